"""What every file of the package keeps to: documented public names, arrays with shapes, calls one can read."""

from __future__ import annotations

import ast
import inspect
import re
import runpy
from collections.abc import Collection, Iterator
from pathlib import Path

import pytest

import ssm_planner
from ssm_planner.cli import COMMANDS

PACKAGE = Path(__file__).parent.parent / "ssm_planner"
FILES = {
    ".".join(file.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__"): file
    for file in sorted(PACKAGE.rglob("*.py"))
}
TREES = {name: ast.parse(file.read_text(encoding="utf-8")) for name, file in FILES.items()}
MAX_POSITIONAL = 5
VARIADIC = {"tag", "vertcat", "horzcat", "_group"}
"""Functions that take any number of the same thing."""
SHAPE = re.compile(r"\((\.\.\.|\w+,|[\w. ×+−/…-]+(, ?[\w. ×+−/…-]*)+)\)|shape|broadcast|\w × \w")
"""A shape as a tuple, such as (n, 4), (samples,) or (..., 3), or in words, such as "shape of mu" and "any shape"."""
ARRAY = re.compile(r"\b(Array|ArrayLike|Indices|NDArray)\b")
COMMAND = {f"run_{name}" for name in COMMANDS} | {f"{name}_arguments" for name in COMMANDS}
"""The two functions of every command, described in `cli` once."""
Definition = ast.FunctionDef | ast.ClassDef


def public(
    tree: ast.Module, open_classes: Collection[str] = ()
) -> Iterator[tuple[str, Definition]]:
    """Public functions and classes of a module, and the public methods of those classes that users hold in hand."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node.name, node
            for part in node.body if node.name in open_classes else ():
                if isinstance(part, ast.FunctionDef) and not part.name.startswith("_"):
                    yield f"{node.name}.{part.name}", part


def undocumented(tree: ast.Module, open_classes: Collection[str] = ()) -> list[str]:
    return [name for name, node in public(tree, open_classes) if not ast.get_docstring(node)]


def said_elsewhere(name: str) -> bool:
    """A command's function, or a method that does what its base class says of it."""
    owner, _, method = name.rpartition(".")
    return name in COMMAND or bool(
        owner and inspect.getdoc(getattr(getattr(ssm_planner, owner), method))
    )


def without_shape(tree: ast.Module, open_classes: Collection[str] = ()) -> list[str]:
    """Public functions that take or return arrays and do not say of which shape."""
    return [
        name
        for name, node in public(tree, open_classes)
        if isinstance(node, ast.FunctionDef)
        and ARRAY.search(
            f"{ast.unparse(node.args)} {ast.unparse(node.returns) if node.returns else ''}"
        )
        and not SHAPE.search(ast.get_docstring(node) or "")
    ]


def long_calls(tree: ast.Module) -> list[str]:
    return [
        f"line {node.lineno}: {ast.unparse(node)[:80]}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and len(node.args) > MAX_POSITIONAL
        and ast.unparse(node.func).rpartition(".")[2] not in VARIADIC
    ]


def test_the_laws_find_what_breaks_them() -> None:
    bad = ast.parse(
        "def f(q: Array) -> None:\n    'Joint values.'\n    g(1, 2, 3, 4, 5, 6)\nclass A:\n    def b(self): ..."
    )
    assert undocumented(bad) == ["A"]
    assert undocumented(bad, {"A"}) == ["A", "A.b"]
    assert without_shape(bad) == ["f"]
    assert long_calls(bad) == ["line 3: g(1, 2, 3, 4, 5, 6)"]
    good = ast.parse(
        "def f(q: Array) -> None:\n    'Joint values (n, 4).'\n    vertcat(1, 2, 3, 4, 5, 6)\n    g(1, 2, e=3)"
    )
    assert not undocumented(good) + without_shape(good) + long_calls(good)


@pytest.mark.parametrize("name", TREES)
def test_a_module_says_what_it_holds(name: str) -> None:
    assert ast.get_docstring(TREES[name]) or not TREES[name].body or name == "__main__"


@pytest.mark.parametrize("name", TREES)
def test_every_public_name_has_a_docstring(name: str) -> None:
    assert not [
        each for each in undocumented(TREES[name], ssm_planner.__all__) if not said_elsewhere(each)
    ]


@pytest.mark.parametrize("name", TREES)
def test_arrays_have_shapes(name: str) -> None:
    assert not without_shape(TREES[name], ssm_planner.__all__)


@pytest.mark.parametrize("name", TREES)
def test_no_call_has_more_than_five_positional_arguments(name: str) -> None:
    assert not long_calls(TREES[name])


def test_the_page_of_public_names_is_up_to_date() -> None:
    script = runpy.run_path(str(PACKAGE.parent / "docs" / "make_api.py"))
    assert script["TARGET"].read_text(encoding="utf-8") == script["page"](), "run `make api`"

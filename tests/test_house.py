"""Every file of the package keeps rules for docstrings, shapes of arrays, calls and lines.

The program that reproduces the paper keeps the same rules.
"""

from __future__ import annotations

import ast
import inspect
import re
import runpy
import subprocess
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path
from unicodedata import combining

import jinja2
import pytest
from jinja2 import nodes
from jinja2.filters import FILTERS

import ssm_planner
from ssm_planner.cli import COMMANDS
from ssm_planner.reproduction import EXAMPLES_FOLDER, PROGRAM_PACKAGE
from tests.support.paths import PACKAGE

FILES = {
    ".".join(file.relative_to(folder).with_suffix("").parts).removesuffix(".__init__"): file
    for folder in (PACKAGE, EXAMPLES_FOLDER)
    for file in sorted(folder.rglob("*.py"))
    if folder == PACKAGE or file.parent.name == PROGRAM_PACKAGE
}
MAX_POSITIONAL = 5
VARIADIC = {"tag", "vertcat", "horzcat", "_group"}
"""Functions that take any number of arguments of the same kind."""
SHAPE = re.compile(r"\((\.\.\.|\w+,|[\w. ×+−/…-]+(, ?[\w. ×+−/…-]*)+)\)|shape|broadcast|\w × \w")
"""A shape is a tuple such as (n, 4), (samples,) or (..., 3).

It can also be stated in words such as "shape of mu" and "any shape".
"""
ARRAY = re.compile(r"\b(Array|ArrayLike|Indices|NDArray)\b")
COMMAND = {f"run_{name}" for name in COMMANDS}
"""Functions that run the commands. The module `cli` describes the commands."""
Definition = ast.FunctionDef | ast.ClassDef


def test_the_top_level_contains_only_what_the_project_consists_of() -> None:
    """The repository contains no other entry, such as a log that a tool left behind."""
    folders = {"docs", "examples", "problems", "results", "ssm_planner", "tests"}
    files = {"CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "Makefile"}
    files |= {"README.md", "constraints.txt", "pyproject.toml"}
    command = ["git", "-C", str(PACKAGE.parent), "ls-files"]
    listing = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    entries = {name.partition("/")[0] for name in listing.splitlines()}
    assert {name for name in entries if not name.startswith(".")} <= folders | files


@cache
def tree(name: str) -> ast.Module:
    """Return the syntax tree of a module."""
    return ast.parse(FILES[name].read_text(encoding="utf-8"))


def public(
    tree: ast.Module, open_classes: Collection[str] = ()
) -> Iterator[tuple[str, Definition]]:
    """Yield the names and definitions of the public functions and classes of a module.

    The public methods of the classes in `open_classes` are included.
    """
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node.name, node
            for part in node.body if node.name in open_classes else ():
                if isinstance(part, ast.FunctionDef) and not part.name.startswith("_"):
                    yield f"{node.name}.{part.name}", part


def undocumented(tree: ast.Module, open_classes: Collection[str] = ()) -> list[str]:
    return [name for name, node in public(tree, open_classes) if not ast.get_docstring(node)]


def said_elsewhere(name: str) -> bool:
    """Return True if a name is documented in another place.

    This holds for the function of a command, and for a method whose base class documents it.
    """
    owner, _, method = name.rpartition(".")
    return name in COMMAND or bool(
        owner and inspect.getdoc(getattr(getattr(ssm_planner, owner), method))
    )


def without_shape(tree: ast.Module, open_classes: Collection[str] = ()) -> list[str]:
    """Return the names of public functions that have arrays without a shape in the docstring."""
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


@pytest.mark.parametrize("name", FILES)
def test_a_module_says_what_it_holds(name: str) -> None:
    assert ast.get_docstring(tree(name)) or not tree(name).body or name == "__main__"


@pytest.mark.parametrize("name", FILES)
def test_every_public_name_has_a_docstring(name: str) -> None:
    assert not [
        item for item in undocumented(tree(name), ssm_planner.__all__) if not said_elsewhere(item)
    ]


@pytest.mark.parametrize("name", FILES)
def test_arrays_have_shapes(name: str) -> None:
    assert not without_shape(tree(name), ssm_planner.__all__)


@pytest.mark.parametrize("name", FILES)
def test_no_call_has_more_than_five_positional_arguments(name: str) -> None:
    assert not long_calls(tree(name))


TEMPLATES = [
    file
    for folder in (PACKAGE, EXAMPLES_FOLDER)
    for file in sorted(folder.rglob("templates/*"))
    if file.suffix not in (".js", ".css")
]
OF_JINJA = {"index", "index0", "first", "last", "length"}
"""Attributes of Jinja's variable `loop`."""
OF_PYTHON = {"items", "keys", "values", "append", "join"}
"""Methods of mappings, lists and texts."""


@cache
def words() -> frozenset[str]:
    """Return all words in the Python sources. These include names, and keys in texts."""
    return frozenset(
        word
        for file in FILES.values()
        for word in re.findall(r"\w+", file.read_text(encoding="utf-8"))
    )


def unknown_to_python(template: str) -> list[str]:
    """Return the attributes and filters of a template that no Python source contains."""
    parsed = jinja2.Environment().parse(template)
    attributes = {node.attr for node in parsed.find_all(nodes.Getattr)} - OF_JINJA - OF_PYTHON
    filters = {node.name for node in parsed.find_all(nodes.Filter)} - set(FILTERS)
    return sorted((attributes | filters) - words())


def test_names_that_only_a_template_has_are_found() -> None:
    assert unknown_to_python("{{ plan.robot.no_such_attribute | number }}") == ["no_such_attribute"]
    assert unknown_to_python("{{ 3.0 | no_such_filter }}") == ["no_such_filter"]
    assert not unknown_to_python("{% for j in joints %}{{ loop.index }} {{ j.name }}{% endfor %}")


@pytest.mark.parametrize("file", TEMPLATES, ids=lambda file: file.name)
def test_python_names_every_attribute_and_filter_of_a_template(file: Path) -> None:
    """Every attribute and filter of a template occurs in a Python source.

    Tools that search for unused names in Python do not read templates, so this test does.
    """
    assert not unknown_to_python(file.read_text(encoding="utf-8"))


def test_the_page_of_public_names_is_up_to_date() -> None:
    script = runpy.run_path(str(PACKAGE.parent / "docs" / "make_api.py"))
    assert script["TARGET"].read_text(encoding="utf-8") == script["page"](), "run `make api`"


TO_WRAP = {"identification", "planning", "view"}
"""Parts of the package that still have longer lines."""


def long_lines(text: str) -> list[int]:
    """Return the numbers of the lines above 100 columns. A combining accent takes no column."""
    widths = [sum(not combining(letter) for letter in line) for line in text.splitlines()]
    return [number for number, width in enumerate(widths, 1) if width > 100]


@pytest.mark.parametrize("name", [name for name in FILES if name.split(".")[0] not in TO_WRAP])
def test_lines_have_at_most_100_columns(name: str) -> None:
    assert not long_lines(FILES[name].read_text(encoding="utf-8"))


def test_long_lines_are_noticed() -> None:
    assert long_lines("a" * 100 + "\n" + "a" * 101 + "\n" + "s\u0307" * 100) == [2]

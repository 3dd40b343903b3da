"""Write docs/api.md, the public names of ssm_planner with their docstrings: `make api`, or `python docs/make_api.py`."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, get_origin

import ssm_planner

HOMES = {
    alias.name: f"ssm_planner.{node.module}"
    for node in ast.walk(ast.parse(Path(ssm_planner.__file__).with_suffix(".pyi").read_text()))
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
}
"""Modules that define the public names."""
TARGET = Path(__file__).with_name("api.md")
BAR = "\\|"  # within a table
QUANTITY = r"Annotated\[(\w+), '[^']*'\]|(Annotated\[.*), '[^']*'(?=\])"  # of files, not of Python
NO_SPACE = r"(?<=[\w\]])=(?=\S)"
HEAD = """\
# Public names

Everything in `ssm_planner.__all__`; `make api` writes this page from the docstrings. With `import ssm_planner as ssm` the
names are `ssm.load_problem`, `ssm.plan` and so on. Quantities are in SI units and radians, arrays are (samples, joints).
"""


def page() -> str:
    """The whole of docs/api.md."""
    values = {
        name: getattr(ssm_planner, name) for name in sorted(ssm_planner.__all__, key=str.casefold)
    }
    functions = [name for name, value in values.items() if inspect.isroutine(value)]
    classes = [
        name
        for name, value in values.items()
        if inspect.isclass(value) and get_origin(value) is None and value is not str
    ]
    constants = [name for name in values if name not in {*functions, *classes}]
    parts = [HEAD]
    for title, names in (("Functions", functions), ("Values", classes)):
        parts.append(
            f"{title}: " + ", ".join(f"[`{name}`](#{name.lower()})" for name in names) + ".\n"
        )
    parts.append("## Functions\n")
    parts += [
        f"### {name}\n\n{_code([_signature(name, _tree(values[name]))])}{_text(values[name])}"
        for name in functions
    ]
    parts.append("## Values\n")
    parts += [_class(name, values[name]) for name in classes]
    parts.append("## Units and types\n\n| name | value | meaning |\n|---|---|---|")
    parts += [_constant(name, values[name]) for name in constants]
    return "\n".join(parts) + "\n"


def _class(name: str, kind: type) -> str:
    """Docstring, fields (or else the constructor's arguments), properties and methods of a class."""
    lines = [f"{name}:", *(f"    {line}" for base in _bases(kind) for line in _fields(_tree(base)))]
    made_here = (
        "__init__" in vars(kind) and inspect.isfunction(vars(kind)["__init__"]) and len(lines) == 1
    )
    if made_here:
        lines = [_signature(name, _tree(kind.__init__))]
    members = {}
    for base in _bases(kind):
        for node in _tree(base).body:
            if isinstance(node, ast.FunctionDef) and node.name[0] != "_":
                members[node.name] = node
    parts = [f"### {name}\n", _text(kind), _code(lines) if len(lines) > 1 or made_here else ""]
    for member, node in members.items():
        is_value = any("property" in ast.unparse(decorator) for decorator in node.decorator_list)
        prefix = (
            f"{name}." if any("classmethod" in ast.unparse(d) for d in node.decorator_list) else ""
        )
        head = (
            f"{member}: {ast.unparse(node.returns)}"
            if is_value and node.returns
            else prefix + _signature(member, node)
        )
        text = (ast.get_docstring(node) or "").replace("\n\n", "\n").replace("\n", "\n  ")
        parts.append(f"* `{head}`" + (f"  \n  {text}" if text else ""))
    return "\n".join(part for part in parts if part) + "\n"


def _bases(kind: type) -> list[type]:
    """The class and those of its bases that are of this package, bases first."""
    return [base for base in reversed(kind.__mro__) if base.__module__.startswith("ssm_planner")]


def _tree(value: Any) -> Any:
    """The definition of a function or class as a syntax tree."""
    return ast.parse(inspect.cleandoc("\n" + inspect.getsource(inspect.unwrap(value)))).body[0]


def _fields(tree: ast.ClassDef) -> Iterator[str]:
    """One line for each public field, its docstring as a comment."""
    for node, meaning in _with_docstrings(tree.body):
        if (
            isinstance(node, ast.AnnAssign)
            and isinstance(node.target, ast.Name)
            and node.target.id[0] != "_"
        ):
            text = re.sub(QUANTITY, r"\1\2", ast.unparse(node)).replace(
                "field(default_factory=dict)", "{}"
            )
            yield text + (f"  # {meaning}" if meaning else "")


def _with_docstrings(body: list[ast.stmt]) -> Iterator[tuple[ast.stmt, str]]:
    """Statements, each with the string that stands below it, on one line."""
    for node, after in zip(body, [*body[1:], ast.Pass()], strict=True):
        text = (
            after.value.value
            if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            else ""
        )
        yield node, " ".join(text.split()) if isinstance(text, str) else ""


def _signature(name: str, node: ast.FunctionDef) -> str:
    arguments = node.args
    for first in (arguments.posonlyargs, arguments.args):
        if first and first[0].arg in ("self", "cls"):
            del first[0]
    returns = f" -> {ast.unparse(node.returns)}" if node.returns and node.name != "__init__" else ""
    text = ast.unparse(arguments).replace("lambda :", "lambda:")  # as Python 3.10 writes it
    return f"{name}({re.sub(NO_SPACE, ' = ', text)}){returns}"


def _constant(name: str, value: object) -> str:
    """A row of the table: a number or what a type stands for, and the docstring below it."""
    module = HOMES[name]
    body = ast.parse(inspect.getsource(import_module(module))).body
    for node, meaning in _with_docstrings(body):
        if isinstance(node, ast.Assign) and name in {
            n.id for n in ast.walk(node.targets[0]) if isinstance(n, ast.Name)
        }:
            text = f"{value:.9g}" if isinstance(value, float) else ast.unparse(node.value)
            return f"| `{name}` | `{text.replace('|', BAR)}` | {meaning.replace('|', BAR)} |"
    raise LookupError(f"no assignment to {name} in {module}")


def _code(lines: list[str]) -> str:
    return "\n".join(["```python", *lines, "```", ""])


def _text(value: Any) -> str:
    return (ast.get_docstring(_tree(value)) or "") + "\n"


if __name__ == "__main__":
    TARGET.write_text(page(), encoding="utf-8")

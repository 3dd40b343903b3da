"""No law and no table of units exists twice in the package.

Two functions with the same operations are found even if their names differ.
"""

from __future__ import annotations

import ast
import hashlib
import pickle
from collections import defaultdict

import pytest

from tests.support.paths import PACKAGE

FUNCTION_NODES = 60
"""Functions with fewer nodes may be alike by chance."""
ARITHMETIC_NODES = 25
"""Arithmetic expressions with fewer nodes may be alike by chance."""
PREFIXES = {"np", "numpy", "ca", "casadi", "math", "xp"}
SAME = {
    "fmax": "maximum",
    "fmin": "minimum",
    "if_else": "where",
    "fabs": "abs",
    "arctan2": "atan2",
    "norm_2": "norm",
}
"""Different names of the same functions in NumPy and CasADi."""
SCALES = {1e-3, 1e3, 1e-6, 60.0}
UNITS = {
    "mm",
    "deg",
    "deg/s",
    "mm/s",
    "mN·m",
    "rpm",
    "ms",
    "rad/s",
    "m/s",
    "mA",
    "kHz",
    "g",
    "min",
    "µm",
}


class _Shape(ast.NodeTransformer):
    """A transformer that removes names, types and docstrings from a syntax tree.

    Local names are replaced by their order of appearance. Called functions keep their names.
    """

    def __init__(self) -> None:
        self.numbers: dict[str, str] = {}

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return ast.Name(self.numbers.setdefault(node.id, f"v{len(self.numbers)}"), ast.Load())

    def visit_arg(self, node: ast.arg) -> ast.AST:
        return ast.arg(self.numbers.setdefault(node.arg, f"v{len(self.numbers)}"))

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        name = SAME.get(node.attr, node.attr)
        if isinstance(node.value, ast.Name) and node.value.id in PREFIXES:
            return ast.Name(name, ast.Load())
        return ast.Attribute(self.visit(node.value), name, ast.Load())

    def visit_Call(self, node: ast.Call) -> ast.AST:
        # A function that is called without a module keeps its name.
        called = (
            ast.Name(node.func.id, ast.Load())
            if isinstance(node.func, ast.Name)
            else self.visit(node.func)
        )
        return ast.Call(
            called,
            [self.visit(item) for item in node.args],
            [self.visit(item) for item in node.keywords],
        )

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        return (
            self.visit(ast.Assign([node.target], node.value, lineno=0))
            if node.value
            else ast.Pass()
        )

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        body = node.body
        if isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
            body = body[1:]
        arguments = [
            self.visit(arg)
            for arg in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
        ]
        return ast.Module([*arguments, *(self.visit(item) for item in body)], [])


def shape(node: ast.AST) -> tuple[int, str]:
    """Return the number of nodes and a digest of a tree.

    Trees with the same operations have the same digest even if their local names differ.
    """
    text = ast.dump(_Shape().visit(pickle.loads(pickle.dumps(node))))
    return text.count("("), hashlib.sha256(text.encode()).hexdigest()


def functions(nodes: list[ast.AST]) -> list[ast.FunctionDef]:
    return [node for node in nodes if isinstance(node, ast.FunctionDef)]


ARITHMETIC = (
    ast.BinOp,
    ast.UnaryOp,
    ast.Name,
    ast.Attribute,
    ast.Constant,
    ast.operator,
    ast.unaryop,
    ast.expr_context,
)


def laws(nodes: list[ast.AST]) -> list[ast.AST]:
    """Return the assigned and returned expressions that consist of arithmetic only."""
    values = [
        node.value for node in nodes if isinstance(node, (ast.Return, ast.Assign)) and node.value
    ]
    return [
        value for value in values if all(isinstance(part, ARITHMETIC) for part in ast.walk(value))
    ]


def twins(sources: dict[str, str]) -> list[list[str]]:
    """Return groups of functions or arithmetic expressions that do the same, as "file:line"."""
    result: dict[str, list[str]] = defaultdict(list)
    for name, text in sources.items():
        tree = list(ast.walk(ast.parse(text)))
        for node, least in [(f, FUNCTION_NODES) for f in functions(tree)] + [
            (v, ARITHMETIC_NODES) for v in laws(tree)
        ]:
            nodes, digest = shape(node)
            if nodes >= least:
                result[digest].append(f"{name}:{node.lineno}")
    return [places for places in result.values() if len(places) > 1]


def scale_tables(sources: dict[str, str]) -> list[str]:
    """Return the positions of tables outside units.py that contain factors of units."""
    result = []
    for name, text in sources.items():
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.Dict) or len(node.keys) < 3:
                continue
            keys = [
                key.value
                for key in node.keys
                if isinstance(key, ast.Constant) and isinstance(key.value, str)
            ]
            scaled = [
                value
                for value in node.values
                if any(
                    isinstance(part, ast.Constant) and part.value in SCALES
                    for part in ast.walk(value)
                )
            ]
            if len(set(keys) & UNITS) >= 2 and scaled:
                result.append(f"{name}:{node.lineno}")
    return result


SOURCES = {
    str(file.relative_to(PACKAGE)): file.read_text(encoding="utf-8")
    for file in sorted(PACKAGE.rglob("*.py"))
}


def test_no_function_and_no_law_stands_twice() -> None:
    assert not twins(SOURCES)


def test_units_have_their_factors_in_one_place() -> None:
    assert not scale_tables({name: text for name, text in SOURCES.items() if name != "units.py"})


FRICTION = '''
def sliding(drive, F, direction, mu):
    """One law."""
    up, down = coefficients(drive, mu)
    mean, half = 0.5 * (up + down), 0.5 * (up - down)
    first = np.where(direction > 0, np.maximum(up * F, down * F), mean * F)
    return first + direction * half * abs(F) + drive.inertia * direction
'''
TWIN = """
def torque_of_mesh(gear: Gear, load: ca.SX, way: ca.SX, coefficient: ca.SX) -> ca.SX:
    larger, smaller = coefficients(gear, coefficient)
    middle, spread = 0.5 * (larger + smaller), 0.5 * (larger - smaller)
    value = ca.if_else(way > 0, ca.fmax(larger * load, smaller * load), middle * load)
    return value + way * spread * abs(load) + gear.inertia * way
"""


def test_a_twin_under_other_names_is_found() -> None:
    assert twins({"numpy.py": FRICTION, "casadi.py": TWIN}) == [["numpy.py:2", "casadi.py:2"]]
    assert not twins(
        {"numpy.py": FRICTION, "casadi.py": TWIN.replace("spread * abs(load)", "spread * load")}
    )


@pytest.mark.parametrize("names", [("a", "b", "c", "d"), ("slope", "inertia", "w", "wd")])
def test_a_law_written_again_is_found(names: tuple[str, str, str, str]) -> None:
    a, b, c, d = names
    law = f"x = {a} * f + {b} * {d} + 0.5 * ({a} - {b}) * {c} + r * {c} * {d}\n"
    assert twins({"one.py": "x = k * f + j * q + 0.5 * (k - j) * p + r * p * q\n", "two.py": law})


def test_a_table_of_units_is_found() -> None:
    table = 'SCALE = {"deg": math.pi / 180, "mm": 1e-3, "s": 1.0}\n'
    assert scale_tables({"elsewhere.py": table}) == ["elsewhere.py:1"]
    assert not scale_tables(
        {"elsewhere.py": 'NAMES = {"deg": "degrees", "mm": "millimetres", "s": "seconds"}\n'}
    )

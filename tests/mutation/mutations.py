"""Enumerate the mutants of a module and put one of them into the running process.

A mutant replaces one node of the syntax tree of one function. Only the bodies and the defaults of
functions are mutated, because values that a module computes during its import cannot be replaced
afterwards.
"""

from __future__ import annotations

import ast
import copy
import gc
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FunctionType

COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
NAMES = {"min": "max", "minimum": "maximum", "argmin": "argmax", "floor": "ceil", "any": "all"}
NAMES |= {other: name for name, other in NAMES.items()}
SMALL = 1e-3
"""Floats of a smaller absolute value are multiplied by 100, and other floats by 1.25.

Such small floats are tolerances, and a change by a quarter could go unnoticed.
"""

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Mutant:
    """One changed node of one function, with the original and the changed text."""

    file: str
    function: str
    line: int
    lines: tuple[int, ...]
    """Lines of the mutated statement. A test that runs one of these lines covers the mutant."""
    original: str
    mutated: str
    place: tuple[int, int, int]
    """Index of the function in the module, of the node in the function, and of the replacement."""

    @property
    def key(self) -> tuple[str, str, str, str]:
        """The key of the mutant in the list of equivalent mutants. It contains no line number."""
        return self.file, self.function, self.original, self.mutated


def _functions(tree: ast.Module) -> list[tuple[str, Function]]:
    """Return the functions of a module and the methods of its classes with qualified names."""
    functions: list[tuple[str, Function]] = []

    def visit(body: list[ast.stmt], prefix: str) -> None:
        for statement in body:
            if isinstance(statement, Function):
                functions.append((prefix + statement.name, statement))
            elif isinstance(statement, ast.ClassDef):
                visit(statement.body, f"{prefix}{statement.name}.")

    visit(tree.body, "")
    return functions


def _constants(node: ast.Constant) -> Iterator[ast.expr]:
    value = node.value
    if isinstance(value, bool):
        yield ast.Constant(not value)
    elif isinstance(value, int):
        yield ast.Constant(value + 1)
        yield ast.Constant(value - 1)
    elif isinstance(value, float):
        yield ast.Constant(value * (1.25 if abs(value) >= SMALL else 100) if value else 1.0)


def _expressions(node: ast.expr) -> Iterator[ast.expr]:
    """Yield the replacements of an expression."""
    if isinstance(node, ast.Constant):
        yield from _constants(node)
    elif isinstance(node, ast.Compare):
        for k, operator in enumerate(node.ops):
            for other in COMPARISONS[type(operator)]:
                operators = [*node.ops[:k], other(), *node.ops[k + 1 :]]
                yield ast.Compare(node.left, operators, node.comparators)
    elif isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC:
        text = any(isinstance(side, ast.JoinedStr) for side in (node.left, node.right))
        if not text:
            yield ast.BinOp(node.left, ARITHMETIC[type(node.op)](), node.right)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.And() if isinstance(node.op, ast.Or) else ast.Or(), node.values)
    elif isinstance(node, ast.UnaryOp) and not isinstance(node.operand, ast.Constant):
        yield node.operand
    elif isinstance(node, ast.IfExp):
        yield node.body
        yield node.orelse
    elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in NAMES:
        yield ast.Name(NAMES[node.id], ast.Load())
    elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load) and node.attr in NAMES:
        yield ast.Attribute(node.value, NAMES[node.attr], ast.Load())


def _conditional(node: ast.If | ast.While) -> Iterator[ast.stmt]:
    for value in (False,) if isinstance(node, ast.While) else (True, False):
        yield type(node)(ast.Constant(value), node.body, node.orelse)


def _statements(node: ast.stmt) -> Iterator[ast.stmt]:
    """Yield the replacements of a statement."""
    if isinstance(node, ast.If | ast.While) and not isinstance(node.test, ast.Constant):
        yield from _conditional(node)
    elif isinstance(node, ast.Return) and node.value is not None:
        if not (isinstance(node.value, ast.Constant) and node.value.value is None):
            yield ast.Return(ast.Constant(None))
    elif isinstance(node, ast.Raise) or (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    ):
        yield ast.Pass()
    elif isinstance(node, ast.AugAssign) and type(node.op) in ARITHMETIC:
        yield ast.AugAssign(node.target, ARITHMETIC[type(node.op)](), node.value)
    elif isinstance(node, ast.Break):
        yield ast.Continue()
    elif isinstance(node, ast.Continue):
        yield ast.Break()


Site = tuple[ast.AST, str, int | None, ast.AST, ast.stmt]


def _sites(function: Function) -> Iterator[Site]:
    """Yield (parent, field, index, node, enclosing statement) of each node that may be mutated."""

    def visit(parent: ast.AST, statement: ast.stmt) -> Iterator[Site]:
        for field, value in ast.iter_fields(parent):
            if field in ("annotation", "returns", "decorator_list", "format_spec", "msg"):
                continue
            if isinstance(parent, ast.Raise) and field in ("exc", "cause"):
                continue  # Messages are not mutated.
            if isinstance(parent, ast.keyword) and parent.arg == "strict":
                continue  # This only asserts equal lengths, and they are equal.
            for index, node in enumerate(value) if isinstance(value, list) else [(None, value)]:
                if isinstance(node, ast.AST):
                    inner = node if isinstance(node, ast.stmt) else statement
                    if isinstance(node, ast.expr | ast.stmt):
                        yield parent, field, index, node, inner
                    yield from visit(node, inner)

    yield from visit(function, function)


def _replacements(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.expr):
        yield from _expressions(node)
    elif isinstance(node, ast.stmt):
        yield from _statements(node)


def _put(site: Site, node: ast.AST) -> None:
    parent, field, index = site[:3]
    if index is None:
        setattr(parent, field, node)
    else:
        getattr(parent, field)[index] = node


def _header(statement: ast.stmt) -> str:
    """Return the first line of a compound statement, or the whole text of another statement."""
    text = ast.unparse(statement)
    if isinstance(statement, Function):  # Decorators come before the first line.
        return next(line for line in text.splitlines() if "def " in line)
    return text.splitlines()[0] if hasattr(statement, "body") else text


def _lines(statement: ast.stmt, function: Function) -> tuple[int, ...]:
    """Return the lines of a statement without the statements in its body.

    For a default of the function, return all lines of its body.
    """
    if statement is function:
        return tuple(range(function.body[0].lineno, (function.end_lineno or 0) + 1))
    body = getattr(statement, "body", None)
    end = max(body[0].lineno - 1, statement.lineno) if body else statement.end_lineno or 0
    return tuple(range(statement.lineno, end + 1))


def mutants(path: Path, file: str) -> list[Mutant]:
    """Return all mutants of a module in the order of their lines."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    result = []
    for number, (name, function) in enumerate(_functions(tree)):
        for k, site in enumerate(_sites(function)):
            node, statement = site[3:]
            original = _header(statement)
            for j, other in enumerate(_replacements(node)):
                _put(site, other)
                changed = other if node is statement else statement
                assert isinstance(changed, ast.stmt)
                mutated = _header(changed)
                _put(site, node)
                if mutated != original:
                    line, lines = statement.lineno, _lines(statement, function)
                    place = (number, k, j)
                    result.append(Mutant(file, name, line, lines, original, mutated, place))
    return result


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def swap(path: Path, mutant: Mutant) -> int:
    """Put the mutated code into every existing function that has the original code.

    Return the number of these functions.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    number, node, replacement = mutant.place
    name, function = _functions(tree)[number]
    site = list(_sites(function))[node]
    first = min([function.lineno, *(d.lineno for d in function.decorator_list)])
    changed = list(_replacements(site[3]))[replacement]
    # A function only accepts code with the same free variables. The original body is therefore
    # appended as unreachable code.
    original = [item for item in function.body if not isinstance(item, ast.Global | ast.Nonlocal)]
    unreachable = ast.If(ast.Constant(False), copy.deepcopy(original), [])
    _put(site, ast.copy_location(changed, site[3]))
    function.body.append(ast.copy_location(unreachable, function.body[-1]))
    compiled = compile(ast.fix_missing_locations(tree), str(path), "exec", dont_inherit=True)
    every = reversed([*_codes(compiled)])  # The first code of a name wins.
    codes = {(c.co_name, c.co_firstlineno): c for c in every}
    outer = codes[name.rpartition(".")[2], first]
    family = {(c.co_name, c.co_firstlineno): c for c in reversed([*_codes(outer)])}
    swapped = 0
    for living in [f for f in gc.get_objects() if isinstance(f, FunctionType)]:
        code = living.__code__
        new = family.get((code.co_name, code.co_firstlineno))
        if new is None or code.co_filename != str(path) or code.co_freevars != new.co_freevars:
            continue
        living.__code__ = new
        swapped += 1
        if new is outer and site[4] is function:
            _swap_defaults(living, function)
    return swapped


def _swap_defaults(living: FunctionType, function: Function) -> None:
    def value(node: ast.expr) -> object:
        expression = ast.fix_missing_locations(ast.Expression(node))
        return eval(compile(expression, "default", "eval"), living.__globals__)

    living.__defaults__ = tuple(map(value, function.args.defaults)) or None
    keywords = zip(function.args.kwonlyargs, function.args.kw_defaults, strict=True)
    living.__kwdefaults__ = {a.arg: value(d) for a, d in keywords if d is not None} or None

"""Mutate one operator of `examples/prove.py` at a time and compare its proofs of five plans.

    python -m tests.mutation.of_proof --count 300 --seed 1

A mutant is found if it raises an error, or if a bound, a verdict or a name differs from that of the
original by more than the enclosures permit. Mutants that only change the allowance for rounding
cannot be found in this way, so these operators are not mutated. The program lists all survivors.
"""

from __future__ import annotations

import argparse
import ast
import copy
import itertools
import json
import math
import signal
import types
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import ssm_planner as ssm
from tests.support.paths import ROOT

FILE = ROOT / "examples/prove.py"
SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.Lt: ast.GtE,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.GtE: ast.Lt,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
MAX_ROUNDING = 1e-10
"""A smaller number in `examples/prove.py` is an allowance for rounding."""
SAME = 1e-7
"""Relative difference up to which two bounds count as the same."""

LONGEST = 5.0
"""CPU time in s after which a mutant counts as found."""


def _stop(*_: object) -> None:
    raise TimeoutError


def is_swapped(node: ast.AST) -> bool:
    """Return True if a mutant swaps the operator of a node."""
    if isinstance(node, ast.UnaryOp):
        return isinstance(node.op, ast.USub) and isinstance(node.operand, ast.Constant)
    return type(operator_of(node)) in SWAPS


def rounding_nodes(tree: ast.AST) -> set[ast.AST]:
    """Return the nodes that only serve the allowance for rounding.

    They are rounding terms such as `4 * U`, sums that add such a term, factors such as `UP` or
    `1 + 1e-12`, and products with such a factor. The other operand of such a sum or product is not
    among them.
    """
    result: set[ast.AST] = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.BinOp):
            continue
        if is_rounding_term(node):
            result |= set(ast.walk(node))
        for operand in (node.left, node.right):
            is_sum = isinstance(node.op, ast.Add | ast.Sub)
            if is_rounding_term(operand) if is_sum else is_rounding_factor(operand):
                result |= {node, *ast.walk(operand)}
    return result


def is_rounding_term(node: ast.AST) -> bool:
    """Return True if a number is as small as a rounding error: U, TINY, 1e-12 or a multiple."""
    if isinstance(node, ast.BinOp):
        parts = is_rounding_term(node.left), is_rounding_term(node.right)
        is_sum = isinstance(node.op, ast.Add | ast.Sub)
        return all(parts) if is_sum else isinstance(node.op, ast.Mult) and any(parts)
    if isinstance(node, ast.Constant):
        return isinstance(node.value, float) and 0 < node.value < MAX_ROUNDING
    return isinstance(node, ast.Name) and node.id in ("U", "TINY")


def is_rounding_factor(node: ast.AST) -> bool:
    """Return True if a number differs from 1 by a rounding term only."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        is_one = isinstance(node.left, ast.Constant) and node.left.value == 1
        return is_one and is_rounding_term(node.right)
    return isinstance(node, ast.Name) and node.id == "UP"


def operator_of(node: ast.AST) -> ast.AST | None:
    """Return the operator of a node. A comparison returns its first operator."""
    return node.ops[0] if isinstance(node, ast.Compare) else getattr(node, "op", None)


def mutant(tree: ast.AST, number: int) -> tuple[int, str, str]:
    """Return (line, operator, source) with the operator of node `number` swapped."""
    changed = copy.deepcopy(tree)
    node: Any = [*ast.walk(changed)][number]
    old = operator_of(node)
    new = ast.UAdd() if isinstance(node, ast.UnaryOp) else SWAPS[type(old)]()
    if isinstance(node, ast.Compare):
        node.ops[0] = new
    else:
        node.op = new
    return node.lineno, f"{type(old).__name__} → {type(new).__name__}", ast.unparse(changed)


def load(source: str) -> types.ModuleType:
    """Return the module that a source text defines."""
    module = types.ModuleType("mutant")
    exec(compile(source, "mutant", "exec"), vars(module))
    return module


@cache
def plans() -> tuple[dict[str, Any], ...]:
    """Return five plans that together use every branch of the proof.

    They contain Stribeck friction, a preloaded screw, holding by a motor, ranges, paths and cases.
    """
    first, second = (
        json.loads((ROOT / f"results/{name}/plan.json").read_text(encoding="utf-8"))
        for name in ("eye_approach", "tilt_insert")
    )
    one, two, _, four = first["problem"]["robot"]["joints"]
    for joint, law in ((one, "stribeck_gaussian"), (two, "stribeck_exponential")):
        joint["drive"]["friction"] |= {
            "law": law,
            "mu_stribeck": 0.05,
            "stribeck_speed": 30.0,
            "b_oc": 0.002,
            "b_ov": 0.003,
        }
    four["drive"] |= {"kind": "antibacklash_screw", "preload": 6.0, "second_nut_mass": 0.05}
    first["problem"] |= {"tip_speed": 0.03}
    first["problem"]["limits"] |= {"spin": [-1.0, 1.5], "roll": [-2.0, 2.5]}
    for joint in second["problem"]["robot"]["joints"]:
        if joint["drive"]:
            joint["drive"] |= {"self_locking": False}
            joint["drive"]["friction"] |= {"mu": 0.01, "mu_static": 0.02}
        joint["jerk"] = 1e4
    return first, second, bent_line(), cut_corners(), ranged()


def bent_line() -> dict[str, Any]:
    """Return a plan that begins in motion.

    Its problem is changed after the planning: the line gets another target, and the start another
    rate.
    """
    task = ssm.Task(roll=0.0, tilt=-100 * ssm.deg, spin=0.0, depth=0.01)
    motion = (
        ssm.Free(ssm.Task(roll=5 * ssm.deg, tilt=-115 * ssm.deg, depth=0.012)),
        ssm.Straight(roll=-8 * ssm.deg, tilt=-100 * ssm.deg, depth=0.02),
    )
    rate = {"roll": 0.05, "tilt": -0.1, "spin": 0.02, "depth": 0.002}
    problem = replace(
        ssm.load_problem("tilt_insert"),
        start=task,
        motion=motion,
        start_rate=rate,
        planner="fast",
        eye=None,
    )
    document: dict[str, Any] = json.loads(ssm.plan(problem).to_json())
    target = {"roll": -0.2 - 2 * math.pi, "depth": 0.019}  # A full turn changes nothing.
    document["problem"]["motion"][1]["target"]["task"] |= target
    document["problem"]["start_rate"] |= {"roll": 0.06, "tilt": -0.12, "spin": 0.01, "depth": 0.003}
    return document


def cut_corners() -> dict[str, Any]:
    """Return a plan along a line, an arc and a great circle above the retina.

    Its problem is changed slightly after the planning.
    """
    deg, mm = ssm.deg, ssm.mm
    eye = ssm.load_problem("eye_approach")
    tips = [ssm.Tip((x * mm, y * mm, z * mm), 0.0) for x, y, z in TIPS]
    motion = (
        ssm.Free(tips[0]),
        ssm.Follow(tips[1], curve="line", blend=0.3 * mm),
        ssm.Follow(tips[3], (tips[2],), curve="arc"),
        ssm.Follow(tips[4], curve="line", constant_speed=5 * mm),
        ssm.Follow(ssm.Task(roll=5 * deg, tilt=-112 * deg), curve="retina", distance=2 * mm),
    )
    problem = replace(eye, motion=motion, planner="fast", limits=eye.limits[:3])
    document: dict[str, Any] = json.loads(ssm.plan(problem).to_json())
    motions = document["problem"]["motion"]
    motions[1]["blend"], motions[3]["constant_speed"] = 0.28 * mm, 4.999999 * mm
    motions[4]["target"]["task"]["tilt"] += 1e-6
    return document


TIPS = ((6, -3, -13), (3, -4, -13), (2, -1, -13), (3, 2, -13), (5, 3, -13.5))
"""Positions of the tip, in mm."""


def ranged() -> dict[str, Any]:
    """Return a short motion with ranges of friction and payload."""
    plan = json.loads((ROOT / "results/tilt_insert/plan.json").read_text(encoding="utf-8"))
    motion, problem = plan["trajectory"], plan["problem"]
    middle = motion["breaks_s"].index(motion["phases"][0]["end_s"])
    motion["breaks_s"] = motion["breaks_s"][middle - 40 : middle + 41]
    motion["coefficients"] = motion["coefficients"][middle - 40 : middle + 40]
    motion["phases"], problem["motion"] = [], []
    problem["friction"], problem["payload"] = 0.9, [0.01, 0.2]
    for drive in (joint["drive"] for joint in problem["robot"]["joints"] if joint["drive"]):
        drive["self_locking"] = False
        law = drive["friction"] | {"mu": 0.02, "mu_static": 0.2, "b_ov": 1e-3}
        shares = {"mu": (0.9, 1.2), "b_c": (0.8, 1.3), "b_oc": (0.2, 3.0), "b_ov": (0.0, 3.0)}
        drive["friction_ranges"] = {
            name: [law[name] * share for share in ends] for name, ends in shares.items()
        }
        drive["friction"] = law
    return plan


def answers(module: types.ModuleType) -> Iterator[tuple[Any, ...]]:
    """Yield the claims of a module about all plans as tuples.

    The first tuples contain results of functions that these plans seldom reach. The claims about
    the plans take longest and therefore follow last.
    """
    zero = np.zeros(1)
    with np.errstate(all="ignore"):
        for low, high in ((-0.5, 0.7), (-2.5, 2.0), (0.3, 0.3), (3.0, 3.5)):
            for psi in (-3.0, -1.0, 0.2, 0.31, 2.2, 3.1):
                c, s = (module.constant(np.array([x])) for x in (math.cos(psi), math.sin(psi)))
                for functions, limit, side, value in module.angle(c, s, low, high):
                    ends = module.supremum(functions, zero == 0, zero, zero + 1)[:2]
                    yield ("angle", None, *map(value, ends), limit, side, 0.0, "")
        wide = module.Model(np.array([[2.0, -0.5], [0.3, 0.2]]), np.zeros(2))
        for model in (module.exponential(wide - 2.0), module.power(wide + 9.0, 0.5)):
            yield ("model", None, *map(float, [*model.c[:3, 0], *model.r]), "")
        bad = module.Model(np.array([[1.0, np.nan]]), np.zeros(2))
        ends = module.supremum([bad], np.array([True, False]), np.zeros(2), np.ones(2))[:2]
        yield ("open", None, *map(float, ends), "")
        loose = module.Model(np.array([[0.1, 2.0], [1.0, 0.1]]), np.array([0.3, 0.2]))
        for ends in (module.bounds(loose), module.heat(loose, [loose, loose * 0.5])):
            yield ("loose", None, *map(float, np.ravel(ends)), "")
        for angle in (-0.4, 0.0, 0.4):  # the tool on both sides of the axes' plane
            yield ("side", None, *map(float, sides(module, angle)), "")
    for plan in plans():
        yield from map(tuple, module.prove(plan))


def sides(module: types.ModuleType, angle: float) -> tuple[float, float]:
    """Return the sign of the tilt at home for two directions of the third axis.

    The first direction is the plan's axis turned about the first joint axis by `angle` in rad. The
    second one is its opposite.
    """
    plan = copy.deepcopy(plans()[1])
    geometry, result = plan["problem"]["robot"]["geometry"], []
    first, axis = (np.array(geometry[name]) for name in ("omega1", "omega3"))
    along = first * (first @ axis)
    axis = along + (axis - along) * math.cos(angle) + np.cross(first, axis) * math.sin(angle)
    for sign in (1.0, -1.0):
        geometry["omega3"] = (sign * axis).tolist()
        boxes = module.Boxes(plan, np.zeros(1, int), np.zeros(1), np.full(1, 1e-3))
        boxes.efforts()
        result.append(boxes.side)
    return result[0], result[1]


def differs(one: list[tuple[Any, ...]], two: Iterator[tuple[Any, ...]]) -> bool:
    """Return True if answers differ by more than the enclosures permit.

    The second answers are computed one after the other, up to the first difference.
    """
    for a, b in itertools.zip_longest(one, two):
        if a is None or b is None:
            return True
        if (a[0], a[1], a[-1]) != (b[0], b[1], b[-1]) or len(a) != len(b):
            return True
        values = [(x, y) for k, (x, y) in enumerate(zip(a[2:-1], b[2:-1], strict=True)) if k != 3]
        scale = max((abs(x) for x, _ in values if math.isfinite(x)), default=0.0) + 1e-9
        if any(not (x == y or abs(x - y) <= SAME * scale) for x, y in values):
            return True
    return False


def survivors(count: int, seed: int) -> Iterator[tuple[int, str, bool]]:
    """Yield (line, operator, found) of a random sample of mutants."""
    source = Path(FILE).read_text(encoding="utf-8")
    tree = ast.parse(source)
    rounding = rounding_nodes(tree)
    swapped = [
        number
        for number, node in enumerate(ast.walk(tree))
        if is_swapped(node) and node not in rounding
    ]
    rng = np.random.default_rng(seed)
    truth = list(answers(load(source)))
    for number in rng.permutation(swapped)[:count]:
        line, name, text = mutant(tree, int(number))
        signal.signal(signal.SIGVTALRM, _stop)
        signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST)
        try:
            with np.errstate(all="ignore"):
                result = differs(truth, answers(load(text)))
        except (Exception, SystemExit):  # noqa: BLE001 a mutant may raise anything
            result = True
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        yield line, name, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    total = killed = 0
    for line, name, is_found in survivors(options.count, options.seed):
        total, killed = total + 1, killed + is_found
        if not is_found:
            print(f"line {line}: {name} survives", flush=True)
    print(f"{killed} of {total} mutants found")


if __name__ == "__main__":
    main()

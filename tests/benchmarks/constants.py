"""Find a named problem that changes when a constant of the planner is doubled or halved.

    python -m tests.benchmarks.constants [--only NAME …] [--cpu] [--list] [-o FILE]

Every constant at the level of a module in ROOMS is halved and doubled. A separate process imports
the module with the changed constant. The problems are planned until one of them changes. A change
counts if the duration differs by more than GAP, if the outcome differs, or if the work differs by
more than a tenth. `Work` is the same on every machine. `--cpu` also compares CPU times in
alternating runs.

The table goes to results/constants.md. `--only` measures the constants with these names, or of
these modules, and replaces their rows. Every row states when it was measured. Rows of constants
that no longer exist, or that have another value now, are dropped.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import dataclasses
import datetime
import importlib.machinery
import importlib.util
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any
from unittest.mock import patch

from tests.support.paths import PACKAGE, ROOT

ROOMS = ("planning", "pipeline", "elements", "interior")
TABLE = ROOT / "results/constants.md"
GAP = 1e-4
WORK = 0.1
"""Smallest relative changes of a duration and of work that count."""
LEAST_WORK = 0.05
"""Work, and CPU time in s, that is added on both sides so that a small problem does not decide."""
REPEATS = 3
"""Pairs of runs that confirm a change of CPU time."""
FACTORS = (2.0, 0.5)
HEADER = ("constant", "value", "reason", "moved", "problem", "change", "measured")
NAMES = [
    *(f"coupled {k}" for k in (48, 20, 54, 2, 60, 44, 38, 30, 29, 34, 53)),
    *("tilt_insert", "waypoints", "eye_approach", "laser_scan", "rounded_corners", "direct_reach"),
    *(f"random {k}, one" for k in (1000, 1002, 1005, 1006, 1011, 1022, 1023, 1024, 1028, 1032)),
    *(f"random {k}" for k in (5001, 5008, 5011, 5012, 5018, 5022, 5028, 5035, 5043, 5045, 5060)),
    *("raven_reach", "tilt_insert, toppra", "tilt_insert, ipopt", "direct_reach, ipopt"),
    *("eye_approach, optimal", "waypoints, optimal", "random 1024, one, optimal"),
    *("random 5028, optimal", "coupled 53, optimal", "random 5002, relaxed"),
    *("random 5034, relaxed", "random 5021", "random 5047", "random 51051"),
    *("slow tip", "moving 9602", "moving 9607", "moving 9609", "moving 9617"),
]
"""Names of the problems: a shipped problem, or a kind and a seed, and how it is planned.

"moving" are random free motions that begin at speed. "slow tip" is `tilt_insert` at 2 mm/s, whose
ramps at both ends are short.

Problems that are planned quickly and change easily come first.
"""


@dataclasses.dataclass(frozen=True)
class Constant:
    """A numeric constant at the level of a module."""

    module: str
    name: str
    value: str
    reason: str


def constants(only: tuple[str, ...] = ()) -> Iterator[Constant]:
    """Yield the constants of ROOMS, or those with these names or of these modules."""
    for room in ROOMS:
        for file in sorted((PACKAGE / room).rglob("*.py")):
            module = ".".join(("ssm_planner", *file.relative_to(PACKAGE).with_suffix("").parts))
            body = ast.parse(file.read_text(encoding="utf-8")).body
            for k, node in enumerate(body):
                for name, value in numeric(node):
                    constant = Constant(module, name, ast.unparse(value), reason(body[k + 1 :]))
                    words = {name, module, module.rpartition(".")[2]}
                    if not only or words & set(only):
                        yield constant


def numeric(node: ast.stmt) -> Iterator[tuple[str, ast.expr]]:
    """Yield name and value of the numeric constants that a statement assigns."""
    if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
        return
    for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
        pairs: list[tuple[ast.expr, ast.expr]] = [(target, node.value)]
        if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            pairs = list(zip(target.elts, node.value.elts, strict=True))
        for item, value in pairs:
            numbers = (
                isinstance(part, ast.Constant) and isinstance(part.value, int | float)
                for part in ast.walk(value)
            )
            if isinstance(item, ast.Name) and item.id.isupper() and any(numbers):
                yield item.id, value


def reason(following: list[ast.stmt]) -> str:
    """Return the first sentence of the text that follows a constant, or a group of constants."""
    for node in following:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            return " ".join(str(node.value.value).split()).partition(". ")[0].rstrip(".")
        if not list(numeric(node)):
            break
    return ""


def moved(value: Any, factor: float) -> Any:
    """Return a value moved by a factor. Numbers near 1 move by their difference from 1."""
    if isinstance(value, bool | str | Path) or value is None or callable(value):
        return value
    if isinstance(value, int):
        return value if value <= 0 else max(1, round(value * factor))
    if isinstance(value, float):
        return 1 + (value - 1) * factor if 0.7 < value < 2 else value * factor
    if isinstance(value, tuple | list):
        return type(value)(moved(item, factor) for item in value)
    if isinstance(value, dict):
        return {key: moved(item, factor) for key, item in value.items()}
    return value * factor if hasattr(value, "dtype") and value.dtype.kind == "f" else value


class Moving(importlib.machinery.SourceFileLoader):
    """Loader of a module in which one constant is changed right after its assignment."""

    constant, factor = "", 1.0

    def get_code(self, fullname: str) -> CodeType:
        tree = ast.parse(Path(self.path).read_text(encoding="utf-8"))
        statements: list[ast.stmt] = []
        for node in tree.body:
            statements.append(node)
            if self.constant in dict(numeric(node)):
                text = f"{self.constant} = __moved__({self.constant}, {self.factor})"
                statements += ast.parse(text).body
        tree.body = statements
        return compile(ast.fix_missing_locations(tree), self.path, "exec")


class Finder:
    """Finder of the module with the changed constant. It precedes the usual finders."""

    def __init__(self, module: str) -> None:
        self.module = module

    def find_spec(self, name: str, path: Any, target: ModuleType | None = None) -> Any:
        if name != self.module:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path)
        assert spec is not None
        assert spec.origin is not None
        return importlib.util.spec_from_file_location(
            name, spec.origin, loader=Moving(name, spec.origin)
        )


def problem_of(name: str) -> tuple[Any, bool]:
    """Return a named problem, and whether the planner searches for relaxations."""
    from ssm_planner.loading.load import load_problem
    from ssm_planner.problem.limits import TipSpeed
    from ssm_planner.problem.value import unchecked_copy
    from tests.benchmarks.direction_free import coupled
    from tests.support.random_problems import random_problem

    kind, *how = name.split(", ")
    words = kind.split()
    base = load_problem(ROOT / "problems/tilt_insert.yaml")
    if words[0] == "random":
        problem = random_problem(base, int(words[1]), most=1 if "one" in how else 3)
    elif words[0] == "moving":
        problem = moving(random_problem(base, int(words[1]), most=1), int(words[1]))
    elif kind == "slow tip":
        problem = dataclasses.replace(base, limits=(*base.limits, TipSpeed(2e-3)))
    elif words[0] == "coupled":
        problem = coupled(base, int(words[1]))
    else:
        problem = load_problem(ROOT / f"problems/{kind}.yaml")
    planner = next((word for word in how if word in ("optimal", "ipopt", "toppra")), "fast")
    if problem.planner != "toppra":
        problem = unchecked_copy(problem, planner=planner)
    return problem, "relaxed" in how


def moving(problem: Any, seed: int) -> Any:
    """Return a free motion to the first target of a problem that begins at a random speed."""
    import numpy as np

    from ssm_planner.kinematics import Mechanism, task_rates
    from ssm_planner.planning.phases import start_configurations
    from ssm_planner.problem.limits import TASK_COORDINATES, TaskRate
    from ssm_planner.problem.motion import Free, Task

    rng = np.random.default_rng(seed)
    target = next((m.to for m in problem.motion if m.kind in ("free", "straight")), None)
    to = {**problem.start.set_coordinates, **(target.set_coordinates if target else {})}
    qd = rng.uniform(-0.8, 0.8, 4) * problem.robot.velocities * (rng.random(4) < 0.7)
    q = start_configurations(problem)[0]
    rates = task_rates(Mechanism.from_robot(problem.robot), q[None], qd[None])[0]
    return dataclasses.replace(
        problem,
        motion=(Free(Task(**to)),),
        start_rate=dict(zip(TASK_COORDINATES, rates.tolist(), strict=True)),
        end_rate={},
        duration=None,
        objective="time",
        limits=tuple(limit for limit in problem.limits if not isinstance(limit, TaskRate)),
    )


def measured(name: str) -> tuple[float, str, float, float]:
    """Plan a problem and return duration, outcome, work and CPU time in s.

    The duration is 0 without a motion.
    """
    from ssm_planner.pipeline import run
    from ssm_planner.planning.work import Work

    problem, relaxed = problem_of(name)
    start = time.process_time()
    try:
        work = Work()
        with patch.object(run, "Work", lambda: work):
            result = run.plan(problem, relaxations=relaxed)
    except Exception as error:  # noqa: BLE001  a moved constant may break anything
        return 0.0, f"raises {type(error).__name__}", 0.0, 0.0
    spent = time.process_time() - start
    reason = "" if result.reason is None else str(result.reason.relaxation or "no motion")
    duration = result.trajectory.duration if result.passed and result.trajectory else 0.0
    return duration, reason, work.spent, spent


def child(module: str, constant: str, factor: float, names: list[str]) -> None:
    """Plan the named problems with a constant moved, and print one line for each of them."""
    if module:
        vars(builtins)["__moved__"] = moved
        Moving.constant, Moving.factor = constant, factor
        sys.meta_path.insert(0, Finder(module))
    for name in names:
        print(json.dumps([name, *measured(name)]), flush=True)


def run(module: str, constant: str, factor: float, names: list[str]) -> Iterator[list[Any]]:
    """Yield the lines of a child process. The process ends with the iteration."""
    command = [sys.executable, "-m", "tests.benchmarks.constants", "--child"]
    arguments = [module, constant, str(factor), *names]
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    process = subprocess.Popen(
        [*command, *arguments],
        cwd=ROOT,
        env={**os.environ, **one_thread},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    assert process.stdout is not None
    try:
        for line in process.stdout:
            yield json.loads(line)
        if process.wait():
            yield ["any", 0.0, "the program fails", 0.0, 0.0]
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def effect(
    constant: Constant, factor: float, base: dict[str, list[Any]], *, cpu: bool
) -> tuple[str, str, str] | None:
    """Return how a constant is moved, the first problem that changes, and by how much."""
    how = f"× {factor:g}"
    slower: list[tuple[float, str]] = []
    for name, duration, outcome, effort, spent in run(
        constant.module, constant.name, factor, list(base)
    ):
        if name not in base:
            return how, name, outcome
        old_duration, old_outcome, old_effort, old_spent = base[name]
        if bool(duration) != bool(old_duration):
            return how, name, "loses its motion" if old_duration else "gets a motion"
        if duration and abs(duration / old_duration - 1) > GAP:
            return how, name, f"duration {100 * (duration / old_duration - 1):+.2g} %"
        if not same_outcome(outcome, old_outcome):
            return how, name, "another relaxation"
        change = (effort + LEAST_WORK) / (old_effort + LEAST_WORK) - 1
        if abs(change) > WORK:
            return how, name, f"work {100 * change:+.0f} %"
        share = (spent + LEAST_WORK) / (old_spent + LEAST_WORK) - 1
        if cpu and abs(share) > WORK:
            slower.append((abs(share), name))
    for _, name in sorted(slower, reverse=True)[:2]:
        share = confirmed_share(constant, factor, name)
        if abs(share) > WORK:
            return how, name, f"CPU time {100 * share:+.0f} %"
    return None


def same_outcome(text: str, other: str) -> bool:
    """Return True if two texts state the same relaxation, with numbers of three digits."""

    def rounded(words: str) -> list[str]:
        result = []
        for word in words.split():
            try:
                result.append(f"{float(word.strip(',;')):.2g}")
            except ValueError:
                result.append(word)
        return result

    return rounded(text) == rounded(other)


def confirmed_share(constant: Constant, factor: float, name: str) -> float:
    """Return the change of the smallest CPU time over alternating runs."""
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(REPEATS):
        for module, result in zip(("", constant.module), times, strict=True):
            lines = run(module, constant.name, factor, [name] * 3)
            result += [line[-1] for line in lines if line[0] == name]
    if not all(times):
        return 0.0
    return (min(times[1]) + LEAST_WORK) / (min(times[0]) + LEAST_WORK) - 1


def row(constant: Constant, base: dict[str, list[Any]], *, cpu: bool) -> list[str]:
    """Return the row of one constant from its measurements."""
    effects = (effect(constant, factor, base, cpu=cpu) for factor in FACTORS)
    result = next((item for item in effects if item is not None), ("both ways", "none", "–"))
    today = datetime.datetime.now(tz=datetime.timezone.utc).date().isoformat()
    return [*description(constant), *result, today]


def description(constant: Constant) -> list[str]:
    """Return the first cells of a row: the name of a constant, its value and its reason."""
    short = constant.value if len(constant.value) <= 40 else constant.value[:37] + "…"
    label = f"{constant.module.removeprefix('ssm_planner.')}.{constant.name}"
    return [f"`{label}`", f"`{short}`", constant.reason]


def read_rows(file: Path) -> dict[str, list[str]]:
    """Return the rows of an earlier table by the name of their constant."""
    if not file.is_file():
        return {}
    lines = file.read_text(encoding="utf-8").splitlines()
    cells = [line.strip("|").split("|") for line in lines if line.startswith("| `")]
    table = [[cell.strip() for cell in line] for line in cells]
    return {line[0]: line for line in table if len(line) == len(HEADER)}


def document(rows: dict[str, list[str]]) -> str:
    """Return the page with the table of the present constants."""
    table = []
    for constant in constants():
        label, value, reason = description(constant)
        _, earlier_value, _, *effect = rows.get(label, [label, "", "", "", "", "", ""])
        is_valid = effect[-1] and earlier_value == value
        table.append(
            [label, value, reason, *(effect if is_valid else ("", "not measured", "", ""))]
        )
    lines = [
        "# Constants of the planner",
        "",
        "`python -m tests.benchmarks.constants` writes this table. Every numeric constant of planning, pipeline, "
        "elements and interior is doubled, then halved. Numbers near 1 move by their difference from 1. The row names "
        "the first problem whose duration changes by more than 1e-4, whose outcome changes, or whose work changes by "
        "more than 10 %. `none` marks constants that no problem of the benchmark needs. The last "
        "column states the day of the measurement. A constant that was changed or renamed since then counts as not measured.",
        "",
        f"{len(table)} constants, {sum(bool(line[-1]) for line in table)} of them measured.",
        "",
        "| " + " | ".join(HEADER) + " |",
        "|---" * len(HEADER) + "|",
        *("| " + " | ".join(cell.replace("|", "∣") for cell in line) + " |" for line in table),
    ]
    return "\n".join(lines) + "\n"


def main() -> int:
    if sys.argv[1:2] == ["--child"]:
        module, name, factor, *names = sys.argv[2:]
        child(module, name, float(factor), names)
        return 0
    parser = argparse.ArgumentParser(description="Effect of every constant of the planner.")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--cpu", action="store_true", help="also compare CPU times")
    parser.add_argument("--list", action="store_true", help="only print the constants")
    parser.add_argument("-o", "--output", type=Path, default=TABLE)
    options = parser.parse_args()
    chosen = list(constants(tuple(options.only)))
    if options.list:
        print(*(f"{c.module}.{c.name} = {c.value}" for c in chosen), sep="\n")
        return 0
    rows = read_rows(options.output)
    options.output.write_text(document(rows), encoding="utf-8")
    if not chosen:  # Only rows of constants that no longer exist are dropped.
        return 0
    base = {line[0]: line[1:] for line in run("", "", 1.0, NAMES)}
    for constant in chosen:
        line = row(constant, base, cpu=options.cpu)
        rows[line[0]] = line
        print(" | ".join(line), flush=True)
        options.output.write_text(document(rows), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

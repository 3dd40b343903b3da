"""Plan random problems over random robots, and judge their endings and their times.

    python -m tests.benchmarks.fuzz_plans [--count 1000] [--first 20000] [--processes 1]

Every problem must end with a certificate or a named reason. A problem is solvable if the planner, a
finer mesh or another guess solves it, and the planner must solve at least 99 % of the solvable
ones. No problem may take more than 10 s of process time. The exit status is 1 if one of these
conditions fails.
"""

from __future__ import annotations

import argparse
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.ocp import free as free_ocp
from ssm_planner.planning.ocp import straight as straight_ocp
from ssm_planner.planning.planner import plan_motion
from ssm_planner.planning.reason import Reason
from ssm_planner.verification.check import check
from tests.benchmarks.motions import meshed
from tests.support.paths import ROOT
from tests.support.random_problems import faults, random_problem

SECONDS, SHARE = 10.0, 0.99
CERTAIN = {
    "position",
    "velocity",
    "acceleration",
    "direction",
    "retina clearance",
    "lens clearance",
    "self-locking",
}
"""Reasons that follow from the given positions alone, without a solver."""
SHORTER = 1.02
"""Factor between the fastest motion found and the requested duration.

Above this factor, the requested duration is certainly too short.
"""
OTHERWISE = ((3, 1.0), (2, 3.0), (1, 1.5))
"""Factors on the number of elements and on the duration of the guess in further attempts."""


@dataclass(frozen=True)
class Ending:
    """Ending of one problem.

    `how` is "certified", the name of a reason, "refused" (bad input) or "crashed".
    """

    seed: int
    how: str
    seconds: float
    faults: tuple[str, ...]
    words: str
    solvable: bool
    """True if the planner or at least one further attempt solved the problem."""

    @property
    def solved(self) -> bool:
        return self.how == "certified"

    def line(self) -> str:
        second = "" if self.solved or not self.solvable else " — SOLVABLE"
        return f"seed {self.seed}: {self.how}, {self.seconds:.1f} s{second}; {'; '.join(self.faults) or self.words}"


def ending(seed: int) -> Ending:
    """Plan one problem and return its ending."""
    problem = random_problem(load_problem(ROOT / "problems/tilt_insert.yaml"), seed)
    start = time.process_time()
    try:
        result = plan(problem)
    except ProblemError as error:
        return Ending(seed, "refused", time.process_time() - start, (), str(error), False)
    except Exception:  # noqa: BLE001  a crash is what is looked for
        words = traceback.format_exc(limit=-2)
        return Ending(seed, "crashed", time.process_time() - start, (words,), words, False)
    seconds = time.process_time() - start
    texts = tuple(faults(problem, result))
    if result.reason is None:
        return Ending(seed, "certified", seconds, texts, "", True)
    words = f"{result.reason.message}; {result.reason.relaxation or 'no relaxation found'}"
    solvable = not _certain(result.reason) and any(_solved(problem, *way) for way in OTHERWISE)
    return Ending(seed, result.reason.constraint, seconds, texts, words, solvable)


def _certain(reason: Reason) -> bool:
    """Return whether another mesh or guess cannot help."""
    if (
        reason.constraint == "duration"
        and reason.required is not None
        and reason.available is not None
    ):
        return reason.required > SHORTER * reason.available
    return reason.constraint in CERTAIN or "too weak to move at all" in reason.message


def _solved(problem: Any, finer: int, stretched: float) -> bool:
    fast = replace(
        problem, objective="time" if problem.objective == "time then heat" else problem.objective
    )
    with _otherwise(finer, stretched):
        try:
            planned = plan_motion(fast)
        except Exception:  # noqa: BLE001  no solution either
            return False
    if planned.trajectory is None:
        return False
    return check(planned.trajectory, problem.robot, problem.task_limits).passed


@contextmanager
def _otherwise(finer: int, stretched: float) -> Iterator[None]:
    """Plan with a finer mesh and a stretched guess within the context."""
    original = free_ocp.find_fastest_motion

    def optimise(task: Any, start: Any, *arguments: Any, **named: Any) -> Any:
        return original(task, start.stretched(stretched), *arguments, **named)

    counts = finer * straight_ocp.MIN_ELEMENTS, finer * free_ocp.DEFAULT_ELEMENTS
    with (
        meshed(*counts),
        patch.object(free_ocp, "find_fastest_motion", optimise),
        patch.object(straight_ocp, "find_fastest_motion", optimise),
    ):
        yield


def lines(endings: Sequence[Ending]) -> list[str]:
    """Return lines with the counts, the slowest problems and the failures."""
    counts = Counter(e.how for e in endings)
    solved, solvable = counts["certified"], sum(e.solvable for e in endings)
    slowest = sorted(endings, key=lambda e: -e.seconds)
    late = [e for e in slowest if e.seconds > SECONDS]
    wrong = [e for e in endings if e.faults]
    missed = [e for e in endings if e.solvable and not e.solved]
    return [
        f"{len(endings)} problems: " + ", ".join(f"{n} {how}" for how, n in counts.most_common()),
        f"solved {solved} of {solvable} solvable: {100 * solved / max(solvable, 1):.2f} % (asked: {100 * SHARE:g} %)",
        f"process time: mean {sum(e.seconds for e in endings) / len(endings):.2f} s, "
        f"largest {slowest[0].seconds:.1f} s; {len(late)} over {SECONDS:g} s (asked: none)",
        "slowest: " + ", ".join(f"{e.seed} {e.seconds:.1f} s" for e in slowest[:10]),
        f"without certificate and without named reason, or with a fault: {len(wrong)} (asked: none)",
        *(f"  {e.line()}" for e in wrong),
        f"solvable but not solved: {len(missed)}",
        *(f"  {e.line()}" for e in missed),
    ]


def reached(endings: Sequence[Ending]) -> bool:
    solvable = [e for e in endings if e.solvable]
    in_time = all(e.seconds <= SECONDS for e in endings)
    return (
        in_time
        and not any(e.faults for e in endings)
        and sum(e.solved for e in solvable) >= SHARE * len(solvable)
    )


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first", type=int, default=20_000, help="first seed")
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.count)
    endings = []
    with ProcessPoolExecutor(options.processes) as pool:
        for done in pool.map(ending, seeds, chunksize=1):
            endings.append(done)
            if done.faults or done.seconds > SECONDS or (done.solvable and not done.solved):
                print(done.line(), file=sys.stderr, flush=True)
            if len(endings) % 20 == 0:
                print(f"{len(endings)} of {options.count}", file=sys.stderr, flush=True)
    print("\n".join(lines(endings)))
    return 0 if reached(endings) else 1


if __name__ == "__main__":
    sys.exit(main())

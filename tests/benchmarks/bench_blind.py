"""Measure predictions of recordings that the fit has not seen, over many splits of the files.

    python -m tests.benchmarks.bench_blind [SPLITS] [SEED] [rigs …]

Every rig has SPLITS random splits, each with a random number of files. Further splits leave out the
slowest speeds, the fastest speeds, or every second file. The program prints the figures of each
split, of all splits together, and of the worst of them. The exit status is 1 if a figure of a rig
over all splits misses ASKED.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from ssm_planner.identification.prediction import Prediction
from ssm_planner.identification.recordings import Recording
from tests.identification.test_blind import RIGS, predicted, recordings_of, split

FEWEST, LEFT_OUT = 6, 4
"""Smallest number of files of a fit, and number of speeds left out at either end."""
ASKED: dict[str, Callable[[float, str], bool]] = {
    "means": lambda share, _: share >= 0.90,
    "samples": lambda share, _: 0.90 <= share <= 0.98,
    "peaks": lambda share, _: share >= 0.95,
    "beyond constant": lambda excess, _: excess <= 0.03,
    "start-stop": lambda error, rig: error <= RIGS[rig][1],
}


def splits(
    steady: list[Recording], count: int, seed: int
) -> Iterator[tuple[str, list[Recording], list[Recording]]]:
    """Yield the name, the files of the fit and the other files of every split."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        fitted = int(rng.integers(FEWEST, len(steady) - LEFT_OUT))
        yield f"{k}: {fitted} files", *split(steady, fitted, int(rng.integers(2**31)))
    speeds = sorted(steady, key=lambda r: abs(r.w.mean()))
    yield f"without the {LEFT_OUT} slowest", speeds[LEFT_OUT:], speeds[:LEFT_OUT]
    yield f"without the {LEFT_OUT} fastest", speeds[:-LEFT_OUT], speeds[-LEFT_OUT:]
    by_speed = sorted(steady, key=lambda r: r.w.mean())
    for first in (0, 1):
        yield f"every second from {first}", by_speed[first::2], by_speed[1 - first :: 2]


def figures(found: list[Prediction], moving: list[Prediction]) -> dict[str, float]:
    """Return the figures by the names in ASKED."""
    beyond = [
        np.sqrt(np.mean((p.tau - p.recording.tau) ** 2)) / p.recording.tau.std() - 1 for p in found
    ]
    return {
        "means": float(np.mean([p.mean_inside for p in found])),
        "samples": float(np.mean([p.sample_coverage for p in found])),
        "peaks": float(
            np.mean([np.abs(p.recording.tau).max() <= p.band.peak for p in found if p.band])
        ),
        "beyond constant": float(np.mean(beyond)),
        "start-stop": max(p.nrmsd for p in moving),
    }


def main(count: int = 20, seed: int = 1, *rigs: str) -> int:
    met = True
    for rig in rigs or RIGS:
        drive, steady = recordings_of(rig, "steady_state")
        _, moving = recordings_of(rig, "start_stop")
        every: list[dict[str, float]] = []
        pooled: tuple[list[Prediction], list[Prediction]] = ([], [])
        print(f"\n{rig}: {len(steady)} files{'':20}" + "".join(f"{name:>16}" for name in ASKED))
        for name, fitted, others in splits(steady, count, seed):
            result = predicted(drive, fitted, others + moving)
            parts = result[: len(others)], result[len(others) :]
            every.append(figures(*parts))
            for pool, part in zip(pooled, parts, strict=True):
                pool += part
            tell(name, every[-1], rig)
        values = figures(*pooled)
        tell("pooled", values, rig)
        tell("lowest", {name: min(item[name] for item in every) for name in ASKED}, rig)
        tell("highest", {name: max(item[name] for item in every) for name in ASKED}, rig)
        met &= all(reached(values[name], rig) for name, reached in ASKED.items())
    return int(not met)


def tell(name: str, found: dict[str, float], rig: str) -> None:
    marked = (
        f"{found[key]:15.3f}{' ' if reached(found[key], rig) else '!'}"
        for key, reached in ASKED.items()
    )
    print(f"{name:37}" + "".join(marked), flush=True)


if __name__ == "__main__":
    sys.exit(main(*(int(a) if a.isdigit() else a for a in sys.argv[1:])))

"""Compare search methods on the shipped study by hypervolume against the number of evaluations.

The hypervolume is that of duration and motor mass, over five seeds. The figures of a candidate are
interpolated from the planned candidates of results/study, so that a comparison takes seconds. The
duration is an inverse-distance mean of the four nearest candidates of the same pace, and the mass
is that of the nearest. Every candidate is also screened for its reach. With `--planned` every
candidate is planned on the motion tilt_insert only, which takes 11 minutes on two busy cores.
"""

from __future__ import annotations

import csv
import sys
from dataclasses import replace

import numpy as np

from ssm_planner.studies.adaptive import candidate_batches
from ssm_planner.studies.evaluation import Evaluation
from ssm_planner.studies.screens import Screens
from ssm_planner.studies.store import Candidate, pareto_front
from ssm_planner.studies.study import PACE_PATH, Design, Search, Study
from ssm_planner.studies.study_file import load_study
from ssm_planner.studies.workers import Workers
from ssm_planner.typing import Array
from tests.benchmarks.faults_studies import problem
from tests.support.paths import ROOT

METHODS = ("sobol", "tpe", "nsga2")
SEEDS = range(1, 6)
COUNTS = (16, 32, 64, 128, 256)
PLANNED = (16, 32, 48, 64)
"""Numbers of evaluations at which planned searches are compared."""
WORST = (5.05, 0.24)
"""Duration in s and mass in kg of the published geometry. Only better candidates count."""
BEST = (4.2, 0.2)
"""Duration in s and mass in kg at which the fraction of the hypervolume is 1."""
LARGER = 1.1
"""Factor of the published geometry's figures below which planned candidates count."""


class Surface:
    """Interpolation between the candidates that were planned."""

    def __init__(self, study: Study) -> None:
        self.study, self.screens = study, Screens(study)
        with (ROOT / "results" / "study" / "table.csv").open(encoding="utf-8") as stream:
            rows = [row for row in csv.DictReader(stream) if row["state"] == "done"]
        self.places = np.array([self.place(row) for row in rows])
        self.paces = [row[PACE_PATH] for row in rows]
        self.values = np.array([[float(row[name]) for name in study.minimise] for row in rows])

    def place(self, design: Design) -> Array:
        """Return the position (2,) of a design. Each coordinate runs from 0 to 1."""
        spans = [variable for variable in self.study.vary if variable.path != PACE_PATH]
        return np.array(
            [(float(design[v.path].split()[0]) - v.low) / (v.high - v.low) for v in spans]
        )

    def rows(self, designs: list[Design], first: int) -> list[Candidate]:
        result = []
        for i, (design, fallen) in enumerate(
            zip(designs, self.screens.reject(designs), strict=True), first
        ):
            if fallen is not None:
                result.append(Candidate(i, "infeasible", design, fallen.stage, fallen.reason))
                continue
            same = np.array([pace == design[PACE_PATH] for pace in self.paces])
            far = np.linalg.norm(self.places - self.place(design), axis=1) + 1e-9
            near = np.argsort(np.where(same, far, np.inf))[:4]
            duration = float(np.average(self.values[near, 0], weights=1 / far[near]))
            figures = dict(
                zip(self.study.minimise, (duration, float(self.values[near[0], 1])), strict=True)
            )
            result.append(Candidate(i, "done", design, figures=figures))
        return result


class Planned:
    """Planner of candidates. It plans every candidate once."""

    def __init__(self, study: Study, workers: Workers) -> None:
        self.study, self.screens = study, Screens(study)
        self._submit = lambda number, design: workers.submit(Evaluation(study), number, design)
        self._found: dict[tuple[str, ...], Candidate] = {}

    def rows(self, designs: list[Design], first: int) -> list[Candidate]:
        """Return the rows of the candidates, numbered from `first`."""
        keys = [tuple(design.values()) for design in designs]
        futures = {}
        for key, design, fallen in zip(keys, designs, self.screens.reject(designs), strict=True):
            if key in self._found or key in futures:
                continue
            if fallen is None:
                futures[key] = self._submit(0, design)
            else:
                self._found[key] = Candidate(0, "infeasible", design, fallen.stage, fallen.reason)
        self._found |= {key: future.result() for key, future in futures.items()}
        return [replace(self._found[key], number=first + i) for i, key in enumerate(keys)]


def run(surface: Surface | Planned, method: str, seed: int, points: int) -> list[Candidate]:
    """Return the rows of one search in the order of its requests."""
    study = replace(surface.study, search=Search(method, points, seed))
    if not study.search.adaptive:
        return surface.rows(list(study.designs()), 0)
    rows: list[Candidate] = []
    for designs, tell in candidate_batches(study):
        rows += surface.rows(designs, len(rows))
        tell(rows[-len(designs) :])
    return rows


def hypervolume(rows: list[Candidate], names: tuple[str, ...], worst: tuple[float, float]) -> float:
    """Return the area that a front dominates below `worst`."""
    volume, last = 0.0, worst[1]
    for duration, mass in sorted(
        tuple(row.figures[name] for name in names) for row in pareto_front(rows, names)
    ):
        if duration < worst[0] and mass < last:
            volume += (worst[0] - duration) * (last - mass)
            last = mass
    return volume


def race(
    surface: Surface | Planned,
    counts: tuple[int, ...],
    worst: tuple[float, float],
    whole: float | None,
) -> None:
    """Print the table.

    `whole` is the hypervolume of fraction 1. By default it is that of all candidates of all runs.
    """
    names = surface.study.minimise
    result = {}
    for method in METHODS:
        result[method] = [run(surface, method, seed, counts[-1]) for seed in SEEDS]
        print(f"{method} done", file=sys.stderr, flush=True)
    everything = [row for runs in result.values() for rows in runs for row in rows]
    whole = whole or hypervolume(everything, names, worst)
    print(f"1 is a hypervolume of {whole:.5f} below {worst}")
    print("| search | " + " | ".join(f"{n}" for n in counts) + " | fall out |")
    print("|---" * (len(counts) + 2) + "|")
    for method, runs in result.items():
        shares = [[hypervolume(rows[:n], names, worst) / whole for n in counts] for rows in runs]
        cells = [
            f"{np.median(item):.3f} ({min(item):.3f}–{max(item):.3f})"
            for item in np.transpose(shares)
        ]
        fallen = np.mean([[row.state != "done" for row in rows] for rows in runs])
        print(f"| `{method}` | " + " | ".join(cells) + f" | {100 * fallen:.0f} % |", flush=True)


def main() -> None:
    if "--planned" not in sys.argv:
        surface = Surface(load_study(ROOT / "problems" / "studies" / "vitreoretinal.yaml"))
        race(surface, COUNTS, WORST, (WORST[0] - BEST[0]) * (WORST[1] - BEST[1]))
        return
    with Workers(2) as workers:
        planned = Planned(problem(), workers)
        own = Evaluation(planned.study)(-1, {})
        duration, mass = (own.figures[name] for name in planned.study.minimise)
        print(f"the published geometry: {duration:.4f} s, {mass:.4f} kg")
        race(planned, PLANNED, (LARGER * duration, LARGER * mass), None)


if __name__ == "__main__":
    main()

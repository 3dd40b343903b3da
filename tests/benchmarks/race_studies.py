"""Searches raced on the shipped study: hypervolume of duration and motor mass against evaluations, five seeds.

A candidate's figures are those of the planned candidates of results/study around it (the duration by inverse distance of the
four nearest of its pace, the mass of the nearest), so that a race takes seconds; its reach is screened as in any study.
"""

from __future__ import annotations

import csv
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from ssm_planner.studies.adaptive import batches
from ssm_planner.studies.screens import Screens
from ssm_planner.studies.store import Candidate, pareto
from ssm_planner.studies.study import PACE, Design, Search, Study
from ssm_planner.studies.study_file import load_study
from ssm_planner.typing import Array

ROOT = Path(__file__).parents[2]
METHODS = ("sobol", "tpe", "nsga2")
SEEDS = range(1, 6)
COUNTS = (16, 32, 64, 128, 256)
WORST = (5.05, 0.24)
"""s and kg: the published geometry's, a candidate that is no better counts for nothing."""
BEST = (4.2, 0.2)
"""s and kg: where the share of the hypervolume is 1."""


class Surface:
    """What planning found, between the candidates that were planned."""

    def __init__(self, study: Study) -> None:
        self.study, self.screens = study, Screens(study)
        with (ROOT / "results" / "study" / "table.csv").open(encoding="utf-8") as stream:
            rows = [row for row in csv.DictReader(stream) if row["state"] == "done"]
        self.places = np.array([self.place(row) for row in rows])
        self.paces = [row[PACE] for row in rows]
        self.values = np.array([[float(row[name]) for name in study.minimise] for row in rows])

    def place(self, design: Design) -> Array:
        """(2,), each from 0 to 1."""
        spans = [variable for variable in self.study.vary if variable.path != PACE]
        return np.array([(float(design[v.path].split()[0]) - v.low) / (v.high - v.low) for v in spans])

    def rows(self, designs: list[Design], first: int) -> list[Candidate]:
        found = []
        for i, (design, fallen) in enumerate(zip(designs, self.screens.fallen(designs), strict=True), first):
            if fallen is not None:
                found.append(Candidate(i, "infeasible", design, fallen.stage, fallen.reason))
                continue
            same = np.array([pace == design[PACE] for pace in self.paces])
            far = np.linalg.norm(self.places - self.place(design), axis=1) + 1e-9
            near = np.argsort(np.where(same, far, np.inf))[:4]
            duration = float(np.average(self.values[near, 0], weights=1 / far[near]))
            figures = dict(zip(self.study.minimise, (duration, float(self.values[near[0], 1])), strict=True))
            found.append(Candidate(i, "done", design, figures=figures))
        return found


def run(surface: Surface, method: str, seed: int) -> list[Candidate]:
    study = replace(surface.study, search=Search(method, COUNTS[-1], seed))
    if not study.search.adaptive:
        return surface.rows(list(study.designs()), 0)
    rows: list[Candidate] = []
    for designs, tell in batches(study):
        rows += surface.rows(designs, len(rows))
        tell(rows[-len(designs) :])
    return rows


def hypervolume(rows: list[Candidate], names: tuple[str, ...]) -> float:
    """Of what a front dominates between WORST and BEST, a share."""
    volume, last = 0.0, WORST[1]
    for duration, mass in sorted(tuple(row.figures[name] for name in names) for row in pareto(rows, names)):
        if duration < WORST[0] and mass < last:
            volume += (WORST[0] - duration) * (last - mass)
            last = mass
    return volume / ((WORST[0] - BEST[0]) * (WORST[1] - BEST[1]))


def main() -> None:
    surface = Surface(load_study(ROOT / "problems" / "studies" / "vitreoretinal.yaml"))
    print("| search | " + " | ".join(f"{n}" for n in COUNTS) + " | fall out |")
    print("|---" * (len(COUNTS) + 2) + "|")
    for method in METHODS:
        runs = [run(surface, method, seed) for seed in SEEDS]
        found = [[hypervolume(rows[:n], surface.study.minimise) for n in COUNTS] for rows in runs]
        cells = [f"{np.median(each):.3f} ({min(each):.3f}–{max(each):.3f})" for each in np.transpose(found)]
        fallen = np.mean([[row.state != "done" for row in rows] for rows in runs])
        print(f"| {method} | " + " | ".join(cells) + f" | {100 * fallen:.0f} % |")


if __name__ == "__main__":
    main()

"""Helpers of the studies' tests: figures in closed form, an executor, and changes of the store."""

from __future__ import annotations

import json
import math
import sqlite3
from concurrent.futures import Executor, Future
from pathlib import Path

import pytest

from ssm_planner.loading.files import section_from_data
from ssm_planner.studies.evaluation import Evaluation
from ssm_planner.studies.store import Candidate, hash_contents
from ssm_planner.studies.study_file import study_from
from ssm_planner.studies.workers import Workers

FILE = {
    "robot": "vitreoretinal",
    "motions": ["tilt_insert"],
    "vary": {
        "geometry.alpha": {"from": "38 deg", "to": "44 deg"},
        "geometry.home_tilt": {"from": "-114 deg", "to": "-110 deg"},
    },
    "minimise": ["duration", "peak_torque"],
    "search": {"points": 16, "seed": 3},
}


def pids(workers: Workers) -> list[int]:
    """Return the process identifiers of the running workers."""
    processes = list(workers._processes.values())
    return [process.pid for process in processes if process.poll() is None]


def study(**changes):
    return study_from(section_from_data({**FILE, **changes}))


class Here(Executor):
    """An executor that evaluates at once in this process and counts the candidates."""

    def __init__(self, *_) -> None:
        self.count = 0

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        self.count += len(args[-1])
        future.set_result(fn(*args, **kwargs))
        return future


def closed_form(factor: float = 1.0):
    """Return a replacement of `Evaluation.__call__` with two figures in closed form.

    One figure improves where the other one gets worse.
    """

    def evaluate(self, number, design):
        alpha = float(design.get("geometry.alpha", "30 deg").split()[0])
        tilt = float(design.get("geometry.home_tilt", "-113 deg").split()[0])
        figures = {"duration": factor * math.cos(math.radians(alpha + tilt)) ** 2 + 1}
        return Candidate(number, "done", design, figures={**figures, "peak_torque": alpha})

    return evaluate


@pytest.fixture
def without_planning(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compute the figures of candidates in closed form and in this process, without planning."""
    monkeypatch.setattr(Evaluation, "__call__", closed_form())
    monkeypatch.setattr("ssm_planner.studies.run.Workers", Here)
    monkeypatch.setattr("ssm_planner.studies.run.write_study_figures", lambda *_: {})
    monkeypatch.setattr("ssm_planner.studies.show.plan_candidate", lambda *_: {})


def execute(folder: Path, statement: str, *values: object) -> None:
    """Execute an SQL statement on the store in a folder, as another program could."""
    connection = sqlite3.connect(folder / "study.sqlite", isolation_level=None)
    connection.execute(statement, values)
    connection.close()


def forge(folder: Path, number: int, **columns: object) -> None:
    """Change columns of a row and compute its hash again, as a deliberate forger would."""
    connection = sqlite3.connect(folder / "study.sqlite", isolation_level=None)
    names = ("state", "stage", "reason", "design", "figures")
    key, *contents = connection.execute(
        f"SELECT key, {', '.join(names)} FROM candidates JOIN numbers USING (key) WHERE number = ?",
        (number,),
    ).fetchone()
    changed = {**dict(zip(names, contents, strict=True)), **columns}
    assignments = ", ".join(f"{name} = ?" for name in (*names, "sha256"))
    connection.execute(
        f"UPDATE candidates SET {assignments} WHERE key = ?",
        (*changed.values(), hash_contents(key, *changed.values()), key),
    )
    connection.close()


def figures_of(folder: Path, number: int) -> dict[str, float]:
    connection = sqlite3.connect(folder / "study.sqlite")
    (text,) = connection.execute(
        "SELECT figures FROM candidates JOIN numbers USING (key) WHERE number = ?", (number,)
    ).fetchone()
    connection.close()
    return json.loads(text)

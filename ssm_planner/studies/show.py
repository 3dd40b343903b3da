"""A candidate of a study in full: its robot file, plans and pages; two of them side by side."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from ssm_planner.atomic import replacing
from ssm_planner.errors import ProblemError
from ssm_planner.pipeline.folder import write_folder
from ssm_planner.reporting.html.report import write_report
from ssm_planner.studies.evaluation import plans_of
from ssm_planner.studies.run import STORE
from ssm_planner.studies.store import Candidate, Store
from ssm_planner.studies.study import Study


def candidate(folder: Path, number: int) -> Candidate:
    """A row of a study's store. Raises ProblemError."""
    if not (folder / STORE).is_file():
        raise ProblemError(
            "no study has been run there",
            file=folder / STORE,
            allowed="run it first, or name its -o",
        )
    with Store(folder / STORE) as store:
        rows = {row.number: row for row in store.rows()}
    if number not in rows:
        raise ProblemError(
            "no candidate of this number",
            value=number,
            key="number",
            allowed=f"0 to {max(rows, default=0)}",
        )
    return rows[number]


def shown(study: Study, folder: Path, number: int) -> list[Path]:
    """Write a candidate into `folder`/candidate_N: robot.yaml, and a folder with plan and page for each motion."""
    row = candidate(folder, number)
    place = folder / f"candidate_{number}"
    place.mkdir(parents=True, exist_ok=True)
    robot = place / "robot.yaml"
    with replacing(robot) as temporary:
        text = yaml.safe_dump(
            _named(study.resolved(study.whole(row.design, row.figures)), study, number),
            sort_keys=False,
            allow_unicode=True,
        )
        temporary.write_text(
            f"# Candidate {number} of the study {study.name}.\n{text}", encoding="utf-8"
        )
    written = [robot]
    for name, plan in plans_of(study, row).items():
        if not plan.passed:
            reason = "" if plan.reason is None else plan.reason.message
            raise ProblemError(f"candidate {number} has no plan of {name}: {reason}")
        written += write_folder(plan, place / name).values()
        written.append(write_report(plan, place / name / "report.html"))
    return written


def _named(tree: dict[str, Any], study: Study, number: int) -> dict[str, Any]:
    return {
        **tree,
        "name": f"{tree['name']}, candidate {number}",
        "source": f"study {study.name}; {tree.get('source', '')}",
    }


def compared(study: Study, folder: Path, first: int, second: int) -> dict[str, Any]:
    """What two candidates choose and give: {numbers, design, figures}, pairs by name."""
    a, b = candidate(folder, first), candidate(folder, second)
    return {
        "study": study.name,
        "numbers": [first, second],
        "design": _pairs(study.whole(a.design, a.figures), study.whole(b.design, b.figures)),
        "figures": _pairs(a.figures, b.figures),
    }


def _pairs(a: Mapping[str, Any], b: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    return {name: (a.get(name), b.get(name)) for name in dict.fromkeys([*a, *b])}

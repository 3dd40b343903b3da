"""The page of a study: front, map of what falls out, parallel coordinates, sensitivity. One file, nothing fetched."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.atomic import replacing
from ssm_planner.display import number
from ssm_planner.reporting.html.page import render
from ssm_planner.studies.store import Candidate, better
from ssm_planner.studies.study import Study, Varied
from ssm_planner.typing import Array
from ssm_planner.units import shown

UNITS = {
    "duration": "s",
    "motor_mass": "kg",
    "peak_torque": "N·m",
    "rms_torque": "N·m",
    "reach_margin": "rad",
}
"""SI, by the first part of a figure's name; others are without unit."""
BINS = 12
"""In which a quantity is cut to see how much of an objective it explains."""
SHOWN = 50
"""Rows of the front's table."""


def write_study_page(
    study: Study, rows: Sequence[Candidate], front: Sequence[Candidate], path: Path, finished: bool
) -> Path:
    """Write the page; rows: the study's own robot, then its candidates. While the study runs the page loads itself again.

    Raises ExportError.
    """
    own, others = rows[0], rows[1:]
    content = _content(study, others, front)
    content["notes"] = [*study.notes, against_own(study, own, front)]
    text = render("study.html", _data(study, others, front), **content, unfinished=not finished)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def _content(study: Study, rows: Sequence[Candidate], front: Sequence[Candidate]) -> dict[str, Any]:
    states = {
        state: sum(row.state == state for row in rows)
        for state in sorted({row.state for row in rows})
    }
    listed = ", ".join(f"{count} {state}" for state, count in states.items())
    stages: dict[str, list[Candidate]] = {}
    for row in rows:
        if row.state not in ("done", "waiting"):
            stages.setdefault(row.stage or row.state, []).append(row)
    names = [name for name in study.minimise if any(name in row.figures for row in front)]
    header = [
        "number",
        *(title_of(name) for name in names),
        *study.paths,
        *(each.path for each in study.selected),
    ]
    cells = [
        [
            str(row.number),
            *(number(scaled(name, row.figures), 5) for name in names),
            *chosen(study, row).values(),
        ]
        for row in front[:SHOWN]
    ]
    return {
        "title": study.name,
        "file": study.file or "FILE",
        "summary": f"{len(rows)} candidates: {listed}. Objectives: {', '.join(map(named, study.minimise))}.",
        "fallen": [
            {
                "stage": stage,
                "count": len(each),
                "example": re.sub(r"(?<!\w)-(?=\d)", "−", each[0].reason or ""),
            }
            for stage, each in sorted(stages.items(), key=lambda item: -len(item[1]))
        ],
        "objectives": [title_of(name) for name in study.minimise],
        "sensitivity": sensitivity(study, rows),
        "front": {"header": header, "rows": cells},
    }


def against_own(study: Study, own: Candidate, front: Sequence[Candidate]) -> str:
    """What the study's own robot reaches, and how many of the front beat it, in one sentence of page and terminal."""
    reached = ", ".join(in_words(name, own.figures) for name in study.minimise)
    missing = [named(name) for name in study.minimise if own.figures.get(name) is None]
    count = len(better(own, front, study.minimise))
    if own.state != "done":
        beaten = f"{own.state}, {own.reason}" if own.reason else own.state
    elif missing:
        beaten = f"{reached}; whether any of the front beats it is not known without {', '.join(missing)}"
    else:
        beaten = f"{reached}; {count} of the front beat{'s' if count == 1 else ''} it: better in one, worse in none"
    return f"{study.own_words}: {beaten}"


def _data(study: Study, rows: Sequence[Candidate], front: Sequence[Candidate]) -> dict[str, Any]:
    """What the script reads: columns over all candidates."""
    figures = _figures(study, rows)
    best = {row.number for row in front}
    columns = [choices_at(study, path, rows) for path in study.paths]
    columns += [
        {"title": title_of(name), "at": [scaled(name, row.figures) for row in rows], "labels": None}
        for name in figures
    ]
    return {
        "names": [*study.paths, *figures],
        "columns": columns,
        "choices": list(study.paths),
        "figures": figures,
        "objectives": [name for name in study.minimise if name in figures],
        "number": [row.number for row in rows],
        "state": [row.state for row in rows],
        "stage": [row.stage or row.state for row in rows],
        "front": [i for i, row in enumerate(rows) if row.number in best],
    }


def _figures(study: Study, rows: Sequence[Candidate]) -> list[str]:
    """The objectives, then the other figures that planned candidates have and that differ."""
    found: dict[str, set[Any]] = {}
    for row in rows:
        if row.state == "done":
            for name, value in row.figures.items():
                found.setdefault(name, set()).add(value)
    names = [name for name in sorted(found) if len(found[name]) > 1 and None not in found[name]]
    others = [
        name
        for name in names
        if name not in study.minimise and name.split(".")[0] in ("duration", "motor_margin")
    ]
    return [*(name for name in study.minimise if name in names), *others]


def choices_at(study: Study, path: str, rows: Sequence[Candidate]) -> dict[str, Any]:
    """What the rows chose at a path, as numbers in the unit of its title; of named entries their places and labels."""
    variable = study.vary[study.paths.index(path)]
    if isinstance(variable, Varied):
        values: list[float] = [float(row.design[path].split()[0]) for row in rows]
        return {
            "title": f"{path} ({variable.unit})" if variable.unit else path,
            "at": values,
            "labels": None,
        }
    labels = list(variable.contents)
    places = {label: i for i, label in enumerate(labels)}
    return {"title": path, "at": [places[row.design[path]] for row in rows], "labels": labels}


def sensitivity(study: Study, rows: Sequence[Candidate]) -> list[dict[str, Any]]:
    """For each choice the share, %, of each objective's variance between its bins or entries, over planned candidates."""
    done = [row for row in rows if row.state == "done"]
    found = []
    for path in study.paths:
        at = np.array(choices_at(study, path, done)["at"], dtype=float)
        shares = []
        for name in study.minimise:
            value = np.array([row.figures.get(name) for row in done], dtype=float)
            shares.append(round(100 * explained(at, value)) if len(done) > BINS else 0)
        found.append({"path": path, "shares": shares})
    return found


def explained(at: Array, value: Array) -> float:
    """Correlation ratio η² of values (n,) over places (n,) in bins of equal count: 0 without, 1 with full dependence.

    Corrected for the bins' number, so that independent ones give 0 on average.
    """
    good = np.isfinite(value)
    at, value = at[good], value[good]
    if len(value) < 2 or np.ptp(value) == 0:
        return 0.0
    places = np.unique(at)
    edges = places if len(places) <= BINS else np.quantile(at, np.linspace(0, 1, BINS + 1)[:-1])
    group = np.searchsorted(edges, at, side="right") - 1
    within = sum(
        float(np.sum((value[group == k] - value[group == k].mean()) ** 2)) for k in np.unique(group)
    )
    count, groups = len(value), len(np.unique(group))
    if count <= groups:
        return 0.0
    total = float(np.sum((value - value.mean()) ** 2))
    return max(0.0, 1.0 - within / (count - groups) / (total / (count - 1)))


def chosen(study: Study, row: Candidate) -> dict[str, str]:
    """What was chosen for a candidate by path, as people read it."""
    whole = study.whole(row.design, row.figures)
    return {path: re.sub(r"^-", "−", str(value)) for path, value in whole.items()}


def named(name: str) -> str:
    """A figure's name in words: "motor_mass" as "motor mass"."""
    return name.replace("_", " ")


def unit_of(name: str) -> tuple[str, float]:
    """The unit in which a figure is shown, "" for none, and the factor from SI."""
    kind = name.split(".")[0]
    return (
        ("%", 100.0)
        if kind == "motor_margin"
        else shown(UNITS[kind])
        if kind in UNITS
        else ("", 1.0)
    )


def title_of(name: str) -> str:
    """A figure's name with the unit in which it is shown."""
    unit = unit_of(name)[0]
    return f"{named(name)} ({unit})" if unit else named(name)


def in_words(name: str, figures: Mapping[str, Any]) -> str:
    """A figure with its unit, such as "motor mass 0.239 kg"."""
    return f"{named(name)} {number(scaled(name, figures), 4)} {unit_of(name)[0]}".strip()


def scaled(name: str, figures: Mapping[str, Any]) -> float | None:
    """A figure in that unit; None where it is not known."""
    value = figures.get(name)
    return None if value is None else float(value) * unit_of(name)[1]

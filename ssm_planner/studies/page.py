"""Write the page of a study: front, rejections, parallel coordinates and sensitivity."""

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
from ssm_planner.typing import Array, JsonObject
from ssm_planner.units import display_unit

UNITS = {
    "duration": "s",
    "motor_mass": "kg",
    "peak_torque": "N·m",
    "rms_torque": "N·m",
    "reach_margin": "rad",
}
"""SI units by the first part of a figure's name; other figures have no unit."""
BINS = 12
"""Number of bins of a quantity for the share of an objective that it explains."""
SHOWN = 50
"""Largest number of rows in the table of the front."""


def write_study_page(
    study: Study, rows: Sequence[Candidate], front: Sequence[Candidate], path: Path, finished: bool
) -> Path:
    """Write the page.

    rows: the study's own robot, then its candidates. While the study runs, the page reloads itself.
    Raises ExportError.
    """
    original = rows[0]
    candidates = rows[1:]
    content = _content(study, candidates, front)
    content["notes"] = [*study.notes, against_own(study, original, front)]
    text = render("study.html", _data(study, candidates, front), **content, unfinished=not finished)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def _content(study: Study, rows: Sequence[Candidate], front: Sequence[Candidate]) -> JsonObject:
    """Return the values of the template."""
    states = {
        state: sum(row.state == state for row in rows)
        for state in sorted({row.state for row in rows})
    }
    counts_text = ", ".join(f"{count} {state}" for state, count in states.items())
    stages: dict[str, list[Candidate]] = {}
    for row in rows:
        if row.state not in ("done", "waiting"):
            stages.setdefault(row.stage or row.state, []).append(row)
    names = [name for name in study.minimise if any(name in row.figures for row in front)]
    header = [
        "number",
        *(title_of(name) for name in names),
        *study.paths,
        *(choice.path for choice in study.selected),
    ]
    cells = [
        [
            str(row.number),
            *(number(scaled(name, row.figures), 5) for name in names),
            *displayed_choices(study, row).values(),
        ]
        for row in front[:SHOWN]
    ]
    return {
        "title": study.name,
        "file": study.file or "FILE",
        "summary": f"{len(rows)} candidates: {counts_text}. Objectives: "
        f"{', '.join(map(named, study.minimise))}.",
        "fallen": [
            {
                "stage": stage,
                "count": len(rejected),
                "example": re.sub(r"(?<!\w)-(?=\d)", "−", rejected[0].reason or ""),
            }
            for stage, rejected in sorted(stages.items(), key=lambda item: -len(item[1]))
        ],
        "objectives": [title_of(name) for name in study.minimise],
        "sensitivity": sensitivity(study, rows),
        "front": {"header": header, "rows": cells},
    }


def against_own(study: Study, reference: Candidate, front: Sequence[Candidate]) -> str:
    """State in one sentence the result of the study's own robot and how many beat it."""
    results = ", ".join(in_words(name, reference.figures) for name in study.minimise)
    missing = [named(name) for name in study.minimise if reference.figures.get(name) is None]
    count = len(better(reference, front, study.minimise))
    if reference.state != "done":
        outcome = f"{reference.state}, {reference.reason}" if reference.reason else reference.state
    elif missing:
        outcome = (
            f"{results}; whether any of the front beats it is not known without "
            f"{', '.join(missing)}"
        )
    else:
        outcome = (
            f"{results}; {count} of the front beat{'s' if count == 1 else ''} it: better in "
            "one, worse in none"
        )
    return f"{study.own_words}: {outcome}"


def _data(study: Study, rows: Sequence[Candidate], front: Sequence[Candidate]) -> JsonObject:
    """Return the values for the script: columns over all candidates."""
    plotted = _shown_figures(study, rows)
    front_numbers = {row.number for row in front}
    columns = [choices_at(study, path, rows) for path in study.paths]
    columns += [
        {"title": title_of(name), "at": [scaled(name, row.figures) for row in rows], "labels": None}
        for name in plotted
    ]
    return {
        "names": [*study.paths, *plotted],
        "columns": columns,
        "choices": list(study.paths),
        "figures": plotted,
        "objectives": [name for name in study.minimise if name in plotted],
        "number": [row.number for row in rows],
        "state": [row.state for row in rows],
        "stage": [row.stage or row.state for row in rows],
        "front": [i for i, row in enumerate(rows) if row.number in front_numbers],
    }


def _shown_figures(study: Study, rows: Sequence[Candidate]) -> list[str]:
    """Return the objectives, then other figures that differ between planned candidates."""
    values_by_name: dict[str, set[Any]] = {}
    for row in rows:
        if row.state == "done":
            for name, value in row.figures.items():
                values_by_name.setdefault(name, set()).add(value)
    names = [
        name
        for name in sorted(values_by_name)
        if len(values_by_name[name]) > 1 and None not in values_by_name[name]
    ]
    other_names = [
        name
        for name in names
        if name not in study.minimise and name.split(".")[0] in ("duration", "motor_margin")
    ]
    return [*(name for name in study.minimise if name in names), *other_names]


def choices_at(study: Study, path: str, rows: Sequence[Candidate]) -> JsonObject:
    """Return the choices of the rows at a path: {title, at, labels}.

    at: numbers in the unit of the title, or indices of entries with their labels.
    """
    variable = study.vary[study.paths.index(path)]
    if isinstance(variable, Varied):
        values: list[float] = [float(row.design[path].split()[0]) for row in rows]
        return {
            "title": f"{path} ({variable.unit})" if variable.unit else path,
            "at": values,
            "labels": None,
        }
    labels = list(variable.contents)
    indices = {label: i for i, label in enumerate(labels)}
    return {"title": path, "at": [indices[row.design[path]] for row in rows], "labels": labels}


def sensitivity(study: Study, rows: Sequence[Candidate]) -> list[JsonObject]:
    """Return the share (%) of each objective's variance that each choice explains.

    Only planned candidates count; one entry per path.
    """
    finished = [row for row in rows if row.state == "done"]
    shares_by_path = []
    for path in study.paths:
        positions = np.array(choices_at(study, path, finished)["at"], dtype=float)
        shares = []
        for name in study.minimise:
            value = np.array([row.figures.get(name) for row in finished], dtype=float)
            shares.append(
                round(100 * correlation_ratio(positions, value)) if len(finished) > BINS else 0
            )
        shares_by_path.append({"path": path, "shares": shares})
    return shares_by_path


def correlation_ratio(positions: Array, value: Array) -> float:
    """Return the correlation ratio η² of values (n,) over positions (n,).

    It is 0 without and 1 with full dependence. Positions are grouped into bins of equal count. A
    correction for the number of bins makes the mean 0 for independent values.
    """
    finite = np.isfinite(value)
    positions = positions[finite]
    value = value[finite]
    if len(value) < 2 or np.ptp(value) == 0:
        return 0.0
    distinct = np.unique(positions)
    edges = (
        distinct
        if len(distinct) <= BINS
        else np.quantile(positions, np.linspace(0, 1, BINS + 1)[:-1])
    )
    group = np.searchsorted(edges, positions, side="right") - 1
    within = sum(
        float(np.sum((value[group == k] - value[group == k].mean()) ** 2)) for k in np.unique(group)
    )
    count = len(value)
    groups = len(np.unique(group))
    if count <= groups:
        return 0.0
    total = float(np.sum((value - value.mean()) ** 2))
    return max(0.0, 1.0 - within / (count - groups) / (total / (count - 1)))


def displayed_choices(study: Study, row: Candidate) -> dict[str, str]:
    """Return the choices of a candidate by path, with a typographic minus sign."""
    full_design = study.complete_design(row.design, row.figures)
    return {path: re.sub(r"^-", "−", str(value)) for path, value in full_design.items()}


def named(name: str) -> str:
    """Return the name of a figure in words: "motor_mass" as "motor mass"."""
    return name.replace("_", " ")


def unit_of(name: str) -> tuple[str, float]:
    """Return the unit in which a figure is shown ("" for none) and the factor from SI."""
    quantity_name = name.split(".")[0]
    if quantity_name == "motor_margin":
        return ("%", 100.0)
    if quantity_name in UNITS:
        return display_unit(UNITS[quantity_name])
    return ("", 1.0)


def title_of(name: str) -> str:
    """Return the name of a figure with the unit in which it is shown."""
    unit = unit_of(name)[0]
    return f"{named(name)} ({unit})" if unit else named(name)


def in_words(name: str, results: Mapping[str, Any]) -> str:
    """Return a figure with its unit, such as "motor mass 0.239 kg"."""
    return f"{named(name)} {number(scaled(name, results), 4)} {unit_of(name)[0]}".strip()


def scaled(name: str, results: Mapping[str, Any]) -> float | None:
    """Return a figure in the unit in which it is shown, or None if it is missing."""
    value = results.get(name)
    return None if value is None else float(value) * unit_of(name)[1]

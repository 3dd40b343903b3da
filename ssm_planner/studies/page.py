"""Write the page of a study with its front, rejections, parallel coordinates and sensitivity.

The front (Pareto front) contains the candidates that no other candidate surpasses in one objective
without being worse in another. A candidate is one of the robots that the study compares.

`write_study_page` fills in the template study.html. The terminal and the figures use the functions
that name and format results, such as `axis_title` and `format_result`.
"""

import re
import shlex
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.atomic import write_text
from ssm_planner.display import format_number, plain_words
from ssm_planner.reporting import PAGE_MARK, render_page
from ssm_planner.studies.store import Candidate, Candidates, dominating_candidates, pareto_front
from ssm_planner.studies.study import Study, Varied
from ssm_planner.typing import Array, Fields, JsonObject
from ssm_planner.units import display_unit

RESULT_UNITS = {
    "duration": "s",
    "motor_mass": "kg",
    "peak_torque": "N·m",
    "rms_torque": "N·m",
    "reach_margin": "rad",
}
"""SI unit of each result, by the first part of its name. Other results are dimensionless."""
BIN_COUNT = 12
"""Number of bins into which `correlation_ratio` divides a quantity."""
MAX_FRONT_ROWS = 50
"""Largest number of rows in the table of the front."""


def write_study_page(study: Study, rows: Candidates, path: Path, finished: bool) -> Path:
    """Write the page of a study, and return its path.

    Parameters
    ----------
    study : Study
        Study that is shown.
    rows : sequence of Candidate
        Result of the original robot, followed by the results of the candidates.
    path : Path
        File of the page. The page links to the reports of candidates in the same folder.
    finished : bool
        False while the study runs. The page then reloads itself.

    Returns
    -------
    Path
        The path of the page.

    Raises
    ------
    ExportError
        If the file cannot be written.
    """
    original, *candidates = rows
    front = pareto_front(candidates, study.minimise)
    states = sorted(Counter(row.state for row in candidates).items())
    counts_text = ", ".join(f"{count} {state}" for state, count in states)
    objectives = ", ".join(map(plain_words, study.minimise))
    share_text = f"{len(front)} of {len(candidates)} candidates"
    report_files = sorted(path.parent.glob("candidate_*/*/report.html"))
    reports = [report.relative_to(path.parent).as_posix() for report in report_files]
    text = render_page(
        "study.html",
        _script_data(study, candidates, front) | {"reports": reports},
        title=study.name,
        # The arguments of `study show` after the numbers of the candidates.
        file=shlex.join([study.file or "FILE", "-o", str(path.parent)]),
        headline=f"The front in {objectives} contains {share_text}.",
        summary=f"{len(candidates)} candidates: {counts_text}.",
        notes=study.notes,
        fallen=_rejection_rows(candidates),
        objectives=[axis_title(name) for name in study.minimise],
        sensitivity=sensitivity_rows(study, candidates),
        front=_front_table(study, front),
        own=compare_with_original(study, original, front),
        reports=reports,
        unfinished=not finished,
    )
    write_text(path, text, PAGE_MARK)
    return path


def _rejection_rows(rows: Candidates) -> list[JsonObject]:
    """Return the table of the stages that rejected candidates, most frequent first.

    Parameters
    ----------
    rows : sequence of Candidate
        Results of all candidates.

    Returns
    -------
    list of dict
        `stage`, the number `count` of its rejections, and the reason of one of them as `example`.
    """
    stages: dict[str, list[Candidate]] = {}
    for row in rows:
        if row.rejection is not None:
            stages.setdefault(row.rejection, []).append(row)
    return [
        {
            "stage": stage,
            "count": len(rejected),
            "example": re.sub(r"(?<!\w)-(?=\d)", "−", rejected[0].reason or ""),
        }
        for stage, rejected in sorted(stages.items(), key=lambda item: -len(item[1]))
    ]


def _front_table(study: Study, front: Candidates) -> JsonObject:
    """Return the header and the rows of the table of the front.

    The columns are the number of the candidate, the objectives, the variables, and the motors and
    gears that were selected from catalogues. The table has at most `MAX_FRONT_ROWS` rows.

    Parameters
    ----------
    study : Study
        Study that is shown.
    front : sequence of Candidate
        Results of the candidates on the Pareto front.

    Returns
    -------
    dict
        `header` is a list of titles, and `rows` a list of rows with one text for each column.
    """
    names = [name for name in study.minimise if any(name in row.figures for row in front)]
    header = ["number"] + [axis_title(name) for name in names] + list(study.paths)
    header += [choice.path for choice in study.selected]
    table = []
    for row in front[:MAX_FRONT_ROWS]:
        objectives = [format_number(displayed_result(name, row.figures), 5) for name in names]
        choices = list(design_texts(study, row).values())
        table.append([str(row.number)] + objectives + choices)
    return {"header": header, "rows": table}


def compare_with_original(study: Study, reference: Candidate, front: Candidates) -> str:
    """Describe the result of the original robot, and how many candidates are better.

    Parameters
    ----------
    study : Study
        Study that is shown.
    reference : Candidate
        Result of the original robot.
    front : sequence of Candidate
        Results of the candidates on the front.

    Returns
    -------
    str
        Text that begins with the description of the original robot.
    """
    results = ", ".join(format_result(name, reference.figures) for name in study.minimise)
    missing = [plain_words(name) for name in study.minimise if reference.figures.get(name) is None]
    count = len(dominating_candidates(reference, front, study.minimise))
    if reference.state != "done":
        outcome = f"{reference.state}, {reference.reason}" if reference.reason else reference.state
    elif missing:
        outcome = (
            f"{results}; whether any of the front beats it is not known without "
            f"{', '.join(missing)}"
        )
    else:
        verb = "beats" if count == 1 else "beat"
        outcome = f"{results}; {count} of the front {verb} it: better in one, worse in none"
    return f"{study.own_words}: {outcome}"


def _script_data(study: Study, rows: Candidates, front: Candidates) -> JsonObject:
    """Return the data for the script of the page as JSON types.

    Parameters
    ----------
    study : Study
        Study that is shown.
    rows : sequence of Candidate
        Results of all candidates.
    front : sequence of Candidate
        Results of the candidates on the front.

    Returns
    -------
    dict
        `names` are variables and results, and `columns` contains for each name the title, the
        values `at` of all candidates, and `labels` of these values or None. `choices` (variables),
        `figures` (results) and `objectives` are subsets of these names. `number`, `state` and
        `stage` have an entry for each candidate, and `front` contains indices of candidates.
    """
    plotted = _plotted_results(study, rows)
    front_numbers = {row.number for row in front}
    columns = [variable_column(study, path, rows) for path in study.paths]
    for name in plotted:
        values = [displayed_result(name, row.figures) for row in rows]
        columns.append({"title": axis_title(name), "at": values, "labels": None})
    return {
        "names": list(study.paths) + plotted,
        "columns": columns,
        "choices": list(study.paths),
        "figures": plotted,
        "objectives": [name for name in study.minimise if name in plotted],
        "number": [row.number for row in rows],
        "state": [row.state for row in rows],
        "stage": [row.rejection or row.state for row in rows],
        "front": [i for i, row in enumerate(rows) if row.number in front_numbers],
    }


def _plotted_results(study: Study, rows: Candidates) -> list[str]:
    """Return the names of the results that the page plots.

    They are objectives, durations and motor margins. A result is plotted if its values differ and
    do not contain None.

    Parameters
    ----------
    study : Study
        Study with its objectives.
    rows : sequence of Candidate
        Results of all candidates.

    Returns
    -------
    list of str
        Names of the results, beginning with the objectives.
    """
    values_by_name: dict[str, set[Any]] = {}
    for row in rows:
        if row.state == "done":
            for name, value in row.figures.items():
                values_by_name.setdefault(name, set()).add(value)
    names = [
        name
        for name, values in sorted(values_by_name.items())
        if len(values) > 1 and None not in values
    ]
    candidates = [name for name in names if name.split(".")[0] in ("duration", "motor_margin")]
    objectives = [name for name in study.minimise if name in names]
    return list(dict.fromkeys(objectives + candidates))


def variable_column(study: Study, path: str, rows: Candidates) -> JsonObject:
    """Return the values of one variable for all candidates.

    Parameters
    ----------
    study : Study
        Study with the variable.
    path : str
        Path of the variable in the robot file.
    rows : sequence of Candidate
        Candidates whose designs are read.

    Returns
    -------
    dict
        `title` contains the path and the unit. `at` contains a number for each candidate: the value
        in this unit, or the index of the chosen entry in `labels`. `labels` contains the names of
        all entries, or None for a range.
    """
    variable = study.vary[study.paths.index(path)]
    if isinstance(variable, Varied):
        title = f"{path} ({variable.unit})" if variable.unit else path
        values = [float(row.design[path].split()[0]) for row in rows]
        return {"title": title, "at": values, "labels": None}
    labels = list(variable.contents)
    return {"title": path, "at": [labels.index(row.design[path]) for row in rows], "labels": labels}


def sensitivity_rows(study: Study, rows: Candidates) -> list[JsonObject]:
    """Return how much of the variance of each objective each variable explains.

    The value is the correlation ratio η² in per cent, which `correlation_ratio` computes. Only
    candidates with the state "done" are evaluated, and all values are 0 if there are at most
    `BIN_COUNT` of them.

    Parameters
    ----------
    study : Study
        Study with its variables and objectives.
    rows : sequence of Candidate
        Results of all candidates.

    Returns
    -------
    list of dict
        Entry for each variable: its `path`, and its `shares` of the variance of each objective in
        %.
    """
    finished = [row for row in rows if row.state == "done"]
    shares_by_path = []
    for path in study.paths:
        positions = np.array(variable_column(study, path, finished)["at"], dtype=float)
        shares = [0] * len(study.minimise)
        if len(finished) > BIN_COUNT:
            for k, name in enumerate(study.minimise):
                value = np.array([row.figures.get(name) for row in finished], dtype=float)
                shares[k] = round(100 * correlation_ratio(positions, value))
        shares_by_path.append({"path": path, "shares": shares})
    return shares_by_path


def correlation_ratio(positions: Array, value: Array) -> float:
    """Return the part of the variance of values that another quantity explains.

    This correlation ratio η² is 0 for independent quantities and 1 if the other quantity determines
    the values.

    Parameters
    ----------
    positions : (n,) array
        Quantity that explains the values.
    value : (n,) array
        Values whose variance is explained. Values that are not finite are ignored.

    Returns
    -------
    float
        η², from 0 to 1. It is 0 for fewer than two values, for equal values, and for too few values
        per bin.

    Notes
    -----
    The positions are divided into k bins of equal count. The ratio is η² = 1 − (W/(n − k))/s²,
    where W is the sum of the squared deviations of the values from the mean of their bin, n is the
    number of values, and s² is their sample variance. The divisor n − k makes the expected value 0
    for independent quantities.
    """
    finite = np.isfinite(value)
    positions = positions[finite]
    value = value[finite]
    if len(value) < 2 or np.ptp(value) == 0:
        return 0.0
    edges = np.unique(positions)
    if len(edges) > BIN_COUNT:
        edges = np.quantile(positions, np.linspace(0, 1, BIN_COUNT + 1)[:-1])
    bins = np.searchsorted(edges, positions, side="right") - 1
    groups = [value[bins == k] for k in np.unique(bins)]
    degrees_of_freedom = len(value) - len(groups)
    if degrees_of_freedom <= 0:
        return 0.0
    within = sum(len(group) * group.var() for group in groups)
    return max(0.0, 1.0 - float(within / degrees_of_freedom / value.var(ddof=1)))


def design_texts(study: Study, row: Candidate) -> dict[str, str]:
    """Return the values that define a candidate as texts for the page, by path.

    They include the names of the motors and gears that were selected from catalogues. A hyphen at
    the beginning of a number becomes a minus sign.
    """
    full_design = study.complete_design(row.design, row.figures)
    return {path: re.sub(r"^-", "−", str(value)) for path, value in full_design.items()}


def result_unit(name: str) -> tuple[str, float]:
    """Return the display unit of a result.

    Parameters
    ----------
    name : str
        Name of the result, such as "duration.tilt_insert". The part before the dot determines the
        unit.

    Returns
    -------
    unit : str
        The unit, which is empty for a dimensionless result.
    factor : float
        Factor that converts SI values to this unit.
    """
    quantity_name = name.split(".")[0]
    if quantity_name == "motor_margin":
        return ("%", 100.0)
    return display_unit(RESULT_UNITS.get(quantity_name, ""))


def axis_title(name: str) -> str:
    """Return the name of a result in words, with its display unit in parentheses."""
    unit = result_unit(name)[0]
    return f"{plain_words(name)} ({unit})" if unit else plain_words(name)


def format_result(name: str, results: Fields) -> str:
    """Format a result with its name and unit, for example as "motor mass 0.239 kg".

    Parameters
    ----------
    name : str
        Name of the result.
    results : mapping
        Results of a candidate in SI units, by name.

    Returns
    -------
    str
        Name in words, value with four digits in the display unit, and unit.
    """
    value = format_number(displayed_result(name, results), 4)
    return f"{plain_words(name)} {value} {result_unit(name)[0]}".strip()


def displayed_result(name: str, results: Fields) -> float | None:
    """Return a result in its display unit, or None if it is missing."""
    value = results.get(name)
    return None if value is None else float(value) * result_unit(name)[1]

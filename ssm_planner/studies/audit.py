"""Audit the results of a study: plan the front and random rows again, and compare the figures."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from itertools import repeat
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ssm_planner.arguments import checked
from ssm_planner.errors import ProblemError
from ssm_planner.representation import ShortRepr
from ssm_planner.studies.provenance import context_of, description_of, differences, study_of
from ssm_planner.studies.run import OWN, TABLE, StudyProgress, driver_of, existing_store
from ssm_planner.studies.store import Candidate, pareto, write_table
from ssm_planner.studies.study import Design, Study
from ssm_planner.typing import frozen


@frozen
class FigureDifference(ShortRepr):
    """A figure of a candidate that differs from the one that was planned again.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.FigureDifference(3, "duration", 4.0, 4.1, within_tolerance=False).name
    'duration'
    """

    number: int
    """Number of the candidate, or −1 for the study's own robot."""
    name: str
    """Name of the figure, "state" or "stage"."""
    stored: Any
    planned: Any
    within_tolerance: bool


@frozen
class Audit(ShortRepr):
    """The outcome of the audit of a study.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Audit(planned=(-1, 0, 7), faults=("candidate 3 is missing",)).passed
    False
    """

    planned: tuple[int, ...]
    """Numbers of the candidates that were planned again."""
    differences: tuple[FigureDifference, ...] = ()
    """All figures that differ."""
    faults: tuple[str, ...] = ()
    """Rows that were changed or are missing, and other faults of the folder."""
    notes: tuple[str, ...] = ()
    """Remarks that are no faults, such as another version of the program."""

    @property
    def passed(self) -> bool:
        """True if there are no faults and all differences are within the tolerance."""
        return not self.faults and all(each.within_tolerance for each in self.differences)


@checked
def audit_study(
    folder: str | Path,
    share: float = 0.05,
    tolerance: float = 0.0,
    seed: int | None = None,
    workers: int | None = None,
    progress: StudyProgress = lambda done, count, states: None,
) -> Audit:
    """Plan and check some candidates of a study again, and compare them with the stored results.

    These candidates are the study's own robot, the front, and a random share of the others. All
    rows are compared with their hashes, and the designs with those of the search.

    Parameters
    ----------
    folder
        Folder of the results.
    share
        Share of the other candidates, 0 to 1.
    tolerance
        Largest permitted difference of a figure, as a share of the larger value. On the same
        processor, the figures are equal. Another processor may change them by up to 0.5 %.
    seed
        Seed of the random candidates. By default, they differ at each call.
    workers
        Number of worker processes, 1 to 256. The default is the number of processors.
    progress
        Function that is called after each result.

    Returns
    -------
    Audit
        Differences and faults.

    Raises
    ------
    ProblemError
        If the folder does not contain the results of a study, or if an argument is invalid.
    ExportError
        If a file cannot be written.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.audit_study("results/study").passed  # doctest: +SKIP
    """
    for name, value, most in (
        ("share", share, 1),
        ("tolerance", tolerance, 1),
        ("seed", seed, None),
    ):
        if value is not None and not 0 <= value <= (value if most is None else most):
            allowed = "at least 0" if most is None else f"0 to {most}"
            raise ProblemError("out of range", key=name, value=value, allowed=allowed)
    folder = Path(folder)
    with existing_store(folder) as store:
        description = store.description()
        study = study_of(description, folder.resolve().name)
        store.describe(description, context_of(description))
        entries = {number: row for _, number, row in store.entries()}
    original = entries.pop(OWN, None)
    rows, faults = _judged(study, entries)
    if original is None or original.design:
        faults.append("the row of the study's own robot is missing or was changed")
    front = pareto(rows, study.minimise)
    numbers = {row.number for row in front}
    others = [row for row in rows if row.number not in numbers]
    sample = [*front, *random.sample(others, math.ceil(0.05 * len(others)))]
    with (
        TemporaryDirectory() as temporary,
        driver_of(study, Path(temporary), workers, None, progress) as driver,
    ):
        driver.run([row.design for row in sample])
        pairs = [*zip([original, *sample], driver.rows(), strict=True)]
        copy = Path(temporary) / TABLE
        write_table(rows, copy)
        table = folder / TABLE
        if not faults and table.is_file() and table.read_bytes() != copy.read_bytes():
            faults.append(f"{TABLE} does not contain the figures of the rows")
    return Audit(
        tuple(row.number for row, _ in pairs if row),
        tuple(each for row, again in pairs if row for each in _differences(row, again, tolerance)),
        tuple(faults),
        tuple(differences(description, description_of(study))),
    )


def _judged(
    study: Study, entries: dict[int, Candidate | None]
) -> tuple[list[Candidate], list[str]]:
    """Return the results that belong to the study, and the faults of all other rows.

    `entries` contains the rows by number, or None for a row that was changed.
    """
    designs = repeat(None, study.count) if study.search.adaptive else study.designs()
    expected: dict[int, Design | None] = dict(enumerate(designs))
    rows, faults = [], []
    for number in sorted({*expected, *entries}):
        row = entries.get(number)
        if row is None and number in entries:
            fault = "the row was changed after the study had written it"
        elif row is None or row.state == "waiting":
            fault = "there is no result"
        elif number not in expected or expected[number] not in (None, row.design):
            fault = "the search of the study gives no such candidate"
        else:
            rows.append(row)
            continue
        faults.append(f"candidate {number}: {fault}")
    return rows, faults


def _differences(
    stored: Candidate, planned: Candidate, tolerance: float
) -> Iterator[FigureDifference]:
    """Yield the differences between a stored candidate and the same candidate planned again."""
    old, new = ({"state": x.state, "stage": x.stage, **x.figures} for x in (stored, planned))
    for name in dict.fromkeys([*old, *new]):
        a: Any = old.get(name)
        b: Any = new.get(name)
        if a != b:
            are_numbers = isinstance(a, (int, float)) and isinstance(b, (int, float))
            is_near = are_numbers and math.isclose(a, b, rel_tol=tolerance)
            yield FigureDifference(stored.number, name, a, b, is_near)

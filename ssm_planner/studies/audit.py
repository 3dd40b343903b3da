"""Audit the results of a study: plan some candidates again, and compare their figures.

An audit shows whether the stored results were changed, and whether this computer obtains the same
results. Figures are the numerical results of a candidate, such as its duration.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Mapping
from itertools import repeat
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ssm_planner.arguments import checked
from ssm_planner.errors import ProblemError
from ssm_planner.studies.provenance import (
    context_hash,
    describe_differences,
    describe_study,
    study_from_description,
)
from ssm_planner.studies.run import (
    ORIGINAL_NUMBER,
    TABLE_FILE,
    StudyProgress,
    open_existing_store,
    open_runner,
)
from ssm_planner.studies.store import Candidate, pareto_front, write_table
from ssm_planner.studies.study import Study
from ssm_planner.typing import frozen


@frozen
class Audit:
    """The outcome of the audit of a study.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Audit(planned=(-1, 0, 7), faults=("candidate 3: there is no result",)).passed
    False
    """

    planned: tuple[int, ...]
    """Numbers of the candidates that were planned again. The original robot has the number −1."""
    faults: tuple[str, ...] = ()
    """Descriptions of figures that differ, of changed or missing rows, and of a table that differs.
    """
    notes: tuple[str, ...] = ()
    """Descriptions of differences within the tolerance, and of differences between the programs."""

    @property
    def passed(self) -> bool:
        """True if the audit found no fault."""
        return not self.faults


@checked
def audit_study(
    folder: str | Path,
    tolerance: float = 1e-6,
    workers: int | None = None,
    progress: StudyProgress = lambda done, count, states: None,
) -> Audit:
    """Plan and check some candidates of a study again, and compare them with the stored results.

    A candidate is one of the robots that the study compares. The audit plans the original robot,
    the Pareto front, and a random 5 % of the other candidates. It compares all stored rows with
    their hashes, and their designs with those of the search. The designs of an adaptive search are
    not compared, because they depend on results.

    Parameters
    ----------
    folder : str or Path
        Folder of the results.
    tolerance : float
        Largest permitted difference of a figure, relative to the larger of the two values. The
        default only permits rounding. Another processor may change figures by up to 0.5 %.
    workers : int, optional
        Number of worker processes, 1 to 256. The default is the number of processors.
    progress : StudyProgress
        Function that is called after each result.

    Returns
    -------
    Audit
        Faults, and the numbers of the candidates that were planned again.

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
    if not 0 <= tolerance < 1:
        raise ProblemError("not a share", key="tolerance", value=tolerance, allowed="0 to 1")
    folder = Path(folder)
    with open_existing_store(folder) as store:
        description = store.description()
        study = study_from_description(description, str(folder))
        store.set_description(description, context_hash(description))
        entries = {number: row for _, number, row in store.entries()}
    original = entries.pop(ORIGINAL_NUMBER, None)
    faults = dict(_row_faults(study, entries))
    if original is None or original.design:
        faults[ORIGINAL_NUMBER] = "the row is missing or was changed"
    rows = [row for number, row in entries.items() if row and number not in faults]
    front = pareto_front(rows, study.minimise)
    front_numbers = {row.number for row in front}
    remaining = [row for row in rows if row.number not in front_numbers]
    sample = list(front) + random.sample(remaining, math.ceil(0.05 * len(remaining)))
    with (
        TemporaryDirectory() as temporary,
        open_runner(study, Path(temporary), workers, None, progress) as runner,
    ):
        runner.run([row.design for row in sample])
        new_rows = runner.rows()
        expected_table = Path(temporary, TABLE_FILE)
        write_table(rows, expected_table)
        table = folder / TABLE_FILE
        table_differs = table.is_file() and table.read_bytes() != expected_table.read_bytes()
    messages = [f"candidate {number}: {fault}" for number, fault in sorted(faults.items())]
    notes = describe_differences(description, describe_study(study))
    if not faults and table_differs:
        messages.append(f"{TABLE_FILE} does not contain the figures of the rows")
    stored_rows = [original or new_rows[0]] + sample
    for row, new_row in zip(stored_rows, new_rows, strict=True):
        for text, is_near in _result_differences(row, new_row, tolerance):
            outcome = notes if is_near else messages
            outcome.append(f"candidate {row.number}: {text}")
    numbers = [ORIGINAL_NUMBER] + [row.number for row in sample]
    return Audit(tuple(numbers), tuple(messages), tuple(notes))


def _row_faults(study: Study, entries: Mapping[int, Candidate | None]) -> Iterator[tuple[int, str]]:
    """Find the rows that cannot be results of the study.

    Parameters
    ----------
    study : Study
        Study that the store describes.
    entries : mapping of int to Candidate or None
        Row of each candidate by its number, or None for a row that was changed.

    Yields
    ------
    number : int
        Number of the candidate.
    fault : str
        Description of the fault.
    """
    designs = repeat(None, study.count) if study.search.adaptive else study.designs()
    for number, design in enumerate(designs):
        row = entries.get(number)
        if row is None:
            yield number, "the row is missing or was changed"
        elif row.state == "waiting":
            yield number, "there is no result"
        elif design not in (None, row.design):
            yield number, "the search of the study gives another design"
    for number in entries.keys() - range(study.count):
        yield number, "the search of the study does not give this candidate"


def _result_differences(stored: Candidate, new: Candidate, tolerance: float) -> Iterator[Any]:
    """Compare the stored result of a candidate with the result of the audit.

    Parameters
    ----------
    stored : Candidate
        Result in the store.
    new : Candidate
        Result of the same candidate that was computed again.
    tolerance : float
        Permitted difference of a figure, relative to the larger value.

    Yields
    ------
    text : str
        Description of a state, stage or figure that differs.
    is_near : bool
        True if the difference is within the tolerance.
    """
    stored_values = {"state": stored.state, "stage": stored.stage, **stored.figures}
    new_values = {"state": new.state, "stage": new.stage, **new.figures}
    for name in stored_values | new_values:
        a: Any = stored_values.get(name)
        b: Any = new_values.get(name)
        if a != b:
            are_numbers = {type(a), type(b)} <= {int, float}
            is_near = are_numbers and abs(a - b) <= tolerance * max(abs(a), abs(b))
            yield f"{name}: {a} is stored, {b} is planned again", is_near

"""Run a study: screen candidates, let workers evaluate the others, and store the results."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ssm_planner.arguments import checked
from ssm_planner.errors import ProblemError, SsmPlannerError
from ssm_planner.representation import ShortRepr
from ssm_planner.studies.evaluation import Evaluation, evaluate_batch
from ssm_planner.studies.figures import write_study_figures
from ssm_planner.studies.page import write_study_page
from ssm_planner.studies.screens import Screens
from ssm_planner.studies.store import Candidate, Store, better, key_of, pareto, write_table
from ssm_planner.studies.study import Choice, Design, Study
from ssm_planner.studies.study_file import load_study
from ssm_planner.studies.workers import WorkerDied, Workers
from ssm_planner.trajectory import blocks
from ssm_planner.typing import JsonObject, frozen

STORE = "study.sqlite"
TABLE = "table.csv"
PAGE = "study.html"
OWN = -1
"""Number of the study's own robot."""
SCREENED_TOGETHER = 4096
"""Number of candidates that are screened at once."""
COMMIT_EVERY = 0.5
"""Interval between writes of the store, s."""
PAGE_EVERY = 10.0
"""Shortest interval between two pages of a running study, s."""
AHEAD = 8
"""Number of batches per worker that are submitted in advance, so that no worker has to wait."""
AHEAD_ELSEWHERE = 512
"""Number of batches that are submitted in advance to an executor of unknown size."""
BATCH_SECONDS = 0.25
"""Target duration of a batch, s. An executor has a fixed cost for each batch."""
LARGEST_BATCH = 64
"""Largest number of candidates in a batch."""
MOST_WORKERS = 256

Task = tuple[str, int, Design]
"""Key, number and design of a candidate that workers evaluate."""


class StudyError(SsmPlannerError):
    """Error for an executor that has lost its workers."""


StudyProgress = Callable[[int, int, dict[str, int]], None]
"""Function of the number of finished candidates, the total, and the number in each state."""


@frozen
class StudyResult(ShortRepr):
    """The results of a study, and the folder that contains them.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> result = ssm.study("vitreoretinal", "results/study")  # doctest: +SKIP
    >>> result.finished, len(result.front)  # doctest: +SKIP
    """

    study: Study
    rows: tuple[Candidate, ...]
    folder: Path
    finished: bool
    """False after an interruption."""
    own: Candidate
    """The study's own robot without changes."""

    @property
    def states(self) -> dict[str, int]:
        """Number of candidates in each state."""
        return dict(sorted(Counter(row.state for row in self.rows).items()))

    @property
    def reasons(self) -> dict[str, int]:
        """Number of rejected candidates by stage, in descending order."""
        counts = Counter(row.rejection for row in self.rows if row.rejection is not None)
        return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))

    @property
    def better(self) -> tuple[Candidate, ...]:
        """Candidates that beat the study's own robot in one objective and are worse in none.

        Empty if that robot lacks an objective or violates a requirement.
        """
        return better(self.own, self.front, self.study.minimise)

    @property
    def front(self) -> tuple[Candidate, ...]:
        """Candidates that no other candidate dominates, in the order of the first objective."""
        return pareto(self.rows, self.study.minimise)


@checked
def study(
    of: Study | str | Path,
    folder: str | Path,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: StudyProgress = lambda done, count, states: None,
) -> StudyResult:
    """Evaluate the candidates of a study, and write the store, the table, the page and the figures.

    Candidates with results in the store are not evaluated again. Ctrl-C ends a run, and the same
    call continues it.

    Parameters
    ----------
    of
        Study, its file, or the name of a shipped study.
    folder
        Folder of the results.
    workers
        Number of worker processes, 1 to 256. The default is the number of processors.
    executor
        Any `concurrent.futures.Executor`, such as that of Dask, which replaces the worker
        processes. It is not shut down.
    progress
        Function that is called after each result.

    Returns
    -------
    StudyResult
        Results of all candidates.

    Raises
    ------
    ProblemError
        If the study is invalid, or if another program writes the same store.
    ExportError
        If a file cannot be written.
    StudyError
        If the executor loses its workers.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> result = ssm.study("vitreoretinal", "results/study")  # doctest: +SKIP
    >>> [candidate.number for candidate in result.front]  # doctest: +SKIP
    """
    of = of if isinstance(of, Study) else load_study(of)
    if workers is not None and not 1 <= workers <= MOST_WORKERS:
        raise ProblemError(
            "invalid number of workers",
            key="workers",
            value=workers,
            allowed=f"1 to {MOST_WORKERS}",
        )
    folder = Path(folder)
    count = workers or os.cpu_count() or 1
    with ExitStack() as stack:
        store = stack.enter_context(Store(folder / STORE))
        pool = executor or Workers(count)
        if executor is None:
            stack.callback(pool.shutdown, cancel_futures=True)
        driver = _Driver(
            of, store, pool, AHEAD * count if executor is None else AHEAD_ELSEWHERE, progress
        )
        finished = True
        try:
            driver.run()
        except KeyboardInterrupt:
            finished = False
        driver.flush()
        rows = tuple(store.rows(driver.keys))
        (original,) = store.rows([driver.own])
    result = StudyResult(of, rows, folder, finished, original)
    write_table(rows, folder / TABLE)
    write_study_page(of, (original, *rows), result.front, folder / PAGE, finished=True)
    write_study_figures(of, original, rows, result.front, folder)
    return result


class _Driver:
    """Driver of a study. It screens candidates, sends them to the workers and writes the store."""

    def __init__(
        self, study: Study, store: Store, pool: Executor, ahead: int, progress: StudyProgress
    ) -> None:
        self._study = study
        self._store = store
        self._pool = pool
        self._ahead = ahead
        self._progress = progress
        self._context = context_of(study)
        self._screens = Screens(study)
        self.keys: list[str] = []
        self.own = key_of({}, self._context)
        self._pending: dict[Future[tuple[list[Candidate], float]], Sequence[Task]] = {}
        # Decaying sums over the latest batches.
        self._batch_seconds, self._batch_candidates = BATCH_SECONDS, 1.0
        self._finished: list[tuple[str, Candidate]] = []
        self._last_write = time.monotonic()
        self._next_page = self._last_write + PAGE_EVERY
        self._states: dict[str, int] = {}
        self._earlier: dict[str, tuple[int, str]] = {}
        # Executors treat the pickle as bytes, so the study is pickled only once.
        self._evaluation = pickle.dumps(Evaluation(study))

    def run(self) -> None:
        """Evaluate all candidates, beginning with the study's own robot."""
        self._store.add([(OWN, self.own, {})])
        self._earlier = self._store.states()
        if self._earlier[self.own][1] == "waiting":
            self._submit([(self.own, OWN, {})])
        if self._study.search.adaptive:
            from ssm_planner.studies.adaptive import batches

            for designs, tell in batches(self._study):
                tell(self._process(designs, len(self.keys), self._study.search.points))
            return
        designs = list(self._study.designs())
        for block in blocks(len(designs), SCREENED_TOGETHER):
            self._process(designs[block], len(self.keys), len(designs), collect=False)
        self._drain()
        self.flush()

    def flush(self) -> None:
        """Write finished candidates into the store. Also write the page if the last one is old."""
        if self._finished:
            self._store.put(self._finished)
            self._finished = []
        self._last_write = time.monotonic()
        if self._last_write > self._next_page:
            self._write_page()

    def _write_page(self) -> None:
        """Write the page of the running study. Pages take at most 2 % of the time."""
        rows = self._store.rows([self.own, *self.keys])
        page = self._store.path.with_name(PAGE)
        front = pareto(rows, self._study.minimise)
        write_study_page(self._study, rows, front, page, finished=False)
        now = time.monotonic()
        self._next_page = now + max(PAGE_EVERY, 50 * (now - self._last_write))

    def _process(
        self, designs: Sequence[Design], first_number: int, total: int, collect: bool = True
    ) -> list[Candidate]:
        """Screen candidates, and send those that pass to the workers.

        Parameters
        ----------
        designs
            Designs of the candidates.
        first_number
            Number of the first candidate.
        total
            Number of candidates of the study.
        collect
            If true, wait for all results.

        Returns
        -------
        list[Candidate]
            Results of the candidates. Empty if `collect` is false.
        """
        keys = [key_of(design, self._context) for design in designs]
        self._total = total
        self.keys += keys
        waiting: list[Task] = []
        new: list[tuple[int, str, Design]] = []
        for number, (key, design) in enumerate(zip(keys, designs, strict=True), first_number):
            known_number, state = self._earlier.get(key, (None, "waiting"))
            if known_number != number:
                new.append((number, key, design))
            if state == "waiting":
                waiting.append((key, number, design))
            else:
                self._count(state)
        self._store.add(new)
        batch: list[Task] = []
        rejections = self._screens.reject([design for _, _, design in waiting])
        for task, rejection in zip(waiting, rejections, strict=True):
            if rejection is not None:
                key, number, design = task
                stage, reason = rejection.stage, rejection.reason
                self._record(key, Candidate(number, "infeasible", design, stage, reason))
                continue
            batch.append(task)
            size = BATCH_SECONDS * self._batch_candidates / self._batch_seconds
            if len(batch) >= min(size, LARGEST_BATCH):
                while len(self._pending) >= self._ahead:
                    self._collect()
                self._submit(batch)
                batch = []
        if batch:
            self._submit(batch)
        if not collect:
            return []
        self._drain()
        self.flush()
        return self._store.rows(keys)

    def _submit(self, batch: Sequence[Task]) -> None:
        """Send a batch to the next free worker."""
        candidates = [(number, design) for _, number, design in batch]
        future = self._pool.submit(evaluate_batch, self._evaluation, candidates)
        self._pending[future] = batch

    def _drain(self) -> None:
        """Wait for the results of all batches."""
        while self._pending:
            self._collect()

    def _collect(self) -> None:
        """Wait for the result of at least one batch.

        The candidates of a batch that ended its worker are submitted again, one by one. Raises
        StudyError if the executor fails in another way.
        """
        worker_error: BaseException | None = None
        for future in wait(self._pending, timeout=COMMIT_EVERY, return_when=FIRST_COMPLETED).done:
            batch = self._pending.pop(future)
            try:
                rows, seconds = future.result()
            except (CancelledError, Exception) as error:  # noqa: BLE001 of the executor
                # Dask raises KilledWorker instead of WorkerDied.
                if not isinstance(error, WorkerDied) and type(error).__name__ != "KilledWorker":
                    worker_error = error
                elif len(batch) > 1:
                    for task in batch:
                        self._submit([task])
                else:
                    reason = "ended its worker process each time it was tried"
                    self._record(batch[0][0], Candidate(-1, "quarantined", {}, None, reason))
                continue
            self._batch_seconds = 0.8 * self._batch_seconds + seconds
            self._batch_candidates = 0.8 * self._batch_candidates + len(batch)
            for (key, _, _), row in zip(batch, rows, strict=True):
                self._record(key, row)
        if worker_error is not None or time.monotonic() - self._last_write > COMMIT_EVERY:
            self.flush()
        if worker_error is not None:
            reason = f"the workers are lost ({type(worker_error).__name__})"
            raise StudyError(
                f"{reason}; the results are stored, and the same command continues the study"
            ) from worker_error

    def _record(self, key: str, row: Candidate) -> None:
        """Add a result to those of the next write, and count its state."""
        self._finished.append((key, row))
        if key != self.own:
            self._count(row.state)
        if len(self._finished) >= SCREENED_TOGETHER:
            self.flush()

    def _count(self, state: str) -> None:
        """Count the state of a candidate, and report the progress."""
        self._states[state] = self._states.get(state, 0) + 1
        self._progress(sum(self._states.values()), self._total, self._states)


def context_of(study: Study) -> str:
    """Return a hash of all data that determine the result of a design.

    These are the robot, the motions, the catalogues, the requirements and the version of the
    package.
    """
    contents: JsonObject = {v.path: v.contents for v in study.vary if isinstance(v, Choice)}
    contents |= {v.path: [v.select, v.contents, v.beside] for v in study.selected}
    dependencies: Mapping[str, Any] = {
        "robot": study.robot,
        "motions": study.motions,
        "contents": contents,
        "require": {
            name: getattr(study.require, name) for name in study.require.__dataclass_fields__
        },
        "version": version("ssm_planner"),
    }
    text = json.dumps(dependencies, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()

"""Run a study: screen candidates, let workers evaluate the others, and store the results.

`study` is the entry. Its `StudyRunner` rejects candidates by the screens, sends the remaining ones
to worker processes in batches, and writes the results into the store.
"""

from __future__ import annotations

import os
import pickle
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

from ssm_planner.arguments import checked
from ssm_planner.errors import ProblemError, SsmPlannerError
from ssm_planner.studies.evaluation import Evaluation, evaluate_batch
from ssm_planner.studies.figures import write_study_figures
from ssm_planner.studies.page import write_study_page
from ssm_planner.studies.provenance import (
    context_hash,
    describe_differences,
    describe_program,
    describe_study,
)
from ssm_planner.studies.screens import Screens
from ssm_planner.studies.store import (
    Candidate,
    Store,
    candidate_key,
    dominating_candidates,
    pareto_front,
    write_table,
)
from ssm_planner.studies.study import Design, Study
from ssm_planner.studies.study_file import load_study
from ssm_planner.studies.workers import WorkerDied, Workers
from ssm_planner.typing import frozen

STORE_FILE = "study.sqlite"
"""Name of the database with the results of all candidates."""
TABLE_FILE = "table.csv"
"""Name of the table of all candidates."""
PAGE_FILE = "study.html"
"""Name of the page of a study."""
ORIGINAL_NUMBER = -1
"""Number of the original robot, that is, the robot of the study file without changes."""
SCREENING_BLOCK_SIZE = 4096
"""Number of candidates that are screened at once."""
WRITE_INTERVAL = 0.5
"""Shortest time between two writes of the store, s."""
PAGE_INTERVAL = 10.0
"""Shortest time between two pages of a running study, s."""
QUEUED_BATCHES_PER_WORKER = 8
"""Number of batches per worker that are submitted in advance, so that no worker has to wait."""
QUEUED_BATCHES_FOR_EXECUTOR = 512
"""Number of batches that are submitted in advance to an executor of unknown size."""
BATCH_DURATION = 0.25
"""Desired duration of a batch, s. Larger batches reduce the cost of communication."""
MAX_BATCH_SIZE = 64
"""Largest number of candidates in a batch."""
MAX_WORKERS = 256
"""Largest number of worker processes."""

CandidateTask = tuple[str, int, Design]
"""Key in the store, number and design of a candidate that workers evaluate."""


class StudyError(SsmPlannerError):
    """Error for an executor that has lost its workers, or whose workers have another program."""


StudyProgress = Callable[[int, int, dict[str, int]], None]
"""Function that is called with the number of finished candidates, the number of all candidates, and
the number of finished candidates in each state.
"""


@frozen
class StudyResult:
    """The results of a study, and the folder that contains them.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> result = ssm.study("vitreoretinal", "results/study")  # doctest: +SKIP
    >>> result.finished, len(result.front)  # doctest: +SKIP
    """

    study: Study
    rows: tuple[Candidate, ...]
    """Results of all candidates in the order of their numbers."""
    folder: Path
    finished: bool
    """False if the study was interrupted."""
    own: Candidate
    """Result of the original robot, that is, the robot of the study file without changes."""
    notes: tuple[str, ...] = ()
    """Remarks that a reader of the results must know."""

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
        """Candidates that are better than the original robot in at least one objective.

        They are at least as good in all others. Empty if the original robot is not done or lacks an
        objective.
        """
        return dominating_candidates(self.own, self.front, self.study.minimise)

    @property
    def front(self) -> tuple[Candidate, ...]:
        """Pareto front: candidates that no other candidate dominates, by the first objective."""
        return pareto_front(self.rows, self.study.minimise)


@checked
def study(
    of: Study | str | Path,
    folder: str | Path,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: StudyProgress = lambda done, count, states: None,
) -> StudyResult:
    """Evaluate the candidates of a study, and write the store, the table, the page and the figures.

    Results that an earlier run has stored are used again if the inputs and the program are the
    same. Rows of other inputs or another program stay in the store, but the result does not contain
    them. Ctrl-C ends a run, and the same call continues it.

    Parameters
    ----------
    of : Study, str or Path
        Study, its file, or the name of a shipped study.
    folder : str or Path
        Folder of the results.
    workers : int, optional
        Number of worker processes, 1 to 256. The default is the number of processors.
    executor : Executor, optional
        Any `concurrent.futures.Executor`, such as that of Dask, which replaces the worker
        processes. This function does not shut it down.
    progress : StudyProgress
        Function that is called after each result.

    Returns
    -------
    StudyResult
        Results of all candidates.

    Raises
    ------
    ProblemError
        If the study is invalid, if a row of the store was changed, or if another program writes the
        same store.
    ExportError
        If a file cannot be written, or if it is a symbolic link.
    StudyError
        If the executor loses its workers, or if a worker has another version of this package or of
        a numerical library.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> result = ssm.study("vitreoretinal", "results/study")  # doctest: +SKIP
    >>> [candidate.number for candidate in result.front]  # doctest: +SKIP
    """
    definition = of if isinstance(of, Study) else load_study(of)
    folder = Path(folder)
    with open_runner(definition, folder, workers, executor, progress) as runner:
        finished = True
        try:
            runner.run()
        except KeyboardInterrupt:
            finished = False
        runner.flush()
        all_rows = runner.rows()
    original, *rows = all_rows
    result = StudyResult(
        definition, tuple(rows), folder, finished, original, notes=tuple(runner.notes)
    )
    write_table(rows, folder / TABLE_FILE)
    write_study_page(definition, all_rows, folder / PAGE_FILE, finished=True)
    write_study_figures(definition, original, rows, result.front, folder)
    return result


def open_existing_store(folder: Path) -> Store:
    """Open the database with the results of a study in a folder.

    Parameters
    ----------
    folder : Path
        Folder of the results.

    Returns
    -------
    Store
        The open database, which the caller must close.

    Raises
    ------
    ProblemError
        If the folder does not contain a store.
    """
    if not (folder / STORE_FILE).is_file():
        raise ProblemError(
            "this folder does not contain the results of a study",
            file=folder / STORE_FILE,
            allowed="the folder that `study -o` wrote",
        )
    return Store(folder / STORE_FILE)


@contextmanager
def open_runner(
    definition: Study,
    folder: Path,
    workers: int | None,
    executor: Executor | None,
    progress: StudyProgress,
) -> Iterator[StudyRunner]:
    """Yield the runner of a study, and end its workers at the end of the block.

    The audit of a study uses this function as well.

    Parameters
    ----------
    definition : Study
        Study that is run.
    folder : Path
        Folder with the store of the results.
    workers : int or None
        Number of worker processes. None means the number of processors.
    executor : Executor or None
        Executor that replaces the worker processes. It is not shut down.
    progress : StudyProgress
        Function that is called after each result.

    Yields
    ------
    StudyRunner
        Runner with an open store.

    Raises
    ------
    ProblemError
        If the number of workers is invalid, or if the store cannot be used.
    ExportError
        If the store cannot be written.
    """
    if workers is not None and not 1 <= workers <= MAX_WORKERS:
        raise ProblemError(
            "invalid number of workers", key="workers", value=workers, allowed=f"1 to {MAX_WORKERS}"
        )
    count = workers or os.cpu_count() or 1
    with ExitStack() as stack:
        store = stack.enter_context(Store(folder / STORE_FILE))
        pool = executor or Workers(count)
        if executor is None:
            stack.callback(pool.shutdown, cancel_futures=True)
        max_pending = (
            QUEUED_BATCHES_PER_WORKER * count if executor is None else QUEUED_BATCHES_FOR_EXECUTOR
        )
        yield StudyRunner(definition, store, pool, max_pending, progress)


class StudyRunner:
    """Runner of a study, which screens candidates, sends them to workers and stores the results.

    Parameters
    ----------
    study : Study
        Study that is run.
    store : Store
        Database of the results.
    executor : Executor
        Workers that evaluate batches of candidates.
    max_pending : int
        Largest number of batches that are submitted before their results arrive.
    progress : StudyProgress
        Function that is called after each result.

    Attributes
    ----------
    notes : list of str
        Remarks that a reader of the results must know.
    keys : list of str
        Keys of all candidates that were submitted, in the order of their numbers.
    original_key : str
        Key of the original robot.
    """

    def __init__(
        self,
        study: Study,
        store: Store,
        executor: Executor,
        max_pending: int,
        progress: StudyProgress,
    ) -> None:
        """Prepare the store and the screens. The parameters are those of the class."""
        self._study = study
        self._store = store
        self._executor = executor
        self._max_pending = max_pending
        self._progress = progress
        description = describe_study(study)
        self._context = context_hash(description)
        previous = store.set_description(description, self._context)
        self.notes = study.notes
        if previous and context_hash(previous) != self._context:
            self.notes += [
                "The folder contained results of another study or program: "
                f"{', '.join(describe_differences(previous, description))}. Their rows remain in "
                f"{STORE_FILE}, but they are not used, and the candidates were evaluated again."
            ]
        self._screens = Screens(study)
        self.keys: list[str] = []
        self.original_key = candidate_key({}, self._context)
        self._pending: dict[Future[Any], Sequence[CandidateTask]] = {}
        # Duration (s) and number of candidates of the latest batches, as sums in which the weight
        # of a batch decreases by the factor 0.8 with each later batch.
        self._batch_seconds = BATCH_DURATION
        self._batch_candidates = 1.0
        self._unwritten_results: list[tuple[str, Candidate]] = []
        self._last_write = time.monotonic()
        self._next_page = self._last_write + PAGE_INTERVAL
        self._states: Counter[str] = Counter()
        self._stored_states: dict[str, tuple[int | None, str]] = {}
        # The study is pickled only once. Executors transfer the resulting bytes unchanged.
        self._pickled_evaluation = pickle.dumps(Evaluation(study))

    def run(self, sample: Sequence[Design] | None = None) -> None:
        """Evaluate the original robot and then all candidates.

        Parameters
        ----------
        sample : sequence of Design, optional
            Designs that replace the candidates of the search, as in an audit.
        """
        self._store.add_candidates([(ORIGINAL_NUMBER, self.original_key, {})])
        self._stored_states = self._store.states()
        if self._stored_states[self.original_key][1] == "waiting":
            self._submit_batch([(self.original_key, ORIGINAL_NUMBER, {})])
        self._total = self._study.count if sample is None else len(sample)
        if self._study.search.adaptive and sample is None:
            from ssm_planner.studies.adaptive import candidate_batches

            for designs, report_results in candidate_batches(self._study):
                self._submit_passing(designs)
                self._wait_for_pending()
                report_results(self.rows()[-len(designs) :])
            return
        remaining = self._study.designs() if sample is None else iter(sample)
        while block := list(islice(remaining, SCREENING_BLOCK_SIZE)):
            self._submit_passing(block)
        self._wait_for_pending()

    def rows(self) -> list[Candidate]:
        """Return the stored results of the original robot and of all submitted candidates."""
        return self._store.rows([self.original_key] + self.keys)

    def flush(self) -> None:
        """Write finished results into the store, and write the page if the last one is old.

        The time until the next page is at least 50 times that of writing this page.
        """
        if self._unwritten_results:
            self._store.write_results(self._unwritten_results)
            self._unwritten_results = []
        self._last_write = time.monotonic()
        if self._last_write > self._next_page:
            page = self._store.path.with_name(PAGE_FILE)
            write_study_page(self._study, self.rows(), page, finished=False)
            now = time.monotonic()
            self._next_page = now + max(PAGE_INTERVAL, 50 * (now - self._last_write))

    def _submit_passing(self, designs: Sequence[Design]) -> None:
        """Screen candidates, store the rejections, and send the other candidates to the workers.

        The screens are closed-form tests without planning (`screens`). Candidates with a stored
        result are only counted. The size of the batches is chosen such that a batch takes about
        `BATCH_DURATION`, according to the duration of earlier batches.

        Parameters
        ----------
        designs : sequence of Design
            Designs of the candidates with the next numbers of the search.
        """
        waiting: list[CandidateTask] = []
        unnumbered: list[tuple[int, str, Design]] = []
        for number, design in enumerate(designs, len(self.keys)):
            key = candidate_key(design, self._context)
            self.keys.append(key)
            known_number, state = self._stored_states.get(key, (None, "waiting"))
            if known_number != number:
                unnumbered.append((number, key, design))
            if state == "waiting":
                waiting.append((key, number, design))
            else:
                self._count_state(state)
        self._store.add_candidates(unnumbered)
        batch: list[CandidateTask] = []
        rejections = self._screens.reject([design for _, _, design in waiting])
        for task, rejection in zip(waiting, rejections, strict=True):
            if rejection is not None:
                key, number, design = task
                stage = rejection.stage
                reason = rejection.reason
                self._record_result(key, Candidate(number, "infeasible", design, stage, reason))
                continue
            batch.append(task)
            batch_size = BATCH_DURATION * self._batch_candidates / self._batch_seconds
            if len(batch) >= min(batch_size, MAX_BATCH_SIZE):
                while len(self._pending) >= self._max_pending:
                    self._collect_results()
                self._submit_batch(batch)
                batch = []
        if batch:
            self._submit_batch(batch)

    def _submit_batch(self, batch: Sequence[CandidateTask]) -> None:
        """Send a batch to the next free worker."""
        candidates = [(number, design) for _, number, design in batch]
        future = self._executor.submit(evaluate_batch, self._pickled_evaluation, candidates)
        self._pending[future] = batch

    def _wait_for_pending(self) -> None:
        """Wait for the results of all batches, and store them."""
        while self._pending:
            self._collect_results()
        self.flush()

    def _collect_results(self) -> None:
        """Wait until a batch is finished or WRITE_INTERVAL has passed, and record its results.

        If a batch ended its worker process, its candidates are submitted again one by one. A single
        candidate that ends its worker at every attempt gets the state "quarantined".

        Raises
        ------
        StudyError
            If the executor fails in another way, or if a worker has another program.
        """
        worker_error: BaseException | None = None
        for future in wait(self._pending, timeout=WRITE_INTERVAL, return_when=FIRST_COMPLETED).done:
            batch = self._pending.pop(future)
            try:
                rows, seconds, workers_program = future.result()
                differing = describe_differences(workers_program, describe_program())
                if differing:
                    names = ", ".join(differing)
                    raise StudyError(f"a worker has another program than the driver: {names}")
            except (CancelledError, Exception) as error:  # noqa: BLE001 of the executor
                # Dask raises KilledWorker instead of WorkerDied.
                if not isinstance(error, WorkerDied) and type(error).__name__ != "KilledWorker":
                    worker_error = error
                elif len(batch) > 1:
                    for task in batch:
                        self._submit_batch([task])
                else:
                    reason = "ended its worker process each time it was tried"
                    self._record_result(batch[0][0], Candidate(-1, "quarantined", {}, None, reason))
                continue
            self._batch_seconds = 0.8 * self._batch_seconds + seconds
            self._batch_candidates = 0.8 * self._batch_candidates + len(batch)
            for (key, _, _), row in zip(batch, rows, strict=True):
                self._record_result(key, row)
        if worker_error is not None or time.monotonic() - self._last_write > WRITE_INTERVAL:
            self.flush()
        if worker_error is not None:
            reason = str(worker_error)
            if not isinstance(worker_error, StudyError):
                reason = f"the workers are lost ({type(worker_error).__name__}: {reason})"
            raise StudyError(
                f"{reason}; the other results are stored, and the same command continues the study"
            ) from worker_error

    def _record_result(self, key: str, row: Candidate) -> None:
        """Keep a result for the next write into the store, and count its state."""
        self._unwritten_results.append((key, row))
        if key != self.original_key:
            self._count_state(row.state)
        if len(self._unwritten_results) >= SCREENING_BLOCK_SIZE:
            self.flush()

    def _count_state(self, state: str) -> None:
        """Count the state of a finished candidate, and report the progress."""
        self._states[state] += 1
        self._progress(self._states.total(), self._total, self._states)

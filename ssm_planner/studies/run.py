"""Run a study: screen candidates, let workers evaluate the others, and store the results."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import pickle
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ssm_planner.arguments import checked
from ssm_planner.errors import SsmPlannerError
from ssm_planner.representation import ShortRepr
from ssm_planner.studies.evaluation import Evaluation, evaluate_batch
from ssm_planner.studies.figures import write_study_figures
from ssm_planner.studies.page import write_study_page
from ssm_planner.studies.screens import Screens
from ssm_planner.studies.store import Candidate, Store, better, key_of, pareto, write_table
from ssm_planner.studies.study import Choice, Design, Study
from ssm_planner.studies.study_file import load_study
from ssm_planner.studies.workers import WorkerDied, Workers

STORE = "study.sqlite"
TABLE = "table.csv"
PAGE = "study.html"
OWN = -1
"""Number of the study's own robot."""
SCREENED_TOGETHER = 4096
COMMIT_EVERY = 0.5
"""Time between writes of the store, s."""
PAGE_EVERY = 10.0
"""Shortest time between pages of a running study, s."""
AHEAD = 8
"""Batches per worker in advance, so that no worker waits for the driver."""
AHEAD_ELSEWHERE = 512
"""Batches in advance for an executor of unknown size."""
BATCH_SECONDS = 0.25
LARGEST_BATCH = 64
"""Target duration (s) and largest size of a batch; engines have a fixed cost per batch."""

Asked = tuple[str, int, Design]
"""Key, number and design of a candidate for the workers."""


class StudyError(SsmPlannerError):
    """The engine that evaluates the candidates is lost."""


StudyProgress = Callable[[int, int, dict[str, int]], None]
"""Called with the number of finished candidates, the total, and the number in each state."""


@dataclass(frozen=True)
class StudyResult(ShortRepr):
    """Results of a study and their folder."""

    study: Study
    rows: tuple[Candidate, ...]
    folder: Path
    finished: bool
    """False after an interruption."""
    own: Candidate
    """The study's own robot without changes."""

    @property
    def states(self) -> dict[str, int]:
        """Return the number of candidates in each state."""
        return _states(self.rows)

    @property
    def reasons(self) -> dict[str, int]:
        """Return the number of rejected candidates by stage, in decreasing order."""
        stages = [
            row.stage or row.state for row in self.rows if row.state not in ("done", "waiting")
        ]
        return dict(
            sorted(
                ((stage, stages.count(stage)) for stage in set(stages)),
                key=lambda item: (-item[1], item[0]),
            )
        )

    @property
    def better(self) -> tuple[Candidate, ...]:
        """Return the candidates that beat the study's own robot in one objective, and lose in none.

        Returns an empty tuple if that robot lacks an objective or violates a requirement.
        """
        return better(self.own, self.front, self.study.minimise)

    @property
    def front(self) -> tuple[Candidate, ...]:
        """Return the candidates that no other dominates, in the order of the first objective."""
        return pareto(self.rows, self.study.minimise)


@checked
def study(
    of: Study | str | Path,
    folder: str | Path,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: StudyProgress = lambda done, count, states: None,
) -> StudyResult:
    """Evaluate the remaining candidates of a study; write store, table and page into `folder`.

    of: a study, its file, or the name of a shipped one. workers: number of processes, by default
    one per processor. executor: any `concurrent.futures.Executor`, such as Dask's, instead of
    processes; it is not shut down. progress: called after each result. Ctrl-C ends the run, and the
    same call continues it. Raises ProblemError, ExportError, or StudyError if the executor loses
    its workers.
    """
    of = of if isinstance(of, Study) else load_study(of)
    folder = Path(folder)
    count = workers or os.cpu_count() or 1
    with ExitStack() as stack:
        store = stack.enter_context(Store(folder / STORE))
        pool = executor or stack.enter_context(_killed_on_exit(Workers(count)))
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


@contextmanager
def _killed_on_exit(workers: Workers) -> Iterator[Workers]:
    """Provide workers and kill them when the block ends."""
    try:
        yield workers
    finally:
        workers.shutdown(cancel_futures=True)


class _Driver:
    """Screens candidates, sends them to the workers and writes the store."""

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
        self._pending: dict[Future[tuple[list[Candidate], float]], Sequence[Asked]] = {}
        self._batch_seconds, self._batch_candidates = (
            BATCH_SECONDS,
            1.0,
        )  # decaying sums over the latest batches
        self._finished: list[tuple[str, Candidate]] = []
        self._last_write = time.monotonic()
        self._next_page = self._last_write + PAGE_EVERY
        self._states: dict[str, int] = {}
        self._earlier: dict[str, tuple[int, str]] = {}
        self._evaluation = pickle.dumps(
            Evaluation(study)
        )  # pickled once, so that engines treat it as bytes

    def run(self) -> None:
        """Evaluate all candidates, the study's own robot first."""
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
        for chunk in _chunks(designs, SCREENED_TOGETHER):
            self._process(chunk, len(self.keys), len(designs), collect=False)
        self._drain()
        self.flush()

    def flush(self) -> None:
        """Write finished candidates into the store, and the page if it is due."""
        if self._finished:
            self._store.put(self._finished)
            self._finished = []
        self._last_write = time.monotonic()
        if self._last_write > self._next_page:
            self._write_page()

    def _write_page(self) -> None:
        """Write the page of the running study; pages take at most 2 % of the time."""
        rows = self._store.rows([self.own, *self.keys])
        page = self._store.path.with_name(PAGE)
        write_study_page(
            self._study, rows, pareto(rows, self._study.minimise), page, finished=False
        )
        now = time.monotonic()
        self._next_page = now + max(PAGE_EVERY, 50 * (now - self._last_write))

    def _process(
        self, designs: Sequence[Design], first_number: int, total: int, collect: bool = True
    ) -> list[Candidate]:
        """Screen candidates and send the others to the workers.

        first: number of the first candidate. total: number of candidates of the study. collect:
        wait for the results and return the rows; otherwise the list is empty.
        """
        keys = [key_of(design, self._context) for design in designs]
        self._total = total
        self.keys += keys
        waiting: list[Asked] = []
        new: list[tuple[int, str, Design]] = []
        for number, (key, design) in enumerate(zip(keys, designs, strict=True), first_number):
            earlier, state = self._earlier.get(key, (None, "waiting"))
            if earlier != number:
                new.append((number, key, design))
            if state == "waiting":
                waiting.append((key, number, design))
            else:
                self._count(state)
        self._store.add(new)
        batch: list[Asked] = []
        for candidate_design, rejection in zip(
            waiting, self._screens.reject([design for _, _, design in waiting]), strict=True
        ):
            key, number, design = candidate_design
            if rejection is not None:
                self._record(
                    key, Candidate(number, "infeasible", design, rejection.stage, rejection.reason)
                )
                continue
            batch.append(candidate_design)
            if len(batch) >= min(
                BATCH_SECONDS * self._batch_candidates / self._batch_seconds, LARGEST_BATCH
            ):
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

    def _submit(self, batch: Sequence[Asked]) -> None:
        """Send a batch to the next free worker."""
        future = self._pool.submit(
            evaluate_batch, self._evaluation, [(number, design) for _, number, design in batch]
        )
        self._pending[future] = batch

    def _drain(self) -> None:
        """Wait for all answers."""
        while self._pending:
            self._collect()

    def _collect(self) -> None:
        """Wait for at least one answer. Raises StudyError if the engine has lost one."""
        lost: BaseException | None = None
        for future in wait(self._pending, timeout=COMMIT_EVERY, return_when=FIRST_COMPLETED).done:
            batch = self._pending.pop(future)
            try:
                rows, seconds = future.result()
            except (CancelledError, Exception) as error:  # noqa: BLE001 the engine's
                if (
                    not isinstance(error, WorkerDied) and type(error).__name__ != "KilledWorker"
                ):  # Dask's WorkerDied
                    lost = error
                elif len(batch) > 1:
                    for design in batch:  # each alone, to find the one that ends its worker
                        self._submit([design])
                else:
                    reason = "ended its worker process each time it was tried"
                    self._record(batch[0][0], Candidate(-1, "quarantined", {}, None, reason))
                continue
            self._batch_seconds = 0.8 * self._batch_seconds + seconds
            self._batch_candidates = 0.8 * self._batch_candidates + len(batch)
            for (key, _, _), row in zip(batch, rows, strict=True):
                self._record(key, row)
        if lost is not None or time.monotonic() - self._last_write > COMMIT_EVERY:
            self.flush()
        if lost is not None:
            reason = f"the workers are lost ({type(lost).__name__})"
            raise StudyError(f"{reason}; what is done is kept, the same command goes on") from lost

    def _record(self, key: str, row: Candidate) -> None:
        """Record a row for the next write and count its state."""
        self._finished.append((key, row))
        if key != self.own:
            self._count(row.state)
        if len(self._finished) >= SCREENED_TOGETHER:
            self.flush()

    def _count(self, state: str) -> None:
        """Count a state and report the progress."""
        self._states[state] = self._states.get(state, 0) + 1
        self._progress(sum(self._states.values()), self._total, self._states)


def context_of(study: Study) -> str:
    """Return the hash of everything that determines a result besides the design.

    These are the robot, the motions, the catalogues, the requirements and the version.
    """
    contents: dict[str, Any] = {v.path: v.contents for v in study.vary if isinstance(v, Choice)}
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
    return hashlib.sha256(
        json.dumps(dependencies, sort_keys=True, default=str).encode()
    ).hexdigest()


def _states(rows: Sequence[Candidate]) -> dict[str, int]:
    """Return the number of rows in each state."""
    names = sorted({row.state for row in rows})
    return {name: sum(row.state == name for row in rows) for name in names}


def _chunks(designs: list[Design], size: int) -> Iterator[list[Design]]:
    """Generate parts of the list with `size` designs."""
    for start in itertools.count(0, size):
        if start >= len(designs):
            return
        yield designs[start : start + size]

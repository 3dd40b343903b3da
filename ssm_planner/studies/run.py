"""A study from candidates to results: screened in closed form, planned, checked and sized by workers, kept in a store."""

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

from ssm_planner.errors import SsmPlannerError
from ssm_planner.studies.evaluation import Evaluation, evaluated
from ssm_planner.studies.figures import write_study_figures
from ssm_planner.studies.page import write_study_page
from ssm_planner.studies.screens import Screens
from ssm_planner.studies.store import Candidate, Store, better, key_of, pareto, write_table
from ssm_planner.studies.study import Choice, Design, Study
from ssm_planner.studies.study_file import load_study
from ssm_planner.studies.workers import WorkerDied, Workers

STORE, TABLE, PAGE = "study.sqlite", "table.csv", "study.html"
OWN = -1
"""Number of the study's own robot."""
SCREENED_TOGETHER = 4096
COMMIT_EVERY = 0.5
"""Seconds between writes of the store."""
PAGE_EVERY = 10.0
"""Seconds between pages while it runs, at least."""
AHEAD = 8
"""Batches given to the workers for each of them, so that none waits for the driver."""
AHEAD_ELSEWHERE = 512
"""Batches given to an executor of unknown size."""
BATCH_SECONDS, LARGEST_BATCH = 0.25, 64
"""A batch takes about so long and holds so many candidates at most: an engine's cost is one for each batch."""

Asked = tuple[str, int, Design]
"""Key, number and design of a candidate given to the workers."""


class StudyError(SsmPlannerError):
    """The engine that evaluates the candidates is lost."""


StudyProgress = Callable[[int, int, dict[str, int]], None]
"""Called with the candidates that are done, their number, and how many are in each state."""


@dataclass(frozen=True)
class StudyResult:
    """What was found, and where it is kept."""

    study: Study
    rows: tuple[Candidate, ...]
    folder: Path
    finished: bool
    """False where it was interrupted."""
    own: Candidate
    """The study's own robot, as it stands."""

    @property
    def states(self) -> dict[str, int]:
        """How many candidates are in each state."""
        return _states(self.rows)

    @property
    def reasons(self) -> dict[str, int]:
        """How many candidates fall out at each stage, the commonest first."""
        stages = [
            row.stage or row.state for row in self.rows if row.state not in ("done", "waiting")
        ]
        return dict(
            sorted(
                ((stage, stages.count(stage)) for stage in set(stages)),
                key=lambda each: (-each[1], each[0]),
            )
        )

    @property
    def better(self) -> tuple[Candidate, ...]:
        """The candidates that are better than the study's own robot in one objective and in none worse.

        None where one of its objectives is not known, or it does not do what is required.
        """
        return better(self.own, self.front, self.study.minimise)

    @property
    def front(self) -> tuple[Candidate, ...]:
        """The candidates that no other is better than in every objective, by the first objective."""
        return pareto(self.rows, self.study.minimise)


def study(
    of: Study | str | Path,
    folder: str | Path,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: StudyProgress = lambda done, count, states: None,
) -> StudyResult:
    """Look at every candidate of a study, or at those that an earlier run left; the table and the store come into `folder`.

    of: a study, its file, or a shipped one's name. workers: processes, default one for each processor. executor: any
    `concurrent.futures.Executor`, such as Dask's, in their place; it is not shut down. Ctrl-C ends it; the same call goes on.
    Raises ProblemError, ExportError, or StudyError where the executor loses its workers.
    """
    of, folder = of if isinstance(of, Study) else load_study(of), Path(folder)
    count = workers or os.cpu_count() or 1
    with ExitStack() as stack:
        store = stack.enter_context(Store(folder / STORE))
        pool = executor or stack.enter_context(_ended(Workers(count)))
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
        (own,) = store.rows([driver.own])
    result = StudyResult(of, rows, folder, finished, own)
    write_table(rows, folder / TABLE)
    write_study_page(of, (own, *rows), result.front, folder / PAGE, finished=True)
    write_study_figures(of, own, rows, result.front, folder)
    return result


@contextmanager
def _ended(workers: Workers) -> Iterator[Workers]:
    """Workers that are ended at once, whatever they do, when the block ends."""
    try:
        yield workers
    finally:
        workers.shutdown(cancel_futures=True)


class _Driver:
    """The only one that writes the store."""

    def __init__(
        self,
        study: Study,
        store: Store,
        pool: Executor,
        ahead: int,
        progress: StudyProgress,
    ) -> None:
        self._study, self._store, self._pool, self._ahead, self._progress = (
            study,
            store,
            pool,
            ahead,
            progress,
        )
        self._context, self._screens = context_of(study), Screens(study)
        self.keys: list[str] = []
        self.own = key_of({}, self._context)
        self._flying: dict[Future[tuple[list[Candidate], float]], Sequence[Asked]] = {}
        self._taken, self._answered = BATCH_SECONDS, 1.0  # seconds and candidates of late
        self._done: list[tuple[str, Candidate]] = []
        self._written = time.monotonic()
        self._next_page = self._written + PAGE_EVERY
        self._states: dict[str, int] = {}
        self._earlier: dict[str, tuple[int, str]] = {}
        self._evaluation = pickle.dumps(Evaluation(study))  # once: an engine need not look into it

    def run(self) -> None:
        """All candidates, the study's own robot first."""
        self._store.add([(OWN, self.own, {})])
        self._earlier = self._store.states()
        if self._earlier[self.own][1] == "waiting":
            self._give([(self.own, OWN, {})])
        if self._study.search.adaptive:
            from ssm_planner.studies.adaptive import batches

            for designs, tell in batches(self._study):
                tell(self._look_at(designs, len(self.keys), self._study.search.points))
            return
        designs = list(self._study.designs())
        for chunk in _chunks(designs, SCREENED_TOGETHER):
            self._look_at(chunk, len(self.keys), len(designs), collect=False)
        self._drain()
        self.flush()

    def flush(self) -> None:
        """What is done, into the store."""
        if self._done:
            self._store.put(self._done)
            self._done = []
        self._written = time.monotonic()
        if self._written > self._next_page:
            self._show()

    def _show(self) -> None:
        """The page as far as it goes; it may take two hundredths of the time."""
        rows = self._store.rows([self.own, *self.keys])
        page = self._store.path.with_name(PAGE)
        write_study_page(
            self._study, rows, pareto(rows, self._study.minimise), page, finished=False
        )
        now = time.monotonic()
        self._next_page = now + max(PAGE_EVERY, 50 * (now - self._written))

    def _look_at(
        self, designs: Sequence[Design], first: int, total: int, collect: bool = True
    ) -> list[Candidate]:
        """Screen candidates and give the rest to the workers; with collect, wait and return their rows."""
        keys = [key_of(design, self._context) for design in designs]
        self._total = total
        self.keys += keys
        todo: list[Asked] = []
        new: list[tuple[int, str, Design]] = []
        for number, (key, design) in enumerate(zip(keys, designs, strict=True), first):
            earlier, state = self._earlier.get(key, (None, "waiting"))
            if earlier != number:
                new.append((number, key, design))
            if state == "waiting":
                todo.append((key, number, design))
            else:
                self._count(state)
        self._store.add(new)
        batch: list[Asked] = []
        for asked, fallen in zip(
            todo, self._screens.fallen([design for _, _, design in todo]), strict=True
        ):
            key, number, design = asked
            if fallen is not None:
                self._keep(
                    key, Candidate(number, "infeasible", design, fallen.stage, fallen.reason)
                )
                continue
            batch.append(asked)
            if len(batch) >= min(BATCH_SECONDS * self._answered / self._taken, LARGEST_BATCH):
                while len(self._flying) >= self._ahead:
                    self._collect()
                self._give(batch)
                batch = []
        if batch:
            self._give(batch)
        if not collect:
            return []
        self._drain()
        self.flush()
        return self._store.rows(keys)

    def _give(self, batch: Sequence[Asked]) -> None:
        """To the next free worker."""
        future = self._pool.submit(
            evaluated, self._evaluation, [(number, design) for _, number, design in batch]
        )
        self._flying[future] = batch

    def _drain(self) -> None:
        while self._flying:
            self._collect()

    def _collect(self) -> None:
        """Wait for one answer at least. Raises StudyError where the engine has lost one."""
        lost: BaseException | None = None
        for future in wait(self._flying, timeout=COMMIT_EVERY, return_when=FIRST_COMPLETED).done:
            batch = self._flying.pop(future)
            try:
                rows, seconds = future.result()
            except (CancelledError, Exception) as error:  # noqa: BLE001 an evaluation raises nothing: the engine's
                if (
                    not isinstance(error, WorkerDied) and type(error).__name__ != "KilledWorker"
                ):  # Dask's WorkerDied
                    lost = error
                elif len(batch) > 1:
                    for (
                        asked
                    ) in batch:  # which of them ended the workers shows when each has its own
                        self._give([asked])
                else:
                    reason = "ended its worker process each time it was tried"
                    self._keep(batch[0][0], Candidate(-1, "quarantined", {}, None, reason))
                continue
            self._taken, self._answered = (
                0.8 * self._taken + seconds,
                0.8 * self._answered + len(batch),
            )
            for (key, _, _), row in zip(batch, rows, strict=True):
                self._keep(key, row)
        if lost is not None or time.monotonic() - self._written > COMMIT_EVERY:
            self.flush()
        if lost is not None:
            reason = f"the workers are lost ({type(lost).__name__})"
            raise StudyError(f"{reason}; what is done is kept, the same command goes on") from lost

    def _keep(self, key: str, row: Candidate) -> None:
        self._done.append((key, row))
        if key != self.own:
            self._count(row.state)
        if len(self._done) >= SCREENED_TOGETHER:
            self.flush()

    def _count(self, state: str) -> None:
        self._states[state] = self._states.get(state, 0) + 1
        self._progress(sum(self._states.values()), self._total, self._states)


def context_of(study: Study) -> str:
    """What a result depends on besides the design: robot, motions, catalogues, what is required, and the version."""
    contents: dict[str, Any] = {v.path: v.contents for v in study.vary if isinstance(v, Choice)}
    contents |= {v.path: [v.select, v.contents, v.beside] for v in study.selected}
    what: Mapping[str, Any] = {
        "robot": study.robot,
        "motions": study.motions,
        "contents": contents,
        "require": {
            name: getattr(study.require, name) for name in study.require.__dataclass_fields__
        },
        "version": version("ssm_planner"),
    }
    return hashlib.sha256(json.dumps(what, sort_keys=True, default=str).encode()).hexdigest()


def _states(rows: Sequence[Candidate]) -> dict[str, int]:
    names = sorted({row.state for row in rows})
    return {name: sum(row.state == name for row in rows) for name in names}


def _chunks(designs: list[Design], size: int) -> Iterator[list[Design]]:
    for start in itertools.count(0, size):
        if start >= len(designs):
            return
        yield designs[start : start + size]

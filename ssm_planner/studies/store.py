"""Store the candidates of a study in SQLite, one row each.

Only the driver writes; others may read at any time.

The key of a row is a hash of the resolved design, the motions and the version of this program. The
store contains figures; plans are computed again on request.
"""

from __future__ import annotations

import csv
import hashlib
import json
import sqlite3
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

from ssm_planner.atomic import locked, replacing
from ssm_planner.errors import ExportError, ProblemError
from ssm_planner.representation import ShortRepr

State = Literal["waiting", "done", "infeasible", "failed", "quarantined"]
"""State of a candidate.

done: planned, checked and sized. infeasible: rejected for a named reason. failed: a fault of this
program. quarantined: ended its worker process at every attempt.
"""
FORMAT = 1
LOCK_WAIT = 0.5
"""Time for which an open store may be locked by another process, s."""
_TABLES = f"""
CREATE TABLE IF NOT EXISTS candidates (
    key TEXT PRIMARY KEY, number INTEGER NOT NULL, state TEXT NOT NULL, stage TEXT, reason TEXT,
    design TEXT NOT NULL, figures TEXT
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS by_number ON candidates (number);
PRAGMA user_version = {FORMAT};
"""


@dataclass(frozen=True)
class Candidate(ShortRepr):
    """One candidate. design: its choices by path; figures: its results by name, SI."""

    number: int
    state: State
    design: Mapping[str, Any]
    stage: str | None = None
    """Stage that rejected an infeasible candidate."""
    reason: str | None = None
    figures: Mapping[str, Any] = field(default_factory=dict)


def key_of(design: Mapping[str, Any], context: str) -> str:
    """Return the key of a design.

    context: text that identifies the robot, the motions, the requirements and the version.
    """
    return hashlib.sha256(f"{context}\n{_text(design)}".encode()).hexdigest()[:32]


class Store(AbstractContextManager["Store"]):
    """Candidates by key.

    Raises ProblemError for another kind of file, or if another driver writes the store.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        lock = path.with_suffix(
            ".lock"
        )  # a separate file: SQLite loses its lock when another handle of its file closes
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            lock.touch()
        except OSError as error:
            raise ExportError(f"{path}: cannot be written: {error.strerror or error}") from error
        # A worker that a killed driver was starting keeps the lock for a moment.
        deadline = time.monotonic() + LOCK_WAIT
        while True:
            self._lock = locked(lock, wait=False)
            try:
                self._lock.__enter__()
                break
            except OSError as error:
                if time.monotonic() > deadline:
                    raise ProblemError(
                        "another program works on this study", file=path, allowed="one at a time"
                    ) from error
                time.sleep(0.02)
        try:
            self._open()
        except BaseException:
            self._lock.__exit__(None, None, None)
            raise

    def _open(self) -> None:
        """Open the database and create its tables. Raises ProblemError or ExportError."""
        with self._faults():
            self._connection = sqlite3.connect(self.path, isolation_level=None)
            (version,) = self._connection.execute("PRAGMA user_version").fetchone()
            if version not in (0, FORMAT):
                raise ProblemError(
                    f"a store of format {version}", file=self.path, allowed=f"format {FORMAT}"
                )
            self._connection.execute("PRAGMA journal_mode = WAL")
            self._connection.execute(
                "PRAGMA synchronous = NORMAL"
            )  # a power cut loses the last rows only
            self._connection.executescript(_TABLES)

    def add(self, designs: Iterable[tuple[int, str, Mapping[str, Any]]]) -> None:
        """Add candidates (number, key, design) as waiting; update the number of existing ones."""
        rows = ((key, number, _text(design)) for number, key, design in designs)
        self._write(
            "INSERT INTO candidates (key, number, state, design) VALUES (?, ?, 'waiting', ?) "
            "ON CONFLICT (key) DO UPDATE SET number = excluded.number",
            rows,
        )

    def put(self, rows: Iterable[tuple[str, Candidate]]) -> None:
        """Write results by key."""
        self._write(
            "UPDATE candidates SET state = ?, stage = ?, reason = ?, figures = ? WHERE key = ?",
            ((row.state, row.stage, row.reason, _text(row.figures), key) for key, row in rows),
        )

    def states(self) -> dict[str, tuple[int, str]]:
        """Return (number, state) by key."""
        return {
            key: (number, state)
            for key, number, state in self._read("SELECT key, number, state FROM candidates")
        }

    def rows(self, keys: Iterable[str] | None = None) -> list[Candidate]:
        """Return all candidates in the order of their numbers, or those of `keys` in order."""
        candidates = {
            key: Candidate(
                number,
                state,
                json.loads(design),
                stage,
                reason,
                figures=json.loads(results or "{}"),
            )
            for key, number, state, stage, reason, design, results in self._read(
                "SELECT key, number, state, stage, reason, design, figures FROM candidates ORDER "
                "BY number, key"
            )
        }
        if keys is None:
            return list(candidates.values())
        return [candidates[key] for key in keys if key in candidates]

    def _read(self, statement: str) -> list[tuple[Any, ...]]:
        with self._faults():
            return self._connection.execute(statement).fetchall()

    def _write(self, statement: str, rows: Iterable[tuple[Any, ...]]) -> None:
        """Execute a statement for all rows in one transaction."""
        with self._faults():
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                self._connection.executemany(statement, rows)
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise

    @contextmanager
    def _faults(self) -> Iterator[None]:
        """Convert errors of SQLite: ExportError for the disk, ProblemError for a damaged file."""
        try:
            yield
        except sqlite3.OperationalError as error:
            raise ExportError(f"{self.path}: cannot be written: {error}") from error
        except sqlite3.DatabaseError as error:
            raise ProblemError(f"not a store of a study: {error}", file=self.path) from error

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._connection.close()
        self._lock.__exit__(None, None, None)


_text = json.JSONEncoder(sort_keys=True, ensure_ascii=False, separators=(",", ":")).encode
"""Encode as JSON; equal values give equal text."""


def columns(rows: Sequence[Candidate]) -> dict[str, list[Any]]:
    """Return the rows as columns of one table, by name.

    The columns are the attributes of the rows, their choices and their figures; missing values are
    None.
    """
    attributes = ("number", "state", "stage", "reason")
    table: dict[str, list[Any]] = {
        name: [getattr(row, name) for row in rows] for name in attributes
    }
    for mapping in ("design", "figures"):
        names = sorted({name for row in rows for name in getattr(row, mapping)})
        table |= {name: [getattr(row, mapping).get(name) for row in rows] for name in names}
    return table


def write_table(rows: Sequence[Candidate], path: Path) -> None:
    """Write the rows as CSV, or as Parquet if the name ends so.

    Raises ExportError if pyarrow is missing.
    """
    table = columns(rows)
    with replacing(path) as temporary:
        if path.suffix != ".parquet":
            with temporary.open("w", newline="", encoding="utf-8") as stream:
                writer = csv.writer(stream, lineterminator="\n")
                writer.writerow(table)
                writer.writerows(zip(*table.values(), strict=True))
            return
        try:
            import pyarrow
            from pyarrow import parquet
        except ImportError:
            raise ExportError(
                f"{path}: Parquet needs the package pyarrow, which is not installed"
            ) from None
        parquet.write_table(pyarrow.table(table), temporary)


def pareto(rows: Sequence[Candidate], objectives: Sequence[str]) -> tuple[Candidate, ...]:
    """Return the done rows that no other dominates.

    Rows without one of the objectives do not count.
    """
    signs = [-1.0 if name.endswith("margin") else 1.0 for name in objectives]
    points = [
        (tuple(sign * row.figures[name] for sign, name in zip(signs, objectives, strict=True)), row)
        for row in rows
        if row.state == "done" and all(row.figures.get(name) is not None for name in objectives)
    ]
    points.sort(key=lambda point: (point[0], point[1].number))
    front: list[tuple[tuple[float, ...], Candidate]] = []
    for values, row in points:
        if not any(
            all(a <= b for a, b in zip(values_of_other, values, strict=True))
            for values_of_other, _ in front
        ):
            front.append((values, row))
    return tuple(row for _, row in front)


def better(
    reference: Candidate, front: Sequence[Candidate], objectives: Sequence[str]
) -> tuple[Candidate, ...]:
    """Return the rows of a front that dominate `reference`.

    Returns an empty tuple if `reference` is not done or lacks an objective.
    """
    if not pareto((reference,), objectives):
        return ()
    return tuple(row for row in front if pareto((reference, row), objectives) == (row,))

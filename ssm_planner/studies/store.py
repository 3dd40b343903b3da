"""The store of a study: SQLite, a row for each candidate, written by the driver alone, readable by anyone meanwhile.

A row is known by the key of what it is a result of: the resolved design, the motions and this program's version. Figures
are kept; plans are made again when they are asked for.
"""

from __future__ import annotations

import csv
import hashlib
import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

from ssm_planner.atomic import locked, replacing
from ssm_planner.errors import ExportError, ProblemError

State = Literal["waiting", "done", "infeasible", "failed", "quarantined"]
"""done: planned, checked and sized; infeasible: falls out for a named reason; failed: a fault of this program;
quarantined: ended its worker process as often as it was tried."""
FORMAT = 1
_TABLES = f"""
CREATE TABLE IF NOT EXISTS candidates (
    key TEXT PRIMARY KEY, number INTEGER NOT NULL, state TEXT NOT NULL, stage TEXT, reason TEXT,
    design TEXT NOT NULL, figures TEXT
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS by_number ON candidates (number);
PRAGMA user_version = {FORMAT};
"""


@dataclass(frozen=True)
class Candidate:
    """One candidate. design: what was chosen, by path; figures: what was found, SI, by name."""

    number: int
    state: State
    design: Mapping[str, Any]
    stage: str | None = None
    """Where an infeasible one fell out."""
    reason: str | None = None
    figures: Mapping[str, Any] = field(default_factory=dict)


def key_of(design: Mapping[str, Any], context: str) -> str:
    """Of a design within a context: a text that stands for the robot, the motions, what is required and the version."""
    return hashlib.sha256(f"{context}\n{_text(design)}".encode()).hexdigest()[:32]


class Store(AbstractContextManager["Store"]):
    """Candidates by key. Raises ProblemError for a file that is no store or that another driver writes."""

    def __init__(self, path: Path) -> None:
        self.path = path
        lock = path.with_suffix(
            ".lock"
        )  # a file of its own: SQLite's locks fall when another handle of its file is closed
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            lock.touch()
        except OSError as error:
            raise ExportError(f"{path}: cannot be written: {error.strerror or error}") from error
        self._lock = locked(lock, wait=False)
        try:
            self._lock.__enter__()
        except OSError as error:
            raise ProblemError(
                "another program works on this study", file=path, allowed="one at a time"
            ) from error
        try:
            self._open()
        except BaseException:
            self._lock.__exit__(None, None, None)
            raise

    def _open(self) -> None:
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
            )  # a power cut loses the last rows, never the store
            self._connection.executescript(_TABLES)

    def add(self, designs: Iterable[tuple[int, str, Mapping[str, Any]]]) -> None:
        """Candidates (number, key, design) as waiting; of those that are there already only the number is renewed."""
        rows = ((key, number, _text(design)) for number, key, design in designs)
        self._write(
            "INSERT INTO candidates (key, number, state, design) VALUES (?, ?, 'waiting', ?) "
            "ON CONFLICT (key) DO UPDATE SET number = excluded.number",
            rows,
        )

    def put(self, rows: Iterable[tuple[str, Candidate]]) -> None:
        """Results by key."""
        self._write(
            "UPDATE candidates SET state = ?, stage = ?, reason = ?, figures = ? WHERE key = ?",
            ((row.state, row.stage, row.reason, _text(row.figures), key) for key, row in rows),
        )

    def states(self) -> dict[str, tuple[int, str]]:
        """Numbers and states by key."""
        return {
            key: (number, state)
            for key, number, state in self._read("SELECT key, number, state FROM candidates")
        }

    def rows(self, keys: Iterable[str] | None = None) -> list[Candidate]:
        """All candidates in the order of their numbers, or those of the keys in theirs."""
        found = {
            key: Candidate(
                number,
                state,
                json.loads(design),
                stage,
                reason,
                figures=json.loads(figures or "{}"),
            )
            for key, number, state, stage, reason, design, figures in self._read(
                "SELECT key, number, state, stage, reason, design, figures FROM candidates ORDER BY number, key"
            )
        }
        return (
            list(found.values()) if keys is None else [found[key] for key in keys if key in found]
        )

    def _read(self, statement: str) -> list[tuple[Any, ...]]:
        with self._faults():
            return self._connection.execute(statement).fetchall()

    def _write(self, statement: str, rows: Iterable[tuple[Any, ...]]) -> None:
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
"""JSON that is the same for the same value."""


def columns(rows: Sequence[Candidate]) -> dict[str, list[Any]]:
    """The rows as columns of one table, by name: each row's own, choices and figures; None where there is none."""
    own = ("number", "state", "stage", "reason")
    table: dict[str, list[Any]] = {name: [getattr(row, name) for row in rows] for name in own}
    for part in ("design", "figures"):
        names = sorted({name for row in rows for name in getattr(row, part)})
        table |= {name: [getattr(row, part).get(name) for row in rows] for name in names}
    return table


def write_table(rows: Sequence[Candidate], path: Path) -> None:
    """The rows as CSV, or as Parquet where the name ends so. Raises ExportError where pyarrow is missing."""
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
    """The done rows that no other dominates; rows without one of the figures are left out."""
    signs = [-1.0 if name.endswith("margin") else 1.0 for name in objectives]
    points = [
        (tuple(sign * row.figures[name] for sign, name in zip(signs, objectives, strict=True)), row)
        for row in rows
        if row.state == "done" and all(row.figures.get(name) is not None for name in objectives)
    ]
    points.sort(key=lambda each: (each[0], each[1].number))
    front: list[tuple[tuple[float, ...], Candidate]] = []
    for values, row in points:
        if not any(all(a <= b for a, b in zip(other, values, strict=True)) for other, _ in front):
            front.append((values, row))
    return tuple(row for _, row in front)


def better(
    own: Candidate, front: Sequence[Candidate], objectives: Sequence[str]
) -> tuple[Candidate, ...]:
    """Of a front the rows that are better than `own` in one objective and in none worse.

    None where `own` is not done or one of its objectives is not known.
    """
    if not pareto((own,), objectives):
        return ()
    return tuple(row for row in front if pareto((own, row), objectives) == (row,))

"""Store the candidates of a study in an SQLite database, with one row for each candidate.

Only one process writes the database, and others may read it at any time. The key of a row is a hash
of the design, the inputs of the study and the program. Each row contains a hash of its content, so
that changes are noticed. The database contains results but no plans, which are computed again on
request. Rows of earlier studies and programs remain in the database without a number.
"""

import csv
import hashlib
import json
import math
import operator
import sqlite3
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import field
from itertools import starmap
from pathlib import Path
from typing import Any, Literal, get_args

from ssm_planner.atomic import locked, replacing
from ssm_planner.errors import ExportError, ProblemError
from ssm_planner.typing import Fields, JsonObject, frozen

State = Literal["waiting", "done", "infeasible", "failed", "quarantined"]
"""State of a candidate.

- "waiting": the candidate has not been evaluated yet.
- "done": its motions are planned and checked, and its motors are sized.
- "infeasible": it was rejected for a reason.
- "failed": a fault of this program prevented its evaluation.
- "quarantined": it ended its worker process at every attempt.
"""
STORE_VERSION = 2
"""Version of the layout of the database."""
LOCK_TIMEOUT = 0.5
"""Longest time to wait for another process that holds the lock of a store, s."""
OUTPUT_PREFIXES = ("study.", "table.", "front.", "map.", "candidate_")
"""Beginnings of the names of all files and folders that a study writes."""
_TABLES = f"""
CREATE TABLE IF NOT EXISTS candidates (
    key TEXT PRIMARY KEY, state TEXT NOT NULL, stage TEXT, reason TEXT, design TEXT NOT NULL,
    figures TEXT NOT NULL, sha256 TEXT NOT NULL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS numbers (number INTEGER PRIMARY KEY, key TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS study (
    id INTEGER PRIMARY KEY, description TEXT NOT NULL, sha256 TEXT NOT NULL
);
PRAGMA user_version = {STORE_VERSION};
"""
"""SQL that creates the tables.

`candidates` contains the results by key, `numbers` the key of each candidate of the latest study,
and `study` the description of this study.
"""


@frozen
class Candidate:
    """A candidate and its results.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Candidate(3, "infeasible", {"geometry.alpha": "30 deg"}, stage="reach").rejection
    'reach'
    """

    number: int
    """Number of the candidate in the search. The original robot has the number −1."""
    state: State
    design: Fields
    """Values of the variables by path."""
    stage: str | None = None
    """Stage that rejected an infeasible candidate, such as "reach" or "plan"."""
    reason: str | None = None
    """Reason of the rejection or fault, in words."""
    figures: Fields = field(default_factory=dict)
    """Numerical results in SI units and names of selected parts, by name of the result."""

    @property
    def rejection(self) -> str | None:
        """Stage that rejected the candidate, or its state if it failed in another way.

        None for the states "done" and "waiting".
        """
        return None if self.state in ("done", "waiting") else self.stage or self.state

    def costs(self, objectives: Sequence[str]) -> list[float] | None:
        """Return the values of objectives with the sign that makes all of them costs to minimise.

        Parameters
        ----------
        objectives : sequence of str
            Names of results.

        Returns
        -------
        list of float or None
            Cost of each objective. A margin is multiplied by −1, because it is maximised. None if
            the candidate is not done or lacks an objective.
        """
        if self.state != "done":
            return None
        costs: list[float] = []
        for name in objectives:
            value: Any = self.figures.get(name)
            if value is None:
                return None
            costs.append(-value if name.endswith("margin") else value)
        return costs


Candidates = Sequence[Candidate]
"""Results of several candidates."""


def candidate_key(design: Fields, context: str) -> str:
    """Return the key that identifies a candidate in the store.

    Candidates with the same values, inputs and program have the same key, so a stored result can be
    used again.

    Parameters
    ----------
    design : mapping
        Values that distinguish the candidate from the original robot, by path.
    context : str
        Hash of the inputs of the study and of the program, from `provenance.context_hash`.

    Returns
    -------
    str
        First 32 digits of a SHA-256 in hexadecimal.
    """
    return hash_contents(context, _to_json(design))[:32]


def hash_contents(*contents: object) -> str:
    """Return the SHA-256 of texts and missing texts (None) in hexadecimal."""
    return hashlib.sha256(repr(contents).encode()).hexdigest()


class Store(AbstractContextManager["Store"]):
    """Database that contains the candidates of a study by key. It is used as a context manager.

    Parameters
    ----------
    path : Path
        File of the database, which is created if it does not exist.

    Raises
    ------
    ProblemError
        If the file is not such a database, or if another process writes it.
    ExportError
        If the file cannot be written, or if a file of the study is a symbolic link.
    """

    def __init__(self, path: Path) -> None:
        """Lock and open the database, and create it if necessary.

        Parameters
        ----------
        path : Path
            File of the database. The lock is a file with the extension .lock next to it.
        """
        self.path = path
        self._context: str | None = None
        # SQLite loses a lock if another handle of its file closes, so the lock has its own file.
        lock = path.with_suffix(".lock")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            prefixes = OUTPUT_PREFIXES + (f"{path.stem}.",)
            for entry in path.parent.iterdir():
                if entry.name.startswith(prefixes):
                    check_not_link(entry)
            lock.touch()
        except OSError as error:
            raise ExportError(f"{path}: cannot be written: {error.strerror or error}") from error
        # If a driver is killed while it starts a worker, the worker keeps the lock for a moment.
        deadline = time.monotonic() + LOCK_TIMEOUT
        while True:
            self._lock = locked(lock, wait=False)
            try:
                self._lock.__enter__()
                break
            except OSError as error:
                if time.monotonic() > deadline:
                    raise ProblemError(
                        "another program writes this study",
                        file=path,
                        allowed="one program at a time",
                    ) from error
                time.sleep(0.02)
        try:
            self._open_database()
        except BaseException:
            self._lock.__exit__(None, None, None)
            raise

    def _open_database(self) -> None:
        """Open the database and create its tables.

        Raises
        ------
        ProblemError
            If the file has another format.
        ExportError
            If the file cannot be written.
        """
        with self._converting_errors():
            self._connection = sqlite3.connect(self.path, isolation_level=None)
            (version,) = self._connection.execute("PRAGMA user_version").fetchone()
            if version not in (0, STORE_VERSION):
                raise ProblemError(
                    f"another version of the program wrote this store (format {version})",
                    file=self.path,
                    allowed=f"format {STORE_VERSION}; choose another folder, or remove this file",
                )
            # A damaged text must not raise an error here, because its wrong hash is reported later.
            self._connection.text_factory = lambda text: text.decode(errors="replace")
            self._connection.create_function("hash_contents", -1, hash_contents)
            self._connection.execute("PRAGMA journal_mode = WAL")
            # A power cut loses only the latest rows.
            self._connection.execute("PRAGMA synchronous = NORMAL")
            self._connection.executescript(_TABLES)

    def set_description(self, description: JsonObject, context: str) -> JsonObject:
        """Store the description of the current study, and return that of the previous study.

        If the descriptions differ, the rows of the previous study lose their numbers.

        Parameters
        ----------
        description : dict
            Description of the study and the program as JSON types.
        context : str
            Hash of the inputs and the program, with which `entries` verifies the keys of the rows.

        Returns
        -------
        dict
            Description of the previous study. Empty for a new database.
        """
        previous = self.description()
        self._context = context
        text = json.dumps(description)
        if json.dumps(previous) != text:
            self._execute_many("DELETE FROM numbers", [()])
            statement = "INSERT OR REPLACE INTO study VALUES (0, ?1, hash_contents(?1))"
            self._execute_many(statement, [(text,)])
        return previous

    def description(self) -> JsonObject:
        """Return the description of the latest study, which is empty in a new database.

        Raises ProblemError if the description was changed.
        """
        for text, sha256 in self._query("SELECT description, sha256 FROM study"):
            with suppress(ValueError, RecursionError):
                description = json.loads(text)
                if sha256 == hash_contents(text) and isinstance(description, dict):
                    return description
            raise ProblemError("the description of the study was changed", file=self.path)
        return {}

    def add_candidates(self, designs: Iterable[tuple[int, str, Fields]]) -> None:
        """Add candidates with the state "waiting".

        A candidate that already exists keeps its result and gets the new number.

        Parameters
        ----------
        designs : iterable of (int, str, Design)
            Number, key and design of each candidate.
        """
        rows = [(number, key, _to_json(design)) for number, key, design in designs]
        self._execute_many(
            "INSERT OR IGNORE INTO candidates VALUES (?1, 'waiting', NULL, NULL, ?2, '{}', "
            "hash_contents(?1, 'waiting', NULL, NULL, ?2, '{}'))",
            [row[1:] for row in rows],
        )
        self._execute_many(
            "INSERT OR REPLACE INTO numbers VALUES (?, ?)", [row[:2] for row in rows]
        )

    def write_results(self, rows: Iterable[tuple[str, Candidate]]) -> None:
        """Write the results of candidates.

        Parameters
        ----------
        rows : iterable of (str, Candidate)
            Key and result of each candidate.
        """
        self._execute_many(
            "UPDATE candidates SET state = ?1, stage = ?2, reason = ?3, figures = ?4, "
            "sha256 = hash_contents(key, ?1, ?2, ?3, design, ?4) WHERE key = ?5",
            ((row.state, row.stage, row.reason, _to_json(row.figures), key) for key, row in rows),
        )

    def states(self) -> dict[str, tuple[int | None, str]]:
        """Return the number and the state of every candidate by key.

        Rows of earlier studies have the number None.
        """
        rows = self._query(
            "SELECT key, number, CAST(state AS TEXT) FROM candidates LEFT JOIN numbers USING (key)"
        )
        return {key: (number, state) for key, number, state in rows}

    def rows(self, keys: Iterable[str] | None = None) -> list[Candidate]:
        """Return candidates with their results.

        Parameters
        ----------
        keys : iterable of str, optional
            Keys of the candidates. The default is all candidates of the latest study by number.

        Returns
        -------
        list of Candidate
            Candidates in the order of the keys. Unknown keys are left out.

        Raises
        ------
        ProblemError
            If a row was changed after the study had written it.
        """
        candidates = []
        for key, number, row in self.entries():
            if row is None:
                raise ProblemError(
                    f"the row of candidate {number} was changed after the study had written it",
                    file=self.path,
                    allowed="rows of the study; `study audit` lists all that were changed",
                )
            candidates.append((key, row))
        if keys is None:
            return [row for _, row in candidates]
        by_key = dict(candidates)
        return [by_key[key] for key in keys if key in by_key]

    def entries(self) -> Iterator[tuple[str, int, Candidate | None]]:
        """Yield the candidates of the latest study in the order of their numbers.

        Yields
        ------
        key : str
            Key of the row.
        number : int
            Number of the candidate.
        row : Candidate or None
            The candidate, or None if the row was changed after the study had written it.
        """
        for number, key, *contents, sha256 in self._query(
            "SELECT number, key, CAST(state AS TEXT), CAST(stage AS TEXT), CAST(reason AS TEXT), "
            "CAST(design AS TEXT), CAST(figures AS TEXT), sha256 FROM numbers "
            "LEFT JOIN candidates USING (key) ORDER BY number"
        ):
            intact = sha256 == hash_contents(key, *contents)
            if self._context is not None:
                intact = intact and key == hash_contents(self._context, contents[3])[:32]
            yield key, number, _candidate_from_row(number, *contents) if intact else None

    def _query(self, statement: str) -> list[tuple[Any, ...]]:
        """Execute a query, and return all rows of its result."""
        with self._converting_errors():
            return self._connection.execute(statement).fetchall()

    def _execute_many(self, statement: str, rows: Iterable[tuple[Any, ...]]) -> None:
        """Execute a statement once for each row of parameters, in one transaction.

        If one execution fails, none of them has an effect.

        Parameters
        ----------
        statement : str
            SQL statement with placeholders.
        rows : iterable of tuple
            Values of the placeholders for each execution.
        """
        with self._converting_errors():
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                self._connection.executemany(statement, rows)
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise

    @contextmanager
    def _converting_errors(self) -> Iterator[None]:
        """Convert the errors of SQLite that the body of a `with` statement raises.

        Raises
        ------
        ExportError
            If the disk or the permissions prevent an operation.
        ProblemError
            If the file is damaged or is not a database.
        """
        try:
            yield
        except sqlite3.OperationalError as error:
            raise ExportError(f"{self.path}: cannot be written: {error}") from error
        except sqlite3.DatabaseError as error:
            raise ProblemError(f"not a store of a study: {error}", file=self.path) from error

    def __exit__(self, *error: object) -> None:
        """Close the database and release its lock."""
        self._connection.close()
        self._lock.__exit__(None, None, None)


_to_json = json.JSONEncoder(sort_keys=True, ensure_ascii=False, separators=(",", ":")).encode
"""Encode a value as JSON. Equal values give equal texts, so that their hashes are equal."""


def _candidate_from_row(number: int, state: Any, *contents: Any) -> Candidate | None:
    """Return the candidate of a row, or None if no study writes such a row.

    Parameters
    ----------
    number : int
        Number of the candidate.
    state : str
        State of the candidate.
    *contents
        Stage that rejected the candidate, reason, design as JSON, and figures (results) as JSON.

    Returns
    -------
    Candidate or None
        None if the state is unknown, a text is not JSON, or a figure cannot be a result.
    """
    stage, reason, design, figures = contents
    try:
        results = json.loads(figures, parse_constant=lambda _: None)  # NaN is unknown
        row = Candidate(number, state, dict(json.loads(design)), stage, reason, figures=results)
        is_valid = state in get_args(State) and all(starmap(_is_result, row.figures.items()))
        return row if is_valid else None
    except (ArithmeticError, AttributeError, RecursionError, TypeError, ValueError):
        return None


def _is_result(name: str, value: Any) -> bool:
    """Return True if a value can be the result of a candidate with a given name.

    The result of a name such as "joints.roll.motor" is the name of the selected motor or gear. All
    other results are finite numbers, or None if a value is unknown.
    """
    if name.startswith("joints."):
        return isinstance(value, str)
    return value is None or (not isinstance(value, str) and math.isfinite(value))


def check_not_link(path: Path) -> None:
    """Raise ExportError if a file is a symbolic link, because writing would change its target."""
    if path.is_symlink():
        raise ExportError(f"{path}: cannot be written: is a symbolic link; remove it")


def write_table(rows: Candidates, path: Path) -> None:
    """Write candidates as a table, as Parquet if the path ends with ".parquet", otherwise as CSV.

    Each row describes one candidate. The columns are its number, state, stage and reason, the
    values of its design, and its figures (numerical results in SI units). Missing values are empty.

    Parameters
    ----------
    rows : sequence of Candidate
        Candidates with their results.
    path : Path
        File that is written.

    Raises
    ------
    ExportError
        If the file cannot be written, or if Parquet is requested without the package pyarrow.
    """
    attributes = ("number", "state", "stage", "reason")
    table = {name: [getattr(row, name) for row in rows] for name in attributes}
    for mappings in ([row.design for row in rows], [row.figures for row in rows]):
        for name in sorted(set().union(*mappings)):
            table[name] = [mapping.get(name) for mapping in mappings]
    is_parquet = path.suffix == ".parquet"
    with replacing(path, "PAR1" if is_parquet else ",".join(attributes)) as temporary:
        if not is_parquet:
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


def pareto_front(rows: Candidates, objectives: Sequence[str]) -> tuple[Candidate, ...]:
    """Return the Pareto front: the candidates that no other candidate dominates.

    A candidate dominates another one if it is not worse in any objective. Among equal candidates,
    the first one remains. Margins are maximised, and all other objectives are minimised. Candidates
    that are not done or lack an objective are ignored.

    Parameters
    ----------
    rows : sequence of Candidate
        Candidates with their results.
    objectives : sequence of str
        Names of the figures that are compared.

    Returns
    -------
    tuple of Candidate
        The front, sorted by the first objective.
    """
    points: list[tuple[list[float], int, Candidate]] = []
    for row in rows:
        costs = row.costs(objectives)
        if costs is not None:
            points.append((costs, row.number, row))
    points.sort(key=lambda point: point[:2])
    front: list[tuple[list[float], Candidate]] = []
    for costs, _, row in points:
        is_dominated = (all(map(operator.le, other, costs)) for other, _ in front)
        if not any(is_dominated):
            front.append((costs, row))
    return tuple(row for _, row in front)


def dominating_candidates(
    reference: Candidate, front: Candidates, objectives: Sequence[str]
) -> tuple[Candidate, ...]:
    """Return the candidates of a front that dominate a reference candidate.

    Parameters
    ----------
    reference : Candidate
        Candidate that is compared, such as the original robot.
    front : sequence of Candidate
        Candidates of the Pareto front.
    objectives : sequence of str
        Names of the figures that are compared.

    Returns
    -------
    tuple of Candidate
        Empty if the reference is not done or lacks an objective.
    """
    if not pareto_front((reference,), objectives):
        return ()
    return tuple(row for row in front if pareto_front((reference, row), objectives) == (row,))

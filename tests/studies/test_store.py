"""The store keeps rows by their keys, admits one writer, and stays valid after a kill.

A file that is not a store is refused with its name.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from ssm_planner.atomic import locked
from ssm_planner.errors import ExportError, ProblemError
from ssm_planner.studies.store import Candidate, Store, candidate_key, write_table


def _designs(count):
    designs = [{"geometry.alpha": f"{i} deg"} for i in range(count)]
    return [(i, candidate_key(design, "context"), design) for i, design in enumerate(designs)]


def test_written_rows_are_read_back(tmp_path):
    designs = _designs(5)
    with Store(tmp_path / "study.sqlite") as store:
        store.add_candidates(designs)
        store.write_results(
            [(designs[2][1], Candidate(2, "done", {}, figures={"duration": 0.1 + 0.2}))]
        )
        store.write_results(
            [(designs[3][1], Candidate(3, "infeasible", {}, stage="reach", reason="too short"))]
        )
    with Store(tmp_path / "study.sqlite") as store:
        store.add_candidates(designs)
        states = {2: "done", 3: "infeasible"}
        assert store.states() == {key: (i, states.get(i, "waiting")) for i, key, _ in designs}
        rows = store.rows()
    assert [row.number for row in rows] == [0, 1, 2, 3, 4]
    assert rows[2] == Candidate(2, "done", designs[2][2], figures={"duration": 0.1 + 0.2})
    assert (rows[3].stage, rows[3].reason) == ("reach", "too short")


def test_the_key_is_of_the_value_not_of_its_order():
    assert (
        candidate_key({"a": 1, "b": 2}, "x")
        == candidate_key({"b": 2, "a": 1}, "x")
        != candidate_key({"a": 1, "b": 2}, "y")
    )


def test_one_driver_at_a_time(tmp_path):
    with Store(tmp_path / "study.sqlite"), pytest.raises(ProblemError, match="another program"):
        Store(tmp_path / "study.sqlite")
    Store(tmp_path / "study.sqlite").__exit__(None, None, None)


def test_a_lock_that_is_given_back_at_once_is_waited_for(tmp_path: Path) -> None:
    """A worker that a killed driver was starting can hold the lock for a moment."""
    path = tmp_path / "study.sqlite"
    with Store(path):
        pass
    lock = locked(path.with_suffix(".lock"))
    lock.__enter__()
    release = threading.Timer(0.1, lock.__exit__, (None, None, None))
    release.start()
    with Store(path) as store:
        assert list(store.rows()) == []
    release.join()


@pytest.mark.parametrize(
    "content",
    [b"no store, a text that somebody wrote" * 90, b"SQLite format 3\x00" + b"\xff" * 9000],
)
def test_a_file_that_is_no_store_is_refused(tmp_path, content):
    path = tmp_path / "study.sqlite"
    path.write_bytes(content)
    with pytest.raises((ProblemError, ExportError), match=r"study\.sqlite"):
        Store(path)
    assert path.read_bytes() == content


def test_a_killed_driver_leaves_whole_rows(tmp_path):
    code = (
        "import sys; from pathlib import Path; from ssm_planner.studies.store import *\n"
        "store = Store(Path(sys.argv[1])); print('open', flush=True)\n"
        "for i in range(10**6):\n"
        "    store.add_candidates([(i, str(i), {'x': i})])\n"
        "    store.write_results([(str(i), Candidate(i, 'done', {}, figures={'y': i}))])\n"
    )
    path = tmp_path / "study.sqlite"
    process = subprocess.Popen([sys.executable, "-c", code, path], stdout=subprocess.PIPE)
    process.stdout.readline()
    time.sleep(0.4)
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    with Store(path) as store:
        rows = store.rows()
    assert len(rows) > 3
    assert all(row.figures == {"y": row.number} for row in rows if row.state == "done")
    assert sum(row.state == "waiting" for row in rows) <= 1


def test_the_table_is_a_csv_of_choices_and_figures(tmp_path):
    rows = [
        Candidate(0, "done", {"geometry.alpha": "30 deg"}, figures={"duration": 1.5}),
        Candidate(1, "failed", {"geometry.alpha": "31 deg"}, reason="why"),
    ]
    write_table(rows, tmp_path / "table.csv")
    assert (tmp_path / "table.csv").read_text(encoding="utf-8").splitlines() == [
        "number,state,stage,reason,geometry.alpha,duration",
        "0,done,,,30 deg,1.5",
        "1,failed,,why,31 deg,",
    ]

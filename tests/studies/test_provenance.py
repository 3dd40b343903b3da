"""Rows of a study belong to one program and its inputs.

They are never reused, shown or accepted for another program or other inputs.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

import ssm_planner
from ssm_planner.errors import ProblemError
from ssm_planner.studies import evaluation, provenance, run
from ssm_planner.studies.evaluation import Evaluation
from ssm_planner.studies.provenance import (
    context_hash,
    describe_differences,
    describe_study,
    study_from_description,
)
from ssm_planner.studies.run import StudyError
from ssm_planner.studies.run import study as run_study
from ssm_planner.studies.show import compare_candidates, write_candidate
from ssm_planner.studies.study import Choice, Requirements, Search, Varied
from ssm_planner.studies.study_file import load_study
from tests.studies.support import FILE, Here, closed_form, study, without_planning
from tests.support.paths import PROBLEMS, ROOT

__all__ = ["without_planning"]
PACKAGE = Path(ssm_planner.__file__).parent
PROGRAM = provenance.describe_program()


def set_program(monkeypatch: pytest.MonkeyPatch, **changes: str) -> dict[str, str]:
    """Pretend that another program runs the study and its workers, and return its description."""
    program = {**PROGRAM, **changes}
    for module in (provenance, run, evaluation):
        monkeypatch.setattr(module, "describe_program", lambda: program)
    return program


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a copy of the package."""
    folder = tmp_path_factory.mktemp("copy") / "ssm_planner"
    shutil.copytree(PACKAGE, folder, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.mark.parametrize(
    "name", ["dynamics/friction.py", "units.csv", *("native/" + name for name in ("*.c", "*.h"))]
)
def test_every_source_changes_the_program(
    name: str, copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A changed byte, another file name and a missing file each change the hash of the program.

    The folder that contains the package does not change it.
    """
    file = sorted(copy.glob(name))[0]
    content = file.read_bytes()
    before = provenance.describe_program.__wrapped__()
    monkeypatch.setattr(provenance, "__file__", str(copy / "studies" / "provenance.py"))
    assert provenance.describe_program.__wrapped__() == before
    hashes = {before["ssm_planner"]}
    file.write_bytes(content + b"\n")
    hashes.add(provenance.describe_program.__wrapped__()["ssm_planner"])
    file.rename(file.with_stem("other"))
    file.with_stem("other").write_bytes(content)
    hashes.add(provenance.describe_program.__wrapped__()["ssm_planner"])
    file.with_stem("other").unlink()
    hashes.add(provenance.describe_program.__wrapped__()["ssm_planner"])
    file.write_bytes(content)
    assert len(hashes) == 4
    assert provenance.describe_program.__wrapped__() == before


@pytest.mark.parametrize("name", provenance.NUMERICAL_LIBRARIES)
def test_the_version_of_a_numerical_library_changes_the_program(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, stated = provenance.describe_program.__wrapped__(), provenance.version
    monkeypatch.setattr(provenance, "version", lambda each: "0.0" if each == name else stated(each))
    after = provenance.describe_program.__wrapped__()
    assert describe_differences(before, after) == [f"{name} ({stated(name)} instead of 0.0)"]


def test_a_missing_compiled_part_is_another_program(monkeypatch: pytest.MonkeyPatch) -> None:
    before = provenance.describe_program.__wrapped__()
    monkeypatch.setattr(provenance, "load", lambda: None)
    assert provenance.describe_program.__wrapped__() == {**before, "compiled part": "not in use"}


def test_every_input_changes_the_context_and_the_search_does_not() -> None:
    of = study()
    context = context_hash(describe_study(of))
    others = [
        replace(of, robot={**of.robot, "gravity": ["0", "0", "-9 m/s^2"]}),
        replace(of, motions={"other": of.motions["tilt_insert"]}),
        replace(of, require=Requirements(motor_margin=0.1)),
        replace(of, vary=(*of.vary, Varied("joints.roll.drive.ratio", 1.0, 2.0, ""))),
        replace(of, selected=(Choice("joints.roll.motor", {"a": {}}, "mass"),)),
    ]
    assert len({context, *(context_hash(describe_study(item)) for item in others)}) == 6
    for same in (
        replace(of, search=Search("grid", 3)),
        replace(of, minimise=("duration",)),
        replace(of, name="other", file="other.yaml"),
    ):
        assert context_hash(describe_study(same)) == context
    assert study_from_description(describe_study(of), of.name).designs
    assert describe_study(study_from_description(describe_study(of), "name")) == describe_study(of)


def test_a_table_of_a_motion_is_an_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The path of a table is relative to its problem file in any working folder.

    A change of the table is a change of the study.
    """
    table = "tilt [deg]\n-85\n-100\n-110\n"
    (tmp_path / "points.csv").write_text(table, encoding="utf-8")
    start = "{roll: 0 deg, tilt: -85 deg, spin: 0 deg, depth: 0 mm}"
    text = f"robot: vitreoretinal\nstart: {start}\nmotion: [repeat: {{times: 1, motion: [path: points.csv]}}]\n"
    (tmp_path / "motion.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "study.yaml").write_text(
        json.dumps({**FILE, "motions": ["motion.yaml"]}), encoding="utf-8"
    )
    monkeypatch.chdir(ROOT)
    of = load_study(tmp_path / "study.yaml")
    first = describe_study(of)
    (problem,) = (problem for _, problem in evaluation.candidate_problems(of, {}))
    assert problem.motion[0].curve == "samples"
    (tmp_path / "points.csv").write_text(table.replace("-100", "-101"), encoding="utf-8")
    assert describe_differences(first, describe_study(load_study(tmp_path / "study.yaml"))) == [
        "tables"
    ]


@pytest.mark.usefixtures("without_planning")
def test_rows_of_another_program_are_kept_and_never_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of = study()
    first = run_study(of, tmp_path)
    assert first.notes == tuple(of.notes)
    original = set_program(monkeypatch)
    set_program(monkeypatch, numpy="0.0")
    monkeypatch.setattr(Evaluation, "__call__", closed_form(2.0))
    executor = Here()
    second = run_study(of, tmp_path, executor=executor)
    assert executor.count == 17
    assert all(
        b.figures["duration"] - 1 == pytest.approx(2 * (a.figures["duration"] - 1))
        for a, b in zip(first.rows, second.rows, strict=True)
    )
    *_, note = second.notes
    assert f"numpy ({original['numpy']} instead of 0.0)" in note
    with sqlite3.connect(tmp_path / "study.sqlite") as connection:
        assert connection.execute("SELECT count(*) FROM candidates").fetchone() == (34,)
    set_program(monkeypatch)
    executor = Here()
    assert run_study(of, tmp_path, executor=executor).rows == first.rows
    assert executor.count == 0


@pytest.mark.usefixtures("without_planning")
@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"search": {"points": 16, "seed": 4}}, "search"),
        ({"motions": ["eye_approach"]}, "motions"),
        ({"require": {"motor_margin": "20 %"}}, "require"),
        ({"minimise": ["duration"]}, "minimise"),
    ],
)
def test_rows_of_another_study_are_not_shown(
    change: dict[str, object], name: str, tmp_path: Path
) -> None:
    run_study(study(), tmp_path)
    other = study(**change)
    with pytest.raises(ProblemError, match=f"another study or program: {name}"):
        write_candidate(other, tmp_path, 0)
    with pytest.raises(ProblemError, match=f"another study or program: {name}"):
        compare_candidates(other, tmp_path, 0, 1)
    assert not (tmp_path / "candidate_0").exists()
    result = run_study(other, tmp_path)
    assert [row.design for row in result.rows] == list(other.designs())
    comparison = compare_candidates(other, tmp_path, 3, 4)
    assert comparison["design"]["geometry.alpha"][0] == result.rows[3].design["geometry.alpha"]
    with pytest.raises(ProblemError, match="another study or program"):
        compare_candidates(study(), tmp_path, 0, 1)


@pytest.mark.usefixtures("without_planning")
def test_rows_of_another_program_are_not_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_study(study(), tmp_path)
    set_program(monkeypatch, ssm_planner="0123456789abcdef")
    with pytest.raises(ProblemError, match=r"ssm_planner \(.* instead of 0123456789abcdef\)"):
        compare_candidates(study(), tmp_path, 0, 1)


@pytest.mark.usefixtures("without_planning")
def test_a_larger_search_uses_the_rows_of_the_smaller_one(tmp_path: Path) -> None:
    first = run_study(study(search={"points": 8, "seed": 3}), tmp_path)
    executor = Here()
    second = run_study(study(), tmp_path, executor=executor)
    assert (executor.count, second.notes) == (8, first.notes)
    assert second.rows[:8] == first.rows


class Elsewhere(Here):
    """An executor whose workers run another program after the first `after` answers."""

    def __init__(self, change: dict[str, str], after: int) -> None:
        super().__init__()
        self.change, self.left = change, after

    def submit(self, fn, /, *args, **kwargs):
        future = super().submit(fn, *args, **kwargs)
        *answer, program = future.result()
        if self.left > 0:
            self.left -= 1
            return future
        changed: Here.submit = type(future)()  # type: ignore[valid-type]
        changed.set_result((*answer, {**program, **self.change}))
        return changed


@pytest.mark.usefixtures("without_planning")
@pytest.mark.parametrize("after", [0, 3])
@pytest.mark.parametrize("name", ["ssm_planner", "numpy", "compiled part", "another package"])
def test_a_worker_with_another_program_is_refused(tmp_path: Path, name: str, after: int) -> None:
    """Results of a worker with another program are not stored.

    Earlier results of the right program are stored, and the next run continues from them.
    """
    executor = Elsewhere({name: "0.0"}, after)
    with pytest.raises(StudyError, match=rf"a worker has another program .*{name} "):
        run_study(study(), tmp_path, executor=executor)
    with sqlite3.connect(tmp_path / "study.sqlite") as connection:
        (stored,) = connection.execute(
            "SELECT count(*) FROM candidates WHERE state = 'done'"
        ).fetchone()
    assert (stored > 0) == (after > 0)
    rest = Here()
    result = run_study(study(), tmp_path, executor=rest)
    assert rest.count == 17 - stored
    assert result.states == {"done": 16}


class Older(Here):
    """An executor whose workers have an older package, which lacks the called function."""

    def submit(self, fn, /, *args, **kwargs):
        future = super().submit(fn, *args, **kwargs)
        changed: Here.submit = type(future)()  # type: ignore[valid-type]
        changed.set_exception(AttributeError(f"module has no attribute {fn.__name__!r}"))
        return changed


@pytest.mark.usefixtures("without_planning")
def test_a_worker_of_an_older_package_is_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"the workers are lost .*no attribute"):
        run_study(study(), tmp_path, executor=Older())


@pytest.fixture
def changed(tmp_path: Path, copy: Path) -> Path:
    """Return a folder with a copy of the package in which motions take twice as long."""
    folder = tmp_path / "changed"
    shutil.copytree(copy, folder / "ssm_planner")
    (folder / "problems").symlink_to(PROBLEMS)
    file = folder / "ssm_planner" / "trajectory.py"
    text = file.read_text(encoding="utf-8")
    old = "        return float(self.breaks[-1] - self.breaks[0])"
    assert text.count(old) == 1
    file.write_text(text.replace(old, f"{old} * 2"), encoding="utf-8")
    (tmp_path / "study.yaml").write_text(
        json.dumps({**FILE, "search": {"points": 2}}), encoding="utf-8"
    )
    return folder


def command(package: Path, folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run the study with a given package and write the results to a folder."""
    words = ["study", folder.parent / "study.yaml", "-o", folder, *options]
    return subprocess.run(
        [sys.executable, "-m", "ssm_planner", *words],
        env={"PYTHONPATH": str(package), "PATH": ""},
        cwd=folder.parent,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_stale_rows_are_not_reused_after_a_change_of_the_code(
    tmp_path: Path, changed: Path
) -> None:
    """The changed program gives the same table in a used folder as in a new one."""

    def table(package: Path, name: str) -> tuple[str, str]:
        done = command(package, tmp_path / name, "--workers", "1")
        assert done.returncode in (0, 1), done.stderr
        return (tmp_path / name / "table.csv").read_text(encoding="utf-8"), done.stdout

    before, _ = table(PACKAGE.parent, "used")
    after, output = table(changed, "used")
    fresh, _ = table(changed, "fresh")
    assert before != after == fresh
    assert "results of another study or program: ssm_planner (" in " ".join(output.split())


@pytest.mark.slow
def test_workers_of_dask_with_other_code_are_refused(tmp_path: Path, changed: Path) -> None:
    pytest.importorskip("distributed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    words = (
        ["scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"],
        ["worker", address, "--nthreads", "1", "--no-dashboard", "--no-nanny"],
    )
    processes = [
        subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{kind}", *options],
            env={**os.environ, "PYTHONPATH": str(changed)},
            cwd=tmp_path,
            stderr=subprocess.DEVNULL,
        )
        for kind, *options in words
    ]
    try:
        done = command(PACKAGE.parent, tmp_path / "out", "--scheduler", address)
    finally:
        for process in processes:
            process.terminate()
            process.wait()
    assert done.returncode == 2, done.stderr
    assert "a worker has another program than the driver: ssm_planner (" in " ".join(
        done.stderr.split()
    )
    with closing(sqlite3.connect(tmp_path / "out" / "study.sqlite")) as connection:
        states = connection.execute("SELECT DISTINCT state FROM candidates").fetchall()
    assert states == [("waiting",)]

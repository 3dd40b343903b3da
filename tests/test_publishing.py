"""A folder contains the results of one plan only, even after an interruption.

Files of the user are never replaced or removed.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from ssm_planner import atomic, publishing
from ssm_planner.atomic import replacing
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.publishing import (
    EXPORT_FORMAT,
    check_generation,
    file_hashes,
    file_name,
    publishing_results,
    read_manifest,
)

OLD, NEW = "a" * 64, "b" * 64
KINDS = {"plan.json": "plan", "report.html": "page", "trajectory.csv": "rows"}


def sha_of(plan: str) -> str:
    """Return the hash of the plan.json that `publish` writes."""
    return hashlib.sha256((KINDS["plan.json"] + plan).encode()).hexdigest()


def publish(folder: Path, plan: str, **files: str) -> None:
    with publishing_results(folder, sha_of(plan)) as temporary:
        for name, text in (files or {name: text + plan for name, text in KINDS.items()}).items():
            (temporary / name.replace("_", ".")).write_text(text, encoding="utf-8")


def export(folder: Path, **files: str) -> None:
    with publishing.publishing(folder) as temporary:
        for name, text in files.items():
            path = temporary / name.replace("__", "/")
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
        manifest = {"format": EXPORT_FORMAT, "files": file_hashes(temporary)}
        (temporary / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")


def content(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8")
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_a_folder_holds_one_generation_and_keeps_what_others_put_there(tmp_path: Path) -> None:
    out = tmp_path / "out"
    publish(out, OLD)
    publish(out, OLD, motion_pdf="drawn")  # This adds a file to the plan.
    (out / "notes.txt").write_text("mine", encoding="utf-8")
    assert set(read_manifest(out)["files"]) == {*KINDS, "motion.pdf"}
    check_generation(out)
    publish(out, NEW)
    assert set(content(out)) == {*KINDS, "manifest.json", "notes.txt"}, (
        "the earlier plan's figure is stale"
    )
    check_generation(out)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_file_of_another_plan_is_refused(tmp_path: Path) -> None:
    publish(tmp_path, OLD)
    before = content(tmp_path)
    with pytest.raises(ExportError, match="another plan"):
        publish(tmp_path, NEW, motion_pdf="drawn")
    with pytest.raises(ExportError, match="holds the results of a plan"):
        export(tmp_path, robot_urdf="x")
    assert content(tmp_path) == before


@pytest.mark.parametrize("moves", range(9))
def test_an_end_at_any_step_of_the_exchange_is_noticed(
    tmp_path: Path, moves: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An interruption after any number of moves leaves complete results or is noticed.

    The exception stands for kill -9, after which no further file is moved.
    """
    out = tmp_path / "out"
    publish(out, OLD)

    class Killed(BaseException):
        pass

    done, replace = [0], Path.replace

    def counted(path: Path, target: Path) -> Path:
        if target.parent == out:
            if done[0] == moves:
                raise Killed
            done[0] += 1
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", counted)
    try:
        publish(out, NEW)
    except Killed:
        pass
    else:
        assert moves >= 5, "the manifest twice and three files"
    monkeypatch.undo()
    plans = {(out / name).read_text(encoding="utf-8")[-1] for name in KINDS}
    if moves in (0, 5, 6, 7, 8):
        check_generation(out)
        assert plans == {OLD[0] if moves == 0 else NEW[0]}
    else:
        with pytest.raises(TrajectoryError, match="make them again"):
            check_generation(out)
        publish(out, NEW)
        check_generation(out)


def test_a_changed_file_is_noticed_and_a_missing_one_is_not(tmp_path: Path) -> None:
    publish(tmp_path, OLD)
    (tmp_path / "report.html").unlink()
    check_generation(tmp_path)
    (tmp_path / "trajectory.csv").write_text("of another plan", encoding="utf-8")
    with pytest.raises(TrajectoryError, match=r"trajectory\.csv: is not the file"):
        check_generation(tmp_path)


def test_an_export_leaves_nothing_stale_and_takes_nothing_of_the_users(tmp_path: Path) -> None:
    out = tmp_path / "out"
    export(out, a_csv="1", bag__data="2", bag__metadata="3")
    export(out, b_csv="4", bag__data="5")
    assert set(content(out)) == {"b_csv", "bag/data", "manifest.json"}
    (out / "bag/recording").write_text("mine", encoding="utf-8")
    (out / "b_csv").write_text("edited", encoding="utf-8")
    before = content(out)
    with pytest.raises(ExportError, match="bag/recording"):
        export(out, bag__data="6")
    assert content(out) == before
    other = tmp_path / "other"
    (other / "bag").mkdir(parents=True)
    (other / "bag/recording").write_text("mine", encoding="utf-8")
    with pytest.raises(ExportError, match="bag/recording"):
        export(other, bag__data="7")
    (tmp_path / "third").mkdir()
    (tmp_path / "third/a_csv").write_text("mine", encoding="utf-8")
    with pytest.raises(ExportError, match="a_csv"):
        export(tmp_path / "third", a_csv="8")
    export(out, c_csv="9")
    assert content(out)["b_csv"] == "edited", "what was changed is not removed"


def test_a_manifest_cannot_name_files_outside_its_folder(tmp_path: Path) -> None:
    mine = tmp_path / "mine.txt"
    mine.write_text("mine", encoding="utf-8")
    out = tmp_path / "out"
    export(out, a_csv="1")
    manifest = read_manifest(out)
    manifest["files"] |= {
        "../mine.txt": publishing.sha256(mine),
        str(mine): publishing.sha256(mine),
        "": "x",
        "\0": "x",
    }
    (out / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    export(out, b_csv="2")
    assert mine.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize("special", ["/dev/null", "fifo"])
def test_devices_and_special_files_are_left_alone(special: str, tmp_path: Path) -> None:
    path = tmp_path / special
    if special == "fifo":
        os.mkfifo(path)
    before = path.lstat().st_mode
    for of in (replacing, publishing.publishing):
        with pytest.raises(ExportError, match="special file"), of(path) as temporary:
            temporary.write_text("x", encoding="utf-8")
    assert path.lstat().st_mode == before
    link = tmp_path / "link"
    link.symlink_to(path)
    with pytest.raises(ExportError, match="special file"), replacing(link) as temporary:
        temporary.write_text("x", encoding="utf-8")


def test_a_symbolic_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("old", encoding="utf-8")
    (tmp_path / "link").symlink_to("real")
    with replacing(tmp_path / "link") as temporary:
        temporary.write_text("new", encoding="utf-8")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text(encoding="utf-8") == "new"


@pytest.mark.parametrize(
    ("umask", "file", "folder"),
    [(0o022, 0o644, 0o755), (0o077, 0o600, 0o700), (0o002, 0o664, 0o775)],
)
def test_the_umask_decides_who_may_read(tmp_path: Path, umask: int, file: int, folder: int) -> None:
    before = os.umask(umask)
    try:
        publish(tmp_path / "out", OLD)
        with replacing(tmp_path / "one") as temporary:
            temporary.write_text("x", encoding="utf-8")
    finally:
        os.umask(before)
    assert {stat.S_IMODE(path.stat().st_mode) for path in (tmp_path / "out").iterdir()} == {file}
    assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == folder
    assert stat.S_IMODE((tmp_path / "one").stat().st_mode) == file


def test_signals_wait_while_files_change_places(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    publish(tmp_path, OLD)
    replace = Path.replace

    def interrupted(path: Path, target: Path) -> Path:
        os.kill(os.getpid(), signal.SIGINT)
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        publish(tmp_path, NEW)
    assert read_manifest(tmp_path)["plan"] == sha_of(NEW)
    check_generation(tmp_path)


def test_folders_that_a_killed_process_left_are_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = tmp_path / ".out-0123456789ab"
    left.mkdir()
    publish(tmp_path / "out", OLD)
    assert left.exists(), "it may be somebody's who has just begun"
    monkeypatch.setattr(atomic, "ABANDONED_AGE", 0.0)
    with atomic.locked(left):
        # The lock belongs to an open file, so that only another process can see that it is held.
        code = "import pathlib, sys; from ssm_planner import atomic; atomic.ABANDONED_AGE = 0.0\n"
        code += "atomic._remove_abandoned(pathlib.Path(sys.argv[1]), '.out-')"
        subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True)
        assert left.exists(), "its process lives"
    atomic._remove_abandoned(tmp_path, ".out-")
    assert not left.exists()


@pytest.mark.parametrize(
    "name",
    [
        "../../x",
        "/etc/x",
        "..",
        ".",
        "",
        "a/b",
        "a\\b",
        "a\0b",
        "a\nb",
        "x" * 5000,
        ".hidden",
        "\udcff",
        "motion é",
    ],
)
def test_names_are_data_and_never_paths(name: str, tmp_path: Path) -> None:
    result = file_name(name)
    assert (tmp_path / result).parent == tmp_path
    assert result not in ("", ".", "..")
    (tmp_path / result).write_text("x", encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == [result]


@pytest.mark.parametrize("name", ["x" * 5000, "plan.json/x", "\udcff", "a/" * 3000 + "b"])
def test_a_manifest_may_list_what_no_file_can_be_called(name: str, tmp_path: Path) -> None:
    publish(tmp_path / "out", OLD)
    path = tmp_path / "out" / publishing.MANIFEST
    manifest = json.loads(path.read_text(encoding="utf-8"))
    manifest["files"][name] = "0" * 64
    path.write_text(json.dumps(manifest), encoding="utf-8")
    check_generation(tmp_path / "out")  # A missing file is not an error.
    publish(tmp_path / "out", NEW)
    assert name not in read_manifest(tmp_path / "out")["files"]


def test_ordinary_names_stay() -> None:
    assert file_name("tilt_insert-2.b") == "tilt_insert-2.b"

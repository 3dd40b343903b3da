"""Compiled element functions: the interpreter's numbers to the last bit, kept by content, and nothing without a compiler."""

from __future__ import annotations

import dataclasses
import os
import shutil
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.codegen import library
from ssm_planner.planning.ocp import compiled
from ssm_planner.planning.ocp.transcription import forget_solutions
from ssm_planner.planning.planner import plan_motion
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.value import unchecked

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(shutil.which("cc") is None or os.name != "posix", reason="no C compiler here")


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[compiled.FunctionStore]:
    monkeypatch.setenv("SSM_PLANNER_COMPILE", "1")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    forget_solutions()
    fresh = compiled.FunctionStore()
    used(fresh, monkeypatch)
    yield fresh
    fresh.wait()


def used(store: compiled.FunctionStore, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("transcription", "structured"):
        monkeypatch.setattr(f"ssm_planner.planning.ocp.{module}.function_store", store)


def tilts(problem: Problem, degrees: float) -> Problem:
    return dataclasses.replace(problem, motion=(dataclasses.replace(problem.motion[0], tilt=np.radians(degrees)),))


@pytest.mark.parametrize("planner", ["optimal", "fast"])
def test_the_same_plan_to_the_last_bit(
    planner: Any, tilt_insert: Problem, store: compiled.FunctionStore, tmp_path: Path
) -> None:
    problem = unchecked(tilt_insert, planner=planner)
    problems = [tilts(problem, degrees) for degrees in (-135, -133, -131, -129, -127, -125)]
    interpreted = [plan_motion(problem) for problem in problems]
    store.compile_all()
    assert any(entry.compiled for entry in store._entries.values())
    forget_solutions()
    for problem, before in zip(problems, interpreted, strict=True):
        after = plan_motion(problem)
        assert np.array_equal(after.trajectory.coefficients, before.trajectory.coefficients)
    kept = list((tmp_path / "ssm_planner").iterdir())
    assert [path.suffix for path in kept] == [".so"] * len(kept)


def test_what_has_not_taken_long_is_not_compiled(
    tilt_insert: Problem, store: compiled.FunctionStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(library, "LONG", np.inf)
    plan_motion(tilt_insert)
    assert not (tmp_path / "ssm_planner").exists()


@pytest.mark.parametrize("planner", ["optimal", "fast"])
def test_what_has_taken_long_is_compiled_for_the_next_process(
    planner: Any, tilt_insert: Problem, store: compiled.FunctionStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(library, "LONG", 1e-6)
    problem = unchecked(tilt_insert, planner=planner)
    plan_motion(problem)
    store.wait()
    forget_solutions()
    later = compiled.FunctionStore()
    used(later, monkeypatch)
    plan_motion(problem)
    later.wait()
    assert any(entry.compiled and entry.seconds > 0 for entry in later._entries.values())


def test_only_the_libraries_used_last_are_kept(
    tilt_insert: Problem, store: compiled.FunctionStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(library, "KEPT_FILES", 3)
    folder = tmp_path / "ssm_planner"
    folder.mkdir(mode=0o700)
    for k in range(5):
        (folder / f"old{k}.so").write_bytes(b"")
        os.utime(folder / f"old{k}.so", (1000 + k, 1000 + k))
    plan_motion(tilt_insert)
    store.compile_all()
    assert len(list(folder.glob("*.so"))) == 3
    assert not (folder / "old0.so").exists()


def spoil(library: Path, share: float) -> None:
    """Another file: this process may have the first one mapped."""
    content = library.read_bytes()
    library.unlink()
    library.write_bytes(content[: int(share * len(content))])
    library.chmod(0o600)


def spoil_by_name(library: Path) -> None:
    library.rename(library.with_name("other-" + library.stem.partition("-")[2] + ".so"))


SPOILT: dict[str, Callable[[Path], object]] = {
    "cut off": lambda library: spoil(library, 0.5),
    "empty": lambda library: spoil(library, 0.0),
    "others can write it": lambda library: library.chmod(0o666),
    "of something else": spoil_by_name,
}


@pytest.mark.parametrize("fault", SPOILT)
def test_a_library_that_is_not_whole_or_not_the_users_is_not_loaded(
    fault: str, tilt_insert: Problem, store: compiled.FunctionStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(library, "LONG", np.inf)
    plan_motion(tilt_insert)
    store.compile_all()
    libraries = list((tmp_path / "ssm_planner").glob("*.so"))
    assert libraries
    for path in libraries:
        SPOILT[fault](path)
    later = compiled.FunctionStore()
    monkeypatch.setattr("ssm_planner.planning.ocp.transcription.function_store", later)
    forget_solutions()
    assert plan_motion(tilt_insert).trajectory is not None
    assert not any(entry.compiled for entry in later._entries.values())


def test_a_folder_that_cannot_be_written_does_not_matter(
    tilt_insert: Problem, store: compiled.FunctionStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(**_: object) -> str:
        raise OSError("No space left on device")

    monkeypatch.setattr(library.tempfile, "mkdtemp", full)
    monkeypatch.setattr(library, "LONG", 0.0)
    assert plan_motion(tilt_insert).trajectory is not None
    store.compile_all()
    assert not any(entry.compiled for entry in store._entries.values())


def test_a_user_without_a_home_has_no_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SSM_PLANNER_COMPILE", "1")
    for name in ("XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os, "getuid", lambda: 2**31 - 2)
    with pytest.raises(RuntimeError):
        Path.home()
    assert library.cache() is None
    assert library.filled_cache() is None


def test_a_compiler_that_fails_is_asked_once(
    tilt_insert: Problem, store: compiled.FunctionStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = tmp_path / "calls"
    broken = tmp_path / "cc"
    broken.write_text(f"#!/bin/sh\necho >> {calls}\nexit 1\n", encoding="utf-8")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    plan_motion(tilt_insert)
    store.compile_all()
    store.compile_all()
    assert len(calls.read_text(encoding="utf-8").splitlines()) == len(store._entries)
    assert not any(entry.compiled for entry in store._entries.values())


def children(pid: int) -> set[int]:
    """Living processes below one."""
    found = set()
    for status in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            name, _, rest = status.read_text().rpartition(")")
            state, parent = rest.split()[:2]
            if int(parent) == pid and state != "Z":
                found |= {int(name.split()[0])} | children(int(name.split()[0]))
    return found


HANGING = """
    import sys, time
    from ssm_planner.codegen import library
    from ssm_planner.loading.load import load_problem
    from ssm_planner.planning.ocp import compiled
    from ssm_planner.planning.planner import plan_motion
    library.LONG, library.PATIENCE = 0.0, float(sys.argv[2])
    plan_motion(load_problem(sys.argv[1]))
    print("planned", flush=True)
    compiled.function_store.wait()
    print("waited", flush=True)
    time.sleep(60)
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc")
@pytest.mark.parametrize("killed", [False, True])
def test_a_compiler_that_hangs_is_ended(killed: bool, tmp_path: Path) -> None:
    """After some patience, or with the program; a module that lies in the working directory is not run on the way."""
    compiler = tmp_path / "bin/cc"
    compiler.parent.mkdir()
    compiler.write_text("#!/bin/sh\nsleep 100\n", encoding="utf-8")
    compiler.chmod(0o755)
    here = tmp_path / "here"
    here.mkdir()
    for name in ("shutil", "hashlib", "threading", "numpy", "sitecustomize"):
        (here / f"{name}.py").write_text(f"open({str(tmp_path / name)!r}, 'w')\n", encoding="utf-8")
    words = [str(ROOT / "problems/tilt_insert.yaml"), "60" if killed else "0.5"]
    path = f"{compiler.parent}{os.pathsep}{os.environ['PATH']}"
    environment = {"SSM_PLANNER_COMPILE": "1", "XDG_CACHE_HOME": str(tmp_path), "PATH": path, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", "import sys; sys.path.remove('')" + textwrap.dedent(HANGING), *words]
    with subprocess.Popen(command, cwd=here, env={**os.environ, **environment}, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"planned\n"
        running = children(process.pid)
        if killed:
            assert running
        else:
            assert process.stdout.readline() == b"waited\n"
        process.kill()
    end = time.monotonic() + 2
    while any(Path(f"/proc/{pid}").exists() for pid in running) and time.monotonic() < end:
        time.sleep(0.02)
    assert not [pid for pid in running if Path(f"/proc/{pid}").exists()]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bin", "here", "ssm_planner"]


def test_a_folder_that_others_can_write_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, store: compiled.FunctionStore
) -> None:
    folder = tmp_path / "ssm_planner"
    folder.mkdir()
    folder.chmod(0o777)
    assert library.cache() is None
    folder.chmod(0o700)
    assert library.cache() == folder


def test_it_can_be_switched_off(monkeypatch: pytest.MonkeyPatch, store: compiled.FunctionStore) -> None:
    monkeypatch.setenv("SSM_PLANNER_COMPILE", "0")
    assert library.cache() is None

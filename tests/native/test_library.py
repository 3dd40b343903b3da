"""The compiled part: made whole, of the sources as they are, or absent without a word."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from ssm_planner.native import compiling, library

COMPILED = shutil.which("cc") is not None and os.name == "posix"
needs_compiler = pytest.mark.skipif(not COMPILED, reason="no C compiler here")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of the sources, of which one library is made without optimisation."""
    for source in [*compiling.FOLDER.glob("*.c"), *compiling.FOLDER.glob("*.h")]:
        shutil.copy(source, tmp_path)
    monkeypatch.setattr(compiling, "FOLDER", tmp_path)
    quick = tuple("-O0" if flag == "-O3" else flag for flag in compiling.FLAGS)
    monkeypatch.setattr(compiling, "FLAGS", quick)
    monkeypatch.setattr(compiling, "VARIANTS", {"portable": ()})
    library._loaded.cache_clear()
    yield tmp_path
    library._loaded.cache_clear()


@pytest.mark.slow
@needs_compiler
def test_of_the_sources_as_they_are(folder: Path) -> None:
    assert library.load() is None
    library._loaded.cache_clear()
    made = compiling.build()
    assert compiling.path_of("portable") in made
    assert sorted(folder.glob("libraries/*")) == sorted(made)
    times = [path.stat().st_mtime_ns for path in made]
    assert compiling.build() == made
    assert [path.stat().st_mtime_ns for path in made] == times  # they are of these sources already
    assert library.load() is not None
    library._loaded.cache_clear()
    with (folder / "reachability.c").open("a") as file:
        file.write("/* another law */\n")
    assert library.load() is None
    made[0].with_stem("other").write_bytes(compiling.key().encode())  # of another system
    assert not compiling._is_made("other")


@needs_compiler
def test_what_does_not_compile_is_no_library_and_no_fault(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for source in folder.glob("*.c"):
        source.unlink()
    (folder / "wrong.c").write_text("this is no C\n", encoding="utf-8")
    assert compiling.build() == []
    assert not list(folder.glob("libraries/*"))
    assert "without its compiled library" in capfd.readouterr().err


def test_without_a_compiler(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(folder))
    assert compiling.build() == []
    assert library.load() is None
    assert capfd.readouterr().err == ""


@needs_compiler
def test_the_tests_run_with_it() -> None:
    """Installed by `make test`, or made by hand: python -m ssm_planner.native.compiling."""
    if not compiling.path_of("portable").exists():
        pytest.skip("installed without the compiled part")
    assert library.load() is not None
    assert library.load().ssm_key() == compiling.key().encode()


def test_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SSM_PLANNER_NATIVE", "0")
    assert library.load() is None


@needs_compiler
def test_warnings(tmp_path: Path) -> None:
    flags = [
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Werror",
        "-fsyntax-only",
        '-DSSM_KEY=""',
    ]
    for source in compiling.FOLDER.glob("*.c"):
        subprocess.run(["cc", *flags, str(source)], check=True)


@needs_compiler
@pytest.mark.slow
def test_every_variant_gives_the_same_bits() -> None:
    compiling.build()
    probe = """
import sys, hashlib, numpy as np
from ssm_planner.native import compiling, library
native = library._open(sys.argv[1])
library.load = lambda: native
from tests.planning.retiming.test_reachability import fastest_profile, random_case
found = [fastest_profile(*random_case(seed)) for seed in range(40)]
print(native is not None, hashlib.sha256(b"".join(b"" if each is None else each.tobytes() for each in found)).hexdigest())
"""
    variants = ["portable"] + ["avx2"] * bool(library._open("portable").ssm_has_avx2())
    said = {
        subprocess.run(
            [sys.executable, "-c", probe, name], check=True, capture_output=True, text=True
        ).stdout
        for name in variants
    }
    assert len(said) == 1
    assert said.pop().startswith("True")

"""The compiled library matches the current sources, and all its variants give the same bits.
Without a working compiler, the package has no library and raises no error.
"""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from ssm_planner.native import library
from tests.support.paths import ROOT

COMPILED = shutil.which("cc") is not None and os.name == "posix"
needs_compiler = pytest.mark.skipif(not COMPILED, reason="no C compiler here")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a folder with copies of the C sources, `library.py` and `.native_build.py`.

    The copies compile only the portable variant, without optimisation, to save time.
    """
    folder = tmp_path / "ssm_planner/native"
    folder.mkdir(parents=True)
    for source in [*library.FOLDER.glob("*.c"), *library.FOLDER.glob("*.h")]:
        shutil.copy(source, folder)
    text = (library.FOLDER / "library.py").read_text(encoding="utf-8")
    quick = text.replace('"-O3"', '"-O0"').replace(', "avx2": ("-mavx2",)', "")
    (folder / "library.py").write_text(quick, encoding="utf-8")
    shutil.copy(ROOT / ".native_build.py", tmp_path)
    return tmp_path


def builder(checkout: Path) -> SimpleNamespace:
    """Return the functions of `.native_build.py` in a checkout."""
    return SimpleNamespace(**runpy.run_path(str(checkout / ".native_build.py")))


def loader(checkout: Path) -> SimpleNamespace:
    """Return the functions of `library.py` in a checkout, with an empty cache."""
    return SimpleNamespace(**runpy.run_path(str(checkout / "ssm_planner/native/library.py")))


@pytest.mark.slow
@needs_compiler
def test_of_the_sources_as_they_are(checkout: Path) -> None:
    """A library is compiled once for its sources, and a change of the sources invalidates it."""
    assert loader(checkout).load() is None
    result = builder(checkout).build()
    folder = checkout / "ssm_planner/native"
    assert loader(checkout).path_of("portable") in result
    assert sorted(folder.glob("libraries/*")) == sorted(result)
    times = [path.stat().st_mtime_ns for path in result]
    assert builder(checkout).build() == result
    assert [path.stat().st_mtime_ns for path in result] == times  # nothing was compiled again
    assert loader(checkout).load() is not None
    with (folder / "reachability.c").open("a") as file:
        file.write("/* another law */\n")
    assert loader(checkout).load() is None
    # A file that contains the key but cannot be loaded counts as missing.
    result[0].with_stem("other").write_bytes(loader(checkout).key().encode())
    assert not builder(checkout)._is_made("other")


@needs_compiler
def test_what_does_not_compile_is_no_library_and_no_fault(
    checkout: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Sources that do not compile leave no library, and the build reports them without an error."""
    folder = checkout / "ssm_planner/native"
    for source in folder.glob("*.c"):
        source.unlink()
    (folder / "wrong.c").write_text("this is no C\n", encoding="utf-8")
    assert builder(checkout).build() == []
    assert not list(folder.glob("libraries/*"))
    assert "without its compiled library" in capfd.readouterr().err


def test_without_a_compiler(
    checkout: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Without a compiler, the build makes no library and prints nothing."""
    monkeypatch.setenv("PATH", str(checkout))
    assert builder(checkout).build() == []
    assert loader(checkout).load() is None
    assert capfd.readouterr().err == ""


def test_the_compiler_may_have_options(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", f"{shutil.which('env')} -u NAME no-such-compiler")
    assert builder(checkout)._compiler()[1:] == ["-u", "NAME", "no-such-compiler"]
    monkeypatch.setenv("CC", " ")
    assert [Path(word).name for word in builder(checkout)._compiler()] in ([], ["cc"])


def test_a_wheel_is_of_the_system_that_is_named(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A build for another processor than x86-64 has no variant for AVX2."""
    monkeypatch.setenv("_PYTHON_HOST_PLATFORM", "manylinux_2_28_aarch64")
    shutil.copy(library.FOLDER / "library.py", checkout / "ssm_planner/native")
    requested: list[str] = []
    functions = runpy.run_path(str(checkout / ".native_build.py"))
    scope = functions["build"].__globals__
    scope |= {"_is_made": lambda name: requested.append(name) is None, "_compiler": lambda: ["cc"]}
    functions["build"]()
    assert requested == ["portable"]


@needs_compiler
def test_the_tests_run_with_it() -> None:
    """The tests load the library of the current sources.

    `make test` installs it, and `python .native_build.py` compiles it.
    """
    if not library.path_of("portable").exists():
        pytest.skip("installed without the compiled part")
    assert library.load() is not None
    assert library.load().ssm_key() == library.key().encode()


def test_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """The value 0 of the variable SSM_PLANNER_NATIVE switches the library off."""
    monkeypatch.setenv("SSM_PLANNER_NATIVE", "0")
    assert library.load() is None


@needs_compiler
def test_warnings(tmp_path: Path) -> None:
    """All C sources compile with strict warnings."""
    flags = [
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Werror",
        "-fsyntax-only",
        '-DSSM_KEY=""',
    ]
    sources = sorted(library.FOLDER.glob("*.c"))
    assert sources
    for source in sources:
        subprocess.run(["cc", *flags, str(source)], check=True)


@needs_compiler
@pytest.mark.slow
def test_every_variant_gives_the_same_bits() -> None:
    builder(ROOT).build()
    probe = """
import sys, hashlib, numpy as np
from ssm_planner.native import library
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

"""The compiled library matches the current sources, and all its variants give the same bits.

`tests/loading/test_files.py` builds the package without a compiler.
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

CMAKE = shutil.which("cmake") or shutil.which("cmake", path=str(Path(sys.executable).parent))
COMPILED = shutil.which("cc") is not None and os.name == "posix"
needs_compiler = pytest.mark.skipif(not COMPILED, reason="no C compiler here")
needs_cmake = pytest.mark.skipif(not (COMPILED and CMAKE), reason="no C compiler or no CMake here")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with copies of the C sources, their build file and `library.py`."""
    folder = tmp_path / "native"
    folder.mkdir()
    for pattern in ("*.c", "*.h", "library.py", "CMakeLists.txt"):
        for source in library.FOLDER.glob(pattern):
            shutil.copy(source, folder)
    return folder


def build(folder: Path) -> subprocess.CompletedProcess[str]:
    """Compile the portable variant of a folder as an editable install does.

    It is not optimised, to save time.
    """
    assert CMAKE is not None
    options = ["-DSKBUILD_STATE=editable", "-DCMAKE_BUILD_TYPE=None"]
    configure = [CMAKE, "-S", str(folder), "-B", str(folder / "build"), *options]
    done = subprocess.run(configure, capture_output=True, text=True)
    if done.returncode:
        return done
    build_folder = str(folder / "build")
    compile_all = [CMAKE, "--build", build_folder, "--parallel", "2", "--target", "portable"]
    return subprocess.run(compile_all, capture_output=True, text=True)


def loader(folder: Path) -> SimpleNamespace:
    """Return the functions of `library.py` in a folder, with an empty cache."""
    return SimpleNamespace(**runpy.run_path(str(folder / "library.py")))


@pytest.mark.slow
@needs_cmake
def test_a_library_belongs_to_its_sources(folder: Path) -> None:
    """A library is compiled once for its sources, and a change of the sources invalidates it."""
    assert loader(folder).load() is None
    assert build(folder).returncode == 0
    path = loader(folder).path_of("portable")
    time = path.stat().st_mtime_ns
    assert loader(folder).load() is not None
    assert build(folder).returncode == 0
    assert path.stat().st_mtime_ns == time  # nothing was compiled again
    for name in ("reachability.c", "lanes.h", "CMakeLists.txt"):
        text = (folder / name).read_bytes()
        (folder / name).write_bytes(text + b"\n")
        assert loader(folder).load() is None, name
        (folder / name).write_bytes(text)
        assert loader(folder).load() is not None
    with (folder / "identity.c").open("a") as file:
        file.write("/* another law */\n")
    assert loader(folder).load() is None
    assert build(folder).returncode == 0
    assert loader(folder).key().encode() in path.read_bytes()
    # A file that contains the key but cannot be loaded counts as missing.
    path.unlink()
    path.write_bytes(loader(folder).key().encode())
    assert loader(folder).load() is None


@needs_cmake
@pytest.mark.parametrize(("processor", "variants"), [("aarch64", 1), ("x86_64", 2)])
def test_variants_are_those_of_the_processor(folder: Path, processor: str, variants: int) -> None:
    """A build for another processor than x86-64 has no variant for AVX2."""
    target = ["-DCMAKE_SYSTEM_NAME=Linux", f"-DCMAKE_SYSTEM_PROCESSOR={processor}"]
    assert CMAKE is not None
    command = [CMAKE, "-S", str(folder), "-B", str(folder / "build"), *target]
    subprocess.run(command, check=True, capture_output=True)
    made = (folder / "build").glob("CMakeFiles/*.dir")
    assert len({path.stem for path in made} & {"portable", "avx2"}) == variants


@needs_compiler
def test_the_tests_run_with_it() -> None:
    """The tests load the library of the current sources.

    `make test` compiles and installs it.
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


@pytest.mark.slow
@pytest.mark.skipif(library.load() is None, reason="installed without the compiled part")
def test_every_variant_gives_the_same_bits() -> None:
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

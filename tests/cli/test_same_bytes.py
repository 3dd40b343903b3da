"""The command line writes the same bytes whichever numerical kernels the environment requests."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ssm_planner.native import library
from tests.support.cases import selected

ROOT = Path(__file__).parents[2]
FILES = {"manifest.json", "motion.png", "motors.png", "plan.json", "report.html", "trajectory.csv"}

pytestmark = pytest.mark.skipif(
    not library.has_avx2(), reason="the promise needs the compiled part and AVX2"
)


def planned(folder: Path, **environment: str) -> dict[str, bytes]:
    """Plan the shipped problem in a new process and return the contents of its files by name."""
    command = [sys.executable, "-m", "ssm_planner", "plan", "problems/tilt_insert.yaml", "-o"]
    outer = {k: v for k, v in os.environ.items() if not k.startswith(("OPENBLAS_", "NPY_"))}
    subprocess.run(
        [*command, str(folder)],
        cwd=ROOT,
        env={**outer, **environment},
        check=True,
        capture_output=True,
    )
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.slow
def test_kernels_and_threads_change_no_byte(tmp_path: Path) -> None:
    hook = tmp_path / "hook"
    hook.mkdir()
    (hook / "sitecustomize.py").write_text("import numpy\n", encoding="utf-8")
    nehalem = {"OPENBLAS_CORETYPE": "Nehalem", "OPENBLAS_NUM_THREADS": "1"}
    haswell = {"OPENBLAS_CORETYPE": "Haswell", "OPENBLAS_NUM_THREADS": "1"}
    environments = {
        **selected({}, every={"Nehalem": nehalem, "Haswell": haswell}),
        "SkylakeX, no AVX2 in NumPy": {
            "OPENBLAS_CORETYPE": "SkylakeX",  # It would fail without AVX-512.
            "NPY_DISABLE_CPU_FEATURES": "X86_V3",
        },
        "NumPy loads first": {
            "PYTHONPATH": str(hook),
            "OPENBLAS_CORETYPE": "Prescott",
            "OPENBLAS_NUM_THREADS": "2",
        },
    }
    expected = planned(tmp_path / "default")
    assert set(expected) == FILES
    for name, environment in environments.items():
        files = planned(tmp_path / name, **environment)
        assert {file for file in FILES if files[file] != expected[file]} == set(), name


@pytest.mark.parametrize("hook", ["", "import numpy"])
def test_the_command_line_fixes_the_kernels_before_numpy_loads(tmp_path: Path, hook: str) -> None:
    """The command line loads the fixed kernels although the environment requests others.

    A module named argcomplete reports which kernels NumPy and SciPy loaded.
    """
    (tmp_path / "sitecustomize.py").write_text(hook + "\n", encoding="utf-8")
    (tmp_path / "argcomplete.py").write_text(
        "import ctypes, glob, os, numpy, scipy.linalg\n"
        "from numpy._core._multiarray_umath import __cpu_features__ as features\n"
        "def autocomplete(parser):\n"
        "    names = []\n"
        "    for line in open('/proc/self/maps'):\n"
        "        path = line.split()[-1]\n"
        "        if 'scipy_openblas' in path:\n"
        "            names.append(path)\n"
        "    for path in sorted(set(names)):\n"
        "        suffix = '64_' if 'openblas64_' in path else ''\n"
        "        core = getattr(ctypes.CDLL(path), f'scipy_openblas_get_corename{suffix}')\n"
        "        core.restype = ctypes.c_char_p\n"
        "        print(core().decode())\n"
        "    print(any(on for name, on in features.items() if name in ('X86_V4', 'AVX512_SKX')))\n"
        "    os._exit(0)\n",
        encoding="utf-8",
    )
    environment = {
        **os.environ,
        "PYTHONPATH": str(tmp_path),
        "OPENBLAS_CORETYPE": "Nehalem",
        "_ARGCOMPLETE": "1",
    }
    done = subprocess.run(
        [sys.executable, "-c", "from ssm_planner.cli import main; main()"],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.stdout.split() == ["Haswell", "Haswell", "False"], done.stderr

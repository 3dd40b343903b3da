"""The example packages add their formats to the command line, and are documented."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from ssm_planner.plans import Plan
from tests.extensions.packages import PACKAGES, Package, install
from tests.support.cli import environment, python
from tests.support.paths import RESULTS, ROOT

RUN = """
import json, sys
from ssm_planner.cli import main
for words in json.load(sys.stdin):
    assert main(words) == 0, words
"""
LONGEST = 250
"""Largest number of lines of code of a package in one language."""
LONGER = {"guard": 400}
"""Larger numbers of lines for packages that also run without an export. The guard runs in Python
and in C.
"""
HEAVY = {"rerun"}
"""Packages that cannot export without a large dependency, which may be missing."""


@pytest.mark.slow
def test_installed_packages_add_their_formats(tmp_path: Path) -> None:
    """The command line offers and writes the formats, and `check` reads the files for ROS 2."""
    forms = {name: package.form for name, package in PACKAGES.items() if name not in HEAVY}
    commands = [
        ["export", str(RESULTS / "tilt_insert"), "--to", form, "-o", str(tmp_path / form)]
        for form in forms.values()
    ]
    check = ["check", str(tmp_path / "ros2_control"), "--robot", "vitreoretinal"]
    words = json.dumps([*commands, check])
    path = environment(PYTHONPATH=install(tmp_path / "site"))
    done = python("-c", RUN, cwd=tmp_path, env=path, input=words)
    assert done.returncode == 0, done.stderr
    for form in forms.values():
        manifest = json.loads((tmp_path / form / "manifest.json").read_text(encoding="utf-8"))
        assert manifest["kind"] == form
        assert manifest["verified"]
    offered = python("-m", "ssm_planner", "export", "--help", env=path).stdout
    assert {package.form for package in PACKAGES.values()} <= set(re.findall(r"\w+", offered))


@pytest.mark.parametrize("package", PACKAGES.values(), ids=list(PACKAGES))
def test_a_package_is_short_and_documented(package: Package) -> None:
    guide = (ROOT / "docs/export.md").read_text(encoding="utf-8")
    listed = (ROOT / "examples/README.md").read_text(encoding="utf-8")
    readme = (package.folder / "README.md").read_text(encoding="utf-8")
    assert f"`{package.form}`" in guide
    assert f"extensions/{package.folder.name}" in guide
    assert f"`extensions/{package.folder.name}`" in listed
    assert f"--to {package.form}" in readme
    assert "pip install" in readme
    lines = [
        line
        for ending in ("py", "c")
        for path in package.folder.rglob(f"*.{ending}")
        for line in path.read_text(encoding="utf-8").splitlines()
    ]
    assert max(map(len, lines)) <= 100
    for ending in ("py", "c"):
        longest = LONGER.get(package.folder.name, LONGEST)
        assert sum(map(code_lines, package.folder.rglob(f"*.{ending}"))) <= longest


def code_lines(path: Path) -> int:
    """Return the number of lines of a source file without comments, docstrings and empty lines."""
    text = path.read_text(encoding="utf-8")
    comments = r"/\*.*?\*/" if path.suffix == ".c" else r'""".*?"""|^\s*#.*?$'
    text = re.sub(comments, "", text, flags=re.S | re.M)
    return sum(bool(line.strip()) for line in text.splitlines())


PROGRAMS = {"ssm_passive.c", "ssm_mujoco.py", "CMakeLists.txt"}
"""These files do not depend on the plan."""


@pytest.mark.parametrize("name", sorted(set(PACKAGES) - HEAVY))
def test_an_unverified_plan_is_marked_in_every_file(
    name: str, exported: Callable[[str], Path], shipped: Plan, tmp_path: Path
) -> None:
    """The name or the text of every file states that the plan is unverified."""
    exported(name)
    module = PACKAGES[name].entry.partition(":")[0]
    sys.modules[module].write(shipped, None, tmp_path, "_unverified")
    files = [path for path in tmp_path.rglob("*") if path.is_file() and path.name not in PROGRAMS]
    assert files
    for path in files:
        named = path.stem.endswith("_unverified")
        assert named or "UNVERIFIED" in path.read_text(encoding="utf-8"), path

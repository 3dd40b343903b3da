"""Loading a changed file either succeeds or raises an error of this package that names the file.
Hypothesis draws the changes.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ssm_planner.errors import SsmPlannerError
from ssm_planner.loading.load import load_drive, load_problem
from tests.support.paths import PROBLEMS

SHIPPED = PROBLEMS
FILES = (
    "tilt_insert.yaml",
    "robots/vitreoretinal.yaml",
    "drives/vitreoretinal_joint1_worm.yaml",
    "drives/vitreoretinal_joint4_screw.yaml",
    "motors/maxon_ecx_torque_22_m.yaml",
    "drives/rig2_antibacklash_screw.yaml",
)
YAML = (
    "",
    " ",
    "\n",
    "  ",
    ":",
    "- ",
    "[",
    "]",
    "{",
    "}",
    ",",
    "#",
    "'",
    '"',
    "&a ",
    "*a",
    "!!int ",
    "<<: ",
    "? ",
    "|",
)
WORDS = (
    "0",
    "-1",
    "1e9",
    "1e400",
    ".nan",
    "null",
    "true",
    "yes",
    "deg",
    "mm",
    "rad",
    "N*m",
    "kg",
    " 5",
    "°",
    "to: ",
)
ODD = (
    "\0",
    "\t",
    "---\n",
    "...",
    "%",
    "@",
    "`",
    "../",
    "/",
    "value: ",
    "x" * 300,
    "😀",
    "\ud7ff",
    "\ud800",
    "\u2028",
)
PIECES = st.sampled_from(YAML + WORDS + ODD)


@st.composite
def mutated(draw: st.DrawFn) -> tuple[str, str]:
    """Draw the name of a shipped file and its text after one to four random edits."""
    name = draw(st.sampled_from(FILES))
    text = (SHIPPED / name).read_text(encoding="utf-8")
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        length = draw(st.sampled_from([0, 0, 1, 1, 2, 5, 20, 200]))
        text = text[:start] + draw(PIECES | st.text(max_size=3)) + text[start + length :]
    return name, text


@pytest.fixture(scope="module")
def folder() -> Path:
    """Yield a folder with a copy of the shipped files."""
    with tempfile.TemporaryDirectory() as root:
        shutil.copytree(SHIPPED, Path(root) / "problems")
        yield Path(root) / "problems"


@settings(
    max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(case=mutated())
@pytest.mark.slow
def test_mutated_files_load_or_are_refused(folder: Path, case: tuple[str, str]) -> None:
    name, text = case
    original = (folder / name).read_bytes()
    (folder / name).write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        message = outcome(folder, name)
    finally:
        (folder / name).write_bytes(original)
    assert message is None or message.startswith(str(folder))


def outcome(folder: Path, name: str) -> str | None:
    """Return the message of the refusal, or None if the file loads. Other exceptions propagate."""
    try:
        if "rig" in name:
            load_drive(folder / name)
        else:
            load_problem(folder / "tilt_insert.yaml")
    except SsmPlannerError as error:
        return str(error)
    return None


@st.composite
def swapped(draw: st.DrawFn) -> tuple[str, str]:
    """Draw the name of a shipped file and its text with one value replaced by another kind of
    value.
    """
    name = draw(st.sampled_from(FILES))
    lines = (SHIPPED / name).read_text(encoding="utf-8").splitlines()
    candidates = [
        i for i, line in enumerate(lines) if ": " in line and not line.lstrip().startswith("#")
    ]
    index = draw(st.sampled_from(candidates))
    values = [
        "[]",
        "{}",
        "5",
        "true",
        "text",
        "''",
        "[1, [2, {a: 3}]]",
        "{value: 1}",
        "1 mm",
        "1 deg",
        "-1e300 kg",
        "~",
    ]
    lines[index] = lines[index].partition(":")[0] + ": " + draw(st.sampled_from(values))
    return name, "\n".join(lines)


@settings(
    max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(case=swapped())
@pytest.mark.slow
def test_swapped_values_load_or_are_refused(folder: Path, case: tuple[str, str]) -> None:
    test_mutated_files_load_or_are_refused.hypothesis.inner_test(folder, case)

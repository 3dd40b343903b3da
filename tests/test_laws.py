"""The public laws of the drives agree with CasADi and with the guide for other simulators."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest

from ssm_planner import laws
from ssm_planner.loading.load import load_drive
from tests.support.cli import python
from tests.support.paths import ROOT

GUIDE = ROOT / "docs/simulation.md"
DRIVES = ("vitreoretinal_joint1_worm", "vitreoretinal_joint4_screw", "direct_drive_arm")
RNG = np.random.default_rng(12)
COUNT = 2000


@pytest.mark.parametrize("name", DRIVES)
def test_a_step_is_the_same_for_arrays_and_expressions(name: str) -> None:
    """A step of a drive gives the same values for arrays and for CasADi expressions.

    In the random cases, some drives rest, some stop within the step, and some start to move.
    """
    drive = load_drive(name)
    peak = abs(float(laws.breakaway_torque(drive, 1.0, 1.0)))
    speed = RNG.choice([0.0, 1e-3, 1.0], COUNT) * RNG.normal(0.0, 50.0, COUNT)
    rest, load = RNG.exponential(1.0, COUNT), RNG.normal(0.0, 1.0, COUNT)
    torque = RNG.normal(0.0, peak, COUNT)
    inputs = (speed, rest, torque, load)
    step = laws.drive_step(drive, *inputs, h=1e-3)
    symbols = [ca.SX.sym(letter) for letter in "wrtl"]
    expressions = vars(laws.drive_step(drive, *symbols, h=1e-3))
    function = ca.Function("step", symbols, list(expressions.values())).map(COUNT)
    for field, result in zip(expressions, function(*(row[None] for row in inputs)), strict=True):
        values = getattr(step, field)
        assert np.abs(result.full()[0] - values).max() <= 1e-12 * np.abs(values).max()
    assert 0 < np.sum(step.w == 0) < COUNT


def test_the_guide_lists_every_law_and_nothing_else() -> None:
    section = GUIDE.read_text(encoding="utf-8").partition("## The law in other simulators")[2]
    table = "\n".join(line for line in section.splitlines() if line.startswith("| `"))
    listed = set(re.findall(r"`(\w+)`", table))
    assert listed == set(laws.__all__) - {"DriveStep"}
    assert laws.__doc__ is not None
    assert listed == set(re.findall(r"^`(\w+)`", laws.__doc__, re.M))
    assert all(getattr(laws, name).__doc__ for name in listed)


def test_the_example_of_the_guide_prints_what_it_shows() -> None:
    text = GUIDE.read_text(encoding="utf-8")
    block = re.search(r"```python\n(.*?)```\n\n```text\n(.*?)```", text, re.S)
    assert block is not None
    done = python("-c", block[1])
    assert done.returncode == 0, done.stderr
    assert done.stdout == block[2]

"""Short plan for tests of the example packages `guard` and `play`.

This module makes the two packages importable.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Robot
from tests.support.paths import ROOT
from tests.support.plans import read_back, trapezoids

for name in ("guard", "play"):
    sys.path.append(str(ROOT / "examples/extensions" / name))

MOVE = np.array([0.4, -0.5, -0.3, -0.008])


def short_plan(folder: Path, robot: Robot) -> Plan:
    """Return a plan of less than a second that moves every joint."""
    return read_back(folder / "plan.json", robot, trapezoids(robot, (MOVE,)))

"""`ssm-planner ik ROBOT --tilt …`: all joint solutions of task coordinates."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from ssm_planner.cli.output import FAILED, OK, quantity_argument, show

if TYPE_CHECKING:
    from ssm_planner.kinematics.of_robot import JointSolutions


def add_arguments(parser: argparse.ArgumentParser) -> None:
    angle, length = quantity_argument("angle"), quantity_argument("length")
    parser.add_argument("robot", type=Path, help="robot file (YAML)")
    parser.add_argument("--roll", type=angle, default=0.0, help="such as 10deg (default 0)")
    parser.add_argument("--tilt", type=angle, required=True, help="such as -100deg")
    parser.add_argument("--spin", type=angle, default=0.0, help="such as 90deg (default 0)")
    parser.add_argument("--depth", type=length, default=0.0, help="such as 15mm (default 0)")
    parser.add_argument("--within-limits", action="store_true", help="only solutions within the joint ranges")
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")


def run(options: argparse.Namespace) -> int:
    from ssm_planner.kinematics.of_robot import ik
    from ssm_planner.loading.load import load_robot
    from ssm_planner.problem.limits import TASK

    robot, point = load_robot(options.robot), {name: getattr(options, name) for name in TASK}
    found = ik(robot, **point, within_limits=options.within_limits)
    show(options.json, found.to_dict(), lambda: _lines(found))
    return OK if found.reachable else FAILED


def _lines(found: JointSolutions) -> Iterator[str]:
    yield "joint 1 deg   joint 2 deg   joint 3 deg   joint 4 mm   within joint ranges"
    for q, inside in zip(found.joints, found.in_limits, strict=True):
        angles = "   ".join(f"{math.degrees(value):11.5f}" for value in q[:3])
        yield f"{angles}   {1e3 * q[3]:10.4f}   {'yes' if inside else 'no'}"
    if not found.reachable:
        off = math.degrees(found.orientation_error), 1e3 * found.tip_error
        yield f"not reachable: the nearest is off by {off[0]:.6g} deg and {off[1]:.6g} mm"

"""`ssm-planner ik ROBOT --tilt …`: all joint solutions of task coordinates."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from ssm_planner.cli.output import FAILED, OK, print_json, quantity_argument


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
    from ssm_planner.cli.kinematics import ik_command
    from ssm_planner.loading.load import load_robot

    robot = load_robot(options.robot)
    result = ik_command(
        robot, options.roll, options.tilt, options.spin, options.depth, within_limits=options.within_limits
    )
    if options.json:
        print_json(result)
    else:
        print("joint 1 deg   joint 2 deg   joint 3 deg   joint 4 mm   within joint ranges")
        for q, inside in zip(result["branches"], result["in_limits"], strict=True):
            angles = "   ".join(f"{math.degrees(value):11.5f}" for value in q[:3])
            print(f"{angles}   {1e3 * q[3]:10.4f}   {'yes' if inside else 'no'}")
        if not result["reachable"]:
            error = result["error"]
            print(
                f"not reachable: the nearest is off by {math.degrees(error['orientation']):.6g} deg "
                f"and {1e3 * error['tip']:.6g} mm"
            )
    return OK if result["reachable"] else FAILED

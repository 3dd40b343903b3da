"""Define a limit on the angular speed of the tool's axis in two places of code. Plan with the limit
and print the results as JSON.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path

import casadi

from ssm_planner.kinematics.forward import SPEED_JACOBIANS, forward_symbolic
from ssm_planner.problem.limits import SpeedLimit


@dataclasses.dataclass(frozen=True)
class AxisSpeed(SpeedLimit):
    """Limit the angular speed of the direction in which the tool points."""

    name = "axis speed"
    field = "axis_speed"
    unit = "rad/s"


# The entry precedes the import of the planner, because it would belong to kinematics/forward.py.
SPEED_JACOBIANS[AxisSpeed] = lambda mechanism, q: casadi.jacobian(
    forward_symbolic(mechanism, q)[0][:, 2], q
)


def main(problem_file: str, kind: str, largest: float, folder: str) -> None:
    """Plan with the limit, read the plan back, write its report, and print the results as JSON."""
    import ssm_planner
    from ssm_planner.plans import load_plan
    from ssm_planner.problem.motion import Free, Straight
    from ssm_planner.reporting.html.report import write_report

    problem = ssm_planner.load_problem(problem_file)
    end = problem.motion[0].to
    motion = Free(end) if kind == "free" else Straight(**end.set_coordinates)
    problem = dataclasses.replace(problem, objective="time", motion=(motion,))
    limited = AxisSpeed(largest).on(problem)
    free, result = ssm_planner.plan(problem), ssm_planner.plan(limited)
    found = next(item for item in result.certificate.limits if item.name == AxisSpeed.name)
    file = result.write(Path(folder) / "plan.json")
    again = load_plan(file)
    page = write_report(again, Path(folder) / "report.html").read_text(encoding="utf-8")
    tightened = AxisSpeed(largest).tightened(1.01 * largest, largest)
    outcome = {
        "passed": result.passed,
        "slower": result.duration / free.duration,
        "worst": found.worst / largest,
        "read back": AxisSpeed(largest) in again.problem.limits,
        "checked again": ssm_planner.check(again.motion, again.robot, again.limits).passed,
        "on the page": "Axis speed" in page,
        "tightened": tightened.largest / largest,
        "in words": AxisSpeed(largest).described(2 * largest),
    }
    print(json.dumps(outcome))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), sys.argv[4])

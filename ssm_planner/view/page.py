"""The local view's page, and what it asks about a mechanism: its workspace, and the joints of a pose (JSON types)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.errors import GeometryError, ProblemError
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.workspace import design_region, tilt_interval
from ssm_planner.problem.limits import TASK
from ssm_planner.problem.motion import Dwell, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.reporting.figures.style import COLOURS
from ssm_planner.reporting.html.page import render
from ssm_planner.reporting.html.scene import link_sides, mechanism_scene
from ssm_planner.typing import Range
from ssm_planner.units import shown

PUBLISHED = math.radians(30.0), math.radians(109.778)
"""α and β of the paper's robot, for a page without a problem."""
SAME = 1e-9
"""rad within which α and β count as those of the robot."""
Pose = tuple[float, float, float, float]
"""Roll, tilt, spin and depth, rad and m."""
MARGINS = tuple(math.radians(degrees) for degrees in (5.0, 2.0, 1.0))
"""By which suggested α and β reach beyond the range, best first."""
LOWEST, HIGHEST = math.radians(1.0), math.radians(179.0)


def _written(point: Any) -> dict[str, str]:
    """Task coordinates of a point as a problem file has them."""
    return {
        name: _in_units(name, getattr(point, name))
        for name in TASK
        if getattr(point, name) is not None
    }


def _in_units(name: str, value: float) -> str:
    return f"{1e3 * value:.12g} mm" if name == "depth" else f"{math.degrees(value):.14g} deg"


def view_page(start: dict[str, Any], token: str) -> str:
    """The HTML document; start: Study.start(), token: what every POST must carry."""
    title = f"{start['name']} – mechanism" if start["name"] else "Mechanism"
    return render(
        "view.html", {"start": start, "token": token, "colours": list(COLOURS)}, title=title
    )


@dataclass(frozen=True, eq=False)
class Study:
    """A problem whose robot is looked at, or none: then the paper's mechanism without limits or motors."""

    problem: Problem | None

    @property
    def own(self) -> Mechanism:
        """The mechanism with the robot's own angles."""
        if self.problem is None:
            return Mechanism.from_angles(*PUBLISHED)
        return Mechanism.from_geometry(self.problem.robot.geometry)

    def mechanism(self, request: Mapping[str, Any]) -> tuple[Mechanism, bool]:
        """The mechanism of the request's alpha and beta, and whether it is the robot's own. Raises ProblemError."""
        own = self.own
        alpha, beta = (number(request, key, LOWEST, HIGHEST) for key in ("alpha", "beta"))
        if abs(alpha - own.alpha) < SAME and abs(beta - own.beta) < SAME:
            return own, True
        return Mechanism.from_angles(alpha, beta, insertion_sign=own.insertion_sign), False

    def start(self) -> dict[str, Any]:
        """What the page needs before it asks: angles, ranges, joints, the problem's start."""
        own = self.own
        low, high = tilt_interval(own)
        ranges = {} if self.problem is None else dict(self.problem.ranges)
        start = None if self.problem is None else self.problem.start
        begin = start.given if isinstance(start, Task) else {}
        pose = [begin.get(name, own.home_tilt if name == "tilt" else 0.0) for name in TASK]
        joints = None if self.problem is None else self.problem.robot.joints
        return {
            "alpha": own.alpha,
            "beta": own.beta,
            "tilt_range": list(ranges.get("tilt", (low, high))),
            "depth_range": list(ranges.get("depth", (0.0, 0.03))),
            "pose": pose,
            "joints": ["roll", "tilt", "spin", "insertion"]
            if joints is None
            else [joint.name for joint in joints],
            "can_plan": self.problem is not None,
            "name": None if self.problem is None else self.problem.name,
        }

    def workspace(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """{alpha, beta, tilt_range} → {tilt_range, reached, margin, own, scene}."""
        mechanism, own = self.mechanism(request)
        wanted = tilt_range(request)
        low, high = tilt_interval(mechanism)
        margin = min(wanted[0] - low, high - wanted[1])
        ranges: dict[str, Range] = {} if self.problem is None else dict(self.problem.ranges)
        eye = None if self.problem is None else self.problem.eye
        sides = (
            link_sides(self.problem.robot, mechanism) if own and self.problem is not None else None
        )
        return {
            "tilt_range": [low, high],
            "reached": margin >= 0.0,
            "margin": margin,
            "own": own,
            "scene": mechanism_scene(mechanism, {**ranges, "tilt": wanted}, sides, eye),
        }

    def suggest(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """{tilt_range} → {alpha, beta}: the smallest α that reaches the range with most of MARGINS. Raises ProblemError."""
        wanted = tilt_range(request)
        for margin in MARGINS:
            try:
                region = design_region(*wanted, margin)
            except GeometryError as error:
                raise ProblemError(
                    "no α and β reach a range on both sides of 0°",
                    key="tilt_range",
                    allowed="both ends of one sign",
                ) from error
            alpha, beta = region.smallest_alpha
            if not region.empty and alpha >= LOWEST and beta <= HIGHEST:
                return {"alpha": alpha, "beta": beta, "margin": margin}
        raise ProblemError("no α and β reach this range", key="tilt_range")

    def problem_file(self, problem: Problem) -> dict[str, Any]:
        """The YAML of a motion made in the view, with what the view's problem file says besides. Raises ProblemError."""
        import yaml

        file = (
            None if self.problem is None or self.problem.file is None else Path(self.problem.file)
        )
        if file is None or not file.is_file():
            raise ProblemError("the problem was not read from a file")
        document = yaml.safe_load(file.read_text(encoding="utf-8"))
        beside = file.parent / str(document["robot"])
        if beside.is_file():
            document["robot"] = str(beside.resolve())
        document["start"] = _written(problem.start)
        document["motion"] = [
            {"dwell": f"{step.duration:.12g} s"}
            if isinstance(step, Dwell)
            else {"straight": {"to": _written(step)}}
            for step in problem.motion
        ]
        low, high = problem.ranges["tilt"]
        document.setdefault("limits", {})["tilt"] = [
            _in_units("tilt", low),
            _in_units("tilt", high),
        ]
        return {"text": yaml.safe_dump(document, sort_keys=False, allow_unicode=True)}

    def ik(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """{alpha, beta, pose} → {reachable, error, branches: [{joints, branch, in_limits, tip}]}, nearest to home first."""
        mechanism, _ = self.mechanism(request)
        limits = None
        if self.problem is not None:
            limits = np.array([joint.position for joint in self.problem.robot.joints])
        found = inverse_task(
            mechanism, [pose(request, "pose")], limits=limits, reference=np.zeros(4)
        )
        tips = tip_position(mechanism, found.joints[0])
        return {
            "reachable": bool(found.reachable[0]),
            "error": float(found.orientation_error[0]),
            "branches": [
                {
                    "joints": found.joints[0, k].tolist(),
                    "branch": int(found.branch[0, k]),
                    "in_limits": bool(found.in_limits[0, k]),
                    "tip": tips[k].tolist(),
                }
                for k in range(found.joints.shape[1])
            ],
        }


def number(
    request: Mapping[str, Any], key: str, low: float, high: float, unit: str = "rad"
) -> float:
    """A finite number of a request within its range; unit: SI. Raises ProblemError."""
    return _checked(request.get(key), key, low, high, unit)


def pose(request: Mapping[str, Any], key: str) -> Pose:
    """Four task coordinates, rad and m. Raises ProblemError."""
    values = request.get(key)
    if not isinstance(values, list) or len(values) != len(TASK):
        raise ProblemError("not a pose", key=key, value=values, allowed="[roll, tilt, spin, depth]")
    reach = {
        "roll": (4 * math.pi, "rad"),
        "tilt": (math.pi, "rad"),
        "spin": (4 * math.pi, "rad"),
        "depth": (1.0, "m"),
    }
    named = [
        (value, f"{key}.{name}", *reach[name]) for name, value in zip(TASK, values, strict=True)
    ]
    roll, tilt, spin, depth = (
        _checked(value, name, -most, most, unit) for value, name, most, unit in named
    )
    return roll, tilt, spin, depth


def tilt_range(request: Mapping[str, Any]) -> Range:
    """The tilt range asked for, rad. Raises ProblemError."""
    ends = request.get("tilt_range")
    if not isinstance(ends, list) or len(ends) != 2:
        raise ProblemError("not a range", key="tilt_range", value=ends, allowed="[low, high]")
    low, high = (_checked(end, "tilt_range", -math.pi, math.pi, "rad") for end in ends)
    if not low < high:
        raise ProblemError("the lower end is not below the upper", key="tilt_range")
    return low, high


def _checked(value: object, key: str, low: float, high: float, si: str) -> float:
    """A number in its range; one that is out of it by rounding is its end."""
    unit, scale = shown(si, "°")
    allowed = f"{scale * low:.6g} to {scale * high:.6g} {unit}"
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        raise ProblemError("not a number", key=key, value=value, allowed=allowed)
    if not low - SAME <= value <= high + SAME:
        raise ProblemError(f"{scale * value:.6g} {unit} is out of range", key=key, allowed=allowed)
    return min(max(float(value), low), high)

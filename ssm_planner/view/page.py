"""Render the local view's page and answer its questions about a mechanism, in JSON types."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.errors import GeometryError, ProblemError
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.workspace import design_region, tilt_interval
from ssm_planner.loading.files import follow, of_data, read, shipped_names
from ssm_planner.loading.robots import robot_from
from ssm_planner.problem.limits import TASK
from ssm_planner.problem.motion import Dwell, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.reporting.figures.style import COLOURS
from ssm_planner.reporting.html.page import render
from ssm_planner.reporting.html.scene import link_sides, mechanism_scene
from ssm_planner.studies.study_file import robot_content
from ssm_planner.typing import Range, record
from ssm_planner.units import display_unit

PUBLISHED = math.radians(30.0), math.radians(109.778)
"""α and β of the paper's robot, for a page without a problem."""
SAME = 1e-9
"""Tolerance for α and β of the robot, rad."""
Pose = tuple[float, float, float, float]
"""Roll, tilt, spin and depth, rad and m."""
MARGINS = tuple(math.radians(degrees) for degrees in (5.0, 2.0, 1.0))
"""Margins of the tilt range for suggested α and β, rad, largest first."""
LOWEST, HIGHEST = math.radians(1.0), math.radians(179.0)


def _coordinates(point: Any) -> dict[str, str]:
    """Return the task coordinates of a point as a problem file states them."""
    return {
        name: _in_units(name, getattr(point, name))
        for name in TASK
        if getattr(point, name) is not None
    }


def _in_units(name: str, value: float) -> str:
    """Return a task coordinate with its unit."""
    return f"{1e3 * value:.12g} mm" if name == "depth" else f"{math.degrees(value):.14g} deg"


def view_page(start: dict[str, Any], token: str) -> str:
    """Return the HTML document. start: Study.start(); token: secret that every POST must carry."""
    title = f"{start['name']} – mechanism" if start["name"] else "Mechanism"
    return render(
        "view.html", {"start": start, "token": token, "colours": list(COLOURS)}, title=title
    )


@record
class Study:
    """State of the view.

    problem: a problem with a robot, or None for the paper's mechanism without limits and motors.
    """

    problem: Problem | None

    @property
    def own(self) -> Mechanism:
        """Return the mechanism with the robot's own angles."""
        if self.problem is None:
            return Mechanism.from_angles(*PUBLISHED)
        return Mechanism.from_geometry(self.problem.robot.geometry)

    def mechanism(self, request: Mapping[str, Any]) -> tuple[Mechanism, bool]:
        """Return the mechanism with the request's angles, and whether it is the robot's own.

        Raises ProblemError.
        """
        original = self.own
        alpha, beta = (number(request, key, LOWEST, HIGHEST) for key in ("alpha", "beta"))
        if abs(alpha - original.alpha) < SAME and abs(beta - original.beta) < SAME:
            return original, True
        share = math.cos(beta) / math.cos(alpha)  # of cos(home tilt), where the roll at home is 0
        home = math.copysign(math.acos(share), original.home_tilt) if abs(share) <= 1.0 else None
        sign = original.insertion_sign
        return Mechanism.from_angles(alpha, beta, home, insertion_sign=sign), False

    def robot_file(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Return the content of the problem's robot file with the angles of a request.

        Its roll at q = 0 stays 0, so that its tilt at q = 0 follows from cos β = cos α cos φ.
        Raises ProblemError.
        """
        file = None if self.problem is None else self.problem.file
        if file is None or not Path(file).is_file():
            raise ProblemError("the problem was not read from a file")
        mechanism, _ = self.mechanism(request)
        content = robot_content(follow(read(Path(file)), "robot"))
        if "home_tilt" not in content["geometry"] or abs(mechanism.home_roll) > SAME:
            raise ProblemError(
                "the frames of the robot's links do not follow these angles",
                key="beta",
                allowed="β between α and 180° − α, and a robot file with alpha and home_tilt",
            )
        geometry = {
            name: _in_units(name, getattr(mechanism, name)) for name in ("alpha", "home_tilt")
        }
        content["geometry"] = {**content["geometry"], **geometry}
        content["geometry"].pop("beta", None)
        changed = f"α {math.degrees(mechanism.alpha):.6g}°, β {math.degrees(mechanism.beta):.6g}°"
        content["name"] = f"{content.get('name', 'robot')} with {changed}"
        return content

    def robot(self, original: Robot, request: Mapping[str, Any]) -> Robot:
        """Return the robot of the problem with the angles of a request.

        Its links keep their masses and shapes. Their frames follow the angles. Raises ProblemError.
        """
        if self.mechanism(request)[1]:
            return original
        turned = robot_from(of_data(self.robot_file(request)))
        first, second, third, fourth = (
            replace(body, frame=other.frame)
            for body, other in zip(original.bodies, turned.bodies, strict=True)
        )
        bodies = first, second, third, fourth
        return replace(original, name=turned.name, geometry=turned.geometry, bodies=bodies)

    def start(self) -> dict[str, Any]:
        """Return the initial values of the page, such as angles, ranges and joints."""
        mechanism = self.own
        low, high = tilt_interval(mechanism)
        ranges = {} if self.problem is None else dict(self.problem.ranges)
        start = None if self.problem is None else self.problem.start
        coordinates = start.set_coordinates if isinstance(start, Task) else {}
        pose = [
            coordinates.get(name, mechanism.home_tilt if name == "tilt" else 0.0) for name in TASK
        ]
        joints = None if self.problem is None else self.problem.robot.joints
        return {
            "alpha": mechanism.alpha,
            "beta": mechanism.beta,
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
        """Answer {alpha, beta, tilt_range} with {tilt_range, reached, margin, own, scene}.

        Raises ProblemError.
        """
        mechanism, own = self.mechanism(request)
        required = tilt_range(request)
        low, high = tilt_interval(mechanism)
        margin = min(required[0] - low, high - required[1])
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
            "scene": mechanism_scene(mechanism, {**ranges, "tilt": required}, sides, eye),
        }

    def suggest(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Answer {tilt_range} with {alpha, beta, margin}.

        The result is the smallest α that reaches the range with the largest possible entry of
        MARGINS. Raises ProblemError.
        """
        required = tilt_range(request)
        for margin in MARGINS:
            try:
                region = design_region(*required, margin)
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

    def problem_file(self, request: Mapping[str, Any], problem: Problem) -> dict[str, Any]:
        """Return the YAML of a motion from the view, completed by the view's problem file.

        The file holds the robot if its angles have changed. Raises ProblemError.
        """
        import yaml

        file = (
            None if self.problem is None or self.problem.file is None else Path(self.problem.file)
        )
        if file is None or not file.is_file():
            raise ProblemError("the problem was not read from a file")
        document = yaml.safe_load(file.read_text(encoding="utf-8"))
        robot = Path(str(document["robot"]))
        shipped = shipped_names("robots").get(robot.stem)
        if shipped is not None and (file.parent / robot).resolve() == shipped.resolve():
            document["robot"] = robot.stem  # The name also works in another folder.
        if self.problem is not None and problem.robot is not self.problem.robot:
            document["robot"] = self.robot_file(request)
        document["start"] = _coordinates(problem.start)
        document["motion"] = [
            {"dwell": f"{step.duration:.12g} s"}
            if isinstance(step, Dwell)
            else {"straight": {"to": _coordinates(step)}}
            for step in problem.motion
        ]
        low, high = problem.ranges["tilt"]
        document.setdefault("limits", {})["tilt"] = [
            _in_units("tilt", low),
            _in_units("tilt", high),
        ]
        return {"text": yaml.safe_dump(document, sort_keys=False, allow_unicode=True)}

    def ik(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Answer {alpha, beta, pose} with {reachable, error, branches}.

        branches: [{joints, branch, in_limits, tip}], in the order of their distance from home.
        Raises ProblemError.
        """
        mechanism, _ = self.mechanism(request)
        limits = None
        if self.problem is not None:
            limits = np.array([joint.position for joint in self.problem.robot.joints])
        solutions = inverse_task(
            mechanism, [pose(request, "pose")], limits=limits, reference=np.zeros(4)
        )
        tips = tip_position(mechanism, solutions.joints[0])
        return {
            "reachable": bool(solutions.reachable[0]),
            "error": float(solutions.orientation_error[0]),
            "branches": [
                {
                    "joints": solutions.joints[0, k].tolist(),
                    "branch": int(solutions.branch[0, k]),
                    "in_limits": bool(solutions.in_limits[0, k]),
                    "tip": tips[k].tolist(),
                }
                for k in range(solutions.joints.shape[1])
            ],
        }


def number(
    request: Mapping[str, Any], key: str, low: float, high: float, unit: str = "rad"
) -> float:
    """Return a finite number of a request within a range; unit: SI unit of the range.

    Raises ProblemError.
    """
    return _number_within(request.get(key), key, low, high, unit)


def pose(request: Mapping[str, Any], key: str) -> Pose:
    """Return four task coordinates of a request, rad and m. Raises ProblemError."""
    values = request.get(key)
    if not isinstance(values, list) or len(values) != len(TASK):
        raise ProblemError("not a pose", key=key, value=values, allowed="[roll, tilt, spin, depth]")
    reach = {
        "roll": (4 * math.pi, "rad"),
        "tilt": (math.pi, "rad"),
        "spin": (4 * math.pi, "rad"),
        "depth": (1.0, "m"),
    }
    bounded = [
        (value, f"{key}.{name}", *reach[name]) for name, value in zip(TASK, values, strict=True)
    ]
    roll, tilt, spin, depth = (
        _number_within(value, name, -largest, largest, unit)
        for value, name, largest, unit in bounded
    )
    return roll, tilt, spin, depth


def tilt_range(request: Mapping[str, Any]) -> Range:
    """Return the tilt range of a request, rad. Raises ProblemError."""
    ends = request.get("tilt_range")
    if not isinstance(ends, list) or len(ends) != 2:
        raise ProblemError("not a range", key="tilt_range", value=ends, allowed="[low, high]")
    low, high = (_number_within(end, "tilt_range", -math.pi, math.pi, "rad") for end in ends)
    if not low < high:
        raise ProblemError("the lower end is not below the upper", key="tilt_range")
    return low, high


def _number_within(value: object, key: str, low: float, high: float, si: str) -> float:
    """Return a number within its range; rounding beyond an end gives the end.

    Raises ProblemError.
    """
    unit, scale = display_unit(si, "°")
    allowed = f"{scale * low:.6g} to {scale * high:.6g} {unit}"
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        raise ProblemError("not a number", key=key, value=value, allowed=allowed)
    if not low - SAME <= value <= high + SAME:
        raise ProblemError(f"{scale * value:.6g} {unit} is out of range", key=key, allowed=allowed)
    return min(max(float(value), low), high)

"""Render the page of the local view, and answer its requests about a mechanism.

A request is a JSON object that the script of the page sends. The methods of `ViewedProblem` state
the keys of their requests and answers, which consist of JSON types in SI units and rad.
"""

import copy
import math
from collections.abc import Mapping
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.errors import GeometryError, ProblemError
from ssm_planner.kinematics import (
    Mechanism,
    design_region,
    inverse_task,
    tilt_interval,
    tip_position,
)
from ssm_planner.loading import (
    Section,
    follow_reference,
    node_from_data,
    number_or_text,
    problem_from,
    read_catalogue,
    read_section,
    section_from_text,
    shipped_folder,
)
from ssm_planner.problem import JOINTS, TASK_COORDINATES, Problem, Task
from ssm_planner.reporting import COLOURS, link_sides, mechanism_scene, render_page
from ssm_planner.studies.study import GEAR_KEYS, Choice, Variable, Varied, robot_with_design
from ssm_planner.studies.study_file import resolved_robot_content
from ssm_planner.typing import JsonObject, Range, record
from ssm_planner.units import display_unit, parse_quantity

PAPER_ANGLES = math.radians(30.0), math.radians(109.778)
"""Angles α and β of the paper's robot, rad. A page without a problem shows this robot."""
ANGLE_TOLERANCE = 1e-9
"""Largest difference of angles α and β that count as equal to those of the robot, rad.

Numbers in requests may exceed their range by the same amount.
"""
Pose = tuple[float, float, float, float]
"""Roll, tilt and spin in rad, and depth in m."""
SUGGESTED_MARGINS = tuple(math.radians(degrees) for degrees in (5.0, 2.0, 1.0))
"""Margins of the tilt range that suggested angles α and β should keep, rad, largest first."""
ADJUSTABLE_KEYS = (("geometry", "ratio"), ("geometry", "lead"), ("friction", "mu"))
"""Groups and keys of the quantities of a drive that a user can change on the page."""
MAX_ADJUSTMENT_FACTOR = 3.0
"""Largest factor by which a user can change such a quantity, up or down."""
MAX_DWELL = 3600.0
"""Longest dwell in a request, s."""
MAX_PAYLOAD = 0.5
"""Largest payload in a request, kg."""
MAX_POSE: Pose = 4 * math.pi, math.pi, 4 * math.pi, 1.0
"""Largest magnitudes of roll, tilt and spin (rad) and of the depth (m) in a request."""
MIN_ANGLE, MAX_ANGLE = math.radians(1.0), math.radians(179.0)
"""Smallest and largest angle α or β in a request, rad."""


def _pose_entry(pose: Pose) -> dict[str, str]:
    """Return a pose as texts with units by name of the coordinate, as in a problem file."""
    return {
        name: _coordinate_text(name, value)
        for name, value in zip(TASK_COORDINATES, pose, strict=True)
    }


def _stated_value(value: Any) -> Any:
    """Return the value of an entry, which may be a mapping with the value and its source."""
    return value["value"] if isinstance(value, dict) else value


def _coordinate_text(name: str, value: float) -> str:
    """Format a task coordinate (rad or m) as text with its unit."""
    return f"{1e3 * value:.12g} mm" if name == "depth" else f"{math.degrees(value):.14g} deg"


def view_page(page: "ViewedProblem", token: str) -> str:
    """Render the HTML document of a page.

    Parameters
    ----------
    page : ViewedProblem
        Problem that the page shows.
    token : str
        Secret that every POST request of the page must contain.

    Returns
    -------
    str
        Text of the page.
    """
    start = page.start()
    return render_page(
        "view.html",
        {"start": start, "token": token, "colours": list(COLOURS)},
        title=f"{start['name']} – mechanism" if start["name"] else "Mechanism",
        page=page,
        start=start,
    )


@record
class ViewedProblem:
    """The problem that a page of the view shows, with the answers to requests of this page.

    Attributes
    ----------
    problem : Problem or None
        A problem with a robot. None means the paper's mechanism without limits and motors.
    edited : Section or None
        Content that a user has edited. It replaces that of the problem's file.
    """

    problem: Problem | None
    edited: Section | None = None

    @property
    def ranges(self) -> Mapping[str, Range]:
        """Ranges of the task coordinates that the problem permits, rad or m."""
        return {} if self.problem is None else self.problem.ranges

    @property
    def robot_mechanism(self) -> Mechanism:
        """Mechanism with the angles of the original robot."""
        if self.problem is None:
            return Mechanism.from_angles(*PAPER_ANGLES)
        return Mechanism.from_robot(self.problem.robot)

    def mechanism(self, request: JsonObject) -> tuple[Mechanism, bool]:
        """Return the mechanism with the angles of a request.

        Parameters
        ----------
        request : dict
            `alpha` and `beta`, rad.

        Returns
        -------
        mechanism : Mechanism
            Mechanism with these angles. The roll at q = 0 is 0 unless the angles are those of the
            robot.
        is_original : bool
            True if the angles are those of the robot.

        Raises
        ------
        ProblemError
            If an angle is out of range.
        """
        original = self.robot_mechanism
        alpha = requested_number(request, "alpha", MIN_ANGLE, MAX_ANGLE)
        beta = requested_number(request, "beta", MIN_ANGLE, MAX_ANGLE)
        change = max(abs(alpha - original.alpha), abs(beta - original.beta))
        if change < ANGLE_TOLERANCE:
            return original, True
        # With a roll of 0 at q = 0, the tilt φ at q = 0 satisfies cos φ = cos β / cos α.
        cosine = math.cos(beta) / math.cos(alpha)
        home_tilt = None
        if abs(cosine) <= 1.0:
            home_tilt = math.copysign(math.acos(cosine), original.home_tilt)
        sign = original.insertion_sign
        return Mechanism.from_angles(alpha, beta, home_tilt, insertion_sign=sign), False

    @cached_property
    def document(self) -> JsonObject:
        """Content of the problem file, including the content of its robot, drives and motors.

        It does not depend on other files. Raises ProblemError if the problem was not read from a
        file.
        """
        file = self.edited or read_section(self._file)
        name = {} if self.problem is None else {"name": self.problem.name}
        return (
            name | file.value | {"robot": resolved_robot_content(follow_reference(file, "robot"))}
        )

    def edit(self, text: str) -> "ViewedProblem":
        """Return the page for a text that replaces the problem file.

        Parameters
        ----------
        text : str
            YAML in the form of a problem file.

        Returns
        -------
        ViewedProblem
            The page of the edited problem.

        Raises
        ------
        ProblemError
            If the text is invalid.
        """
        section = Section(self._file, section_from_text(text).root)
        return ViewedProblem(problem_from(section), section)

    @property
    def _file(self) -> Path:
        """Path of the problem file. Raises ProblemError if the problem was not read from a file."""
        file = None if self.problem is None else self.problem.file
        if file is None or not Path(file).is_file():
            raise ProblemError(
                "planning needs a robot with drives: start the view with a problem file"
            )
        return Path(file)

    @cached_property
    def variables(self) -> tuple[Variable, ...]:
        """Quantities that a user can change: motors, gears, ratios, leads and friction.

        They have the form of the variables of a study. The first entry of each choice has the name
        "" and is the present motor or gear.
        """
        folder = shipped_folder()
        motors = read_catalogue(folder / "motors") | read_catalogue(
            folder / "catalogues" / "motors_24v.csv"
        )
        variables: list[Variable] = []
        for name, joint in self.document["robot"]["joints"].items():
            if "motor" in joint:
                present = {"": joint["motor"]}
                variables.append(Choice(f"joints.{name}.motor", present | motors))
            drive = joint.get("drive", {})
            for gear in GEAR_KEYS:
                if drive.get("kind", "").endswith(gear):
                    catalogue = read_catalogue(folder / "catalogues" / f"{gear}s.csv", gear=True)
                    present = {"": {"name": drive["name"]}}
                    variables.append(Choice(f"joints.{name}.drive.{gear}", present | catalogue))
            for group, key in ADJUSTABLE_KEYS:
                value = drive.get(group, {}).get(key)
                text, _, unit = str(_stated_value(value)).partition(" ")
                with suppress(ValueError):
                    number = float(text)
                    path = f"joints.{name}.drive.{group}.{key}"
                    ends = number / MAX_ADJUSTMENT_FACTOR, number * MAX_ADJUSTMENT_FACTOR
                    variables.append(Varied(path, *ends, unit))
        return tuple(variables)

    @cached_property
    def stand_ins(self) -> dict[str, str]:
        """Assumed figures of the motors as text, by their path in the robot file."""
        stand_ins = {}
        for joint in self.problem.robot.joints if self.problem is not None else ():
            for name in joint.motor.placeholders if joint.motor is not None else ():
                entry = self.document["robot"]["joints"][joint.name]["motor"][name]
                stand_ins[f"joints.{joint.name}.motor.{name}"] = str(_stated_value(entry))
        return stand_ins

    def _robot_with_figures(self, figures: Mapping[str, str]) -> JsonObject:
        """Replace assumed figures of motors by figures that the user has entered.

        A motor file may mark all its figures as placeholders at once. This mark is replaced by a
        mark for each figure that remains assumed.

        Parameters
        ----------
        figures : mapping of str
            Text of each entered figure by its path, such as "joints.roll.motor.rotor_inertia".

        Returns
        -------
        dict
            Content of the robot file.
        """
        robot = copy.deepcopy(self.document["robot"])
        for path in self.stand_ins if figures else ():
            _, joint, _, name = path.split(".")
            motor = robot["joints"][joint]["motor"]
            motor.pop("placeholder", None)
            entry = motor[name] if isinstance(motor[name], dict) else {"value": motor[name]}
            motor[name] = entry | {"placeholder": True}
            if path in figures:
                motor[name] = {
                    "value": number_or_text(figures[path]),
                    "source": "entered in the view",
                }
        return robot

    def changed_robot(self, request: JsonObject) -> JsonObject:
        """Return the content of the robot file with the angles and the design of a request.

        Static friction keeps its ratio to kinetic friction. The roll at q = 0 stays 0, so the tilt
        φ at q = 0 follows from cos β = cos α cos φ, where α and β are the requested angles. Links
        keep their masses and shapes, and their frames follow the angles.

        Parameters
        ----------
        request : dict
            `alpha` and `beta` (rad), and `design`, which gives values to `variables` and to assumed
            figures (`stand_ins`), by path.

        Returns
        -------
        dict
            Content of the robot file.

        Raises
        ------
        ProblemError
            If a value is invalid, or if the frames of the links cannot follow the angles.
        """
        mechanism, is_original = self.mechanism(request)
        design = self._design(request)
        figures = {path: design.pop(path) for path in self.stand_ins if path in design}
        changes = [f"{path.removeprefix('joints.')} {text}" for path, text in design.items()]
        changes += ["entered motor figures"] * bool(figures)
        content = self._robot_with_figures(figures)
        for path in [path for path in design if path.endswith(".mu")]:
            friction = content["joints"][path.split(".")[1]]["drive"]["friction"]
            factor = float(design.pop(path)) / _stated_value(friction["mu"])
            for key in friction.keys() & {"mu", "mu_static"}:
                entry = friction[key] if isinstance(friction[key], dict) else {}
                # An assumed coefficient that is changed on the page is still an assumption.
                friction[key] = {
                    "value": factor * _stated_value(friction[key]),
                    "placeholder": entry.get("placeholder", False),
                }
        if not is_original:
            if "home_tilt" not in content["geometry"] or abs(mechanism.home_roll) > ANGLE_TOLERANCE:
                raise ProblemError(
                    "the frames of the robot's links do not follow these angles",
                    key="beta",
                    allowed="β between α and 180° − α, and a robot file with alpha and home_tilt",
                )
            for name in ("alpha", "home_tilt"):
                design[f"geometry.{name}"] = _coordinate_text(name, getattr(mechanism, name))
            angles = math.degrees(mechanism.alpha), math.degrees(mechanism.beta)
            changes.insert(0, "α {:.6g}°, β {:.6g}°".format(*angles))
        contents = {
            choice.path: choice.contents for choice in self.variables if isinstance(choice, Choice)
        }
        content = robot_with_design(content, contents, design)
        if not is_original:
            content["geometry"].pop("beta", None)
        return content | {"name": f"{content.get('name', 'robot')} with {', '.join(changes)}"}

    def _design(self, request: JsonObject) -> dict[str, str]:
        """Check the values that a request gives to variables and assumed figures.

        Parameters
        ----------
        request : dict
            `design` contains the values by path.

        Returns
        -------
        dict of str
            Values as texts by path.

        Raises
        ------
        ProblemError
            If a value is invalid, or if a path is unknown.
        """
        values = request.get("design") or {}
        paths: dict[str, Variable | str] = {variable.path: variable for variable in self.variables}
        paths |= self.stand_ins
        if not isinstance(values, dict) or values.keys() - paths.keys():
            raise ProblemError("not a design", key="design", allowed=", ".join(paths))
        design = {}
        for path, value in values.items():
            variable = paths[path]
            if isinstance(variable, Varied):
                size = requested_number(values, path, variable.low, variable.high, variable.unit)
                design[path] = f"{size:.12g} {variable.unit}".rstrip()
            elif isinstance(value, str) and (
                isinstance(variable, str) or value in variable.contents
            ):
                design[path] = value
            else:
                raise ProblemError("no such part or figure", key=path, value=value)
        return design

    def start(self) -> JsonObject:
        """Return the initial values of the page.

        Returns
        -------
        dict
            `values` contains the angles, the pose and the tilt range (rad and m), the payload (kg)
            and the parts. The other keys are `depth_range` (m), `joints`, `can_plan` and `name`.
        """
        mechanism = self.robot_mechanism
        low, high = tilt_interval(mechanism)
        problem = self.problem
        start = None if problem is None else problem.start
        coordinates = start.set_coordinates if isinstance(start, Task) else {}
        ends = self.ranges.get("tilt", (low, high))
        values: JsonObject = {"alpha": mechanism.alpha, "beta": mechanism.beta}
        values |= {"low": ends[0], "high": ends[1]}
        values |= dict.fromkeys(TASK_COORDINATES, 0.0) | {"tilt": mechanism.home_tilt} | coordinates
        if problem is not None:
            values["payload"] = parse_quantity(self.document.get("tip_payload", "0 kg"), "mass")
            values |= dict.fromkeys(self.stand_ins, "")
            for variable in self.variables:
                values[variable.path] = (
                    variable.low * MAX_ADJUSTMENT_FACTOR if isinstance(variable, Varied) else ""
                )
        return {
            "values": values,
            "depth_range": list(self.ranges.get("depth", (0.0, 0.03))),
            "joints": list(JOINTS),
            "can_plan": problem is not None,
            "name": None if problem is None else problem.name,
        }

    def workspace(self, request: JsonObject) -> JsonObject:
        """Answer a request about the workspace of a mechanism.

        Parameters
        ----------
        request : dict
            `alpha`, `beta` and the required `tilt_range`, rad.

        Returns
        -------
        dict
            `tilt_range` is the range that the mechanism reaches, and `margin` the smaller distance
            of the required range from its ends, rad. `reached` is true if the margin is not
            negative. `own` is true if the angles are those of the robot. `scene` describes the 3D
            view.

        Raises
        ------
        ProblemError
            If a value is invalid.
        """
        mechanism, is_original = self.mechanism(request)
        required = requested_tilt_range(request)
        low, high = tilt_interval(mechanism)
        margin = min(required[0] - low, high - required[1])
        problem = self.problem
        eye = None if problem is None else problem.eye
        sides = (
            link_sides(problem.robot, mechanism) if is_original and problem is not None else None
        )
        return {
            "tilt_range": [low, high],
            "reached": margin >= 0.0,
            "margin": margin,
            "own": is_original,
            "scene": mechanism_scene(mechanism, {**self.ranges, "tilt": required}, sides, eye),
        }

    def suggest(self, request: JsonObject) -> JsonObject:
        """Suggest the smallest α that reaches a tilt range.

        Parameters
        ----------
        request : dict
            `tilt_range`, rad.

        Returns
        -------
        dict
            `alpha`, `beta`, and the largest `margin` of `SUGGESTED_MARGINS` that they keep, rad.

        Raises
        ------
        ProblemError
            If no angles reach the range.
        """
        required = requested_tilt_range(request)
        for margin in SUGGESTED_MARGINS:
            try:
                region = design_region(*required, margin)
            except GeometryError as error:
                raise ProblemError(
                    "no α and β reach a range on both sides of 0°",
                    key="tilt_range",
                    allowed="both ends of one sign",
                ) from error
            alpha, beta = region.smallest_alpha
            if not region.empty and alpha >= MIN_ANGLE and beta <= MAX_ANGLE:
                return {"alpha": alpha, "beta": beta, "margin": margin}
        raise ProblemError("no α and β reach this range", key="tilt_range")

    def problem_content(self, request: JsonObject) -> JsonObject:
        """Return the content of a problem file with the robot and the motion of a request.

        Parameters
        ----------
        request : dict
            `alpha` and `beta` (rad), `design` (values of the robot by path) and `payload` (kg).
            With `own` true, the motion is that of the file. Otherwise, `start` is a pose,
            `tilt_range` limits the tilt (rad), and `motion` is a list of {pose} and {dwell}. A pose
            consists of roll, tilt, spin (rad) and depth (m), and a dwell is a time (s).

        Returns
        -------
        dict
            Content of the problem file.

        Raises
        ------
        ProblemError
            If a value is invalid.
        """
        content = dict(self.document)
        if request.get("design") or not self.mechanism(request)[1]:
            content["robot"] = self.changed_robot(request)
        if "payload" in request:
            mass = requested_number(request, "payload", 0.0, MAX_PAYLOAD, "kg")
            content["tip_payload"] = f"{mass:.12g} kg"
            if not mass:
                del content["tip_payload"]
        if request.get("own") is True:
            return content
        motion = request.get("motion")
        if not isinstance(motion, list) or not all(isinstance(step, dict) for step in motion):
            raise ProblemError("not a motion", key="motion", allowed="a list of poses and dwells")
        content["start"] = _pose_entry(requested_pose(request, "start"))
        entries: list[JsonObject] = []
        for step in motion:
            if "dwell" in step:
                duration = requested_number(step, "dwell", 1e-3, MAX_DWELL, "s")
                entries.append({"dwell": f"{duration:.12g} s"})
            else:
                entries.append({"straight": {"to": _pose_entry(requested_pose(step, "pose"))}})
        content["motion"] = entries
        low, high = requested_tilt_range(request)
        lowest, highest = self.ranges.get("tilt", (low, high))
        low, high = max(low, lowest), min(high, highest)
        tilts = [_coordinate_text("tilt", low), _coordinate_text("tilt", high)]
        return content | {"limits": {**content.get("limits", {}), "tilt": tilts}}

    def requested_problem(self, request: JsonObject) -> Problem:
        """Build the problem of a request, which has the keys of `problem_content`.

        The method raises ProblemError if a value is invalid.
        """
        return problem_from(Section(self._file, node_from_data(self.problem_content(request))))

    def problem_file(self, request: JsonObject) -> JsonObject:
        """Return the problem of a request as YAML that does not depend on other files.

        Parameters
        ----------
        request : dict
            Request in the form that `problem_content` describes.

        Returns
        -------
        dict
            `text` is the YAML.

        Raises
        ------
        ProblemError
            If a value is invalid.
        """
        import yaml

        if request.get("relaxed"):
            raise ProblemError(
                "a changed limit cannot be saved; enter it under “Problem as YAML”",
                key="relaxed",
            )
        content = self.problem_content(request)
        return {"text": yaml.safe_dump(content, sort_keys=False, allow_unicode=True)}

    def ik(self, request: JsonObject) -> JsonObject:
        """Answer a request for the inverse kinematics of a pose.

        Parameters
        ----------
        request : dict
            `alpha` and `beta` of the mechanism (rad), and the `pose`: roll, tilt and spin (rad),
            and depth (m).

        Returns
        -------
        dict
            `reachable` tells whether the pose can be reached, and `error` is the error of the
            orientation, rad. `branches` contains {joints, branch, in_limits, tip} for each
            solution, in the order of the distance from home.

        Raises
        ------
        ProblemError
            If a value is invalid.
        """
        mechanism, _ = self.mechanism(request)
        limits = None
        if self.problem is not None:
            limits = np.array([joint.position for joint in self.problem.robot.joints])
        solutions = inverse_task(
            mechanism, [requested_pose(request, "pose")], limits=limits, reference=np.zeros(4)
        )
        tips = tip_position(mechanism, solutions.joints[0])
        branches = [
            {
                "joints": solutions.joints[0, k].tolist(),
                "branch": int(solutions.branch[0, k]),
                "in_limits": bool(solutions.in_limits[0, k]),
                "tip": tip.tolist(),
            }
            for k, tip in enumerate(tips)
        ]
        return {
            "reachable": bool(solutions.reachable[0]),
            "error": float(solutions.orientation_error[0]),
            "branches": branches,
        }


def requested_pose(request: JsonObject, key: str) -> Pose:
    """Return the pose that a request contains under a key.

    Parameters
    ----------
    request : dict
        Content of the request.
    key : str
        Key of the pose.

    Returns
    -------
    roll, tilt, spin, depth : float
        Three angles, rad, and the depth, m.

    Raises
    ------
    ProblemError
        If the entry is not a list of four numbers in their ranges.
    """
    values = request.get(key)
    if not isinstance(values, list) or len(values) != len(TASK_COORDINATES):
        raise ProblemError("not a pose", key=key, value=values, allowed="[roll, tilt, spin, depth]")
    coordinates = []
    for name, value, largest in zip(TASK_COORDINATES, values, MAX_POSE, strict=True):
        path = f"{key}.{name}"
        unit = "m" if name == "depth" else "rad"
        coordinates.append(requested_number({path: value}, path, -largest, largest, unit))
    roll, tilt, spin, depth = coordinates
    return roll, tilt, spin, depth


def requested_tilt_range(request: JsonObject) -> Range:
    """Return the tilt range that a request contains under the key "tilt_range".

    Parameters
    ----------
    request : dict
        Content of the request.

    Returns
    -------
    low, high : float
        Ends of the range, rad.

    Raises
    ------
    ProblemError
        If the entry is not a range.
    """
    ends = request.get("tilt_range")
    if not isinstance(ends, list) or len(ends) != 2:
        raise ProblemError("not a range", key="tilt_range", value=ends, allowed="[low, high]")
    low, high = [
        requested_number({"tilt_range": end}, "tilt_range", -math.pi, math.pi) for end in ends
    ]
    if not low < high:
        raise ProblemError("the lower end is not below the upper", key="tilt_range")
    return low, high


def requested_number(
    request: JsonObject, key: str, low: float, high: float, unit: str = "rad"
) -> float:
    """Return a number of a request.

    Parameters
    ----------
    request : dict
        Content of the request.
    key : str
        Key of the number.
    low, high : float
        Permitted range. A number that exceeds it by rounding is moved to its end.
    unit : str
        SI unit of the range, for messages.

    Returns
    -------
    float
        The number.

    Raises
    ------
    ProblemError
        If the entry is not a number in the range.
    """
    value = request.get(key)
    unit, scale = display_unit(unit, "°")
    allowed = f"{scale * low:.6g} to {scale * high:.6g} {unit}"
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        raise ProblemError("not a number", key=key, value=value, allowed=allowed)
    if not low - ANGLE_TOLERANCE <= value <= high + ANGLE_TOLERANCE:
        raise ProblemError(f"{scale * value:.6g} {unit} is out of range", key=key, allowed=allowed)
    return min(max(float(value), low), high)

"""Reject candidates by closed-form tests, before any planning and for all candidates at once.

The tests are called screens. They check the reach (paper, eq. 9), the self-locking of every drive,
and the torque that starts each straight motion from rest against weight and static friction. A
candidate that a screen cannot evaluate passes it.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ssm_planner.dynamics import breakaway_torque, static_loads
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import Family
from ssm_planner.loading import problem_from_dict, robot_from, section_from_data
from ssm_planner.problem import JOINTS, TASK_COORDINATES, Joint, Problem, Robot, Straight, Task
from ssm_planner.studies.study import Choice, Design, Study
from ssm_planner.typing import Array, frozen
from ssm_planner.units import quantity

GEOMETRY_ANGLES = ("alpha", "home_tilt", "home_roll")
"""Keys of the robot file that define a geometry."""
START_FRACTION = 1e-6
"""Share of a straight motion from which the directions of its joints are computed."""
DEGREE = math.pi / 180


@frozen
class Rejection:
    """The stage that rejected a candidate, and the reason."""

    stage: str
    reason: str


Rejections = list[Rejection | None]
"""Rejection of each candidate, or None if it passes."""


JointOptions = dict[str, Joint | ProblemError]
"""Joint with each entry of a choice by name of the entry, or the error if the entry is invalid."""
StraightMove = tuple[list[float], list[float]]
"""Start and end of a straight motion in task coordinates, rad and m."""


class Screens:
    """The screens of one study. They can be applied to many candidates at once."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self._valid_design = study.design([0.0] * len(study.vary))
        problems = list(self._valid_problems())
        self.robot: Robot | None = problems[0].robot if problems else None
        self._tilts, self._moves = _required_tilts_and_moves(problems)
        self._joint_options = self._optional_joints()

    def reject(self, designs: Sequence[Design]) -> Rejections:
        """Apply all screens. Returns the rejection of each candidate, or None if it passes."""
        if not designs:
            return []
        rejections: Rejections = [None] * len(designs)
        family = self._geometry_family(designs)
        if family is not None:
            self._screen_reach(family, rejections)
        self._screen_parts(designs, rejections)
        if family is not None and self._moves and not self._bodies_vary:
            self._screen_start(designs, family, rejections)
        return rejections

    @property
    def _bodies_vary(self) -> bool:
        """True if masses, bodies or gravity differ between candidates."""
        if any(path.startswith(("bodies", "gravity")) for path in self.study.paths):
            return True
        return any("parts" in body for body in self.study.robot["bodies"])

    def _valid_problems(self) -> Iterator[Problem]:
        """Yield the problem of each motion, with a candidate for which all problems are valid.

        The result is empty if none of three candidates is valid.
        """
        for position in (0.0, 0.5, 1.0):
            design = self.study.design([position] * len(self.study.vary))
            try:
                tree = self.study.resolved(design)
                problems = [
                    problem_from_dict({**motion, "robot": tree})
                    for motion in self.study.motions.values()
                ]
            except ProblemError:
                continue
            self._valid_design = design
            yield from problems
            return

    def _geometry_family(self, designs: Sequence[Design]) -> Family | None:
        """Return the geometries of all designs as arrays.

        None if other keys than `GEOMETRY_ANGLES` define the geometry.
        """
        geometry = self.study.robot["geometry"]
        axes_vary = any(path.startswith("geometry.axes") for path in self.study.paths)
        if "alpha" not in geometry or "beta" in geometry or axes_vary:
            return None
        columns = []
        for name in GEOMETRY_ANGLES:
            path = f"geometry.{name}"
            texts = [str(geometry.get(name, "0 deg"))]
            if path in self.study.paths:
                texts = [design[path] for design in designs]
            columns.append(np.broadcast_to(_parse_angles(texts), (len(designs),)))
        sign = -1 if geometry["insertion"] == "negative" else 1
        return Family(columns[0], columns[1], columns[2], sign)

    def _screen_reach(self, family: Family, rejections: Rejections) -> None:
        """Reject candidates that do not reach the required tilts or the tilts of the motions."""
        require = self.study.require
        tilt_requirements: list[tuple[str, Array, float]] = []
        if require.reach is not None:
            tilt_requirements.append(
                ("the tilts required", np.array(require.reach), require.reach_margin)
            )
        if len(self._tilts):
            tilt_requirements.append(("the tilts of the motions", self._tilts, 0.0))
        for subject, tilts, margin in tilt_requirements:
            distance = family.boundary_distance(tilts)
            for i in np.flatnonzero(distance < margin):
                if rejections[i] is None:
                    low, high = family.tilt_magnitudes
                    demand = f"{tilts.min() / DEGREE:.5g} to {tilts.max() / DEGREE:.5g} deg"
                    reachable = f"{low[i] / DEGREE:.5g} to {high[i] / DEGREE:.5g} deg"
                    reason = f"{subject}, {demand}, are not within {reachable} of joint 1"
                    rejections[i] = Rejection("reach", reason)

    def _screen_parts(self, designs: Sequence[Design], rejections: Rejections) -> None:
        """Reject candidates with an invalid drive or motor, or with a drive that does not lock."""
        for path, options in self._joint_options.items():
            faults = {label: self._part_rejection(option) for label, option in options.items()}
            for i, design in enumerate(designs):
                if rejections[i] is None:
                    rejections[i] = faults[design[path]]

    def _part_rejection(self, joint: Joint | ProblemError) -> Rejection | None:
        """Return the rejection if a joint is invalid or its drive does not lock, otherwise None."""
        if isinstance(joint, ProblemError):
            return Rejection("parts", joint.reason)
        drive = joint.drive
        if drive is None or not (self.study.require.self_locking or drive.self_locking):
            return None
        try:
            replace(drive, self_locking=True).check_locking()
        except ProblemError as error:
            return Rejection("locking", f"joint {joint.name}: {error.reason}")
        return None

    def _optional_joints(self) -> dict[str, JointOptions]:
        """Build one joint for each drive or motor that the study can choose.

        All other values are those of the first candidate. The result contains the joints by path of
        the choice and name of the entry, or the error if an entry is invalid.
        """
        joints: dict[str, JointOptions] = {}
        for variable in self.study.vary:
            keys = variable.path.split(".")
            is_component = keys[0] == "joints" and ("drive" in keys or "motor" in keys)
            if not isinstance(variable, Choice) or not is_component:
                continue
            index = JOINTS.index(keys[1])
            options: JointOptions = {}
            for label in variable.contents:
                try:
                    tree = self.study.resolved({**self._valid_design, variable.path: label})
                    options[label] = robot_from(section_from_data(tree)).joints[index]
                except ProblemError as error:
                    options[label] = error
            joints[variable.path] = options
        return joints

    def _screen_start(
        self, designs: Sequence[Design], family: Family, rejections: Rejections
    ) -> None:
        """Reject designs whose motors cannot start a motion from rest on any branch.

        The reason is that of the first branch.
        """
        if self.robot is None:
            return
        passes = np.array([rejection is None for rejection in rejections])
        if not passes.any():
            return
        indices = np.flatnonzero(passes).tolist()
        passing_designs = [designs[i] for i in indices]
        passing_family = family.subset(passes)
        positive_branch = self._start_rejections(passing_family, 1, passing_designs)
        negative_branch = self._start_rejections(passing_family, -1, passing_designs)
        for i, reason, other_reason in zip(indices, positive_branch, negative_branch, strict=True):
            if other_reason is not None:
                rejections[i] = reason

    def _start_rejections(
        self, family: Family, branch: int, designs: Sequence[Design]
    ) -> Rejections:
        """Return the rejection of each design whose motors are too weak on one branch, or None."""
        starts, ends = np.array(self._moves).swapaxes(0, 1)
        steps = starts + START_FRACTION * (ends - starts)
        with np.errstate(invalid="ignore", divide="ignore"):
            q = family.joints(starts, branch)
            step = family.joints(steps, branch) - q
            step[..., :3] = np.arctan2(np.sin(step[..., :3]), np.cos(step[..., :3]))
            direction = np.where(np.abs(step) > 1e-12, np.sign(step), 0.0)
            load = self._weight_efforts(family, q)
        rejections: Rejections = [None] * len(designs)
        selected = {choice.path.split(".")[1] for choice in self.study.selected}
        for k, name in enumerate(JOINTS):
            if name in selected:
                continue
            for joint, members in self._joint_variants(name, designs):
                faults = _motor_rejections(joint, load[members, :, k], direction[members, :, k])
                for i, rejection in faults.items():
                    rejections[members[i]] = rejections[members[i]] or rejection
        return rejections

    def _weight_efforts(self, family: Family, q: Array) -> Array:
        """Return the efforts of the weight on the joints at q (n, k, 4), (n, k, 4), N·m and N.

        The bodies keep their place relative to the axes of their joints.
        """
        assert self.robot is not None
        count = len(family.alpha)
        axes = np.stack([family.omega1, family.omega2, family.omega3], axis=1)
        masses = np.tile([body.mass for body in self.robot.bodies], (count, 1))
        return static_loads(axes, masses, self._centres_of_mass(family), self.robot.gravity, q)

    def _centres_of_mass(self, family: Family) -> Array:
        """Return the centres of mass in the base frame at q = 0, (n, 4, 3), m.

        The z axis of a body's frame stays along the axis of its joint.
        """
        assert self.robot is not None
        new_axes = (family.omega1, family.omega2, family.omega3, family.omega3)
        centres = [body.frame @ body.com for body in self.robot.bodies]
        bodies = zip(centres, self.robot.geometry.axes, new_axes, strict=True)
        return np.stack(
            [_rotate_with_axis(centre, old, new) for centre, old, new in bodies], axis=1
        )

    def _joint_variants(
        self, name: str, designs: Sequence[Design]
    ) -> Iterator[tuple[Joint, Array]]:
        """Yield each variant of a joint, and the indices of the designs that contain it.

        Variants differ in their drive and motor. A variant whose drive and motor do not fit
        together is left out.
        """
        assert self.robot is not None
        original = self.robot.joints[JOINTS.index(name)]
        paths = [path for path in self._joint_options if path.split(".")[1] == name]
        groups: dict[tuple[str, ...], list[int]] = {}
        for i, design in enumerate(designs):
            groups.setdefault(tuple(design[path] for path in paths), []).append(i)
        for labels, members in groups.items():
            joint: Any = original
            for path, label in zip(paths, labels, strict=True):
                option = self._joint_options[path][label]
                assert isinstance(option, Joint)  # Candidates with an error are rejected already.
                field = "motor" if path.endswith("motor") else "drive"
                try:
                    joint = replace(joint, **{field: getattr(option, field)})
                except ProblemError:
                    joint = None
                    break
            if joint is not None:
                yield joint, np.array(members)


def _motor_rejections(joint: Joint, load: Array, direction: Array) -> dict[int, Rejection]:
    """Return the rejection of each robot whose motor cannot start a joint, by index.

    The result is empty if the joint lacks a motor or the friction of its drive.

    Parameters
    ----------
    joint : Joint
        Joint of the candidate.
    load : (n, k)
        Efforts of the weight in k configurations of n robots, N·m or N.
    direction : (n, k)
        Directions of the starts, +1, −1, or 0 for a joint that rests.
    """
    drive, motor = joint.drive, joint.motor
    if drive is None or motor is None or drive.friction is None:
        return {}
    torque = np.abs(breakaway_torque(drive, load, np.where(direction == 0, 1.0, direction)))
    torque = np.where((direction == 0) | ~np.isfinite(torque), 0.0, torque).max(axis=1)
    return {
        i: Rejection(
            "static torque",
            f"joint {joint.name} starts against {1e3 * torque[i]:.4g} mN·m, "
            f"{motor.name} has {1e3 * motor.max_torque:.4g} mN·m",
        )
        for i in np.flatnonzero(torque > motor.max_torque).tolist()
    }


def _parse_angles(texts: Sequence[str]) -> Array:
    """Convert texts such as "30 deg" to angles (n,) in rad. All texts have the same unit."""
    unit = texts[0].strip().partition(" ")[2]
    factor = quantity(f"1 {unit}", "angle")
    return np.array([float(text.strip().partition(" ")[0]) for text in texts]) * factor


def _rotate_with_axis(point: Array, old: Array, new: Array) -> Array:
    """Rotate a point by the smallest rotation that turns one axis into another.

    Parameters
    ----------
    point : (3,)
        Point that is rotated.
    old : (3,)
        Unit vector of the axis before the rotation.
    new : (n, 3)
        Unit vectors of the axis after each of n rotations.

    Returns
    -------
    (n, 3)
        The point after each rotation.
    """
    axis = np.cross(old, new)
    cosine = new @ old
    tangent = np.cross(axis, point)
    return point + tangent + np.cross(axis, tangent) / (1.0 + cosine)[:, None]


def _required_tilts_and_moves(problems: Sequence[Problem]) -> tuple[Array, list[StraightMove]]:
    """Return the tilts (k,) that all motions must reach, rad, and their straight motions.

    Only motions whose ends are given in task coordinates are evaluated. The evaluation of a problem
    ends at its first other motion.
    """
    tilts: list[float] = []
    moves: list[StraightMove] = []
    for problem in problems:
        start = problem.start
        if not isinstance(start, Task):
            continue
        position = {name: getattr(start, name) or 0.0 for name in TASK_COORDINATES}
        tilts.append(position["tilt"])
        for motion in problem.motion:
            if not isinstance(motion, Straight):
                break
            target = position | motion.to.set_coordinates
            moves.append((list(position.values()), list(target.values())))
            tilts.append(target["tilt"])
            position = target
    return np.array(tilts), moves

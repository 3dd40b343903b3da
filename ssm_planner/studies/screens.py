"""Reject candidates by closed-form tests, before any planning and for all candidates at once.

A candidate is one of the robots that a study compares. The tests are called screens. They check the
reach (paper, eq. 9), the self-locking of every drive, and the motor torque that starts each
straight motion from rest against weight and static friction. A candidate that a screen cannot
evaluate passes it, and the planner judges it later.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ssm_planner.dynamics import breakaway_torque, static_loads
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import MechanismFamily
from ssm_planner.loading import problem_from_dict, robot_from, section_from_data
from ssm_planner.problem import JOINTS, TASK_COORDINATES, Joint, Problem, Robot, Straight, Task
from ssm_planner.studies.study import Choice, Design, Study
from ssm_planner.typing import Array, frozen
from ssm_planner.units import parse_quantity

GEOMETRY_ANGLES = ("alpha", "home_tilt", "home_roll")
"""Keys of the robot file that define a geometry: the angle α, and tilt and roll at q = 0."""
START_FRACTION = 1e-6
"""Fraction of a straight motion at which the starting directions of its joints are evaluated."""
DEGREE = math.pi / 180
"""One degree, rad."""


@frozen
class Rejection:
    """The stage that rejected a candidate, and the reason in words."""

    stage: str
    """Name of the test: "reach", "parts" (invalid motor or drive), "locking" or "static torque"."""
    reason: str
    """Reason of the rejection."""


Rejections = list[Rejection | None]
"""Rejection of each candidate, or None if the candidate passes."""


JointOptions = dict[str, Joint | ProblemError]
"""Joint with each entry of a choice, by name of the entry.

An invalid entry has its error instead of a joint.
"""
StraightMove = tuple[list[float], list[float]]
"""Roll, tilt, spin and depth at the start and at the end of a straight motion, rad and m."""


class Screens:
    """The screens of one study, which can be applied to many candidates at once.

    Attributes
    ----------
    study : Study
        Study whose candidates are screened.
    robot : Robot or None
        A valid robot of the study. None if all three tried candidates are invalid.
    """

    def __init__(self, study: Study) -> None:
        """Collect the requirements of a study and the joints among which its search chooses.

        Parameters
        ----------
        study : Study
            Study whose candidates are screened.
        """
        self.study = study
        self._valid_design = study.design([0.0] * len(study.vary))
        problems = list(self._valid_problems())
        self.robot: Robot | None = problems[0].robot if problems else None
        self._tilts, self._moves = _required_tilts_and_moves(problems)
        self._joint_options = self._optional_joints()

    def reject(self, designs: Sequence[Design]) -> Rejections:
        """Reject candidates that fail a closed-form test (screen) of reach, drives or motors.

        The test of the motors is left out if bodies or gravity differ between candidates, because
        it needs the weight.

        Parameters
        ----------
        designs : sequence of Design
            Designs of the candidates.

        Returns
        -------
        list of Rejection or None
            Rejection of each candidate, or None if the candidate passes all screens.
        """
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
        """True if the bodies (links) or gravity may differ between candidates."""
        if any(path.startswith(("bodies", "gravity")) for path in self.study.paths):
            return True
        return any("parts" in body for body in self.study.robot["bodies"])

    def _valid_problems(self) -> Iterator[Problem]:
        """Yield the problem of each motion, with a candidate for which all problems are valid.

        The candidates at the beginning, in the middle and at the end of all ranges are tried.
        Nothing is yielded if none of them is valid.

        Yields
        ------
        Problem
            Problem of a motion of the study.
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

    def _geometry_family(self, designs: Sequence[Design]) -> MechanismFamily | None:
        """Return the geometries of the mechanisms of all candidates as arrays.

        Parameters
        ----------
        designs : sequence of Design
            Designs of n candidates.

        Returns
        -------
        MechanismFamily or None
            Geometries of the n candidates. None if other keys of the robot file than
            `GEOMETRY_ANGLES` define the geometry.
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
        return MechanismFamily(columns[0], columns[1], columns[2], sign)

    def _screen_reach(self, family: MechanismFamily, rejections: Rejections) -> None:
        """Reject candidates that do not reach the required tilts or the tilts of the motions.

        Parameters
        ----------
        family : MechanismFamily
            Geometries of n candidates.
        rejections : list of Rejection or None
            Rejection of each candidate, which is set in place. Earlier rejections remain.
        """
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
        """Reject candidates with an invalid drive or motor, or with a drive that does not lock.

        Parameters
        ----------
        designs : sequence of Design
            Designs of the candidates.
        rejections : list of Rejection or None
            Rejection of each candidate, which is set in place. Earlier rejections remain.
        """
        for path, options in self._joint_options.items():
            faults = {label: self._part_rejection(option) for label, option in options.items()}
            for i, design in enumerate(designs):
                if rejections[i] is None:
                    rejections[i] = faults[design[path]]

    def _part_rejection(self, joint: Joint | ProblemError) -> Rejection | None:
        """Test whether a joint is valid and whether its drive is self-locking if this is required.

        A drive is self-locking if its load cannot move it. The study or the file of the drive may
        require this.

        Parameters
        ----------
        joint : Joint or ProblemError
            Joint with its drive and motor, or the error of an invalid drive or motor.

        Returns
        -------
        Rejection or None
            Rejection with the stage "parts" or "locking", or None if the joint passes.
        """
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
        """Build one joint for each drive or motor among which the search chooses.

        All other values are those of a valid candidate.

        Returns
        -------
        dict
            Joint, or error of an invalid entry, by path of the choice and by name of the entry.
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
        self, designs: Sequence[Design], family: MechanismFamily, rejections: Rejections
    ) -> None:
        """Reject candidates whose motors cannot start a straight motion from rest.

        A candidate is rejected only if its motors are too weak on both branches of the inverse
        kinematics. The reason is that of the positive branch.

        Parameters
        ----------
        designs : sequence of Design
            Designs of n candidates.
        family : MechanismFamily
            Geometries of these candidates.
        rejections : list of Rejection or None
            Rejection of each candidate, which is set in place. Earlier rejections remain.
        """
        passes = np.array([rejection is None for rejection in rejections])
        if not passes.any():
            return
        # Only the candidates that passed all other screens are tested.
        indices = np.flatnonzero(passes).tolist()
        passing_designs = [designs[i] for i in indices]
        passing_family = family.subset(passes)
        positive_branch = self._start_rejections(passing_family, 1, passing_designs)
        negative_branch = self._start_rejections(passing_family, -1, passing_designs)
        for i, reason, other_reason in zip(indices, positive_branch, negative_branch, strict=True):
            if other_reason is not None:
                rejections[i] = reason

    def _start_rejections(
        self, family: MechanismFamily, branch: int, designs: Sequence[Design]
    ) -> Rejections:
        """Return the rejection of each design whose motors are too weak on one branch, or None.

        Parameters
        ----------
        family : MechanismFamily
            Geometries of n candidates.
        branch : int
            Branch of the inverse kinematics, +1 or −1.
        designs : sequence of Design
            Designs of these candidates.

        Returns
        -------
        list of Rejection or None
            Rejection of each candidate, or None if its motors suffice on this branch. Joints whose
            motor or gear is selected after the planning are not tested.
        """
        starts, ends = np.array(self._moves).swapaxes(0, 1)
        points = starts + START_FRACTION * (ends - starts)
        with np.errstate(invalid="ignore", divide="ignore"):
            q = family.joints(starts, branch)
            step = family.joints(points, branch) - q
            # The inverse kinematics may add a whole turn to an angle.
            step[..., :3] = np.arctan2(np.sin(step[..., :3]), np.cos(step[..., :3]))
            direction = np.where(np.abs(step) > 1e-12, np.sign(step), 0.0)
            load = self._weight_efforts(family, q)
        rejections: Rejections = [None] * len(designs)
        selected = {choice.joint for choice in self.study.selected}
        for k, name in enumerate(JOINTS):
            if name in selected:
                continue
            for joint, members in self._joint_variants(name, designs):
                faults = _motor_rejections(joint, load[members, :, k], direction[members, :, k])
                for i, rejection in faults.items():
                    rejections[members[i]] = rejections[members[i]] or rejection
        return rejections

    def _weight_efforts(self, family: MechanismFamily, q: Array) -> Array:
        """Return the efforts that the weight of the bodies exerts on the joints.

        The axes of the joints differ between the candidates. Each body of the original robot is
        rotated by the smallest rotation that turns the original axis of its joint into the axis of
        the candidate.

        Parameters
        ----------
        family : MechanismFamily
            Geometries of n candidates.
        q : (n, k, 4) array
            Joint positions of each candidate in k configurations, rad for joints 1 to 3 and m for
            joint 4.

        Returns
        -------
        (n, k, 4) array
            Efforts, N·m for the rotary joints and N for the translation.
        """
        assert self.robot is not None
        count = len(family.alpha)
        axes = np.stack([family.omega1, family.omega2, family.omega3], axis=1)
        masses = np.tile([body.mass for body in self.robot.bodies], (count, 1))
        new_axes = (family.omega1, family.omega2, family.omega3, family.omega3)
        original_centres = [body.frame @ body.com for body in self.robot.bodies]
        bodies = zip(original_centres, self.robot.geometry.axes, new_axes, strict=True)
        centres = np.stack([_rotate_with_axis(*body) for body in bodies], axis=1)
        return static_loads(axes, masses, centres, self.robot.gravity, q)

    def _joint_variants(
        self, name: str, designs: Sequence[Design]
    ) -> Iterator[tuple[Joint, Array]]:
        """Yield each combination of drive and motor of a joint, and the candidates that have it.

        Candidates with the same drive and motor of the joint form a group. The method yields one
        joint for each group, so that the torques of a group can be computed at once. A combination
        whose drive and motor do not fit together is left out.

        Parameters
        ----------
        name : str
            Name of the joint.
        designs : sequence of Design
            Designs of the candidates.

        Yields
        ------
        joint : Joint
            Joint with the drive and the motor of the group.
        members : (m,) array of int
            Indices in `designs` of the m candidates in the group.
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
    """Find the robots whose motor cannot start a joint from rest.

    Parameters
    ----------
    joint : Joint
        Joint with its drive and motor.
    load : (n, k) array
        Efforts of the weight on the joint of n robots in k configurations, N·m or N.
    direction : (n, k) array
        Directions in which the joint starts, +1 or −1, or 0 for a joint that rests.

    Returns
    -------
    dict
        Rejection by index of the robot. Empty if the motor of the joint, its drive or the friction
        of this drive is missing.
    """
    drive = joint.drive
    motor = joint.motor
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
    """Convert texts such as "30 deg" to angles.

    Parameters
    ----------
    texts : sequence of str
        n quantities, which all have the same unit.

    Returns
    -------
    (n,) array
        Angles, rad.
    """
    unit = texts[0].strip().partition(" ")[2]
    factor = parse_quantity(f"1 {unit}", "angle")
    return np.array([float(text.strip().partition(" ")[0]) for text in texts]) * factor


def _rotate_with_axis(point: Array, old: Array, new: Array) -> Array:
    """Rotate a point by the smallest rotation that turns one axis into another.

    Parameters
    ----------
    point : (3,) array
        Point that is rotated.
    old : (3,) array
        Unit vector of the axis before the rotation.
    new : (n, 3) array
        Unit vectors of the axis after each of n rotations. None may be opposite to `old`.

    Returns
    -------
    (n, 3) array
        The point after each rotation.

    Notes
    -----
    With a = old × new, which is not normalised, c = old · new and the point p, Rodrigues' formula
    gives p + a × p + a × (a × p)/(1 + c).
    """
    axis = np.cross(old, new)
    cosine = new @ old
    product = np.cross(axis, point)
    return point + product + np.cross(axis, product) / (1.0 + cosine)[:, None]


def _required_tilts_and_moves(problems: Sequence[Problem]) -> tuple[Array, list[StraightMove]]:
    """Return the tilts that the motions must reach, and their straight motions.

    Only motions whose ends are given in task coordinates are evaluated. The evaluation of a problem
    ends at its first motion that is not straight, because the later positions are unknown.

    Parameters
    ----------
    problems : sequence of Problem
        Problem of each motion of the study.

    Returns
    -------
    tilts : (k,) array
        Tilts at the ends of the motions, rad.
    moves : list of StraightMove
        Task coordinates at the start and at the end of each straight motion.
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

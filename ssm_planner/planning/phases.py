"""Phases of a problem: the entries of its motion list with their joint positions.

`build_phases` converts the motion list to phases. The joint positions at the targets follow from
the inverse kinematics. It has two solutions for each pose of the tool, called the branches +1 and
−1, and whole turns may be added to the angles of the revolute joints. `start_configurations` lists
these choices at the start, and `alternative_joints` those at a target of a free motion.
"""

from collections.abc import Iterator
from dataclasses import field, replace
from functools import cached_property, lru_cache
from itertools import product

import numpy as np

from ssm_planner.errors import ProblemError, within
from ssm_planner.kinematics import (
    Mechanism,
    Solutions,
    inverse_task,
    inverse_tip,
    task_from_joints,
    task_rates,
    theta2_from_tilt,
)
from ssm_planner.planning.curves import CurveFollower, driven_joints
from ssm_planner.planning.lower_bound import lower_bound, rate_bound, stopping_curves
from ssm_planner.planning.retiming.blends import blend_pieces
from ssm_planner.planning.retiming.paths import (
    ClosedPath,
    JointPath,
    SplinePath,
    StraightPath,
    split_at_corners,
)
from ssm_planner.planning.scan_pattern import complete_task, scan_motions
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE, ROUNDING_TOLERANCE
from ssm_planner.problem import (
    SINGLE_COORDINATE_MOTIONS,
    TIP_CURVES,
    Dwell,
    Follow,
    Free,
    Joints,
    Motion,
    Point,
    Problem,
    Scan,
    Straight,
    Task,
    Tip,
    motion_key,
)
from ssm_planner.typing import Array, Range, record


@record
class Phase:
    """One entry of the motion list with its points in task and joint coordinates.

    Most entries give one phase. A scan, a table of points with corners, or a curve that begins away
    from the robot's position gives several. Motions with rounded corners between them are joined to
    one phase.
    """

    problem: Problem
    """The problem with its robot and limits."""
    motion: Motion
    """Entry of the motion list."""
    start: Array
    """Task coordinates roll, tilt, spin (rad) and depth (m) at the start, (4,)."""
    end: Array
    """Task coordinates at the end, (4,), rad and m."""
    points: Array
    """Joint positions at the start, at the via points and at the end, (k + 1, 4), rad and m.

    A via point is a given point between start and end. On a curve, the points at which joints
    reverse take the place of via points.
    """
    path: JointPath | None = None
    """Given joint path. None for a free motion and for a robot at rest.

    On a free motion, the solver chooses the path.
    """
    qd_start: Array = field(default_factory=lambda: np.zeros(4))
    qd_end: Array = field(default_factory=lambda: np.zeros(4))
    """Joint velocities at both ends, (4,) each, rad/s and m/s."""
    qdd_start: Array = field(default_factory=lambda: np.zeros(4))
    """Joint accelerations at the start of a free motion with limited jerk, (4,), rad/s² and m/s².
    """

    @cached_property
    def mechanism(self) -> Mechanism:
        """Mechanism of the problem's robot."""
        return Mechanism.from_robot(self.problem.robot)

    @cached_property
    def lower_bound(self) -> float:
        """Duration that no motion of the phase can beat, s.

        It is the largest of three bounds: the time of the slowest joint, the time that limited task
        rates require, and the longest stop of a joint that begins at speed.
        """
        robot, limits = self.problem.robot, self.problem.task_limits
        speeds = np.stack([self.qd_start, self.qd_end])
        rates = task_rates(self.mechanism, self.points[[0, -1]], speeds)
        by_rates = rate_bound(robot, np.stack([self.start, self.end]), rates, limits)
        bounds = [lower_bound(robot, self.points, speeds, limits), by_rates]
        if not self.qd_end.any():
            curves = stopping_curves(robot, self.qd_start, self.qdd_start)
            bounds += [curve.duration for curve in curves if curve is not None]
        return max(bounds)

    @property
    def minimum_duration(self) -> float:
        """Requested duration, or else the lower bound on the duration, s.

        It is infinite if the requested duration is shorter than the lower bound.
        """
        duration = self.motion.duration
        if duration is None:
            return self.lower_bound
        return duration if self.lower_bound <= duration * (1 + EQUALITY_TOLERANCE) else np.inf

    @property
    def q_start(self) -> Array:
        """Joint positions at the start, (4,), rad and m."""
        return np.asarray(self.points[0])

    @property
    def is_at_rest(self) -> bool:
        """True if the robot rests during the phase.

        The phase is then a dwell, or a motion from rest whose target is the present position. Such
        a motion takes no time unless a duration is requested.
        """
        steps = np.abs(np.diff(self.points, axis=0))
        moves = self.path is not None or (steps > ROUNDING_TOLERANCE).any()
        return not moves and self.begins_and_ends_at_rest

    @property
    def begins_and_ends_at_rest(self) -> bool:
        """True if all joints are at rest at both ends."""
        return not (self.qd_start.any() or self.qd_end.any())

    def from_rest(self, points: Array, *, to_end: bool = True) -> "Phase":
        """Return a phase that begins at rest and passes other points, as a part of this phase.

        The ways to move (candidates) that divide a phase into two motions use it
        (`candidates/in_parts.py`).

        Parameters
        ----------
        points : (k, 4) array
            Joint positions at the start, at the via points and at the end of the part, rad and m.
        to_end : bool
            True if the part ends with the joint velocities of this phase. Otherwise it ends at
            rest.

        Returns
        -------
        Phase
            The part, with the problem and the entry of the motion list of this phase.
        """
        start = task_at_end(self.mechanism, np.stack([self.q_start, points[0]]), self.start)
        at_rest = np.zeros(4)
        return replace(
            self,
            start=start,
            end=task_at_end(self.mechanism, points, start),
            points=points,
            qd_start=at_rest,
            qd_end=self.qd_end if to_end else at_rest,
            qdd_start=at_rest,
        )

    def speeds_along(self, path: JointPath) -> tuple[float, float]:
        """Return the path speed ds/dt at both ends of a path, 1/s.

        It follows from the joint velocities at both ends of the phase.

        Parameters
        ----------
        path : JointPath
            Joint path q(s) with the path parameter s from 0 to 1, between the ends of the phase.
        """
        return path.speed_at(0.0, self.qd_start), path.speed_at(1.0, self.qd_end)

    @property
    def branch(self) -> int | None:
        """Branch of a given path in task coordinates: +1 or −1. None for any other phase.

        The branch is the one of the two solutions of the inverse kinematics on which the path
        stays.
        """
        return getattr(self.path, "branch", None)


def task_at_end(mechanism: Mechanism, points: Array, start: Array) -> Array:
    """Return the task coordinates (4,) at the last of several joint positions.

    Roll and spin are followed from point to point without jumps, so they may exceed a whole turn.

    Parameters
    ----------
    mechanism : Mechanism
        Geometry of the robot.
    points : (n, 4) array
        Joint positions, rad and m.
    start : (4,) array
        Task coordinates at the first of them, rad and m.
    """
    task = start
    for point in points[1:]:
        task = task_from_joints(mechanism, point[None, :], near=task)[0]
    return task


def start_configurations(problem: Problem) -> list[Array]:
    """Return the joint positions at which the motion may begin, the preferred ones first.

    They are the given joints. If the start is given in other coordinates, they are the solutions of
    the inverse kinematics on both branches (its two solutions for each pose), with whole turns of
    the revolute joints. Those on the branch of the configuration q = 0 come first.

    Parameters
    ----------
    problem : Problem
        The problem with its start.

    Returns
    -------
    list of (4,) arrays
        Joint positions, rad and m.

    Raises
    ------
    ProblemError
        If the mechanism cannot reach the start.
    """
    target = problem.start
    if isinstance(target, Joints):
        return [np.array(target.values)]
    with within("start"):
        mechanism = Mechanism.from_robot(problem.robot)
        solutions = _inverse_solutions(problem, mechanism, target, np.zeros(4), np.zeros(4))
    # Almost a whole turn, so that no joint at 0 has equivalent angles.
    turn = np.full(3, 2 * np.pi - EQUALITY_TOLERANCE)
    result = [
        q
        for solution in solutions.joints[0, solutions.reaches[0]]
        for q in _with_whole_turns(solution, -turn, turn)
    ]
    result.sort(key=lambda q: float(np.abs(q[:3]).sum()))
    return sorted(result, key=lambda q: bool(mechanism.branch_of(q) != mechanism.home_branch))


def _with_whole_turns(q: Array, low: Array, high: Array) -> list[Array]:
    """Return joint positions with the same pose of the tool, which differ by whole turns.

    Parameters
    ----------
    q : (4,) array
        Joint positions, rad and m.
    low, high : (3,) arrays
        Smallest and largest angles of the revolute joints, rad.

    Returns
    -------
    list of (4,) arrays
        Joint positions, rad and m. Each angle is that of `q`, or a whole turn less or more.
    """
    choices = []
    for angle, smallest, largest in zip(q[:3], low, high, strict=True):
        turned = angle + 2 * np.pi * np.array([0, -1, 1])
        beyond = np.maximum(smallest - turned, turned - largest)
        choices.append(turned[beyond <= ROUNDING_TOLERANCE])
    return [np.array([*angles, q[3]]) for angles in product(*choices)]


def build_phases(problem: Problem, q: Array) -> tuple[Phase, ...]:
    """Build the consecutive phases of a problem from a start configuration.

    A phase is an entry of the motion list with its joint positions. Roll and spin are continuous
    from phase to phase.

    Parameters
    ----------
    problem : Problem
        The problem with its motion list.
    q : (4,) array
        Joint positions at the start, rad and m.

    Returns
    -------
    tuple of Phase
        Phases in the order of time. Each begins where the previous one ends.

    Raises
    ------
    ProblemError
        If the mechanism cannot reach a point, or if no motion goes anywhere.
    """
    mechanism = Mechanism.from_robot(problem.robot)
    phases: list[Phase] = []
    # Joint positions determine roll and spin up to whole turns. A start in task coordinates selects
    # the turns that it states.
    reference = None
    if isinstance(problem.start, Task):
        reference = complete_task(problem, mechanism, problem.start, np.zeros(4), key="start.tilt")
    task = task_from_joints(mechanism, q[None, :], near=reference)[0]
    keys: list[str] = []
    for k, entry in enumerate(problem.motion):
        key = f"motion[{k}].{motion_key(entry)}"
        with within(key):
            motions: list[Motion] = [entry]
            if isinstance(entry, Scan):
                motions = scan_motions(problem, mechanism, entry, q)
            for motion in motions:
                phases += _PhaseBuilder(problem, mechanism, task, q).phases(motion)
                task, q = phases[-1].end, phases[-1].points[-1]
        # All phases of an entry have the key of the entry.
        keys += [key] * (len(phases) - len(keys))
    phases = _join_blended_phases(problem, phases, keys)
    # A free motion that begins or ends at speed must leave its position, even if it returns there.
    at_speed = problem.start_rate or problem.end_rate
    may_return = at_speed and any(isinstance(phase.motion, Free) for phase in phases)
    if not may_return and all(phase.is_at_rest and not phase.motion.duration for phase in phases):
        nowhere = phases[0].motion
        reason = "this motion has length zero: its start and target are equal"
        raise ProblemError(reason, file=problem.file, line=nowhere.line, key=keys[0])
    return tuple(phases)


@record
class _PhaseBuilder:
    """Builder of the phases of one entry of the motion list, and the state in which they begin."""

    problem: Problem
    """The problem with its robot and limits."""
    mechanism: Mechanism
    """Geometry of the robot."""
    start: Array
    """Task coordinates at the start of the entry, (4,), rad and m."""
    q: Array
    """Joint positions at the start of the entry, (4,), rad and m."""

    def phases(self, motion: Motion) -> list[Phase]:
        """Build the phases of one entry of the motion list. Most entries have a single phase.

        Parameters
        ----------
        motion : Motion
            Entry of the motion list. Scans must be converted to other motions first.

        Returns
        -------
        list of Phase
            Phases in the order of time.
        """
        if isinstance(motion, Dwell):
            return [self._rest_phase(motion)]
        if isinstance(motion, Straight):
            return [self._straight_phase(motion)]
        if isinstance(motion, Follow):
            return self._curve_phases(motion)
        assert isinstance(motion, Free)
        return [self._free_phase(motion)]

    def _rest_phase(self, motion: Motion) -> Phase:
        """Build a phase in which the robot rests at the present position."""
        points = np.stack([self.q, self.q])
        return Phase(self.problem, motion, self.start, self.start, points)

    def _phase_along(self, motion: Motion, path: JointPath) -> Phase:
        """Build the phase of an entry of the motion list along a joint path.

        Parameters
        ----------
        motion : Motion
            Entry of the motion list.
        path : JointPath
            Path that begins at the present position.

        Returns
        -------
        Phase
            The phase. Its points are the ends of the path and the points at which joints reverse.
        """
        knots = path.sample(path.directions[0]).q
        end = task_at_end(self.mechanism, knots, self.start)
        return Phase(self.problem, motion, self.start, end, knots, path=path)

    def _builder_at(self, q: Array) -> "_PhaseBuilder":
        """Return a builder whose phases begin at joint positions q (4,)."""
        end = task_from_joints(self.mechanism, q[None], near=self.start)[0]
        return replace(self, start=end, q=q)

    def _straight_phase(self, motion: Straight) -> Phase:
        """Build the phase of a straight line in task coordinates.

        Parameters
        ----------
        motion : Straight
            Entry of the motion list. Coordinates that its target omits keep their values.

        Returns
        -------
        Phase
            The phase with its path. If the target is the present position, the robot rests in the
            phase.
        """
        key = "to" if motion_key(motion) in SINGLE_COORDINATE_MOTIONS else "to.tilt"
        end = complete_task(self.problem, self.mechanism, motion.to, self.start, key=key)
        if np.abs(end - self.start).max() < ROUNDING_TOLERANCE:
            return self._rest_phase(motion)
        path = straight_path(self.problem, self.mechanism, self.start, end, self.q)
        # The points at which joints reverse are computed later, because many straight phases of
        # other joint positions turn out to be impossible before.
        points = path.sample(np.array([0.0, 1.0])).q
        return Phase(self.problem, motion, self.start, end, points, path=path)

    def _free_phase(self, motion: Free) -> Phase:
        """Build the phase of a free motion through its points. Repeated points are left out.

        Parameters
        ----------
        motion : Free
            Entry of the motion list.

        Returns
        -------
        Phase
            The phase without a given path. If all points are the present position, the robot rests
            in the phase.
        """
        points, at_target = [self.q], self
        for at_target, _ in self.targets(motion):
            if np.abs(at_target.q - points[-1]).max() >= ROUNDING_TOLERANCE:
                points.append(at_target.q)
        if len(points) == 1:
            return self._rest_phase(motion)
        return Phase(self.problem, motion, self.start, at_target.start, np.stack(points))

    def targets(self, motion: Free) -> "Iterator[tuple[_PhaseBuilder, Iterator[Array]]]":
        """Yield the state at each target of a free motion, and other joint positions there.

        The targets are the via points (between start and end) and the end. If the spin at the end
        is free, the spin before it is kept.

        Parameters
        ----------
        motion : Free
            The free motion.

        Yields
        ------
        at_target : _PhaseBuilder
            The state at the target with the preferred joint positions, as a builder.
        others : iterator of (4,) arrays
            The other joint positions at the target that are within their ranges, rad and m.
        """
        before = self
        for k, target in enumerate((*motion.through, motion.to)):
            is_last = k == len(motion.through)
            if is_last and motion.spin_free and not isinstance(target, Joints):
                target = replace(target, spin=float(before.start[2]))
            with within("to" if is_last else f"through[{k}]"):
                joints = before._joints_at(target)
                before = before._builder_at(next(joints))
            yield before, joints

    def _joints_at(self, target: Point) -> Iterator[Array]:
        """Yield all joint positions that reach a target, the preferred ones first.

        They are the given ones, or the solutions of the inverse kinematics, which has two branches
        (+1 and −1), with whole turns of the revolute joints. The solution nearest to the present
        joint positions is preferred: among those on the present branch and within the ranges of the
        joints, else among those within the ranges, else among all.

        Parameters
        ----------
        target : Point
            Via point (between start and end) or end of a free motion.

        Yields
        ------
        (4,) array
            Joint positions, rad and m. All except the first ones are within their ranges.

        Raises
        ------
        ProblemError
            If the mechanism cannot reach the target.
        """
        if isinstance(target, Joints):
            yield np.array(target.values)
            return
        # The solutions are sorted by their distance from q, so the first usable one is nearest.
        solutions = _inverse_solutions(self.problem, self.mechanism, target, self.start, self.q)
        joints, valid = solutions.joints[0], solutions.valid[0]
        usable = valid & (solutions.branch[0] == self.mechanism.branch_of(self.q))
        if not usable.any():
            usable = valid if valid.any() else solutions.reaches[0]
        preferred = joints[int(np.argmax(usable))]
        yield preferred
        low, high = np.array([joint.position for joint in self.problem.robot.joints[:3]]).T
        for solution in joints[valid]:
            for q in _with_whole_turns(solution, low, high):
                if np.abs(q - preferred).max() > ROUNDING_TOLERANCE:
                    yield q

    def _curve_phases(self, motion: Follow) -> list[Phase]:
        """Build the phases of a motion along a curve.

        If the robot is not at the beginning of the curve, a free motion to it comes first.

        Parameters
        ----------
        motion : Follow
            Entry of the motion list.

        Returns
        -------
        list of Phase
            Phases in the order of time.
        """
        curve = CurveFollower(self.problem, self.mechanism, motion, self.start, self.q)
        beginning = curve.beginning
        phases: list[Phase] = []
        builder = self
        # `beginning` is the same object as `q` if the robot is there already.
        if beginning is not self.q:
            builder = self._builder_at(beginning)
            name = f"{motion.name}, approach"
            approach = Free(Joints.from_array(beginning), name=name, line=motion.line)
            points = np.stack([self.q, beginning])
            phases = [Phase(self.problem, approach, self.start, builder.start, points)]
            curve = replace(curve, task=builder.start, q=beginning)
        if motion.curve in TIP_CURVES:
            return [*phases, builder._tip_phase(curve)]
        return [*phases, *builder._spline_phases(curve)]

    def _spline_phases(self, curve: CurveFollower) -> list[Phase]:
        """Build the phases through the points of a spline or table.

        A table is divided at its corners into smooth curves, and the robot stops between them.

        Parameters
        ----------
        curve : CurveFollower
            The curve, which begins at the present position.

        Returns
        -------
        list of Phase
            One phase for each smooth curve, in the order of time.
        """
        motion, points = curve.motion, curve.points
        # Divided by the velocity limits, rad and m become comparable.
        scale = self.problem.robot.velocities
        if len(points) == 1:
            return [self._rest_phase(motion)]
        runs = split_at_corners(points, scale) if motion.curve == "samples" else [points]
        pieces = self.problem.by_optimal_control(motion)
        phases: list[Phase] = []
        builder = self
        for k, run in enumerate(runs, 1):
            path = SplinePath(self.mechanism, run, scale, pieces=pieces)
            named_motion = motion if len(runs) == 1 else replace(motion, name=f"{motion.name} {k}")
            phases.append(builder._phase_along(named_motion, path))
            # The path contains the joint positions, so only the task coordinates are updated.
            builder = replace(self, start=phases[-1].end)
        return phases

    def _tip_phase(self, curve: CurveFollower) -> Phase:
        """Build the phase in which the tip follows a line or an arc.

        If the line passes the remote centre along the tool axis, joints 3 and 4 move in a straight
        line instead.

        Parameters
        ----------
        curve : CurveFollower
            The curve, which begins at the present position.

        Returns
        -------
        Phase
            The phase with its path. If neither the tip nor a joint moves, the robot rests in the
            phase.
        """
        # Joint positions (4,) in place of a path are those at the end: `q`, or positions that only
        # joints 3 and 4 have to move to.
        path: JointPath | Array = curve.tip_path()
        if not isinstance(path, JointPath):
            if np.abs(path - self.q).max() < ROUNDING_TOLERANCE:
                return self._rest_phase(curve.motion)
            end = self._builder_at(path).start
            path = straight_path(self.problem, self.mechanism, self.start, end, self.q)
        return self._phase_along(curve.motion, path)


def _join_blended_phases(problem: Problem, phases: list[Phase], keys: list[str]) -> list[Phase]:
    """Join consecutive phases to one phase where the problem asks for rounded corners between them.

    Parameters
    ----------
    problem : Problem
        The problem, for its file name.
    phases : list of Phase
        Phases (entries of the motion list with their joint positions) in the order of time.
    keys : list of str
        Key in the problem file of the motion of each phase, for error messages.

    Returns
    -------
    list of Phase
        Phases in their order. Each joined phase replaces the phases from which it was made.
    """
    merged: list[Phase] = []
    chain: list[Phase] = []
    for k, phase in enumerate(phases, 1):
        chain.append(phase)
        # Without a rounded corner at its end, a phase is the last one of its chain.
        if not isinstance(phase.motion, (Straight, Follow)) or phase.motion.blend is None:
            merged.append(_blend_phases(problem, chain, keys[k - len(chain) : k]))
            chain = []
    return merged


def _blend_phases(problem: Problem, chain: list[Phase], keys: list[str]) -> Phase:
    """Join the paths of consecutive phases to one phase, and round the corners between them.

    Parameters
    ----------
    problem : Problem
        The problem, for its file name.
    chain : list of Phase
        The phases (entries of the motion list). All but the last one have a motion with a rounded
        corner (`blend`) at its end.
    keys : list of str
        Key in the problem file of the motion of each phase, for error messages.

    Returns
    -------
    Phase
        The joined phase. A single phase is returned unchanged.

    Raises
    ------
    ProblemError
        If a corner cannot be rounded, or if a motion has length zero.
    """
    if len(chain) == 1:
        return chain[0]
    # `blend` is the distance from the corner at the end of a motion. The last motion ends without
    # a corner.
    distances = [getattr(phase.motion, "blend", 0.0) for phase in chain[:-1]]
    pieces = []
    try:
        for k, phase in enumerate(chain):
            if not isinstance(phase.path, ClosedPath):
                # The key is the index of the corner before this motion, as in `blend_pieces`.
                raise ProblemError(
                    "a motion without length cannot have a rounded corner",
                    key=str(max(k - 1, 0)),
                    allowed="motions that go somewhere, or no blend",
                )
            pieces.append(phase.path)
        path = blend_pieces(pieces[0].mechanism, pieces, distances)
    except ProblemError as error:
        # The index of the corner in `error.key` is replaced by the place in the problem file.
        k = int(error.key or 0)
        error.file = problem.file
        error.line = chain[k].motion.line
        error.key = f"{keys[k]}.blend"
        error.value = f"{1e3 * distances[k]:g} mm"
        raise
    # dict.fromkeys removes repeated names and keeps the order.
    name = " + ".join(dict.fromkeys(phase.motion.name for phase in chain))
    motion = replace(chain[0].motion, name=name)
    points = path.sample(path.directions[0]).q
    return Phase(problem, motion, chain[0].start, chain[-1].end, points, path=path)


def straight_path(
    problem: Problem, mechanism: Mechanism, start: Array, end: Array, q: Array
) -> StraightPath:
    """Return the joint path along a straight line in task coordinates.

    Parameters
    ----------
    problem : Problem
        The problem, whose robot states which joints have drives.
    mechanism : Mechanism
        Geometry of the robot.
    start, end : (4,) arrays
        Task coordinates at both ends, rad and m.
    q : (4,) array
        Joint positions at the start, rad and m. The path stays on their branch, that is, it follows
        the same one of the two solutions of the inverse kinematics.

    Returns
    -------
    StraightPath
        The path q(s) with the path parameter s from 0 to 1.
    """
    branch = int(mechanism.branch_of(q))
    driven = driven_joints(problem)
    return StraightPath(mechanism, start=start, end=end, branch=branch, first=q, driven=driven)


def reversal_ranges(phase: Phase, points: Array) -> Array:
    """Return the ranges of joint positions in which joints may reverse on a free motion.

    They are the ranges of the joints. The ranges of tilt and depth narrow those of joints 2 and 4,
    because each of these coordinates depends on one joint alone. All ranges are widened where
    necessary to contain the points of the motion.

    Parameters
    ----------
    phase : Phase
        Entry of the motion list whose path the solver chooses (a free motion).
    points : (k, 4) array
        Joint positions at its points, rad and m.

    Returns
    -------
    (2, 4) array
        Smallest and largest joint positions, rad and m.
    """
    problem, mechanism = phase.problem, phase.mechanism
    ranges = np.array([joint.position for joint in problem.robot.joints]).T
    # The position of joint 4 is the depth, or its negative.
    depth = np.sort(mechanism.insertion_sign * np.array(problem.ranges["depth"]))
    ranges[:, 3] = np.clip(ranges[:, 3], *depth)
    low, high = problem.ranges.get("tilt", (-np.inf, np.inf))
    branches = set(mechanism.branch_of(points).tolist())
    # On each branch, tilt is a monotone function of joint 2 alone and keeps its sign. The range of
    # tilt then limits joint 2, unless it contains both signs or the motion changes the branch.
    if low * high > 0 and max(abs(low), abs(high)) < np.pi and len(branches) == 1:
        ends = np.sort(theta2_from_tilt(mechanism, np.array([low, high]), *branches))
        # Whole turns move the range to the one that contains the start.
        ends += 2 * np.pi * np.round((points[0, 1] - ends.mean()) / (2 * np.pi))
        ranges[:, 1] = np.clip(ranges[:, 1], *ends)
    positions = np.vstack([ranges, points])
    return np.stack([positions.min(axis=0), positions.max(axis=0)])


def alternative_joints(phase: Phase, index: int) -> list[Array]:
    """Return other joint positions within their ranges that reach a target of a free motion.

    They differ from the present ones by the branch (the inverse kinematics has two solutions, the
    branches +1 and −1), or by whole turns of the revolute joints.

    Parameters
    ----------
    phase : Phase
        Entry of the motion list whose path the solver chooses (a free motion).
    index : int
        Index of the target. The targets are the via points (between start and end) and the end.

    Returns
    -------
    list of (4,) arrays
        Joint positions, rad and m. Empty if the problem gives the target in joint coordinates.
    """
    assert isinstance(phase.motion, Free)
    builder = _PhaseBuilder(phase.problem, phase.mechanism, phase.start, phase.q_start)
    _, others = list(builder.targets(phase.motion))[index]
    return list(others)


def _inverse_solutions(
    problem: Problem, mechanism: Mechanism, target: Point, defaults: Array, reference: Array
) -> Solutions:
    """Return all joint solutions of a target in task coordinates, or of a position of the tip.

    Parameters
    ----------
    problem : Problem
        The problem with its ranges.
    mechanism : Mechanism
        Geometry of the robot.
    target : Task or Tip
        The target. A position of the tip must lie in the range of depth.
    defaults : (4,) array
        Task coordinates that replace omitted ones, rad and m.
    reference : (4,) array
        Joint positions, rad and m. The solutions nearest to them come first.

    Returns
    -------
    Solutions
        Joint positions on both branches, that is, for both solutions of the inverse kinematics, and
        which of them reach the target, also within the ranges of the joints.

    Raises
    ------
    ProblemError
        If the mechanism cannot reach the target.
    """
    limits = [joint.position for joint in problem.robot.joints]
    if isinstance(target, Tip):
        solutions = inverse_tip(
            mechanism, [target.position], target.spin, limits=limits, reference=reference
        )
        depth = mechanism.insertion_sign * solutions.joints[0, :, 3]
        low, high = problem.ranges.get("depth", (-np.inf, np.inf))
        # The mechanism may reach a depth that the problem does not allow.
        solutions.reaches[0] &= (depth >= low - ROUNDING_TOLERANCE) & (
            depth <= high + ROUNDING_TOLERANCE
        )
        if not solutions.reaches[0].any():
            raise ProblemError(
                "the mechanism cannot bring the tip there within the depth range",
                file=problem.file,
                line=target.line,
                key="tip",
                value=", ".join(f"{1e3 * x:.4g} mm" for x in target.position),
            )
        return solutions
    assert isinstance(target, Task)
    task = complete_task(problem, mechanism, target, defaults)
    return _cached_inverse_task(mechanism, tuple(task), tuple(limits), tuple(reference))


@lru_cache(maxsize=256)
def _cached_inverse_task(
    mechanism: Mechanism,
    task: tuple[float, ...],
    limits: tuple[Range, ...],
    reference: tuple[float, ...],
) -> Solutions:
    """Solve the inverse kinematics of one target, and cache the result for repeated targets.

    The planner asks for the same target several times, for example when it compares joint positions
    at the start. Without the cache, the problem `waypoints` takes almost twice the CPU time. A
    cache needs hashable arguments, so arrays are passed as tuples.

    Parameters
    ----------
    mechanism : Mechanism
        Geometry of the robot.
    task : tuple of 4 floats
        Task coordinates roll, tilt, spin (rad) and depth (m) of the target.
    limits : tuple of 4 pairs of floats
        Smallest and largest position of each joint, rad and m.
    reference : tuple of 4 floats
        Joint positions, rad and m. The solutions nearest to them come first.

    Returns
    -------
    Solutions
        Joint positions on both branches, that is, for both solutions of the inverse kinematics, and
        which of them are valid.
    """
    return inverse_task(mechanism, [task], limits=limits, reference=reference)

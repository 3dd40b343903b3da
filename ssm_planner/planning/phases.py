"""Phases of a problem: end points by inverse kinematics, branches, and whole turns."""

from __future__ import annotations

from dataclasses import field, replace
from functools import lru_cache
from itertools import product

import numpy as np

from ssm_planner.errors import ProblemError, within
from ssm_planner.kinematics import (
    Mechanism,
    Solutions,
    inverse_task,
    inverse_tip,
    task_from_joints,
    theta2_from_tilt,
)
from ssm_planner.planning.curves import (
    at_distance,
    driven_joints,
    points_of_curve,
    tip_curve,
    without_repeats,
)
from ssm_planner.planning.retiming.blends import BlendedPath, rounded
from ssm_planner.planning.retiming.paths import (
    ClosedPath,
    JointPath,
    SplinePath,
    StraightPath,
    smooth_runs,
)
from ssm_planner.planning.scan_pattern import refuse_tilt, visits_of
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.problem import (
    ALONE,
    OF_TIP,
    TASK,
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
    key_of,
)
from ssm_planner.typing import Array, record


@record
class Phase:
    """One entry of the motion list with its end points in task and joint coordinates."""

    motion: Motion
    start: Array
    end: Array
    """Task coordinates at both ends, (4,) each."""
    points: Array
    """Joints at the start, at the points passed without stopping, and at the end, (k + 1, 4)."""
    path: JointPath | None
    """Given path. None for a free motion and for a robot at rest."""
    qd_start: Array = field(default_factory=lambda: np.zeros(4))
    qd_end: Array = field(default_factory=lambda: np.zeros(4))
    """Joint velocities at both ends, (4,) each."""
    qdd_start: Array = field(default_factory=lambda: np.zeros(4))
    """Joint accelerations (4,) at the start of a free motion with limited jerk."""

    @classmethod
    def standing(cls, motion: Motion, task: Array, q: Array) -> Phase:
        """Return a phase at rest at task coordinates and joints, (4,) each."""
        return cls(motion, task, task, np.stack([q, q]), None)

    @classmethod
    def along(cls, motion: Motion, start: Array, path: JointPath) -> Phase:
        """Return a phase along a path from task coordinates `start` (4,)."""
        knots = path.sample(path.directions[0]).q
        return cls(motion, start, task_at_end(path.mechanism, knots, start), knots, path)

    @property
    def q_start(self) -> Array:
        """Joints at the start, (4,)."""
        return np.asarray(self.points[0])

    @property
    def stands(self) -> bool:
        """True if the robot stays where it is.

        This is a dwell, or a motion whose target is the present position. The latter takes no time
        unless a duration is given.
        """
        return self.path is None and not np.diff(self.points, axis=0).any()

    @property
    def begins_and_ends_at_rest(self) -> bool:
        """True if all joints are at rest at both ends."""
        return not (self.qd_start.any() or self.qd_end.any())

    @property
    def branch(self) -> int | None:
        """Branch of the inverse kinematics on which a given path stays: +1 or −1.

        None otherwise.
        """
        return self.path.branch if isinstance(self.path, (ClosedPath, BlendedPath)) else None


def task_at_end(mechanism: Mechanism, points: Array, start: Array) -> Array:
    """Return task coordinates (4,) at the last of the joints `points` (n, 4).

    They are continuous from `start` (4,) at the first point.
    """
    task = start
    for point in points[1:]:
        task = task_from_joints(mechanism, point[None, :], near=task)[0]
    return task


def start_configurations(problem: Problem, mechanism: Mechanism) -> list[Array]:
    """Return the start configurations (4,) to try.

    These are the given joints, or every closed-form solution with its whole turns, the home branch
    first.
    """
    target = problem.start
    if isinstance(target, Joints):
        return [np.array(target.values)]
    with within("start"):
        solutions = _solutions(problem, mechanism, target, np.zeros(4), None)
    branches = np.where(solutions.reaches[0], solutions.branch[0], 0)
    order = sorted(
        np.flatnonzero(branches), key=lambda k: bool(branches[k] != mechanism.home_branch)
    )
    return [q for k in order for q in _with_turns(solutions.joints[0, k])]


def _with_turns(q: Array) -> list[Array]:
    """Return all combinations of a configuration with whole turns of its revolute joints.

    Each angle is taken within half a turn of zero, and one turn further on the other side of zero.
    The configuration with the smallest sum of angles comes first.
    """
    angles = np.arctan2(np.sin(q[:3]), np.cos(q[:3]))
    choices = [
        [angle, angle - 2 * np.pi * np.sign(angle)] if angle else [angle] for angle in angles
    ]
    grid = [np.array([a, b, c, q[3]]) for a in choices[0] for b in choices[1] for c in choices[2]]
    return sorted(grid, key=lambda joints: float(np.abs(joints[:3]).sum()))


def phases_from(problem: Problem, mechanism: Mechanism, q: Array) -> tuple[Phase, ...]:
    """Return the phases that follow each other from a start configuration q (4,).

    Task coordinates are continuous from phase to phase.

    Raises
    ------
    ProblemError
        If a point is out of reach, or if no motion goes anywhere.
    """
    phases: list[Phase] = []
    reference = None
    if isinstance(problem.start, Task):
        reference = _task_of(problem, mechanism, problem.start, np.zeros(4), "start.tilt")
    task = task_from_joints(mechanism, q[None, :], near=reference)[0]
    keys: list[str] = []
    for k, entry in enumerate(problem.motion):
        key = f"motion[{k}].{key_of(entry)}"
        with within(key):
            for motion in (
                visits_of(problem, mechanism, entry, q) if isinstance(entry, Scan) else (entry,)
            ):
                phases += _PhaseBuilder(problem, mechanism, task, q).phases(motion)
                task, q = phases[-1].end, phases[-1].points[-1]
        keys += [key] * (len(phases) - len(keys))
    phases = _without_stops(problem, phases, keys)
    if not any(
        phase.path is not None or phase.motion.duration or not phase.stands for phase in phases
    ):
        nowhere = phases[0].motion
        reason = "this motion goes nowhere: its start and target are the same"
        raise ProblemError(reason, file=problem.file, line=nowhere.line, key=keys[0])
    return tuple(phases)


@record
class _PhaseBuilder:
    """Builder of the phases of one motion."""

    problem: Problem
    mechanism: Mechanism
    start: Array
    q: Array
    """Task coordinates and joints at the start of the motion, (4,) each."""

    def phases(self, motion: Motion) -> list[Phase]:
        """Return the phases of a motion."""
        if isinstance(motion, Dwell):
            return [Phase.standing(motion, self.start, self.q)]
        if isinstance(motion, Straight):
            return [self._straight(motion)]
        if isinstance(motion, Follow):
            return self._curved(motion)
        assert isinstance(motion, Free)
        return [self._free(motion)]

    def _straight(self, motion: Straight) -> Phase:
        """Return a straight motion."""
        key = "to" if key_of(motion) in ALONE else "to.tilt"
        end = _task_of(self.problem, self.mechanism, motion.to, self.start, key)
        if np.abs(end - self.start).max() < ROUNDING:
            return Phase.standing(motion, self.start, self.q)
        path = straight_path(self.problem, self.mechanism, self.start, end, self.q)
        return Phase(motion, self.start, end, path.sample(np.array([0.0, 1.0])).q, path)

    def _free(self, motion: Free) -> Phase:
        """Return a free motion through its points."""
        points, end = [self.q], self.start
        for k in range(len(motion.through) + 1):
            with within("to" if k == len(motion.through) else f"through[{k}]"):
                target = _target(motion, k, end)
                point = _free_end(self.problem, self.mechanism, target, end, points[-1])
            if np.abs(point - points[-1]).max() < ROUNDING:
                continue
            points.append(point)
            end = task_from_joints(self.mechanism, point[None, :], near=end)[0]
        if len(points) == 1:
            return Phase.standing(motion, self.start, self.q)
        return Phase(motion, self.start, end, np.stack(points), None)

    def _curved(self, motion: Follow) -> list[Phase]:
        """Return the phases along a curve.

        A free motion to the first sample, or to the requested distance from the retina, precedes
        the curve unless the robot is there already.
        """
        if motion.curve in OF_TIP:
            target = self.q
            if motion.distance is not None:
                target = at_distance(self.problem, self.mechanism, motion, self.start, self.q)
            if target is self.q:
                return [self._of_tip(motion)]
            approach, following = self._approach(motion, target)
            return [approach, following._of_tip(motion)]
        points, leading = points_of_curve(self.problem, self.mechanism, motion, self.start, self.q)
        if not leading:
            return self._through(motion, points)
        approach, following = self._approach(motion, points[1])
        return [approach, *following._through(motion, points[1:])]

    def _approach(self, motion: Follow, target: Array) -> tuple[Phase, _PhaseBuilder]:
        """Return the free motion to joints `target` (4,), and the builder that continues there."""
        lead = Free(Joints.from_array(target), name=f"{motion.name}, approach", line=motion.line)
        end = task_from_joints(self.mechanism, target[None], near=self.start)[0]
        phase = Phase(lead, self.start, end, np.stack([self.q, target]), None)
        return phase, replace(self, start=end, q=target)

    def _through(self, motion: Follow, points: Array) -> list[Phase]:
        """Return the phases through points (n, 4), one for every smooth run of samples."""
        scale = self.problem.robot.velocities
        points = without_repeats(points)
        if len(points) == 1:
            return [Phase.standing(motion, self.start, points[-1])]
        runs = smooth_runs(points, scale) if motion.curve == "samples" else [points]
        pieces = self.problem.by_optimal_control(motion)
        phases: list[Phase] = []
        start = self.start
        for k, run in enumerate(runs, 1):
            path = SplinePath(self.mechanism, run, scale, pieces=pieces)
            labelled = motion if len(runs) == 1 else replace(motion, name=f"{motion.name} {k}")
            phases.append(Phase.along(labelled, start, path))
            start = phases[-1].end
        return phases

    def _of_tip(self, motion: Follow) -> Phase:
        """Return the phase in which the tip follows a line or an arc."""
        path: JointPath | Array = tip_curve(
            self.problem, self.mechanism, motion, self.start, self.q
        )
        if not isinstance(path, JointPath):
            joints = path
            if np.abs(joints - self.q).max() < ROUNDING:
                return Phase.standing(motion, self.start, self.q)
            end = task_from_joints(self.mechanism, joints[None], near=self.start)[0]
            path = straight_path(self.problem, self.mechanism, self.start, end, self.q)
        return Phase.along(motion, self.start, path)


def _without_stops(problem: Problem, phases: list[Phase], keys: list[str]) -> list[Phase]:
    """Return the phases, joined to one where corners between them are rounded.

    `keys` are the keys of their motions in the problem file.
    """
    merged: list[Phase] = []
    chain: list[Phase] = []
    for k, phase in enumerate(phases, 1):
        chain.append(phase)
        if not isinstance(phase.motion, (Straight, Follow)) or phase.motion.blend is None:
            merged.append(_rounded_phase(problem, chain, keys[k - len(chain) : k]))
            chain = []
    return merged


def _rounded_phase(problem: Problem, chain: list[Phase], keys: list[str]) -> Phase:
    """Return one phase along the paths of a chain of phases with rounded corners.

    Raises ProblemError.
    """
    if len(chain) == 1:
        return chain[0]
    distances = [getattr(phase.motion, "blend", 0.0) for phase in chain[:-1]]
    pieces = [phase.path for phase in chain if isinstance(phase.path, ClosedPath)]
    resting = next(
        (k for k, phase in enumerate(chain) if not isinstance(phase.path, ClosedPath)), None
    )
    try:
        if resting is not None:
            allowed = "motions that go somewhere, or no blend"
            raise ProblemError(
                "a motion that goes nowhere cannot have a rounded corner",
                key=str(max(resting - 1, 0)),
                allowed=allowed,
            )
        path = rounded(pieces[0].mechanism, pieces, distances)
    except ProblemError as error:
        k = int(error.key or 0)
        error.file = problem.file
        error.line = chain[k].motion.line
        error.key = f"{keys[k]}.blend"
        error.value = f"{1e3 * distances[k]:g} mm"
        raise
    motion = chain[0].motion
    name = " + ".join(dict.fromkeys(phase.motion.name for phase in chain))
    assert not isinstance(motion, Scan)
    points = path.sample(path.directions[0]).q
    return Phase(replace(motion, name=name), chain[0].start, chain[-1].end, points, path)


def straight_path(
    problem: Problem, mechanism: Mechanism, start: Array, end: Array, q: Array
) -> StraightPath:
    """Return the straight path between task coordinates (4,) that begins at joints q (4,)."""
    branch = int(mechanism.branch_of(q))
    driven = driven_joints(problem)
    return StraightPath(mechanism, start=start, end=end, branch=branch, first=q, watched=driven)


def reversal_ranges(problem: Problem, mechanism: Mechanism, points: Array) -> Array:
    """Return the ranges (2, 4) in which joints may reverse on a motion through points (k, 4).

    They are the ranges of the joints, narrowed by those of depth and tilt, and contain the points.
    """
    ranges = np.array([joint.position for joint in problem.robot.joints]).T
    depth = np.sort(mechanism.insertion_sign * np.array(problem.ranges["depth"]))
    ranges[:, 3] = max(ranges[0, 3], depth[0]), min(ranges[1, 3], depth[1])
    low, high = problem.ranges.get("tilt", (-np.inf, np.inf))
    branches = set(mechanism.branch_of(points).tolist())
    # On each branch tilt is a monotone function of joint 2 alone.
    if low * high > 0 and max(abs(low), abs(high)) < np.pi and len(branches) == 1:
        ends = np.sort(theta2_from_tilt(mechanism, np.array([low, high]), *branches))
        ends += 2 * np.pi * np.round((points[0, 1] - ends.mean()) / (2 * np.pi))
        ranges[:, 1] = max(ranges[0, 1], ends[0]), min(ranges[1, 1], ends[1])
    return np.stack(
        [np.minimum(ranges[0], points.min(axis=0)), np.maximum(ranges[1], points.max(axis=0))]
    )


def _target(motion: Free, index: int, task: Array) -> Point:
    """Return the target `index` of a free motion. A free spin keeps its value in `task` (4,)."""
    target = (*motion.through, motion.to)[index]
    if not motion.spin_free or index < len(motion.through) or isinstance(target, Joints):
        return target
    return replace(target, spin=float(task[2]))


def _free_end(
    problem: Problem, mechanism: Mechanism, target: Point, task: Array, reference: Array
) -> Array:
    """Return the joints (4,) at a target of a free motion.

    They are the given ones, or the solution nearest to `reference` (4,), preferably on its branch.
    """
    if isinstance(target, Joints):
        return np.array(target.values)
    solutions = _solutions(problem, mechanism, target, task, reference)
    branch = mechanism.branch_of(reference)
    usable = solutions.valid[0] & (solutions.branch[0] == branch)
    if not usable.any():
        usable = solutions.valid[0] if solutions.valid[0].any() else solutions.reaches[0]
    return np.array(solutions.joints[0, int(np.argmax(usable))])


def other_ends(problem: Problem, mechanism: Mechanism, phase: Phase, index: int) -> list[Array]:
    """Return other joints (4,) within their ranges that reach target `index` of a free phase.

    The targets are the via points and the end. The joints differ by the branch of the inverse
    kinematics and by whole turns. The list is empty if the target gives joints.
    """
    motion = phase.motion
    end = phase.start
    point = phase.q_start
    assert isinstance(motion, Free)
    for k in range(index + 1):
        task = end
        reference = point
        target = _target(motion, k, end)
        point = _free_end(problem, mechanism, target, task, reference)
        end = task_from_joints(mechanism, point[None, :], near=task)[0]
    if isinstance(target, Joints):
        return []
    solutions = _solutions(problem, mechanism, target, task, reference)
    ranges = np.array([joint.position for joint in problem.robot.joints[:3]])
    ends = []
    for q in solutions.joints[0, solutions.valid[0]]:
        turned = q[:3, None] + 2 * np.pi * np.array([0, -1, 1])
        inside = (turned >= ranges[:, :1] - ROUNDING) & (turned <= ranges[:, 1:] + ROUNDING)
        turns = [angles[mask] for angles, mask in zip(turned, inside, strict=True)]
        ends += [np.array([*angles, q[3]]) for angles in product(*turns)]
    return [q for q in ends if np.abs(q - point).max() > ROUNDING]


def _solutions(
    problem: Problem, mechanism: Mechanism, target: Point, defaults: Array, reference: Array | None
) -> Solutions:
    """Return all joint solutions of a target in task coordinates or of a tip position.

    A tip position is restricted to the depth range. Raises ProblemError if the target is out of
    reach.
    """
    limits = (
        None if reference is None else np.array([joint.position for joint in problem.robot.joints])
    )
    if isinstance(target, Tip):
        solutions = inverse_tip(
            mechanism, [target.position], target.spin, limits=limits, reference=reference
        )
        depth = mechanism.insertion_sign * solutions.joints[0, :, 3]
        low, high = problem.ranges.get("depth", (-np.inf, np.inf))
        solutions.reaches[0] &= (depth >= low - ROUNDING) & (depth <= high + ROUNDING)
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
    task = _task_of(problem, mechanism, target, defaults)
    return _inverse(
        mechanism,
        *(None if array is None else array.tobytes() for array in (task, limits, reference)),
    )


@lru_cache(maxsize=256)
def _inverse(
    mechanism: Mechanism, task: bytes | None, limits: bytes | None, reference: bytes | None
) -> Solutions:
    """Return `inverse_task` of one target, cached for repeated targets (`waypoints`: 40 % less CPU).

    Arrays are passed as bytes, because they must be hashable.
    """
    assert task is not None
    within = None if limits is None else np.frombuffer(limits).reshape(4, 2)
    reference_joints = None if reference is None else np.frombuffer(reference)
    return inverse_task(
        mechanism, np.frombuffer(task)[None, :], limits=within, reference=reference_joints
    )


def _task_of(
    problem: Problem, mechanism: Mechanism, target: Task, defaults: Array, key: str = "tilt"
) -> Array:
    """Return the task coordinates (4,) of a target.

    Coordinates that it does not name are taken from `defaults`.

    `key` is the key of the tilt in error messages.
    """
    task = np.array([target.set_coordinates.get(name, defaults[k]) for k, name in enumerate(TASK)])
    refuse_tilt(problem, mechanism, float(task[1]), line=target.line, key=key)
    return task

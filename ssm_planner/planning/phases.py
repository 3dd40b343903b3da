"""Phases of a problem: end points by inverse kinematics, branches, and whole turns."""

from __future__ import annotations

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
from ssm_planner.planning.retiming.blends import BlendedPath, rounded
from ssm_planner.planning.retiming.paths import (
    ClosedPath,
    JointPath,
    SplinePath,
    StraightPath,
    smooth_runs,
)
from ssm_planner.planning.scan_pattern import refuse_tilt, visits_of
from ssm_planner.planning.tolerances import ROUNDING, SAME
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
from ssm_planner.typing import Array, Range, record


@record
class Phase:
    """One entry of the motion list with its end points in task and joint coordinates."""

    problem: Problem
    motion: Motion
    start: Array
    end: Array
    """Task coordinates at both ends, (4,) each."""
    points: Array
    """Joints at the start, at the points passed without stopping, and at the end, (k + 1, 4)."""
    path: JointPath | None = None
    """Given path. None for a free motion and for a robot at rest."""
    qd_start: Array = field(default_factory=lambda: np.zeros(4))
    qd_end: Array = field(default_factory=lambda: np.zeros(4))
    """Joint velocities at both ends, (4,) each."""
    qdd_start: Array = field(default_factory=lambda: np.zeros(4))
    """Joint accelerations (4,) at the start of a free motion with limited jerk."""

    @cached_property
    def mechanism(self) -> Mechanism:
        """Mechanism of the problem's robot."""
        return Mechanism.from_robot(self.problem.robot)

    @cached_property
    def lower_bound(self) -> float:
        """Duration that no motion between the ends can beat, s."""
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
    def least_duration(self) -> float:
        """Requested duration, or else the lower bound, s.

        It is infinite if the requested duration is shorter than the bound.
        """
        duration = self.motion.duration
        if self.stands:
            return duration or 0.0
        if duration is None:
            return self.lower_bound
        return duration if self.lower_bound <= duration * (1 + SAME) else np.inf

    @property
    def q_start(self) -> Array:
        """Joints at the start, (4,)."""
        return np.asarray(self.points[0])

    @property
    def stands(self) -> bool:
        """True if the robot stays where it is.

        This is a dwell, or a motion from rest whose target is the present position. The latter
        takes no time unless a duration is given.
        """
        moves = self.path is not None or np.diff(self.points, axis=0).any()
        return not moves and self.begins_and_ends_at_rest

    @property
    def begins_and_ends_at_rest(self) -> bool:
        """True if all joints are at rest at both ends."""
        return not (self.qd_start.any() or self.qd_end.any())

    def part(self, points: Array, *, to_end: bool = True) -> Phase:
        """Return the free motion from rest through other points (k, 4).

        It ends with the velocities of this phase, or at rest if `to_end` is false.
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
        """Return ṡ at both ends of a path."""
        return path.speed_at(0.0, self.qd_start), path.speed_at(1.0, self.qd_end)

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


def start_configurations(problem: Problem) -> list[Array]:
    """Return the start configurations (4,) to try.

    These are the given joints, or every closed-form solution with its whole turns, the home branch
    first.
    """
    target = problem.start
    if isinstance(target, Joints):
        return [np.array(target.values)]
    with within("start"):
        mechanism = Mechanism.from_robot(problem.robot)
        solutions = _solutions(problem, mechanism, target, np.zeros(4), None)
    reaching = np.flatnonzero(solutions.reaches[0])
    order = sorted(reaching, key=lambda k: bool(solutions.branch[0, k] != mechanism.home_branch))
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
    grid = [np.array([*turned, q[3]]) for turned in product(*choices)]
    return sorted(grid, key=lambda joints: float(np.abs(joints[:3]).sum()))


def phases_from(problem: Problem, q: Array) -> tuple[Phase, ...]:
    """Return the phases that follow each other from a start configuration q (4,).

    Task coordinates are continuous from phase to phase.

    Raises
    ------
    ProblemError
        If a point is out of reach, or if no motion goes anywhere.
    """
    mechanism = Mechanism.from_robot(problem.robot)
    phases: list[Phase] = []
    reference = None
    if isinstance(problem.start, Task):
        reference = _task_of(problem, mechanism, problem.start, np.zeros(4), "start.tilt")
    task = task_from_joints(mechanism, q[None, :], near=reference)[0]
    keys: list[str] = []
    for k, entry in enumerate(problem.motion):
        key = f"motion[{k}].{key_of(entry)}"
        with within(key):
            motions: list[Motion] = [entry]
            if isinstance(entry, Scan):
                motions = visits_of(problem, mechanism, entry, q)
            for motion in motions:
                phases += _PhaseBuilder(problem, mechanism, task, q).phases(motion)
                task, q = phases[-1].end, phases[-1].points[-1]
        keys += [key] * (len(phases) - len(keys))
    phases = _without_stops(problem, phases, keys)
    at_speed = problem.start_rate or problem.end_rate
    may_return = at_speed and any(isinstance(phase.motion, Free) for phase in phases)
    if not may_return and all(phase.stands and not phase.motion.duration for phase in phases):
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
            return [self._standing(motion)]
        if isinstance(motion, Straight):
            return [self._straight(motion)]
        if isinstance(motion, Follow):
            return self._curved(motion)
        assert isinstance(motion, Free)
        return [self._free(motion)]

    def _standing(self, motion: Motion) -> Phase:
        """Return a phase at rest."""
        points = np.stack([self.q, self.q])
        return Phase(self.problem, motion, self.start, self.start, points)

    def _along(self, motion: Motion, path: JointPath) -> Phase:
        """Return a phase along a path."""
        knots = path.sample(path.directions[0]).q
        end = task_at_end(self.mechanism, knots, self.start)
        return Phase(self.problem, motion, self.start, end, knots, path=path)

    def _moved(self, q: Array) -> _PhaseBuilder:
        """Return the builder that continues at joints q (4,)."""
        end = task_from_joints(self.mechanism, q[None], near=self.start)[0]
        return replace(self, start=end, q=q)

    def _straight(self, motion: Straight) -> Phase:
        """Return a straight motion."""
        key = "to" if key_of(motion) in ALONE else "to.tilt"
        end = _task_of(self.problem, self.mechanism, motion.to, self.start, key)
        if np.abs(end - self.start).max() < ROUNDING:
            return self._standing(motion)
        path = straight_path(self.problem, self.mechanism, self.start, end, self.q)
        points = path.sample(np.array([0.0, 1.0])).q
        return Phase(self.problem, motion, self.start, end, points, path=path)

    def _free(self, motion: Free) -> Phase:
        """Return a free motion through its points."""
        points, there = [self.q], self
        for _, _, there in self.targets(motion):
            if np.abs(there.q - points[-1]).max() >= ROUNDING:
                points.append(there.q)
        if len(points) == 1:
            return self._standing(motion)
        return Phase(self.problem, motion, self.start, there.start, np.stack(points))

    def targets(self, motion: Free) -> Iterator[tuple[Point, _PhaseBuilder, _PhaseBuilder]]:
        """Yield the targets of a free motion, with the builders before and at each of them.

        A free spin keeps its value.
        """
        here = self
        for k, target in enumerate((*motion.through, motion.to)):
            is_last = k == len(motion.through)
            if is_last and motion.spin_free and not isinstance(target, Joints):
                target = replace(target, spin=float(here.start[2]))
            with within("to" if is_last else f"through[{k}]"):
                there = here._moved(here._free_end(target))
            yield target, here, there
            here = there

    def _free_end(self, target: Point) -> Array:
        """Return the joints (4,) at a target of a free motion.

        They are the given ones, or the solution nearest to q, preferably on its branch.
        """
        if isinstance(target, Joints):
            return np.array(target.values)
        solutions = self.solutions(target)
        branch = self.mechanism.branch_of(self.q)
        usable = solutions.valid[0] & (solutions.branch[0] == branch)
        if not usable.any():
            usable = solutions.valid[0] if solutions.valid[0].any() else solutions.reaches[0]
        return np.array(solutions.joints[0, int(np.argmax(usable))])

    def solutions(self, target: Point) -> Solutions:
        """Return all joint solutions of a target, those nearest to q first."""
        return _solutions(self.problem, self.mechanism, target, self.start, self.q)

    def _curved(self, motion: Follow) -> list[Phase]:
        """Return the phases along a curve.

        A free motion to its beginning precedes the curve unless the robot is there already.
        """
        curve = CurveFollower(self.problem, self.mechanism, motion, self.start, self.q)
        beginning = curve.beginning
        phases: list[Phase] = []
        builder = self
        if beginning is not self.q:
            builder = self._moved(beginning)
            name = f"{motion.name}, approach"
            lead = Free(Joints.from_array(beginning), name=name, line=motion.line)
            points = np.stack([self.q, beginning])
            phases = [Phase(self.problem, lead, self.start, builder.start, points)]
        if motion.curve in OF_TIP:
            return [*phases, builder._of_tip(motion)]
        return [*phases, *builder._through(motion, curve.points)]

    def _through(self, motion: Follow, points: Array) -> list[Phase]:
        """Return the phases through points (n, 4), one for every smooth run of samples."""
        scale = self.problem.robot.velocities
        if len(points) == 1:
            return [self._standing(motion)]
        runs = smooth_runs(points, scale) if motion.curve == "samples" else [points]
        pieces = self.problem.by_optimal_control(motion)
        phases: list[Phase] = []
        builder = self
        for k, run in enumerate(runs, 1):
            path = SplinePath(self.mechanism, run, scale, pieces=pieces)
            labelled = motion if len(runs) == 1 else replace(motion, name=f"{motion.name} {k}")
            phases.append(builder._along(labelled, path))
            builder = replace(self, start=phases[-1].end)
        return phases

    def _of_tip(self, motion: Follow) -> Phase:
        """Return the phase in which the tip follows a line or an arc."""
        path = CurveFollower(self.problem, self.mechanism, motion, self.start, self.q).tip_path()
        if isinstance(path, JointPath):
            return self._along(motion, path)
        if np.abs(path - self.q).max() < ROUNDING:
            return self._standing(motion)
        end = self._moved(path).start
        straight = straight_path(self.problem, self.mechanism, self.start, end, self.q)
        return self._along(motion, straight)


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
    pieces = []
    try:
        for k, phase in enumerate(chain):
            if not isinstance(phase.path, ClosedPath):
                raise ProblemError(
                    "a motion that goes nowhere cannot have a rounded corner",
                    key=str(max(k - 1, 0)),
                    allowed="motions that go somewhere, or no blend",
                )
            pieces.append(phase.path)
        path = rounded(pieces[0].mechanism, pieces, distances)
    except ProblemError as error:
        k = int(error.key or 0)
        error.file = problem.file
        error.line = chain[k].motion.line
        error.key = f"{keys[k]}.blend"
        error.value = f"{1e3 * distances[k]:g} mm"
        raise
    name = " + ".join(dict.fromkeys(phase.motion.name for phase in chain))
    motion = replace(chain[0].motion, name=name)
    points = path.sample(path.directions[0]).q
    return Phase(problem, motion, chain[0].start, chain[-1].end, points, path=path)


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


def other_ends(phase: Phase, index: int) -> list[Array]:
    """Return other joints (4,) within their ranges that reach target `index` of a free phase.

    The targets are the via points and the end. The joints differ by the branch of the inverse
    kinematics and by whole turns. The list is empty if the target gives joints.
    """
    assert isinstance(phase.motion, Free)
    builder = _PhaseBuilder(phase.problem, phase.mechanism, phase.start, phase.q_start)
    target, here, there = list(builder.targets(phase.motion))[index]
    if isinstance(target, Joints):
        return []
    solutions = here.solutions(target)
    ranges = np.array([joint.position for joint in phase.problem.robot.joints[:3]])
    ends = []
    for q in solutions.joints[0, solutions.valid[0]]:
        turned = q[:3, None] + 2 * np.pi * np.array([0, -1, 1])
        inside = (turned >= ranges[:, :1] - ROUNDING) & (turned <= ranges[:, 1:] + ROUNDING)
        turns = [angles[mask] for angles, mask in zip(turned, inside, strict=True)]
        ends += [np.array([*angles, q[3]]) for angles in product(*turns)]
    return [q for q in ends if np.abs(q - there.q).max() > ROUNDING]


def _solutions(
    problem: Problem, mechanism: Mechanism, target: Point, defaults: Array, reference: Array | None
) -> Solutions:
    """Return all joint solutions of a target in task coordinates or of a tip position.

    A tip position is restricted to the depth range. Raises ProblemError if the target is out of
    reach.
    """
    limits = None
    if reference is not None:
        limits = tuple(joint.position for joint in problem.robot.joints)
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
    near = None if reference is None else tuple(reference.tolist())
    return _inverse(mechanism, tuple(task.tolist()), limits, near)


@lru_cache(maxsize=256)
def _inverse(
    mechanism: Mechanism,
    task: tuple[float, ...],
    limits: tuple[Range, ...] | None,
    reference: tuple[float, ...] | None,
) -> Solutions:
    """Return `inverse_task` of one target, cached for repeated targets (`waypoints`: 28 % less CPU)."""
    return inverse_task(mechanism, [task], limits=limits, reference=reference)


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

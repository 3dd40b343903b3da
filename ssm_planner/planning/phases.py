"""From the motion list of a problem to phases with closed-form inverse kinematics: end points, branch, joint turns."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product

import numpy as np

from ssm_planner.errors import ProblemError, within
from ssm_planner.kinematics.inverse import inverse_task, inverse_tip
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.solutions import Solutions
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.kinematics.workspace import theta2_from_tilt
from ssm_planner.planning.curves import (
    NOWHERE,
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
from ssm_planner.problem.limits import TASK
from ssm_planner.problem.motion import (
    ALONE,
    OF_TIP,
    Dwell,
    Follow,
    Free,
    Joints,
    Motion,
    Point,
    Scan,
    Straight,
    Task,
    Tip,
    key_of,
)
from ssm_planner.problem.problem import Problem
from ssm_planner.typing import Array


@dataclass(frozen=True, eq=False)
class Phase:
    """One entry of the motion list, with its place in the robot's workspace."""

    motion: Motion
    start: Array
    end: Array
    """Task coordinates at both ends, (4,)."""
    points: Array
    """Joints at the start, at the points passed without stopping, and at the end, (k + 1, 4)."""
    path: JointPath | None
    """None for a free motion, and where the robot stands."""
    qd_start: Array = field(default_factory=lambda: np.zeros(4))
    qd_end: Array = field(default_factory=lambda: np.zeros(4))
    """Joint speeds at both ends, (4,)."""
    qdd_start: Array = field(default_factory=lambda: np.zeros(4))
    """Joint accelerations at the start of a free motion where jerk is limited, (4,)."""

    @property
    def q_start(self) -> Array:
        return np.asarray(self.points[0])

    @property
    def stands(self) -> bool:
        """The robot stays where it is: a dwell, or a motion to where it already is, which takes no time unless asked for."""
        return self.path is None and not np.diff(self.points, axis=0).any()

    @property
    def branch(self) -> int | None:
        """Branch of the inverse kinematics that a straight motion, a line or an arc stays on: +1 or −1."""
        return self.path.branch if isinstance(self.path, (ClosedPath, BlendedPath)) else None


def start_configurations(problem: Problem, mechanism: Mechanism) -> list[Array]:
    """Start configurations (4,) to try: as given, or every closed-form solution with its whole turns."""
    target = problem.start
    if isinstance(target, Joints):
        return [np.array(target.values)]
    with within("start"):
        found = _solutions(problem, mechanism, target, np.zeros(4), None)
    branches = np.where(found.reaches[0], found.branch[0], 0)
    order = sorted(
        np.flatnonzero(branches), key=lambda k: bool(branches[k] != mechanism.home_branch)
    )
    return [q for k in order for q in _with_turns(found.joints[0, k])]


def _with_turns(q: Array) -> list[Array]:
    """The same configuration with revolute joints within half a turn of zero, and one turn to the other side."""
    angles = np.arctan2(np.sin(q[:3]), np.cos(q[:3]))
    choices = [
        [angle, angle - 2 * np.pi * np.sign(angle)] if angle else [angle] for angle in angles
    ]
    grid = [np.array([a, b, c, q[3]]) for a in choices[0] for b in choices[1] for c in choices[2]]
    return sorted(grid, key=lambda joints: float(np.abs(joints[:3]).sum()))


def phases_from(problem: Problem, mechanism: Mechanism, q: Array) -> tuple[Phase, ...]:
    """The phases one after the other from a start configuration q (4,); task coordinates stay continuous.

    Raises ProblemError for a point out of reach or a motion that goes nowhere.
    """
    phases: list[Phase] = []
    near = None
    if isinstance(problem.start, Task):
        near = _task_of(problem, mechanism, problem.start, np.zeros(4), "start.tilt")
    task = task_from_joints(mechanism, q[None, :], near=near)[0]
    places: list[str] = []
    for k, entry in enumerate(problem.motion):
        place = f"motion[{k}].{key_of(entry)}"
        with within(place):
            for motion in (
                visits_of(problem, mechanism, entry, q) if isinstance(entry, Scan) else (entry,)
            ):
                phases += _phases_of(problem, mechanism, motion, (task, q))
                task, q = phases[-1].end, phases[-1].points[-1]
        places += [place] * (len(phases) - len(places))
    phases = _without_stops(problem, mechanism, phases, places)
    if not any(
        phase.path is not None or phase.motion.duration or not phase.stands for phase in phases
    ):
        nowhere = phases[0].motion
        reason = "this motion goes nowhere: its start and target are the same"
        raise ProblemError(reason, file=problem.file, line=nowhere.line, key=places[0])
    return tuple(phases)


def _phases_of(
    problem: Problem, mechanism: Mechanism, motion: Motion, at: tuple[Array, Array]
) -> list[Phase]:
    """The phases of one motion; at: task coordinates and joints where it starts, (4,) each."""
    task, q = at
    if isinstance(motion, Dwell):
        return [Phase(motion, task, task, np.stack([q, q]), None)]
    if isinstance(motion, Straight):
        return [_straight_phase(problem, mechanism, motion, at)]
    if isinstance(motion, Follow):
        return _curved_phases(problem, mechanism, motion, at)
    assert isinstance(motion, Free)
    return [_free_phase(problem, mechanism, motion, at)]


def _without_stops(
    problem: Problem, mechanism: Mechanism, phases: list[Phase], places: list[str]
) -> list[Phase]:
    """The phases, those between rounded corners as one; places: of their motions in the problem."""
    merged: list[Phase] = []
    chain: list[Phase] = []
    for k, phase in enumerate(phases, 1):
        chain.append(phase)
        if not isinstance(phase.motion, (Straight, Follow)) or phase.motion.blend is None:
            there = places[k - len(chain) : k]
            merged.append(
                chain[0] if len(chain) == 1 else _rounded_phase(problem, mechanism, chain, there)
            )
            chain = []
    return merged


def _rounded_phase(
    problem: Problem, mechanism: Mechanism, chain: list[Phase], places: list[str]
) -> Phase:
    """A phase along those of a chain, corners rounded. Raises ProblemError."""
    distances = [getattr(phase.motion, "blend", 0.0) for phase in chain[:-1]]
    pieces = [phase.path for phase in chain if isinstance(phase.path, ClosedPath)]
    stands = next(
        (k for k, phase in enumerate(chain) if not isinstance(phase.path, ClosedPath)), None
    )
    try:
        if stands is not None:
            keeps = "motions that go somewhere, or no blend"
            raise ProblemError(
                "a motion that goes nowhere has no corner",
                key=str(max(stands - 1, 0)),
                allowed=keeps,
            )
        path = rounded(mechanism, pieces, distances)
    except ProblemError as error:
        k = int(error.key or 0)
        error.file, error.line, error.key = problem.file, chain[k].motion.line, f"{places[k]}.blend"
        error.value = f"{1e3 * distances[k]:g} mm"
        raise
    first, name = chain[0].motion, " + ".join(dict.fromkeys(phase.motion.name for phase in chain))
    assert not isinstance(first, Scan)
    points = path.sample(path.directions[0]).q
    return Phase(replace(first, name=name), chain[0].start, chain[-1].end, points, path)


def _straight_phase(
    problem: Problem, mechanism: Mechanism, motion: Straight, at: tuple[Array, Array]
) -> Phase:
    """A motion straight in task coordinates; at: task coordinates and joints where it starts, (4,) each."""
    start, q = at
    end = _task_of(
        problem, mechanism, motion.to, start, "to" if key_of(motion) in ALONE else "to.tilt"
    )
    if np.abs(end - start).max() < NOWHERE:
        return Phase(motion, start, start, np.stack([q, q]), None)
    path = straight_path(problem, mechanism, start, end, q)
    return Phase(motion, start, end, path.sample(np.array([0.0, 1.0])).q, path)


def _free_phase(
    problem: Problem, mechanism: Mechanism, motion: Free, at: tuple[Array, Array]
) -> Phase:
    """A motion through points and to the last; at: task coordinates and joints where it starts, (4,) each."""
    start, q = at
    points, end = [q], start
    for k in range(len(motion.through) + 1):
        with within("to" if k == len(motion.through) else f"through[{k}]"):
            point = _free_end(problem, mechanism, _target(motion, k, end), end, points[-1])
        if np.abs(point - points[-1]).max() < NOWHERE:
            continue
        points.append(point)
        end = task_from_joints(mechanism, point[None, :], near=end)[0]
    return Phase(motion, start, end, np.stack(points if len(points) > 1 else [q, q]), None)


def _curved_phases(
    problem: Problem, mechanism: Mechanism, motion: Follow, at: tuple[Array, Array]
) -> list[Phase]:
    """A motion along a curve; at: task coordinates and joints where it starts, (4,) each.

    Through samples: a free motion to the first of them unless the robot is there, and a phase for every smooth run of them.
    """
    start, q = at
    if motion.distance is not None:
        return _retina_phases(problem, mechanism, motion, at)
    if motion.curve in OF_TIP:
        return [_tip_phase(problem, mechanism, motion, at)]
    points, leading = points_of_curve(problem, mechanism, motion, start, q)
    phases: list[Phase] = []
    if leading:
        lead = Free(_as_joints(points[1]), name=f"{motion.name}, approach", line=motion.line)
        start = task_from_joints(mechanism, points[1:2], near=start)[0]
        phases.append(Phase(lead, at[0], start, points[:2], None))
        points = points[1:]
    scale = np.array([joint.velocity for joint in problem.robot.joints])
    points = without_repeats(points)
    runs = (
        smooth_runs(points, scale)
        if motion.curve == "samples"
        else [points]
        if len(points) > 1
        else []
    )
    for k, run in enumerate(runs, 1):
        path = SplinePath(mechanism, run, scale, pieces=problem.by_optimal_control(motion))
        knots = path.sample(path.directions[0]).q
        end = start
        for point in knots[1:]:
            end = task_from_joints(mechanism, point[None, :], near=end)[0]
        named = motion if len(runs) == 1 else replace(motion, name=f"{motion.name} {k}")
        phases.append(Phase(named, start, end, knots, path))
        start = end
    return phases or [Phase(motion, start, start, np.stack([points[-1], points[-1]]), None)]


def _retina_phases(
    problem: Problem, mechanism: Mechanism, motion: Follow, at: tuple[Array, Array]
) -> list[Phase]:
    """Along the retina, after a free motion to the distance from it unless the tip is there; at: as for `_tip_phase`."""
    start, q = at
    first = at_distance(problem, mechanism, motion, start, q)
    if first is q:
        return [_tip_phase(problem, mechanism, motion, at)]
    lead = Free(_as_joints(first), name=f"{motion.name}, approach", line=motion.line)
    end = task_from_joints(mechanism, first[None], near=start)[0]
    return [
        Phase(lead, start, end, np.stack([q, first]), None),
        _tip_phase(problem, mechanism, motion, (end, first)),
    ]


def _tip_phase(
    problem: Problem, mechanism: Mechanism, motion: Follow, at: tuple[Array, Array]
) -> Phase:
    """A motion along a line or an arc of the tip; at: task coordinates and joints where it starts, (4,) each."""
    start, q = at
    path: JointPath | Array = tip_curve(problem, mechanism, motion, start, q)
    if not isinstance(path, JointPath):
        last = path
        if np.abs(last - q).max() < NOWHERE:
            return Phase(motion, start, start, np.stack([q, q]), None)
        path = straight_path(
            problem, mechanism, start, task_from_joints(mechanism, last[None], near=start)[0], q
        )
    knots = path.sample(path.directions[0]).q
    end = start
    for point in knots[1:]:
        end = task_from_joints(mechanism, point[None, :], near=end)[0]
    return Phase(motion, start, end, knots, path)


def _as_joints(q: Array) -> Joints:
    a, b, c, d = q.tolist()
    return Joints((a, b, c, d))


def straight_path(
    problem: Problem, mechanism: Mechanism, start: Array, end: Array, q: Array
) -> StraightPath:
    """The path from start to end, straight in task coordinates (4,), from the joints q (4,) on; with the drives' turns."""
    branch, driven = int(mechanism.branch_of(q)), driven_joints(problem)
    return StraightPath(mechanism, start=start, end=end, branch=branch, first=q, watched=driven)


def joint_room(problem: Problem, mechanism: Mechanism, points: Array) -> Array:
    """Where joints may turn back on a motion through points (k, 4): ranges of joints, of depth and of tilt, (2, 4)."""
    room = np.array([joint.position for joint in problem.robot.joints]).T
    depth = np.sort(mechanism.insertion_sign * np.array(problem.ranges["depth"]))
    room[:, 3] = max(room[0, 3], depth[0]), min(room[1, 3], depth[1])
    low, high = problem.ranges.get("tilt", (-np.inf, np.inf))
    branches = set(mechanism.branch_of(points).tolist())
    # tilt follows joint 2 alone, one way on each branch
    if low * high > 0 and max(abs(low), abs(high)) < np.pi and len(branches) == 1:
        ends = np.sort(theta2_from_tilt(mechanism, np.array([low, high]), *branches))
        ends += 2 * np.pi * np.round((points[0, 1] - ends.mean()) / (2 * np.pi))
        room[:, 1] = max(room[0, 1], ends[0]), min(room[1, 1], ends[1])
    return np.stack(
        [np.minimum(room[0], points.min(axis=0)), np.maximum(room[1], points.max(axis=0))]
    )


def _target(motion: Free, place: int, held: Array) -> Point:
    """A target of a free motion; a spin that is free is that of the task coordinates (4,) before it."""
    target = (*motion.through, motion.to)[place]
    if not motion.spin_free or place < len(motion.through) or isinstance(target, Joints):
        return target
    return replace(target, spin=float(held[2]))


def _free_end(
    problem: Problem, mechanism: Mechanism, target: Point, held: Array, first: Array
) -> Array:
    """Joints at the end of a free motion: as given, or the solution nearest to where it starts, on the same branch."""
    if isinstance(target, Joints):
        return np.array(target.values)
    found = _solutions(problem, mechanism, target, held, first)
    branch = mechanism.branch_of(first)
    usable = found.valid[0] & (found.branch[0] == branch)
    if not usable.any():
        usable = found.valid[0] if found.valid[0].any() else found.reaches[0]
    return np.array(found.joints[0, int(np.argmax(usable))])


def other_ends(problem: Problem, mechanism: Mechanism, phase: Phase, place: int) -> list[Array]:
    """Joints (4,) within their ranges that reach a target of a free phase, as those that it takes do; place: of which.

    The targets are those on the way and the last. Branches of the inverse kinematics, and whole turns of joints.
    """
    motion, end, point = phase.motion, phase.start, phase.q_start
    assert isinstance(motion, Free)
    for k in range(place + 1):
        held, first, target = end, point, _target(motion, k, end)
        point = _free_end(problem, mechanism, target, held, first)
        end = task_from_joints(mechanism, point[None, :], near=held)[0]
    if isinstance(target, Joints):
        return []
    found = _solutions(problem, mechanism, target, held, first)
    ranges = np.array([joint.position for joint in problem.robot.joints[:3]])
    others = []
    for q in found.joints[0, found.valid[0]]:
        turns = [
            _turns_within(float(angle), *limits) for angle, limits in zip(q, ranges, strict=False)
        ]
        others += [np.array([*angles, q[3]]) for angles in product(*turns)]
    return [q for q in others if np.abs(q - point).max() > NOWHERE]


def _turns_within(angle: float, low: float, high: float) -> list[float]:
    """The angles within a range that are whole turns from one, up to one to each side of it."""
    return [
        turned
        for k in (0, -1, 1)
        if low - NOWHERE <= (turned := angle + 2 * np.pi * k) <= high + NOWHERE
    ]


def _solutions(
    problem: Problem, mechanism: Mechanism, target: Point, held: Array, reference: Array | None
) -> Solutions:
    """All joint solutions of a target in task coordinates or tip position."""
    limits = (
        None if reference is None else np.array([joint.position for joint in problem.robot.joints])
    )
    if isinstance(target, Tip):
        found = inverse_tip(
            mechanism, [target.position], target.spin, limits=limits, reference=reference
        )
        depth = mechanism.insertion_sign * found.joints[0, :, 3]
        low, high = problem.ranges.get("depth", (-np.inf, np.inf))
        found.reaches[0] &= (depth >= low - NOWHERE) & (depth <= high + NOWHERE)
        if not found.reaches[0].any():
            raise ProblemError(
                "the mechanism cannot bring the tip there within the depth range",
                file=problem.file,
                line=target.line,
                key="tip",
                value=", ".join(f"{1e3 * x:.4g} mm" for x in target.position),
            )
        return found
    assert isinstance(target, Task)
    task = _task_of(problem, mechanism, target, held)
    return _inverse(
        mechanism, *(None if each is None else each.tobytes() for each in (task, limits, reference))
    )


@lru_cache(maxsize=256)
def _inverse(
    mechanism: Mechanism, task: bytes | None, limits: bytes | None, reference: bytes | None
) -> Solutions:
    """`inverse_task` of one target: other joints for one of several targets ask for the same ones again."""
    assert task is not None
    within = None if limits is None else np.frombuffer(limits).reshape(4, 2)
    near = None if reference is None else np.frombuffer(reference)
    return inverse_task(mechanism, np.frombuffer(task)[None, :], limits=within, reference=near)


def _task_of(
    problem: Problem, mechanism: Mechanism, target: Task, held: Array, key: str = "tilt"
) -> Array:
    """Task coordinates (4,) of a target that names some; those that it does not name are held. key: of the tilt."""
    task = np.array([target.given.get(name, held[k]) for k, name in enumerate(TASK)])
    refuse_tilt(problem, mechanism, float(task[1]), line=target.line, key=key)
    return task

"""Every public value refuses impossible contents and accepts valid contents. Seeded edits by
`dataclasses.replace` produce both.
"""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle
import typing
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_drive, load_motorisation, load_problem, load_robot
from ssm_planner.problem.drive import Ratings
from ssm_planner.problem.limits import TaskRange, TaskRate, TipSpeed
from ssm_planner.problem.motion import Dwell, Free, Joints, Straight, Task, Tip
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.value import Value, unchecked_copy
from tests.support.paths import PROBLEMS

EDITS = 200


def values() -> list[Any]:
    """Return at least one value of every public type."""
    robot, problem = load_robot("vitreoretinal"), load_problem("laser_scan")
    rig, motorisation = load_drive("rig3_worm"), load_motorisation("paper")
    driven = robot.joints[0]
    eye = problem.eye
    assert driven.drive is not None
    assert eye is not None
    return [
        robot, robot.geometry, robot.bodies[0], driven, driven.drive, driven.drive.friction, driven.motor, rig, rig.rig,
        Ratings(1.0, 2.0, 300.0, 0.5, 0.05, 0.003, "fixed-free"), motorisation, motorisation.strokes[0],
        problem, load_problem("tilt_insert"), eye, eye.lens, problem.motion[0],
        Task(tilt=-1.9, depth=0.01), Joints((0.1, 0.2, 0.3, -0.01)), Tip((0.001, 0.0, -0.01), 0.1),
        Straight(tilt=-2.0, duration=2.0), Free(Task(tilt=-2.0), (Joints((0.1, 0.2, 0.3, -0.01)),)), Dwell(0.2),
        TaskRange("tilt", -2.4, -1.4), TaskRate("tilt", 0.5), TipSpeed(0.02),
    ]  # fmt: skip


VALUES = values()
BY_NAME = {type(value).__name__: value for value in VALUES}


def bad_contents(value: Any, field: str, rng: np.random.Generator) -> Any:
    """Return contents that the field cannot hold, derived from its present contents."""
    now = getattr(value, field)
    wrong_types: list[Any] = [True, object(), {1, 2}, b"x", 1j]
    if isinstance(now, bool):
        return rng.choice(np.array(["yes", "1"]))
    if isinstance(now, (int, float)):
        return [math.nan, math.inf, -math.inf, "1.0", "fast", True, [now], object(), 1j][
            rng.integers(9)
        ]
    if isinstance(now, str):
        return [3, 1.5, True, [now], object()][rng.integers(5)]
    if isinstance(now, np.ndarray):
        with_nan = now.copy()
        with_nan.flat[rng.integers(now.size)] = [math.nan, math.inf][rng.integers(2)]
        return [with_nan, now.ravel()[:-1], now[None], now.astype(str), "x", now.astype(bool)][
            rng.integers(6)
        ]
    if isinstance(now, tuple) and now and isinstance(now[0], float):
        fixed = "..." not in str(typing.get_type_hints(type(value))[field])
        return [
            (math.nan, *now[1:]),
            ("a", *now[1:]),
            (True, *now[1:]),
            3.0,
            (*now, now[-1]) if fixed else (None,),
        ][rng.integers(5)]
    if isinstance(now, tuple):
        return [("nonsense",), (*now, object()), 3, "abc"][rng.integers(4)]
    if isinstance(now, Mapping):
        return [{"tlt": math.nan}, 3, "abc", [1.0], {"mu": object()}][rng.integers(5)]
    return wrong_types[rng.integers(len(wrong_types))]


def assert_refused(value: Any, **changes: Any) -> None:
    """Assert that a change is refused with its key, its value and the allowed contents."""
    (field, *_), kind = changes, type(value).__name__
    with pytest.raises(ProblemError) as caught:
        dataclasses.replace(value, **changes)
    error = caught.value
    assert error.key is not None, error
    assert error.key.startswith(kind), error
    assert any(name in error.key for name in changes) or field in str(error), (field, error)
    assert error.value is not None, error
    assert error.allowed, error


@pytest.mark.parametrize("seed", range(EDITS))
def test_no_bad_edit_gets_past(seed: int) -> None:
    rng = np.random.default_rng(7919 + seed)
    value = VALUES[seed % len(VALUES)]
    fields = [field.name for field in dataclasses.fields(value)]
    field = str(rng.choice(fields))
    assert_refused(value, **{field: bad_contents(value, field, rng)})


NOT_POSITIVE = [
    (kind, field, number)
    for kind, fields in {
        "Joint": ("velocity", "acceleration", "jerk"),
        "Motor": (
            "nominal_torque",
            "max_torque",
            "max_speed",
            "rotor_inertia",
            "torque_constant",
            "encoder_counts",
        ),
        "Drive": ("ratio", "gamma", "lead_angle", "pressure_angle"),
        "Friction": ("stribeck_speed", "identified_speed"),
        "Ratings": (
            "continuous_output",
            "peak_output",
            "input_speed",
            "duty",
            "free_length",
            "root_diameter",
        ),
        "Rig": ("motor_nominal_torque", "payload_arm", "gravity"),
        "Stroke": ("reach", "velocity", "acceleration"),
        "Eye": ("radius", "port"),
        "Scan": ("distance", "spacing"),
        "Straight": ("duration",),
        "Free": ("duration",),
        "Dwell": ("duration",),
        "Problem": ("duration",),
        "TaskRate": ("largest",),
        "TipSpeed": ("largest",),
    }.items()
    for field in fields
    for number in (0, -1)
]


@pytest.mark.parametrize(("kind", "field", "number"), NOT_POSITIVE)
def test_zero_and_negative_where_neither_can_be(kind: str, field: str, number: int) -> None:
    assert_refused(BY_NAME[kind], **{field: number})


@pytest.mark.parametrize(
    ("kind", "field"),
    [
        *(("Friction", name) for name in ("mu", "b_c", "b_v", "b_oc", "b_ov", "memory", "dwell_constant", "mu_lowest")),
        *(("Drive", name) for name in ("input_inertia", "output_inertia", "preload", "second_nut_mass")),
        *(("Eye", name) for name in ("clearance", "shaft_radius")),
        ("Body", "mass"), ("Rig", "payload_mass"), ("Scan", "dwell"),
    ],
)  # fmt: skip
def test_negative_where_it_cannot_be(kind: str, field: str) -> None:
    assert_refused(BY_NAME[kind], **{field: -1e-3})


ROBOT: Robot = load_robot("vitreoretinal")
PROBLEM: Problem = dataclasses.replace(load_problem("tilt_insert"), eye=None)
GEOMETRY, BODY, JOINT = ROBOT.geometry, ROBOT.bodies[0], ROBOT.joints[0]
DRIVE = JOINT.drive
assert DRIVE is not None
assert DRIVE.friction is not None
CONTRADICTIONS: list[tuple[Any, dict[str, Any]]] = [
    (GEOMETRY, {"omega1": 1.001 * GEOMETRY.omega1}),
    (GEOMETRY, {"omega2": GEOMETRY.omega1}),
    (GEOMETRY, {"tool_home": np.eye(3)}),
    (GEOMETRY, {"tool_home": 2 * GEOMETRY.tool_home}),
    (GEOMETRY, {"insertion_sign": 0}),
    (BODY, {"inertia": -BODY.inertia}),
    (BODY, {"inertia": np.diag([1.0, 1.0, 3.0])}),
    (BODY, {"inertia": BODY.inertia + np.triu(np.full((3, 3), 1e-3), 1)}),
    (BODY, {"mass": 0.0}),
    (BODY, {"frame": -BODY.frame}),
    (JOINT, {"position": (1.0, -1.0)}),
    (JOINT, {"position": (1.0, 1.0)}),
    (JOINT, {"name": "tlt"}),
    (JOINT, {"kind": "helical"}),
    (JOINT, {"drive": load_drive("rig3_worm")}),
    (JOINT, {"drive": ROBOT.joints[3].drive}),
    (ROBOT, {"joints": ROBOT.joints[:3]}),
    (ROBOT, {"joints": ROBOT.joints[::-1]}),
    (ROBOT, {"bodies": ROBOT.bodies[:3]}),
    (ROBOT, {"limits": (TaskRange("depth", 1.0, 2.0),)}),
    (DRIVE, {"friction": None}),
    (DRIVE, {"friction_ranges": {"mu": (0.5, 0.6)}}),
    (DRIVE, {"friction_ranges": {"nu": (0.1, 0.2)}}),
    (DRIVE, {"lead_angle": 1.2}),
    (DRIVE.friction, {"mu_static": 0.5 * DRIVE.friction.mu}),
    (DRIVE.friction, {"mu": 2 * DRIVE.friction.mu_static}),
    (DRIVE.friction, {"law": "stribeck_gaussian"}),
    (DRIVE.friction, {"mu_stribeck": 0.1}),
    (BY_NAME["Ratings"], {"peak_output": 0.5}),
    (BY_NAME["Ratings"], {"duty": 1.5}),
    (BY_NAME["Motor"], {"torque_constant_per_kelvin": 0.1}),
    (BY_NAME["Motor"], {"time_constant_winding": 10.0, "time_constant_motor": 1.0}),
    (BY_NAME["Stroke"], {"joint": "tlt"}),
    (BY_NAME["Motorisation"], {"strokes": (BY_NAME["Stroke"], BY_NAME["Stroke"])}),
    (BY_NAME["Eye"], {"clearance": 1.0}),
    (BY_NAME["Lens"], {"semi_axes": np.array([1e-3, 0.0, 1e-3])}),
    (BY_NAME["Lens"], {"frame": np.ones((3, 3))}),
    (BY_NAME["Scan"], {"at": Task(roll=0.0)}),
    (BY_NAME["Scan"], {"rows": 3}),
    (BY_NAME["Scan"], {"diameters": (2e-3, 1e-3)}),
    (BY_NAME["Tip"], {"position": (0.0, 0.0, 0.0)}),
    (BY_NAME["TaskRange"], {"lower": -1.0}),
    (BY_NAME["TaskRange"], {"coordinate": "tlt"}),
    (PROBLEM, {"objective": "fastest"}),
    (PROBLEM, {"objective": "effort"}),
    (PROBLEM, {"planner": "toppra", "objective": "effort", "duration": 9.0}),
    (PROBLEM, {"planner": "toppra", "motion": (Free(Task(tilt=-2.0)),)}),
    (PROBLEM, {"planner": "toppra", "robot": dataclasses.replace(
        ROBOT, joints=(dataclasses.replace(JOINT, jerk=50.0), *ROBOT.joints[1:]))}),
    (PROBLEM, {"motion": ()}),
    (PROBLEM, {"motion": (BY_NAME["Scan"],)}),
    (PROBLEM, {"limits": (TaskRange("tilt", -1.2, -0.8),)}),
    (PROBLEM, {"limits": (TaskRange("depth", 0.04, 0.05),)}),
    (PROBLEM, {"limits": (TaskRange("tilt", -2.0, -1.45),)}),
    (PROBLEM, {"eye": dataclasses.replace(BY_NAME["Eye"], lens=None), "motion": (
        dataclasses.replace(BY_NAME["Scan"], at=Task(tilt=-3.0)),)}),
    (JOINT, {"motor": dataclasses.replace(BY_NAME["Motor"], rotor_inertia=1.0)}),
    (BY_NAME["Motor"], {"max_torque": 0.9 * BY_NAME["Motor"].nominal_torque}),
    (BY_NAME["Eye"], {"centre": 0.5 * BY_NAME["Eye"].centre}),
    (BY_NAME["Eye"], {"port": 1e-4}),
    (BY_NAME["Eye"], {"lens": dataclasses.replace(BY_NAME["Lens"], centre=np.array([0.0, 0.0, -1e-3]))}),
    (PROBLEM, {"limits": {"tilt": (-2.4, -1.4)}}),
    (PROBLEM, {"limits": (TaskRange("tilt", -2.4, -1.4), TaskRange("tilt", -2.3, -1.5))}),
    (PROBLEM, {"start_rate": {"tlt": 0.1}}),
    (PROBLEM, {"end_rate": {"tilt": math.nan}}),
]  # fmt: skip


@pytest.mark.parametrize(
    ("value", "changes"), CONTRADICTIONS, ids=lambda x: ",".join(x) if isinstance(x, dict) else None
)
def test_contradictions(value: Any, changes: dict[str, Any]) -> None:
    assert_refused(value, **changes)


def somewhere_outside(problem: Problem, rng: np.random.Generator) -> Task | Joints | Tip:
    """Return a point with one coordinate beyond its range."""
    beyond = float(10 ** rng.uniform(-6, 1)) * float(rng.choice([-1, 1]))
    form = int(rng.integers(3))
    if form == 0:
        name = str(rng.choice(list(problem.ranges)))
        low, high = problem.ranges[name]
        return Task(**{name: high + beyond if beyond > 0 else low + beyond})
    if form == 1:
        k = int(rng.integers(4))
        values = [sum(joint.position) / 2 for joint in problem.robot.joints]
        low, high = problem.robot.joints[k].position
        values[k] = high + beyond if beyond > 0 else low + beyond
        return Joints((values[0], values[1], values[2], values[3]))
    direction = rng.normal(size=3)
    far = max(map(abs, problem.ranges["depth"])) + abs(beyond)
    x, y, z = (direction * far / np.linalg.norm(direction)).tolist()
    return Tip((x, y, z), 0.1)


@pytest.mark.parametrize("seed", range(1000, 1000 + EDITS))
def test_no_point_outside_its_range_gets_past(seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem: Problem = [PROBLEM, BY_NAME["Problem"]][seed % 2]
    point = somewhere_outside(problem, rng)
    place = int(rng.integers(3))
    if place == 0 and not isinstance(point, Task):
        return assert_refused(problem, start=point)
    inside = Task(tilt=-1.9)
    if place == 1:
        return assert_refused(problem, motion=(Free(inside, (inside, point)),))
    if isinstance(point, Task) and rng.random() < 0.5:
        return assert_refused(problem, motion=(Dwell(0.1), Straight(**point.set_coordinates)))
    return assert_refused(problem, motion=(Free(point),))


def test_a_robot_whose_own_range_is_narrower_brings_its_range_along() -> None:
    robot = dataclasses.replace(ROBOT, limits=(TaskRange("tilt", -2.0, -1.45),))
    with pytest.raises(
        ProblemError,
        match=r"motion\[0\].tilt = -135 deg: outside the limits of tilt .* -114.592 deg to",
    ):
        dataclasses.replace(PROBLEM, robot=robot)


def test_a_point_on_the_end_of_its_range_passes() -> None:
    for problem in (PROBLEM, BY_NAME["Problem"]):
        for name, ends in problem.ranges.items():
            for end in ends:
                assert dataclasses.replace(problem, motion=(Straight(**{name: end}),))


HEALTHY: list[Callable[[], Any]] = [
    lambda: dataclasses.replace(ROBOT, name="another", gravity=[0, 0, -9.8]),
    lambda: dataclasses.replace(JOINT, velocity=np.float64(2.0), jerk=50, position=[-1, 1]),
    lambda: dataclasses.replace(
        DRIVE.friction, law="stribeck_gaussian", mu_stribeck=0.05, stribeck_speed=3
    ),
    lambda: dataclasses.replace(DRIVE, self_locking=False, friction_ranges={"mu": [0.05, 0.5]}),
    lambda: dataclasses.replace(
        PROBLEM, motion=[Straight(tilt=-2.0), Dwell(0.2)], limits=[TipSpeed(0.02)]
    ),
    lambda: dataclasses.replace(PROBLEM, objective="effort", duration=9.0),
    lambda: dataclasses.replace(PROBLEM, planner="toppra"),
    lambda: dataclasses.replace(BY_NAME["Scan"], diameters=(), rows=3, columns=np.int64(4)),
    lambda: dataclasses.replace(BY_NAME["Eye"], clearance=0),
]


@pytest.mark.parametrize("edit", HEALTHY)
def test_healthy_edits_pass(edit: Callable[[], Any]) -> None:
    assert isinstance(edit(), Value)


@pytest.mark.parametrize("value", VALUES, ids=lambda value: type(value).__name__)
def test_values_are_equal_by_content(value: Any) -> None:
    for same in (
        dataclasses.replace(value),
        copy.deepcopy(value),
        pickle.loads(pickle.dumps(value)),
    ):
        assert same == value
        assert hash(same) == hash(value)
    assert value != 3


def test_two_loads_of_one_file_are_equal() -> None:
    for name in ("tilt_insert", "laser_scan", "waypoints", "eye_approach"):
        assert load_problem(name) == load_problem(PROBLEMS / f"{name}.yaml")
    assert load_problem("tilt_insert") != load_problem("waypoints")
    heavier = dataclasses.replace(BODY, mass=2 * BODY.mass, inertia=2 * BODY.inertia)
    assert dataclasses.replace(ROBOT, bodies=(heavier, *ROBOT.bodies[1:])) != ROBOT


def test_a_trial_value_is_not_checked_and_leaves_the_original() -> None:
    free_of_friction = unchecked_copy(DRIVE.friction, mu=np.zeros((3, 1)))
    assert free_of_friction.mu.shape == (3, 1)
    assert isinstance(DRIVE.friction.mu, float)

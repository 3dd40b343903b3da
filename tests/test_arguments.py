"""Wrong arguments of public functions raise one error that names argument, value and allowed types."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
import pytest

import ssm_planner
from ssm_planner.arguments import checked
from ssm_planner.errors import ProblemError, SsmPlannerError, TrajectoryError
from tests.support.paths import ROOT

WRONG = {
    "None": None,
    "number": 3,
    "NaN": float("nan"),
    "bytes": b"x",
    "complex": 1 + 2j,
    "object": object(),
    "task": ssm_planner.Task(tilt=-2.0),
    "texts": ["a", "b"],
    "ragged": [[1, 2], [3]],
    "mapping": {"a": None},
}
SCALARS = {"float": {"number"}, "int": {"number"}, "ArrayLike": {"number", "NaN"}}
"""Labels of the wrong values that are valid for the annotated types."""
FUNCTIONS = {
    name: value
    for name in ssm_planner.__all__
    if inspect.isfunction(value := getattr(ssm_planner, name))
}


def fits(annotation: str, label: str) -> bool:
    """Return True if a value belongs to an annotated type.

    The value is given by its label, and the type by the text of its annotation.
    """
    members = {re.sub(r"\[.*", "", member).strip() for member in annotation.split(" | ")}
    return label in members or any(label in SCALARS.get(member, ()) for member in members)


CASES = [
    pytest.param(name, parameter.name, label, id=f"{name}-{parameter.name}-{label}")
    for name, function in sorted(FUNCTIONS.items())
    for parameter in inspect.signature(function).parameters.values()
    for label in WRONG
    if parameter.kind is not parameter.VAR_KEYWORD
    if not fits(str(parameter.annotation), label)
    if not (label == "texts" and "Sequence[str" in str(parameter.annotation))
]


@pytest.mark.parametrize(("name", "argument", "label"), CASES)
def test_a_wrong_argument_is_named(name: str, argument: str, label: str) -> None:
    function = FUNCTIONS[name]
    robot = ssm_planner.load_robot("vitreoretinal") if argument != "robot" else None
    valid: dict[str, Any] = {"robot": robot, "recordings": ["x.csv"], "tilt_low": -2.0}
    valid |= {"tilt_high": -1.0, "q": [0.0] * 4, "qd": [0.0] * 4, "qdd": [0.0] * 4, "to": "csv"}
    if name == "compare":
        valid["recordings"] = {"roll": "x.csv"}
    required = {
        parameter.name: valid.get(parameter.name, "nothing")
        for parameter in inspect.signature(function).parameters.values()
        if parameter.default is parameter.empty and parameter.kind is not parameter.VAR_KEYWORD
    }
    with pytest.raises(SsmPlannerError) as caught:
        function(**{**required, argument: WRONG[label]})
    message = str(caught.value)
    assert message.startswith(f"{argument} = ")
    assert f"wrong argument of {name}()" in message
    assert "(allowed: " in message


@pytest.mark.parametrize("function", FUNCTIONS.values(), ids=FUNCTIONS)
def test_every_public_function_checks_its_arguments(function: Any) -> None:
    codes = set()
    while function is not None:
        codes.add(function.__code__)
        function = getattr(function, "__wrapped__", None)
    assert checked(test_the_message_of_a_missing_file).__code__ in codes


def test_numbers_of_numpy_are_numbers() -> None:
    @checked
    def area(width: float, count: int, path: str | Path = "x") -> float:
        return width * count

    assert area(np.float64(2.0), np.int64(3)) == area(2, 3) == 6.0
    for wrong in ({"width": True}, {"count": 2.0}, {"width": np.inf}, {"path": None}):
        with pytest.raises(ProblemError, match=f"^{next(iter(wrong))} = "):
            area(**{"width": 1.0, "count": 1, **wrong})
    with pytest.raises(TypeError, match="missing"):
        area()


def test_the_message_of_a_missing_file() -> None:
    with pytest.raises(TrajectoryError, match=r"^nothing: no such file or folder$"):
        ssm_planner.check("nothing")
    with pytest.raises(ProblemError, match=r"^instants = 0: .*at least 1"):
        ssm_planner.controlled_stops("x", instants=0)


HOSTILE = {
    **WRONG,
    "infinity": float("inf"),
    "huge": 1e300,
    "empty list": [],
    "empty rows": np.empty((0, 4)),
    "rows": np.zeros((3, 4)),
    "NaN array": np.full(3, np.nan),
    "text array": np.array(["a"]),
    "function": len,
    "class": ssm_planner.Robot,
}
"""Values of many types. Hardly any method accepts one of them."""
TEXTS = {"text": "a", "empty text": "", "negative": -1.5, "zero": 0}
PYTHON_ERRORS = {
    "Joint.limit": KeyError,  # like a mapping
    "JointLoad.by_parts": TypeError,  # of the caller's function
}
NOT_CALLED_BY_USERS = (
    "Choice.value_at", "Cycle.from_torque", "Cycle.mean", "Demands.from_table", "JointLoad.rms",
    "Study.design", "Transmission.effort_arm", "Varied.grid",
)  # fmt: skip
"""Helpers of results that refuse wrong types, but not every wrong shape."""


def public_values() -> dict[str, Any]:
    """Return an instance of the public classes whose methods have arguments, by class name."""
    plan = ssm_planner.load_plan(ROOT / "results" / "tilt_insert")
    robot = plan.robot
    assert plan.certificate is not None
    assert plan.sizing is not None
    study = ssm_planner.load_study("vitreoretinal")
    values = [
        plan, robot, plan.motion, plan.problem, plan.limits, plan.certificate,
        plan.certificate.limits[0], *robot.joints[0].limits, robot.joints[0], *robot.limits,
        robot.joints[0].drive, *plan.phases, ssm_planner.Replanner(plan.problem),
        ssm_planner.design_region(-2.0, -1.9), ssm_planner.Scenario(), plan.sizing.joints[0],
        *study.vary, study, ssm_planner.load_controller("epos4"), ssm_planner.TipSpeed(0.1),
        ssm_planner.TaskRate("tilt", 0.1), ssm_planner.Joints((0.0, 0.5, 0.0, 0.0)),
        plan.sizing.joints[0].band,
    ]  # fmt: skip
    return {type(value).__name__: value for value in values}


VALUES = public_values()
METHODS = {
    f"{name}.{member}": (value, member)
    for name, value in VALUES.items()
    for member in dir(type(value))
    if member[0] != "_"
    and isinstance(inspect.getattr_static(value, member), (FunctionType, classmethod))
}


@pytest.mark.parametrize("name", METHODS)
def test_a_method_refuses_what_it_cannot_use(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No public method answers a wrong argument with an error from deep in the package."""
    monkeypatch.chdir(tmp_path)
    value, member = METHODS[name]
    method = getattr(value, member)
    parameters = inspect.signature(method).parameters.values()
    valid: dict[str, Any] = {"robot": VALUES["Robot"], "trajectory": VALUES["Trajectory"]}
    valid |= {"motion": VALUES["Plan"], "t": np.array([0.1]), "joint": "roll", "file": Path("x")}
    required = {
        parameter.name: valid.get(parameter.name, 0.5)
        for parameter in parameters
        if parameter.default is parameter.empty
        and parameter.kind is parameter.POSITIONAL_OR_KEYWORD
    }
    faults = []
    for parameter in parameters:
        if parameter.kind is not parameter.POSITIONAL_OR_KEYWORD:
            continue
        for label, wrong in {**HOSTILE, **TEXTS}.items():
            try:
                method(**{**required, parameter.name: wrong})
            except SsmPlannerError:
                pass
            except Exception as error:  # noqa: BLE001 - any error of Python is a fault
                expected = PYTHON_ERRORS.get(name, ())
                is_problem = member == "on"  # a type variable, because of the order of modules
                if name not in NOT_CALLED_BY_USERS and not (
                    is_problem or isinstance(error, expected)
                ):
                    faults.append(f"{parameter.name}={label}: {error!r}")
    assert not faults


PLAN, ROBOT, MOTION = VALUES["Plan"], VALUES["Robot"], VALUES["Trajectory"]
REPLANNER = VALUES["Replanner"]
MISUSES: dict[str, tuple[Any, str]] = {
    "rate of 0": (lambda: MOTION.uniform(0), r"^rate = 0 .*allowed: above 0"),
    "negative rate": (lambda: MOTION.uniform(-1), r"^rate = -1 .*allowed: above 0"),
    "absurd rate": (lambda: MOTION.uniform(1e12), r"^rate = 1e\+12 .*10,000,000 samples"),
    "text as a time": (lambda: MOTION.sample("a"), r"^t = a: .*allowed: array of numbers"),
    "square times": (lambda: MOTION.sample(np.zeros((2, 2))), r"^t has shape \(2, 2\)"),
    "positions outside": (lambda: MOTION.positions(np.array([99.0])), r"^t = 99 s is not between"),
    "wrong side": (lambda: MOTION.sample(0.1, "up"), r"^side = up: .*'left' or 'right'"),
    "speed of 0": (lambda: MOTION.slower(0.0), r"^speed = 0: .*allowed: above 0"),
    "no points": (lambda: ssm_planner.retime(np.empty((0, 4)), ROBOT), r"^path: 0 points"),
    "empty path": (lambda: ssm_planner.retime([], ROBOT), r"^path has shape \(0,\)"),
    "text as a rate": (
        lambda: ssm_planner.export(PLAN, "csv", rate="fast"),
        r"^rate = fast: .*allowed: float or None",
    ),
    "too many stops": (
        lambda: ssm_planner.export(PLAN, "csv", stops=10**30),
        r"^stops = 1.*numbers up to 1e\+15",
    ),
    "array as a motion": (
        lambda: ssm_planner.Plan.from_trajectory(np.zeros((3, 4)), ROBOT),
        r"^trajectory = .*allowed: Trajectory",
    ),
    "no folder": (lambda: PLAN.save(None), r"^folder = None: .*allowed: str or Path"),
    "no axes": (lambda: PLAN.plot(3), r"^axes = 3: .*allowed: matplotlib Axes"),
    "too many instants": (
        lambda: ssm_planner.controlled_stops(PLAN, instants=10**9),
        r"^instants = 1000000000: .*at most 100000",
    ),
    "unknown condition": (lambda: ssm_planner.size(PLAN, colour=1), r"colour: unknown key"),
    "name as a problem": (lambda: ssm_planner.Replanner("tilt_insert"), r"^problem = tilt_insert"),
    "number as a start": (lambda: REPLANNER.plan(start=3), r"^start = 3: .*Task or Joints or Tip"),
    "no coefficients": (lambda: ssm_planner.Trajectory(None, None, ()), r"^breaks = None"),
    "huge angle": (lambda: ssm_planner.ik(ROBOT, 1e300, 0, 0, 0), r"^roll = 1e\+300"),
    "wrong limits": (lambda: ssm_planner.TaskLimits(3), r"^limits = 3"),
    "array as a choice": (
        lambda: ssm_planner.Friction(0.1, 0.1, 0.0, 0.0, law=np.zeros(3)),
        r"wrong type of value .*coulomb",
    ),
}


@pytest.mark.parametrize("label", MISUSES)
def test_a_misuse_names_argument_value_and_allowed_values(
    label: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    misuse, message = MISUSES[label]
    with pytest.raises(SsmPlannerError, match=message):
        misuse()
    assert not list(tmp_path.iterdir())


def test_calls_within_the_package_are_not_checked() -> None:
    robot = ssm_planner.load_robot("vitreoretinal")
    source = "def call(joint): return joint.find_limit(3)"
    names: dict[str, Any] = {"__name__": "ssm_planner.somewhere"}
    exec(source, names)
    with pytest.raises(TypeError, match="isinstance"):
        names["call"](robot.joints[0])
    with pytest.raises(ProblemError, match=r"^limit_type = 3"):
        robot.joints[0].find_limit(3)  # type: ignore[arg-type]

"""Wrong arguments of public functions raise one error that names argument, value and allowed types."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ssm_planner
from ssm_planner.arguments import checked
from ssm_planner.errors import ProblemError, SsmPlannerError, TrajectoryError

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
    assert f"no argument for {name}()" in message
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

"""Public values keep their content in files and in other processes.

The problem of a stored plan gives the same motion again.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import pickle
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import ssm_planner
from ssm_planner import Certificate, LimitCheck, Plan, Problem, Trajectory, load_plan, plan
from ssm_planner.loading.files import read_section, section_from_text, shipped_files
from ssm_planner.loading.robots import robot_from
from ssm_planner.problem.serialization import problem_from_plain, to_plain
from ssm_planner.studies.study_file import resolved_robot_content
from ssm_planner.view.page import ViewedProblem
from tests.problem.test_serialization import same
from tests.support.cases import selected
from tests.support.paths import ROOT
from tests.support.random_problems import random_problem

SHIPPED = sorted(path.stem for path in (ROOT / "problems").glob("*.yaml"))
FRESH = """
import pickle, sys
values = pickle.load(sys.stdin.buffer)
texts = [repr(value) for value in values]
sys.stdout.buffer.write(pickle.dumps((values, texts)))
"""
"""Program of a process that knows only the pickled values."""
NUMBERS = st.floats(-1e3, 1e3, allow_subnormal=False)


def in_a_fresh_process(values: list[Any]) -> tuple[list[Any], list[str]]:
    data = pickle.dumps(values)
    done = subprocess.run(
        [sys.executable, "-c", FRESH], input=data, capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr.decode()
    returned: tuple[list[Any], list[str]] = pickle.loads(done.stdout)
    return returned


def parts_of(value: object, seen: set[int]) -> Iterator[object]:
    """Yield the dataclasses in a value, among them the value itself."""
    if id(value) in seen:
        return
    seen.add(id(value))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield value
        for field in dataclasses.fields(value):
            yield from parts_of(getattr(value, field.name), seen)
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from parts_of(item, seen)
    elif isinstance(value, (tuple, list)):
        for item in value:
            yield from parts_of(item, seen)


def check_same(a: Any, b: Any) -> None:
    """Assert that two values are equal in depth.

    Only the elements of arrays are compared, because some values make their arrays read-only.
    """
    if isinstance(a, np.ndarray):
        assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    elif dataclasses.is_dataclass(a):
        assert type(a) is type(b)
        for field in dataclasses.fields(a):
            check_same(getattr(a, field.name), getattr(b, field.name))
    elif isinstance(a, (tuple, list)):
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            check_same(x, y)
    elif isinstance(a, Mapping):
        assert list(a) == list(b)
        check_same(list(a.values()), list(b.values()))
    else:
        assert a == b or a is b or repr(a) == repr(b)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_the_problem_of_a_plan_plans_again_to_the_same_motion(name: str, tmp_path: Path) -> None:
    first = plan(name)
    assert first.trajectory is not None
    again = plan(load_plan(first.write(tmp_path / "plan.json")).problem)
    assert np.array_equal(again.motion.breaks, first.motion.breaks)
    assert np.array_equal(again.motion.coefficients, first.motion.coefficients)
    assert again.certificate == first.certificate


def test_values_of_a_plan_return_from_a_fresh_process() -> None:
    result = load_plan(ROOT / "results/tilt_insert")
    others = (result.sizing, result.stops, result.motion.uniform(50.0))
    robot = result.robot
    others += (
        ssm_planner.fk(robot, [0.0] * 4),
        ssm_planner.ik(robot),
        ssm_planner.workspace(robot),
    )
    values, seen = [], set[int]()
    for value in (result, *others):
        values += parts_of(value, seen)
    public = {type(value) for value in values} & {
        value
        for name in ssm_planner.__all__
        if inspect.isclass(value := getattr(ssm_planner, name))
    }
    assert len(public) > 35
    returned, texts = in_a_fresh_process(values)
    assert texts == [repr(value) for value in values]
    for value, copy in zip(values, returned, strict=True):
        check_same(value, copy)


def valid_problem(base: Problem, seed: int) -> Problem:
    """Return a random problem whose motors have at least their nominal torque."""
    problem = random_problem(base, seed)
    joints = tuple(
        dataclasses.replace(joint, motor=motor)
        if (motor := joint.motor) is None or motor.max_torque >= motor.nominal_torque
        else dataclasses.replace(
            joint, motor=dataclasses.replace(motor, nominal_torque=motor.max_torque)
        )
        for joint in problem.robot.joints
    )
    return dataclasses.replace(problem, robot=dataclasses.replace(problem.robot, joints=joints))


@pytest.mark.slow
@settings(max_examples=selected(250, every=1000), deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_random_problem_returns_from_its_file(tilt_insert: Problem, seed: int) -> None:
    problem = valid_problem(tilt_insert, seed)
    text = json.dumps(to_plain(problem), allow_nan=False)
    same(problem, problem_from_plain(json.loads(text)))


@pytest.mark.slow
def test_random_problems_return_from_a_fresh_process(tilt_insert: Problem) -> None:
    problems = [random_problem(tilt_insert, seed) for seed in range(200)]
    returned, _ = in_a_fresh_process(problems)
    for problem, copy in zip(problems, returned, strict=True):
        check_same(problem, copy)


@st.composite
def motions(draw: st.DrawFn) -> Trajectory:
    lengths = draw(st.lists(st.floats(1e-3, 10.0), min_size=1, max_size=5))
    states = draw(
        st.lists(
            st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12),
            min_size=len(lengths) + 1,
            max_size=len(lengths) + 1,
        )
    )
    q, qd, qdd = np.split(np.array(states), 3, axis=1)
    motion = Trajectory.from_samples(np.cumsum([0.0, *lengths]), q, qd, qdd)
    span = ssm_planner.Span("all", 0.0, float(motion.breaks[-1]))
    return Trajectory(motion.breaks, motion.coefficients, (span,))


CHECKS = st.builds(
    LimitCheck,
    st.text(),
    st.none() | st.text(),
    worst=NUMBERS,
    limit=NUMBERS,
    margin=NUMBERS,
    time=NUMBERS,
    unit=st.text(),
    case=st.none() | st.text(),
)


@pytest.mark.slow
@settings(max_examples=selected(250, every=1000), deadline=None)
@given(motions(), st.lists(CHECKS, max_size=4), st.lists(st.text(), max_size=2))
def test_random_motions_and_certificates_return_from_their_file(
    motion: Trajectory, checks: list[LimitCheck], unchecked: list[str]
) -> None:
    copy = Trajectory.from_dict(json.loads(json.dumps(motion.to_dict())))
    check_same(motion, copy)
    certificate = Certificate(tuple(checks), "random", 7, tuple(unchecked), "ab")
    data = json.loads(json.dumps(certificate.to_dict()))
    assert Certificate.from_dict(data) == certificate


@pytest.mark.parametrize("name", shipped_files("robots"))
def test_a_robot_returns_from_the_content_of_its_file(name: str) -> None:
    robot = ssm_planner.load_robot(name)
    content = resolved_robot_content(read_section(shipped_files("robots")[name]))
    assert robot_from(section_from_text(yaml.safe_dump(content))) == robot


@pytest.mark.parametrize("name", SHIPPED)
def test_a_problem_returns_from_the_text_of_the_view(name: str) -> None:
    problem = ssm_planner.load_problem(name)
    study = ViewedProblem(problem)
    angles = {key: study.start()["values"][key] for key in ("alpha", "beta")}
    assert Problem.from_yaml(study.problem_file({**angles, "own": True})["text"]) == problem


def test_a_difference_is_noticed() -> None:
    result = load_plan(ROOT / "results/tilt_insert")
    with pytest.raises(AssertionError):
        check_same(result, dataclasses.replace(result, stopped=True))
    with pytest.raises(AssertionError):
        check_same(result.motion, result.motion.slower(0.5))
    assert isinstance(result, Plan)

"""Every public value has a text of at most 400 characters."""

from __future__ import annotations

import dataclasses
import inspect
import re

import numpy as np

import ssm_planner
from ssm_planner import Problem, Robot
from ssm_planner.plans import load_plan
from ssm_planner.representation import LONGEST_TEXT, short_repr
from ssm_planner.typing import record
from tests.support.paths import ROOT


def test_public_values_that_hold_arrays_or_other_values_have_short_texts() -> None:
    for name in ssm_planner.__all__:
        value = getattr(ssm_planner, name)
        if not inspect.isclass(value) or not dataclasses.is_dataclass(value):
            continue
        types = " ".join(str(field.type) for field in dataclasses.fields(value))
        if re.search(r"Array|Mapping|\bdict|\blist|tuple.*\.\.\.|Problem|Robot", types):
            assert value.__repr__ is short_repr, name


def test_values_of_a_plan_show_themselves_in_400_characters(
    robot: Robot, tilt_insert: Problem
) -> None:
    plan = load_plan(ROOT / "results/tilt_insert/plan.json")
    assert plan.trajectory is not None
    assert plan.certificate is not None
    samples = plan.trajectory.uniform(100.0)
    for value in (robot, tilt_insert, plan, plan.trajectory, plan.certificate, samples):
        assert len(repr(value)) <= LONGEST_TEXT
        assert repr(value).startswith(type(value).__name__ + "(")


def test_a_text_that_is_too_long_is_cut() -> None:
    @record
    class Wide:
        first: tuple[float, ...]
        second: np.ndarray

    kind = dataclasses.make_dataclass("Wider", [(f"a{k}", float) for k in range(100)])
    assert len(short_repr(kind(*range(100)))) == LONGEST_TEXT
    assert repr(Wide((1.0,), np.zeros((3, 4)))).endswith("first=(1.0,), second=<array (3, 4)>)")

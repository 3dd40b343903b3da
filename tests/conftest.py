"""Fixtures of all tests, and settings that make every run the same."""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # pytest-xdist uses all cores
os.environ["COLUMNS"] = "100"  # Printed text must not depend on the terminal of the test run.

import pytest

pytest.register_assert_rewrite("tests.support")
pytest_plugins = ["tests.support.plugin"]

from dataclasses import replace

from hypothesis import settings

from ssm_planner.loading.load import load_problem, load_robot
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from tests.support.paths import PROBLEMS

# Every run draws the same cases, so that a new failure comes from a change of the code.
# HYPOTHESIS_PROFILE=search draws other cases.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("search", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))


@pytest.fixture
def few_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sample posteriors at few points, for tests that need no accurate intervals."""
    from ssm_planner.identification import sampling

    monkeypatch.setattr(sampling, "ADAPTATION_POINTS", (2**11,) * 4)
    monkeypatch.setattr(sampling, "FINAL_POINTS", 2**12)


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no figures of plans and start no process for them, in tests that need no figures."""
    from ssm_planner.reporting.figures import process

    monkeypatch.setattr(process, "_start_process", lambda: None)
    monkeypatch.setattr(process, "write_figures", lambda *_: {})


@pytest.fixture(scope="session")
def robot() -> Robot:
    """Return the shipped vitreoretinal robot."""
    return load_robot(PROBLEMS / "robots/vitreoretinal.yaml")


@pytest.fixture(scope="session")
def tilt_insert() -> Problem:
    """Return the shipped problem without its eye, so that tests can move the tool anywhere."""
    return replace(load_problem(PROBLEMS / "tilt_insert.yaml"), eye=None)


@pytest.fixture(scope="session")
def laser_scan() -> Problem:
    """Return the shipped problem with an eye and a scan of its retina."""
    return load_problem(PROBLEMS / "laser_scan.yaml")

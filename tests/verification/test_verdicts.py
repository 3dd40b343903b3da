"""The verdicts are `kept`, `violated` and `not judged`. Rounding of a table hides no violation."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ssm_planner import api
from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_robot
from ssm_planner.problem.limits import TipSpeed
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.verification.certificate import Certificate, LimitCheck, Unjudged
from ssm_planner.verification.check import check
from tests.support.cli import run
from tests.support.paths import PROBLEMS
from tests.support.plans import smooth
from tests.verification.test_polylines import through

ROBOT = PROBLEMS / "robots/vitreoretinal.yaml"
HOME = np.array([0.0, 1.2, 0.0, -0.01])
POSITIONS = "time_s,q1_rad,q2_rad,q3_rad,q4_m"
VELOCITIES = ",qd1_rad_per_s,qd2_rad_per_s,qd3_rad_per_s,qd4_m_per_s"
LINE = LimitCheck("velocity", "roll", 0.5, 2.0, 0.75, 1.5, "rad/s")


def table(path: Path, robot: Robot, quicker: float = 1.0, velocities: bool = False) -> Path:
    """Write a table of 401 points that keeps every limit unless it is played faster."""
    motion = smooth(robot)
    s = motion.sample(np.linspace(0, motion.duration, 401))
    columns = [s.t / quicker, s.q, *([s.qd * quicker] if velocities else [])]
    header = POSITIONS + VELOCITIES * velocities
    rows = np.column_stack(columns)
    np.savetxt(path, rows, fmt="%.15g", delimiter=",", header=header, comments="")
    return path


def test_a_certificate_is_violated_before_it_is_not_judged() -> None:
    """A violated limit has priority over limits that are not judged."""
    torque = Unjudged("motor torque", "roll", "no reason")
    broken = LimitCheck("jerk", None, 3.0, 2.0, -0.5, 0.0, "")
    kept = Certificate((LINE,), "x", 3)
    assert (kept.verdict, kept.passed) == ("kept", True)
    assert Certificate((), "x", 3).verdict == "not judged"
    open_ = Certificate((LINE,), "x", 3, unjudged=(torque,))
    assert (open_.verdict, open_.passed) == ("not judged", False)
    assert open_.with_more((broken,)).verdict == "violated"
    judged = LimitCheck("motor torque", "roll", 0.5, 2.0, 0.75, 1.5, "N·m")
    assert open_.with_more((judged,)).verdict == "kept"
    own = Certificate((LINE,), "x", 3, unjudged=(Unjudged("velocity", "roll", "rounding"),))
    assert own.verdict_of(LINE) == "not judged"
    assert open_.verdict_of(LINE) == "kept"
    assert open_.verdict_of(broken) == "violated"
    for certificate in (kept, open_, own):
        data = json.loads(json.dumps(certificate.to_dict()))
        assert Certificate.from_dict(data) == certificate
        assert data["verdict"] == certificate.verdict
        of_limits = [line["verdict"] for line in data["limits"]]
        assert of_limits == [certificate.verdict_of(LINE)]


def test_limits_are_allowed_to_remain_unjudged_by_name() -> None:
    names = ("motor torque", "continuous torque", "jerk")
    unjudged = tuple(Unjudged(name, "roll", "why") for name in names)
    certificate = Certificate((LINE,), "x", 3, unjudged=unjudged)
    assert [u.name for u in certificate.allowing("motor torque").unjudged] == list(names[1:])
    assert [u.name for u in certificate.allowing("torque").unjudged] == ["jerk"]
    assert certificate.allowing("rque").unjudged == unjudged
    allowed = certificate.allowing("torque", "jerk")
    assert allowed.verdict == "kept"
    assert sum("why (allowed)" in text for text in allowed.unchecked) == 3


def test_positions_alone_leave_the_acceleration_unjudged_and_a_script_can_tell(
    robot: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path / "q.csv", robot)
    assert run("check", path, "--robot", ROBOT, "--json") == 4
    data = json.loads(capsys.readouterr().out)
    assert (data["verdict"], data["passed"]) == ("not judged", False)
    assert {u["name"] for u in data["unjudged"]} >= {"acceleration", "continuous torque"}
    assert run("check", path, "--robot", ROBOT) == 4
    said = capsys.readouterr().out
    assert "check: NOT JUDGED" in said
    assert "not judged: acceleration of roll, tilt" in said
    names = ",".join({u["name"] for u in data["unjudged"]})
    assert run("check", path, "--robot", ROBOT, "--allow-unjudged", names) == 0
    assert "check: PASSED" in capsys.readouterr().out
    assert run("check", path, "--robot", ROBOT, "--allow-unjudged", "torque") == 4
    assert run("check", table(path, robot, velocities=True), "--robot", ROBOT) == 0


def test_no_name_allows_a_violation(robot: Robot, tmp_path: Path) -> None:
    """The motion is played ten times faster.

    A table with velocities is violated. A table without velocities is at least not kept.
    """
    quick = table(tmp_path / "v.csv", robot, quicker=10.0, velocities=True)
    everything = "acceleration,torque,velocity,jump"
    for options in ((), ("--allow-unjudged", everything)):
        assert run("check", quick, "--robot", ROBOT, *options) == 1
    assert api.check(table(tmp_path / "q.csv", robot, quicker=10.0), robot).verdict != "kept"


def test_an_unknown_limit_is_refused(robot: Robot, tmp_path: Path) -> None:
    path = table(tmp_path / "q.csv", robot)
    with pytest.raises(ProblemError, match="--allow-unjudged"):
        run("check", path, "--robot", ROBOT, "--allow-unjudged", "torqe")


def oracle(t: np.ndarray, q: np.ndarray, bound: float, resolution: float) -> str:
    """Return the verdict on the speed of one joint, from all pairs of points."""
    late, early = np.triu_indices(len(t), 1)[::-1]
    distance = np.abs(q[late] - q[early])
    if np.any(distance - 2 * resolution > bound * (1 + 2e-6) * (t[late] - t[early])):
        return "violated"
    fastest = (np.abs(np.diff(q)) / np.diff(t)).max()
    return "not judged" if fastest > bound * (1 + 1e-3) else "kept"


@settings(deadline=None, max_examples=60)
@given(
    joint=st.integers(0, 3),
    digits=st.sampled_from([1e-2, 1e-3, 1e-4, 1e-6]),
    rate=st.sampled_from([100.0, 1000.0]),
    factors=st.lists(st.floats(-30.0, 30.0), min_size=1, max_size=6),
    sizes=st.lists(st.integers(1, 40), min_size=6, max_size=6),
)
def test_rounding_hides_no_speed(
    joint: int, digits: float, rate: float, factors: list[float], sizes: list[int]
) -> None:
    """The speeds may exceed the limit many times, and the positions have few digits."""
    robot = load_robot("vitreoretinal")
    bound = robot.joints[joint].velocity
    speed = bound * np.repeat(factors, sizes[: len(factors)])
    t = np.arange(len(speed) + 1) / rate
    q = np.tile(HOME, (len(t), 1))
    q[1:, joint] += np.cumsum(speed) / rate
    q[:, joint] = np.round(q[:, joint] / digits) * digits
    resolution = np.full(4, digits / 2)
    found = check(through(q, t), robot, resolution=resolution)
    line = found["velocity", robot.joints[joint].name]
    assert found.verdict_of(line) == oracle(t, q[:, joint], bound, digits / 2)


@pytest.mark.parametrize(
    ("joint", "digits", "rate", "factor"),
    [
        (3, 1e-3, 1000.0, 20.0),
        (3, 1e-4, 1000.0, 4.0),
        (0, 1e-3, 1000.0, 1.3),
        (0, 0.01, 100.0, 1.5),
    ],
)
def test_a_steady_speed_beyond_the_limit_is_violated_in_every_rounding(
    robot: Robot, joint: int, digits: float, rate: float, factor: float
) -> None:
    t = np.arange(0.0, 1.0 if joint == 0 else 0.05, 1 / rate)
    q = np.tile(HOME, (len(t), 1))
    q[:, joint] += factor * robot.joints[joint].velocity * t
    q[:, joint] = np.round(q[:, joint] / digits) * digits
    result = check(through(q, t), robot, resolution=np.full(4, digits / 2))
    line = result["velocity", robot.joints[joint].name]
    assert not line.passed
    assert line.worst <= factor * robot.joints[joint].velocity * (1 + 1e-9)


@pytest.mark.parametrize("digits", [1e-3, 1e-4, 1e-6, 1e-9])
@pytest.mark.parametrize("share", [0.2, 0.7, 1.0])
def test_a_healthy_speed_is_never_violated(robot: Robot, digits: float, share: float) -> None:
    t = np.arange(0.0, 0.3, 1e-3)
    q = HOME + share * np.outer(t, [joint.velocity for joint in robot.joints])
    q = np.round(q / digits) * digits
    limits = TaskLimits((TipSpeed(1.0),))
    result = check(through(q, t), robot, limits, resolution=np.full(4, digits / 2))
    assert {line.name for line in result.violations} <= {"velocity jump", "position"}

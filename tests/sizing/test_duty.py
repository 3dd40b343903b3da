"""Duty cycles of single joints that move back and forth are compared with closed forms.

The shipped files give the expected cycles, and inconsistent files are refused.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_motorisation
from ssm_planner.problem.motion import Stroke
from ssm_planner.sizing.duty import DutyCycle, back_and_forth
from ssm_planner.sizing.requirements import motor_requirement
from tests.support.paths import PROBLEMS

SHIPPED = PROBLEMS


@given(
    st.floats(0.01, 3),
    st.floats(0.05, 5),
    st.floats(0.1, 50),
    st.sampled_from(["roll", "tilt", "insertion"]),
)
@settings(max_examples=50, deadline=None)
def test_a_stroke_is_the_fastest_within_its_limits(
    reach: float, v: float, a: float, joint: str
) -> None:
    motion = back_and_forth(Stroke(joint, 0.2, reach, v, a, (0.1, 0.2, 0.3, -0.01)))
    distance = 2 * reach
    one_way = distance / v + v / a if distance >= v * v / a else 2 * math.sqrt(distance / a)
    assert motion.duration == pytest.approx(2 * one_way)
    samples = motion.sample(np.linspace(0, motion.duration, 4001))
    i = ("roll", "tilt", "spin", "insertion").index(joint)
    assert np.abs(samples.qd[:, i]).max() <= v * (1 + 1e-9)
    assert np.abs(samples.qdd[:, i]) == pytest.approx(
        np.where(np.abs(samples.qdd[:, i]) > a / 2, a, 0.0)
    )
    assert samples.q[0, i] == pytest.approx(0.2 - reach)
    assert samples.q[-1, i] == pytest.approx(0.2 - reach)
    assert samples.q[:, i].max() == pytest.approx(0.2 + reach)
    others = [k for k in range(4) if k != i]
    assert np.all(samples.q[:, others] == np.array((0.1, 0.2, 0.3, -0.01))[others])
    left, right = (motion.sample(motion.breaks[1:-1], side=side) for side in ("left", "right"))
    assert left.q == pytest.approx(right.q, abs=1e-12)
    assert left.qd == pytest.approx(right.qd, abs=1e-12)
    assert np.abs(motion.sample(motion.breaks[[0, -1]], side="left").qd).max() < 1e-12


@pytest.mark.parametrize(
    ("file", "speeds"),
    [
        ("package", {"roll": (2.0, 10.0), "tilt": (2.0, 10.0), "insertion": (0.03, 0.1)}),
        ("paper", {"roll": (65, 200), "tilt": (65, 200), "insertion": (0.02, 0.1)}),
    ],
)
def test_the_shipped_runs(file: str, speeds: dict[str, tuple[float, float]]) -> None:
    result = load_motorisation(SHIPPED / "motorisation" / f"{file}.yaml")
    for stroke in result.strokes:
        v, a = speeds[stroke.joint]
        if v == 65:
            v, a = math.radians(v), math.radians(a)
        assert (stroke.velocity, stroke.acceleration) == pytest.approx((v, a))
        assert stroke.reach == pytest.approx(0.03 if stroke.joint == "insertion" else math.pi / 2)
    for load in DutyCycle.of_motorisation(result).loads():
        requirement = motor_requirement(load)
        v, a = next((s.velocity, s.acceleration) for s in result.strokes if s.joint == load.joint)
        assert requirement.peak_speed == pytest.approx(load.drive.ratio * v)
        assert requirement.peak_acceleration == pytest.approx(load.drive.ratio * a)
        assert load.moving_share == pytest.approx(1.0)


def test_the_screw_at_constant_speed_by_hand() -> None:
    """The torque of the screw at constant speed equals the law of the paper computed by hand.

    At constant speed the load of the screw is the component of the weight along the tool axis.
    """
    result = load_motorisation(SHIPPED / "motorisation" / "package.yaml")
    (load,) = [
        item for item in DutyCycle.of_motorisation(result).loads() if item.joint == "insertion"
    ]
    drive, f = load.drive, load.drive.friction
    # The tool axis is inclined by 23° to the vertical.
    weight = 0.09964338 * 9.81 * math.cos(math.radians(23))
    for way in (1, -1):
        cruising = np.flatnonzero((np.abs(load.qdd) < 1e-12) & (load.direction == way))
        F = weight + f.b_oc * way + f.b_ov * 0.03 * way
        phi = math.atan(f.mu / math.cos(drive.pressure_angle))
        w = drive.ratio * 0.03 * way
        expected = (
            f.b_c * way + f.b_v * w + drive.gamma * math.tan(drive.lead_angle + way * phi) * F
        )
        assert load.torque()[cruising] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("reach: 90 deg", "reach: 90", ("back_and_forth[0].roll.reach", "without a unit")),
        (
            "reach: 90 deg",
            "reach: -90 deg",
            ("back_and_forth[0].roll.reach", "not greater than zero"),
        ),
        (
            "velocity: 2 rad/s",
            "velocity: 2 m/s",
            ("back_and_forth[0].roll.velocity", "not a speed"),
        ),
        ("- roll:", "- rol:", ("did you mean 'roll'?",)),
        ("- roll:", "- spin:", ("back_and_forth[0].spin", "no drive")),
        ("- roll:", "- tilt:", ("back_and_forth[1].tilt", "already has a run")),
        ("robot:", "motion: []\nrobot:", ("unknown key",)),
    ],
)
def test_files_that_make_no_sense(
    tmp_path: Path, old: str, new: str, parts: tuple[str, ...]
) -> None:
    """An invalid file is refused, and the message names its key."""
    text = (SHIPPED / "motorisation" / "package.yaml").read_text(encoding="utf-8")
    text = text.replace("../robots", str(SHIPPED / "robots"))
    assert old in text
    path = tmp_path / "run.yaml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ProblemError) as caught:
        load_motorisation(path)
    message = str(caught.value)
    assert message.startswith(f"{path}:")
    for part in parts:
        assert part in message


def test_a_problem_file_is_recognised() -> None:
    with pytest.raises(ProblemError, match="plan it first"):
        load_motorisation(SHIPPED / "tilt_insert.yaml")

"""The program designs a session of recordings.

The tests check the order and repetition of the speeds, the whole turns, and the intervals that a
simulated session gives.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import spearmanr

from ssm_planner.cli import main
from ssm_planner.errors import RecordingError
from ssm_planner.identification.design import (
    MIDDLE_SPEED_RECORDINGS,
    _session_speeds,
    design_session,
)
from ssm_planner.identification.session import ORDERED_CORRELATION
from tests.support.paths import RESULTS

IDENTIFIED = RESULTS / "rig1_lead_screw" / "rig1_lead_screw.yaml"


@settings(deadline=None)
@given(st.integers(6, 40).map(lambda half: 2 * half), st.floats(0.5, 500.0))
def test_a_session_is_balanced_repeated_and_not_in_order_of_speed(count: int, top: float) -> None:
    speeds = _session_speeds(top, count)
    assert len(speeds) == count
    assert np.abs(speeds).max() == pytest.approx(top)
    assert np.sort(speeds) == pytest.approx(-np.sort(speeds)[::-1])
    middle = speeds[0]
    assert np.sum(np.isclose(speeds, middle)) == MIDDLE_SPEED_RECORDINGS
    assert np.isclose(np.abs(speeds[[0, 1, -2, -1]]), middle).all()
    for values in (np.abs(speeds), speeds):
        assert abs(spearmanr(np.arange(count), values).statistic) < ORDERED_CORRELATION


def test_a_simulated_session_gives_intervals_that_hold_the_friction_it_was_simulated_with(
    tmp_path: Path,
) -> None:
    session = design_session(IDENTIFIED, count=24, top_speed=25.0)
    turns = np.abs(session.speeds) * session.durations / (2 * np.pi)
    assert turns == pytest.approx(np.round(turns), abs=1e-9)
    assert turns.min() >= 3
    assert session.durations.min() >= 10.0 - 1e-9
    viscous = session.expected["b_v"]
    assert viscous.low < 5.46e-5 < viscous.high
    with session.save(tmp_path / "session.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    speeds = [float(row["speed_rpm"]) * 2 * np.pi / 60 for row in rows]
    assert speeds == pytest.approx(session.speeds, rel=1e-5)
    assert [int(row["motor_turns"]) for row in rows] == np.round(turns).tolist()
    assert [row["speed"] for row in session.to_dict()["recordings"]] == session.speeds.tolist()


@pytest.mark.parametrize("count", [0, 10, 13])
def test_a_session_needs_enough_recordings_in_both_directions(count: int) -> None:
    with pytest.raises(RecordingError, match="even number of at least 12"):
        design_session(IDENTIFIED, count=count, top_speed=20.0)


def test_the_command_writes_the_session(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "next" / "session.csv"
    words = ["identify", str(IDENTIFIED), "--design", "--count", "12", "--top-speed", "200rpm"]
    assert main([*words, "-o", str(file)]) == 0
    text = capsys.readouterr().out
    assert "95 % low" in text
    assert "12 recordings in" in text
    assert len(file.read_text(encoding="utf-8").splitlines()) == 13
    assert main([*words, "--count", "13"]) == 2
    assert "even number" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["--design", "--top-speed", "0rpm"], "0 rpm is out of range"),
        (["--design", "--top-speed", "-5rpm"], "-5 rpm is out of range"),
        (["recording.csv", "--design"], "a recording has no effect"),
        (["--design", "--fix", "mu=0.1"], "--fix has no effect"),
        (["--top-speed", "10rpm"], "--top-speed: needs --design"),
    ],
)
def test_an_option_without_effect_is_refused(
    capsys: pytest.CaptureFixture[str], words: list[str], fault: str
) -> None:
    assert main(["identify", str(IDENTIFIED), *words]) == 2
    assert fault in capsys.readouterr().err

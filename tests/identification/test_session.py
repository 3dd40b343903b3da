"""The notes of a session state the order of its speeds and its pauses.

Recordings in which the torque has the wrong sign are refused.
"""

from __future__ import annotations

import time
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.errors import RecordingError
from ssm_planner.identification.identify import identify
from ssm_planner.identification.recordings import Recording
from ssm_planner.identification.session import session_notes
from ssm_planner.identification.torque_map import compute_torque_map
from tests.support.recordings import REAL, RECORDINGS

START = datetime(2020, 7, 6, 15, 30)
SPEEDS = np.array([200.0, 150.0, 100.0, 70.0, 40.0, 20.0, 10.0, 5.0])


def recording(speed: float, minute: float | None, tau: float = 0.0) -> Recording:
    """Return a steady recording that was made some minutes after START."""
    instants = np.arange(20) * 1e-3
    header = {}
    if minute is not None:
        header["date"] = (START + timedelta(minutes=minute)).isoformat(sep=" ")
    w, torque = np.full(20, speed), tau + 1e-6 * np.cos(instants)
    return Recording(f"{speed:g}", instants, w=w, tau=torque, header=header)


@pytest.mark.parametrize(("sign", "word"), [(1, "fall"), (-1, "rise")])
def test_speeds_in_order_of_time_are_stated(sign: int, word: str) -> None:
    minutes = np.arange(len(SPEEDS))[::sign]
    steady = [recording(w, t) for w, t in zip(SPEEDS, minutes.tolist(), strict=True)]
    (note,) = session_notes(compute_torque_map(steady), [])
    assert f"{word} with time (rank correlation {-sign:.2f})" in note


@given(st.randoms(use_true_random=False))
def test_the_order_does_not_depend_on_the_order_of_the_files(random: object) -> None:
    steady = [recording(w, float(t)) for t, w in enumerate(SPEEDS)]
    random.shuffle(steady)  # type: ignore[attr-defined]
    assert len(list(session_notes(compute_torque_map(steady), []))) == 1


def test_a_session_in_random_order_needs_no_remark_and_one_without_dates_needs_one() -> None:
    minutes = [3.0, 6.0, 0.0, 5.0, 1.0, 7.0, 2.0, 4.0]
    steady = [recording(w, t) for w, t in zip(SPEEDS, minutes, strict=True)]
    assert not list(session_notes(compute_torque_map(steady), []))
    assert not list(session_notes(compute_torque_map([recording(w, 0.0) for w in SPEEDS]), []))
    (note,) = session_notes(compute_torque_map([recording(w, None) for w in SPEEDS]), [])
    assert "too few recordings have a date" in note
    assert "no interval includes it" in note


@pytest.mark.parametrize(
    ("minutes", "words"), [(45.0, "45 minutes"), (180.0, "3 hours"), (4 * 1440.0, "4 days")]
)
def test_pauses_are_stated(minutes: float, words: str) -> None:
    steady = [recording(w, 0.0) for w in SPEEDS]
    (note,) = session_notes(compute_torque_map(steady), [recording(50.0, minutes)])
    assert f"50 was recorded {words} after" in note


@pytest.mark.parametrize("load", [0.0, 3e-3, -3e-3])
def test_a_motor_that_produces_energy_has_a_wrong_sign(load: float) -> None:
    """Recordings in which the motor produces energy have a torque of the wrong sign.

    The energy of a load cancels over both directions, and friction takes energy.
    """
    steady = [
        recording(sign * w, None, load + sign * 1e-3) for w in SPEEDS.tolist() for sign in (1, -1)
    ]
    assert len(compute_torque_map(steady).w) == 2 * len(SPEEDS)
    flipped = [Recording(r.name, r.time, w=r.w, tau=-r.tau) for r in steady]
    with pytest.raises(RecordingError, match="produce energy"):
        compute_torque_map(flipped)


@pytest.mark.skipif(not REAL, reason="the recordings are not beside the project")
@pytest.mark.parametrize("rig", [1, 2, 3])
@pytest.mark.usefixtures("few_points")
def test_the_sessions_of_the_paper_went_from_fast_to_slow(rig: int) -> None:
    name = ("lead_screw", "antibacklash_screw", "worm")[rig - 1]
    folder = RECORDINGS / f"drive{rig}_{name}" / "steady_state"
    result = identify(f"rig{rig}_{name}", [folder], law="coulomb")
    assert any("speeds of the recordings fall with time" in note for note in result.fit.notes)


@pytest.mark.skipif(not hasattr(time, "tzset"), reason="the system has no time zones to set")
def test_pauses_do_not_depend_on_the_time_zone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stated pause is the same in every time zone.

    Clocks in Berlin went forward by an hour at 2:00 on 29 March 2020.
    """
    before = Recording("a", np.arange(20.0), w=np.ones(20), tau=np.ones(20))
    dates = ("2020-03-29 01:50:00", "2020-03-29 03:30:00")
    pair = [replace(before, name=date, header={"date": date}) for date in dates]
    notes = []
    for zone in ("UTC", "Europe/Berlin"):
        monkeypatch.setenv("TZ", zone)
        time.tzset()
        notes.append(list(session_notes(compute_torque_map(pair), []))[-1])
    monkeypatch.undo()
    time.tzset()
    assert notes[0] == notes[1]
    assert "100 minutes" in notes[0]

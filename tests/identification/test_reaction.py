"""The reaction of the speed controller is a filter of the recorded speed.

The filter is fitted separately from the friction law.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.dynamics.friction import required_friction
from ssm_planner.errors import ProblemError
from ssm_planner.identification.identify import _with_ripple
from ssm_planner.identification.parameters import drive_with_parameters, map_torque
from ssm_planner.identification.prediction import predict_recording
from ssm_planner.identification.reaction import (
    FILTER_DELAYS,
    delayed_signals,
    fit_reaction,
    speed_deviation,
)
from ssm_planner.identification.recordings import Recording, read_recordings
from ssm_planner.loading.load import load_drive
from ssm_planner.problem.posterior import Posterior, Reaction
from tests.identification.test_prediction import start_stop
from tests.support.paths import PROBLEMS
from tests.support.recordings import REAL, RECORDINGS, RIGS

TAPS = np.array([2e-5, 3e-5, 8e-5, -1e-4, -3e-5, -2e-5, -1e-5])
"""Filter coefficients of the simulated controller, in N·m·s/rad of torque per speed."""


def drive_of():
    """Return the worm rig with Coulomb friction and a posterior of equal parameter sets."""
    drive = load_drive(PROBLEMS / "drives" / "rig3_worm.yaml")
    values = {"b_c": 5.5e-4, "b_v": 1.15e-5, "b_oc": 4e-3, "mu": 0.12, "mu_static": 0.12}
    drive = drive_with_parameters(drive, "coulomb", values)
    posterior = Posterior(("mu",), np.full((10, 1), 0.12), scatter=1e-6)
    return replace(drive, friction=replace(required_friction(drive), posterior=posterior))


def controlled(speed: float, seed: int, noise: float = 0.0) -> Recording:
    """Return steady motion in which the controller reacts to a random ripple of the speed."""
    rng = np.random.default_rng(seed)
    time = 0.0128 * np.arange(500)
    phases, rates = rng.uniform(0, 2 * np.pi, 6), rng.uniform(2, 25, 6)
    ripple = 0.1 * np.sin(np.outer(time, rates) + phases).sum(axis=1)
    w = speed + ripple - ripple.mean()
    drive = drive_of()
    law = map_torque(drive, np.array([speed]), drive.rig.F_payload).item()
    answer = delayed_signals(time, w - w.mean()) @ TAPS
    tau = law + answer - answer.mean() + noise * rng.standard_normal(len(time))
    return Recording(f"{speed:g}", time, w=w, tau=tau)


def test_the_filter_is_fitted_and_confirmed_on_other_recordings() -> None:
    recordings = [controlled(speed, k, 1e-6) for k, speed in enumerate((-20.0, -10.0, 10.0, 20.0))]
    reaction = fit_reaction(recordings)
    assert reaction is not None
    np.testing.assert_allclose(reaction.taps, TAPS, atol=5e-6)
    assert min(reaction.explained) > 0.95
    assert reaction.speeds == pytest.approx((-20.0, -10.0, 10.0, 20.0), rel=1e-3)
    assert fit_reaction(recordings[:1]) is None


def test_torque_that_the_speed_does_not_explain_is_no_reaction() -> None:
    rng = np.random.default_rng(0)
    recordings = [controlled(speed, k) for k, speed in enumerate((-20.0, -10.0, 10.0, 20.0))]
    noisy = [replace(r, tau=1e-3 + 1e-4 * rng.standard_normal(len(r.tau))) for r in recordings]
    reaction = fit_reaction(noisy)
    assert reaction is not None
    assert not reaction.explained_share(np.linspace(-20, 20, 9)).any()


def test_a_prediction_states_law_and_reaction_apart() -> None:
    training = [controlled(speed, k, 1e-6) for k, speed in enumerate((-20.0, -10.0, 10.0, 20.0))]
    plain = drive_of()
    drive = _with_ripple(plain, {}, fit_reaction(training))
    recording = controlled(15.0, 9)
    with_reaction, law_alone = (
        predict_recording(d, recording, d.rig.F_payload) for d in (drive, plain)
    )
    assert not law_alone.reaction.any()
    np.testing.assert_allclose(with_reaction.law, law_alone.tau, atol=1e-12)
    np.testing.assert_allclose(with_reaction.tau - with_reaction.law, with_reaction.reaction)
    assert with_reaction.nrmsd < 0.1 * law_alone.nrmsd
    content = with_reaction.to_dict()
    assert content["nrmsd_law"] == pytest.approx(law_alone.nrmsd)
    assert content["reaction_rms"] == pytest.approx(np.std(recording.tau), rel=0.1)
    assert content["position_ripple_rms"] == 0.0


def test_the_reaction_needs_regular_motion_at_a_confirmed_speed() -> None:
    time, w = start_stop(speed=15.0)
    direction = np.sign(w)
    deviation = speed_deviation(w, direction)
    assert not deviation.any()
    ripple = np.where(np.abs(w) == 15.0, 0.3 * np.sin(20 * time), 0.0)
    np.testing.assert_allclose(speed_deviation(w + ripple, direction), ripple, atol=0.03)
    reaction = Reaction(
        (0.0,), taps=(-1.0,), speeds=(5.0, 20.0), deviations=(1.0, 2.0), explained=(0.2, 0.75)
    )
    assert reaction.explained_share(np.array([5.0, 11.0, 20.0])).tolist() == [0.0, 0.0, 0.75]
    assert reaction.remaining_rms(np.array([5.0, 20.0])).tolist() == [1.0, 1.0]
    with pytest.raises(ProblemError, match="wrong length"):
        replace(reaction, taps=(1.0, 2.0))


@pytest.mark.skipif(not REAL, reason="the recordings are not beside the project")
@pytest.mark.parametrize("folder", RIGS)
def test_the_reaction_explains_the_ripple_of_recordings_left_out(folder: str) -> None:
    """The filter explains the ripple of recordings that its fit has not used.

    Above 70 rpm it explains at least 70 % of the variance on average and 60 % in each recording.
    """
    drive = load_drive(PROBLEMS / "drives" / f"{RIGS[folder][0]}.yaml")
    recordings = read_recordings(
        [RECORDINGS / folder / "steady_state"],
        nominal_torque=drive.rig.motor_nominal_torque,
        direction=drive.rig.direction,
    )
    reaction = fit_reaction(recordings)
    assert reaction is not None
    assert len(reaction.taps) == len(FILTER_DELAYS) == 7
    is_fast = np.abs(reaction.speeds) > 70 * np.pi / 30
    explained = np.array(reaction.explained)[is_fast]
    assert explained.mean() >= 0.7
    assert explained.min() >= 0.6

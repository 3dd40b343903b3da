"""Identification recovers the friction of a simulation from its recordings. The true parameters lie
within the estimated intervals.

The command `python tests/simulation/test_identified.py DRAWS` prints how often this is the case.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.identification.fit import MapFit, fit_map
from ssm_planner.identification.parameters import drive_with_parameters, map_torque
from ssm_planner.identification.recordings import Recording, read_recording
from ssm_planner.identification.torque_map import compute_torque_map
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.controller import Controller
from ssm_planner.simulation.plant import FRICTION_PARAMETERS
from ssm_planner.simulation.recorder import write_recording
from ssm_planner.simulation.simulate import PowerLosses, Scenario, _Simulation
from ssm_planner.trajectory import Span, Trajectory
from tests.support.cases import selected
from tests.support.paths import RESULTS

PLAN = RESULTS / "tilt_insert" / "plan.json"
SPEEDS = 1e-3 * np.array([1.0, 2.0, 4.0, 7.0, 10.0, 14.0, 18.0, 20.0])
RAMP, STEADY, SETTLED = 0.25, 0.5, 0.1
"""Durations in s of the ramp, of the steady motion, and of the settling after the ramp."""
INSERTION = 3
DRAWN = ("mu", "b_c", "b_v")
SPREAD, SCATTER = 0.2, 0.01
"""Relative standard deviations of the parameters between drives, and of the friction between
recordings.
"""


def sliding(q: np.ndarray, speed: float, sign: int) -> Trajectory:
    """Return a motion in which only joint 4 moves. It accelerates, keeps its speed, and brakes."""
    breaks = np.cumsum([0.0, RAMP, STEADY, RAMP])
    coefficients = np.zeros((3, 6, 4))
    coefficients[:, 0] = q
    start = -4e-3 - (speed * (RAMP + STEADY) if sign > 0 else 0.0)
    coefficients[:, 0, INSERTION] = start + sign * speed * np.array(
        [0.0, RAMP / 2, RAMP / 2 + STEADY]
    )
    coefficients[:, 1, INSERTION] = sign * speed * np.array([0.0, 1.0, 1.0])
    coefficients[:, 2, INSERTION] = sign * speed / (2 * RAMP) * np.array([1.0, 0.0, -1.0])
    return Trajectory(breaks, coefficients, (Span("slide", 0.0, float(breaks[-1])),))


class Bench:
    """The arm slides joint 4 at every speed in both directions, at one tilt."""

    def __init__(self, plan: Plan, folder: Path) -> None:
        q = plan.motion.sample(plan.motion.breaks[-1:]).q[0]
        motions = [sliding(q, speed, sign) for speed in SPEEDS for sign in (1, -1)]
        self.stages = [
            _Simulation(replace(plan, trajectory=motion), Scenario(), Controller())
            for motion in motions
        ]
        self.drive, self.folder = plan.robot.joints[INSERTION].drive, folder
        self.arm = self.stages[0].arm(0.0)
        for stage in self.stages:
            stage.arms = {0.0: self.arm}
            stage.play()
        self.friction = self.stages[0].friction.reshape(4, -1)[INSERTION]
        self.load = float(self.arm.body.gravity_load(q[None])[0, INSERTION])

    def identified(self, rng: np.random.Generator) -> tuple[dict[str, float], MapFit]:
        """Draw friction parameters, and fit them to simulated recordings.

        Return the drawn parameters with the torques of slow motion, and the fit.
        """
        place = {name: FRICTION_PARAMETERS.index(name) for name in FRICTION_PARAMETERS}
        truth = {
            name: self.friction[place[name]] * float(np.exp(rng.normal(0, SPREAD)))
            for name in DRAWN
        }
        recordings = [
            self._recorded(stage, truth, 1 + SCATTER * rng.normal()) for stage in self.stages
        ]
        fit = fit_map(self.drive, compute_torque_map(recordings), self.load)
        complete = {**truth, "b_oc": self.friction[place["b_oc"]]}
        slow = map_torque(
            drive_with_parameters(self.drive, "coulomb", complete),
            np.array([1e-6, -1e-6]),
            self.load,
        )
        return {**truth, "forwards": slow[0], "backwards": slow[1]}, fit

    def _recorded(self, stage: _Simulation, truth: dict[str, float], scatter: float) -> Recording:
        """Return the part with constant speed of one motion, as read from a recorder file.

        `scatter` multiplies the friction of the bearings.
        """
        friction = stage.friction.reshape(4, -1).copy()
        values = {
            **truth,
            "mu_static": truth["mu"],
            "b_c": scatter * truth["b_c"],
            "b_v": scatter * truth["b_v"],
        }
        for name, value in values.items():
            friction[INSERTION, FRICTION_PARAMETERS.index(name)] = value
        played = self.arm.play(
            self.arm.initial_state(*stage.initial_motion, stage.commands),
            stage.commands,
            stage.offsets,
            friction.ravel(),
        )
        none = PowerLosses(*np.zeros((3, 1)))
        path = write_recording(
            stage.result(played, none), "insertion", self.folder / "recording.csv"
        )
        lines = path.read_text(encoding="utf-8").splitlines()
        even = [
            row
            for row in lines[6:]
            if RAMP + SETTLED <= float(row.split(";")[0]) / 1e3 <= RAMP + STEADY
        ]
        path.write_text("\n".join(lines[:6] + even) + "\n", encoding="utf-8")
        axis = stage.axes["insertion"]
        return read_recording(path, nominal_torque=axis.rated_torque, direction=axis.direction)


def coverage(draws: int, folder: Path, seed: int = 3) -> dict[str, float]:
    """Return the relative frequency with which each true value lies in its interval.

    The values are the drawn parameters and the torque of slow motion in both directions.
    """
    bench, rng, hits = Bench(load_plan(PLAN), folder), np.random.default_rng(seed), {}
    for _ in range(draws):
        truth, fit = bench.identified(rng)
        estimates = {**fit.estimates, **fit.combinations}
        for name, value in truth.items():
            hits.setdefault(name, []).append(estimates[name].low <= value <= estimates[name].high)
    return {name: float(np.mean(result)) for name, result in hits.items()}


@pytest.mark.slow
@pytest.mark.usefixtures("few_points")
def test_identification_finds_the_friction_of_simulated_recordings(tmp_path: Path) -> None:
    result = coverage(selected(3, every=5), tmp_path)
    # There are 15 or 25 intervals of 95 %, which depend on each other in groups of five. It is very
    # unlikely that fewer than 12 or 20 of them are right. Run this file for more draws.
    assert np.mean(list(result.values())) >= 0.8, result


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as where:
        print(coverage(int(sys.argv[1]) if len(sys.argv) > 1 else 100, Path(where)))

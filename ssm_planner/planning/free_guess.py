"""The first guess of a free phase, in closed form: it keeps velocity, acceleration and jerk limits of every joint.

The slowest joint moves as fast as it can alone. The others move in step with it where that keeps their limits, else by their
own fastest motion stretched to its time. So without torque, tip speed and range limits the guess is already optimal.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ssm_planner.planning.profile import Profile, rest_to_rest
from ssm_planner.problem.values import Array

SLACK = 1 + 1e-12


@dataclass(frozen=True, eq=False)
class FreeGuess:
    """duration in s; instants (n + 1,) as shares of it; y, ẏ, ÿ start, ÿ end of the moving joints, (n, 4 · moving)."""

    duration: float
    instants: Array
    elements: Array

    @property
    def fractions(self) -> Array:
        return np.diff(self.instants)


def guess(distances: Array, limits: Array, jerk: bool, count: int, fewest: int = 2) -> FreeGuess:
    """For moving joints over `distances` > 0 (m,) under limits (3, m): velocity, acceleration, jerk."""
    alone = [_alone(d, limits[:, k], jerk) for k, d in enumerate(distances)]
    slowest = int(np.argmax([profile.duration for profile in alone]))
    leader = alone[slowest]
    profiles = []
    for k, d in enumerate(distances):
        in_step = leader.scaled(d / distances[slowest])
        fits = all(peak <= limit * SLACK for peak, limit in zip(in_step.peaks[: 2 + jerk], limits[:, k], strict=False))
        profiles.append(in_step if fits else alone[k].stretched(leader.duration))
    switches = leader.switches
    instants = [np.zeros(1)]
    for start, end in pairwise(switches):
        n = max(fewest, round(count * (end - start) / leader.duration))
        instants.append(np.linspace(start, end, n + 1)[1:])
    t = np.concatenate(instants)
    middle = (t[1:] + t[:-1]) / 2
    y, speed, start, end = [], [], [], []
    for profile, d in zip(profiles, distances, strict=True):
        position, velocity, _ = profile.at(t)
        _, _, here = profile.at(middle)
        half = 0.5 * np.diff(t) * (profile.at(middle + 1e-9)[2] - here) / 1e-9
        y.append(position[:-1] / d)
        speed.append(velocity[:-1] * leader.duration / d)
        start.append((here - half) * leader.duration**2 / d)
        end.append((here + half) * leader.duration**2 / d)
    columns = [np.stack(part, axis=1) for part in (y, speed, start, end)]
    return FreeGuess(leader.duration, t / leader.duration, np.hstack(columns))


def _alone(distance: float, limits: Array, jerk: bool) -> Profile:
    return rest_to_rest(float(distance), float(limits[0]), float(limits[1]), float(limits[2]) if jerk else None)

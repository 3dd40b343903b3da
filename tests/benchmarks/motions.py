"""Motions of other programs as trajectories, so that one independent check judges all of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np

from ssm_planner.planning import phase_planner
from ssm_planner.planning.retiming.paths import StraightPath
from ssm_planner.problem.problem import Problem
from ssm_planner.trajectory import Trajectory, quintic_coefficients
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.check import check

SUBDIVISION = 4


@contextmanager
def meshed(straight: int, free: int) -> Iterator[None]:
    """Plan with about the given numbers of mesh elements within the context."""
    solvers = {
        "solve_straight": (phase_planner.solve_straight, straight),
        "solve_free": (phase_planner.solve_free, free),
    }

    def solve(name: str) -> Any:
        solver, count = solvers[name]
        return lambda *given, **named: solver(*given, **{**named, "count": count})

    with patch.multiple(phase_planner, **{name: solve(name) for name in solvers}):
        yield


def along_path(path: StraightPath, elements: Array, subdivision: int = SUBDIVISION) -> Trajectory:
    """Return the joint polynomials of a motion s(t) along a path.

    They are exact in q, q̇ and q̈ at both ends of every piece. `elements` (n, 5) holds s, ṡ, s̈ at
    the start, s̈ at the end, and the length in s of time. Within an element s̈ is linear.
    """
    share = np.arange(subdivision + 1) / subdivision
    s0, v0, a0, a1, h = (column[:, None] for column in elements.T)
    t, rise = share * h, a1 - a0
    s = np.clip(s0 + t * (v0 + t * (a0 / 2 + share * rise / 6)), 0.0, 1.0)
    speed, acceleration = v0 + t * (a0 + share * rise / 2), a0 + share * rise
    begins = np.concatenate([[0.0], np.cumsum(elements[:, 4])])
    breaks = np.append((begins[:-1, None] + t[:, :-1]).ravel(), begins[-1])
    # Adjacent elements share exactly the same position and speed.
    s[:-1, -1], speed[:-1, -1] = s[1:, 0], speed[1:, 0]
    s[-1, -1], speed[-1, -1] = 1.0, 0.0
    ends = []
    for part in (slice(None, -1), slice(1, None)):
        samples = path.sample(s[:, part].ravel())
        v, a = speed[:, part].reshape(-1, 1), acceleration[:, part].reshape(-1, 1)
        ends.append((samples.q, samples.dq * v, samples.ddq * v**2 + samples.dq * a))
    return Trajectory(breaks, quintic_coefficients(np.diff(breaks), ends[0], ends[1]), ())


def of_joints(q: Array, qd: Array, first: Array, last: Array, lengths: Array) -> Trajectory:
    """Return joint polynomials from q, q̇ (n + 1, 4) and q̈ at both ends of each element (n, 4)."""
    breaks = np.concatenate([[0.0], np.cumsum(lengths)])
    return Trajectory(
        breaks,
        quintic_coefficients(np.diff(breaks), (q[:-1], qd[:-1], first), (q[1:], qd[1:], last)),
        (),
    )


def certificate(problem: Problem, trajectory: Trajectory) -> Certificate:
    """Return the result of the independent check against the limits of the robot."""
    return check(trajectory, problem.robot)


def excess(found: Certificate, name: str | None = None) -> tuple[float, str]:
    """Return the largest relative excess over a limit, and a text about it.

    `name` selects one limit. The excess is 0 if all limits are kept.
    """
    limits = [limit for limit in found.limits if name in (None, limit.name)]
    worst = min(limits, key=lambda limit: limit.margin)
    if worst.margin >= -1e-6:
        return max(-worst.margin, 0.0), "none above 1e-6"
    joint = "" if worst.joint is None else f", {worst.joint}"
    return -worst.margin, f"{-100 * worst.margin:.2g} % ({worst.name}{joint})"

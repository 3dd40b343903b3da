"""Task coordinates (roll, tilt, spin, depth), in batch."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssm_planner.errors import GeometryError
from ssm_planner.model.arguments import batch
from ssm_planner.model.closed_form import task_of_joints, task_rates_of_joints
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.namespace import NUMPY
from ssm_planner.model.screws import rotation
from ssm_planner.model.solutions import nearest_turn

Array = NDArray[np.float64]


def task_batch(name: str, value: ArrayLike) -> Array:
    """Task coordinates (n, 4), checked: tilt is in [−π, π]."""
    task = batch(name, value, 4)
    bad = np.flatnonzero(np.abs(task[:, 1]) > math.pi + 1e-9)
    if bad.size:
        raise GeometryError(
            f"{name}[{bad[0]}, 1] of shape {task.shape}: tilt = {task[bad[0], 1]:.6g} rad, must be in [-pi, pi] rad;"
            " degrees are not meant"
        )
    return task


def task_from_joints(mechanism: Mechanism, q: ArrayLike, near: ArrayLike | None = None) -> Array:
    """(roll, tilt, spin, depth) of joints q (n, 4); returns (n, 4).

    Tilt takes the sign of the home tilt: of the two names (ψ, φ, σ) and (ψ + π, −φ, σ + π) of a pose, the one on that
    side. Roll and spin are in (−π, π], or the 2π-equivalents nearest to `near`, task coordinates (n, 4) or (4,).
    """
    q = batch("q", q, 4)
    task = np.stack(task_of_joints(NUMPY, mechanism, (q[:, 0], q[:, 1], q[:, 2], q[:, 3])), axis=1)
    centre = np.zeros((1, 4)) if near is None else batch("near", near, 4)
    for column in (0, 2):
        task[:, column] = nearest_turn(task[:, column], centre[:, column])
    return task


def task_rates(mechanism: Mechanism, q: ArrayLike, qd: ArrayLike) -> Array:
    """Rates of (roll, tilt, spin, depth) of joints q and joint rates qd, (n, 4) each; rad/s and m/s, (n, 4).

    Roll and spin rates grow without bound towards a tilt of 0 or 180°, where the two are the same rotation.
    """
    q, qd = batch("q", q, 4), batch("qd", qd, 4)
    return np.stack(task_rates_of_joints(NUMPY, mechanism, tuple(q.T), tuple(qd.T)), axis=1)


def pose_from_task(mechanism: Mechanism, task: ArrayLike) -> tuple[Array, Array]:
    """R = e^{ω̂1 ψ} e^{t̂ φ} e^{−t̂ φ_h} e^{−ω̂1 ψ_h} R_0 Rz(σ) and the tip position; task (n, 4), any sign of tilt."""
    task = task_batch("task", task)
    pointing = rotation(mechanism.omega1, task[:, 0]) @ rotation(mechanism.tilt_axis, task[:, 1])
    spin = rotation((0.0, 0.0, 1.0), task[:, 2])
    theta4 = mechanism.insertion_sign * task[:, 3:]
    return pointing @ mechanism.tool_on_omega1 @ spin, (pointing @ mechanism.omega1) * theta4

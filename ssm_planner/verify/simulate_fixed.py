"""Forward simulation of one drive in fixed steps, all in one call: the fast form of simulate.py."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ssm_planner.errors import GeometryError
from ssm_planner.model.drive_dynamics import always_unique, with_load
from ssm_planner.problem.values import Array, Drive
from ssm_planner.verify.simulate import NOT_UNIQUE, DriveMotion
from ssm_planner.verify.simulate_servo import Servo, servo_step
from ssm_planner.verify.simulate_step import drive_step

_CHUNK = 500


def simulate_drive_fixed(
    drive: Drive,
    servo: Servo | None,
    reference: Array,
    *,
    period: float = 1e-3,
    steps: int = 4,
    load: float = 0.0,
    load_inertia: float = 0.0,
) -> DriveMotion:
    """Follow motor speeds `reference` (n,), one per control period (s), from rest; `steps` integration steps in each.

    servo None: a motor without power. load: constant effort on the output, N·m or N; load_inertia: kg·m² or kg. The
    load's inertia is rigidly coupled: the motion is meaningful where `effective_inertia` is positive on both sides.
    """
    reference = np.asarray(reference, dtype=float)
    if reference.ndim != 1 or not len(reference):
        raise GeometryError(f"reference must be (n,) speeds, not {reference.shape}")
    loaded = with_load(drive, load_inertia)
    run = _period(loaded, servo, load, period, steps).mapaccum("drive", _CHUNK)
    padded = np.concatenate([reference, np.repeat(reference[-1:], -len(reference) % _CHUNK)])
    states, torques = [np.array([[0.0], [0.0], [0.0], [1e6], [0.0], [0.0]])], []
    for first in range(0, len(padded), _CHUNK):
        after, tau = run(states[-1][:, -1], padded[None, first : first + _CHUNK])
        states.append(after.full())
        torques.append(tau.full())
    angle, w, _, _, work, loss = np.hstack(states)[:, : len(reference)]
    moved = (loaded.output_inertia + loaded.second_nut_mass) / loaded.ratio**2
    return DriveMotion(
        time=period * np.arange(len(reference), dtype=float),
        angle=angle,
        w=w,
        tau=np.hstack(torques)[0, : len(reference)],
        state=np.sign(w),
        work=work,
        dissipated=loss,
        kinetic=0.5 * (loaded.input_inertia + moved) * w**2,
        potential=load * angle / loaded.ratio,
        events=(),
        status=_status(loaded, w),
    )


def _status(drive: Drive, w: Array) -> str:
    if not np.all(np.isfinite(w)):
        return "diverged"
    return "done" if always_unique(drive) else NOT_UNIQUE


def _period(drive: Drive, servo: Servo | None, load: float, period: float, steps: int) -> ca.Function:
    """(state, wanted speed) → (state after one control period, torque in it)."""
    x, wanted = ca.SX.sym("x", 6), ca.SX.sym("wanted")
    angle, w, integral, rest, work, loss = ca.vertsplit(x)
    tau, integral = (ca.SX(0), integral) if servo is None else servo_step(servo, wanted - w, integral, period)
    h = period / steps
    for _ in range(steps):
        step = drive_step(drive, w, rest, tau, ca.SX(load), h)
        mean = 0.5 * (w + step.w)
        angle, work, loss = angle + h * mean, work + h * tau * mean, loss + step.loss
        w, rest = step.w, step.rest
    return ca.Function("period", [x, wanted], [ca.vertcat(angle, w, integral, rest, work, loss), tau], {"cse": True})

"""One fixed step of a sliding drive in CasADi: slide, stop at exactly zero speed, stand, break away.

Forward simulation of one drive in fixed steps, all in one call: the fast form of simulate.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ssm_planner.dynamics.forward import always_unique, effective_inertia, with_load
from ssm_planner.dynamics.friction import friction_coefficient, friction_of
from ssm_planner.dynamics.transmission import mesh_coefficients, mesh_torque, output_effort
from ssm_planner.errors import GeometryError
from ssm_planner.problem.drive import Drive
from ssm_planner.simulation.drive import NOT_UNIQUE, DriveMotion
from ssm_planner.simulation.servo import Servo, servo_step
from ssm_planner.typing import Array


@dataclass(frozen=True)
class DriveStep:
    """After one step: speed, time at rest, and the energy that friction took in it."""

    w: ca.SX
    rest: ca.SX
    loss: ca.SX


def drive_step(drive: Drive, w: ca.SX, rest: ca.SX, tau: ca.SX, load: ca.SX, h: float) -> DriveStep:
    """Advance a drive by h (s) under a torque and an effort on its output that are constant over the step.

    w: motor speed; exactly 0 means that the drive stands. rest: time it has stood, s. The step ends at zero speed where
    the sign of w would change: the next one decides whether the drive stays. Speed is linear within a step, so the
    energies of the step (J) are those of its mean speed.
    """
    f = friction_of(drive)
    mu = friction_coefficient(f, w)
    mu_rest = _rest_coefficient(drive, rest)
    limits = [_breakaway(drive, load, s, mu_rest) for s in (1.0, -1.0)]
    starts = ca.if_else(tau > limits[0], 1, ca.if_else(tau < limits[1], -1, 0))
    stands = w == 0
    sign = ca.if_else(stands, starts, ca.sign(w))
    wd, effort = _acceleration(drive, tau, w, load, sign, mu)
    free = w + h * wd
    stops = sign * free <= 0
    after = ca.if_else(ca.logic_or(sign == 0, stops), 0, free)
    mean = 0.5 * (w + after)
    qd = mean / drive.ratio
    sliding = sign * f.b_c + f.b_v * w + mesh_torque(drive, effort, wd, sign, mu)
    transmitted = effort
    if drive.kind == "antibacklash_screw":
        transmitted = transmitted + drive.second_nut_mass * wd / drive.ratio
    output = f.b_oc * sign + f.b_ov * w / drive.ratio
    slid = h * (sliding * mean - transmitted * qd + output * qd)
    moved = drive.input_inertia + (drive.output_inertia + drive.second_nut_mass) / drive.ratio**2
    stopped = h * (tau * mean - load * qd) + 0.5 * moved * w**2
    loss = ca.if_else(sign == 0, 0, ca.if_else(stops, stopped, slid))
    return DriveStep(after, ca.if_else(after == 0, rest + h, 0), loss)


def _rest_coefficient(drive: Drive, rest: ca.SX) -> ca.SX:
    """Coefficient at breakaway after a rest; the law of friction.static_coefficient from its value as w → 0."""
    f = friction_of(drive)
    arrival = min(float(friction_coefficient(f, 0.0)), f.mu_static)
    if not f.dwell_constant:
        return ca.SX(f.mu_static)
    return arrival + (f.mu_static - arrival) * ca.exp(-f.dwell_constant / ca.fmax(rest, 1e-9))


def _breakaway(drive: Drive, load: ca.SX, sign: float, mu: ca.SX) -> ca.SX:
    effort = output_effort(drive, load, 0.0, 0.0, sign)
    return friction_of(drive).b_c * sign + mesh_torque(drive, effort, 0.0, sign, mu)


def _acceleration(drive: Drive, tau: ca.SX, w: ca.SX, load: ca.SX, sign: ca.SX, mu: ca.SX) -> tuple[ca.SX, ca.SX]:
    """(wd, F): the exact law solved for the acceleration, as drive_dynamics.slip_acceleration does for numbers."""
    f = friction_of(drive)
    effort = output_effort(drive, load, w / drive.ratio, 0.0, sign)
    left = tau - f.b_c * sign - f.b_v * w
    up_inertia, down_inertia = effective_inertia(drive, mu)
    output = drive.output_inertia / drive.ratio
    if drive.kind == "antibacklash_screw":
        inertia = ca.if_else(sign > 0, up_inertia, down_inertia)
        wd = (left - mesh_torque(drive, effort, 0.0, sign, mu)) / inertia
        return wd, effort + output * wd
    up, down = mesh_coefficients(drive, mu)
    opposed = (left - up * effort) / up_inertia
    driven = (left - down * effort) / down_inertia
    wd = ca.if_else(sign * (effort + output * opposed) >= 0, opposed, driven)
    return wd, effort + output * wd


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

"""Two simulations of one drive, as references for the simulation of the package.

`simulate_drive` integrates adaptively and treats every change between sticking and sliding as an
event. While the drive sticks, the speed is exactly 0 until the torque exceeds breakaway. While it
slides, the exact law is solved for the acceleration, branch by branch and independently of the
solution in dynamics/transmission.py. Frictional memory is left out.

`simulate_drive_fixed` repeats the fixed step of the package.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import casadi as ca
import numpy as np

from ssm_planner.dynamics.friction import (
    friction_coefficient,
    required_friction,
    static_coefficient,
)
from ssm_planner.dynamics.transmission import (
    breakaway_torque,
    mesh_coefficients,
    output_effort,
)
from ssm_planner.errors import GeometryError
from ssm_planner.problem.drive import Drive
from ssm_planner.simulation.drive import drive_step
from ssm_planner.typing import Array
from tests.support.arm_motion import NOT_UNIQUE, always_unique
from tests.support.velocity_control import Servo, servo_step

Outcome = Literal["unique", "none", "several"]


@dataclass(frozen=True)
class Slip:
    """Acceleration of a sliding drive at one instant."""

    wd: float
    """Motor acceleration in rad/s². NaN where no motion satisfies the law."""
    effort: float
    """Effort F that the mesh carries, in N·m or N."""
    outcome: Outcome


def with_load(drive: Drive, load_inertia: float) -> Drive:
    """Return the drive with the inertia of a load (kg·m² or kg) fixed to its output."""
    return replace(drive, output_inertia=drive.output_inertia + load_inertia)


def mesh_torque(drive: Drive, F: float, wd: float, direction: float, mu: float) -> float:
    """Return the motor torque of the mesh alone for a motion in `direction` (±1).

    The law γ·tan(λ ± φ)·F is written as mean·F + direction·half·|F|.
    """
    up, down = mesh_coefficients(drive, mu)
    mean, half = 0.5 * (up + down), 0.5 * (up - down)
    if drive.kind != "antibacklash_screw":
        return mean * F + direction * half * abs(F)
    main, second = mean - direction * half, mean + direction * half
    return main * (F - drive.preload) + second * (
        drive.preload + drive.second_nut_mass * wd / drive.ratio
    )


def servo_torque(servo: Servo, error: float, integral: float) -> float:
    return min(max(servo.kp * error + integral, -servo.limit), servo.limit)


def servo_rate(servo: Servo, error: float, integral: float) -> float:
    """Return the rate of the integral. It is 0 if the error pushes the torque beyond its limit."""
    expected = servo.kp * error + integral
    return 0.0 if abs(expected) > servo.limit and expected * error > 0 else servo.ki * error


def slip_acceleration(
    drive: Drive, tau: float, w: float, load: float, direction: int, mu: float
) -> Slip:
    """Return the acceleration of a drive that moves, or starts to move, in `direction` (±1).

    `tau` is the motor torque in N·m. `load` is the effort on the output without its inertia and
    friction. The inertia of the load belongs to the drive (`with_load`). The function solves
    motor_torque(F, w, wd) = tau with F = load + J_out·wd/ratio + friction.
    """
    f = required_friction(drive)
    effort = float(output_effort(drive, load, w / drive.ratio, 0.0, direction))
    left = tau - f.b_c * direction - f.b_v * w
    output = drive.output_inertia / drive.ratio
    up, down = mesh_coefficients(drive, mu)
    inertias = (drive.input_inertia + up * output, drive.input_inertia + down * output)
    if drive.kind == "antibacklash_screw":
        main, second = (down, up) if direction > 0 else (up, down)
        inertia = drive.input_inertia + main * output + second * drive.second_nut_mass / drive.ratio
        wd = (left - float(mesh_torque(drive, effort, 0.0, direction, mu))) / float(inertia)
        return Slip(wd, effort + output * wd, "unique")
    result = []
    for side, slope, inertia in zip((1, -1), (up, down), inertias, strict=True):
        if inertia == 0:
            continue
        wd = (left - slope * effort) / float(inertia)
        carried = effort + output * wd
        if carried * direction * side >= 0:
            result.append((wd, carried))
    if not result:
        return Slip(float("nan"), float("nan"), "none")
    wd, carried = result[0]
    return Slip(
        float(wd),
        float(carried),
        "unique" if len(result) == 1 or result[0] == result[1] else "several",
    )


def breaks_away(drive: Drive, tau: float, load: float, mu_static: float) -> int:
    """Return the direction (±1) in which a drive at rest starts under the torque tau, or 0."""
    if tau > breakaway_torque(drive, load, 1.0, mu_static):
        return 1
    if tau < breakaway_torque(drive, load, -1.0, mu_static):
        return -1
    return 0


def friction_power(
    drive: Drive, w: float, effort: float, direction: int, mu: float, wd: float = 0.0
) -> float:
    """Return the power in W that mesh, bearings and output friction turn into heat.

    The power is not negative in motion.
    """
    f = required_friction(drive)
    qd = w / drive.ratio
    transmitted = effort * qd
    if drive.kind == "antibacklash_screw":
        transmitted += drive.second_nut_mass * wd / drive.ratio * qd
    mesh = float(mesh_torque(drive, effort, wd, direction, mu)) * w - transmitted
    return mesh + f.b_c * direction * w + f.b_v * w * w + (f.b_oc * direction + f.b_ov * qd) * qd


Speed = Callable[[float], float]

_MOST_EVENTS = 20_000
_ANGLE, _SPEED, _INTEGRAL, _WORK, _LOSS = range(5)


@dataclass(frozen=True, eq=False)
class DriveMotion:
    """A simulated motion. All arrays are (samples,), on the motor side and in SI units."""

    time: Array
    angle: Array
    w: Array
    tau: Array
    state: Array
    """Direction of sliding, −1 or +1, or 0 for a drive at rest."""
    work: Array
    """Energy in J that the motor has put in since the start."""
    dissipated: Array
    kinetic: Array
    potential: Array
    """Potential energy of the constant load in J."""
    events: tuple[tuple[float, str], ...]
    """Time in s and name of each event.

    The names are `stops`, `starts forwards`, `starts backwards` and `reverses`.
    """
    status: str
    """`done`, or the reason why the simulation ended early."""

    @property
    def energy_error(self) -> float:
        """Return the largest error of the energy balance, relative to the largest energy.

        The error is |work − (kinetic + potential + dissipated)|.
        """
        stored = self.kinetic + self.potential
        error = self.work - (stored - stored[0]) - self.dissipated
        scale = max(
            float(np.max(np.abs(x))) for x in (self.work, self.dissipated, stored - stored[0])
        )
        return float(np.max(np.abs(error)) / scale) if scale > 1e-15 else 0.0


@dataclass
class _Plant:
    """The equations of one drive with a constant load and a servo."""

    drive: Drive
    servo: Servo
    reference: Speed
    load: float

    def torque(self, t: float, x: Array) -> float:
        return servo_torque(self.servo, self.reference(t) - x[_SPEED], x[_INTEGRAL])

    def rates(self, t: float, x: Array, state: int) -> Array:
        w = x[_SPEED] if state else 0.0
        error = self.reference(t) - w
        tau = servo_torque(self.servo, error, x[_INTEGRAL])
        rate = servo_rate(self.servo, error, x[_INTEGRAL])
        if state == 0:
            return np.array([0.0, 0.0, rate, 0.0, 0.0])
        mu = float(friction_coefficient(required_friction(self.drive), w))
        slip = slip_acceleration(self.drive, tau, w, self.load, state, mu)
        loss = friction_power(self.drive, w, slip.effort, state, mu, slip.wd)
        return np.array([w, slip.wd, rate, tau * w, loss])

    def ill_posed(self, t: float, x: Array, state: int) -> bool:
        mu = float(friction_coefficient(required_friction(self.drive), x[_SPEED]))
        outcome = slip_acceleration(
            self.drive, self.torque(t, x), x[_SPEED], self.load, state, mu
        ).outcome
        return outcome != "unique"

    def mu_static(self, rest: float) -> float:
        f = required_friction(self.drive)
        return float(
            static_coefficient(f, rest, min(float(friction_coefficient(f, 0.0)), f.mu_static))
        )


def simulate_drive(
    drive: Drive,
    servo: Servo,
    reference: Speed,
    duration: float,
    *,
    load: float = 0.0,
    load_inertia: float = 0.0,
    speed: float = 0.0,
    rtol: float = 1e-8,
    max_step: float = np.inf,
) -> DriveMotion:
    """Integrate a drive adaptively and locate every stop and start as an event.

    `reference` gives the wanted motor speed in rad/s at a time in s. `load` is a constant effort on
    the output in N·m or N. `load_inertia` is in kg·m² or kg. `speed` is the initial motor speed in
    rad/s.

    The simulation ends early, with a status that states the reason, if the rigid law has no unique
    motion (`effective_inertia`) or if the number of events exceeds its limit.
    """
    plant = _Plant(with_load(drive, load_inertia), servo, reference, load)
    x = np.zeros(5)
    x[_SPEED] = speed
    t, rest_since, state = 0.0, -np.inf, int(np.sign(speed))
    if state == 0:
        state = breaks_away(plant.drive, plant.torque(t, x), load, plant.mu_static(np.inf))
    pieces: list[tuple[Array, Array, int]] = []
    events: list[tuple[float, str]] = []
    status = "done"
    while t < duration:
        if state and plant.ill_posed(t, x, state):
            status = NOT_UNIQUE
            break
        if len(events) > _MOST_EVENTS:
            status = f"more than {_MOST_EVENTS} stops and starts"
            break
        times, states, event = _piece(plant, t, x, state, duration, rest_since, rtol, max_step)
        pieces.append((times, states, state))
        t, x = float(times[-1]), states[-1].copy()
        if event is None:
            break
        state, rest_since, name = _next_state(plant, t, x, state, event)
        events.append((t, name))
    return _collect(plant, pieces, tuple(events), status)


def _piece(
    plant: _Plant,
    t: float,
    x: Array,
    state: int,
    end: float,
    rest_since: float,
    rtol: float,
    max_step: float,
) -> tuple[Array, Array, int | None]:
    """Integrate until the state ends. Returns times, states and the index of the event or None."""
    from scipy.integrate import solve_ivp

    watched = _sliding_events() if state else _standing_events(plant, rest_since)
    scale = np.array([1e-3, 1e-4, 1e-7, 1e-9, 1e-9])
    result = solve_ivp(
        plant.rates,
        (t, end),
        x,
        args=(state,),
        events=watched,
        rtol=rtol,
        atol=rtol * scale,
        max_step=max_step,
    )
    fired = [k for k, crossings in enumerate(result.t_events or []) if len(crossings)]
    return result.t, result.y.T, fired[0] if fired else None


def _sliding_events() -> list[Any]:
    def stops(t: float, x: Array, state: int) -> float:
        # A drive that has just started is still at speed 0. Only a return to 0 counts.
        return float(x[_SPEED] * state)

    stops.terminal, stops.direction = True, -1.0  # type: ignore[attr-defined]
    return [stops]


def _standing_events(plant: _Plant, rest_since: float) -> list[Any]:
    def margin(t: float, x: Array, sign: float) -> float:
        limit = breakaway_torque(plant.drive, plant.load, sign, plant.mu_static(t - rest_since))
        return float(sign * (plant.torque(t, x) - limit))

    def forwards(t: float, x: Array, state: int) -> float:
        return margin(t, x, 1.0)

    def backwards(t: float, x: Array, state: int) -> float:
        return margin(t, x, -1.0)

    for event in (forwards, backwards):
        event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
    return [forwards, backwards]


def _next_state(
    plant: _Plant, t: float, x: Array, state: int, event: int
) -> tuple[int, float, str]:
    """Return the new state, the start of the rest and the name of the event.

    The speed in `x` is set to exactly 0.
    """
    x[_SPEED] = 0.0
    if state == 0:
        return (1, -np.inf, "starts forwards") if event == 0 else (-1, -np.inf, "starts backwards")
    onwards = breaks_away(plant.drive, plant.torque(t, x), plant.load, plant.mu_static(0.0))
    if onwards == -state:
        return onwards, -np.inf, "reverses"
    return 0, t, "stops"


def _collect(
    plant: _Plant,
    pieces: list[tuple[Array, Array, int]],
    events: tuple[tuple[float, str], ...],
    status: str,
) -> DriveMotion:
    time = np.concatenate([times for times, _, _ in pieces]) if pieces else np.zeros(1)
    x = np.concatenate([states for _, states, _ in pieces]) if pieces else np.zeros((1, 5))
    state = (
        np.concatenate([np.full(len(times), s) for times, _, s in pieces])
        if pieces
        else np.zeros(1)
    )
    drive = plant.drive
    moved = (drive.output_inertia + drive.second_nut_mass) / drive.ratio**2
    return DriveMotion(
        time=time,
        angle=x[:, _ANGLE],
        w=x[:, _SPEED],
        tau=np.array([plant.torque(t, row) for t, row in zip(time, x, strict=True)]),
        state=state,
        work=x[:, _WORK],
        dissipated=x[:, _LOSS],
        kinetic=0.5 * (drive.input_inertia + moved) * x[:, _SPEED] ** 2,
        potential=plant.load * x[:, _ANGLE] / drive.ratio,
        events=events,
        status=status,
    )


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
    """Follow motor speeds `reference` (n,) in rad/s from rest, one speed per control period.

    Each `period` in s has `steps` integration steps. A `servo` of None stands for a motor without
    power. `load` is a constant effort on the output in N·m or N. `load_inertia` is in kg·m² or kg.

    The inertia of the load is rigidly coupled. The motion is therefore meaningful only where
    `effective_inertia` is positive on both sides.
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


def _period(
    drive: Drive, servo: Servo | None, load: float, period: float, steps: int
) -> ca.Function:
    """Return the function of one control period.

    It maps the state and the wanted speed to the state after the period and the torque in it.
    """
    x, expected = ca.SX.sym("x", 6), ca.SX.sym("wanted")
    angle, w, integral, rest, work, loss = ca.vertsplit(x)
    tau, integral = (
        (ca.SX(0), integral) if servo is None else servo_step(servo, expected - w, integral, period)
    )
    h = period / steps
    for _ in range(steps):
        step = drive_step(drive, w, rest, tau, ca.SX(load), h=h)
        mean = 0.5 * (w + step.w)
        angle, work, loss = angle + h * mean, work + h * tau * mean, loss + step.loss
        w, rest = step.w, step.rest_time
    return ca.Function(
        "period",
        [x, expected],
        [ca.vertcat(angle, w, integral, rest, work, loss), tau],
        {"cse": True},
    )

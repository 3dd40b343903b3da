"""Forward simulation of one drive under a velocity-controlled motor; standstill is a state with its own equations.

Sticking, the speed is exactly 0 until the torque passes breakaway; sliding, the exact law is solved for the
acceleration. `simulate_drive` integrates adaptively and finds every change of state as an event; `step_drive` is the
fixed-step form. Frictional memory is left out: the coefficient follows the speed at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.dynamics.forward import breaks_away, friction_power, slip_acceleration, with_load
from ssm_planner.dynamics.friction import friction_coefficient, friction_of, static_coefficient
from ssm_planner.dynamics.transmission import breakaway_torque
from ssm_planner.problem.drive import Drive
from ssm_planner.simulation.servo import Servo
from ssm_planner.typing import Array

Speed = Callable[[float], float]
NOT_UNIQUE = "the effective inertia with the load driving is negative: a rigid drive has no unique motion"

_MOST_EVENTS = 20_000
_ANGLE, _SPEED, _INTEGRAL, _WORK, _LOSS = range(5)


@dataclass(frozen=True, eq=False)
class DriveMotion:
    """A simulated motion, arrays (samples,); motor side, SI."""

    time: Array
    angle: Array
    w: Array
    tau: Array
    state: Array
    """−1, 0 or +1: sliding backwards, standing, sliding forwards."""
    work: Array
    """Energy that the motor has put in since the start, J."""
    dissipated: Array
    kinetic: Array
    potential: Array
    """Of the constant load, J."""
    events: tuple[tuple[float, str], ...]
    """(time, `stops` | `starts forwards` | `starts backwards` | `reverses`)."""
    status: str
    """`done`, or why the simulation ended early."""

    @property
    def energy_error(self) -> float:
        """Largest |work − (kinetic + potential + dissipated)| over the largest energy that passed."""
        stored = self.kinetic + self.potential
        error = self.work - (stored - stored[0]) - self.dissipated
        scale = max(float(np.max(np.abs(x))) for x in (self.work, self.dissipated, stored - stored[0]))
        return float(np.max(np.abs(error)) / scale) if scale > 1e-15 else 0.0


@dataclass
class _Plant:
    """Equations of one drive with a constant load under a servo."""

    drive: Drive
    servo: Servo
    reference: Speed
    load: float

    def torque(self, t: float, x: Array) -> float:
        return self.servo.torque(self.reference(t) - x[_SPEED], x[_INTEGRAL])

    def rates(self, t: float, x: Array, state: int) -> Array:
        w = x[_SPEED] if state else 0.0
        error = self.reference(t) - w
        tau = self.servo.torque(error, x[_INTEGRAL])
        rate = self.servo.integral_rate(error, x[_INTEGRAL])
        if state == 0:
            return np.array([0.0, 0.0, rate, 0.0, 0.0])
        mu = float(friction_coefficient(friction_of(self.drive), w))
        slip = slip_acceleration(self.drive, tau, w, self.load, state, mu)
        loss = friction_power(self.drive, w, slip.effort, state, mu, slip.wd)
        return np.array([w, slip.wd, rate, tau * w, loss])

    def ill_posed(self, t: float, x: Array, state: int) -> bool:
        mu = float(friction_coefficient(friction_of(self.drive), x[_SPEED]))
        outcome = slip_acceleration(self.drive, self.torque(t, x), x[_SPEED], self.load, state, mu).outcome
        return outcome != "unique"

    def mu_static(self, rest: float) -> float:
        f = friction_of(self.drive)
        return float(static_coefficient(f, rest, min(float(friction_coefficient(f, 0.0)), f.mu_static)))


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
    """Integrate a drive adaptively, every stop and start found as an event.

    reference: motor speed wanted at a time (s), rad/s. load: constant effort on the output, N·m or N; load_inertia: kg·m²
    or kg. speed: initial motor speed. Ends early, with a status that says why, where the rigid law has no unique motion
    (`effective_inertia`) or events follow each other without end.
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
    plant: _Plant, t: float, x: Array, state: int, end: float, rest_since: float, rtol: float, max_step: float
) -> tuple[Array, Array, int | None]:
    """Integrate one state until it ends: (times, states, index of the event or None)."""
    from scipy.integrate import solve_ivp

    watched = _sliding_events() if state else _standing_events(plant, rest_since)
    scale = np.array([1e-3, 1e-4, 1e-7, 1e-9, 1e-9])
    found = solve_ivp(
        plant.rates, (t, end), x, args=(state,), events=watched, rtol=rtol, atol=rtol * scale, max_step=max_step
    )
    fired = [k for k, at in enumerate(found.t_events or []) if len(at)]
    return found.t, found.y.T, fired[0] if fired else None


def _sliding_events() -> list[Any]:
    def stops(t: float, x: Array, state: int) -> float:
        # A drive that has just started is still at 0: only a return to 0 counts.
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


def _next_state(plant: _Plant, t: float, x: Array, state: int, event: int) -> tuple[int, float, str]:
    """(new state, start of rest, name) after an event; x is corrected to an exact standstill."""
    x[_SPEED] = 0.0
    if state == 0:
        return (1, -np.inf, "starts forwards") if event == 0 else (-1, -np.inf, "starts backwards")
    onwards = breaks_away(plant.drive, plant.torque(t, x), plant.load, plant.mu_static(0.0))
    if onwards == -state:
        return onwards, -np.inf, "reverses"
    return 0, t, "stops"


def _collect(
    plant: _Plant, pieces: list[tuple[Array, Array, int]], events: tuple[tuple[float, str], ...], status: str
) -> DriveMotion:
    time = np.concatenate([times for times, _, _ in pieces]) if pieces else np.zeros(1)
    x = np.concatenate([states for _, states, _ in pieces]) if pieces else np.zeros((1, 5))
    state = np.concatenate([np.full(len(times), s) for times, _, s in pieces]) if pieces else np.zeros(1)
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

"""Reference for the simulation of the whole arm, which locates every stop and start of a drive.

It integrates the equations of velocity_control.py adaptively to a tolerance, with servos in
continuous time. The fixed-step simulation is compared with it. The reference is some hundred times
slower.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.dynamics.friction import (
    friction_coefficient,
    required_friction,
    static_coefficient,
)
from ssm_planner.dynamics.transmission import breakaway_torque
from ssm_planner.problem.drive import Drive
from ssm_planner.typing import Array
from tests.support.adaptive_drive import (
    breaks_away,
    friction_power,
    servo_rate,
    servo_torque,
    slip_acceleration,
)
from tests.support.arm_motion import ArmMotion, arm_motion
from tests.support.velocity_control import ArmSimulation

Reference = Callable[[float], tuple[Array, Array, Array]]
"""Function from a time in s to the wanted q, qd and qdd, (4,) each."""

_MOST_EVENTS = 20_000
_STATE = 24
_WORK, _LOCKED_WORK, _FRICTION, _DAMPING = range(4)


@dataclass(frozen=True, eq=False)
class AdaptiveMotion:
    """The motion at the requested instants, and its events.

    An event is (time, joint from 0, `stops`, `starts` or `reverses`).
    """

    motion: ArmMotion
    events: tuple[tuple[float, int, str], ...]
    status: str


def simulate_arm(
    arm: ArmSimulation, reference: Reference, times: Array, rtol: float = 1e-7
) -> AdaptiveMotion:
    """Integrate the arm from rest at reference(times[0]) and sample it at increasing times (n,)."""
    from scipy.integrate import solve_ivp

    plant = _Arm(arm, reference)
    times = np.asarray(times, dtype=float)
    full = arm.state_at_rest(reference(float(times[0]))[0])
    x = np.concatenate([full[:20], np.zeros(4)])
    t, end = float(times[0]), float(times[-1])
    modes, since = dict.fromkeys(arm.driven, 0), dict.fromkeys(arm.driven, -np.inf)
    rows: list[Array] = [x]
    events: list[tuple[float, int, str]] = []
    status = "done"
    while t < end:
        if len(events) > _MOST_EVENTS:
            status = f"more than {_MOST_EVENTS} stops and starts"
            break
        owners, watched = plant.events(modes, since)
        inside = times[(times > t) & (times <= end)]
        result = solve_ivp(
            plant.rates,
            (t, end),
            x,
            args=(modes,),
            events=watched,
            t_eval=inside,
            rtol=rtol,
            atol=rtol * plant.scale,
        )
        if len(result.t):
            rows.extend(result.y.T)
        instants, at_events = result.t_events or [], result.y_events or []
        fired = [k for k, crossings in enumerate(instants) if len(crossings)]
        if not fired:
            status = "done" if result.success else str(result.message)
            break
        t, x = float(instants[fired[0]][0]), at_events[fired[0]][0].copy()
        joint = owners[fired[0]]
        modes[joint], name = plant.after_event(t, x, joint, modes[joint])
        since[joint] = t if modes[joint] == 0 else -np.inf
        events.append((t, joint, name))
    states = np.array(rows)
    tau = np.array([plant.torques(s, row) for s, row in zip(times, states, strict=False)])
    full_states = np.hstack([states[:, :20], np.zeros((len(states), 4)), states[:, 20:]])
    return AdaptiveMotion(
        arm_motion(arm, times[: len(states)], full_states, tau), tuple(events), status
    )


class _Arm:
    """Right-hand side and events of the arm.

    The state is (q, qd, motor angle, w, integral; 4 energies).
    """

    def __init__(self, arm: ArmSimulation, reference: Reference) -> None:
        self.arm, self.reference = arm, reference
        q, qd, force, locked = (ca.SX.sym(name, 4) for name in ("q", "qd", "force", "locked"))
        qdd = arm.accelerations(q, qd, force, locked)
        self.dynamics = ca.Function(
            "dynamics", [q, qd, force, locked], [qdd, arm.body.symbolic(q, qd, qdd)]
        )
        speeds = [1.0, 1.0, 1.0, 0.1]
        self.scale = np.array(
            [*([1e-3] * 4), *speeds, *([1e-1] * 4), *([10.0] * 4), *([1e-3] * 4), *([1e-2] * 4)]
        )

    def torques(self, t: float, x: Array) -> Array:
        q, qd, _ = self.reference(t)
        tau = np.zeros(4)
        for k in self.arm.driven:
            servo = self.arm.servos[k]
            if servo is not None:
                tau[k] = servo_torque(servo, self._error(k, q, qd, x), x[16 + k])
        return tau

    def rates(self, t: float, x: Array, modes: dict[int, int]) -> Array:
        arm = self.arm
        q, qd, qdd = self.reference(t)
        tau = self.torques(t, x)
        rate, force = np.zeros(_STATE), np.zeros(4)
        for k in arm.driven:
            drive = arm.drive(k)
            load, damper = self._load(k, x, modes[k])
            force[k] = load
            w = x[12 + k] if modes[k] else 0.0
            servo = arm.servos[k]
            if servo is not None:
                rate[16 + k] = servo_rate(servo, self._error(k, q, qd, x), x[16 + k])
            rate[20 + _DAMPING] += damper * (w / drive.ratio - x[4 + k])
            if modes[k]:
                mu = float(friction_coefficient(required_friction(drive), w))
                slip = slip_acceleration(drive, tau[k], w, load, modes[k], mu)
                rate[8 + k], rate[12 + k] = w, slip.wd
                rate[20 + _FRICTION] += friction_power(drive, w, slip.effort, modes[k], mu, slip.wd)
                rate[20 + _WORK] += tau[k] * w
        accelerations, efforts = self.dynamics(x[:4], x[4:8], force, qdd)
        rate[:4], rate[4:8] = x[4:8], accelerations.full()[:, 0]
        for k in set(range(4)) - set(arm.driven):
            rate[20 + _LOCKED_WORK] += float(efforts[k]) * x[4 + k]
        return rate

    def events(self, modes: dict[int, int], since: dict[int, float]) -> tuple[list[int], list[Any]]:
        owners: list[int] = []
        watched: list[Any] = []
        for k in self.arm.driven:
            signs = (modes[k],) if modes[k] else (1, -1)
            for sign in signs:
                event = self._stop(k) if modes[k] else self._start(k, sign, since[k])
                event.terminal, event.direction = True, -1.0 if modes[k] else 1.0
                owners.append(k)
                watched.append(event)
        return owners, watched

    def after_event(self, t: float, x: Array, k: int, mode: int) -> tuple[int, str]:
        """Return the new mode and the name of the event. The speed in `x` is set to exactly 0."""
        x[12 + k] = 0.0
        load, _ = self._load(k, x, 0)
        drive, tau = self.arm.drive(k), float(self.torques(t, x)[k])
        if mode == 0:
            upper = breakaway_torque(drive, load, 1.0, self._mu_static(drive, np.inf))
            return (
                1 if tau > 0.5 * (upper + breakaway_torque(drive, load, -1.0)) else -1
            ), "starts"
        onwards = breaks_away(drive, tau, load, self._mu_static(drive, 0.0))
        return (onwards, "reverses") if onwards == -mode else (0, "stops")

    def _stop(self, k: int) -> Any:
        def stop(t: float, x: Array, modes: dict[int, int]) -> float:
            return float(x[12 + k] * modes[k])

        return stop

    def _start(self, k: int, sign: int, since: float) -> Any:
        drive = self.arm.drive(k)

        def start(t: float, x: Array, modes: dict[int, int]) -> float:
            load, _ = self._load(k, x, 0)
            limit = breakaway_torque(drive, load, float(sign), self._mu_static(drive, t - since))
            return float(sign * (self.torques(t, x)[k] - limit))

        return start

    def _load(self, k: int, x: Array, mode: int) -> tuple[float, float]:
        """Return the effort of spring and damper on the output, and the part of the damper."""
        ratio, compliance = self.arm.drive(k).ratio, self.arm.compliance
        damper = compliance.damping[k] * ((x[12 + k] if mode else 0.0) / ratio - x[4 + k])
        return float(compliance.stiffness[k] * (x[8 + k] / ratio - x[k]) + damper), float(damper)

    def _error(self, k: int, q: Array, qd: Array, x: Array) -> float:
        ratio = self.arm.drive(k).ratio
        return float(ratio * qd[k] + self.arm.position_gain * (ratio * q[k] - x[8 + k]) - x[12 + k])

    def _mu_static(self, drive: Drive, rest: float) -> float:
        f = required_friction(drive)
        return float(
            static_coefficient(f, rest, min(float(friction_coefficient(f, 0.0)), f.mu_static))
        )

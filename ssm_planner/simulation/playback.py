"""Set points played on the simulated arm: what the drives are told at every period of their position loop."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ssm_planner.codegen.vectorised import dense
from ssm_planner.formats.epos4 import Stream
from ssm_planner.formats.epos4_setup import Axis
from ssm_planner.problem.controller import Controller
from ssm_planner.problem.robot import JOINTS, Robot
from ssm_planner.simulation.cascade import Electrics, electrics_of, encoder, gains_of, loop_step
from ssm_planner.simulation.plant import (
    FRICTION,
    INTEGRAL,
    MOTOR,
    QD,
    STATE,
    ArmPlant,
    Compliance,
    W,
)
from ssm_planner.typing import Array, Mask
from ssm_planner.units import rpm

STEPS = 2
"""Of the plant in one period of the position loop."""
FREQUENCIES = (30.0, 30.0, 30.0, 100.0)
"""Natural frequencies of the joints with their drives locked, Hz: assumed."""
BACKLASH = (np.radians(0.1), np.radians(0.1), np.radians(0.1), 2e-5)
"""Free play between drive and joint, rad and m: assumed."""

CURRENT, DERIVATIVE, ERROR, TRIP = (slice(STATE + 4 * k, STATE + 4 * k + 4) for k in range(4))
"""Of a state (44,) behind that of the plant: A, A, rad, and 1 where the drive has tripped."""
WHOLE = STATE + 16
_CHUNK = 250
_BREAKAWAY = 100
"""Periods that breaking away takes."""


@dataclass(frozen=True, eq=False)
class Commands:
    """What reaches the drives in every period of the position loop, (n, 4) each; SI, in the joints' positive directions."""

    demand: Array
    """Motor angle, rad."""
    speed: Array
    """rad/s, of the velocity offset."""
    acceleration: Array
    """rad/s², difference of the velocity offsets."""
    torque: Array
    """N·m, of the torque offset."""
    given: Array
    """Accelerations of joints without a drive."""
    power: Array
    """(n,): 1 where the drives have power."""
    stalled: Array
    """1 where something holds the motor fast."""

    def table(self) -> Array:
        """(n, 25)."""
        parts = (self.demand, self.speed, self.acceleration, self.torque, self.given, self.stalled)
        return np.column_stack([*parts, self.power])


@dataclass(frozen=True, eq=False)
class Played:
    """A motion in n periods."""

    states: Array
    """(n + 1, 44): before the first period and after every one."""
    error: Array
    """Following errors (n, 4), rad at the motor."""
    saturated: Array
    """(n, 4): 1 where less current could flow than was demanded."""


def commands(
    streams: dict[str, Stream],
    axes: dict[str, Axis],
    controller: Controller,
    given: tuple[Array, Array],
    period: float,
) -> Commands:
    """Set points every `period` (s) as the drives take them up at their loop period.

    Between two set points the position is interpolated (0x60C2); velocity and torque offsets hold for a period. The
    delay of one period that this costs is common to all drives and left out. given: times (n,) of the loop and
    accelerations (n, 4) of what has no drive.
    """
    t, accelerations = given
    columns = {
        name: np.zeros((len(t), 4)) for name in ("demand", "speed", "acceleration", "torque")
    }
    for name, stream in streams.items():
        axis, k = axes[name], JOINTS.index(name)
        sent = period * np.arange(len(stream["target_position_inc"]))
        coming = np.minimum(np.floor(t / period + 1e-9).astype(int) + 1, len(sent) - 1)
        increment = 2.0 * np.pi / axis.counts_per_turn * axis.direction
        columns["demand"][:, k] = increment * np.interp(t, sent, stream["target_position_inc"])
        speed = axis.direction * stream["velocity_offset_mrpm"] * rpm / 1000.0
        bend = np.append(np.diff(speed), 0.0) / period
        columns["speed"][:, k], columns["acceleration"][:, k] = (
            speed[coming],
            bend[np.maximum(coming - 1, 0)],
        )
        if controller.torque_offset:
            offset = axis.direction * stream["torque_offset_permille"] * axis.rated_torque / 1000.0
            columns["torque"][:, k] = offset[coming]
    return Commands(
        **columns, given=accelerations, power=np.ones(len(t)), stalled=np.zeros((len(t), 4))
    )


def compliance_of(plant_robot: Robot, controller: Controller, scale: float = 1.0) -> Compliance:
    """Springs, dampers and backlash as the controller file has them, or as assumed; stiffness and damping times scale."""
    body = ArmPlant(plant_robot, None, controller.loop_period).body
    frequency, backlash, ratios = list(FREQUENCIES), list(BACKLASH), [0.3] * 4
    for k, name in enumerate(JOINTS):
        part = controller.compliance.get(name)
        if part is not None:
            frequency[k] = part.frequency or frequency[k]
            backlash[k] = backlash[k] if part.backlash is None else part.backlash
            ratios[k] = part.damping_ratio
    found = Compliance.of_frequency(
        body, np.zeros(4), (frequency[0], frequency[1], frequency[2], frequency[3])
    )
    damping = found.damping * np.asarray(ratios) / 0.3
    return Compliance(found.stiffness * scale, damping * scale, np.asarray(backlash))


class ControlledArm(ArmPlant):
    """An arm with its drives' controllers; built once, played any number of set points and frictions."""

    def __init__(
        self,
        robot: Robot,
        controller: Controller,
        axes: dict[str, Axis],
        windows: dict[str, float],
        *,
        compliance: Compliance | None = None,
        steps: int = STEPS,
    ) -> None:
        """windows: following error, rad at the motor, beyond which a drive trips, by joint."""
        self.period, self.steps = controller.loop_period, steps
        super().__init__(robot, compliance or compliance_of(robot, controller), self.period / steps)
        self.controller, self.axes, self.windows = controller, axes, windows
        self.electrics: dict[int, Electrics] = {
            k: electrics_of(robot.joints[k], controller) for k in self.driven
        }
        self.one = self._period_function()
        self._many = self.one.mapaccum("arm", _CHUNK)

    def start(self, q: Array) -> Array:
        """State (44,) at rest at q (4,); the drives' encoders were set there."""
        return np.concatenate([self.at_rest(q), np.zeros(WHOLE - STATE)])

    def offsets(self, state: Array, q: Array) -> Array:
        """Motor angle (4,) beyond ratio · q, which the encoders take for nothing: they were set at q (4,)."""
        found = np.zeros(4)
        for k in self.driven:
            found[k] = state[MOTOR][k] - self.drive(k).ratio * q[k]
        return found

    def play(self, state: Array, told: Commands, offsets: Array, friction: Array) -> Played:
        """From a state (44,): commands (n periods), encoder offsets (4,), friction as `ArmPlant.friction` gives it."""
        table = told.table()
        table = np.hstack([table, np.tile(np.concatenate([offsets, friction]), (len(table), 1))])
        halved = self.halved(told)
        whole, rest = divmod(len(table), _CHUNK)
        states, errors, saturated = [state[:, None]], [], []
        for k in range(whole + (rest > 0)):
            part = table[k * _CHUNK : (k + 1) * _CHUNK]
            used = len(part)
            part = (
                np.vstack([part, np.repeat(part[-1:], _CHUNK - used, axis=0)])
                if used < _CHUNK
                else part
            )
            play = self._many_halves if halved[k * _CHUNK] else self._many
            after, error, cut = play(states[-1][:, -1], part.T)
            states.append(after.full()[:, :used])
            errors.append(error.full()[:, :used])
            saturated.append(cut.full()[:, :used])
        return Played(np.hstack(states).T, np.hstack(errors).T, np.hstack(saturated).T)

    def halved(self, told: Commands) -> Mask:
        """(n,): periods played in half steps, those about a drive's breaking away: there a step errs most."""
        turns = told.speed != 0
        starts = (turns & ~np.vstack([np.zeros((1, 4), dtype=bool), turns[:-1]])).any(axis=1)
        chunks = range(0, len(starts), _CHUNK)
        return np.repeat(
            [starts[max(0, k - _BREAKAWAY) : k + _CHUNK].any() for k in chunks], _CHUNK
        )[: len(starts)]

    @cached_property
    def one_in_halves(self) -> ca.Function:
        """`one` in steps half as long."""
        h, steps = self.h, self.steps
        self.h, self.steps = h / 2, 2 * steps
        function = self._period_function()
        self.h, self.steps = h, steps
        return function

    @cached_property
    def _many_halves(self) -> ca.Function:
        return self.one_in_halves.mapaccum("halves", _CHUNK)

    def _period_function(self) -> ca.Function:
        """(state, commands of one period) → (state after it, following errors, saturation)."""
        x, u = ca.SX.sym("x", WHOLE), ca.SX.sym("u", 25 + 4 + 4 * len(FRICTION))
        demand, speed, acceleration, torque, given, stalled = (
            u[4 * k : 4 * k + 4] for k in range(6)
        )
        offsets, friction = u[25:29], u[29:]
        power = ca.logic_and(u[24], ca.mmax(x[TRIP]) == 0)
        tau, loops = (
            [ca.SX(0)] * 4,
            {name: [ca.SX(0)] * 4 for name in ("current", "i", "d", "e", "trip", "cut")},
        )
        for k in self.driven:
            joint, electrics = self.robot.joints[k], self.electrics[k]
            gains, axis = gains_of(joint, self.controller, electrics), self.axes[joint.name]
            error = demand[k] - encoder(x[MOTOR][k] - offsets[k], axis.counts_per_turn)
            forward = gains.ff_velocity * speed[k] + gains.ff_acceleration * acceleration[k]
            step = loop_step(
                gains,
                electrics,
                self.period,
                error=ca.vertcat(error, x[ERROR][k]),
                before=ca.vertcat(x[CURRENT][k], x[INTEGRAL][k], x[DERIVATIVE][k]),
                w=x[W][k],
                feedforward=forward + torque[k] / electrics.torque_constant,
            )
            current = ca.if_else(power, step.current, 0)
            tau[k] = electrics.torque_constant * current
            loops["current"][k], loops["cut"][k] = current, ca.logic_and(power, step.saturated)
            loops["i"][k], loops["d"][k], loops["e"][k] = step.integral, step.derivative, error
            late = ca.logic_and(power, ca.fabs(error) > self.windows[joint.name])
            loops["trip"][k] = ca.fmax(x[TRIP][k], late)
        # what has no drive stops where it is without power: nothing is known of how it is moved
        locked = ca.if_else(power, given, -x[QD] / self.period)
        y = ca.vertcat(x[: INTEGRAL.start], *loops["i"], x[INTEGRAL.stop : STATE])
        step_once = self.step_function()
        for _ in range(self.steps):
            y = step_once(y, ca.vertcat(*tau), locked, stalled, friction)
        after = ca.vertcat(y, *(ca.vertcat(*loops[name]) for name in ("current", "d", "e", "trip")))
        outputs = [after, ca.vertcat(*loops["e"]), ca.vertcat(*loops["cut"])]
        return dense("period", [x, u], outputs)

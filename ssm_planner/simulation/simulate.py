"""A plan played on the simulated arm: its exported set points, the drives' controllers, and what may go wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from ssm_planner.dynamics.rigid_body import with_payload
from ssm_planner.errors import ProblemError
from ssm_planner.formats.epos4 import setpoint_times, setpoints
from ssm_planner.formats.epos4_setup import QUADRATURE, Axis, axes_of, following_error_window
from ssm_planner.formats.spline_points import at_times
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.plans import Plan
from ssm_planner.problem.controller import Controller
from ssm_planner.problem.robot import JOINTS, Robot
from ssm_planner.simulation.cascade import electrics_of
from ssm_planner.simulation.draws import Draws, drawn_frictions, play_draws
from ssm_planner.simulation.plant import MOTOR, QD, Q, W
from ssm_planner.simulation.playback import (
    CURRENT,
    TRIP,
    Commands,
    ControlledArm,
    Played,
    commands,
    compliance_of,
)
from ssm_planner.typing import Array

PERIOD = 1
"""Of the set points, ms, as exported."""
COUNTS = 4096
"""Increments per motor turn where neither the motor's nor the controller's file gives them: as on the authors' rigs."""
TIP_ERROR = 1e-4
"""Largest tip error that passes unless another is given, m: about the tremor of an unaided hand (0.05 to 0.18 mm RMS)."""
SETTLE = 0.2
"""Time that the drives hold the target before the power goes, s."""
HORIZON = 1.0
"""Time after a loss of power within which the arm must stand, s."""
STILL = 0.05
"""A joint that swings on its spring turns back within this time, s: only what is still for as long stands."""
STANDS = 1e-3
"""A joint slower than this share of its velocity limit, with its motor at rest, stands."""
EVERYWHERE: Literal["everywhere"] = "everywhere"


@dataclass(frozen=True)
class Scenario:
    """What happens while a plan is played; all of it may be combined."""

    speed: float = 1.0
    """Of the playback, relative to the plan."""
    payload: float = 0.0
    """Point mass at the tip, kg."""
    payload_time: float = 0.0
    """When it is taken up, s."""
    power_loss: float | Literal["everywhere"] | None = None
    """When all drives lose their power, s from the start; None: after the target has been held for SETTLE."""
    instants: int = 1000
    """Of a power loss everywhere."""
    stall: tuple[str, float] | None = None
    """Joint whose motor something holds fast, and from when, s."""
    supply: float | None = None
    """V; None: the controller's."""
    friction: float = 1.0
    """Times the friction of every drive."""
    dropped: float | None = None
    """When one set point of every drive is lost, s."""
    wrong_direction: str | None = None
    """Joint whose controller counts the other way than the robot file says."""
    compliance: float = 1.0
    """Times the assumed stiffness and damping between motor and joint."""
    draws: int = 0
    """Frictions under which the motion is played besides, drawn from what the drive files know of them."""
    spread: float | None = None
    """Range of the friction of which a drive file says nothing, as a share; None: as stated."""
    tip_error: float = TIP_ERROR
    """Largest that passes, m."""
    travel: float | None = None
    """Largest way of the tip after a loss of power that passes, m; None: any."""

    def __post_init__(self) -> None:
        if self.power_loss is not None and self.power_loss != EVERYWHERE:
            object.__setattr__(self, "power_loss", float(self.power_loss))

    def check(self, robot: Robot, duration: float) -> None:
        """Raises ProblemError for what cannot happen to this robot within the duration (s) of the playback."""
        driven = [joint.name for joint in robot.joints if joint.drive is not None]
        if not 0 < self.speed <= 1:
            raise ProblemError(
                "no playback", key="speed", value=self.speed, allowed="above 0 and up to 1 (100 %)"
            )
        if not 0 <= self.draws <= 100_000:
            raise ProblemError(
                "no such number", key="draws", value=self.draws, allowed="0 to 100 000"
            )
        if self.spread is not None and not 0 <= self.spread < 1:
            raise ProblemError(
                "no range of friction",
                key="spread",
                value=self.spread,
                allowed="0 up to, not including, 1",
            )
        if self.draws and self.payload and self.payload_time > 0:
            raise ProblemError(
                "not with draws", key="payload_time", value=self.payload_time, allowed="0"
            )
        if not 0 < self.friction <= 10:
            raise ProblemError(
                "no such friction",
                key="friction",
                value=self.friction,
                allowed="above 0 and up to 10",
            )
        for key, joint in (
            ("stall", self.stall and self.stall[0]),
            ("wrong_direction", self.wrong_direction),
        ):
            if joint is not None and joint not in driven:
                raise ProblemError(
                    "no driven joint", key=key, value=joint, allowed=", ".join(driven)
                )
        loss = None if self.power_loss == EVERYWHERE else self.power_loss
        times = {"power_loss": loss, "stall": self.stall and self.stall[1], "dropped": self.dropped}
        for key, time in {**times, "payload_time": self.payload_time}.items():
            if time is not None and not 0 <= time <= duration:
                raise ProblemError(
                    "not during the motion", key=key, value=time, allowed=f"0 s to {duration:.4g} s"
                )


@dataclass(frozen=True)
class Tracking:
    """Of one joint, rad or m: simulated minus planned position while the drives have power."""

    joint: str
    worst: float
    rms: float


@dataclass(frozen=True)
class MotorUse:
    """What one motor did."""

    joint: str
    peak_torque: float
    """N·m."""
    limit: float
    """Its largest torque, N·m."""
    saturated: bool
    """More current was demanded than the drive or its supply could give."""
    tripped: bool
    """The following error left its window."""
    following_error: float
    """Largest, increments."""
    window: int
    """Increments."""
    placeholder: bool
    """Some of the motor's figures stand in for unknown ones."""


@dataclass(frozen=True, eq=False)
class PowerLosses:
    """What the arm does when all drives lose their power at each of n instants."""

    time: Array
    """(n,), s from the start."""
    travel: Array
    """(n,): largest distance of the tip from where it was, m."""
    standing: Array
    """(n,): time until the arm stands, s; infinite where it does not within HORIZON."""

    @property
    def holds(self) -> bool:
        """The arm came to stand everywhere."""
        return bool(np.all(np.isfinite(self.standing)))

    @property
    def worst(self) -> int:
        """Place of the largest travel."""
        return int(np.argmax(self.travel))


@dataclass(frozen=True, eq=False)
class SimulationResult:
    """A simulated playback: motion beside the plan, and a verdict. Arrays (n,) and (n, 4), SI."""

    time: Array
    planned: Array
    """Joint positions that the plan wants."""
    q: Array
    qd: Array
    motor_angle: Array
    """As the encoder counts, rad, from ratio · q at the start."""
    w: Array
    torque: Array
    tip: Array
    """Distance of the tip from where the plan wants it, m, (n,)."""
    following: Array
    """Following errors, rad at the motor."""
    powered: Array
    """(n,): whether the drives have power, which goes and does not come back."""
    tracking: tuple[Tracking, ...]
    motors: tuple[MotorUse, ...]
    losses: PowerLosses
    scenario: Scenario
    reasons: tuple[str, ...]
    """Why it did not pass; empty where it did."""
    axes: dict[str, Axis] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    draws: Draws | None = None
    """Of the same motion under drawn frictions; None where none were asked for."""
    """What was assumed."""

    @property
    def passed(self) -> bool:
        """Followed, without a trip or saturation, and stood without power."""
        return not self.reasons

    @property
    def tip_error(self) -> float:
        """Largest while the drives have power, m."""
        return float(self.tip[: self._powered].max())

    @property
    def holds(self) -> bool:
        """The arm stands after every loss of power that was simulated."""
        return self.losses.holds

    @property
    def travel(self) -> float:
        """Largest way of the tip after a loss of power, m."""
        return float(self.losses.travel.max())

    @property
    def _powered(self) -> int:
        return max(int(np.sum(self.powered)), 1)

    def to_dict(self) -> dict[str, Any]:
        """What `simulate --json` prints; SI."""
        losses, worst = self.losses, self.losses.worst
        return {
            "passed": self.passed,
            "tracking": [vars(each) for each in self.tracking],
            "tip_error": self.tip_error,
            "motors": [vars(each) for each in self.motors],
            "holds": self.holds,
            "travel": self.travel,
            "power_loss": {
                "instants": len(losses.time),
                "worst_time": float(losses.time[worst]),
                "longest": float(losses.standing.max()) if losses.holds else None,
                "not_held": int(np.sum(~np.isfinite(losses.standing))),
            },
            "draws": None if self.draws is None else self.draws.to_dict(),
            "reasons": list(self.reasons),
            "notes": list(self.notes),
        }


def simulate(
    plan: Plan,
    scenario: Scenario | None = None,
    controller: Controller | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> SimulationResult:
    """Play a plan's exported set points on the simulated arm.

    Raises ProblemError, TrajectoryError or ExportError for what cannot be played.
    """
    scenario, controller = scenario or Scenario(), controller or Controller()
    duration = plan.motion.duration / scenario.speed if scenario.speed > 0 else 0.0
    scenario.check(plan.robot, duration)
    if scenario.supply is not None:
        controller = replace(controller, supply=scenario.supply)
    played_plan = (
        plan
        if scenario.speed == 1.0
        else replace(plan, trajectory=plan.motion.slower(scenario.speed))
    )
    stage = _Stage(played_plan, scenario, controller)
    progress("playing the set points")
    played = stage.play()
    progress("losing power")
    losses = stage.lose_power(played, progress)
    return stage.result(played, losses, stage.draws(progress))


class _Stage:
    """A plan, what happens to it, and the arm that plays it."""

    def __init__(self, plan: Plan, scenario: Scenario, controller: Controller) -> None:
        self.plan, self.scenario, self.controller = plan, scenario, controller
        robot = plan.robot
        self.axes = axes_of(robot, _counts(robot, controller))
        self.windows = {name: self._window(axis) for name, axis in self.axes.items()}
        self.arms: dict[float, ControlledArm] = {}
        self.unknown: tuple[str, ...] = ()
        self.period = controller.loop_period
        loss = scenario.power_loss
        end = plan.motion.duration + SETTLE if not isinstance(loss, float) else loss + HORIZON
        self.time: Array = self.period * np.arange(round(end / self.period), dtype=float)
        stretch = setpoint_times(plan, PERIOD)[1]
        samples = at_times(plan, plan.motion.breaks[0] + self.time, stretch)
        self.planned, speed = samples.q, samples.qd
        given = np.diff(speed, axis=0, append=speed[-1:]) / self.period
        self.told = self._commands(given)

    def arm(self, payload: float) -> ControlledArm:
        """The arm with a mass at its tip."""
        if payload not in self.arms:
            springs = compliance_of(self.plan.robot, self.controller, self.scenario.compliance)
            robot = with_payload(self.plan.robot, payload)
            windows = {
                name: 2 * np.pi / self.axes[name].counts_per_turn * self.windows[name]
                for name in self.axes
            }
            self.arms[payload] = ControlledArm(
                robot, self.controller, self.axes, windows, compliance=springs
            )
        return self.arms[payload]

    def play(self) -> Played:
        """The whole motion, the payload taken up where the scenario has it."""
        scenario = self.scenario
        first = self.arm(0.0 if scenario.payload_time > 0 else scenario.payload)
        state = first.start(self.planned[0])
        self.offsets = first.offsets(state, self.planned[0])
        self.friction = first.friction(scenario.friction)
        change = round(scenario.payload_time / self.period) if scenario.payload_time > 0 else 0
        if not change or not scenario.payload:
            return first.play(state, self.told, self.offsets, self.friction)
        before = first.play(
            state, part_of(self.told, slice(0, change)), self.offsets, self.friction
        )
        second = self.arm(scenario.payload)
        after = second.play(
            before.states[-1], part_of(self.told, slice(change, None)), self.offsets, self.friction
        )
        return Played(
            np.vstack([before.states, after.states[1:]]),
            np.vstack([before.error, after.error]),
            np.vstack([before.saturated, after.saturated]),
        )

    def lose_power(self, played: Played, progress: Callable[[str], None]) -> PowerLosses:
        """All drives off at the scenario's instant, at `instants` instants of the motion, or at the end."""
        loss, duration = self.scenario.power_loss, self.plan.motion.duration
        if loss == EVERYWHERE:
            instants = np.linspace(0.0, duration, self.scenario.instants)
        else:
            instants = np.array([loss if isinstance(loss, float) else self.time[-1]])
        off = part_of(self.told, np.zeros(round(HORIZON / self.period), dtype=int))
        off = replace(off, power=np.zeros(len(off.power)))
        travel, standing = np.zeros(len(instants)), np.zeros(len(instants))
        for i, instant in enumerate(instants):
            if len(instants) > 1 and i % 250 == 0:
                progress(f"power lost at {i} of {len(instants)} instants")
            k = min(round(instant / self.period), len(self.time))
            travel[i], standing[i] = self._stop(played.states[k], off, instant)
        return PowerLosses(instants, travel, standing)

    def _stop(self, state: Array, off: Commands, instant: float) -> tuple[float, float]:
        """(way of the tip, time until the arm stands), as long as it takes, at most HORIZON."""
        arm = self.arm(self.scenario.payload if instant >= self.scenario.payload_time else 0.0)
        states, part, still = [state[None, :]], 250, round(STILL / self.period)
        for k in range(0, len(off.power), part):
            found = arm.play(
                states[-1][-1], part_of(off, slice(k, k + part)), self.offsets, self.friction
            )
            states.append(found.states[1:])
            if np.all(self._standing(found.states)[-still:]):
                break
        path = np.vstack(states)
        moving = np.flatnonzero(np.logical_not(self._standing(path)))
        standing = 0.0 if not len(moving) else float(self.period * (moving[-1] + 1))
        tips = tip_position(Mechanism.from_geometry(self.plan.robot.geometry), path[::5, Q])
        stood = len(moving) == 0 or moving[-1] < len(path) - still
        return float(np.linalg.norm(tips - tips[0], axis=1).max()), standing if stood else np.inf

    def _standing(self, states: Array) -> Array:
        """(n,): every motor at rest and every joint still."""
        still = np.array([STANDS * joint.velocity for joint in self.plan.robot.joints])
        return np.all(states[:, W] == 0.0, axis=1) & np.all(np.abs(states[:, QD]) <= still, axis=1)

    def draws(self, progress: Callable[[str], None]) -> Draws | None:
        """The same set points under many frictions."""
        scenario = self.scenario
        if not scenario.draws:
            return None
        frictions, self.unknown = drawn_frictions(self.plan.robot, scenario.draws, scenario.spread)
        arm = self.arm(scenario.payload)
        return play_draws(
            arm,
            arm.start(self.planned[0]),
            self.told,
            offsets=self.offsets,
            friction=scenario.friction * frictions,
            planned=self.planned,
            tip_limit=scenario.tip_error,
            progress=progress,
        )

    def result(
        self, played: Played, losses: PowerLosses, draws: Draws | None = None
    ) -> SimulationResult:
        """Everything found, and the verdict."""
        states, robot = played.states[:-1], self.plan.robot
        mechanism = Mechanism.from_geometry(robot.geometry)
        tip = np.linalg.norm(
            tip_position(mechanism, states[:, Q]) - tip_position(mechanism, self.planned), axis=1
        )
        constants = [
            electrics_of(j, self.controller).torque_constant if j.drive else 0.0
            for j in robot.joints
        ]
        torque = played.states[1:, CURRENT] * np.array(constants)
        on = (self.told.power > 0) & np.all(states[:, TRIP] == 0, axis=1)
        powered = slice(0, max(int(np.sum(on)), 1))
        tripped = played.states[-1, TRIP] > 0
        error = (states[:, Q] - self.planned)[powered]
        tracking = tuple(
            Tracking(
                joint, float(np.abs(error[:, k]).max()), float(np.sqrt(np.mean(error[:, k] ** 2)))
            )
            for k, joint in enumerate(JOINTS)
        )
        motors = tuple(
            self._motor(k, torque[powered, k], played, bool(tripped[k]))
            for k, joint in enumerate(robot.joints)
            if joint.drive is not None
        )
        result = SimulationResult(
            time=self.time,
            planned=self.planned,
            q=states[:, Q],
            qd=states[:, QD],
            motor_angle=states[:, MOTOR] - self.offsets,
            w=states[:, W],
            torque=torque,
            tip=tip,
            following=played.error,
            powered=on,
            tracking=tracking,
            motors=motors,
            losses=losses,
            scenario=self.scenario,
            reasons=(),
            axes=self.axes,
            notes=(*self._notes(), *self.unknown),
            draws=draws,
        )
        return replace(result, reasons=tuple(_reasons(result)))

    def _motor(self, k: int, torque: Array, played: Played, tripped: bool) -> MotorUse:
        joint = self.plan.robot.joints[k]
        counts, motor = self.axes[joint.name].counts_per_turn, joint.motor
        return MotorUse(
            joint.name,
            peak_torque=float(np.abs(torque).max()),
            limit=np.inf if motor is None else motor.max_torque,
            saturated=bool(played.saturated[:, k].any()),
            tripped=tripped,
            following_error=float(np.abs(played.error[: len(torque), k]).max())
            * counts
            / (2 * np.pi),
            window=self.windows[joint.name],
            placeholder=motor is not None and motor.placeholder,
        )

    def _window(self, axis: Axis) -> int:
        given = self.controller.axis(axis.name).following_error
        if given is None:
            return following_error_window(axis, PERIOD)
        return max(round(given * abs(axis.increments_per_unit)), 1)

    def _commands(self, given: Array) -> Commands:
        scenario = self.scenario
        streams = setpoints(self.plan, self.axes, PERIOD)
        if scenario.dropped is not None:
            lost = max(1, round(1000 * scenario.dropped / PERIOD))
            for stream in streams.values():
                for column in stream.values():
                    column[min(lost, len(column) - 1)] = column[min(lost, len(column) - 1) - 1]
        told = commands(streams, self.axes, self.controller, (self.time, given), PERIOD / 1000)
        if scenario.wrong_direction is not None:
            k = JOINTS.index(scenario.wrong_direction)
            for column in (told.speed, told.acceleration, told.torque):
                column[:, k] *= -1
            told.demand[:, k] = 2 * told.demand[0, k] - told.demand[:, k]
        if isinstance(scenario.power_loss, float):
            told.power[self.time >= scenario.power_loss - 1e-9] = 0.0
        if scenario.stall is not None:
            joint, begin = scenario.stall
            told.stalled[self.time >= begin - 1e-9, JOINTS.index(joint)] = 1.0
        return told

    def _notes(self) -> tuple[str, ...]:
        notes = ["spring, damper and backlash between motor and joint are assumed, not measured"]
        for joint in self.plan.robot.joints:
            motor = joint.motor
            if motor is None:
                continue
            if motor.encoder_counts is None and self.controller.counts_per_turn is None:
                notes.append(
                    f"joint {joint.name}: its motor file gives no encoder; {COUNTS} increments per turn assumed"
                )
            elif motor.encoder_counts is not None and not motor.encoder_known:
                notes.append(
                    f"joint {joint.name}: its encoder, {motor.encoder_counts} counts, is a placeholder figure"
                )
            if motor.terminal_resistance is None:
                notes.append(
                    f"joint {joint.name}: terminal_resistance unknown; the winding's voltage drop is left out"
                )
            if motor.placeholder:
                notes.append(f"joint {joint.name}: figures of motor {motor.name} are placeholders")
        return tuple(notes)


def part_of(told: Commands, rows: slice | Array) -> Commands:
    """Some rows (m,) of the commands."""
    return Commands(**{name: column[rows] for name, column in vars(told).items()})


def _counts(robot: Robot, controller: Controller) -> dict[str, int]:
    """Increments per motor turn: the motor file's, else the controller's, else those of the authors' rigs."""
    counts = {}
    for joint in robot.joints:
        encoder = None if joint.motor is None else joint.motor.encoder_counts
        counts[joint.name] = (
            QUADRATURE * encoder if encoder else controller.counts_per_turn or COUNTS
        )
    return counts


def _reasons(result: SimulationResult) -> list[str]:
    scenario, reasons = result.scenario, []
    if not np.all(np.isfinite(result.q)):
        return ["the simulated motion diverged: gains that the plant does not bear"]
    for motor in result.motors:
        if motor.tripped:
            k = JOINTS.index(motor.joint)
            counts = result.axes[motor.joint].counts_per_turn
            late = np.abs(result.following[:, k]) * counts / (2 * np.pi) > motor.window
            when = float(result.time[int(np.argmax(late))])
            reasons.append(
                f"joint {motor.joint}: the following error left its window of {motor.window} increments at {when:.4f} s; "
                "the drives lost their power"
            )
        if motor.saturated:
            reasons.append(
                f"joint {motor.joint}: the motor saturated (peak torque {1e3 * motor.peak_torque:.3g} mN·m, largest "
                f"{1e3 * motor.limit:.3g} mN·m)"
            )
    if result.tip_error > scenario.tip_error:
        when = float(result.time[int(np.argmax(result.tip * result.powered))])
        reasons.append(
            f"the tip was {1e3 * result.tip_error:.3g} mm away from the plan at {when:.4f} s (allowed: "
            f"{1e3 * scenario.tip_error:.3g} mm)"
        )
    if result.draws is not None and not result.draws.passed.all():
        failed = int(np.sum(~result.draws.passed))
        reasons.append(
            f"with {failed} of {len(result.draws.passed)} drawn frictions a motor saturates, a drive trips or the tip strays"
        )
    losses = result.losses
    if not losses.holds:
        first = float(losses.time[np.argmax(~np.isfinite(losses.standing))])
        reasons.append(
            f"without power at {first:.4f} s the arm does not stand within {HORIZON:g} s"
        )
    if scenario.travel is not None and result.travel > scenario.travel:
        reasons.append(
            f"without power at {float(losses.time[losses.worst]):.4f} s the tip travels {1e3 * result.travel:.3g} mm "
            f"(allowed: {1e3 * scenario.travel:.3g} mm)"
        )
    return reasons

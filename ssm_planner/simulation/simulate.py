"""Simulate how the arm executes a plan, with the controllers of its drives and disturbances.

`simulate` is the main entry. It sends the set points that an export contains to simulated motor
controllers, which move a model of the arm (`playback`). This simulation is called a playback. It
then simulates losses of power, and judges the result. A `Scenario` describes the disturbances.
"""

from __future__ import annotations

from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from ssm_planner.arguments import checked
from ssm_planner.dynamics import with_payload
from ssm_planner.errors import ProblemError
from ssm_planner.formats import (
    Axis,
    drive_axes,
    following_error_window,
    sample_setpoints,
    sample_slowed_plan,
    setpoint_times,
)
from ssm_planner.kinematics import Mechanism, tip_position
from ssm_planner.plans import Plan, as_plan
from ssm_planner.problem import JOINTS, Bound, Controller, Robot, Value
from ssm_planner.problem.value import NotNegative, Positive, Share
from ssm_planner.progress import Progress, Step, silent
from ssm_planner.simulation.draws import Draws, draw_frictions, play_draws
from ssm_planner.simulation.plant import MOTOR, QD, Q, W
from ssm_planner.simulation.playback import (
    CURRENT,
    TRIP,
    Commands,
    ControlledArm,
    Playback,
    commands_from_setpoints,
    robot_compliance,
)
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, JsonObject, frozen, record

SETPOINT_INTERVAL = 1
"""Interval between the exported set points, ms."""
ASSUMED_ENCODER_COUNTS = 4096
"""Assumed encoder increments per motor turn, if the files of motor and controller omit them.

The test rigs of the paper have this value.
"""
DEFAULT_TIP_ERROR = 1e-4
"""Default of the largest permitted tip error, m.

The tremor of an unaided hand has about this size (0.05 to 0.18 mm RMS).
"""
HOLDING_TIME = 0.2
"""Time for which the drives hold the target before they lose power, s."""
MAX_STOPPING_TIME = 1.0
"""Time after a loss of power within which the arm must come to rest, s."""
STANDSTILL_TIME = 0.05
"""Time without motion after which the arm counts as standing still, s.

A joint that swings on its spring turns back within this time.
"""
REST_SPEED_RATIO = 1e-3
"""Joint speed below which a joint counts as at rest, as a share of its velocity limit."""
EVERYWHERE: Literal["everywhere"] = "everywhere"
"""Value of `Scenario.power_loss` that simulates a loss of power at many instants."""


@record
class Scenario(Value):
    """Conditions and disturbances of the simulated execution of a plan (playback).

    All of them can be combined, except random friction (`draws`) with a payload that the arm picks
    up during the motion.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> scenario = ssm.Scenario(power_loss=0.5, payload=1e-3)
    >>> ssm.simulate("results/tilt_insert", scenario).holds
    True
    """

    speed: Share = 1.0
    """Speed of the simulated motion, as a fraction of the planned speed."""
    payload: NotNegative = 0.0
    """Point mass at the tip, kg."""
    payload_time: NotNegative = 0.0
    """Time at which the payload is picked up, s."""
    power_loss: NotNegative | Literal["everywhere"] | None = None
    """Time at which all drives lose their power, s.

    "everywhere" simulates a loss at many instants. With None, the drives lose their power after
    they have held the target for `HOLDING_TIME`.
    """
    instants: Annotated[int, Bound(at_least=1)] = 1000
    """Number of instants for `power_loss="everywhere"`."""
    stall: tuple[str, NotNegative] | None = None
    """Joint whose motor is blocked, and the time at which it is blocked, s."""
    supply: Positive | None = None
    """Supply voltage, V. None means the voltage of the controller."""
    friction: Annotated[float, Bound(above=0.0, at_most=10.0)] = 1.0
    """Factor on the friction of every drive."""
    dropped: NotNegative | None = None
    """Time at which every drive misses one set point and repeats the last one, s."""
    wrong_direction: str | None = None
    """Joint whose controller has the opposite direction of rotation to that of the robot file."""
    compliance: Positive = 1.0
    """Factor on the stiffness and the damping between motor and joint."""
    draws: Annotated[int, Bound(at_least=0, at_most=100_000)] = 0
    """Number of additional playbacks, each with friction that is drawn at random.

    The distribution of the friction parameters comes from the drive files.
    """
    spread: float | None = None
    """Relative range of friction parameters whose uncertainty the drive file omits.

    None keeps these parameters at the values of the drive file.
    """
    tip_error: NotNegative = DEFAULT_TIP_ERROR
    """Largest permitted tip error, m."""
    travel: NotNegative | None = None
    """Largest permitted travel of the tip after a loss of power, m. None permits any travel."""

    def check(self, robot: Robot, duration: float) -> None:
        """Check the values of the scenario, and that they fit the robot and the motion.

        Parameters
        ----------
        robot : Robot
            Robot that executes the motion.
        duration : float
            Duration of the motion at the speed of the scenario, s.

        Raises
        ------
        ProblemError
            If a value is out of range, a joint has no drive, or an instant is outside the motion.
        """
        driven = [joint.name for joint in robot.joints if joint.drive is not None]
        stalled_joint, stall_time = self.stall or (None, None)
        joints = {"stall": stalled_joint, "wrong_direction": self.wrong_direction}
        for key, joint in joints.items():
            if joint is not None and joint not in driven:
                raise ProblemError(
                    "no joint of this name has a drive",
                    key=key,
                    value=joint,
                    allowed=", ".join(driven) or "none: no joint has a drive",
                )
        times = {
            "power_loss": None if self.power_loss == EVERYWHERE else self.power_loss,
            "stall": stall_time,
            "dropped": self.dropped,
            "payload_time": self.payload_time,
        }
        for key, time in times.items():
            if time is not None and not 0 <= time <= duration:
                raise ProblemError(
                    "outside the motion", key=key, value=time, allowed=f"0 s to {duration:.4g} s"
                )

    def _check(self) -> None:
        if self.spread is not None and not 0 <= self.spread < 1:
            raise self._field_error("spread", "out of range", "at least 0 and below 1")
        if self.draws and self.payload and self.payload_time > 0:
            raise self._field_error("payload_time", "not possible with draws", "0")


@frozen
class Tracking:
    """Tracking error of one joint while the drives have power, rad or m.

    The error is the simulated position minus the planned position.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Tracking("roll", worst=1.2e-3, rms=4e-4).worst
    0.0012
    """

    joint: str
    worst: float
    """Largest magnitude of the error."""
    rms: float
    """Root mean square of the error."""


@frozen
class MotorUse:
    """Load of one motor and its drive in the simulation.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> use = ssm.MotorUse(
    ...     "roll",
    ...     peak_torque=0.04,
    ...     limit=0.05,
    ...     saturated=False,
    ...     tripped=False,
    ...     following_error=12.0,
    ...     window=800,
    ...     placeholder=False,
    ... )
    >>> use.peak_torque < use.limit
    True
    """

    joint: str
    peak_torque: float
    """Largest motor torque, N·m."""
    limit: float
    """Largest permitted torque of the motor, N·m."""
    saturated: bool
    """True if the controller demanded more current than the drive or its supply can provide."""
    tripped: bool
    """True if the following error exceeded `window`, so that the drives switched off."""
    following_error: float
    """Largest following error (demanded minus measured motor angle), increments of the encoder."""
    window: int
    """Largest permitted following error, increments."""
    placeholder: bool
    """True if the motor file contains assumed values, which it marks as placeholders."""


@record
class PowerLosses:
    """Motion of the arm after all drives have lost their power, for n instants of the loss.

    Each instant is an independent simulation.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> losses = ssm.PowerLosses(np.array([0.1, 0.2]), np.array([0.0, 1e-6]), np.zeros(2))
    >>> losses.holds, losses.worst
    (True, 1)
    """

    time: Array
    """Instants of the loss, measured from the start of the motion, (n,), s."""
    travel: Array
    """Largest distance of the tip from its position at the loss, (n,), m."""
    standing: Array
    """Time until the arm rests, (n,), s.

    It is infinite if the arm still moves after `MAX_STOPPING_TIME`.
    """

    @property
    def holds(self) -> bool:
        """True if the arm comes to rest after every loss of power."""
        return bool(np.all(np.isfinite(self.standing)))

    @property
    def worst(self) -> int:
        """Index of the loss with the largest travel."""
        return int(np.argmax(self.travel))


@record
class SimulationResult:
    """Simulated execution of a plan (playback) at n instants, with the planned motion.

    Arrays are (n, 4) with one column for each joint, unless stated otherwise, and in SI units. The
    property `passed` states the verdict, and `reasons` explains a failure.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> result = ssm.simulate("results/tilt_insert")
    >>> result.q.shape == result.planned.shape, result.tip_error < 1e-4
    (True, True)
    """

    time: Array
    """Instants since the start, (n,), s."""
    planned: Array
    """Planned joint positions."""
    q: Array
    """Simulated joint positions."""
    qd: Array
    """Simulated joint velocities."""
    motor_angle: Array
    """Motor angle that the encoder measures, rad. It is ratio · q at the start."""
    w: Array
    """Motor speed, rad/s."""
    torque: Array
    """Motor torque, N·m."""
    tip: Array
    """Distance of the tip from its planned position, (n,), m."""
    following: Array
    """Following errors (demanded minus measured motor angle), rad."""
    powered: Array
    """True while the drives have power, (n,). Lost power does not return."""
    tracking: tuple[Tracking, ...]
    """Tracking error of each joint."""
    motors: tuple[MotorUse, ...]
    """Load of the motor of each driven joint."""
    losses: PowerLosses
    """Motion after each simulated loss of power."""
    scenario: Scenario
    """Conditions and disturbances of the playback."""
    reasons: tuple[str, ...]
    """Reasons why the simulation failed. Empty if it passed."""
    axes: dict[str, Axis] = field(default_factory=dict)
    """Axis settings of the controller by joint."""
    notes: tuple[str, ...] = ()
    """Assumptions of the simulation."""
    draws: Draws | None = None
    """Results of the same motion with random friction. None if the scenario requests none."""

    @property
    def passed(self) -> bool:
        """True if no part of the simulation failed.

        It fails if a drive trips, a motor saturates, the tip error is too large, or the arm does
        not come to rest without power.
        """
        return not self.reasons

    @property
    def tip_error(self) -> float:
        """Largest tip error while the drives have power, m."""
        return float(self.tip[: max(int(np.sum(self.powered)), 1)].max())

    @property
    def holds(self) -> bool:
        """True if the arm comes to rest after every simulated loss of power."""
        return self.losses.holds

    @property
    def travel(self) -> float:
        """Largest travel of the tip after a loss of power, m."""
        return float(self.losses.travel.max())

    def to_dict(self) -> JsonObject:
        """Return the result as a dict, in SI units.

        The command `simulate --json` prints this dict.
        """
        losses = self.losses
        longest_stop = float(losses.standing.max()) if losses.holds else None
        return {
            "passed": self.passed,
            "tracking": [vars(joint) for joint in self.tracking],
            "tip_error": self.tip_error,
            "motors": [vars(motor) for motor in self.motors],
            "holds": self.holds,
            "travel": self.travel,
            "power_loss": {
                "instants": len(losses.time),
                "worst_time": float(losses.time[losses.worst]),
                "longest": longest_stop,
                "not_held": int(np.sum(~np.isfinite(losses.standing))),
            },
            "draws": self.draws and self.draws.to_dict(),
            "reasons": list(self.reasons),
            "notes": list(self.notes),
        }


@checked
def simulate(
    plan: Plan | Trajectory | str | Path,
    scenario: Scenario | None = None,
    controller: Controller | None = None,
    progress: Progress = silent,
    robot: Robot | None = None,
) -> SimulationResult:
    """Simulate how the arm executes a plan with its motor controllers, and judge the result.

    The set points are those of the export for the controllers. The controllers track them on a
    model of the arm with friction, backlash and compliance. After the motion, or at the instants of
    the scenario, all drives lose their power.

    Parameters
    ----------
    plan : Plan, Trajectory, str or Path
        Plan, trajectory, or the path of a plan.json.
    scenario : Scenario, optional
        Conditions and disturbances. The default is `Scenario()`.
    controller : Controller, optional
        The motor controller. The default is `Controller()`.
    progress : callable
        Function that is called with a `Step` before each part of the simulation.
    robot : Robot, optional
        Robot that executes a trajectory. It is needed only if `plan` is a trajectory, because a
        plan contains its robot.

    Returns
    -------
    SimulationResult
        The simulated motion and the verdict.

    Raises
    ------
    ProblemError, TrajectoryError, ExportError
        If the plan cannot be simulated in this scenario.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> result = ssm.simulate("results/tilt_insert")
    >>> result.passed, [use.saturated for use in result.motors]
    (True, [False, False, False])
    """
    plan = as_plan(plan, robot)
    scenario = scenario or Scenario()
    controller = controller or Controller()
    scenario.check(plan.robot, plan.motion.duration / scenario.speed)
    if scenario.supply is not None:
        controller = replace(controller, supply=scenario.supply)
    if scenario.speed != 1.0:
        plan = replace(plan, trajectory=plan.motion.slower(scenario.speed))
    simulation = _Simulation(plan, scenario, controller)
    progress(Step("playing the set points"))
    played = simulation.play()
    progress(Step("losing power"))
    losses = simulation.simulate_power_losses(played, progress)
    return simulation.result(played, losses, simulation.draws(progress))


class _Simulation:
    """Simulation of one plan in one scenario.

    It prepares the commands once, and builds one simulated arm for each payload.
    """

    def __init__(self, plan: Plan, scenario: Scenario, controller: Controller) -> None:
        """Compute the set points of the plan and the commands of the scenario.

        Parameters
        ----------
        plan : Plan
            Plan that the arm executes, already slowed to the speed of the scenario.
        scenario : Scenario
            Conditions and disturbances.
        controller : Controller
            The motor controller, already with the supply voltage of the scenario.
        """
        self.plan = plan
        self.scenario = scenario
        self.controller = controller
        robot = plan.robot
        self.axes = drive_axes(robot, _encoder_counts(robot, controller))
        self.windows = {name: self._error_window(axis) for name, axis in self.axes.items()}
        self.arms: dict[float, ControlledArm] = {}
        self.unknown: tuple[str, ...] = ()
        self.period = controller.loop_period
        end = plan.motion.duration + HOLDING_TIME
        if isinstance(scenario.power_loss, float):
            end = scenario.power_loss + MAX_STOPPING_TIME
        self.time: Array = self.period * np.arange(round(end / self.period), dtype=float)
        _, time_scale = setpoint_times(plan, SETPOINT_INTERVAL)
        samples = sample_slowed_plan(plan, plan.motion.breaks[0] + self.time, time_scale)
        self.planned = samples.q
        speed = samples.qd
        is_standing = np.abs(speed[0]) <= REST_SPEED_RATIO * robot.velocities
        velocity = np.where(is_standing, 0.0, speed[0])
        self.initial_motion = samples.q[0], velocity, samples.qdd[0] * np.any(velocity)
        prescribed = np.diff(speed, axis=0, append=speed[-1:]) / self.period
        self.commands = self._commands(prescribed)

    def arm(self, payload: float) -> ControlledArm:
        """Return the simulated arm with a payload, which is built on first use.

        Parameters
        ----------
        payload : float
            Point mass at the tip, kg.

        Returns
        -------
        ControlledArm
            Arm with the compliance of the scenario. Its springs do not depend on the payload.
        """
        if payload not in self.arms:
            springs = robot_compliance(self.plan.robot, self.controller, self.scenario.compliance)
            robot = with_payload(self.plan.robot, payload)
            windows = {
                name: 2 * np.pi / axis.counts_per_turn * self.windows[name]
                for name, axis in self.axes.items()
            }
            self.arms[payload] = ControlledArm(
                robot, self.controller, self.axes, windows, compliance=springs
            )
        return self.arms[payload]

    def play(self) -> Playback:
        """Simulate the complete motion of the plan.

        If the arm picks up the payload during the motion (`Scenario.payload_time`), an arm without
        a payload moves until then. An arm with the payload continues from the state that the first
        arm has reached.

        Returns
        -------
        Playback
            States, following errors and saturation in all periods of the position loop.
        """
        scenario = self.scenario
        arm = self.arm(0.0 if scenario.payload_time > 0 else scenario.payload)
        state = arm.initial_state(*self.initial_motion, self.commands)
        self.offsets = arm.encoder_offsets(self.planned[0])
        self.friction = arm.friction_parameters(scenario.friction)
        change = round(scenario.payload_time / self.period) if scenario.payload_time > 0 else 0
        if not change or not scenario.payload:
            return arm.play(state, self.commands, self.offsets, self.friction)
        commands_before = select_periods(self.commands, slice(0, change))
        commands_after = select_periods(self.commands, slice(change, None))
        empty = arm.play(state, commands_before, self.offsets, self.friction)
        arm = self.arm(scenario.payload)
        loaded = arm.play(empty.states[-1], commands_after, self.offsets, self.friction)
        return Playback(
            np.vstack([empty.states, loaded.states[1:]]),
            np.vstack([empty.error, loaded.error]),
            np.vstack([empty.saturated, loaded.saturated]),
        )

    def simulate_power_losses(self, played: Playback, progress: Progress) -> PowerLosses:
        """Simulate losses of power, each beginning with the state of the playback at its instant.

        Parameters
        ----------
        played : Playback
            Playback with power.
        progress : callable
            Called with each step.

        Returns
        -------
        PowerLosses
            One entry for each instant of the scenario. If the scenario states no instant, power is
            lost at the end of the playback.
        """
        loss = self.scenario.power_loss
        if loss == EVERYWHERE:
            instants = np.linspace(0.0, self.plan.motion.duration, self.scenario.instants)
        else:
            instants = np.array([loss if isinstance(loss, float) else self.time[-1]])
        # Without power, the demanded positions have no effect, so the first row is repeated.
        first_row = np.zeros(round(MAX_STOPPING_TIME / self.period), dtype=int)
        unpowered = replace(
            select_periods(self.commands, first_row), power=np.zeros(len(first_row))
        )
        travel = np.zeros(len(instants))
        rest_time = np.zeros(len(instants))
        for i, instant in enumerate(instants):
            if len(instants) > 1 and i % 250 == 0:
                progress(Step("losing power at all instants", i, len(instants)))
            k = min(round(instant / self.period), len(self.time))
            travel[i], rest_time[i] = self._stop_without_power(played.states[k], unpowered, instant)
        return PowerLosses(instants, travel, rest_time)

    def _stop_without_power(
        self, state: Array, unpowered: Commands, instant: float
    ) -> tuple[float, float]:
        """Simulate the arm after a loss of power until it rests.

        Parameters
        ----------
        state : (44,) array
            State of the arm and its controllers at the loss of power, see `playback.CURRENT`.
        unpowered : Commands
            Commands without power in the periods of the position loop after the loss.
        instant : float
            Instant of the loss in the motion, s. It determines whether the arm carries the payload.

        Returns
        -------
        travel : float
            Largest distance of the tip from its initial position, m.
        time : float
            Time until the arm rests, s. Infinite if it still moves at the end of `unpowered`.
        """
        arm = self.arm(self.scenario.payload if instant >= self.scenario.payload_time else 0.0)
        states = [state[None, :]]
        chunk = 250
        standstill_periods = round(STANDSTILL_TIME / self.period)
        for k in range(0, len(unpowered.power), chunk):
            commands = select_periods(unpowered, slice(k, k + chunk))
            continuation = arm.play(states[-1][-1], commands, self.offsets, self.friction)
            states.append(continuation.states[1:])
            if np.all(self._is_at_rest(continuation.states)[-standstill_periods:]):
                break
        path = np.vstack(states)
        # Every fifth state suffices, because the tip moves little within a few periods.
        tips = tip_position(Mechanism.from_robot(self.plan.robot), path[::5, Q])
        travel = float(np.linalg.norm(tips - tips[0], axis=1).max())
        moving = np.flatnonzero(np.logical_not(self._is_at_rest(path)))
        if not len(moving):
            return travel, 0.0
        periods = moving[-1] + 1
        if periods > len(path) - standstill_periods:
            return travel, np.inf
        return travel, float(self.period * periods)

    def _is_at_rest(self, states: Array) -> Array:
        """Determine for each state whether all motors and joints are at rest.

        A motor is at rest if its speed is exactly 0. A joint is at rest if its speed is at most
        `REST_SPEED_RATIO` times its velocity limit.

        Parameters
        ----------
        states : (n, 44) array
            States of the arm and its controllers, see `playback.CURRENT`.

        Returns
        -------
        (n,) array of bool
            True for a state at rest.
        """
        rest_speeds = REST_SPEED_RATIO * self.plan.robot.velocities
        joints_rest = np.all(np.abs(states[:, QD]) <= rest_speeds, axis=1)
        return np.all(states[:, W] == 0.0, axis=1) & joints_rest

    def draws(self, progress: Progress) -> Draws | None:
        """Play the same set points again with many frictions that are drawn at random.

        Parameters
        ----------
        progress : callable
            Function that is called with a `Step` now and then.

        Returns
        -------
        Draws or None
            Results of these playbacks. None if the scenario requests none (`Scenario.draws` is 0).
        """
        scenario = self.scenario
        if not scenario.draws:
            return None
        frictions, self.unknown = draw_frictions(self.plan.robot, scenario.draws, scenario.spread)
        arm = self.arm(scenario.payload)
        return play_draws(
            arm,
            arm.initial_state(*self.initial_motion, self.commands),
            self.commands,
            offsets=self.offsets,
            friction=scenario.friction * frictions,
            planned=self.planned,
            tip_limit=scenario.tip_error,
            progress=progress,
        )

    def result(
        self, played: Playback, losses: PowerLosses, draws: Draws | None = None
    ) -> SimulationResult:
        """Combine all simulations to a result that states whether the arm passed.

        Parameters
        ----------
        played : Playback
            Playback of the set points.
        losses : PowerLosses
            Motion after the losses of power.
        draws : Draws or None
            Playbacks with random friction. None if the scenario requests none.

        Returns
        -------
        SimulationResult
            Simulated motion, load of the motors, and the reasons of a failure.
        """
        states = played.states[:-1]
        robot = self.plan.robot
        mechanism = Mechanism.from_robot(robot)
        planned_tip = tip_position(mechanism, self.planned)
        tip = np.linalg.norm(tip_position(mechanism, states[:, Q]) - planned_tip, axis=1)
        torque = played.states[1:, CURRENT] * self.arm(self.scenario.payload).torque_constants
        powered = (self.commands.power > 0) & np.all(states[:, TRIP] == 0, axis=1)
        count = max(int(np.sum(powered)), 1)
        tripped = played.states[-1, TRIP] > 0
        errors = (states[:, Q] - self.planned)[:count]
        tracking = tuple(
            Tracking(name, float(np.abs(error).max()), float(np.sqrt(np.mean(error**2))))
            for name, error in zip(JOINTS, errors.T, strict=True)
        )
        motors = tuple(
            self._motor_use(k, torque[:count, k], played, bool(tripped[k]))
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
            powered=powered,
            tracking=tracking,
            motors=motors,
            losses=losses,
            scenario=self.scenario,
            reasons=(),
            axes=self.axes,
            notes=self._assumptions() + self.unknown,
            draws=draws,
        )
        return replace(result, reasons=tuple(_failure_reasons(result)))

    def _motor_use(self, k: int, torque: Array, played: Playback, tripped: bool) -> MotorUse:
        """Summarise the load of one motor during the playback.

        The following error is the demanded minus the measured motor angle.

        Parameters
        ----------
        k : int
            Index of the joint.
        torque : (m,)
            Motor torques in the periods with power, N·m.
        played : Playback
            Playback of all joints.
        tripped : bool
            True if the drive of the joint tripped, that is, if its following error became so large
            that all drives switched off.

        Returns
        -------
        MotorUse
            Largest torque and following error, and whether the motor saturated or tripped.
        """
        joint = self.plan.robot.joints[k]
        motor = joint.motor
        max_error = float(np.abs(played.error[: len(torque), k]).max())
        increments_per_rad = self.axes[joint.name].counts_per_turn / (2 * np.pi)
        return MotorUse(
            joint.name,
            peak_torque=float(np.abs(torque).max()),
            limit=np.inf if motor is None else motor.max_torque,
            saturated=bool(played.saturated[:, k].any()),
            tripped=tripped,
            following_error=max_error * increments_per_rad,
            window=self.windows[joint.name],
            placeholder=motor is not None and motor.placeholder,
        )

    def _error_window(self, axis: Axis) -> int:
        """Return the largest following error that a drive permits.

        The following error is the demanded minus the measured motor angle. If it exceeds this
        window, the drive trips, which means that all drives switch off. The controller file has
        priority. If it states no window, the result is the value that the export writes.

        Parameters
        ----------
        axis : Axis
            Settings of the drive.

        Returns
        -------
        int
            Window in increments of the encoder.
        """
        window = self.controller.axis(axis.name).following_error
        if window is None:
            return following_error_window(axis, SETPOINT_INTERVAL)
        return max(round(window * abs(axis.increments_per_unit)), 1)

    def _commands(self, prescribed: Array) -> Commands:
        """Return the commands of the plan with the disturbances of the scenario.

        The commands follow from the set points that an export contains. A missed set point, a wrong
        direction of rotation, a loss of power and a blocked motor change them.

        Parameters
        ----------
        prescribed : (n, 4) array
            Accelerations of joints without a drive, rad/s² or m/s². The other columns are not used.

        Returns
        -------
        Commands
            Commands in each of the n periods of the position loop.
        """
        scenario = self.scenario
        streams = sample_setpoints(self.plan, self.axes, "csp", SETPOINT_INTERVAL)[0].streams
        if scenario.dropped is not None:
            row = max(1, round(1000 * scenario.dropped / SETPOINT_INTERVAL))
            for stream in streams.values():
                for column in stream.values():
                    lost_row = min(row, len(column) - 1)
                    column[lost_row] = column[lost_row - 1]
        result = commands_from_setpoints(
            streams, self.axes, self.controller, (self.time, prescribed), SETPOINT_INTERVAL / 1000
        )
        if scenario.wrong_direction is not None:
            k = JOINTS.index(scenario.wrong_direction)
            for column in (result.speed, result.acceleration, result.torque):
                column[:, k] *= -1
            result.demand[:, k] = 2 * result.demand[0, k] - result.demand[:, k]
        if isinstance(scenario.power_loss, float):
            result.power[self.time >= scenario.power_loss - 1e-9] = 0.0
        if scenario.stall is not None:
            joint, stall_time = scenario.stall
            result.stalled[self.time >= stall_time - 1e-9, JOINTS.index(joint)] = 1.0
        return result

    def _assumptions(self) -> tuple[str, ...]:
        """Return the assumptions of the simulation, as sentences for the result."""
        notes = ["spring, damper and backlash between motor and joint are assumed, not measured"]
        for joint in self.plan.robot.joints:
            motor = joint.motor
            if motor is None:
                continue
            if motor.encoder_counts is None and self.controller.counts_per_turn is None:
                notes.append(
                    f"joint {joint.name}: its motor file gives no encoder; "
                    f"{ASSUMED_ENCODER_COUNTS} increments per turn are assumed"
                )
            elif motor.encoder_counts is not None and not motor.encoder_known:
                notes.append(
                    f"joint {joint.name}: its encoder with {motor.encoder_counts} counts is a "
                    "placeholder"
                )
            if motor.terminal_resistance is None:
                notes.append(
                    f"joint {joint.name}: terminal_resistance is not known; the voltage drop of "
                    "the winding is ignored"
                )
            if motor.placeholder:
                notes.append(f"joint {joint.name}: figures of motor {motor.name} are placeholders")
        return tuple(notes)


def select_periods(commands: Commands, rows: slice | Array) -> Commands:
    """Return the commands in the selected periods of the position loop.

    Parameters
    ----------
    commands : Commands
        Commands in n periods.
    rows : slice or (m,) array of int
        Indices of the periods. An index may occur several times.

    Returns
    -------
    Commands
        Commands in the m selected periods.
    """
    return Commands(**{name: column[rows] for name, column in vars(commands).items()})


def _encoder_counts(robot: Robot, controller: Controller) -> dict[str, int]:
    """Return the encoder increments per motor turn of each joint.

    The motor file has priority over the controller file. If neither file states the increments of a
    joint, they are `ASSUMED_ENCODER_COUNTS`.

    Parameters
    ----------
    robot : Robot
        Robot with its motors.
    controller : Controller
        The motor controller.

    Returns
    -------
    dict of int
        Increments by name of the joint.
    """
    counts = {}
    for joint in robot.joints:
        counts[joint.name] = controller.counts_per_turn or ASSUMED_ENCODER_COUNTS
        if joint.motor is not None and joint.motor.increments is not None:
            counts[joint.name] = joint.motor.increments
    return counts


def _failure_reasons(result: SimulationResult) -> list[str]:
    """Return the reasons why a simulation failed, as sentences.

    Parameters
    ----------
    result : SimulationResult
        Simulated motion without reasons.

    Returns
    -------
    list of str
        Reasons, in the order of motors, tip error, random frictions and losses of power. Empty if
        the simulation passed. A simulation that diverged has only this reason.
    """
    scenario = result.scenario
    reasons = []
    if not np.all(np.isfinite(result.q)):
        return ["the simulated motion diverged: the controller gains make the plant unstable"]
    for motor in result.motors:
        if motor.tripped:
            k = JOINTS.index(motor.joint)
            counts = result.axes[motor.joint].counts_per_turn
            is_outside = np.abs(result.following[:, k]) * counts / (2 * np.pi) > motor.window
            time = float(result.time[int(np.argmax(is_outside))])
            reasons.append(
                f"joint {motor.joint}: the following error left its window of {motor.window} "
                f"increments at {time:.4f} s; the drives lost their power"
            )
        if motor.saturated:
            reasons.append(
                f"joint {motor.joint}: the motor saturated (peak torque "
                f"{1e3 * motor.peak_torque:.3g} mN·m, largest {1e3 * motor.limit:.3g} mN·m)"
            )
    if result.tip_error > scenario.tip_error:
        time = float(result.time[int(np.argmax(result.tip * result.powered))])
        reasons.append(
            f"the tip was {1e3 * result.tip_error:.3g} mm away from the plan at {time:.4f} s "
            f"(allowed: {1e3 * scenario.tip_error:.3g} mm)"
        )
    if result.draws is not None and not result.draws.passed.all():
        failed = int(np.sum(~result.draws.passed))
        reasons.append(
            f"with {failed} of {len(result.draws.passed)} drawn frictions a motor saturates, a "
            "drive trips or the tip error is too large"
        )
    losses = result.losses
    if not losses.holds:
        time = float(losses.time[np.argmax(~np.isfinite(losses.standing))])
        reasons.append(
            f"without power at {time:.4f} s the arm does not stand within {MAX_STOPPING_TIME:g} s"
        )
    if scenario.travel is not None and result.travel > scenario.travel:
        reasons.append(
            f"without power at {float(losses.time[losses.worst]):.4f} s the tip travels "
            f"{1e3 * result.travel:.3g} mm (allowed: {1e3 * scenario.travel:.3g} mm)"
        )
    return reasons

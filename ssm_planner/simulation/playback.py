"""Simulate how the arm and its motor controllers follow set points.

`ControlledArm` adds the controllers (`cascade`) to the model of the arm (`plant`). Time is divided
into periods of the position loop, and each period into a few steps of the arm's model.
"""

from functools import cached_property

import casadi as ca
import numpy as np

from ssm_planner.codegen import dense_function
from ssm_planner.dynamics import RigidBody
from ssm_planner.dynamics.robot_dynamics import motor_torque
from ssm_planner.formats import Axis, Stream
from ssm_planner.problem import JOINTS, Controller, Robot
from ssm_planner.simulation.cascade import (
    MotorElectrics,
    advance_loops,
    loop_gains,
    motor_electrics,
    round_to_increments,
)
from ssm_planner.simulation.plant import (
    DAMPING_RATIO,
    FRICTION_PARAMETERS,
    INTEGRAL,
    JOINT_FREQUENCIES,
    MOTOR,
    QD,
    STATE_SIZE,
    ArmPlant,
    Compliance,
    Q,
    W,
)
from ssm_planner.typing import Array, Mask, record
from ssm_planner.units import rpm

STEPS_PER_PERIOD = 2
"""Number of steps of the plant in one period of the position loop."""
ASSUMED_BACKLASH = (np.radians(0.1), np.radians(0.1), np.radians(0.1), 2e-5)
"""Assumed free play between drive and joint, rad, and m for joint 4."""

CURRENT, DERIVATIVE, ERROR, TRIP = (
    slice(STATE_SIZE + 4 * k, STATE_SIZE + 4 * k + 4) for k in range(4)
)
"""Slices of the state of an arm with its controllers, an array of 44 numbers.

The first 28 numbers are the state of the arm (`plant.Q` to `plant.ENERGY`). The last 16 numbers
belong to the controllers. These slices of four numbers contain, for each joint, the motor current
in A, the derivative term of the position loop in A, the following error in rad, and 1 for a drive
that has switched off because its following error was too large (otherwise 0). The following error
is the demanded minus the measured motor angle.
"""
CONTROLLED_STATE_SIZE = STATE_SIZE + 16
"""Length of a state of the arm with its controllers, 44."""
_PERIODS_PER_CHUNK = 250
"""Number of periods in a chunk, which one call of a CasADi function simulates."""
_MAX_BREAKAWAY_PERIODS = 100
"""Largest number of periods from the first command to move until static friction is overcome."""


@record
class Commands:
    """Commands to the drives in each of n periods of the position loop, and the disturbances.

    Arrays are (n, 4) with one column for each joint, unless stated otherwise. Values are in SI
    units and have the signs of the joints. A velocity or torque offset is a value that the
    controller receives with each set point. It determines the feed-forward current.
    """

    demand: Array
    """Demanded motor angle, rad."""
    speed: Array
    """Velocity offset of the motor, rad/s."""
    acceleration: Array
    """Difference quotient of the velocity offsets, rad/s²."""
    torque: Array
    """Torque offset of the motor, N·m."""
    prescribed: Array
    """Prescribed accelerations of joints without a drive, rad/s² or m/s²."""
    stalled: Array
    """1 while the motor is blocked, otherwise 0."""
    power: Array
    """1 while the drives have power, otherwise 0, (n,)."""

    def table(self) -> Array:
        """Combine all commands in one table with one row for each period.

        The table is an (n, 25) array.

        A row consists of the fields of this class in their order: four numbers for each of the six
        fields from `demand` to `stalled`, and one number for `power`.
        """
        return np.column_stack(list(vars(self).values()))


@record
class Playback:
    """Simulated states and following errors in n periods of the position loop."""

    states: Array
    """States of the arm and its controllers before the first period and after every period.

    The array is (n + 1, 44). `Q` to `ENERGY` and `CURRENT` to `TRIP` are slices of its rows.
    """
    error: Array
    """Following errors (demanded minus measured motor angle), (n, 4), rad."""
    saturated: Array
    """1 if the demanded current exceeded the possible current, otherwise 0, (n, 4)."""


def commands_from_setpoints(
    streams: dict[str, Stream],
    axes: dict[str, Axis],
    controller: Controller,
    prescribed: tuple[Array, Array],
    period: float,
) -> Commands:
    """Convert the set points of a plan to the commands in each period of the position loop.

    A set point consists of a target position, a velocity offset and a torque offset. The offsets
    determine the feed-forward current. The controller interpolates positions between set points
    (object 0x60C2). Velocity and torque offsets are constant between set points. The interpolation
    delays all drives by the same time, which the simulation ignores.

    Parameters
    ----------
    streams : dict
        Sequence of set points of each driven joint, as columns of integers in units of the
        controller: increments, 1e-3 rpm, and per mille of the rated torque.
    axes : dict
        Axis settings by joint.
    controller : Controller
        The motor controller.
    prescribed : pair of (n,) and (n, 4) arrays
        Instants of the position loop in s, and accelerations of joints without a drive in rad/s²
        or m/s².
    period : float
        Interval between set points, s.

    Returns
    -------
    Commands
        Commands in n periods.
    """
    t, accelerations = prescribed
    columns = {
        name: np.zeros((len(t), 4)) for name in ("demand", "speed", "acceleration", "torque")
    }
    for name, stream in streams.items():
        axis = axes[name]
        k = JOINTS.index(name)
        sent = period * np.arange(len(stream["target_position_inc"]))
        # The small number keeps an instant at a set point from being rounded down.
        next_index = np.minimum(np.floor(t / period + 1e-9).astype(int) + 1, len(sent) - 1)
        increment = 2.0 * np.pi / axis.counts_per_turn * axis.direction
        columns["demand"][:, k] = increment * np.interp(t, sent, stream["target_position_inc"])
        speed = axis.direction * stream["velocity_offset_mrpm"] * rpm / 1000.0
        acceleration = np.append(np.diff(speed), 0.0) / period
        columns["speed"][:, k] = speed[next_index]
        columns["acceleration"][:, k] = acceleration[np.maximum(next_index - 1, 0)]
        if controller.torque_offset:
            offset = axis.direction * stream["torque_offset_permille"] * axis.rated_torque / 1000.0
            columns["torque"][:, k] = offset[next_index]
    return Commands(
        **columns, prescribed=accelerations, power=np.ones(len(t)), stalled=np.zeros((len(t), 4))
    )


def robot_compliance(robot: Robot, controller: Controller, scale: float = 1.0) -> Compliance:
    """Compute stiffness, damping and backlash between the drives and the joints.

    Values of the controller file have priority over those of the robot file. Values that neither
    file states are assumed, see `JOINT_FREQUENCIES`, `ASSUMED_BACKLASH` and `DAMPING_RATIO`. The
    known backlash of each gear stage adds to the backlash of the robot file or the assumed one.

    Parameters
    ----------
    robot : Robot
        Robot with its joints.
    controller : Controller
        The motor controller, whose file may contain data of the compliance.
    scale : float
        Factor on stiffness and damping.

    Returns
    -------
    Compliance
        Stiffness, damping and backlash of the four joints.
    """
    frequency = list(JOINT_FREQUENCIES)
    backlash = list(ASSUMED_BACKLASH)
    ratios = [DAMPING_RATIO] * 4
    body = RigidBody.from_robot(robot)
    assumed = Compliance.from_frequencies(body, np.zeros(4), frequency)
    for k, (name, joint) in enumerate(zip(JOINTS, robot.joints, strict=True)):
        backlash[k] = backlash[k] if joint.backlash is None else joint.backlash
        backlash[k] += sum(play or 0.0 for play in joint.plays().values())
        if joint.stiffness is not None:
            frequency[k] *= float(np.sqrt(joint.stiffness / assumed.stiffness[k]))
        settings = controller.compliance.get(name)
        if settings is not None:
            frequency[k] = settings.frequency or frequency[k]
            backlash[k] = backlash[k] if settings.backlash is None else settings.backlash
            ratios[k] = settings.damping_ratio
    default = Compliance.from_frequencies(body, np.zeros(4), frequency)
    damping = default.damping * np.asarray(ratios) / DAMPING_RATIO
    return Compliance(default.stiffness * scale, damping * scale, np.asarray(backlash))


class ControlledArm(ArmPlant):
    """Simulation model of an arm with the motor controllers of its drives.

    It can execute any commands with any friction parameters.
    """

    def __init__(
        self,
        robot: Robot,
        controller: Controller,
        axes: dict[str, Axis],
        windows: dict[str, float],
        *,
        compliance: Compliance | None = None,
        steps: int = STEPS_PER_PERIOD,
    ) -> None:
        """Build the CasADi function that simulates one period of the position loop.

        Parameters
        ----------
        robot : Robot
            Robot with its drives and motors.
        controller : Controller
            The motor controller.
        axes : dict
            Axis settings of the controller by joint.
        windows : dict
            Largest permitted following error in rad at the motor, by joint. A larger one trips the
            drive, which means that all drives switch off.
        compliance : Compliance, optional
            Springs, dampers and backlash. By default, they come from the files of controller and
            robot, and missing values are assumed (`robot_compliance`).
        steps : int
            Number of steps of the plant in one period of the position loop.
        """
        self.period = controller.loop_period
        self.steps = steps
        super().__init__(
            robot, compliance or robot_compliance(robot, controller), self.period / steps
        )
        self.controller = controller
        self.axes = axes
        self.windows = windows
        self.electrics: dict[int, MotorElectrics] = {
            k: motor_electrics(robot.joints[k], controller) for k in self.driven
        }
        self.control_step = self._period_function()
        self._chunk = self.control_step.mapaccum("arm", _PERIODS_PER_CHUNK)

    def initial_state(self, q: Array, qd: Array, qdd: Array, command: Commands) -> Array:
        """Return the state of the arm and its controllers at the start of a motion.

        The arm may already move. The motors are at the angles that the encoders expect, and the
        loads deflect the joints. The currents of moving motors overcome the load and the friction.
        The integral terms of the position loops provide the part of the current that the
        feed-forward of the first command does not contain.

        Parameters
        ----------
        q, qd, qdd : (4,) arrays
            Joint positions, velocities and accelerations in rad, rad/s and rad/s² (joint 4: m, m/s
            and m/s²).
        command : Commands
            Commands of the motion.

        Returns
        -------
        (44,) array
            State of the arm (28 numbers) and of its controllers (16 numbers), see `CURRENT`.
        """
        state = np.concatenate(
            [self.state_in_motion(q, qd, qdd), np.zeros(CONTROLLED_STATE_SIZE - STATE_SIZE)]
        )
        motor = self.state_at_rest(q)[MOTOR]
        torques = motor_torque(self.robot, q, qd, qdd)
        for k in self.driven:
            state[Q][k] -= (state[MOTOR][k] - motor[k]) / self.drive(k).ratio
            state[MOTOR][k] = motor[k]
            if state[W][k] == 0.0:
                continue
            joint = self.robot.joints[k]
            electrics = self.electrics[k]
            gains = loop_gains(joint, self.controller, electrics)
            state[CURRENT][k] = torques[k] / electrics.torque_constant
            state[INTEGRAL][k] = state[CURRENT][k] - (
                gains.ff_velocity * command.speed[0, k]
                + gains.ff_acceleration * command.acceleration[0, k]
                + command.torque[0, k] / electrics.torque_constant
            )
        return state

    @property
    def torque_constants(self) -> list[float]:
        """Torque constants of the four motors, N·m/A. 0 for a joint without a drive."""
        return [getattr(self.electrics.get(k), "torque_constant", 0.0) for k in range(4)]

    def encoder_offsets(self, q: Array) -> Array:
        """Compute the motor angles at which the encoders measure 0.

        The encoders were set to ratio · q while the arm rested at joint positions q, although the
        weight deflected the joints. The offset of an encoder is the motor angle minus the angle
        that the encoder measures.

        Parameters
        ----------
        q : (4,)
            Joint positions at which the encoders were set, rad, and m for joint 4.

        Returns
        -------
        (4,) array
            Offsets of the encoders, rad. 0 for a joint without a drive.
        """
        state = self.state_at_rest(q)
        offsets = np.zeros(4)
        for k in self.driven:
            offsets[k] = state[MOTOR][k] - self.drive(k).ratio * q[k]
        return offsets

    def play(self, state: Array, command: Commands, offsets: Array, friction: Array) -> Playback:
        """Simulate the arm while its controllers execute commands.

        The periods of the position loop are simulated in chunks of equal length. If one period of a
        chunk needs half the usual time step of the integrator (see `half_step_periods`), all
        periods of the chunk are integrated with half the time step.

        Parameters
        ----------
        state : (44,) array
            Initial state of the arm and its controllers, from `initial_state` or from
            `Playback.states`.
        command : Commands
            Commands in n periods.
        offsets : (4,) array
            Motor angles at which the encoders measure 0, see `encoder_offsets`, rad.
        friction : (28,) array
            Friction parameters of all joints, see `ArmPlant.friction_parameters`.

        Returns
        -------
        Playback
            States, following errors and saturation in all periods.
        """
        constants = np.concatenate([offsets, friction])
        table = command.table()
        table = np.hstack([table, np.tile(constants, (len(table), 1))])
        needs_halves = self.half_step_periods(command)
        states = [state[None]]
        errors = []
        saturated = []
        for start in range(0, len(table), _PERIODS_PER_CHUNK):
            rows = table[start : start + _PERIODS_PER_CHUNK]
            count = len(rows)
            # Every chunk has the same length, so the last row of a short one is repeated.
            rows = np.pad(rows, ((0, _PERIODS_PER_CHUNK - count), (0, 0)), "edge")
            simulate_chunk = self._chunk_in_halves if needs_halves[start] else self._chunk
            next_states, following_errors, is_cut = simulate_chunk(states[-1][-1], rows.T)
            states.append(next_states.full().T[:count])
            errors.append(following_errors.full().T[:count])
            saturated.append(is_cut.full().T[:count])
        return Playback(np.vstack(states), np.vstack(errors), np.vstack(saturated))

    def half_step_periods(self, command: Commands) -> Mask:
        """Find the periods in which the integrator must use half its usual time step.

        The integration error is largest while a drive breaks away, that is, while static friction
        is being overcome. A drive may break away during `_MAX_BREAKAWAY_PERIODS` periods after the
        first command to move.

        Parameters
        ----------
        command : Commands
            Commands in n periods of the position loop.

        Returns
        -------
        (n,) array of bool
            True for all periods of every chunk in which a drive may break away.
        """
        moving = command.speed != 0
        was_moving = np.vstack([np.zeros((1, 4), dtype=bool), moving[:-1]])
        starts = (moving & ~was_moving).any(axis=1)
        chunks = range(0, len(starts), _PERIODS_PER_CHUNK)
        has_start = [
            starts[max(0, k - _MAX_BREAKAWAY_PERIODS) : k + _PERIODS_PER_CHUNK].any()
            for k in chunks
        ]
        return np.repeat(has_start, _PERIODS_PER_CHUNK)[: len(starts)]

    @cached_property
    def control_step_in_halves(self) -> ca.Function:
        """CasADi function like `control_step`, but with plant steps of half the duration."""
        # `_period_function` reads these attributes, which are restored afterwards.
        self.h /= 2
        self.steps *= 2
        function = self._period_function()
        self.h *= 2
        self.steps //= 2
        return function

    @cached_property
    def _chunk_in_halves(self) -> ca.Function:
        """CasADi function that simulates a chunk of periods with half the usual time step."""
        return self.control_step_in_halves.mapaccum("halves", _PERIODS_PER_CHUNK)

    def _period_function(self) -> ca.Function:
        """Build the CasADi function that advances the arm by one period of the position loop.

        Returns
        -------
        casadi.Function
            It has two arguments. x (44,) is the state of the arm and its controllers (see
            `CURRENT`). u (57,) is the input of the period: a row of `Commands.table` (25), the
            offsets of the encoders in rad (4), and the friction parameters (28). The function
            returns the next state (44,), the following errors (4,) in rad, and for each motor (4,)
            1 if its current is limited, otherwise 0.
        """
        x = ca.SX.sym("x", CONTROLLED_STATE_SIZE)
        u = ca.SX.sym("u", 25 + 4 + 4 * len(FRICTION_PARAMETERS))
        # The offsets of the encoders are u[25:29], which `_control_joint` reads.
        prescribed = u[16:20]
        stalled = u[20:24]
        friction = u[29:]
        power = ca.logic_and(u[24], ca.mmax(x[TRIP]) == 0)
        names = ("tau", "current", "i", "d", "e", "trip", "cut")
        columns = {name: ca.SX.zeros(4) for name in names}  # Joints without a drive have zeros.
        for k in self.driven:
            for name, value in self._control_joint(k, x, u, power).items():
                columns[name][k] = value
        # The actuation of a joint without a drive is not modelled. It stops if the power fails.
        locked = ca.if_else(power, prescribed, -x[QD] / self.period)
        plant_state = ca.vertcat(x[: INTEGRAL.start], columns["i"], x[INTEGRAL.stop : STATE_SIZE])
        step_once = self.step_function()
        for _ in range(self.steps):
            plant_state = step_once(plant_state, columns["tau"], locked, stalled, friction)
        controller_state = [columns["current"], columns["d"], columns["e"], columns["trip"]]
        state = ca.vertcat(plant_state, *controller_state)
        return dense_function("period", [x, u], [state, columns["e"], columns["cut"]])

    def _control_joint(self, k: int, x: ca.SX, u: ca.SX, power: ca.SX) -> dict[str, ca.SX]:
        """Advance the controller of one joint by one period.

        Parameters
        ----------
        k : int
            Index of a joint with a drive.
        x : (44,) expression
            State of the arm and its controllers before the period, see `CURRENT`.
        u : (57,) expression
            Commands, encoder offsets and friction parameters, see `_period_function`.
        power : expression
            1 while the drives have power, otherwise 0.

        Returns
        -------
        dict
            Motor torque `tau` in N·m, `current` in A, integral term `i` and derivative term `d` in
            A, following error `e` in rad, and 1 or 0 for a drive that has tripped (`trip`) and for
            a limited current (`cut`).
        """
        # The input begins with four commands of each kind. The encoder offsets follow at 25.
        demand = u[k]
        speed = u[k + 4]
        acceleration = u[k + 8]
        torque = u[k + 12]
        offset = u[k + 25]
        joint = self.robot.joints[k]
        electrics = self.electrics[k]
        gains = loop_gains(joint, self.controller, electrics)
        counts_per_turn = self.axes[joint.name].counts_per_turn
        error = demand - round_to_increments(x[MOTOR][k] - offset, counts_per_turn)
        feedforward = gains.ff_velocity * speed + gains.ff_acceleration * acceleration
        step = advance_loops(
            gains,
            electrics,
            self.period,
            error=ca.vertcat(error, x[ERROR][k]),
            previous=ca.vertcat(x[CURRENT][k], x[INTEGRAL][k], x[DERIVATIVE][k]),
            w=x[W][k],
            feedforward=feedforward + torque / electrics.torque_constant,
        )
        current = ca.if_else(power, step.current, 0)
        is_late = ca.logic_and(power, ca.fabs(error) > self.windows[joint.name])
        return {
            "tau": electrics.torque_constant * current,
            "current": current,
            "i": step.integral,
            "d": step.derivative,
            "e": error,
            "trip": ca.fmax(x[TRIP][k], is_late),
            "cut": ca.logic_and(power, step.saturated),
        }

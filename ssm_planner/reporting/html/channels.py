"""Sample every quantity that an HTML page (report) of a plan plots over time.

A channel is one named series of values at the instants of the page, such as the velocity of one
joint. `sample_channels` is the entry. `encode_channels` converts its result for the scripts of a
page.
"""

import base64
import math
from collections.abc import Sequence

import numpy as np

from ssm_planner.codegen import NUMPY
from ssm_planner.kinematics import (
    Mechanism,
    eye_limits,
    task_from_joints,
    task_rates,
    tip_position,
    tool_speed,
)
from ssm_planner.plans import Plan
from ssm_planner.problem import (
    JOINTS,
    TASK_COORDINATES,
    LensClearance,
    RetinaClearance,
    SpeedLimit,
    TaskLimits,
    TipSpeed,
)
from ssm_planner.reporting.text import ZERO_CELSIUS
from ssm_planner.sizing import (
    THERMAL_DATA,
    Conditions,
    Cycle,
    JointLoad,
    ThermalModel,
    missing_data,
    pause_after_motion,
    steady_state,
    torque_split,
)
from ssm_planner.sizing.joint_load import MOST_INSTANTS
from ssm_planner.trajectory import Samples
from ssm_planner.typing import Array, Arrays

SAMPLE_RATE, MIN_SAMPLES, MAX_SAMPLES = 400.0, 1200, 4000
"""Samples per second of motion in a page, and the smallest and largest number of samples."""
EYE_CHANNELS = {RetinaClearance.name: "retina", LensClearance.name: "lens"}
"""Name of the channel of each clearance in the eye."""


def time_grid(duration: float) -> Array:
    """Return the instants (n,) in s at which a page shows a motion of this duration."""
    return np.linspace(
        0.0, duration, int(np.clip(SAMPLE_RATE * duration, MIN_SAMPLES, MAX_SAMPLES))
    )


def sample_channels(plan: Plan, t: Array) -> Arrays:
    """Sample every quantity of a plan that the page plots over time.

    Each quantity becomes a channel, that is, one named series of values.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.
    t : (n,) array
        Instants, s. After the end of the motion, quantities keep their last value.

    Returns
    -------
    dict of (n,) arrays
        Values by name of the channel, in SI units, with temperatures in °C. A number at the end of
        a name is an index from 0. "q", "qd", "qdd" and "qddd" with the index of a joint are its
        position, velocity, acceleration and jerk, "w" and "tau" the speed and the torque of its
        motor, and "winding" and "housing" the temperatures of its motor. "split0_load" is the
        component "load" of the motor torque of joint 0. "t" contains the instants. "task0" to
        "task3" are roll, tilt, spin and depth, and "tip0" to "tip2" the coordinates of the tip.
        Further names denote limited rates, tool speeds and clearances.
    """
    trajectory = plan.motion
    samples = trajectory.sample(trajectory.breaks[0] + np.minimum(t, trajectory.duration))
    channels = {
        "t": t,
        **_tool_channels(Mechanism.from_robot(plan.robot), samples, plan.limits),
    }
    for name in ("q", "qd", "qdd", "qddd"):
        channels |= {f"{name}{i}": getattr(samples, name)[:, i] for i in range(4)}
    assert plan.sizing is not None
    loads = [joint.load for joint in plan.sizing.joints]
    for load in loads:
        i = JOINTS.index(load.joint)
        following = np.searchsorted(load.t - load.t[0], t, "right")
        # The interpolation uses only the instants just before and just after those of the page. A
        # long motion has many more.
        used = np.clip([following - 1, following], 0, len(load.t) - 1)
        selected = load.subset(np.unique(used))
        curves = {f"w{i}": selected.speed(), f"tau{i}": selected.torque()}
        for name, torque in torque_split(selected).components():
            curves[f"split{i}_{name}"] = torque
        for name, values in curves.items():
            channels[name] = np.interp(t, selected.t - load.t[0], values)
    return channels | _temperature_channels(loads, t, pause_after_motion(plan.problem))


def encode_channels(channels: Arrays) -> dict[str, str]:
    """Encode the plotted series of values (channels) for the scripts of a page.

    The base64 text of little-endian doubles is exact and fast to read.

    Parameters
    ----------
    channels : dict of (n,) arrays
        Values by name of the channel.

    Returns
    -------
    dict of str
        Base64 text by name of the channel.
    """
    return {
        name: base64.b64encode(values.astype("<f8").tobytes()).decode("ascii")
        for name, values in channels.items()
    }


def plotted_speeds(limits: TaskLimits) -> list[type[SpeedLimit]]:
    """Return the kinds of tool speed that the page plots: the tip speed and limited speeds."""
    limited = [type(limit) for limit in limits.speeds if not isinstance(limit, TipSpeed)]
    return [TipSpeed] + limited


def _tool_channels(mechanism: Mechanism, samples: Samples, limits: TaskLimits) -> Arrays:
    """Compute the quantities of the tool that the report plots over time.

    They are the task coordinates, the rates of those coordinates whose rate is limited, the tip
    position, the tool speeds, and the clearances in the eye. Each is one channel of the report,
    that is, one named series of values.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.
    samples : Samples
        n samples of the joint motion.
    limits : TaskLimits
        Limits of the task.

    Returns
    -------
    dict of (n,) arrays
        Values in SI units by name of the channel. "task0" to "task3" are roll, tilt, spin and
        depth, "task_rate0" to "task_rate3" their rates, and "tip0" to "tip2" the coordinates x, y
        and z of the tip. Speeds have the name of the field of their limit, and clearances the names
        `EYE_CHANNELS`.
    """
    task = task_from_joints(mechanism, samples.q)
    for column in (0, 2):  # Roll and spin may jump by a whole turn.
        task[:, column] = np.unwrap(task[:, column])
    rates = task_rates(mechanism, samples.q, samples.qd)
    tip = tip_position(mechanism, samples.q)
    channels = {
        speed_type.field: tool_speed(speed_type, mechanism, samples.q, samples.qd)
        for speed_type in plotted_speeds(limits)
    }
    channels |= {f"tip{i}": tip[:, i] for i in range(3)}
    channels |= {f"task{i}": task[:, i] for i in range(4)}
    channels |= {
        f"task_rate{i}": rates[:, i] for i in range(4) if TASK_COORDINATES[i] in limits.rates
    }
    if limits.eye is not None:
        for name, (clearance, _) in eye_limits(NUMPY, limits.eye, tip.T).items():
            channels[EYE_CHANNELS[name]] = clearance
    return channels


def _temperature_channels(loads: Sequence[JointLoad], t: Array, pause: float) -> Arrays:
    """Return the temperatures of the windings and housings of all motors over time.

    The temperatures are those of the steady state that is reached if the motion repeats again and
    again with a pause. Motors without thermal data, and motors that overheat, are left out.

    Parameters
    ----------
    loads : sequence of JointLoad
        Loads of the motors.
    t : (n,) array
        Instants, s.
    pause : float
        Time before the motion repeats, s.

    Returns
    -------
    dict of (n,) arrays
        Temperatures in °C by the names "winding0" and "housing0" for the motor of joint 0, and so
        on.
    """
    channels = {}
    for load in loads:
        if load.motor is None or missing_data(load.motor, *THERMAL_DATA):
            continue
        # Temperatures change slowly, so a selection of about MOST_INSTANTS instants suffices.
        end = len(load.t) - 1
        step = math.ceil(len(load.t) / MOST_INSTANTS)
        selected = load.subset(np.append(np.arange(0, end, step), end))
        cycle = Cycle.from_torque(selected.t, selected.torque(), pause)
        state = steady_state(ThermalModel.from_motor(load.motor, Conditions().ambient), cycle)
        if state.steady:
            i = JOINTS.index(load.joint)
            channels[f"winding{i}"] = np.interp(t, cycle.t, state.winding) - ZERO_CELSIUS
            channels[f"housing{i}"] = np.interp(t, cycle.t, state.housing) - ZERO_CELSIUS
    return channels

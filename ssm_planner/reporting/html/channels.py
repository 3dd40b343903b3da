"""Channels: every quantity that a page plots, sampled in time."""

from __future__ import annotations

import base64
from collections.abc import Sequence

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.kinematics.eye import eye_limits
from ssm_planner.kinematics.forward import tip_position, tool_speed
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints, task_rates
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import TASK, LensClearance, RetinaClearance, SpeedLimit, TipSpeed
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import JOINTS
from ssm_planner.sizing.duty import pause_of
from ssm_planner.sizing.joint_load import JointLoad, joint_loads
from ssm_planner.sizing.motor_limits import Conditions, missing
from ssm_planner.sizing.requirements import torque_split
from ssm_planner.sizing.thermal_network import FIGURES, Cycle, ThermalModel, steady_state
from ssm_planner.trajectory import Samples
from ssm_planner.typing import Array

RATE, FEWEST, MOST = 400.0, 1200, 4000
"""Samples per second of motion, and how many a page holds."""
LOAD_RATE = 500.0
"""Hz at which the motors are computed, besides every instant at which a torque jumps."""
CELSIUS = 273.15


EYE_CHANNELS = {RetinaClearance.name: "retina", LensClearance.name: "lens"}


def time_grid(duration: float) -> Array:
    """Instants (n,) at which a page shows a motion of this duration, s."""
    return np.linspace(0.0, duration, int(np.clip(RATE * duration, FEWEST, MOST)))


def channels_of(plan: Plan, t: Array) -> dict[str, Array]:
    """Every plotted quantity at t (n,), SI, by name such as "qd2" (joint index); after the plan's end its last value."""
    trajectory = plan.motion
    samples = trajectory.sample(trajectory.breaks[0] + np.minimum(t, trajectory.duration))
    channels = {
        "t": t,
        **_tool_channels(Mechanism.from_geometry(plan.robot.geometry), samples, plan.limits),
    }
    for name in ("q", "qd", "qdd", "qddd"):
        channels |= {f"{name}{i}": getattr(samples, name)[:, i] for i in range(4)}
    loads = joint_loads(trajectory, plan.robot, LOAD_RATE)
    for load in loads:
        i = JOINTS.index(load.joint)
        for name, values in (("w", load.speed()), ("tau", load.torque())):
            channels[f"{name}{i}"] = np.interp(t, load.t - load.t[0], values)
    return (
        channels
        | _split_channels(loads, t)
        | _temperature_channels(loads, t, pause_of(plan.problem))
    )


def encoded(channels: dict[str, Array]) -> dict[str, str]:
    """Channels (n,) as base64 of little-endian doubles: exact, and quick to read in a browser."""
    return {
        name: base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode("ascii")
        for name, values in channels.items()
    }


def limited_speeds(limits: TaskLimits) -> list[type[SpeedLimit]]:
    """Speeds of the tool that the page shows: the tip's, and what else is limited."""
    return [TipSpeed, *(type(limit) for limit in limits.speeds if not isinstance(limit, TipSpeed))]


def _tool_channels(mechanism: Mechanism, samples: Samples, limits: TaskLimits) -> dict[str, Array]:
    """Task coordinates, their rates, tip position and speed and, where there is an eye, what is limited about it; SI."""
    task = task_from_joints(mechanism, samples.q)
    for column in (0, 2):
        task[:, column] = np.unwrap(task[:, column])
    rates = task_rates(mechanism, samples.q, samples.qd)
    tip = tip_position(mechanism, samples.q)
    channels = {
        kind.field: tool_speed(kind, mechanism, samples.q, samples.qd)
        for kind in limited_speeds(limits)
    }
    channels |= {f"tip{i}": tip[:, i] for i in range(3)}
    channels |= {f"task{i}": task[:, i] for i in range(4)}
    channels |= {f"task_rate{i}": rates[:, i] for i in range(4) if TASK[i] in limits.rates}
    if limits.eye is not None:
        channels |= {
            EYE_CHANNELS[name]: value
            for name, (value, _) in eye_limits(NUMPY, limits.eye, tip.T).items()
        }
    return channels


def _split_channels(loads: Sequence[JointLoad], t: Array) -> dict[str, Array]:
    """Parts of each motor's torque at t (n,), N·m, by name such as "split0_load"."""
    return {
        f"split{JOINTS.index(load.joint)}_{name}": np.interp(t, load.t - load.t[0], part)
        for load in loads
        for name, part in torque_split(load).parts()
    }


def _temperature_channels(loads: Sequence[JointLoad], t: Array, pause: float) -> dict[str, Array]:
    """Winding and housing, °C, of the motors whose file has the figures, once the repeated motion is in its steady state."""
    channels = {}
    for load in loads:
        if load.motor is None or missing(load.motor, *FIGURES):
            continue
        cycle = Cycle.from_torque(load.t, load.torque(), pause)
        found = steady_state(ThermalModel.from_motor(load.motor, Conditions().ambient), cycle)
        if found.steady:
            for name, values in (("winding", found.winding), ("housing", found.housing)):
                channels[f"{name}{JOINTS.index(load.joint)}"] = (
                    np.interp(t, cycle.t, values) - CELSIUS
                )
    return channels

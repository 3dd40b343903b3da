"""Build the descriptions of all plots of an HTML page that shows a plan.

Such a description is called a panel. It contains the curves of the plot (series), its limits, and
the intervals in which these limits are active, that is, reached by the motion. The values of a
curve are in a channel, a named series of sampled values (`channels`). `build_panels` is the entry.
The script assets/plots.js draws the panels.
"""

from collections.abc import Iterator
from typing import TypeVar

import numpy as np

from ssm_planner.display import format_number
from ssm_planner.identification import true_runs
from ssm_planner.plans import Plan
from ssm_planner.problem import (
    JOINTS,
    TASK_COORDINATES,
    Eye,
    Joint,
    JointAcceleration,
    JointJerk,
    JointPosition,
    JointVelocity,
    LensClearance,
    Limit,
    Motor,
    MotorSpeed,
    MotorTorque,
    RetinaClearance,
    SpeedLimit,
    TaskLimits,
    TaskRange,
    TaskRate,
)
from ssm_planner.reporting.figures.style import display_unit_of
from ssm_planner.reporting.html.channels import plotted_speeds
from ssm_planner.reporting.text import ACTIVE_MARGIN, ZERO_CELSIUS
from ssm_planner.sizing import (
    THERMAL_DATA,
    TORQUE_COMPONENTS,
    Conditions,
    available_torque,
    continuous_torque,
    missing_data,
)
from ssm_planner.typing import Array, Arrays, JsonObject, Mask, Range
from ssm_planner.units import RPM

Panel = JsonObject
"""A plot on the page, as JSON types. `new_panel` lists its keys."""
CoordinateLimit = TypeVar("CoordinateLimit", TaskRange, TaskRate)
"""Class of limits that apply to one task coordinate."""
MAX_MERGED_GAP = 0.01
"""Gap between two active intervals below which they are merged, s."""
COORDINATE_GROUPS = (([0, 1, 2], "rad", "Task: roll, tilt, spin"), ([3], "m", "Task: depth"))
"""Indices, unit and title of the task coordinates that share a panel."""
TEMPERATURE_SECTION = (
    "Steady-state temperature of the repeated motion at 25\N{NO-BREAK SPACE}°C ambient"
)
"""Heading of the panels of temperatures."""
MAP_POINTS = 81
"""Number of speeds in the torque–speed map of a motor."""


def build_panels(plan: Plan, channels: Arrays) -> list[Panel]:
    """Build the descriptions of all plots (panels) of a plan, in the order of the page.

    Parameters
    ----------
    plan : Plan
        A plan with a trajectory.
    channels : dict of (n,) arrays
        Sampled quantities by name, as `sample_channels` returns them.

    Returns
    -------
    list of Panel
        Descriptions of the plots, with limits in display units.
    """
    joints = plan.robot.joints
    joint_groups = [
        (unit, [(i, joint) for i, joint in enumerate(joints) if joint.unit == unit])
        for unit in ("rad", "m")
    ]
    tool = list(tool_panels(plan.limits))
    panels = [panel for panel in tool if panel["section"] == "Task coordinates"]
    for field, per_time, limit_type in (
        ("q", "", JointPosition),
        ("qd", "/s", JointVelocity),
        ("qdd", "/s²", JointAcceleration),
        ("qddd", "/s³", JointJerk),
    ):
        for unit, group in joint_groups:
            # Without a jerk limit the acceleration jumps, and its derivative would be solver noise.
            has_limit = limit_type is not JointJerk or any(
                joint.jerk is not None for _, joint in group
            )
            if group and has_limit:
                panels.append(_joint_panel(group, field, unit + per_time, limit_type))
    panels += [panel for panel in tool if panel not in panels]
    panels += _motor_panels(joints, channels)
    panels += torque_part_panels(channels)
    panels += temperature_panels(
        channels, {i: j.motor for i, j in enumerate(joints) if j.motor is not None}
    )
    for panel in panels:
        add_active_intervals(panel, channels)
        convert_to_display_units(panel)
    return panels


def new_panel(section: str, title: str, unit: str, series: list[tuple[str, str, int]]) -> Panel:
    """Build the description of a plot (panel) whose limits are added later.

    Parameters
    ----------
    section, title : str
        Heading under which the plot appears on the page, and the title of the plot.
    unit : str
        SI unit of the plotted values, or "rpm" for values in rad/s that are displayed in rpm.
    series : list of (str, str, int)
        For each curve, the name of the channel with its values, its label, and the index of its
        colour.

    Returns
    -------
    Panel
        Dictionary of JSON types with the keys `section`, `title`, `unit`, `series`, `limits`
        (results of `new_limit_entry`), `missing` (sentences on data that the plot lacks) and
        `active` (intervals in which the motion is at a limit). The last three lists are empty.
    """
    return {
        "section": section,
        "title": title,
        "unit": unit,
        "series": [
            {"channel": channel, "label": label, "joint": joint} for channel, label, joint in series
        ],
        "limits": [],
        "missing": [],
        "active": [],
    }


def new_limit_entry(
    name: str,
    of: str,
    index: int,
    low: float,
    high: float,
    channel: str | None = None,
    size: float | None = None,
) -> JsonObject:
    """Return a limit in the form that the page reads.

    Parameters
    ----------
    name : str
        Name of the limit.
    of : str
        Joint or coordinate to which the limit applies, or "".
    index : int
        Index of the colour.
    low, high : float
        Bounds in the SI unit of the panel. They may be infinite.
    channel : str, optional
        Name of the plotted quantity to which the limit applies. The page marks the intervals in
        which this quantity is at the limit. None marks no intervals.
    size : float, optional
        Value to which the tolerance `ACTIVE_MARGIN` refers. The default is the limit itself, or
        half the width of a range.

    Returns
    -------
    dict
        The arguments as JSON types, and the `label` of the limit, which contains its name and the
        joint or coordinate.
    """
    return {
        "name": name,
        "of": of,
        "label": f"{name}, {of}" if of else name,
        "joint": index,
        "low": low,
        "high": high,
        "channel": channel,
        "size": size,
    }


def limit_entry(limit: Limit, index: int, channel: str) -> JsonObject:
    """Return a limit of the problem in the form that the page reads.

    Parameters
    ----------
    limit : Limit
        Limit that is shown.
    index : int
        Index of the colour.
    channel : str
        Name of the plotted quantity to which the limit applies. The page marks the intervals in
        which this quantity is at the limit.

    Returns
    -------
    dict
        Entry as that of `new_limit_entry`, in the SI unit of the limit.
    """
    # A speed is never negative, so its lower bound 0 is not a limit.
    low = -np.inf if isinstance(limit, SpeedLimit) else limit.low
    size = limit.half_width if isinstance(limit, RetinaClearance) else None
    owner = limit.coordinate if isinstance(limit, TaskRange) else limit.joint or ""
    line = new_limit_entry(
        limit.name, owner, index=index, low=low, high=limit.high, channel=channel, size=size
    )
    # The name of a range contains its coordinate.
    return {**line, "label": limit.name} if isinstance(limit, TaskRange) else line


def add_active_intervals(panel: Panel, channels: Arrays) -> None:
    """Add to the description of a plot the intervals in which the motion is at one of its limits.

    Each interval contains its `start` and `end` in s, the `side` (+1 for the upper and −1 for the
    lower bound), the bound as `value`, and the label, name and colour index of the limit.

    Parameters
    ----------
    panel : Panel
        Description of the plot, which is changed in place.
    channels : dict of (n,) arrays
        Sampled quantities by name.
    """
    for limit in panel["limits"]:
        if limit["channel"] is None:
            continue
        values, low, high = channels[limit["channel"]], limit["low"], limit["high"]
        for start, end, side in active_intervals(channels["t"], values, low, high, limit["size"]):
            bound = high if side > 0 else low
            names = {key: limit[key] for key in ("label", "name", "joint")}
            panel["active"].append(
                {**names, "start": start, "end": end, "side": side, "value": bound}
            )


def convert_to_display_units(panel: Panel) -> None:
    """Convert the limits and intervals of a plot to display units, in place.

    The curves stay in SI units. The scripts of the page multiply them by the `scale` that this
    function adds to the description of the plot.

    Parameters
    ----------
    panel : Panel
        Description of the plot with limits in SI units. Infinite bounds become None.
    """
    panel["unit"], panel["scale"] = display_unit_of(panel["unit"])
    for limit in panel["limits"]:
        for end in ("low", "high"):
            limit[end] = panel["scale"] * limit[end] if np.isfinite(limit[end]) else None
    for interval in panel["active"]:
        interval["value"] *= panel["scale"]


def active_intervals(
    t: Array, values: Array, low: float, high: float, size: float | None = None
) -> Iterator[tuple[float, float, int]]:
    """Find the intervals in which a quantity is at its lower or upper bound.

    Parameters
    ----------
    t : (n,) array
        Instants, s.
    values : (n,) array
        Quantity at these instants.
    low, high : float
        Bounds of the quantity. They may be infinite.
    size : float, optional
        Value to which the tolerance `ACTIVE_MARGIN` refers. The default is the bound itself. If
        both bounds are finite, the tolerance always refers to half of their distance.

    Yields
    ------
    start, end : float
        Ends of the interval, s.
    side : int
        +1 at the upper bound and −1 at the lower bound.
    """
    for side, bound in ((1, high), (-1, low)):
        if np.isfinite(bound):
            tolerance = ACTIVE_MARGIN * (abs(bound) if size is None else size)
            if np.isfinite(low) and np.isfinite(high):
                tolerance = ACTIVE_MARGIN / 2 * (high - low)
            with np.errstate(invalid="ignore"):
                active = side * (bound - values) <= tolerance
            for start, end in _merged_runs(t, active):
                yield start, end, side


def _merged_runs(t: Array, active: Mask) -> list[Range]:
    """Return the start and end times of all runs of true values, in s.

    A run is a sequence of successive instants with the value true. Runs with a gap shorter than
    `MAX_MERGED_GAP` are merged.

    Parameters
    ----------
    t : (n,) array
        Instants, s.
    active : (n,) array of bool
        Values at these instants.

    Returns
    -------
    list of (float, float)
        Start and end time of each run, s.
    """
    intervals: list[Range] = []
    for first_index, end_index in true_runs(active):
        start, end = float(t[first_index]), float(t[end_index - 1])
        if intervals and start - intervals[-1][1] < MAX_MERGED_GAP:
            start = intervals.pop()[0]
        intervals.append((start, end))
    return intervals


def limit_rows(limits: TaskLimits) -> list[tuple[str, str, str, str]]:
    """Format every limit on the tool as cells of a table.

    The name of a clearance in the eye also states the radius to which it refers.

    Parameters
    ----------
    limits : TaskLimits
        Limits of the task.

    Returns
    -------
    list of (str, str, str, str)
        For each limit: its name, lower bound, upper bound and display unit. An infinite bound is an
        empty text. The ranges of task coordinates come first.
    """
    radii = {}
    if limits.eye is not None:
        radii[RetinaClearance.name] = f", radius {1e3 * limits.eye.radius:g} mm"
        radii[LensClearance.name] = f", shaft radius {1e3 * limits.eye.shaft_radius:g} mm"
    rows = []
    for limit in sorted(limits.all_limits, key=lambda limit: not isinstance(limit, TaskRange)):
        low = limit.low if isinstance(limit, TaskRange) or limit.is_floor else -np.inf
        unit, scale = display_unit_of(limit.unit)
        ends = [
            format_number(scale * end, 6) if np.isfinite(end) else "" for end in (low, limit.high)
        ]
        rows.append((limit.name + radii.get(limit.name, ""), ends[0], ends[1], unit))
    return rows


def missing_temperature_reasons(channels: Arrays, motors: dict[int, Motor]) -> Iterator[str]:
    """Yield the reasons why temperatures of motors cannot be plotted.

    Parameters
    ----------
    channels : dict of (n,) arrays
        Sampled quantities by name.
    motors : dict of Motor
        Motors by joint index.

    Yields
    ------
    str
        One reason for each motor without a temperature.
    """
    for i, motor in motors.items():
        if f"winding{i}" not in channels:
            missing_values = missing_data(motor, *THERMAL_DATA)
            reason = "the motor overheats without reaching a steady state"
            if missing_values:
                reason = f"the motor file lacks {', '.join(missing_values)}"
            yield f"{JOINTS[i]}: {reason}".replace("_", " ")


def motor_map(i: int, motor: Motor) -> JsonObject:
    """Return the speed–torque curves of a motor at nominal voltage and 25 °C.

    Parameters
    ----------
    i : int
        Index of the joint.
    motor : Motor
        Motor whose limits are drawn.

    Returns
    -------
    dict
        JSON types: the largest and the continuous torque in mN·m at `MAP_POINTS` motor speeds in
        rpm.
    """
    conditions = Conditions()
    speed = np.linspace(0.0, motor.max_speed, MAP_POINTS)
    available = available_torque(motor, conditions, speed)
    continuous = np.minimum(available, continuous_torque(motor, conditions.ambient) or 0.0)
    return {
        "joint": i,
        "motor": motor.name,
        "placeholder": motor.placeholder,
        "speed": (RPM * speed).tolist(),
        "largest": (1e3 * available).tolist(),
        "continuous": (1e3 * continuous).tolist(),
    }


def _joint_panel(
    joints: list[tuple[int, Joint]],
    field: str,
    unit: str,
    limit_type: type[JointPosition | JointVelocity | JointAcceleration | JointJerk],
) -> Panel:
    """Build the description of the plot (panel) of one quantity of several joints, with its limits.

    Parameters
    ----------
    joints : list of (int, Joint)
        Index and joint for each curve.
    field : str
        Beginning of the name of each curve's channel, such as "qd". The index of the joint follows.
    unit : str
        SI unit of the quantity.
    limit_type : type
        Class of the limits on the quantity.

    Returns
    -------
    Panel
        Description of the plot. Its key `missing` names the joints without a limit.
    """
    title = f"{limit_type.name.capitalize()}: {', '.join(joint.name for _, joint in joints)}"
    panel = new_panel(
        "Joints", title, unit, [(f"{field}{i}", joint.name, i) for i, joint in joints]
    )
    unlimited = []
    for i, joint in joints:
        limit = joint.find_limit(limit_type)
        if limit is None:
            unlimited.append(joint.name)
        else:
            panel["limits"].append(limit_entry(limit, i, f"{field}{i}"))
    if unlimited:
        owners = f": {', '.join(unlimited)}" if panel["limits"] else ""
        panel["missing"].append(f"no {limit_type.name} limit{owners}")
    return panel


def _motor_panels(joints: tuple[Joint, ...], channels: Arrays) -> Iterator[Panel]:
    """Yield the descriptions of the plots (panels) of the speed and the torque of every motor.

    Parameters
    ----------
    joints : tuple of Joint
        All joints of the robot.
    channels : dict of (n,) arrays
        Sampled quantities by name. A joint is driven if its motor torque is among them.

    Yields
    ------
    Panel
        First one plot of the speed of each motor, and then one plot of the torque of each motor.
    """
    driven = [i for i in range(4) if f"tau{i}" in channels]
    for name, limit_type, unit in (("w", MotorSpeed, "rpm"), ("tau", MotorTorque, "N·m")):
        for i in driven:
            joint, motor = joints[i], joints[i].motor
            title = f"{limit_type.name.capitalize()}: {joint.name}"
            panel = new_panel("Motors", title, unit, [(f"{name}{i}", joint.name, i)])
            if motor is None:
                panel["missing"].append("no motor given")
            else:
                panel["limits"].append(limit_entry(joint.limit(limit_type), i, f"{name}{i}"))
                high = motor.nominal_torque
                if name == "tau":
                    panel["limits"].append(
                        new_limit_entry("nominal torque", joint.name, index=i, low=-high, high=high)
                    )
            yield panel


def torque_part_panels(channels: Arrays) -> Iterator[Panel]:
    """Yield one plot description (panel) per driven joint, with the parts of its motor torque.

    A part is the contribution of one cause to the torque, such as friction or inertia.

    Parameters
    ----------
    channels : dict of (n,) arrays
        Sampled quantities by name. "split0_load" is the part "load" of the motor torque of joint 0.

    Yields
    ------
    Panel
        Description of the plot with one curve for each name in `TORQUE_COMPONENTS`.
    """
    for i, joint in enumerate(JOINTS):
        if f"split{i}_{TORQUE_COMPONENTS[0]}" in channels:
            series = [
                (f"split{i}_{name}", name.replace("_", " "), k)
                for k, name in enumerate(TORQUE_COMPONENTS)
            ]
            yield new_panel("Parts of the motor torque", f"Torque split: {joint}", "N·m", series)


def temperature_panels(channels: Arrays, motors: dict[int, Motor]) -> Iterator[Panel]:
    """Yield one plot description (panel) per motor, with the temperatures of winding and housing.

    Motors whose temperatures were not computed are left out. `missing_temperature_reasons` states
    the reasons.

    Parameters
    ----------
    channels : dict of (n,) arrays
        Sampled quantities by name. "winding0" and "housing0" are the temperatures in °C of the
        motor of joint 0.
    motors : dict of Motor
        Motors by joint index.

    Yields
    ------
    Panel
        Description of the plot, with the limit of the winding temperature.
    """
    for i, motor in motors.items():
        series = [(f"winding{i}", "winding", 1), (f"housing{i}", "housing", 0)]
        if f"winding{i}" not in channels:
            continue
        panel = new_panel(TEMPERATURE_SECTION, f"Motor of {JOINTS[i]}", "°C", series)
        if motor.max_winding_temperature is not None:
            high = motor.max_winding_temperature - ZERO_CELSIUS
            panel["limits"] = [
                new_limit_entry(
                    "winding temperature",
                    JOINTS[i],
                    index=1,
                    low=-np.inf,
                    high=high,
                    channel=f"winding{i}",
                )
            ]
        yield panel


def tool_panels(limits: TaskLimits) -> Iterator[Panel]:
    """Yield the descriptions of the plots (panels) that show the motion of the tool.

    They show the task coordinates roll, tilt, spin and depth, those of their rates that have a
    limit, the tool speeds, and the clearances in the eye.

    Parameters
    ----------
    limits : TaskLimits
        Limits of the task, which the plots show as lines.

    Yields
    ------
    Panel
        Description of a plot with limits in SI units.
    """
    for indices, unit, title in COORDINATE_GROUPS:
        series = [(f"task{i}", TASK_COORDINATES[i], i) for i in indices]
        panel = new_panel("Task coordinates", title, unit, series)
        ranges = _limits_by_index(limits, TaskRange, indices)
        panel["limits"] = [limit_entry(limit, i, f"task{i}") for i, limit in ranges.items()]
        yield panel
    for indices, unit, _ in COORDINATE_GROUPS:
        rates = _limits_by_index(limits, TaskRate, indices)
        if not rates:
            continue
        title = "Rate: " + ", ".join(TASK_COORDINATES[i] for i in rates)
        if indices == [3]:
            title = rates[3].name.capitalize()
        series = [(f"task_rate{i}", TASK_COORDINATES[i], i) for i in rates]
        panel = new_panel("Task coordinates", title, f"{unit}/s", series)
        panel["limits"] = [limit_entry(rate, i, f"task_rate{i}") for i, rate in rates.items()]
        yield panel
    for speed_type in plotted_speeds(limits):
        series = [(speed_type.field, "tip", 3)]
        panel = new_panel("Tool tip", speed_type.name.capitalize(), speed_type.unit, series)
        panel["limits"] = [
            limit_entry(speed, 3, speed_type.field)
            for speed in limits.speeds
            if type(speed) is speed_type
        ]
        yield panel
    if limits.eye is not None:
        yield from _eye_panels(limits.eye)


def _limits_by_index(
    limits: TaskLimits, limit_type: type[CoordinateLimit], indices: list[int]
) -> dict[int, CoordinateLimit]:
    """Return the limits of one class on selected coordinates, by the index of the coordinate.

    Parameters
    ----------
    limits : TaskLimits
        Limits of the task.
    limit_type : type
        Class of the limits, `TaskRange` or `TaskRate`.
    indices : list of int
        Indices of the coordinates in `TASK_COORDINATES`.

    Returns
    -------
    dict of Limit
        Limits by index. Coordinates without a limit are left out.
    """
    by_name = {limit.coordinate: limit for limit in limits.limits if isinstance(limit, limit_type)}
    return {i: by_name[TASK_COORDINATES[i]] for i in indices if TASK_COORDINATES[i] in by_name}


def _eye_panels(eye: Eye) -> Iterator[Panel]:
    """Yield the plot descriptions (panels) of the distances from the tool to parts of the eye.

    The first plot shows the distance of the tip to the retina. If the eye has a lens, the second
    plot shows the distance of the shaft from the centre of the lens, in semi-axes of the lens.

    Parameters
    ----------
    eye : Eye
        Geometry of the eye with the required clearances.

    Yields
    ------
    Panel
        Description of the plot with its limit.
    """
    for limit in eye.limits:
        if isinstance(limit, RetinaClearance):
            panel = new_panel("Tool tip", "Tip to retina", limit.unit, [("retina", "tip", 3)])
            panel["limits"] = [limit_entry(limit, 3, "retina")]
            panel["missing"].append(
                f"in the port ({1e3 * eye.port:g} mm): {1e3 * eye.clearance:g} mm plus distance to "
                "its edge"
            )
        else:
            unit = "semi-axes from its centre"
            panel = new_panel("Tool tip", "Shaft to lens", unit, [("lens", "shaft", 3)])
            panel["limits"] = [limit_entry(limit, 3, "lens")]
        yield panel

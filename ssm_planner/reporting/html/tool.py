"""What the page plots of the tool: task coordinates and their rates, the tip's speed, and how it stands in the eye."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.kinematics.eye import LENS, RETINA, eye_limits, lens_limit
from ssm_planner.kinematics.forward import tip_position, tip_velocity
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints, task_rates
from ssm_planner.problem.problem import TASK, Eye, TaskLimits
from ssm_planner.reporting.figures.style import unit_of
from ssm_planner.reporting.html.panels import Panel, new_limit, new_panel
from ssm_planner.trajectory import Samples
from ssm_planner.typing import Array, Range
from ssm_planner.verification.limits import INSERTION_SPEED, RATES

GROUPS = (([0, 1, 2], "rad", "Task: roll, tilt, spin"), ([3], "m", "Task: depth"))
RATE_NAMES = (*RATES, INSERTION_SPEED)


def tool_channels(mechanism: Mechanism, samples: Samples, limits: TaskLimits) -> dict[str, Array]:
    """Task coordinates, their rates, tip position and speed and, where there is an eye, what is limited about it; SI."""
    task = task_from_joints(mechanism, samples.q)
    for column in (0, 2):
        task[:, column] = np.unwrap(task[:, column])
    rates = task_rates(mechanism, samples.q, samples.qd)
    tip = tip_position(mechanism, samples.q)
    channels = {"tip_speed": np.linalg.norm(tip_velocity(mechanism, samples.q, samples.qd), axis=1)}
    channels |= {f"tip{i}": tip[:, i] for i in range(3)}
    channels |= {f"task{i}": task[:, i] for i in range(4)}
    channels |= {f"task_rate{i}": rates[:, i] for i in range(4) if TASK[i] in limits.rates}
    if limits.eye is not None:
        channels |= {name.split()[0]: value for name, (value, _) in eye_limits(NUMPY, limits.eye, tip.T).items()}
    return channels


def tool_panels(limits: TaskLimits) -> list[Panel]:
    """Panels of these channels; rates only where they are limited."""
    panels = []
    for which, unit, title in GROUPS:
        panels.append(new_panel("Task coordinates", title, unit, [(f"task{i}", TASK[i], i) for i in which]))
        panels[-1]["limits"] = _ranges(limits.ranges, which)
    for which, unit, _ in GROUPS:
        limited = [i for i in which if TASK[i] in limits.rates]
        if limited:
            named = "Insertion speed" if which == [3] else "Rate: " + ", ".join(TASK[i] for i in limited)
            series = [(f"task_rate{i}", TASK[i], i) for i in limited]
            panels.append(new_panel("Task coordinates", named, f"{unit}/s", series))
            panels[-1]["limits"] = [_rate(i, limits.rates[TASK[i]]) for i in limited]
    panels.append(new_panel("Tool tip", "Tip speed", "m/s", [("tip_speed", "tip", 3)]))
    if limits.tip_speed is not None:
        panels[-1]["limits"] = [new_limit("tip speed", "", 3, -np.inf, limits.tip_speed, "tip_speed")]
    return panels if limits.eye is None else panels + _eye_panels(limits.eye)


def limit_rows(limits: TaskLimits) -> list[tuple[str, str, str, str]]:
    """(limit, from, to, unit) of everything that limits the tool."""
    found = [(f"{name} range", *ends, "m" if name == "depth" else "rad") for name, ends in limits.ranges.items()]
    for k, name in enumerate(TASK):
        if name in limits.rates:
            found.append((RATE_NAMES[k], -np.inf, limits.rates[name], "m/s" if name == "depth" else "rad/s"))
    if limits.tip_speed is not None:
        found.append(("tip speed", -np.inf, limits.tip_speed, "m/s"))
    eye = limits.eye
    if eye is not None:
        found.append((f"{RETINA}, radius {1e3 * eye.radius:g} mm", eye.clearance, np.inf, "m"))
        if eye.lens is not None:
            found.append((f"{LENS}, shaft radius {1e3 * eye.shaft_radius:g} mm", lens_limit(eye), np.inf, ""))
    rows = []
    for name, low, high, si in found:
        unit, scale = unit_of(si)
        start, end = (f"{scale * bound:.6g}" if np.isfinite(bound) else "" for bound in (low, high))
        rows.append((name, start, end, unit))
    return rows


def _ranges(ranges: Mapping[str, Range], which: list[int]) -> list[dict[str, object]]:
    return [new_limit(f"{TASK[i]} range", TASK[i], i, *ranges[TASK[i]], f"task{i}") for i in which if TASK[i] in ranges]


def _rate(i: int, largest: float) -> dict[str, object]:
    return new_limit(RATE_NAMES[i], "", i, -largest, largest, f"task_rate{i}")


def _eye_panels(eye: Eye) -> list[Panel]:
    panels = [new_panel("Tool tip", "Tip to retina", "m", [("retina", "tip", 3)])]
    size = eye.radius - eye.clearance
    panels[0]["limits"] = [new_limit(RETINA, "", 3, eye.clearance, np.inf, "retina", size)]
    panels[0]["missing"].append(
        f"in the port ({1e3 * eye.port:g} mm): {1e3 * eye.clearance:g} mm plus the distance to its edge"
    )
    if eye.lens is not None:
        panels.append(new_panel("Tool tip", "Shaft to lens", "lens sizes", [("lens", "shaft", 3)]))
        panels[1]["limits"] = [new_limit(LENS, "", 3, lens_limit(eye), np.inf, "lens")]
    return panels

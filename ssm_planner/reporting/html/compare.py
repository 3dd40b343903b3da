"""Write a page that compares two plans, which are called A and B.

`comparison_data` also provides the curves of the local view.
"""

from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from ssm_planner.display import MISSING_VALUE, format_number, format_percent, format_signed
from ssm_planner.plans import Plan
from ssm_planner.reporting.figures.style import COLOURS
from ssm_planner.reporting.html.channels import encode_channels, sample_channels, time_grid
from ssm_planner.reporting.html.page import render_page, write_page
from ssm_planner.reporting.html.panels import Panel, build_panels, new_panel
from ssm_planner.reporting.html.report import verdict_marks
from ssm_planner.reporting.html.scene import robot_scene
from ssm_planner.reporting.text import Table
from ssm_planner.typing import Arrays, JsonObject
from ssm_planner.units import RPM
from ssm_planner.verification import Certificate

OMITTED_SECTIONS = ("Parts of the motor torque",)
"""Sections of the report that the comparison omits."""
PLAN_NAMES = ("A", "B")
"""Names of the two plans on the page."""


def write_comparison(plan_a: Plan, plan_b: Plan, path: Path) -> Path:
    """Write the page that compares two plans, and return its path.

    Parameters
    ----------
    plan_a, plan_b : Plan
        Plans with trajectories.
    path : Path
        File of the page.

    Raises
    ------
    ExportError
        If the file cannot be written.
    """
    return write_page(path, comparison_page(plan_a, plan_b), plan_a.sha256)


def comparison_page(plan_a: Plan, plan_b: Plan) -> str:
    """Render the comparison of two plans as an HTML document.

    Parameters
    ----------
    plan_a, plan_b : Plan
        Plans with trajectories.

    Returns
    -------
    str
        Text of the page.
    """
    plans = plan_a, plan_b
    return render_page(
        "compare.html",
        comparison_data(plans),
        title=f"{plan_a.problem.name} against {plan_b.problem.name} – plan comparison",
        plans=list(zip(PLAN_NAMES, plans, map(verdict_marks, plans), strict=True)),
        durations=_durations_table(plans),
        limits=_limits_table(plan_a.certificate, plan_b.certificate),
        motors=_motors_table(plans),
    )


def comparison_data(plans: Sequence[Plan]) -> JsonObject:
    """Return the data of one or two plans for the scripts of the page as JSON types.

    All plans are sampled on the same time grid. After its end, the shorter plan keeps its last
    position.

    Parameters
    ----------
    plans : sequence of Plan
        Plans with trajectories.

    Returns
    -------
    dict
        `duration` of the longest plan and `ends` of all plans in s, `colours`, `panels` (the
        descriptions of the plots, each with the curves of all plans), and for each plan its 3D
        scene in `scenes` and its sampled quantities in `channels`.
    """
    duration = max(plan.motion.duration for plan in plans)
    t = time_grid(duration)
    channels = [sample_channels(plan, t) for plan in plans]
    panels = []
    for plan, samples in zip(plans, channels, strict=True):
        # A limit cannot be active after the end of the plan.
        is_running = t <= plan.motion.duration + 1e-9
        running_samples = {name: values[is_running] for name, values in samples.items()}
        panels.append(build_panels(plan, running_samples) + list(_margin_panels(plan, samples)))
    merged = _merge_panels(panels)
    # The plots of a section follow each other, because the page opens a section for each group.
    sections = [panel["section"] for panel in merged]
    return {
        "duration": duration,
        "ends": [plan.motion.duration for plan in plans],
        "colours": list(COLOURS),
        "panels": sorted(merged, key=lambda panel: sections.index(panel["section"])),
        "scenes": [robot_scene(plan.robot, plan.limits) for plan in plans],
        "channels": [encode_channels(samples) for samples in channels],
    }


def _margin_panels(plan: Plan, samples: Arrays) -> Iterator[Panel]:
    """Yield one plot description (panel) for each motor, with the margin of its torque and speed.

    The margin is 1 − max(|τ|/τ_max, |w|/w_max), where τ is the motor torque, w is the motor speed,
    and τ_max and w_max are their limits.

    Parameters
    ----------
    plan : Plan
        Plan that is shown.
    samples : dict of (n,) arrays
        Sampled quantities of the plan by name. The function adds the margins under the names
        "margin0" for joint 0, and so on.

    Yields
    ------
    Panel
        Description of a plot in per cent.
    """
    for i, joint in enumerate(plan.robot.joints):
        if joint.motor is not None and f"tau{i}" in samples:
            torque_ratio = abs(samples[f"tau{i}"]) / joint.motor.max_torque
            speed_ratio = abs(samples[f"w{i}"]) / joint.motor.max_speed
            samples[f"margin{i}"] = 1 - np.maximum(torque_ratio, speed_ratio)
            series = [(f"margin{i}", joint.name, i)]
            panel = new_panel("Motors", f"Margin of torque and speed: {joint.name}", "%", series)
            yield panel | {"scale": 100.0}


def _durations_table(plans: tuple[Plan, Plan]) -> Table:
    """Build the table of the durations of two plans and of their lower bounds.

    Parameters
    ----------
    plans : (Plan, Plan)
        Plans A and B.

    Returns
    -------
    Table
        Rows for the duration, its lower bound, the duration of the independent program toppra, and
        the excess of the duration over its lower bound. Each row contains the values of plans A and
        B and the change from A to B.
    """
    a, b = plans
    gaps = [None if plan.gap is None else 100 * plan.gap for plan in plans]
    rows = [
        ("duration s",) + _pair_cells(a.duration, b.duration),
        ("lower bound s",) + _pair_cells(a.lower_bound, b.lower_bound),
        ("toppra s",) + _pair_cells(a.toppra_duration, b.toppra_duration),
        ("above the lower bound %",) + _pair_cells(gaps[0], gaps[1], relative=False),
    ]
    return Table("quantity, A, B, change", rows, (1, 2, 3))


def _limits_table(certificate_a: Certificate | None, certificate_b: Certificate | None) -> Table:
    """Build the table of the margins in both certificates, smallest margin first.

    A margin is the smallest distance of the motion from a limit, relative to the limit.

    Parameters
    ----------
    certificate_a, certificate_b : Certificate or None
        Certificates of plans A and B, or None for a plan without one.

    Returns
    -------
    Table
        One row for each limit of at least one plan, with the margins of plans A and B and the
        difference B − A.
    """
    margins_a = _margins(certificate_a)
    margins_b = _margins(certificate_b)
    rows = []
    for key in margins_a | margins_b:
        a = margins_a.get(key)
        b = margins_b.get(key)
        change = None if a is None or b is None else b - a
        smallest = min(margin for margin in (a, b) if margin is not None)
        margins = [format_percent(value, 2) for value in (a, b, change)]
        rows.append((smallest, [*key, *margins]))
    cells = [row for _, row in sorted(rows)]
    return Table("limit, joint, margin A, margin B, change", cells, (2, 3, 4))


def _margins(certificate: Certificate | None) -> dict[tuple[str, str], float]:
    """Return the margin of each limit by its name and joint.

    The joint of a limit on the tool is an empty text. Without a certificate, the result is empty.
    """
    if certificate is None:
        return {}
    return {(limit.name, limit.joint or ""): limit.margin for limit in certificate.limits}


def _motors_table(plans: tuple[Plan, Plan]) -> Table:
    """Build the table of the torques and speeds that two plans require of the motors.

    Parameters
    ----------
    plans : (Plan, Plan)
        Plans A and B.

    Returns
    -------
    Table
        Three rows for each joint: peak torque and RMS torque in mN·m, and peak speed in rpm. Each
        row contains the values of plans A and B and the change from A to B in per cent.
    """
    requirements_a, requirements_b = (
        {item.joint: item.to_dict() for item in plan.requirements} for plan in plans
    )
    rows = []
    for joint in sorted(requirements_a.keys() | requirements_b.keys()):
        a = requirements_a.get(joint, {})
        b = requirements_b.get(joint, {})
        motors = " / ".join(dict.fromkeys(side.get("motor") or MISSING_VALUE for side in (a, b)))
        for key, name, scale in (
            ("peak_torque", "peak torque mN·m", 1e3),
            ("rms_torque", "RMS torque mN·m", 1e3),
            ("peak_speed", "peak speed rpm", RPM),
        ):
            value_a, value_b = [scale * plan[key] if plan else None for plan in (a, b)]
            rows.append((joint, motors, name) + _pair_cells(value_a, value_b))
    return Table("joint, motor, quantity, A, B, change", rows, (3, 4, 5))


def _pair_cells(a: float | None, b: float | None, relative: bool = True) -> tuple[str, str, str]:
    """Format the values of plans A and B, and the change from A to B.

    Parameters
    ----------
    a, b : float or None
        The values. None if a plan does not have the value.
    relative : bool
        If true, the change is given in per cent of A, otherwise as the difference B − A.

    Returns
    -------
    tuple of three str
        Cells for A, B and the change. The change is empty if a value is missing.
    """
    change = MISSING_VALUE
    if a is not None and b is not None and (a or not relative):
        change = format_percent(b / a - 1, 2) if relative else format_signed(b - a, 2)
    return format_number(a, 5), format_number(b, 5), change


def _merge_panels(panels: Sequence[list[Panel]]) -> list[Panel]:
    """Merge the plots of plans A and B into one plot for each quantity, such as a joint velocity.

    A plot is described by a dictionary, which is called a panel. In a merged panel, the key "side"
    of a limit is 0 for A and 1 for B, and selects the colour. It is None for a limit that both
    plans have. The key "sides" lists the plans that have the quantity.

    Parameters
    ----------
    panels : sequence of list of Panel
        Panels of each plan, from `build_panels`.

    Returns
    -------
    list of Panel
        Panels with one quantity each, which the page draws as one curve for each plan.
    """
    merged: dict[tuple[str, str], Panel] = {}
    for side, name in enumerate(PLAN_NAMES[: len(panels)]):
        shown_panels = [panel for panel in panels[side] if panel["section"] not in OMITTED_SECTIONS]
        for panel in chain.from_iterable(map(_split_by_series, shown_panels)):
            key = panel["section"], panel["channel"]
            shared = merged.setdefault(key, {**panel, "limits": [], "active": [], "sides": []})
            shared["sides"].append(side)
            for limit in panel["limits"]:
                equal_limits = [
                    line
                    for line in shared["limits"]
                    if all(line[key] == limit[key] for key in ("name", "low", "high"))
                ]
                for line in equal_limits:
                    line["side"] = None
                if not equal_limits:
                    shared["limits"].append({**limit, "of": name, "side": side})
            for interval in panel["active"]:
                label = f"{name}: {interval['label']}"
                shared["active"].append({**interval, "joint": side, "label": label})
    return list(merged.values())


def _split_by_series(panel: Panel) -> Iterator[Panel]:
    """Yield a separate plot description (panel) for each curve of a plot.

    The comparison shows one quantity of both plans in each plot, so a plot cannot contain the
    curves of several joints.

    Parameters
    ----------
    panel : Panel
        Description of a plot with one or more curves.

    Yields
    ------
    Panel
        Description of a plot with one curve, and with the limits and active intervals that have its
        colour index.
    """
    for series in panel["series"]:
        joint = series["joint"]
        title = panel["title"]
        if len(panel["series"]) > 1:
            title = f"{title.partition(':')[0]}: {series['label']}"
        yield panel | {
            "title": title,
            "channel": series["channel"],
            "series": [series],
            "limits": [limit for limit in panel["limits"] if limit["joint"] == joint],
            "active": [interval for interval in panel["active"] if interval["joint"] == joint],
            "missing": [],
        }

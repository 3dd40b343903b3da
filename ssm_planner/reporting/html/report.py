"""report.html: one plan, or two side by side, as a self-contained page made from plan.json alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ssm_planner.atomic import replacing
from ssm_planner.formats.plan_json import PlanFile, read_plan
from ssm_planner.reporting.figures.style import COLOURS, FIFTH
from ssm_planner.reporting.html.elements import Markup, tag
from ssm_planner.reporting.html.header import header
from ssm_planner.reporting.html.motors import TEMPERATURE, motor_map, without_temperature
from ssm_planner.reporting.html.page import page
from ssm_planner.reporting.html.scene import scene_of
from ssm_planner.reporting.html.series import channels_of, encoded, panels_of, time_grid
from ssm_planner.reporting.html.tables import all_tables


def write_report(plan_json: Path, out: Path) -> Path:
    """Write the report of a plan.json. Raises TrajectoryError or ProblemError (the plan), ExportError (the page)."""
    return write_page(out, report_page(read_plan(plan_json)))


def report_page(plan: PlanFile) -> str:
    """The report of a plan as an HTML document."""
    body = Markup(header(plan) + stage() + all_tables(plan) + "</div></main>")
    return page(
        f"{plan.document['problem'].get('name')} – plan report", body, report_data(plan), ("maps.js", "report.js")
    )


def report_data(plan: PlanFile) -> dict[str, Any]:
    """What the page's scripts read: channels, panels, phases, joints and scene."""
    channels = channels_of(plan, time_grid(plan.trajectory.duration))
    motors = {i: joint.motor for i, joint in enumerate(plan.robot.joints) if joint.motor is not None and joint.drive}
    start = float(plan.trajectory.breaks[0])
    return {
        "duration": plan.trajectory.duration,
        "colours": [*COLOURS, FIFTH],
        "phases": [{"name": p.name, "start": p.start - start, "end": p.end - start} for p in plan.trajectory.phases],
        "joints": [{"name": joint.name, "kind": joint.kind} for joint in plan.robot.joints],
        "panels": panels_of(plan, channels),
        "maps": [motor_map(i, motor) for i, motor in motors.items()],
        "notes": {TEMPERATURE: without_temperature(channels, motors)},
        "scene": scene_of(plan.robot, plan.limits),
        "channels": encoded(channels),
    }


def stage() -> Markup:
    """The 3D view with its player, and the open frame for plots and tables beside it."""
    view = tag("div", tag("p", "The 3D view needs WebGL and JavaScript.", class_="fallback"), id="scene")
    left = tag("section", view, tag("div", id="player"), tag("div", id="now"), class_="stage", aria_label="Mechanism")
    return Markup(f'<main>{left}<div class="story">' + tag("div", id="active") + tag("div", id="plots"))


def write_page(out: Path, text: str) -> Path:
    """Write a page whole or not at all. Raises ExportError."""
    with replacing(out) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return out

"""The result folder of one plan."""

from __future__ import annotations

from pathlib import Path

from ssm_planner.formats.csv import write_csv
from ssm_planner.formats.plan_json import write_plan
from ssm_planner.plans import Plan
from ssm_planner.reporting.figures.process import FigureProcess, write_figures
from ssm_planner.reporting.html.report import write_report


def write_folder(plan: Plan, folder: Path, drawer: FigureProcess | None = None) -> dict[str, Path]:
    """Write plan.json, report.html, trajectory.csv and the figures; returns their paths by name. Raises ExportError.

    drawer: has begun to draw the motion, and draws the rest while the files are written; None: all is drawn here.
    """
    if plan.trajectory is None:
        return {}
    if drawer is not None:
        drawer.draw("motors", plan.trajectory, plan.problem.robot, plan.requirements)
    plan_file = write_plan(folder / "plan.json", plan)
    return {
        "plan": plan_file,
        "report": write_report(plan_file, folder / "report.html"),
        "trajectory": write_csv(folder / "trajectory.csv", plan.trajectory, plan.problem.robot),
        **write_figures(plan, folder, drawer),
    }

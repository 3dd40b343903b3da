"""The result folder of one plan."""

from __future__ import annotations

from pathlib import Path

from ssm_planner.exports.csv import write_csv
from ssm_planner.exports.plan_file import write_plan
from ssm_planner.outcome import Plan
from ssm_planner.report.figure_process import FigureProcess
from ssm_planner.report.html import write_report
from ssm_planner.report.plan_figures import write_figures


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

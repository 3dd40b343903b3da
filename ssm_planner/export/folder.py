"""The result folder of one plan."""

from __future__ import annotations

from pathlib import Path

from ssm_planner.export.csv import write_csv
from ssm_planner.export.plan_file import write_plan
from ssm_planner.plan import Plan
from ssm_planner.report.plan_figures import write_figures


def write_folder(plan: Plan, folder: Path) -> dict[str, Path]:
    """Write plan.json, trajectory.csv and the figures; returns their paths by name. Raises ExportError."""
    if plan.trajectory is None:
        return {}
    return {
        "plan": write_plan(folder / "plan.json", plan),
        "trajectory": write_csv(folder / "trajectory.csv", plan.trajectory, plan.problem.robot),
        **write_figures(plan, folder),
    }

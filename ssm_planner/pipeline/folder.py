"""The result folder of one plan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ssm_planner.plans import FILE, Plan, load_plan, use_folder_writer

if TYPE_CHECKING:
    from ssm_planner.reporting.figures.process import FigureProcess

__all__ = ["Plan", "load_plan", "write_folder"]
"""Who takes `Plan` and `load_plan` from here can `save` plans."""


@use_folder_writer
def write_folder(
    plan: Plan, folder: Path, drawer: FigureProcess | None = None, rate: float | None = None
) -> dict[str, Path]:
    """Write plan.json, report.html, trajectory.csv, the figures and their manifest; their paths by name. Raises ExportError.

    drawer: has begun to draw the motion, and draws the rest while the files are written; None: all is drawn here. rate:
    of trajectory.csv, Hz; None: as `write_csv` chooses.
    """
    from ssm_planner.formats.csv import write_csv
    from ssm_planner.publishing import publishing_results
    from ssm_planner.reporting.figures.process import write_figures
    from ssm_planner.reporting.html.report import write_report

    if plan.trajectory is None:
        return {}
    if drawer is not None and plan.requirements:
        drawer.draw("motors", plan.trajectory, plan.robot, plan.requirements)
    with publishing_results(folder, plan.sha256) as temporary:
        paths = {
            "plan": plan.write(temporary / FILE),
            "report": write_report(plan, temporary / "report.html"),
            "trajectory": write_csv(
                temporary / "trajectory.csv", plan.trajectory, plan.robot, rate
            ),
            **write_figures(plan, temporary, drawer),
        }
    return {name: folder / path.name for name, path in paths.items()}

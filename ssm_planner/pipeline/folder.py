"""The result folder of a plan.

The command `ssm-planner plan`, studies and `Plan.save` call `write_folder`.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from ssm_planner.plans import Plan

if TYPE_CHECKING:
    from ssm_planner.reporting.figures.process import FigureProcess

NO_PLAN = "no_plan.html"
"""Name of the page that the folder contains if planning fails.

`write_folder` deletes it when there is a plan.
"""


def write_folder(
    plan: Plan, folder: Path, drawer: "FigureProcess | None" = None, rate: float | None = None
) -> dict[str, Path]:
    """Write the result folder of a plan.

    The folder contains plan.json, report.html, trajectory.csv, the figures and their manifest. All
    files appear in the folder together, when the last one is complete. Nothing is written for a
    plan without a trajectory.

    Parameters
    ----------
    plan : Plan
        The plan.
    folder : Path
        The folder. It is created if it does not exist.
    drawer : FigureProcess, optional
        Another process, which already draws the figures. By default, this process draws them.
    rate : float, optional
        Rows of trajectory.csv per second, Hz. By default, `write_csv` chooses the rate.

    Returns
    -------
    dict
        Paths of the files by their names, for example "plan" and "report". Empty if nothing is
        written.

    Raises
    ------
    ExportError
        If a file cannot be written.
    """
    from ssm_planner.formats.csv import write_csv
    from ssm_planner.publishing import PLAN_FILE, publishing_results
    from ssm_planner.reporting.figures.process import write_figures
    from ssm_planner.reporting.html.report import write_report

    if plan.trajectory is None:
        return {}
    with publishing_results(folder) as temporary:
        paths = {
            "plan": plan.write(temporary / PLAN_FILE),
            "report": write_report(plan, temporary / "report.html"),
            "trajectory": write_csv(
                temporary / "trajectory.csv", plan.trajectory, plan.robot, rate
            ),
            **write_figures(plan, temporary, drawer),
        }
    # An earlier attempt may have left the page of a failure.
    (folder / NO_PLAN).unlink(missing_ok=True)
    return {name: folder / path.name for name, path in paths.items()}

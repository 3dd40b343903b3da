"""Run `ssm-planner ik ROBOT --tilt …` and `ssm-planner workspace ROBOT` or `--reach A B`."""

import math
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

import ssm_planner as ssm
from ssm_planner.cli.shared import (
    FAILED,
    OK,
    fill_in_template,
    print_result,
    print_result_with_page,
)
from ssm_planner.display import format_fixed
from ssm_planner.errors import ProblemError
from ssm_planner.typing import JsonObject


def run_ik(options: Namespace) -> int:
    """Print the joint solutions of a tool pose, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status: 0 if the pose can be reached, and 1 otherwise.
    """
    from ssm_planner.problem import TASK_COORDINATES

    robot = ssm.load_robot(options.robot)
    point = {name: getattr(options, name) for name in TASK_COORDINATES}
    solutions = ssm.ik(robot, **point, within_limits=options.within_limits)
    print_result(options, solutions.to_dict(), _solution_lines(solutions))
    return OK if solutions.reachable else FAILED


def _solution_lines(solutions: ssm.JointSolutions) -> Iterator[str]:
    """Yield a table of joint solutions in deg and mm as lines of text.

    Parameters
    ----------
    solutions : JointSolutions
        Solutions of the inverse kinematics of one pose, in rad and m.

    Yields
    ------
    str
        Line of text.
    """
    yield "joint 1 deg   joint 2 deg   joint 3 deg   joint 4 mm   within joint ranges"
    for q, is_inside in zip(solutions.joints, solutions.in_limits, strict=True):
        angles = "   ".join(f"{format_fixed(math.degrees(value), 5):>11}" for value in q[:3])
        yield f"{angles}   {format_fixed(1e3 * q[3], 4):>10}   {'yes' if is_inside else 'no'}"
    if not solutions.reachable:
        angle = math.degrees(solutions.orientation_error)
        distance = 1e3 * solutions.tip_error
        yield f"not reachable: the nearest is off by {angle:.6g} deg and {distance:.6g} mm"


def run_workspace(options: Namespace) -> int:
    """Print the workspace of a robot, or the designs that reach a tilt range.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status: 0, or 1 if no design reaches the tilt range.

    Raises
    ------
    ProblemError
        If both the robot and the range are missing.
    """
    if options.robot is None and options.reach is None:
        raise ProblemError("workspace needs a robot file, or a tilt range: --reach -140deg -80deg")
    robot = None if options.robot is None else ssm.load_robot(options.robot)
    if robot is not None and options.reach is None:
        result = _workspace_result(robot, options.output)
    else:
        low, high = sorted(options.reach)
        result = _design_region_result((low, high), options.margin or 0.0, robot, options.output)
    name = "workspace" if "tilt_range" in result else "design_region"
    files = result.get("files", {}).values()
    lines = [f"figure: {path}" for path in files] + fill_in_template("workspace.txt", **result)
    print_result_with_page(options, name, result, lines, files)
    return OK if result.get("reachable", True) else FAILED


def _workspace_result(robot: ssm.Robot, output: Path | None) -> JsonObject:
    """Return the workspace of a robot as JSON types.

    Parameters
    ----------
    robot : Robot
        Robot whose workspace is computed.
    output : Path or None
        Folder of the figures. None draws no figures.

    Returns
    -------
    dict
        Content of --json. If figures are drawn, `files` contains their paths.
    """
    result = ssm.workspace(robot).to_dict()
    if output is not None:
        from ssm_planner.kinematics import Mechanism
        from ssm_planner.reporting import publish_figures, workspace_figures

        result["files"] = publish_figures(workspace_figures(Mechanism.from_robot(robot)), output)
    return result


def _design_region_result(
    reach: ssm.Range, margin: float, robot: ssm.Robot | None, output: Path | None
) -> JsonObject:
    """Return the designs that reach a tilt range, as JSON types.

    A design consists of the angles α and β between neighbouring joint axes.

    Parameters
    ----------
    reach : (float, float)
        Lowest and highest tilt, rad.
    margin : float
        Additional tilt at both ends, rad.
    robot : Robot or None
        Robot whose margin is added to the result.
    output : Path or None
        Folder of the figure.

    Returns
    -------
    dict
        `alpha` and `beta` of the design with the smallest α (rad, None if no design reaches the
        range), the vertices `region` of all designs, `margin`, `reachable`, and optionally `robot`
        and `files`.
    """
    from ssm_planner.kinematics import design_margin, design_region

    region = design_region(*reach, margin)
    alpha, beta = region.smallest_alpha
    result: JsonObject = {
        "alpha": None if region.empty else alpha,
        "beta": None if region.empty else beta,
        "region": region.vertices.tolist(),
        "margin": margin,
        "reachable": not region.empty,
    }
    built = None
    if robot is not None:
        design = ssm.workspace(robot)
        built = alpha, beta = design.alpha, design.beta
        margin = design_margin(*built, reach)
        result["robot"] = {"alpha": alpha, "beta": beta, "margin": margin}
    if output is not None:
        from ssm_planner.reporting import design_region_figure, publish_figures

        drawing = design_region_figure(region, built)
        result["files"] = publish_figures({"design_region": drawing}, output)
    return result

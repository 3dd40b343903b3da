"""Run `ssm-planner retime FILE --robot ROBOT`.

The command computes the fastest timing of the path in a trajectory file within the robot's limits.
"""

from argparse import Namespace
from pathlib import Path

from ssm_planner.cli.shared import FAILED, OK, print_result, progress_reporter
from ssm_planner.progress import Step


def run_retime(options: Namespace) -> int:
    """Compute the fastest timing of a path, write the result folder, and return the exit status.

    The path is first smoothed into one or several curves, and the output states how far these
    deviate from the lines between the points of the file.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status: 0 if a motion was found and passed the check, and 1 otherwise.
    """
    progress = progress_reporter(f"reading {options.path}")
    import numpy as np

    from ssm_planner.formats import read_trajectory
    from ssm_planner.pipeline.retime import retiming_problem, robot_with_limits
    from ssm_planner.pipeline.run import plan_to_folder
    from ssm_planner.publishing import file_name
    from ssm_planner.reporting import summary_lines

    robot, base = robot_with_limits(options.robot, options.problem)
    reading = read_trajectory(options.path, robot)
    problem, deviation = retiming_problem(reading, robot, base, f"{options.path.stem}_retimed")
    folder = options.output or Path("results") / file_name(problem.name)
    result, files = plan_to_folder(problem, folder, progress, rate=options.rate)
    progress(Step("done"))
    recorded_duration = reading.trajectory.duration
    runs = "one smooth curve"
    if len(problem.motion) > 1:
        runs = f"{len(problem.motion)} smooth runs, at rest between them"
    distance = (
        f"{np.degrees(deviation[:3].max()):.3g} deg and {1e3 * deviation[3]:.3g} mm "
        "from the lines between its points"
    )
    lines = [
        f"the path       {runs}, at most {distance}",
        f"in the file    {recorded_duration:.4f} s, {reading.interpolation}",
        "",
    ]
    document = {
        **result.summary(),
        "files": files,
        "runs": len(problem.motion),
        "off_lines": deviation.tolist(),
        "duration_in_file": recorded_duration,
    }
    lines += summary_lines(result, verbose=True)
    lines.append(f"file     {files['report' if result.passed else 'page']}")
    print_result(options, document, lines)
    return OK if result.passed else FAILED

"""Run `ssm-planner compare PLAN RECORDING...`, which compares an executed motion with its plan."""

from argparse import Namespace

import ssm_planner as ssm
from ssm_planner.cli.shared import (
    FAILED,
    OK,
    UNJUDGED,
    fill_in_template,
    print_result,
    progress_reporter,
)
from ssm_planner.progress import Step

STATUS_OF_VERDICT = {"held": OK, "cannot tell": UNJUDGED, "not held": FAILED}
"""Exit status of each verdict of a comparison."""


def run_compare(options: Namespace) -> int:
    """Compare recordings with a plan, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status: 0 if the motion was executed as planned, 1 if not, and 4 if the recordings
        cannot tell.
    """
    progress = progress_reporter(f"reading {options.plan}")
    from ssm_planner.comparison.compare import DEFAULT_LAG
    from ssm_planner.comparison.measured import assign_recordings

    plan = ssm.load_plan(options.plan)
    progress(Step("comparing"))
    comparison = ssm.compare(
        plan,
        dict(assign_recordings(options.recordings, plan.robot)),
        options.counts_per_turn,
        lag=DEFAULT_LAG if options.lag is None else options.lag,
        speed=options.speed,
    )
    progress(Step("done"))
    document = {"plan": options.plan, **comparison.to_dict()}
    print_result(options, document, compare_lines(comparison))
    return STATUS_OF_VERDICT[comparison.verdict]


def compare_lines(comparison: ssm.Comparison) -> list[str]:
    """Format a comparison of an executed motion with its plan as lines of text.

    Parameters
    ----------
    comparison : Comparison
        Result of the comparison.

    Returns
    -------
    list of str
        Lines on the clock of the recordings, the smallest visible faults, the errors of every axis,
        the margins of the limits, the findings, the limits that are not judged, and the verdict.
    """
    from ssm_planner.comparison.noise import SIGNIFICANT_DEVIATIONS
    from ssm_planner.display import format_fixed, format_number, format_percent
    from ssm_planner.reporting import Table, unit_of_limit

    errors = []
    rows = []
    for axis in comparison:
        cells: list[float | None] = [axis.alignment.delay, axis.alignment.correlation]
        for name in ("position", "speed", "torque"):
            cells.append(axis.differences[name].nrmsd if axis.differences else None)
        errors.append([axis.joint, axis.recording] + [format_fixed(cell, 4) for cell in cells])
        for limit in axis.limits:
            unit, scale = unit_of_limit(limit)
            row = (
                limit.name,
                axis.joint,
                format_number(scale * limit.measured, 5),
                format_number(scale * limit.noise, 2),
                format_number(scale * limit.limit, 5),
                unit,
                format_percent(limit.planned_margin, 2),
                format_percent(limit.margin, 2),
                "EXCEEDED" if limit.verdict == "not held" else limit.verdict,
            )
            rows.append(row)
    header = "axis, recording, begins at s, correlation, NRMSD position, speed, torque"
    limits_header = "limit, joint, measured, noise, limit, unit, margin planned, measured, "
    return fill_in_template(
        "compared.txt",
        comparison=comparison,
        certain=SIGNIFICANT_DEVIATIONS,
        tables=[Table(header, errors, range(2, 7)), Table(limits_header, rows, (2, 3, 4, 6, 7))],
    )

"""Format plans and sizing results as text and tables for the terminal and for pages.

Functions whose names end in `_lines` return lines for the terminal. Functions whose names end in
`_table` return a `Table`, which the terminal and the pages show. This module does not load the
planner, so that `check` starts quickly.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import accumulate, chain, zip_longest
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from ssm_planner.display import (
    MISSING_VALUE,
    format_fixed,
    format_number,
    format_percent,
    format_signed,
    plain_words,
    terminal_width,
)
from ssm_planner.problem import (
    JOINTS,
    JUMP_NAMES,
    MESSAGE_UNITS,
    ContinuousTorque,
    Free,
    LensClearance,
    MotorTorque,
    RetinaClearance,
    SelfLocking,
)
from ssm_planner.sizing import (
    TORQUE_COMPONENTS,
    JointSizing,
    MotorRequirement,
    MotorVerdict,
    Sizing,
    WhatIf,
)
from ssm_planner.typing import JsonObject, frozen
from ssm_planner.units import RPM, display_unit
from ssm_planner.verification import LimitCheck

if TYPE_CHECKING:  # `check` prints tables without loading the planner.
    from ssm_planner.comparison.findings import Kept
    from ssm_planner.plans import PhaseSummary, Plan
    from ssm_planner.simulation.simulate import SimulationResult
    from ssm_planner.verification.proof import Proof

SizingObject = Mapping[str, Any]
"""JSON object of a sizing, which `size --json` prints and plan.json contains."""
VERDICT_LABELS = {True: "yes", False: "NO", None: "not known"}
"""Word for each value of an `adequate` entry. None means that data are missing."""
MOTOR_MARGINS = ("torque", "speed", "continuous_torque", "voltage", "heat")
"""Checks of a motor whose margins appear in tables."""
ZERO_CELSIUS = 273.15
"""0 °C in K."""
LOWER_BOUND_LIMITS = (SelfLocking.name, RetinaClearance.name, LensClearance.name)
"""Limits below which a quantity must not fall. All other limits are upper bounds or ranges."""
ACTIVE_MARGIN = 0.005
"""Largest margin with which a limit counts as active, that is, as reached by the fastest motion.

The plots of the report use it as well, relative to a limit or to half the width of a range.
"""
CHECK_BY_RATING = {
    "max_torque": "torque",
    "max_speed": "speed",
    "nominal_torque": "continuous_torque",
}
"""Name of the check that a rating of a motor limits, by the key of the rating in the motor file."""
MAX_SENSITIVITIES = 3
"""Number of sensitivities in the summary of a plan. The largest ones are shown."""
CONFIRMATION_TOLERANCE = 1e-6
"""Largest relative difference of durations with which Ipopt confirms a motion."""


@frozen
class Table:
    """A table of text.

    Attributes
    ----------
    header : sequence of str
        Headings of the columns. A single text contains all headings with ", " in between.
    rows : sequence of sequences of str
        Rows with one cell for each column.
    numeric_columns : sequence of int
        Indices of the columns with numbers, which are aligned on the right.
    caption : str
        Title above the table. It may be empty.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric_columns: Sequence[int] = ()
    caption: str = ""

    def __post_init__(self) -> None:
        if isinstance(self.header, str):
            object.__setattr__(self, "header", tuple(self.header.split(", ")))

    def __str__(self) -> str:
        """Return the caption and the table as text for the terminal."""
        return "\n".join([self.caption] * bool(self.caption) + self.lines())

    def lines(self, width: int | None = None) -> list[str]:
        """Return the table as lines of text, with a rule below the header.

        Wide cells are wrapped. Columns that still do not fit follow in a second table, which
        repeats the columns before the first number.

        Parameters
        ----------
        width : int, optional
            Largest number of characters in a line. The default is the width of the terminal.

        Returns
        -------
        list of str
            Lines without spaces at their ends.
        """
        limit = terminal_width() if width is None else width
        widths = self._widths(limit)
        indices = list(range(len(widths)))
        # Two spaces separate the columns.
        ends = accumulate(widths, lambda end, width: end + 2 + width)
        fit = sum(end <= limit for end in ends)
        label_count = min(self.numeric_columns, default=1)
        if label_count < fit < len(widths):
            upper = self._select(indices[:fit])
            lower = self._select(indices[:label_count] + indices[fit:])
            return upper.lines(limit) + [""] + lower.lines(limit)
        rule = ["-" * width for width in widths]
        lines = []
        for row in [self.header, rule] + list(self.rows):
            for cells in _wrap_row(row, widths):
                aligned = (
                    cell.rjust(width) if i in self.numeric_columns else cell.ljust(width)
                    for i, cell, width in zip(indices, cells, widths, strict=True)
                )
                lines.append("  ".join(aligned).rstrip())
        return lines

    def _select(self, indices: Sequence[int]) -> "Table":
        """Return a table that contains only the columns with the given indices."""
        rows = [[row[i] for i in indices] for row in self.rows]
        numeric_columns = [k for k, i in enumerate(indices) if i in self.numeric_columns]
        return Table([self.header[i] for i in indices], rows, numeric_columns)

    def _widths(self, limit: int) -> list[int]:
        """Return the width of each column, so that a line has at most `limit` characters.

        Columns become narrower in steps of one character until they fit. The widest column of
        numbers shrinks first, and columns of text follow. No column becomes narrower than its
        longest word, so a line may remain too long.

        Parameters
        ----------
        limit : int
            Largest number of characters in a line.

        Returns
        -------
        list of int
            Width of each column, characters.
        """
        widths = []
        smallest = []
        for i, heading in enumerate(self.header):
            cells = [row[i] for row in self.rows]
            unbroken = " ".join([heading] + cells).split()
            # Numbers stay on one line, but their headings may be wrapped.
            if i in self.numeric_columns:
                unbroken += cells
            widths.append(max(map(len, [heading] + cells)))
            smallest.append(max(map(len, unbroken), default=0))
        while sum(widths) + 2 * (len(widths) - 1) > limit:
            shrinkable = [i for i, width in enumerate(widths) if width > smallest[i]]
            if not shrinkable:
                break
            selected = max(shrinkable, key=lambda i: (i in self.numeric_columns, widths[i]))
            widths[selected] -= 1
        return widths


def _wrap_row(row: Sequence[str], widths: Sequence[int]) -> Iterator[Sequence[str]]:
    """Wrap each cell of a row to the width of its column, and yield the row line by line.

    Cells with fewer lines than others are filled with empty text.
    """
    cells = [
        wrap(cell, max(width, 1), break_on_hyphens=False) or [""]
        for cell, width in zip(row, widths, strict=True)
    ]
    return zip_longest(*cells, fillvalue="")


def unit_of_limit(limit: "LimitCheck | Kept", degree: str = "deg") -> tuple[str, float]:
    """Return the display unit of a limit.

    Parameters
    ----------
    limit : LimitCheck or Kept
        Result of a limit in a certificate or in a comparison, in SI units.
    degree : str
        Symbol of degrees, "deg" for the terminal and "°" for pages.

    Returns
    -------
    unit : str
        The unit. Motor speeds have the unit rpm.
    factor : float
        Factor that converts SI values to this unit.
    """
    return display_unit(MESSAGE_UNITS.get(limit.name, limit.unit), degree)


def limit_cells(
    limit: LimitCheck, degree: str = "deg", digits: int = 6
) -> tuple[str, str, str, str, str, str]:
    """Format a limit as cells of a table.

    Parameters
    ----------
    limit : LimitCheck
        Result of the limit in a certificate.
    degree : str
        Symbol of degrees, "deg" for the terminal and "°" for pages.
    digits : int
        Number of significant digits of the worst value and of the bound.

    Returns
    -------
    tuple of six str
        Name, joint, worst value, bound, unit and margin. The bound begins with "≤" or "≥". The
        margin is the distance of the worst value from the bound in per cent of the bound.
    """
    unit, scale = unit_of_limit(limit, degree)
    excess = limit.worst - limit.limit
    is_distinct = abs(excess) > 1e-5 * abs(limit.limit) + 1e-9
    # A permitted value above the limit, or a forbidden value below it, shows that the limit is a
    # lower bound.
    is_floor = limit.name in LOWER_BOUND_LIMITS or (is_distinct and (excess > 0) == limit.passed)
    worst_text = format_number(scale * limit.worst, digits)
    bound = f"{'≥' if is_floor else '≤'} {format_number(scale * limit.limit, digits)}"
    return limit.name, limit.joint or "", worst_text, bound, unit, format_percent(limit.margin, 4)


def _format_in_milli(value: float) -> str:
    """Format 1000 times a value, such as a torque in mN·m, with four significant digits."""
    return format_number(1e3 * value, 4)


def limits_table(limits: Iterable[LimitCheck]) -> Table:
    """Build the table of all limits, smallest margin first.

    Parameters
    ----------
    limits : iterable of LimitCheck
        Results of all limits in a certificate. A limit on jumps only verifies the continuity of the
        motion, so it appears in the table only if it is exceeded.

    Returns
    -------
    Table
        One row for each limit: the cells of `limit_cells`, and the instant of the worst value in s.
        "EXCEEDED" follows the name of a violated limit.
    """
    rows = []
    for limit in sorted(limits, key=lambda limit: limit.margin):
        if limit.name not in JUMP_NAMES or not limit.passed:
            name, *cells = limit_cells(limit)
            verdict = "" if limit.passed else " EXCEEDED"
            rows.append((name + verdict, *cells, format_fixed(limit.time, 4)))
    return Table("limit, joint, worst, limit, unit, margin, at s", rows, (2, 3, 5, 6))


def phases_table(plan: "Plan") -> Table:
    """Build the table of the durations and the duration bounds of all phases.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Returns
    -------
    Table
        One row for each phase, and one for the total. The columns contain the duration, the
        duration that the independent program toppra obtains, the lower bound for motions along the
        same path, and the lower bound for all paths, in s.
    """
    entries: list[tuple[str, PhaseSummary | Plan]] = [(phase.name, phase) for phase in plan.phases]
    entries.append(("total", plan))
    rows = []
    for name, entry in entries:
        times = (entry.duration, entry.toppra_duration, entry.path_bound, entry.lower_bound)
        rows.append([name] + [format_fixed(value, 4) for value in times])
    return Table("phase, duration s, toppra s, path bound s, lower bound s", rows, (1, 2, 3, 4))


def sensitivities_table(plan: "Plan") -> Table:
    """Build the table of the time that a motion saves if a limit is raised by one per cent.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Returns
    -------
    Table
        One row for each limit that affects the duration, with the saved time in ms and in per cent
        of the duration.
    """
    rows = []
    for item in plan.sensitivities or ():
        saved = -item.seconds_per_percent
        shares = format_fixed(1e3 * saved, 2), format_fixed(100 * saved / plan.motion.duration, 3)
        rows.append((item.limit, item.joint or MISSING_VALUE, *shares))
    return Table("limit, joint, saved ms for +1 %, share %", rows, (2, 3))


def tip_error_table(plan: "Plan") -> Table:
    """Build the table of the stated joint errors and of the tip errors that they cause.

    Parameters
    ----------
    plan : Plan
        Plan that is reported. A robot file may state errors of its joints, such as backlash.

    Returns
    -------
    Table
        One row for each source of error, with the error of the joint in its display unit and the
        resulting error of the tip in mm.
    """
    rows = []
    for source in plan.tip_error.sources if plan.tip_error else ():
        joint = next(joint for joint in plan.robot.joints if joint.name == source.joint)
        unit, scale = display_unit(joint.unit)
        error = f"{format_number(scale * source.error, 3)} {unit}"
        rows.append((source.joint, source.name, error, format_number(1e3 * source.tip, 3)))
    return Table("joint, error, at the joint, at the tip mm", rows, (2, 3))


def candidates_table(plan: "Plan") -> Table:
    """Build the table of the candidate motions of every phase.

    The planner tries several kinds of motion for each phase. These are called candidates.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Returns
    -------
    Table
        One row for each candidate, with the lower bound, the estimate and the result of its
        duration in s, and the outcome of the search.
    """
    names = [phase.name for phase in plan.phases]
    rows = []
    for name, candidates in zip_longest(names, plan.candidates, fillvalue=()):
        for candidate in candidates:
            times = [format_fixed(candidate[key], 4) for key in ("bound", "estimate", "duration")]
            row = [name or MISSING_VALUE, candidate["kind"], *times, candidate["outcome"]]
            rows.append(row)
    return Table("phase, candidate, bound s, estimate s, duration s, outcome", rows, (2, 3, 4))


def explanation_lines(plan: "Plan") -> list[str]:
    """Return the lines that explain which motions the planner has tried, for `plan --explain`.

    The lines list the candidate motions of every phase. For phases for which the planner has
    computed it, they also state how much time a further reversal of a joint would save.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Returns
    -------
    list of str
        Lines of text.
    """
    savings = [
        f"{phase.name}: a further reversal would save {phase.reversal_multiplier:.1e} of the "
        "duration, to first order"
        for phase in plan.phases
        if phase.reversal_multiplier is not None
    ]
    if savings:
        savings.append("")
    return candidates_table(plan).lines() + [""] + savings


def joints_table(plan: "Plan") -> Table:
    """Build the table of the joint positions at the start and at the end of the motion.

    Several sets of joint positions reach the same tool pose. The table shows which of them the plan
    uses.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Returns
    -------
    Table
        One row for each joint, with both positions in degrees or mm.
    """
    ends = plan.motion.sample(np.array([0.0, plan.motion.duration])).q
    rows = []
    for joint, (start, end) in zip(plan.problem.robot.joints, ends.T, strict=True):
        unit, scale = display_unit(joint.unit)
        rows.append(
            (joint.name, format_number(scale * start, 5), format_number(scale * end, 5), unit)
        )
    return Table("joint, from, to, unit", rows, (1, 2))


def motors_table(requirements: Iterable[MotorRequirement]) -> Table:
    """Build the table that compares the requirements on the motors with their ratings.

    Each cell contains the required value and the rating, such as "2.1 of 3.5". The last column
    counts the values that the motor file marks as assumed (placeholders).

    Parameters
    ----------
    requirements : iterable of MotorRequirement
        Torque and speed that a motion requires of the motor of each joint.

    Returns
    -------
    Table
        One row for each joint, with torques in mN·m and speeds in rpm.
    """
    rows = []
    for requirement in requirements:
        motor = requirement.motor
        name = "no motor given"
        placeholders = peak = rms = speed = MISSING_VALUE
        if motor is not None:
            name = motor.name
            placeholders = str(len(motor.placeholders) or "none")
            peak = _format_in_milli(motor.max_torque)
            rms = _format_in_milli(motor.nominal_torque)
            speed = format_fixed(RPM * motor.max_speed, 0)
        rows.append(
            (
                requirement.joint,
                name,
                f"{_format_in_milli(requirement.peak_torque)} of {peak}",
                f"{_format_in_milli(requirement.rms_torque)} of {rms}",
                f"{format_fixed(RPM * requirement.peak_speed, 0)} of {speed}",
                placeholders,
            )
        )
    header = "joint, motor, peak torque mN·m, RMS torque mN·m, peak speed rpm, placeholder figures"
    return Table(header, rows, (2, 3, 4, 5))


def summary_lines(plan: "Plan", verbose: bool = False) -> list[str]:
    """Return the summary of a plan as lines of text.

    The last lines state the duration, the result of the check, the closest limit and the verdict on
    the motors. For a plan without a motion, the lines state the reason instead.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.
    verbose : bool, optional
        If true, the summary also lists solvers, motors, joints, limits and unknown data.

    Returns
    -------
    list of str
        Lines of text.
    """
    if plan.trajectory is None:
        reason = plan.reason.message if plan.reason else plan.status
        lines = [f"{plan.problem.name}: no plan ({plan.status})", f"  reason: {reason}"]
        if plan.reason is not None and plan.reason.relaxation:
            lines.append(f"  relaxation: {plan.reason.relaxation}")
        return lines
    results = list(solver_and_condition_lines(plan) if verbose else condition_lines(plan))
    lines = [f"{plan.problem.name}, robot {plan.problem.robot.name}"]
    if results:
        lines += [""] + results
    if plan.reason is not None:
        lines += ["", plan.reason.message]
        if plan.reason.relaxation:
            lines.append(f"relaxation: {plan.reason.relaxation}")
    tables = [phases_table(plan)]
    if verbose:
        limits = () if plan.certificate is None else plan.certificate.limits
        tables += [
            sensitivities_table(plan),
            tip_error_table(plan),
            joints_table(plan),
            motors_table(plan.requirements),
            limits_table(limits),
        ]
    for table in tables:
        if table.rows:
            lines += [""] + table.lines()
    if verbose and plan.notes:
        lines += ["", "Not known"] + [f"  {note}" for note in plan.notes]
    lines.append("")
    if plan.sizing is not None:
        _, _, reason = summarise_sizing(plan.sizing.to_dict())
        if reason:
            lines += [f"Motors: {reason}", ""]
    return lines + list(answer_lines(plan))


def answer_lines(plan: "Plan") -> Iterator[str]:
    """Yield the lines that answer the main questions about a plan.

    There is one line each for the duration, the check, the closest limit and the motors. The first
    nine characters of a line are its label.

    Parameters
    ----------
    plan : Plan
        A plan with a trajectory.

    Yields
    ------
    str
        Line of text.
    """
    proven = plan.path_bound or plan.lower_bound
    # A lower bound is rounded down, so that it remains valid.
    bound = "–" if proven is None else f"{math.floor(1e4 * proven) / 1e4:.4f} s"
    meaning = f"no motion on this path is shorter than {bound}"
    if not plan.path_bound and any(motion.kind == Free.kind for motion in plan.problem.motion):
        meaning = f"lower bound {bound}, loose for free motions"
    yield f"time     {format_fixed(plan.duration, 4)} s; {meaning}"
    certificate = plan.certificate
    if plan.uncertified_reason is not None or certificate is None:
        reason = plan.uncertified_reason or "the plan has no certificate"
        yield f"check    NOT CERTIFIED: {reason}"
    else:
        limits = certificate.limits
        violations = certificate.violations
        binding = sum(limit.margin <= ACTIVE_MARGIN for limit in limits)
        kept_text = f"{len(limits)} limits kept{proof_text(plan)}"
        verdict = f"PASSED: {kept_text}; {binding} bind by design"
        if violations:
            verdict = f"FAILED: {len(violations)} of {len(limits)} limits exceeded"
        yield f"check    {verdict}"
        closest = closest_limit_text(limits)
        if closest:
            yield f"closest  {closest}"
    if plan.sizing is not None:
        outcome = summarise_sizing(plan.sizing.to_dict())[1]
        yield f"motors   {outcome.removeprefix('Motors ')}"


def closest_inactive_limit(limits: Iterable[LimitCheck]) -> LimitCheck | None:
    """Return the limit with the smallest margin among those that are not active.

    The fastest motion always reaches some limits, which are called active. They are left out, as
    are limits on jumps, because they do not show how close the motion comes to the other limits.

    Parameters
    ----------
    limits : iterable of LimitCheck
        Results of all limits in a certificate.

    Returns
    -------
    LimitCheck or None
        Result of the closest limit, or None if all limits are active.
    """
    slack = (
        limit for limit in limits if limit.margin > ACTIVE_MARGIN and limit.name not in JUMP_NAMES
    )
    return min(slack, key=lambda limit: limit.margin, default=None)


def closest_limit_text(limits: Iterable[LimitCheck], degree: str = "deg") -> str:
    """Describe the limit that `closest_inactive_limit` returns.

    Parameters
    ----------
    limits : iterable of LimitCheck
        Results of all limits in a certificate.
    degree : str
        Symbol of degrees, "deg" for the terminal and "°" for pages.

    Returns
    -------
    str
        Text such as "retina clearance: 1.645 mm (≥ 1), 0.645 mm to spare". It is "" if all limits
        are active.
    """
    limit = closest_inactive_limit(limits)
    if limit is None:
        return ""
    name, joint, worst_text, allowed, unit, _ = limit_cells(limit, degree, 4)
    owner = f" of {joint}" if joint else ""
    distance = abs(limit.worst - limit.limit) * unit_of_limit(limit)[1]
    value = f"{worst_text} {unit}".rstrip()
    spare = f"{format_number(distance)} {unit}".rstrip()
    return f"{name}{owner}: {value} ({allowed}), {spare} to spare"


def rates_text(rates: Mapping[str, float]) -> str:
    """Format rates of task coordinates, for example as “tilt -10 deg/s”.

    Parameters
    ----------
    rates : mapping of str to float
        Rates of roll, tilt and spin in rad/s, and of the depth in m/s. Rates of 0 are left out.

    Returns
    -------
    str
        Rates in display units, separated by commas.
    """
    texts = []
    for name, rate in rates.items():
        unit, scale = display_unit("m" if name == "depth" else "rad")
        if rate:
            texts.append(f"{name} {format_number(scale * rate, 4)} {unit}/s")
    return ", ".join(texts)


def solver_text(plan: "Plan") -> str:
    """Name the solver that computed a plan.

    The planner solves each phase of a motion by its own solver, which exploits the structure of the
    problem. If this structured solver fails, the planner uses the general solver Ipopt.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Returns
    -------
    str
        "structured", "Ipopt", or "structured; Ipopt in" with the names of the phases that Ipopt
        solved.
    """
    by_ipopt = [phase.name for phase in plan.phases if phase.solver == "Ipopt"]
    if not by_ipopt:
        return "structured"
    if len(by_ipopt) == len(plan.phases):
        return "Ipopt"
    return f"structured; Ipopt in {', '.join(by_ipopt)}"


def confirmation_texts(plan: "Plan") -> tuple[str, str]:
    """Describe how the motions of Ipopt compare with those of the structured solver.

    The planner's own structured solver computes a motion. Ipopt, a general solver, then starts from
    this motion and either confirms it or finds a shorter one.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Returns
    -------
    verb, agreement : str
        The verb "confirms" or "shortens", and a text about the durations. It does not contain
        numbers of iterations or exact differences, because these depend on rounding. Both are ""
        if only one of the solvers was used.
    """
    if plan.confirmation is None:
        return "", ""
    difference = abs(plan.confirmation[1])
    verb, agreement = "confirms", f"durations agree within {CONFIRMATION_TOLERANCE:.0e}"
    if difference > CONFIRMATION_TOLERANCE:
        verb = "shortens"
        agreement = f"durations differ by up to {difference:.0e}: the shorter motion is used"
    alone = [
        phase.name
        for phase in plan.phases
        if phase.solver == "Ipopt" and phase.confirmation_iterations is None
    ]
    if alone:
        agreement += f"; only Ipopt solved {', '.join(alone)}"
    return verb, agreement


def range_lines(plan: "Plan") -> Iterator[str]:
    """Yield lines on the effect of uncertain friction and payload on a plan.

    A problem may contain a range of the friction and a range of the payload for which the motion
    must keep the motor torque limits. The first line states these ranges, and by how many per cent
    the motion takes longer than without them. A further line for each motor states the combination
    of friction and payload with the smallest torque margin. Without such ranges, the function
    yields nothing.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Yields
    ------
    str
        Line of text.
    """
    friction = plan.problem.friction
    payload = plan.problem.payload
    if friction is None and payload is None:
        return
    ranges = []
    if friction:
        ranges.append(f"friction within {100 * friction:g} %")
    if payload:
        ranges.append(f"payload up to {1e3 * payload[1]:g} g")
    cost = ""
    if plan.duration is not None and plan.nominal_duration:
        increase = 100 * (plan.duration / plan.nominal_duration - 1)
        cost = f": {increase:+.2f} % compared with {plan.nominal_duration:.4f} s without the range"
    yield f"range        {', '.join(ranges)}{cost}"
    for limit in () if plan.certificate is None else plan.certificate.limits:
        if limit.name == MotorTorque.name and limit.case:
            margin = f"margin {100 * limit.margin:+.2f} %"
            yield f"             joint {limit.joint}: worst, {margin}, at {limit.case}"


def path_lines(plan: "Plan") -> list[str]:
    """Describe the rounded corners and the constant tip speeds of all phases.

    A problem can request both for the path of the tip. The lines state by how much the tip deviates
    from the straight lines at a corner, and in which interval the tip speed is constant.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Returns
    -------
    list of str
        One line for each phase with a rounded corner, then one for each phase with a constant tip
        speed.
    """
    corners = [
        f"corners      {phase.name}: the tip deviates from its lines by up to "
        f"{1e3 * phase.corner_departure:.4g} mm, within "
        f"{1e3 * (phase.corner_reach or 0.0):.4g} mm of a corner"
        for phase in plan.phases
        if phase.corner_departure is not None
    ]
    constant = [
        f"tip speed    {phase.name}: {1e3 * phase.constant_speed:.4g} mm/s from "
        f"{phase.constant_from:.4f} s to "
        f"{phase.constant_to:.4f} s of its {phase.duration:.4f} s, within "
        f"{phase.constant_error:.0e}"
        for phase in plan.phases
        if phase.constant_speed is not None
    ]
    return corners + constant


def proof_text(plan: "Plan") -> str:
    """Return how many limits are proven at every instant, as an addition to "limits kept".

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Returns
    -------
    str
        Text that begins with a comma. It is "" if the plan does not contain a proof.
    """
    if not plan.proof or plan.certificate is None:
        return ""
    unproven = len(plan.unproven)
    if not unproven:
        return ", proven at every instant"
    return f", {len(plan.certificate.limits) - unproven} of them proven at every instant"


def proof_table(proofs: Sequence["Proof"]) -> Table:
    """Build the table of the proven bounds of all limits, in SI units.

    A proof encloses the worst value of a limited quantity over the entire motion between two
    bounds, which are in the columns "worst from" and "to".

    Parameters
    ----------
    proofs : sequence of Proof
        Proof of each limit.

    Returns
    -------
    Table
        One row for each limit, with the instant of the worst value in s and the verdict.
    """
    rows = [
        (
            proof.name,
            proof.joint or "",
            *(format_number(value, 10) for value in (proof.low, proof.high, proof.limit)),
            format_number(proof.time, 6),
            proof.verdict,
        )
        for proof in proofs
    ]
    return Table("limit, joint, worst from, to, limit, at s, ", rows, (2, 3, 4, 5))


def condition_lines(plan: "Plan") -> Iterator[str]:
    """Yield lines on the conditions that a problem contains in addition to its limits.

    These are rounded corners, constant tip speeds, velocities of the task coordinates at the start
    and at the end, and ranges of friction and payload. The lines of `cross_check_lines` and one
    line for each violated limit follow.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Yields
    ------
    str
        Line of text.
    """
    yield from path_lines(plan)
    for verb, rates in (("starts", plan.problem.start_rate), ("ends", plan.problem.end_rate)):
        if any(rates.values()):
            yield f"{verb:<12} at {rates_text(rates)}, as declared"
    yield from range_lines(plan)
    yield from cross_check_lines(plan)
    if plan.certificate is not None:
        for violation in plan.certificate.violations:
            time = f"t = {violation.time:.4f} s"
            yield f"exceeded     {violation.name} {violation.joint or ''} at {time}"


def cross_check_lines(plan: "Plan") -> Iterator[str]:
    """Yield lines that compare the duration of a plan with independent results.

    toppra is an independent program that computes the shortest duration along a path, without the
    limits on continuous torque. Further lines state the tip error that stated joint errors cause,
    and the limits whose increase by 1 % would save most time. Phases that toppra cannot judge are
    listed with the reason.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Yields
    ------
    str
        Line of text.
    """
    result = plan.cross_check
    if result is not None:
        comparison = "slower" if result["difference"] > 0 else "faster"
        yield (
            f"cross-check  {result['duration']:.4f} s by {result['by']}, the plan is "
            f"{abs(100 * result['difference']):.3f} % {comparison}"
        )
        limits = plan.certificate.limits if plan.certificate else ()
        if any(x.name == ContinuousTorque.name and x.margin <= ACTIVE_MARGIN for x in limits):
            yield "             (toppra does not know the limit on continuous torque, which binds)"
    if plan.path_bound and plan.duration:
        # In per cent with three decimals, rounded up so that the statement remains true.
        gap = math.ceil(1e5 * (1 - plan.path_bound / plan.duration)) / 1e3
        yield f"proven       no motion along this path is more than {gap:.3f} % shorter"
    if plan.tip_error is not None and plan.tip_error.bound is not None:
        source = plan.tip_error.sources[0]
        bound = format_number(1e3 * plan.tip_error.bound, 3)
        yield (
            f"tip error    {bound} mm or less with 99 % probability; the largest source is the "
            f"{source.name} of {source.joint}"
        )
    if plan.sensitivities:
        rows = sensitivities_table(plan).rows[:MAX_SENSITIVITIES]
        savings = ", ".join(f"{limit} of {joint} {saved} ms" for limit, joint, saved, _ in rows)
        yield f"faster       +1 % of a limit saves: {savings}".replace(f" of {MISSING_VALUE}", "")
    for reason in dict.fromkeys(phase.not_judged for phase in plan.phases if phase.not_judged):
        names = ", ".join(phase.name for phase in plan.phases if phase.not_judged == reason)
        yield f"cross-check  none of {names}: {reason}"


def solver_and_condition_lines(plan: "Plan") -> Iterator[str]:
    """Yield lines on the solvers of a plan and on its conditions.

    The structured solver of this package computes the motion. Ipopt, a general solver, then
    confirms it: it starts from this motion, and a line states how far its result differs.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Yields
    ------
    str
        Line of text.
    """
    if plan.problem.planner == "fast" and plan.phases:
        yield f"solver       {solver_text(plan)}"
    verb, agreement = confirmation_texts(plan)
    if verb:
        yield f"confirmed    Ipopt {verb} the structured solver's motion: {agreement}"
    yield from condition_lines(plan)


def summarise_sizing(sizing: SizingObject) -> tuple[str, str, str]:
    """Summarise a sizing in words.

    Parameters
    ----------
    sizing : SizingObject
        Sizing as JSON types, in the form that `size --json` prints. A sizing compares the torques
        and speeds of a motion with the ratings of the motors and gears.

    Returns
    -------
    mark : str
        "good", "bad", or "open" if data are missing.
    verdict : str
        Short text, such as "Motors and gears suffice".
    reason : str
        Explanation of the verdict.
    """
    motors, gears = sizing["motors"], sizing["gears"]
    with_motor = {motor["joint"] for motor in motors}
    missing_motors = ", ".join(sorted({gear["joint"] for gear in gears} - with_motor))
    if sizing["adequate"] is False:
        return "bad", "Motors or gears do not suffice", "; ".join(_failed_checks(sizing))
    if not gears:
        return "open", "Motors open", "no joint has a drive"
    if missing_motors:
        return "open", "Motors open", f"no motor given for {missing_motors}"
    undecided = _open_checks(sizing)
    margin, tightest = min(
        (margin, f"{plain_words(name)} of {motor['joint']} is the tightest check")
        for motor in motors
        for name, margin in motor["margins"].items()
        if margin is not None
    )
    lacking = f"Not checked or undecided: {', '.join(undecided)}"
    if margin < 0:
        return "open", "Motors suffice: not known", lacking
    values = list(placeholder_values(sizing))
    outcome = f"Motors suffice with {format_fixed(100 * margin, 1)} % margin"
    reasons = [tightest]
    if values:
        condition = "stand-in figure holds" if len(values) == 1 else "stand-in figures hold"
        outcome += f" if {len(values)} {condition}"
        reasons.append(f"Stand-in figures: {', '.join(values)}")
    if undecided:
        outcome += f"; {len(undecided)} {'check' if len(undecided) == 1 else 'checks'} open"
        reasons.append(lacking)
    if values or undecided:
        return "open", outcome, ". ".join(reasons)
    reason = f"with at least {100 * sizing['confidence']:g} % each"
    return "good", "Motors and gears suffice", reason


def placeholder_values(sizing: SizingObject) -> Iterator[str]:
    """Yield the joint and name of each placeholder on which a check depends.

    A placeholder is a value that a motor or drive file marks as assumed. If such a value is a
    rating, the text also states how much lower the rating may be.

    Parameters
    ----------
    sizing : SizingObject
        Object that `size --json` prints.

    Yields
    ------
    str
        Text such as "roll max torque (may be 12.5 % lower)".
    """
    for motor in sizing["motors"]:
        margins = motor["margins"]
        is_electrical = margins["voltage"] is not None or margins["heat"] is not None
        for name in motor["placeholders"]:
            margin = margins.get(CHECK_BY_RATING.get(name))
            if margin is not None:
                spare = f" (may be {format_fixed(100 * margin, 1)} % lower)"
                yield f"{motor['joint']} {plain_words(name)}{spare}"
            elif is_electrical and name not in (*CHECK_BY_RATING, "encoder_counts"):
                yield f"{motor['joint']} {plain_words(name)}"
    for gear in sizing["gears"]:
        if any(margin is not None for margin in gear["margins"].values()):
            for name in gear["placeholders"]:
                yield f"{gear['joint']} {plain_words(name)}"


def skipped_checks(sizing: SizingObject) -> Iterator[tuple[str, str, str, str]]:
    """Yield the checks that were skipped because data are missing.

    Parameters
    ----------
    sizing : SizingObject
        Sizing as JSON types, in the form that `size --json` prints.

    Yields
    ------
    joint, component, checks, data : str
        Joint, name of the motor or gear, its skipped checks, and the data that these checks need.
        Motors and gears without skipped checks are left out.
    """
    gear_checks = _gear_checks(sizing)
    for component in sizing["motors"] + sizing["gears"]:
        skipped = component["not_checked"]
        if "motor" in component:  # The entry of the gear names its checks.
            skipped = {name: needs for name, needs in skipped.items() if name not in gear_checks}
        if skipped:
            label = component["motor" if "motor" in component else "drive"]
            checks = ", ".join(map(plain_words, skipped))
            # The needs of a check are joined by " and ".
            data = dict.fromkeys(" and ".join(skipped.values()).split(" and "))
            yield component["joint"], label, checks, ", ".join(data)


def _open_checks(sizing: SizingObject) -> list[str]:
    """Name the checks that are open for at least one joint.

    Parameters
    ----------
    sizing : SizingObject
        Sizing as JSON types, in the form that `size --json` prints.

    Returns
    -------
    list of str
        Names of checks of motors. All checks of gears are combined under the name "gear".
    """
    gear_checks = _gear_checks(sizing)
    names = (
        "gear" if name in gear_checks else plain_words(name)
        for component in sizing["motors"] + sizing["gears"]
        for name in component["not_checked"]
    )
    return list(dict.fromkeys(names))


def _failed_checks(sizing: SizingObject) -> list[str]:
    """Describe each failed check of a motor or gear by its joint, its name and its margin.

    The margin is negative: it is the distance from the limit, relative to the limit. If two motors
    or gears of a joint fail the same check, only one of them is described.

    Parameters
    ----------
    sizing : SizingObject
        Object that `size --json` prints.

    Returns
    -------
    list of str
        One text for each failed check.
    """
    failed = {}
    for motor in sizing["motors"]:
        for check in motor["checks"]:
            if check["passed"] is False:
                failed[motor["joint"], check["name"]] = check["margin"]
    for gear in sizing["gears"]:
        if gear["adequate"] is False:
            failed.setdefault((gear["joint"], gear["binds"]), gear["margins"][gear["binds"]])
    return [
        f"{joint}: {plain_words(name)} {format_percent(margin)}"
        for (joint, name), margin in failed.items()
    ]


def _gear_checks(sizing: SizingObject) -> set[str]:
    """Return the names of all checks of gears."""
    return {name for gear in sizing["gears"] for name in gear["margins"]}


def sizing_lines(sizing: Sizing) -> list[str | Table]:
    """Return lines of text and tables that report a sizing without its verdict.

    The lines list the torques and speeds that the motion requires, the parts of the peak torque,
    the margins of all motors and those of all gears, and the checks that lack data.
    `sizing_verdict_lines` states the verdict.

    Parameters
    ----------
    sizing : Sizing
        Requirements of the motion, and the checks of motors and gears.

    Returns
    -------
    list of str and Table
        Lines of text, and tables with captions.
    """
    confidence = "at the stated friction"
    if all(joint.band.known for joint in sizing.joints):
        confidence = f"at {100 * sizing.conditions.confidence:g} % confidence"
    unknowns = [
        f"joint {joint}, {component}: {checks} not checked: needs {data}"
        for joint, component, checks, data in skipped_checks(sizing.to_dict())
    ]
    unknowns += _motor_notes(sizing)
    lines: list[str | Table] = []
    for table in (
        _requirements_table(sizing),
        _torque_parts_table(sizing),
        _candidates_table(sizing, f"Margins {confidence} (* with placeholder figures)"),
    ):
        lines += [table, ""]
    lines.append(_gears_table(sizing))
    if unknowns:
        lines += ["", "Not known"] + [f"  {line}" for line in unknowns]
    return lines


def what_if_lines(payload: WhatIf, duration: WhatIf) -> Iterator[str]:
    """Yield one line on the largest payload, and one on the shortest duration.

    Parameters
    ----------
    payload : WhatIf
        Largest payload with which the motors suffice, kg.
    duration : WhatIf
        Shortest duration with which the motors suffice, as a multiple of the present one.

    Yields
    ------
    str
        Line of text.
    """
    for question, answer, form in (
        ("largest payload", payload, "{:.4g} kg"),
        ("shortest duration", duration, "{:.4f} times the present one"),
    ):
        binds = plain_words(answer.binds or "")
        if answer.status == "found":
            text = f"{form.format(answer.value)} (then joint {answer.joint}: {binds})"
        elif answer.status == "never":
            text = f"none: joint {answer.joint}: {binds} is exceeded for every value"
        else:
            text = "the checks found no limit"
        yield f"{question:18} {text}"


def selection_lines(selection: Sequence[JsonObject]) -> Iterator[str | Table]:
    """Yield lines on the best pairs of motor and gear for each joint.

    The first line of a joint counts the pairs that suffice, that cannot be judged, and that do not
    suffice. A table of the best pairs follows. The last lines count the excluded pairs by the name
    of the check, and name the data that checks lack.

    Parameters
    ----------
    selection : sequence of dict
        Entry `selection` in the output of `size --json`.

    Yields
    ------
    str
        Line of text.
    """
    head = "motor, gear, adequate, binds, margin, g, gearhead g, mm, load/rotor inertia, to bus mJ"
    for joint in selection:
        answers = list(chain.from_iterable(joint["adequate"]))
        yield ""
        yield (
            f"{joint['joint']}: {len(joint['motors'])} motors × {len(joint['gears'])} gears: "
            f"{answers.count(True)} suffice, {answers.count(None)} not known, "
            f"{answers.count(False)} ruled out; by {joint['rank']}"
        )
        rows = []
        missing = set()
        for pair in joint["best"]:
            binds = pair["binds"]
            row = [pair["motor"], pair["gear"], VERDICT_LABELS[pair["adequate"]]]
            row += [plain_words(binds or MISSING_VALUE), format_percent(pair["margins"].get(binds))]
            for key in ("mass", "gearhead_mass", "length", "inertia_ratio", "energy_to_bus"):
                scale = 1.0 if key == "inertia_ratio" else 1e3
                row.append(MISSING_VALUE if pair[key] is None else format_number(scale * pair[key]))
            rows.append(row)
            for name, needs in pair["not_checked"].items():
                missing.add(f"{plain_words(name)}: {needs}")
        yield Table(head, rows, range(4, 10)) if rows else "no pair remains"
        reasons = [f"{plain_words(name)} {count}" for name, count in joint["reasons"].items()]
        if reasons:
            yield f"ruled out by: {', '.join(reasons)}"
        for check in sorted(missing):
            yield f"not known: {check}"


def _requirements_table(sizing: Sizing) -> Table:
    """Build the table of the torques, speeds and powers that a motion requires of each motor.

    If the drive file states the uncertainty of the friction, the upper bounds of the peak and RMS
    torques are added in parentheses. They hold with the probability `Conditions.confidence`.

    Parameters
    ----------
    sizing : Sizing
        Requirements of the motion.

    Returns
    -------
    Table
        One row for each joint, with torques in mN·m, speeds in rpm and powers in W.
    """
    head = "joint, peak mN·m, RMS mN·m, mean mN·m, peak rpm, peak rad/s², peak W, mean W, Joule W"
    rows = []
    confidence = sizing.conditions.confidence
    for joint in sizing.joints:
        requirement = joint.requirement
        peak = _format_in_milli(requirement.peak_torque)
        rms = _format_in_milli(requirement.rms_torque)
        if joint.band.known:
            peak += f" (≤ {_format_in_milli(joint.band.high('peak_torque', confidence))})"
            rms += f" (≤ {_format_in_milli(joint.band.high('rms_torque', confidence))})"
        row = [requirement.joint, peak, rms, _format_in_milli(requirement.mean_torque)]
        powers = requirement.peak_power, requirement.mean_power
        values = RPM * requirement.peak_speed, requirement.peak_acceleration, *powers
        row += [format_number(value, 4) for value in values]
        rows.append(row + [format_number(requirement.joule_power)])
    return Table(head, rows, range(1, 9), "Required of the motors")


def _torque_parts_table(sizing: Sizing) -> Table:
    """Build the table of the parts of each motor's peak torque.

    A part is the contribution of one cause, such as friction. It has a positive sign if it
    increases the magnitude of the torque.

    Parameters
    ----------
    sizing : Sizing
        Requirements of the motion.

    Returns
    -------
    Table
        One row for each joint and one column for each part, in mN·m.
    """
    rows = []
    for joint in sizing.joints:
        torques = joint.requirement.split.at_peak
        sign = math.copysign(1e3, sum(torques.values()))
        parts = (format_signed(sign * torques[name], 4) for name in TORQUE_COMPONENTS)
        rows.append([joint.load.joint, *parts])
    header = ["joint"] + [plain_words(name) for name in TORQUE_COMPONENTS]
    caption = "Parts of the peak torque, mN·m (+ increases it, − reduces it)"
    return Table(header, rows, range(1, len(header)), caption)


def _candidates_table(sizing: Sizing, caption: str) -> Table:
    """Build the table of all judged motors with the margins of their checks.

    Parameters
    ----------
    sizing : Sizing
        Checks of the motors.
    caption : str
        Title of the table.

    Returns
    -------
    Table
        One row for each motor. The column "adequate" states whether the motor suffices, and "binds"
        names the check that decides. The last columns contain the smallest margin of the gear and
        the largest temperature of the winding. A name that begins with "or" marks an alternative
        that the robot file lists in addition to its motor. A star marks a motor whose file contains
        assumed values.
    """
    head = ["joint", "motor", "adequate", "binds"]
    head += [plain_words(name) for name in MOTOR_MARGINS]
    head += ["gear", "winding"]
    rows = []
    for verdict in sizing.verdicts + sizing.alternatives:
        by_name = {check.name: check.margin for check in verdict.checks}
        gear_margins = [check.margin for check in verdict.gear if check.margin is not None]
        prefix = "or " if verdict in sizing.alternatives else ""
        mark = " *" if verdict.motor.placeholder else ""
        row = [verdict.joint, f"{prefix}{verdict.motor.name}{mark}"]
        row += [VERDICT_LABELS[verdict.adequate], plain_words(verdict.binds or MISSING_VALUE)]
        row += [format_percent(by_name[name]) for name in MOTOR_MARGINS]
        row += [format_percent(min(gear_margins, default=None)), _winding_temperature(verdict)]
        rows.append(row)
    return Table(head, rows, range(2, len(head)), caption)


def _winding_temperature(verdict: MotorVerdict) -> str:
    """Format the largest temperature of the winding in °C."""
    if verdict.heat is None:
        return MISSING_VALUE
    hottest = verdict.heat.winding
    return "no steady state" if hottest is None else f"{hottest - ZERO_CELSIUS:.0f} °C"


def _gears_table(sizing: Sizing) -> Table:
    """Build the table of the gears of all joints with the margins of their checks.

    Parameters
    ----------
    sizing : Sizing
        Checks of the gears.

    Returns
    -------
    Table
        One row for each joint. It omits checks that have no margin because data are missing.
    """
    rows = []
    for joint in sizing.joints:
        margins = [
            f"{plain_words(check.name)} {format_percent(check.margin)}"
            for check in joint.gear
            if check.margin is not None
        ]
        rows.append(
            (joint.load.joint, joint.load.drive.name, ", ".join(margins) or "no check was possible")
        )
    return Table("joint, drive, margins", rows, caption="Gears")


def _motor_notes(sizing: Sizing) -> Iterator[str]:
    """Yield the notes of all judged motors, and the times until their windings are too hot.

    Parameters
    ----------
    sizing : Sizing
        Checks of the motors.

    Yields
    ------
    str
        Line of text. Equal notes of several motors appear once.
    """
    verdicts = sizing.verdicts + sizing.alternatives
    for verdict in verdicts:
        heat = verdict.heat
        if heat is not None and heat.time_until_limit is not None:
            duration = (
                f"reaches {heat.limit - ZERO_CELSIUS:.0f} °C after {heat.time_until_limit:.4g} s"
            )
            yield f"joint {verdict.joint}, {verdict.motor.name}: the winding {duration}"
    yield from dict.fromkeys(note for verdict in verdicts for note in verdict.notes)


def sizing_verdict_lines(sizing: Sizing) -> list[str]:
    """Return lines that state the verdict for each joint, and for all motors together.

    Parameters
    ----------
    sizing : Sizing
        Checks of the motors and gears.

    Returns
    -------
    list of str
        Lines of text. If the verdict is open, the last lines state the reason.
    """
    lines = ["", "Verdicts"]
    for joint in sizing.joints:
        verdict = _joint_verdict_text(joint, sizing.conditions.confidence)
        lines.append(f"  {joint.load.joint:10} {verdict}")
        lines += [
            f"  {'':10} with {alternative.motor.name}: {VERDICT_LABELS[alternative.adequate]}"
            for alternative in joint.alternatives
        ]
    _, outcome, reason = summarise_sizing(sizing.to_dict())
    if sizing.adequate is None:
        return lines + [f"  why        {reason}", outcome]
    return lines + [f"Motors and gears suffice: {VERDICT_LABELS[sizing.adequate]}"]


def _joint_verdict_text(joint: JointSizing, confidence: float) -> str:
    """Describe the verdict on the candidate motors of one joint.

    Parameters
    ----------
    joint : JointSizing
        Sizing of the joint.
    confidence : float
        Probability with which the smallest suitable motor suffices, from 0 to 1.

    Returns
    -------
    str
        Text such as "no motor given".
    """
    smallest = joint.smallest
    if smallest is not None:
        mark = " (placeholder figures)" if smallest.motor.placeholder else ""
        return f"{smallest.motor.name}: smallest suitable motor at {100 * confidence:g} %{mark}"
    if not joint.candidates:
        return "no motor given"
    if joint.adequate is None:
        return "not known: the missing values are listed above"
    if len(joint.candidates) > 1:
        return "no motor of the list suffices"
    return "the motor does NOT suffice"


def simulation_tables(result: "SimulationResult") -> tuple[Table, Table]:
    """Build the tables of a simulated playback, that is, of the simulated execution of a plan.

    Parameters
    ----------
    result : SimulationResult
        Result of the simulation.

    Returns
    -------
    errors : Table
        Largest and RMS tracking error of each driven joint, mrad or mm.
    motors : Table
        For each motor: largest and permitted torque in mN·m, largest and permitted following error
        in increments, and whether the motor saturated or the drive switched off ("tripped").
    """
    driven = [motor.joint for motor in result.motors]
    errors = [
        (
            tracking.joint,
            _format_in_milli(tracking.worst),
            _format_in_milli(tracking.rms),
            "mm" if tracking.joint == JOINTS[3] else "mrad",
        )
        for tracking in result.tracking
        if tracking.joint in driven
    ]
    motors = [
        (
            motor.joint,
            _format_in_milli(motor.peak_torque),
            _format_in_milli(motor.limit),
            "SATURATED" if motor.saturated else "no",
            format_fixed(motor.following_error, 0),
            str(motor.window),
            "TRIPPED" if motor.tripped else "no",
        )
        for motor in result.motors
    ]
    header = "motor, peak mN·m, largest mN·m, saturated, following error inc, window inc, tripped"
    errors_table = Table("joint, largest error, rms, unit", errors, (1, 2))
    return errors_table, Table(header, motors, (1, 2, 4, 5))

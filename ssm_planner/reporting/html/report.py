"""Write report.html, the page of a plan.

The page is self-contained, and its content follows from plan.json alone. `write_report` is the
entry.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from ssm_planner.display import MISSING_VALUE, format_fixed, format_number
from ssm_planner.plans import PhaseSummary, Plan
from ssm_planner.problem import (
    JOINTS,
    JUMP_NAMES,
    TASK_COORDINATES,
    Joint,
    JointAcceleration,
    JointJerk,
    JointVelocity,
    MotorSpeed,
    MotorTorque,
    to_plain,
)
from ssm_planner.reporting.figures.film import mechanism_still
from ssm_planner.reporting.figures.style import COLOURS, FIFTH_COLOUR
from ssm_planner.reporting.html.channels import encode_channels, sample_channels, time_grid
from ssm_planner.reporting.html.outcome import write_outcome
from ssm_planner.reporting.html.page import render_page, write_page
from ssm_planner.reporting.html.panels import (
    TEMPERATURE_SECTION,
    Panel,
    build_panels,
    limit_rows,
    missing_temperature_reasons,
    motor_map,
)
from ssm_planner.reporting.html.scene import robot_scene
from ssm_planner.reporting.text import (
    MOTOR_MARGINS,
    Table,
    candidates_table,
    closest_limit_text,
    confirmation_texts,
    joints_table,
    limit_cells,
    motors_table,
    phases_table,
    proof_table,
    proof_text,
    range_lines,
    rates_text,
    sensitivities_table,
    skipped_checks,
    summarise_sizing,
    tip_error_table,
)
from ssm_planner.typing import Array, JsonObject
from ssm_planner.units import display_unit
from ssm_planner.verification import Certificate, LimitCheck

JOINT_COLUMNS = "joint, position, velocity, acceleration, jerk"
"""Headings of the table of the limits of the joints."""
MIN_SHOWN_LIMITS = 10
"""Number of limits that the page shows without a click. Violated limits are always shown."""
MAX_CLAUSES = 5
"""Largest number of clauses in the sentence about the motion."""
COORDINATE_TOLERANCE = 1e-6
"""Change below which a task coordinate counts as unchanged, rad or m."""
MIN_ACTIVE_FRACTION = 0.15
"""Fraction of the duration during which a limit must be active to appear in the sentence."""
JOINT_LIMITS = tuple(
    limit.name for limit in (JointVelocity, JointAcceleration, JointJerk, MotorSpeed, MotorTorque)
)
"""Names of limits that apply to one joint."""
LENGTH_COORDINATES = ("tip x", "y", "z", "depth", "q4")
"""Names in the description of a target whose unit is that of a length."""
JOINT_POSITIONS = ("q1", "q2", "q3", "q4")
"""Names of the joint positions in the description of a target."""
LimitRow = tuple[LimitCheck, tuple[str, ...]]
"""A limit of the certificate, and its cells from `limit_cells`."""
VerdictMark = tuple[str, str, str]
"""A verdict: its kind ("good", "bad" or "open"), a short text and the reason."""


def write_report(plan: Plan, path: Path) -> Path:
    """Write the report of a plan, and return its path.

    Parameters
    ----------
    plan : Plan
        A plan with a trajectory.
    path : Path
        File of the page.

    Raises
    ------
    ExportError
        If the file cannot be written.
    """
    return write_page(path, report_page(plan), plan.sha256)


def report_page(plan: Plan) -> str:
    """Render the report of a plan as an HTML document.

    This function only collects texts, tables and the data of the plots. The template report.html
    arranges them.

    Parameters
    ----------
    plan : Plan
        A plan with a trajectory.

    Returns
    -------
    str
        Text of the page.
    """
    data = report_data(plan)
    sizing = sizing_object(plan)
    missing = list(skipped_checks(sizing))
    return render_page(
        "report.html",
        data,
        title=f"{plan.problem.name} – plan report",
        sentence=motion_sentence(plan, data["panels"]),
        verdict_marks=verdict_marks(plan),
        plan=plan,
        confirmation=confirmation_texts(plan),
        ranges=list(range_lines(plan)),
        closest=plan.certificate and closest_limit_text(plan.certificate.limits, "°"),
        tiers=_limit_groups(plan.certificate),
        proof=proof_table(plan.proof),
        phases=phases_table(plan),
        sensitivities=sensitivities_table(plan),
        tip_errors=tip_error_table(plan),
        candidates=candidates_table(plan),
        ends=joints_table(plan),
        motors=motors_table(plan.requirements),
        stops=_controlled_stops_summary(plan),
        sizing=sizing,
        margins=MOTOR_MARGINS,
        missing=Table("joint, motor or gear, not checked, missing data", missing),
        repeated=repetition_text(plan.problem.duty),
        problem=problem_tables(plan),
        still=mechanism_still(plan),
    )


def write_no_plan(plan: Plan, path: Path, changes: Sequence[tuple[str, float]] = ()) -> Path:
    """Write the page of a problem without a certified motion, and return its path.

    Parameters
    ----------
    plan : Plan
        Result of the planning, which states the reason.
    path : Path
        File of the page.
    changes : sequence of (str, float)
        Changes of limits, in words, and the durations in s of the motions that they permit. The
        page has a slider for them.

    Raises
    ------
    ExportError
        If the file cannot be written.
    """
    reason = plan.reason
    if reason is None or plan.disagreements:
        conclusion = f"The motion is not certified: {_certificate_mark(plan)[2]}."
    else:
        conclusion = f"No motion keeps every limit: {reason.message}."
        if reason.relaxation:
            conclusion += f" The suggested change is {reason.relaxation}."
    steps = [f"{text}: the motion takes {format_fixed(time, 4)} s" for text, time in changes]
    return write_outcome(path, plan.problem.name, conclusion, problem_tables(plan), steps=steps)


def problem_tables(plan: Plan) -> list[Table]:
    """Build the tables of a problem: its motion, the limits of task and joints, and the drives.

    Parameters
    ----------
    plan : Plan
        Plan or failed plan of the problem.

    Returns
    -------
    list of four Table
        Tables with captions.
    """
    joints = list(map(_joint_row, plan.robot.joints))
    drives = [
        (joint.name, *(part.name if part else MISSING_VALUE for part in (joint.drive, joint.motor)))
        for joint in plan.robot.joints
    ]
    limits = limit_rows(plan.limits)
    return [
        _motion_table(plan),
        Table("limit, from, to, unit", limits, (1, 2), "Limits of the task"),
        Table(JOINT_COLUMNS, joints, (1, 2, 3, 4), "Limits of the joints"),
        Table("joint, drive, motor", drives, caption="Drives"),
    ]


def repetition_text(duty: float | None) -> str:
    """Describe how often the robot performs the motion, as the beginning of a sentence.

    Parameters
    ----------
    duty : float or None
        Pause between two repetitions, s. None means a single motion.

    Returns
    -------
    str
        Subject of a sentence, such as "The motion repeated without pause".
    """
    if duty is None:
        return "The motion performed once, from a cold start,"
    return f"The motion repeated {f'after a pause of {duty:.6g} s' if duty else 'without pause'}"


def report_data(plan: Plan) -> JsonObject:
    """Return the data for the scripts of the page as JSON types.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Returns
    -------
    dict
        `channels` contains the sampled quantities over time, and `panels` the plots that show them.
        `phases` and `joints` describe the motion and the robot, `stops` the tip positions at the
        ends of the phases, and `maps` the torque–speed curves of the motors. `scene` is the scene
        of the 3D view. Times count from the start of the motion, s.
    """
    channels = sample_channels(plan, time_grid(plan.motion.duration))
    motors = {
        i: joint.motor
        for i, joint in enumerate(plan.robot.joints)
        if joint.motor is not None and joint.drive
    }
    start = float(plan.motion.breaks[0])
    return {
        "duration": plan.motion.duration,
        "colours": COLOURS + (FIFTH_COLOUR,),
        "stops": _rest_positions(plan, channels),
        "phases": [
            {"name": phase.name, "start": phase.start - start, "end": phase.end - start}
            for phase in plan.motion.phases
        ],
        "joints": [
            {
                "name": joint.name,
                "kind": joint.kind,
                "gears": joint.drive
                and [*(stage.name for stage in joint.drive.stages.values()), joint.drive.name],
            }
            for joint in plan.robot.joints
        ],
        "panels": build_panels(plan, channels),
        "maps": [motor_map(i, motor) for i, motor in motors.items()],
        "notes": {TEMPERATURE_SECTION: list(missing_temperature_reasons(channels, motors))},
        "scene": robot_scene(plan.robot, plan.limits),
        "channels": encode_channels(channels),
    }


def motion_sentence(plan: Plan, panels: list[Panel]) -> str:
    """Describe in one sentence the motion, its duration and the limits that determine it.

    An example is "Tilts −85° → −135°, inserts 20 mm in 3.35 s; limited by the tip speed."

    Parameters
    ----------
    plan : Plan
        Plan that is reported.
    panels : list of Panel
        Descriptions of all plots of the plan. They contain the intervals in which the motion is at
        a limit.

    Returns
    -------
    str
        The sentence with a full stop.
    """
    groups: dict[str, list[PhaseSummary]] = {}
    for phase in plan.phases:
        # Phases of one scan or repetition have a common name before the comma.
        group = phase.name.rpartition(", ")[0] or f"{phase.name} {len(groups)}"
        groups.setdefault(group, []).append(phase)
    clauses: list[str] = []
    for name, phases in groups.items():
        spots = sum(_is_spot(phase) for phase in phases)
        if len(phases) == 1:
            clauses += _coordinate_clauses(phases[0])
        elif spots:
            clauses.append(f"visits {spots} spots ({name})")
        else:
            clauses.append(f"{name} in {len(phases)} phases")
    if len(clauses) > MAX_CLAUSES:
        clauses = [f"makes {len(plan.phases)} phases"]
    text = f"{', '.join(clauses) or 'stands still'} in {format_fixed(plan.duration, 2)} s"
    limits = _limiting_text(plan, panels)
    if limits:
        text += f"; limited by {limits}"
    return f"{text[0].upper()}{text[1:]}."


def _coordinate_clauses(phase: PhaseSummary) -> Iterator[str]:
    """Yield a clause for each task coordinate that a phase changes, such as “inserts 20 mm”.

    Parameters
    ----------
    phase : PhaseSummary
        Phase of a plan with its task coordinates at both ends.

    Yields
    ------
    str
        Clause about the depth in mm, or about roll, tilt or spin in degrees.
    """
    for name, start, end in zip(TASK_COORDINATES, phase.task_start, phase.task_end, strict=True):
        change = abs(end - start)
        if change <= COORDINATE_TOLERANCE:
            continue
        if name == "depth":
            yield f"{'inserts' if end > start else 'withdraws'} {format_number(1e3 * change, 3)} mm"
        else:
            start_angle = format_number(math.degrees(start), 4)
            end_angle = format_number(math.degrees(end), 4)
            yield f"{name}s {start_angle}° → {end_angle}°"


def _limiting_text(plan: Plan, panels: list[Panel]) -> str:
    """Name at most two limits that are active for the longest time.

    A limit is active while the motion is at this limit. Limits of positions and clearances are left
    out, because they do not determine the duration. A limit must be active for more than the
    fraction `MIN_ACTIVE_FRACTION` of the duration.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.
    panels : list of Panel
        Descriptions of all plots of the plan. They contain the intervals in which a limit is
        active.

    Returns
    -------
    str
        Text such as "the tip speed and the speed of tilt". Empty if no limit is named.
    """
    times: dict[str, dict[int, float]] = {}
    for panel in panels:
        for interval in panel["active"]:
            name = interval["name"]
            joint = interval["joint"]
            if not name.endswith(("range", "position", "clearance")):
                by_joint = times.setdefault(name, {})
                by_joint[joint] = by_joint.get(joint, 0.0) + interval["end"] - interval["start"]
    shortest = MIN_ACTIVE_FRACTION * plan.motion.duration
    joints = {
        name: [joint for joint, time in sorted(by_joint.items()) if time > shortest]
        for name, by_joint in times.items()
    }
    names = sorted(filter(joints.get, times), key=lambda name: -max(times[name].values()))
    return " and ".join(_limit_text(name, joints[name]) for name in names[:2])


def _limit_text(name: str, joints: list[int]) -> str:
    """Name a limit together with its joints, such as “the speed of roll and tilt”.

    Parameters
    ----------
    name : str
        Name of the limit.
    joints : list of int
        Indices of the joints, from 0. They are ignored for a limit of the tool.

    Returns
    -------
    str
        Name of the limit with an article.
    """
    quantity = "speed" if name == "velocity" else name
    if name not in JOINT_LIMITS:
        return f"the {quantity}"
    *first_names, last_name = (JOINTS[i] for i in joints)
    first_text = f"{', '.join(first_names)} and " if first_names else ""
    return f"the {quantity} of {first_text}{last_name}"


def _is_spot(phase: PhaseSummary) -> bool:
    """Return True if the tool rests at a spot of a scan during the phase.

    The name of such a phase consists of the name of the scan, a comma and the name of the spot.
    """
    return phase.task_start == phase.task_end and ", " in phase.name


def _rest_positions(plan: Plan, channels: Mapping[str, Array]) -> list[JsonObject]:
    """Return the tip positions at the ends of the phases.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.
    channels : mapping of (n,) arrays
        Sampled quantities of the plan by name. "t" contains the instants in s, and "tip0" to "tip2"
        the coordinates of the tip in m.

    Returns
    -------
    list of dict
        `position` contains the coordinates in m, and `spot` is true for a spot of a scan. Equal
        positions appear once.
    """
    spots = {phase.name for phase in plan.phases if _is_spot(phase)}
    t = channels["t"]
    tip = np.column_stack([channels[f"tip{i}"] for i in range(3)])
    stops: dict[tuple[float, ...], bool] = {}
    for phase in plan.motion.phases:
        index = np.searchsorted(t, phase.end - plan.motion.breaks[0])
        position = tuple(np.round(tip[min(index, len(t) - 1)], 5).tolist())
        stops[position] = stops.get(position, False) or phase.name in spots
    return [{"position": list(position), "spot": spot} for position, spot in stops.items()]


def _limit_groups(certificate: Certificate | None) -> list[tuple[str, list[LimitRow]]]:
    """Divide the limits of a certificate into three groups, each sorted by margin.

    The first group contains the limits with the smallest margins, among them all violated ones. The
    second group contains the other limits, and the third group the limits on jumps that are kept.

    Parameters
    ----------
    certificate : Certificate or None
        Result of the check of all limits. Without it, the groups are empty.

    Returns
    -------
    list of (str, list of LimitRow)
        Heading and limits of each group.
    """
    limits = () if certificate is None else certificate.limits
    rows: list[LimitRow] = [
        (check, limit_cells(check, "°")) for check in sorted(limits, key=lambda check: check.margin)
    ]
    numerical = [row for row in rows if row[0].name in JUMP_NAMES and row[0].passed]
    main_rows = [row for row in rows if row not in numerical]
    count = max(MIN_SHOWN_LIMITS, sum(not check.passed for check, _ in main_rows))
    return [
        ("tightest", main_rows[:count]),
        ("Other limits", main_rows[count:]),
        ("Numerical continuity: jumps between polynomials, rest at both ends", numerical),
    ]


def verdict_marks(plan: Plan) -> list[VerdictMark]:
    """Return the verdicts on the planning, the certificate and the motors of a plan."""
    planning = ("good", "Feasible", "")
    if plan.status != "solved":
        planning = ("bad", "No plan", plan.status)
    return [planning, _certificate_mark(plan), summarise_sizing(sizing_object(plan))]


def sizing_object(plan: Plan) -> JsonObject:
    """Return the sizing of a plan with a trajectory, in the form that `size --json` prints."""
    assert plan.sizing is not None
    return plan.sizing.to_dict()


def _certificate_mark(plan: Plan) -> VerdictMark:
    """Return the verdict on the certificate of a plan, that is, on the check of all its limits.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Returns
    -------
    VerdictMark
        "good" if the certificate passed and no other evaluation disagrees. Otherwise "bad" with the
        first reason.
    """
    certificate = plan.certificate
    if certificate is None:
        return "bad", "Not certified", plan.uncertified_reason or "the plan has no certificate"
    if not certificate.passed:
        tightest = certificate.worst
        joint = f" of joint {tightest.joint}" if tightest.joint else ""
        return "bad", "Not certified", f"{tightest.name}{joint} exceeded at {tightest.time:.3f} s"
    if plan.disagreements:
        return "bad", "Not certified", plan.disagreements[0]
    return "good", "Certified", f"{len(certificate.limits)} limits kept{proof_text(plan)}"


def _controlled_stops_summary(plan: Plan) -> JsonObject | None:
    """Summarise the controlled stops of a plan, which begin at many instants of the motion.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.

    Returns
    -------
    dict or None
        `count` is the number of stops, `passed` is true if all of them keep the limits, and
        `broken` contains the violated limits. `longest` contains the start of the longest stop in s
        and its duration in ms. `farthest` contains the start of the stop with the largest travel in
        s and its travel in mm. The result is None if the plan does not contain stops.
    """
    stops = plan.stops
    if stops is None:
        return None
    broken = {f"{limit.name} {limit.joint or ''}".strip() for limit in stops.certificate.violations}
    longest_index, farthest_index = int(np.argmax(stops.duration)), int(np.argmax(stops.travel))
    return {
        "count": len(stops.time),
        "passed": stops.passed,
        "broken": sorted(broken),
        "longest": (stops.time[longest_index], 1e3 * stops.duration[longest_index]),
        "farthest": (stops.time[farthest_index], 1e3 * stops.travel[farthest_index]),
    }


def _motion_table(plan: Plan) -> Table:
    """Build the table of a problem's motion: its start, every entry, and rates at both ends.

    Parameters
    ----------
    plan : Plan
        Plan with the problem. An entry of the problem is one motion to a target or one pause.

    Returns
    -------
    Table
        Name, kind and target or duration of each entry.
    """
    problem = to_plain(plan.problem)
    rows = [("start", "", _target_text({"target": problem.get("start")}))]
    for entry in problem.get("motion") or []:
        rows.append((str(entry["name"]), str(entry["kind"]), _target_text(entry)))
    ends = (("at the start", plan.problem.start_rate), ("at the end", plan.problem.end_rate))
    for label, rates in ends:
        if any(rates.values()):
            rows.append((label, "speed", rates_text(rates)))
    return Table("motion, kind, to", rows, caption="Motion")


def _target_text(motion: JsonObject) -> str:
    """Format the target and the duration of an entry of the motion list.

    Parameters
    ----------
    motion : dict
        Entry of the list with the key `duration` (s), or with the key `target`. A target contains
        task coordinates, tip coordinates or joint positions, with angles in rad and lengths in m.

    Returns
    -------
    str
        Text such as "tilt −85°, depth 20 mm, in 3 s", or "2 s" for a pause.
    """
    target = motion.get("target") or {}
    values = dict(target.get("task") or {})
    values |= zip(LENGTH_COORDINATES, target.get("tip") or (), strict=False)
    values |= zip(JOINT_POSITIONS, target.get("joints") or (), strict=False)
    texts = []
    for name, value in values.items():
        unit, scale = display_unit("m" if name in LENGTH_COORDINATES else "rad", "°")
        texts.append(f"{name} {format_number(scale * value, 6)} {unit}")
    if motion.get("duration") is not None:
        texts.append(f"in {motion['duration']:g} s" if texts else f"{motion['duration']:g} s")
    return ", ".join(texts)


def _joint_row(joint: Joint) -> tuple[str, ...]:
    """Format the limits of a joint as one row of a table.

    Parameters
    ----------
    joint : Joint
        Joint with its limits.

    Returns
    -------
    tuple of five str
        Cells under the headings `JOINT_COLUMNS`, with limits in degrees or mm.
    """
    unit, scale = display_unit(joint.unit, "°")
    low, high = joint.position

    def format_value(value: float) -> str:
        """Format a value in the display unit."""
        return format_number(scale * value, 6)

    return (
        joint.name,
        f"{format_value(low)} … {format_value(high)} {unit}",
        f"{format_value(joint.velocity)} {unit}/s",
        f"{format_value(joint.acceleration)} {unit}/s²",
        MISSING_VALUE if joint.jerk is None else f"{format_value(joint.jerk)} {unit}/s³",
    )

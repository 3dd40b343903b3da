"""Column names of trajectory tables: which joint, which derivative, which unit."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ssm_planner.errors import TrajectoryError
from ssm_planner.problem.robot import Robot
from ssm_planner.units import ANGLES, LENGTHS, PER, TIMES, of_heading

ORDER_WORDS = {
    0: {"q", "pos", "position", "angle", "theta", "displacement"},
    1: {"qd", "dq", "vel", "velocity", "speed", "rate"},
    2: {"qdd", "ddq", "acc", "accel", "acceleration"},
}
ORDER_NAMES = ("position", "velocity", "acceleration")
_JOINT = re.compile(r"^(joint|j|axis|q|qd|qdd|dq|ddq|theta)_?([1-4])$")


@dataclass(frozen=True)
class Heading:
    """One column: its place in the row and its factor to SI."""

    column: int
    name: str
    factor: float


def headings(
    names: list[str], robot: Robot, where: str
) -> tuple[dict[tuple[int, int], Heading], list[str]]:
    """Columns by (derivative 0 to 2, joint 0 to 3), time as (−1, 0), and the names of those not used.

    Raises TrajectoryError, beginning with `where`: a missing or unknown unit, a unit that is not of this joint or
    derivative, a column given twice, a missing one.
    """
    found: dict[tuple[int, int], Heading] = {}
    ignored = []
    for column, name in enumerate(names):
        try:
            meaning = _meaning(name, robot)
        except ValueError as error:
            raise TrajectoryError(f"{where}: column {name!r}: {error}") from error
        if meaning is None:
            ignored.append(name)
            continue
        key, factor = meaning
        if key in found:
            raise TrajectoryError(
                f"{where}: columns {found[key].name!r} and {name!r} are the same quantity"
            )
        found[key] = Heading(column, name, factor)
    _complete(found, names, robot, where)
    return found, ignored


def _complete(
    found: dict[tuple[int, int], Heading], names: list[str], robot: Robot, where: str
) -> None:
    if (-1, 0) not in found:
        raise TrajectoryError(
            f"{where}: no column of time with its unit, such as time_s; the columns are {names}"
        )
    for order in range(3):
        given = [i for i in range(4) if (order, i) in found]
        missing = [robot.joints[i].name for i in range(4) if i not in given]
        if missing and (order == 0 or given):
            unit = (
                ""
                if order
                else "; a column is named such as q1_rad, q4_m, 'roll [deg]' or 'joint1_position_rad'"
            )
            raise TrajectoryError(
                f"{where}: no {ORDER_NAMES[order]} of joint {', '.join(missing)}{unit}"
            )
    if (2, 0) in found and (1, 0) not in found:
        raise TrajectoryError(f"{where}: accelerations without velocities")


def _meaning(name: str, robot: Robot) -> tuple[tuple[int, int], float] | None:
    """((derivative, joint), factor) of a column name; None for a column that is none of a joint's or time's."""
    label, unit = of_heading(name)
    words = [word for word in re.split(r"[^a-z0-9]+|_", label.lower()) if word]
    if words and (words[0] in ("t", "time", "timestamp") or words[:3] == ["time", "from", "start"]):
        if unit not in TIMES:
            raise ValueError(_unit_fault(unit, ", ".join(TIMES)))
        return (-1, 0), TIMES[unit]
    joint, order = _joint(words, robot)
    if joint is None:
        return None
    base, per = _base(unit)
    kinds = ANGLES if robot.joints[joint].kind == "revolute" else LENGTHS
    if base not in kinds:
        raise ValueError(
            _unit_fault(unit, f"{', '.join(kinds)}, for derivatives with /s or /s^2")
            + _kind(robot, joint)
        )
    if order is not None and order != per:
        raise ValueError(f"a {ORDER_NAMES[order]} with the unit {unit!r} of a {ORDER_NAMES[per]}")
    return (per, joint), kinds[base]


def _joint(words: list[str], robot: Robot) -> tuple[int | None, int | None]:
    """(joint, derivative that the words name); None where they do not say."""
    joint, order = None, None
    names = [each.name for each in robot.joints]
    rest = []
    for k, word in enumerate(words):
        match = _JOINT.match(word)
        if match:
            joint = int(match.group(2)) - 1
            rest.append(match.group(1))
        elif (
            word in ("joint", "axis")
            and k + 1 < len(words)
            and words[k + 1] in ("1", "2", "3", "4")
        ):
            joint = int(words[k + 1]) - 1
        elif word in names:
            joint = names.index(word)
        else:
            rest.append(word)
    for word in rest:
        order = next((k for k, known in ORDER_WORDS.items() if word in known), order)
    known = {
        "joint",
        "j",
        "axis",
        "1",
        "2",
        "3",
        "4",
        "actual",
        "target",
        "command",
        "desired",
        "value",
    }
    if any(
        word not in known and not any(word in words for words in ORDER_WORDS.values())
        for word in rest
    ):
        return None, None
    return joint, order


def _base(unit: str) -> tuple[str, int]:
    """(deg, 1) of deg/s or deg_per_s."""
    match = re.fullmatch(rf"(.*?)({PER})?", unit)
    per = (match.group(2) or "") if match else ""
    base = unit[: len(unit) - len(per)] if per else unit
    return base, 0 if not per else 2 if per.endswith(("2", "²")) else 1


def _unit_fault(unit: str, allowed: str) -> str:
    return (
        f"unit {unit!r} is not known here (allowed: {allowed})"
        if unit
        else f"no unit (allowed: {allowed})"
    )


def _kind(robot: Robot, joint: int) -> str:
    each = robot.joints[joint]
    return f"; joint {each.name} {'turns' if each.kind == 'revolute' else 'slides'}"

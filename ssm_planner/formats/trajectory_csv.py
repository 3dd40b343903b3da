"""Parse column names of trajectory tables: joint, derivative and unit.

A column name consists of words and a unit, such as q1_rad, "roll [deg]" or
joint1_velocity_rad_per_s. `identify_columns` finds the quantity of each column, so that tables of
other programs can be read.
"""

import re

from ssm_planner.errors import TrajectoryError
from ssm_planner.problem import Robot
from ssm_planner.typing import frozen
from ssm_planner.units import ANGLES, LENGTHS, PER_SECOND, TIMES, split_heading

ORDER_WORDS = (
    "q|pos|position|angle|theta|displacement",
    "qd|dq|vel|velocity|speed|rate",
    "qdd|ddq|acc|accel|acceleration",
)
"""Patterns of the words that denote the position, the velocity and the acceleration."""
OTHER_WORDS = "joint|j|axis|[1-4]|actual|target|command|desired|value"
"""Pattern of further words that may be part of a column name, and do not change its meaning."""
ORDER_NAMES = ("position", "velocity", "acceleration")
_JOINT_PATTERN = re.compile(r"^(joint|j|axis|q|qd|qdd|dq|ddq|theta)_?([1-4])$")


@frozen
class TableColumn:
    """A column of a table.

    Attributes
    ----------
    column : int
        Index of the column in the file.
    name : str
        Name of the column in the file.
    factor : float
        Factor that converts its values to SI units.
    """

    column: int
    name: str
    factor: float


def identify_columns(
    names: list[str], robot: Robot, location: str
) -> tuple[dict[tuple[int, int], TableColumn], list[str]]:
    """Identify the columns of a table.

    Parameters
    ----------
    names : list of str
        Column names in the order of the file.
    robot : Robot
        Robot that defines the names of the joints. It also determines whether a joint has angles or
        lengths.
    location : str
        Beginning of error messages: the file and the line.

    Returns
    -------
    columns : dict of TableColumn
        Columns of the time and the joint states. A key consists of the order of the derivative (0
        for positions, 1 for velocities, 2 for accelerations) and the index of the joint from 0. The
        time has the key (−1, 0).
    ignored : list of str
        Names of the unused columns.

    Raises
    ------
    TrajectoryError
        If a unit is missing, unknown or wrong for the joint or the derivative, or if a required
        column is missing or occurs twice.
    """
    columns: dict[tuple[int, int], TableColumn] = {}
    ignored = []
    for column, name in enumerate(names):
        try:
            meaning = _parse_heading(name, robot)
        except ValueError as error:
            raise TrajectoryError(f"{location}: column {name!r}: {error}") from error
        if meaning is None:
            ignored.append(name)
            continue
        key, factor = meaning
        if key in columns:
            raise TrajectoryError(
                f"{location}: columns {columns[key].name!r} and {name!r} are the same quantity"
            )
        columns[key] = TableColumn(column, name, factor)
    _check_complete(columns, names, robot, location)
    return columns, ignored


def _check_complete(
    columns: dict[tuple[int, int], TableColumn], names: list[str], robot: Robot, location: str
) -> None:
    """Raise TrajectoryError if a table lacks columns that a trajectory requires.

    A table needs the time and the positions of all joints. Velocities and accelerations are
    optional, but must be complete, and accelerations require velocities.

    Parameters
    ----------
    columns : dict of TableColumn
        Columns by the order of the derivative and the index of the joint, both from 0. The time has
        the key (−1, 0).
    names : list of str
        All column names of the file, for messages.
    robot : Robot
        Robot with the names of the joints.
    location : str
        Beginning of error messages: the file and the line.
    """
    if (-1, 0) not in columns:
        raise TrajectoryError(
            f"{location}: no time column with a unit (for example time_s); the columns are {names}"
        )
    for order in range(3):
        present = [i for i in range(4) if (order, i) in columns]
        missing = [robot.joints[i].name for i in range(4) if i not in present]
        if missing and (order == 0 or present):
            examples = ""
            if order == 0:
                examples = (
                    "; examples of column names: q1_rad, q4_m, 'roll [deg]', 'joint1_position_rad'"
                )
            raise TrajectoryError(
                f"{location}: no {ORDER_NAMES[order]} of joint {', '.join(missing)}{examples}"
            )
    if (2, 0) in columns and (1, 0) not in columns:
        raise TrajectoryError(f"{location}: accelerations need velocities")


def _parse_heading(name: str, robot: Robot) -> tuple[tuple[int, int], float] | None:
    """Determine the quantity and the unit of a column from its name.

    Parameters
    ----------
    name : str
        Name of the column with its unit, such as "q1_rad" or "roll [deg]".
    robot : Robot
        Robot with the names of the joints.

    Returns
    -------
    ((int, int), float) or None
        Key and factor, or None for a column with another quantity. The key consists of the order of
        the derivative and the index of the joint, both from 0. The time has the key (−1, 0). The
        factor converts values of the column to SI units.

    Raises
    ------
    ValueError
        If the unit is missing or does not fit the quantity.
    """
    label, unit = split_heading(name)
    tokens = [token for token in re.split(r"[^a-z0-9]+|_", label.lower()) if token]
    if tokens and tokens[0] in ("t", "time", "timestamp"):
        if unit not in TIMES:
            raise ValueError(_unit_error(unit, ", ".join(TIMES)))
        return (-1, 0), TIMES[unit]
    joint, order = _parse_words(tokens, robot)
    if joint is None:
        return None
    base, per = _split_unit(unit)
    robot_joint = robot.joints[joint]
    units = LENGTHS if robot_joint.slides else ANGLES
    if base not in units:
        motion_text = f"; joint {robot_joint.name} {'slides' if robot_joint.slides else 'turns'}"
        raise ValueError(
            _unit_error(unit, f"{', '.join(units)}; derivatives add /s or /s^2") + motion_text
        )
    if order is not None and order != per:
        raise ValueError(
            f"the column is a {ORDER_NAMES[order]}, but {unit!r} is a unit of {ORDER_NAMES[per]}"
        )
    return (per, joint), units[base]


def _parse_words(tokens: list[str], robot: Robot) -> tuple[int | None, int | None]:
    """Return the joint and the derivative that the words of a column name denote.

    Parameters
    ----------
    tokens : list of str
        Words of the column name in lower case, without its unit.
    robot : Robot
        Robot with the names of the joints.

    Returns
    -------
    joint : int or None
        Index of the joint, from 0. None if no word names a joint, or if a word is unknown.
    order : int or None
        Order of the derivative, from 0. None if no word states it, or if a word is unknown.
    """
    joint = None
    order = None
    names = [joint.name for joint in robot.joints]
    unknown = []
    for k, token in enumerate(tokens):
        match = _JOINT_PATTERN.match(token)
        if match:
            joint = int(match.group(2)) - 1
            unknown.append(match.group(1))
        elif token in ("joint", "axis") and k + 1 < len(tokens) and tokens[k + 1] in tuple("1234"):
            joint = int(tokens[k + 1]) - 1
        elif token in names:
            joint = names.index(token)
        else:
            unknown.append(token)
    for token in unknown:
        if not re.fullmatch("|".join((OTHER_WORDS, *ORDER_WORDS)), token):
            return None, None
        order = next(
            (k for k, pattern in enumerate(ORDER_WORDS) if re.fullmatch(pattern, token)), order
        )
    return joint, order


def _split_unit(unit: str) -> tuple[str, int]:
    """Split a unit into the unit of the joint position and the order of the time derivative.

    For example, both deg/s and deg_per_s give ("deg", 1), and mm/s^2 gives ("mm", 2).
    """
    match = re.search(rf"({PER_SECOND})\Z", unit)
    if match is None:
        return unit, 0
    return unit[: match.start()], 2 if match[0].endswith(("2", "²")) else 1


def _unit_error(unit: str, allowed: str) -> str:
    """Return the error message for a unit that is missing or not allowed.

    Parameters
    ----------
    unit : str
        Unit in a column name, or "" if the column name has no unit.
    allowed : str
        Allowed units, separated by commas.

    Returns
    -------
    str
        Message with the unit and the allowed units.
    """
    if unit:
        return f"unit {unit!r} is not allowed (allowed: {allowed})"
    return f"the unit is missing (allowed: {allowed})"

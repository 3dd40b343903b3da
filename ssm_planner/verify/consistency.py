"""Signs that numbers are not what their column says: degrees as radians, millimetres as metres, swapped columns."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ssm_planner.errors import TrajectoryError
from ssm_planner.problem.values import Array, Robot

LARGEST_ANGLE = 8 * math.pi
"""rad: four turns; more are degrees."""
LARGEST_STROKE = 1.0
"""m; more are millimetres."""
FEW = 20
"""Intervals below which slopes are not compared with derivatives: points may rest in between."""
ENOUGH = 20_000
"""Intervals that are compared."""
ALIKE = 0.05
"""Residual and deviation of the factor, relative, up to which two columns are one the multiple of the other."""
FACTORS = ((180 / math.pi, "degrees where radians are meant"), (1000.0, "millimetres where metres are meant"))


def check_magnitudes(q: Array, robot: Robot, place: Callable[[int], str]) -> None:
    """Positions that no joint of this kind has. Raises TrajectoryError naming the point."""
    for i, joint in enumerate(robot.joints):
        revolute = joint.kind == "revolute"
        k = int(np.argmax(np.abs(q[:, i])))
        value = float(q[k, i])
        if abs(value) > (LARGEST_ANGLE if revolute else LARGEST_STROKE):
            unit, meant = ("rad", "degrees") if revolute else ("m", "millimetres")
            raise TrajectoryError(
                f"{place(k)}: position of joint {joint.name} = {value:.6g} {unit}: more than this kind of joint has; "
                f"are these {meant}, or are columns swapped?"
            )


def check_derivatives(t: Array, value: Array, derivative: Array, robot: Robot, names: tuple[str, str]) -> None:
    """Derivatives that are not those of the values (n, 4): another unit, or another joint's. Raises TrajectoryError."""
    if len(t) <= FEW:
        return
    some = np.unique(np.linspace(0, len(t) - 2, min(len(t) - 1, ENOUGH)).astype(int))
    slopes = (value[some + 1] - value[some]) / (t[some + 1] - t[some])[:, None]
    means = (derivative[some + 1] + derivative[some]) / 2
    for i, joint in enumerate(robot.joints):
        if not slopes[:, i].any():
            continue
        factor, residual = _compare(slopes[:, i], means[:, i])
        if _same(factor, residual):
            continue
        for k, other in enumerate(robot.joints):
            if _same(*_compare(slopes[:, i], means[:, k])):
                raise TrajectoryError(
                    f"the {names[1]} given for joint {other.name} are those of joint {joint.name}: swapped columns?"
                )
        if residual < ALIKE:
            hint = next((f": {text}?" for known, text in FACTORS if abs(factor / known - 1) < ALIKE), "")
            hint = hint or next(
                (f": {text} in the {names[0]}?" for k, text in FACTORS if abs(factor * k - 1) < ALIKE), ""
            )
            raise TrajectoryError(
                f"the {names[1]} of joint {joint.name} are {factor:.4g} times the slope of its {names[0]}{hint}"
            )


def _same(factor: float, residual: float) -> bool:
    return residual < ALIKE and abs(factor - 1) < ALIKE


def _compare(slope: Array, mean: Array) -> tuple[float, float]:
    """(factor, relative residual) of the mean derivative over each interval as a multiple of the slope."""
    size = float(np.linalg.norm(mean))
    if size == 0.0:
        return 0.0, 1.0
    factor = float(slope @ mean) / float(slope @ slope)
    return factor, float(np.linalg.norm(mean - factor * slope)) / size

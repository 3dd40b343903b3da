"""Task coordinates to joints and back in closed form, once, for NumPy arrays and CasADi expressions."""

from __future__ import annotations

import math
from typing import Any

from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.namespace import Namespace
from ssm_planner.model.triangle import azimuths, elbow_squares, tilt_magnitude


def joints_of_task(
    xp: Namespace, mechanism: Mechanism, task: tuple[Any, Any, Any, Any], branch: Any
) -> tuple[Any, ...]:
    """Closed-form inverse: (θ1, θ2, θ3, θ4) of (roll, tilt, spin, depth) on one branch.

    Continuous along any path that stays on the branch, with roll and spin as given (not wrapped).
    """
    roll, tilt, spin, depth = task
    mech = mechanism
    cosine2, sine2 = elbow_squares(xp, mech.alpha, mech.beta, xp.cos(tilt / 2.0), xp.sin(tilt / 2.0))
    c, s = xp.sqrt(xp.nonnegative(cosine2)), branch * xp.sqrt(xp.nonnegative(sine2))
    zeta, eta = azimuths(xp, mech.alpha, mech.beta, c, s)
    turned = xp.where(tilt * mech.side >= 0.0, 0.0, math.pi)
    theta1 = roll - zeta - mech.side * math.pi / 2.0 + turned
    theta2 = mech.delta + 2.0 * xp.arctan2(s, c)
    theta3 = spin + eta - mech.spin_offset - turned
    return theta1, theta2, theta3, mech.insertion_sign * depth


def task_of_joints(xp: Namespace, mechanism: Mechanism, q: tuple[Any, Any, Any, Any]) -> tuple[Any, Any, Any, Any]:
    """(roll, tilt, spin, depth) of joints, tilt on the home side; roll and spin are not wrapped."""
    theta1, theta2, theta3, theta4 = q
    mech = mechanism
    x = theta2 - mech.delta
    zeta, eta = azimuths(xp, mech.alpha, mech.beta, xp.cos(x / 2.0), xp.sin(x / 2.0))
    roll = theta1 + zeta + mech.side * math.pi / 2.0
    tilt = mech.side * tilt_magnitude(xp, mech.alpha, mech.beta, x)
    return roll, tilt, theta3 - eta + mech.spin_offset, mech.insertion_sign * theta4


def task_rates_of_joints(
    xp: Namespace, mechanism: Mechanism, q: tuple[Any, Any, Any, Any], qd: tuple[Any, Any, Any, Any]
) -> tuple[Any, Any, Any, Any]:
    """Time derivative of task_of_joints.

    It grows without bound towards a tilt of 0 or 180°, where roll and spin are one; there itself it is that of θ2 at rest.
    With x, P, E of triangle.py and P² + Q² = sin² φ: dφ/dx = sin α sin β sin x / sin φ on the home side,
    dζ/dx = −E sin β / sin² φ, dη/dx = −P sin α / sin² φ.
    """
    mech, (speed1, speed2, speed3, speed4) = mechanism, qd
    x = q[1] - mech.delta
    c, s = xp.cos(x / 2.0), xp.sin(x / 2.0)
    minus, plus = xp.sin(mech.alpha - mech.beta) * (c * c), xp.sin(mech.alpha + mech.beta) * (s * s)
    sine2 = (minus + plus) ** 2 + (2.0 * xp.sin(mech.beta) * s * c) ** 2
    sine2 = xp.where(sine2 > 0.0, sine2, 1.0)
    roll = speed1 - xp.sin(mech.beta) * (minus - plus) / sine2 * speed2
    tilt = mech.side * xp.sin(mech.alpha) * xp.sin(mech.beta) * (2.0 * s * c) / xp.sqrt(sine2) * speed2
    spin = speed3 + xp.sin(mech.alpha) * (minus + plus) / sine2 * speed2
    return roll, tilt, spin, mech.insertion_sign * speed4

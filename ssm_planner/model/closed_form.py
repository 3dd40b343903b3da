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

"""When there is no motion along a path: which motor cannot start or carry it, where, and what would do."""

from __future__ import annotations

import numpy as np

from ssm_planner.model.rigid_body import RigidBody
from ssm_planner.model.transmission import breakaway_torque
from ssm_planner.planning.legs import Leg
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming import Retiming
from ssm_planner.problem.values import Problem


def no_motion(problem: Problem, leg: Leg, retiming: Retiming) -> Reason:
    """The motor that is too weak to move its joint slowly along the leg, or the solver's word where none is."""
    path = leg.path
    if path is not None:
        s = np.linspace(0.0, 1.0, 201)
        q = path.sample(s).q
        gravity = RigidBody.from_robot(problem.robot).gravity_load(q)
        knots, signs = path.directions
        sigma = signs[np.clip(np.searchsorted(knots, s, side="right") - 1, 0, len(signs) - 1)]
        worst: tuple[float, Reason] | None = None
        for i, joint in enumerate(problem.robot.joints):
            if joint.drive is None or joint.motor is None or not sigma[:, i].any():
                continue
            needed = np.abs(breakaway_torque(joint.drive, gravity[:, i], sigma[:, i]))
            k = int(np.argmax(needed))
            ratio = float(needed[k] / joint.motor.max_torque)
            if ratio > 1 and (worst is None or ratio > worst[0]):
                place = f"{leg.motion.name}, {100 * s[k]:.0f} % of the way"
                message = (
                    f"motor of joint {joint.name} is too weak to move at all: it needs {1e3 * needed[k]:.4g} mN·m to break "
                    f"away against gravity and friction and has {1e3 * joint.motor.max_torque:.4g} mN·m ({place})"
                )
                relaxation = f"motor torque of joint {joint.name} of at least {1e3 * needed[k]:.4g} mN·m"
                worst = (
                    ratio,
                    Reason(
                        "motor torque", joint.name, place, float(needed[k]), joint.motor.max_torque, relaxation, message
                    ),
                )
        if worst is not None:
            return worst[1]
    return Reason(
        "solver", None, leg.motion.name, None, None, None, retiming.message or "the optimisation did not converge"
    )

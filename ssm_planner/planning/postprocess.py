"""Changes of a motion after its optimisation.

`limit_stop_travel` slows a free motion down until the tip can stop within the allowed distance from
every instant. TOPP-RA computes the fastest such timing of its path.
"""

from dataclasses import replace

import numpy as np

from ssm_planner.elements.rows import with_margin
from ssm_planner.planning.ocp.motion import PhaseSolution
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.retiming.constraints import braking_travel
from ssm_planner.planning.retiming.paths import MIN_GRID_INTERVALS, MotionPath
from ssm_planner.planning.retiming.retime import FAILURE, retime_motion, retimed_trajectory
from ssm_planner.problem import Robot

GRID_MARGIN = 2e-5
"""Relative margin that TOPP-RA's motion keeps from the limits.

TOPP-RA enforces the limits only at its grid points. The margin covers the excess between them.
"""


def limit_stop_travel(phase: Phase, strict: Robot, motion: PhaseSolution) -> PhaseSolution:
    """Return a free motion from which the tip can always stop within the allowed distance.

    If the tip would travel too far while it stops, TOPP-RA times the same path again with a bound
    on this distance (`retiming.constraints.braking_travel`). The optimal control problem itself
    does not contain this limit.

    Parameters
    ----------
    phase : Phase
        Entry of the motion list whose path the solver chooses (a free motion).
    strict : Robot
        The robot with the limits that the motion must keep.
    motion : PhaseSolution
        The motion of the phase. The status of a failure is returned unchanged.

    Returns
    -------
    PhaseSolution
        The motion if the tip can stop in time, otherwise the slower motion along the same path. Its
        status is "infeasible" if TOPP-RA finds no timing.
    """
    limit, mechanism = phase.problem.stop_travel, phase.mechanism
    if limit is None or not motion.solved:
        return motion
    trajectory = motion.trajectory
    knots = motion.border_instants / trajectory.duration
    path = MotionPath(mechanism, trajectory, knots, motion.directions)
    samples = trajectory.sample(np.linspace(0.0, motion.duration, MIN_GRID_INTERVALS))
    travel = braking_travel(mechanism, phase.problem.robot, samples.q, samples.qd)
    if travel.max() <= limit.largest:
        return motion
    # The path is the motion itself over s = t / duration, so a start at rest stays at rest for
    # every ṡ. The ṡ of the motion would leave no margin to the limits, so it is reduced. A start at
    # speed must keep its ṡ.
    speed_ratio = 1.0 if phase.qd_start.any() else 1 - 2 * GRID_MARGIN
    robot = with_margin(strict, GRID_MARGIN)
    retiming = retime_motion(path, robot, phase.problem.task_limits, speed_ratio=speed_ratio)
    if not retiming.solved:
        return replace(motion, status="infeasible", message=FAILURE)
    trajectory = retimed_trajectory(path, retiming)
    duration = phase.motion.duration
    if duration is not None:
        # A motion that is shorter than requested is stretched. The caller rejects a longer one.
        trajectory = trajectory.slower(min(trajectory.duration / duration, 1.0))
    # The borders (knots of the path) are passed at new instants.
    instants = np.interp(path.knots, retiming.s, retiming.times)
    return replace(
        motion,
        breaks=trajectory.breaks,
        coefficients=trajectory.coefficients,
        border_instants=instants * trajectory.duration / retiming.duration,
    )

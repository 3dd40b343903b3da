"""Choose points of a plan so that a controller's spline through them keeps the limits.

A controller receives points and joins them by cubics or quintics. `spline_points` chooses the
points for the exports to CSV and ROS 2. The first choice are the breaks of the plan's pieces, where
its acceleration may jump. If they do not suffice, each piece is divided into 2, 4 or 8 parts. The
spline that the controller will execute is checked like any trajectory. Its cubics differ slightly
from the quintics of the plan. If they exceed a limit by a small amount, the motion is slowed down
until it keeps the limit. Further points keep the error of quantities that the controller
interpolates linearly, such as efforts, below a bound.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ssm_planner.dynamics import REST_FRACTION
from ssm_planner.errors import ExportError
from ssm_planner.formats.points import Points, interpolate_points
from ssm_planner.plans import Plan
from ssm_planner.problem import ContinuousTorque, SymmetricLimit
from ssm_planner.trajectory import Samples
from ssm_planner.typing import Array, record
from ssm_planner.verification import Certificate, LimitCheck

DIVISIONS = (1, 2, 4, 8)
"""Numbers of equal parts into which each piece of the plan is divided, in the order of trial."""
SMOOTH_ACCELERATION_JUMP = 1e-6
"""Largest acceleration jump at a break, relative to the limit, with which quintics are tried.

A larger jump cannot occur in quintics through the breaks, because each point has one acceleration.
"""
LARGEST_SLOWDOWN = 1e-3
"""Largest relative increase of the duration with which a spline is tried."""
MAX_SLOWDOWN_TRIALS = 4
"""Largest number of slower splines that are tried."""
REST_SPEED = 1e-7
"""Speed up to which a joint counts as resting at an end of a motion, rad/s or m/s."""
TIME_ROUNDING = 1e-9
"""Coarsest resolution to which times are rounded, s."""
LINEAR_TOLERANCE = 0.005
"""Largest error of linear interpolation between points, relative to the largest value."""
JUMP_INTERVAL = 1e-4
"""Smallest distance of an additional point from its neighbours, s.

Linear interpolation cannot follow a jump. It lasts less than twice this interval between points.
"""
Law = Callable[[Samples], Array]
"""Function that returns a quantity of each joint (n, 4), such as its effort, for n samples."""


@record
class SplinePoints:
    """Points of a plan, and the certificate of the controller's spline through them."""

    samples: Samples
    """State of the joints at n points."""
    has_accelerations: bool
    """True if the controller must join the points by quintics, and False for cubics."""
    stretch: float
    """Duration of the spline divided by the duration of the plan."""
    certificate: Certificate
    """Certificate of the spline through the points."""

    @property
    def note(self) -> str:
        """Summary of the points for the manifest."""
        text = f"{len(self.samples.t)} points; {self.certificate.interpolation}"
        if self.stretch > 1:
            text += (
                f"; slower than the plan by {1e6 * (self.stretch - 1):.2g} ppm so that the spline "
                "keeps the limits"
            )
        return text


def spline_points(
    plan: Plan, certificate: Certificate, tick: float | None = 1e-9, law: Law | None = None
) -> SplinePoints:
    """Choose points of a plan for a controller that joins them by cubics or quintics.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    certificate : Certificate
        Certificate of the plan. If it did not pass, the first choice of points is returned, even if
        the spline exceeds a limit.
    tick : float, optional
        Resolution of the times that the controller accepts, s. None disables rounding.
    law : callable, optional
        Quantities that the controller interpolates linearly. Points are added until the error of
        this interpolation is at most `LINEAR_TOLERANCE`.

    Returns
    -------
    SplinePoints
        The first points for which the spline keeps every limit.

    Raises
    ------
    ExportError
        If every spline exceeds a limit.
    """
    choices = [(divisions, False) for divisions in DIVISIONS]
    if _acceleration_jump(plan) <= SMOOTH_ACCELERATION_JUMP:
        choices.insert(0, (1, True))
    trials = []
    for choice in choices:
        trials.append(_try_points(plan, *choice, 1.0, tick))
        if trials[-1].certificate.passed or not certificate.passed:
            break
    candidate = max(trials, key=lambda trial: trial.certificate.worst.margin)
    choice = choices[trials.index(candidate)]
    if law is not None:
        candidate = _try_points(plan, *choice, 1.0, tick, law=law)
    for _ in range(MAX_SLOWDOWN_TRIALS):
        if candidate.certificate.passed or not certificate.passed:
            return candidate
        factors = [_stretch_factor(plan, limit) for limit in candidate.certificate.violations]
        stretch = candidate.stretch * max(factors)
        if stretch > 1 + LARGEST_SLOWDOWN:
            break
        candidate = _try_points(plan, *choice, stretch, tick, law=law)
    raise ExportError(
        f"{plan.path}: the spline through {len(candidate.samples.t)} points exceeds "
        f"{candidate.certificate.worst.excess}: no points that keep it were found"
    )


def sample_slowed_plan(plan: Plan, t: Array, stretch: float = 1.0) -> Samples:
    """Sample a plan that is slowed down by a constant factor.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    t : (n,) array
        Instants of the slower motion, s. The motion starts at the same time as the plan.
    stretch : float
        Duration of the slower motion divided by the duration of the plan.

    Returns
    -------
    Samples
        States of the joints at these instants. The joints rest at instants that exceed the end by
        more than `TIME_ROUNDING`.
    """
    start = plan.motion.breaks[0]
    end = plan.motion.breaks[-1]
    samples = plan.motion.sample(np.minimum(start + (t - start) / stretch, end))
    last = start + plan.motion.duration * stretch + TIME_ROUNDING
    moves = ((samples.t < end) | (t <= last))[:, None]
    # The n-th time derivative of the slower motion is smaller by the factor stretch^n.
    qd = samples.qd * moves / stretch
    qdd = samples.qdd * moves / stretch**2
    qddd = samples.qddd * moves / stretch**3
    return Samples(t, samples.q, qd, qdd, qddd)


def _try_points(
    plan: Plan,
    divisions: int,
    has_accelerations: bool,
    stretch: float,
    tick: float | None,
    law: Law | None = None,
) -> SplinePoints:
    """Divide the pieces of a plan into equal parts, and check the spline through the points.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    divisions : int
        Number of equal parts into which each piece of the plan is divided.
    has_accelerations : bool
        True to join the points by quintics instead of cubics.
    stretch : float
        Duration of the spline divided by the duration of the plan.
    tick : float or None
        Resolution of the times that the controller accepts, s. None disables rounding.
    law : callable, optional
        Quantities that the controller interpolates linearly, which may require more points.

    Returns
    -------
    SplinePoints
        The points, and the certificate of the spline through them.
    """
    breaks = plan.motion.breaks
    fractions = np.arange(divisions) / divisions
    t = np.append(breaks[:-1, None] + fractions * np.diff(breaks)[:, None], breaks[-1])
    t = (t - breaks[0]) * stretch
    if law is not None:
        t = _add_points(plan, t, stretch, law)
    if tick is not None:
        t = np.round(t / tick) * tick
    samples = replace(sample_slowed_plan(plan, breaks[0] + t, stretch), t=t)
    # Remove rounding errors at the end, because controllers refuse a nonzero last velocity.
    if np.all(np.abs(samples.qd[-1]) < 1e-6):
        samples.qd[-1] = 0.0
    qdd = samples.qdd if has_accelerations else None
    reading = interpolate_points(Points(t, samples.q, samples.qd, qdd), plan.robot)
    certificate = reading.check(plan.robot, plan.limits.slower(stretch))
    return SplinePoints(samples, has_accelerations, stretch, certificate)


def _add_points(plan: Plan, t: Array, stretch: float, law: Law) -> Array:
    """Add points where the linear interpolation of a law between points deviates from the law.

    An interval whose error exceeds the tolerance is divided at the instant of the largest error,
    until the error is small enough or the interval is shorter than twice `JUMP_INTERVAL`.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    t : (n,) array
        Times of the points of the slower motion since its start, s.
    stretch : float
        Duration of the slower motion divided by the duration of the plan.
    law : callable
        Quantities that are interpolated.

    Returns
    -------
    (m,) array
        Times of all points, s.
    """
    robot = plan.robot
    begin = plan.motion.breaks[0]
    is_new = np.full(len(t), True)
    while True:
        k = np.flatnonzero((np.diff(t) > 2 * JUMP_INTERVAL) & (is_new[:-1] | is_new[1:]))
        if not len(k):
            # The law may jump at a point. Rounding must not move the point before the jump.
            return np.append(t[0], t[1:] + 0.51 * TIME_ROUNDING)
        values = law(sample_slowed_plan(plan, begin + t, stretch))
        times = np.linspace(t[k] + JUMP_INTERVAL, t[k + 1] - JUMP_INTERVAL, 9, axis=1)
        samples = sample_slowed_plan(plan, begin + times.ravel(), stretch)
        line = np.stack([np.interp(times.ravel(), t, column) for column in values.T], axis=1)
        tolerance = LINEAR_TOLERANCE * np.abs(values).max(axis=0) + 1e-12
        error = np.abs(law(samples) - line) / tolerance
        # A joint counts as resting shortly before it stops. The law then describes a start.
        rests = np.abs(samples.qd) <= REST_FRACTION * robot.velocities
        rests &= np.abs(samples.qdd) > REST_FRACTION * robot.accelerations
        error[rests] = 0
        largest = error.max(axis=1).reshape(times.shape)
        wrong = largest.max(axis=1) > 1
        middle = times[wrong, largest[wrong].argmax(axis=1)]
        t = np.sort(np.append(t, middle))
        is_new = np.isin(t, middle)


def _acceleration_jump(plan: Plan) -> float:
    """Return the largest acceleration jump at a break, relative to the limit of the joint.

    A break is an instant at which two polynomials of the plan meet.
    """
    inner = plan.motion.breaks[1:-1]
    jump = plan.motion.sample(inner, "right").qdd - plan.motion.sample(inner, "left").qdd
    return float(np.max(np.abs(jump) / plan.robot.accelerations, initial=0.0))


def _stretch_factor(plan: Plan, violation: LimitCheck) -> float:
    """Estimate how much longer a motion must last to keep a limit that it violates.

    The margin m of a violated limit is negative, and the limited quantity is 1 − m times its limit.
    If the limit concerns the n-th time derivative, the quantity decreases at least with the n-th
    power of the speed. The factor is therefore (1 − 1.2 m)^(1/n), where 1.2 adds a reserve.

    Parameters
    ----------
    plan : Plan
        Plan with the limits.
    violation : LimitCheck
        Result for the violated limit.

    Returns
    -------
    float
        Factor on the duration, above 1. It is infinite if a slower motion does not help.
    """
    limit = plan.problem.limit(violation.name, violation.joint)
    # The addend 1e-7 makes the factor effective if the margin is almost 0.
    if isinstance(limit, SymmetricLimit) and not isinstance(limit, ContinuousTorque):
        return float((1 - 1.2 * violation.margin + 1e-7) ** (1 / limit.order))
    return np.inf

"""Points of a plan through which a controller's own spline keeps the limits: reconstructed and checked, not assumed.

The points are the breaks of the plan's pieces, where its acceleration may jump, and if need be some in between. The
spline that the controller will run is built through them and checked like any trajectory. A small excess that remains,
because a cubic is not quite the plan's quintic, is removed by running the whole motion slower by as much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ssm_planner.errors import ExportError
from ssm_planner.formats.points import Points, join_points
from ssm_planner.plans import Plan
from ssm_planner.problem.limit import Symmetric
from ssm_planner.problem.limits import ContinuousTorque
from ssm_planner.trajectory import Samples
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate, LimitCheck
from ssm_planner.verification.check import check

PARTS = (1, 2, 4, 8)
"""Into how many parts each piece is cut, in the order of trial."""
SMOOTH = 1e-6
"""Largest jump of acceleration at a break, as a share of its limit, that quintics through the breaks do not mind."""
LARGEST_STRETCH = 1e-3
TRIALS = 4
REST = 1e-7
"""rad/s or m/s: slower is at rest."""
ROUNDED = 1e-9
"""s; times are rounded to no coarser ticks."""


@dataclass(frozen=True, eq=False)
class SplinePoints:
    """Points whose spline keeps what the plan keeps."""

    samples: Samples
    with_acceleration: bool
    """The controller is to join them by quintics; otherwise by cubics."""
    stretch: float
    """Duration over the plan's."""
    certificate: Certificate
    """Of the spline through the points."""

    @property
    def note(self) -> str:
        text = f"{len(self.samples.t)} points; {self.certificate.interpolation}"
        if self.stretch > 1:
            text += f"; slower than the plan by {1e6 * (self.stretch - 1):.2g} ppm so that the spline keeps the limits"
        return text


def spline_points(plan: Plan, certificate: Certificate, tick: float | None = 1e-9) -> SplinePoints:
    """Points of a plan for a controller that joins them by cubics or quintics.

    certificate: of the plan; where it did not pass, the points are those of the plan as it is. tick: resolution of
    times, s. Raises ExportError where no spline keeps the limits.
    """
    smooth = _acceleration_jump(plan) <= SMOOTH
    found = [_trial(plan, 1, True, 1.0, tick)] if smooth else []
    for parts in PARTS:
        if found and (found[-1].certificate.passed or not certificate.passed):
            return found[-1]
        found.append(_trial(plan, parts, False, 1.0, tick))
    best = max(found, key=lambda each: each.certificate.worst.margin)
    parts = PARTS[found.index(best) - smooth] if not best.with_acceleration else 1
    for _ in range(TRIALS):
        if best.certificate.passed or not certificate.passed:
            return best
        stretch = best.stretch * max(_slower(plan, limit) for limit in best.certificate.violations)
        if stretch > 1 + LARGEST_STRETCH:
            break
        best = _trial(plan, parts, best.with_acceleration, stretch, tick)
    worst = best.certificate.worst
    raise ExportError(
        f"{plan.path}: the spline through {len(best.samples.t)} points exceeds the {worst.name} limit of "
        f"{worst.joint or 'the tool'} by {-100 * worst.margin:.3g} % at {worst.time:.4f} s: no points that keep it were found"
    )


def at_times(plan: Plan, t: Array, stretch: float = 1.0) -> Samples:
    """The plan run slower by a factor, at times t (n,) of the slower motion; beyond its end it rests there.

    A time within ROUNDED of the end is the end.
    """
    begin, end = plan.motion.breaks[0], plan.motion.breaks[-1]
    s = plan.motion.sample(np.minimum(begin + (t - begin) / stretch, end))
    moving = (s.t < end)[:, None] | (t <= begin + plan.motion.duration * stretch + ROUNDED)[:, None]
    qd, qdd, qddd = (x * moving / stretch**k for k, x in enumerate((s.qd, s.qdd, s.qddd), start=1))
    return Samples(t, s.q, qd, qdd, qddd)


def _trial(
    plan: Plan, parts: int, with_acceleration: bool, stretch: float, tick: float | None
) -> SplinePoints:
    breaks = plan.motion.breaks
    shares = np.arange(parts) / parts
    t = np.append((breaks[:-1, None] + shares * np.diff(breaks)[:, None]).ravel(), breaks[-1])
    t = (t - breaks[0]) * stretch
    if tick is not None:
        t = np.round(t / tick) * tick
    s = at_times(plan, breaks[0] + t, stretch)
    s = Samples(t, s.q, s.qd, s.qdd, s.qddd)
    # at rest at the end, whatever rounding has left: controllers refuse a last velocity
    if np.all(np.abs(s.qd[-1]) < 1e-6):
        s.qd[-1] = 0.0
    reading = join_points(Points(t, s.q, s.qd, s.qdd if with_acceleration else None), plan.robot)
    certificate = check(
        reading.trajectory,
        plan.robot,
        plan.limits.slower(stretch),
        interpolation=reading.interpolation,
    )
    return SplinePoints(s, with_acceleration, stretch, certificate)


def _acceleration_jump(plan: Plan) -> float:
    inner = plan.motion.breaks[1:-1]
    jump = plan.motion.sample(inner, "right").qdd - plan.motion.sample(inner, "left").qdd
    return float(
        np.max(np.abs(jump) / [joint.acceleration for joint in plan.robot.joints], initial=0.0)
    )


def _slower(plan: Plan, found: LimitCheck) -> float:
    """By which factor the motion must be slower to keep a limit; infinite where slowing does not help.

    A quantity that depends on the nth derivative falls at least with the nth power of the speed, where the motion is
    slowed a little.
    """
    for limit in plan.problem.all_limits:
        if (
            limit.key == (found.name, found.joint)
            and isinstance(limit, Symmetric)
            and not isinstance(limit, ContinuousTorque)
        ):
            return float((1 - 1.2 * found.margin + 1e-7) ** (1 / limit.order))
    return np.inf

"""The bounds within which the package's scripts identify the rigs, and published parameters that lie outside.

The sign of the package's products of inertia: what it does to the bodies and to the motor torques.

Stribeck's term as the package computes it, exp(−|w|/w_s)², and as a Gaussian, exp(−(w/w_s)²).

The sign of the velocity product C(q, q̇) q̇ in the effort that the drives carry.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ssm_planner.dynamics.friction import friction_coefficient, friction_of, stribeck_shape
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.identification.fit import fit_map
from ssm_planner.loading.mechanism import possible, principal_moments
from ssm_planner.paper.published import DRIVEN
from ssm_planner.paper.rigs import RigResult, published_drive
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.robot import Body, Robot, frozen
from ssm_planner.sizing.joint_load import JointLoad, joint_loads
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array

_NONE, _SUPPORT = (0.0, 0.0), (1e-5, 1e-3)

BOUNDS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "rig1_lead_screw": {
        "preload": _NONE,
        "b_c": (1e-3, 1e-2),
        "b_v": _SUPPORT,
        "b_oc": (1e-3, 5e-2),
        "b_ov": (0.0, 1e-5),
        "mu": (0.20, 0.21),
        "mu_stribeck": (0.0, 0.08),
        "stribeck_speed": (0.0, 15.0),
        "dwell_constant": _NONE,
        "memory": _NONE,
    },
    "rig2_antibacklash_screw": {
        "preload": (0.5, 1.5),
        "b_c": (1e-5, 1e-2),
        "b_v": _SUPPORT,
        "b_oc": (1e-5, 5e-2),
        "b_ov": (0.0, 1e-5),
        "mu": (0.15, 0.27),
        "mu_stribeck": (0.0, 0.2),
        "stribeck_speed": (0.0, 15.0),
        "dwell_constant": _NONE,
        "memory": _NONE,
    },
    "rig3_worm": {
        "preload": _NONE,
        "b_c": (1e-4, 1e-3),
        "b_v": _SUPPORT,
        "b_oc": (1e-5, 1e-2),
        "b_ov": (0.0, 1e-5),
        "mu": (0.12, 0.16),
        "mu_stribeck": (0.0, 0.1),
        "stribeck_speed": (0.0, 1.0),
        "dwell_constant": _NONE,
        "memory": (0.0, 0.25),
    },
}
"""Lower and upper bound by rig and parameter, SI (sd_1dof.m of the package)."""


@dataclass(frozen=True)
class Outside:
    """A published parameter that the package's own identification cannot return; SI."""

    rig: str
    parameter: str
    value: float
    bounds: tuple[float, float]


def outside_bounds(name: str, drive: Drive) -> tuple[Outside, ...]:
    """Published parameters of a rig outside the package's bounds."""
    published = {} if drive.rig is None else drive.rig.published
    return tuple(
        Outside(drive.name, parameter, published[parameter], bounds)
        for parameter, bounds in BOUNDS[name].items()
        if parameter in published and not bounds[0] <= published[parameter] <= bounds[1]
    )


@dataclass(frozen=True, eq=False)
class BodyMoments:
    """Principal moments about the centre of mass, ascending, kg·m², (3,) each."""

    name: str
    as_tensor: Array
    """The published products taken as entries of the tensor, as the toolbox takes them."""
    as_cad: Array
    """Taken with the CAD program's sign, as the robot file does."""

    @property
    def possible(self) -> tuple[bool, bool]:
        """Whether a body can have them."""
        return possible(self.as_tensor), possible(self.as_cad)


def flipped(robot: Robot) -> Robot:
    """The robot with all products of inertia negated: the package's reading of its own figures."""
    first, second, third, fourth = (_flipped(body) for body in robot.bodies)
    return replace(robot, bodies=(first, second, third, fourth))


def body_moments(robot: Robot) -> tuple[BodyMoments, ...]:
    """Of every body with mass."""
    return tuple(
        BodyMoments(
            body.name,
            principal_moments(body.mass, body.com, _flipped(body).inertia),
            principal_moments(body.mass, body.com, body.inertia),
        )
        for body in robot.bodies
        if body.mass > 0
    )


def joint_inertia(robot: Robot) -> Array:
    """Diagonal of the mass matrix at home, (4,), kg·m² and kg."""
    return np.diagonal(RigidBody.from_robot(robot).mass_matrix(np.zeros((1, 4)))[0]).copy()


def torque_change(robot: Robot, trajectory: Trajectory) -> dict[str, float]:
    """Largest change of motor torque at any instant of a motion through the flipped sign, N·m, by driven joint."""
    return largest_change(joint_loads(trajectory, robot), joint_loads(trajectory, flipped(robot)))


def largest_change(before: Sequence[JointLoad], after: Sequence[JointLoad]) -> dict[str, float]:
    """Largest change of motor torque between loads of the same instants, N·m, by joint; 0 for joints without one."""
    change = dict.fromkeys(DRIVEN, 0.0)
    for a, b in zip(before, after, strict=True):
        change[a.joint] = max(change[a.joint], float(np.abs(b.torque() - a.torque()).max()))
    return change


def _flipped(body: Body) -> Body:
    diagonal = np.diag(np.diag(body.inertia))
    return replace(body, inertia=frozen(2 * diagonal - body.inertia, (3, 3)))


SPEEDS = (0.25, 0.5, 1.0, 2.0)
"""Motor speed by Stribeck speed at which μ is shown."""


@dataclass(frozen=True, eq=False)
class StribeckForms:
    """Of one rig with a published Stribeck term. Each pair: the package's form, the Gaussian."""

    title: str
    mu: tuple[tuple[float, float], ...]
    """At SPEEDS."""
    largest: tuple[float, float, float]
    """|w|/w_s at which the coefficients lie farthest apart, and both there."""
    published_nrmsd: tuple[float, float]
    """Of the map, with the published parameters."""
    fitted_nrmsd: tuple[float, float]
    fitted_speed: tuple[float, float]
    """w_s, rad/s."""
    criterion: tuple[float, float]
    """AICc of the two fits."""


def stribeck_forms(drive: Drive, result: RigResult) -> StribeckForms | None:
    """Both forms on one rig; None where its authors give no Stribeck speed."""
    pair = tuple(published_drive(drive, law) for law in ("stribeck_exponential", "stribeck_gaussian"))
    exponential, gaussian = pair
    speed = friction_of(exponential).stribeck_speed
    if not speed:
        return None
    x = np.linspace(0.0, 4.0, 4001)
    gap = np.abs(stribeck_shape("stribeck_gaussian", x) - stribeck_shape("stribeck_exponential", x))
    widest = float(x[int(np.argmax(gap))])
    other = fit_map(drive, result.data, result.rig.F_payload, law="stribeck_gaussian", reference=result.rig.published)
    fits = (result.fits["stribeck_exponential"], other)
    return StribeckForms(
        result.title,
        tuple((_mu(exponential, s * speed), _mu(gaussian, s * speed)) for s in SPEEDS),
        (widest, _mu(exponential, widest * speed), _mu(gaussian, widest * speed)),
        (result.map_nrmsd(exponential), result.map_nrmsd(gaussian)),
        (fits[0].nrmsd, fits[1].nrmsd),
        (fits[0].estimates["stribeck_speed"].value, fits[1].estimates["stribeck_speed"].value),
        (fits[0].criterion["stribeck_exponential"], fits[1].criterion["stribeck_gaussian"]),
    )


def _mu(drive: Drive, w: float) -> float:
    return float(friction_coefficient(friction_of(drive), w))


@dataclass(frozen=True)
class VelocitySign:
    """Over one motion, by driven joint: N·m or N for effort, N·m for torque."""

    effort: dict[str, float]
    """Largest |C q̇|."""
    gravity: dict[str, float]
    """Largest effort of gravity, for comparison."""
    torque: dict[str, float]
    """Largest change of motor torque where the velocity product is subtracted instead of added."""


def subtracted(load: JointLoad) -> JointLoad:
    """The load with M q̈ − C q̇ + g instead of M q̈ + C q̇ + g."""
    return replace(load, velocity=-load.velocity)


def velocity_sign(loads: Sequence[JointLoad]) -> VelocitySign:
    """What the sign changes over a motion."""
    effort, gravity = dict.fromkeys(DRIVEN, 0.0), dict.fromkeys(DRIVEN, 0.0)
    for load in loads:
        effort[load.joint] = max(effort[load.joint], float(np.abs(load.velocity).max()))
        gravity[load.joint] = max(gravity[load.joint], float(np.abs(load.gravity).max()))
    return VelocitySign(effort, gravity, largest_change(loads, [subtracted(load) for load in loads]))

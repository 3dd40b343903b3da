"""Compute where the published package differs from its own equations, and by how much.

The package is the MATLAB code that the authors published with the paper.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from paper_reproduction.friction import RigResult, published_drive
from paper_reproduction.motions import RUNS, SpeedRun
from paper_reproduction.published import BOUNDS, DRIVEN, Inputs
from paper_reproduction.section import Section
from ssm_planner.dynamics import RigidBody, friction_coefficient, required_friction, stribeck_shape
from ssm_planner.identification import fit_map
from ssm_planner.problem import (
    Body,
    Drive,
    FrictionLawName,
    Motorisation,
    Robot,
    is_possible_inertia,
    principal_moments,
    read_only_array,
    unchecked_copy,
)
from ssm_planner.reporting import COLOURS, draw_legend, finish_axes, new_figure
from ssm_planner.sizing import DutyCycle, JointLoad, joint_loads
from ssm_planner.typing import Array, frozen, record

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FORMS = ("exp(−2x)", "exp(−x²)")
"""Forms of the Stribeck term, where x is the ratio of motor speed to Stribeck speed."""
STRIBECK_LAWS: tuple[FrictionLawName, ...] = ("stribeck_exponential", "stribeck_gaussian")
"""Names of the friction laws with these forms."""


def departures_section(
    inputs: Inputs, runs: Sequence[SpeedRun], rigs: Sequence[RigResult]
) -> Section:
    """Build the section about the differences between the published package and its equations.

    They concern the sign of the products of inertia, the exponent of the Stribeck term, the sign of
    the velocity product, the torque at standstill, and the bounds of the identification.

    Parameters
    ----------
    inputs : Inputs
        Problems, drives and recordings of the project.
    runs : sequence of SpeedRun
        Rows of Table III after planning.
    rigs : sequence of RigResult
        Results for the test rigs.
    """
    solved = [run for run in runs if run.loads]
    payload_runs = {
        f"payload curves, {RUNS[name]}": run for name, run in inputs.motorisations.items()
    }
    payload_signs = [
        (label, velocity_sign(DutyCycle.of_motorisation(run).loads()))
        for label, run in payload_runs.items()
    ]
    payload_changes = [max(sign.torque.values()) for _, sign in payload_signs]
    forms = [stribeck_forms(inputs.rigs[rig.name], rig) for rig in rigs]
    values = {
        "bodies": body_moments(inputs.robot),
        "inertia": joint_inertia(inputs.robot),
        "flipped_inertia": joint_inertia(flipped(inputs.robot)),
        "inertia_changes": [
            *map(_change_of_motion, solved),
            *itertools.starmap(_change_of_payload, payload_runs.items()),
        ],
        "FORMS": FORMS,
        "STRIBECK_SPEEDS": STRIBECK_SPEEDS,
        "forms": [form for form in forms if form is not None],
        "velocity": [
            *((run.row.label, velocity_sign(run.loads)) for run in solved),
            *payload_signs,
        ],
        "payload_change": max(payload_changes, default=0.0),
        "standstill": [(run.row.label, _largest_starts(run)) for run in solved],
        "outside": list(itertools.chain(*itertools.starmap(outside_bounds, inputs.rigs.items()))),
    }
    return Section("departures", values, {"stribeck_forms": _stribeck_figure()})


def _change_of_motion(run: SpeedRun) -> tuple[str, dict[str, float], dict[str, float]]:
    """Return how much the motor torques of a motion change if the products of inertia are negated.

    Returns
    -------
    label : str
        Name of the motion.
    change : dict
        Largest change of the motor torque by driven joint, N·m.
    peak : dict
        Largest motor torque by driven joint, N·m.
    """
    assert run.plan.trajectory is not None
    flipped_loads = joint_loads(run.plan.trajectory, flipped(run.plan.problem.robot))
    peaks = {joint: max(abs(end) for end in run.envelope(joint)) for joint in DRIVEN}
    return run.row.label, largest_change(run.loads, flipped_loads), peaks


def _change_of_payload(
    label: str, run: Motorisation
) -> tuple[str, dict[str, float], dict[str, float]]:
    """Return the results of `_change_of_motion` for a payload curve with the name `label`."""
    loads = DutyCycle.of_motorisation(run).loads()
    flipped_loads = DutyCycle.of_motorisation(replace(run, robot=flipped(run.robot))).loads()
    return (
        label,
        largest_change(loads, flipped_loads),
        {load.joint: float(np.abs(load.torque()).max()) for load in loads},
    )


def _largest_starts(run: SpeedRun) -> list[float | None]:
    """Return the largest motor torque at the start of a motion of each driven joint, N·m.

    The value of a joint that never starts is None.
    """
    loads = [run.load(joint) for joint in DRIVEN]
    torques = [np.abs(load.torque()[load.breakaway > 0]) for load in loads]
    return [float(torque.max()) if len(torque) else None for torque in torques]


def _stribeck_figure() -> "Figure":
    """Draw both forms of the Stribeck term over the speed."""
    figure = new_figure(4.8, 3.2)
    axes = figure.subplots()
    x = np.linspace(0.0, 3.0, 301)
    styles = ((f"{FORMS[0]}, the package", "-"), (f"{FORMS[1]}, a Gaussian", "--"))
    for law, (label, dash), colour in zip(STRIBECK_LAWS, styles, COLOURS, strict=False):
        axes.plot(x, stribeck_shape(law, x), dash, color=colour, label=label)
    finish_axes(axes, "speed by the Stribeck speed", "Stribeck's part of μ by its value at rest")
    draw_legend(axes)
    return figure


@frozen
class Outside:
    """Published parameter in SI units that is outside the bounds of the package's identification.

    The package can therefore not have identified it.
    """

    rig: str
    parameter: str
    value: float
    bounds: tuple[float, float]


def outside_bounds(name: str, drive: Drive) -> tuple[Outside, ...]:
    """Return the published parameters of a test rig that are outside the bounds of the package.

    `name` is the name of the rig in BOUNDS, and `drive` its drive.
    """
    published = {} if drive.rig is None else drive.rig.published
    return tuple(
        Outside(drive.name, parameter, published[parameter], bounds)
        for parameter, bounds in BOUNDS[name].items()
        if parameter in published and not bounds[0] <= published[parameter] <= bounds[1]
    )


@record
class BodyMoments:
    """Principal moments of a body about its centre of mass in ascending order, kg·m², (3,) each."""

    name: str
    as_tensor: Array
    """Moments if the published products are entries of the tensor, as the toolbox assumes."""
    as_cad: Array
    """Moments if the products have the sign of CAD programs, as in the robot file."""

    @property
    def possible(self) -> tuple[bool, bool]:
        """True for each of `as_tensor` and `as_cad` if a rigid body can have these moments."""
        return is_possible_inertia(self.as_tensor), is_possible_inertia(self.as_cad)


def flipped(robot: Robot) -> Robot:
    """Return a robot whose products of inertia are negated, as the package interprets them."""
    body1, body2, body3, body4 = (_flipped(body) for body in robot.bodies)
    return replace(robot, bodies=(body1, body2, body3, body4))


def body_moments(robot: Robot) -> tuple[BodyMoments, ...]:
    """Compute the principal moments of every body that has a mass."""
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
    """Return the diagonal of the mass matrix at q = 0, (4,), kg·m² and kg."""
    return np.diagonal(RigidBody.from_robot(robot).mass_matrix(np.zeros((1, 4)))[0]).copy()


def largest_change(
    loads: Sequence[JointLoad], changed_loads: Sequence[JointLoad]
) -> dict[str, float]:
    """Return the largest change of the motor torque of each driven joint, N·m.

    `loads` and `changed_loads` are compared.

    Both sets have the same joints and instants. A joint without a load has 0.
    """
    pairs = zip(loads, changed_loads, strict=True)
    return _largest_magnitudes(
        (before.joint, after.torque() - before.torque()) for before, after in pairs
    )


def _largest_magnitudes(values: Iterable[tuple[str, Array]]) -> dict[str, float]:
    """Return the largest magnitude of the values of each driven joint.

    `values` contains pairs of a joint and its values (n,). A joint may occur several times.
    """
    largest = dict.fromkeys(DRIVEN, 0.0)
    for joint, value in values:
        largest[joint] = max(largest[joint], float(np.abs(value).max()))
    return largest


def _flipped(body: Body) -> Body:
    """Return a body whose products of inertia are negated."""
    diagonal = np.diag(np.diag(body.inertia))
    return unchecked_copy(body, inertia=read_only_array(2 * diagonal - body.inertia, (3, 3)))


STRIBECK_SPEEDS = (0.25, 0.5, 1.0, 2.0)
"""Ratios of motor speed to Stribeck speed for which the document lists μ."""


@record
class StribeckForms:
    """Comparison of both forms of the Stribeck term for one test rig.

    In each pair, the first value belongs to the form of the package, and the second to the Gaussian
    form.
    """

    title: str
    mu: tuple[tuple[float, float], ...]
    """Friction coefficients at STRIBECK_SPEEDS."""
    largest: tuple[float, float, float]
    """Ratio |w|/w_s at which the coefficients differ most, and both coefficients."""
    published_nrmsd: tuple[float, float]
    """NRMSD of the map with the published parameters."""
    fitted_nrmsd: tuple[float, float]
    """NRMSD of the map with fitted parameters."""
    fitted_speed: tuple[float, float]
    """Fitted Stribeck speeds w_s, rad/s."""
    criterion: tuple[float, float]
    """RMS error of both fits on recordings outside the fit, N·m."""


def stribeck_forms(drive: Drive, result: RigResult) -> StribeckForms | None:
    """Compare both forms of the Stribeck term for one test rig.

    The result is None if the authors do not state a Stribeck speed for this rig.
    """
    exponential, gaussian = (published_drive(drive, law) for law in STRIBECK_LAWS)
    speed = required_friction(exponential).stribeck_speed
    if not speed:
        return None
    x = np.linspace(0.0, 4.0, 4001)
    shapes = [stribeck_shape(law, x) for law in STRIBECK_LAWS]
    widest_ratio = float(x[int(np.argmax(np.abs(shapes[1] - shapes[0])))])
    rig = result.rig
    gaussian_fit = fit_map(
        drive, result.data, rig.F_payload, law=STRIBECK_LAWS[1], reference=rig.published
    )
    first_fit, second_fit = fits = (result.fits[STRIBECK_LAWS[0]], gaussian_fit)

    def coefficients(ratio: float) -> tuple[float, float]:
        """Return the friction coefficients of both forms at a multiple of the Stribeck speed."""
        exponential_mu, gaussian_mu = (
            float(friction_coefficient(required_friction(form), ratio * speed))
            for form in (exponential, gaussian)
        )
        return exponential_mu, gaussian_mu

    first_speed, second_speed = (fit.estimates["stribeck_speed"].value for fit in fits)
    return StribeckForms(
        result.title,
        mu=tuple(map(coefficients, STRIBECK_SPEEDS)),
        largest=(widest_ratio, *coefficients(widest_ratio)),
        published_nrmsd=(result.map_nrmsd(exponential), result.map_nrmsd(gaussian)),
        fitted_nrmsd=(first_fit.nrmsd, second_fit.nrmsd),
        fitted_speed=(first_speed, second_speed),
        criterion=(first_fit.criterion[first_fit.law], second_fit.criterion[second_fit.law]),
    )


@frozen
class VelocitySign:
    """Effect of a wrong sign of the velocity product C q̇ on one motion, by driven joint.

    C q̇ contains the Coriolis and centrifugal efforts.
    """

    effort: dict[str, float]
    """Largest |C q̇|, N·m or N."""
    gravity: dict[str, float]
    """Largest effort of gravity for comparison, N·m or N."""
    torque: dict[str, float]
    """Largest change of motor torque after subtracting the velocity product, N·m."""


def subtracted(load: JointLoad) -> JointLoad:
    """Return the load of a joint with M q̈ − C q̇ + g instead of M q̈ + C q̇ + g.

    M is the mass matrix, C q̇ the velocity product and g the effort of gravity.
    """
    return replace(load, velocity=-load.velocity)


def velocity_sign(loads: Sequence[JointLoad]) -> VelocitySign:
    """Compute the effect of a wrong sign of the velocity product C q̇ on a motion.

    C q̇ contains the Coriolis and centrifugal efforts. `loads` contains the load of each driven
    joint.
    """
    return VelocitySign(
        _largest_magnitudes((load.joint, load.velocity) for load in loads),
        _largest_magnitudes((load.joint, load.gravity) for load in loads),
        largest_change(loads, [subtracted(load) for load in loads]),
    )

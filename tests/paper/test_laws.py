"""The claims of the document are tested as laws.

No motion exceeds a bound, equivalent formulas agree, and some terms vanish.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from paper_reproduction import published
from paper_reproduction.departures import (
    body_moments,
    flipped,
    joint_inertia,
    outside_bounds,
    subtracted,
    velocity_sign,
)
from paper_reproduction.friction import (
    LAWS,
    friction_maps,
    published_drive,
    with_friction,
    with_rows,
)
from paper_reproduction.motions import payloads, tilts_of
from paper_reproduction.published import BOUNDS, Inputs
from paper_reproduction.tilt_rate import tilt_rate_bound
from paper_reproduction.workspace import design_choice, tilt_range
from ssm_planner.dynamics.friction import friction_coefficient, required_friction, stribeck_shape
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_rates
from ssm_planner.problem.robot import Robot
from ssm_planner.sizing.duty import DutyCycle
from tests.support.paper_cases import Made


def test_table_i_is_exact_for_the_printed_beta_and_shifted_by_its_rounding(robot: Robot) -> None:
    result = tilt_range(robot)
    for printed, exact in zip(result.printed, result.exact, strict=True):
        assert printed.theoretical == pytest.approx(printed.paper, abs=1e-12)
        shift = 0.0 if exact.name == "tilt range" else published.BETA - result.beta
        assert exact.theoretical - exact.paper == pytest.approx(shift, abs=1e-12)
    assert result.printed[0].agreement == pytest.approx(published.TILT_AGREEMENT)


def test_the_design_follows_from_the_requirement() -> None:
    choice = design_choice()
    assert choice.region.smallest_alpha == pytest.approx((published.ALPHA, published.BETA))
    assert choice.least == pytest.approx((published.REQUIRED_TILT / 2, published.BETA))
    assert choice.spare == pytest.approx(published.ALPHA - published.REQUIRED_TILT / 2)


def test_no_motion_beats_the_bound_of_the_tilt_rate(made: Made) -> None:
    problem = made.inputs.problem
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    ends, acceleration = tilts_of(problem), problem.robot.joints[0].acceleration
    bound = tilt_rate_bound(mechanism, ends, acceleration)
    for run in made.document.runs:
        samples = run.plan.motion.uniform(1000.0)
        rates = task_rates(mechanism, samples.q, samples.qd)
        assert 0.0 < np.abs(rates[:, 1]).max() < bound.rate
    # The chosen interpretation relies on this limit.
    assert bound.rate < math.radians(80.0)
    assert tilt_rate_bound(mechanism, ends, 4.0 * acceleration).rate == pytest.approx(
        2.0 * bound.rate
    )
    assert tilt_rate_bound(mechanism, ends[::-1], acceleration).rate == pytest.approx(bound.rate)
    inner = (ends[0] + 0.1, ends[1] - 0.1)
    assert tilt_rate_bound(mechanism, inner, acceleration).rate < bound.rate


def test_motions_keep_the_printed_speeds_and_reach_them(made: Made) -> None:
    assert made.document.is_certified
    for run in made.document.runs:
        assert run.plan.trajectory is not None
        speed = np.abs(run.plan.trajectory.uniform(2000.0).qd).max(axis=0)
        assert speed[:3].max() == pytest.approx(run.row.tilt, rel=1e-3)
        assert speed[3] == pytest.approx(run.row.insertion, rel=1e-3)
        assert np.all(speed <= np.array([*[run.row.tilt] * 3, run.row.insertion]) * (1 + 1e-6))
        assert run.reaches()


def test_envelopes_hold_the_peaks_that_the_plan_requires(made: Made) -> None:
    for run in made.document.runs:
        peaks = {
            requirement.joint: requirement.peak_torque for requirement in run.plan.requirements
        }
        for joint, peak in peaks.items():
            assert max(map(abs, run.envelope(joint))) == pytest.approx(peak, rel=1e-6)


def test_unloaded_maps_are_the_closed_form_of_table_ii(robot: Robot) -> None:
    for m in friction_maps(robot):
        row, friction = published.TABLE_II[m.joint], required_friction(m.drive)
        angle = math.atan(row.mu / math.cos(m.drive.pressure_angle))
        mesh = m.drive.gamma * math.tan(m.drive.lead_angle + angle)
        effort = friction.b_oc + friction.b_ov * m.w / m.drive.ratio
        expected = row.b_c + row.b_v * m.w + mesh * effort
        np.testing.assert_allclose(m.unloaded[0], expected, rtol=1e-12)
        np.testing.assert_allclose(m.unloaded[1], -expected, rtol=1e-12)
        assert m.mesh == pytest.approx(mesh * effort[-1])
        for side, (low, high) in enumerate(m.loaded):
            assert np.all(low <= high)
            # If the load passes through zero, the band contains the map without load.
            if m.gravity[0] <= 0.0 <= m.gravity[1]:
                assert np.all(
                    (low <= m.unloaded[side] + 1e-12) & (m.unloaded[side] <= high + 1e-12)
                )


def test_the_arms_weight_at_home_lies_in_its_range(robot: Robot) -> None:
    home = RigidBody.from_robot(robot).gravity_load(np.zeros((1, 4)))[0]
    for m in friction_maps(robot):
        assert (
            m.gravity[0] - 1e-9
            <= home[("roll", "tilt", "spin", "insertion").index(m.joint)]
            <= m.gravity[1] + 1e-9
        )


def test_the_sign_of_products_moves_moments_but_not_their_sum(robot: Robot) -> None:
    result = body_moments(robot)
    assert len(result) == 3
    for body in result:
        assert body.as_tensor.sum() == pytest.approx(body.as_cad.sum())
        assert body.possible == (False, True)
    twice = flipped(flipped(robot))
    for a, b in zip(robot.bodies, twice.bodies, strict=True):
        np.testing.assert_allclose(a.inertia, b.inertia, atol=1e-18)
    q = np.array([[0.3, -0.7, 0.2, -0.01]])
    gravity = [RigidBody.from_robot(item).gravity_load(q) for item in (robot, flipped(robot))]
    np.testing.assert_allclose(gravity[0], gravity[1], atol=1e-12)
    assert joint_inertia(flipped(robot))[0] > 1.5 * joint_inertia(robot)[0]


def test_the_velocity_product_of_a_joint_that_moves_alone_vanishes(inputs: Inputs) -> None:
    for motorisation in inputs.motorisations.values():
        loads = DutyCycle.of_motorisation(motorisation).loads()
        assert {load.joint for load in loads} == set(published.DRIVEN)
        sign = velocity_sign(loads)
        assert max(sign.effort.values()) < 1e-12
        assert max(sign.torque.values()) < 1e-12
        assert min(sign.gravity.values()) > 0.1


def test_the_velocity_product_grows_with_the_square_of_speed(made: Made) -> None:
    slow, fast = (velocity_sign(run.loads) for run in made.document.runs[:2])
    for joint in ("roll", "tilt"):
        assert fast.effort[joint] == pytest.approx(4.0 * slow.effort[joint], rel=0.02)
    for load in made.document.runs[0].loads:
        assert np.all(
            subtracted(load).tau_rigid - load.tau_rigid
            == pytest.approx(-2.0 * load.velocity, abs=1e-12)
        )


def test_stribecks_two_forms_agree_at_rest_and_at_twice_the_speed_only() -> None:
    x = np.linspace(0.0, 3.0, 3001)
    gap = stribeck_shape("stribeck_gaussian", x) - stribeck_shape("stribeck_exponential", x)
    assert gap[[0, 2000]] == pytest.approx([0.0, 0.0], abs=1e-15)
    assert np.all(gap[1:2000] > 0)
    assert np.all(gap[2001:] < 0)


def test_the_published_drive_of_a_rig_has_its_authors_parameters(inputs: Inputs) -> None:
    for name, drive in inputs.rigs.items():
        assert drive.rig is not None
        values = drive.rig.published
        friction = required_friction(published_drive(drive))
        assert {key: getattr(friction, key) for key in ("mu", "b_c", "b_v", "b_oc", "b_ov")} == {
            key: values[key] for key in ("mu", "b_c", "b_v", "b_oc", "b_ov")
        }
        still = values["mu"] + values["mu_stribeck"]
        assert friction.mu_static == pytest.approx(still)
        if values.get("stribeck_speed"):
            assert float(friction_coefficient(friction, 0.0)) == pytest.approx(still), name
    assert published.PACKAGE_FRICTION["roll"].b_c == inputs.rigs["rig3_worm"].rig.published["b_c"]


def test_fits_of_the_map_beat_the_published_parameters(made: Made) -> None:
    for rig in made.document.rigs:
        before = rig.map_nrmsd(rig.published)
        for law in LAWS:
            assert rig.fits[law].nrmsd < before
        for tested in rig.tested:
            assert tested.ours < tested.published < 0.13


def test_parameters_called_outside_the_bounds_are(inputs: Inputs) -> None:
    """The document lists exactly the published parameters that lie outside their bounds."""
    for name, drive in inputs.rigs.items():
        assert drive.rig is not None
        outside = {item.parameter for item in outside_bounds(name, drive)}
        for parameter, (low, high) in BOUNDS[name].items():
            value = drive.rig.published.get(parameter)
            assert (parameter in outside) == (value is not None and (value < low or value > high))
            assert low <= high
    drive = inputs.rigs["rig3_worm"]
    inside = {parameter: high for parameter, (_, high) in BOUNDS["rig3_worm"].items()}
    assert not outside_bounds("rig3_worm", replace(drive, rig=replace(drive.rig, published=inside)))


def test_payload_curves_with_table_ii_are_those_of_the_robot(inputs: Inputs) -> None:
    first = payloads(inputs)[0]
    as_shipped = DutyCycle.of_motorisation(first.run).loads()
    for load, joint in zip(as_shipped, first.identified.joints, strict=True):
        np.testing.assert_allclose(joint.requirement.torque, load.torque(), rtol=1e-9)
    worm = with_rows(first.run.robot, published.PACKAGE_FRICTION).joints[0].drive
    assert worm == with_friction(worm, published.PACKAGE_FRICTION["roll"])

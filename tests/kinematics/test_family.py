"""A family of mechanisms gives the same results as each of its members."""

from __future__ import annotations

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.kinematics.family import MechanismFamily
from ssm_planner.kinematics.mechanism import Mechanism, tilt_magnitudes
from ssm_planner.kinematics.task import joints_of_task
from ssm_planner.kinematics.workspace import boundary_distance
from ssm_planner.problem.robot import Geometry


def _family(count=60):
    rng = np.random.default_rng(5)
    alpha = rng.uniform(np.radians(20), np.radians(50), count)
    tilt = -rng.uniform(np.radians(100), np.radians(125), count)
    return MechanismFamily(alpha, tilt, rng.uniform(-0.3, 0.3, count))


def _member(family, i):
    x = np.cross([0, 1.0, 0], family.omega3[i])
    x /= np.linalg.norm(x)
    tool = np.column_stack((x, np.cross(family.omega3[i], x), family.omega3[i]))
    return Mechanism.from_geometry(
        Geometry(family.omega1[i], family.omega2[i], family.omega3[i], tool)
    )


def test_angles_and_joints_agree_with_every_member():
    family = _family()
    task = np.array([[0.1, -1.8, 0.2, 0.004], [-0.3, -2.0, -0.1, 0.02]])
    result = {branch: family.joints(task, branch) for branch in (1, -1)}
    for i in range(len(family.alpha)):
        member = _member(family, i)
        assert np.allclose(
            (family.beta[i], family.delta[i]), (member.beta, member.delta), rtol=0, atol=1e-12
        )
        assert family.side[i] == member.side
        low, high = (ends[i] for ends in family.tilt_magnitudes)
        assert np.allclose(
            (low, high), tilt_magnitudes(member.alpha, member.beta), rtol=0, atol=1e-12
        )
        for branch in (1, -1):
            theta = joints_of_task(NUMPY, member, tuple(task.T), branch * member.home_branch)
            expected = np.stack(np.broadcast_arrays(*theta), axis=-1)
            # Angles that differ by whole turns are equal.
            away = np.angle(np.exp(1j * (result[branch][i] - expected)[:, :3]))
            assert np.abs(away).max() < 1e-9
            assert np.allclose(result[branch][i][:, 3], expected[:, 3])


def test_distance_to_the_boundary_is_that_of_the_worst_tilt():
    family = _family()
    tilts = np.radians([-85.0, -110.0, -130.0])
    distance = family.boundary_distance(tilts)
    for i in range(len(family.alpha)):
        assert np.isclose(
            distance[i], boundary_distance(_member(family, i), tilts).min(), atol=1e-12
        )


def test_tilts_on_the_other_side_are_out_of_reach():
    assert np.all(_family().boundary_distance(np.radians([100.0])) == -np.inf)

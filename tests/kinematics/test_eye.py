"""The distances to retina and lens are compared with dense points on the shaft and the lens.

The constraint rows for optimisation agree with the limits, and their gradients are continuous.
"""

from __future__ import annotations

import dataclasses
import math

import casadi
import numpy as np
import pytest

from ssm_planner.codegen.namespace import NUMPY, casadi_namespace
from ssm_planner.kinematics.eye import (
    eye_constraints,
    eye_limits,
    lens_constraint,
    lens_ratio,
    retina_constraint,
    retina_distance,
    smallest_lens_ratio,
)
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import pose_from_task
from ssm_planner.kinematics.workspace import tilt_interval
from ssm_planner.loading.load import load_problem
from ssm_planner.problem.problem import Eye, Lens
from ssm_planner.problem.robot import read_only_array
from ssm_planner.problem.value import unchecked_copy
from tests.support.paths import PROBLEMS

APPROACH = PROBLEMS / "eye_approach.yaml"
SHARES = np.linspace(0.0, 1.0, 4001)


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    matrix, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return matrix * np.sign(np.linalg.det(matrix))


def random_eye(rng: np.random.Generator) -> Eye:
    """Return a random eye around the remote centre, with a lens that is clear of the port."""
    while True:
        turned, frame = random_rotation(rng), random_rotation(rng)
        centre = turned @ [0.0, 0.0, -0.012 * rng.uniform(0.9, 1.1)]
        semi_axes = rng.uniform(0.001, 0.005, 3)
        lens_centre = centre + random_rotation(rng)[:, 0] * rng.uniform(0.002, 0.008)
        lens = Lens(
            read_only_array(lens_centre, (3,)),
            read_only_array(semi_axes, (3,)),
            read_only_array(frame, (3, 3)),
        )
        eye = Eye(
            read_only_array(centre, (3,)),
            0.012,
            rng.uniform(0.0, 0.0015),
            0.003,
            rng.uniform(0.0, 0.0005),
            lens,
        )
        if np.linalg.norm(frame.T @ lens_centre / semi_axes) > smallest_lens_ratio(eye):
            return eye


def tips_in(rng: np.random.Generator, eye: Eye, count: int = 300) -> np.ndarray:
    return eye.centre + rng.uniform(-1.2, 1.2, (count, 3)) * eye.radius


def test_retina_allows_the_inner_ball_and_the_port() -> None:
    rng = np.random.default_rng(1)
    for _ in range(30):
        eye = random_eye(rng)
        tips = np.vstack((tips_in(rng, eye), rng.uniform(-1, 1, (100, 3)) * 1.2 * eye.port))
        distance = retina_distance(NUMPY, eye, tips.T)
        inside = np.linalg.norm(tips - eye.centre, axis=1) <= eye.radius - eye.clearance
        at_port = np.linalg.norm(tips, axis=1) <= eye.port
        assert np.array_equal(distance >= eye.clearance, inside | at_port)
        beyond = np.linalg.norm(tips, axis=1) > eye.clearance + eye.port
        wall = eye.radius - np.linalg.norm(tips - eye.centre, axis=1)
        assert np.array_equal(distance[beyond & (wall >= 0)], wall[beyond & (wall >= 0)])
        # The distance changes by no more than the tip moves, so it has no steps.
        moved = tips + rng.uniform(-1, 1, tips.shape) * 1e-5
        change = np.abs(retina_distance(NUMPY, eye, moved.T) - distance)
        assert np.all(change <= np.linalg.norm(moved - tips, axis=1) * (1 + 1e-9))


def test_lens_ratio_is_the_nearest_of_dense_points_along_the_shaft() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        lens = random_eye(rng).lens
        for tip in lens.centre + rng.uniform(-1.5, 1.5, (20, 3)) * 0.006:
            points = SHARES[:, None] * tip
            dense = np.linalg.norm(
                (points - lens.centre) @ lens.frame / lens.semi_axes, axis=1
            ).min()
            result = float(lens_ratio(NUMPY, lens, tip))
            assert result <= dense + 1e-12
            assert result == pytest.approx(dense, abs=1e-3)


def surface(lens: Lens, enlarged: float, count: int = 20_000) -> np.ndarray:
    """Return points (count, 3) on the surface of the lens enlarged by the factor `enlarged`."""
    k = np.arange(count) + 0.5
    polar, around = np.arccos(1 - 2 * k / count), math.pi * (1 + math.sqrt(5)) * k
    ball = np.stack(
        (np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)), axis=1
    )
    return lens.centre + (enlarged * ball * lens.semi_axes) @ lens.frame.T


def to_segment(points: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """Return the distances (n,) of points from the segment between the origin and the tip."""
    share = np.clip(points @ tip / (tip @ tip), 0.0, 1.0)
    return np.linalg.norm(points - share[:, None] * tip, axis=1)


def test_a_shaft_at_the_limit_keeps_its_radius_from_the_lens() -> None:
    rng = np.random.default_rng(3)
    for _ in range(40):
        eye = random_eye(rng)
        tip = eye.lens.centre * rng.uniform(0.7, 1.6) + rng.uniform(-1, 1, 3) * 0.006
        ratio = float(lens_ratio(NUMPY, eye.lens, tip))
        # The lens is scaled so that this shaft is exactly at the limit.
        size = ratio - eye.shaft_radius / eye.lens.semi_axes.min()
        if size <= 0.05:
            continue
        grown = dataclasses.replace(
            eye.lens, semi_axes=read_only_array(eye.lens.semi_axes * size, (3,))
        )
        # The copy is unchecked because the lens may be too large for the eye.
        at_limit = unchecked_copy(eye, lens=grown)
        value, least = eye_limits(NUMPY, at_limit, tip)["lens clearance"]
        assert value == pytest.approx(least, rel=1e-12)
        nearest = to_segment(surface(grown, 1.0), tip).min()
        assert nearest >= eye.shaft_radius - 1e-6
        # The lens enlarged by the ratio just touches the shaft.
        assert to_segment(surface(grown, float(value)), tip).min() < 2e-4


def test_everything_turns_with_the_eye() -> None:
    """A rotation of eye and tip around the remote centre changes no limit and no constraint row."""
    rng = np.random.default_rng(4)
    eye = random_eye(rng)
    tips = tips_in(rng, eye)
    turned = random_rotation(rng)
    lens = Lens(
        read_only_array(turned @ eye.lens.centre, (3,)),
        eye.lens.semi_axes,
        read_only_array(turned @ eye.lens.frame, (3, 3)),
    )
    other = dataclasses.replace(eye, centre=read_only_array(turned @ eye.centre, (3,)), lens=lens)
    for evaluate in (
        lambda e, p: [v for v, _ in eye_limits(NUMPY, e, p).values()],
        lambda e, p: list(eye_constraints(NUMPY, e, p).values()),
    ):
        for a, b in zip(evaluate(eye, tips.T), evaluate(other, turned @ tips.T), strict=True):
            assert np.abs(a - b).max() < 1e-12


@pytest.mark.parametrize("kind", [casadi.SX, casadi.MX])
def test_symbolic_equals_numeric(kind) -> None:
    """The symbolic limits and constraint rows equal the numeric ones."""
    rng = np.random.default_rng(5)
    for _ in range(5):
        eye = random_eye(rng)
        symbol = kind.sym("p", 3)
        xp = casadi_namespace()
        values = [value for value, _ in eye_limits(xp, eye, symbol).values()] + list(
            eye_constraints(xp, eye, symbol).values()
        )
        function = casadi.Function("eye", [symbol], [casadi.vertcat(*values)])
        tips = np.vstack(
            (tips_in(rng, eye, 100), np.zeros((1, 3)), 1e-3 * rng.uniform(-1, 1, (50, 3)))
        )
        numeric = [value for value, _ in eye_limits(NUMPY, eye, tips.T).values()] + list(
            eye_constraints(NUMPY, eye, tips.T).values()
        )
        assert np.abs(function(tips.T).full() - np.stack(numeric)).max() < 1e-13


def test_beyond_the_port_the_retina_row_allows_what_is_allowed() -> None:
    """Outside the port, the retina row is satisfied exactly where the clearance is kept."""
    rng = np.random.default_rng(6)
    for _ in range(50):
        eye = random_eye(rng)
        edge = rng.standard_normal((400, 3))
        edge *= eye.port / np.linalg.norm(edge, axis=1)[:, None] * rng.uniform(0.98, 1.02, (400, 1))
        tips = np.vstack((tips_in(rng, eye), rng.uniform(-1, 1, (300, 3)) * 1.2 * eye.port, edge))
        tips = tips[np.linalg.norm(tips, axis=1) > eye.port]
        row = retina_constraint(NUMPY, eye, tips.T)
        allowed = retina_distance(NUMPY, eye, tips.T) >= eye.clearance
        assert 10 < allowed.sum() < len(tips) - 10
        assert ((row <= 0) == allowed)[np.abs(row) > 1e-12].all()


def test_a_tip_as_near_to_the_retina_as_allowed_is_on_the_edge_of_the_row() -> None:
    """The retina row is zero at a tip whose distance from the retina equals the clearance."""
    rng = np.random.default_rng(7)
    for _ in range(50):
        eye = random_eye(rng)
        away = rng.standard_normal((100, 3))
        tips = (
            eye.centre + (eye.radius - eye.clearance) * away / np.linalg.norm(away, axis=1)[:, None]
        )
        assert np.abs(retina_constraint(NUMPY, eye, tips.T)).max() < 1e-12


def test_rows_are_once_continuously_differentiable() -> None:
    """The gradients of the constraint rows are continuous.

    They agree on both sides of the edge of the port. They also agree where the point of the shaft
    nearest to the lens reaches the tip.
    """
    rng = np.random.default_rng(8)
    symbol = casadi.SX.sym("p", 3)
    for _ in range(20):
        eye = random_eye(rng)
        rows = casadi.vertcat(*eye_constraints(casadi_namespace(), eye, symbol).values())
        gradient = casadi.Function("gradient", [symbol], [casadi.jacobian(rows, symbol)])
        edge = rng.standard_normal(3)
        edge *= eye.port / np.linalg.norm(edge)
        across = rng.standard_normal(3)
        # The tip is the nearest point of the shaft if the scaled shaft and the scaled vector from
        # the tip to the lens are orthogonal.
        scale = eye.lens.frame / eye.lens.semi_axes @ eye.lens.frame.T
        at_tip = np.linalg.solve(scale, (scale @ eye.lens.centre + 0.3 * across)) * 0.5
        way = scale @ at_tip
        at_tip *= float(way @ (scale @ eye.lens.centre)) / float(way @ way)
        for place in (edge, at_tip):
            inner, outer = (gradient(place * (1 + step)).full() for step in (-1e-9, 1e-9))
            assert np.abs(inner - outer).max() < 1e-4 * max(1.0, np.abs(inner).max())


def test_derivatives_are_finite_with_the_tip_in_the_remote_centre() -> None:
    rng = np.random.default_rng(9)
    symbol = casadi.SX.sym("p", 3)
    for _ in range(10):
        eye = random_eye(rng)
        row = lens_constraint(casadi_namespace(), eye, eye.lens, symbol)
        function = casadi.Function("row", [symbol], [row, *casadi.hessian(row, symbol)])
        for size in (0.0, 1e-15, 1e-9, 1e-6):
            for value in function(size * rng.standard_normal(3)):
                assert np.isfinite(value.full()).all()
                assert np.abs(value.full()).max() < 1e10


def test_the_shipped_eye_lies_as_its_comments_say() -> None:
    problem = load_problem(APPROACH)
    eye, mechanism = problem.eye, Mechanism.from_geometry(problem.robot.geometry)
    up, wall = np.array([0.0, 0.0, 1.0]), 0.012
    # The port lies 4 mm along the wall behind the limbus, which is 6 mm from the optical axis.
    from_axis = math.asin(0.006 / wall) + 0.004 / wall
    assert np.linalg.norm(eye.centre) == pytest.approx(wall, abs=2e-5)
    assert math.acos(-eye.centre @ up / wall) == pytest.approx(from_axis, abs=2e-3)
    cornea = eye.centre + wall * up
    assert (cornea - (eye.centre - eye.radius * up)) @ up == pytest.approx(0.0233)
    back = eye.lens.centre - eye.lens.semi_axes[2] * eye.lens.frame[:, 2]
    assert (cornea - back) @ up == pytest.approx(0.008)
    # At the tilt that the file states, the tool points at the macula. This tilt is well inside the
    # range of the robot.
    macula = eye.centre - eye.radius * up
    tips = pose_from_task(mechanism, [0.0, math.radians(-115.3), 0.0, np.linalg.norm(macula)])[1]
    assert np.abs(tips[0] - macula).max() < 5e-5
    low, high = tilt_interval(mechanism)
    assert low + 0.4 < math.radians(-115.3) < high - 0.4
    target = np.array(problem.motion[0].to.position)
    assert float(retina_distance(NUMPY, eye, target)) == pytest.approx(0.0015)


def test_without_a_lens_only_the_retina_counts() -> None:
    eye = dataclasses.replace(random_eye(np.random.default_rng(10)), lens=None)
    assert (
        list(eye_limits(NUMPY, eye, np.ones(3)))
        == list(eye_constraints(NUMPY, eye, np.ones(3)))
        == ["retina clearance"]
    )
    assert smallest_lens_ratio(eye) == 1.0

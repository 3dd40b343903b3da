"""Verify the passes of TOPP-RA against the package toppra and closed forms.

The tests run with and without the compiled part.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ssm_planner.native import library
from ssm_planner.planning.retiming.constraints import LinearConstraints
from ssm_planner.planning.retiming.reachability import fastest_profile
from ssm_planner.typing import Array

POINTS = 120
AGREES = 2e-5
"""toppra has absolute tolerances. It stays within bounds, or exceeds them, by up to 1e-8."""
KEPT = 1e-12 if library.load() else 1e-7
Case = tuple[Array, LinearConstraints, tuple[float, float]]


def random_rows(rng: np.random.Generator, grid: Array, *, viscous: bool) -> LinearConstraints:
    """Return random constraints of accelerations and torques along a smooth path.

    The coefficients a, b and c have both signs. With `viscous`, some rows have a = 0.
    """
    count = int(rng.integers(2, 8))
    phase, turns = rng.uniform(0, 6, (3, count)), rng.uniform(0.5, 6, (3, count))
    a, b, c = np.sin(turns[:, None] * grid[:, None] + phase[:, None])
    c *= rng.uniform(0.0, 1.05)  # With c above 1, the motor is too weak to hold the load.
    if viscous:
        a[:, 0], b[:, 0] = 0.0, np.abs(b[:, 0])
    ceiling = rng.uniform(0.5, 5) * (1.2 + np.sin(rng.uniform(1, 9) * grid))
    rows = (
        np.concatenate([a, -a], axis=1),
        np.concatenate([b, -b], axis=1),
        np.concatenate([c, -c], axis=1),
    )
    return LinearConstraints(*rows, np.zeros_like(rows[0]), ceiling)


def by_toppra(grid: Array, rows: LinearConstraints, speeds: tuple[float, float]) -> Array | None:
    """Return the squared speeds by the package toppra, or None if it finds no profile."""
    toppra = pytest.importorskip("toppra")
    from toppra.constraint import LinearConstraint
    from toppra.constraint.linear_constraint import canlinear_colloc_to_interpolate

    toppra.setup_logging("CRITICAL")
    count = rows.a.shape[1]

    class Rows(LinearConstraint):  # type: ignore[misc, no-any-unimported]
        def __init__(self) -> None:
            super().__init__()
            self.identical = True

        def compute_constraint_params(self, *_: object, **__: object) -> tuple[object, ...]:
            collocated = rows.a, rows.b, rows.c, np.eye(count), np.ones(count)
            a, b, c, f, g, *_ = canlinear_colloc_to_interpolate(
                *collocated, None, None, grid, identical=True
            )
            return a, b, c, f, g, None, np.stack([np.zeros(len(grid)), rows.ceiling], axis=1)

    class Line(toppra.interpolator.AbstractGeometricPath):  # type: ignore[misc, name-defined]
        dof, path_interval, waypoints = 1, np.array([0.0, 1.0]), None

        def __call__(self, s: Array, order: int = 0) -> Array:
            return np.zeros((np.size(s), 1))

    algorithm = toppra.algorithm.TOPPRA([Rows()], Line(), grid, solver_wrapper="seidel")
    _, speed, _, _ = algorithm.compute_parameterization(*speeds, return_data=True)
    return None if speed is None or not np.isfinite(speed).all() else np.asarray(speed) ** 2


def duration(grid: Array, speed_squared: Array) -> float:
    """Return the duration in s of a profile with constant acceleration between grid points."""
    speed = np.sqrt(speed_squared)
    return float((2 * np.diff(grid) / (speed[1:] + speed[:-1])).sum())


def random_case(seed: int) -> Case:
    """Return a grid, random constraints and speeds at both ends."""
    rng = np.random.default_rng(seed)
    grid = np.sort(np.concatenate([[0.0, 1.0], rng.uniform(0, 1, POINTS - 2)]))
    rows = random_rows(rng, grid, viscous=seed % 3 == 0)
    first, last = (
        (0.0, 0.0) if seed % 2 else np.sqrt(rows.ceiling[[0, -1]]) * rng.uniform(0, 0.5, 2)
    )
    return grid, rows, (float(first), float(last))


def hard_case(seed: int) -> Case:
    """Return a case with rows that bound the speed alone, also from below.

    Other rows do not depend on the speed, and nothing can satisfy some of these.
    """
    grid, rows, _ = random_case(2 * seed + 1)
    rng, shape = np.random.default_rng(seed), (len(grid), 3)
    a, b, c = (np.zeros(shape) for _ in range(3))
    b[:, 0] = -1.0
    c[:, 0] = 1 + rng.uniform(-0.1, 0.15)  # This row requires ṡ² ≥ c − 1.
    b[:, 1], c[:, 1] = -rng.uniform(0.5, 2.0, len(grid)), 1 + rng.uniform(-0.2, 0.02, len(grid))
    c[:, 2] = rng.uniform(0.5, 1.0)
    if seed % 7 == 0:
        c[rng.integers(len(grid)), 2] = 1.001
    if seed % 7 == 1:
        c[:, 2] = 1.0
    parts = (np.hstack([*item]) for item in ((rows.a, a), (rows.b, b), (rows.c, c)))
    complete = LinearConstraints(*parts, np.zeros((len(grid), rows.a.shape[1] + 3)), rows.ceiling)
    least = max(float(c[[0, -1], :2].max()) - 1, 0.0)
    return grid, complete, (np.sqrt(least * rng.uniform(1, 3)), np.sqrt(least * rng.uniform(1, 3)))


@pytest.mark.skipif(library.load() is None, reason="installed without the compiled part")
@pytest.mark.parametrize("make_case", [random_case, hard_case])
def test_without_the_compiled_part_motions_are_as_fast(
    make_case: Callable[[int], Case], monkeypatch: pytest.MonkeyPatch
) -> None:
    cases = [make_case(seed) for seed in range(80)]
    compiled = [fastest_profile(*case) for case in cases]
    assert 0.05 < np.mean([profile is None for profile in compiled]) < 0.95
    monkeypatch.setenv("SSM_PLANNER_NATIVE", "0")
    for case, in_c in zip(cases, compiled, strict=True):
        by_package = fastest_profile(*case)
        assert (in_c is None) == (by_package is None)
        if in_c is not None and by_package is not None:
            expected = duration(case[0], in_c)
            assert duration(case[0], by_package) == pytest.approx(expected, rel=5e-6)


@pytest.mark.parametrize("seed", range(60))
def test_as_fast_as_toppra_and_within_the_rows(seed: int) -> None:
    grid, rows, speeds = random_case(seed)
    mine, other = fastest_profile(grid, rows, speeds), by_toppra(grid, rows, speeds)
    assert (mine is None) == (other is None)
    if mine is None or other is None:
        return
    assert duration(grid, mine) == pytest.approx(duration(grid, other), rel=AGREES)
    acceleration = np.diff(mine) / (2 * np.diff(grid))
    for end, x in ((slice(None, -1), mine[:-1]), (slice(1, None), mine[1:])):
        value = rows.a[end] * acceleration[:, None] + rows.b[end] * x[:, None] + rows.c[end]
        assert value.max() <= 1 + KEPT * (1 + np.abs(rows.a[end] * acceleration[:, None]).max())
    assert (mine <= rows.ceiling * (1 + KEPT)).all()
    assert mine[0] == pytest.approx(speeds[0] ** 2, abs=KEPT)
    assert mine[-1] == pytest.approx(speeds[1] ** 2, abs=KEPT)


@pytest.mark.parametrize("compiled", ["0", "1"])
def test_a_limit_on_acceleration_alone_gives_the_triangle(
    compiled: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SSM_PLANNER_NATIVE", compiled)
    grid = np.linspace(0, 1, 201)
    both = np.ones((201, 2)) * [0.5, -0.5]  # |s̈| ≤ 2
    rows = LinearConstraints(both, 0 * both, 0 * both, 0 * both, np.full(201, 100.0))
    result = fastest_profile(grid, rows, (0.0, 0.0))
    assert result is not None
    assert result == pytest.approx(4 * np.minimum(grid, 1 - grid), abs=1e-6)


@pytest.mark.parametrize("compiled", ["0", "1"])
def test_a_speed_that_cannot_be_had_at_an_end_gives_none(
    compiled: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A speed that the constraints do not allow at an end gives no profile."""
    monkeypatch.setenv("SSM_PLANNER_NATIVE", compiled)
    grid = np.linspace(0, 1, 11)
    both = np.ones((11, 2)) * [1.0, -1.0]
    rows = LinearConstraints(both, 0 * both, 0 * both, 0 * both, np.full(11, 9.0))
    assert fastest_profile(grid, rows, (0.0, 1.0)) is not None
    assert fastest_profile(grid, rows, (0.0, 1.5)) is None
    assert fastest_profile(grid, rows, (1.5, 0.0)) is None
    assert fastest_profile(grid, rows, (0.0, 3.1)) is None

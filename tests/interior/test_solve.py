"""Verify the structured interior-point solver on problems whose optimum has a closed form.

The solver must also report that an infeasible program does not converge.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from ssm_planner.elements.compiled import compiled_library
from ssm_planner.interior.problem import Point, Program, RowGroup
from ssm_planner.interior.solve import Outcome, solve
from ssm_planner.interior.spline import Spline
from ssm_planner.planning.lower_bound import rest_to_rest
from ssm_planner.typing import Array
from tests.support.casadi_group import CasadiGroup

pytestmark = pytest.mark.skipif(
    not compiled_library(), reason="the package is built without its compiled part"
)
some = st.floats(0.1, 10.0)


def chain(
    fractions: Array,
    distance: float,
    *,
    velocity: float = np.inf,
    acceleration: float = np.inf,
    jerk: float = np.inf,
) -> Program:
    """Return the program that moves one coordinate from rest at 0 to rest at `distance` > 0.

    It minimises the time.
    """
    n = len(fractions)
    smooth = np.isfinite(jerk)
    spline = Spline(
        "bspline" if smooth else "hermite",
        1,
        fractions,
        np.zeros(n, dtype=int),
        None if smooth else 1.0,
    )
    # Each element has the variables z = (u, u̇, ü_0, ü_1, h, u̇_b).
    matrix = np.array(
        [
            *([0, side, 0, 0, 0, 0] for side in (1, -1)),
            *([0, 0, 0, 0, 0, side] for side in (1, -1)),
            *([0, 0, side, 0, 0, 0] for side in (1, -1)),
            *([0, 0, 0, side, 0, 0] for side in (1, -1)),
            *([0, 0, -side, side, -jerk if smooth else 0, 0] for side in (1, -1)),
        ],
        dtype=float,
    )
    bound = [velocity, 0.0, velocity, 0.0, *[acceleration] * 4, *[0.0 if smooth else np.inf] * 2]
    free = np.ones((spline.rows, 1), dtype=bool)
    ends = 3 if smooth else 2
    free[:ends] = free[-ends:] = False
    return Program(
        spline=spline,
        groups=(),
        matrix=matrix,
        bound=np.tile(bound, (n, 1)),
        free=free,
        equal=(*np.zeros((2, 0), dtype=int), np.zeros(0)),
        least_times=np.array([1e-2]),
        duration=(0.0, np.inf),
        time_weight=1.0,
        smoothing=np.zeros(1),
        block_variance_weight=0.0,
    )


def start(program: Program, distance: float, time: float) -> Point:
    """Return the cubic from rest to rest as the starting point."""
    s = np.append(0.0, np.cumsum(program.spline.fractions))
    u, v, a = (3 - 2 * s) * s**2, 6 * s * (1 - s) / time, (6 - 12 * s) / time**2
    rest = np.array([1.0, *np.ones(len(s) - 2), 1.0])
    if program.spline.kind == "bspline":
        a = a * np.concatenate([[0.0], rest[1:-1], [0.0]])
    c = program.spline.unknowns(
        *(distance * x[:, None] for x in (u, v, a)), program.spline.fractions * time
    )
    if program.spline.kind == "bspline":
        c[:3], c[-3:] = 0.0, distance
    return Point(c, np.array([time]))


def pieces(*lengths: float, each: int = 4) -> Array:
    """Return the fractions of a mesh with element borders at the ends of all pieces."""
    total = sum(lengths)
    return np.concatenate(
        [np.full(each, length / each / total) for length in lengths if length > 1e-9 * total]
    )


def fastest(program: Program, distance: float, guess: float) -> Outcome:
    """Return the solution that starts from a cubic with the duration `guess`."""
    return solved(program, start(program, distance, guess))


def solved(program: Program, point: Point) -> Outcome:
    """Return the outcome of the solver with fixed options."""
    return solve(
        program,
        point,
        warm=None,
        iterations=300,
        barrier_exponent=1.5,
        centring_tolerance=np.inf,
    )


def rows_of(
    symbolic: Callable[[ca.SX], list[ca.SX]], fractions: Array, at: tuple[float, ...] = (0.0, 1.0)
) -> RowGroup:
    """Return rows of (u, u̇, ü) at these fractions of every element, at most 1 each."""
    z = ca.SX.sym("z", 5)
    u, v, a0, a1, h = ca.vertsplit(z)
    rows = []
    for c in at:
        rise = c * (a1 - a0)
        state = ca.vertcat(
            u + c * h * (v + c * h * (a0 / 2 + rise / 6)), v + c * h * (a0 + rise / 2), a0 + rise
        )
        rows += symbolic(state)
    value = ca.vertcat(*rows)
    lam = ca.SX.sym("lam", value.numel())
    functions = {
        "rows": ca.Function("rows", [z], [ca.densify(value)]),
        "jacobian": ca.Function("jacobian", [z], [ca.jacobian(value, z)]),
        "hessian": ca.Function("hessian", [z, lam], [ca.hessian(ca.dot(lam, value), z)[0]]),
    }
    n = len(fractions)
    return RowGroup(CasadiGroup(functions, n), np.arange(n), np.ones((n, value.numel())))


@settings(deadline=None, max_examples=40)
@given(distance=some, velocity=some, acceleration=some)
# The solver begins this case with a dozen short steps.
@example(distance=5.0, velocity=0.5, acceleration=6.0)
def test_bang_bang_with_a_velocity_limit(
    distance: float, velocity: float, acceleration: float
) -> None:
    """The duration is T = D/v + v/a if the velocity limit is reached, and T = 2 √(D/a) otherwise.

    The mesh has element borders at the times when the acceleration switches.
    """
    profile = rest_to_rest(distance, velocity, acceleration)
    program = chain(
        pieces(*profile.lengths), distance, velocity=velocity, acceleration=acceleration
    )
    program = replace(program, least_times=np.array([0.1 * profile.duration]))
    found = fastest(program, distance, 1.5 * profile.duration)
    assert found.converged
    assert found.state.point.times[0] == pytest.approx(profile.duration, rel=2e-6)


@settings(deadline=None, max_examples=30)
@given(distance=some, velocity=some, acceleration=some, jerk=some)
def test_jerk_limited_rest_to_rest_is_ruckigs(
    distance: float, velocity: float, acceleration: float, jerk: float
) -> None:
    ruckig = pytest.importorskip("ruckig", reason="Ruckig is not installed")
    task, reference = ruckig.InputParameter(1), ruckig.Trajectory(1)
    task.current_position, task.target_position = [0.0], [distance]
    task.max_velocity, task.max_acceleration, task.max_jerk = [velocity], [acceleration], [jerk]
    assume(ruckig.Ruckig(1).calculate(task, reference) == ruckig.Result.Working)
    lengths = rest_to_rest(distance, velocity, acceleration, jerk).lengths
    # Very short pieces would test the mesh instead of the solver.
    assume(lengths.min() >= 1e-2 * lengths.sum())
    program = chain(
        pieces(*lengths), distance, velocity=velocity, acceleration=acceleration, jerk=jerk
    )
    program = replace(program, least_times=np.array([0.1 * reference.duration]))
    found = fastest(program, distance, 1.5 * reference.duration)
    assert found.converged
    assert found.state.point.times[0] == pytest.approx(reference.duration, rel=1e-5)


def test_a_torque_limit_against_gravity() -> None:
    """The constraint |ü + g| ≤ 1 allows the accelerations 1 − g and −(1 + g).

    The duration is T = √(2 D (1/(1 − g) + 1/(1 + g))).
    """
    gravity, distance = 0.4, 3.0
    up, down = 1 - gravity, 1 + gravity
    time = np.sqrt(2 * distance * (1 / up + 1 / down))
    fractions = pieces(down, up, each=10)
    group = rows_of(lambda x: [x[2] + gravity, -x[2] - gravity], fractions)
    result = fastest(replace(chain(fractions, distance), groups=(group,)), distance, 1.3 * time)
    assert result.converged
    assert result.state.point.times[0] == pytest.approx(time, rel=1e-6)


@pytest.mark.parametrize("each", [10, 20, 40])
def test_a_torque_limit_with_viscous_friction(each: int) -> None:
    """With |ü + k u̇| ≤ 1, the error of the duration decreases with the square of the step h.

    The motion accelerates with v = (1 − e^{−k t})/k and brakes with v' = −1 − k v.
    """
    k, distance = 1.0, 2.0
    # After the time t1 of acceleration, braking from v1 takes ln(1 + k v1)/k. The distance of
    # braking is v1/k − ln(1 + k v1)/k².
    low, high = 0.0, 50.0
    for _ in range(200):
        t1 = (low + high) / 2
        v1 = (1 - np.exp(-k * t1)) / k
        t2 = np.log1p(k * v1) / k
        way = t1 / k - v1 / k + v1 / k - t2 / k
        low, high = (t1, high) if way < distance else (low, t1)
    fractions = pieces(t1, t2, each=each)
    group = rows_of(lambda x: [x[2] + k * x[1], -x[2] - k * x[1]], fractions, at=(0.0, 0.5, 1.0))
    result = fastest(
        replace(chain(fractions, distance), groups=(group,)), distance, 1.3 * (t1 + t2)
    )
    assert result.converged
    assert result.state.point.times[0] == pytest.approx(t1 + t2, rel=0.1 / each**2)


def test_least_effort_in_a_given_time() -> None:
    """The cubic from rest to rest has the least ∫ ü² dt, which is 12 D²/T³."""
    fractions, distance, time = pieces(1.0, 2.0, each=5), 2.0, 1.7
    # The integral over an element is h (a_0² + a_0 a_1 + a_1²) / 3.
    program = replace(
        chain(fractions, distance),
        duration=(time, time),
        time_weight=0.0,
        smoothing=np.full(1, 1 / 3),
    )
    guess = start(program, distance, time)
    result = solved(program, Point(guess.c + 0.1 * program.free, guess.times))
    assert result.converged
    assert result.objective == pytest.approx(12 * distance**2 / time**3, rel=1e-9)
    assert result.state.point.times[0] == pytest.approx(time, rel=1e-12)


def test_a_point_on_the_way_of_a_jerk_limited_motion() -> None:
    """The symmetric optimum passes u = D/2. A motion through u = D/3 takes longer."""
    profile = rest_to_rest(2.0, 1.0, 1.0, 2.0)
    fractions = pieces(*profile.lengths)
    program = chain(fractions, 2.0, velocity=1.0, acceleration=1.0, jerk=2.0)
    middle = int(np.searchsorted(np.cumsum(fractions), 0.5 - 1e-9)) + 1
    times = []
    for share in (1 / 2, 1 / 3):
        given = replace(program, equal=(np.array([middle]), np.array([0]), np.array([2.0 * share])))
        result = fastest(given, 2.0, 1.5 * profile.duration)
        assert result.converged
        assert result.z[middle, 0] == pytest.approx(2.0 * share, abs=1e-9)
        times.append(result.state.point.times[0])
    assert times[0] == pytest.approx(profile.duration, rel=1e-5)
    assert times[1] > 1.02 * profile.duration


@settings(deadline=None, max_examples=20)
@given(distance=some, faster=st.floats(0.3, 3.0))
def test_time_scales_with_the_limits(distance: float, faster: float) -> None:
    """The time is 1/λ if velocity limits are λ times and acceleration limits λ² times as large.

    This holds on any mesh.
    """
    fractions = np.full(17, 1 / 17)
    times = [
        fastest(
            chain(fractions, distance, velocity=x, acceleration=2 * x**2),
            distance,
            4 * (distance + 1) / x,
        )
        for x in (1.0, faster)
    ]
    assert all(found.converged for found in times)
    assert times[0].state.point.times[0] == pytest.approx(
        faster * times[1].state.point.times[0], rel=1e-5
    )


def test_a_program_with_an_impossible_row_does_not_converge() -> None:
    """A program with a row that no motion can keep does not converge."""
    fractions = pieces(1.0, 1.0)
    group = rows_of(lambda x: [x[0] + 3.0], fractions)
    assert not fastest(
        replace(chain(fractions, 2.0, acceleration=1.0), groups=(group,)), 2.0, 5.0
    ).converged


def test_rows_that_are_identically_zero_are_masked() -> None:
    """The row u̇ ≥ 0 of a node at rest is masked, because its slack can only be zero."""
    program = chain(pieces(1.0, 1.0), 2.0, acceleration=1.0)
    state = fastest(program, 2.0, 5.0).state
    mask = state.multipliers[:-1].reshape(program.bound.shape) > 0
    assert np.array_equal(state.slacks[:-1] == 1.0, ~mask.ravel())
    assert not mask[0, 1]
    assert mask[1:, 1].all()
    assert not mask[:, [0, 2]].any()


def test_earlier_solutions_do_not_change_a_bit() -> None:
    program = chain(pieces(1.0, 1.3, 1.0), 2.0, velocity=0.9, acceleration=1.0)
    first = fastest(program, 2.0, 5.0)
    fastest(chain(pieces(1.0, 1.0), 2.0, acceleration=1.0), 2.0, 5.0)
    again = fastest(program, 2.0, 5.0)
    assert first.state.point.times.tobytes() == again.state.point.times.tobytes()
    assert first.z.tobytes() == again.z.tobytes()

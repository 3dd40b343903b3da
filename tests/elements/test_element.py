"""Verify the derivatives and the cost integrals of one element.

The references are derivatives of the whole element by CasADi, Gauss quadrature, and the exact
friction law.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from ssm_planner.dynamics.motors import motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.elements.element import SIMPSON_WEIGHTS, element_functions
from ssm_planner.elements.free_element import FreeElement
from ssm_planner.elements.rows import joint_limits
from ssm_planner.elements.straight_element import StraightElement
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.planning.ocp.path_fit import fit_path
from ssm_planner.planning.retiming.paths import StraightPath
from ssm_planner.problem.problem import Eye, Lens, Problem
from ssm_planner.problem.robot import Robot, read_only_array
from ssm_planner.trajectory import Samples
from ssm_planner.typing import Array

WithJerk = Callable[[Robot, float, float], Robot]
AIMS = ("time", "heat", "effort")
LENS = Lens(
    read_only_array([9e-3, 0, -2e-3], (3,)),
    read_only_array([4.8e-3, 4e-3, 2e-3], (3,)),
    read_only_array(np.eye(3), (3, 3)),
)
EYE = Eye(read_only_array([9e-3, 0, -8e-3], (3,)), 11.5e-3, 1e-3, 2.5e-3, 2.5e-4, LENS)
ROWS = frozenset(
    [(f"{name} range", None) for name in ("roll", "spin")]
    + [(f"{name} rate", None) for name in ("roll", "tilt", "spin")]
    + [("tip speed", None), ("retina clearance", None), ("lens clearance", None)]
    + [("motor torque", i) for i in (0, 1, 3)]
)
Case = tuple[Any, list[Array]]


def straight_case(robot: Robot, aim: Any, rng: np.random.Generator) -> Case:
    """Return an element with every row of a straight motion, and random arguments."""
    mechanism = Mechanism.from_geometry(robot.geometry)
    start, end = np.array([0.1, -1.7, 0.2, 4e-3]), np.array([-0.3, -2.2, 0.5, 15e-3])
    path = StraightPath(mechanism, start, end, mechanism.home_branch, np.zeros(4))
    local = fit_path(path, (RigidBody.from_robot(robot),), np.array([0.4]), np.array([0.45]))[0]
    sigma = np.sign(path.sample(np.array([0.42])).dq[0])
    z = np.array(
        [
            rng.uniform(0.4, 0.42),
            rng.uniform(0.5, 1.5),
            *rng.uniform(-2, 2, 2),
            rng.uniform(0.005, 0.02),
        ]
    )
    limits = {**joint_limits(robot), "speeds": np.array([0.02]), "stop": np.array([1e9])}
    numbers = StraightElement.layout.pack(**limits, time_scale=1.7)
    return StraightElement(robot=robot, jerk=True, aim=aim), [z, sigma, local, numbers]


def free_case(robot: Robot, aim: Any, rng: np.random.Generator) -> Case:
    """Return an element of a free motion of all joints, and random arguments."""
    mechanism = Mechanism.from_geometry(robot.geometry)
    moving = (0, 1, 2, 3)
    first, unit = np.array([-0.5, 0.6, 0.1, -2e-3]), np.array([0.8, 0.8, 0.5, 15e-3])
    sigma = rng.choice([-1.0, 1.0], 4)
    position = sigma * rng.uniform(0.1, 0.5, 4) - np.array([0, 0, 0, 0.6])
    z = np.concatenate(
        [
            position,
            sigma * rng.uniform(0.5, 1.5, 4),
            rng.uniform(-2, 2, 8),
            rng.uniform(0.01, 0.03, 1),
        ]
    )
    limits = {**joint_limits(robot), "speeds": np.array([0.02]), "stop": np.array([1e9])}
    numbers = FreeElement.layout.pack(
        **{"q0": first, "d": unit, **limits, "rate": [0.4, 0.5, 0.6]},
        **{
            "range_centre": [0.1, -0.2],
            "range_half_width": [0.4, 0.7],
            "retina_easing": 1e-6,
            "time_scale": 1.7,
        },
    )
    element = FreeElement(
        robot=robot, mechanism=mechanism, moving=moving, active=ROWS, eye=EYE, aim=aim
    )
    return element, [z, sigma, numbers]


CASES = {"straight": straight_case, "free": free_case}


def reference(element: Any) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Return reference functions that CasADi derives from the whole element at once.

    They compute the rows and their Jacobian, the cost and its gradient, and the Hessian of λᵀ rows
    + κ cost.
    """
    z = ca.MX.sym("z", element.size)
    arguments = [ca.MX.sym(f"a{i}", size) for i, (size, _) in enumerate(element.parameters)]
    symbol = ca.SX.sym("z", element.size)
    points = ca.Function("states", [symbol], element.collocation_states(symbol))(z)
    rows = ca.vertcat(*(element.point(point, *arguments) for point in points))
    cost = ca.MX(0)
    if element.cost is not None:
        cost = sum(
            share * z[-1] * element.cost(point, *arguments)
            for point, share in zip(points, SIMPSON_WEIGHTS, strict=True)
        )
    lam, kappa = ca.MX.sym("lam", rows.numel()), ca.MX.sym("kappa")
    hessian = ca.hessian(ca.dot(lam, rows) + kappa * cost, z)[0]
    inputs = [z, *arguments]
    return (
        ca.Function("rows", inputs, [rows, ca.jacobian(rows, z)]),
        ca.Function("cost", inputs, [cost, ca.gradient(cost, z)]),
        ca.Function("hessian", [*inputs, ca.vertcat(lam, kappa)], [hessian]),
    )


def assert_close(mine: Any, its: Any) -> None:
    """Assert that two arrays agree within 1e-9 of the largest reference value."""
    mine, its = ca.DM(mine).full(), ca.DM(its).full()
    assert np.abs(mine - its).max(initial=0.0) <= 1e-9 * max(np.abs(its).max(initial=0.0), 1e-12)


@pytest.mark.parametrize("aim", AIMS)
@pytest.mark.parametrize("kind", CASES)
def test_derivatives_are_those_of_the_whole_element(
    tilt_insert: Problem, with_jerk: WithJerk, kind: str, aim: str
) -> None:
    rng = np.random.default_rng(7)
    robot = with_jerk(tilt_insert.robot, 35.0, 1.0)
    element, _ = CASES[kind](robot, aim, rng)
    mine, (rows, cost, hessian) = element_functions(element), reference(element)
    names = {name for name, _ in element.row_names}
    assert {"motor torque", "tip speed"} <= names
    assert len(names) >= 5
    assert (mine.cost is None) == (aim == "time")
    for _ in range(5):
        _, numbers = CASES[kind](robot, aim, rng)
        values, jacobian = rows(*numbers)
        assert_close(mine.rows(*numbers), values)
        assert_close(mine.jacobian(*numbers), jacobian)
        multipliers = rng.uniform(0, 1, values.numel())
        kappa = [] if mine.cost is None else [2.3]
        result = mine.hessian(*numbers, np.append(multipliers, kappa))
        assert_close(result, hessian(*numbers, np.append(multipliers, kappa or [0.0])))
        assert_close(result, ca.DM(result).T)
        if mine.cost is not None and mine.gradient is not None:
            value, gradient = cost(*numbers)
            assert_close(mine.cost(*numbers), value)
            again, slope = mine.gradient(*numbers)
            assert_close(again, value)
            assert_close(slope, gradient)


@pytest.mark.parametrize("kind", CASES)
def test_a_cost_is_the_integral_over_the_element(tilt_insert: Problem, kind: str) -> None:
    """Two half elements integrate the cost with a much smaller error than one element.

    The cost uses Simpson's rule, so their error is nearly sixteen times smaller. Gauss quadrature
    gives the reference.
    """
    element, numbers = CASES[kind](tilt_insert.robot, "heat", np.random.default_rng(3))
    z, *arguments = numbers
    z[-1] *= 10
    nodes, weights = np.polynomial.legendre.leggauss(12)
    x = ca.SX.sym("z", element.size)
    values = [
        float(element.cost(ca.Function("s", [x], [element.state(x, float(c))])(z), *arguments))
        for c in (nodes + 1) / 2
    ]
    exact = z[-1] / 2 * float(weights @ values)
    cost = element_functions(element).cost
    assert cost is not None
    complete = float(cost(z, *arguments)) - exact
    halves = sum(float(cost(half, *arguments)) for half in _halves(z)) - exact
    assert abs(complete) < 1e-2 * exact
    assert abs(halves) < abs(complete) / 10


def _halves(z: Array) -> tuple[Array, Array]:
    """Return the two halves of an element. The cubic polynomial stays the same."""
    m = (len(z) - 1) // 4
    u, v, a0, a1 = (z[k * m : (k + 1) * m] for k in range(4))
    t, middle = z[-1] / 2, (a0 + a1) / 2
    slope = (a1 - a0) / z[-1]
    position = u + v * t + a0 * t**2 / 2 + slope * t**3 / 6
    speed = v + a0 * t + slope * t**2 / 2
    return np.concatenate([u, v, a0, middle, [t]]), np.concatenate(
        [position, speed, middle, a1, [t]]
    )


def test_heat_is_that_of_the_exact_friction_law(tilt_insert: Problem) -> None:
    """The heat of an element agrees with the motor model that the check uses too.

    The tolerance allows for the smoothing between the two sides of a gear contact.
    """
    robot, rng = tilt_insert.robot, np.random.default_rng(5)
    nominal = np.array(
        [joint.motor.nominal_torque if joint.motor else np.inf for joint in robot.joints]
    )
    for _ in range(10):
        element, (z, sigma, numbers) = free_case(robot, "heat", rng)
        state = z[:4], z[4:8], z[8:12]
        p = FreeElement.layout.unpack(numbers)
        scale, unit = p.time_scale, p.d
        q, qd, qdd = p.q0 + unit * state[0], unit * state[1] / scale, unit * state[2] / scale**2
        samples = Samples(np.zeros(1), q[None], qd[None], qdd[None], 0 * q[None])
        motor = motor_motion(
            robot, RigidBody.from_robot(robot), samples, sigma[None], np.zeros((1, 4), dtype=bool)
        )
        exact = np.nansum((motor.torque[0] / nominal) ** 2)
        result = float(element.cost(np.concatenate(state), sigma, numbers))
        assert result == pytest.approx(exact, rel=5e-3, abs=1e-5)


def test_effort_counts_only_what_speed_and_acceleration_ask(tilt_insert: Problem) -> None:
    """The effort tends to zero in slow motions, although weight and friction remain."""
    element, (z, sigma, numbers) = free_case(tilt_insert.robot, "effort", np.random.default_rng(5))
    heat = dataclasses.replace(element, aim="heat")
    efforts = []
    for slower in (1.0, 10.0, 100.0):
        state = np.concatenate([z[:4], z[4:8] / slower, z[8:12] / slower**2])
        efforts.append(float(element.cost(state, sigma, numbers)))
    assert efforts[0] > 20 * efforts[1] > 400 * efforts[2]
    assert float(heat.cost(state, sigma, numbers)) > 100 * efforts[2]

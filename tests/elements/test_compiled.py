"""Verify that the elements in C return the numbers of the CasADi functions.

The cases cover random robots, every drive, friction law, load and aim, and eyes.
"""

from __future__ import annotations

import ctypes
import dataclasses
import itertools
from collections.abc import Callable
from typing import Any, get_args

import casadi as ca
import numpy as np
import pytest

from ssm_planner.codegen.mapped import MappedFunction
from ssm_planner.dynamics.rigid_body import (
    LOAD_LAYOUT,
    RigidBody,
    axis_frames,
    efforts_from_parameters,
    load_parameters,
    with_payload,
)
from ssm_planner.elements import kernels
from ssm_planner.elements.compiled import (
    NativeElements,
    mapped_elements,
    native_elements,
    rows_between,
)
from ssm_planner.elements.element import (
    Aim,
    ElementFunctions,
    ElementModel,
    element_functions,
)
from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.native import library
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.typing import Array
from tests.elements.test_element import CASES
from tests.support.random_problems import random_problem

WithJerk = Callable[[Robot, float, float], Robot]
RELATIVE = 1e-11
COUNT = 6
"""The number of elements fills one block of SIMD lanes and a part of a second block."""
pytestmark = pytest.mark.skipif(
    library.load() is None, reason="installed without the compiled part"
)


def _by_name(functions: ElementFunctions) -> dict[str, ca.Function]:
    """Return the element functions that are not None, by name."""
    return {name: function for name, function in vars(functions).items() if function is not None}


def drives(robot: Robot, rng: np.random.Generator) -> Robot:
    """Return the robot with other drives, so that its joints use all three friction laws.

    Each sliding drive has one nut or, with probability 0.5, two. With probability 0.6 the robot has
    two corner cases, which have payloads of 0 and 0.03 kg and other friction.
    """
    laws = itertools.cycle(["stribeck_exponential", "coulomb", "stribeck_gaussian"])

    def other(drive: Drive) -> Drive:
        law: Any = next(laws)
        speed = None if law == "coulomb" else 8.0
        friction = unchecked_copy(
            drive.friction,
            law=law,
            stribeck_speed=speed,
            mu_stribeck=0.0 if speed is None else 0.03,
            mu_static=0.21,
        )
        two = drive.slides and rng.random() < 0.5
        kind = "antibacklash_screw" if two else "lead_screw" if drive.slides else "worm"
        nut = (
            {"preload": 30.0, "second_nut_mass": 0.02}
            if two
            else {"preload": 0.0, "second_nut_mass": 0.0}
        )
        return unchecked_copy(drive, kind=kind, friction=friction, **nut)

    def changed(one: Robot) -> Robot:
        joints = [
            j if j.drive is None else unchecked_copy(j, drive=other(j.drive)) for j in one.joints
        ]
        return unchecked_copy(one, joints=tuple(joints))

    plain = changed(robot)
    corners = tuple(changed(with_payload(robot, mass)) for mass in (0.0, 0.03))
    return (
        unchecked_copy(plain, corners=corners, lightest=corners[:1])
        if rng.random() < 0.6
        else plain
    )


def agree(mine: Array, its: Array) -> None:
    """Assert that two arrays agree within RELATIVE times the largest reference value."""
    scale = max(float(np.abs(its).max(initial=0.0)), 1e-12)
    assert float(np.abs(mine.reshape(its.shape) - its).max(initial=0.0)) <= RELATIVE * scale


def breakaway_functions(element: ElementModel) -> dict[str, ca.Function]:
    """Return CasADi functions of the breakaway rows, their Jacobian and their Hessian, by name."""
    function = element.breakaway
    symbols = [ca.SX.sym(f"x{i}", function.size1_in(i)) for i in range(function.n_in())]
    rows = function(*symbols)
    lam = ca.SX.sym("lam", rows.numel())
    return {
        "rows": ca.Function("rows", symbols, [ca.densify(rows)]),
        "jacobian": ca.Function("jacobian", symbols, [ca.jacobian(rows, symbols[0])]),
        "hessian": ca.Function(
            "hessian", [*symbols, lam], [ca.hessian(ca.dot(lam, rows), symbols[0])[0]]
        ),
    }


def check(element: ElementModel, z: Array, parameters: list[Array]) -> None:
    """Assert that every compiled function of the model agrees with CasADi's.

    `z` (count, n) contains the variables of each element.
    """
    rng = np.random.default_rng(1)
    symbols = [ca.SX.sym("x", element.state_size), *element.parameter_symbols(ca.SX)]
    assert element.row_names == [(row.name, row.joint) for row in element._active_rows(*symbols)]
    native = native_elements(element, parameters, len(z))
    assert native is not None
    lam = rng.uniform(-1, 1, (len(z), native.shapes["rows"][1]))
    if element.aim != "time":
        lam = np.column_stack([lam, rng.uniform(0, 3, len(z))])
    functions = _by_name(element_functions(element))
    assert set(functions) == set(native.shapes)
    for name, function in functions.items():
        arguments = (z, lam) if name == "hessian" else (z,)
        agree(
            native.call(name, *arguments),
            MappedFunction(function, parameters, len(z))(*arguments)[-1],
        )
    agree(
        rows_between(element, z, parameters),
        MappedFunction(element.dense_rows, parameters, len(z))(z)[0],
    )
    starts = native_elements(element, parameters, len(z), "breakaway")
    assert starts is not None
    for name, function in breakaway_functions(element).items():
        arguments = (
            (z, lam[:, :1] * np.ones(starts.shapes["rows"][1])) if name == "hessian" else (z,)
        )
        agree(
            starts.call(name, *arguments),
            MappedFunction(function, parameters, len(z))(*arguments)[-1],
        )


def at_once(
    native: NativeElements, z: Array, lam: Array, sigma: Array
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return values and derivatives in the two calls that the structured solver uses, by name.

    The Hessian in the second dictionary contains the additional term J' diag(sigma) J.
    """

    def addresses(names: tuple[str, ...]) -> tuple[dict[str, Array], list[ctypes.c_void_p]]:
        shapes = {name: native.shapes.get(name, (0,)) for name in names}
        result = {name: np.full(shape, np.nan) for name, shape in shapes.items()}
        return result, [ctypes.c_void_p(item.ctypes.data) for item in result.values()]

    one, context = library.load(), ctypes.byref(native.context)
    assert one is not None
    values, pointers = addresses(("rows", "cost"))
    inputs = [ctypes.c_void_p(item.ctypes.data) for item in (z, lam, sigma)]
    assert one.ssm_values_of(context, inputs[0], *pointers) == 0
    derivatives, pointers = addresses(("jacobian", "gradient", "hessian"))
    assert one.ssm_derivatives_of(context, *inputs, (ctypes.c_void_p * 3)(*pointers)) == 0
    return values, derivatives


def multipliers_of(
    native: NativeElements, aim: Aim, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return random multipliers of the rows and the cost, and random stiffnesses of the rows.

    The first array has the shape (count, rows), or (count, rows + 1) with a cost. The second has
    the shape (count, rows).
    """
    shape = native.shapes["rows"]
    return rng.uniform(-1, 1, (shape[0], shape[1] + (aim != "time"))), rng.uniform(0, 2, shape)


@pytest.mark.parametrize("aim", get_args(Aim))
@pytest.mark.parametrize("kind", CASES)
def test_all_at_once_is_one_by_one(
    tilt_insert: Problem, with_jerk: WithJerk, kind: str, aim: Aim
) -> None:
    """One call for all derivatives returns the same as a separate call for each."""
    rng = np.random.default_rng(5)
    element, z, parameters = elements_of(with_jerk(tilt_insert.robot, 35.0, 1.0), kind, aim, rng)
    native = native_elements(element, parameters, COUNT)
    assert native is not None
    lam, sigma = multipliers_of(native, aim, rng)
    values, derivatives = at_once(native, z, lam, sigma)
    for name in set(values) & set(native.shapes):
        agree(values[name], native.call(name, z))
    for name in {"jacobian", "gradient"} & set(native.shapes):
        agree(derivatives[name], native.call(name, z))
    jacobian = native.call("jacobian", z)
    stiff = np.einsum("kr,kri,krj->kij", sigma, jacobian, jacobian)
    agree(derivatives["hessian"], native.call("hessian", z, lam) + stiff)


def test_angles_of_many_turns(tilt_insert: Problem) -> None:
    """The compiled functions reduce angles of many turns as accurately as CasADi."""
    element, z, parameters = elements_of(
        tilt_insert.robot, "free", "time", np.random.default_rng(6)
    )
    z[:, :4] *= 1e7
    native = native_elements(element, parameters, COUNT)
    assert native is not None
    agree(
        native.call("rows", z),
        MappedFunction(element_functions(element).rows, parameters, COUNT)(z)[0],
    )


@pytest.mark.parametrize("kind", CASES)
def test_every_variant_gives_the_same_bits(
    tilt_insert: Problem, with_jerk: WithJerk, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The library variants for different instruction sets return the same bits."""
    rng = np.random.default_rng(7)
    element, z, parameters = elements_of(
        with_jerk(tilt_insert.robot, 35.0, 1.0), kind, "cooling", rng
    )
    result = []
    for name in ("portable", "avx2"):
        opened = library._open(name)
        if opened is None or (name == "avx2" and not opened.ssm_has_avx2()):
            continue
        monkeypatch.setattr(library, "_loaded", lambda opened=opened: opened)
        native = native_elements(element, parameters, COUNT)
        assert native is not None
        parts = at_once(native, z, *multipliers_of(native, "cooling", np.random.default_rng(8)))
        result.append(b"".join(item.tobytes() for part in parts for item in part.values()))
    assert len(set(result)) == 1


def elements_of(
    robot: Robot, kind: str, aim: Aim, rng: np.random.Generator
) -> tuple[Any, Array, list[Array]]:
    """Return a model, variables of COUNT elements (COUNT, n), and the parameters."""
    cases = [CASES[kind](robot, aim, rng) for _ in range(COUNT)]
    z, *item = (np.array(values) for values in zip(*(numbers for _, numbers in cases), strict=True))
    element, packed = cases[0][0], item[-1][0]
    fields = vars(element.layout.unpack(packed)) | {"cooling": [0.5, 0.0, 1.0, 2.0], "stop": 0.4}
    return element, z, [*item[:-1], element.layout.pack(**fields)]


@pytest.mark.parametrize("aim", get_args(Aim))
@pytest.mark.parametrize("kind", CASES)
def test_numbers_are_those_of_casadi(
    tilt_insert: Problem, with_jerk: WithJerk, kind: str, aim: Aim
) -> None:
    rng = np.random.default_rng(3)
    element, z, parameters = elements_of(with_jerk(tilt_insert.robot, 35.0, 1.0), kind, aim, rng)
    check(element, z, parameters)


@pytest.mark.parametrize("seed", range(4))
def test_any_robot_has_them(tilt_insert: Problem, seed: int) -> None:
    """The compiled functions exist for random robots, drives and choices of moving joints."""
    rng = np.random.default_rng(seed)
    robot = drives(random_problem(tilt_insert, seed).robot, rng)
    aim = get_args(Aim)[seed]
    element, z, parameters = elements_of(robot, "free", aim, rng)
    moving = ((0, 1, 2, 3), (1,), (0, 3), (1, 2, 3))[seed]
    states = z[:, :16].reshape(COUNT, 4, 4)[:, :, moving].reshape(COUNT, -1)
    model = dataclasses.replace(element, moving=moving, active=None)
    check(model, np.column_stack([states, z[:, -1]]), parameters)


@pytest.mark.parametrize("seed", range(3))
def test_any_robot_has_them_on_a_path(tilt_insert: Problem, with_jerk: WithJerk, seed: int) -> None:
    """The compiled functions exist for elements on a path, also if a joint lacks a drive."""
    rng = np.random.default_rng(seed)
    robot = drives(with_jerk(random_problem(tilt_insert, seed).robot, 35.0, 1.0), rng)
    undriven = unchecked_copy(robot.joints[1], drive=None, motor=None)
    robot = unchecked_copy(robot, joints=(robot.joints[0], undriven, *robot.joints[2:]))
    element, z, (_, _, packed) = elements_of(robot, "straight", get_args(Aim)[seed], rng)
    sigma = rng.choice([-1.0, 1.0], (COUNT, 4))
    sigma[:, 1] = 0.0  # A path gives no direction to a joint without a drive.
    fits = rng.normal(size=(COUNT, element.parameters[1].size))
    fits[:, :2] = 0.42, 0.05
    check(dataclasses.replace(element, jerk=bool(seed)), z, [sigma, fits, packed])


@pytest.mark.parametrize("kind", CASES)
def test_ipopt_is_given_the_same(tilt_insert: Problem, kind: str) -> None:
    """The compiled functions for Ipopt have the values and the sparsity of CasADi's functions."""
    rng = np.random.default_rng(5)
    element, z, parameters = elements_of(tilt_insert.robot, kind, "heat", rng)
    native = mapped_elements(element, COUNT)
    assert native is not None
    alike = [i + 1 for i, values in enumerate(parameters) if values.ndim == 1]
    for name, function in _by_name(element_functions(element)).items():
        inputs = [values.T for values in (z, *parameters)]
        if name == "hessian":
            inputs.append(rng.uniform(0, 1, (function.size1_in(len(inputs)), COUNT)))
        theirs = function.map(name, "serial", COUNT, alike, []).call(inputs)
        for mine, its in zip(native.function(function).call(inputs), theirs, strict=True):
            assert mine.sparsity() == its.sparsity()
            agree(mine.full(), its.full())
        native.check()


def test_an_interruption_within_is_raised(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A KeyboardInterrupt in a compiled function is raised again by `check`, once."""
    element, z, parameters = elements_of(
        tilt_insert.robot, "free", "time", np.random.default_rng(5)
    )
    native = mapped_elements(element, COUNT)
    assert native is not None

    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(native._elements, "with_parameters", interrupted)
    with pytest.raises(RuntimeError):
        native.function(element_functions(element).rows).call(
            [values.T for values in (z, *parameters)]
        )
    with pytest.raises(KeyboardInterrupt):
        native.check()
    native.check()


def test_joints_at_rest_have_finite_rows(tilt_insert: Problem) -> None:
    """The rows and their Jacobian are finite for joints at rest without a direction of motion.

    This includes rows without a limit.
    """
    element, z, parameters = elements_of(
        tilt_insert.robot, "free", "time", np.random.default_rng(2)
    )
    still = z.copy()
    still[:, 4:16] = 0.0
    native = native_elements(element, [np.zeros(4), *parameters[1:]], COUNT)
    assert native is not None
    for name in ("rows", "jacobian"):
        assert np.isfinite(native.call(name, still)).all()


def test_lanes_do_not_matter(tilt_insert: Problem) -> None:
    """The Hessian of an element has the same bits alone and in a block with others."""
    element, z, parameters = elements_of(
        tilt_insert.robot, "free", "heat", np.random.default_rng(2)
    )
    sigma, packed = parameters
    together = native_elements(element, parameters, COUNT)
    assert together is not None
    lam = np.ones((COUNT, together.shapes["rows"][1] + 1))
    complete = together.call("hessian", z, lam)
    for k in range(COUNT):
        alone = native_elements(element, [sigma[k], packed], 1)
        assert alone is not None
        assert np.array_equal(alone.call("hessian", z[k : k + 1], lam[:1])[0], complete[k])


@pytest.mark.parametrize("seed", range(3))
def test_figures_of_a_robot_give_its_efforts(tilt_insert: Problem, seed: int) -> None:
    """The efforts from compact load parameters agree with the rigid-body inverse dynamics."""
    robot = random_problem(tilt_insert, seed).robot
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.uniform(-2, 2, (3, 4))
    figures, symbols = (
        load_parameters(robot.geometry, robot.bodies, robot.gravity),
        [ca.SX.sym(n, 4) for n in "abc"],
    )
    by_figures = ca.SX.sym("f", LOAD_LAYOUT.size)
    function = ca.Function(
        "tau", [by_figures, *symbols], [efforts_from_parameters(by_figures, *symbols)]
    )
    frames, _, offset = axis_frames(
        (robot.geometry.omega1, robot.geometry.omega2, robot.geometry.omega3)
    )
    turned = q + np.array([0.0, offset, 0.0, 0.0])
    expected = RigidBody.from_robot(robot).inverse_dynamics(q[None], qd[None], qdd[None])[0]
    assert function(figures, turned, qd, qdd).full().ravel() == pytest.approx(
        expected, rel=1e-11, abs=1e-15
    )
    assert np.allclose(
        frames[:, :, 2][1:], [robot.geometry.omega1, robot.geometry.omega2, robot.geometry.omega3]
    )
    rotation = forward(Mechanism.from_geometry(robot.geometry), q)[0][0]
    assert np.allclose(rotation.T @ rotation, np.eye(3))


def test_the_c_is_what_the_laws_give() -> None:
    """The C header in the repository equals the output of `python -m ssm_planner.elements.kernels`.

    The comparison needs the version of CasADi that wrote the header.
    """
    text = kernels.KERNELS_HEADER.read_text(encoding="utf-8")
    if f"CasADi {ca.CasadiMeta.version()}:" not in text:
        pytest.skip("written by another CasADi")
    assert text == kernels.kernels_text(), "run `python -m ssm_planner.elements.kernels`"

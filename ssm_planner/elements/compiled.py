"""Interface to the C code that evaluates path constraints and costs (native/elements.c).

The C code computes the same values as the CasADi Functions `ElementFunctions`, `dense_rows` and
`breakaway` of an element model, up to rounding, but many times per second more. This module passes
the data of a model to it in one struct of integers and pointers. The structured solver and the
refinement use `native_elements`, and Ipopt uses `mapped_elements`. Both are None without the
compiled part, and the callers then evaluate the CasADi Functions.
"""

import ctypes
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal

import casadi as ca
import numpy as np

from ssm_planner.codegen import Layout, call
from ssm_planner.dynamics import (
    axis_frames,
    breakaway_coefficient,
    joints_without_motor,
    load_parameters,
    mesh_coefficients,
    motorised_joints,
    required_friction,
    thread_from_efficiencies,
)
from ssm_planner.elements.element import (
    COLLOCATION_POINTS,
    DENSE_POINTS,
    SIMPSON_WEIGHTS,
    ElementModel,
)
from ssm_planner.elements.free_element import FreeElement
from ssm_planner.elements.rows import MOTORLESS_COST_WEIGHT, actuations_by_load
from ssm_planner.elements.straight_element import FIT_DEGREE, StraightElement
from ssm_planner.errors import ProblemError
from ssm_planner.interior.problem import ElementGroup
from ssm_planner.kinematics import SPEED_JACOBIANS, Mechanism, smallest_lens_ratio
from ssm_planner.native.library import load
from ssm_planner.problem import FRICTION_LAWS, Drive, Eye, MotorTorque, TipSpeed
from ssm_planner.typing import Array, Arrays, record

MECHANISM_LAYOUT = Layout(
    omega2=2, omega3=2, alpha=1, beta=1, delta=1, side=1, spin_offset=1, insertion_sign=1, offset=1
)
"""Numbers that describe the kinematics in C, in the base frame of `rigid_body.axis_frames`.

`omega2` and `omega3` are the x and z components of the axes of joints 2 and 3. The following
numbers are the fields of `Mechanism` with the same names. `offset` is the offset of the angle θ2 of
joint 2 that `axis_frames` returns.
"""
EYE_LAYOUT = Layout(centre=3, radius=1, clearance=1, port=1, lens_centre=3, lens_frame=9)
"""Numbers that describe the eye in C, in the base frame of `rigid_body.axis_frames`.

`lens_frame` contains the columns of the rotation matrix of the lens. Each column is divided by the
semi-axis of the lens in its direction, and by the result of `smallest_lens_ratio`.
"""
DRIVE_LAYOUT = Layout(
    ratio=1,
    gamma=1,
    lead_slope=1,
    wedging=1,
    input_inertia=1,
    output_inertia=1,
    preload=1,
    second_nut_mass=1,
    mu=1,
    mu_stribeck=1,
    stribeck_speed=1,
    b_c=1,
    b_v=1,
    b_oc=1,
    b_ov=1,
    limit=1,
    nominal=1,
)
"""Numbers that describe one motor with its drive in C, in SI units.

`limit` and `nominal` are the largest and the nominal torque of the motor, N·m. The other numbers
are the fields of `Drive` and of its friction with the same names.
"""
ACCELERATION_DRIVE = DRIVE_LAYOUT.pack(
    **dict.fromkeys(DRIVE_LAYOUT.slices, 0.0)
    | dict.fromkeys(("ratio", "input_inertia", "stribeck_speed", "limit", "nominal"), 1.0)
)
"""Drive whose motor torque is the acceleration of the joint, as numbers of `DRIVE_LAYOUT`.

It represents joints without a motor in the cost of effort.
"""
ELEMENTS_PER_VECTOR = 4
"""Number of elements that the C code evaluates at once, one in each entry of a vector register."""
TORQUE_LAWS = ("worm", "antibacklash_screw")
"""Names of the torque laws in C: of drives with one mesh, and of drives with two nuts."""
Location = Literal["collocation", "between", "breakaway"]
POINTS_BY_LOCATION: dict[Location, tuple[float, ...]] = {
    "collocation": COLLOCATION_POINTS,
    "between": DENSE_POINTS,
    "breakaway": (0.0,),
}
"""Fractions of an element at which the rows are evaluated, by the name of the evaluation.

"collocation": the points of the optimisation program. "between": the points of the refinement.
"breakaway": the start of the element, with static friction.
"""

INTEGER_MEMBERS = (
    "straight",
    "count",
    "m",
    "rows",
    "points",
    "loads",
    "actuations",
    "costs",
    "effort",
    "hull",
)
"""Integers in the struct `Elements` of elements.c, in its order.

They are: whether the motion follows a path, the number of elements, the number of coordinates, the
numbers of rows, points, payloads, actuations and motors in the cost, whether the cost is the
effort, and whether Bernstein coefficients replace velocities (`Instant.qd_hull`).
"""
POINTER_MEMBERS = (
    "shares",
    "weights",
    "moving",
    "undriven",
    "slots",
    "actuation",
    "drives",
    "cost",
    "cost_drives",
    "cost_weights",
    "load",
    "mechanism",
    "eye",
    "limits",
    "sigma",
    "fits",
)
"""Pointers to arrays in the struct `Elements`, which follow the integers.

shares, weights
    Fractions of the points, and their weights in integrals.
moving, undriven
    Indices of the moving joints. For each joint, whether it lacks a drive.
slots
    For every row that such a robot can have, its position among the active rows, or −1.
actuation, drives
    Joint, payload and law of each actuation, and its `DRIVE_LAYOUT`.
cost, cost_drives, cost_weights
    Joint and law, `DRIVE_LAYOUT`, and weight of each motor in the cost.
load, mechanism, eye, limits
    Rigid bodies with each payload, `MECHANISM_LAYOUT`, `EYE_LAYOUT`, and limits.
sigma, fits
    Directions of the joints, and fits of the path, of each element.
"""


class _ElementsStruct(ctypes.Structure):
    """The struct `Elements` of elements.c, which contains all data of a model at n elements."""

    _fields_ = [
        *((name, ctypes.c_long) for name in INTEGER_MEMBERS),
        *((name, ctypes.c_void_p) for name in POINTER_MEMBERS),
        ("offset", ctypes.c_double),
    ]


class NativeElements:
    """Path constraints and cost of an element model in C, at n elements with given parameters.

    Attributes
    ----------
    context : ctypes.Structure
        Data of the C functions.
    """

    def __init__(
        self,
        library: ctypes.CDLL,
        element: ElementModel,
        parameters: Sequence[Array],
        count: int,
        location: Location,
    ) -> None:
        """Build the data of the C functions.

        The object keeps the memory of all arrays alive.

        Parameters
        ----------
        library : ctypes.CDLL
            The compiled part of the package.
        element : ElementModel
            Model of one element of the mesh.
        parameters : sequence of (size,) or (count, size) arrays
            Parameter vectors of the model. Those of shape (size,) apply to all elements.
        count : int
            Number n of elements.
        location : str
            Name of the points at which the rows are evaluated, a key of `POINTS_BY_LOCATION`.
        """
        inputs = _element_inputs(element, location)
        arrays = _parameter_arrays(element, inputs.arrays, parameters, count)
        self._element_inputs = inputs
        self._arrays = {
            name: np.ascontiguousarray(values, dtype=float) for name, values in arrays.items()
        }
        points = len(POINTS_BY_LOCATION[location])
        rows = inputs.rows
        self.context = _ElementsStruct(
            straight=isinstance(element, StraightElement),
            count=count,
            m=element.coordinates,
            rows=rows,
            points=points,
            loads=len(element.robot.loads),
            actuations=len(inputs.arrays["actuation"]),
            costs=len(inputs.arrays["cost"]),
            effort=element.aim == "effort",
            hull=location == "collocation",
            offset=inputs.offset,
            **_addresses(inputs.arrays | self._arrays),
        )
        size = element.size
        all_rows = points * rows
        self.shapes: dict[str, tuple[int, ...]] = {
            "rows": (count, all_rows),
            "jacobian": (count, all_rows, size),
            "hessian": (count, size, size),
        }
        """Shapes of the results by the names of the functions, see `call`."""
        if len(inputs.arrays["cost"]):
            self.shapes |= {"cost": (count, 1), "gradient": (count, size)}
        self._library = library
        self.group = ElementGroup.from_library(
            library, self.context, (size, all_rows, int(len(inputs.arrays["cost"]) > 0), count)
        )
        """The same functions in the form that the structured solver reads."""

    def call(self, name: str, z: Array, multipliers: Array | None = None) -> Array:
        """Evaluate one of the functions at all elements.

        Parameters
        ----------
        name : str
            "rows", "jacobian", "hessian", "cost" or "gradient", as in `ElementFunctions`.
        z : (n, size) array
            Vectors z of the elements.
        multipliers : (n, rows) array, optional
            Multipliers λ of the rows, for the Hessian only. With a cost, another column contains
            the multiplier κ of the cost.

        Returns
        -------
        array
            The results of all elements, with the shape in `shapes`.
        """
        result = np.empty(self.shapes[name])
        arrays = [np.ascontiguousarray(z, dtype=float)]
        if multipliers is not None:
            arrays.append(np.ascontiguousarray(multipliers, dtype=float))
        arrays.append(result)
        addresses = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
        function = getattr(self._library, f"ssm_{name}_of")
        function(ctypes.byref(self.context), *addresses)
        return result


def _parameter_arrays(
    element: ElementModel, constant_arrays: Arrays, parameters: Sequence[Array], count: int
) -> dict[str, Any]:
    """Build the arrays of `_ElementsStruct` that depend on the parameters of a model.

    Parameters
    ----------
    element : ElementModel
        Model of one element of the mesh.
    constant_arrays : dict of arrays
        Arrays that do not depend on the parameters, see `_ElementInputs`.
    parameters : sequence of arrays
        Parameter vectors of the model: the directions of the joints, the fits of a path (only for
        a motion along one), and the vector in the order of the model's `layout`.
    count : int
        Number of elements.

    Returns
    -------
    dict of arrays
        Arrays by their names in `POINTER_MEMBERS`.
    """
    sigma, *fit_parameters, packed = parameters
    slices = element.layout.slices
    drives = constant_arrays["drives"].copy()
    drives[:, DRIVE_LAYOUT.slices["limit"]] = packed[slices["torque"]][
        constant_arrays["actuation"][:, :1]
    ]
    joints = constant_arrays["cost"][:, 0]
    weights = np.ones(len(joints))
    if element.aim == "cooling":
        weights = packed[slices["cooling"]][joints]
    elif element.aim == "effort":
        is_motorless = np.isin(joints, joints_without_motor(element.robot.joints))
        limits = packed[slices["acceleration"]][joints[is_motorless]]
        weights[is_motorless] = MOTORLESS_COST_WEIGHT / limits**2
    path_fits = [np.broadcast_to(values, (count, values.shape[-1])) for values in fit_parameters]
    return {
        "drives": drives,
        "cost_weights": weights,
        "limits": packed,
        # A joint without a drive may reverse at any time. C needs its sign only for the effort.
        "sigma": np.where(constant_arrays["undriven"], 1.0, np.broadcast_to(sigma, (count, 4))),
        "fits": _interleaved_fits(*path_fits) if path_fits else [],
    }


def _addresses(arrays: Arrays) -> dict[str, int]:
    """Return the addresses of the first entries of arrays.

    Parameters
    ----------
    arrays : dict of arrays
        Arrays by name. The caller must keep them alive.

    Returns
    -------
    dict of int
        Addresses by the same names.
    """
    return {name: values.__array_interface__["data"][0] for name, values in arrays.items()}


@record
class _ElementInputs:
    """Data of the C functions that do not depend on the parameters of a model."""

    arrays: Arrays
    """Arrays by their names in `_ElementsStruct`.

    The torque limits in `drives` are parameters, so `_parameter_arrays` replaces them.
    """
    rows: int
    """Number of active rows at one point."""
    offset: float
    """Offset of the angle θ2 of joint 2 in the C code, rad. 0 along a path."""


@lru_cache(maxsize=64)
def _element_inputs(element: ElementModel, location: Location) -> _ElementInputs:
    """Build the data of the C functions that do not depend on parameters.

    Parameters
    ----------
    element : ElementModel
        Model of one element of the mesh.
    location : str
        Points at which the rows are evaluated, a key of `POINTS_BY_LOCATION`. Only torque rows are
        evaluated at "breakaway", and the cost only at "collocation".

    Returns
    -------
    _ElementInputs
        Arrays, number of active rows, and offset of joint 2.
    """
    breakaway = location == "breakaway"
    rows = element.indexed_rows
    if breakaway:
        rows = [row for row in element.all_indexed_rows if row[0] == MotorTorque.name]
    actuation, drives = _actuation_arrays(element, breakaway=breakaway)
    # Each actuation has three rows: two of a driving motor and one of a braking motor.
    slots = np.full(3 * len(actuation) + element.first_actuation, -1)
    slots[[index for *_, index in rows]] = np.arange(len(rows))
    cost, cost_drives = _cost_arrays(element if location == "collocation" else None)
    values_by_name: dict[str, Any] = {
        "shares": POINTS_BY_LOCATION[location],
        "weights": SIMPSON_WEIGHTS,
        "moving": [0],
        "undriven": [joint.drive is None for joint in element.robot.joints],
        "slots": slots,
        "actuation": actuation,
        "drives": drives,
        "cost": cost,
        "cost_drives": cost_drives,
    }
    offset = 0.0
    if isinstance(element, FreeElement):
        values_by_name |= _free_motion_arrays(element)
        (offset,) = values_by_name["mechanism"][MECHANISM_LAYOUT.slices["offset"]]
    arrays = {
        name: np.ascontiguousarray(values, dtype=int if name in _INTEGER_ARRAYS else float)
        for name, values in values_by_name.items()
    }
    return _ElementInputs(arrays, len(rows), offset)


def _free_motion_arrays(element: FreeElement) -> dict[str, Any]:
    """Build the arrays of `_ElementsStruct` that only free motions need.

    Parameters
    ----------
    element : FreeElement
        Model of one element of the mesh.

    Returns
    -------
    dict of array-like
        Indices of the moving joints ("moving"), rigid bodies with each payload ("load"), and the
        numbers of `MECHANISM_LAYOUT` and `EYE_LAYOUT` ("mechanism" and "eye").
    """
    mechanism, eye = _mechanism_and_eye_values(element.mechanism, element.eye)
    load = [
        load_parameters(load.geometry, load.bodies, load.gravity) for load in element.robot.loads
    ]
    return {"moving": element.moving, "load": load, "mechanism": mechanism, "eye": eye}


def _actuation_arrays(element: ElementModel, *, breakaway: bool) -> tuple[Array, Array]:
    """Build the arrays that describe the actuations of a robot in C.

    An actuation is a joint with one of its possible drives and payloads (see `rows.Actuation`). The
    arrays are sorted by payload.

    Parameters
    ----------
    element : ElementModel
        Model of one element of the mesh.
    breakaway : bool
        True if joints start to move. Their friction coefficient is then constant, the static one.

    Returns
    -------
    actuation : (a, 3) array of int
        Joint, index of the payload, and index of the law (`_law_index`) of each of a actuations.
    drives : (a, DRIVE_LAYOUT.size) array
        Numbers of `DRIVE_LAYOUT`.
    """
    by_load = actuations_by_load(element.robot)
    actuation = np.array(
        [(i, load, _law_index(drive)) for i, _, load, drive, _ in by_load], dtype=int
    )
    drives = np.array([_drive_values(drive, breakaway=breakaway) for *_, drive, _ in by_load])
    actuation = actuation.reshape(-1, 3)
    if breakaway:
        # The first law of friction in `FRICTION_LAWS` has a constant coefficient.
        # The index of a law is len(FRICTION_LAWS) · torque law + friction law.
        actuation[:, 2] -= actuation[:, 2] % len(FRICTION_LAWS)
    return actuation, drives.reshape(-1, DRIVE_LAYOUT.size)


def _cost_arrays(element: ElementModel | None) -> tuple[Array, Array]:
    """Build the arrays that describe the motors in the cost in C.

    If the cost is the effort, joints without a motor are included, with `ACCELERATION_DRIVE`.

    Parameters
    ----------
    element : ElementModel or None
        Model of one element of the mesh. With None, there is no cost to evaluate.

    Returns
    -------
    cost : (k, 2) array of int
        Joint, and index of the law (`_law_index`), of each of k motors. k is 0 without a cost.
    drives : (k, DRIVE_LAYOUT.size) array
        Numbers of `DRIVE_LAYOUT`.
    """
    if element is None or element.aim == "time":
        return np.zeros((0, 2), dtype=int), np.zeros((0, DRIVE_LAYOUT.size))
    joints = element.robot.joints
    laws = [(i, _law_index(drive)) for i, drive, _ in motorised_joints(joints)]
    drives = [
        _drive_values(drive, motor.nominal_torque) for _, drive, motor in motorised_joints(joints)
    ]
    if element.aim == "effort":
        other_joints = list(joints_without_motor(joints))
        # Law 0 has one mesh and a constant friction coefficient.
        laws += [(i, 0) for i in other_joints]
        drives += [ACCELERATION_DRIVE] * len(other_joints)
    return np.array(laws, dtype=int).reshape(-1, 2), np.array(drives).reshape(-1, DRIVE_LAYOUT.size)


def _interleaved_fits(fits: Array) -> Array:
    """Return the fits of a path in the order of the C code.

    The C code evaluates `ELEMENTS_PER_VECTOR` elements at once, so the numbers of so many elements
    are interleaved. The last element is repeated to complete a group. Within an element, the
    coefficients of each curve are adjacent.

    Parameters
    ----------
    fits : (n, size) array
        Fit of each element in the order of `straight_element.fit_layout`.

    Returns
    -------
    (groups, size, ELEMENTS_PER_VECTOR) array
        The same numbers.
    """
    group_count = math.ceil(len(fits) / ELEMENTS_PER_VECTOR)
    indices = np.minimum(np.arange(group_count * ELEMENTS_PER_VECTOR), len(fits) - 1)
    padded = fits[indices]
    # The first two numbers are the centre and the half width of the interval of the fit.
    by_degree = padded[:, 2:].reshape(len(padded), FIT_DEGREE + 1, -1)
    by_curve = by_degree.transpose(0, 2, 1).reshape(len(padded), -1)
    elements = np.hstack([padded[:, :2], by_curve])
    return elements.reshape(group_count, ELEMENTS_PER_VECTOR, -1).transpose(0, 2, 1)


def compiled_library() -> ctypes.CDLL | None:
    """Return the compiled part of the package if it can evaluate elements.

    Returns
    -------
    ctypes.CDLL or None
        The library. None if it does not exist, or if another package has added a tool speed, which
        the C code does not contain.
    """
    return load() if list(SPEED_JACOBIANS) == [TipSpeed] else None


def native_elements(
    element: ElementModel,
    parameters: Sequence[Array],
    count: int,
    location: Location = "collocation",
) -> NativeElements | None:
    """Build the C functions of an element model for given parameters.

    Parameters
    ----------
    element : ElementModel
        Model of one element of the mesh.
    parameters : sequence of (size,) or (count, size) arrays
        Parameter vectors of the model.
    count : int
        Number n of elements.
    location : str
        Points at which the rows are evaluated, a key of `POINTS_BY_LOCATION`.

    Returns
    -------
    NativeElements or None
        The functions. None without the compiled part of the package.
    """
    library = compiled_library()
    if library is None:
        return None
    return NativeElements(library, element, parameters, count, location)


class _ElementsCallback(ca.Callback):
    """One of `ElementFunctions`, evaluated in C for n elements, as a function of CasADi.

    Its arguments and results are those of the CasADi Function mapped over n elements. The results
    have the same sparsity, so a program that contains the callback keeps its structure.
    """

    def __init__(self, elements: "_LatestElements", name: str, function: ca.Function) -> None:
        """Determine the sizes of all arguments and results, and register the callback in CasADi.

        Parameters
        ----------
        elements : _LatestElements
            C functions of the n elements.
        name : str
            Name of the function in `ElementFunctions`.
        function : casadi.Function
            The CasADi Function for one element.
        """
        ca.Callback.__init__(self)
        self._elements = elements
        self._name = name
        self._argument_rows = [elements.element.size]
        self._per_element = [True]
        for parameter in elements.element.parameters:
            self._argument_rows.append(parameter.size)
            self._per_element.append(parameter.per_element)
        if name == "hessian":
            self._argument_rows.append(function.size1_in(len(self._argument_rows)))
            self._per_element.append(True)
        self._result_sparsities = [function.sparsity_out(i) for i in range(function.n_out())]
        sparsity = self._result_sparsities[-1]
        rows, columns = sparsity.get_triplet()
        row_starts = np.array(rows, dtype=int) * sparsity.size2()
        self._nonzero_positions = row_starts + np.array(columns, dtype=int)
        """Positions of the structural nonzeros in a dense row-major result."""
        self.construct(f"{name}_of_elements", {"enable_fd": False})

    # CasADi calls the following methods. Their names and signatures are CasADi's.
    def get_n_in(self) -> int:
        return len(self._argument_rows)

    def get_n_out(self) -> int:
        return len(self._result_sparsities)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(
            self._argument_rows[i], self._elements.count if self._per_element[i] else 1
        )

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.repmat(self._result_sparsities[i], 1, self._elements.count)

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arguments: Sequence[memoryview], results: Sequence[memoryview]) -> int:
        """Evaluate the function when CasADi calls it.

        Exceptions must not reach CasADi. This method stores them, also an interruption by the user,
        and `MappedElements.check` raises them after the solve.

        Parameters
        ----------
        arguments, results : sequence of memoryview
            Memory of the nonzeros of all arguments and results.

        Returns
        -------
        int
            Number of stored exceptions. CasADi takes any number except 0 for a failure.
        """
        elements = self._elements
        try:
            arrays = [np.frombuffer(values) for values in arguments]
            z = arrays[0].reshape(elements.count, -1)
            parameters = arrays[1:]
            multipliers = None
            if self._name == "hessian":
                multipliers = parameters.pop().reshape(elements.count, -1)
            native = elements.with_parameters(parameters)
            if len(results) > 1 and results[0]:
                np.frombuffer(results[0])[:] = native.call("cost", z).ravel()
            values = native.call(self._name, z, multipliers).reshape(elements.count, -1)
            np.frombuffer(results[-1])[:] = values[:, self._nonzero_positions].ravel()
        except BaseException as error:  # noqa: BLE001
            elements.failures.append(error)
        return len(elements.failures)


@dataclass(eq=False)
class _LatestElements:
    """C functions of an element model at n elements, for the latest values of its parameters.

    CasADi passes the parameters in every call, although they are the same during a solve.
    """

    library: ctypes.CDLL
    element: ElementModel
    count: int
    failures: list[BaseException] = field(default_factory=list)
    """Exceptions of the functions, which CasADi does not pass on."""
    _cached: tuple[list[Array], NativeElements] | None = None

    def with_parameters(self, parameters: list[Array]) -> NativeElements:
        """Return the C functions for given parameter vectors.

        If the parameters equal those of the previous call, the result is the same object.

        Parameters
        ----------
        parameters : list of arrays
            Parameter vectors of the model in one dimension, as CasADi passes them.

        Returns
        -------
        NativeElements
            The functions at all elements.
        """
        cached = self._cached
        if cached is None or not all(map(np.array_equal, cached[0], parameters)):
            copies = [values.copy() for values in parameters]
            shaped = [
                values.reshape(self.count, -1) if parameter.per_element else values
                for values, parameter in zip(copies, self.element.parameters, strict=True)
            ]
            self._cached = cached = (
                copies,
                NativeElements(self.library, self.element, shaped, self.count, "collocation"),
            )
        return cached[1]


class MappedElements:
    """The `ElementFunctions` of a model, evaluated in C for n elements, for a program of CasADi."""

    def __init__(self, library: ctypes.CDLL, element: ElementModel, count: int) -> None:
        """Prepare the functions of an element model for several elements.

        Parameters
        ----------
        library : ctypes.CDLL
            The compiled part of the package.
        element : ElementModel
            Model of one element of the mesh.
        count : int
            Number n of elements.
        """
        self._elements = _LatestElements(library, element, count)
        self._functions: list[_ElementsCallback] = []

    def function(self, function: ca.Function) -> ca.Function:
        """Build a callback that replaces one of `ElementFunctions`, mapped over the elements.

        CasADi does not keep the callback alive. It exists as long as this object.

        Parameters
        ----------
        function : casadi.Function
            One of `ElementFunctions` for a single element.

        Returns
        -------
        casadi.Function
            The callback for all elements.
        """
        self._functions.append(_ElementsCallback(self._elements, function.name(), function))
        return self._functions[-1]

    def check(self) -> None:
        """Raise the first exception that a callback has stored since the last check.

        The method does nothing if no callback has stored one.
        """
        failures = self._elements.failures[:]
        self._elements.failures.clear()
        if failures:
            raise failures[0]


def mapped_elements(element: ElementModel, count: int) -> MappedElements | None:
    """Build the C functions of an element model as functions of CasADi.

    Parameters
    ----------
    element : ElementModel
        Model of one element of the mesh.
    count : int
        Number of elements.

    Returns
    -------
    MappedElements or None
        The functions. None without the compiled part of the package.
    """
    library = compiled_library()
    return None if library is None else MappedElements(library, element, count)


def rows_between(element: ElementModel, z: Array, parameters: Sequence[Array]) -> Array:
    """Evaluate the path constraints at nine points of each element.

    The points are `DENSE_POINTS`.

    The refinement of a motion calls this function to find constraints that are violated between the
    collocation points.

    Parameters
    ----------
    element : ElementModel
        Model of one element of the mesh.
    z : (n, size) array
        Vectors z of the elements.
    parameters : sequence of (size,) or (n, size) arrays
        Parameter vectors of the model.

    Returns
    -------
    (n, 9 rows) array
        Values of the active rows at the first point, then those at the second one, and so on.
    """
    n = len(z)
    native = native_elements(element, parameters, n, "between")
    if native is not None:
        return native.call("rows", z)
    repeated = [np.broadcast_to(values, (n, values.shape[-1])) for values in parameters]
    return call(element.dense_rows, z, *repeated)[0]


_INTEGER_ARRAYS = ("moving", "undriven", "slots", "actuation", "cost")
"""Names of those `POINTER_MEMBERS` that point to integers. The others point to doubles."""


def _law_index(drive: Drive) -> int:
    """Return the index of the C function for the torque law and the friction law of a drive.

    The functions are sorted by `TORQUE_LAWS`, then by `FRICTION_LAWS`. Only screws with two nuts
    have the second torque law.

    Parameters
    ----------
    drive : Drive
        Drive of the joint.

    Returns
    -------
    int
        Index, from 0.
    """
    friction = required_friction(drive)
    law = "coulomb" if friction.stribeck_speed is None else friction.law
    torque_law = int(drive.two_nuts)
    return len(FRICTION_LAWS) * torque_law + FRICTION_LAWS.index(law)


def _drive_values(drive: Drive, nominal: float = 1.0, *, breakaway: bool = False) -> Array:
    """Collect the numbers that describe a drive in C.

    Parameters
    ----------
    drive : Drive
        Drive of the joint.
    nominal : float
        Nominal torque of the motor, N·m.
    breakaway : bool
        True if the static friction coefficient replaces the kinetic one.

    Returns
    -------
    (DRIVE_LAYOUT.size,) array
        Numbers of the drive. The torque limit is 1, because it is a parameter of the model.
    """
    friction = required_friction(drive)
    values = {name: getattr(drive, name) for name in DRIVE_LAYOUT.slices if hasattr(drive, name)}
    values |= {
        name: getattr(friction, name) for name in DRIVE_LAYOUT.slices if hasattr(friction, name)
    }
    values["stribeck_speed"] = friction.stribeck_speed or 1.0
    if breakaway:  # At breakaway the law of a constant coefficient holds.
        values["mu"] = breakaway_coefficient(friction)
    if drive.stages:
        values |= _equivalent_thread_values(drive, values["mu"])
    return DRIVE_LAYOUT.pack(**values, limit=1.0, nominal=nominal)


def _equivalent_thread_values(drive: Drive, mu: float) -> dict[str, float]:
    """Compute the numbers of a thread without gear stages that has the same torque law as a drive.

    The C code contains no gear stages before the thread. A self-locking mesh always opposes the
    motor, so the stages only change the lever arm `gamma` of the drive. For another mesh, this
    function finds a thread with the same efficiencies in both directions.

    Parameters
    ----------
    drive : Drive
        Drive with gear stages.
    mu : float
        Friction coefficient of the thread.

    Returns
    -------
    dict of float
        Numbers by their names in `DRIVE_LAYOUT`.

    Raises
    ------
    ProblemError
        If the mesh is not self-locking and its friction coefficient is not constant.
    """
    uphill, downhill = mesh_coefficients(drive, mu)
    if downhill <= 0:
        return {"gamma": drive.gamma * math.prod(stage.forwards for stage in drive.stages.values())}
    if required_friction(drive).law != "coulomb":
        raise ProblemError(
            "a gearhead or belt before a thread that is not self-locking needs constant friction",
            file=drive.file,
            key="friction.law",
            value=required_friction(drive).law,
            allowed="coulomb",
        )
    gamma, mu = thread_from_efficiencies(1.0, 1.0 / uphill, downhill)
    return {"gamma": gamma, "mu": mu, "lead_slope": 1.0, "wedging": 1.0}


def _mechanism_and_eye_values(mechanism: Mechanism, eye: Eye | None) -> tuple[Array, Array]:
    """Collect the numbers that describe the kinematics and the eye in C.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.
    eye : Eye or None
        Eye with the retina and the lens.

    Returns
    -------
    mechanism_values : (MECHANISM_LAYOUT.size,) array
        Numbers of `MECHANISM_LAYOUT`.
    eye_values : (EYE_LAYOUT.size,) array
        Numbers of `EYE_LAYOUT`. Those of a missing eye or lens are not used.
    """
    frames, angles, offset = axis_frames((mechanism.omega1, mechanism.omega2, mechanism.omega3))
    angle = sum(angles)
    data = MECHANISM_LAYOUT.pack(
        omega2=[np.sin(angles[0]), np.cos(angles[0])],
        omega3=[np.sin(angle), np.cos(angle)],
        alpha=mechanism.alpha,
        beta=mechanism.beta,
        delta=mechanism.delta,
        side=mechanism.side,
        spin_offset=mechanism.spin_offset,
        insertion_sign=mechanism.insertion_sign,
        offset=offset,
    )
    if eye is None:
        return data, np.ones(EYE_LAYOUT.size)
    lens_centre = np.zeros(3)
    lens_frame = np.eye(3)
    base = frames[0].T
    if eye.lens is not None:
        lens_centre = eye.lens.centre
        lens_frame = eye.lens.frame / eye.lens.semi_axes / smallest_lens_ratio(eye)
    return data, EYE_LAYOUT.pack(
        centre=base @ eye.centre,
        radius=eye.radius,
        clearance=eye.clearance,
        port=eye.port,
        lens_centre=base @ lens_centre,
        lens_frame=base @ lens_frame,
    )

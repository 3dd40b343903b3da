"""Interface to the C code that evaluates path constraints and costs (native/elements.c).

The C code computes the same values as the CasADi Functions `ElementFunctions`, `dense_rows` and
`breakaway` of an element model, up to rounding, but many times faster. This module passes the data
of a model to it in one struct of integers and pointers. `native_elements` returns the C functions
for the structured solver and the refinement, and `mapped_elements` returns them for Ipopt. If the
package was built without a C compiler, both return None, and the callers evaluate the CasADi
Functions instead.

The terms are those of `element`. An element is an interval of time, z is the vector that describes
its motion, and a row is one path constraint. An actuation is a joint with one drive and one payload
(`rows.Actuation`).
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

In this frame, the axis of joint 1 is the z axis. `omega2` and `omega3` are the x and z components
of the axes of joints 2 and 3, whose y components are 0. `offset` is the offset of the angle θ2 of
joint 2 that `axis_frames` returns. The other numbers are the fields of `Mechanism` with the same
names.
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
"""Numbers of `DRIVE_LAYOUT` for a drive whose motor torque equals the acceleration of its joint.

It represents joints without a motor in the cost of effort, in which accelerations count for them.
"""
ELEMENTS_PER_VECTOR = 4
"""Number of elements that the C code evaluates at once, in the entries of a vector register."""
TORQUE_LAWS = ("worm", "antibacklash_screw")
"""Names of the torque laws in C, for drives with one mesh and for drives with two nuts."""
Location = Literal["collocation", "between", "breakaway"]
POINTS_BY_LOCATION: dict[Location, tuple[float, ...]] = {
    "collocation": COLLOCATION_POINTS,
    "between": DENSE_POINTS,
    "breakaway": (0.0,),
}
"""Fractions of an element at which the rows are evaluated, by the purpose of the evaluation.

"collocation" are the points at which the optimisation problem imposes the rows. "between" are the
points at which the refinement looks for violated rows. "breakaway" is the start of the element, at
which joints start to move against static friction.
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

straight
    1 if the motion follows a path, 0 if it is free.
count, m, rows, points
    Numbers of elements, of coordinates, of active rows at a point, and of points in an element.
loads, actuations, costs
    Numbers of payloads, of actuations, and of motors in the cost.
effort
    1 if the cost is the effort.
hull
    1 if Bernstein coefficients replace velocities (`Instant.qd_hull`).
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
    Fractions of an element at which it is evaluated, and their weights in integrals.
moving, undriven
    Indices of the moving joints, and for each joint 1 if it lacks a drive.
slots
    For every row that such a model can have, its position among the active rows, or −1.
actuation, drives
    Joint, payload and law (`_law_index`) of each actuation, and its numbers of `DRIVE_LAYOUT`.
cost, cost_drives, cost_weights
    Joint and law, numbers of `DRIVE_LAYOUT`, and weight of each motor in the cost.
load, mechanism, eye, limits
    Rigid bodies with each payload, numbers of `MECHANISM_LAYOUT` and `EYE_LAYOUT`, and limits.
sigma, fits
    For each element, the directions of the joints, and the polynomials that replace the path.
"""


class _ElementsStruct(ctypes.Structure):
    """The struct `Elements` of elements.c, which contains the data of a model for n elements."""

    _fields_ = [
        *((name, ctypes.c_long) for name in INTEGER_MEMBERS),
        *((name, ctypes.c_void_p) for name in POINTER_MEMBERS),
        ("offset", ctypes.c_double),
    ]


class NativeElements:
    """C functions for the path constraints and the cost of an element model at n elements.

    The parameters of the model are constants of these functions.

    Attributes
    ----------
    context : ctypes.Structure
        Struct with the data that the C functions read.
    """

    def __init__(
        self,
        library: ctypes.CDLL,
        element: ElementModel,
        parameters: Sequence[Array],
        count: int,
        location: Location,
    ) -> None:
        """Build the data that the C functions read.

        The object keeps the memory of all arrays alive to which the struct points.

        Parameters
        ----------
        library : ctypes.CDLL
            The compiled part of the package.
        element : ElementModel
            Model of one element, that is, of one interval of time of the mesh.
        parameters : sequence of (size,) or (count, size) arrays
            Parameter vectors of the model. Those of the shape (size,) apply to all elements.
        count : int
            Number n of elements.
        location : str
            Points at which the rows (path constraints) are evaluated, a key of
            `POINTS_BY_LOCATION`.
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
        """Shapes of the results of `call` by the names of the functions."""
        if len(inputs.arrays["cost"]):
            self.shapes |= {"cost": (count, 1), "gradient": (count, size)}
        self._library = library
        self.group = ElementGroup.from_library(
            library, self.context, (size, all_rows, int(len(inputs.arrays["cost"]) > 0), count)
        )
        """The same functions as a struct that the structured solver reads."""

    def call(self, name: str, z: Array, multipliers: Array | None = None) -> Array:
        """Evaluate one of the functions at all elements.

        Parameters
        ----------
        name : str
            "rows" (the path constraints), "jacobian", "hessian", "cost" or "gradient", as in
            `ElementFunctions`.
        z : (n, size) array
            Vectors z of the elements.
        multipliers : (n, rows) array, optional
            Lagrange multipliers λ of the rows at all points, only for the Hessian. If there is a
            cost, the array has one more column, which contains the multiplier κ of the cost.

        Returns
        -------
        array
            The results of all elements. `shapes` contains their shape.
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
    """Build the arrays for the C functions that depend on the parameters of a model.

    Parameters
    ----------
    element : ElementModel
        Model of one element, that is, of one interval of time of the mesh.
    constant_arrays : dict of arrays
        Arrays that do not depend on the parameters, see `_ElementInputs`.
    parameters : sequence of arrays
        Parameter vectors of the model. The first contains the directions of the joints, and the
        last has the order of the model's `layout`. For a motion along a path, the second contains
        the polynomials that replace the path (`fit_layout`).
    count : int
        Number of elements.

    Returns
    -------
    dict of arrays
        Arrays by their names in `POINTER_MEMBERS`.
    """
    sigma, *fit_parameters, packed = parameters
    # Column 0 of "actuation" and of "cost" contains the index of the joint.
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
        # A joint without a drive may reverse at any time, so its direction is open. The C code
        # needs some sign for the effort. With 1, the torque of `ACCELERATION_DRIVE` is the
        # acceleration.
        "sigma": np.where(constant_arrays["undriven"], 1.0, np.broadcast_to(sigma, (count, 4))),
        "fits": _interleaved_fits(*path_fits) if path_fits else [],
    }


def _addresses(arrays: Arrays) -> dict[str, int]:
    """Return the addresses of the memory of arrays.

    Parameters
    ----------
    arrays : dict of arrays
        Arrays by name. The caller must keep them alive.

    Returns
    -------
    dict of int
        Addresses of the first entries by the same names.
    """
    return {name: values.__array_interface__["data"][0] for name, values in arrays.items()}


@record
class _ElementInputs:
    """Data for the C functions that do not depend on the parameters of a model."""

    arrays: Arrays
    """Arrays by their names in `POINTER_MEMBERS`.

    The torque limits in `drives` are placeholders, which `_parameter_arrays` replaces.
    """
    rows: int
    """Number of active rows at one point."""
    offset: float
    """Offset of the angle θ2 of joint 2 in the C code, rad. 0 along a path."""


@lru_cache(maxsize=64)
def _element_inputs(element: ElementModel, location: Location) -> _ElementInputs:
    """Build the data for the C functions that do not depend on the parameters of a model.

    The results for the last 64 arguments are cached.

    Parameters
    ----------
    element : ElementModel
        Model of one element, that is, of one interval of time of the mesh.
    location : str
        Points at which the rows (path constraints) are evaluated, a key of `POINTS_BY_LOCATION`. At
        "breakaway", only torque rows are evaluated. The cost is evaluated only at "collocation".

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
    # The C code has three rows for each actuation, two of a driving and one of a braking motor.
    slots = np.full(3 * len(actuation) + element.first_actuation, -1)
    slots[[index for *_, index in rows]] = np.arange(len(rows))
    cost, cost_drives = _cost_arrays(element if location == "collocation" else None)
    values_by_name: dict[str, Any] = {
        "shares": POINTS_BY_LOCATION[location],
        "weights": SIMPSON_WEIGHTS,
        # Along a path, the only coordinate is s. The entry is not used then.
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
    """Build the arrays for the C functions that only free motions need.

    Parameters
    ----------
    element : FreeElement
        Model of one element, that is, of one interval of time of the mesh.

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

    An actuation is a joint with one drive and one payload, for which its motor must be strong
    enough (`rows.Actuation`). The arrays are sorted by payload.

    Parameters
    ----------
    element : ElementModel
        Model of one element, that is, of one interval of time of the mesh.
    breakaway : bool
        True if joints start to move. Their friction coefficient is then the static one, which does
        not depend on the speed.

    Returns
    -------
    actuation : (a, 3) array of int
        Index of the joint, index of the payload, and index of the law (`_law_index`) of each of the
        a actuations.
    drives : (a, DRIVE_LAYOUT.size) array
        Numbers of `DRIVE_LAYOUT` for each of them.
    """
    by_load = actuations_by_load(element.robot)
    actuation = np.array(
        [(i, load, _law_index(drive)) for i, _, load, drive, _ in by_load], dtype=int
    )
    drives = np.array([_drive_values(drive, breakaway=breakaway) for *_, drive, _ in by_load])
    actuation = actuation.reshape(-1, 3)
    if breakaway:
        # The index of a law is len(FRICTION_LAWS) · torque law + friction law. The first friction
        # law has a constant coefficient, so the remainder is set to 0.
        actuation[:, 2] -= actuation[:, 2] % len(FRICTION_LAWS)
    return actuation, drives.reshape(-1, DRIVE_LAYOUT.size)


def _cost_arrays(element: ElementModel | None) -> tuple[Array, Array]:
    """Build the arrays that describe the motors in the cost in C.

    If the cost is the effort, joints without a motor are included, with `ACCELERATION_DRIVE`.

    Parameters
    ----------
    element : ElementModel or None
        Model of one element, that is, of one interval of time of the mesh. With None, there is no
        cost to evaluate.

    Returns
    -------
    cost : (k, 2) array of int
        Index of the joint, and index of the law (`_law_index`), of each of the k motors. k is 0
        without a cost.
    drives : (k, DRIVE_LAYOUT.size) array
        Numbers of `DRIVE_LAYOUT` for each of them.
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
    """Rearrange the polynomials of the elements to the order that the C code reads.

    The polynomials approximate functions of the path parameter s near an element (time interval),
    for example the slope of a joint. These functions are called curves. The C code evaluates a
    group of `ELEMENTS_PER_VECTOR` elements at once, so the corresponding numbers of these elements
    must be adjacent. The last element is repeated to complete the last group. The input contains
    first the coefficients of degree 0 of all curves, then those of degree 1, and so on. The output
    contains all coefficients of the first curve, then those of the second one, and so on.

    Parameters
    ----------
    fits : (n, size) array
        Polynomials of each element, in the order of `straight_element.fit_layout`.

    Returns
    -------
    (groups, size, ELEMENTS_PER_VECTOR) array
        The same numbers, with n / ELEMENTS_PER_VECTOR groups, rounded up.
    """
    group_count = math.ceil(len(fits) / ELEMENTS_PER_VECTOR)
    indices = np.minimum(np.arange(group_count * ELEMENTS_PER_VECTOR), len(fits) - 1)
    padded = fits[indices]
    # The first two numbers are the centre and the half width of the interval of s.
    by_degree = padded[:, 2:].reshape(len(padded), FIT_DEGREE + 1, -1)
    by_curve = by_degree.transpose(0, 2, 1).reshape(len(padded), -1)
    elements = np.hstack([padded[:, :2], by_curve])
    return elements.reshape(group_count, ELEMENTS_PER_VECTOR, -1).transpose(0, 2, 1)


def compiled_library() -> ctypes.CDLL | None:
    """Return the compiled part of the package if it contains the limits of all tool speeds.

    Returns
    -------
    ctypes.CDLL or None
        The library. None if it does not exist, or if another package has added a tool speed to
        `SPEED_JACOBIANS`, because the C code knows only the speed of the tip.
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
        Model of one element, that is, of one interval of time of the mesh.
    parameters : sequence of (size,) or (count, size) arrays
        Parameter vectors of the model.
    count : int
        Number n of elements.
    location : str
        Points at which the rows (path constraints) are evaluated, a key of `POINTS_BY_LOCATION`.

    Returns
    -------
    NativeElements or None
        The functions. None if `compiled_library` returns None.
    """
    library = compiled_library()
    if library is None:
        return None
    return NativeElements(library, element, parameters, count, location)


class _ElementsCallback(ca.Callback):
    """One of `ElementFunctions` for n elements, which CasADi calls and C evaluates.

    Its arguments and results are those of the CasADi Function mapped over n elements. The results
    have the same sparsity, so that the derivatives in an optimisation problem remain sparse.
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
            The CasADi Function for one element, which the callback replaces.
        """
        ca.Callback.__init__(self)
        self._elements = elements
        self._name = name
        # The arguments are z, the parameter vectors, and for the Hessian the multipliers.
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
        """Positions of the structural nonzeros in a dense row-major result, in CasADi's order."""
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
        """Evaluate the function in C, and write the results to the memory that CasADi provides.

        Exceptions must not reach CasADi. This method stores them in `_LatestElements.failures`,
        also an interruption by the user. `MappedElements.check` raises them after the solve.

        Parameters
        ----------
        arguments, results : sequence of memoryview
            Memory of the nonzeros of all arguments and results.

        Returns
        -------
        int
            Number of exceptions that are stored. CasADi takes any number except 0 for a failure.
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
            # Only "gradient" has two results. The first one is the cost itself.
            if len(results) > 1 and results[0]:
                np.frombuffer(results[0])[:] = native.call("cost", z).ravel()
            values = native.call(self._name, z, multipliers).reshape(elements.count, -1)
            np.frombuffer(results[-1])[:] = values[:, self._nonzero_positions].ravel()
        except BaseException as error:  # noqa: BLE001
            elements.failures.append(error)
        return len(elements.failures)


@dataclass(eq=False)
class _LatestElements:
    """The C functions of an element model at n elements, kept for the latest parameters.

    CasADi passes the parameters in every call, although they do not change during a solve. The C
    functions are therefore prepared only when the parameters differ from those of the last call.
    """

    library: ctypes.CDLL
    element: ElementModel
    count: int
    failures: list[BaseException] = field(default_factory=list)
    """Exceptions in the callbacks, which CasADi does not pass on."""
    _cached: tuple[list[Array], NativeElements] | None = None
    """Parameters of the last call, and the C functions for them."""

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
    """The `ElementFunctions` of a model for n elements, as CasADi Functions that C evaluates."""

    def __init__(self, library: ctypes.CDLL, element: ElementModel, count: int) -> None:
        """Prepare the functions of an element model for several elements.

        Parameters
        ----------
        library : ctypes.CDLL
            The compiled part of the package.
        element : ElementModel
            Model of one element, that is, of one interval of time of the mesh.
        count : int
            Number n of elements.
        """
        self._elements = _LatestElements(library, element, count)
        self._functions: list[_ElementsCallback] = []

    def function(self, function: ca.Function) -> ca.Function:
        """Build a CasADi Function that evaluates one of `ElementFunctions` in C for all elements.

        CasADi does not keep such a callback alive. It exists as long as this object.

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
        Model of one element, that is, of one interval of time of the mesh.
    count : int
        Number of elements.

    Returns
    -------
    MappedElements or None
        The functions. None if `compiled_library` returns None.
    """
    library = compiled_library()
    return None if library is None else MappedElements(library, element, count)


def rows_between(element: ElementModel, z: Array, parameters: Sequence[Array]) -> Array:
    """Evaluate the active path constraints (rows) at the nine `DENSE_POINTS` of each element.

    After a solve, the refinement calls this function to find rows that are violated between the
    collocation points, at which the optimisation problem imposes them.

    Parameters
    ----------
    element : ElementModel
        Model of one element, that is, of one interval of time of the mesh.
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

    The functions are sorted by `TORQUE_LAWS`, then by `FRICTION_LAWS`. Drives with two nuts have
    the second torque law, and all others have the first one.

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
    # 1 is a placeholder for a law without this speed.
    values["stribeck_speed"] = friction.stribeck_speed or 1.0
    if breakaway:  # `_actuation_arrays` selects the law with the constant coefficient `mu`.
        values["mu"] = breakaway_coefficient(friction)
    if drive.stages:
        values |= _equivalent_thread_values(drive, values["mu"])
    return DRIVE_LAYOUT.pack(**values, limit=1.0, nominal=nominal)


def _equivalent_thread_values(drive: Drive, mu: float) -> dict[str, float]:
    """Compute the numbers of a thread without gear stages that has the same torque law as a drive.

    The C code contains no gear stages before the thread, so an equivalent thread replaces both. A
    self-locking mesh always opposes the motor, so the stages only change the lever arm `gamma` of
    the drive. For another mesh, the function finds a thread with the same efficiencies in both
    directions.

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
    # In the base frame, the axes of joints 2 and 3 lie in the x–z plane if joint 2 is turned by
    # `offset`. Their angles to the z axis are angles[0] and `angle`.
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
    # Rotation matrix from the robot's frame to the base frame of `axis_frames`.
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

"""Rows and costs of the elements of a mesh in C (native/elements.c), for both element models.

The results equal those of the CasADi Functions `ElementFunctions`, `dense_rows` and `breakaway` of
the same model, up to rounding.
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
    axes_frames,
    breakaway_coefficient,
    friction_of,
    load_figures,
    mesh_coefficients,
    motorised,
    motorless,
    of_efficiencies,
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
from ssm_planner.kinematics import JACOBIANS, Mechanism, lens_limit
from ssm_planner.native.library import load
from ssm_planner.problem import FRICTION_LAWS, Drive, Eye, MotorTorque, TipSpeed
from ssm_planner.typing import Array, Arrays, record

MECHANISM_LAYOUT = Layout(
    omega2=2, omega3=2, alpha=1, beta=1, delta=1, side=1, spin_offset=1, insertion_sign=1, offset=1
)
"""Kinematics in the frames of `rigid_body.axes_frames`.

These are the x and z components of the second and the third axis, the angles of `Mechanism`, and
the offset of θ2.
"""
EYE_LAYOUT = Layout(centre=3, radius=1, clearance=1, port=1, lens_centre=3, lens_frame=9)
"""The eye in the base frame of `rigid_body.axes_frames`.

`lens_frame` contains the columns of the frame of the lens. Each column is divided by its semi-axis
and by the limit of the lens.
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
"""One motor with its drive. `limit` and `nominal` are torques of the motor, N·m."""
ACCELERATION_DRIVE = DRIVE_LAYOUT.pack(
    **dict.fromkeys(DRIVE_LAYOUT.slices, 0.0)
    | dict.fromkeys(("ratio", "input_inertia", "stribeck_speed", "limit", "nominal"), 1.0)
)
"""A drive whose torque is the acceleration of its joint, without a load.

It represents joints without a motor in the cost of effort.
"""
ELEMENTS_PER_VECTOR = 4
"""Number of elements that C evaluates at once."""
TORQUE_LAWS = ("worm", "antibacklash_screw")
"""Torque laws of drives with one mesh, and with two nuts."""
Location = Literal["collocation", "between", "breakaway"]
POINTS_BY_LOCATION: dict[Location, tuple[float, ...]] = {
    "collocation": COLLOCATION_POINTS,
    "between": DENSE_POINTS,
    "breakaway": (0.0,),
}
"""Fractions of an element at which the rows are evaluated, by the name of the evaluation."""

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
"""Integer members of the struct `Elements` of elements.c."""
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
"""Pointers of this struct to arrays, which follow the integers."""


class _ElementsStruct(ctypes.Structure):
    """The struct `Elements` of elements.c."""

    _fields_ = [
        *((name, ctypes.c_long) for name in INTEGER_MEMBERS),
        *((name, ctypes.c_void_p) for name in POINTER_MEMBERS),
        ("offset", ctypes.c_double),
    ]


class NativeElements:
    """The functions of an element model at n elements with given parameters."""

    def __init__(
        self,
        library: ctypes.CDLL,
        element: ElementModel,
        parameters: Sequence[Array],
        count: int,
        location: Location,
    ) -> None:
        """Prepare the inputs of the C code.

        Parameters
        ----------
        library : ctypes.CDLL
            The compiled library.
        element : ElementModel
            Model of one element of the mesh.
        parameters : sequence of (size,) or (count, size) arrays
            Parameters of the model.
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
        """Shapes of the results by the names of the functions."""
        if len(inputs.arrays["cost"]):
            self.shapes |= {"cost": (count, 1), "gradient": (count, size)}
        self._library = library
        self.group = ElementGroup.from_library(
            library, self.context, (size, all_rows, int(len(inputs.arrays["cost"]) > 0), count)
        )
        """The group for the structured solver."""

    def call(self, name: str, z: Array, multipliers: Array | None = None) -> Array:
        """Evaluate one of the functions.

        Parameters
        ----------
        name : str
            "rows", "jacobian", "hessian", "cost" or "gradient".
        z : (n, size) array
            The elements.
        multipliers : (n, rows) array, optional
            Multipliers of the rows for the Hessian. With a cost, a last column contains that of the
            cost.

        Returns
        -------
        array
            The results, with the shape in `shapes`.
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
    """Return the arrays of `_ElementsStruct` that depend on the parameters of an element model.

    Parameters
    ----------
    element : ElementModel
        Model of one element of the mesh.
    constant_arrays : dict of arrays
        Arrays that do not depend on the parameters, see `_ElementInputs`.
    parameters : sequence of arrays
        Parameters of the model.
    count : int
        Number of elements.
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
        is_motorless = np.isin(joints, motorless(element.robot.joints))
        limits = packed[slices["acceleration"]][joints[is_motorless]]
        weights[is_motorless] = MOTORLESS_COST_WEIGHT / limits**2
    fits = [np.broadcast_to(values, (count, values.shape[-1])) for values in fit_parameters]
    return {
        "drives": drives,
        "cost_weights": weights,
        "limits": packed,
        # A joint without a drive may reverse at any time. C needs its sign only for the effort.
        "sigma": np.where(constant_arrays["undriven"], 1.0, np.broadcast_to(sigma, (count, 4))),
        "fits": _interleaved_fits(*fits) if fits else [],
    }


def _addresses(arrays: Arrays) -> dict[str, int]:
    """Return the addresses of the memory of arrays."""
    return {name: values.__array_interface__["data"][0] for name, values in arrays.items()}


@record
class _ElementInputs:
    """Inputs of the C functions that do not depend on the parameters of a model.

    Attributes
    ----------
    rows : int
        Number of rows.
    offset : float
        Offset of θ2, rad.
    """

    arrays: Arrays
    """Arrays by their names in `_ElementsStruct`. The limits of the drives are set later."""
    rows: int
    offset: float


@lru_cache(maxsize=64)
def _element_inputs(element: ElementModel, location: Location) -> _ElementInputs:
    """Return the constant inputs of the C code that evaluates the rows of an element model.

    The C code evaluates the rows at the collocation points, at the points between them, or at a
    start with static friction. It evaluates the cost only at the collocation points.
    """
    breakaway = location == "breakaway"
    rows = element.indexed_rows
    if breakaway:
        rows = [row for row in element.all_indexed_rows if row[0] == MotorTorque.name]
    actuation, drives = _actuation_arrays(element, breakaway=breakaway)
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
    """Return the arrays of `_ElementsStruct` that only free motions need."""
    mechanism, eye = _mechanism_and_eye_values(element.mechanism, element.eye)
    load = [load_figures(load.geometry, load.bodies, load.gravity) for load in element.robot.loads]
    return {"moving": element.moving, "load": load, "mechanism": mechanism, "eye": eye}


def _actuation_arrays(element: ElementModel, *, breakaway: bool) -> tuple[Array, Array]:
    """Return the data of all actuations, sorted by load.

    At breakaway, the law of a constant friction coefficient applies.

    Returns
    -------
    actuation : (a, 3) array of int
        Joint, index of the load, and index of the law.
    drives : (a, DRIVE_LAYOUT) array
        Values of the drive.
    """
    by_load = actuations_by_load(element.robot)
    actuation = np.array(
        [(i, load, _law_index(drive)) for i, _, load, drive, _ in by_load], dtype=int
    )
    drives = np.array([_drive_values(drive, breakaway=breakaway) for *_, drive, _ in by_load])
    actuation = actuation.reshape(-1, 3)
    if breakaway:
        actuation[:, 2] -= actuation[:, 2] % len(FRICTION_LAWS)
    return actuation, drives.reshape(-1, DRIVE_LAYOUT.size)


def _cost_arrays(element: ElementModel | None) -> tuple[Array, Array]:
    """Return the data of all motors in the cost.

    With effort as the cost, the joints without a motor are included. If there is no cost, or if
    `element` is None, the arrays are empty.

    Returns
    -------
    cost : (q, 2) array of int
        Joint, and index of the law.
    drives : (q, DRIVE_LAYOUT) array
        Values of the drive.
    """
    if element is None or element.aim == "time":
        return np.zeros((0, 2), dtype=int), np.zeros((0, DRIVE_LAYOUT.size))
    joints = element.robot.joints
    laws = [(i, _law_index(drive)) for i, drive, _ in motorised(joints)]
    drives = [_drive_values(drive, motor.nominal_torque) for _, drive, motor in motorised(joints)]
    if element.aim == "effort":
        other_joints = list(motorless(joints))
        laws += [(i, 0) for i in other_joints]
        drives += [ACCELERATION_DRIVE] * len(other_joints)
    return np.array(laws, dtype=int).reshape(-1, 2), np.array(drives).reshape(-1, DRIVE_LAYOUT.size)


def _interleaved_fits(fits: Array) -> Array:
    """Return fits (n, size of `straight_element.fit_layout`) in the order of the C code.

    The C code evaluates `ELEMENTS_PER_VECTOR` elements at once, so their values are interleaved.
    The last element is repeated to complete a group. Within an element, the coefficients of each
    curve are adjacent.

    Returns
    -------
    (groups, size, ELEMENTS_PER_VECTOR) array
    """
    group_count = math.ceil(len(fits) / ELEMENTS_PER_VECTOR)
    indices = np.minimum(np.arange(group_count * ELEMENTS_PER_VECTOR), len(fits) - 1)
    padded = fits[indices]
    by_degree = padded[:, 2:].reshape(len(padded), FIT_DEGREE + 1, -1)
    by_curve = by_degree.transpose(0, 2, 1).reshape(len(padded), -1)
    elements = np.hstack([padded[:, :2], by_curve])
    return elements.reshape(group_count, ELEMENTS_PER_VECTOR, -1).transpose(0, 2, 1)


def compiled_library() -> ctypes.CDLL | None:
    """Return the compiled library.

    The result is None if the library does not exist. It is also None if another package has added a
    tool speed, which the C code does not contain.
    """
    return load() if list(JACOBIANS) == [TipSpeed] else None


def native_elements(
    element: ElementModel,
    parameters: Sequence[Array],
    count: int,
    location: Location = "collocation",
) -> NativeElements | None:
    """Return the native functions of an element model, or None without the compiled part.

    Parameters
    ----------
    element : ElementModel
        Model of one element of the mesh.
    parameters : sequence of (size,) or (count, size) arrays
        Parameters of the model.
    count : int
        Number of elements.
    location : str
        "collocation" for the points `COLLOCATION_POINTS`, "between" for the points `DENSE_POINTS`,
        or "breakaway" for the start with static friction.
    """
    library = compiled_library()
    if library is None:
        return None
    return NativeElements(library, element, parameters, count, location)


class _ElementsCallback(ca.Callback):
    """A function of `ElementFunctions` for n elements as a CasADi callback.

    Its results have the sparsity of the CasADi Function.
    """

    def __init__(self, elements: "_LatestElements", name: str, function: ca.Function) -> None:
        """Determine the sizes of arguments and results from a CasADi Function for one element."""
        ca.Callback.__init__(self)
        self._elements = elements
        self._name = name
        self._in = [elements.element.size]
        self._repeated = [True]
        for parameter in elements.element.parameters:
            self._in.append(parameter.size)
            self._repeated.append(parameter.per_element)
        if name == "hessian":
            self._in.append(function.size1_in(len(self._in)))
            self._repeated.append(True)
        self._out = [function.sparsity_out(i) for i in range(function.n_out())]
        sparsity = self._out[-1]
        rows, columns = sparsity.get_triplet()
        row_starts = np.array(rows, dtype=int) * sparsity.size2()
        self._indices = row_starts + np.array(columns, dtype=int)
        """Indices of the nonzeros in a dense result."""
        self.construct(f"{name}_of_elements", {"enable_fd": False})

    def get_n_in(self) -> int:
        return len(self._in)

    def get_n_out(self) -> int:
        return len(self._out)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._in[i], self._elements.count if self._repeated[i] else 1)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.repmat(self._out[i], 1, self._elements.count)

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arguments: Sequence[memoryview], results: Sequence[memoryview]) -> int:
        """Evaluate the function, as CasADi requires.

        Exceptions must not reach CasADi. They are stored, also an interruption by the user, and
        `MappedElements.check` raises them. Returns the number of stored exceptions.
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
            np.frombuffer(results[-1])[:] = values[:, self._indices].ravel()
        except BaseException as error:  # noqa: BLE001
            elements.failures.append(error)
        return len(elements.failures)


@dataclass(eq=False)
class _LatestElements:
    """An element model at n elements whose parameters seldom change."""

    library: ctypes.CDLL
    element: ElementModel
    count: int
    failures: list[BaseException] = field(default_factory=list)
    """Exceptions of the functions, which CasADi does not pass on."""
    _cached: tuple[list[Array], NativeElements] | None = None

    def with_parameters(self, parameters: list[Array]) -> NativeElements:
        """Return the functions at these parameters.

        If the parameters equal those of the previous call, the result is the same object.
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
    """The functions of an element model at n elements for CasADi, with parameters as inputs."""

    def __init__(self, library: ctypes.CDLL, element: ElementModel, count: int) -> None:
        """Use the compiled library for `count` elements."""
        self._elements = _LatestElements(library, element, count)
        self._functions: list[_ElementsCallback] = []

    def function(self, function: ca.Function) -> ca.Function:
        """Return a callback that replaces one of `ElementFunctions`, mapped over the elements.

        CasADi does not keep the callback alive. It exists as long as this object.
        """
        self._functions.append(_ElementsCallback(self._elements, function.name(), function))
        return self._functions[-1]

    def check(self) -> None:
        """Raise the first exception of a function, if there is one."""
        failures = self._elements.failures[:]
        self._elements.failures.clear()
        if failures:
            raise failures[0]


def mapped_elements(element: ElementModel, count: int) -> MappedElements | None:
    """Return the mapped functions of an element model, or None without the compiled part."""
    library = compiled_library()
    return None if library is None else MappedElements(library, element, count)


def rows_between(element: ElementModel, z: Array, parameters: Sequence[Array]) -> Array:
    """Evaluate the rows at all points `DENSE_POINTS` of each element.

    Parameters
    ----------
    element : ElementModel
        Model of one element of the mesh.
    z : (n, size) array
        The elements.
    parameters : sequence of (size,) or (n, size) arrays
        Parameters of the model.

    Returns
    -------
    (n, 9 rows) array
        Results of `ElementModel.dense_rows`.
    """
    n = len(z)
    native = native_elements(element, parameters, n, "between")
    if native is not None:
        return native.call("rows", z)
    repeated = [np.broadcast_to(values, (n, values.shape[-1])) for values in parameters]
    return call(element.dense_rows, z, *repeated)[0]


_INTEGER_ARRAYS = ("moving", "undriven", "slots", "actuation", "cost")
"""Names of the arrays of integers in `_ElementsStruct`."""


def _law_index(drive: Drive) -> int:
    """Return the index of the C function for the torque law and the friction law of a drive."""
    friction = friction_of(drive)
    law = "coulomb" if friction.stribeck_speed is None else friction.law
    return len(FRICTION_LAWS) * drive.two_nuts + FRICTION_LAWS.index(law)


def _drive_values(drive: Drive, nominal: float = 1.0, *, breakaway: bool = False) -> Array:
    """Return the values of a drive (DRIVE_LAYOUT,) without its torque limit, which is set later.

    Parameters
    ----------
    drive : Drive
        Drive of the joint.
    nominal : float
        Nominal torque of the motor, N·m.
    breakaway : bool
        Use the static friction coefficient.
    """
    friction = friction_of(drive)
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
    """Return the values of a thread without gear stages that has the same torque law as a drive.

    A self-locking mesh always opposes the motor, so the stages only change its effort arm. Another
    mesh needs a constant friction coefficient `mu`. Raises ProblemError if it is not constant.
    """
    uphill, downhill = mesh_coefficients(drive, mu)
    if downhill <= 0:
        return {"gamma": drive.gamma * math.prod(stage.forwards for stage in drive.stages.values())}
    if friction_of(drive).law != "coulomb":
        raise ProblemError(
            "a gearhead or belt before a thread that is not self-locking needs constant friction",
            file=drive.file,
            key="friction.law",
            value=friction_of(drive).law,
            allowed="coulomb",
        )
    gamma, mu = of_efficiencies(1.0, 1.0 / uphill, downhill)
    return {"gamma": gamma, "mu": mu, "lead_slope": 1.0, "wedging": 1.0}


def _mechanism_and_eye_values(mechanism: Mechanism, eye: Eye | None) -> tuple[Array, Array]:
    """Return the values of the mechanism (MECHANISM_LAYOUT,) and of the eye (EYE_LAYOUT,)."""
    frames, angles, offset = axes_frames((mechanism.omega1, mechanism.omega2, mechanism.omega3))
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
        lens_frame = eye.lens.frame / eye.lens.semi_axes / lens_limit(eye)
    return data, EYE_LAYOUT.pack(
        centre=base @ eye.centre,
        radius=eye.radius,
        clearance=eye.clearance,
        port=eye.port,
        lens_centre=base @ lens_centre,
        lens_frame=base @ lens_frame,
    )

"""Rows and costs of the elements of a mesh by native/elements.c: any model of `models`, from a robot's figures alone.

They are those of `ElementFunctions`, of `between` and of `breakaway`, within rounding.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal

import casadi as ca
import numpy as np

from ssm_planner.codegen.vectorised import Layout, call
from ssm_planner.dynamics.friction import breakaway_coefficient, friction_of
from ssm_planner.dynamics.motors import motorised
from ssm_planner.dynamics.rigid_body import axes_frames, load_figures
from ssm_planner.interior.problem import ElementGroup
from ssm_planner.kinematics.eye import lens_limit
from ssm_planner.kinematics.forward import JACOBIANS
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.native.library import load
from ssm_planner.planning.ocp.constraints import actuations_by_load
from ssm_planner.planning.ocp.element import COLLOCATION, DENSE, SIMPSON, ElementModel
from ssm_planner.planning.ocp.models import DEGREE, FreeElement, StraightElement
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.limits import MotorTorque, TipSpeed
from ssm_planner.problem.posterior import LAWS
from ssm_planner.problem.problem import Eye
from ssm_planner.typing import Array

MECHANISM = Layout(
    omega2=2, omega3=2, alpha=1, beta=1, delta=1, side=1, spin_offset=1, insertion_sign=1, offset=1
)
"""Of kinematics in the frames of `rigid_body.axes_frames`: x and z of the second and third axis; angles of `Mechanism`; the
offset of θ2."""
EYE = Layout(centre=3, radius=1, clearance=1, port=1, lens_centre=3, lens_frame=9)
"""In the base's frame of these; lens_frame: the columns of the lens's frame, each over its semi-axis and the lens's limit."""
DRIVE = Layout(
    **dict.fromkeys(
        ("ratio", "gamma", "lead_slope", "wedging", "input_inertia", "output_inertia", "preload"), 1
    ),
    **dict.fromkeys(
        ("second_nut_mass", "mu", "mu_stribeck", "stribeck_speed", "b_c", "b_v", "b_oc", "b_ov"), 1
    ),
    **dict.fromkeys(("limit", "nominal"), 1),
)
"""Of one motor and its drive; limit, nominal: its torques."""
LANES = 4
"""Elements that C takes at once."""
KINDS = ("worm", "antibacklash_screw")
"""Of drives, that differ in their law; every other one follows that of a worm."""
Where = Literal["collocation", "between", "breakaway"]
SHARES: dict[Where, tuple[float, ...]] = {
    "collocation": COLLOCATION,
    "between": DENSE,
    "breakaway": (0.0,),
}


class _Context(ctypes.Structure):
    """`Elements` of elements.c."""

    _fields_ = [
        *[
            (name, ctypes.c_long)
            for name in ("straight", "count", "m", "rows", "points", "loads", "actuations", "costs")
        ],
        *[(name, ctypes.c_long) for name in ("effort", "hull")],
        *[
            (name, ctypes.c_void_p)
            for name in ("shares", "weights", "moving", "undriven", "slots", "actuation")
        ],
        *[
            (name, ctypes.c_void_p)
            for name in ("drives", "cost", "cost_drives", "cost_weights", "load", "mechanism")
        ],
        *[(name, ctypes.c_void_p) for name in ("eye", "limits", "sigma", "fits")],
        ("offset", ctypes.c_double),
    ]


class NativeElements:
    """The functions of an element model at n elements with these parameters, by the names of `ElementFunctions`."""

    def __init__(
        self,
        library: ctypes.CDLL,
        element: ElementModel,
        parameters: Sequence[Array],
        count: int,
        where: Where,
    ) -> None:
        laid = _laid(element, where)
        sigma, *fits, packed = parameters
        torque = packed[element.layout.slices["torque"]]
        drives, costs = laid.arrays["drives"].copy(), laid.arrays["cost"]
        drives[:, DRIVE.slices["limit"]] = torque[laid.arrays["actuation"][:, :1]]
        cooling = element.aim == "cooling"
        own: dict[str, Any] = {
            "drives": drives,
            "cost_weights": packed[element.layout.slices["cooling"]][costs[:, 0]]
            if cooling
            else np.ones(len(costs)),
            "limits": packed,
            "sigma": np.broadcast_to(sigma, (count, 4)),
            "fits": _in_lanes(np.broadcast_to(fits[0], (count, fits[0].shape[-1]))) if fits else [],
        }
        self._laid, self._kept = (
            laid,
            {name: np.ascontiguousarray(values, dtype=float) for name, values in own.items()},
        )
        points, rows = len(SHARES[where]), laid.rows
        self.context = _Context(
            straight=isinstance(element, StraightElement),
            count=count,
            m=element.coordinates,
            rows=rows,
            points=points,
            loads=laid.loads,
            actuations=len(drives),
            costs=len(costs),
            effort=element.aim == "effort",
            hull=where == "collocation",
            offset=laid.offset,
            **laid.addresses | _addresses(self._kept),
        )
        size, all_rows = element.size, points * rows
        self.shapes: dict[str, tuple[int, ...]] = {
            "rows": (count, all_rows),
            "jacobian": (count, all_rows, size),
            "hessian": (count, size, size),
        }
        """Of the functions' results, by their names."""
        if len(costs):
            self.shapes |= {"cost": (count, 1), "gradient": (count, size)}
        self._library = library
        self.group = ElementGroup.of(
            library, self.context, (size, all_rows, int(len(costs) > 0), count)
        )
        """For the structured solver."""

    def call(self, name: str, z: Array, multipliers: Array | None = None) -> Array:
        """One of the functions, dense; z (n, size), multipliers of the Hessian (n, rows, and 1 where there is a cost)."""
        values = [
            np.ascontiguousarray(each, dtype=float) for each in (z, multipliers) if each is not None
        ]
        values.append(np.empty(self.shapes[name]))
        addresses = (ctypes.c_void_p(each.ctypes.data) for each in values)
        getattr(self._library, f"ssm_{name}_of")(ctypes.byref(self.context), *addresses)
        return values[-1]


def _addresses(arrays: dict[str, Array]) -> dict[str, int]:
    return {name: values.__array_interface__["data"][0] for name, values in arrays.items()}


@dataclass(frozen=True, eq=False)
class _Laid:
    """What the functions of an element model are given whatever the parameters."""

    arrays: dict[str, Array]
    """By their names in `_Context`; the drives with limits to be filled in."""
    addresses: dict[str, int]
    rows: int
    loads: int
    offset: float


@lru_cache(maxsize=64)
def _laid(element: ElementModel, where: Where) -> _Laid:
    figures = _figures(element)
    rows = element.row_places
    if where == "breakaway":
        rows = [row for row in element.all_rows if row[0] == MotorTorque.name]
    slots = np.full(3 * len(figures.actuation) + element.first_actuation, -1)
    slots[[place for *_, place in rows]] = np.arange(len(rows))
    actuation = figures.actuation.copy()
    if where == "breakaway":
        actuation[:, 2] -= actuation[:, 2] % len(LAWS)
    given = {
        "shares": SHARES[where],
        "weights": SIMPSON,
        "moving": element.moving if isinstance(element, FreeElement) else [0],
        "slots": slots,
        "actuation": actuation,
        "drives": figures.drives[int(where == "breakaway")],
        "cost": figures.cost
        if element.aim != "time" and where == "collocation"
        else figures.cost[:0],
        **figures.arrays,
    }
    arrays = {
        name: np.ascontiguousarray(values, dtype=int if name in _INTEGERS else float)
        for name, values in given.items()
    }
    return _Laid(arrays, _addresses(arrays), len(rows), len(element.robot.loads), figures.offset)


def _in_lanes(fits: Array) -> Array:
    """Fits (n, size of `models.fit_of`) as C reads them: of LANES elements at once, the last repeated, curve by curve."""
    padded = fits[np.minimum(np.arange(-(-len(fits) // LANES) * LANES), len(fits) - 1)]
    curves = (
        padded[:, 2:]
        .reshape(len(padded), DEGREE + 1, -1)
        .transpose(0, 2, 1)
        .reshape(len(padded), -1)
    )
    return np.hstack([padded[:, :2], curves]).reshape(-1, LANES, fits.shape[1]).transpose(0, 2, 1)


def compiled() -> ctypes.CDLL | None:
    """The library; None where there is none, or where it does not know a speed of the tool that is limited."""
    return load() if list(JACOBIANS) == [TipSpeed] else None


def native_elements(
    element: ElementModel, parameters: Sequence[Array], count: int, where: Where = "collocation"
) -> NativeElements | None:
    """None where nothing is compiled.

    parameters: of `element`, (size,) or (count, size). where: at the points COLLOCATION or DENSE, or the rows of
    `breakaway`, each with derivatives.
    """
    library = compiled()
    return None if library is None else NativeElements(library, element, parameters, count, where)


class _Evaluated(ca.Callback):
    """One of the functions of `ElementFunctions` mapped over n elements, for CasADi; its results keep their sparsity."""

    def __init__(self, elements: _AtParameters, name: str, function: ca.Function) -> None:
        ca.Callback.__init__(self)
        self._elements, self._name = elements, name
        self._in = [
            elements.element.size,
            *(parameter.size for parameter in elements.element.parameters),
        ]
        self._repeated = [
            True,
            *(parameter.per_element for parameter in elements.element.parameters),
        ]
        if name == "hessian":
            self._in.append(function.size1_in(len(self._in)))
            self._repeated.append(True)
        self._out = [function.sparsity_out(i) for i in range(function.n_out())]
        row, column = self._out[-1].get_triplet()
        self._places = np.array(row, dtype=int) * self._out[-1].size2() + np.array(
            column, dtype=int
        )
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

    def eval_buffer(self, given: Sequence[memoryview], found: Sequence[memoryview]) -> int:
        """0, or not where something was raised, by the user who interrupted it for instance: `MappedElements.check`."""
        elements = self._elements
        try:
            z, *others = (np.frombuffer(values) for values in given)
            z = z.reshape(elements.count, -1)
            multipliers = (
                others.pop().reshape(elements.count, -1) if self._name == "hessian" else None
            )
            native = elements.at(others)
            if len(found) > 1:
                np.frombuffer(found[0])[:] = native.call("cost", z).ravel()
            values = native.call(self._name, z, multipliers).reshape(elements.count, -1)
            np.frombuffer(found[-1])[:] = values[:, self._places].ravel()
        except BaseException as error:  # noqa: BLE001
            elements.failures.append(error)
        return len(elements.failures)


@dataclass(eq=False)
class _AtParameters:
    """An element model at n elements, with parameters that seldom change."""

    library: ctypes.CDLL
    element: ElementModel
    count: int
    failures: list[BaseException] = field(default_factory=list)
    """What functions raised, for CasADi passes no exceptions on."""
    _last: tuple[list[Array], NativeElements] | None = None

    def at(self, parameters: list[Array]) -> NativeElements:
        """At these parameters; those of the last call are kept."""
        last = self._last
        if last is None or not all(map(np.array_equal, last[0], parameters)):
            kept = [values.copy() for values in parameters]
            shaped = [
                values.reshape(self.count, -1) if parameter.per_element else values
                for values, parameter in zip(kept, self.element.parameters, strict=True)
            ]
            self._last = last = (
                kept,
                NativeElements(self.library, self.element, shaped, self.count, "collocation"),
            )
        return last[1]


class MappedElements:
    """The functions of an element model at n elements for CasADi, with parameters as inputs."""

    def __init__(self, library: ctypes.CDLL, element: ElementModel, count: int) -> None:
        self._elements = _AtParameters(library, element, count)
        self._functions: list[_Evaluated] = []

    def function(self, function: ca.Function) -> ca.Function:
        """In place of one of `ElementFunctions` mapped over the elements; lives as long as this."""
        self._functions.append(_Evaluated(self._elements, function.name(), function))
        return self._functions[-1]

    def check(self) -> None:
        """Raise what a function raised."""
        failures = self._elements.failures[:]
        self._elements.failures.clear()
        if failures:
            raise failures[0]


def mapped_elements(element: ElementModel, count: int) -> MappedElements | None:
    """None where nothing is compiled."""
    library = compiled()
    return None if library is None else MappedElements(library, element, count)


def rows_between(element: ElementModel, z: Array, parameters: Sequence[Array]) -> Array:
    """`ElementModel.between` of elements z (n, size), (n, 9 rows); parameters (size,) or (n, size)."""
    n = len(z)
    native = native_elements(element, parameters, n, "between")
    if native is not None:
        return native.call("rows", z)
    given = (
        values if values.ndim == 2 else np.broadcast_to(values, (n, len(values)))
        for values in parameters
    )
    return call(element.between, z, *given)[0]


_INTEGERS = ("moving", "undriven", "slots", "actuation", "cost")


@dataclass(frozen=True, eq=False)
class _Figures:
    """What is the same for all problems of an element model."""

    actuation: Array
    """Joint, load and law, by load, (a, 3)."""
    drives: tuple[Array, Array]
    """Of each (a, DRIVE), in motion and at breakaway."""
    cost: Array
    """Joint and law of every motor, (q, 2)."""
    arrays: dict[str, Array]
    """By their names in `_Context`."""
    offset: float


@lru_cache(maxsize=32)
def _figures(element: ElementModel) -> _Figures:
    robot = element.robot
    by_load = actuations_by_load(robot)
    motors = [(i, drive, motor.nominal_torque) for i, drive, motor in motorised(robot.joints)]
    arrays = {
        "undriven": np.array([joint.drive is None for joint in robot.joints]),
        "cost_drives": np.array([_drive_figures(drive, nominal) for _, drive, nominal in motors]),
    }
    offset = 0.0
    if isinstance(element, FreeElement):
        offset = axes_frames((robot.geometry.omega1, robot.geometry.omega2, robot.geometry.omega3))[
            2
        ]
        arrays["load"] = np.array(
            [load_figures(each.geometry, each.bodies, each.gravity) for each in robot.loads]
        )
        arrays["mechanism"], arrays["eye"] = _posture_figures(element.mechanism, element.eye)
    return _Figures(
        np.array([(i, load, _law(drive)) for i, _, load, drive, _ in by_load], dtype=int).reshape(
            -1, 3
        ),
        (
            np.array([_drive_figures(drive) for *_, drive, _ in by_load]).reshape(-1, DRIVE.size),
            np.array([_drive_figures(drive, breakaway=True) for *_, drive, _ in by_load]).reshape(
                -1, DRIVE.size
            ),
        ),
        np.array([(i, _law(drive)) for i, drive, _ in motors], dtype=int).reshape(-1, 2),
        arrays,
        offset,
    )


def _law(drive: Drive) -> int:
    kind = KINDS[1] if drive.kind == KINDS[1] else KINDS[0]
    friction = friction_of(drive)
    law = "coulomb" if friction.stribeck_speed is None else friction.law
    return len(LAWS) * KINDS.index(kind) + LAWS.index(law)


def _drive_figures(drive: Drive, nominal: float = 1.0, *, breakaway: bool = False) -> Array:
    """DRIVE; the limit is filled in later."""
    friction = friction_of(drive)
    own = {name: getattr(drive, name) for name in DRIVE.slices if hasattr(drive, name)}
    own |= {name: getattr(friction, name) for name in DRIVE.slices if hasattr(friction, name)}
    own["stribeck_speed"] = friction.stribeck_speed or 1.0
    if breakaway:  # the law of a constant coefficient
        own["mu"] = breakaway_coefficient(friction)
    return DRIVE.pack(**own, limit=1.0, nominal=nominal)


def _posture_figures(mechanism: Mechanism, eye: Eye | None) -> tuple[Array, Array]:
    frames, angles, offset = axes_frames((mechanism.omega1, mechanism.omega2, mechanism.omega3))
    angle = sum(angles)
    figures = MECHANISM.pack(
        omega2=[np.sin(angles[0]), np.cos(angles[0])],
        omega3=[np.sin(angle), np.cos(angle)],
        **{
            name: getattr(mechanism, name)
            for name in ("alpha", "beta", "delta", "side", "spin_offset")
        },
        insertion_sign=mechanism.insertion_sign,
        offset=offset,
    )
    if eye is None:
        return figures, np.ones(EYE.size)
    lens_centre, lens_frame, base = np.zeros(3), np.eye(3), frames[0].T
    if eye.lens is not None:
        lens_centre = eye.lens.centre
        lens_frame = eye.lens.frame / eye.lens.semi_axes / lens_limit(eye)
    return figures, EYE.pack(
        centre=base @ eye.centre,
        radius=eye.radius,
        clearance=eye.clearance,
        port=eye.port,
        lens_centre=base @ lens_centre,
        lens_frame=base @ lens_frame,
    )

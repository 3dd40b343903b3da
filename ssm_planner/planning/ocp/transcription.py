"""The nonlinear program of every optimised motion: transcription on cubic elements.

A straight motion has one coordinate, the path parameter s. The coordinates of a free motion are its
moving joints. `Transcription.build` states the program from top to bottom. Only the element model
differs between both kinds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.codegen.vectorised import Layout
from ssm_planner.elements.compiled import MappedElements, mapped_elements
from ssm_planner.elements.element import ElementModel, element_functions
from ssm_planner.planning.ocp.ipopt import IpoptProgram, Start, build_solvers, ipopt
from ssm_planner.planning.ocp.nlp import (
    Multipliers,
    NlpData,
    NlpSolution,
    NlpStructure,
)
from ssm_planner.trajectory import Cubic
from ssm_planner.typing import Array, frozen, record

SMOOTHING = 3e-6
"""Weight of 3 ∫ (ü/limit)² dt of the joints. It determines the motion of joints that do not bind.
"""
EVEN = 1e-5
"""Weight of the variance of the blocks' times, relative to their least. It makes the mesh unique.
"""


@record
class _Symbols:
    """Variables and parameters of a program with n elements, m coordinates and b blocks."""

    x: ca.MX
    """u, u̇, ü at the start and ü at the end of every element, (4 m, n)."""
    times: ca.MX
    """Times of the blocks, (b,)."""
    cubic: Cubic
    """The elements as cubics, (m, n) each."""
    z: ca.MX
    """The elements as vectors [u; u̇; ü; ü; h], (4 m + 1, n)."""
    element_parameters: list[ca.MX]
    """Parameters of the element model, (size, n) or (size, 1) each."""
    own_parameters: ca.MX
    layout: Layout
    p: Any
    """Parameters of the program by their names in the layout."""

    @classmethod
    def build(cls, structure: NlpStructure, element: ElementModel) -> _Symbols:
        """Return the symbols of a structure and an element model."""
        n, m, b = structure.elements, structure.coordinates, len(structure.block_sizes)
        x, times = ca.MX.sym("x", 4 * m, n), ca.MX.sym("times", b)
        u, v, a0, a1 = (x[i * m : (i + 1) * m, :] for i in range(4))
        element_parameters = [
            ca.MX.sym(f"p{i}", size, n if per_element else 1)
            for i, (size, per_element) in enumerate(element.parameters)
        ]
        layout = Layout(fractions=n, end=2 * m, jerk=m, acceleration=m, weights=2, least_times=b)
        own_parameters = ca.MX.sym("p", layout.size)
        p = layout.unpack(own_parameters)
        # h_k = fraction_k T_block(k)
        h = p.fractions.T * ca.horzcat(
            *(ca.repmat(times[i], 1, size) for i, size in enumerate(structure.block_sizes))
        )
        cubic = Cubic(u, v, a0, a1, ca.repmat(h, m, 1))
        z = ca.vertcat(x, h)
        return cls(
            x=x,
            times=times,
            cubic=cubic,
            z=z,
            element_parameters=element_parameters,
            own_parameters=own_parameters,
            layout=layout,
            p=p,
        )


@frozen
class Transcription:
    """Ipopt for one structure and element model.

    Every number of NlpData is a parameter or a bound.
    """

    structure: NlpStructure
    element: ElementModel
    solver: Callable[[Start], ca.Function] = field(compare=False)
    """Returns Ipopt for a start from a guess, from an earlier solution with multipliers, or from
    the structured solver's.
    """
    native: MappedElements | None = field(compare=False)
    """Functions that are evaluated in C. None without the compiled part."""
    parameters: Layout = field(compare=False)
    """Layout of the fields of NlpData that are parameters, after those of the element model."""
    sizes: dict[str, int] = field(compare=False)
    """Number of rows in every group of constraints before the path constraints, in their order."""

    @classmethod
    @lru_cache(maxsize=12)
    def build(cls, structure: NlpStructure, element: ElementModel) -> Transcription:
        """Return the program, built once for each structure and element model.

        With n elements k, m coordinates and b blocks, the program is

            min   w_t Σ T + w_c Σ L(z_k) + 3 SMOOTHING Σ ∫ (ü/limit)² dt + EVEN var(T / T_least)
            s.t.  u, u̇ continuous, ü too if jerk is limited;
                  bounds on u, u̇, ü, u⃛ and Σ T;  G(z_k) ≤ 1 − backoff

        Shapes are (coordinates, elements), because CasADi maps columns.
        """
        s = _Symbols.build(structure, element)
        duration = ca.sum1(s.times)
        objective = s.p.weights[0] * duration + _regularisation(structure, s.cubic, s.times, s.p)

        # Boundary conditions: bounds of the variables (BoundaryConditions), and static friction
        # where a joint starts. The path constraints G(z_k) and the cost L(z_k) follow from the
        # element model, with exact derivatives.
        constraints = {
            "dynamics": _dynamics(structure, s.cubic, s.p.end),
            **_limits(structure, s.cubic, s.p.jerk),
            "breakaway": _breakaway(structure, element, s),
            "duration": duration,
        }
        native = mapped_elements(element, structure.elements)
        parameters = (ca.vec(parameter) for parameter in s.element_parameters)
        program = IpoptProgram(
            structure,
            x=ca.vertcat(ca.vec(s.x), s.times),
            p=ca.vertcat(*parameters, s.own_parameters),
            objective=objective,
            constraints=ca.vertcat(*constraints.values()),
            cost_weight=s.p.weights[1],
            z=s.z,
            element_parameters=s.element_parameters,
        )
        solver = build_solvers(program, element_functions(element), native)
        sizes = {name: rows.numel() for name, rows in constraints.items()}
        return cls(structure, element, solver, native=native, parameters=s.layout, sizes=sizes)

    def solve(
        self,
        data: NlpData,
        elements: Array,
        warm: NlpSolution | None = None,
        *,
        confirming: bool = False,
    ) -> NlpSolution:
        """Solve with Ipopt from elements (n, 4 m + 1).

        The start is cold from a guess and `warm` from Ipopt's solution of a neighbouring program.
        `confirming` starts from a solution of the structured solver.
        """
        n, m = self.structure.elements, self.structure.coordinates
        if confirming:
            data = self._as_structured(data)
        cold: Start = "brief" if data.brief else "cold"
        start_kind: Start = "confirming" if confirming else cold if warm is None else "warm"
        result, stats = ipopt(self.solver(start_kind), **self._inputs(data, elements, warm))
        if self.native is not None:
            self.native.check()
        x, lam_x, lam_g = (result[name].full().ravel() for name in ("x", "lam_x", "lam_g"))
        states = x[: 4 * m * n].reshape(n, 4 * m)
        times = x[4 * m * n :]
        elements = np.column_stack([states, times[self.structure.block] * data.fractions])
        return NlpSolution(
            str(stats["return_status"]),
            self.structure,
            elements,
            iterations=int(stats["iter_count"]),
            residual=max(stats["iterations"][name][-1] for name in ("inf_pr", "inf_du")),
            ipopt_multipliers=(lam_x, lam_g),
            objective=float(result["f"]),
            multipliers=self._multipliers(data, lam_x, lam_g),
        )

    def _multipliers(self, data: NlpData, of_x: Array, of_g: Array) -> Multipliers:
        """Return the multipliers of the path constraints and of the directions.

        CasADi's are negative at lower bounds.
        """
        n, m = self.structure.elements, self.structure.coordinates
        within = np.zeros((n, m))
        start = self.sizes["dynamics"]
        limited = self.structure.moving & self.structure.velocity_limits
        within[limited] = of_g[start : start + self.sizes["velocity"]]
        at_start = np.where(data.is_fixed, 0.0, of_x[: 4 * m * n].reshape(n, 4 * m))[:, m : 2 * m]
        signed = np.stack([at_start, within])
        lower, upper = (np.maximum(side * signed, 0.0).sum(axis=0) for side in (-1, 1))
        rows = np.maximum(of_g[sum(self.sizes.values()) :], 0.0).reshape(n, -1)
        return Multipliers.of_bounds(data, lower, upper, rows, frozenset(self.element.row_names))

    def _as_structured(self, data: NlpData) -> NlpData:
        """Return the data without bounds of u that follow from others.

        Their barrier would move the point at which Ipopt stops.
        """
        positions = slice(self.structure.coordinates)
        needed = data.bounds_of_u_count(self.structure) | data.is_fixed[:, positions]
        lower, upper = data.lower.copy(), data.upper.copy()
        lower[:, positions][~needed] = -np.inf
        upper[:, positions][~needed] = np.inf
        return replace(data, lower=lower, upper=upper)

    def _inputs(self, data: NlpData, elements: Array, warm: NlpSolution | None) -> dict[str, Array]:
        """Return the arguments of the solver."""
        limited = self.structure.moving & self.structure.velocity_limits
        bounds = {
            "dynamics": (0.0, 0.0),
            "velocity": tuple(velocity[limited] for velocity in data.velocity),
            "jerk": (-np.inf, 0.0),
            "breakaway": (-np.inf, data.breakaway_bound.ravel()),
            "duration": data.duration,
        }
        path_bound = data.path_bound.ravel()
        lower, upper = (
            [np.broadcast_to(bounds[name][side], size) for name, size in self.sizes.items()]
            for side in (0, 1)
        )
        own_parameters = self.parameters.pack(
            **{name: getattr(data, name) for name in self.parameters.slices}
        )
        inputs = {
            "x0": self.structure.variables(elements),
            "p": np.concatenate([*map(np.ravel, data.element_parameters), own_parameters]),
            "lbx": np.append(data.lower.ravel(), data.least_times),
            "ubx": np.append(data.upper.ravel(), np.full(len(data.least_times), np.inf)),
            "lbg": np.concatenate([*lower, np.full(path_bound.size, -np.inf)]),
            "ubg": np.concatenate([*upper, path_bound]),
        }
        if warm is not None and warm.ipopt_multipliers is not None:
            inputs["lam_x0"], inputs["lam_g0"] = warm.ipopt_multipliers
        return inputs


def _regularisation(structure: NlpStructure, cubic: Cubic, times: ca.MX, p: Any) -> ca.MX:
    """Return the smoothing of joints, with r = ü/limit, and the variance of the blocks' times."""
    r0, r1 = (a / ca.repmat(p.acceleration, 1, structure.elements) for a in (cubic.a0, cubic.a1))
    smoothing = (
        ca.sum2(ca.sum1(cubic.h * (r0**2 + r0 * r1 + r1**2))) if structure.joints else ca.MX(0)
    )
    b, relative = times.numel(), times / p.least_times
    variance = ca.sumsqr(relative - ca.sum1(relative) / b) / b
    return SMOOTHING * smoothing + EVEN * variance


def _dynamics(structure: NlpStructure, cubic: Cubic, end: ca.MX) -> ca.MX:
    """Return the gaps between elements, and between the last element and `end` (2 m,).

    ü may jump unless jerk is limited.
    """
    m, moving = structure.coordinates, structure.moving
    u_after, v_after = cubic.end
    gaps = [
        _select(u_after - ca.horzcat(cubic.u[:, 1:], end[:m]), moving),
        _select(v_after - ca.horzcat(cubic.v[:, 1:], end[m:]), moving),
    ]
    if structure.smooth:
        gaps.append(_select(cubic.a1[:, :-1] - cubic.a0[:, 1:], moving[:-1] | moving[1:]))
    return ca.vertcat(*gaps)


def _limits(structure: NlpStructure, cubic: Cubic, jerk: ca.MX) -> dict[str, ca.MX]:
    """Return the rows of velocity and jerk.

    They are the middle Bernstein coefficient of u̇ (the outer ones are variables), and |a1 − a0| −
    jerk h.
    """
    moving = structure.moving
    jerk_limited = moving & (structure.joints and structure.smooth)
    rise = cubic.a1 - cubic.a0
    bound = ca.repmat(jerk, 1, structure.elements) * cubic.h
    return {
        "velocity": _select(cubic.middle_velocity, moving & structure.velocity_limits),
        "jerk": ca.vertcat(
            _select(rise - bound, jerk_limited), _select(-rise - bound, jerk_limited)
        ),
    }


def _breakaway(structure: NlpStructure, element: ElementModel, symbols: _Symbols) -> ca.MX:
    """Return the rows of static friction where a joint may start."""
    sigma, *other_parameters = symbols.element_parameters
    rows = []
    for k, side in structure.breakaways:
        parameters = (_column(parameter, k) for parameter in other_parameters)
        rows.append(element.breakaway(symbols.z[:, k], sigma[:, side], *parameters))
    return ca.vertcat(*rows)


def forget_programs() -> None:
    """Clear the cache of programs, in order to free memory."""
    Transcription.build.cache_clear()


def _select(values: ca.MX, mask: Any) -> ca.MX:
    """Return the selected entries of a matrix (m, n), element after element. `mask` is (n, m)."""
    return ca.vec(values)[np.flatnonzero(mask).tolist()]


def _column(parameter: ca.MX, k: int) -> ca.MX:
    """Return the column of element k of a parameter."""
    return parameter if parameter.size2() == 1 else parameter[:, k]

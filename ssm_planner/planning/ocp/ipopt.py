"""Ipopt solvers for a program of CasADi, with exact sparse derivatives.

`transcription` states the program with the symbols of `ProgramSymbols`. `build_solvers` adds the
constraints and costs of the elements, differentiates everything, and builds Ipopt with options that
depend on the initial point.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, Literal

import casadi as ca

from ssm_planner.codegen.vectorised import Layout
from ssm_planner.elements.compiled import MappedElements
from ssm_planner.elements.element import ElementFunctions, ElementModel
from ssm_planner.interior.solve import (
    FIRST_BARRIER,
    OPTIMALITY_TOLERANCE,
    TOLERANCE_PER_BARRIER,
)
from ssm_planner.planning.ocp.nlp import NlpStructure
from ssm_planner.trajectory import CubicPiece
from ssm_planner.typing import record

Start = Literal["cold", "confirming"]
"""Kind of initial point, which decides on Ipopt's options.

"cold": a guess. "confirming": a solution of the structured solver (`ocp.structured`), which Ipopt is
to confirm.
"""
COLD_START_ITERATIONS = 300
"""Largest number of iterations of a cold start, unless twice the number of elements is larger."""
COMMON_OPTIONS = {
    "print_level": 0,
    "sb": "yes",
    "tol": OPTIMALITY_TOLERANCE,
    # 0 selects the AMD ordering. MUMPS would choose METIS on fine meshes, which takes longer.
    "mumps_pivot_order": 0,
}
"""Options of Ipopt for every kind of start."""
OPTIONS_BY_START: dict[Start, dict[str, Any]] = {
    "cold": {"mu_init": FIRST_BARRIER, "bound_push": 1e-2, "bound_frac": 1e-2},
    # Ipopt computes multipliers as barrier weight / slack. At the last barrier weight of the
    # structured solver they are that solver's multipliers, so Ipopt begins at the solution.
    "confirming": {
        "max_iter": 30,
        "bound_mult_init_method": "mu-based",
        "mu_init": OPTIMALITY_TOLERANCE / TOLERANCE_PER_BARRIER,
        "bound_push": 1e-13,
        "bound_frac": 1e-13,
        "slack_bound_push": 1e-13,
        "slack_bound_frac": 1e-13,
        # With 0 Ipopt crashes if it has to treat fixed variables as free ones.
        "bound_relax_factor": 1e-12,
        "constr_mult_init_max": 1e10,
    },
}
"""Options of Ipopt by the kind of start, in addition to `COMMON_OPTIONS`."""


@record
class ProgramSymbols:
    """CasADi symbols of a program with n elements, m coordinates and b blocks."""

    structure: NlpStructure
    x: ca.MX
    """u, u̇, ü at the start and ü at the end of every element as columns, (4 m, n)."""
    times: ca.MX
    """Durations of the blocks in scaled time, (b,)."""
    cubic: CubicPiece
    """The elements as cubics, (m, n) each."""
    z: ca.MX
    """Vectors z of the elements as columns, (4 m + 1, n).

    Each column contains u, u̇, ü at the start and ü at the end of an element (m numbers each), and
    the length h of this element.
    """
    element_parameters: list[ca.MX]
    """Constants of the functions of an element as columns: (size, n), or (size, 1) if shared."""
    own_parameters: ca.MX
    """Parameters of the program itself as one vector."""
    layout: Layout
    """Names and positions of the parameters in this vector. The names are fields of `NlpData`."""
    p: Any
    """The same parameters as attributes."""

    @classmethod
    def build(cls, structure: NlpStructure, element: ElementModel) -> "ProgramSymbols":
        """Create the CasADi symbols of a program.

        Parameters
        ----------
        structure : NlpStructure
            Numbers of elements, coordinates and blocks.
        element : ElementModel
            Functions of one element. They determine the sizes of the vectors of their constants.

        Returns
        -------
        ProgramSymbols
            Free symbols, and the expressions of the elements in terms of these symbols.
        """
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
        # The length of element k is h_k = fraction_k · T_b, with the duration T_b of its block b.
        h = p.fractions.T * ca.horzcat(
            *(ca.repmat(times[i], 1, size) for i, size in enumerate(structure.block_sizes))
        )
        cubic = CubicPiece(u, v, a0, a1, ca.repmat(h, m, 1))
        z = ca.vertcat(x, h)
        return cls(
            structure,
            x=x,
            times=times,
            cubic=cubic,
            z=z,
            element_parameters=element_parameters,
            own_parameters=own_parameters,
            layout=layout,
            p=p,
        )

    @property
    def variables(self) -> ca.MX:
        """Variables of the program: states of all elements, then durations of the blocks."""
        return ca.vertcat(ca.vec(self.x), self.times)

    @property
    def parameters(self) -> ca.MX:
        """All parameters as one vector: constants of the elements, then `own_parameters`."""
        return ca.vertcat(*map(ca.vec, self.element_parameters), self.own_parameters)


def build_solvers(
    symbols: ProgramSymbols,
    objective: ca.MX,
    constraints: ca.MX,
    *,
    functions: ElementFunctions,
    native: MappedElements | None,
) -> Callable[[Start], ca.Function]:
    """Build Ipopt solvers with exact sparse derivatives, one for each kind of start.

    The program is

        min   f(x) = objective + w Σ L(z_k)
        s.t.  bounds on g(x) = [constraints; G(z_1); …; G(z_n)],  z = S x + constant,

    where z contains the vectors z_k of all elements. The Jacobian and the Hessian of one element,
    in C or as expanded expressions, are evaluated for all elements. This is several times faster
    than the derivatives of the program as a whole, and gives the same numbers. With the Lagrange
    multipliers λ of all constraints, λ_k of G(z_k), and λ_f of the objective, and with the Hessians
    H_k = ∇²(λ_kᵀ G + λ_f w L)(z_k),

        ∇g = [∂constraints/∂x; diag(∂G/∂z(z_k)) S],   ∇f = ∇objective + w Sᵀ [∇L(z_k)]_k,
        ∇²(Lagrangian) = ∇²(λ_f objective + λᵀ constraints) + Sᵀ diag(H_k) S.

    Parameters
    ----------
    symbols : ProgramSymbols
        Variables and parameters of the program.
    objective : MX
        Objective without the costs L of the elements.
    constraints : (rows,) MX
        Constraints without the path constraints G of the elements.
    functions : ElementFunctions
        Path constraints and costs of one element, and their derivatives.
    native : MappedElements or None
        The same functions of all elements in C. None without the compiled part.

    Returns
    -------
    callable
        Function that returns the solver for a kind of start, and keeps it for the next call.
    """
    x, p, z, weight = symbols.variables, symbols.parameters, symbols.z, symbols.p.weights[1]
    n, z_by_x = z.size2(), ca.jacobian(ca.vec(z), x)
    evaluate = partial(_map_elements, native, z, symbols.element_parameters)
    # Constraints and their Jacobian.
    jacobians = _block_diagonal(evaluate(functions.jacobian), functions.jacobian.sparsity_out(0), n)
    g = ca.vertcat(constraints, ca.vec(evaluate(functions.rows)))
    jac_g = ca.vertcat(ca.jacobian(constraints, x), jacobians @ z_by_x)

    f, grad_f = objective, ca.gradient(objective, x)
    # Objective with the costs of all elements, and its gradient.
    lam_f = ca.MX.sym("lam_f")
    lam_g = ca.MX.sym("lam_g", g.numel())
    lam_constraints, lam_rows = ca.vertsplit(lam_g, [0, constraints.numel(), g.numel()])
    multipliers = ca.reshape(lam_rows, -1, n)
    if functions.cost is not None and functions.gradient is not None:
        f += weight * ca.sum2(evaluate(functions.cost))
        _, cost_gradients = evaluate(functions.gradient)
        grad_f += weight * (z_by_x.T @ ca.vec(cost_gradients))
        multipliers = ca.vertcat(multipliers, ca.repmat(lam_f * weight, 1, n))
    # Hessian of the Lagrangian.
    hessians = _block_diagonal(
        evaluate(functions.hessian, multipliers), functions.hessian.sparsity_out(0), n
    )
    hess = ca.hessian(lam_f * objective + ca.dot(lam_constraints, constraints), x)[0]
    hess += z_by_x.T @ hessians @ z_by_x
    nlp = {"x": x, "p": p, "f": f, "g": g}
    hess_lag = ca.Function("hess_lag", [x, p, lam_f, lam_g], [ca.triu(hess)])
    return _ipopt_by_start(symbols.structure, nlp, grad_f, jac_g=jac_g, hess_lag=hess_lag)


def _ipopt_by_start(
    structure: NlpStructure,
    nlp: dict[str, ca.MX],
    grad_f: ca.MX,
    *,
    jac_g: ca.MX,
    hess_lag: ca.Function,
) -> Callable[[Start], ca.Function]:
    """Return a function that builds Ipopt for a kind of start, from a program and its derivatives.

    Parameters
    ----------
    structure : NlpStructure
        Number of elements and kinds of constraints, on which the options depend.
    nlp : dict
        Expressions x (variables), p (parameters), f (objective) and g (constraints).
    grad_f : MX
        Gradient of f by x.
    jac_g : MX
        Jacobian of g by x.
    hess_lag : Function
        Upper triangle of the Hessian of the Lagrangian, with the arguments of CasADi's `nlpsol`.

    Returns
    -------
    callable
        Function of a kind of start. It keeps each solver for the next call.
    """
    x, p, f, g = nlp.values()
    options: dict[str, Any] = {
        "print_time": False,
        "error_on_fail": False,
        "no_nlp_grad": True,  # It would only serve multipliers of p, which are not needed.
        "calc_lam_p": False,
        "grad_f": ca.Function("grad_f", [x, p], [f, grad_f], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [x, p], [g, jac_g], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": hess_lag,
    }

    def build(start: Start) -> ca.Function:
        """Build Ipopt with the options of one kind of start.

        Parameters
        ----------
        start : str
            "cold" or "confirming".

        Returns
        -------
        Function
            Solver with the arguments of CasADi's `nlpsol`.
        """
        iterations = max(COLD_START_ITERATIONS, 2 * structure.elements)
        ipopt_options = {**COMMON_OPTIONS, "max_iter": iterations, **OPTIONS_BY_START[start]}
        # Initial multipliers mu_init / slack save a fifth of the iterations, except if the
        # coordinates are joints with limited jerk.
        if start == "cold" and not (
            structure.coordinates_are_joints and structure.has_continuous_acceleration
        ):
            ipopt_options["bound_mult_init_method"] = "mu-based"
        return ca.nlpsol("ocp", "ipopt", nlp, {**options, "ipopt": ipopt_options})

    return cache(build)


def _map_elements(
    native: MappedElements | None,
    z: ca.MX,
    parameters: list[ca.MX],
    function: ca.Function,
    *inputs: ca.MX,
) -> Any:
    """Evaluate a function at all elements and return the values side by side.

    Parameters
    ----------
    native : MappedElements or None
        The element functions in C. None: CasADi evaluates them.
    z : (4 m + 1, n) MX
        Vectors z of the elements as columns: u, u̇, ü at the start, ü at the end (m numbers each),
        and the length.
    parameters : list of MX
        Constants of the function: (size, n) with one column for each element, or (size, 1) if all
        elements share them.
    function : Function
        CasADi function of one element, with the arguments z, the constants and `inputs`.
    *inputs : MX
        Further arguments of the function, one column for each element.

    Returns
    -------
    MX or list of MX
        The results of the function, with the columns of all elements one after the other. A
        function with several results gives a list.
    """
    if native is not None:
        return native.function(function)(z, *parameters, *inputs)
    # Argument 0 is z, so parameter i is argument i + 1.
    shared = [i + 1 for i, parameter in enumerate(parameters) if parameter.size2() == 1]
    return function.map(function.name(), "serial", z.size2(), shared, [])(z, *parameters, *inputs)


def run_ipopt(solver: ca.Function, **arguments: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Run Ipopt once and return CasADi's result and the statistics of the run.

    Parameters
    ----------
    solver : Function
        Solver of `build_solvers`.
    **arguments
        Initial point, bounds and parameters by CasADi's names, for example x0 and lbg.

    Returns
    -------
    result : dict
        Final variables x, objective f, and multipliers lam_x and lam_g of the bounds.
    stats : dict
        Return status, number of iterations, and residuals of all iterations.

    Raises
    ------
    KeyboardInterrupt
        If the user interrupted the solver.
    """
    result = solver(**arguments)
    stats = solver.stats()
    # This status is the only trace of Ctrl-C: Ipopt does not pass the exception on.
    if stats["return_status"] == "NonIpopt_Exception_Thrown":
        raise KeyboardInterrupt
    return result, stats


def _block_diagonal(columns: ca.MX, block: ca.Sparsity, count: int) -> ca.MX:
    """Return the block-diagonal matrix diag(B_1, …, B_n).

    Parameters
    ----------
    columns : MX
        Blocks side by side, as a mapped function returns them.
    block : Sparsity
        Sparsity pattern of one block.
    count : int
        Number n of blocks.
    """
    pattern = ca.diagcat(*[block] * count)
    return ca.MX(pattern, ca.vec(columns).nz[:]) if pattern.nnz() else ca.MX(*pattern.shape)

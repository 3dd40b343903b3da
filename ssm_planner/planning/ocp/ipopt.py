"""Ipopt solvers for nonlinear programs in CasADi, with exact sparse derivatives.

`transcription` states a program with the symbols of `ProgramSymbols`. `build_solvers` adds the path
constraints and the costs of the elements (time intervals of the mesh), builds the derivatives of
the whole program, and returns Ipopt with options that depend on the kind of initial point.

Source of Ipopt: A. Wächter, L. T. Biegler, On the implementation of an interior-point filter
line-search algorithm for large-scale nonlinear programming, Mathematical Programming 106, 2006.
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

"cold": a guess. "confirming": a solution of the structured solver (`ocp.structured`), which Ipopt
is to confirm.
"""
COLD_START_ITERATIONS = 300
"""Largest number of iterations of a cold start, unless twice the number of elements is larger."""
COMMON_OPTIONS = {
    "print_level": 0,
    "sb": "yes",  # Ipopt does not print its banner.
    "tol": OPTIMALITY_TOLERANCE,
    # Ipopt relaxes the bounds of the variables slightly. Its result keeps the original ones.
    "honor_original_bounds": "yes",
    # 0 selects the AMD ordering. MUMPS would choose METIS on fine meshes, which takes longer.
    "mumps_pivot_order": 0,
}
"""Options of Ipopt for every kind of start."""
OPTIONS_BY_START: dict[Start, dict[str, Any]] = {
    "cold": {"mu_init": FIRST_BARRIER, "bound_push": 1e-2, "bound_frac": 1e-2},
    # A slack is the distance of a constraint from its bound. Ipopt computes its first multipliers
    # as barrier weight / slack. With the last barrier weight of the structured solver, they are
    # that solver's multipliers, so Ipopt begins at the solution. The pushes of 1e-13 keep Ipopt
    # from moving this initial point away from the bounds. Their default is 1e-2.
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
    """CasADi symbols of a program with n elements, m coordinates and b blocks.

    Elements are time intervals, in which the coordinates u are cubic polynomials. Blocks are groups
    of elements that share one unknown duration (`nlp`).
    """

    structure: NlpStructure
    """Numbers of elements, segments and blocks, and kinds of constraints of the program."""
    x: ca.MX
    """u, u̇, ü at the start and ü at the end of every element as columns, (4 m, n)."""
    times: ca.MX
    """Durations of the blocks in scaled time, (b,)."""
    cubic: CubicPiece
    """The elements as cubic polynomials. Each field has the shape (m, n)."""
    z: ca.MX
    """Vectors z of the elements as columns, (4 m + 1, n).

    Each column contains u, u̇, ü at the start and ü at the end of an element (m numbers each), and
    the length h of this element.
    """
    element_parameters: list[ca.MX]
    """Parameter vectors of the element model as columns: (size, n), or (size, 1) if shared."""
    own_parameters: ca.MX
    """Parameters of the program itself as one vector, (layout.size,)."""
    layout: Layout
    """Names and positions of the parameters in this vector. The names are fields of `NlpData`."""
    p: Any
    """The same parameters as attributes with the names in `layout`."""

    @classmethod
    def build(cls, structure: NlpStructure, element: ElementModel) -> "ProgramSymbols":
        """Create the CasADi symbols of a program.

        Parameters
        ----------
        structure : NlpStructure
            Numbers of elements, coordinates and blocks.
        element : ElementModel
            Functions of one element (time interval). Only the sizes of their parameter vectors are
            used.

        Returns
        -------
        ProgramSymbols
            Symbols of the variables and parameters, and the vectors z of the elements as
            expressions of these symbols.
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
        """Variables of the program as one vector, (4 m n + b,).

        It contains u, u̇, ü at the start and ü at the end of each element, then the durations of the
        blocks.
        """
        return ca.vertcat(ca.vec(self.x), self.times)

    @property
    def parameters(self) -> ca.MX:
        """All parameters as one vector: those of the element model, then `own_parameters`."""
        return ca.vertcat(*map(ca.vec, self.element_parameters), self.own_parameters)


def build_solvers(
    symbols: ProgramSymbols,
    objective: ca.MX,
    constraints: ca.MX,
    *,
    functions: ElementFunctions,
    native: MappedElements | None,
) -> Callable[[Start], ca.Function]:
    """Add the elements to a program, and build its Ipopt solvers with exact sparse derivatives.

    The elements (time intervals of the mesh) add their path constraints and their costs.

    Parameters
    ----------
    symbols : ProgramSymbols
        Variables and parameters of the program.
    objective : MX
        Objective without the costs of the elements.
    constraints : (rows,) MX
        Constraints without the path constraints of the elements.
    functions : ElementFunctions
        Path constraints and cost of one element as CasADi functions, with their derivatives.
    native : MappedElements or None
        The same functions of all elements in C. None without the compiled part of the package.

    Returns
    -------
    callable
        Function that takes the kind of start, "cold" or "confirming", and returns the solver. It
        builds each solver at the first call and keeps it for later ones.

    Notes
    -----
    With the vectors z_k of the elements, which form z, with their path constraints G and costs L,
    and with the weight w of the costs, the program is

        min   f(x) = objective + w Σ L(z_k)
        s.t.  bounds on g(x) = [constraints; G(z_1); …; G(z_n)],  z = S x + constant.

    The Jacobian and the Hessian of one element, in C or as expanded expressions, are evaluated for
    all elements. This is several times faster than the derivatives of the program as a whole, and
    gives the same numbers. With the Lagrange multipliers λ of `constraints`, λ_k of G(z_k) and λ_f
    of the objective, and with the Hessians H_k = ∇²(λ_kᵀ G + λ_f w L)(z_k),

        ∇g = [∂constraints/∂x; diag(∂G/∂z(z_k)) S],   ∇f = ∇objective + w Sᵀ [∇L(z_k)]_k,
        ∇²(Lagrangian) = ∇²(λ_f objective + λᵀ constraints) + Sᵀ diag(H_k) S.
    """
    x, p, z, weight = symbols.variables, symbols.parameters, symbols.z, symbols.p.weights[1]
    n, z_by_x = z.size2(), ca.jacobian(ca.vec(z), x)
    evaluate = partial(_map_elements, native, z, symbols.element_parameters)
    # g and its Jacobian. `z_by_x` is the matrix S.
    jacobians = _block_diagonal(evaluate(functions.jacobian), functions.jacobian.sparsity_out(0), n)
    g = ca.vertcat(constraints, ca.vec(evaluate(functions.rows)))
    jac_g = ca.vertcat(ca.jacobian(constraints, x), jacobians @ z_by_x)

    f, grad_f = objective, ca.gradient(objective, x)
    # Multipliers λ_f of the objective and λ of all constraints: first those of `constraints`, then
    # those of the path constraints, which `multipliers` contains in one column for each element.
    lam_f = ca.MX.sym("lam_f")
    lam_g = ca.MX.sym("lam_g", g.numel())
    lam_constraints, lam_rows = ca.vertsplit(lam_g, [0, constraints.numel(), g.numel()])
    multipliers = ca.reshape(lam_rows, -1, n)
    # f and its gradient, with the costs of all elements.
    if functions.cost is not None and functions.gradient is not None:
        f += weight * ca.sum2(evaluate(functions.cost))
        _, cost_gradients = evaluate(functions.gradient)
        grad_f += weight * (z_by_x.T @ ca.vec(cost_gradients))
        multipliers = ca.vertcat(multipliers, ca.repmat(lam_f * weight, 1, n))
    # Hessian of the Lagrangian. Ipopt reads its upper triangle.
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
    """Return a function that builds the Ipopt solver of a program for a given kind of start.

    Parameters
    ----------
    structure : NlpStructure
        Number of elements and kinds of constraints, on which the options depend.
    nlp : dict
        Expressions of the program in this order: variables x, parameters p, objective f and
        constraints g.
    grad_f : MX
        Gradient of f with respect to x.
    jac_g : MX
        Jacobian of g with respect to x.
    hess_lag : Function
        Upper triangle of the Hessian of the Lagrangian as a function of x, p, and the multipliers
        of f and g.

    Returns
    -------
    callable
        Function that takes the kind of start, "cold" or "confirming", and returns the solver. It
        builds each solver at the first call and keeps it for later ones.
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
        """Build Ipopt with the options for one kind of start.

        The function reads the program, its derivatives and its structure from the enclosing one.

        Parameters
        ----------
        start : str
            "cold" (from a guess) or "confirming" (from a solution of the structured solver).

        Returns
        -------
        Function
            The solver, with the arguments and results of `casadi.nlpsol`.
        """
        iterations = max(COLD_START_ITERATIONS, 2 * structure.elements)
        ipopt_options = {**COMMON_OPTIONS, "max_iter": iterations, **OPTIONS_BY_START[start]}
        # Initial multipliers mu_init / slack instead of 1 save a fifth of the iterations, except if
        # the coordinates are joints with limited jerk.
        if start == "cold" and not structure.limits_jerk:
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
    """Evaluate a function of one element at all elements, and return the values side by side.

    Parameters
    ----------
    native : MappedElements or None
        The functions of the elements (time intervals) in C. None: CasADi evaluates them.
    z : (4 m + 1, n) MX
        Vectors z of the n elements as columns: u, u̇, ü at the start, ü at the end (m numbers each),
        and the length.
    parameters : list of MX
        Parameter vectors of the function: (size, n) with one column for each element, or (size, 1)
        if all elements share the vector.
    function : Function
        One of `ElementFunctions`. Its arguments are z, the parameter vectors and `inputs`.
    *inputs : MX
        Further arguments of the function, one column for each element.

    Returns
    -------
    MX or list of MX
        Results of the function. For a result with c columns, the value is an expression with c n
        columns: those of the first element, then those of the second one, and so on. A function
        with several results gives a list.
    """
    if native is not None:
        return native.function(function)(z, *parameters, *inputs)
    # Argument 0 is z, so parameter i is argument i + 1.
    shared = [i + 1 for i, parameter in enumerate(parameters) if parameter.size2() == 1]
    return function.map(function.name(), "serial", z.size2(), shared, [])(z, *parameters, *inputs)


def run_ipopt(solver: ca.Function, **arguments: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Run Ipopt once, and return the solution and the statistics of the run.

    Parameters
    ----------
    solver : Function
        A solver that `build_solvers` provides.
    **arguments
        Initial point, bounds and parameters by their names in `casadi.nlpsol`, for example `x0` and
        `lbg`.

    Returns
    -------
    result : dict
        Results of `casadi.nlpsol`: the final variables `x`, the objective `f`, the multipliers
        `lam_x` and `lam_g` of the bounds, and others.
    stats : dict
        Statistics of Ipopt, for example its return status, the number of iterations, and the
        residuals after each iteration.

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
    """Build the block-diagonal matrix diag(B_1, …, B_n) of equally large blocks.

    Parameters
    ----------
    columns : (rows, n · columns of a block) MX
        Blocks side by side, as `_map_elements` returns them.
    block : Sparsity
        Sparsity pattern of one block, which all blocks have.
    count : int
        Number n of blocks.

    Returns
    -------
    MX
        The sparse matrix.
    """
    # CasADi stores nonzeros column by column. `columns` and the block-diagonal matrix have the same
    # nonzeros in the same order, so only the pattern changes.
    pattern = ca.diagcat(*[block] * count)
    return ca.MX(pattern, ca.vec(columns).nz[:]) if pattern.nnz() else ca.MX(*pattern.shape)

"""Speeds of the tool that a problem may limit: |v| with v = J(q) q̇, one Jacobian for each kind of SpeedLimit."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.forward import tip_position_symbolic
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.problem.limits import SpeedLimit, TipSpeed
from ssm_planner.typing import Array

if TYPE_CHECKING:
    import casadi


def tip_jacobian(mechanism: Mechanism, q: casadi.SX) -> casadi.SX:
    """∂p/∂q of the tip position, (3, 4); q (4,)."""
    import casadi

    return casadi.jacobian(tip_position_symbolic(mechanism, q), q)


JACOBIANS: dict[type[SpeedLimit], Callable[[Mechanism, casadi.SX], casadi.SX]] = {TipSpeed: tip_jacobian}
"""J of every kind of limit, (k, 4) in CasADi from q (4,)."""


def tool_speed(kind: type[SpeedLimit], mechanism: Mechanism, q: Array, qd: Array) -> Array:
    """|J(q) q̇| of joints q and rates qd, (n, 4) each; (n,), SI."""
    from ssm_planner.codegen.vectorised import call

    return np.asarray(call(_speed(kind, mechanism), q, qd)[0][:, 0])


def speed_bounds(limits: Iterable[SpeedLimit], unlimited: float) -> Array:
    """The bound of every kind in JACOBIANS, in its order; (kinds,). Raises ProblemError for a kind that is not there."""
    found = {type(limit): limit.largest for limit in limits}
    for kind in found:
        if kind not in JACOBIANS:
            raise ProblemError(f"kinematics/tool_speeds.py has no Jacobian for {kind.__name__}")
    return np.array([found.get(kind, unlimited) for kind in JACOBIANS])


@lru_cache(maxsize=16)
def _speed(kind: type[SpeedLimit], mechanism: Mechanism) -> casadi.Function:
    import casadi

    q, qd = casadi.SX.sym("q", 4), casadi.SX.sym("qd", 4)
    return casadi.Function("speed", [q, qd], [casadi.norm_2(JACOBIANS[kind](mechanism, q) @ qd)])

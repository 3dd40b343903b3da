"""The nonlinear program behind every optimised motion: coordinates as cubic pieces on a mesh of elements.

    variables   u, u̇, ü at the start and ü at the end of every element; the time T_k of every block
    objective   w_t Σ T_k + w_c ∫ cost dt (heat or effort of the motors); besides a trace of ∫ ü² of joints, and of unevenness
                of the mesh, which decide what is otherwise undecided
    dynamics    u and u̇ continuous (ü too where jerk is limited)
    limits      rows ≤ 1 of the stage at the collocation points of every element; static friction where a joint starts;
                of the coordinates themselves: the Bernstein coefficients of u̇, and the slope of ü

A segment lies between two borders at which u is given: waypoints, or the points where a joint turns back. A straight
motion has one coordinate, its path parameter s; a free motion has its moving joints.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeVar, cast

import casadi as ca
import numpy as np

from ssm_planner.planning.ocp import element
from ssm_planner.planning.ocp.compiled import stages
from ssm_planner.planning.ocp.derivatives import Mesh, assemble, ipopt
from ssm_planner.planning.ocp.element import COLLOCATION, ElementFunctions
from ssm_planner.planning.ocp.nlp import NlpData, NlpSolution, NlpStructure
from ssm_planner.typing import Array

SMOOTHING = 3e-6
"""Weight of ∫ (ü/limit)² of joints."""
EVEN = 1e-5
"""Weight of the variance of the blocks' times, each relative to its least: decides where several meshes do as well."""
ITERATIONS, HEAT_ITERATIONS = 300, 80
"""At most; the least heat is given up sooner, for the fastest motion is at hand."""
KEPT_PROGRAMS = 12
KEPT_STAGES = 32
KEPT_ANSWERS = 64
RowName = tuple[str, int | None]
Aim = Literal["time", "heat", "effort"]
DENSE = tuple(k / 8 for k in range(9))
"""Where the planner looks for limits exceeded between the collocation points."""


class ElementModel(element.ElementModel, Protocol):
    """One element of a motion as CasADi Functions."""

    @property
    def key(self) -> tuple[Any, ...]:
        """Two stages with the same key have the same functions."""

    @property
    def aim(self) -> Aim: ...

    @property
    def names(self) -> list[RowName]:
        """Limit and joint of every row."""

    @property
    def breakaway(self) -> ca.Function:
        """(z, *arguments) → rows ≤ 1 at the element's start with static friction."""

    @property
    def breakaway_joints(self) -> Sequence[int]:
        """Joint of every breakaway row."""


@dataclass(frozen=True, eq=False)
class Transcription:
    """Ipopt on one shape and stage, all numbers being parameters."""

    shape: NlpStructure
    stage: ElementModel
    cold: ca.Function
    warm: ca.Function
    equal: int
    hull: int
    slope: int
    start: int
    """Rows: equations, velocity hull, slope of the acceleration, breakaway; then the total time, then the elements'."""

    @classmethod
    def of(cls, shape: NlpStructure, stage: ElementModel) -> Transcription:
        """The program, built once for each shape and key of a stage; again when the stage has been compiled."""
        functions, compiled = stages.functions(stage, stage.key)
        key = (shape, stage.key, compiled)
        found: Transcription = _recent(_programs, key, lambda: cls._build(shape, stage, functions), KEPT_PROGRAMS)
        return found

    @classmethod
    def _build(cls, shape: NlpStructure, stage: ElementModel, functions: ElementFunctions) -> Transcription:
        n, m = shape.elements, shape.coordinates
        x, times = ca.MX.sym("x", 4 * m, n), ca.MX.sym("times", len(shape.blocks))
        arguments = [ca.MX.sym(f"argument{i}", size, n if own else 1) for i, (size, own) in enumerate(stage.arguments)]
        fractions, end, weights = ca.MX.sym("fractions", 1, n), ca.MX.sym("end", m, 2), ca.MX.sym("weights", 2)
        jerk, unit, least = ca.MX.sym("jerk", m), ca.MX.sym("unit", m), ca.MX.sym("least", len(shape.blocks))
        h = fractions * ca.horzcat(*(ca.repmat(times[i], 1, k) for i, k in enumerate(shape.blocks)))
        wide = ca.repmat(h, m, 1)
        u, v, a0, a1 = (x[k * m : (k + 1) * m, :] for k in range(4))
        moving = shape.moving
        next_u, next_v = ca.horzcat(u[:, 1:], end[:, 0]), ca.horzcat(v[:, 1:], end[:, 1])
        equal = [
            _where(u + wide * v + wide**2 * (a0 / 3 + a1 / 6) - next_u, moving),
            _where(v + wide * (a0 + a1) / 2 - next_v, moving),
        ]
        if shape.smooth:
            equal.append(_where(a1[:, :-1] - a0[:, 1:], moving[:-1] | moving[1:]))
        hull = _where(v + wide * a0 / 2, moving & shape.hull)
        room = ca.repmat(jerk, 1, n) * wide
        sloped = moving & (shape.joints and shape.smooth)
        slopes = ca.vertcat(_where(a1 - a0 - room, sloped), _where(a0 - a1 - room, sloped))
        z = ca.vertcat(x, h)
        starts = [
            stage.breakaway(z[:, k], arguments[0][:, side], *(_column(argument, k) for argument in arguments[1:]))
            for k, side in shape.starts
        ]
        equations, starting = ca.vertcat(*equal), ca.vertcat(*starts)
        b0, b1 = (a / ca.repmat(unit, 1, n) for a in (a0, a1))
        energy = ca.sum2(ca.sum1(wide * (b0**2 + b0 * b1 + b1**2))) if shape.joints else ca.MX(0)
        total = ca.sum1(times)
        pace = times / least
        uneven = ca.sumsqr(pace - ca.sum1(pace) / pace.numel()) / pace.numel()
        cold, warm = assemble(
            ca.vertcat(ca.vec(x), times),
            ca.vertcat(*(ca.vec(a) for a in arguments), fractions.T, ca.vec(end), jerk, unit, weights, least),
            weights[0] * total + SMOOTHING * energy + EVEN * uneven,
            ca.vertcat(equations, hull, slopes, starting, total),
            functions,
            Mesh(z, tuple(arguments)),
            weights[1],
            HEAT_ITERATIONS if stage.aim == "heat" else max(ITERATIONS, 2 * n),
        )
        sizes = (part.numel() for part in (equations, hull, slopes, starting))
        return cls(shape, stage, cold, warm, *sizes)

    def solve(self, question: NlpData, point: dict[str, Any]) -> NlpSolution:
        """Ipopt's answer from a guess (`point_of`), or warm from an earlier answer's point."""
        shape = self.shape
        fast = [speed[shape.moving & shape.hull] for speed in question.speed]
        allowed = np.tile(question.allowed, (1, len(COLLOCATION))).ravel()
        free = np.full(self.slope + self.start, -np.inf), np.full(allowed.size, -np.inf)
        low = (np.zeros(self.equal), fast[0], free[0], question.time[:1], free[1])
        high = (
            *(np.zeros(self.equal), fast[1], np.zeros(self.slope)),
            *(question.starting.ravel(), question.time[1:], allowed),
        )
        arguments = (a.ravel() for a in question.arguments)
        numbers = {
            **point,
            "p": np.concatenate([*arguments, *question.parameters]),
            "lbx": np.append(question.lower.ravel(), question.times),
            "ubx": np.append(question.upper.ravel(), np.full(len(shape.blocks), np.inf)),
            "lbg": np.concatenate(low),
            "ubg": np.concatenate(high),
        }
        digest = hashlib.sha256(b"".join(np.asarray(value).tobytes() for value in numbers.values())).digest()
        # trials of relaxations and second attempts ask most of their questions again
        key = shape, self.stage.key, tuple(numbers), digest
        found: NlpSolution = _recent(_answers, key, lambda: self._solve(question, numbers), KEPT_ANSWERS)
        return found

    def _solve(self, question: NlpData, numbers: dict[str, Any]) -> NlpSolution:
        shape, n, m = self.shape, self.shape.elements, self.shape.coordinates
        answer, stats = ipopt(self.warm if "lam_g0" in numbers else self.cold, **numbers)
        stages.spent(self.stage.key, sum(stats[f"t_wall_nlp_{name}"] for name in ("g", "jac_g", "hess_l", "grad_f")))
        x = answer["x"].full().ravel()
        states, found = x[: 4 * m * n].reshape(n, 4 * m), x[4 * m * n :]
        elements = np.column_stack([states, found[shape.block] * question.fractions])
        again = {"x0": answer["x"], "lam_x0": answer["lam_x"], "lam_g0": answer["lam_g"]}
        return NlpSolution(str(stats["return_status"]), shape, elements, found, int(stats["iter_count"]), again)


def point_of(states: Array, times: Array) -> dict[str, Any]:
    """Where to start from: states (n, 4 m) and times (b,)."""
    return {"x0": np.append(states.ravel(), times)}


_programs: OrderedDict[tuple[NlpStructure, tuple[Any, ...], bool], Transcription] = OrderedDict()
_stages: OrderedDict[tuple[Any, ...], Any] = OrderedDict()
_answers: OrderedDict[tuple[Any, ...], NlpSolution] = OrderedDict()
S = TypeVar("S", bound=ElementModel)


def shared(stage: S) -> S:
    """The stage with the same key that was used last, so that its Functions are built once."""
    return cast(S, _recent(_stages, stage.key, lambda: stage, KEPT_STAGES))


def forget_answers() -> None:
    """Solve again what has been solved already: for measuring how long it takes."""
    _answers.clear()


def _recent(store: OrderedDict[Any, Any], key: Any, make: Callable[[], Any], most: int) -> Any:
    """What the store holds for a key, made where it holds nothing; the store keeps what was used most recently."""
    if key not in store:
        store[key] = make()
        while len(store) > most:
            store.popitem(last=False)
    store.move_to_end(key)
    return store[key]


def _where(values: ca.MX, chosen: Any) -> ca.MX:
    """The chosen entries of a matrix (m, n), element after element; chosen (n, m)."""
    return ca.vec(values)[np.flatnonzero(chosen).tolist()]


def _column(argument: ca.MX, k: int) -> ca.MX:
    return argument if argument.size2() == 1 else argument[:, k]

"""The Newton system: a positive definite band with a border.

    [ K   P ] [ dc ]     [ −r_c ]        P = [B  A_cᵀ],   Q = [ C    A_Tᵀ ]
    [ Pᵀ  Q ] [ dT ]  =  [ −r_T ]                             [ A_T   0   ]
              [ dν ]     [ −e   ]

K (rows · m) is block-banded, for an element couples four rows of unknowns; the border holds the b times and the q equality
constraints; springs of the equalities (`problem.STIFF`) stand in K. The whole has the inertia of a minimum where K is
positive definite and the Schur complement S = Q − Pᵀ K⁻¹ P has b positive and q negative eigenvalues. Where it has not,
δ I is added to K and C, δ growing as in Ipopt.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ssm_planner.interior.problem import Evaluator, Quadratic
from ssm_planner.interior.spline import LOCAL
from ssm_planner.typing import Array

FIRST, LEAST, MOST = 1e-4, 1e-20, 1e20
"""δ: where none was needed before, and its bounds."""
UP_FIRST, UP, DOWN = 100.0, 8.0, 3.0
"""Factors by which it grows, and falls from one iteration to the next."""
POSITIVE = 1e-12
"""An eigenvalue of S below this is none."""


@dataclass(frozen=True, eq=False)
class Factors:
    """Of the system at one point."""

    band: Array
    border: Array
    solved_border: Array
    """K⁻¹ P."""
    schur: Array

    def solve(self, right: Array) -> Array:
        """[dc, dT, dν] of the right-hand side; not numbers where the system is singular."""
        size = len(self.border)
        inner = _solved(self.band, right[:size])
        rest = right[size:] - self.border.T @ inner
        try:
            outer = rest / self.schur[0] if len(rest) == 1 else np.linalg.solve(self.schur, rest)
        except np.linalg.LinAlgError:
            outer = np.full(len(rest), np.nan)
        return np.concatenate([inner - self.solved_border @ outer, outer])


class System:
    """Assembles and factorises the systems of one program."""

    def __init__(self, evaluator: Evaluator) -> None:
        spline, free = evaluator.program.spline, evaluator.program.free
        self._width, self.size = LOCAL * spline.coordinates, free.size
        flat = (evaluator.local[:, :, None] * spline.coordinates + np.arange(spline.coordinates)).reshape(
            -1, self._width
        )
        row, column = np.tril_indices(self._width)
        self._lower = row * self._width + column
        # column by column, the diagonal first: LAPACK's lower band
        self._places = (flat[:, column] * self._width + (row - column)).ravel()
        self.free = free.ravel()
        self._last = 0.0

    def factorise(self, quadratic: Quadratic, equalities: Array) -> Factors | None:
        """Factors of the system, made convex where it is not; None where nothing helps."""
        blocks = len(quadratic.corner)
        entries = quadratic.local.reshape(-1, self._width**2)[:, self._lower].ravel()
        band = np.asarray(np.bincount(self._places, entries, self.size * self._width), dtype=float)
        band = band.reshape(self.size, self._width)
        border = np.hstack([quadratic.border, equalities[:, : self.size].T]) * self.free[:, None]
        q = len(equalities)
        corner: Array = np.zeros((blocks + q, blocks + q))
        corner[blocks:, :blocks] = equalities[:, self.size :]
        corner[:blocks, blocks:] = equalities[:, self.size :].T
        delta = 0.0
        while delta < MOST:
            band_now: Array = band.copy()
            band_now[:, 0] = np.where(self.free, band[:, 0] + delta + POSITIVE, 1.0)
            factor, failed = _lapack().dpbtrf(band_now.T, lower=1, overwrite_ab=1)
            if not (failed or np.isnan(factor[0]).any()):
                corner[:blocks, :blocks] = quadratic.corner + delta * np.eye(blocks)
                solved = _solved(factor, border)
                schur = corner - border.T @ solved
                if not np.isfinite(schur).all():
                    return None
                eigenvalues = schur[0] if len(schur) == 1 else np.linalg.eigvalsh((schur + schur.T) / 2)
                if np.all(eigenvalues[q:] > POSITIVE) and np.all(eigenvalues[:q] < 0):
                    self._last = delta or self._last
                    return Factors(factor, border, solved, schur)
            if delta == 0.0:
                delta = max(self._last / DOWN, LEAST) if self._last else FIRST
            else:
                delta *= UP if self._last else UP_FIRST
        return None


@cache
def _lapack() -> Any:
    """Loaded where it is needed: Ipopt's plans need none of it."""
    from scipy.linalg import lapack

    return lapack


def _solved(factor: Array, right: Array) -> Array:
    """K⁻¹ of one right-hand side or of several."""
    found, _ = _lapack().dpbtrs(factor, right, lower=1)
    return np.asarray(found)

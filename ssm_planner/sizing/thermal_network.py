"""Two heat capacities in a row, solved exactly in their two modes for a power that is piecewise straight in time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ssm_planner.typing import Array

SMALL = 1e-4
"""Below it the functions of `_phi` are taken from their series."""


@dataclass(frozen=True, eq=False)
class Modes:
    """x' = A x + b P of (winding, housing) above ambient, as two independent modes z' = rate·z + input·P.

    rates (2,) in 1/s, negative where the mode settles; input (2,); shape (2, 2): x = shape @ z.
    """

    rates: Array
    input: Array
    shape: Array
    inverse: Array

    @classmethod
    def of(cls, r_inner: float, r_outer: float, c_inner: float, c_outer: float, gain: float = 0.0) -> Modes:
        """Thermal resistances (K/W) and capacities (J/K); gain: power that each kelvin of the inner body adds, W/K."""
        exchange = 1.0 / (r_inner * math.sqrt(c_inner * c_outer))
        symmetric = np.array(
            [
                [(gain - 1.0 / r_inner) / c_inner, exchange],
                [exchange, -(1.0 / r_inner + 1.0 / r_outer) / c_outer],
            ]
        )
        rates, vectors = np.linalg.eigh(symmetric)
        root = np.sqrt([c_inner, c_outer])
        inverse = vectors.T * root
        return cls(rates, inverse[:, 0] / c_inner, vectors / root[:, None], inverse)

    @property
    def growing(self) -> bool:
        """A mode does not settle: the losses grow faster than the heat leaves."""
        return bool(self.rates.max() >= 0.0)

    def decay(self, t: Array | float) -> Array:
        """What is left of the modes after t (n,), (2, n)."""
        return np.exp(self.rates[:, None] * np.atleast_1d(t))

    def temperatures(self, states: Array) -> Array:
        """(inner, outer) above ambient for modes (2, n), K."""
        return np.asarray(self.shape @ states)

    def states(self, rise: Array) -> Array:
        """Modes (2,) of temperatures (2,) above ambient, K."""
        return np.asarray(self.inverse @ rise)


def follow(modes: Modes, t: Array, power: Array) -> Array:
    """Modes (2, n) at t (n,) from zero under a power (n,) in W that is straight between the instants; exact."""
    step = np.diff(t)
    x = modes.rates[:, None] * step
    first, second = _phi(x)
    gained = modes.input[:, None] * step * (first * power[:-1] + second * np.diff(power))
    states = np.zeros((2, len(t)))
    states[:, 1:] = _running(np.exp(x), gained)
    return states


def _running(factor: Array, gained: Array) -> Array:
    """z_k = factor_k·z_(k−1) + gained_k for all k, z_0 = 0, by doubling: log2(n) steps on whole arrays."""
    factor, result = factor.copy(), gained.copy()
    reach = 1
    while reach < result.shape[1]:
        result[:, reach:] = result[:, reach:] + factor[:, reach:] * result[:, :-reach]
        factor[:, reach:] = factor[:, reach:] * factor[:, :-reach]
        reach *= 2
    return result


def _phi(x: Array) -> tuple[Array, Array]:
    """(eˣ − 1)/x and (eˣ − 1 − x)/x²."""
    near = np.abs(x) < SMALL
    safe = np.where(near, 1.0, x)
    first = np.where(near, 1.0 + x / 2 + x * x / 6, np.expm1(safe) / safe)
    second = np.where(near, 0.5 + x / 6 + x * x / 24, (np.expm1(safe) - safe) / safe**2)
    return first, second

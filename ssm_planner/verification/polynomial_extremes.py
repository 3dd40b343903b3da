"""Extremes of the quantities that are polynomials in time: position, velocity, acceleration, jerk, motor speed."""

from __future__ import annotations

from collections.abc import Sequence

from ssm_planner.verification.bernstein import largest
from ssm_planner.verification.limits import Worst
from ssm_planner.verification.pieces import Pieces

EXACT = 1e-10
"""Share of a limit to which an extreme is exact."""


def find_extremes(pieces: Pieces, worst: Sequence[Worst]) -> None:
    """Bring the worst values of polynomial quantities up to date with these pieces."""
    for each in worst:
        quantity = each.quantity
        if quantity.order is None:
            continue
        bounds = [quantity.scale * bound[quantity.order, quantity.index] for bound in pieces.bounds]
        for sign, limit in ((1.0, quantity.limit.high), (-1.0, -quantity.limit.low)):
            known = limit + each.excess * quantity.limit.half_width
            if max(sign * bound for bound in bounds) <= known:
                continue
            coefficients = pieces.bernstein[quantity.order][:, quantity.index] * (sign * quantity.scale)
            value, piece, s = largest(coefficients, EXACT * quantity.limit.half_width, known)
            time = float(pieces.start[piece] + s * pieces.length[piece])
            each.offer((value - limit) / quantity.limit.half_width, sign * value, time)

"""Evaluate closed forms for many mechanisms at once, for design studies.

A family is a set of mechanisms that differ in the angle α, the home tilt and the home roll. The
module `mechanism` explains the symbols, and `Mechanism` is the class of a single mechanism.
"""

from functools import cached_property
from typing import cast

import numpy as np

from ssm_planner.codegen import NUMPY
from ssm_planner.kinematics.mechanism import Mechanism, azimuths
from ssm_planner.kinematics.task import joints_of_task
from ssm_planner.typing import Array, record


@record
class MechanismFamily:
    """Set of n mechanisms with ω1 = x, ω2 = (cos α, sin α, 0) and ω3 = Rx(ψ_h) Ry(φ_h) x.

    Parameters
    ----------
    alpha : (n,)
        Angle α between the axes of joints 1 and 2, rad.
    home_tilt, home_roll : (n,)
        Tilt φ_h and roll ψ_h of the tool at q = 0, rad.
    insertion_sign : int
        Sign in depth = insertion_sign · θ4.
    """

    alpha: Array
    home_tilt: Array
    home_roll: Array
    insertion_sign: int = -1

    def subset(self, mask: Array) -> "MechanismFamily":
        """Return the family of the mechanisms for which a mask is true.

        Parameters
        ----------
        mask : (n,) mask
            True for each mechanism of the subset.

        Returns
        -------
        MechanismFamily
            The selected mechanisms in their order.
        """
        return MechanismFamily(
            self.alpha[mask], self.home_tilt[mask], self.home_roll[mask], self.insertion_sign
        )

    @cached_property
    def omega1(self) -> Array:
        """Unit vectors of the axis of joint 1, (n, 3)."""
        return np.tile([1.0, 0.0, 0.0], (len(self.alpha), 1))

    @cached_property
    def omega2(self) -> Array:
        """Unit vectors of the axis of joint 2, (n, 3)."""
        return np.column_stack((np.cos(self.alpha), np.sin(self.alpha), np.zeros_like(self.alpha)))

    @cached_property
    def omega3(self) -> Array:
        """Unit vectors of the axis of joint 3, (n, 3)."""
        sine = np.sin(self.home_tilt)
        return np.column_stack(
            (np.cos(self.home_tilt), np.sin(self.home_roll) * sine, -np.cos(self.home_roll) * sine)
        )

    @cached_property
    def beta(self) -> Array:
        """Angles β (n,) between the axes of joints 2 and 3, rad.

        They follow from cos β = cos α cos φ_h + sin α sin φ_h sin ψ_h.
        """
        return np.arccos(np.clip(np.sum(self.omega2 * self.omega3, axis=1), -1.0, 1.0))

    @cached_property
    def side(self) -> Array:
        """Sign of the home tilt, (n,)."""
        return np.where(self.home_tilt < 0, -1.0, 1.0)

    @cached_property
    def delta(self) -> Array:
        """Positions δ (n,) of joint 2 at which the tool axis is nearest to the first axis, rad."""
        component = np.sin(self.alpha) * self.omega3[:, 0] - np.cos(self.alpha) * self.omega3[:, 1]
        return np.arctan2(self.omega3[:, 2], component)

    @cached_property
    def tilt_magnitudes(self) -> tuple[Array, Array]:
        """Smallest and largest magnitude of the tilt (rad), each (n,) (paper, eq. 9).

        They are |α − β|, and α + β or, for a sum above π, 2π − (α + β).
        """
        total = self.alpha + self.beta
        return np.abs(self.alpha - self.beta), np.minimum(total, 2.0 * np.pi - total)

    def boundary_distance(self, tilts: Array) -> Array:
        """Compute the smallest distance of given tilts from the ends of every tilt range.

        Parameters
        ----------
        tilts : (k,) array
            Signed tilts (rad) that a mechanism must reach.

        Returns
        -------
        (n,) array
            Smallest distance (rad) for each mechanism. It is negative for a mechanism that cannot
            reach all tilts. It is −∞ if not all tilts have the sign of the home tilt and the
            mechanism cannot reach the tilt 0, through which it would have to pass.
        """
        low, high = self.tilt_magnitudes
        size = np.abs(tilts)
        margin = np.minimum(size.min() - low, high - size.max())
        sides = np.unique(np.sign(tilts))
        other_side = self.side != sides[0] if len(sides) == 1 else np.full(len(low), True)
        return np.where(other_side & (low > 0), -np.inf, margin)

    def joints(self, task: Array, branch: int) -> Array:
        """Compute the joint positions of every mechanism for the same task coordinates.

        See the equations of `joints_of_task`.

        Parameters
        ----------
        task : (k, 4) array
            Roll, tilt and spin (rad), and depth (m).
        branch : int
            +1 for the branch of the inverse kinematics on which q = 0 lies, −1 for the other
            branch.

        Returns
        -------
        (n, k, 4) array
            Joint positions (rad, and m for joint 4).
        """
        coordinates = np.asarray(task, dtype=float).T[:, None, :]  # four rows (1, k)
        home_branch = np.where(np.sin(self.delta) > 0.0, -1.0, 1.0)[:, None]
        mechanisms = cast(Mechanism, _BroadcastFamily(self))
        theta = joints_of_task(NUMPY, mechanisms, coordinates, branch * home_branch)
        return np.stack(np.broadcast_arrays(*theta), axis=-1)


class _BroadcastFamily:
    """View of a family with the attributes of a `Mechanism` that `joints_of_task` reads.

    The attributes have the shape (n, 1), so that they broadcast over k points. `spin_offset` is η
    at q = 0, which makes the spin σ = θ3 − η + spin_offset zero there.
    """

    def __init__(self, family: MechanismFamily) -> None:
        half = -family.delta / 2.0
        _, eta = azimuths(NUMPY, family.alpha, family.beta, np.cos(half), np.sin(half))
        self.alpha = family.alpha[:, None]
        self.beta = family.beta[:, None]
        self.delta = family.delta[:, None]
        self.side = family.side[:, None]
        self.spin_offset = eta[:, None]
        self.insertion_sign = family.insertion_sign

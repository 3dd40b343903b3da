"""Compute mass, centre of mass and inertia of arcs, rods, boxes and points in closed form.

Each solid contributes the integrals of 1, r and r·rᵀ over its volume, multiplied by its density,
where r is the position. They are the mass, the first moment and the second moment S. The moments of
several solids are added. The inertia tensor about the origin is tr(S)·1 − S, with the trace tr(S)
and the identity matrix 1.
"""

import math

import numpy as np

from ssm_planner.typing import Array, record


@record
class MassMoments:
    """Mass, first moment and second moment of solids, with respect to the origin.

    Attributes
    ----------
    mass : float
        Mass, kg.
    first : (3,) array
        First moment ∫r dm with the position r, kg·m.
    second : (3, 3) array
        Second moment ∫r·rᵀ dm, kg·m².
    """

    mass: float
    first: Array
    second: Array

    def __add__(self, moments: "MassMoments") -> "MassMoments":
        """Compute the moments of both groups of solids together.

        Parameters
        ----------
        moments : MassMoments
            Moments of the other group.

        Returns
        -------
        MassMoments
            The sums.
        """
        return MassMoments(
            self.mass + moments.mass, self.first + moments.first, self.second + moments.second
        )

    def rotated(self, rotation: Array) -> "MassMoments":
        """Compute the moments of the solid after a rotation about the origin.

        Parameters
        ----------
        rotation : (3, 3) array
            Rotation matrix.

        Returns
        -------
        MassMoments
            Moments of the rotated solid.
        """
        return MassMoments(self.mass, rotation @ self.first, rotation @ self.second @ rotation.T)

    @property
    def com(self) -> Array:
        """Centre of mass (3,), m."""
        return self.first / self.mass if self.mass > 0 else np.zeros(3)

    @property
    def inertia(self) -> Array:
        """Inertia tensor (3, 3) about the origin, kg·m², with the products −∫xy dm."""
        return np.trace(self.second) * np.eye(3) - self.second


def point_moments(mass: float, position: Array) -> MassMoments:
    """Compute the moments of a point mass.

    Parameters
    ----------
    mass : float
        Mass, kg.
    position : (3,) array
        Position of the point, m.

    Returns
    -------
    MassMoments
        Moments about the origin.
    """
    return MassMoments(mass, mass * position, mass * np.outer(position, position))


def box_moments(mass: float, position: Array, size: Array) -> MassMoments:
    """Compute the moments of a box about the origin.

    Parameters
    ----------
    mass : float
        Mass, kg.
    position : (3,) array
        Centre of the box, m.
    size : (3,) array
        Lengths of the edges, which are parallel to the axes, m.

    Returns
    -------
    MassMoments
        Moments of the box.
    """
    # The second moment of an edge of length a about its middle is mass a² / 12.
    moments = point_moments(mass, position)
    return MassMoments(mass, moments.first, moments.second + mass / 12 * np.diag(np.square(size)))


def rod_moments(start: Array, end: Array, diameter: float, density: float) -> MassMoments:
    """Compute the moments of a straight round rod about the origin.

    Parameters
    ----------
    start, end : (3,) arrays
        Ends of the centre line, m.
    diameter : float
        Diameter, m.
    density : float
        Density, kg/m³.

    Returns
    -------
    MassMoments
        Moments of the rod.
    """
    vector = end - start
    length = float(np.linalg.norm(vector))
    mass = density * math.pi / 4 * diameter**2 * length
    direction = np.outer(vector, vector) / length**2
    # About its middle, the second moment is mass length²/12 along the rod and mass diameter²/16 in
    # both directions across it.
    central_moment = mass * (
        length**2 / 12 * direction + diameter**2 / 16 * (np.eye(3) - direction)
    )
    moments = point_moments(mass, (start + end) / 2)
    return MassMoments(mass, moments.first, moments.second + central_moment)


def arc_moments(
    start: Array, end: Array, radius: float, section: tuple[float, float], density: float
) -> MassMoments:
    """Compute the moments of a bar with a rectangular section that is curved around the origin.

    The moments are integrated exactly in a frame with its x axis towards `start` and its z axis
    across the plane of the arc.

    Parameters
    ----------
    start, end : (3,) arrays
        Unit vectors towards both ends, less than 180° apart.
    radius : float
        Radius of the centre line, m.
    section : (float, float)
        Width in the plane of the arc and height across this plane, m.
    density : float
        Density, kg/m³.

    Returns
    -------
    MassMoments
        Moments of the bar about the origin.
    """
    across = np.cross(start, end)
    width, height = section
    angle = math.atan2(float(np.linalg.norm(across)), float(start @ end))
    normal = across / np.linalg.norm(across)
    frame = np.column_stack([start, np.cross(normal, start), normal])
    inner = radius - width / 2
    outer = radius + width / 2
    # The integral of r^(k − 1) over the width is (outer^k − inner^k)/k.
    moment_0, moment_1, moment_2 = [density * height * (outer**k - inner**k) / k for k in (2, 3, 4)]
    sine = math.sin(angle)
    cosine = math.cos(angle)
    mass = moment_0 * angle
    # Integrals of cos², cos sin and sin² over the angle of the arc.
    plane = moment_2 * np.array(
        [
            [(angle + sine * cosine) / 2, sine**2 / 2, 0],
            [sine**2 / 2, (angle - sine * cosine) / 2, 0],
            [0, 0, 0],
        ]
    )
    plane[2, 2] = mass * height**2 / 12
    return MassMoments(mass, moment_1 * np.array([sine, 1 - cosine, 0.0]), plane).rotated(frame)

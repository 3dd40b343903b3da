"""Mass, centre and inertia of simple solids, in closed form: arcs about the origin, rods, boxes, points.

Each is the integral over the solid of 1, r and r·rᵀ times its density; these add up, and inertia = tr(S)·1 − S.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ssm_planner.typing import Array


@dataclass(frozen=True, eq=False)
class Moments:
    """mass, kg; first moment ∫r dm (3,), kg·m; second moment ∫r·rᵀ dm (3, 3), kg·m²; about the origin."""

    mass: float
    first: Array
    second: Array

    def __add__(self, other: Moments) -> Moments:
        return Moments(self.mass + other.mass, self.first + other.first, self.second + other.second)

    def turned(self, rotation: Array) -> Moments:
        """In a frame that `rotation` (3, 3) takes the vectors of this one to."""
        return Moments(self.mass, rotation @ self.first, rotation @ self.second @ rotation.T)

    @property
    def com(self) -> Array:
        """Centre of mass (3,), m."""
        return self.first / self.mass if self.mass > 0 else np.zeros(3)

    @property
    def inertia(self) -> Array:
        """Tensor about the origin (3, 3), kg·m², products −∫xy dm."""
        return np.asarray(np.trace(self.second) * np.eye(3) - self.second)


def point(mass: float, at: Array) -> Moments:
    """A point mass (kg) at a place (3,), m."""
    return Moments(mass, mass * at, mass * np.outer(at, at))


def box(mass: float, at: Array, size: Array) -> Moments:
    """A box of size (3,) along the axes with its centre at a place (3,), m; kg."""
    moments = point(mass, at)
    return Moments(mass, moments.first, moments.second + mass / 12 * np.diag(np.square(size)))


def rod(start: Array, end: Array, diameter: float, density: float) -> Moments:
    """A round rod from start to end (3,), m; kg/m³."""
    way = end - start
    length = float(np.linalg.norm(way))
    mass = density * math.pi / 4 * diameter**2 * length
    along = np.outer(way, way) / length**2
    spread = mass * (length**2 / 12 * along + diameter**2 / 16 * (np.eye(3) - along))
    moments = point(mass, (start + end) / 2)
    return Moments(mass, moments.first, moments.second + spread)


def arc(
    start: Array, end: Array, radius: float, section: tuple[float, float], density: float
) -> Moments:
    """A curved bar about the origin from the direction `start` to `end` (unit vectors (3,), less than 180° apart).

    radius: of its middle line, m; section: in the plane of the arc and across it, m; kg/m³.
    """
    across, (width, height) = np.cross(start, end), section
    angle = math.atan2(float(np.linalg.norm(across)), float(start @ end))
    normal = across / np.linalg.norm(across)
    frame = np.column_stack([start, np.cross(normal, start), normal])
    inner, outer = radius - width / 2, radius + width / 2
    # ∫ r^(k+1) dr over the section, times its height
    zeroth, first, second = (density * height * (outer**k - inner**k) / k for k in (2, 3, 4))
    sine, cosine = math.sin(angle), math.cos(angle)
    mass = zeroth * angle
    plane = second * np.array(
        [
            [(angle + sine * cosine) / 2, sine**2 / 2, 0],
            [sine**2 / 2, (angle - sine * cosine) / 2, 0],
            [0, 0, 0],
        ]
    )
    plane[2, 2] = mass * height**2 / 12
    return Moments(mass, first * np.array([sine, 1 - cosine, 0.0]), plane).turned(frame)

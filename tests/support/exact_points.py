"""Reference values of a plan.json at single instants in decimal arithmetic with 40 digits.

The module shares no code and no formulation with `examples/prove.py`. All vectors are in the base
frame. The torque law uses tangents of sums, and angles follow from an arctangent.
"""

from __future__ import annotations

import math
from decimal import Decimal, getcontext
from functools import cache
from typing import Any

getcontext().prec = 40
D = Decimal
Vector = list[D]


def sine_and_cosine(x: D) -> tuple[D, D]:
    """Return sine and cosine of x by the series of x/2^10 and ten doublings of the angle."""
    z = x / 1024
    sine, cosine, term = D(0), D(0), D(1)
    for k in range(30):
        if k % 2:
            sine += term if k % 4 == 1 else -term
        else:
            cosine += term if k % 4 == 0 else -term
        term = term * z / (k + 1)
    for _ in range(10):
        sine, cosine = 2 * sine * cosine, cosine * cosine - sine * sine
    return sine, cosine


@cache
def arctangent(x: D) -> D:
    """Return the arctangent of x by Newton's method on sine and cosine."""
    y = D(math.atan(float(x)))
    for _ in range(4):
        sine, cosine = sine_and_cosine(y)
        y -= (sine - x * cosine) * cosine
    return y


def angle_of(s: D, c: D) -> D:
    """Return the angle of the point (c, s) in (−π, π]."""
    if c == 0 and s == 0:
        return D(0)
    half_turn = 4 * arctangent(D(1))
    if c > 0:
        return arctangent(s / c)
    if abs(s) >= abs(c):
        return (half_turn / 2 if s > 0 else -half_turn / 2) - arctangent(c / s)
    return arctangent(s / c) + (half_turn if s >= 0 else -half_turn)


def vector(values: Any) -> Vector:
    return [D(float(x)) for x in values]


def add(*vectors: Vector) -> Vector:
    return [sum(x, D(0)) for x in zip(*vectors, strict=True)]


def times(k: D, x: Vector) -> Vector:
    return [k * y for y in x]


def dot(a: Vector, b: Vector) -> D:
    return sum((x * y for x, y in zip(a, b, strict=True)), D(0))


def cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def normal(x: Vector) -> Vector:
    return times(1 / dot(x, x).sqrt(), x)


def turned(axis: Vector, angle: D, x: Vector) -> Vector:
    """Return x turned about the axis a by the angle: x cos + (1 − cos) a (a·x) + sin a×x."""
    sine, cosine = sine_and_cosine(angle)
    return add(
        times(cosine, x), times((1 - cosine) * dot(axis, x), axis), times(sine, cross(axis, x))
    )


def product(matrix: list[Vector], x: Vector) -> Vector:
    return [dot(row, x) for row in matrix]


class Instant:
    """The motion at local time x (decimal) in one piece of a plan."""

    def __init__(self, plan: dict[str, Any], piece: int, x: D) -> None:
        self.problem = plan["problem"]
        self.robot = self.problem["robot"]
        coefficients = plan["trajectory"]["coefficients"][piece]
        self.derivatives = []
        for order in range(4):
            values = []
            for j in range(4):
                value = D(0)
                for k in range(order, 6):
                    factor = 1
                    for i in range(order):
                        factor *= k - i
                    value += D(float(coefficients[k][j])) * factor * x ** (k - order)
                values.append(value)
            self.derivatives.append(values)
        self.q, self.v, self.a, self.jerk = self.derivatives
        geometry = self.robot["geometry"]
        self.home = [normal(vector(geometry[f"omega{k}"])) for k in (1, 2, 3)]
        self.axes = [
            self.home[0],
            self.carried(self.home[1], 1),
            self.carried(self.home[2], 2),
        ]

    def carried(self, x: Vector, joints: int) -> Vector:
        """Return x turned by the first `joints` joints. The last of these joints turns first."""
        for k in reversed(range(joints)):
            x = turned(self.home[k], self.q[k], x)
        return x

    def back(self, x: Vector, joints: int) -> Vector:
        for k in range(joints):
            x = turned(self.home[k], -self.q[k], x)
        return x

    def efforts(self) -> Vector:
        """Return the efforts of the joints by D'Alembert's principle in the base frame.

        τ_j is the component along axis j of the moment of all bodies that joint j carries.
        """
        gravity = vector(self.robot["gravity"])
        omega, alpha, moments, force = [D(0)] * 3, [D(0)] * 3, [], [D(0)] * 3
        for k, body in enumerate(self.robot["bodies"]):
            count = min(k + 1, 3)
            if k < 3:
                alpha = add(
                    alpha,
                    times(self.a[k], self.axes[k]),
                    times(self.v[k], cross(omega, self.axes[k])),
                )
                omega = add(omega, times(self.v[k], self.axes[k]))
            frame = [vector(row) for row in body["frame"]]
            com, mass = vector(body["com"]), D(float(body["mass"]))
            place = self.carried(product(frame, com), count)
            slide = [D(0)] * 3
            if k == 3:
                place = add(place, times(self.q[3], self.axes[2]))
                slide = add(
                    times(self.a[3], self.axes[2]), times(2 * self.v[3], cross(omega, self.axes[2]))
                )
            inertia = [vector(row) for row in body["inertia"]]
            transposed = [list(column) for column in zip(*frame, strict=True)]

            def of(x: Vector, count: int = count) -> Vector:
                y = product(transposed, self.back(x, count))  # noqa: B023
                about = times(dot(com, com), y)  # noqa: B023
                y = add(product(inertia, y), times(-mass, add(about, times(-dot(com, y), com))))  # noqa: B023
                return self.carried(product(frame, y), count)  # noqa: B023

            pull = add(
                times(D(-1), gravity), slide, cross(alpha, place), cross(omega, cross(omega, place))
            )
            force = times(mass, pull)
            moments.append(add(of(alpha), cross(omega, of(omega)), cross(place, force)))
        result = [dot(self.axes[j], add(*moments[j:])) for j in range(3)]
        return [*result, dot(self.axes[2], force)]

    def motor_torque(self, j: int, load: D, sign: int, mu: D) -> D:
        """Return the torque of the exact law, with the tangent of λ ± φ from sine and cosine."""
        drive = self.robot["joints"][j]["drive"]
        law = drive["friction"]
        number = {
            k: D(float(v)) for k, v in {**law, **drive}.items() if isinstance(v, (int, float))
        }
        effort = (
            load
            + number["output_inertia"] * self.a[j]
            + sign * number["b_oc"]
            + number["b_ov"] * self.v[j]
        )
        w, wd = number["ratio"] * self.v[j], number["ratio"] * self.a[j]
        phi = arctangent(mu / sine_and_cosine(number["pressure_angle"])[1])

        def tangent(angle: D) -> D:
            sine, cosine = sine_and_cosine(angle)
            return sine / cosine

        base = number["input_inertia"] * wd + sign * number["b_c"] + number["b_v"] * w
        if drive["kind"] == "antibacklash_screw":
            preload, mass = number["preload"], number["second_nut_mass"]
            first = tangent(number["lead_angle"] - sign * phi) * (effort - preload)
            second = tangent(number["lead_angle"] + sign * phi) * (preload + mass * self.a[j])
            return number["gamma"] * (first + second) + base
        opposing = effort * sign > 0
        slope = tangent(number["lead_angle"] + (phi if opposing else -phi))
        return number["gamma"] * slope * effort + base

    @property
    def tool(self) -> Vector:
        return self.axes[2]

    def task(self) -> tuple[D, D]:
        """Return roll and tilt of the tool."""
        first, second, _ = self.home
        t = normal(add(second, times(-dot(first, second), first)))
        n = cross(first, t)
        side = -1 if dot(self.home[2], n) > 0 else 1
        c, s = -side * dot(self.tool, n), side * dot(self.tool, t)
        return angle_of(s, c), side * angle_of((c * c + s * s).sqrt(), dot(self.tool, first))

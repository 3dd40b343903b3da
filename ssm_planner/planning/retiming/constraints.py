"""Limits along a path q(s) as constraints on s̈ and ṡ² for TOPP-RA, with exact friction.

Along a path, every quantity that is linear in q̈, q̇² and |q̇| is a function of the acceleration s̈
and of the speed ṡ ≥ 0,

    a(s) s̈ + b(s) ṡ² + c(s) + k(s) ṡ,   (1)

because q̇ = q' ṡ and q̈ = q' s̈ + q'' ṡ², with primes for derivatives with respect to s. In the
code, a *term* is one such function, stored as an array (4, n) of its coefficients a, b, c, k at n
values of s. A *row* is the constraint that a term, divided by its limit, is at most 1.
`LinearConstraints` holds all rows of a path. With x = ṡ², (1) is linear in (s̈, x) except for k √x.
TOPP-RA needs linear rows, so it uses the tangent of √x. The tangent is at least √x, because √x is
concave. A motion that satisfies the linear rows therefore satisfies the limits.

Sources: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on
Reachability Analysis, IEEE T-RO 34(3), 2018, §II (rows linear in (s̈, ṡ²));
dynamics/transmission.py (the friction law).
"""

import numpy as np

from ssm_planner.dynamics import (
    RigidBody,
    breakaway_coefficient,
    friction_coefficient,
    motor_torque_rows,
    output_effort,
    required_friction,
)
from ssm_planner.elements.rows import joint_limits
from ssm_planner.kinematics import Mechanism, task_rates, tool_speed
from ssm_planner.planning.retiming.paths import JointPath, PathSamples, joint_starts
from ssm_planner.problem import TASK_COORDINATES, Drive, Robot, TaskLimits, TipSpeed
from ssm_planner.typing import Array, Indices, Mask, record

BINDING_SHARE = 0.998
"""Share of its limit at which a constraint counts as binding.

The constraints are evaluated between grid points. A motion that follows a limit at the grid points
may be slightly below it there.
"""


@record
class LinearConstraints:
    """Constraints a s̈ + b ṡ² + c + k ṡ ≤ 1 on the motion along a path, at n values of s.

    Each constraint (row) is divided by its limit, so the right side is 1. ṡ² must also stay below
    `ceiling`.
    """

    a: Array
    """Coefficients of the acceleration s̈, (n, rows)."""
    b: Array
    """Coefficients of the squared speed ṡ², (n, rows)."""
    c: Array
    """Constant terms, (n, rows)."""
    k: Array
    """Coefficients of the speed ṡ, (n, rows). They result from viscous friction."""
    ceiling: Array
    """Largest ṡ² that limits on speeds allow, (n,), 1/s²."""

    def tangent(self, speed_squared: Array) -> "LinearConstraints":
        """Return constraints without a term in ṡ (k = 0) that are at least as strict.

        TOPP-RA needs constraints that are linear in x = ṡ². The term k √x with k ≥ 0 is therefore
        replaced by its tangent at x₀, because √x ≤ √x₀/2 + x/(2 √x₀).

        Parameters
        ----------
        speed_squared : (n,) array
            Values x₀ > 0 of ṡ², at which the constraints do not change, 1/s².

        Returns
        -------
        LinearConstraints
            The constraints with k = 0.
        """
        root = np.sqrt(speed_squared)[:, None]
        b = self.b + self.k / (2 * root)
        c = self.c + self.k * (root / 2)
        return LinearConstraints(self.a, b, c, np.zeros_like(c), self.ceiling)

    def active(self, grid: Array, speed_squared: Array) -> Indices:
        """Find the constraint that limits a motion most on each grid interval.

        A constraint binds if it reaches the share `BINDING_SHARE` of its limit in the middle of the
        interval.

        Parameters
        ----------
        grid : (n,) array
            Values of s at which the constraints hold.
        speed_squared : (n,) array
            ṡ² of the motion at these values, 1/s².

        Returns
        -------
        (n − 1,) int array
            For each interval, the index of the row that is closest to its limit, or −1 if no
            constraint binds. The index after the last row stands for `ceiling`.
        """

        def middle(values: Array) -> Array:
            """Return the means (n − 1, …) of the values (n, …) at both ends of each interval."""
            return (values[1:] + values[:-1]) / 2

        # ṡ² is linear in s on an interval, and d(ṡ²)/ds = 2 s̈.
        acceleration = (np.diff(speed_squared) / (2 * np.diff(grid)))[:, None]
        x = middle(speed_squared)[:, None]
        values = middle(self.a) * acceleration + middle(self.b) * x + middle(self.c)
        values += middle(self.k) * np.sqrt(x)
        values = np.hstack([values, x / middle(self.ceiling)[:, None]])
        return np.where(values.max(axis=1) > BINDING_SHARE, values.argmax(axis=1), -1)


@record
class PathLimits:
    """Limits of a robot at n points of a path, with all quantities that do not depend on time.

    `constraints` makes rows for TOPP-RA of them.
    """

    robot: Robot
    """The robot with the limits of its joints and motors."""
    samples: PathSamples
    """q, q' and q'' at the points."""
    loads: tuple[tuple[Array, Array, Array], ...]
    """Coefficients A, B and C of the torques τ_rigid = A s̈ + B ṡ² + C that move the links.

    There is one tuple for each of `Robot.loads`, the variants of the links and the payload that the
    motion must allow for. Each array has the shape (n, 4), in N·m, and in N for joint 4.
    """
    directions: Array
    """Signs σ of q'(s), 0 for a joint that does not move, (n, 4)."""
    ceiling: Array
    """Largest ṡ² that the speed limits allow, (n,), 1/s²."""
    starts: Mask
    """True where a joint starts to move after a rest or a reversal, (n, 4)."""
    braking_slopes: Array | None
    """|J q'| / (2d) at the points, (n,), where d is the limit on the distance to stop, in m.

    J is the Jacobian of the tip, so |J q'| ṡ is the speed of the tip. None without such a limit.
    """

    @classmethod
    def on_grid(
        cls,
        path: JointPath,
        grid: Array,
        robot: Robot,
        limits: TaskLimits,
        *,
        moving: bool = False,
    ) -> "PathLimits":
        """Evaluate the limits of a robot and a task at the grid points of a path.

        Parameters
        ----------
        path : JointPath
            Joint path q(s) with the path parameter s from 0 to 1.
        grid : (n,) array
            Values of s.
        robot : Robot
            The robot with the limits of its joints and motors.
        limits : TaskLimits
            Limits on the tool and on rates of task coordinates.
        moving : bool
            True if ṡ is not 0 at s = 0.

        Returns
        -------
        PathLimits
            The limits at the n grid points.
        """
        knots, signs = path.directions
        # Index of the interval between two knots that contains each grid point.
        interval = np.clip(np.searchsorted(knots, grid, side="right") - 1, 0, len(knots) - 2)
        samples = path.sample(grid)
        bodies = map(RigidBody.from_robot, robot.loads)
        loads = tuple(body.path_load(samples.q, samples.dq, samples.ddq) for body in bodies)
        ceiling = _speed_ceiling(path, samples, robot, limits)
        stops = None
        if limits.stop_travel is not None:
            stops = tool_speed(TipSpeed, path.mechanism, samples.q, samples.dq) / (
                2 * limits.stop_travel.largest
            )
        return cls(
            robot,
            samples,
            loads,
            directions=signs[interval],
            ceiling=ceiling,
            starts=joint_starts(samples, knots, signs, moving=moving),
            braking_slopes=stops,
        )

    def constraints(self, speed_squared: Array) -> LinearConstraints:
        """Return the constraints of accelerations, of the distance to stop, and of motor torques.

        Each constraint, called a row, is divided by its limit. For joint i, the rows of
        acceleration are ±(q'_i s̈ + q''_i ṡ²) ≤ q̈_i,max. The row of the distance to stop is
        inequality (2) in `braking_travel`. The rows of torque bound the motor's torque in the
        direction of motion from above, and from below where the motor brakes (`_torque_terms`).

        Parameters
        ----------
        speed_squared : (n,) array
            ṡ² of the previous pass of TOPP-RA, 1/s². Friction coefficients that depend on speed are
            evaluated there.

        Returns
        -------
        LinearConstraints
            All rows at the n points.
        """
        rows: list[Array] = []
        derivatives = self.samples.dq, self.samples.ddq
        for i, joint in enumerate(self.robot.joints):
            dq, ddq = (derivative[:, i] / joint.acceleration for derivative in derivatives)
            acceleration = self._linear_term(a=dq, b=ddq)
            rows += [acceleration, -acceleration]
            if self.braking_slopes is not None:
                braking = self._linear_term(b=self.braking_slopes * np.abs(dq))
                rows.append(braking - np.sign(dq) * acceleration)
        for i, joint in enumerate(self.robot.joints):
            limit = np.inf if joint.motor is None else joint.motor.max_torque
            for load, drive, sides in self.robot.actuations(i):
                mu = self._friction_coefficient(drive, i, speed_squared)
                driving, braking = self._torque_terms(drive, i, mu, self.loads[load], speed_squared)
                # An actuation concerns driving (1), braking (−1) or both.
                rows += [term / limit for term in driving] if 1 in sides else []
                rows += [braking / limit] if -1 in sides else []
        a, b, c, k = np.stack(rows, axis=-1)
        return LinearConstraints(a, b, c, k, self.ceiling)

    def _friction_coefficient(self, drive: Drive, i: int, speed_squared: Array) -> Array:
        """Return the friction coefficient μ of the drive of joint i at the n points of the path.

        With Stribeck friction, μ depends on the speed of the motor. The speed is not known yet, so
        that of the previous pass of TOPP-RA is used. Where a joint starts to move, μ is that of
        static friction.

        Parameters
        ----------
        drive : Drive
            Drive of the joint with its friction parameters.
        i : int
            Index of the joint, from 0.
        speed_squared : (n,) array
            ṡ² of the motion of the previous pass, 1/s².

        Returns
        -------
        (n,) array
            Friction coefficients.
        """
        friction = required_friction(drive)
        # Speed of the motor, rad/s.
        w = drive.ratio * np.abs(self.samples.dq[:, i]) * np.sqrt(speed_squared)
        static, kinetic = breakaway_coefficient(friction, w), friction_coefficient(friction, w)
        return np.asarray(np.where(self.starts[:, i], static, kinetic))

    def _torque_terms(
        self,
        drive: Drive,
        i: int,
        mu: Array,
        load: tuple[Array, Array, Array],
        speed_squared: Array,
    ) -> tuple[list[Array], Array]:
        """Write the torque of a motor as terms, that is, as linear functions of s̈, ṡ² and ṡ.

        Let σ be the direction of motion, F = τ_rigid + J_out q̈ + b_oc σ + b_ov q̇ the effort that
        the drive must produce at its output, and w = r q̇ the motor velocity with the gear ratio r.
        The torque in the direction of motion is the larger of two linear functions
        (`transmission.TorqueRows`),

            σ τ = max_k [slope_k σF + σ (inertia ẇ + coulomb + viscous w)].

        Where the motor drives, σ τ ≤ limit holds if and only if both functions are at most the
        limit. Where it brakes, the condition is −σ τ ≤ limit. One function suffices for it, because
        each is a lower bound of σ τ. The function that is larger at the given ṡ² is taken.

        All rows must have k ≥ 0. Where the functions have k < 0, the rows of driving leave out
        their part k ṡ. Where the function of braking has k > 0, its part k ṡ is replaced by
        k ṡ² / √ceiling, which is not larger, because ṡ² ≤ ceiling. All rows become stricter.

        Parameters
        ----------
        drive : Drive
            Drive of the joint.
        i : int
            Index of the joint, from 0.
        mu : (n,) array
            Friction coefficients.
        load : tuple of three (n, 4) arrays
            A, B and C of τ_rigid = A s̈ + B ṡ² + C.
        speed_squared : (n,) array
            ṡ² of the previous pass of TOPP-RA, 1/s².

        Returns
        -------
        driving : list of (4, n) arrays
            Two terms, σ times the motor torque in N·m. Both must be at most the limit.
        braking : (4, n) array
            Term for −σ times the motor torque, N·m. It must be at most the limit.
        """
        sigma = self.directions[:, i]
        dq = self.samples.dq[:, i]
        qd = self._linear_term(k=sigma * np.abs(dq))
        qdd = self._linear_term(a=dq, b=self.samples.ddq[:, i])
        a, b, c = (matrix[:, i] for matrix in load)
        direction = self._linear_term(c=sigma)
        effort = sigma * output_effort(drive, self._linear_term(a, b, c), qd, qdd, direction)
        rows = motor_torque_rows(drive, sigma, mu)
        inertia, viscous = drive.ratio * rows.inertia, drive.ratio * rows.viscous
        motor_side = sigma * (inertia * qdd + self._linear_term(c=rows.coulomb) + viscous * qd)
        terms = [slope * effort + motor_side for slope in rows.slope]
        # Effort at the given ṡ² without its parts in s̈ and ṡ, which only selects a function.
        at_speed = effort[1] * speed_squared + effort[2]
        first, second = (slope * at_speed for slope in rows.slope)
        a, b, c, k = np.where(first > second, terms[0], terms[1])
        # A row is concave in ṡ² only if its k ≥ 0, and TOPP-RA needs concave rows.
        braking = -self._linear_term(
            a, b + np.maximum(k, 0.0) / np.sqrt(self.ceiling), c, np.minimum(k, 0.0)
        )
        driving = [self._linear_term(a, b, c, np.maximum(k, 0.0)) for a, b, c, k in terms]
        return driving, braking

    def _linear_term(
        self,
        a: Array | float = 0.0,
        b: Array | float = 0.0,
        c: Array | float = 0.0,
        k: Array | float = 0.0,
    ) -> Array:
        """Stack the coefficients of a term a s̈ + b ṡ² + c + k ṡ at the n points of the path.

        Parameters
        ----------
        a, b, c, k : (n,) array or float
            Coefficients at the points. A number applies to all points.

        Returns
        -------
        (4, n) array
            The coefficients a, b, c and k.
        """
        # `ceiling` takes part because its length n is that of the result.
        a, b, c, k, _ = np.broadcast_arrays(a, b, c, k, self.ceiling)
        return np.stack([a, b, c, k])


def braking_travel(mechanism: Mechanism, robot: Robot, q: Array, qd: Array) -> Array:
    """Return the distance that the tip covers while all joints brake to a stop, m.

    Every joint brakes with a constant deceleration, and all joints stop together. The joint that
    needs most time brakes with its largest acceleration q̈_i,max. With the Jacobian J of the tip,
    the tip stops after the distance |J q̇| · max_i(|q̇_i| / q̈_i,max) / 2.

    Parameters
    ----------
    mechanism : Mechanism
        Geometry of the robot.
    robot : Robot
        The robot with the largest accelerations of its joints.
    q, qd : (n, 4) arrays
        Joint positions (rad, and m for joint 4) and velocities (rad/s and m/s).

    Returns
    -------
    (n,) array
        Distance, m.

    Notes
    -----
    On a path q(s), the robot also uses a part of each acceleration for the motion itself. If the
    deceleration s̈ = −|J q'| ṡ² / (2d) is available at every point, then d(ṡ²)/ds = 2 s̈ brings ṡ
    to 0 before the tip has moved by d. A limit d on the distance to stop therefore holds if

        |J q'| |q'_i| ṡ² / (2d) − min(0, ± (q'_i s̈ + q''_i ṡ²)) ≤ q̈_i,max,   (2)

    with + if joint i moves forwards. The condition is sufficient, not necessary. The independent
    check covers motors that cannot brake as hard as their joints may.
    """
    limit = robot.accelerations
    return np.asarray(tool_speed(TipSpeed, mechanism, q, qd) * (np.abs(qd) / limit).max(axis=1) / 2)


def _speed_ceiling(
    path: JointPath, samples: PathSamples, robot: Robot, limits: TaskLimits
) -> Array:
    """Return the largest ṡ² that all limits on speeds allow at the points of a path.

    The speeds are |q'_i| ṡ of the joints, r |q'_i| ṡ of the motors (r: gear ratio), |J(q) q'| ṡ of
    the tool (J: Jacobian) and |dtask/ds| ṡ of the task coordinates. Each is proportional to ṡ, so
    each limit gives a bound of ṡ. The distance in which the tip stops is proportional to ṡ²
    (`braking_travel`), so a limit on it bounds ṡ too.

    Parameters
    ----------
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1.
    samples : PathSamples
        q, q' and q'' at n values of s.
    robot : Robot
        The robot with the limits of its joints and motors.
    limits : TaskLimits
        Limits on the tool and on rates of task coordinates.

    Returns
    -------
    (n,) array
        Largest ṡ², 1/s².
    """
    # Velocities that both the joints and their motors allow, (4,).
    limit = joint_limits(robot)["velocity"]
    # A speed that is 0 at a point does not limit ṡ there, and the quotient is infinite.
    with np.errstate(divide="ignore", over="ignore"):
        # Each entry is the largest ṡ that one limit allows, (n,).
        speeds = [*(limit / np.abs(samples.dq)).T]
        for bound in limits.speeds:
            slope = tool_speed(type(bound), path.mechanism, samples.q, samples.dq)
            speeds.append(bound.largest / slope)
        if limits.stop_travel is not None:
            travel = braking_travel(path.mechanism, robot, samples.q, samples.dq)
            speeds.append(np.sqrt(limits.stop_travel.largest / travel))
        if limits.rates:
            slopes = np.abs(task_rates(path.mechanism, samples.q, samples.dq))
            speeds += [
                rate / slopes[:, TASK_COORDINATES.index(name)]
                for name, rate in limits.rates.items()
            ]
    return np.asarray(np.min(speeds, axis=0) ** 2)

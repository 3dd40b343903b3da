"""Trajectories that exceed one limit within one interval of samples only.

The functions of the model itself compute the limited quantity.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.dynamics.motors import motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.kinematics.eye import lens_ratio
from ssm_planner.kinematics.forward import space_jacobian, tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints, task_rates
from ssm_planner.problem.limits import TASK_COORDINATES
from ssm_planner.problem.problem import Eye, Lens, TaskLimits
from ssm_planner.problem.robot import Robot, read_only_array
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.trajectory import Samples, Trajectory, quintic_coefficients
from tests.support.plans import of_task

EXCESS = 1e-3
BENT = {
    "position": 0, "tilt range": 0, "velocity": 1, "motor speed": 1, "tip speed": 1, "acceleration": 2, "jerk": 2,
    "motor torque": 2, "roll rate": 1, "tilt rate": 1, "spin rate": 1, "insertion speed": 1, "retina clearance": 0,
    "lens clearance": 0,
}  # fmt: skip
"""Derivative of q that is changed in the middle of the interval, for each limit."""
OVERALL = "continuous torque"
"""Limit of the motion as a whole, for which no interval is changed."""
KINDS = [*BENT, OVERALL]
WHICH = {
    "tilt range": (1,), "tip speed": (0, 1), "roll rate": (0,), "tilt rate": (1,), "spin rate": (2,),
    "insertion speed": (3,), "retina clearance": (1, 3), "lens clearance": (0, 1),
}  # fmt: skip
"""Candidate joints for the change, for limits of the task."""
TASK_RATES = {
    "roll rate": "roll",
    "tilt rate": "tilt",
    "spin rate": "spin",
    "insertion speed": "depth",
}
RANGES = ("position", "tilt range")
"""Limits whose excess is relative to the half width of a range instead of the limit."""
CENTRE = np.array([0.007, 0.0, -0.011])
PLACE = np.array([0.002, 0.003, -0.006])
SEMI_AXES = np.array([0.004, 0.003, 0.0015])
SCALE = np.array([1.0, 1.0, 1.0, 0.03])
LOOSE = 1e3
INTERVALS = 16
DENSE = 300


@dataclass(frozen=True, eq=False)
class Case:
    """A trajectory, the largest value of a limited quantity, and the interval that contains it."""

    trajectory: Trajectory
    robot: Robot
    limit: tuple[str, str | None]
    joint: int
    largest: float
    interval: tuple[float, float]

    def bounds(self, factor: float) -> tuple[float, float]:
        """Return (low, high) so that the largest value is `factor` times the limit.

        For a range, the excess is relative to its half width.
        """
        if self.limit[0] not in RANGES:
            return -self.largest / factor, self.largest / factor
        half = SCALE[max(self.joint, 0)]
        high = self.largest - (factor - 1) * half
        return high - 2 * half, high

    def robot_with(self, factor: float) -> Robot:
        """Return the robot with this limit set by `factor` and all other limits loose."""
        name, (low, high) = self.limit[0], self.bounds(factor)
        joints = []
        for i, joint in enumerate(self.robot.joints):
            quantity = name if i == self.joint else ""
            motor = joint.motor
            if motor is not None:
                motor = dataclasses.replace(
                    motor,
                    max_speed=high if quantity == "motor speed" else 1e6,
                    max_torque=high if quantity == "motor torque" else LOOSE,
                    nominal_torque=high if quantity in (OVERALL, "motor torque") else LOOSE,
                )
            joints.append(
                dataclasses.replace(
                    joint,
                    motor=motor,
                    position=(low, high) if quantity == "position" else (-LOOSE, LOOSE),
                    velocity=high if quantity == "velocity" else LOOSE,
                    acceleration=high if quantity == "acceleration" else 1e6,
                    jerk=high if quantity == "jerk" else 1e9,
                )
            )
        return dataclasses.replace(self.robot, joints=tuple(joints))

    def task(self, factor: float) -> TaskLimits:
        """Return the task limits with this limit set by `factor`."""
        kind, bounds = self.limit[0], self.bounds(factor)
        limits = of_task(
            ranges={"tilt": bounds} if kind == "tilt range" else {},
            tip_speed=bounds[1] if kind == "tip speed" else None,
            rates={TASK_RATES[kind]: bounds[1]} if kind in TASK_RATES else {},
            eye=_eye(kind, bounds[1]) if kind.endswith("clearance") else None,
        )
        # The motion is a section of a longer one. Its start and its end are in motion.
        return dataclasses.replace(limits, start_rate=None, end_rate=None)


def _eye(kind: str, high: float) -> Eye:
    """Return an eye whose limit is `high`.

    For the retina the tip may be `high` from the centre. For the lens a passing shaft touches it at
    1 / `high`.
    """
    # A tool could not enter this eye, but its limits are met in the middle of an interval.
    clearance = 1e-3
    any_eye = Eye(
        read_only_array(CENTRE, (3,)), float(np.linalg.norm(CENTRE)), clearance, port=2 * clearance
    )
    if kind == "retina clearance":
        return unchecked_copy(any_eye, radius=high + clearance, port=1e-9)
    lens = Lens(
        read_only_array(PLACE, (3,)),
        read_only_array(SEMI_AXES / high, (3,)),
        read_only_array(np.eye(3), (3, 3)),
    )
    return unchecked_copy(any_eye, radius=LOOSE, port=1e-9, lens=lens)


def seeded(rng: np.random.Generator, robot: Robot, kind: str) -> Case:
    """Return a random motion in which a quantity peaks in the middle of one interval.

    The state in the middle of the interval is changed until the peak is large enough.
    """
    if kind == OVERALL:
        return _overall(rng, robot)
    while True:
        case = _bent(rng, robot, kind)
        if case is not None:
            return case


def _overall(rng: np.random.Generator, robot: Robot) -> Case:
    """Return a random motion with the root mean square torque of one motor."""
    joint = int(rng.choice((0, 1, 3)))
    t, states = _samples(rng)
    trajectory = Trajectory(t, _quintics(t, _drifting(t, states)), ())
    count = INTERVALS * DENSE
    middles = (np.arange(count) + 0.5) / count * t[-1]
    torque = _motor(trajectory.sample(middles), robot, "motor torque", joint)
    rms = float(np.sqrt(np.mean(np.square(torque))))
    return Case(
        trajectory,
        robot,
        (OVERALL, robot.joints[joint].name),
        joint,
        rms,
        (float(t[-1]), float(t[-1])),
    )


def _drifting(t: np.ndarray, states: list[np.ndarray]) -> list[np.ndarray]:
    """Return the states with a constant drift, so that no joint reverses.

    The torque jumps at reversals, and dense sampling finds such a peak only approximately.
    """
    drift = 1.5 * np.abs(states[1]).max(axis=0)
    return [states[0] + drift * t[:, None], states[1] + drift, states[2]]


def _bent(rng: np.random.Generator, robot: Robot, kind: str) -> Case | None:
    joint = int(rng.choice((0, 1, 3))) if kind.startswith("motor") else int(rng.integers(4))
    joint = -1 if kind in WHICH else joint
    t, states = _samples(rng)
    if kind == "motor torque":
        states = _drifting(t, states)
    pieces = _quintics(t, states)
    k = int(rng.integers(1, INTERVALS - 1))
    values = _values(Trajectory(t, pieces, ()), robot, kind, joint)
    others = float(np.delete(values, k, axis=0).max())
    bent = int(rng.choice(WHICH.get(kind, (joint,))))
    middle = Trajectory(t, pieces, ()).sample(np.array([(t[k] + t[k + 1]) / 2]))
    size = 1e-3 * (np.ptp(states[BENT[kind]], axis=0)[bent] + 1e-6) * rng.choice((-1.0, 1.0))
    for doubling in range(40):
        state = [middle.q[0].copy(), middle.qd[0].copy(), middle.qdd[0].copy()]
        state[BENT[kind]][bent] += size * 1.6 ** (doubling // 2) * (-1) ** doubling
        trajectory = _with_middle(t, states, k, state)
        inside = _values(_stretch(trajectory, k), robot, kind, joint)
        largest = float(inside.max())
        needed = 1.5 * EXCESS * (SCALE[max(joint, 0)] if kind in RANGES else abs(largest))
        if (
            kind == "motor torque"
            and trajectory.sample(np.linspace(0, t[-1], 2000)).qd[:, joint].min() <= 0
        ):
            return None
        if largest - max(others, inside[0, 0], inside[-1, -1]) > needed:
            name = None if joint < 0 else robot.joints[joint].name
            return Case(
                trajectory, robot, (kind, name), joint, largest, (float(t[k]), float(t[k + 1]))
            )
    return None


def _samples(rng: np.random.Generator) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return times and q, qd, qdd of a sum of sines."""
    t = np.linspace(0.0, rng.uniform(0.3, 1.0), INTERVALS + 1)
    rate, phase = rng.uniform(1.0, 6.0, (2, 4)), rng.uniform(0, 2 * np.pi, (2, 4))
    angle = t[:, None, None] * rate + phase
    size = rng.uniform(0.1, 0.3, (2, 4)) * SCALE / 2
    q = (np.sin(angle) * size).sum(axis=1) + np.array([0.0, 0.6, 0.0, -0.015])
    return t, [
        q,
        (np.cos(angle) * rate * size).sum(axis=1),
        -(np.sin(angle) * rate**2 * size).sum(axis=1),
    ]


def _quintics(t: np.ndarray, states: list[np.ndarray]) -> np.ndarray:
    q, qd, qdd = states
    return quintic_coefficients(np.diff(t), (q[:-1], qd[:-1], qdd[:-1]), (q[1:], qd[1:], qdd[1:]))


def _with_middle(
    t: np.ndarray, states: list[np.ndarray], k: int, state: list[np.ndarray]
) -> Trajectory:
    """Return the quintics through the samples and one state in the middle of interval k."""
    t = np.insert(t, k + 1, (t[k] + t[k + 1]) / 2)
    return Trajectory(
        t,
        _quintics(t, [np.insert(x, k + 1, s, axis=0) for x, s in zip(states, state, strict=True)]),
        (),
    )


def _stretch(trajectory: Trajectory, k: int) -> Trajectory:
    """Return the two pieces of interval k."""
    return Trajectory(
        trajectory.breaks[k : k + 3].copy(), trajectory.coefficients[k : k + 2].copy(), ()
    )


def _values(trajectory: Trajectory, robot: Robot, kind: str, joint: int) -> np.ndarray:
    """Return the values (pieces, DENSE) that the limit bounds from above."""
    count = len(trajectory.breaks) - 1
    piece = np.repeat(np.arange(count), DENSE)
    s = trajectory.sample_pieces(
        piece, np.tile(np.linspace(0.0, 1.0, DENSE), count) * np.diff(trajectory.breaks)[piece]
    )
    fields = {"velocity": s.qd, "acceleration": s.qdd, "jerk": s.qddd}
    mechanism = Mechanism.from_geometry(robot.geometry)
    if kind == "position":
        values = s.q[:, joint]
    elif kind in fields:
        values = np.abs(fields[kind][:, joint])
    elif kind.startswith("motor"):
        values = _motor(s, robot, kind, joint)
    elif kind == "tilt range":
        values = task_from_joints(mechanism, s.q)[:, 1]
    elif kind in TASK_RATES:
        values = np.abs(
            task_rates(mechanism, s.q, s.qd)[:, TASK_COORDINATES.index(TASK_RATES[kind])]
        )
    elif kind.endswith("clearance"):
        values = _about_eye(tip_position(mechanism, s.q), kind)
    else:
        values = np.linalg.norm(tip_velocity(mechanism, s.q, s.qd), axis=1)
    return values.reshape(count, DENSE)


def _about_eye(tip: np.ndarray, kind: str) -> np.ndarray:
    if kind == "retina clearance":
        return np.linalg.norm(tip - CENTRE, axis=1)
    lens = Lens(
        read_only_array(PLACE, (3,)),
        read_only_array(SEMI_AXES, (3,)),
        read_only_array(np.eye(3), (3, 3)),
    )
    return 1 / lens_ratio(NUMPY, lens, tip.T)


def _motor(s: Samples, robot: Robot, kind: str, joint: int) -> np.ndarray:
    direction, breakaway = motion_directions(robot, s, 1)
    motor = motor_motion(robot, RigidBody.from_robot(robot), s, direction, breakaway)
    return np.abs((motor.speed if kind == "motor speed" else motor.torque)[:, joint])


def tip_velocity(mechanism: Mechanism, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Return the velocity (n, 3) of the tool tip in m/s for q and qd (n, 4).

    It is v + ω × p of the spatial velocity (v, ω) = J_s(q) qd.
    """
    twist = np.einsum("nij,nj->ni", space_jacobian(mechanism, q), qd)
    return twist[:, :3] + np.cross(twist[:, 3:], tip_position(mechanism, q))

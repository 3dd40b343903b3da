"""Compare free motions of the planner with a program that does not know the directions of motion.

    python -m tests.benchmarks.direction_free [COUNT] [STARTS]

The reference has its own transcription with cubic elements of equal length and limits at four
points of each element. It smooths friction by tanh(q̇/ε), has no static friction and assumes no
signs of the speeds. Ipopt starts from straight lines and from random bumps. With weak motors the
reference is slightly shorter than static friction allows. Neither program limits the continuous
torque.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import casadi as ca
import numpy as np

from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.kinematics.forward import forward_symbolic
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.feasibility import feasible_phases
from ssm_planner.planning.phases import reversal_ranges
from ssm_planner.problem.limits import TaskRange, TipSpeed
from ssm_planner.problem.motion import Free, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.value import unchecked_copy
from tests.benchmarks.peer_rows import motor
from tests.support.paths import ROOT

ELEMENTS, POINTS = 48, (0.0, 1 / 3, 2 / 3, 1.0)
STANDS = np.array([0.01, 0.01, 0.01, 2e-4])
"""Speed ε of the smoothed friction in rad/s and m/s."""
SMOOTHING = 1e-6
NEVER_WARM = 1.0
"""Nominal torque in N·m that no motion exceeds."""
IPOPT = {"print_level": 0, "sb": "yes", "max_iter": 600, "tol": 1e-7, "linear_solver": "mumps"}


def coupled(base: Problem, seed: int) -> Problem:
    """Return a random free motion.

    Even seeds limit the speed of the tip, and odd seeds have weak motors.
    """
    rng = np.random.default_rng(seed)

    def point() -> dict[str, float]:
        roll, tilt, spin = np.radians(rng.uniform([-28, -135, -40], [28, -85, 40]))
        return {"roll": roll, "tilt": tilt, "spin": spin, "depth": rng.uniform(0.002, 0.028)}

    limits: tuple[object, ...] = (TaskRange("depth", 0.0, 0.03),)
    strength = 1.0
    if seed % 2 == 0:
        limits += (TipSpeed(rng.uniform(0.006, 0.02)),)
    else:
        strength = rng.uniform(0.45, 0.7)
    joints = [
        joint
        if joint.motor is None
        else replace(
            joint,
            motor=unchecked_copy(
                joint.motor, max_torque=strength * joint.motor.max_torque, nominal_torque=NEVER_WARM
            ),
        )
        for joint in base.robot.joints
    ]
    robot = replace(base.robot, joints=tuple(joints))
    start, to = point(), point()
    return replace(
        base,
        robot=robot,
        start=Task(**start),
        motion=(Free(Task(**to)),),
        limits=limits,
        objective="time",
        eye=None,
    )


def rows_of(problem: Problem, mechanism: Mechanism) -> ca.Function:
    """Return the function from (q, q̇, q̈) to rows of tip speed and motor torque, which are ≤ 1.

    The friction in the motor torque is smoothed.
    """
    q, qd, qdd = (ca.SX.sym(name, 4) for name in ("q", "qd", "qdd"))
    rows = []
    for limit in problem.speeds:
        tip = forward_symbolic(mechanism, q)[1]
        rows.append(ca.sumsqr(ca.jtimes(tip, q, qd)) / limit.largest**2)
    sigma = ca.tanh(qd / STANDS)
    tau = RigidBody.from_robot(problem.robot).symbolic(q, qd, qdd)
    most = ca.DM([joint.motor.max_torque if joint.motor else 1.0 for joint in problem.robot.joints])
    limits = ca.SX(ca.vertcat(ca.DM.ones(8), most))
    rows += motor(problem.robot.joints, qd, qdd, tau, limits, [sigma[i] for i in range(4)], False)
    return ca.Function("rows", [q, qd, qdd], [ca.vertcat(*rows)])


def shortest(problem: Problem, guess: float, starts: int, seed: int) -> float:
    """Return the duration in s of the shortest motion that Ipopt finds from `starts` starts."""
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    phase = feasible_phases(problem)[0][0]
    first, last = phase.points
    room = reversal_ranges(phase, phase.points)
    velocity, acceleration = np.array(
        [(j.velocity, j.acceleration) for j in problem.robot.joints]
    ).T
    rows, n = rows_of(problem, mechanism), ELEMENTS
    unit = np.array([1.0, 1.0, 1.0, 0.02])
    x, a, time = ca.MX.sym("x", 8, n + 1), ca.MX.sym("a", 8, n), ca.MX.sym("time")
    scale = np.concatenate([unit, unit])
    h = time / n
    q, v, a0, a1 = (ca.diag(unit) @ item for item in (x[:4, :-1], x[4:, :-1], a[:4, :], a[4:, :]))
    after = ca.diag(scale) @ x[:, 1:]
    gaps = [
        ca.vec(ca.diag(1 / unit) @ (after[:4, :] - (q + h * v + h**2 * (a0 / 3 + a1 / 6)))),
        ca.vec(ca.diag(1 / unit) @ (after[4:, :] - (v + h * (a0 + a1) / 2))),
    ]
    inside, mapped, slowest = [], rows.map(n), ca.diag(1 / velocity)
    for c in POINTS:
        t, rise = c * h, a1 - a0
        speed = v + t * (a0 + c * rise / 2)
        inside += [ca.vec(mapped(q + t * (v + t * (a0 / 2 + c * rise / 6)), speed, a0 + c * rise))]
        inside += [ca.vec(slowest @ speed), ca.vec(-slowest @ speed)]
    effort = h * ca.sumsqr(ca.diag(unit / acceleration) @ a[:4, :]) + h * ca.sumsqr(
        ca.diag(unit / acceleration) @ a[4:, :]
    )
    z = ca.vertcat(ca.vec(x), ca.vec(a), time)
    g = ca.vertcat(*gaps, *inside)
    equal = sum(gap.numel() for gap in gaps)
    solver = ca.nlpsol(
        "free",
        "ipopt",
        {"x": z, "f": time + SMOOTHING * effort, "g": g},
        {"print_time": False, "ipopt": IPOPT},
    )
    low_x = np.tile(np.concatenate([room[0] / unit, -velocity / unit])[:, None], n + 1)
    high_x = np.tile(np.concatenate([room[1] / unit, velocity / unit])[:, None], n + 1)
    for k, point in ((0, first), (n, last)):
        low_x[:, k] = high_x[:, k] = np.concatenate([point / unit, np.zeros(4)])
    most = np.tile(np.concatenate([acceleration / unit] * 2)[:, None], n)
    low = np.concatenate([low_x.ravel("F"), -most.ravel("F"), [0.05]])
    high = np.concatenate([high_x.ravel("F"), most.ravel("F"), [100.0]])
    rng, best = np.random.default_rng(seed), np.inf
    share = np.linspace(0, 1, n + 1)
    for start in range(starts):
        bump = (
            0.0
            if start == 0
            else rng.normal(size=4)[:, None] * (0.3 * unit)[:, None] * np.sin(np.pi * share) ** 2
        )
        line = first[:, None] + share * (last - first)[:, None] + bump
        speed = np.gradient(line, share * guess, axis=1)
        x0 = np.vstack([line / unit[:, None], speed / unit[:, None]])
        begin = np.concatenate([x0.ravel("F"), np.zeros(8 * n), [guess]])
        result = solver(
            x0=np.clip(begin, low, high), lbx=low, ubx=high,
            lbg=np.concatenate([np.zeros(equal), np.full(g.numel() - equal, -np.inf)]),
            ubg=np.concatenate([np.zeros(equal), np.ones(g.numel() - equal)]),
        )  # fmt: skip
        if solver.stats()["success"]:
            best = min(best, float(result["x"][-1]))
    return best


def main(count: int, starts: int) -> None:
    base, ratios = load_problem(ROOT / "problems/tilt_insert.yaml"), []
    for seed in range(count):
        problem = coupled(base, seed)
        planned = plan(problem, relaxations=False)
        if planned.trajectory is None or planned.duration is None:
            print(
                f"{seed:3d} {planned.status}: {planned.reason.message if planned.reason else ''}",
                flush=True,
            )
            continue
        reference = shortest(problem, 1.2 * planned.duration, starts, seed)
        ratios.append(planned.duration / reference)
        print(
            f"{seed:3d} {planned.duration:8.4f} s, reference {reference:8.4f} s: {ratios[-1]:.4f}",
            flush=True,
        )
    holds = np.count_nonzero(np.array(ratios) <= 1.005)
    print(
        f"{holds} of {len(ratios)} within 1.005; median {np.median(ratios):.4f}, largest {max(ratios):.4f}"
    )


if __name__ == "__main__":
    main(*(int(value) for value in [*sys.argv[1:], *("20", "4")[len(sys.argv) - 1 :]]))

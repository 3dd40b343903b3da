"""The C code compiled as strictly as compilers can, and compared with the program itself."""

from __future__ import annotations

import ctypes
import dataclasses
import re
import shutil
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from ssm_planner.codegen.c import Argument, write_function
from ssm_planner.codegen.vectorised import OPERATIONS, dense, steps
from ssm_planner.dynamics.motors import directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.formats.c import c_code
from ssm_planner.formats.export import export
from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.workspace import tilt_interval
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Samples

COMPILER = shutil.which("gcc") or shutil.which("cc")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler (gcc or cc) on this machine")
STRICT = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wshadow", "-Wstrict-prototypes"]
STATES = 100_000
AGREEMENT = 1e-12
DRIVER = """
#include "ssm_robot.h"
void all(long n, const double *q, const double *qd, const double *qdd, const double *qddd,
         double *rotation, double *position, double *tau, double *tau_motor);
void inverse(long n, const double *task, const double *branch, const double *near, double *q);
void all(long n, const double *q, const double *qd, const double *qdd, const double *qddd,
         double *rotation, double *position, double *tau, double *tau_motor)
{
    for (long k = 0; k < n; ++k) {
        ssm_forward(q + 4 * k, rotation + 9 * k, position + 3 * k);
        ssm_inverse_dynamics(q + 4 * k, qd + 4 * k, qdd + 4 * k, tau + 4 * k);
        ssm_motor_torque(q + 4 * k, qd + 4 * k, qdd + 4 * k, qddd + 4 * k, tau_motor + 4 * k);
    }
}
void inverse(long n, const double *task, const double *branch, const double *near, double *q)
{
    for (long k = 0; k < n; ++k) ssm_inverse(task + 4 * k, branch[k], near + 4 * k, q + 4 * k);
}
"""


def compiled(folder: Path, robot: Robot, *flags: str) -> ctypes.CDLL:
    header, source = c_code(robot)
    (folder / "ssm_robot.h").write_text(header, encoding="utf-8")
    (folder / "ssm_robot.c").write_text(source, encoding="utf-8")
    (folder / "driver.c").write_text(DRIVER, encoding="utf-8")
    command = [COMPILER, *STRICT, *flags, "-shared", "-fPIC", "-o", "robot.so", "ssm_robot.c", "driver.c", "-lm"]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert not result.stderr
    return ctypes.CDLL(str(folder / "robot.so"))


def pointers(*arrays: np.ndarray) -> list:
    return [array.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for array in arrays]


@pytest.fixture(scope="module")
def library(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return compiled(tmp_path_factory.mktemp("c"), robot, "-O2")


def states(count: int, seed: int) -> Samples:
    """Random states, many of them with joints that stand."""
    rng = np.random.default_rng(seed)
    q, qd, qdd, qddd = (np.ascontiguousarray(rng.normal(size=(count, 4)) * [1, 1, 1, 0.05]) for _ in range(4))
    for values in (qd, qdd, qddd):
        values[rng.random(values.shape) < 0.2] = 0.0
    return Samples(np.arange(count, dtype=float), q, qd, qdd, qddd)


def run_all(library: ctypes.CDLL, s: Samples) -> tuple[np.ndarray, ...]:
    n = len(s.t)
    out = np.empty((n, 9)), np.empty((n, 3)), np.empty((n, 4)), np.empty((n, 4))
    library.all(ctypes.c_long(n), *pointers(s.q, s.qd, s.qdd, s.qddd, *out))
    return out


def close(found: np.ndarray, expected: np.ndarray) -> None:
    """Relative to the value, or to a thousandth of the largest where terms cancel."""
    size = np.maximum(np.abs(expected), 1e-3 * np.abs(expected).max(axis=0))
    assert np.max(np.abs(found - expected) / size) <= AGREEMENT


def expected_torque(robot: Robot, s: Samples) -> np.ndarray:
    direction, breakaway = directions(robot, s, 1)
    torque = motor_motion(robot, RigidBody.from_robot(robot), s, direction, breakaway).torque
    return np.where(np.isnan(torque), 0.0, torque)


def test_c_equals_python_on_random_states(robot: Robot, library: ctypes.CDLL) -> None:
    s = states(STATES, 1)
    rotation, position, tau, torque = run_all(library, s)
    expected = forward(Mechanism.from_geometry(robot.geometry), s.q)
    close(rotation, expected[0].reshape(-1, 9))
    close(position, expected[1])
    close(tau, RigidBody.from_robot(robot).inverse_dynamics(s.q, s.qd, s.qdd))
    driven = [i for i, joint in enumerate(robot.joints) if joint.drive is not None]
    close(torque[:, driven], expected_torque(robot, s)[:, driven])
    assert not torque[:, [i for i in range(4) if i not in driven]].any()


def test_c_equals_python_for_other_drives(robot: Robot, tmp_path: Path) -> None:
    joint = robot.joints[3]
    friction = dataclasses.replace(
        joint.drive.friction, law="stribeck_exponential", mu_stribeck=0.05, stribeck_speed=3.0
    )
    drive = dataclasses.replace(
        joint.drive, kind="antibacklash_screw", preload=5.0, second_nut_mass=0.05, friction=friction
    )
    slippery = dataclasses.replace(robot.joints[0].drive.friction, mu=0.01, mu_static=0.015)
    first = dataclasses.replace(robot.joints[0], drive=dataclasses.replace(robot.joints[0].drive, friction=slippery))
    other = dataclasses.replace(robot, joints=(first, *robot.joints[1:3], dataclasses.replace(joint, drive=drive)))
    s = states(5000, 2)
    torque = run_all(compiled(tmp_path, other, "-O1"), s)[3]
    close(torque[:, [0, 1, 3]], expected_torque(other, s)[:, [0, 1, 3]])


def test_inverse_kinematics_in_c(robot: Robot, library: ctypes.CDLL) -> None:
    mechanism = Mechanism.from_geometry(robot.geometry)
    low, high = tilt_interval(mechanism)
    rng = np.random.default_rng(3)
    n = 20_000
    task = np.column_stack(
        [rng.uniform(-3, 3, n), rng.uniform(low + 1e-3, high - 1e-3, n), rng.uniform(-3, 3, n), rng.uniform(0, 0.03, n)]
    )
    near = np.ascontiguousarray(rng.uniform(-9, 9, (n, 4)))
    for branch, k in ((1.0, 0), (-1.0, 1)):
        q = np.empty((n, 4))
        library.inverse(ctypes.c_long(n), *pointers(np.ascontiguousarray(task), np.full(n, branch), near, q))
        solutions = inverse_task(mechanism, task)
        assert np.all(solutions.branch[:, k] == branch)
        turns = (q - solutions.joints[:, k])[:, :3] / (2 * np.pi)
        assert np.abs(turns - np.round(turns)).max() <= AGREEMENT
        assert np.abs(q[:, :3] - near[:, :3]).max() <= np.pi * (1 + 1e-9)
        reached = forward(mechanism, q)
        asked = forward(mechanism, solutions.joints[:, k])
        assert np.abs(reached[0] - asked[0]).max() <= 1e-12
        assert np.abs(reached[1] - asked[1]).max() <= 1e-12
    outside, q = np.array([[0.0, -0.5, 0.0, 0.0]]), np.empty((1, 4))
    library.inverse(ctypes.c_long(1), *pointers(outside, np.ones(1), np.zeros((1, 4)), q))
    assert np.isnan(q[0, 1])


def test_motor_torques_are_fast_enough_for_a_control_loop(robot: Robot, tmp_path: Path) -> None:
    """At most 5 µs for all motors of the arm at -O2, the best of several runs."""
    header, source = c_code(robot)
    (tmp_path / "ssm_robot.h").write_text(header, encoding="utf-8")
    (tmp_path / "ssm_robot.c").write_text(source, encoding="utf-8")
    main = """
#include <stdio.h>
#include <time.h>
#include "ssm_robot.h"
int main(void)
{
    double q[4] = {0.3, 0.5, 0.2, -0.01}, qd[4] = {0.5, -0.4, 0.3, 0.01}, qdd[4] = {1.0, 2.0, -1.0, 0.05};
    double zero[4] = {0.0, 0.0, 0.0, 0.0}, tau[4], sum = 0.0, best = 1e9;
    for (int run = 0; run < 7; ++run) {
        clock_t begin = clock();
        for (int k = 0; k < 20000; ++k) {
            q[0] += 1e-7;
            ssm_motor_torque(q, qd, qdd, zero, tau);
            sum += tau[0] + tau[1] + tau[3];
        }
        double took = (double)(clock() - begin) / CLOCKS_PER_SEC / 20000.0;
        if (took < best) best = took;
    }
    printf("%.9g %.9g\\n", best, sum);
    return 0;
}
"""
    (tmp_path / "main.c").write_text(main, encoding="utf-8")
    command = [COMPILER, *STRICT, "-O2", "-o", "time", "ssm_robot.c", "main.c", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    best, _ = map(
        float, subprocess.run([str(tmp_path / "time")], capture_output=True, text=True, check=True).stdout.split()
    )
    assert best <= 5e-6


def test_the_exported_files_compile_also_when_marked(plan: Plan, bad_plan: Plan, tmp_path: Path) -> None:
    for source, suffix, force in ((plan, "", False), (bad_plan, "_unverified", True)):
        folder = tmp_path / f"c{suffix}"
        export(source, "c", folder, force=force)
        command = [COMPILER, *STRICT, "-c", f"ssm_robot{suffix}.c"]
        subprocess.run(command, cwd=folder, check=True)
        text = (folder / f"ssm_robot{suffix}.c").read_text(encoding="utf-8")
        assert re.findall(r"#include .*", text) == [f'#include "ssm_robot{suffix}.h"', "#include <math.h>"]


def test_every_operation_that_is_known_can_be_written(tmp_path: Path) -> None:
    """All of the table, compiled and compared with CasADi."""
    x = ca.SX.sym("x", 2)
    a, b = x[0], x[1]
    rows = [
        a + b, a - b, a * b, a / b, -a, ca.exp(a), ca.log(b), ca.sqrt(b), a**2, a + a, 1 / b, ca.sin(a), ca.cos(a), ca.tan(a),
        ca.asin(a), ca.acos(a), ca.atan(a), ca.floor(b), ca.ceil(b), ca.fabs(a), ca.sign(a), ca.logic_not(a > b), b**a,
        b**0.3,
        a < b, a <= b, a == b, a != b, ca.logic_and(a > 0, b > 0), ca.logic_or(a > 0, b > 0), ca.fmin(a, b), ca.fmax(a, b),
        ca.if_else(a > 0, b, 2 * b), ca.atan2(a, b), ca.copysign(b, a), ca.fmod(b, 0.7), ca.hypot(a, b),
        -1.5e-7, 1e30,
    ]  # fmt: skip
    function = dense("table", [x], [ca.vertcat(*rows)])
    assert set(OPERATIONS) - {step.name for step in steps(function)} == {"assign"}
    text = write_function(
        "void table(const double x[2], double y[40])", function, [Argument("x", 2)], [Argument("y", 40)]
    )
    signs = "static double sign_of(double x) { return (double)((x > 0.0) - (x < 0.0)); }\n"
    prototype = "void table(const double x[2], double y[40]);\n"
    (tmp_path / "table.c").write_text(f"#include <math.h>\n{prototype}{signs}{text}", encoding="utf-8")
    command = [COMPILER, *STRICT, "-shared", "-fPIC", "-o", "table.so", "table.c", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "table.so"))
    for point in ([0.3, 1.7], [-0.4, 0.9], [0.0, 2.0], [0.5, 0.5]):
        y = np.zeros(40)
        library.table(*pointers(np.array(point), y))
        assert y[: len(rows)] == pytest.approx(function(point).full()[:, 0], rel=1e-14)


def test_inputs_may_be_overwritten_by_outputs(robot: Robot, library: ctypes.CDLL) -> None:
    """All inputs are read before the first output is written: one array may serve as both."""
    s = states(1, 4)
    expected = run_all(library, s)[2]
    shared = s.qdd.copy()
    library.ssm_inverse_dynamics(*pointers(s.q, s.qd, shared, shared))
    assert np.array_equal(shared, expected)

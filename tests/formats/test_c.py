"""The exported C code compiles with strict warnings and agrees with the Python package."""

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

from ssm_planner.codegen.c import REAL_DEFINITIONS, SIGN_FUNCTION, Argument, write_function
from ssm_planner.codegen.vectorised import OPERATIONS, dense_function, instructions
from ssm_planner.dynamics.motors import motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.formats.c import comment_safe_text, joint_limits, robot_code, trajectory_code
from ssm_planner.formats.export import export
from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.workspace import tilt_interval
from ssm_planner.loading.load import load_robot
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Samples
from tests.support.paths import PROBLEMS

COMPILER = shutil.which("gcc") or shutil.which("cc")
pytestmark = pytest.mark.skipif(
    COMPILER is None, reason="no C compiler (gcc or cc) on this machine"
)
STRICT = [
    "-std=c99",
    "-Wpedantic",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-Wconversion",
    "-Wshadow",
    "-Wstrict-prototypes",
]
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)] or [COMPILER]
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
SINGLE = "-DSSM_FLOAT32"
STATES = 100_000
AGREEMENT = 1e-12
DRIVER = """
#include "ssm_robot.h"
void all(long n, const ssm_real *q, const ssm_real *qd, const ssm_real *qdd, const ssm_real *qddd,
         ssm_real *rotation, ssm_real *position, ssm_real *tau, ssm_real *tau_motor);
void inverse(long n, const ssm_real *task, const ssm_real *branch, const ssm_real *near, ssm_real *q);
void all(long n, const ssm_real *q, const ssm_real *qd, const ssm_real *qdd, const ssm_real *qddd,
         ssm_real *rotation, ssm_real *position, ssm_real *tau, ssm_real *tau_motor)
{
    for (long k = 0; k < n; ++k) {
        ssm_forward(q + 4 * k, rotation + 9 * k, position + 3 * k);
        ssm_inverse_dynamics(q + 4 * k, qd + 4 * k, qdd + 4 * k, tau + 4 * k);
        ssm_motor_torque(q + 4 * k, qd + 4 * k, qdd + 4 * k, qddd + 4 * k, tau_motor + 4 * k);
    }
}
void inverse(long n, const ssm_real *task, const ssm_real *branch, const ssm_real *near, ssm_real *q)
{
    for (long k = 0; k < n; ++k) ssm_inverse(task + 4 * k, branch[k], near + 4 * k, q + 4 * k);
}
"""


SAMPLER = """
#include "ssm_trajectory.h"
void sample(long n, const ssm_real *t, ssm_real *q, ssm_real *qd, ssm_real *qdd, ssm_real *tau_motor);
void sample(long n, const ssm_real *t, ssm_real *q, ssm_real *qd, ssm_real *qdd, ssm_real *tau_motor)
{
    for (long k = 0; k < n; ++k) ssm_sample(t[k], q + 4 * k, qd + 4 * k, qdd + 4 * k, tau_motor + 4 * k);
}
"""
HARSH = """
#include <float.h>
#include <math.h>
#include <stdio.h>
#include "ssm_trajectory.h"
int main(void)
{
    const ssm_real odd[] = {NAN, INFINITY, -INFINITY, SSM_R(0.0), -SSM_R(1.0), SSM_R(1e30)};
    ssm_real q[4], qd[4], qdd[4], tau[4], rotation[9], position[3], sum = SSM_R(0.0);
    for (int k = 0; k < 20000; ++k) {
        const ssm_real t = k < 6 ? odd[k] : ssm_duration * (ssm_real)(k - 500) / SSM_R(19000.0);
        ssm_sample(t, q, qd, qdd, k % 2 ? tau : 0);
        ssm_forward(q, rotation, position);
        ssm_inverse_dynamics(q, qd, qdd, tau);
        for (int j = 0; j < 4; ++j) {
            if (!(SSM_F(fabs)(qd[j]) <= ssm_velocity_max[j] * SSM_R(1.0001))) return 2;
            sum += q[j] + tau[j];
        }
    }
    printf("%.9g\\n", (double)sum);
    return 0;
}
"""


def built(
    folder: Path, texts: dict[str, str], target: str, *flags: str, compiler: str | None = COMPILER
) -> Path:
    """Compile the C texts (by file name) without a warning, and return the compiled file."""
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    sources = [name for name in texts if name.endswith(".c")]
    command = [str(compiler), *STRICT, *flags, "-o", target, *sources, "-lm"]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert not result.stderr
    return folder / target


def texts_of(robot: Robot, plan: Plan | None = None) -> dict[str, str]:
    """Return the exported files of a robot and of a plan."""
    result = {"ssm_robot": robot_code(robot)}
    if plan is not None:
        result["ssm_trajectory"] = trajectory_code(plan)
    return {
        f"{name}.{ending}": text
        for name, pair in result.items()
        for ending, text in zip("hc", pair, strict=True)
    }


def compiled(folder: Path, robot: Robot, *flags: str) -> ctypes.CDLL:
    """Compile and load the C code of a robot together with `DRIVER`."""
    texts = {**texts_of(robot), "driver.c": DRIVER}
    return ctypes.CDLL(str(built(folder, texts, "robot.so", *flags, "-shared", "-fPIC")))


def pointers(*arrays: np.ndarray) -> list:
    return [array.ctypes.data_as(ctypes.c_void_p) for array in arrays]


@pytest.fixture(scope="module")
def library(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return compiled(tmp_path_factory.mktemp("c"), robot, "-O2")


def states(count: int, seed: int) -> Samples:
    """Return `count` random states (n, 4). A fifth of the velocities, accelerations and jerks are
    zero.
    """
    rng = np.random.default_rng(seed)
    q, qd, qdd, qddd = (
        np.ascontiguousarray(rng.normal(size=(count, 4)) * [1, 1, 1, 0.05]) for _ in range(4)
    )
    for values in (qd, qdd, qddd):
        values[rng.random(values.shape) < 0.2] = 0.0
    return Samples(np.arange(count, dtype=float), q, qd, qdd, qddd)


def run_all(library: ctypes.CDLL, s: Samples, dtype: type = np.float64) -> tuple[np.ndarray, ...]:
    """Return rotation (n, 9), position (n, 3), joint torque and motor torque (n, 4) from C."""
    n = len(s.t)
    out = tuple(np.empty((n, size), dtype) for size in (9, 3, 4, 4))
    inputs = (np.ascontiguousarray(x, dtype) for x in (s.q, s.qd, s.qdd, s.qddd))
    library.all(ctypes.c_long(n), *pointers(*(arrays := [*inputs, *out])))
    return tuple(arrays[4:])


def close(found: np.ndarray, expected: np.ndarray) -> None:
    """Assert that the results agree.

    Errors are relative to the value, or to a thousandth of the largest value where terms cancel.
    """
    size = np.maximum(np.abs(expected), 1e-3 * np.abs(expected).max(axis=0))
    assert np.max(np.abs(found - expected) / size) <= AGREEMENT


def expected_torque(robot: Robot, s: Samples) -> np.ndarray:
    """Return the motor torques (n, 4) of the package, with zeros for joints without a drive."""
    direction, breakaway = motion_directions(robot, s, 1)
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
    first = dataclasses.replace(
        robot.joints[0], drive=dataclasses.replace(robot.joints[0].drive, friction=slippery)
    )
    other = dataclasses.replace(
        robot, joints=(first, *robot.joints[1:3], dataclasses.replace(joint, drive=drive))
    )
    s = states(5000, 2)
    torque = run_all(compiled(tmp_path, other, "-O1"), s)[3]
    close(torque[:, [0, 1, 3]], expected_torque(other, s)[:, [0, 1, 3]])


@pytest.mark.parametrize("name", ["raven_like", "direct_drive"])
def test_c_equals_python_for_drives_with_efficiencies(name: str, tmp_path: Path) -> None:
    robot = load_robot(PROBLEMS / f"robots/{name}.yaml")
    s = states(5000, 3)
    torque = run_all(compiled(tmp_path, robot, "-O1"), s)[3]
    assert np.abs(torque).min(axis=1).max() > 0
    close(torque, expected_torque(robot, s))


def test_inverse_kinematics_in_c(robot: Robot, library: ctypes.CDLL) -> None:
    mechanism = Mechanism.from_geometry(robot.geometry)
    low, high = tilt_interval(mechanism)
    rng = np.random.default_rng(3)
    n = 20_000
    task = np.column_stack(
        [
            rng.uniform(-3, 3, n),
            rng.uniform(low + 1e-3, high - 1e-3, n),
            rng.uniform(-3, 3, n),
            rng.uniform(0, 0.03, n),
        ]
    )
    near = np.ascontiguousarray(rng.uniform(-9, 9, (n, 4)))
    for branch, k in ((1.0, 0), (-1.0, 1)):
        q = np.empty((n, 4))
        library.inverse(
            ctypes.c_long(n), *pointers(np.ascontiguousarray(task), np.full(n, branch), near, q)
        )
        solutions = inverse_task(mechanism, task)
        assert np.all(solutions.branch[:, k] == branch)
        turns = (q - solutions.joints[:, k])[:, :3] / (2 * np.pi)
        assert np.abs(turns - np.round(turns)).max() <= AGREEMENT
        assert np.abs(q[:, :3] - near[:, :3]).max() <= np.pi * (1 + 1e-9)
        reached = forward(mechanism, q)
        expected = forward(mechanism, solutions.joints[:, k])
        assert np.abs(reached[0] - expected[0]).max() <= 1e-12
        assert np.abs(reached[1] - expected[1]).max() <= 1e-12
    outside, q = np.array([[0.0, -0.5, 0.0, 0.0]]), np.empty((1, 4))
    library.inverse(ctypes.c_long(1), *pointers(outside, np.ones(1), np.zeros((1, 4)), q))
    assert np.isnan(q[0, 1])


def sampled(
    library: ctypes.CDLL, t: np.ndarray, dtype: type = np.float64
) -> tuple[np.ndarray, ...]:
    """Return q, qd, qdd and motor torque (n, 4) of the compiled sampler."""
    out = tuple(np.empty((len(t), 4), dtype) for _ in range(4))
    library.sample(ctypes.c_long(len(t)), *pointers(t.astype(dtype), *out))
    return out


@pytest.mark.parametrize("which", ["plan", "smooth_plan"])
def test_the_sampler_equals_python(
    which: str, request: pytest.FixtureRequest, robot: Robot, tmp_path: Path
) -> None:
    """The sampler agrees with Python at 1e5 random instants and at all breaks.

    Before the start and after the end, it returns the nearest end position at rest.
    """
    plan: Plan = request.getfixturevalue(which)
    texts = {**texts_of(robot, plan), "driver.c": SAMPLER}
    library = ctypes.CDLL(str(built(tmp_path, texts, "t.so", "-O2", "-shared", "-fPIC")))
    motion, rng = plan.trajectory, np.random.default_rng(5)
    t = np.concatenate([rng.uniform(0, motion.duration, STATES), motion.breaks[:-1]])
    s = motion.sample(t)
    result = sampled(library, t)
    for value, expected in zip(result[:3], (s.q, s.qd, s.qdd), strict=True):
        size = np.maximum(np.abs(expected), 1e-3 * max(np.abs(expected).max(), 1e-300))
        assert np.max(np.abs(value - expected) / size) <= AGREEMENT
    driven = [i for i, joint in enumerate(robot.joints) if joint.drive is not None]
    close(result[3][:, driven], expected_torque(robot, s)[:, driven])
    start, end = motion.sample(motion.breaks[[0, -1]], side="left").q
    for instants, q in (
        ([-1.0, -1e-9, np.nan, -np.inf], start),
        ([motion.duration, 1e9, np.inf], end),
    ):
        rest = sampled(library, np.array(instants))
        assert np.abs(rest[0] - q).max() <= AGREEMENT
        assert not np.any(rest[1:])
    assert ctypes.c_double.in_dll(library, "ssm_duration").value == motion.duration


def test_single_precision(plan: Plan, robot: Robot, tmp_path: Path) -> None:
    """In single precision, the inverse dynamics errs by at most 1e-6 N·m or N within the joint
    limits.

    The reference is the result in double precision for the same rounded states.
    """
    texts = {**texts_of(robot, plan), "driver.c": DRIVER, "sampler.c": SAMPLER}
    library = ctypes.CDLL(str(built(tmp_path, texts, "f.so", "-O2", SINGLE, "-shared", "-fPIC")))
    low, high = np.array([joint.position for joint in robot.joints]).T
    bounds = np.array([[joint.velocity, joint.acceleration] for joint in robot.joints]).T
    rng = np.random.default_rng(6)
    shape = (STATES, 4)
    drawn = (
        rng.uniform(low, high, shape),
        *(rng.uniform(-limit, limit, shape) for limit in bounds),
        np.zeros(shape),
    )
    state = [np.asarray(x, np.float32) for x in drawn]
    s = Samples(np.arange(float(STATES)), *(np.asarray(x, float) for x in state))
    rotation, position, tau, torque = run_all(library, s, np.float32)
    expected = forward(Mechanism.from_geometry(robot.geometry), s.q)
    assert np.abs(rotation - expected[0].reshape(-1, 9)).max() <= 2e-6
    assert np.abs(position - expected[1]).max() <= 1e-7
    assert (
        np.abs(tau - RigidBody.from_robot(robot).inverse_dynamics(s.q, s.qd, s.qdd)).max() <= 1e-6
    )
    driven = [i for i, joint in enumerate(robot.joints) if joint.drive is not None]
    assert np.abs(torque - expected_torque(robot, s))[:, driven].max() <= 1e-6
    t = rng.uniform(0, plan.trajectory.duration, 10_000)
    exact = plan.trajectory.sample(t)
    result = sampled(library, t, np.float32)
    assert np.abs(result[0] - exact.q).max() <= 1e-6
    assert np.abs(result[1] - exact.qd).max() <= 1e-5


def test_limits_are_constants(robot: Robot, library: ctypes.CDLL) -> None:
    result = {
        name: list((ctypes.c_double * 4).in_dll(library, name)) for name in joint_limits(robot)
    }
    assert result == joint_limits(robot)
    assert result["ssm_velocity_max"] == [joint.velocity for joint in robot.joints]
    assert result["ssm_position_min"] == [joint.position[0] for joint in robot.joints]
    motors = [
        np.inf if joint.motor is None or joint.drive is None else joint.motor.max_torque
        for joint in robot.joints
    ]
    assert result["ssm_motor_torque_max"] == motors


@pytest.mark.parametrize("precision", [[], [SINGLE]], ids=["double", "single"])
@pytest.mark.parametrize("compiler", COMPILERS)
def test_sanitizers_find_nothing(
    compiler: str, precision: list[str], plan: Plan, tmp_path: Path
) -> None:
    (tmp_path / "try.c").write_text("int main(void) { return 0; }", encoding="utf-8")
    trial = subprocess.run(
        [compiler, *SANITIZERS, "try.c"], cwd=tmp_path, capture_output=True, check=False
    )
    if trial.returncode != 0:
        pytest.skip(f"{compiler} has no address and undefined-behaviour sanitizers here")
    texts = {**texts_of(plan.robot, plan), "main.c": HARSH}
    program = built(
        tmp_path, texts, "harsh", "-g", "-O1", *precision, *SANITIZERS, compiler=compiler
    )
    run = subprocess.run([str(program)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert not run.stderr


def test_both_precisions_fit_into_one_program(plan: Plan, tmp_path: Path) -> None:
    """The two precisions have different names, so a call in the wrong precision does not link."""
    texts = texts_of(plan.robot, plan)
    objects = {}
    for flags, name in (([], "double"), ([SINGLE], "single")):
        (tmp_path / name).mkdir()
        for file, text in texts.items():
            (tmp_path / name / file).write_text(text, encoding="utf-8")
        command = [COMPILER, *STRICT, *flags, "-c", "ssm_robot.c", "ssm_trajectory.c"]
        subprocess.run(command, cwd=tmp_path / name, check=True)
        objects[name] = [f"{name}/{item}.o" for item in ("ssm_robot", "ssm_trajectory")]
    (tmp_path / "main.c").write_text(HARSH, encoding="utf-8")
    command = [
        COMPILER,
        *STRICT,
        "-Isingle",
        SINGLE,
        "main.c",
        *objects["single"],
        *objects["double"],
        "-lm",
    ]
    subprocess.run(command, cwd=tmp_path, check=True)
    wrong = [COMPILER, "-Idouble", "main.c", *objects["single"], "-lm"]
    failed = subprocess.run(wrong, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "undefined reference" in failed.stderr


HOSTILE = (
    "*/ int x; /*",
    "*\\\n/ int x;",
    "??/\n*/",
    '" x "',
    "\r\n#define double int",
    "//",
    "\u2028",
)


@pytest.mark.parametrize("name", HOSTILE)
def test_names_stay_in_their_comments(name: str, robot: Robot, tmp_path: Path) -> None:
    """The name of the robot does not change the compiled code."""
    seen = []
    for item in ("plain", name):
        for text in robot_code(
            dataclasses.replace(robot, name=item), [f"Exported with {comment_safe_text(item)}."]
        ):
            (tmp_path / "x.c").write_text(text.replace("#include", "//"), encoding="utf-8")
            command = [str(COMPILER), "-trigraphs", "-E", "-P", "x.c"]
            seen.append(
                subprocess.run(
                    command, cwd=tmp_path, capture_output=True, text=True, check=True
                ).stdout
            )
    assert seen[:2] == seen[2:]


def test_motor_torques_are_fast_enough_for_a_control_loop(robot: Robot, tmp_path: Path) -> None:
    """The code computes the torques of all motors in at most 5 µs at -O2, in the best of several
    runs.
    """
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
    program = built(tmp_path, {**texts_of(robot), "main.c": main}, "time", "-O2")
    best, _ = map(
        float,
        subprocess.run([str(program)], capture_output=True, text=True, check=True).stdout.split(),
    )
    assert best <= 5e-6


def test_the_exported_files_compile_also_when_marked(
    plan: Plan, bad_plan: Plan, tmp_path: Path
) -> None:
    for source, suffix, force in ((plan, "", False), (bad_plan, "_unverified", True)):
        folder = tmp_path / f"c{suffix}"
        export(source, "c", folder, force=force)
        command = [COMPILER, *STRICT, "-c", f"ssm_robot{suffix}.c", f"ssm_trajectory{suffix}.c"]
        subprocess.run(command, cwd=folder, check=True)
        included = re.findall(
            r"#include .*",
            "".join(path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.[ch]"))),
        )
        robot, trajectory = (
            f'#include "{name}{suffix}.h"' for name in ("ssm_robot", "ssm_trajectory")
        )
        assert included == [robot, "#include <math.h>", trajectory, robot]


def test_every_operation_that_is_known_can_be_written(tmp_path: Path) -> None:
    """All operations of the table are compiled and compared with CasADi."""
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
    function = dense_function("table", [x], [ca.vertcat(*rows)])
    assert set(OPERATIONS) - {step.name for step in instructions(function)} == {"assign"}
    text = write_function(
        "void table(const ssm_real x[2], ssm_real y[40])",
        function,
        [Argument("x", 2)],
        [Argument("y", 40)],
    )
    prototype = "void table(const ssm_real x[2], ssm_real y[40]);\n"
    (tmp_path / "table.c").write_text(
        f"#include <math.h>\n{REAL_DEFINITIONS}{prototype}{SIGN_FUNCTION}{text}", encoding="utf-8"
    )
    command = [COMPILER, *STRICT, "-shared", "-fPIC", "-o", "table.so", "table.c", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "table.so"))
    for point in ([0.3, 1.7], [-0.4, 0.9], [0.0, 2.0], [0.5, 0.5]):
        y = np.zeros(40)
        library.table(*pointers(np.array(point), y))
        assert y[: len(rows)] == pytest.approx(function(point).full()[:, 0], rel=1e-14)


def test_inputs_may_be_overwritten_by_outputs(robot: Robot, library: ctypes.CDLL) -> None:
    """The code reads all inputs before it writes outputs, so one array may serve as both."""
    s = states(1, 4)
    expected = run_all(library, s)[2]
    shared = s.qdd.copy()
    library.ssm_inverse_dynamics(*pointers(s.q, s.qd, shared, shared))
    assert np.array_equal(shared, expected)

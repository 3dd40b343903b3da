"""Export a robot and its motion as C99 code.

The generated code contains kinematics, dynamics, motor torques and the polynomials of the motion,
and is intended for a control loop. `export_c` writes it. The code is generated from the CasADi
expressions with which this package plans, so no physical law is implemented twice.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.codegen import (
    REAL_DEFINITIONS,
    SIGN_FUNCTION,
    Argument,
    c_literal,
    dense_function,
    write_function,
)
from ssm_planner.display import jinja_environment, render_template
from ssm_planner.dynamics import RigidBody, motion_directions_symbolic, motor_torque_symbolic
from ssm_planner.formats.spline_points import REST_SPEED
from ssm_planner.kinematics import Mechanism, forward_symbolic, joints_from_task_symbolic
from ssm_planner.plans import Plan
from ssm_planner.problem import (
    JOINTS,
    Joint,
    JointAcceleration,
    JointJerk,
    JointVelocity,
    Limit,
    MotorSpeed,
    MotorTorque,
    Robot,
    robot_hash,
)
from ssm_planner.publishing import one_line
from ssm_planner.typing import Array, JsonObject, record
from ssm_planner.verification import Certificate, end_velocities

TEMPLATE_PACKAGE = "ssm_planner.formats"
"""Package that contains the templates."""
ROBOT_FILE = "ssm_robot"
"""Name of the files with the robot, without suffix and extension."""
TRAJECTORY_FILE = "ssm_trajectory"
"""Name of the files with the motion, without suffix and extension."""
UNITS = f"rad, m, N*m, N, s; joints in the order {', '.join(JOINTS)}"
"""Units of all quantities in the code."""
LIMIT_TYPES: dict[str, type[Limit]] = {
    "velocity": JointVelocity,
    "acceleration": JointAcceleration,
    "jerk": JointJerk,
    "motor_torque": MotorTorque,
    "motor_speed": MotorSpeed,
}
"""Classes of the joint limits in the code, by the part of the C constant that names them."""


@record
class CFunction:
    """A C function of the header.

    Attributes
    ----------
    name : str
        Name of the function in C.
    comment : str
        Comment above the declaration of the function.
    inputs, outputs : tuple of Argument
        Names and sizes of the arguments.
    function : casadi.Function
        CasADi function with the expressions that the C function evaluates.
    """

    name: str
    comment: str
    inputs: tuple[Argument, ...]
    outputs: tuple[Argument, ...]
    function: ca.Function


def export_c(plan: Plan, certificate: Certificate, folder: Path, suffix: str) -> JsonObject:
    """Write ssm_robot and ssm_trajectory (.h and .c), and return the entries of the manifest.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    certificate : Certificate
        Certificate of the plan. The code does not contain it.
    folder : Path
        Folder of the files.
    suffix : str
        Text before the extension of all file names: "" for a verified plan, or "_unverified".

    Returns
    -------
    dict
        Entries that this format adds to the manifest: units, rate (null) and notes for the user.
    """
    remarks = [f"Exported with {comment_safe_text(plan.path.name)}, SHA-256 {plan.sha256}."]
    if suffix:
        remarks.append("UNVERIFIED: the plan has no passed certificate.")
    texts = {
        ROBOT_FILE: robot_code(plan.robot, remarks, suffix),
        TRAJECTORY_FILE: trajectory_code(plan, remarks, suffix),
    }
    for name, (header, source) in texts.items():
        (folder / f"{name}{suffix}.h").write_text(header, encoding="utf-8")
        (folder / f"{name}{suffix}.c").write_text(source, encoding="utf-8")
    notes = [
        f"joint {joint.name} has no drive: its motor torque is 0"
        for joint in plan.robot.joints
        if joint.drive is None
    ]
    return {"units": {"all": UNITS}, "rate_hz": None, "notes": notes}


def robot_code(robot: Robot, remarks: Sequence[str] = (), suffix: str = "") -> tuple[str, str]:
    """Return the header and the source file of a robot as C99 code.

    Parameters
    ----------
    robot : Robot
        Robot whose data the code contains.
    remarks : sequence of str
        Lines that are added to the comment at the beginning of both files.
    suffix : str
        Suffix in the names of all files, before the extension. The source file includes the header
        with this suffix.

    Returns
    -------
    header, source : str
        Text of the two files.
    """
    functions = c_functions(robot)
    limits = joint_limits(robot)
    declarations = [_declaration(function) for function in functions]
    definitions = [
        write_function(declaration, function.function, function.inputs, function.outputs)
        for declaration, function in zip(declarations, functions, strict=True)
    ]
    bodies = "\n".join(definitions)
    comments = [function.comment for function in functions]
    values = {
        "comment": _file_comment(robot, remarks),
        "header": f"{ROBOT_FILE}{suffix}.h",
        "real": REAL_DEFINITIONS,
        "names": list(limits) + [function.name for function in functions],
        "limits": [(name, list(map(c_literal, bounds))) for name, bounds in limits.items()],
        "functions": list(zip(declarations, comments, strict=True)),
        "sign": SIGN_FUNCTION if "sign_of(" in bodies else "",
        "bodies": bodies,
    }
    return _render_files("robot", values)


def trajectory_code(plan: Plan, remarks: Sequence[str] = (), suffix: str = "") -> tuple[str, str]:
    """Return the header and the source file of a plan's motion as C99 code.

    The code contains the coefficients of the polynomials as constant tables, and a function that
    evaluates them at a time.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    remarks : sequence of str
        Lines that are added to the comment at the beginning of both files.
    suffix : str
        Suffix in the names of all files, before the extension. The source file includes the headers
        with this suffix.

    Returns
    -------
    header, source : str
        Text of the two files.
    """
    motion = plan.motion
    moves = np.abs(end_velocities(motion)) > REST_SPEED
    values = {
        "comment": _file_comment(plan.robot, remarks),
        "robot": f"{ROBOT_FILE}{suffix}.h",
        "header": f"{TRAJECTORY_FILE}{suffix}.h",
        "breaks": _c_literals(motion.breaks - motion.breaks[0]),
        "pieces": _c_literals(motion.coefficients),
        "moves": moves.astype(int).tolist(),
    }
    return _render_files("trajectory", values)


def _c_literals(values: Array) -> Any:
    """Return the numbers of an array of any shape as C literals, in lists of the same shape."""
    return np.vectorize(c_literal, otypes=[object])(values).tolist()


def joint_limits(robot: Robot) -> dict[str, list[float]]:
    """Return the limits of the four joints by the names of their C constants.

    Parameters
    ----------
    robot : Robot
        Robot with its joints.

    Returns
    -------
    dict of lists of 4 floats
        Limits of joints 1 to 4 in SI units, by the name of the C constant, such as
        "ssm_velocity_max". A limit that a joint does not have is infinite.
    """

    def limit(joint: Joint, limit_type: type[Limit]) -> float:
        """Return the upper limit of a given class that a joint has, or infinity."""
        joint_limit = joint.find_limit(limit_type)
        return math.inf if joint_limit is None else joint_limit.high

    limits = {
        "ssm_position_min": [joint.position[0] for joint in robot.joints],
        "ssm_position_max": [joint.position[1] for joint in robot.joints],
    }
    for name, limit_type in LIMIT_TYPES.items():
        limits[f"ssm_{name}_max"] = [limit(joint, limit_type) for joint in robot.joints]
    return limits


def _render_files(template: str, values: dict[str, Any]) -> tuple[str, str]:
    """Return the header and the source file that result from two templates.

    Parameters
    ----------
    template : str
        Common name of the templates without their extensions .h and .c.
    values : dict
        Values of the variables in the templates, by name.

    Returns
    -------
    header, source : str
        Text of the two files.
    """
    templates = jinja_environment(TEMPLATE_PACKAGE, escape=False)
    header = render_template(templates, f"{template}.h", **values)
    source = render_template(templates, f"{template}.c", **values)
    return header, source


def _file_comment(robot: Robot, remarks: Sequence[str]) -> str:
    """Return the comment at the beginning of a generated file.

    Parameters
    ----------
    robot : Robot
        Robot whose name and hash the comment states.
    remarks : sequence of str
        Lines between the robot and the units.

    Returns
    -------
    str
        Comment in C with the robot, the remarks and the units of all quantities.
    """
    sentences = [
        f"Robot {comment_safe_text(robot.name)} (SHA-256 of its values {robot_hash(robot)}).",
        *remarks,
        f"SI units: {UNITS}.",
        "The code allocates no memory, keeps no state and only uses the C mathematics library "
        "(-lm). All functions are reentrant.",
    ]
    return "/*\n" + "\n".join(f" * {line}" for line in sentences) + "\n */"


def comment_safe_text(name: str) -> str:
    """Return a name without the characters that could end a C comment or its line.

    Names come from files of users. A name that contains "*/" would otherwise end the comment, so
    that the rest of the name would be compiled.
    """
    return one_line(name, without="*/\\?")


def c_functions(robot: Robot) -> list[CFunction]:
    """Build the functions that a control loop can call for a robot.

    They compute the forward kinematics, the inverse kinematics, the inverse dynamics of the rigid
    bodies, and the motor torques with friction.

    Parameters
    ----------
    robot : Robot
        Robot whose values the functions contain.

    Returns
    -------
    list of CFunction
        Name, comment, arguments and CasADi function of `ssm_forward`, `ssm_inverse`,
        `ssm_inverse_dynamics` and `ssm_motor_torque`.
    """
    mechanism = Mechanism.from_robot(robot)
    body = RigidBody.from_robot(robot)
    q, qd, qdd, qddd = [ca.SX.sym(name, 4) for name in ("q", "qd", "qdd", "qddd")]
    task = ca.SX.sym("task", 4)
    guess = ca.SX.sym("near", 4)
    branch = ca.SX.sym("branch")
    rotation, tip = forward_symbolic(mechanism, q)
    # The closed form needs a numeric branch, so the code contains both branches and selects one.
    positive_branch = joints_from_task_symbolic(mechanism, task, 1, guess)
    negative_branch = joints_from_task_symbolic(mechanism, task, -1, guess)
    joints = ca.if_else(branch > 0, positive_branch, negative_branch)
    direction, breakaway = motion_directions_symbolic(robot, qd, qdd, qddd, 1)
    _, torque, _ = motor_torque_symbolic(robot, q, qd, qdd, direction, breakaway=breakaway)
    motion = (Argument("q", 4), Argument("qd", 4), Argument("qdd", 4))
    return [
        CFunction(
            "ssm_forward",
            "Computes the tool orientation (rows of the rotation base <- tool) and the tip "
            "position of joints q.",
            (Argument("q", 4),),
            (Argument("rotation", 9), Argument("position", 3)),
            dense_function("forward", [q], [ca.vec(rotation.T), tip]),
        ),
        CFunction(
            "ssm_inverse",
            "Computes the joints of (roll, tilt, spin, depth) on a branch, +1.0 or -1.0 (the sign "
            "of\n"
            "   sin(theta2 - delta)). Whole turns are added so that revolute joints are close to\n"
            "   `near`. Joints are NaN outside the workspace.",
            (Argument("task", 4), Argument("branch", 0), Argument("near", 4)),
            (Argument("q", 4),),
            dense_function("inverse", [task, branch, guess], [joints]),
        ),
        CFunction(
            "ssm_inverse_dynamics",
            "Computes the joint efforts of the rigid bodies at q, qd, qdd in N*m and N.",
            motion,
            (Argument("tau", 4),),
            dense_function("inverse_dynamics", [q, qd, qdd], [body.symbolic(q, qd, qdd)]),
        ),
        CFunction(
            "ssm_motor_torque",
            "Computes the motor torques in N*m by the exact friction law. A standing joint is\n"
            "   assumed to start in the direction of qdd, or of qddd if qdd is zero, with static "
            "friction.\n"
            "   If both are zero, the joint is held. Self-locking drives hold it without torque.\n"
            "   The torque is 0 for a joint without a drive. qddd may be zeros.",
            motion + (Argument("qddd", 4),),
            (Argument("tau_motor", 4),),
            dense_function("motor_torque", [q, qd, qdd, qddd], [torque]),
        ),
    ]


def _declaration(function: CFunction) -> str:
    """Return the C declaration of a function, without its semicolon.

    Parameters
    ----------
    function : CFunction
        Function with its arguments. An argument of size 0 is a single number, and any other
        argument is an array of its size.

    Returns
    -------
    str
        Declaration such as "void ssm_forward(const ssm_real q[4], ssm_real position[3])".
    """
    inputs = [
        f"const ssm_real {argument.name}[{argument.size}]"
        if argument.size
        else f"ssm_real {argument.name}"
        for argument in function.inputs
    ]
    outputs = [f"ssm_real {argument.name}[{argument.size}]" for argument in function.outputs]
    return f"void {function.name}({', '.join(inputs + outputs)})"

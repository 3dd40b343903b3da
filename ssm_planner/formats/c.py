"""Kinematics, inverse dynamics and motor torques of one robot as C99 without dependencies, for a control loop.

The functions are the program's own expressions, written out operation by operation; no second law is written here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca

from ssm_planner.codegen.c import Argument, write_function
from ssm_planner.codegen.vectorised import dense
from ssm_planner.dynamics.motors import directions_law, motor_law
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.kinematics.forward import forward_symbolic
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import joints_from_task_symbolic
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.serialization import robot_hash
from ssm_planner.publishing import one_line
from ssm_planner.verification.certificate import Certificate

NAME = "ssm_robot"
SIGN = "static double sign_of(double x) { return (double)((x > 0.0) - (x < 0.0)); }\n\n"
UNITS = "rad, m, N*m, N, s; joints in the order {names}"


@dataclass(frozen=True, eq=False)
class CFunction:
    """One function of the header: its expressions and what it does, in a comment."""

    name: str
    comment: str
    inputs: tuple[Argument, ...]
    outputs: tuple[Argument, ...]
    function: ca.Function


def export_c(plan: Plan, certificate: Certificate, folder: Path, suffix: str) -> dict[str, Any]:
    """Write ssm_robot.h and ssm_robot.c into a folder; returns what the manifest says of them."""
    header, source = c_code(
        plan.robot, [f"Exported with {c_text(plan.path.name)}, SHA-256 {plan.sha256}.", *_mark(suffix)], suffix
    )
    (folder / f"{NAME}{suffix}.h").write_text(header, encoding="utf-8")
    (folder / f"{NAME}{suffix}.c").write_text(source, encoding="utf-8")
    notes = [f"joint {j.name} has no drive: its motor torque is 0" for j in plan.robot.joints if j.drive is None]
    return {"units": {"all": UNITS.format(names=_names(plan.robot))}, "rate_hz": None, "notes": notes}


def c_code(robot: Robot, remarks: Sequence[str] = (), suffix: str = "") -> tuple[str, str]:
    """(header, source) of a robot as C99."""
    functions = c_functions(robot)
    about = [
        f"Robot {c_text(robot.name)} (SHA-256 of its values {robot_hash(robot)}).",
        *remarks,
        f"SI units: {UNITS.format(names=_names(robot))}.",
        "No allocation, no state, no dependency but the C library's mathematics (-lm); all functions are reentrant.",
    ]
    comment = "/*\n" + "\n".join(f" * {line}" for line in about) + "\n */\n"
    guard = "SSM_ROBOT_H"
    declarations = "\n\n".join(f"/* {f.comment} */\n{_declaration(f)};" for f in functions)
    header = f"""{comment}#ifndef {guard}
#define {guard}

#ifdef __cplusplus
extern "C" {{
#endif

{declarations}

#ifdef __cplusplus
}}
#endif

#endif
"""
    bodies = "\n".join(write_function(_declaration(f), f.function, f.inputs, f.outputs) for f in functions)
    source = (
        f'{comment}#include "{NAME}{suffix}.h"\n\n#include <math.h>\n\n{SIGN if "sign_of(" in bodies else ""}{bodies}'
    )
    return header, source


def c_text(name: str) -> str:
    """A name as part of a C comment: nothing that ends the comment or the line, or splices lines."""
    return one_line(name, without="*/\\?")


def c_functions(robot: Robot) -> list[CFunction]:
    """Forward and inverse kinematics, inverse dynamics, motor torques."""
    mechanism, body = Mechanism.from_geometry(robot.geometry), RigidBody.from_robot(robot)
    q, qd, qdd, qddd, task, near = (ca.SX.sym(name, 4) for name in ("q", "qd", "qdd", "qddd", "task", "near"))
    branch = ca.SX.sym("branch")
    turned, tip = forward_symbolic(mechanism, q)
    # the closed form takes a branch as a number: both are written, one is chosen
    ahead, behind = (joints_from_task_symbolic(mechanism, task, k, near) for k in (1, -1))
    direction, breakaway = directions_law(robot, qd, qdd, qddd, 1)
    _, torque, _ = motor_law(robot, q, qd=qd, qdd=qdd, direction=direction, breakaway=breakaway)
    four = (Argument("q", 4), Argument("qd", 4), Argument("qdd", 4))
    return [
        CFunction(
            "ssm_forward",
            "Tool orientation (rows of the rotation base <- tool) and tip position of joints q.",
            (Argument("q", 4),),
            (Argument("rotation", 9), Argument("position", 3)),
            dense("forward", [q], [ca.vec(turned.T), tip]),
        ),
        CFunction(
            "ssm_inverse",
            "Joints of (roll, tilt, spin, depth) on a branch, +1.0 or -1.0 (the sign of sin(theta2 - delta)), revolute\n"
            "   joints moved by whole turns next to `near`. Outside the workspace the joints are NaN.",
            (Argument("task", 4), Argument("branch", 0), Argument("near", 4)),
            (Argument("q", 4),),
            dense("inverse", [task, branch, near], [ca.if_else(branch > 0, ahead, behind)]),
        ),
        CFunction(
            "ssm_inverse_dynamics",
            "Joint efforts of the rigid bodies at q, qd, qdd: N*m, N.",
            four,
            (Argument("tau", 4),),
            dense("inverse_dynamics", [q, qd, qdd], [body.symbolic(q, qd, qdd)]),
        ),
        CFunction(
            "ssm_motor_torque",
            "Motor torques, N*m, that move the joints so, by the exact friction law; a standing joint is taken to move\n"
            "   next in the direction of qdd, or of qddd where that is zero too, with static friction; if all are zero it\n"
            "   is held, which costs a self-locking drive nothing. 0 for a joint without a drive. qddd may be zeros.",
            (*four, Argument("qddd", 4)),
            (Argument("tau_motor", 4),),
            dense("motor_torque", [q, qd, qdd, qddd], [torque]),
        ),
    ]


def _declaration(f: CFunction) -> str:
    inputs = [f"double {a.name}" if a.size == 0 else f"const double {a.name}[{a.size}]" for a in f.inputs]
    return f"void {f.name}({', '.join([*inputs, *(f'double {a.name}[{a.size}]' for a in f.outputs)])})"


def _names(robot: Robot) -> str:
    return ", ".join(joint.name for joint in robot.joints)


def _mark(suffix: str) -> list[str]:
    return ["UNVERIFIED: the plan has no passed certificate."] if suffix else []

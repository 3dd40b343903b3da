"""Forward dynamics of one drive: the acceleration that a motor torque gives, and whether there is only one.

The inverse law of transmission.py solved for the acceleration. It is piecewise linear: along the branch on which the
load opposes motion the motor turns `effective_inertia(...)[0]`, along the other one `effective_inertia(...)[1]`, which
friction can make negative when the load's inertia is large (J_in·ratio < γ·|tan(λ − φ)|·M). Then a rigid drive with the
load ahead of it has no unique motion: it may run ahead or jam at once.
"""

from __future__ import annotations

from ssm_planner.codegen.namespace import namespace_of
from ssm_planner.dynamics.friction import breakaway_coefficient, friction_of
from ssm_planner.dynamics.transmission import motor_torque_rows, output_effort
from ssm_planner.problem.drive import Drive
from ssm_planner.typing import Expression


def effective_inertia(
    drive: Drive, mu: Expression | None = None, direction: Expression = 1
) -> tuple[Expression, Expression]:
    """Inertia at the motor shaft, kg·m², (load opposing, load driving); shape of mu, default the kinetic coefficient.

    J_in + γ·tan(λ ± φ)·J_out / ratio. An antibacklash screw, both of whose nuts count, has one for each direction (±1).
    """
    rows = motor_torque_rows(drive, direction, mu)
    output = drive.output_inertia / drive.ratio
    opposing, driving = (rows.inertia + slope * output for slope in rows.slope)
    return opposing, driving


def always_unique(drive: Drive) -> bool:
    """Whether every torque gives this drive one motion: its effective inertia is positive at the largest friction."""
    largest = breakaway_coefficient(friction_of(drive))
    return all(inertia > 0 for direction in (1, -1) for inertia in effective_inertia(drive, largest, direction))


def motor_acceleration(
    drive: Drive, tau: Expression, w: Expression, load: Expression, direction: Expression, mu: Expression
) -> tuple[Expression, Expression]:
    """(wd, F), rad/s² and N·m or N: acceleration and mesh effort of a drive that moves in `direction` (±1).

    tau, w: motor torque and speed; load: effort on the output besides its inertia and friction. Solves
    motor_torque(F, w, wd) = tau with F = load + J_out·wd/ratio + friction; meaningful where `always_unique`.
    """
    rows = motor_torque_rows(drive, direction, mu)
    effort = output_effort(drive, load, w / drive.ratio, 0.0, direction)
    inertias = effective_inertia(drive, mu, direction)
    opposed, driven = (
        (tau - rows.torque(slope * effort, w, 0.0)) / inertia
        for slope, inertia in zip(rows.slope, inertias, strict=True)
    )
    output = drive.output_inertia / drive.ratio
    xp = namespace_of(opposed, driven, direction)
    wd = xp.where(direction * (effort + output * opposed) >= 0, opposed, driven)
    return wd, effort + output * wd

"""Laws of the drives, for other simulators and controllers.

All functions accept numbers, NumPy arrays and CasADi expressions in SI units, and a `Drive` with
its friction, such as `load_drive("vitreoretinal_joint1_worm")`. docs/simulation.md shows their use.

=====================  ===============================================================
`drive_torque`         motor torque and mesh effort of a motion (feed-forward)
`drive_step`           motor speed after a time step, with stick–slip (simulation)
`motor_acceleration`   acceleration of a sliding drive under a motor torque
`breakaway_torque`     motor torque at which a resting drive starts to move
`holding_torque`       smallest motor torque that keeps a drive at rest
`friction_coefficient` friction coefficient of the mesh at a motor speed
`self_locking_margin`  margins of self-locking
=====================  ===============================================================
"""

from ssm_planner.dynamics import (
    breakaway_torque,
    drive_torque,
    friction_coefficient,
    holding_torque,
    motor_acceleration,
    self_locking_margin,
)
from ssm_planner.simulation.drive import DriveStep, drive_step

__all__ = [
    "DriveStep",
    "breakaway_torque",
    "drive_step",
    "drive_torque",
    "friction_coefficient",
    "holding_torque",
    "motor_acceleration",
    "self_locking_margin",
]

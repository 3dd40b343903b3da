"""Physical laws that other packages use, by the module that defines them."""

from .friction import (
    STANDSTILL as STANDSTILL,
    breakaway_coefficient as breakaway_coefficient,
    friction_coefficient as friction_coefficient,
    friction_of as friction_of,
    remembered_speed as remembered_speed,
    static_coefficient as static_coefficient,
    stribeck_shape as stribeck_shape,
)
from .motors import (
    STILL as STILL,
    directions as directions,
    directions_law as directions_law,
    drive_torque as drive_torque,
    motor_law as motor_law,
    motor_motion as motor_motion,
    motorised as motorised,
    motorless as motorless,
)
from .rigid_body import (
    LOAD as LOAD,
    RigidBody as RigidBody,
    axes_frames as axes_frames,
    efforts_by_figures as efforts_by_figures,
    inertia_about_com as inertia_about_com,
    load_figures as load_figures,
    static_loads as static_loads,
    with_payload as with_payload,
)
from .spread import (
    LINEAR_DRAWS as LINEAR_DRAWS,
    SEED as SEED,
    FrictionSpread as FrictionSpread,
    drive_with as drive_with,
    spread_of as spread_of,
)
from .transmission import (
    TorqueRows as TorqueRows,
    breakaway_torque as breakaway_torque,
    holding_torque as holding_torque,
    mesh_coefficients as mesh_coefficients,
    motor_acceleration as motor_acceleration,
    motor_torque_rows as motor_torque_rows,
    moving_torque as moving_torque,
    nut_contact as nut_contact,
    of_efficiencies as of_efficiencies,
    output_effort as output_effort,
    self_locking_margin as self_locking_margin,
)

"""Physical laws that other packages use, by the module that defines them."""

from .friction import (
    STANDSTILL_SPEED as STANDSTILL_SPEED,
    breakaway_coefficient as breakaway_coefficient,
    friction_coefficient as friction_coefficient,
    required_friction as required_friction,
    delayed_speed as delayed_speed,
    static_coefficient as static_coefficient,
    stribeck_shape as stribeck_shape,
)
from .motors import (
    REST_FRACTION as REST_FRACTION,
    MotorMotion as MotorMotion,
    motion_directions as motion_directions,
    motion_directions_symbolic as motion_directions_symbolic,
    drive_torque as drive_torque,
    motor_torque_symbolic as motor_torque_symbolic,
    motor_motion as motor_motion,
    motorised_joints as motorised_joints,
    joints_without_motor as joints_without_motor,
)
from .rigid_body import (
    LOAD_LAYOUT as LOAD_LAYOUT,
    RigidBody as RigidBody,
    axis_frames as axis_frames,
    efforts_from_parameters as efforts_from_parameters,
    inertia_about_com as inertia_about_com,
    load_parameters as load_parameters,
    static_loads as static_loads,
    with_payload as with_payload,
)
from .spread import (
    LINEARISED_DRAWS as LINEARISED_DRAWS,
    RANDOM_SEED as RANDOM_SEED,
    FrictionSpread as FrictionSpread,
    drive_with_values as drive_with_values,
    friction_spread as friction_spread,
)
from .transmission import (
    TorqueRows as TorqueRows,
    breakaway_torque as breakaway_torque,
    holding_torque as holding_torque,
    mesh_coefficients as mesh_coefficients,
    motor_acceleration as motor_acceleration,
    motor_torque_rows as motor_torque_rows,
    moving_torque as moving_torque,
    nut_contact_force as nut_contact_force,
    thread_from_efficiencies as thread_from_efficiencies,
    output_effort as output_effort,
    self_locking_margin as self_locking_margin,
)

"""Kinematics that other packages use, by the module that defines it."""

from .eye import (
    eye_limits as eye_limits,
    eye_constraints as eye_constraints,
    smallest_lens_ratio as smallest_lens_ratio,
    lens_constraint as lens_constraint,
    retina_constraint as retina_constraint,
)
from .family import MechanismFamily as MechanismFamily
from .forward import (
    SPEED_JACOBIANS as SPEED_JACOBIANS,
    forward_symbolic as forward_symbolic,
    speed_bounds as speed_bounds,
    tip_position as tip_position,
    tip_position_symbolic as tip_position_symbolic,
    tool_speed as tool_speed,
)
from .inverse import inverse_task as inverse_task, inverse_tip as inverse_tip
from .mechanism import Mechanism as Mechanism
from .robot_kinematics import fk as fk, jacobian as jacobian
from .rotations import (
    angle_between as angle_between,
    check_rows as check_rows,
    casadi_constant as casadi_constant,
    rotation as rotation,
    rotation_symbolic as rotation_symbolic,
)
from .solutions import Solutions as Solutions, nearest_turn as nearest_turn
from .task import (
    joint_rates as joint_rates,
    joints_from_task_symbolic as joints_from_task_symbolic,
    joints_of_task as joints_of_task,
    pose_from_task as pose_from_task,
    roll_of_tip as roll_of_tip,
    task_from_joints as task_from_joints,
    task_from_joints_symbolic as task_from_joints_symbolic,
    task_of_joints as task_of_joints,
    task_of_tip_symbolic as task_of_tip_symbolic,
    task_rates as task_rates,
    task_rates_symbolic as task_rates_symbolic,
    tip_from_task as tip_from_task,
)
from .workspace import (
    DesignRegion as DesignRegion,
    design_margin as design_margin,
    design_region as design_region,
    joint_speed_per_tilt_speed as joint_speed_per_tilt_speed,
    smallest_singular_value as smallest_singular_value,
    theta2_from_tilt as theta2_from_tilt,
    tilt_interval as tilt_interval,
)

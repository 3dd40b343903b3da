"""Kinematics that other packages use, by the module that defines it."""

from .eye import (
    eye_limits as eye_limits,
    eye_rows as eye_rows,
    lens_limit as lens_limit,
    lens_row as lens_row,
    retina_row as retina_row,
)
from .family import Family as Family
from .forward import (
    JACOBIANS as JACOBIANS,
    forward_symbolic as forward_symbolic,
    speed_bounds as speed_bounds,
    tip_position as tip_position,
    tip_position_symbolic as tip_position_symbolic,
    tool_speed as tool_speed,
)
from .inverse import inverse_task as inverse_task, inverse_tip as inverse_tip
from .mechanism import Mechanism as Mechanism
from .of_robot import fk as fk, jacobian as jacobian
from .rotations import (
    batch as batch,
    constant as constant,
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

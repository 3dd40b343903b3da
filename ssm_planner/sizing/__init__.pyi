"""Names of the sizing that other packages use, by the module that defines them."""

from .assess import MotorVerdict as MotorVerdict, extrapolation_notes as extrapolation_notes
from .duty import DutyCycle as DutyCycle, pause_after_motion as pause_after_motion
from .joint_load import JointLoad as JointLoad, joint_loads as joint_loads
from .motor_limits import (
    REFERENCE_TEMPERATURE as REFERENCE_TEMPERATURE,
    Conditions as Conditions,
    available_torque as available_torque,
    continuous_torque as continuous_torque,
    missing_data as missing_data,
)
from .requirements import (
    TORQUE_COMPONENTS as TORQUE_COMPONENTS,
    MotorRequirement as MotorRequirement,
    motor_requirements as motor_requirements,
    torque_split as torque_split,
)
from .selection import (
    MARGIN_CHECKS as MARGIN_CHECKS,
    RANKS as RANKS,
    JointSelection as JointSelection,
    select_motors as select_motors,
    select_joint as select_joint,
)
from .size import (
    JointSizing as JointSizing,
    Sizing as Sizing,
    WhatIf as WhatIf,
    largest_payload as largest_payload,
    shortest_duration as shortest_duration,
    size_motion as size_motion,
)
from .tip_error import TipError as TipError, tip_error as tip_error
from .thermal_network import (
    THERMAL_DATA as THERMAL_DATA,
    Cycle as Cycle,
    ThermalModel as ThermalModel,
    steady_state as steady_state,
)

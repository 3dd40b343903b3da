"""Names of the sizing that other packages use, by the module that defines them."""

from .assess import MotorVerdict as MotorVerdict, extrapolation as extrapolation
from .duty import DutyCycle as DutyCycle, pause_of as pause_of
from .joint_load import JointLoad as JointLoad, joint_loads as joint_loads
from .motor_limits import (
    REFERENCE_TEMPERATURE as REFERENCE_TEMPERATURE,
    Conditions as Conditions,
    available_torque as available_torque,
    continuous_torque as continuous_torque,
    missing as missing,
)
from .requirements import (
    PARTS as PARTS,
    MotorRequirement as MotorRequirement,
    motor_requirements as motor_requirements,
    torque_split as torque_split,
)
from .selection import (
    MARGINS as MARGINS,
    RANKS as RANKS,
    JointSelection as JointSelection,
    select as select,
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
    FIGURES as FIGURES,
    Cycle as Cycle,
    ThermalModel as ThermalModel,
    steady_state as steady_state,
)

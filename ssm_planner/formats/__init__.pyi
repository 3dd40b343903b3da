"""Names of `formats` that other packages use, by the module that defines them."""

from .epos4 import (
    Stream as Stream,
    sample_setpoints as sample_setpoints,
    setpoint_times as setpoint_times,
)
from .epos4_setup import (
    Axis as Axis,
    drive_axes as drive_axes,
    following_error_window as following_error_window,
)
from .format import FORMATS as FORMATS
from .points import Reading as Reading
from .read import read_trajectory as read_trajectory
from .signature import signature_error as signature_error
from .spline_points import sample_slowed_plan as sample_slowed_plan

"""Names of the formats that other packages use, by the module that defines them."""

from .epos4 import Stream as Stream, setpoint_times as setpoint_times, setpoints as setpoints
from .epos4_setup import (
    Axis as Axis,
    axes_of as axes_of,
    following_error_window as following_error_window,
)
from .format import FORMATS as FORMATS
from .points import Reading as Reading
from .read import read_manifest as read_manifest, read_trajectory as read_trajectory
from .signature import signature_fault as signature_fault
from .spline_points import at_times as at_times

"""Names of `identification` that other packages use, and the modules that define them."""

from .drive_file import parameter_unit as parameter_unit
from .fit import MapFit as MapFit, fit_map as fit_map
from .identify import friction_origin as friction_origin, predict as predict
from .parameters import map_torque as map_torque, drive_with_parameters as drive_with_parameters
from .prediction import (
    RecordedMotion as RecordedMotion,
    Prediction as Prediction,
    prediction_band as prediction_band,
    law_correction as law_correction,
    nrmsd as nrmsd,
    predict_recording as predict_recording,
)
from .recordings import (
    trapezoidal_integral as trapezoidal_integral,
    largest_magnitude as largest_magnitude,
    smallest_step as smallest_step,
    read_recording as read_recording,
    read_recordings as read_recordings,
    rms as rms,
    true_runs as true_runs,
)
from .torque_map import (
    TABLE_NAME as TABLE_NAME,
    TorqueMap as TorqueMap,
    read_torque_map as read_torque_map,
)

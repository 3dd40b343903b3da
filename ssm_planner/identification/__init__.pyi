"""Names of `identification` that other packages use, and the modules that define them."""

from .drive_file import unit_of as unit_of
from .fit import MapFit as MapFit, fit_map as fit_map
from .identify import friction_origin as friction_origin, predict as predict
from .parameters import map_torque as map_torque, with_parameters as with_parameters
from .prediction import (
    Motion as Motion,
    Prediction as Prediction,
    band_of as band_of,
    departure as departure,
    nrmsd as nrmsd,
    predict_recording as predict_recording,
)
from .recordings import (
    integrated as integrated,
    largest as largest,
    quantum as quantum,
    read_recording as read_recording,
    read_recordings as read_recordings,
    rms as rms,
    runs as runs,
)
from .torque_map import (
    TABLE as TABLE,
    TorqueMap as TorqueMap,
    read_figures as read_figures,
)

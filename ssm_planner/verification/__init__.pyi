"""Names of the verification that other packages use, by the module that defines them."""

from .certificate import (
    Certificate as Certificate,
    LimitCheck as LimitCheck,
    broken_seal as broken_seal,
    sealed as sealed,
    subjects as subjects,
)
from .check import check_stops as check_stops
from .ends import end_velocities as end_velocities
from .limits import DYNAMIC as DYNAMIC
from .second_opinion import second_opinions_and_proofs as second_opinions_and_proofs
from .slower import (
    SLOWEST as SLOWEST,
    SpeedRange as SpeedRange,
    check_slower as check_slower,
    check_speeds as check_speeds,
)
from .stops import StopMotions as StopMotions, quickest_stops as quickest_stops
from .visits import with_task as with_task

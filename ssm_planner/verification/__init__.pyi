"""Names of the verification that other packages use, by the module that defines them."""

from .certificate import (
    Certificate as Certificate,
    LimitCheck as LimitCheck,
    seal_error as seal_error,
    with_seal as with_seal,
    describe_unjudged as describe_unjudged,
)
from .check import check_stops as check_stops
from .ends import end_velocities as end_velocities
from .limits import ACCELERATION_DEPENDENT_LIMITS as ACCELERATION_DEPENDENT_LIMITS
from .second_opinion import second_opinions_and_proofs as second_opinions_and_proofs
from .slower import (
    DEFAULT_SLOWEST_SPEED as DEFAULT_SLOWEST_SPEED,
    SpeedRange as SpeedRange,
    check_slower as check_slower,
    check_speeds as check_speeds,
)
from .stops import StopMotions as StopMotions, quickest_stops as quickest_stops
from .visits import with_task_results as with_task_results

"""Names of the problem that other packages use, by the module that defines them."""

from .controller import (
    AxisController as AxisController,
    Controller as Controller,
    JointCompliance as JointCompliance,
)
from .drive import (
    PARAMETERS as PARAMETERS,
    RANGED as RANGED,
    WEDGE as WEDGE,
    Drive as Drive,
    Friction as Friction,
    FrictionLawName as FrictionLawName,
    Ratings as Ratings,
    Rig as Rig,
    ScrewEnds as ScrewEnds,
)
from .drive_geometry import (
    BadGeometry as BadGeometry,
)
from .limit import (
    Symmetric as Symmetric,
    in_words as in_words,
)
from .limits import (
    ENDS as ENDS,
    JUMPS as JUMPS,
    PROMISES as PROMISES,
    READ_IN as READ_IN,
    TASK as TASK,
    ConstantSpeed as ConstantSpeed,
    ContinuousTorque as ContinuousTorque,
    CornerRounding as CornerRounding,
    Duration as Duration,
    EndVelocity as EndVelocity,
    FeedForward as FeedForward,
    JointAcceleration as JointAcceleration,
    JointJerk as JointJerk,
    JointLimit as JointLimit,
    JointPosition as JointPosition,
    JointVelocity as JointVelocity,
    Jump as Jump,
    LensClearance as LensClearance,
    Limit as Limit,
    MotorSpeed as MotorSpeed,
    MotorTorque as MotorTorque,
    NutContact as NutContact,
    OfPath as OfPath,
    PathDeparture as PathDeparture,
    RetinaClearance as RetinaClearance,
    RetinaDistance as RetinaDistance,
    SelfLocking as SelfLocking,
    SpeedLimit as SpeedLimit,
    StopTravel as StopTravel,
    TaskRange as TaskRange,
    TaskRate as TaskRate,
    TipSpeed as TipSpeed,
    ToolLimit as ToolLimit,
)
from .motion import (
    ALONE as ALONE,
    LARGEST_GRID as LARGEST_GRID,
    OF_TIP as OF_TIP,
    Dwell as Dwell,
    Follow as Follow,
    Free as Free,
    Joints as Joints,
    Motion as Motion,
    Motorisation as Motorisation,
    Point as Point,
    Scan as Scan,
    Straight as Straight,
    Stroke as Stroke,
    Task as Task,
    Tip as Tip,
    key_of as key_of,
)
from .motor import (
    Motor as Motor,
)
from .posterior import (
    CONFIDENCE as CONFIDENCE,
    LAW as LAW,
    LAWS as LAWS,
    LOAD_OFFSET as LOAD_OFFSET,
    Harmonics as Harmonics,
    Posterior as Posterior,
    Ripple as Ripple,
    interval_of as interval_of,
)
from .problem import (
    Eye as Eye,
    Lens as Lens,
    Objective as Objective,
    Problem as Problem,
    TaskLimits as TaskLimits,
)
from .robot import (
    JOINTS as JOINTS,
    SMALLEST_ANGLE as SMALLEST_ANGLE,
    Body as Body,
    Geometry as Geometry,
    Joint as Joint,
    Robot as Robot,
    possible as possible,
    principal_moments as principal_moments,
    read_only_array as read_only_array,
    unit_vector as unit_vector,
)
from .serialization import (
    plain as plain,
    problem_from_plain as problem_from_plain,
    robot_hash as robot_hash,
    robot_text as robot_text,
)
from .transmissions import (
    TRANSMISSIONS as TRANSMISSIONS,
    Transmission as Transmission,
)
from .value import (
    Ascending as Ascending,
    Bound as Bound,
    NotNegative as NotNegative,
    Quantity as Quantity,
    Shape as Shape,
    Value as Value,
    attributes as attributes,
    built as built,
    check_mapping as check_mapping,
    descriptions as descriptions,
    hints as hints,
    quantities as quantities,
    strip_annotations as strip_annotations,
    unchecked as unchecked,
)

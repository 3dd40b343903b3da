"""Public names of the package and the modules that define them."""

from .api import (
    check as check,
    check_speeds as check_speeds,
    compare as compare,
    controlled_stops as controlled_stops,
    report as report,
    size as size,
)
from .comparison.clock import Alignment as Alignment, Clock as Clock
from .comparison.compare import (
    AxisComparison as AxisComparison,
    Comparison as Comparison,
    Difference as Difference,
)
from .comparison.findings import Finding as Finding, Kept as Kept, Verdict as Verdict
from .comparison.tip import MeasuredTipError as MeasuredTipError
from .dynamics.robot_dynamics import (
    inverse_dynamics as inverse_dynamics,
    motor_torque as motor_torque,
)
from .errors import (
    ExportError as ExportError,
    GeometryError as GeometryError,
    ProblemError as ProblemError,
    RecordingError as RecordingError,
    SsmPlannerError as SsmPlannerError,
    TrajectoryError as TrajectoryError,
)
from .formats.epos4_setup import Axis as Axis
from .formats.export import export as export
from .formats.format import Format as Format
from .identification.design import (
    SessionDesign as SessionDesign,
    design_session as design_session,
)
from .identification.dynamic import DynamicFit as DynamicFit
from .identification.fit import Estimate as Estimate, MapFit as MapFit
from .identification.identify import (
    Identification as Identification,
    identify as identify,
    predict as predict,
)
from .identification.prediction import Prediction as Prediction, PredictionBand as PredictionBand
from .identification.recordings import Recording as Recording
from .identification.torque_map import TorqueMap as TorqueMap
from .kinematics.robot_kinematics import (
    JointSolutions as JointSolutions,
    ToolPose as ToolPose,
    Workspace as Workspace,
    fk as fk,
    ik as ik,
    jacobian as jacobian,
    workspace as workspace,
)
from .kinematics.workspace import (
    DesignRegion as DesignRegion,
    Extreme as Extreme,
    design_region as design_region,
)
from .loading.load import (
    Problem as Problem,
    load_controller as load_controller,
    load_drive as load_drive,
    load_motor as load_motor,
    load_problem as load_problem,
    load_robot as load_robot,
)
from .reproduction import Reproduction as Reproduction, reproduce as reproduce
from .pipeline.retime import retime as retime
from .pipeline.run import Replanner as Replanner, plan as plan
from .planning.reason import Reason as Reason
from .plans import (
    PhaseSummary as PhaseSummary,
    Plan as Plan,
    load_plan as load_plan,
)
from .problem.controller import (
    AxisController as AxisController,
    Controller as Controller,
    JointCompliance as JointCompliance,
)
from .problem.drive import (
    Drive as Drive,
    DriveKind as DriveKind,
    Friction as Friction,
    FrictionLawName as FrictionLawName,
    Gearhead as Gearhead,
    Ratings as Ratings,
    Rig as Rig,
    ScrewEnds as ScrewEnds,
)
from .problem.limits import (
    Limit as Limit,
    SpeedLimit as SpeedLimit,
    StopTravel as StopTravel,
    TaskRange as TaskRange,
    TaskRate as TaskRate,
    TipSpeed as TipSpeed,
    ToolLimit as ToolLimit,
)
from .problem.motion import (
    Dwell as Dwell,
    Follow as Follow,
    Free as Free,
    Joints as Joints,
    Line as Line,
    Motion as Motion,
    Point as Point,
    Scan as Scan,
    Straight as Straight,
    Task as Task,
    Tip as Tip,
)
from .problem.motor import Motor as Motor
from .problem.posterior import (
    Harmonics as Harmonics,
    Posterior as Posterior,
    Reaction as Reaction,
    Ripple as Ripple,
)
from .problem.problem import (
    Eye as Eye,
    Lens as Lens,
    Objective as Objective,
    Planner as Planner,
    Rates as Rates,
    TaskLimits as TaskLimits,
)
from .problem.robot import Body as Body, Geometry as Geometry, Joint as Joint, Robot as Robot
from .problem.transmissions import Dimensions as Dimensions, Transmission as Transmission
from .problem.value import (
    Coefficient as Coefficient,
    Count as Count,
    Current as Current,
    Delay as Delay,
    Interval as Interval,
    Length as Length,
    Mass as Mass,
    Matrix as Matrix,
    NotNegative as NotNegative,
    Position as Position,
    Positive as Positive,
    Share as Share,
    Sign as Sign,
    Speed as Speed,
    Time as Time,
    Torque as Torque,
    Vector as Vector,
)
from .progress import Progress as Progress, Step as Step
from .reporting.figures.film import film as film
from .simulation.draws import Draws as Draws
from .simulation.simulate import (
    MotorUse as MotorUse,
    PowerLosses as PowerLosses,
    Scenario as Scenario,
    SimulationResult as SimulationResult,
    Tracking as Tracking,
    simulate as simulate,
)
from .sizing.assess import MotorVerdict as MotorVerdict
from .sizing.checks import Check as Check
from .sizing.demand import Band as Band, DemandName as DemandName, Demands as Demands
from .sizing.heat_check import Heat as Heat
from .sizing.joint_load import JointLoad as JointLoad
from .sizing.motor_limits import Conditions as Conditions
from .sizing.requirements import (
    MotorRequirement as MotorRequirement,
    TorqueBreakdown as TorqueBreakdown,
)
from .sizing.size import JointSizing as JointSizing, Sizing as Sizing
from .sizing.thermal_network import Cycle as Cycle, ThermalModel as ThermalModel
from .sizing.tip_error import ErrorSource as ErrorSource, TipError as TipError
from .stopping import Stops as Stops
from .studies.audit import Audit as Audit, audit_study as audit_study
from .studies.run import StudyProgress as StudyProgress, StudyResult as StudyResult, study as study
from .studies.store import Candidate as Candidate, State as State
from .studies.study import (
    Choice as Choice,
    Design as Design,
    Requirements as Requirements,
    Search as Search,
    Study as Study,
    Variable as Variable,
    Varied as Varied,
)
from .studies.study_file import load_study as load_study
from .templates import schema as schema, template as template
from .trajectory import Samples as Samples, Side as Side, Span as Span, Trajectory as Trajectory
from .typing import (
    Array as Array,
    Fields as Fields,
    Indices as Indices,
    JsonObject as JsonObject,
    Mask as Mask,
    Numbers as Numbers,
    Range as Range,
)
from .units import deg as deg, mm as mm, mNm as mNm, ms as ms, rpm as rpm
from .verification.certificate import (
    Certificate as Certificate,
    LimitCheck as LimitCheck,
    Unjudged as Unjudged,
)
from .verification.path_bound import Sensitivity as Sensitivity
from .verification.proof import Proof as Proof, prove as prove
from .verification.second_opinion import Opinion as Opinion
from .verification.slower import SpeedRange as SpeedRange, WorstSpeed as WorstSpeed
from .view.server import ViewServer as ViewServer, serve_view as serve_view

__version__: str

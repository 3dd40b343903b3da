"""Planning, verification and export for serial spherical mechanisms with self-locking drives.

The names in `__all__` are what is public; each is loaded when it is first used, so that importing the package is instant.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ssm_planner.api import check, check_speeds, compare, controlled_stops, report, size
    from ssm_planner.comparison.clock import Alignment, Clock
    from ssm_planner.comparison.compare import AxisComparison, Comparison, Difference
    from ssm_planner.comparison.findings import Finding, Kept, Verdict
    from ssm_planner.errors import (
        ExportError,
        GeometryError,
        ProblemError,
        RecordingError,
        SsmPlannerError,
        TrajectoryError,
    )
    from ssm_planner.formats.epos4_setup import Axis
    from ssm_planner.formats.export import export
    from ssm_planner.identification.dynamic import DynamicFit
    from ssm_planner.identification.fit import Estimate, MapFit
    from ssm_planner.identification.identify import Identification, identify, predict
    from ssm_planner.identification.prediction import Prediction, PredictionBand
    from ssm_planner.identification.recordings import Recording
    from ssm_planner.identification.torque_map import TorqueMap
    from ssm_planner.kinematics.of_robot import (
        JointSolutions,
        ToolPose,
        Workspace,
        fk,
        ik,
        workspace,
    )
    from ssm_planner.kinematics.workspace import DesignRegion, Extreme, design_region
    from ssm_planner.loading.load import (
        Problem,
        load_controller,
        load_drive,
        load_motor,
        load_problem,
        load_robot,
    )
    from ssm_planner.pipeline.folder import Plan, load_plan
    from ssm_planner.pipeline.run import Progress, Replanner, plan
    from ssm_planner.planning.reason import Reason
    from ssm_planner.plans import PhaseSummary
    from ssm_planner.problem.controller import AxisController, Controller, JointCompliance
    from ssm_planner.problem.drive import (
        Drive,
        DriveKind,
        Friction,
        FrictionLawName,
        Ratings,
        Rig,
        ScrewEnds,
    )
    from ssm_planner.problem.limits import (
        Limit,
        SpeedLimit,
        StopTravel,
        TaskRange,
        TaskRate,
        TipSpeed,
        ToolLimit,
    )
    from ssm_planner.problem.motion import (
        Dwell,
        Follow,
        Free,
        Joints,
        Line,
        Motion,
        Point,
        Scan,
        Straight,
        Task,
        Tip,
    )
    from ssm_planner.problem.motor import Motor
    from ssm_planner.problem.posterior import Harmonics, Posterior, Ripple
    from ssm_planner.problem.problem import Eye, Lens, Objective, Planner, TaskLimits
    from ssm_planner.problem.robot import Body, Geometry, Joint, Robot
    from ssm_planner.problem.value import (
        Count,
        Interval,
        Matrix,
        NotNegative,
        Positive,
        Sign,
        Vector,
    )
    from ssm_planner.simulation.draws import Draws
    from ssm_planner.simulation.simulate import (
        MotorUse,
        PowerLosses,
        Scenario,
        SimulationResult,
        Tracking,
        simulate,
    )
    from ssm_planner.sizing.assess import MotorVerdict
    from ssm_planner.sizing.checks import Check
    from ssm_planner.sizing.demand import Band, DemandName, Demands
    from ssm_planner.sizing.heat_check import Heat
    from ssm_planner.sizing.joint_load import JointLoad
    from ssm_planner.sizing.motor_limits import Conditions
    from ssm_planner.sizing.requirements import MotorRequirement, TorqueBreakdown
    from ssm_planner.sizing.size import JointSizing, Sizing
    from ssm_planner.sizing.thermal_network import Cycle, ThermalModel
    from ssm_planner.stopping import Stops
    from ssm_planner.studies.run import StudyProgress, StudyResult, study
    from ssm_planner.studies.store import Candidate, State
    from ssm_planner.studies.study import (
        Choice,
        Design,
        Requirements,
        Search,
        Study,
        Variable,
        Varied,
    )
    from ssm_planner.studies.study_file import load_study
    from ssm_planner.trajectory import Samples, Side, Span, Trajectory
    from ssm_planner.typing import Array, Indices, Mask, Range
    from ssm_planner.units import deg, mm, mNm, ms, rpm
    from ssm_planner.verification.certificate import Certificate, LimitCheck
    from ssm_planner.verification.slower import SpeedRange, WorstSpeed

__all__ = [
    "Alignment", "Array", "Axis", "AxisComparison", "AxisController", "Band", "Body", "Candidate", "Certificate",
    "Check", "Choice", "Clock", "Comparison", "Conditions", "Controller", "Count", "Cycle", "DemandName", "Demands",
    "Design", "DesignRegion", "Difference", "Draws", "Drive", "DriveKind", "Dwell", "DynamicFit", "Estimate",
    "ExportError", "Extreme", "Eye", "Finding", "Follow", "Free", "Friction", "FrictionLawName", "Geometry", "GeometryError",
    "Harmonics", "Heat", "Identification", "Indices", "Interval", "Joint", "JointCompliance", "JointLoad",
    "JointSizing", "JointSolutions", "Joints", "Kept", "Lens", "Limit", "LimitCheck", "Line", "MapFit", "Mask",
    "Matrix", "Motion", "Motor", "MotorRequirement", "MotorUse", "MotorVerdict", "NotNegative", "Objective",
    "PhaseSummary", "Plan", "Planner", "Point", "Positive", "Posterior", "PowerLosses", "Prediction",
    "PredictionBand", "Problem", "ProblemError", "Progress", "Range", "Ratings", "Reason", "Recording",
    "RecordingError", "Replanner", "Requirements", "Rig", "Ripple", "Robot", "Samples", "Scan", "Scenario", "ScrewEnds",
    "Search", "Side", "Sign", "SimulationResult", "Sizing", "Span", "SpeedLimit", "SpeedRange", "SsmPlannerError", "State",
    "StopTravel", "Stops", "Straight", "Study", "StudyProgress", "StudyResult", "Task", "TaskLimits", "TaskRange",
    "TaskRate", "ThermalModel", "Tip", "TipSpeed", "ToolLimit", "ToolPose", "TorqueBreakdown", "TorqueMap",
    "Tracking", "Trajectory", "TrajectoryError", "Variable", "Varied", "Vector", "Verdict", "Workspace", "WorstSpeed",
    "check", "check_speeds", "compare", "controlled_stops", "deg", "design_region", "export", "fk", "identify", "ik",
    "load_controller", "load_drive", "load_motor", "load_plan", "load_problem", "load_robot", "load_study", "mNm",
    "mm", "ms", "plan", "predict", "report", "rpm", "simulate", "size", "study", "workspace",
]  # fmt: skip

_HOMES = {
    name: module
    for module, names in {
        "ssm_planner.api": "check compare report size check_speeds controlled_stops",
        "ssm_planner.comparison.clock": "Alignment Clock",
        "ssm_planner.comparison.compare": "AxisComparison Comparison Difference",
        "ssm_planner.comparison.findings": "Finding Kept Verdict",
        "ssm_planner.errors": "ExportError GeometryError ProblemError RecordingError SsmPlannerError TrajectoryError",
        "ssm_planner.formats.export": "export",
        "ssm_planner.identification.dynamic": "DynamicFit",
        "ssm_planner.identification.fit": "Estimate MapFit",
        "ssm_planner.identification.identify": "Identification identify predict",
        "ssm_planner.identification.prediction": "Prediction PredictionBand",
        "ssm_planner.identification.recordings": "Recording",
        "ssm_planner.identification.torque_map": "TorqueMap",
        "ssm_planner.kinematics.of_robot": "JointSolutions ToolPose Workspace fk ik workspace",
        "ssm_planner.kinematics.workspace": "DesignRegion Extreme design_region",
        "ssm_planner.loading.load": "Problem load_drive load_motor load_problem load_robot load_controller",
        "ssm_planner.pipeline.folder": "Plan load_plan",
        "ssm_planner.pipeline.run": "Progress Replanner plan",
        "ssm_planner.planning.reason": "Reason",
        "ssm_planner.plans": "PhaseSummary",
        "ssm_planner.problem.drive": "Drive DriveKind Friction FrictionLawName Ratings Rig ScrewEnds",
        "ssm_planner.problem.limits": "Limit SpeedLimit StopTravel TaskRange TaskRate TipSpeed ToolLimit",
        "ssm_planner.problem.motion": "Dwell Follow Free Joints Line Motion Point Scan Straight Task Tip",
        "ssm_planner.problem.motor": "Motor",
        "ssm_planner.problem.posterior": "Harmonics Posterior Ripple",
        "ssm_planner.problem.problem": "Eye Lens Objective Planner TaskLimits",
        "ssm_planner.problem.robot": "Body Geometry Joint Robot",
        "ssm_planner.problem.value": "Count Interval Matrix NotNegative Positive Sign Vector",
        "ssm_planner.sizing.assess": "MotorVerdict",
        "ssm_planner.sizing.checks": "Check",
        "ssm_planner.sizing.demand": "Band DemandName Demands",
        "ssm_planner.sizing.heat_check": "Heat",
        "ssm_planner.sizing.joint_load": "JointLoad",
        "ssm_planner.sizing.motor_limits": "Conditions",
        "ssm_planner.sizing.requirements": "MotorRequirement TorqueBreakdown",
        "ssm_planner.sizing.size": "JointSizing Sizing",
        "ssm_planner.sizing.thermal_network": "Cycle ThermalModel",
        "ssm_planner.studies.run": "StudyProgress StudyResult study",
        "ssm_planner.studies.store": "Candidate State",
        "ssm_planner.studies.study": "Choice Design Requirements Search Study Variable Varied",
        "ssm_planner.studies.study_file": "load_study",
        "ssm_planner.formats.epos4_setup": "Axis",
        "ssm_planner.problem.controller": "AxisController Controller JointCompliance",
        "ssm_planner.simulation.simulate": "MotorUse PowerLosses Scenario SimulationResult Tracking simulate",
        "ssm_planner.stopping": "Stops",
        "ssm_planner.verification.slower": "SpeedRange WorstSpeed",
        "ssm_planner.simulation.draws": "Draws",
        "ssm_planner.trajectory": "Samples Side Span Trajectory",
        "ssm_planner.typing": "Array Indices Range Mask",
        "ssm_planner.units": "deg mNm mm ms rpm",
        "ssm_planner.verification.certificate": "Certificate LimitCheck",
    }.items()
    for name in names.split()
}
"""No module of the package may have one of these names: importing it would put the module in the function's place."""


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("importlib.metadata").version("ssm-planner")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return list(__all__)

"""The resolved values of a problem: SI floats and radians, frozen, arrays read-only.

`load.py` makes them from YAML; every later stage takes them as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ssm_planner.problem.rig import Rig

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Range = tuple[float, float]

JOINTS = ("roll", "tilt", "spin", "insertion")
"""Names by which limits and results speak of joints 1 to 4."""

TASK = ("roll", "tilt", "spin", "depth")
"""Order of the task coordinates in every array."""


def frozen(value: object, shape: tuple[int, ...]) -> Array:
    """A read-only float array of the given shape."""
    array = np.array(value, dtype=float).reshape(shape)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Geometry:
    """Axes of the mechanism in the base frame at q = 0 (paper, eq. 1); unit vectors, shape (3,)."""

    omega1: Array
    omega2: Array
    omega3: Array
    tool_home: Array
    """R_0, (3, 3), base ← tool at q = 0; its z column is omega3."""
    insertion_sign: int = -1
    """depth = insertion_sign · θ4."""


@dataclass(frozen=True, eq=False)
class Body:
    """Inertial data of one moving body, in its own frame at the RCM."""

    name: str
    mass: float
    com: Array
    """Centre of mass in the body frame, m, (3,)."""
    inertia: Array
    """Inertia tensor about the body frame's origin, kg·m², (3, 3), products with the tensor's sign (−∫xy dm)."""
    frame: Array
    """Rotation base ← body at q = 0, (3, 3)."""


FrictionLawName = Literal["coulomb", "stribeck_exponential", "stribeck_gaussian"]


@dataclass(frozen=True)
class Friction:
    """Friction of one drive, motor side unless said otherwise (physics of the mesh: model/transmission.py).

    μ(w) = mu + mu_stribeck · s(|w| / stribeck_speed), s = 0, exp(−2x) or exp(−x²) by law; μ at rest is mu_static.
    """

    mu: float
    """Kinetic (Coulomb) coefficient of the mesh."""
    mu_static: float
    """Coefficient at breakaway."""
    b_c: float
    """Bearing Coulomb torque, N·m."""
    b_v: float
    """Bearing viscous coefficient, N·m·s/rad."""
    b_oc: float = 0.0
    """Output Coulomb effort, N·m (worm) or N (screw)."""
    b_ov: float = 0.0
    """Output viscous coefficient, N·m·s/rad or N·s/m."""
    law: FrictionLawName = "coulomb"
    mu_stribeck: float = 0.0
    stribeck_speed: float | None = None
    """Motor speed w_s of the Stribeck term, rad/s."""
    dwell_constant: float | None = None
    """c of mu_static growing as exp(−c / t_dwell), s; None: fully grown at once."""
    memory: float = 0.0
    """Frictional memory: delay of w in μ(w), s."""
    mu_lowest: float | None = None
    """Lowest plausible mu (lubrication, temperature); the self-locking margin is reported there too."""
    identified_speed: float | None = None
    """Largest motor speed in the data behind the parameters, rad/s; beyond it friction is extrapolated."""
    covariance: Mapping[str, Mapping[str, float]] | None = None
    source: str | None = None


DriveKind = Literal["worm", "lead_screw", "antibacklash_screw"]
ScrewEnds = Literal["fixed-free", "supported-supported", "fixed-supported", "fixed-fixed"]


@dataclass(frozen=True)
class Ratings:
    """What the manufacturer of a gear or screw allows; None where the file gives nothing."""

    continuous_output: float | None = None
    """Output effort for all time, N·m (worm) or N (screws)."""
    peak_output: float | None = None
    """Output effort at any instant."""
    input_speed: float | None = None
    """Motor speed, rad/s."""
    duty: float | None = None
    """Largest share of time in motion."""
    free_length: float | None = None
    """Unsupported length of a screw, m."""
    root_diameter: float | None = None
    """Core diameter of a screw, m."""
    ends: ScrewEnds | None = None


@dataclass(frozen=True)
class Drive:
    """A self-locking transmission, geometry resolved: w = ratio · qd."""

    name: str
    kind: DriveKind
    ratio: float
    """Motor angle per joint coordinate: 1 (worm) or rad/m (screws)."""
    gamma: float
    """Effort arm γ: d_worm / d_wheel (worm) or d_screw / 2 in m (screws)."""
    lead_angle: float
    """λ, rad."""
    pressure_angle: float
    """Normal pressure angle θ_n, rad."""
    input_inertia: float
    """Inertia on the motor shaft, rotor included, kg·m²."""
    output_inertia: float
    """Inertia of the output side that is not in the bodies, kg·m² (worm) or kg (screws)."""
    friction: Friction | None
    """None only where rig is given: friction still to be identified. Drives of a robot always have friction."""
    preload: float = 0.0
    """Spring force between the half nuts of an antibacklash screw, N."""
    second_nut_mass: float = 0.0
    self_locking: bool = True
    """The robot relies on this drive holding without torque."""
    dimensions: Mapping[str, float] = field(default_factory=dict)
    """The geometry as written, SI, for reports."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """Where each figure comes from, by its key in the file."""
    placeholders: tuple[str, ...] = ()
    """Names of the figures that stand in for unknown ones; sources says why."""
    rig: Rig | None = None
    """Present for a drive on a test rig."""
    file: str | None = None
    ratings: Ratings | None = None
    friction_ranges: Mapping[str, Range] = field(default_factory=dict)
    """What lubrication, temperature and wear may make of friction parameters, by their names in Friction."""


@dataclass(frozen=True)
class Motor:
    """A motor's datasheet figures; None where the file gives none."""

    name: str
    nominal_torque: float
    """Continuous torque, N·m."""
    max_torque: float
    """Largest usable torque, N·m: what a plan may use at any instant."""
    max_speed: float
    """rad/s."""
    nominal_voltage: float | None = None
    nominal_current: float | None = None
    torque_constant: float | None = None
    terminal_resistance: float | None = None
    rotor_inertia: float | None = None
    resistance_winding_housing: float | None = None
    resistance_housing_ambient: float | None = None
    time_constant_winding: float | None = None
    time_constant_motor: float | None = None
    max_winding_temperature: float | None = None
    """K."""
    torque_constant_per_kelvin: float | None = None
    """Relative change of the torque constant with the magnets' temperature, 1/K, negative."""
    encoder_counts: int | None = None
    sources: Mapping[str, str] = field(default_factory=dict)
    placeholders: tuple[str, ...] = ()
    """Names of the figures that nobody could source for this motor; sources says what stands in and why."""
    file: str | None = None

    @property
    def placeholder(self) -> bool:
        return bool(self.placeholders)


@dataclass(frozen=True)
class Joint:
    """Limits and actuation of one joint; rad or m and their time derivatives."""

    name: str
    kind: Literal["revolute", "prismatic"]
    position: Range
    velocity: float
    acceleration: float
    jerk: float | None = None
    drive: Drive | None = None
    motor: Motor | None = None
    motor_direction: Literal[-1, 1] = 1
    """Sense in which the motor's controller counts when the joint moves forward."""


@dataclass(frozen=True, eq=False)
class Robot:
    name: str
    geometry: Geometry
    bodies: tuple[Body, Body, Body, Body]
    joints: tuple[Joint, Joint, Joint, Joint]
    gravity: Array
    """Acceleration of gravity in the base frame, m/s², (3,)."""
    limits: Mapping[str, Range] = field(default_factory=dict)
    """Ranges of task coordinates that the robot itself declares, by name in TASK."""
    file: str | None = None


@dataclass(frozen=True, eq=False)
class Target:
    """One point of a motion: any subset of task coordinates (the rest held), joint values, or a tip position."""

    task: Mapping[str, float] | None = None
    joints: tuple[float, float, float, float] | None = None
    tip: tuple[float, float, float] | None = None
    spin: float | None = None
    """Used with tip."""
    line: int | None = None
    """Line of the problem file, for messages."""


@dataclass(frozen=True, eq=False)
class Lens:
    """An ellipsoid that the shaft keeps clear of, base frame, m."""

    centre: Array
    """(3,)."""
    semi_axes: Array
    """(3,), along the columns of `frame`."""
    frame: Array
    """(3, 3), rotation base ← lens."""


@dataclass(frozen=True, eq=False)
class Eye:
    """The eye about the remote centre, base frame, m: the retina as a sphere, and the lens where there is one."""

    centre: Array
    """(3,)."""
    radius: float
    clearance: float
    """Least distance of the tip from the retina."""
    port: float
    """Within this distance of the remote centre there is no retina: the incision itself."""
    shaft_radius: float = 0.0
    """Added around the shaft where it passes the lens."""
    lens: Lens | None = None


@dataclass(frozen=True, eq=False)
class TaskLimits:
    """Limits on where the tool is and how fast it goes, beside those of the joints."""

    ranges: Mapping[str, Range] = field(default_factory=dict)
    """By name in TASK, rad or m."""
    tip_speed: float | None = None
    """m/s."""
    rates: Mapping[str, float] = field(default_factory=dict)
    """Largest |rate| of task coordinates by name in TASK, rad/s or m/s."""
    eye: Eye | None = None


@dataclass(frozen=True)
class Scan:
    """Spots on the retina: a raster, or rings one after the other, about the point where the tool's axis meets it."""

    diameters: tuple[float, ...]
    """Of the rings, m; none for a raster."""
    rows: int
    columns: int
    """Of a raster."""
    spacing: float
    """Between neighbouring spots, m; on a ring as nearly as a whole number of spots allows."""
    distance: float
    """Of the tip from the retina, m."""
    dwell: float
    """At every spot, s; 0: the spots are passed without stopping."""


MotionKind = Literal["straight", "free", "dwell", "scan"]


@dataclass(frozen=True, eq=False)
class Motion:
    """One entry of the motion list."""

    kind: MotionKind
    name: str
    """The key in the file: tilt, roll, spin, insert, straight, free, dwell."""
    target: Target | None = None
    duration: float | None = None
    """Of a dwell; of another motion where it is asked for, s."""
    line: int | None = None
    through: tuple[Target, ...] = ()
    """Points that a free motion passes without stopping, in order, before its target."""
    scan: Scan | None = None
    """Its target is the task coordinates at which the tool points to the middle of the pattern."""


Objective = Literal["time", "time then heat", "effort"]
Planner = Literal["optimal", "toppra"]


@dataclass(frozen=True, eq=False)
class Problem:
    name: str
    robot: Robot
    start: Target
    motion: tuple[Motion, ...]
    limits: Mapping[str, Range] = field(default_factory=dict)
    """Ranges of task coordinates, by name in TASK: the robot's, narrowed by the problem's."""
    tip_speed: float | None = None
    objective: Objective = "time then heat"
    file: str | None = None
    rates: Mapping[str, float] = field(default_factory=dict)
    """Largest |rate| of task coordinates by name in TASK, rad/s or m/s."""
    eye: Eye | None = None
    start_rate: Mapping[str, float] = field(default_factory=dict)
    """Rates of task coordinates at the very start, by name in TASK; 0 where not named."""
    end_rate: Mapping[str, float] = field(default_factory=dict)
    duration: float | None = None
    """Of everything together where it is asked for, s."""
    planner: Planner = "optimal"
    """"toppra": straight motions timed by TOPP-RA alone, several times faster; without jerk limits."""

    @property
    def task_limits(self) -> TaskLimits:
        return TaskLimits(self.limits, self.tip_speed, self.rates, self.eye)

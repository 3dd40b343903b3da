"""Drives as frozen values: geometry of worm or screw, friction, ratings, test rig. SI floats and radians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from ssm_planner.typing import Range


@dataclass(frozen=True)
class Rig:
    """Payload of a rig and the meaning of its recorded channels; SI."""

    payload_mass: float
    """kg, moved by the output; 0 without payload."""
    motor_nominal_torque: float
    """N·m; a recorder gives torque in percent of it."""
    payload_arm: float | None = None
    """Radius of the pulley that the payload hangs from, m (worm); None where it hangs on the nut itself (screws)."""
    payload_direction: Literal[-1, 1] = 1
    """+1: gravity pulls the output towards positive motion."""
    gravity: float = 9.81
    """m/s², positive."""
    direction: Literal[-1, 1] = 1
    """The rig's positive motion and torque are direction times the recorded channels."""
    published: Mapping[str, float] = field(default_factory=dict)
    """Parameters that others published for this drive, by name in Friction (and preload), SI: for comparison, and the
    reference nearest to which identification settles what its data leave open (it then says so)."""

    @property
    def F_payload(self) -> float:
        """Part of the output effort F that the payload's weight adds, N·m (worm) or N (screw): positive opposes
        positive motion."""
        return -self.payload_direction * self.payload_mass * self.gravity * (self.payload_arm or 1.0)

    @property
    def payload_inertia(self) -> float:
        """What the payload adds to the drive's output inertia, kg·m² (worm) or kg (screw)."""
        return self.payload_mass * (self.payload_arm or 1.0) ** 2


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

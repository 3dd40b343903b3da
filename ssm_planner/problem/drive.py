"""Drives as frozen values: geometry of worm or screw, friction, ratings, test rig. SI floats and radians."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal, get_args

from ssm_planner.problem.posterior import Posterior
from ssm_planner.problem.value import Names, NotNegative, Positive, Quantity, Sign, Value

LARGEST_LEAD_ANGLE = math.radians(60)
LARGEST_THREAD_ANGLE = math.radians(120)
RANGED = ("mu", "mu_static", "b_c", "b_v", "b_oc", "b_ov")
PARAMETERS = (
    "mu",
    "mu_static",
    "mu_stribeck",
    "stribeck_speed",
    "b_c",
    "b_v",
    "b_oc",
    "b_ov",
    "dwell_constant",
    "memory",
)


@dataclass(frozen=True, eq=False)
class Rig(Value):
    """Payload of a rig and the meaning of its recorded channels; SI."""

    payload_mass: Annotated[NotNegative, Quantity("mass")]
    """kg, moved by the output; 0 without payload."""
    motor_nominal_torque: Annotated[Positive, Quantity("torque")]
    """N·m; a recorder gives torque in percent of it."""
    payload_arm: Annotated[Positive, Quantity("length")] | None = None
    """Radius of the pulley that the payload hangs from, m (worm); None where it hangs on the nut itself (screws)."""
    payload_direction: Sign = 1
    """+1: gravity pulls the output towards positive motion."""
    gravity: Annotated[Positive, Quantity("acceleration")] = 9.81
    """m/s², positive."""
    direction: Sign = 1
    """The rig's positive motion and torque are direction times the recorded channels."""
    load_offset: Annotated[float, Quantity("torque", "force")] = 0.0
    """Constant effort beside the payload that an identification found, N·m (worm) or N (screw); positive opposes positive
    motion."""
    published: Annotated[Mapping[str, NotNegative], Names((*PARAMETERS, "preload"))] = field(
        default_factory=dict
    )
    """Parameters that others published for this drive, by name in Friction (and preload), SI: for comparison, and the
    reference nearest to which identification settles what its data leave open (it then says so)."""

    @property
    def F_payload(self) -> float:
        """Part of the output effort F that the payload's weight adds, N·m (worm) or N (screw): positive opposes
        positive motion."""
        return (
            -self.payload_direction * self.payload_mass * self.gravity * (self.payload_arm or 1.0)
        )

    @property
    def load(self) -> float:
        """Constant output effort of the rig: payload and load_offset, N·m or N."""
        return self.F_payload + self.load_offset

    @property
    def payload_inertia(self) -> float:
        """What the payload adds to the drive's output inertia, kg·m² (worm) or kg (screw)."""
        return self.payload_mass * (self.payload_arm or 1.0) ** 2


FrictionLawName = Literal["coulomb", "stribeck_exponential", "stribeck_gaussian"]


@dataclass(frozen=True, eq=False)
class Friction(Value):
    """Friction of one drive, motor side unless said otherwise (physics of the mesh: dynamics/transmission.py).

    μ(w) = mu + mu_stribeck · s(|w| / stribeck_speed), s = 0, exp(−2x) or exp(−x²) by law; μ at rest is mu_static.
    """

    mu: Annotated[NotNegative, Quantity("number")]
    """Kinetic (Coulomb) coefficient of the mesh."""
    mu_static: Annotated[NotNegative, Quantity("number")]
    """Coefficient at breakaway."""
    b_c: Annotated[NotNegative, Quantity("torque")]
    """Bearing Coulomb torque, N·m."""
    b_v: Annotated[NotNegative, Quantity("rotary_viscosity")]
    """Bearing viscous coefficient, N·m·s/rad."""
    b_oc: Annotated[NotNegative, Quantity("torque", "force")] = 0.0
    """Output Coulomb effort, N·m (worm) or N (screw)."""
    b_ov: Annotated[NotNegative, Quantity("rotary_viscosity", "linear_viscosity")] = 0.0
    """Output viscous coefficient, N·m·s/rad or N·s/m."""
    law: FrictionLawName = "coulomb"
    """How the coefficient depends on speed."""
    mu_stribeck: Annotated[NotNegative, Quantity("number")] = 0.0
    """What the coefficient of the Stribeck laws has beyond mu at low speed."""
    stribeck_speed: Annotated[Positive, Quantity("motor_speed")] | None = None
    """Motor speed w_s of the Stribeck term, rad/s."""
    dwell_constant: Annotated[NotNegative, Quantity("time")] | None = None
    """c of mu_static growing as exp(−c / t_dwell), s; None: fully grown at once."""
    memory: Annotated[NotNegative, Quantity("time")] = 0.0
    """Frictional memory: delay of w in μ(w), s."""
    mu_lowest: Annotated[NotNegative, Quantity("number")] | None = None
    """Lowest plausible mu (lubrication, temperature); the self-locking margin is reported there too."""
    identified_speed: Annotated[Positive, Quantity("motor_speed")] | None = None
    """Largest motor speed in the data behind the parameters, rad/s; beyond it friction is extrapolated."""
    covariance: Mapping[str, Mapping[str, float]] | None = None
    """Of the parameters, as a user states it; SI."""
    posterior: Posterior | None = None
    """What an identification leaves open; then there is no covariance."""
    source: str | None = None
    """Where the parameters come from."""

    def _check(self) -> None:
        if self.mu_static < self.mu:
            raise self._wrong("mu_static", "smaller than mu", f"at least mu = {self.mu:g}")
        if self.mu_lowest is not None and self.mu_lowest > self.mu:
            raise self._wrong("mu_lowest", "larger than mu", f"at most mu = {self.mu:g}")
        if self.law != "coulomb" and self.stribeck_speed is None:
            raise self._wrong(
                "law",
                "this law needs mu_stribeck and stribeck_speed",
                "both of them, or law: coulomb",
            )
        if self.covariance is not None and self.posterior is not None:
            raise self._wrong(
                "covariance", "the posterior says it already", "one of the two", "both"
            )
        for name, unused in (("mu_stribeck", 0.0), ("stribeck_speed", None)):
            if self.law == "coulomb" and getattr(self, name) != unused:
                raise self._wrong(
                    name, "not a parameter of the coulomb law", "law: stribeck_exponential or …"
                )


ThreadKind = Literal["worm", "lead_screw", "antibacklash_screw"]
EfficientKind = Literal["direct", "gear", "belt", "cable", "ball_screw", "cable_slide"]
DriveKind = Literal[ThreadKind, EfficientKind]
TURNING: tuple[DriveKind, ...] = ("worm", "direct", "gear", "belt", "cable")
"""Kinds whose output turns; that of the others slides."""
WEDGE = math.radians(45)
"""Lead angle of the thread that stands for a drive with efficiencies (dynamics/transmission.of_efficiencies)."""
ScrewEnds = Literal["fixed-free", "supported-supported", "fixed-supported", "fixed-fixed"]


@dataclass(frozen=True, eq=False)
class Ratings(Value):
    """What the manufacturer of a gear or screw allows; None where the file gives nothing."""

    continuous_output: Annotated[Positive, Quantity("torque", "force")] | None = None
    """Output effort for all time, N·m (worm) or N (screws)."""
    peak_output: Annotated[Positive, Quantity("torque", "force")] | None = None
    """Output effort at any instant."""
    input_speed: Annotated[Positive, Quantity("motor_speed")] | None = None
    """Motor speed, rad/s."""
    duty: Annotated[Positive, Quantity("number")] | None = None
    """Largest share of time in motion."""
    free_length: Annotated[Positive, Quantity("length")] | None = None
    """Unsupported length of a screw, m."""
    root_diameter: Annotated[Positive, Quantity("length")] | None = None
    """Core diameter of a screw, m."""
    ends: ScrewEnds | None = None
    """How the screw is held, for buckling and critical speed."""

    def _check(self) -> None:
        continuous, peak = self.continuous_output, self.peak_output
        if continuous is not None and peak is not None and peak < continuous:
            raise self._wrong(
                "peak_output", "smaller than continuous_output", f"at least {continuous:g} in SI"
            )
        if self.duty is not None and self.duty > 1:
            raise self._wrong("duty", "more than all of the time", "a share above 0 and up to 1")
        length, diameter = self.free_length, self.root_diameter
        if length is not None and diameter is not None and diameter > length:
            raise self._wrong(
                "root_diameter", "thicker than long: is the unit right?", "less than free_length"
            )


@dataclass(frozen=True, eq=False)
class Drive(Value):
    """A transmission, geometry resolved: w = ratio · qd."""

    name: str
    """Such as the manufacturer's designation."""
    kind: DriveKind
    """Worm gear, or a screw with one nut or with two that a spring presses apart; or a drive with efficiencies."""
    ratio: Positive
    """Motor angle per joint coordinate: 1 (where the output turns) or rad/m (where it slides)."""
    gamma: Positive
    """Effort arm γ: d_worm / d_wheel (worm) or d_screw / 2 in m (screws); of efficiencies: dynamics/transmission.py."""
    lead_angle: Positive
    """λ, rad."""
    pressure_angle: Positive
    """Normal pressure angle θ_n, rad."""
    input_inertia: Annotated[NotNegative, Quantity("inertia")]
    """Inertia on the motor shaft, rotor included, kg·m²."""
    output_inertia: Annotated[NotNegative, Quantity("inertia", "mass")]
    """Inertia of the output side that is not in the bodies, kg·m² (worm) or kg (screws)."""
    friction: Friction | None
    """None only where rig is given: friction still to be identified. Drives of a robot always have friction."""
    preload: Annotated[NotNegative, Quantity("force")] = 0.0
    """Spring force between the half nuts of an antibacklash screw, N."""
    second_nut_mass: Annotated[NotNegative, Quantity("mass")] = 0.0
    """Of the half nut that the spring carries, kg."""
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
    file: str | None = field(default=None, compare=False)
    ratings: Ratings | None = None
    """What the manufacturer allows; without it gears are not judged."""
    friction_ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """What lubrication, temperature and wear may make of friction parameters, by their names in Friction."""

    @property
    def lead_slope(self) -> float:
        """tan λ."""
        return math.tan(self.lead_angle)

    @property
    def wedging(self) -> float:
        """1 / cos θ_n: tan of the friction angle per μ."""
        return 1.0 / math.cos(self.pressure_angle)

    @property
    def slides(self) -> bool:
        """The output slides."""
        return self.kind not in TURNING

    @property
    def threaded(self) -> bool:
        """A worm or a screw whose thread slides: it may lock itself."""
        return self.kind in get_args(ThreadKind)

    def _check(self) -> None:
        if not self.threaded and self.self_locking:
            raise self._wrong(
                "self_locking", f"a {self.kind} drive does not lock itself", "False", "True"
            )
        if not self.lead_angle < LARGEST_LEAD_ANGLE:
            raise self._wrong("lead_angle", "implausible", "above 0 and below 60 deg, in rad")
        if not self.pressure_angle < LARGEST_THREAD_ANGLE / 2:
            raise self._wrong("pressure_angle", "implausible", "above 0 and below 60 deg, in rad")
        if self.friction is None and self.rig is None:
            raise self._wrong(
                "friction",
                "missing: only a drive with a rig may leave it to be identified",
                "a Friction",
                "None",
            )
        for name in ("preload", "second_nut_mass"):
            if self.kind != "antibacklash_screw" and getattr(self, name) > 0:
                raise self._wrong(
                    name,
                    f"a {self.kind} has one nut or wheel only",
                    "0, or kind antibacklash_screw",
                )
        self._check_ranges()

    def _check_ranges(self) -> None:
        """Every range holds the parameter's own value."""
        for name, (low, high) in self.friction_ranges.items():
            field = f"friction_ranges.{name}"
            if name not in RANGED:
                raise self._wrong(field, "unknown parameter", ", ".join(RANGED), name)
            if self.friction is None:
                raise self._wrong(
                    field,
                    "a range of a friction that is still to be identified",
                    "no range",
                    (low, high),
                )
            value = getattr(self.friction, name)
            if low < 0:
                raise self._wrong(
                    field, "friction is not negative", "[lower, upper], from 0", (low, high)
                )
            if not low <= value <= high:
                reason = f"does not hold the value of {name} itself, {value:g} in SI"
                raise self._wrong(field, reason, "a range around it", (low, high))

    def check_locking(self) -> None:
        """Raises ProblemError where φ_f = atan(μ/cos θ_n) ≤ λ, so that the load drives the motor, or where the gear jams.

        Values at rest do not count: they can be shaken off. A drive made in Python may fail: the planner then says so.
        """
        friction = self.friction
        if friction is None:
            return
        lowest, field = friction.mu, "friction.mu"
        if friction.mu_lowest is not None:
            lowest, field = friction.mu_lowest, "friction.mu_lowest"
        if self.friction_ranges.get("mu", (lowest,))[0] < lowest:
            lowest, field = self.friction_ranges["mu"][0], "friction_ranges.mu"
        repose = math.atan(lowest / math.cos(self.pressure_angle))
        if self.self_locking and repose <= self.lead_angle:
            needed = math.tan(self.lead_angle) * math.cos(self.pressure_angle)
            raise self._wrong(
                field,
                f"the drive does not lock itself: lead angle λ = {math.degrees(self.lead_angle):.4g} deg, "
                f"friction angle φ_f = {math.degrees(repose):.4g} deg, and φ_f must be larger",
                f"mu above {needed:.4g}, or self_locking: not required",
                lowest,
            )
        highest = max(friction.mu_static, friction.mu + friction.mu_stribeck)
        if self.lead_angle + math.atan(highest / math.cos(self.pressure_angle)) >= math.pi / 2:
            raise self._wrong(
                "friction",
                "with this lead angle and friction the gear jams: λ + φ_f is 90 deg or more",
                "a smaller friction or lead angle",
                f"μ of {highest:g}",
            )

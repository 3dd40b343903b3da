"""Geometry, friction, ratings and test rig of drives, in SI units and radians.

A `Drive` is the transmission between a motor and a joint: a worm, screw, gear, belt or cable.
`dynamics/transmission.py` computes its torques from these values. `loading/drives.py` reads drives
from files.
"""

import math
from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, Literal

from ssm_planner.problem.posterior import LAW_PARAMETERS, Posterior
from ssm_planner.problem.transmissions import LARGEST_THREAD_ANGLE, TRANSMISSIONS, Transmission
from ssm_planner.problem.value import (
    Coefficient,
    Delay,
    Length,
    Mass,
    Names,
    NotNegative,
    Positive,
    Share,
    Sign,
    Speed,
    Torque,
    Value,
    uncompared_field,
)
from ssm_planner.typing import Numbers, Range, record

LARGEST_LEAD_ANGLE = math.radians(60)
"""Largest plausible lead angle, rad."""
RANGE_PARAMETERS = ("mu", "mu_static", "b_c", "b_v", "b_oc", "b_ov")
"""Parameters of Friction for which a drive may state a range."""
FRICTION_PARAMETERS = (*LAW_PARAMETERS, "dwell_constant", "memory")
"""Parameters of Friction that are numbers."""


@record
class Rig(Value):
    """Payload of a test rig and meaning of its recorded channels, in SI units.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.load_drive("rig1_lead_screw").rig.direction
    -1
    """

    payload_mass: Mass
    """Mass that the output moves, kg. 0 without payload."""
    motor_nominal_torque: Torque
    """Nominal torque of the motor, N·m. Recorded torques are in percent of it."""
    payload_arm: Length | None = None
    """Radius of the pulley that carries the payload of a worm, m.

    None if the payload hangs on the nut (screws).
    """
    payload_direction: Sign = 1
    """+1 if gravity pulls the output in the direction of positive motion."""
    gravity: Annotated[Positive, "acceleration"] = 9.81
    """Acceleration of gravity, m/s², positive."""
    direction: Sign = 1
    """Sign of the rig's positive motion and torque relative to the recorded channels."""
    load_offset: Annotated[float, "torque or force"] = 0.0
    """Identified constant effort in addition to the payload, N·m (worm) or N (screw).

    Positive values oppose positive motion.
    """
    published: Annotated[Mapping[str, NotNegative], Names((*FRICTION_PARAMETERS, "preload"))] = (
        field(default_factory=dict)
    )
    """Published parameters of this drive in SI units, by name in Friction (and preload).

    They serve for comparison. If the data do not determine a parameter, the identification uses the
    solution nearest to them and reports it.
    """

    @property
    def F_payload(self) -> float:
        """Output effort that is due to the weight of the payload, N·m (worm) or N (screw).

        Positive values oppose positive motion.
        """
        return (
            -self.payload_direction * self.payload_mass * self.gravity * (self.payload_arm or 1.0)
        )

    @property
    def load(self) -> float:
        """Constant output effort due to the payload and `load_offset`, N·m (worm) or N (screw)."""
        return self.F_payload + self.load_offset

    @property
    def payload_inertia(self) -> float:
        """Contribution of the payload to the drive's output inertia, kg·m² (worm) or kg (screw)."""
        return self.payload_mass * (self.payload_arm or 1.0) ** 2


FrictionLawName = Literal["coulomb", "stribeck_exponential", "stribeck_gaussian"]


@record
class Friction(Value):
    """Friction of one drive, on the motor side unless stated otherwise (dynamics/transmission.py).

    μ(w) = mu + mu_stribeck · s(|w| / stribeck_speed), where s = 0, exp(−2x) or exp(−x²) depends on
    the law. At rest, μ is mu_static.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Friction(mu=0.13, mu_static=0.15, b_c=5e-4, b_v=1e-5).law
    'coulomb'
    """

    mu: Coefficient
    """Kinetic (Coulomb) coefficient of the mesh."""
    mu_static: Coefficient
    """Coefficient at breakaway."""
    b_c: Annotated[NotNegative, "torque"]
    """Bearing Coulomb torque, N·m."""
    b_v: Annotated[NotNegative, "rotary_viscosity"]
    """Bearing viscous coefficient, N·m·s/rad."""
    b_oc: Annotated[NotNegative, "torque or force"] = 0.0
    """Output Coulomb effort, N·m (worm) or N (screw)."""
    b_ov: Annotated[NotNegative, "rotary_viscosity or linear_viscosity"] = 0.0
    """Output viscous coefficient, N·m·s/rad or N·s/m."""
    law: FrictionLawName = "coulomb"
    """Dependence of the coefficient on speed."""
    mu_stribeck: Coefficient = 0.0
    """Increase of the coefficient above mu at low speed, in the Stribeck laws."""
    stribeck_speed: Speed | None = None
    """Motor speed w_s of the Stribeck term, rad/s."""
    dwell_constant: Delay | None = None
    """Constant c of mu_static, which grows as exp(−c / t_dwell), s.

    None if it reaches its full value at once.
    """
    memory: Delay = 0.0
    """Frictional memory: delay of w in μ(w), s."""
    mu_lowest: Coefficient | None = None
    """Lowest plausible mu (lubrication, temperature).

    The self-locking margin is reported for it as well.
    """
    identified_speed: Speed | None = None
    """Largest motor speed in the identification data, rad/s. Friction is extrapolated beyond it."""
    covariance: Mapping[str, Numbers] | None = None
    """Covariance of the parameters as stated by the user, in SI units."""
    posterior: Posterior | None = None
    """Uncertainty of the identified parameters. It excludes a covariance."""
    source: str | None = None
    """Source of the parameters."""

    def _check(self) -> None:
        """Raise ProblemError if fields contradict each other, or if the law lacks a parameter."""
        if self.mu_static < self.mu:
            raise self._field_error("mu_static", "smaller than mu", f"at least mu = {self.mu:g}")
        if self.mu_lowest is not None and self.mu_lowest > self.mu:
            raise self._field_error("mu_lowest", "larger than mu", f"at most mu = {self.mu:g}")
        if self.law != "coulomb" and self.stribeck_speed is None:
            raise self._field_error(
                "law",
                "this law needs mu_stribeck and stribeck_speed",
                "both of them, or law: coulomb",
            )
        if self.covariance is not None and self.posterior is not None:
            raise self._field_error(
                "covariance", "the posterior states it already", "one of the two", "both"
            )
        for name, default in (("mu_stribeck", 0.0), ("stribeck_speed", None)):
            if self.law == "coulomb" and getattr(self, name) != default:
                raise self._field_error(
                    name, "not a parameter of the coulomb law", "law: stribeck_exponential or …"
                )


DriveKind = str
"""Name of a kind of drive, which is a name in `TRANSMISSIONS`."""
EFFICIENCY_LEAD_ANGLE = math.radians(45)
"""Lead angle of the thread that represents a drive with efficiencies.

See dynamics/transmission.thread_from_efficiencies.
"""
ScrewEnds = Literal["fixed-free", "supported-supported", "fixed-supported", "fixed-fixed"]
"""Bearings at the two ends of a screw."""


@record
class Ratings(Value):
    """Manufacturer's ratings of a gear or screw. A value is None if the file does not state it.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Ratings(continuous_output=1.5, input_speed=4000 * ssm.rpm).duty is None
    True
    """

    continuous_output: Annotated[Positive, "torque or force"] | None = None
    """Largest continuous output effort, N·m (worm) or N (screws)."""
    peak_output: Annotated[Positive, "torque or force"] | None = None
    """Largest output effort at any instant, N·m (worm) or N (screws)."""
    input_speed: Speed | None = None
    """Largest motor speed, rad/s."""
    duty: Share | None = None
    """Largest share of time in motion."""
    free_length: Length | None = None
    """Unsupported length of a screw, m."""
    root_diameter: Length | None = None
    """Core diameter of a screw, m."""
    ends: ScrewEnds | None = None
    """Bearings of the screw, for buckling and critical speed."""

    def _check(self) -> None:
        """Raise ProblemError if two ratings contradict each other."""
        continuous = self.continuous_output
        peak = self.peak_output
        if continuous is not None and peak is not None and peak < continuous:
            raise self._field_error(
                "peak_output", "smaller than continuous_output", f"at least {continuous:g} in SI"
            )
        length = self.free_length
        diameter = self.root_diameter
        if length is not None and diameter is not None and diameter > length:
            raise self._field_error(
                "root_diameter",
                "the diameter exceeds the length: check the unit",
                "less than free_length",
            )


@record
class Gearhead(Value):
    """Gear stage between motor and drive, such as a planetary gearhead or a belt.

    While the motor drives, a torque τ at the output needs τ / (ratio · efficiency) at the input.
    While the load drives, τ · backward_efficiency / ratio arrives at the input. A value is None if
    the file does not state it.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Gearhead("planetary", ratio=14.0, efficiency=0.8).backwards
    0.05714285714285715
    """

    name: str
    """Name such as the manufacturer's designation."""
    ratio: Annotated[Positive, "number"]
    """Turns of the input per turn of the output."""
    efficiency: Share
    """Ratio of output to input power while the motor drives."""
    backward_efficiency: Share | None = None
    """Ratio of output to input power while the load drives. The default is `efficiency`."""
    inertia: Annotated[NotNegative, "inertia"] | None = None
    """Inertia at the input, kg·m²."""
    backlash: Annotated[NotNegative, "angle"] | None = None
    """Total play of the output with the input locked, rad."""
    mass: Annotated[Positive, "mass"] | None = None
    """Mass, kg."""
    length: Length | None = None
    """Length, m."""
    ratings: Ratings | None = None
    """Manufacturer's ratings. Without them, the stage is not checked."""
    placeholder: bool = False
    """True if the figures replace unknown ones."""
    source: str | None = None
    """Source of the figures."""

    @property
    def forwards(self) -> float:
        """Ratio of input torque to output torque while the motor drives."""
        return 1.0 / (self.ratio * self.efficiency)

    @property
    def backwards(self) -> float:
        """Ratio of input torque to output torque while the load drives."""
        backward = self.backward_efficiency
        return (self.efficiency if backward is None else backward) / self.ratio


@record
class Drive(Value):
    """Transmission with resolved geometry: w = ratio · qd.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> drive = ssm.load_robot("vitreoretinal").joints[0].drive
    >>> drive.kind, drive.slides
    ('worm', False)
    """

    name: str
    """Name such as the manufacturer's designation."""
    kind: DriveKind
    """Name of the kind, such as worm, lead_screw or gear."""
    ratio: Positive
    """Motor angle per joint coordinate: dimensionless (rotary output) or rad/m (linear output)."""
    gamma: Positive
    """Effort arm γ: d_worm / d_wheel (worm) or d_screw / 2 in m (screws).

    dynamics/transmission.py defines it for drives with efficiencies.
    """
    lead_angle: Positive
    """Lead angle λ, rad."""
    pressure_angle: Positive
    """Normal pressure angle θ_n, rad."""
    input_inertia: Annotated[NotNegative, "inertia"]
    """Inertia on the motor shaft, rotor included, kg·m²."""
    output_inertia: Annotated[NotNegative, "inertia or mass"]
    """Inertia of the output side that the bodies do not include, kg·m² (worm) or kg (screws)."""
    friction: Friction | None
    """Friction of the drive, or None before identification.

    Only a drive with a rig may have None. Drives of a robot always have friction.
    """
    preload: Annotated[NotNegative, "force"] = 0.0
    """Spring force between the half nuts of an antibacklash screw, N."""
    second_nut_mass: Mass = 0.0
    """Mass of the half nut that the spring carries, kg."""
    self_locking: bool = True
    """True if the robot relies on this drive to hold without motor torque."""
    dimensions: Numbers = field(default_factory=dict)
    """Geometry as stated in the file, in SI units, for reports."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """Source of each figure, by its key in the file."""
    placeholders: tuple[str, ...] = ()
    """Names of the figures that replace unknown ones. `sources` states the reason."""
    rig: Rig | None = None
    """Test rig of the drive, or None for a drive that is not on a rig."""
    file: str | None = uncompared_field()
    ratings: Ratings | None = None
    """Manufacturer's ratings. Without them, the gear is not checked."""
    friction_ranges: Mapping[str, Range] = field(default_factory=dict)
    """Ranges of friction parameters, by their names in Friction.

    They cover lubrication, temperature and wear.
    """
    gearhead: Gearhead | None = None
    """Gearhead on the motor. `ratio`, input_inertia, b_c and b_v refer to the motor shaft."""
    belt: Gearhead | None = None
    """Belt between gearhead and drive."""

    @property
    def stages(self) -> dict[str, Gearhead]:
        """Gear stages between motor and drive by field, from the motor on."""
        stages = {"gearhead": self.gearhead, "belt": self.belt}
        return {name: stage for name, stage in stages.items() if stage is not None}

    @property
    def stage_ratio(self) -> float:
        """Turns of the motor per turn of the drive's input shaft."""
        return math.prod(stage.ratio for stage in self.stages.values())

    @property
    def lead_slope(self) -> float:
        """Tangent of the lead angle λ."""
        return math.tan(self.lead_angle)

    @property
    def wedging(self) -> float:
        """Ratio of the tangent of the friction angle to μ.

        It is 1 / cos θ_n, where μ is the coefficient of friction and θ_n is the normal pressure
        angle.
        """
        return 1.0 / math.cos(self.pressure_angle)

    @property
    def transmission(self) -> type[Transmission]:
        """Class that declares the kind of drive, with its dimensions and its ratio."""
        return TRANSMISSIONS.find(self.kind, "Drive.kind")

    @property
    def slides(self) -> bool:
        """True if the output is linear."""
        return self.transmission.slides

    @property
    def threaded(self) -> bool:
        """True for worms and screws with sliding friction, which can be self-locking."""
        return self.transmission.threaded

    @property
    def two_nuts(self) -> bool:
        """True for screws with two half nuts that a spring presses apart."""
        return self.transmission.two_nuts

    def _check(self) -> None:
        """Raise ProblemError for an implausible angle or a field that does not fit the kind."""
        if not self.threaded and self.self_locking:
            raise self._field_error(
                "self_locking", f"a {self.kind} drive is not self-locking", "False", "True"
            )
        if not self.lead_angle < LARGEST_LEAD_ANGLE:
            raise self._field_error("lead_angle", "implausible", "above 0 and below 60 deg, in rad")
        if not self.pressure_angle < LARGEST_THREAD_ANGLE / 2:
            raise self._field_error(
                "pressure_angle", "implausible", "above 0 and below 60 deg, in rad"
            )
        if self.friction is None and self.rig is None:
            raise self._field_error(
                "friction",
                "missing: only a drive with a rig can be identified later",
                "a Friction",
                "None",
            )
        for name in ("preload", "second_nut_mass"):
            if not self.two_nuts and getattr(self, name) > 0:
                raise self._field_error(
                    name,
                    f"a {self.kind} has a single nut or wheel",
                    "0, or kind antibacklash_screw",
                )
        diameter = self.dimensions.get("diameter", math.inf)
        if self.ratings is not None and (self.ratings.root_diameter or 0.0) > diameter:
            raise self._field_error(
                "ratings.root_diameter",
                "larger than the diameter at which friction acts",
                f"at most {diameter:g} m",
                self.ratings.root_diameter,
            )
        self._check_ranges()

    def _check_ranges(self) -> None:
        """Raise ProblemError if a range of friction is invalid.

        The range must belong to a parameter in `RANGE_PARAMETERS`, and must contain the parameter's
        nominal value.
        """
        for name, (low, high) in self.friction_ranges.items():
            field = f"friction_ranges.{name}"
            if name not in RANGE_PARAMETERS:
                raise self._field_error(
                    field, "unknown parameter", ", ".join(RANGE_PARAMETERS), name
                )
            if self.friction is None:
                raise self._field_error(
                    field,
                    "the friction must be identified before it can have a range",
                    "no range",
                    (low, high),
                )
            value = getattr(self.friction, name)
            if low < 0:
                raise self._field_error(
                    field, "friction cannot be negative", "[lower, upper], from 0", (low, high)
                )
            if not low <= value <= high:
                reason = f"does not contain the value of {name}, {value:g} in SI"
                raise self._field_error(field, reason, "a range that contains it", (low, high))

    def check_travel(self, travel: float) -> None:
        """Raise ProblemError if a rotating screw is shorter than the travel of its nut.

        Parameters
        ----------
        travel : float
            Travel of the joint, m. Drives without a rotating screw ignore it.
        """
        length = None if self.ratings is None else self.ratings.free_length
        if self.transmission.rotating_screw and length is not None and length < travel:
            raise self._field_error(
                "ratings.free_length",
                "shorter than the travel of the joint",
                f"at least {travel:g} m",
                length,
            )

    def check_locking(self) -> None:
        """Raise ProblemError if the drive must be self-locking and is not, or if the gear jams.

        The loader calls this method. A drive that was built in Python can violate the condition.
        The planner then reports the violation.

        Notes
        -----
        A load drives the motor if φ_f = atan(μ/cos θ_n) ≤ λ, where φ_f is the friction angle, θ_n
        is the normal pressure angle and λ is the lead angle. μ is the lowest plausible kinetic
        coefficient. The static coefficient is ignored, because vibration can remove the static
        friction. The gear jams if λ + φ_f reaches 90° for the largest coefficient.
        """
        friction = self.friction
        if friction is None:
            return
        lowest = friction.mu
        field = "friction.mu"
        if friction.mu_lowest is not None:
            lowest = friction.mu_lowest
            field = "friction.mu_lowest"
        if self.friction_ranges.get("mu", (lowest,))[0] < lowest:
            lowest = self.friction_ranges["mu"][0]
            field = "friction_ranges.mu"
        friction_angle = math.atan(lowest / math.cos(self.pressure_angle))
        if self.self_locking and friction_angle <= self.lead_angle:
            required_mu = math.tan(self.lead_angle) * math.cos(self.pressure_angle)
            raise self._field_error(
                field,
                "the drive is not self-locking: lead angle λ = "
                f"{math.degrees(self.lead_angle):.4g} deg, "
                f"friction angle φ_f = {math.degrees(friction_angle):.4g} deg, "
                "and φ_f must be larger",
                f"mu above {required_mu:.4g}, or self_locking: not required",
                lowest,
            )
        highest = max(friction.mu_static, friction.mu + friction.mu_stribeck)
        if self.lead_angle + math.atan(highest / math.cos(self.pressure_angle)) >= math.pi / 2:
            raise self._field_error(
                "friction",
                "with this lead angle and friction the gear jams: λ + φ_f is 90 deg or more",
                "a smaller friction or lead angle",
                f"μ of {highest:g}",
            )

"""Define the kinds of drives by their names, geometry, torque law and checks.

Each kind is a subclass of `Transmission`, whose fields are the dimensions in drive files.
`TRANSMISSIONS` lists all kinds. To add a kind, write a subclass and register it
(docs/architecture.md).
"""

import math
from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, ClassVar

from ssm_planner.arguments import check_methods
from ssm_planner.problem.drive_geometry import (
    SCREW_FAMILY,
    WORM_FAMILY,
    DimensionError,
    GearFamily,
    resolve_dimensions,
)
from ssm_planner.problem.value import Length, Positive
from ssm_planner.registry import Registry
from ssm_planner.typing import record

_Number = Annotated[Positive, "number"]
_Angle = Annotated[Positive, "angle"]
Dimensions = Mapping[str, float]
"""Dimensions in SI units by key."""
LARGEST_THREAD_ANGLE = math.radians(120)
"""Largest plausible angle between the flanks of a thread, rad."""


@check_methods
class Transmission:
    """Base class of the kinds of drives. The class itself represents the kind.

    The fields of a subclass are the keys of `geometry` in drive files. Their annotations state the
    units, and their docstrings describe the keys. The default of an optional key is None. Unless
    `threaded` is set, the drive is not self-locking, and it has efficiencies if it has dimensions.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> from ssm_planner.problem import TRANSMISSIONS
    >>> TRANSMISSIONS["worm"].threaded
    True
    """

    name: ClassVar[str]
    """Value of `kind` in files."""
    slides: ClassVar[bool] = False
    """True if the output is linear."""
    threaded: ClassVar[bool] = False
    """True if the drive has a thread with sliding friction, which can be self-locking."""
    two_nuts: ClassVar[bool] = False
    """True if a spring presses two half nuts apart."""
    rotating_screw: ClassVar[bool] = False
    """True if a slender screw turns, so that its whirling and buckling are checked."""
    distinctive: ClassVar[frozenset[str]] = frozenset()
    """Keys of `geometry` that distinguish the kind in a catalogue.

    A row of a catalogue of these drives has at least one of them.
    """

    @classmethod
    def complete(cls, stated: Dimensions) -> dict[str, float]:
        """Compute the dimensions of a drive that a file does not state.

        By default, a drive has only the stated dimensions. The result for a thread contains
        `ratio`, `lead_angle` and `thread_angle`.

        Parameters
        ----------
        stated : mapping of float
            Dimensions that the file states, in SI units by key.

        Returns
        -------
        dict of float
            All dimensions in SI units by key.

        Raises
        ------
        DimensionError
            If the stated dimensions do not determine all others.
        """
        return dict(stated)

    @classmethod
    def motor_ratio(cls, dimensions: Dimensions) -> float:
        """Return the motor angle per unit of the joint coordinate, in rad/rad or rad/m.

        The default is the dimension `ratio`, or 1 without it.
        """
        return dimensions.get("ratio", 1.0)

    @classmethod
    def effort_arm(cls, dimensions: Dimensions) -> float:
        """Return the factor between the output effort and the motor torque of a thread.

        The motor torque per output effort is γ·tan(λ ± φ), where γ is this factor (effort arm), λ
        is the lead angle and φ is the friction angle. For a screw, γ is the radius at which
        friction acts, m.
        """
        return dimensions["diameter"] / 2


@record
class _Thread(Transmission):
    """Base of the kinds of drives with a thread."""

    threaded = True
    family: ClassVar[GearFamily]
    """Equations between the dimensions."""
    lead: Length | None = None
    """Advance of the thread in one turn."""
    lead_angle: _Angle | None = None
    """Lead angle at the diameter at which friction acts: tan = lead / (π · diameter)."""
    starts: _Number | None = None
    """Number of parallel threads: lead = starts · pitch."""
    pitch: Length | None = None
    """Distance between neighbouring threads."""

    @classmethod
    def complete(cls, stated: Dimensions) -> dict[str, float]:
        """Compute the dimensions of a thread that a file does not state.

        Parameters
        ----------
        stated : mapping of float
            Dimensions that the file states, in SI units by key.

        Returns
        -------
        dict of float
            All dimensions in SI units by key.

        Raises
        ------
        DimensionError
            If the stated dimensions do not determine the others, or are implausible.
        """
        numbers = dict(stated)
        thread_angle = numbers.pop("thread_angle")
        outer = numbers.pop("outer_diameter", None)
        if not thread_angle < LARGEST_THREAD_ANGLE:
            raise DimensionError("implausible", "thread_angle", "an angle below 120 deg")
        dimensions = resolve_dimensions(cls.family, numbers)
        if outer is not None:
            if outer < dimensions["diameter"]:
                raise DimensionError(
                    "smaller than the diameter at which friction acts", "outer_diameter"
                )
            dimensions["outer_diameter"] = outer
        return {**dimensions, "thread_angle": thread_angle}


@record
class Worm(_Thread):
    """Worm gear.

    Any set of dimensions that determines ratio, both diameters and the lead suffices.
    """

    name = "worm"
    family = WORM_FAMILY
    distinctive = frozenset({"wheel_diameter", "worm_diameter", "ratio"})
    ratio: _Number | None = None
    """Turns of the worm per turn of the wheel."""
    worm_diameter: Length | None = None
    """Pitch diameter of the worm."""
    wheel_diameter: Length | None = None
    """Pitch diameter of the wheel."""
    thread_angle: _Angle = field(kw_only=True)
    """Angle between both flanks in the axial section."""

    @classmethod
    def effort_arm(cls, dimensions: Dimensions) -> float:
        """Return the quotient of the diameters of worm and wheel, a number without a unit."""
        return dimensions["worm_diameter"] / dimensions["wheel_diameter"]


@record
class LeadScrew(_Thread):
    """Lead screw with one nut.

    Any set of dimensions that determines lead and effective diameter suffices.
    """

    name = "lead_screw"
    family = SCREW_FAMILY
    slides = True
    rotating_screw = True
    diameter: Length | None = None
    """Diameter at which friction acts."""
    effective_diameter: Length | None = None
    """Synonym of diameter."""
    thread_angle: _Angle = field(kw_only=True)
    """Angle between both flanks in the axial section."""
    outer_diameter: Length | None = None
    """Outer diameter, for information. Friction acts at the effective diameter."""


@record
class AntibacklashScrew(LeadScrew):
    """Lead screw with two half nuts that a spring presses apart."""

    name = "antibacklash_screw"
    two_nuts = True


@record
class Direct(Transmission):
    """Motor that moves the joint directly."""

    name = "direct"


@record
class Gear(Transmission):
    """Gear with a rotary output."""

    name = "gear"
    ratio: _Number
    """Turns of the motor per turn of the output."""


@record
class Belt(Gear):
    """Belt with a rotary output."""

    name = "belt"


@record
class Cable(Gear):
    """Cable with a rotary output."""

    name = "cable"


@record
class BallScrew(Transmission):
    """Ball screw."""

    name = "ball_screw"
    slides = True
    rotating_screw = True
    lead: Length
    """Advance of the nut in one turn."""

    @classmethod
    def motor_ratio(cls, dimensions: Dimensions) -> float:
        """Return 2π / lead, the motor angle per travel of the nut, rad/m."""
        return 2 * math.pi / dimensions["lead"]


@record
class CableSlide(Transmission):
    """Belt or cable that pulls a slide."""

    name = "cable_slide"
    slides = True
    pulley_diameter: Length
    """Diameter at which the belt or cable runs."""
    ratio: _Number | None = None
    """Turns of the motor per turn of the pulley. The default is 1."""

    @classmethod
    def motor_ratio(cls, dimensions: Dimensions) -> float:
        """Return the motor angle per travel of the slide, rad/m.

        It is the ratio of motor to pulley turns, divided by the radius of the pulley.
        """
        return dimensions.get("ratio", 1.0) * 2 / dimensions["pulley_diameter"]


TRANSMISSIONS: Registry[type[Transmission]] = Registry(
    "ssm_planner.drives",
    "kind of drive",
    *(Worm, LeadScrew, AntibacklashScrew, Direct, Gear, Belt, Cable, BallScrew, CableSlide),
)
"""All kinds of drives."""

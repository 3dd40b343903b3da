"""Compute the dimensions of a gear from any sufficient set of them.

Files of worms and screws may state different dimensions, such as lead and diameter, or starts,
pitch and lead angle. The dimensions satisfy a few equations, each a product of powers.
`resolve_dimensions` solves these equations one after the other, and compares redundant dimensions.
"""

import math
from collections.abc import Mapping

from ssm_planner.typing import Numbers, record

DIMENSION_TOLERANCE = 0.005
"""Largest relative difference between a stated dimension and the value that follows from others."""

# Each law is a product of powers: Π xᵢ^pᵢ = constant. If only one xᵢ is unknown, the law gives it.
_Law = tuple[Mapping[str, int], float]
_HELIX: _Law = ({"tan_lead_angle": 1, "diameter": 1, "lead": -1}, 1 / math.pi)
_THREAD: _Law = ({"lead": 1, "starts": -1, "pitch": -1}, 1.0)


@record
class GearFamily:
    """Kinds of gears whose dimensions satisfy the same equations."""

    laws: tuple[_Law, ...]
    """Equations between the dimensions. Each consists of powers by dimension and of their product.
    """
    needed: tuple[str, ...]
    """Dimensions that must follow from the stated ones."""
    diameter: str
    """Key of the diameter at which friction acts."""
    advice: str
    """Description of sufficient sets of dimensions, for messages."""


WORM_FAMILY = GearFamily(
    (({"ratio": 1, "lead": 1, "wheel_diameter": -1}, math.pi), _HELIX, _THREAD),
    ("ratio", "diameter", "wheel_diameter", "lead"),
    "worm_diameter",
    "the worm; it needs three independent ones of ratio, worm_diameter, wheel_diameter, lead (or "
    "starts and pitch), lead_angle",
)
SCREW_FAMILY = GearFamily(
    (({"ratio": 1, "lead": 1}, 2 * math.pi), _HELIX, _THREAD),
    ("diameter", "lead"),
    "diameter",
    "the screw; it needs two independent ones of diameter (or effective_diameter), lead (or starts "
    "and pitch), lead_angle",
)
# Figures that datasheets state exactly come before figures that are usually rounded.
_EVALUATION_ORDER = (
    "ratio",
    "lead",
    "starts",
    "pitch",
    "diameter",
    "wheel_diameter",
    "tan_lead_angle",
)


class DimensionError(ValueError):
    """Dimensions that do not determine the gear or contradict each other.

    The attribute `key` is the dimension that is probably wrong, or None.
    """

    def __init__(self, reason: str, key: str | None = None, allowed: str | None = None) -> None:
        super().__init__(reason)
        self.key = key
        self.allowed = allowed


def resolve_dimensions(family: GearFamily, numbers: Numbers) -> dict[str, float]:
    """Compute all dimensions of a gear in SI units from those that a file states.

    The keys of a worm are ratio, worm_diameter, wheel_diameter, lead, lead_angle, starts and pitch,
    with ratio = π · wheel_diameter / lead. The keys of a screw are diameter or effective_diameter,
    lead, lead_angle, starts and pitch, with ratio = 2π / lead. Both satisfy tan(lead_angle) = lead
    / (π · diameter) and lead = starts · pitch.

    Parameters
    ----------
    family : GearFamily
        Equations between the dimensions.
    numbers : mapping of float
        Stated dimensions in SI units by their keys in the file.

    Returns
    -------
    dict of float
        All dimensions that can be computed, by key.

    Raises
    ------
    DimensionError
        If the dimensions do not suffice or contradict each other.
    """
    named_numbers = _dimensions_by_law_name(numbers)
    dimensions: dict[str, float] = {}
    for name in _EVALUATION_ORDER:
        if name not in named_numbers:
            continue
        key, value = named_numbers[name]
        if name in dimensions:
            if abs(dimensions[name] / value - 1) > DIMENSION_TOLERANCE:
                raise DimensionError(
                    "contradicts the other dimensions, which give "
                    f"{_format_dimension(name, dimensions[name])}; omit or correct one of them",
                    key,
                )
            continue
        dimensions[name] = value
        _derive_dimensions(family, dimensions)
    missing = [name for name in family.needed if name not in dimensions]
    if missing:
        have = ", ".join(numbers) or "none"
        raise DimensionError(f"the dimensions given ({have}) do not determine {family.advice}")
    lead_angle = math.atan(dimensions.pop("tan_lead_angle"))
    diameter = dimensions.pop("diameter")
    return {family.diameter: diameter, "lead_angle": lead_angle, **dimensions}


def _dimensions_by_law_name(dimensions: Numbers) -> dict[str, tuple[str, float]]:
    """Convert the stated dimensions to the unknowns of the equations.

    The equations contain the tangent of the lead angle instead of the angle, and a single diameter,
    which has three keys in files.

    Parameters
    ----------
    dimensions : mapping of float
        Stated dimensions in SI units by key in the file.

    Returns
    -------
    dict of tuples
        Key in the file, and value in SI units, by name in the equations.

    Raises
    ------
    DimensionError
        If a lead angle is implausible, or if two keys state different diameters.
    """
    internal: dict[str, tuple[str, float]] = {}
    for key, value in dimensions.items():
        if key == "lead_angle":
            if not 0 < value < math.pi / 3:
                raise DimensionError("a lead angle must be between 0 and 60 deg", key)
            internal["tan_lead_angle"] = (key, math.tan(value))
        elif key in ("worm_diameter", "diameter", "effective_diameter"):
            if (
                "diameter" in internal
                and abs(internal["diameter"][1] / value - 1) > DIMENSION_TOLERANCE
            ):
                raise DimensionError(
                    "differs from diameter: give only the diameter at which friction acts", key
                )
            internal.setdefault("diameter", (key, value))
        else:
            internal[key] = (key, value)
    return internal


def _derive_dimensions(family: GearFamily, dimensions: dict[str, float]) -> None:
    """Add every dimension that follows from the known dimensions.

    An equation with a single unknown dimension determines it. This is repeated until no equation
    gives a new dimension.

    Parameters
    ----------
    family : GearFamily
        Equations between the dimensions.
    dimensions : dict of float
        Known dimensions in SI units by name. The computed dimensions are added to it.
    """
    progress = True
    while progress:
        progress = False
        for powers, constant in family.laws:
            unknown = [name for name in powers if name not in dimensions]
            if len(unknown) == 1:
                # Solve Π xᵢ^pᵢ = constant for the unknown xᵢ.
                value = constant
                for name, power in powers.items():
                    if name in dimensions:
                        value /= dimensions[name] ** power
                dimensions[unknown[0]] = value ** (1 / powers[unknown[0]])
                progress = True


def _format_dimension(name: str, value: float) -> str:
    """Return a dimension as text: an angle in degrees, a length in mm, or a plain number."""
    if name == "tan_lead_angle":
        return f"{math.degrees(math.atan(value)):.4g} deg"
    return f"{value:.5g}" if name in ("ratio", "starts") else f"{value * 1e3:.5g} mm"

"""Convert quantities with units, such as `65 deg/s`, to numbers in SI units.

Every number with a dimension in a YAML file has its unit. `parse_quantity` reads such a text for a
given kind of quantity (`QUANTITY_KINDS`), and checks its dimensions and its plausibility. Other
functions read fractions, vectors and intervals. `split_heading` and the factors `TIMES`, `ANGLES`,
`LENGTHS` and `SPEEDS` serve the columns of tables, and `display_unit` serves messages.
"""

import math
import re
from collections import Counter
from functools import lru_cache
from pathlib import Path

from ssm_planner.package_table import package_table
from ssm_planner.typing import frozen

deg = math.pi / 180
"""SI factor of an angle: `85 * deg` is an angle in rad."""
rpm = math.pi / 30
"""SI factor of a rotational speed: `8000 * rpm` is a speed in rad/s."""
mm = 1e-3
"""SI factor of a length: `20 * mm` is a length in m."""
mNm = 1e-3
"""SI factor of a torque: `80 * mNm` is a torque in N·m."""
ms = 1e-3
"""SI factor of a time: `50 * ms` is a time in s."""

Dimensions = tuple[tuple[str, int], ...]
"""Powers of the base dimensions in sorted order, empty for a dimensionless number."""

LONGEST_SYMBOL = 3
"""Largest length of a unit without a plural form."""
_SYMBOLS: dict[str, dict[str, tuple[float, str]]] = {
    "prefix": {"": (1.0, "")},
    "base": {},
    "derived": {},
}
"""Factor of each prefix, dimension of each base unit, and value of each derived unit.

Angle is a separate dimension, so `5` and `5 mm` are not valid angles.
"""
for _names, _group, _factor, _unit in package_table(Path(__file__).with_name("symbols.csv")):
    _SYMBOLS[_group] |= dict.fromkeys(_names.split(), (float(_factor), _unit))
_TEMPERATURE_ZEROS = {"degC": 273.15, "degree_Celsius": 273.15}
"""Zero of temperature scales in K. In a compound unit such as K/W, a degree is a kelvin."""

_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*(.*?)\s*", re.DOTALL)
_FACTOR = r"[A-Za-z_]+(?:(?:\^|\*\*)-?[1-9])?"
_UNIT = re.compile(rf"(?:1\s*/\s*)?{_FACTOR}(?:(?:\s*[*/]\s*|\s+){_FACTOR})*")
_FACTORS = re.compile(r"(/?)\s*([A-Za-z_]+)(?:(?:\^|\*\*)(-?[1-9]))?")
_VECTOR = re.compile(r"\s*[(\[]([^()\[\]]*)[)\]]\s*(.*?)\s*", re.DOTALL)
_SPELLINGS = {
    "−": "-",
    "°C": "degC",
    "°": "deg",
    "\u00b5": "u",  # micro sign
    "\u03bc": "u",  # Greek mu
    "\u03a9": "ohm",  # Greek omega
    "\u2126": "ohm",  # ohm sign
    "·": "*",
    "⋅": "*",
    "²": "^2",
    "³": "^3",
}


_NUMBER_HINT = "a bare number such as 0.13, without a unit"


# Factors to SI units of the units in the headings of tables.
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": deg, "°": deg}
LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
_UNIT_IN_BRACKETS = re.compile(r"^(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]\s*$")
PER_SECOND = r"(?:_per_s(?:\^?2)?|/s(?:\^?2|²)?)"
"""Pattern of the end of a unit of a first or second derivative with respect to time."""
_UNIT_AT_END = re.compile(rf"^(.*?)[_ ]((?:rad|mrad|deg|m|mm|um){PER_SECOND}?|s|ms|us|ns)$", re.I)


def split_heading(name: str) -> tuple[str, str]:
    """Split the heading of a column, such as `roll [deg/s]`, into its label and its unit.

    The unit may be in brackets or parentheses, or at the end of the heading after `_` or a space,
    as in `roll_deg_per_s`.

    Parameters
    ----------
    name : str
        Heading.

    Returns
    -------
    label : str
        Heading without the unit.
    unit : str
        Unit, or "" if the heading does not state one.
    """
    match = _UNIT_IN_BRACKETS.match(name) or _UNIT_AT_END.match(name.strip())
    if match is None:
        return name, ""
    label, unit = match.groups()
    return label, unit.strip()


LARGEST_MAGNITUDE = 1e50
"""Largest magnitude of a number in SI units. The reciprocal is the smallest magnitude above 0.

Powers and quotients of a few such numbers neither overflow nor vanish.
"""
SPEEDS = {"rpm": rpm, "1/min": rpm, "rad/s": 1.0, "deg/s": deg, "mrpm": 1e-3 * rpm}


class BadQuantity(ValueError):
    """Error for a text that is not the required quantity.

    Parameters
    ----------
    reason : str
        Description of the fault.
    allowed : str
        Description of the allowed values.
    """

    def __init__(self, reason: str, allowed: str) -> None:
        super().__init__(f"{reason} (allowed: {allowed})")
        self.reason = reason
        self.allowed = allowed


def parse_quantity(value: object, unit_kind: str) -> float:
    """Convert a quantity such as `65 deg/s` to SI units.

    Parameters
    ----------
    value : object
        Value from a YAML file. It must be a text with a number and a unit, unless `unit_kind` is
        "number" or "share".
    unit_kind : str
        Kind of quantity, a key of `QUANTITY_KINDS`. "number" means a number without a unit, and
        "share" a fraction such as 20 % or 0.2.

    Returns
    -------
    float
        Value in SI units.

    Raises
    ------
    BadQuantity
        If the value is not a quantity of this kind, or is implausibly large.
    """
    if unit_kind in _READERS_WITHOUT_UNIT:
        return _READERS_WITHOUT_UNIT[unit_kind](value)
    target = QUANTITY_KINDS[unit_kind]
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise BadQuantity(f"{describe(value)} where {target.name} is needed", target.expected)
    if not isinstance(value, str):
        raise BadQuantity("a number without a unit", target.expected)
    match = _QUANTITY.fullmatch(_to_ascii(value))
    if match is None:
        raise BadQuantity("not a number with a unit", target.expected)
    if not match[2]:
        raise BadQuantity("a number without a unit", target.expected)
    return _convert(float(match[1]), match[2], target)


def parse_number(value: object) -> float:
    """Check that a value is a finite number without a unit.

    Parameters
    ----------
    value : object
        Value from a YAML file.

    Returns
    -------
    float
        The number.

    Raises
    ------
    BadQuantity
        If the value is of another type, not finite, or of an implausible magnitude.
    """
    match = _QUANTITY.fullmatch(_to_ascii(value)) if isinstance(value, str) else None
    if match is not None and match[2]:
        raise BadQuantity("this figure has no unit", _NUMBER_HINT)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise BadQuantity(f"{describe(value)} where a number is needed", _NUMBER_HINT)
    _check_magnitude(value, _NUMBER_HINT)
    return float(value)


def _check_magnitude(value: float, allowed: str) -> None:
    """Check that a number is finite and of a plausible magnitude.

    Parameters
    ----------
    value : float
        Number in SI units.
    allowed : str
        Description of the allowed values for the message.

    Raises
    ------
    BadQuantity
        If the number is not finite, above `LARGEST_MAGNITUDE`, or closer to 0 than its reciprocal,
        without being 0.
    """
    if not math.isfinite(value):
        raise BadQuantity("not a finite number", allowed)
    if value and not 1 / LARGEST_MAGNITUDE <= abs(value) <= LARGEST_MAGNITUDE:
        raise BadQuantity("implausibly small or large", allowed)


def parse_share(value: object) -> float:
    """Convert a percentage or a fraction to a fraction: `20 %`, `20%` and 0.2 all give 0.2.

    Parameters
    ----------
    value : object
        Number or text from a YAML file.

    Returns
    -------
    float
        Fraction.

    Raises
    ------
    BadQuantity
        If the value is not a finite number, or a number above 10 without `%`, which was probably
        meant as a percentage.
    """
    text = str(value).strip()
    allowed = "a share such as 10% or 0.1"
    try:
        result = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        result = math.nan
    if not math.isfinite(result):
        raise BadQuantity(f"{describe(value)} instead of a share", allowed)
    if result > 10 and not text.endswith("%"):
        raise BadQuantity(f"did you mean {text}%?", allowed)
    return result


def parse_vector(value: object, kinds: tuple[str, ...]) -> tuple[float, ...]:
    """Convert a vector such as `[1 mm, 2 mm, 3 mm]` or `(1, 2, 3) mm` to SI units.

    Parameters
    ----------
    value : object
        List of quantities, or text with one unit after the bracket.
    kinds : tuple of str
        Kind of quantity of each component, a key of `QUANTITY_KINDS`, "number" or "share".

    Returns
    -------
    tuple of float
        Components in SI units.

    Raises
    ------
    BadQuantity
        If the number of components is wrong, or a component is not a quantity of its kind.
    """
    shape = ", ".join(QUANTITY_KINDS.get(kind, NUMBER).example for kind in kinds)
    allowed = f"{len(kinds)} values such as [{shape}]"
    match = _VECTOR.fullmatch(_to_ascii(value)) if isinstance(value, str) else None
    if match is not None:
        if not match[2]:
            raise BadQuantity("numbers without a unit", allowed)
        value = [f"{item.strip()} {match[2]}" for item in match[1].split(",")]
    if not isinstance(value, (list, tuple)):
        raise BadQuantity(f"{describe(value)} where {len(kinds)} values are needed", allowed)
    if len(value) != len(kinds):
        raise BadQuantity(f"{len(value)} values", allowed)
    return tuple(parse_quantity(item, kind) for item, kind in zip(value, kinds, strict=True))


_READERS_WITHOUT_UNIT = {"number": parse_number, "share": parse_share}
"""Functions that read the kinds of quantities without a unit, by kind."""


def parse_interval(value: object, unit_kind: str) -> tuple[float, float]:
    """Convert an interval such as `[-139 deg, -81 deg]` to its bounds in SI units.

    Parameters
    ----------
    value : object
        List of two quantities, or text with one unit after the bracket.
    unit_kind : str
        Kind of quantity of both bounds, a key of `QUANTITY_KINDS`, "number" or "share".

    Returns
    -------
    (float, float)
        Lower and upper bound in SI units.

    Raises
    ------
    BadQuantity
        If a bound is not a quantity of this kind, or the lower bound is not below the upper one.
    """
    low, high = parse_vector(value, (unit_kind, unit_kind))
    if not low < high:
        raise BadQuantity("the lower bound is not below the upper one", "[lower, upper]")
    return low, high


def _convert(magnitude: float, unit: str, target: "QuantityKind") -> float:
    """Convert a magnitude with a unit to SI units.

    Parameters
    ----------
    magnitude : float
        Number before the unit.
    unit : str
        Unit in ASCII characters, such as N*m*s/rad.
    target : QuantityKind
        Required kind of quantity.

    Returns
    -------
    float
        Value in SI units.

    Raises
    ------
    BadQuantity
        If the unit is unknown, does not belong to this kind, or gives an implausible value.
    """
    if _UNIT.fullmatch(unit) is None:
        raise BadQuantity(
            f"{unit[:40]!r} is not a unit",
            f"{target.expected}; units are joined by * and /, powers ^2",
        )
    try:
        factor, dimensions = _parse_unit(unit)
    except KeyError as error:
        raise BadQuantity(f"unknown unit {error.args[0]!r}", target.expected) from None
    if any(dimensions == _parse_unit(symbol)[1] for symbol in (target.unit, *target.others)):
        value = magnitude * factor + _TEMPERATURE_ZEROS.get(unit, 0.0)
        return _check_plausible(value, target, f"{magnitude:g} {unit}")
    name = _quantity_name(dimensions)
    fault = f"{name}, not {target.name}"
    # Two kinds may have one name, for example the speeds of revolute and of sliding joints.
    if name == target.name:
        fault = f"not {target.name} in {target.unit}"
    raise BadQuantity(f"{magnitude:g} {unit} is {fault}", target.expected)


def _check_plausible(value: float, target: "QuantityKind", text: str) -> float:
    """Return a value unchanged, or raise an error if its size suggests another unit.

    Parameters
    ----------
    value : float
        Value in SI units.
    target : QuantityKind
        Kind of quantity with its largest plausible value.
    text : str
        Value as the user wrote it, for the message.

    Returns
    -------
    float
        The same value.

    Raises
    ------
    BadQuantity
        If the magnitude is implausible, or a temperature is below absolute zero.
    """
    _check_magnitude(value, target.expected)
    if abs(value) > target.largest:
        raise BadQuantity(
            f"{text} is implausibly large for {target.name} here: did you mean {target.slip}?",
            target.expected,
        )
    if target.unit == "K" and value < 0:
        raise BadQuantity("below absolute zero", target.expected)
    return value


@lru_cache(maxsize=256)
def _parse_unit(text: str) -> tuple[float, Dimensions]:
    """Compute the factor to SI units and the dimensions of a unit such as N*m*s/rad.

    Parameters
    ----------
    text : str
        Unit in ASCII characters. A sign `/` applies only to the next factor.

    Returns
    -------
    factor : float
        Value of the unit in SI units.
    dimensions : Dimensions
        Powers of the base dimensions. Dimensions that cancel are omitted.

    Raises
    ------
    KeyError
        If a unit is unknown. The argument of the error is its name.
    """
    factor = 1.0
    powers = Counter[str]()
    for separator, name, exponent in _FACTORS.findall(text):
        power = int(exponent or 1) * (-1 if separator else 1)
        scale, dimensions = _unit_by_name(name)
        factor *= scale**power
        for dimension, inner_power in dimensions:
            powers[dimension] += power * inner_power
    # Dimensions that cancel, such as that of rad in rad/rad, are omitted.
    return factor, tuple(sorted(item for item in powers.items() if item[1] != 0))


@lru_cache(maxsize=256)
def _unit_by_name(name: str) -> tuple[float, Dimensions]:
    """Return the factor to SI units and the dimensions of a single unit.

    Parameters
    ----------
    name : str
        Name or symbol of the unit. It may have a prefix and, if it is long, a plural s.

    Returns
    -------
    factor : float
        Value of the unit in SI units.
    dimensions : Dimensions
        Powers of the base dimensions.

    Raises
    ------
    KeyError
        If the unit is unknown. The argument of the error is its name.
    """
    singular = name.removesuffix("s") if len(name) > LONGEST_SYMBOL else name
    for symbol in (name, singular):
        for prefix, (prefix_factor, _) in _SYMBOLS["prefix"].items():
            if not symbol.startswith(prefix):
                continue
            unit = _unit_without_prefix(symbol.removeprefix(prefix))
            if unit is not None:
                factor, dimensions = unit
                return prefix_factor * factor, dimensions
    raise KeyError(name)


def _unit_without_prefix(name: str) -> tuple[float, Dimensions] | None:
    """Return the factor to SI units and the dimensions of a unit without a prefix.

    Base units have the factor 1. A derived unit is defined by a factor and an expression of other
    units.

    Parameters
    ----------
    name : str
        Name or symbol of the unit.

    Returns
    -------
    (float, Dimensions) or None
        Factor and powers of the base dimensions, or None if the unit is unknown.
    """
    if name in _SYMBOLS["base"]:
        return 1.0, ((_SYMBOLS["base"][name][1], 1),)
    if name not in _SYMBOLS["derived"]:
        return None
    factor, unit = _SYMBOLS["derived"][name]
    scale, dimensions = _parse_unit(unit)
    return factor * scale, dimensions


def _quantity_name(dimensions: Dimensions) -> str:
    """Return the name of the quantity with given dimensions, for messages.

    Parameters
    ----------
    dimensions : Dimensions
        Powers of the base dimensions.

    Returns
    -------
    str
        Name of the first kind of quantity with these dimensions, "a pure number", or a text of the
        dimensions, such as "a [length]^4".
    """
    for kind in QUANTITY_KINDS.values():
        if _parse_unit(kind.unit)[1] == dimensions:
            return kind.name
    if not dimensions:
        return "a pure number"
    texts = [f"[{name}]" if power == 1 else f"[{name}]^{power}" for name, power in dimensions]
    return "a " + " ".join(texts)


def _to_ascii(text: str) -> str:
    """Replace symbols such as ° and ² by ASCII text."""
    for symbol, ascii_text in _SPELLINGS.items():
        text = text.replace(symbol, ascii_text)
    return text


def describe(value: object) -> str:
    """Describe the type of a YAML value for messages, for example "a list".

    Parameters
    ----------
    value : object
        Value from a YAML file.

    Returns
    -------
    str
        Type with an article, or "nothing" for None.
    """
    descriptions = {
        type(None): "nothing",
        bool: "true/false",
        int: "a number",
        float: "a number",
        list: "a list",
        tuple: "a list",
        dict: "a mapping",
    }
    for value_type, description in descriptions.items():
        if isinstance(value, value_type):
            return description
    return "a text"


@frozen
class QuantityKind:
    """Kind of quantity, with the units in which a file may state it."""

    name: str
    """Name for messages, such as "an angle"."""
    example: str
    """Example of a value with its unit."""
    unit: str
    """SI unit."""
    others: tuple[str, ...] = ()
    """Units of another dimension that have the same meaning, such as N*m*s for N*m*s/rad."""
    largest: float = math.inf
    """Largest plausible value in SI units. Above it, the unit is probably wrong."""
    slip: str = ""
    """Unit that was probably intended for a larger value."""

    @property
    def expected(self) -> str:
        """Name and example of the quantity for messages."""
        return f"{self.name} such as {self.example}"


NUMBER = QuantityKind("a number", "0.13", "")
"""Kind of dimensionless numbers. It is not in `QUANTITY_KINDS`."""
QUANTITY_KINDS = {
    key: QuantityKind(
        name, example, unit, tuple(others.split()), largest=float(largest or "inf"), slip=slip
    )
    for key, name, example, unit, others, largest, slip in package_table(
        Path(__file__).with_suffix(".csv")
    )
}
"""Kinds of quantity by their name in the schema."""


RPM = 30 / math.pi
"""Revolutions per minute in 1 rad/s."""
_DISPLAY_UNITS = {"m": ("mm", 1e3), "N·m": ("mN·m", 1e3), "rpm": ("rpm", RPM)}


def display_unit(unit: str, degree: str = "deg") -> tuple[str, float]:
    """Return the unit in which messages display values, and the factor to this unit.

    The result for "rad/s" is ("deg/s", 57.3).

    Parameters
    ----------
    unit : str
        SI unit of the values. "rpm" represents the speed of a motor in rad/s.
    degree : str
        Symbol of a degree, such as "°" on pages and in figures.

    Returns
    -------
    name : str
        Displayed unit.
    scale : float
        Factor by which values in SI units must be multiplied.
    """
    base, separator, denominator = unit.partition("/")
    if base == "rad":
        name, scale = degree, 180 / math.pi
    else:
        name, scale = _DISPLAY_UNITS.get(base, (base, 1.0))
    return name + separator + denominator, scale

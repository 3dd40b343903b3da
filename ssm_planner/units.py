"""Convert quantities with units, such as `65 deg/s`, to numbers in SI units."""

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
_PER_SECOND = r"(?:_per_s(?:\^?2)?|/s(?:\^?2|²)?)"
_UNIT_AT_END = re.compile(rf"^(.*?)[_ ]((?:rad|mrad|deg|m|mm|um){_PER_SECOND}?|s|ms|us|ns)$", re.I)


def split_heading(name: str) -> tuple[str, str]:
    """Split a column heading such as `roll [deg/s]`, `roll (deg/s)` or `roll_deg_per_s`.

    The result is the label and the unit. The unit is "" if the heading does not state one.
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

    `reason` is the fault, and `allowed` describes the allowed values.
    """

    def __init__(self, reason: str, allowed: str) -> None:
        super().__init__(f"{reason} (allowed: {allowed})")
        self.reason = reason
        self.allowed = allowed


def parse_quantity(value: object, unit_kind: str) -> float:
    """Convert a quantity such as `65 deg/s` to SI units.

    `unit_kind` is a key of `QUANTITY_KINDS`, or "number" for a number without a unit.

    Raises
    ------
    BadQuantity
        If the value is not such a quantity, or is implausibly large.
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
    """Check that a value is a finite number without a unit, and return it.

    Raises BadQuantity for other values.
    """
    match = _QUANTITY.fullmatch(_to_ascii(value)) if isinstance(value, str) else None
    if match is not None and match[2]:
        raise BadQuantity("this figure has no unit", _NUMBER_HINT)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise BadQuantity(f"{describe(value)} where a number is needed", _NUMBER_HINT)
    _check_magnitude(value, _NUMBER_HINT)
    return float(value)


def _check_magnitude(value: float, allowed: str) -> None:
    """Raise BadQuantity for a number that is not finite, or of an implausible magnitude.

    `allowed` describes the allowed values in the message.
    """
    if not math.isfinite(value):
        raise BadQuantity("not a finite number", allowed)
    if value and not 1 / LARGEST_MAGNITUDE <= abs(value) <= LARGEST_MAGNITUDE:
        raise BadQuantity("implausibly small or large", allowed)


def parse_share(value: object) -> float:
    """Convert a share to a fraction: `20 %`, `20%` and 0.2 all give 0.2.

    Raises BadQuantity for other texts.
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

    `kinds` contains the kind of quantity of each component. Raises BadQuantity for other values.
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
"""Readers of quantities that do not have a unit."""


def parse_interval(value: object, unit_kind: str) -> tuple[float, float]:
    """Convert an interval such as `[-139 deg, -81 deg]` to its bounds in SI units.

    Raises BadQuantity unless the lower bound is first.
    """
    low, high = parse_vector(value, (unit_kind, unit_kind))
    if not low < high:
        raise BadQuantity("the lower bound is not below the upper one", "[lower, upper]")
    return low, high


def _convert(magnitude: float, unit: str, target: "QuantityKind") -> float:
    """Convert a magnitude with a unit to SI units.

    Raises BadQuantity if the unit is unknown, or does not belong to the kind of quantity `target`.
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
    """Return a value in SI units. Raises BadQuantity if its size suggests another unit.

    `text` is the value as the user wrote it.
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
    """Return the factor to SI units and the dimensions of a unit such as N*m*s/rad.

    Raises KeyError with the name of an unknown unit.
    """
    factor = 1.0
    powers = Counter[str]()
    for separator, name, exponent in _FACTORS.findall(text):
        power = int(exponent or 1) * (-1 if separator else 1)
        scale, dimensions = _unit_by_name(name)
        factor *= scale**power
        for dimension, inner_power in dimensions:
            powers[dimension] += power * inner_power
    return factor, tuple(sorted(item for item in powers.items() if item[1] != 0))


@lru_cache(maxsize=256)
def _unit_by_name(name: str) -> tuple[float, Dimensions]:
    """Return the factor and the dimensions of a single unit, which may have a prefix or a plural s.

    Raises KeyError if the unit is unknown.
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
    """Return the factor and the dimensions of a unit without a prefix, or None if it is unknown."""
    if name in _SYMBOLS["base"]:
        return 1.0, ((_SYMBOLS["base"][name][1], 1),)
    if name not in _SYMBOLS["derived"]:
        return None
    factor, unit = _SYMBOLS["derived"][name]
    scale, dimensions = _parse_unit(unit)
    return factor * scale, dimensions


def _quantity_name(dimensions: Dimensions) -> str:
    """Return the name of the quantity with these dimensions, or a text of the dimensions."""
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
    """Describe the type of a YAML value for messages, for example "a list"."""
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
    """Return the unit in which messages display values of an SI unit, and the factor to this unit.

    The result for "rad/s" is ("deg/s", 57.3). "rpm" represents the speed of a motor in rad/s.
    `degree` is the symbol of a degree, such as "°" on pages and in figures.
    """
    base, separator, denominator = unit.partition("/")
    if base == "rad":
        name, scale = degree, 180 / math.pi
    else:
        name, scale = _DISPLAY_UNITS.get(base, (base, 1.0))
    return name + separator + denominator, scale

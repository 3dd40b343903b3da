"""Read motor files, and detect wrong units by comparing the values with each other.

Figures of one datasheet follow from each other by physics: stall torque = k·U/R, no-load speed = (U
− R·I_0)/k, nominal torque = k·(I_N − I_0), and mechanical time constant = J·R/k². Here, k is the
torque constant, U the nominal voltage, R the terminal resistance, I_N and I_0 the nominal and the
no-load current, and J the rotor inertia. The rules in motors.csv state these relations, and ranges
for quantities that only experience limits. `motor_from` builds a motor and applies the rules.
"""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from ssm_planner.loading.schema import (
    POSITIVE,
    SOURCE_KEY,
    Boolean,
    Figure,
    build_class_model,
    locate_errors,
    optional_key,
    quantity_reader,
    sourced_reader,
    validate_section,
)
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.package_table import package_table
from ssm_planner.problem import Motor


def _comparison_figure(quantity_kind: str, description: str) -> Any:
    """Return the type and default of a key that only serves to check other figures of the file.

    Parameters
    ----------
    quantity_kind : str
        Kind of quantity, a key of units.QUANTITY_KINDS such as "torque".
    description : str
        Meaning of the figure.

    Returns
    -------
    tuple
        Type and default of the key, as pydantic expects them.
    """
    hint = Annotated[Figure, sourced_reader(quantity_reader(quantity_kind, POSITIVE))]
    return optional_key(hint, f"{description}, only to check other figures.")


COMPARISON_FIGURES = {
    "speed_constant": _comparison_figure("speed_constant", "Speed constant"),
    "stall_torque": _comparison_figure("torque", "Stall torque"),
    "nominal_speed": _comparison_figure(
        "motor_speed", "Speed at nominal torque and nominal voltage"
    ),
    "no_load_speed": _comparison_figure("motor_speed", "Speed without a load at nominal voltage"),
    "mechanical_time_constant": _comparison_figure("time", "Mechanical time constant"),
}
"""Keys of a motor file that are not fields of Motor. They only serve to check other figures."""
MotorModel = build_class_model(
    Motor,
    {
        "source": SOURCE_KEY,
        "placeholder": (
            Boolean,
            Field(False, description="True if every figure is a placeholder."),
        ),
        **COMPARISON_FIGURES,
    },
    sourced=True,
)
"""Model of a motor file: the figures of a datasheet, each with its source."""

REFERENCE_TEMPERATURE = 298.15
"""Temperature at which datasheets state resistance and torque constant, K."""


PLAUSIBILITY_RULES = package_table(Path(__file__).with_suffix(".csv"))
"""Ranges, from `low` to `high`, of products of powers of figures in SI units.

`figure` is the name that messages contain, and `product` is a text such as `nominal_voltage
torque_constant^-1`. `fault` describes a violation. It may contain the fields `value`, which is the
product, and `expected`, which is the value of the figure for a product of 1. Both are multiplied by
`scale`.
"""


def motor_from(section: Section) -> Motor:
    """Build the motor that a section of a file describes.

    Parameters
    ----------
    section : Section
        Content of a motor file, or the part of a robot file that contains the motor.

    Returns
    -------
    Motor
        The motor with the source of each figure.

    Raises
    ------
    ProblemError
        If a value is invalid, implausible or without a source.
    """
    model: Any = validate_section(section, MotorModel)
    sourced = model.sourced_figures()
    for name, entry in sourced.items():
        if entry.source is None and model.source is None:
            allowed = "{value: …, source: …}, or one source: for the whole file"
            raise section.error("no source", name, allowed=allowed, show=False)
    values = {name: entry.value for name, entry in sourced.items()}
    _check_figures(section, values)
    with locate_errors(section):
        return Motor(
            model.name,
            sources={name: entry.source or model.source for name, entry in sourced.items()},
            placeholders=tuple(
                name for name, entry in sourced.items() if model.placeholder or entry.placeholder
            ),
            file=section.file_name,
            **{name: value for name, value in values.items() if name not in COMPARISON_FIGURES},
        )


def _check_figures(section: Section, values: Mapping[str, float]) -> None:
    """Raise ProblemError if the figures of a motor violate a plausibility rule.

    The rules are in the file motors.csv. A rule is ignored unless all its figures are stated.

    Parameters
    ----------
    section : Section
        The motor file, for messages.
    values : mapping of float
        Stated figures in SI units by key.
    """
    # A rule contains only products of figures. Sums and differences are therefore added as further
    # figures. A figure that is not stated is NaN, and so is every figure that follows from it.
    figures = defaultdict(lambda: math.nan, values)
    voltage, resistance = figures["nominal_voltage"], figures["terminal_resistance"]
    current, no_load_current = figures["nominal_current"], figures["no_load_current"]
    figures["loaded_current"] = current - no_load_current
    figures["loaded_voltage"] = voltage - resistance * current
    figures["idle_voltage"] = voltage - resistance * no_load_current
    figures["thermal_resistance"] = (
        figures["resistance_winding_housing"] + figures["resistance_housing_ambient"]
    )
    figures["permitted_rise"] = figures["max_winding_temperature"] - REFERENCE_TEMPERATURE
    constant = figures["torque_constant"]
    figures["heating_current"] = values.get("nominal_current", figures["nominal_torque"] / constant)
    if "mechanical_time_constant" not in values:
        figures["rotor_time"] = figures["rotor_inertia"] * resistance / constant**2
    for rule in PLAUSIBILITY_RULES:
        check_rule(section, figures, rule)


def check_rule(section: Section, figures: Mapping[str, float], rule: Sequence[str]) -> None:
    """Raise ProblemError if the figures of a datasheet contradict each other.

    A rule states a product of powers of figures that must lie between two limits. For example, the
    product of torque constant and speed constant of a motor is about 1 in SI units. The message
    states the values that the first figure of the rule may have, given the others.

    Parameters
    ----------
    section : Section
        Part of the file with the figures, for messages.
    figures : mapping of float
        Figures in SI units by key. NaN stands for a figure that is not stated, so that its rules
        are not violated.
    rule : sequence of str
        Row of a table of rules: the figure that the message names, the product (for example
        "nominal_voltage torque_constant^-1"), its lower and upper limit, a scale for the message,
        and the description of a violation.
    """
    figure, product_text, *numbers, fault = rule
    factors = (factor.partition("^") for factor in product_text.split())
    powers = {name: int(power or 1) for name, _, power in factors}
    product = math.prod(figures[name] ** power for name, power in powers.items())
    low, high, scale = map(float, numbers)
    if not (product < low or product > high):  # also if the product is NaN
        return
    # Values of the figure for which the product is 1, `low` and `high`.
    expected, *ends = (
        figures[figure] * (end / product) ** (1 / powers.get(figure, 1)) for end in (1.0, low, high)
    )
    allowed = "{:.3g} to {:.3g} in SI units: figures of one datasheet and one winding"
    raise section.error(
        fault.format(value=scale * product, expected=scale * expected),
        *figure.split("."),
        allowed=allowed.format(*sorted(ends)),
    )

"""A motor file → Motor: figures that contradict each other or their unit are found here."""

from __future__ import annotations

from ssm_planner.problem.complaint import validated
from ssm_planner.problem.motor_plausibility import check_plausible
from ssm_planner.problem.schema.motor import MotorModel
from ssm_planner.problem.source import Section
from ssm_planner.problem.values import Motor

LARGEST_TORQUE = 5.0
"""N·m, of a motor that moves a surgical tool; a larger figure has lost its milli."""
SMALLEST_TORQUE = 1e-6
TORQUE_AGREEMENT = 0.25
"""Torque constant times nominal current against nominal torque: the rest is friction and rounding of the motor."""
CONSTANT_AGREEMENT = 0.1
"""Torque constant times speed constant, which is 1 in SI."""


def motor_from(section: Section) -> Motor:
    """The motor that a section describes. Raises ProblemError."""
    model = validated(section, MotorModel)
    figures = dict(model.figures())
    values = {name: figure.value for name, figure in figures.items()}
    for name, figure in figures.items():
        if figure.source is None and model.source is None:
            raise section.error(
                "no source", name, allowed="{value: …, source: …}, or one source: for the whole file", show=False
            )
    _check(section, values)
    check_plausible(section, values)
    sources = {name: figure.source or model.source or "" for name, figure in figures.items()}
    placeholders = tuple(name for name, figure in figures.items() if model.placeholder or figure.placeholder)
    values.pop("speed_constant", None)
    counts = values.pop("encoder_counts", None)
    return Motor(
        name=model.name,
        encoder_counts=None if counts is None else round(counts),
        sources=sources,
        placeholders=placeholders,
        file=str(section.file),
        **values,
    )


def _check(section: Section, values: dict[str, float]) -> None:
    nominal, largest = values["nominal_torque"], values["max_torque"]
    for name in ("nominal_torque", "max_torque"):
        if not SMALLEST_TORQUE <= values[name] <= LARGEST_TORQUE:
            raise section.error(
                f"implausible for a motor of this size ({values[name]:g} N*m): is the unit right, mN*m?",
                name,
                allowed=f"{SMALLEST_TORQUE * 1e3:g} mN*m to {LARGEST_TORQUE:g} N*m",
            )
    if largest < nominal:
        raise section.error("smaller than nominal_torque", "max_torque", allowed=f"at least {nominal:g} N*m")
    if largest > 100 * nominal:
        raise section.error(
            "more than 100 times nominal_torque: is the unit right?", "max_torque", allowed=f"{nominal:g} N*m upwards"
        )
    counts = values.get("encoder_counts")
    if counts is not None and counts != round(counts):
        raise section.error("not a whole number", "encoder_counts")
    constant, current = values.get("torque_constant"), values.get("nominal_current")
    if constant is not None and current is not None and abs(constant * current / nominal - 1) > TORQUE_AGREEMENT:
        raise section.error(
            f"contradicts torque_constant × nominal_current = {constant * current * 1e3:.4g} mN*m by more than 25 %",
            "nominal_torque",
            allowed="figures of one datasheet and one winding",
        )
    speed = values.get("speed_constant")
    if constant is not None and speed is not None and abs(constant * speed - 1) > CONSTANT_AGREEMENT:
        raise section.error(
            f"contradicts torque_constant, which gives {1 / constant * 60 / 6.283185307179586:.4g} rpm/V",
            "speed_constant",
            allowed="speed constant = 1 / torque constant in SI",
        )

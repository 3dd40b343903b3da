"""Valid quantities are read, and messages about others state the expected form."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.units import (
    QUANTITY_KINDS,
    BadQuantity,
    parse_interval,
    parse_number,
    parse_quantity,
    parse_vector,
)

NUMBERS = st.floats(min_value=-1e3, max_value=1e3).filter(lambda x: x == 0 or abs(x) > 1e-9)


@pytest.mark.parametrize(
    ("text", "kind", "expected"),
    [
        ("65 deg/s", "angular_velocity", math.radians(65)),
        ("200 deg/s^2", "angular_acceleration", math.radians(200)),
        ("20 mm", "length", 0.02),
        ("80 mN*m", "torque", 0.08),
        ("80 mN m", "torque", 0.08),
        ("80 mNm", "torque", 0.08),
        ("-140deg", "angle", math.radians(-140)),
        ("−140°", "angle", math.radians(-140)),
        ("1.5 rad", "angle", 1.5),
        ("0.165 g*cm^2", "inertia", 1.65e-8),
        ("6.5e-7 kg*m**2", "inertia", 6.5e-7),
        ("6.5e-7 kg·m²", "inertia", 6.5e-7),
        ("60 rpm", "motor_speed", 2 * math.pi),
        ("3 rad/s", "motor_speed", 3.0),
        ("7.18e-5 N*m*s/rad", "rotary_viscosity", 7.18e-5),
        ("7.18e-5 N*m*s", "rotary_viscosity", 7.18e-5),
        ("0.1 N*s/m", "linear_viscosity", 0.1),
        ("24 V", "voltage", 24.0),
        ("2480 mA", "current", 2.48),
        ("0.763 ohm", "resistance", 0.763),
        ("0.763 Ω", "resistance", 0.763),
        ("14.8 mN*m/A", "torque_constant", 0.0148),
        ("645 rpm/V", "speed_constant", 645 * 2 * math.pi / 60),
        ("2.46 K/W", "thermal_resistance", 2.46),
        ("155 degC", "temperature", 428.15),
        ("200 1/s", "rate", 200.0),
        ("0.2s", "time", 0.2),
        (".5 s", "time", 0.5),
    ],
)
def test_reads(text: str, kind: str, expected: float) -> None:
    assert parse_quantity(text, kind) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("value", "kind", "parts"),
    [
        (5, "angle", ("without a unit", "an angle such as -110 deg")),
        ("5", "angle", ("without a unit", "deg")),
        (5.0, "angular_velocity", ("without a unit", "a speed such as 65 deg/s")),
        ("5 m/m", "angle", ("pure number", "not an angle")),
        ("5 mm", "angle", ("a length, not an angle",)),
        ("20 deg", "length", ("an angle, not a length", "20 mm")),
        ("80 mN/m", "torque", ("not a torque", "80 mN*m")),
        ("80 mN*m", "force", ("a torque, not a force",)),
        ("65 deg", "angular_velocity", ("an angle, not a speed",)),
        ("65 1/s", "angular_velocity", ("a rate, not a speed",)),
        ("20 mm/s", "angular_velocity", ("is not a speed in rad/s", "65 deg/s")),
        ("20 deg/s", "velocity", ("is not a speed in m/s", "20 mm/s")),
        ("2e5 N/m", "rotary_stiffness", ("is not a stiffness in N*m/rad",)),
        ("900 N*m", "rotary_stiffness", ("a torque, not a stiffness",)),
        ("-110 rad", "angle", ("did you mean deg",)),
        ("20 m", "length", ("did you mean mm",)),
        ("65 rad/s", "angular_velocity", ("did you mean deg/s",)),
        ("nan deg", "angle", ("not a number",)),
        ("1e999 deg", "angle", ("not a finite",)),
        (float("nan"), "angle", ("without a unit",)),
        ("5 foo", "angle", ("unknown unit 'foo'",)),
        ("5 m^9^9", "length", ("not a unit",)),
        ("5 m**9**9**9", "length", ("not a unit",)),
        ("5 (m)", "length", ("not a unit",)),
        ("1,5 mm", "length", ("not a unit",)),
        ("ten mm", "length", ("not a number with a unit",)),
        ("", "length", ("not a number",)),
        (None, "length", ("nothing where a length",)),
        (True, "length", ("true/false",)),
        ([1], "length", ("a list",)),
        ({}, "length", ("a mapping",)),
        ("-300 degC", "temperature", ("absolute zero",)),
        ("0.13 N", "number", ("has no unit", "0.13")),
        ("0.13 kg/kg", "number", ("has no unit",)),
        (float("inf"), "number", ("not a finite",)),
        ("much", "number", ("a text where a number",)),
    ],
)
def test_refuses(value: object, kind: str, parts: tuple[str, ...]) -> None:
    with pytest.raises(BadQuantity) as caught:
        parse_number(value) if kind == "number" else parse_quantity(value, kind)
    for part in parts:
        assert part in str(caught.value)


@cache
def pint_registry() -> Any:
    """Return the unit registry of pint. Pint is imported only on demand, because that takes 2 s."""
    import pint

    return pint.UnitRegistry()


@pytest.mark.parametrize("kind", [kind for kind in QUANTITY_KINDS if kind != "temperature"])
def test_units_convert_as_in_pint(kind: str) -> None:
    registry = pint_registry()
    text = QUANTITY_KINDS[kind].example
    expected = registry.Quantity(text.replace("1/s", "/s")).to(QUANTITY_KINDS[kind].unit).magnitude
    assert parse_quantity(text, kind) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("text", ["3 kilograms", "2 kilogram", "40 g", "40 grams"])
def test_units_written_out_have_plurals(text: str) -> None:
    amount, unit = text.split()
    assert parse_quantity(text, "mass") == pytest.approx(
        float(amount) * (1e-3 if unit[0] == "g" else 1.0)
    )


@pytest.mark.parametrize("text", ["3 cms", "3 kmm", "3 s_", "3 mmm"])
def test_neither_two_prefixes_nor_plurals_of_symbols(text: str) -> None:
    with pytest.raises(BadQuantity, match="unknown unit"):
        parse_quantity(text, "length")


@given(NUMBERS)
def test_prefixes_agree(value: float) -> None:
    assert parse_quantity(f"{value!r} mN*m", "torque") == pytest.approx(
        parse_quantity(f"{value / 1000!r} N*m", "torque")
    )


@given(st.floats(-700, 700).filter(lambda value: value == 0 or abs(value) > 1e-40))
def test_degrees_are_radians(value: float) -> None:
    assert parse_quantity(f"{value!r} deg", "angle") == pytest.approx(
        math.radians(value), rel=1e-14
    )


@given(st.sampled_from(sorted(QUANTITY_KINDS)), st.sampled_from(sorted(QUANTITY_KINDS)))
def test_a_kind_takes_its_own_unit_and_no_other_dimension(wanted: str, offered: str) -> None:
    text = QUANTITY_KINDS[offered].example
    same_dimension = {QUANTITY_KINDS[k].unit for k in (wanted, offered)} == {
        QUANTITY_KINDS[wanted].unit
    }
    if same_dimension:
        parse_quantity("1" + text[text.index(" ") :], wanted)
    else:
        with pytest.raises(BadQuantity, match="not a"):
            parse_quantity(text, wanted)


def outcome(text: str, kind: str) -> float | str:
    try:
        return parse_quantity(text, kind)
    except BadQuantity as error:
        return str(error)


@given(
    st.text(max_size=30) | st.text("0123456789.eE+-*/^() mNgskradegV1", max_size=20),
    st.sampled_from(sorted(QUANTITY_KINDS)),
)
def test_any_text_is_read_or_refused(text: str, kind: str) -> None:
    for written in (text, "1 " + text):
        result = outcome(written, kind)
        assert (
            QUANTITY_KINDS[kind].name in result
            if isinstance(result, str)
            else math.isfinite(result)
        )


def test_vectors_and_intervals() -> None:
    assert parse_vector("(1, -2, 3e1) mm", ("length",) * 3) == pytest.approx((0.001, -0.002, 0.03))
    assert parse_vector(["1 mm", "2 mm"], ("length",) * 2) == pytest.approx((0.001, 0.002))
    assert parse_interval(["-139 deg", "-81 deg"], "angle") == pytest.approx(
        (math.radians(-139), math.radians(-81))
    )


@pytest.mark.parametrize(
    ("value", "part"),
    [
        (["-81 deg", "-139 deg"], "not below"),
        (["1 deg", "1 deg"], "not below"),
        (["1 deg"], "1 values"),
        (["1 deg", "2 deg", "3 deg"], "3 values"),
        ([1, 2], "without a unit"),
        ("(1, 2)", "without a unit"),
        ("1 deg", "a text where 2 values"),
        (["1 deg", "2 mm"], "a length, not an angle"),
    ],
)
def test_bad_intervals(value: object, part: str) -> None:
    with pytest.raises(BadQuantity, match=part):
        parse_interval(value, "angle")

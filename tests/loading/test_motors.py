"""Motor files: values, sources and placeholders are read. Contradictory values are refused with a
message that names the line.
"""

from __future__ import annotations

from typing import Any

import pytest

M22 = "motors/maxon_ecx_torque_22_m.yaml"
EC13 = "motors/maxon_ec_13_6w.yaml"


@pytest.mark.parametrize(
    ("file", "old", "new", "parts"),
    [
        (
            M22,
            "value: 36.7 mN*m",
            "value: 26 mN*m",
            ("nominal_torque", "36.7 mN*m", "35 %", "one winding"),
        ),
        (
            M22,
            "value: 645 rpm/V",
            "value: 500 rpm/V",
            ("speed_constant", "contradicts torque_constant", "645.2 rpm/V"),
        ),
        (M22, "value: 2480 mA", "value: 2480 A", ("nominal_current.value", "did you mean mA")),
        (
            M22,
            "value: 14.8 mN*m/A",
            "value: 14.8 mN*m",
            ("a torque, not a torque constant", "14.8 mN*m/A"),
        ),
        (M22, "value: 78 mN*m", "value: 30 mN*m", ("max_torque", "smaller than nominal_torque")),
        (
            M22,
            "  placeholder: true",
            "  placeholder: perhaps",
            ("max_speed.placeholder = perhaps", "true or false"),
        ),
        (
            EC13,
            "nominal_torque: 2.19 mN*m",
            "nominal_torque: 10 N*m",
            ("implausible", "10 N*m", "mN*m"),
        ),
        (EC13, "nominal_torque: 2.19 mN*m", "nominal_torque: 2.19 N", ("a force, not a torque",)),
        (EC13, "nominal_torque: 2.19 mN*m", "nominal_torque: 0 mN*m", ("not greater than zero",)),
        (
            EC13,
            "nominal_torque: 2.19 mN*m",
            "nominal_torqe: 2.19 mN*m",
            ("did you mean 'nominal_torque'?",),
        ),
        (EC13, "max_speed: 50000 rpm", "max_speed: 50000 rad/s", ("did you mean rpm",)),
        (EC13, "max_speed: 50000 rpm", "max_speed: 50000", ("without a unit", "8000 rpm")),
        (EC13, "max_speed: 50000 rpm", "max_speed:", ("empty value",)),
        (EC13, "  value: 2.19 mN*m", "  value: 2.19 N*m", ("max_torque", "more than 100 times")),
        (
            EC13,
            "max_torque:",
            "encoder_counts: 10.5\nmax_torque:",
            ("encoder_counts = 10.5", "whole number"),
        ),
    ],
)
def test_bad_motors(files: Any, file: str, old: str, new: str, parts: tuple[str, ...]) -> None:
    # A message about contradictory values points to the first line of the entry of a value.
    complete = {
        "max_torque": "max_torque:",
        "speed_constant": "speed_constant:",
        "nominal_torque": "nominal_torque:",
    }
    message = files.rejection(file, old, new, complete.get(parts[0]))
    for part in parts:
        assert part in message


def test_a_figure_needs_a_source(files: Any) -> None:
    message = files.rejection(EC13, "source: manufacturer's datasheet", "", at="nominal_torque")
    assert "no source" in message


def test_every_fault_of_a_file_is_listed(files: Any) -> None:
    files.edit(EC13, "nominal_voltage: 24 V", "nominal_voltage: 24")
    message = files.rejection(EC13, "max_speed: 50000 rpm", "max_sped: 1 rpm", at="max_sped")
    assert (
        "did you mean 'max_speed'?" in message
    )  # Unknown keys are reported alone, because other faults may follow from them.
    files.edit(EC13, "max_sped: 1 rpm", "max_speed: 1")
    message = files.rejection(
        EC13, "torque_constant: 8.03 mN*m/A", "torque_constant: 8", at="nominal_voltage"
    )
    assert [line.split(": ")[1].split(" = ")[0] for line in message.splitlines()] == [
        "nominal_voltage",
        "torque_constant",
        "max_speed",
    ]


def test_placeholders_are_named_and_explained(files: Any) -> None:
    motor = files.load(M22)
    assert motor.placeholders == ("max_speed", "encoder_counts")
    assert motor.placeholder
    assert "no datasheet" in motor.sources["max_speed"]
    motor = files.load("motors/maxon_ecx_torque_22_xl.yaml")
    stated = {name for name in motor.sources if getattr(motor, name) is not None}
    assert set(motor.placeholders) == stated
    assert all("22 M" in motor.sources[name] for name in stated - {"encoder_counts"})
    assert "rigs" in motor.sources["encoder_counts"]


def test_complete_motor(files: Any) -> None:
    motor = files.load(EC13)
    assert motor.nominal_torque == pytest.approx(2.19e-3)
    assert motor.rotor_inertia == pytest.approx(0.165e-7)
    assert motor.max_speed == pytest.approx(50000 * 3.141592653589793 / 30)
    assert motor.placeholders == ("max_torque",)

"""A motor with a wrong unit or with a value of another motor contradicts physical relations and is
refused. The tests change every motor of the shipped catalogue.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import pytest

from ssm_planner import units
from ssm_planner.errors import ProblemError
from ssm_planner.loading.catalogues import read_motors
from ssm_planner.loading.load import load_motor
from tests.support.paths import PROBLEMS

CATALOGUE = PROBLEMS / "catalogues/motors_24v.csv"
ROWS = list(csv.reader(CATALOGUE.read_text(encoding="utf-8").splitlines()))
HEADINGS, MOTORS = ROWS[0], ROWS[1:]
SLIPS = {
    "nominal_voltage": (1e3, 1e-3, 100, 1e-2, 10, 0.1),
    "nominal_torque": (1e3, 1e-3, 100, 1e-2, 10, 0.1),
    "nominal_current": (1e3, 1e-3, 100, 1e-2, 10, 0.1),
    "nominal_speed": (60 / (2 * math.pi), 2 * math.pi / 60, 1e3),
    "chart_max_torque": (1e3, 1e-3, 100, 1e-2),
    "stall_torque": (1e3, 1e-3, 10, 0.1),
    "max_speed": (60 / (2 * math.pi), 2 * math.pi / 60, 100),
    "terminal_resistance": (1e3, 1e-3, 100, 1e-2),
    "torque_constant": (1e3, 1e-3, 10, 0.1, 60 / (2 * math.pi), 2 * math.pi / 60),
    "rotor_inertia": (1e7, 1e4, 1e3, 100, 1e-2, 1e-3),
    "no_load_current": (1e3, 100, 60, 1 / 60, 1e-2, 1e-3),
    "time_constant_motor": (60, 1 / 60, 1e3),
    "time_constant_winding": (1e3, 60, 1e-3),
    "resistance_housing_ambient": (100, 1e-2, 1e3),
    "max_winding_temperature": (10, 0.1),
    "weight": (1e3, 1e-3, 100, 1e-2),
}


def written(file: Path, rows: list[list[str]], separator: str = ",") -> Path:
    """Write a catalogue with these rows, and return its file."""
    with file.open("w", encoding="utf-8", newline="") as out:
        csv.writer(out, delimiter=separator).writerows([HEADINGS, *rows])
    return file


def fault_of(file: Path) -> ProblemError | None:
    """Return the error that reading a catalogue raises, or None."""
    try:
        read_motors(file)
    except ProblemError as error:
        return error
    return None


def scaled(cell: str, factor: float) -> str:
    """Return a quantity whose number is multiplied by a factor."""
    number, _, unit = cell.partition(" ")
    return f"{float(number) * factor!r} {unit}"


@pytest.mark.parametrize("column", SLIPS)
def test_a_wrong_unit_is_refused_in_every_row(tmp_path: Path, column: str) -> None:
    """The message names the file, the line, the key and the allowed values, whichever of the
    related values it blames.
    """
    k = HEADINGS.index(column)
    accepted = []
    for motor in MOTORS:
        for factor in SLIPS[column]:
            row = list(motor)
            row[k] = scaled(row[k], factor)
            file = written(tmp_path / "motors.csv", [row])
            fault = fault_of(file)
            if fault is None:
                accepted.append((motor[0], factor))
                continue
            assert str(fault).startswith(f"{file}:2: ")
            assert fault.key
            assert "allowed" in str(fault)
    assert not accepted


def test_figures_of_two_motors_in_one_row_are_refused(tmp_path: Path) -> None:
    """Electrical values of another motor are refused if they differ by more than about a fifth."""
    kinds = {"torque_constant": "torque_constant", "terminal_resistance": "resistance"}
    for one, other in zip(MOTORS, MOTORS[7:] + MOTORS[:7], strict=True):
        for name, kind in kinds.items():
            k = HEADINGS.index(name)
            ratio = units.parse_quantity(other[k], kind) / units.parse_quantity(one[k], kind)
            if 0.8 < ratio < 1.25:
                continue
            row = [*one[:k], other[k], *one[k + 1 :]]
            with pytest.raises(ProblemError, match=r":2: "):
                read_motors(written(tmp_path / "motors.csv", [row]))


def motor_file(folder: Path, **figures: Any) -> Path:
    """Write a motor file with consistent values and the given changes, and return the file."""
    inputs = {
        "name": "M",
        "source": "a test",
        "nominal_torque": "2.64 mN*m",
        "max_torque": "8 mN*m",
        "max_speed": "90000 rpm",
        "nominal_voltage": "24 V",
        "nominal_current": "1.05 A",
        "no_load_current": "156 mA",
        "torque_constant": "2.93 mN*m/A",
        "terminal_resistance": "0.973 ohm",
        "rotor_inertia": "0.13 g*cm^2",
    } | figures
    file = folder / "motor.yaml"
    file.write_text("".join(f"{k}: {v}\n" for k, v in inputs.items() if v), encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("key", "right", "wrong"),
    [
        ("mechanical_time_constant", "1.47 ms", "14.7 ms"),
        ("no_load_speed", "77700 rpm", "60000 rpm"),
        ("nominal_speed", "74500 rpm", "40000 rpm"),
        ("stall_torque", "72.3 mN*m", "60 mN*m"),
        ("speed_constant", "3260 rpm/V", "2500 rpm/V"),
        ("no_load_current", "156 mA", "156 A"),
        ("rotor_inertia", "0.13 g*cm^2", "13 g*cm^2"),
    ],
)
def test_each_figure_agrees_with_the_others(
    tmp_path: Path, key: str, right: str, wrong: str
) -> None:
    load_motor(motor_file(tmp_path, **{key: right}))
    file = motor_file(tmp_path, **{key: wrong})
    line = 1 + [text.split(":")[0] for text in file.read_text().splitlines()].index(key)
    with pytest.raises(ProblemError) as caught:
        load_motor(file)
    assert str(caught.value).startswith(f"{file}:{line}: {key} = {wrong}: ")


def test_a_stated_mechanical_time_constant_permits_an_unusual_rotor(tmp_path: Path) -> None:
    """A datasheet may state the large mechanical time constant of a slow motor.

    The product J·R/k² is then compared with it and not with a general bound.
    """
    unusual = {"rotor_inertia": "13 g*cm^2", "mechanical_time_constant": "147 ms"}
    assert load_motor(motor_file(tmp_path, **unusual)).rotor_inertia == pytest.approx(13e-7)

"""Catalogues that spreadsheets write are read. Inconsistent or hostile catalogues are refused with
file and line.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.loading.catalogues import drives_with_gears, read_motors
from ssm_planner.loading.load import load_robot
from ssm_planner.loading.tables import LEADING_NUMBER
from tests.support.paths import PROBLEMS

MOTORS = PROBLEMS / "catalogues/motors_24v.csv"
WORM = (
    "name,geometry.ratio,geometry.worm_diameter,geometry.lead [mm],output_inertia [kg*m^2],"
    "ratings.continuous_output,ratings.peak_output,ratings.input_speed,ratings.duty,mass [g]\n"
    "w1,60,8 mm,1.25664,4.7e-9,0.5 N*m,1 N*m,4000 rpm,0.5,12\n"
    "w2,40,8 mm,1.25664,4.7e-9,0.5 N*m,1 N*m,4000 rpm,0.5,12\n"
)
SMALL = "".join(line + "\n" for line in MOTORS.read_text(encoding="utf-8").splitlines()[:3])


def with_commas(text: str, separator: str, texts: tuple[str, ...] = ("name", "source")) -> str:
    """Return the table as a spreadsheet with decimal commas writes it."""
    headings, *rows = csv.reader(io.StringIO(text))
    changed = [
        [
            cell.replace(".", ",", 1)
            if heading not in (*texts, "order_number") and LEADING_NUMBER.match(cell)
            else cell
            for heading, cell in zip(headings, row, strict=True)
        ]
        for row in rows
    ]
    out = io.StringIO()
    csv.writer(out, delimiter=separator).writerows([headings, *changed])
    return out.getvalue()


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas_mean_the_same(tmp_path: Path, separator: str) -> None:
    file = tmp_path / MOTORS.name
    text = with_commas(MOTORS.read_text(encoding="utf-8"), separator)
    assert "2,64 mN*m" in text
    file.write_text(text, encoding="utf-8")
    assert read_motors(file) == read_motors(MOTORS)
    robot = load_robot("vitreoretinal")
    for name, joint in (("worms", robot.joints[0]), ("screws", robot.joints[3])):
        shipped = PROBLEMS / f"catalogues/{name}.csv"
        text = shipped.read_text(encoding="utf-8")
        file = tmp_path / shipped.name
        file.write_text(with_commas(text, separator), encoding="utf-8")
        assert drives_with_gears(file, joint.drive) == drives_with_gears(shipped, joint.drive)


def test_commas_in_texts_stay(tmp_path: Path) -> None:
    file = tmp_path / MOTORS.name
    text = with_commas(SMALL, ";").replace("ECX SPEED 13M Ø13 mm", "2,5 ECX SPEED 13M, 1.5")
    file.write_text(text, encoding="utf-8")
    assert "2,5 ECX SPEED 13M, 1.5" in read_motors(file)[0].of.name


MOTOR_FAULTS = [
    # numbers
    ("2.64 mN*m", "2,64 mN*m"),
    ("2.64 mN*m", "2.64"),
    ("2.64 mN*m", "nan mN*m"),
    ("2.64 mN*m", "inf mN*m"),
    ("2.64 mN*m", "1e999 mN*m"),
    ("2.64 mN*m", "-2.64 mN*m"),
    ("2.64 mN*m", "0 mN*m"),
    ("2.64 mN*m", ""),
    ("2.64 mN*m", "about 2.64 mN*m"),
    ("2.64 mN*m", "2.64..2.7 mN*m"),
    ("2.64 mN*m", "2.64 mN*m or more"),
    ("2.64 mN*m", "=2+0.64 mN*m"),
    ("2.64 mN*m", "2.64e mN*m"),
    ("2.64 mN*m", "0x2 mN*m"),
    ("2.64 mN*m", "٢٫٦ mN*m"),
    ("90000 rpm", "90'000 rpm"),
    ("90000 rpm", "90 000 rpm"),
    ("90000 rpm", "90.000 rpm"),
    ("90000 rpm", "90_000 rpm"),
    ("90000 rpm", "true"),
    ("90000 rpm", "9e4 1/min^2"),
    # units
    ("2.64 mN*m", "2.64 mN"),
    ("2.64 mN*m", "2.64 mN*m mN*m"),
    ("2.64 mN*m", "2.64 mN*cm/s"),
    ("0.13 g*cm^2", "0.13 g*cm"),
    ("0.13 g*cm^2", "0.13 kg*cm^2"),
    ("0.13 g*cm^2", "13 g*cm^2"),
    ("0.13 g*cm^2", "0.13 g*mm^2"),
    ("32 g,", "32 kg,"),
    ("32 g,", "-32 g,"),
    ("155 degC", "155 K"),
    ("155 degC", "155 degF"),
    ("155 degC", "1155 degC"),
    ("29.5 K/W", "29.5 W/K"),
    ("1.74 s", "1.74 min"),
    ("475 s", "475 min"),
    ("0.973 ohm", "973 ohm"),
    ("0.973 ohm", "0.973 mohm"),
    ("156 mA", "156 A"),
    # figures that contradict each other
    ("90000 rpm", "9000 rpm"),
    ("2.93 mN*m/A", "5 mN*m/A"),
    ("72.3 mN*m", "40 mN*m"),
    ("8.52 mN*m", "2.5 mN*m"),
    ("1.05 A", "0.1 A"),
    ("1.05 A", "2.1 A"),
    ("156 mA", "1.06 A"),
    ("74500 rpm", "95000 rpm"),
    ("74500 rpm", "30000 rpm"),
    ("2.5 K/W,1.74 s,475 s", "2.5 K/W,475 s,1.74 s"),
    ("29.5 K/W,2.5 K/W", "2.5 K/W,29.5 K/W"),
    ("0.13 g*cm^2", "1e-9 kg*m^2,"),
    # the table
    ("ECXZ13M1VF40N1IL1D561A", "ECXZ13M3KN48K1ST1D497A"),
    ('ECXZ13M3KN48K1ST1D497A,"ECX SPEED 13M Ø13 mm, brushless, with Hall sensors"', ","),
    ("max_speed", "nominal_torque"),
    ("chart_max_torque", "max_torque,chart_max_torque"),
    ("stall_torque", "max_torque"),
    ("terminal_inductance", "mass"),
    ("order_number,name", "number,title"),
    (",154 mA", ""),
    (",154 mA", ",154 mA,1"),
    ("max_speed", "max_sped"),
    ("nominal_torque", "nominal_torque [mN*m]"),
    ("24 g", '"24 g'),
    ("\n", "\n\0"),
]


@pytest.mark.parametrize(("old", "new"), MOTOR_FAULTS)
def test_hostile_motors_are_refused(tmp_path: Path, old: str, new: str) -> None:
    assert old in SMALL
    file = tmp_path / "motors.csv"
    file.write_text(SMALL, encoding="utf-8")
    assert len(read_motors(file)) == 2
    file.write_text(SMALL.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ProblemError, match=r"motors\.csv:\d+: "):
        read_motors(file)


COMMA_FAULTS = [
    ("2,64 mN*m", "2.64 mN*m"),
    ("2,64 mN*m", "2,64,0 mN*m"),
    ("2,64 mN*m", "1.002,64 mN*m"),
    ("90000 rpm", "90.000 rpm"),
    ("90000 rpm", "90,000 rpm"),
    ("2,64 mN*m", "2;64 mN*m"),
    ("0,973 ohm", "973,000 ohm"),
    ("2,64 mN*m", "2,640.0 mN*m"),
]


@pytest.mark.parametrize(("old", "new"), COMMA_FAULTS)
def test_hostile_commas_are_refused(tmp_path: Path, old: str, new: str) -> None:
    text = with_commas(SMALL, ";")
    assert old in text
    file = tmp_path / "motors.csv"
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ProblemError, match=r"motors\.csv:2: "):
        read_motors(file)


GEAR_FAULTS = [
    ("60,8 mm", "-60,8 mm"),
    ("60,8 mm", "60 mm,8 mm"),
    ("60,8 mm", "nan,8 mm"),
    ("60,8 mm", "60,8"),
    ("60,8 mm", "60,8 m"),
    ("60,8 mm", "60,0 mm"),
    ("1.25664", "-1.25664"),
    ("1.25664", "1,25664"),
    ("1.25664", "1.25664 mm"),
    ("4.7e-9", "-4.7e-9"),
    ("0.5 N*m,1 N*m", "1 N*m,0.5 N*m"),
    ("0.5 N*m,1 N*m", "0.5 N,1 N*m"),
    ("0.5 N*m,1 N*m", "0 N*m,1 N*m"),
    ("4000 rpm", "4000 mm"),
    ("4000 rpm,0.5", "4000 rpm,50"),
    ("4000 rpm,0.5", "4000 rpm,-0.5"),
    (",12\n", ",-12\n"),
    (",12\n", ",0\n"),
    (",12\n", ",12 kg\n"),
    (",12\n", ",inf\n"),
    ("geometry.ratio", "geometry.raito"),
    ("ratings.duty", "ratings.dutty"),
    ("ratings.duty", "rating.duty"),
    ("ratings.duty", "ratings.peak_output"),
    ("mass [g]", "mass [mm]"),
    ("mass [g]", "kind"),
    ("w2", "w1"),
]


@pytest.mark.parametrize(("old", "new"), GEAR_FAULTS)
def test_hostile_gears_are_refused(tmp_path: Path, old: str, new: str) -> None:
    drive = load_robot("vitreoretinal").joints[0].drive
    assert drive is not None
    file = tmp_path / "gears.csv"
    file.write_text(WORM, encoding="utf-8")
    assert len(drives_with_gears(file, drive)) == 2
    assert old in WORM
    file.write_text(WORM.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ProblemError, match=r"gears\.csv:\d+: "):
        drives_with_gears(file, drive)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\n\n",
        b"# only a remark\n",
        b"name,nominal_torque\n",
        "name,nominal_torque\nA,1 mN*m\n".encode("utf-16"),
        b"name,nominal_torque\nA\xff,1 mN*m\n",
        b"PK\x03\x04\x14\x00\x06\x00",
        b"name,nominal_torque\n" + b"A,1 mN*m\n" * 2,
        b"name;nominal_torque\nA,1 mN*m\n",
        b'name,nominal_torque\n"A,1 mN*m\n',
        b"<html><table><tr><td>name</td></tr></table></html>",
        b'{"name": "A", "nominal_torque": 1}',
    ],
)
def test_a_file_that_is_no_catalogue_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "motors.csv"
    file.write_bytes(content)
    with pytest.raises(ProblemError, match=r"motors\.csv"):
        read_motors(file)

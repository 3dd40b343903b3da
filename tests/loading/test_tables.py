"""A table has the same contents with any separator. Decimal commas are refused with line and
column.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.errors import ProblemError, TrajectoryError
from ssm_planner.formats.csv import read_csv
from ssm_planner.identification.torque_map import TABLE_NAME, read_torque_map
from ssm_planner.loading.catalogues import drives_with_gears, read_motors
from ssm_planner.loading.load import load_problem, load_robot
from ssm_planner.loading.tables import DECIMAL_COMMA, SEPARATORS, table_rows
from tests.support.paths import PROBLEMS

MOTORS = PROBLEMS / "catalogues/motors_24v.csv"
HEADER = "time_s,q1_rad,q2_rad,q3_rad,q4_m,motor1_torque_Nm\n"
CELL = st.text(st.characters(codec="ascii", categories=("L", "N", "P", "S", "Zs")), max_size=8)


def rewritten(text: str, separator: str) -> str:
    """Return the table with another separator and a byte order mark, as a spreadsheet writes it."""
    out = io.StringIO()
    csv.writer(out, delimiter=separator).writerows(csv.reader(io.StringIO(text)))
    return "\ufeff" + out.getvalue()


@pytest.mark.parametrize("separator", SEPARATORS)
def test_a_catalogue_means_the_same_with_every_separator(tmp_path: Path, separator: str) -> None:
    file = tmp_path / MOTORS.name
    file.write_text(rewritten(MOTORS.read_text(encoding="utf-8"), separator), encoding="utf-8")
    assert read_motors(file) == read_motors(MOTORS)
    drive = load_robot("vitreoretinal").joints[3].drive
    screws = PROBLEMS / "catalogues/screws.csv"
    file = tmp_path / screws.name
    file.write_text(rewritten(screws.read_text(encoding="utf-8"), separator), encoding="utf-8")
    assert drives_with_gears(file, drive) == drives_with_gears(screws, drive)


@pytest.mark.parametrize("separator", SEPARATORS)
def test_a_table_of_figures_means_the_same(tmp_path: Path, separator: str) -> None:
    figures = PROBLEMS / "drives" / TABLE_NAME
    lines = figures.read_text(encoding="utf-8").splitlines(keepends=True)
    text = "".join(line for line in lines if not line.startswith("#"))
    file = tmp_path / TABLE_NAME
    file.write_text(rewritten(text, separator), encoding="utf-8")
    a, b = (read_torque_map(path, "rig3_worm") for path in (figures, file))
    assert a.names == b.names
    assert np.array_equal(a.tau, b.tau)


@pytest.mark.parametrize("separator", SEPARATORS)
def test_a_path_means_the_same(tmp_path: Path, separator: str) -> None:
    text = "tilt [deg],depth_mm\n-95,5\n-96,6.5\n-97,7\n"
    motions = []
    for name, content in (("a", text), ("b", rewritten(text, separator))):
        (tmp_path / f"{name}.csv").write_text(content, encoding="utf-8")
        problem = tmp_path / f"{name}.yaml"
        problem.write_text(
            "robot: vitreoretinal\nstart: {roll: 0 deg, tilt: -95 deg, spin: 0 deg, depth: 5 mm}\n"
            f"motion:\n  - path: {name}.csv\n",
            encoding="utf-8",
        )
        motions.append(load_problem(problem).motion[0])
    assert motions[0].to == motions[1].to
    assert motions[0].through == motions[1].through


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a;b\n0,5;1\n", [":2: column a = 0,5: ", "semicolons"]),
        ("a\tb\n1\t-1,25e3 mm\n", [":2: column b = -1,25e3 mm: ", "tabs"]),
        ('a,b\n1,"0,5"\n', [":2: column b = 0,5: ", "commas"]),
        ("a,b\n0,5,1,5\n", [":2: 4 cells", "2 as in the headings", "commas"]),
        ("a;b\n1\n", [":2: 1 cells", "semicolons"]),
        ("a,b\n1," + "9" * 200_000 + "\n", [":2: ", "invalid table"]),
    ],
)
def test_a_bad_table_is_refused_with_the_line(tmp_path: Path, text: str, words: list[str]) -> None:
    file = tmp_path / "table.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ProblemError) as caught:
        list(table_rows(file))
    for word in words:
        assert word in str(caught.value)


@given(st.lists(st.lists(CELL.map(str.strip), min_size=3, max_size=3), max_size=5))
def test_cells_return_from_every_separator(tmp_path_factory, rows: list[list[str]]) -> None:
    file = tmp_path_factory.getbasetemp() / "random.csv"
    kept = [row for row in rows if any(row) and row[0][:1] != "#"]
    for separator in SEPARATORS:
        out = io.StringIO()
        csv.writer(out, delimiter=separator, quoting=csv.QUOTE_ALL).writerows([["x", "y", "z"]])
        csv.writer(out, delimiter=separator, quoting=csv.QUOTE_ALL).writerows(kept)
        file.write_text(out.getvalue(), encoding="utf-8")
        if not any(DECIMAL_COMMA.fullmatch(cell) for row in kept for cell in row):
            assert [cells for _, cells in table_rows(file)] == [["x", "y", "z"], *kept]


def test_a_trajectory_with_decimal_commas_between_commas_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "motion.csv"
    rows = [f"0,{k},0,1,-1,5,0,0,-0,005,0,{k}\n" for k in range(1, 9)]
    file.write_text(HEADER + "".join(rows), encoding="utf-8")
    with pytest.raises(TrajectoryError, match=r"motion.csv:2: .*12 columns.* 6"):
        read_csv(file, load_robot("vitreoretinal"))

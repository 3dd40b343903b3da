"""The published figures in the program equal those that the paper prints."""

from __future__ import annotations

import math
import re

import pytest

from paper_reproduction import published
from paper_reproduction.published import DRIVEN, TABLE_I, TABLE_I_MEASURED, TABLE_II, TABLE_III
from ssm_planner.problem.robot import Robot
from tests.support.paths import SHARED

PAPER_FILE = SHARED / "paper.tex"
NUMBER = r"-?\d+(?:\.\d+)?"


def numbers_of_row(paper: str, label: str) -> list[float]:
    """Return the numbers of the table row that starts with a label."""
    result = re.search(re.escape(label) + r"(.*?)\\\\", paper)
    assert result, label
    return [float(text) for text in re.findall(NUMBER, result.group(1))]


def check_table_i(paper: str) -> None:
    printed = numbers_of_row(paper, r"\makecell[r]{Range w.r.t.\\$\omega_1$-axis}")
    assert [round(math.degrees(end), 6) for end in (*TABLE_I, *TABLE_I_MEASURED)] == printed
    assert (
        float(re.search(r"(\d+\.\d)\\%\$ agreement between the theo", paper)[1]) / 100
        == published.TILT_AGREEMENT
    )


def check_table_ii(paper: str) -> None:
    rows = ((r"$\mu_c$ &&", "mu", 1.0), (r"$\mu_{s}$ &&", "mu_static", 1.0))
    rows += ((r"$10^3b_c$ &&", "b_c", 1e-3), (r"$10^5b_v$ &&", "b_v", 1e-5))
    for label, name, scale in rows:
        printed = [scale * value for value in numbers_of_row(paper, label)]
        assert [getattr(TABLE_II[joint], name) for joint in DRIVEN] == pytest.approx(printed), name


def check_table_iii(paper: str) -> None:
    table = paper[paper.index(r"\textbf{\makecell[c]{Speed\\(Tilt-Insertion)}}") :]
    rows = re.findall(
        rf"(\d+)\$\^\\circ\$/s - (\d+)mm/s && ({NUMBER}) & ({NUMBER}) & ({NUMBER})", table
    )
    assert len(rows) == len(TABLE_III)
    for row, printed in zip(TABLE_III, rows, strict=True):
        ours = (
            math.degrees(row.tilt),
            1e3 * row.insertion,
            *(row.nrmsd[joint] for joint in DRIVEN),
        )
        assert ours == pytest.approx([float(value) for value in printed])


def check_required_ranges(paper: str) -> None:
    circ = r"\$(\d+)\^\\circ\$"
    result = re.search(
        rf"{circ} spin, {circ} roll, {circ} tilt, and \$(\d+)\$mm translation", paper
    )
    assert result
    angles = (published.REQUIRED_SPIN, published.REQUIRED_ROLL, published.REQUIRED_TILT)
    ours = [*map(math.degrees, angles), 1e3 * published.REQUIRED_TRAVEL]
    assert ours == pytest.approx([float(value) for value in result.groups()])


def check_required_speeds(paper: str) -> None:
    circ, mm = r"\$(\d+)\^\\circ\$/s", r"\$(\d+)\$mm/s"
    sentence = rf"{circ}\$\^2\$ and {circ}, while the translation unit requires {mm}\$\^2\$ acceleration and {mm} velocity"
    result = re.search(sentence, paper)
    assert result
    ours = [
        math.degrees(value) for value in (published.ROTARY_ACCELERATION, published.ROTARY_SPEED)
    ]
    ours += [1e3 * value for value in (published.LINEAR_ACCELERATION, published.LINEAR_SPEED)]
    assert ours == pytest.approx([float(value) for value in result.groups()])


def test_published_figures_are_those_of_the_paper() -> None:
    if not PAPER_FILE.is_file():
        pytest.skip("the paper's source is not beside the project")
    paper = re.sub(r"\s+", " ", PAPER_FILE.read_text(encoding="utf-8"))
    check_table_i(paper)
    check_table_ii(paper)
    check_table_iii(paper)
    check_required_ranges(paper)
    check_required_speeds(paper)


def test_the_robot_has_the_friction_and_the_limits_of_the_paper(robot: Robot) -> None:
    for joint in robot.joints:
        if joint.name in TABLE_II:
            assert joint.drive is not None
            assert joint.drive.friction is not None
            row, friction = TABLE_II[joint.name], joint.drive.friction
            assert (friction.mu, friction.mu_static) == (row.mu, row.mu_static)
            assert (friction.b_c, friction.b_v) == pytest.approx((row.b_c, row.b_v))
    rotary, translation = robot.joints[0], robot.joints[3]
    assert (rotary.velocity, rotary.acceleration) == pytest.approx(
        (published.ROTARY_SPEED, published.ROTARY_ACCELERATION)
    )
    assert (translation.velocity, translation.acceleration) == pytest.approx(
        (published.LINEAR_SPEED, published.LINEAR_ACCELERATION)
    )

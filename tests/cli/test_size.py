"""The command `size` prints JSON, writes files, returns an exit status and refuses bad input."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from ssm_planner.errors import SsmPlannerError
from ssm_planner.loading.load import load_problem
from ssm_planner.plans import PLAN_FORMAT, PLAN_VERSION
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.serialization import to_plain
from tests.support.cli import run
from tests.support.paths import PROBLEMS
from tests.support.sizing_cases import COMPLETE, equipped, random_trajectory

SHIPPED = PROBLEMS
EC_MAX = SHIPPED / "motors/maxon_ec_max_22_25w.yaml"


def plan_file(folder: Path, robot: Robot) -> Path:
    path = folder / "plan.json"
    document = {
        "format": PLAN_FORMAT,
        "version": PLAN_VERSION,
        "problem": to_plain(replace(load_problem(PROBLEMS / "tilt_insert.yaml"), robot=robot)),
        "certificate": None,
        "trajectory": random_trajectory(3).to_dict(),
    }
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


@pytest.mark.slow
def test_everything_known(tmp_path: Path, robot: Robot, capsys: pytest.CaptureFixture[str]) -> None:
    plan = plan_file(tmp_path, equipped(robot))
    status = run(
        "size",
        plan,
        "--supply",
        "24 V",
        "--current-limit",
        "20 A",
        "--json",
        "-o",
        tmp_path / "out",
        "--what-if",
    )
    document = json.loads(capsys.readouterr().out)
    assert status == 0
    assert document["adequate"] is True
    assert {row["joint"] for row in document["motors"]} == {"roll", "tilt", "insertion"}
    assert document["what_if"]["shortest_duration"]["status"] == "found"
    for path in document["files"].values():
        assert Path(path).stat().st_size > 1000
    assert (
        json.loads((tmp_path / "out/sizing.json").read_text(encoding="utf-8"))["adequate"] is True
    )


def test_a_motor_that_does_not_suffice(
    tmp_path: Path, robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = plan_file(
        tmp_path, equipped(robot, replace(COMPLETE, nominal_torque=1e-5, max_torque=2e-5))
    )
    assert run("size", plan) == 1
    out = capsys.readouterr().out
    assert "does NOT suffice" in out
    assert "Traceback" not in out


def test_a_csv_needs_the_robot(
    tmp_path: Path, robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    from ssm_planner.formats.csv import write_csv
    from ssm_planner.sizing.requirements import motor_requirements

    trajectory = random_trajectory(3)
    path = write_csv(tmp_path / "motion.csv", trajectory, robot)
    with pytest.raises(SsmPlannerError, match="--robot"):
        run("size", path)
    run("size", path, "--robot", SHIPPED / "robots/vitreoretinal.yaml", "--json")
    document = json.loads(capsys.readouterr().out)
    for row, expected in zip(
        document["requirements"], motor_requirements(trajectory, robot), strict=True
    ):
        assert row["rms_torque"] == pytest.approx(expected.rms_torque, rel=1e-2)


def test_missing_figures_are_reported(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("size", SHIPPED / "motorisation/paper.yaml") == 0
    out = capsys.readouterr().out
    assert "placeholder" in out
    assert "not checked: needs" in out
    assert "not known" in out
    assert " yes " not in out


def test_candidates_for_all_joints_and_for_one(capsys: pytest.CaptureFixture[str]) -> None:
    other = SHIPPED / "motors/maxon_ecx_torque_22_m.yaml"
    run(
        "size",
        SHIPPED / "motorisation/paper.yaml",
        "--motor",
        EC_MAX,
        f"tilt={other}",
        "--spread",
        "0.1",
        "--json",
    )
    document = json.loads(capsys.readouterr().out)
    rows = [(row["joint"], row["motor"][:12]) for row in document["motors"]]
    assert sorted(rows) == [
        ("insertion", "maxon EC-max"),
        ("roll", "maxon EC-max"),
        ("tilt", "maxon EC-max"),
        ("tilt", "maxon ECX TO"),
    ]
    # The drive of joint 4 states the inertia of its rotor, so that only ratings of the gear are
    # missing.
    (insertion,) = [row for row in document["motors"] if row["joint"] == "insertion"]
    assert all(margin > 0 for margin in insertion["margins"].values() if margin is not None)
    assert all("ratings." in needs for needs in insertion["not_checked"].values())
    assert insertion["adequate"] is None
    assert document["smallest"]["insertion"] is None


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["nothing.json"], "no such file"),
        ([SHIPPED / "tilt_insert.yaml"], "plan it first"),
        ([SHIPPED / "motorisation/paper.yaml", "--motor", "nothing.yaml"], "no such file"),
        ([SHIPPED / "motorisation/paper.yaml", "--motor", f"spin={EC_MAX}"], "no drive"),
        (
            [SHIPPED / "motorisation/paper.yaml", "--motor", f"wrist={EC_MAX}"],
            "unknown joint",
        ),
        ([SHIPPED / "motorisation/paper.yaml", "--confidence", "2"], "confidence"),
        (
            [SHIPPED / "motorisation/paper.yaml", "--motor", SHIPPED / "tilt_insert.yaml"],
            "unknown key",
        ),
    ],
)
def test_bad_input_is_one_clear_error(words: list[object], part: str) -> None:
    with pytest.raises(SsmPlannerError, match=part):
        run("size", *words)


def test_a_quantity_without_unit_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        run("size", SHIPPED / "motorisation/paper.yaml", "--ambient", "25")
    assert caught.value.code == 2
    assert "without a unit" in capsys.readouterr().err

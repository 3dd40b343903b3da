"""An extreme or invalid figure of a catalogue never causes a wrong yes or an internal error."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from ssm_planner.cli import main
from ssm_planner.errors import ProblemError, TrajectoryError
from ssm_planner.loading.catalogues import CatalogueEntry, drives_with_gears, read_motors
from ssm_planner.loading.load import load_robot
from ssm_planner.plans import load_plan
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.sizing.selection import select_motors
from tests.support.cli import run
from tests.support.paths import PROBLEMS, RESULTS
from tests.support.sizing_cases import random_trajectory

Figures = dict[str, str]
ROWS = csv.DictReader((PROBLEMS / "catalogues/motors_24v.csv").read_text("utf-8").splitlines())
MOTOR: Figures = next(iter(ROWS))
WORM: Figures = {
    "name": "worm",
    "geometry.ratio": "120",
    "geometry.worm_diameter": "10 mm",
    "geometry.lead": "0.7853982 mm",
    "geometry.thread_angle": "40 deg",
    "input_inertia": "1e-7 kg*m^2",
    "output_inertia": "8.5e-6 kg*m^2",
    "friction.mu": "0.1",
    "friction.mu_static": "0.12",
    "friction.mu_lowest": "0.09",
    "friction.b_c": "1e-4 N*m",
    "friction.b_v": "1e-6 N*m*s/rad",
    "friction.b_oc": "1e-4 N*m",
    "friction.b_ov": "1e-6 N*m*s/rad",
    "ratings.input_speed": "5000 rpm",
    "ratings.peak_output": "20 N*m",
    "ratings.continuous_output": "10 N*m",
    "ratings.duty": "1",
    "mass": "3 g",
    "length": "60 mm",
}
SCREW: Figures = {
    "name": "screw",
    "geometry.diameter": "2.75 mm",
    "geometry.outer_diameter": "3 mm",
    "geometry.lead": "0.5 mm",
    "geometry.thread_angle": "30 deg",
    "output_inertia": "0.01 kg",
    "ratings.root_diameter": "2.2 mm",
    "ratings.free_length": "60 mm",
    "ratings.ends": "fixed-free",
    "ratings.input_speed": "10000 rpm",
    "ratings.peak_output": "100 N",
    "ratings.continuous_output": "50 N",
    "ratings.duty": "1",
}
TEXTS = ("name", "order_number", "terminal_inductance", "ratings.ends")
"""Columns that contain no figures or are ignored."""
ODD = ("0", "-1", "nan", "inf", "1e-320", "1e-200", "1e-45", "1e-30", "1e30", "1e45", "1e320")
ALSO = ("true", "abc", "")


def written(file: Path, row: Figures) -> Path:
    with file.open("w", encoding="utf-8", newline="") as out:
        table = csv.DictWriter(out, row)
        table.writeheader()
        table.writerow(row)
    return file


@pytest.fixture(scope="module")
def duty() -> DutyCycle:
    trajectory = random_trajectory(3, duration=2.0, pieces=4)
    return DutyCycle.of_trajectory(trajectory, load_robot("vitreoretinal"))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("row", "key"),
    [
        pytest.param(row, key, id=f"{kind} {key}")
        for kind, row in (("motor", MOTOR), ("worm", WORM), ("screw", SCREW))
        for key in row
        if key not in TEXTS
    ],
)
def test_every_figure_is_refused_or_assessed(
    tmp_path: Path, duty: DutyCycle, row: Figures, key: str
) -> None:
    """Each extreme value of a figure is either refused or gives a table of finite numbers.

    A refusal names the file.
    """
    joint = duty.robot.joints[3 if row is SCREW else 0]
    unit = row[key].partition(" ")[2]
    faults = []
    for text in (*(f"{number} {unit}".strip() for number in ODD), *ALSO):
        motor, gear = ({**MOTOR, key: text}, WORM) if row is MOTOR else (MOTOR, {**row, key: text})
        try:
            motors = read_motors(written(tmp_path / "motors.csv", motor))
            gears = drives_with_gears(written(tmp_path / "gears.csv", gear), joint.drive, 0.03)
        except ProblemError as error:
            faults.append(error)
            continue
        for selection in select_motors(duty, motors, {joint.name: gears}, Conditions(spread=0.2)):
            json.dumps(selection.to_dict("mass", 1), allow_nan=False)
    assert len(faults) >= 7
    assert all(fault.file is not None and "inf to inf" not in str(fault) for fault in faults)


@pytest.mark.parametrize(
    ("key", "text", "allowed"),
    [
        ("ratings.root_diameter", "50 mm", "at most 0.00275 m"),
        ("ratings.free_length", "3 mm", "at least 0.03 m"),
    ],
)
def test_an_impossible_screw_is_one_clear_error(
    tmp_path: Path, key: str, text: str, allowed: str
) -> None:
    joint = load_robot("vitreoretinal").joints[3]
    file = tmp_path / "screws.csv"
    assert len(drives_with_gears(written(file, SCREW), joint.drive, 0.03)) == 1
    with pytest.raises(ProblemError) as caught:
        drives_with_gears(written(file, {**SCREW, key: text}), joint.drive, 0.03)
    assert re.fullmatch(
        rf".*screws\.csv:2: {key} = {text}: .* \(allowed: {allowed}\)", str(caught.value)
    )


def test_a_joint_longer_than_its_screw_is_refused(tmp_path: Path) -> None:
    joint = load_robot("vitreoretinal").joints[3]
    (part,) = drives_with_gears(written(tmp_path / "screws.csv", SCREW), joint.drive)
    with pytest.raises(ProblemError, match=r"free_length.*shorter than the travel"):
        replace(joint, drive=part.of, position=(-0.07, 0.0))


def test_the_joint_decides_on_self_locking(tmp_path: Path, duty: DutyCycle) -> None:
    text = (PROBLEMS / "drives/vitreoretinal_joint1_worm.yaml").read_text(encoding="utf-8")
    slippery = text.replace("mu: {value: 0.13", "mu: {value: 0.005").replace(
        "self_locking: required", "self_locking: not required"
    )
    assert slippery.count("not required") == 1
    (tmp_path / "worm.yaml").write_text(slippery, encoding="utf-8")
    joint = duty.robot.joints[0]
    for required in (True, False):
        (part,) = drives_with_gears(tmp_path, replace(joint.drive, self_locking=required))
        selection = select_motors(duty, read_motors(Path("motors_24v.csv"))[:1], {"roll": [part]})[
            0
        ]
        names = [check.name for check in selection.gear_checks[0]]
        assert ("self_locking" in names) is required


def test_a_placeholder_is_named_and_never_a_yes(tmp_path: Path, duty: DutyCycle) -> None:
    """A motor or gear with an assumed figure never gets the answer yes.

    Its other answers equal those of the same part with stated figures. An assumed encoder count
    does not change the answer.
    """
    motors = [
        replace(part, of=replace(part.of, placeholders=placeholders))
        for part in read_motors(Path("motors_24v.csv"))[::6]
        for placeholders in ((), ("max_torque",), ("encoder_counts",))
    ]
    drive = duty.robot.joints[0].drive
    (gear,) = drives_with_gears(written(tmp_path / "gears.csv", WORM), drive)
    assumed = replace(gear.of, placeholders=("mu",))
    gears = {"roll": [gear, CatalogueEntry("assumed", assumed)]}
    selection = select_motors(duty, motors, gears, Conditions(spread=0.2))[0]
    stated, placeholder, counts = (selection.adequate[0, k::3] for k in range(3))
    assert stated.max() == 1
    assert (counts == stated).all()
    assert (placeholder == stated.clip(max=0)).all()
    assert (selection.adequate[1] <= 0).all()
    for pair in ((0, 0), (0, 1), (0, 2), (1, 0)):
        verdict = selection.verdict(*pair).adequate
        assert {True: 1, None: 0, False: -1}[verdict] == selection.adequate[pair]


def test_a_gear_inherits_assumed_friction(tmp_path: Path, duty: DutyCycle) -> None:
    drive = replace(duty.robot.joints[0].drive, placeholders=("b_c", "identified_speed", "ratio"))
    (part,) = drives_with_gears(written(tmp_path / "gears.csv", WORM), drive)
    assert part.of.placeholders == ("identified_speed",)


def test_the_command_names_placeholders(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figures = {"weight": "mass", "chart_max_torque": "max_torque", "order_number": "", "name": ""}
    lines = ["name: X", "source: a guess", "placeholder: true"]
    for name, cell in MOTOR.items():
        if name != "terminal_inductance" and (key := figures.get(name, name)):
            lines.append(f"{key}: {cell}")
    (tmp_path / "x.yaml").write_text("\n".join(lines), encoding="utf-8")
    status = run("size", RESULTS / "tilt_insert", "--catalogue", tmp_path, "--spread", "0.2")
    out = " ".join(capsys.readouterr().out.split())
    assert status in (0, 1)
    assert "motor x: placeholder figures (nominal_torque, max_torque" in out
    assert "suitable motor: yes" not in out


def test_gears_need_a_catalogue() -> None:
    with pytest.raises(ProblemError, match="--gears: needs --catalogue"):
        run("size", RESULTS / "tilt_insert", "--gears", "worms")


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (r'"units": {', '"units": 5, "other": {', "units"),
        (r'"coefficients": \[\[\[[^,]*,', '"coefficients": [[[true,', "not a number"),
        (r'"breaks_s": \[0.0', '"breaks_s": [false', "not a number"),
    ],
)
def test_a_damaged_plan_is_refused(tmp_path: Path, old: str, new: str, reason: str) -> None:
    text = json.dumps(json.loads((RESULTS / "tilt_insert/plan.json").read_text(encoding="utf-8")))
    damaged = re.sub(old, new, text)
    assert damaged != text
    file = tmp_path / "plan.json"
    file.write_text(damaged, encoding="utf-8")
    with pytest.raises(TrajectoryError, match=reason):
        load_plan(file)


def test_a_plan_without_a_certificate_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = json.loads((RESULTS / "tilt_insert/plan.json").read_text(encoding="utf-8"))
    file = tmp_path / "plan.json"
    file.write_text(json.dumps({**document, "certificate": None}), encoding="utf-8")
    run("size", file)
    assert "not certified: the plan has no certificate" in capsys.readouterr().out


def test_counts_of_an_impossible_encoder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ProblemError, match=r"encoder_counts = 1e\+?30"):
        read_motors(written(tmp_path / "motors.csv", {**MOTOR, "encoder_counts": "1e30"}))


def test_a_bare_number_of_percent_gets_a_hint(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(RESULTS / "tilt_insert"), "--to", "csv", "--speed", "80"]) == 2
    assert "did you mean 80%?" in capsys.readouterr().err

"""The options `check --speed`, `export --speed` and `export --stops` are tested.

Exported stops start from the position of the plan, and an export at a lower speed passes its check.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.cli import main
from ssm_planner.plans import Plan, load_plan
from ssm_planner.verification.check import check
from tests.support.paths import RESULTS

SHIPPED = RESULTS / "tilt_insert" / "plan.json"


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    """Return the shipped plan with a new certificate of the present program."""
    shipped = load_plan(SHIPPED)
    result = replace(
        shipped, certificate=check(shipped.motion, shipped.robot, shipped.limits, seal=True)
    )
    return load_plan(result.write(tmp_path_factory.mktemp("plan") / "plan.json"))


def test_stops_are_in_plan_json(plan: Plan) -> None:
    document = json.loads(plan.path.read_text(encoding="utf-8"))["stops"]
    assert document["passed"] is True
    assert len(document["time"]) == len(document["duration"]) == len(document["travel"]) == 1000
    assert document["longest"]["duration"] == max(document["duration"])
    assert document["farthest"]["travel"] == max(document["travel"])


def test_check_at_one_speed_and_over_a_range(
    plan: Plan, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(plan.path), "--speed", "10 %", "--json"]) == 0
    one = json.loads(capsys.readouterr().out)
    assert (one["speed"], one["passed"]) == (0.1, True)
    assert main(["check", str(plan.path), "--speed", "1%..100%", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["speeds"]["slowest"] == 0.01
    assert {item["name"] for item in result["speeds"]["worst"]} == {
        "motor torque",
        "continuous torque",
    }
    assert main(["check", str(plan.path), "--speed", "1%..100%"]) == 0
    assert "worst at % of the speed" in capsys.readouterr().out
    for words in ("0%", "fast", "10%..50%", "120%"):
        assert main(["check", str(plan.path), "--speed", words]) == 2
        assert "speed" in capsys.readouterr().err


def test_an_export_at_a_lower_speed_passes_its_own_check(plan: Plan, tmp_path: Path) -> None:
    words = [
        "export",
        str(plan.path),
        "--to",
        "csv",
        "-o",
        str(tmp_path / "slow"),
        "--speed",
        "10%",
    ]
    assert main(words) == 0
    manifest = json.loads((tmp_path / "slow" / "manifest.json").read_text(encoding="utf-8"))
    assert (manifest["speed"], manifest["verified"]) == (0.1, True)
    (file,) = (tmp_path / "slow").glob("*.csv")
    last = np.loadtxt(file, delimiter=",", skiprows=1, usecols=0)[-1]
    assert last == pytest.approx(10 * plan.motion.duration, rel=1e-6)
    robot = str(SHIPPED.parents[2] / "problems" / "robots" / "vitreoretinal.yaml")
    assert main(["check", str(file), "--robot", robot]) == 0


@pytest.mark.parametrize("to", ["csv", "epos4"])
def test_the_family_of_stops_is_exported(plan: Plan, tmp_path: Path, to: str) -> None:
    words = ["export", str(plan.path), "--to", to, "-o", str(tmp_path / to), "--stops", "20"]
    assert main([*words, *(["--counts-per-turn", "4096"] if to == "epos4" else [])]) == 0
    file = tmp_path / to / "stops.csv"
    names = file.read_text(encoding="utf-8").split("\n", 1)[0].split(",")
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    begins = np.unique(rows[:, 0])
    assert 15 <= len(begins) <= 20
    scale = np.ones(4)
    if to == "epos4":
        axes = json.loads((tmp_path / to / "manifest.json").read_text(encoding="utf-8"))["axes"]
        scale = np.array(
            [axes[joint.name].get("increments_per_unit", 1.0) for joint in plan.robot.joints]
        )
        assert names[2:] == ["roll_inc", "tilt_inc", "spin_rad", "insertion_inc"]
    for start in begins:
        stop = rows[rows[:, 0] == start]
        assert stop[0, 1] == 0.0
        assert np.all(np.diff(stop[:, 1]) > 0)
        state = plan.motion.sample(start)
        # Half an increment and the distance that is moved within the rounding of the printed time
        # are allowed.
        allowed = 0.5 + 5.1e-7 * np.abs(state.qd[0] * scale) if to == "epos4" else 2e-6
        assert np.all(np.abs(stop[0, 2:] - state.q[0] * scale) <= allowed)


def test_stops_are_of_csv_and_epos4_alone(
    plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["export", str(plan.path), "--to", "urdf", "-o", str(tmp_path), "--stops", "20"]) == 2
    )
    assert "csv, epos4" in capsys.readouterr().err

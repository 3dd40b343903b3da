"""The command `simulate` prints JSON, writes files and returns an exit status.

Bad input causes one message.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ssm_planner.cli import main
from tests.support.paths import RESULTS

PLAN = str(RESULTS / "tilt_insert" / "plan.json")


@pytest.mark.slow
def test_json_and_files(capsys, tmp_path):
    assert (
        main(
            [
                "simulate",
                PLAN,
                "--power-loss",
                "everywhere",
                "--instants",
                "5",
                "-o",
                str(tmp_path),
                "--json",
            ]
        )
        == 0
    )
    out = capsys.readouterr()
    result = json.loads(out.out)
    assert result["passed"] is True
    assert result["holds"] is True
    assert result["reasons"] == []
    assert [item["joint"] for item in result["tracking"]] == ["roll", "tilt", "spin", "insertion"]
    assert {"joint", "worst", "rms"} == set(result["tracking"][0])
    assert {"joint", "peak_torque", "saturated"} <= set(result["motors"][0])
    assert 0 < result["tip_error"] < 1e-4
    assert 0 < result["travel"] < 1e-3
    assert result["power_loss"]["instants"] == 5
    assert "playing the set points" in out.err
    for path in result["files"].values():
        assert Path(path).stat().st_size > 0
    assert {"simulation.json", "playback.png", "power_loss.png", "roll.csv"} <= {
        Path(path).name for path in result["files"].values()
    }


def test_a_failure_has_exit_status_1_and_its_reason(capsys):
    assert main(["simulate", PLAN, "--stall", "tilt@1s"]) == 1
    out = capsys.readouterr().out
    assert "reason: joint tilt: the following error left its window" in out
    assert "NOT PASSED" in out


def test_options_combine(capsys):
    words = [
        "--payload",
        "50g@1s",
        "--friction",
        "0.9",
        "--supply",
        "20V",
        "--speed",
        "50%",
        "--json",
    ]
    assert main(["simulate", PLAN, *words, "--controller", "epos4"]) == 0
    assert json.loads(capsys.readouterr().out)["passed"] is True


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--stall", "tilt"], ["--stall", "JOINT@TIME"]),
        (["--stall", "spin@1s"], ["--stall", "spin", "roll, tilt, insertion"]),
        (["--power-loss", "5 m"], ["--power-loss", "a time"]),
        (["--power-loss", "9 s"], ["--power-loss", "0 s to 3.349 s"]),
        (["--speed", "fast"], ["--speed", "10%"]),
        (["--speed", "0%"], ["speed", "above 0"]),
        (["--payload", "3"], ["--payload", "without a unit"]),
        (["--instants", "0"], ["--instants = 0", "at least 1"]),
        (["--controller", "none.yaml"], ["none.yaml", "no such file"]),
    ],
)
def test_bad_input_is_one_message_and_exit_status_2(capsys, words, parts):
    assert main(["simulate", PLAN, *words]) == 2
    err = capsys.readouterr().err
    assert "Traceback" not in err
    for part in parts:
        assert part in err

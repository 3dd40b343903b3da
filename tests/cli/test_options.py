"""An error about the value of an option names the option and the text that the user typed."""

from __future__ import annotations

import argparse
import csv

import pytest

from ssm_planner.cli import COMMANDS, main
from ssm_planner.cli.shared import ARGUMENTS, add_arguments
from tests.support.paths import ROOT

PLAN = str(ROOT / "results/tilt_insert")
RIG = str(ROOT / "problems/drives/rig1_lead_screw.yaml")
CASES = [
    (["view", "--port", "70000"], "--port = 70000"),
    (["view", "--port=-1"], "--port = -1"),
    (["check", PLAN, "--speed", "0"], "--speed = 0:"),
    (["check", PLAN, "--speed", "200%"], "--speed = 200%"),
    (["check", PLAN, "--tip-speed", "-5mm/s"], "--tip-speed = -5mm/s"),
    (["check", PLAN, "--tip-speed=-5mm/s"], "--tip-speed = -5mm/s"),
    (["film", PLAN, "--speed", "0", "-o", "film"], "--speed = 0:"),
    (["plan", "tilt_insert", "--from", PLAN, "--at", "100s"], "--at = 100s"),
    (["plan", "tilt_insert", "--rate", "1e9"], "argument --rate"),
    (["retime", "path.csv", "--robot", "vitreoretinal", "--rate", "1GHz"], "argument --rate"),
    (
        ["size", PLAN, "--ambient", "500degC"],
        "--ambient: '500degC': out of range (allowed: -70degC to 125degC)",
    ),
    (["size", PLAN, "--supply", "-5V"], "--supply = -5V"),
    (["size", PLAN, "--current-limit", "-5A"], "--current-limit = -5A"),
    (["size", PLAN, "--pause", "-5s"], "--pause = -5s"),
    (["size", PLAN, "--payload", "-5g"], "--payload = -5g"),
    (["size", PLAN, "--confidence", "2"], "--confidence = 2"),
    (["size", PLAN, "--conf", "2"], "--conf = 2"),
    (["size", PLAN, "--draws", "10000000"], "--draws = 10000000"),
    (["simulate", PLAN, "--power-loss", "300s"], "--power-loss = 300s"),
    (["simulate", PLAN, "--stall", "roll@-1s"], "--stall = roll@-1s"),
    (["simulate", PLAN, "--supply", "-3V"], "--supply = -3V"),
    (["simulate", PLAN, "--friction", "0"], "--friction = 0"),
    (["simulate", PLAN, "--wrong-direction", "lift"], "--wrong-direction = lift"),
    (["simulate", PLAN, "--tip-error", "-1mm"], "--tip-error = -1mm"),
    (["simulate", PLAN, "--travel", "-1mm"], "--travel = -1mm"),
    (["export", PLAN, "--to", "epos4", "--counts-per-turn", "lift=3"], "--counts-per-turn"),
    (["export", PLAN, "--to", "csv", "--speed", "0"], "--speed = 0"),
    (["study", "vitreoretinal", "--workers", "0"], "--workers = 0"),
    (["study", "vitreoretinal", "--workers", "100000"], "--workers = 100000"),
    (["identify", RIG, "--free", "lift"], "cannot free 'lift'"),
    (["identify", RIG, "--fix", "mu=0.1", "--fix", "mu=0.2"], "--fix = mu=0.1 mu=0.2"),
    (["plan", "tilt_insert", "--at", "1s"], "--at: needs --from"),
    (["plan", "tilt_insert", "--from", PLAN], "--from: needs --at"),
    (["plan", "tilt_insert", "--rate", "-5"], "'-5' is not a rate"),
    (["workspace", "vitreoretinal", "--margin", "0deg"], "--margin: needs --reach"),
    (["size", PLAN, "--rank", "mass"], "--rank: needs --catalogue"),
    (["identify", RIG, "--count", "24"], "--count: needs --design"),
    (
        ["export", PLAN, "--to", "epos4", "--counts-per-turn", "roll=4096", "roll=2000"],
        "once per joint",
    ),
    (["check", PLAN, "--start-rate", "tilt=0deg/s,tilt=1deg/s"], "repeated coordinate"),
    (["check", PLAN, "--key", "nofile"], "nofile: cannot be read"),
    (["check", str(ROOT / "results")], "no plan.json in this folder"),
]


@pytest.mark.parametrize(("words", "part"), CASES, ids=lambda value: " ".join(value[:4:3]))
def test_an_error_names_the_option(
    words: list[str],
    part: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert part in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_an_error_of_a_file_keeps_its_key(capsys: pytest.CaptureFixture[str], tmp_path) -> None:
    robot = tmp_path / "robot.yaml"
    robot.write_text("speed: 3\n", encoding="utf-8")
    assert main(["check", PLAN, "--robot", str(robot), "--speed", "50%"]) == 2
    message = capsys.readouterr().err
    assert "robot.yaml:1: speed" in message
    assert "--speed" not in message


def test_every_row_of_the_table_belongs_to_a_command_and_can_be_used() -> None:
    """Every option belongs to a command, has a help text, and has a valid default."""
    with ARGUMENTS.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {name for row in rows for name in row["commands"].split()} == {*COMMANDS}
    for command in COMMANDS:
        parser = argparse.ArgumentParser()
        add_arguments(parser, command)
        for action in parser._actions:
            if action.type is not None and isinstance(action.default, str):
                action.type(action.default)
            assert action.help

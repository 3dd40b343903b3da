"""Verify that every command answers for robots without drives, motors or masses.

The answer is a result or one message. No combination of robot, objective, planner and command ends
in an internal fault (status 3). EVERY_CASE=1 plans every objective with every planner.
"""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from ssm_planner.cli import main
from tests.support.cases import selected
from tests.support.paths import PROBLEMS

pytestmark = pytest.mark.slow

JOINTS = ("roll", "tilt", "spin", "insertion")
BOTH = ("drive", "motor")
Robot = dict[str, Any]


@cache
def _shipped() -> Robot:
    """Return the data of the shipped robot, with drives and motors given by name."""
    robot: Robot = yaml.safe_load((PROBLEMS / "robots/vitreoretinal.yaml").read_text("utf-8"))
    for joint in robot["joints"].values():
        joint.pop("alternatives", None)
        joint.update({part: Path(joint[part]).stem for part in BOTH if part in joint})
    return robot


def _without(parts: tuple[str, ...], joints: tuple[str, ...] = JOINTS) -> Callable[[Robot], None]:
    """Return a function that removes these parts of these joints from the data of a robot."""

    def change(robot: Robot) -> None:
        for joint, part in itertools.product(joints, parts):
            robot["joints"][joint].pop(part, None)

    return change


def _massless(robot: Robot) -> None:
    """Remove drives, motors and masses."""
    _without(BOTH)(robot)
    robot["bodies"] = [
        {"name": body["name"], "frame": body["frame"], "mass": "0 kg"} for body in robot["bodies"]
    ]


def _with_jerk_limits(robot: Robot) -> None:
    """Replace drives and motors by jerk limits."""
    _without(BOTH)(robot)
    for name, joint in robot["joints"].items():
        joint["jerk"] = "1 m/s^3" if name == "insertion" else "2000 deg/s^3"


def _mixed(robot: Robot) -> None:
    """Remove the motor of roll and the drive of tilt."""
    _without(("motor",), ("roll",))(robot)
    _without(("drive",), ("tilt",))(robot)


VARIANTS: dict[str, Callable[[Robot], None]] = {
    "no drives": _without(("drive",)),
    "no motors": _without(("motor",)),
    "neither": _without(BOTH),
    "only the tilt's": _without(BOTH, ("roll", "spin", "insertion")),
    "all but the tilt's": _without(BOTH, ("tilt",)),
    "a motor or a drive is missing": _mixed,
    "no masses": _massless,
    "jerk limits": _with_jerk_limits,
    "a payload range": _without(("motor",), ("tilt",)),
}
OBJECTIVES: dict[str, dict[str, str]] = {
    "time": {"objective": "time"},
    "heat": {},
    "effort": {"objective": "effort", "duration": "6 s"},
    "duration": {"duration": "6 s"},
}
PLANNERS = ("optimal", "fast", "ipopt", "toppra")
MISSION = [
    {"tilt": {"to": "-100 deg"}},
    {"insert": {"to": "10 mm"}},
    {"dwell": "0.1 s"},
    {"free": {"to": {"roll": "10 deg", "tilt": "-110 deg", "spin": "20 deg", "depth": "5 mm"}}},
]


def _write(folder: Path, variant: str, objective: str, planner: str) -> tuple[Path, Path]:
    """Write a robot and a problem, and return both files."""
    robot = copy.deepcopy(_shipped())
    VARIANTS[variant](robot)
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot, sort_keys=False), "utf-8")
    ranges: dict[str, Any] = {"tilt": ["-139 deg", "-81 deg"], "depth": ["0 mm", "30 mm"]}
    if variant == "a payload range":
        ranges["payload"] = ["0 g", "30 g"]
    problem = {
        "robot": "robot.yaml",
        "start": {"roll": "0 deg", "tilt": "-85 deg", "spin": "0 deg", "depth": "1 mm"},
        "motion": MISSION[:3] if planner == "toppra" else MISSION,
        "limits": ranges,
        "planner": planner,
        **OBJECTIVES[objective],
    }
    (folder / "problem.yaml").write_text(yaml.safe_dump(problem, sort_keys=False), "utf-8")
    return folder / "robot.yaml", folder / "problem.yaml"


def _answers(capsys: pytest.CaptureFixture[str], words: tuple[object, ...]) -> int:
    """Run a command in this process and return its status. A refusal must print a reason."""
    capsys.readouterr()
    try:
        status = main([str(word) for word in words])
    except SystemExit as error:
        status = int(error.code or 0)
    printed = capsys.readouterr()
    unjudged = words[0] == "check" and str(words[1]).endswith("epos4")
    assert status in ((1, 2, 4) if unjudged else (0, 1, 2)), (words, printed.err)
    assert status != 2 or printed.err.strip(), words
    assert "Traceback" not in printed.err, words
    return status


def _cases(variant: str) -> set[tuple[str, str]]:
    """Return every planner with one objective, which depends on the variant.

    Over all variants, every objective meets every planner, and every variant meets every objective
    and every planner. TOPP-RA always plans for time too.
    """
    objectives = list(OBJECTIVES)
    first = list(VARIANTS).index(variant)
    turns = {
        (objectives[(first + k) % len(objectives)], planner) for k, planner in enumerate(PLANNERS)
    }
    return selected(
        {("time", "toppra"), *turns}, every=set(itertools.product(objectives, PLANNERS))
    )


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("variant", VARIANTS)
def test_every_objective_and_planner_plans_or_refuses(
    variant: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The next test writes the folder of every variant.
    files = {"report": tmp_path / "out/report.html"}
    monkeypatch.setattr("ssm_planner.pipeline.run.write_folder", lambda *_: files)
    statuses = {}
    for objective, planner in _cases(variant):
        _, problem = _write(tmp_path, variant, objective, planner)
        words = ("plan", problem, "--json", "-o", tmp_path / "out")
        statuses[objective, planner] = _answers(capsys, words)
    # TOPP-RA does not support durations or effort. Every other planner plans every objective.
    refused = {case for case, status in statuses.items() if status}
    assert {planner for _, planner in refused} <= {"toppra"}
    assert ("time", "toppra") not in refused or variant == "jerk limits"


def _judgements(plan: Path, robot: Path, problem: Path, out: Path) -> Iterator[tuple[object, ...]]:
    """Yield commands that judge or play a plan."""
    catalogue, table = PROBLEMS / "catalogues/motors_24v.csv", plan / "trajectory.csv"
    yield from (("check", plan), ("check", plan, "--speed", "10%"))
    yield from (("check", table, "--robot", robot), ("check", table, "--problem", problem))
    yield from (("size", plan, "--json"), ("size", plan, "--catalogue", catalogue))
    yield ("size", plan, "--what-if")
    yield ("size", plan, "--spread", "0.2", "--draws", "200", "--payload", "20 g")
    yield from (("simulate", plan, "-o", out / "sim"), ("simulate", plan, "--power-loss", "0.5s"))
    yield ("simulate", plan, "--stall", "tilt@0.3s")
    yield ("simulate", plan, "--payload", "20g", "--speed", "50%")
    yield from (("compare", plan, table), ("compare", plan, f"roll={table}", "--json"))


def _exports(plan: Path, robot: Path, problem: Path, out: Path) -> Iterator[tuple[object, ...]]:
    """Yield commands that write a plan in other formats or read these formats."""
    for kind in ("csv", "epos4", "pvt", "urdf", "c"):
        yield ("export", plan, "--to", kind, "-o", out / kind)
    yield ("export", plan, "--to", "ros2", "-o", out / "ros2", "--rate", "50")
    yield ("export", plan, "--to", "csv", "-o", out / "half", "--speed", "50%")
    yield ("export", plan, "--to", "epos4", "-o", out / "csp", "--counts-per-turn", "4096")
    yield ("export", plan, "--to", "ros2", "-o", out / "effort", "--effort", "--no-bag")
    yield from (("check", out / kind, "--robot", robot) for kind in ("csv", "ros2", "epos4", "pvt"))
    yield ("export", plan, "--to", "csv", "-o", out / "coarse", "--rate", "20")
    coarse = out / "coarse/trajectory.csv"
    yield ("retime", coarse, "--robot", robot, "-o", out / "retimed")
    yield from (("report", plan, "-o", out / "page"), ("report", plan, plan, "-o", out / "two"))
    yield from (("workspace", robot), ("ik", robot, "--tilt", "-100deg", "--within-limits"))
    yield ("plan", problem, "--from", plan, "--at", "0.3s", "-o", out / "from", "--json")


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("variant", VARIANTS)
def test_every_command_answers(
    variant: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "ssm_planner.reporting.figures.style.render_figure", lambda *_, **__: {"png": b""}
    )
    number = list(VARIANTS).index(variant)
    objective = list(OBJECTIVES)[number % len(OBJECTIVES)]
    every = _judgements, _exports
    robot, problem = _write(tmp_path, variant, objective, "fast")
    plan = tmp_path / "plan"
    assert _answers(capsys, ("plan", problem, "-o", plan)) == 0
    for commands in selected(every[number % 2 :][:1], every=every):
        for words in commands(plan, robot, problem, tmp_path / "out"):
            _answers(capsys, words)

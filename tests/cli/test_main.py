"""The command line reports errors with one message and the right exit status.

Its output files are either complete or unchanged.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.cli import main
from tests.support.paths import RESULTS, ROOT

Edit = Callable[[str], str]


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """Return a copy of problems/ that a test may change."""
    shutil.copytree(ROOT / "problems", tmp_path / "problems")
    return tmp_path


def replace(old: str, new: str) -> Edit:
    def edit(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return edit


def run_plan(files: Path, *options: str) -> int:
    return main(
        ["plan", str(files / "problems/tilt_insert.yaml"), "-o", str(files / "out"), *options]
    )


def test_plan_writes_a_complete_and_consistent_folder(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_plan(files, "--json") == 0
    captured = capsys.readouterr()
    printed = json.loads(captured.out)
    assert {
        "status",
        "duration",
        "lower_bound",
        "gap",
        "toppra_duration",
        "passed",
        "solve_time",
    } <= set(printed)
    assert {"motors", "limits", "reason", "files"} <= set(printed)
    assert printed["passed"] is True
    assert printed["reason"] is None
    assert "independent check" in captured.err
    assert all(limit["margin"] >= -1e-6 for limit in printed["limits"])
    assert {motor["joint"]: motor["placeholder"] for motor in printed["motors"]}["roll"] is True

    plan = json.loads((files / "out/plan.json").read_text(encoding="utf-8"))
    assert plan["duration"] == pytest.approx(printed["duration"])
    table = np.genfromtxt(files / "out/trajectory.csv", delimiter=",", names=True)
    assert table["time_s"][-1] == pytest.approx(plan["duration"])
    assert np.allclose(np.diff(table["time_s"])[:-1], 1e-3)
    assert -1e3 * table["q4_m"][-1] == pytest.approx(20)
    assert np.abs(table["motor1_torque_Nm"]).max() <= printed["motors"][0]["peak_torque"] + 1e-9
    for name in ("motion.png", "motors.png"):
        assert (files / "out" / name).stat().st_size > 10_000


@pytest.mark.slow
@pytest.mark.usefixtures("no_figures")
def test_the_summary_ends_with_verdicts_and_names_placeholders(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_plan(files, "--verbose") == 0
    text = capsys.readouterr().out
    assert "by toppra" in text[: text.index("duration s")]
    motors = text[text.index("\nMotors: ") :]
    assert "Stand-in figures: roll nominal torque" in " ".join(motors.split())
    assert "PASSED" in motors


PROBLEM, ROBOT = "tilt_insert.yaml", "robots/vitreoretinal.yaml"
WORM = "drives/vitreoretinal_joint1_worm.yaml"
BAD = {
    "unreachable tilt": (
        PROBLEM,
        replace("-135 deg", "-139.5 deg"),
        [r"tilt_insert.yaml:\d+", "tilt", "139.5"],
    ),
    "unknown key": (
        PROBLEM,
        replace("objective:", "objektive:"),
        [r"tilt_insert.yaml:\d+", "objektive", "objective"],
    ),
    "no unit": (PROBLEM, replace("-135 deg", "-135"), [r"tilt_insert.yaml:\d+", "-135", "unit"]),
    "wrong unit": (
        PROBLEM,
        replace("-135 deg", "-135 mm"),
        [r"tilt_insert.yaml:\d+", "-135 mm", "angle"],
    ),
    "radians meant as degrees": (
        PROBLEM,
        replace("-135 deg", "-135 rad"),
        [r"tilt_insert.yaml:\d+", "-135 rad", "deg"],
    ),
    "negative limit": (
        ROBOT,
        replace("velocity: 65 deg/s", "velocity: -65 deg/s"),
        [r"vitreoretinal.yaml:\d+", "velocity", "-65 deg/s"],
    ),
    "unphysical inertia": (
        ROBOT,
        replace("products_of_inertia: cad", "products_of_inertia: tensor"),
        [r"vitreoretinal.yaml:\d+", "inertia", "sign", "cad"],
    ),
    "missing file": (
        PROBLEM,
        replace("robots/vitreoretinal", "robots/nobody"),
        [r"tilt_insert.yaml:\d+", "nobody"],
    ),
    "broken YAML": (PROBLEM, replace("start:", "start: {"), [r"tilt_insert.yaml:\d+"]),
    "not self-locking": (
        WORM,
        replace("mu: {value: 0.13", "mu: {value: 0.01"),
        [r"worm.yaml:\d+", "lock", "0.01", "0.0234"],
    ),
}


@pytest.mark.parametrize("case", BAD, ids=BAD.keys())
def test_bad_input_gives_one_message_and_status_2(
    case: str, files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, edit, expected = BAD[case]
    earlier = files / "out/plan.json"
    earlier.parent.mkdir()
    earlier.write_text("earlier result", encoding="utf-8")
    path = files / "problems" / name
    path.write_text(edit(path.read_text(encoding="utf-8")), encoding="utf-8")
    assert run_plan(files) == 2
    captured = capsys.readouterr()
    message = "\n".join(line for line in captured.err.splitlines() if not line.startswith("["))
    for part in expected:
        assert re.search(part, message), (part, message)
    assert "Traceback" not in message
    assert captured.out == ""
    assert [file.name for file in earlier.parent.iterdir()] == ["plan.json"]
    assert earlier.read_text(encoding="utf-8") == "earlier result"


def test_an_infeasible_problem_gives_its_reason_and_status_1(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = files / "problems/motors/maxon_ecx_torque_22_xl.yaml"
    path.write_text(
        path.read_text(encoding="utf-8")
        .replace("max_torque: 78 mN*m", "max_torque: 15 mN*m")
        .replace("36.7", "14")
        .replace("2480 mA", "946 mA"),
        encoding="utf-8",
    )
    assert run_plan(files, "--json") == 1
    printed = json.loads(capsys.readouterr().out)
    assert printed["status"] == "infeasible"
    assert printed["passed"] is False
    reason = printed["reason"]
    assert (reason["constraint"], reason["joint"]) == ("motor torque", "roll")
    assert reason["required"] > reason["available"] == pytest.approx(0.015)
    page = Path(printed["files"]["page"])
    assert [*(files / "out").iterdir()] == [page]
    text = page.read_text(encoding="utf-8")
    start = text.index("No motion keeps every limit: ")
    assert start < text.index(reason["message"]) < text.index(reason["relaxation"])
    assert start < text.index("<h1>")


@pytest.mark.slow
def test_an_unwritable_folder_is_one_message(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (files / "out").write_text("a file where the folder should be", encoding="utf-8")
    assert run_plan(files) == 2
    assert "cannot be written" in capsys.readouterr().err
    assert (files / "out").read_text(encoding="utf-8") == "a file where the folder should be"


def test_workspace_and_reach(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["workspace", str(ROOT / "problems" / ROBOT), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert math.degrees(result["beta"]) == pytest.approx(109.778, abs=5e-4)
    assert np.degrees(result["tilt_range"]) == pytest.approx([-139.778, -79.778], abs=5e-4)
    assert main(["workspace", "--reach", "-140deg", "-80deg", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert np.degrees([result["alpha"], result["beta"]]) == pytest.approx([30, 110])


def test_ik_gives_every_branch(capsys: pytest.CaptureFixture[str]) -> None:
    robot = str(ROOT / "problems" / ROBOT)
    assert (
        main(["ik", robot, "--roll", "5deg", "--tilt", "-100deg", "--depth", "15mm", "--json"]) == 0
    )
    result = json.loads(capsys.readouterr().out)
    assert result["reachable"] is True
    assert len(result["branches"]) == 2
    assert all(q[3] == pytest.approx(-0.015) for q in result["branches"])
    assert main(["ik", robot, "--tilt", "-150deg", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["reachable"] is False


@pytest.mark.parametrize(
    "arguments", [[], ["nonsense"], ["plan"], ["ik", "x.yaml", "--tilt", "-100"], ["workspace"]]
)
def test_wrong_arguments_are_status_2(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        status = main(arguments)
    except SystemExit as stop:
        status = int(stop.code or 0)
    assert status == 2
    assert "Traceback" not in capsys.readouterr().err


def test_help_names_every_command_without_loading_anything_heavy() -> None:
    code = "import sys; from ssm_planner.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
    code += "print(sorted({'numpy', 'casadi', 'toppra', 'matplotlib', 'pint', 'pydantic'} & set(sys.modules)))"
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert out.rstrip().endswith("[]")
    for command in ("plan", "workspace", "ik"):
        assert command in out


def test_a_fault_of_the_program_has_its_own_status_and_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def faulty(*_: object) -> None:
        raise TypeError("first line\nsecond line")

    monkeypatch.setattr("ssm_planner.load_robot", faulty)
    words = ["workspace", str(ROOT / "problems/robots/vitreoretinal.yaml")]
    assert main(words) == 3
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "internal fault at test_main.py:" in said
    assert "TypeError: first line second line" in said
    assert "report" in said
    monkeypatch.setenv("SSM_PLANNER_DEBUG", "1")
    assert main(words) == 3
    assert "Traceback" in capsys.readouterr().err


SLOW = """
import sys, time
import ssm_planner.formats.csv as csv
def slow(*a):
    print("writing", flush=True)
    time.sleep(30)
csv.write_csv = slow
from ssm_planner.cli import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "status", "word"), [("SIGINT", 130, "interrupted"), ("SIGTERM", 143, "terminated")]
)
def test_requests_to_end(number: str, status: int, word: str, tmp_path: Path) -> None:
    words = ["plan", str(ROOT / "problems/tilt_insert.yaml"), "-o", str(tmp_path / "out")]
    with subprocess.Popen(
        [sys.executable, "-c", SLOW, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "writing\n"
        process.send_signal(getattr(signal, number))
        _, errors = process.communicate(timeout=20)
    assert process.returncode == status
    assert f"{word}; earlier results are unchanged" in errors
    assert "Traceback" not in errors
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_nothing_in_the_working_directory_is_run(tmp_path: Path) -> None:
    """Neither the program nor its child processes import a module from the working directory.

    This also holds for `python -m ssm_planner`.
    """
    folder = tmp_path / "here"
    folder.mkdir()
    for name in ("shutil", "numpy", "casadi", "matplotlib", "pickle", "hashlib", "sitecustomize"):
        (folder / f"{name}.py").write_text(
            f"open({str(tmp_path / name)!r}, 'w')\nraise SystemExit(9)\n", encoding="utf-8"
        )
    (folder / "matplotlibrc").write_text("lines.linewidth: 40\n", encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    start = "import runpy, sys; sys.path[:0] = ['']; sys.argv[0] = 'x'; runpy.run_module('ssm_planner', run_name='__main__')"
    words = ["plan", str(ROOT / "problems/tilt_insert.yaml"), "-o", str(tmp_path / "out")]
    command = [sys.executable, "-c", "import sys; sys.path.remove('')\n" + start, *words]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"here", "out"}
    assert (tmp_path / "out/motion.png").stat().st_size < 3 * (
        ROOT / "results/tilt_insert/motion.png"
    ).stat().st_size


@pytest.mark.slow
@pytest.mark.usefixtures("no_figures")
def test_a_problems_name_chooses_no_folder(files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = files / "problems/tilt_insert.yaml"
    problem.write_text(problem.read_text(encoding="utf-8") + 'name: "../../x"\n', encoding="utf-8")
    (files / "a/b").mkdir(parents=True)
    monkeypatch.chdir(files / "a/b")
    assert main(["plan", str(problem), "--json"]) == 0
    assert [path.name for path in (files / "a/b/results").iterdir()] == ["_.._x"]
    assert not (files / "x").exists()
    assert not (files / "a/x").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("no_figures")
def test_a_plan_that_takes_over_from_another_does_not_replace_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(RESULTS / "tilt_insert", "results/tilt_insert")
    before = {path.name: path.read_bytes() for path in Path("results/tilt_insert").iterdir()}
    assert main(["plan", "tilt_insert", "--from", "results/tilt_insert", "--at", "3.3s"]) == 0
    assert {path.name for path in Path("results").iterdir()} == {
        "tilt_insert",
        "tilt_insert_replanned",
    }
    after = {path.name: path.read_bytes() for path in Path("results/tilt_insert").iterdir()}
    assert after == before


def test_joint_names_of_a_plan_are_no_paths(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = (
        (ROOT / "results/tilt_insert/plan.json")
        .read_text(encoding="utf-8")
        .replace('"name": "roll"', '"name": "../../roll"')
    )
    (tmp_path / "plan.json").write_text(plan, encoding="utf-8")
    words = [
        "export",
        str(tmp_path / "plan.json"),
        "--to",
        "epos4",
        "--counts-per-turn",
        "4096",
        "-o",
        str(tmp_path / "a/b"),
    ]
    assert main(words) == 2
    assert "roll" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["plan.json"]


@pytest.mark.parametrize(("name", "status"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_a_signal_in_code_that_is_made_from_text_has_the_same_status(
    name: str, status: int, tmp_path: Path
) -> None:
    """A signal inside exec() ends the command with the same status as anywhere else.

    Dataclasses and many libraries call exec() while they load, and CPython then remembers the
    interruption.
    """
    (tmp_path / "begun.py").write_text(
        f"""
import signal, sys
from ssm_planner import cli
from ssm_planner.cli import check
check.run_check = lambda options: exec("signal.raise_signal(signal.{name})", {{"signal": signal}})
sys.argv = ["ssm-planner", "check", "x"]
sys.exit(cli.main())
""",
        encoding="utf-8",
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    done = subprocess.run(
        [sys.executable, "-m", "begun"], capture_output=True, text=True, env=environment
    )
    assert done.returncode == status, done.stderr
    assert done.stderr.endswith("earlier results are unchanged\n")


@pytest.mark.parametrize(("name", "status"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_a_signal_where_the_interpreter_ignores_exceptions_ends_the_command(
    name: str, status: int, tmp_path: Path
) -> None:
    """A signal ends the command even where the interpreter ignores exceptions.

    Imports release their locks in callbacks of weak references. The interpreter prints and drops an
    exception that is raised in such a callback.
    """
    (tmp_path / "begun.py").write_text(
        f"""
import signal, sys, time, weakref
from ssm_planner import cli
from ssm_planner.cli import check
def run(options):
    lock = type("Lock", (), {{}})()
    watch = weakref.ref(lock, lambda _: signal.raise_signal(signal.{name}))
    del lock
    time.sleep(30)
check.run_check = run
sys.argv = ["ssm-planner", "check", "x"]
sys.exit(cli.main())
""",
        encoding="utf-8",
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    done = subprocess.run(
        [sys.executable, "-m", "begun"], capture_output=True, text=True, env=environment, timeout=20
    )
    assert done.returncode == status, done.stderr
    assert done.stderr.endswith("earlier results are unchanged\n")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(("name", "status"), [("SIGINT", 130), ("SIGTERM", 143)])
@pytest.mark.parametrize(
    "command", [["export", "--to", "ros2"], ["report"], ["export", "--to", "csv"]], ids=" ".join
)
@pytest.mark.slow
def test_a_signal_while_temporary_files_are_removed_leaves_none(
    command: list[str], name: str, status: int, tmp_path: Path
) -> None:
    (tmp_path / "begun.py").write_text(
        f"""
import pathlib, shutil, signal, sys
from ssm_planner import cli
def interrupted(remove, first=[]):
    def removed(path, *words, **options):
        if "/.out" in str(path) and not first:
            first.append(path)
            signal.raise_signal(signal.{name})
        remove(path, *words, **options)
    return removed
shutil.rmtree = interrupted(shutil.rmtree)
pathlib.Path.unlink = interrupted(pathlib.Path.unlink)
sys.exit(cli.main())
""",
        encoding="utf-8",
    )
    (tmp_path / "out").mkdir()
    out = (
        tmp_path / "out"
        if "ros2" in command
        else tmp_path / "out" / f"out.{'csv' if 'csv' in command else 'html'}"
    )
    words = [command[0], str(ROOT / "results/tilt_insert"), *command[1:], "-o", str(out)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    done = subprocess.run(
        [sys.executable, "-m", "begun", *words],
        capture_output=True,
        text=True,
        env=environment,
        timeout=60,
    )
    assert done.returncode == status, done.stderr
    assert "completed before that" in done.stderr
    assert not list(tmp_path.rglob(".out-*"))


@pytest.mark.parametrize(
    "start",
    ['import runpy; runpy.run_module("ssm_planner", run_name="__main__")', "installed script"],
)
def test_an_interruption_while_the_command_line_is_loaded_leaves_no_traceback(start: str):
    """The installed script imports and calls the entry point that pyproject.toml declares."""
    if start == "installed script":
        project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
        ((module, function),) = re.findall(r'^ssm-planner = "(.+):(.+)"$', project, re.MULTILINE)
        start = f"from {module} import {function}; sys.exit({function}())"
    script = f"""
import sys
class Interrupts:
    def find_spec(self, name, *_):
        if name == "ssm_planner.cli":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupts())
{start}
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (130, "")

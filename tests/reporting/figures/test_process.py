"""Figures of a second process equal those of this process, even if the second process fails."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from ssm_planner.plans import Plan, load_plan
from ssm_planner.reporting.figures import process as figure_process
from ssm_planner.reporting.figures.plan import PLAN_FIGURES
from ssm_planner.reporting.figures.process import FigureProcess, write_figures
from ssm_planner.reporting.figures.style import png_with_text, render_figure
from tests.support.paths import ROOT


@pytest.fixture(scope="module")
def file() -> Plan:
    return load_plan(ROOT / "results/tilt_insert/plan.json")


@pytest.fixture(scope="module")
def plan(file: Plan) -> Plan:
    """Return a plan with only the parts that figures need."""

    return Plan(file.problem, "solved", file.trajectory)


@pytest.fixture(scope="module")
def drawn_here(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return content(write_figures(plan, tmp_path_factory.mktemp("here")))


def content(paths: dict[str, Path]) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in paths.values()}


def begin(drawer: FigureProcess, plan: Plan) -> None:
    drawer.draw("motion", plan.trajectory, plan.problem.robot)
    drawer.draw("motors", plan.trajectory, plan.problem.robot, plan.requirements)


def running(drawer: FigureProcess) -> bool:
    process = drawer._process
    assert process is not None
    return process.poll() is None


@pytest.mark.slow
def test_the_same_bytes(plan: Plan, drawn_here: dict[str, bytes], tmp_path: Path) -> None:
    assert set(drawn_here) == {f"{name}.png" for name in PLAN_FIGURES}
    with FigureProcess() as drawer:
        begin(drawer, plan)
        files = drawer.result()
        about = f"plan {plan.sha256}"
        named = {
            f"{name}.png": png_with_text(endings["png"], "Source", about)
            for name, endings in files.items()
        }
        assert named == drawn_here
        assert content(write_figures(plan, tmp_path, drawer)) == drawn_here
    assert not running(drawer)


@pytest.mark.slow
def test_the_last_motion_counts(file: Plan) -> None:
    first = replace(file.trajectory, phases=file.trajectory.phases[:1])
    last = render_figure(PLAN_FIGURES["motion"](file.trajectory, file.robot), pdf=False)["png"]
    assert render_figure(PLAN_FIGURES["motion"](first, file.robot), pdf=False)["png"] != last
    with FigureProcess() as drawer:
        drawer.draw("motion", first, file.robot)
        drawer.draw("motion", file.trajectory, file.robot)
        assert drawer.result()["motion"]["png"] == last


FAULTS: dict[str, Callable[[pytest.MonkeyPatch], None]] = {
    "no interpreter": lambda patch: patch.setattr(sys, "executable", ""),
    "no such interpreter": lambda patch: patch.setattr(sys, "executable", "/nowhere/python"),
    "it fails": lambda patch: patch.setattr(
        figure_process, "_CHILD_PROGRAM", "raise SystemExit(3)"
    ),
    "it ends without an answer": lambda patch: patch.setattr(
        figure_process, "_CHILD_PROGRAM", "pass"
    ),
    "it never answers": lambda patch: (
        patch.setattr(figure_process, "_CHILD_PROGRAM", "import time; time.sleep(60)"),
        patch.setattr(figure_process, "ANSWER_TIMEOUT", 0.2),
    ),
    "one processor": lambda patch: patch.setattr(os, "cpu_count", lambda: 1),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.slow
def test_the_caller_draws_figures_that_the_process_does_not_deliver(
    fault: str,
    plan: Plan,
    drawn_here: dict[str, bytes],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    FAULTS[fault](monkeypatch)
    with FigureProcess() as drawer:
        begin(drawer, plan)
        assert content(write_figures(plan, tmp_path, drawer)) == drawn_here


@pytest.mark.parametrize("begun", [False, True])
def test_an_interruption_ends_it(begun: bool, plan: Plan) -> None:
    drawer = FigureProcess()

    def interrupted() -> None:
        with drawer:
            assert running(drawer)
            if begun:
                begin(drawer, plan)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert not running(drawer)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="signals as a terminal sends them")
def test_ctrl_c_while_results_are_written_leaves_no_files_and_no_process(tmp_path: Path) -> None:
    code = """if True:
        import sys, time
        from ssm_planner.reporting.figures import process as figure_process
        start = figure_process._start_process
        def started():
            process = start()
            print(process.pid, flush=True)
            return process
        figure_process._start_process = started
        import ssm_planner.formats.csv as csv
        def slow(*a):
            print("writing", flush=True)
            time.sleep(30)
        csv.write_csv = slow
        from ssm_planner.cli import main
        sys.exit(main(sys.argv[1:]))
    """
    words = ["plan", str(ROOT / "problems/tilt_insert.yaml"), "-o", str(tmp_path / "out")]
    with subprocess.Popen(
        [sys.executable, "-c", code, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        start_new_session=True,
    ) as process:
        assert process.stdout is not None
        child = int(process.stdout.readline())
        assert process.stdout.readline() == "writing\n"
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert not still_there(child)
    assert "earlier results are unchanged" in errors
    assert not list(tmp_path.iterdir())


def still_there(pid: int) -> bool:
    """Return True if a process still exists after 5 s."""
    for _ in range(50):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
        time.sleep(0.1)
    return True

"""Fixtures that open pages in a headless Chromium and record every message and every request."""

from __future__ import annotations

import copy
import json
import random
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.paths import ROOT

PLAN = ROOT / "results/tilt_insert/plan.json"
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
)
READY = "typeof SSM !== 'undefined' && Boolean(SSM.ready)"


@dataclass
class Visit:
    """An open page with the messages that it wrote and the addresses that it fetched."""

    page: Any
    said: list[str] = field(default_factory=list)
    fetched: list[str] = field(default_factory=list)

    def wait(self, condition: str, seconds: float = 20.0) -> None:
        """Wait until a JavaScript expression is true.

        The content security policy of the page forbids the wait functions of Playwright.
        """
        for _ in range(int(seconds / 0.02)):
            if self.page.evaluate(condition):
                return
            self.page.wait_for_timeout(20)
        raise AssertionError(f"never true: {condition}")


def chromium() -> str:
    path = (
        shutil.which("chromium")
        or shutil.which("chromium-browser")
        or shutil.which("google-chrome")
    )
    if path is None:
        pytest.skip("no Chromium installed (Debian: apt-get install chromium)")
    return path


@pytest.fixture(scope="session")
def launch() -> Iterator[Callable[..., Any]]:
    """Return a function that starts a browser with further flags."""
    sync_api = pytest.importorskip(
        "playwright.sync_api", reason="Playwright is not installed (pip install playwright)"
    )
    path = chromium()
    with sync_api.sync_playwright() as playwright:
        yield lambda *flags: playwright.chromium.launch(executable_path=path, args=[*FLAGS, *flags])


@pytest.fixture(scope="session")
def browser(launch: Callable[..., Any]) -> Iterator[Any]:
    started = launch()
    yield started
    started.close()


def listen(opened: Visit, message: Any) -> None:
    """Record a message of the page.

    The graphics driver also writes messages when Chromium copies a 3D view that was drawn in
    software. These are ignored.
    """
    if "GL Driver Message" not in message.text:
        opened.said.append(f"{message.type}: {message.text}")


@pytest.fixture
def visit(browser: Any) -> Iterator[Callable[..., Visit]]:
    """Return a function that opens an address and waits until the scripts of the page are ready.

    The width and height of the window are in pixels.
    """
    pages = []

    # With reduced motion, pages do not play by themselves.
    def open_page(address: str, width: int = 1280, height: int = 800, ready: str = READY) -> Visit:
        page = browser.new_page(
            viewport={"width": width, "height": height}, reduced_motion="reduce"
        )
        pages.append(page)
        opened = Visit(page)
        page.on("console", lambda message: listen(opened, message))
        page.on("pageerror", lambda error: opened.said.append(f"error: {error}"))
        page.on("request", lambda request: opened.fetched.append(request.url))
        page.goto(address)
        opened.wait(ready)
        return opened

    yield open_page
    for page in pages:
        page.close()


@pytest.fixture(scope="session")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the report of the shipped plan and return its path."""
    from ssm_planner.plans import load_plan
    from ssm_planner.reporting.html.report import write_report

    return write_report(load_plan(PLAN), tmp_path_factory.mktemp("report") / "report.html")


@pytest.fixture(scope="session")
def in_eye(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the shipped plan inside an eye with a rotated lens, and with limits on rates."""
    from ssm_planner.kinematics.rotations import rotation
    from ssm_planner.loading.load import load_problem
    from ssm_planner.problem.serialization import to_plain

    document = json.loads(PLAN.read_text(encoding="utf-8"))
    problem = load_problem(ROOT / "problems/eye_approach.yaml")
    eye = to_plain(problem.eye)
    eye["lens"] |= {
        "semi_axes": [0.0048, 0.004, 0.002],
        "frame": rotation([0.6, 0.0, 0.8], 0.7).tolist(),
    }
    document["problem"] |= {"eye": eye, "rates": dict(problem.rates)}
    path = tmp_path_factory.mktemp("in_eye") / "plan.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def in_eye_report(in_eye: Path) -> Path:
    """Write the report of the plan inside an eye and return its path."""
    from ssm_planner.plans import load_plan
    from ssm_planner.reporting.html.report import write_report

    return write_report(load_plan(in_eye), in_eye.with_name("report.html"))


@pytest.fixture(scope="session")
def slower(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the shipped plan stretched to 1.25 times its duration.

    The names of its problem, phases and robot are HTML.
    """
    document = copy.deepcopy(json.loads(PLAN.read_text(encoding="utf-8")))
    factor, trajectory = 1.25, document["trajectory"]
    trajectory["breaks_s"] = [factor * time for time in trajectory["breaks_s"]]
    trajectory["coefficients"] = [
        [[value / factor**k for value in row] for k, row in enumerate(piece)]
        for piece in trajectory["coefficients"]
    ]
    for phase in trajectory["phases"]:
        phase["start_s"], phase["end_s"] = factor * phase["start_s"], factor * phase["end_s"]
        phase["name"] = "</script><script>window.broken = 1</script>"
    document["duration"] *= factor
    document["problem"]["name"] = "<img src=x onerror='window.broken = 2'>"
    document["problem"]["robot"]["name"] = "<script>window.broken = 3</script>"
    path = tmp_path_factory.mktemp("slower") / "plan.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def comparison(slower: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the comparison of the shipped plan with the slower one and return its path."""
    from ssm_planner.plans import load_plan
    from ssm_planner.reporting.html.compare import write_comparison

    out = tmp_path_factory.mktemp("comparison") / "comparison.html"
    return write_comparison(load_plan(PLAN), load_plan(slower), out)


@pytest.fixture(scope="session")
def simulated() -> Any:
    """Return the simulation of the shipped plan with a joint that stalls."""
    from ssm_planner.plans import load_plan
    from ssm_planner.simulation.simulate import Scenario, simulate

    return simulate(load_plan(PLAN), Scenario(stall=("tilt", 1.0)))


@pytest.fixture(scope="session")
def simulation(simulated: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the page of the simulation with a stalled joint and return its path."""
    from ssm_planner.plans import load_plan
    from ssm_planner.reporting.html.simulation import write_simulation_page

    return write_simulation_page(
        load_plan(PLAN), simulated, tmp_path_factory.mktemp("simulation") / "simulation.html"
    )


@pytest.fixture(scope="session")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the page of the shipped study with random figures and return its path.

    Every fourth candidate is infeasible. Candidate 5 has a page of its motion.
    """
    from ssm_planner.studies.page import write_study_page
    from ssm_planner.studies.store import Candidate
    from ssm_planner.studies.study_file import load_study

    of, draw = load_study(ROOT / "problems/studies/vitreoretinal.yaml"), random.Random(1)
    rows = []
    for number in range(48):
        design = of.design(np.array([draw.random() for _ in of.paths]))
        figures = {name: draw.uniform(0.2, 0.3) for name in of.minimise}
        fallen = Candidate(
            number,
            "infeasible",
            design,
            stage=("reach", "plan")[number % 8 // 4],
            reason="too weak",
        )
        rows.append(Candidate(number, "done", design, figures=figures) if number % 4 else fallen)
    out = tmp_path_factory.mktemp("my study") / "study.html"
    motion = out.parent / "candidate_5" / "tilt_insert" / "report.html"
    motion.parent.mkdir(parents=True)
    motion.write_text("<title>the motion of candidate 5</title>", encoding="utf-8")
    write_study_page(of, (rows[1], *rows), out, finished=True)
    return out

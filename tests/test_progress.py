"""Every long call reports its steps, and the counts of the steps never decrease."""

from __future__ import annotations

import threading
import urllib.request
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
import yaml

import ssm_planner
from ssm_planner import ProblemError, Progress, Step
from tests.support.paths import ROOT


def identify(progress: Progress) -> object:
    return ssm_planner.identify("rig3_worm", progress=progress)


def plan(progress: Progress) -> object:
    return ssm_planner.plan("tilt_insert", progress, relaxations=False)


def simulate(progress: Progress) -> object:
    scenario = ssm_planner.Scenario(draws=2)
    return ssm_planner.simulate(ROOT / "results/tilt_insert", scenario, progress=progress)


@pytest.mark.usefixtures("few_points")
@pytest.mark.parametrize("work", [pytest.param(identify, marks=pytest.mark.slow), plan, simulate])
def test_long_work_reports_steps_that_count_forwards(work: Callable[[Progress], object]) -> None:
    steps: list[Step] = []
    work(steps.append)
    assert steps
    assert all(type(step) is Step and step.step for step in steps)
    for step, later in pairwise(steps):
        assert 0 <= step.done <= step.total or step.total == 0
        if step.step == later.step and step.total and step.total == later.total:
            assert step.done < later.done
    assert any(step.total for step in steps)


def test_the_message_names_the_present_item_and_ends_with_the_last() -> None:
    messages = [str(Step("scan", done, 3)) for done in range(4)]
    assert messages == ["scan (1 of 3)", "scan (2 of 3)", "scan (3 of 3)", "scan (3 of 3)"]
    assert str(Step("check")) == "check"


@pytest.mark.parametrize("call", [ssm_planner.schema, lambda kind: ssm_planner.template(kind, "x")])
def test_an_unknown_kind_of_file_is_refused(call: Callable[[str], object]) -> None:
    with pytest.raises(ProblemError, match=r"kind = gearbox: .*allowed: .*motor"):
        call("gearbox")


def test_a_template_is_a_valid_file_of_its_schema(tmp_path: Path) -> None:
    text = ssm_planner.template("motor", "mine")
    (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
    assert ssm_planner.load_motor(tmp_path / "mine.yaml").name == "mine"
    assert set(yaml.safe_load(text)) <= set(ssm_planner.schema("motor")["properties"])


def test_the_view_is_served_until_its_context_ends() -> None:
    with ssm_planner.serve_view() as server:
        server.timeout = 5
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        thread = threading.Thread(target=server.handle_request)
        thread.start()
        with opener.open(server.url, timeout=5) as answer:
            assert b"<html" in answer.read()
        thread.join(5)
    with pytest.raises(ProblemError, match="allowed: 0 to 65535"):
        ssm_planner.serve_view(port=65536)


def test_a_reproduction_names_its_files_and_missing_parts(tmp_path: Path) -> None:
    with pytest.raises(ProblemError, match="no such folder"):
        ssm_planner.reproduce(tmp_path, problems=tmp_path / "none")

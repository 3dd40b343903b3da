"""The data of each result's page keep their laws for random problems with and without a motion.

RANDOM_RESULTS=200 tests 200 problems.
"""

from __future__ import annotations

import html
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.pipeline.run import plan
from ssm_planner.pipeline.thermal import with_fast_planner
from ssm_planner.plans import Plan
from ssm_planner.problem.problem import Problem
from ssm_planner.reporting.html.channels import sample_channels, time_grid
from ssm_planner.reporting.html.compare import comparison_data
from ssm_planner.reporting.html.report import report_data, write_no_plan
from ssm_planner.typing import Array
from tests.support.cases import drawn
from tests.support.random_problems import random_problem

COUNT = int(os.environ.get("RANDOM_RESULTS", "30"))
GROUPS = 5
"""Number of tests into which the seeds are divided. These tests can run in parallel."""


def check_panels(panels: list[dict[str, Any]], ends: list[float], step: float) -> None:
    """Check the titles, units and names of plots, and that limits are active in the motion only.

    `ends` are the durations of the motions and `step` is a tolerance, both in s.
    """
    for panel in panels:
        assert panel["title"]
        assert panel["unit"], panel["title"]
        assert panel["scale"] > 0
        assert all(series["label"] for series in panel["series"])
        for limit in panel["limits"]:
            assert limit["label"]
            assert limit["low"] is not None or limit["high"] is not None
            for end in (limit["low"], limit["high"]):
                assert end is None or math.isfinite(end)
        for active in panel["active"]:
            end = ends[active["joint"]] if len(ends) > 1 else ends[0]
            assert 0.0 <= active["start"] <= active["end"] <= end + step, active["label"]


def check_channels(panels: list[dict[str, Any]], channels: dict[str, Array]) -> None:
    """Check that every curve that a panel names exists and is finite."""
    for panel in panels:
        for series in panel["series"]:
            assert np.isfinite(channels[series["channel"]]).all(), series["channel"]


@pytest.mark.slow
@pytest.mark.parametrize("group", drawn(2, range(GROUPS)))
def test_pages_of_random_results_keep_their_laws(
    group: int, tilt_insert: Problem, tmp_path: Path
) -> None:
    last: Plan | None = None
    for seed in range(group, COUNT, GROUPS):
        result = plan(with_fast_planner(random_problem(tilt_insert, seed)), relaxations=False)
        if not result.passed:
            page = write_no_plan(result, tmp_path / "no_plan.html").read_text(encoding="utf-8")
            sentence = page.partition('class="lead"><strong>')[2].partition("</strong>")[0]
            assert sentence.startswith(
                ("No motion keeps every limit", "The motion is not certified")
            )
            assert result.reason is None or result.reason.message in html.unescape(sentence)
            continue
        data = report_data(result)
        grid = time_grid(result.motion.duration)
        check_panels(data["panels"], [result.motion.duration], 2 * grid[1])
        check_channels(data["panels"], sample_channels(result, grid))
        if last is not None:
            both = comparison_data((last, result))
            step = 2 * both["duration"] / (len(grid) - 1)
            check_panels(both["panels"], both["ends"], step)
        last = result

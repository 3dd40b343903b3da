"""Values appear as tables, plots and data frames in notebooks.

Messages reach the logger, and an exception cancels `plan`.
"""

from __future__ import annotations

import copy
import logging
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib as mpl
import nbclient
import nbformat
import numpy as np
import pytest

from ssm_planner import Plan, SsmPlannerError, load_plan, plan
from ssm_planner.progress import Step
from ssm_planner.representation import html_table
from tests.support.paths import ROOT


class Cells(HTMLParser):
    """A parser that collects the texts of the cells of a table by row."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag == "tr":
            self.rows.append([])
        elif tag == "td":
            self.rows[-1].append("")

    def handle_data(self, data: str) -> None:
        if self.rows and self.rows[-1]:
            self.rows[-1][-1] += data


@pytest.fixture(scope="module")
def result() -> Plan:
    return load_plan(ROOT / "results/tilt_insert")


@pytest.fixture
def pyplot() -> Iterator[Any]:
    mpl.use("Agg")
    from matplotlib import pyplot

    yield pyplot
    pyplot.close("all")


def test_a_table_has_every_value_and_is_escaped() -> None:
    rows = Cells(html_table([{"name": "<b>", "worst": 1 / 3}, {"name": "&", "worst": None}])).rows
    assert rows == [["name", "worst"], ["<b>", "0.333333"], ["&", "None"]]
    assert Cells(html_table([])).rows == []


def test_values_show_themselves_as_tables(result: Plan) -> None:
    assert result.certificate is not None
    limits = [limit.name for limit in result.certificate.limits]
    assert [row[0] for row in Cells(result.certificate._repr_html_()).rows[1:]] == limits
    rows = Cells(result._repr_html_()).rows
    assert dict(zip(*rows[:2], strict=True))["duration"] == f"{result.duration:.6g}"
    assert [row[0] for row in rows[3:]] == limits
    assert f"{result.duration:.6g} s" in result.motion._repr_html_()
    assert [row[0] for row in Cells(result.motion._repr_html_()).rows[1:]] == ["tilt", "insert"]


def test_a_plot_shows_the_joints_in_degrees_and_millimetres(result: Plan, pyplot: Any) -> None:
    axes = pyplot.figure().add_subplot()
    assert result.plot(axes) is axes
    assert axes.get_xlabel() == "time (s)"
    lines = axes.get_lines()
    assert [line.get_label() for line in lines] == [
        "roll (deg)", "tilt (deg)", "spin (deg)", "insertion (mm)"
    ]  # fmt: skip
    end = result.motion.sample(result.duration).q[0]
    for line, value in zip(lines, [*np.degrees(end[:3]), 1e3 * end[3]], strict=True):
        assert line.get_xdata()[-1] == pytest.approx(result.duration)
        assert line.get_ydata()[-1] == pytest.approx(value, abs=1e-9)
    assert result.plot() is not axes or pyplot.gca() is axes


def test_data_frames_need_pandas(result: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    samples = result.motion.uniform(10.0)
    monkeypatch.setitem(sys.modules, "pandas", None)
    for value in (samples, result.certificate):
        with pytest.raises(SsmPlannerError, match="pip install pandas"):
            value.to_dataframe()
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=lambda data: data))
    frame = samples.to_dataframe()
    assert list(frame)[:6] == ["t", "q1", "q2", "q3", "q4", "qd1"]
    assert np.array_equal(frame["qddd4"], samples.qddd[:, 3])
    assert result.certificate is not None
    assert [row["margin"] for row in result.certificate.to_dataframe()] == [
        limit.margin for limit in result.certificate.limits
    ]


def test_messages_reach_the_logger_and_an_exception_cancels(
    caplog: pytest.LogCaptureFixture,
) -> None:
    steps: list[Step] = []

    def cancel(step: Step) -> None:
        steps.append(step)
        raise KeyboardInterrupt

    with caplog.at_level(logging.INFO, "ssm_planner"):
        with pytest.raises(KeyboardInterrupt):
            plan("tilt_insert", cancel)
        assert len(steps) == 1
        assert caplog.messages == [str(step) for step in steps]
        assert plan("tilt_insert", steps.append, relaxations=False).passed
    assert caplog.messages == [str(step) for step in steps]


@pytest.mark.slow
def test_the_notebook_of_the_examples_prints_what_it_shows(tmp_path: Path) -> None:
    notebook = nbformat.read(ROOT / "examples/first_plan.ipynb", as_version=4)
    run = copy.deepcopy(notebook)
    where = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(run, timeout=300, resources=where).execute()
    for before, after in zip(notebook.cells, run.cells, strict=True):
        printed = ["".join(o.get("text", "")) for o in after.get("outputs", [])]
        assert printed == ["".join(o.get("text", "")) for o in before.get("outputs", [])]
    assert sum("image/png" in str(cell.get("outputs")) for cell in run.cells) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["stream"]

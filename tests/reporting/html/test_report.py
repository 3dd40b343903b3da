"""The report is tested without a browser.

The tests cover the content of the file, the time to write it, and names that must remain text.
"""

from __future__ import annotations

import base64
import itertools
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jinja2 import UndefinedError

from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.loading.load import load_problem
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem import JOINTS, Dwell, Straight
from ssm_planner.problem.serialization import to_plain
from ssm_planner.reporting.html.channels import (
    MIN_SAMPLES,
    encode_channels,
    sample_channels,
    time_grid,
)
from ssm_planner.reporting.html.compare import comparison_data, write_comparison
from ssm_planner.reporting.html.page import EMBEDDED_LIBRARIES, safe_json, template_environment
from ssm_planner.reporting.html.panels import active_intervals
from ssm_planner.reporting.html.report import (
    _limiting_text,
    _motion_table,
    report_data,
    report_page,
    write_report,
)
from ssm_planner.reporting.html.simulation import simulation_data, write_simulation_page
from ssm_planner.reporting.text import (
    Table,
    joints_table,
    limit_cells,
    simulation_tables,
    summary_lines,
)
from ssm_planner.simulation.simulate import Scenario, simulate
from ssm_planner.verification.check import check
from tests.support.cli import run
from tests.support.paths import PROBLEMS, RESULTS

PLAN = RESULTS / "tilt_insert/plan.json"
APPROACH = PROBLEMS / "eye_approach.yaml"
MEGABYTE = 2**20


TEXT = st.text() | st.text(alphabet="<>&\"'/!-\u2028 script")


class Reader(HTMLParser):
    """A parser that collects the elements of a page with their attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_report(load_plan(PLAN), tmp_path_factory.mktemp("page") / "report.html").read_text(
        encoding="utf-8"
    )


def test_page_and_terminal_show_where_the_joints_start_and_end(page: str) -> None:
    plan = load_plan(PLAN)
    assert plan.trajectory is not None
    rows = joints_table(plan).rows
    ends = plan.trajectory.sample(np.array([0.0, plan.trajectory.duration])).q
    for k, (row, unit) in enumerate(zip(rows, ("deg", "deg", "deg", "mm"), strict=True)):
        values = [float(cell.replace("\u2212", "-")) for cell in row[1:3]]
        assert values == pytest.approx(
            ends[:, k] * (180 / np.pi if unit == "deg" else 1e3), abs=1e-3
        )
        assert row[3] == unit
    assert "<h3>Joints at both ends</h3>" in page
    assert "joint        from" in "\n".join(summary_lines(plan, verbose=True))


def stretched(factor: float, **names: str) -> dict[str, Any]:
    """Return the shipped plan with its time stretched by `factor`, as a document.

    `names` replace entries of its problem.
    """
    document: dict[str, Any] = json.loads(PLAN.read_text(encoding="utf-8"))
    trajectory = document["trajectory"]
    trajectory["breaks_s"] = [factor * t for t in trajectory["breaks_s"]]
    trajectory["coefficients"] = [
        [[value / factor**k for value in row] for k, row in enumerate(piece)]
        for piece in trajectory["coefficients"]
    ]
    for phase in trajectory["phases"]:
        phase["start_s"], phase["end_s"] = factor * phase["start_s"], factor * phase["end_s"]
    document["duration"] *= factor
    document["problem"].update(names)
    return document


def test_nothing_is_fetched_and_the_file_is_small(page: str) -> None:
    assert len(page.encode()) < 5 * MEGABYTE
    for name, attributes in Reader(page).tags:
        for key in ("src", "href", "action", "data", "srcset"):
            assert not attributes.get(key) or str(attributes[key]).startswith(("data:", "#")), (
                name,
                attributes,
            )
    assert "default-src 'none'" in page
    styles = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)
    assert not any("url(" in style or "@import" in style for style in styles)


def test_licences_of_the_libraries_go_with_the_page(page: str) -> None:
    for name, _ in EMBEDDED_LIBRARIES:
        assert name in page
    assert page.count("Permission is hereby granted, free of charge") >= len(EMBEDDED_LIBRARIES)


def test_the_report_of_a_ten_second_plan_stays_small(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(stretched(3.0)), encoding="utf-8")
    out = write_report(load_plan(path), tmp_path / "report.html")
    assert out.stat().st_size < 8 * MEGABYTE


def test_same_plan_gives_the_same_channels_exactly() -> None:
    plan = load_plan(PLAN)
    data = report_data(plan)

    def channel(name: str) -> np.ndarray:
        return np.frombuffer(base64.b64decode(data["channels"][name]), dtype="<f8")

    samples = plan.trajectory.sample(channel("t"))
    for i in range(4):
        assert np.array_equal(channel(f"q{i}"), samples.q[:, i])
        assert np.array_equal(channel(f"qd{i}"), samples.qd[:, i])


def test_peaks_of_the_page_are_the_plans() -> None:
    data = report_data(load_plan(PLAN))
    names = [joint["name"] for joint in data["joints"]]
    for required in json.loads(PLAN.read_text(encoding="utf-8"))["motors"]:
        i = names.index(required["joint"])
        for channel, key in ((f"tau{i}", "peak_torque"), (f"w{i}", "peak_speed")):
            values = np.frombuffer(base64.b64decode(data["channels"][channel]), dtype="<f8")
            assert np.abs(values).max() == pytest.approx(required[key], rel=0.02)


def test_a_loaded_plan_is_sized_as_the_file_says(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(load_plan(PLAN).to_dict()), encoding="utf-8")
    sizing = load_plan(path).sizing
    assert sizing is not None
    assert json.loads(path.read_text(encoding="utf-8"))["sizing"] == json.loads(
        json.dumps(sizing.to_dict())
    )


def test_torque_split_adds_up_to_the_torque() -> None:
    channels = {
        name: np.frombuffer(base64.b64decode(text), dtype="<f8")
        for name, text in report_data(load_plan(PLAN))["channels"].items()
    }
    for i in (0, 1, 3):
        parts = sum(values for name, values in channels.items() if name.startswith(f"split{i}_"))
        assert parts == pytest.approx(channels[f"tau{i}"], abs=1e-12)


def test_an_eye_and_rates_have_their_panels_limits_and_places(tmp_path: Path) -> None:
    """The page plots the limited values that the check judges.

    Their limits and worst values are compared with those of `check`.
    """
    document = stretched(1.0)
    problem = load_problem(APPROACH)
    document["problem"] |= {"eye": to_plain(problem.eye), "rates": {"tilt": 0.3, "depth": 0.01}}
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    plan = load_plan(path)
    data = report_data(plan)
    assert data["scene"]["eye"] == to_plain(problem.eye)
    result = {limit.name: limit for limit in check(plan.trajectory, plan.robot, plan.limits).limits}
    panels = {
        limit["name"]: (panel, limit) for panel in data["panels"] for limit in panel["limits"]
    }
    for name, scale in (
        ("tilt rate", 180 / np.pi),
        ("insertion speed", 1e3),
        ("retina clearance", 1e3),
        ("lens clearance", 1.0),
    ):
        panel, limit = panels[name]
        assert panel["scale"] == pytest.approx(scale)
        low_side = name.endswith("clearance")
        assert limit["low" if low_side else "high"] == pytest.approx(scale * result[name].limit)
        values = np.frombuffer(base64.b64decode(data["channels"][limit["channel"]]), dtype="<f8")
        worst = values.min() if low_side else np.abs(values).max()
        assert worst == pytest.approx(result[name].worst, rel=0.02)
    assert "roll rate" not in panels
    text = write_report(load_plan(path), tmp_path / "report.html").read_text(encoding="utf-8")
    assert "retina clearance, radius 11.3 mm" in text
    assert "lens clearance, shaft radius 0.25 mm" in text


def test_plans_with_and_without_an_eye_are_compared(tmp_path: Path) -> None:
    document = stretched(1.2)
    document["problem"] |= {"eye": to_plain(load_problem(APPROACH).eye), "rates": {"tilt": 0.3}}
    other = tmp_path / "plan.json"
    other.write_text(json.dumps(document), encoding="utf-8")
    for pair in ((PLAN, other), (other, PLAN)):
        assert "Tip to retina" in write_comparison(
            *map(load_plan, pair), tmp_path / "comparison.html"
        ).read_text(encoding="utf-8")


def test_a_simulated_playback_stands_beside_its_plan(tmp_path: Path) -> None:
    """The page shows the positions, errors and torques of the simulation.

    The simulation runs at half the speed and with a motor that stalls.
    """
    plan = load_plan(PLAN)
    result = simulate(plan, Scenario(speed=0.5, stall=("tilt", 2.0)))
    data = simulation_data(plan, result)
    planned, simulated = (
        {
            name: np.frombuffer(base64.b64decode(values), dtype="<f8")
            for name, values in side.items()
        }
        for side in data["channels"]
    )
    t = simulated["t"]
    assert t[-1] == pytest.approx(result.time[-1])
    for i in (0, 1, 2, 3):
        np.testing.assert_allclose(
            simulated[f"q{i}"], np.interp(t, result.time, result.q[:, i]), atol=1e-12
        )
        np.testing.assert_allclose(
            simulated[f"q{i}"] - planned[f"q{i}"], simulated[f"error{i}"], atol=2e-5
        )
    assert np.abs(simulated["error1"]).max() > 1.0
    shown = {panel["title"] for panel in data["panels"]}
    assert shown >= {"Distance of the tip from the plan", "roll", "tilt", "insertion"}
    text = write_simulation_page(plan, result, tmp_path / "simulation.html").read_text(
        encoding="utf-8"
    )
    assert "the following error left its window" in text


@given(TEXT)
def test_text_never_becomes_markup(text: str) -> None:
    template = template_environment().from_string(
        '{% from "parts.html" import table, verdict %}{{ table(t) }}{{ verdict(marks) }}'
    )
    tables = [Table((cell,), [(cell,)], caption=cell) for cell in ("text", text)]
    pages = [template.render(t=t, marks=[("good", t.header[0], t.header[0])]) for t in tables]
    plain, hostile = (Reader(page).tags for page in pages)
    assert len(hostile) >= len(plain) - 1  # An empty caption is omitted.
    assert [entry for entry in plain if entry[0] != "caption"] == [
        entry for entry in hostile if entry[0] != "caption"
    ]


def test_a_name_that_a_template_misses_is_an_error() -> None:
    with pytest.raises(UndefinedError):
        template_environment().get_template("report.html").render(data="{}")


@given(
    st.recursive(TEXT | st.floats(allow_nan=False, allow_infinity=False), st.lists, max_leaves=5)
)
def test_embedded_json_cannot_end_its_element(data: Any) -> None:
    text = safe_json(data)
    assert not set("<>&") & set(text)
    assert json.loads(text) == data


@given(st.lists(st.floats(allow_nan=False), min_size=1, max_size=20))
def test_channels_are_exact(values: list[float]) -> None:
    array = np.array(values)
    assert np.array_equal(
        np.frombuffer(base64.b64decode(encode_channels({"x": array})["x"]), dtype="<f8"), array
    )


@given(st.lists(st.booleans(), min_size=2, max_size=60))
def test_every_active_instant_is_in_a_stretch(at: list[bool]) -> None:
    t = 0.1 * np.arange(len(at))
    values = np.where(at, 2.0, 0.0)
    stretches = list(active_intervals(t, values, -2.0, 2.0))
    inside = [any(start <= time <= end for start, end, _ in stretches) for time in t]
    assert inside == at
    assert all(side == 1 for *_, side in stretches)


def test_plan_without_trajectory_is_refused(tmp_path: Path) -> None:
    document = stretched(1.0)
    document["trajectory"] = None
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(TrajectoryError, match="no trajectory"):
        write_report(load_plan(path), tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


def test_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(ExportError, match="cannot be written"):
        write_report(load_plan(PLAN), tmp_path / "file" / "report.html")


def test_comparison_joins_limits_of_both(tmp_path: Path) -> None:
    other = tmp_path / "plan.json"
    other.write_text(json.dumps(stretched(1.5, name="<script>other</script>")), encoding="utf-8")
    text = write_comparison(
        load_plan(PLAN), load_plan(other), tmp_path / "comparison.html"
    ).read_text(encoding="utf-8")
    assert "+50.00 %" in text
    assert "<script>other" not in text


def test_no_limit_is_active_after_the_end_of_its_plan(tmp_path: Path) -> None:
    other = tmp_path / "plan.json"
    other.write_text(json.dumps(stretched(1.5)), encoding="utf-8")
    for first, second in ((PLAN, other), (other, PLAN)):
        data = comparison_data((load_plan(first), load_plan(second)))
        step = data["duration"] / (MIN_SAMPLES - 1)
        stretches = [stretch for panel in data["panels"] for stretch in panel["active"]]
        assert {stretch["joint"] for stretch in stretches} == {0, 1}
        for stretch in stretches:
            assert stretch["end"] <= data["ends"][stretch["joint"]] + step, stretch["label"]


def test_a_limit_of_one_plan_has_the_colour_of_this_plan(tmp_path: Path) -> None:
    document = stretched(1.5)
    document["problem"]["robot"]["joints"][0]["velocity"] *= 1.1
    other = tmp_path / "plan.json"
    other.write_text(json.dumps(document), encoding="utf-8")
    panels = comparison_data((load_plan(PLAN), load_plan(other)))["panels"]
    sections = [name for name, _ in itertools.groupby(panel["section"] for panel in panels)]
    assert len(sections) == len(set(sections)), "each section is opened once"
    sides = {
        (line["label"], line["high"]): line["side"] for panel in panels for line in panel["limits"]
    }
    of_roll = {high: side for (label, high), side in sides.items() if label == "velocity, roll"}
    assert [of_roll[high] for high in sorted(of_roll)] == [0, 1]
    assert all(side is None for (label, _), side in sides.items() if label.endswith("insertion"))


def test_the_page_of_power_losses_shows_their_travel() -> None:
    plan = load_plan(PLAN)
    result = simulate(plan, Scenario(power_loss="everywhere", instants=5))
    data = simulation_data(plan, result)
    (panel,) = (panel for panel in data["panels"] if panel["channel"] == "travel")
    assert (panel["unit"], panel["scale"]) == ("mm", 1e3)
    curve = {
        name: np.frombuffer(base64.b64decode(data["channels"][1][name]), dtype="<f8")
        for name in ("t", "travel")
    }
    # The page draws straight lines between the power losses and samples them at its instants.
    travel = np.interp(curve["t"], result.losses.time, result.losses.travel)
    np.testing.assert_allclose(curve["travel"], travel, rtol=1e-12, atol=0.0)


def test_a_joint_without_a_drive_has_no_tracking() -> None:
    """The simulation moves a joint without a drive exactly, so that its error has no meaning."""
    plan = load_plan(PLAN)
    result = simulate(plan, Scenario(stall=("tilt", 1.0)))
    assert {row[0] for row in simulation_tables(result)[0].rows} == {"roll", "tilt", "insertion"}
    titles = [panel["title"] for panel in simulation_data(plan, result)["panels"]]
    assert "spin" not in titles


def test_the_bound_of_a_free_motion_is_called_loose(page: str) -> None:
    """Without a bound along the path, the page only states the general bound.

    It calls this bound loose if the motion is free.
    """
    assert "proven: no motion on this path is shorter than" in page
    for name in ("eye_approach", "tilt_insert"):
        result = load_plan(RESULTS / name / "plan.json")
        phases = tuple(replace(phase, path_bound=None) for phase in result.phases)
        text = report_page(replace(result, phases=phases))
        assert "proven: no motion" not in text
        assert ("loose for free motions" in text) == (name == "eye_approach")


def test_every_bound_has_a_sense() -> None:
    """Each worst value satisfies the inequality that the page prints before its limit."""
    for name in ("tilt_insert", "eye_approach"):
        certificate = load_plan(RESULTS / name / "plan.json").certificate
        assert certificate is not None
        for limit in certificate.limits:
            sign, bound = limit_cells(limit)[3].split()
            worst, value = (
                float(text.replace("\u2212", "-")) for text in (limit_cells(limit)[2], bound)
            )
            slack = 1e-5 * max(1.0, abs(value))
            assert worst <= value + slack if sign == "≤" else worst >= value - slack, limit


@pytest.mark.slow
def test_command_writes_report_comparison_and_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        run(
            "report",
            PLAN.parent,
            "-o",
            tmp_path / "r.html",
            "--figures",
            tmp_path / "figures",
            "--json",
        )
        == 0
    )
    files = json.loads(capsys.readouterr().out)["files"]
    assert {Path(path).suffix for path in files.values()} == {".html", ".png", ".pdf"}
    assert all(Path(path).stat().st_size > 1000 for path in files.values())
    assert run("report", PLAN, PLAN, "-o", tmp_path / "c.html") == 0
    assert "Two plans" in (tmp_path / "c.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_figures_are_the_same_bytes_each_time(tmp_path: Path) -> None:
    from ssm_planner.reporting.figures.process import write_figures_of_file

    plan = load_plan(PLAN)
    first, second = (write_figures_of_file(plan, tmp_path / name) for name in ("a", "b"))
    assert {path.name for path in first.values()} == {
        "motion.png",
        "motion.pdf",
        "motors.png",
        "motors.pdf",
    }
    assert all(first[name].read_bytes() == second[name].read_bytes() for name in first)


def test_the_curves_of_a_page_are_those_of_all_instants() -> None:
    """The page interpolates at instants next to its grid.

    The result equals, to the last bit, the interpolation over all instants.
    """
    plan = load_plan(PLAN)
    t = time_grid(plan.motion.duration)
    channels = sample_channels(plan, t)
    for joint in plan.sizing.joints:
        i, load = JOINTS.index(joint.load.joint), joint.load
        for name, values in ((f"w{i}", load.speed()), (f"tau{i}", load.torque())):
            assert np.array_equal(channels[name], np.interp(t, load.t, values))


def test_the_table_of_the_motion_states_target_and_duration() -> None:
    """A motion with a required duration shows its target as well. A pause has only a duration."""
    motion = (Straight(depth=0.015, duration=0.1, name="insert"), Dwell(2.0, "dwell"))
    problem = replace(load_problem("tilt_insert"), motion=motion)
    rows = _motion_table(Plan(problem, "infeasible", None)).rows
    assert [row[2] for row in rows[1:]] == ["depth 15 mm, in 0.1 s", "2 s"]


def test_the_headline_names_the_joints_that_are_long_at_a_limit() -> None:
    """A joint that is only briefly at a limit is left out. Joints have their names."""
    plan = load_plan(PLAN)
    duration = plan.motion.duration

    def active(joint: int, share: float) -> dict[str, object]:
        return {"name": "acceleration", "joint": joint, "start": 0.0, "end": share * duration}

    panels: Any = [{"active": [active(3, 0.5), active(0, 1e-4)]}]
    assert _limiting_text(plan, panels) == "the acceleration of insertion"
    panels = [{"active": [active(3, 0.5), active(0, 0.4), active(1, 0.4)]}]
    assert _limiting_text(plan, panels) == "the acceleration of roll, tilt and insertion"

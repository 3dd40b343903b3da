"""A plan.json is read back as it was written, and files that are not plans are refused with a
message.
"""

from __future__ import annotations

import hashlib
import json
import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.cli import main
from ssm_planner.errors import ExportError, ProblemError, SsmPlannerError, TrajectoryError
from ssm_planner.loading import json_files
from ssm_planner.loading.json_files import read_json_in_parts
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan as plan_problem
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Span, Trajectory
from ssm_planner.verification.check import check
from tests.support.paths import ROOT
from tests.support.plans import smooth, write_plan


def test_a_plan_is_read_as_it_was_written(plan: Plan, robot: Robot) -> None:
    again = load_plan(plan.path)
    assert np.array_equal(again.trajectory.coefficients, plan.trajectory.coefficients)
    own = robot.ranges["tilt"]  # The robot's upper end is narrower.
    assert again.limits.ranges == {"tilt": (-2.42, own[1]), "depth": (0.0, 0.03)}
    assert again.certificate == check(plan.trajectory, robot, plan.limits, seal=True)
    assert again.sha256 == plan.sha256


def test_the_shipped_plan_is_read(robot: Robot) -> None:
    path = ROOT / "results/tilt_insert/plan.json"
    if not path.is_file():
        pytest.skip("results/tilt_insert/plan.json is not there: make it with ssm-planner plan")
    shipped = load_plan(path)
    assert shipped.certificate is not None
    assert shipped.certificate.passed
    assert [joint.name for joint in shipped.robot.joints] == [joint.name for joint in robot.joints]


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda text: text[: len(text) // 2], TrajectoryError, "truncated|not JSON"),
        (lambda text: "", TrajectoryError, "not JSON"),
        (lambda text: "time_s,q1_rad\n0,0\n", TrajectoryError, "not JSON"),
        (lambda text: "[1, 2]", TrajectoryError, "not a plan.json"),
        (lambda text: '{"format": "something else"}', TrajectoryError, "not a plan.json"),
        (
            lambda text: text.replace('"version": 1', '"version": 99'),
            TrajectoryError,
            "version 99; this program reads",
        ),
        (
            lambda text: text.replace('"breaks_s": [0.0', '"breaks_s": [NaN'),
            TrajectoryError,
            "contains NaN",
        ),
        (
            lambda text: text.replace('"breaks_s": [0.0', '"breaks_s": [1e999'),
            TrajectoryError,
            "finite numbers",
        ),
        (
            lambda text: text.replace('"breaks_s": [0.0', '"breaks_s": [50.0'),
            TrajectoryError,
            "breaks .* must increase",
        ),
        (
            lambda text: text.replace('"breaks_s"', '"breaks"'),
            TrajectoryError,
            "not the pieces of a trajectory",
        ),
        (
            lambda text: text.replace('"mass": 0.7227848', '"mass": "heavy"'),
            ProblemError,
            "robot.bodies\\[0\\].mass",
        ),
        (
            lambda text: text.replace('"depth": [0.0, 0.03]', '"depth": 0.03'),
            ProblemError,
            "problem.limits",
        ),
        (
            lambda text: text.replace('"depth": [0.0, 0.03]', '"deep": [0.0, 0.03]'),
            ProblemError,
            "problem.limits",
        ),
        (
            lambda text: text.replace('"tip_speed": null', '"tip_speed": -1.0'),
            ProblemError,
            "tip_speed",
        ),
        (
            lambda text: text.replace('"rates": {}', '"rates": {"tilt": 0.0}'),
            ProblemError,
            "problem.rates.tilt",
        ),
        (
            lambda text: text.replace('"rates": {}', '"rates": {"tip": 1.0}'),
            ProblemError,
            "problem.rates.tip",
        ),
        (
            lambda text: text.replace('"eye": null', '"eye": {"centre": [0, 0]}'),
            ProblemError,
            "problem.eye.centre",
        ),
        (lambda text: text.replace('"eye": null', '"eye": []'), ProblemError, "problem.eye"),
        (
            lambda text: text.replace('"margin"', '"margins"'),
            TrajectoryError,
            "not a line of a certificate",
        ),
        (lambda text: "[" * 100000, TrajectoryError, "nested too deeply|truncated"),
    ],
)
def test_files_that_are_no_plan(
    plan: Plan, tmp_path: Path, change, error: type[SsmPlannerError], message: str
) -> None:
    text = plan.path.read_text(encoding="utf-8")
    changed = change(text)
    assert changed != text
    path = tmp_path / "plan.json"
    path.write_text(changed, encoding="utf-8")
    with pytest.raises(error, match=message) as caught:
        load_plan(path)
    assert str(path) in str(caught.value)


def test_a_file_of_bytes_and_one_that_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(TrajectoryError, match="not a text file"):
        load_plan(path)
    with pytest.raises(TrajectoryError, match="no such file"):
        load_plan(tmp_path / "none.json")


def test_an_infeasible_plan_holds_no_trajectory(plan: Plan, tmp_path: Path) -> None:
    document = {**plan.to_dict(), "trajectory": None, "status": "infeasible"}
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(TrajectoryError, match=r"no trajectory \(status: infeasible\)"):
        load_plan(path)


def test_helpers_make_passing_plans(robot: Robot) -> None:
    assert check(smooth(robot), robot).passed


@pytest.mark.slow
def test_a_saved_folder_is_the_command_s_and_the_same_every_time(tmp_path: Path) -> None:
    problem = load_problem(ROOT / "problems/tilt_insert.yaml")
    saved = plan_problem(problem).save(tmp_path / "saved")
    assert (
        main(["plan", str(ROOT / "problems/tilt_insert.yaml"), "-o", str(tmp_path / "command")])
        == 0
    )
    names = {path.name for path in saved.values()}
    assert {"plan.json", "report.html", "trajectory.csv"} < names
    assert names | {"manifest.json"} == {path.name for path in (tmp_path / "command").iterdir()}
    for name in names:
        content = (tmp_path / "saved" / name).read_bytes()
        assert content == (tmp_path / "command" / name).read_bytes(), name


@pytest.mark.slow
def test_a_loaded_plan_is_the_plan(tmp_path: Path) -> None:
    result = plan_problem(load_problem(ROOT / "problems/tilt_insert.yaml")).cross_checked()
    result.save(tmp_path)
    loaded = load_plan(tmp_path)
    assert loaded.to_json() == result.to_json()
    assert (
        loaded.sha256
        == result.sha256
        == hashlib.sha256((tmp_path / "plan.json").read_bytes()).hexdigest()
    )
    assert (
        loaded.to_dict().keys()
        == json.loads((ROOT / "results/tilt_insert/plan.json").read_text("utf-8")).keys()
    )
    assert loaded.trajectory is not None
    assert loaded.trajectory.sample(0.001).q.shape == (1, 4)
    assert replace(loaded, status="changed").file is None


def test_a_plan_without_a_passed_certificate_is_not_saved(bad_plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="no passed certificate"):
        bad_plan.save(tmp_path / "out")
    assert not (tmp_path / "out").exists()


HOSTILE = (
    "",
    "{",
    "}",
    "[",
    "]",
    ",",
    ":",
    '"',
    "null",
    "1e999",
    "1e-3",
    "NaN",
    "9" * 30,
    "\ufeff",
    "\n\n",
    '"x"',
    "-",
)


@pytest.mark.parametrize("batch", [1, 300, 1_000_000])
def test_a_plan_read_in_parts_is_the_plan_and_what_is_none_is_refused(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, batch: int
) -> None:
    """The reader of very long plans and the usual reader agree on validity and on all numbers."""
    data = json.dumps(
        {key: plan.to_dict()[key] for key in ("format", "version", "trajectory")}, indent=1
    ).encode()
    path, rng = tmp_path / "plan.json", np.random.default_rng(batch)
    monkeypatch.setattr("ssm_planner.loading.json_files.BATCH_BYTES", batch)

    def read(in_parts: int) -> object:
        monkeypatch.setattr("ssm_planner.loading.json_files.PARTIAL_READ_BYTES", in_parts)
        try:
            document, sha256 = read_json_in_parts(
                path, 10**9, ("trajectory", "coefficients"), (6, 4)
            )
            return sha256, Trajectory.from_dict(document["trajectory"]).to_dict()
        except (TrajectoryError, KeyError, TypeError):
            return None  # The last two errors mean that the content is not a plan.

    refused = 0
    for case in range(200):
        first = int(rng.integers(0, len(data)))
        changed = data[:first] + str(rng.choice(HOSTILE)).encode() + data[first + case % 3 :]
        path.write_bytes(changed if case else data)
        complete = read(10**9)
        assert read(0) == complete, changed[first - 40 : first + 40]
        refused += complete is None
    assert 0 < refused < 199


def test_the_hash_belongs_to_the_content_that_was_read(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another program replaces the file between the reading of the content and of the hash."""
    path, new = tmp_path / "plan.json", tmp_path / "new.json"
    data = json.dumps(plan.to_dict()).encode()
    path.write_bytes(data)
    new.write_bytes(b"{}")
    parse = json_files._parse_in_parts

    def parse_and_replace(*arguments: Any) -> Any:
        """Parse the file, and put the other one in its position."""
        content = parse(*arguments)
        new.replace(path)
        return content

    monkeypatch.setattr(json_files, "PARTIAL_READ_BYTES", 0)
    monkeypatch.setattr(json_files, "_parse_in_parts", parse_and_replace)
    _, sha256 = read_json_in_parts(path, 10**9, ("trajectory", "coefficients"), (6, 4))
    assert path.read_bytes() == b"{}"
    assert sha256 == hashlib.sha256(data).hexdigest()


@pytest.mark.slow
def test_a_plan_of_many_pieces_needs_the_memory_of_its_numbers(
    tmp_path: Path, robot: Robot
) -> None:
    """A piece needs 192 bytes, and twice as much while pieces are joined.

    Python numbers would need 770 bytes for each piece.
    """

    def peak(count: int) -> int:
        breaks = np.linspace(0.0, 100.0, count + 1)
        trajectory = Trajectory(breaks, np.full((count, 6, 4), -1e-3), (Span("all", 0.0, 100.0),))
        path = write_plan(tmp_path / "plan.json", robot, trajectory)
        tracemalloc.start()
        try:
            load_plan(path)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ssm_planner.loading.json_files.PARTIAL_READ_BYTES", 0)
        patch.setattr("ssm_planner.loading.json_files.BATCH_BYTES", 2**14)
        for module in ("trajectory", "verification.certificate"):
            patch.setattr(f"ssm_planner.{module}.PIECES_PER_BLOCK", 1024)
        assert peak(12_000) - peak(4_000) < 8_000 * 600

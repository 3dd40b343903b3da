"""Plans that are built by hand have the sums, verdicts and notes that follow from their phases."""

from __future__ import annotations

import hashlib
import json
import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner import Opinion, plans
from ssm_planner.errors import ExportError, SsmPlannerError, TrajectoryError
from ssm_planner.formats.export import export
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.plans import PLAN_FORMAT, PLAN_VERSION, PhaseSummary, Plan, load_plan
from ssm_planner.problem.limits import TaskRange, TipSpeed
from ssm_planner.problem.motion import Free, Joints, Straight, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.publishing import MANIFEST, RESULT_FORMAT
from ssm_planner.reporting.text import summary_lines
from ssm_planner.trajectory import Span, Trajectory, quintic_coefficients
from ssm_planner.verification.check import check
from tests.support.paths import RESULTS as RESULTS_FOLDER

START = np.array([0.3, 1.15, 0.1, 0.0])
NEAR = START + np.array([0.02, -0.02, 0.01, 0.0])


def motion(first: np.ndarray = START, last: np.ndarray = NEAR, duration: float = 2.0) -> Trajectory:
    """Return a motion of one quintic from rest to rest.

    Positions are in rad and m, and the duration is in s.
    """
    zero = np.zeros((1, 4))
    piece = quintic_coefficients(
        np.diff(np.array([0.0, duration])), (first[None], zero, zero), (last[None], zero, zero)
    )
    return Trajectory(np.array([0.0, duration]), piece, (Span("all", 0.0, duration),))


def problem(robot: Robot, **changes: Any) -> Problem:
    """Return the problem of a free motion between two joint positions."""
    start, end = Joints(tuple(START.tolist())), Joints(tuple(NEAR.tolist()))
    return replace(Problem(robot, start, (Free(end),), name="by hand"), **changes)


def phase(**changes: Any) -> PhaseSummary:
    """Return a straight phase of 2 s with a lower bound of 1.6 s."""
    ends = (0.0, 0.0, 0.0, 0.0)
    return replace(PhaseSummary("out", 2.0, 2.0, 1.6, ends, ends, 1, 3), **changes)


@pytest.fixture(scope="module")
def plan(robot: Robot) -> Plan:
    """Return a plan with two phases of 1 s each and without a certificate."""
    half = phase(duration=1.0, toppra_duration=1.0, lower_bound=0.8)
    return Plan(problem(robot), "solved", motion(), (half, replace(half, name="back")))


def test_a_phase_faster_than_toppra_fails_the_plan(plan: Plan) -> None:
    changed = replace(plan, software={**plan.software, "toppra": "0"})
    for share, fails in ((2e-4, True), (0.5e-4, False), (-5e-4, False), (-0.1, False)):
        duration = 1.0 / (1 - share)
        phases = tuple(item.with_opinion(Opinion(duration)) for item in plan.phases)
        result = replace(changed, phases=phases)
        assert bool(result.disagreements) == fails
        assert replace(plan, phases=phases).disagreements == ()
        assert any("shorter" in note for note in result.notes) == (share < -0.01)
        assert result.cross_check is not None
        assert result.cross_check["duration"] == pytest.approx(2 * max(duration, 0.8))


def test_a_figure_below_the_lower_bound_is_an_error_of_toppra(plan: Plan) -> None:
    below = plan.phases[0].with_opinion(Opinion(0.79, 0.79))
    assert below.toppra_duration is None
    assert below.path_bound == 0.8
    assert "below the lower bound" in (below.not_judged or "")
    assert plan.phases[0].with_opinion(Opinion(not_judged="no reason")).not_judged == "no reason"
    for share in (1e-6, 9e-6):  # Toppra's duration has an error of GRID_TOLERANCE.
        assert plan.phases[0].with_opinion(Opinion(0.8 * (1 - share))).toppra_duration == 0.8
    assert plan.phases[0].with_opinion(Opinion(0.8 * (1 - 1.1e-5))).toppra_duration is None


def test_sums_over_phases_need_every_phase(plan: Plan) -> None:
    assert plan.duration == 2.0
    assert plan.toppra_duration == pytest.approx(2.0)
    assert plan.lower_bound == pytest.approx(1.6)
    assert plan.gap == pytest.approx((2.0 - 1.6) / 1.6)
    one_unknown = replace(plan, phases=(plan.phases[0], phase(toppra_duration=None)))
    assert one_unknown.toppra_duration is None
    for empty in (replace(plan, phases=()), replace(plan, trajectory=None)):
        assert empty.toppra_duration is None
        assert empty.lower_bound is None
        assert empty.gap is None
    assert replace(plan, trajectory=None).duration is None
    assert replace(plan, phases=(phase(lower_bound=0.0),)).gap is None


def test_the_confirmation_adds_iterations_and_takes_the_largest_difference(plan: Plan) -> None:
    assert plan.confirmation is None
    phases = tuple(
        phase(confirmation_iterations=iterations, confirmation_difference=difference)
        for iterations, difference in ((4, 1e-9), (7, -3e-8), (None, 2e-8), (5, None))
    )
    assert replace(plan, phases=phases).confirmation == (11, -3e-8)


def test_fields_of_some_phases_are_left_out_of_the_others() -> None:
    plain, rounded = phase(toppra_duration=None).to_dict(), phase(corner_reach=0.0).to_dict()
    assert "corner_reach" not in plain
    assert "constant_speed" not in plain
    assert plain["toppra_duration"] is None
    assert rounded["corner_reach"] == 0.0


def test_a_plan_without_a_trajectory_has_nothing_that_follows_from_it(plan: Plan) -> None:
    empty = replace(plan, trajectory=None, status="infeasible")
    assert empty.sizing is None
    assert empty.stops is None
    assert empty.requirements == ()
    assert not empty.passed
    assert empty.to_dict()["trajectory"] is None
    with pytest.raises(TrajectoryError, match=r"by hand: .* no trajectory .status: infeasible"):
        _ = empty.motion


def test_summary_and_document_state_the_numbers(plan: Plan) -> None:
    timed = replace(plan, solve_time=0.25, nominal_duration=1.9)
    summary, document = timed.summary(), timed.to_dict()
    assert "stopped" not in summary
    assert replace(plan, stopped=True).summary()["stopped"] is True
    assert summary["limits"] == []
    assert summary["reason"] is None
    assert summary["passed"] is False
    assert [entry["name"] for entry in summary["phases"]] == ["out", "back"]
    assert summary["solve_time"] == 0.25
    assert document["solve_time"] is None
    assert (document["format"], document["version"]) == (PLAN_FORMAT, PLAN_VERSION)
    assert document["nominal_duration"] == 1.9
    assert document["certificate"] is None
    assert document["stops"] is None
    assert document["phases"] == summary["phases"]
    assert timed.sizing is not None
    assert summary["sizing"] == timed.sizing.to_dict()
    tried = ({"kind": "free", "duration": 2.0},), ()
    assert replace(plan, candidates=tried).summary()["candidates"] == [[tried[0][0]], []]
    assert "candidates" not in summary
    assert [entry["joint"] for entry in summary["motors"]] == [
        joint.requirement.joint for joint in timed.sizing.joints
    ]


def test_a_written_plan_is_read_back(plan: Plan, robot: Robot, tmp_path: Path) -> None:
    limits = plan.limits
    certified = replace(
        plan, certificate=check(plan.motion, robot, limits, seal=True), stopped=True
    )
    assert certified.passed
    assert certified.uncertified_reason is None
    path = certified.write(tmp_path / "plan.json")
    again, in_folder = load_plan(path), load_plan(tmp_path)
    assert again.passed
    assert again.stopped
    document = json.loads(path.read_text(encoding="utf-8"))
    assert certified.stops is not None
    assert document["stops"] == json.loads(json.dumps(certified.stops.to_dict()))
    assert document["limits"] == document["certificate"]["limits"] != []
    assert document["status"] == again.status == "solved"
    assert not replace(again, stopped=False).stopped
    assert not Plan.from_json(plan.to_json().encode(), path).stopped
    assert again.phases == plan.phases
    assert again.to_json() == certified.to_json() == path.read_text(encoding="utf-8")
    assert again.sha256 == certified.sha256 == in_folder.sha256
    assert path.read_text(encoding="utf-8").startswith('{\n "format"')
    assert again.path == path
    assert certified.path == Path("results/by_hand/plan.json")
    assert again.software == certified.software
    moved = replace(again, trajectory=motion(duration=2.1))
    assert moved.certificate is None
    assert not moved.passed
    assert any(note.startswith("not certified: the trajectory") for note in moved.notes)
    assert Plan.from_json(path.read_bytes(), path).sha256 == certified.sha256


def test_a_plan_from_another_process_can_be_saved_there(
    plan: Plan, robot: Robot, tmp_path: Path
) -> None:
    """A new process can save a plan that it has only unpickled.

    Such a process has not imported the modules that write pages.
    """
    certified = replace(plan, certificate=check(plan.motion, robot, plan.limits, seal=True))
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        files = process.submit(Plan.save, certified, tmp_path).result()
    assert {"plan", "report", "trajectory"} <= set(files)
    assert all(file.is_file() for file in files.values())
    assert load_plan(tmp_path).sha256 == certified.cross_checked().sha256


def test_a_plan_whose_certificate_was_changed_has_a_summary(tmp_path: Path) -> None:
    """The cross-check remains if the certificate does not match the file and is left out."""
    document = json.loads((RESULTS_FOLDER / "tilt_insert/plan.json").read_text("utf-8"))
    document["certificate"]["limits"][0]["worst"] = 1e-9
    (tmp_path / "plan.json").write_text(json.dumps(document), "utf-8")
    changed = load_plan(tmp_path / "plan.json")
    assert changed.certificate is None
    lines = list(summary_lines(changed))
    assert any(line.startswith("cross-check") for line in lines)
    assert any("NOT CERTIFIED" in line for line in lines)


def test_a_plan_without_a_passed_certificate_is_not_saved(plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="by hand: the plan has no passed certificate"):
        plan.save(tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("version", PLAN_VERSION + 1, f"this program reads version {PLAN_VERSION}"),
        ("format", "another", "not a plan.json"),
        ("problem", None, "problem is missing or not a mapping"),
        ("trajectory", [1], "trajectory is missing or not a mapping"),
        ("nominal_duration", True, "nominal_duration = True: wrong type of value"),
        ("nominal_duration", "2", "nominal_duration = 2: wrong type of value"),
        ("phases", {"a": 1}, r"phases = .*wrong type of value .allowed: a list"),
        ("phases", [{"name": 3}], r"phases\[0\]"),
    ],
)
def test_documents_that_are_no_plan(
    plan: Plan, tmp_path: Path, key: str, value: object, message: str
) -> None:
    path = tmp_path / "plan.json"
    path.write_text(json.dumps({**plan.to_dict(), key: value}), encoding="utf-8")
    with pytest.raises(SsmPlannerError, match=message) as caught:
        load_plan(path)
    assert str(path) in str(caught.value)


def test_the_versions_of_the_software_are_known() -> None:
    assert plans._package_version("no such package") == "unknown"
    assert set(plans.software()) == {"ssm-planner", "casadi", "numpy", "scipy"}
    assert "unknown" not in plans.software().values()


def with_friction(robot: Robot, **changes: Any) -> Robot:
    """Return the robot with a changed friction of the drive of its first joint."""
    joint = robot.joints[0]
    assert joint.drive is not None
    assert joint.drive.friction is not None
    friction = replace(joint.drive.friction, **changes)
    joint = replace(joint, drive=replace(joint.drive, friction=friction))
    return replace(robot, joints=(joint, *robot.joints[1:]))


def test_friction_beyond_the_identified_speeds_is_noted(plan: Plan, robot: Robot) -> None:
    def notes(known: float | None) -> list[str]:
        changed = replace(plan, problem=problem(with_friction(robot, identified_speed=known)))
        return [note for note in changed.notes if "friction" in note and "joint roll" in note]

    peak = plan.requirements[0].peak_speed
    assert plan.requirements[0].joint == robot.joints[0].name == "roll"
    assert notes(1.01 * peak) == notes(peak) == []
    (beyond,) = notes(peak / 2)
    assert "extrapolated 2.0×" in beyond
    assert f"({peak / 2:.3g} rad/s, used up to {peak:.3g} rad/s)" in beyond
    (unknown,) = notes(None)
    assert "does not say up to which speed" in unknown


def test_missing_and_placeholder_motors_are_noted(plan: Plan, robot: Robot) -> None:
    joints = robot.joints
    without = replace(robot, joints=(replace(joints[0], motor=None), *joints[1:]))
    notes = replace(plan, problem=problem(without)).notes
    assert [note for note in notes if "no motor given" in note] == [
        "joint roll: no motor given, its torque is not limited"
    ]
    assert joints[0].motor is not None
    for placeholders, text in (
        (("encoder_counts",), None),
        (("max_torque", "resistance"), "has placeholder figures (max_torque, resistance)"),
    ):
        motor = replace(joints[0].motor, placeholders=placeholders)
        guessed = replace(robot, joints=(replace(joints[0], motor=motor), *joints[1:]))
        notes = replace(plan, problem=problem(guessed)).notes
        stated = [note for note in notes if note.startswith("joint roll: motor ")]
        assert stated == ([] if text is None else [f"joint roll: motor {motor.name} {text}"])


def test_phases_of_no_duration_and_a_stopped_search_are_noted(plan: Plan) -> None:
    assert not any("skipped" in note or "stopped" in note for note in plan.notes)
    short = tuple(phase(name=name, duration=0.0, toppra_duration=None) for name in "ab")
    notes = replace(plan, phases=(phase(), *short), stopped=True).notes
    assert "skipped because the robot is already at the end: a, b" in notes
    assert "the search was stopped: other joints may be faster" in notes


def test_ranges_wider_than_the_robot_s_are_noted(plan: Plan, robot: Robot) -> None:
    low, high = robot.ranges["tilt"]
    wider = problem(robot, limits=(TaskRange("tilt", low - 0.1, high),))
    (note,) = [n for n in replace(plan, problem=wider).notes if "asked for" in n]
    assert note.startswith("range of ")
    assert note.index(f"{math.degrees(low - 0.1):.4g}"[:4]) < note.index("the robot allows")
    assert not any("asked for" in n for n in plan.notes)


def test_a_start_a_whole_turn_away_is_noted(plan: Plan, robot: Robot) -> None:
    far = START + np.array([2 * math.pi, 0.0, 0.0, 0.0])
    turned = replace(plan, trajectory=motion(far, far + (NEAR - START)))
    open_start = problem(robot, start=Task(roll=0.1, tilt=-1.9, spin=0.0, depth=0.0))
    degrees = math.degrees(START[0])
    (note,) = [n for n in replace(turned, problem=open_start).notes if "starts at" in n]
    assert note.startswith(
        f"joint roll starts at {360 + degrees:.6g} deg, a whole turn from {degrees:.6g} deg"
    )
    assert not any("starts at" in n for n in turned.notes)  # Its start names the joints.
    for angle, noted in ((185.0, True), (-185.0, True), (179.0, False)):
        start = np.array([math.radians(angle), *START[1:]])
        beside = replace(plan, problem=open_start, trajectory=motion(start, start + 0.01))
        assert any("joint roll starts at" in n for n in beside.notes) is noted
    near = replace(plan, problem=open_start)
    assert not any("starts at" in n for n in near.notes)
    back = replace(near, trajectory=motion(START - [2 * math.pi, 0, 0, 0], NEAR))
    (note,) = [n for n in back.notes if "starts at" in n]
    assert f"{degrees - 360:.6g} deg, a whole turn from {degrees:.6g} deg" in note


def test_free_phases_by_the_longer_way_round_are_noted(plan: Plan, robot: Robot) -> None:
    turn = np.array([np.radians(190.0), 0.0, 0.0, 0.0])
    for sign, other in ((1, -170), (-1, 170)):
        moved = motion(START, START + sign * turn, duration=4.0)
        round_about = replace(plan, trajectory=moved, phases=(phase(duration=4.0),))
        (note,) = [n for n in round_about.notes if "turns by" in n]
        assert note == f"out: joint roll turns by {190 * sign} deg, not by {other} deg"
        both = problem(robot, motion=(Free(Joints(tuple(NEAR.tolist()))), Straight(tilt=-1.8)))
        assert any("turns by" in n for n in replace(round_about, problem=both).notes)
        straight = problem(robot, motion=(Straight(tilt=-1.8),))
        assert not any("turns by" in n for n in replace(round_about, problem=straight).notes)
    split = replace(plan, trajectory=motion(START, START + turn, duration=2.0))
    assert not any("turns by" in n for n in split.notes)  # Each phase turns by one half.


def test_phases_that_change_the_branch_are_noted(plan: Plan) -> None:
    mechanism = Mechanism.from_geometry(plan.robot.geometry)
    across = np.array([START[0], 2 * mechanism.delta - START[1], *START[2:]])
    assert abs(across[1] - START[1]) < math.pi
    over = motion(START, across, duration=2.0)
    branches = [n for n in replace(plan, trajectory=over, phases=(phase(),)).notes if "branch" in n]
    assert len(branches) == 1
    assert "out: goes from branch " in branches[0]
    before, after = (int(mechanism.branch_of(q)) for q in (START, across))
    assert before == -after
    assert f"branch {before:+d} of" in branches[0]
    assert branches[0].endswith(f"branch {after:+d}")
    assert not any("branch" in n for n in plan.notes)


def test_limits_unlike_those_of_another_robot_are_named(plan: Plan, robot: Robot) -> None:
    assert plan.limit_differences(robot) == ()
    joint = replace(robot.joints[1], velocity=2 * robot.joints[1].velocity, jerk=5.0)
    notes = plan.limit_differences(
        replace(robot, joints=(robot.joints[0], joint, *robot.joints[2:]))
    )
    assert len(notes) == 2
    velocity = next(note for note in notes if f"velocity of joint {robot.joints[1].name}" in note)
    own, other = velocity.split("; the robot given has ")
    assert f" to {robot.joints[1].velocity:.6g} " in own
    assert f" to {joint.velocity:.6g} " in other
    jerk = next(note for note in notes if "jerk" in note)
    assert ": none; the robot given has" in jerk
    (tool,) = plan.limit_differences(replace(robot, limits=(*robot.limits, TipSpeed(0.5))))
    assert "another limit: tip speed: none; the robot given has " in tool
    (tool,) = plan.limit_differences(replace(robot, limits=robot.limits[1:]))
    assert f"another limit: {robot.limits[0].name}: " in tool
    assert tool.endswith("; the robot given has none")


def test_a_motion_from_arrays_becomes_a_plan_that_keeps_its_certificate(
    robot: Robot, tmp_path: Path
) -> None:
    t = np.linspace(3.0, 5.0, 401)
    u = (t - 3.0) / 2
    blend = 10 * u**3 - 15 * u**4 + 6 * u**5
    q = np.array([0.0, 0.5, 0.0, 0.0]) + np.outer(blend, [0.1, 0.2, 0.0, -0.005])
    motion = Trajectory.from_samples(t, q)
    plan = Plan.from_trajectory(motion, robot)
    assert plan.passed
    assert plan.certificate == check(plan.motion, robot, plan.limits, seal=True)
    assert plan.motion.duration == pytest.approx(2.0)
    assert plan.problem.start.values == pytest.approx(q[0])
    assert plan.problem.motion[-1].to.values == pytest.approx(q[-1])
    assert [(span.name, span.start, span.end) for span in plan.motion.phases] == [
        ("free", 0.0, 2.0)
    ]
    np.testing.assert_allclose(plan.motion.sample(t - 3.0).q, motion.sample(t).q, atol=1e-12)
    plan.save(tmp_path / "saved")
    saved = load_plan(tmp_path / "saved")
    assert saved.passed
    content = (tmp_path / "saved/plan.json").read_bytes()
    assert saved.file_sha256 == hashlib.sha256(content).hexdigest()
    _, manifest = export(motion, "csv", tmp_path / "csv", robot=robot)
    assert manifest["verified"]
    with pytest.raises(TrajectoryError, match="pass robot"):
        export(motion, "csv", tmp_path / "none")


def test_a_motion_from_arrays_that_is_too_fast_does_not_pass(robot: Robot) -> None:
    t = np.linspace(0.0, 0.05, 51)
    q = np.array([0.0, 0.5, 0.0, 0.0]) + np.outer(1 - np.cos(np.pi * t / 0.05), [0.1, 0.2, 0, 0])
    plan = Plan.from_trajectory(Trajectory.from_samples(t, q), robot)
    assert not plan.passed
    with pytest.raises(ExportError, match="does not pass"):
        export(plan, "csv")


def test_a_certificate_without_its_trajectory_is_dropped(robot: Robot) -> None:
    certificate = check(motion(), robot, problem(robot).task_limits, seal=True)
    assert Plan(problem(robot), "solved", motion(), (), certificate).certificate is not None
    assert Plan(problem(robot), "infeasible", None, (), certificate).certificate is None


@pytest.mark.parametrize("duration", [None, 1.5, 2])
def test_the_duration_without_ranges_is_read_back(
    plan: Plan, tmp_path: Path, duration: float | None
) -> None:
    path = replace(plan, nominal_duration=duration).write(tmp_path / plans.PLAN_FILE)
    assert load_plan(path).nominal_duration == duration


def test_a_plan_in_a_folder_with_a_file_of_another_plan_is_refused(
    plan: Plan, tmp_path: Path
) -> None:
    path = plan.write(tmp_path / plans.PLAN_FILE)
    table = tmp_path / "trajectory.csv"
    table.write_text("t\n", encoding="utf-8")
    files = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in (path, table)}
    manifest = {"format": RESULT_FORMAT, "files": files}
    (tmp_path / MANIFEST).write_text(json.dumps(manifest), encoding="utf-8")
    assert load_plan(tmp_path).duration == plan.duration
    table.write_text("t\n0\n", encoding="utf-8")
    for name in (tmp_path, path):
        with pytest.raises(TrajectoryError, match=r"trajectory\.csv: is not the file"):
            load_plan(name)


def test_a_joint_without_a_drive_has_no_note_on_friction(plan: Plan, robot: Robot) -> None:
    changed = replace(robot, joints=(replace(robot.joints[0], drive=None), *robot.joints[1:]))
    assert plans._friction_notes(changed, plan.requirements[0]) == []


def test_a_plan_is_neither_true_nor_false(plan: Plan) -> None:
    with pytest.raises(TypeError, match=r"plan\.passed"):
        bool(plan)


def test_a_plan_is_taken_as_a_value_and_as_a_file(plan: Plan, tmp_path: Path) -> None:
    path = plan.write(tmp_path / plans.PLAN_FILE)
    assert plans.as_plan(plan) is plan
    for name in (path, str(path), tmp_path):
        assert plans.as_plan(name).sha256 == plan.sha256


def test_a_name_that_no_file_can_have_is_refused() -> None:
    with pytest.raises(TrajectoryError):
        load_plan("plan\0.json")


@pytest.mark.parametrize("block", [64, 640])
def test_a_plan_is_written_in_parts_and_only_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    """The text of a plan does not depend on the size of its blocks.

    The hash is computed without a second copy of the text.
    """
    plan = replace(load_plan(RESULTS_FOLDER / "tilt_insert"))
    text = plan.to_json()
    assert json.loads(text) == json.loads(json.dumps(plan.to_dict()))
    monkeypatch.setattr("ssm_planner.trajectory.PIECES_PER_BLOCK", block)
    again = replace(plan)
    assert len(list(again._text_parts())) > 5
    file = again.write(tmp_path / "plan.json")
    monkeypatch.setattr(Plan, "_text_parts", None)
    assert file.read_text(encoding="utf-8") == text
    assert again.sha256 == hashlib.sha256(text.encode()).hexdigest()

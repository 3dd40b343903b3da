"""The server of the local view answers the requests of its page and refuses all others.

Its answers are compared with the kinematics, with the planner and with `study`.
"""

from __future__ import annotations

import argparse
import base64
import http.client
import json
import math
import re
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.cli import pages
from ssm_planner.cli.shared import add_arguments
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import pose_from_task, task_from_joints
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan
from ssm_planner.plans import load_plan
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.serialization import to_plain
from ssm_planner.view.jobs import PlanningJob, PlanningOutcome
from ssm_planner.view.page import ViewedProblem
from ssm_planner.view.server import MAX_REQUEST_SIZE, ViewServer
from tests.support.paths import PROBLEMS, ROOT

APPROACH = PROBLEMS / "eye_approach.yaml"
PLAN = ROOT / "results/tilt_insert/plan.json"
ANGLES = {"alpha": 0.6, "beta": 1.8}
POSE = [0.2, -1.7, 0.3, 0.012]
MU = "joints.roll.drive.friction.mu"
RATIO = "joints.tilt.drive.geometry.ratio"


@pytest.fixture(scope="module")
def server(tilt_insert: Problem) -> Iterator[ViewServer]:
    with ViewServer(tilt_insert) as running:
        threading.Thread(
            target=running.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True
        ).start()
        yield running
        running.shutdown()


def send(
    server: ViewServer, method: str, path: str, body: Any = None, **headers: str | None
) -> tuple[int, str]:
    """Send a request and return the status and the text of the answer.

    Values in `headers` replace those that the page sends. None omits a header.
    """
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=20)
    text = body if isinstance(body, (str, bytes)) else json.dumps(body)
    sent = {
        "Content-Type": "application/json",
        "X-Token": server.token,
        "Host": f"127.0.0.1:{server.server_port}",
    }
    sent |= {key.replace("_", "-"): value for key, value in headers.items()}  # type: ignore[dict-item]
    try:
        connection.putrequest(method, path, skip_host=True)
        data = b"" if body is None else text.encode() if isinstance(text, str) else text
        sent.setdefault("Content-Length", str(len(data)))
        for key, value in sent.items():
            if value is not None:
                connection.putheader(key, value)
        connection.endheaders(data)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


def ask(server: ViewServer, path: str, body: Any) -> dict[str, Any]:
    status, text = send(server, "POST", path, body)
    assert status == 200, text
    result: dict[str, Any] = json.loads(text)
    return result


def own_motion(server: ViewServer, **more: Any) -> dict[str, Any]:
    """Return the request to plan the motion of the problem file, with further entries `more`."""
    own = server.jobs.requested_page({}).robot_mechanism
    return {"alpha": own.alpha, "beta": own.beta, "own": True, **more}


def test_listens_on_the_loopback_interface_only(server: ViewServer) -> None:
    assert server.server_address[0] == "127.0.0.1"


def test_page_holds_the_token_and_nothing_from_elsewhere(server: ViewServer) -> None:
    status, text = send(server, "GET", "/")
    assert status == 200
    assert server.token in text
    assert not re.search(r"""(?:src|href)=["']?(?:https?:)?//""", text)


@pytest.mark.parametrize(
    "host", ["example.org", "127.0.0.1", "127.0.0.1:1", "localhost.example.org", None]
)
def test_other_host_names_are_refused(server: ViewServer, host: str | None) -> None:
    for method, path in (("GET", "/"), ("POST", "/ik")):
        status, text = send(server, method, path, {}, Host=host)
        assert status in (400, 421)
        assert server.token not in text


def test_localhost_is_this_host(server: ViewServer) -> None:
    assert send(server, "GET", "/", Host=f"localhost:{server.server_port}")[0] == 200


@pytest.mark.parametrize("path", ["/workspace", "/ik", "/plan", "/progress"])
@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"X_Token": None}, 403),
        ({"X_Token": "guess"}, 403),
        ({"Origin": "http://example.org"}, 403),
        ({"Origin": "null"}, 403),
        ({"Content_Type": "text/plain"}, 415),
        ({"Content_Type": None}, 415),
        ({"Content_Length": None}, 411),
        ({"Content_Length": "-1"}, 411),
        ({"Content_Length": str(MAX_REQUEST_SIZE + 1)}, 413),
        ({"Content_Length": "9" * 40}, 413),
        ({"Transfer_Encoding": "chunked"}, 411),
    ],
)
def test_anything_but_the_pages_requests_is_refused(
    server: ViewServer, path: str, headers: dict[str, str | None], status: int
) -> None:
    assert send(server, "POST", path, {"own": True}, **headers)[0] == status


@pytest.mark.parametrize("body", ["", "{", "[]", "3", '{"alpha": NaN}', "[" * 2000, b"\xff\xfe"])
def test_a_body_that_is_no_json_object_is_refused(server: ViewServer, body: str | bytes) -> None:
    assert send(server, "POST", "/ik", body)[0] == 400


def test_other_paths_and_methods_are_refused(server: ViewServer) -> None:
    for path in (
        "/etc/passwd",
        "/../server.py",
        "/report/",
        "/report/none",
        "/workspace",
        "/?x",
        "/report/../",
    ):
        assert send(server, "GET", path)[0] == 404
    assert send(server, "POST", "/", {})[0] == 404
    for method in ("PUT", "DELETE", "OPTIONS", "HEAD"):
        assert send(server, method, "/")[0] == 501


@pytest.mark.parametrize(
    ("path", "request_", "key"),
    [
        ("/ik", {**ANGLES, "pose": [0, 0, 0]}, "pose"),
        ("/ik", {**ANGLES, "pose": [0, "0", 0, 0]}, "pose.tilt"),
        ("/ik", {**ANGLES, "pose": [0, -110, 0, 0]}, "pose.tilt"),
        ("/ik", {**ANGLES, "pose": [True, 0, 0, 0]}, "pose.roll"),
        ("/ik", {"alpha": 0.0, "beta": 1.0, "pose": POSE}, "alpha"),
        ("/ik", {"alpha": 1e400, "beta": 1.0, "pose": POSE}, "alpha"),
        ("/workspace", {**ANGLES}, "tilt_range"),
        ("/workspace", {**ANGLES, "tilt_range": [1, 0]}, "tilt_range"),
        (
            "/plan",
            {
                "alpha": 0.6,
                "beta": 0.4,
                "start": POSE,
                "motion": [{"pose": POSE}],
                "tilt_range": [-2, -1],
            },
            "beta",
        ),
        ("/plan", {**ANGLES, "own": True, "design": {"joints.spin.mass": 1.0}}, "design"),
        ("/plan", {**ANGLES, "own": True, "design": ["joints.roll.motor"]}, "design"),
        ("/plan", {**ANGLES, "own": True, "design": {"joints.roll.motor": "none"}}, "motor"),
        ("/plan", {**ANGLES, "own": True, "design": {MU: "0.1"}}, MU),
        ("/plan", {**ANGLES, "own": True, "design": {MU: 1e3}}, MU),
        ("/plan", {**ANGLES, "own": True, "payload": -0.1}, "payload"),
        ("/progress", {"job": "../x"}, "job"),
    ],
)
def test_bad_values_are_named(
    server: ViewServer, path: str, request_: dict[str, Any], key: str
) -> None:
    status, text = send(server, "POST", path, json.dumps(request_))
    assert status == 400
    assert key in json.loads(text)["error"]


def test_branches_reach_the_pose(server: ViewServer) -> None:
    mechanism, _ = server.jobs.requested_page({}).mechanism(ANGLES)
    assert (mechanism.alpha, mechanism.beta) == pytest.approx(tuple(ANGLES.values()), abs=1e-12)
    result = ask(server, "/ik", {**ANGLES, "pose": POSE})
    rotation, position = pose_from_task(mechanism, [POSE])
    assert result["reachable"]
    assert {branch["branch"] for branch in result["branches"]} == {1, -1}
    for branch in result["branches"]:
        reached = forward(mechanism, [branch["joints"]])
        assert np.allclose(reached[0], rotation, atol=1e-9)
        assert np.allclose(reached[1], position, atol=1e-9)
        assert np.allclose(branch["tip"], position[0], atol=1e-9)


def test_pose_outside_the_workspace_says_how_far(server: ViewServer) -> None:
    nearest = -(ANGLES["beta"] - ANGLES["alpha"])
    result = ask(server, "/ik", {**ANGLES, "pose": [0.0, nearest + 0.1, 0.0, 0.01]})
    assert not result["reachable"]
    assert result["error"] == pytest.approx(0.1)


def test_band_is_the_closed_form_tilt_range(server: ViewServer) -> None:
    result = ask(server, "/workspace", {**ANGLES, "tilt_range": [-2.0, -1.5]})
    low, high = -(ANGLES["alpha"] + ANGLES["beta"]), -(ANGLES["beta"] - ANGLES["alpha"])
    assert result["tilt_range"] == pytest.approx([low, high])
    assert result["margin"] == pytest.approx(min(-2.0 - low, high + 1.5))
    vertices = np.reshape(result["scene"]["bands"][0]["vertices"], (-1, 3))
    angles = np.arccos(
        vertices @ np.array(result["scene"]["axes"][0]) / np.linalg.norm(vertices, axis=1)
    )
    assert angles.min() == pytest.approx(-high, abs=1e-4)
    assert angles.max() == pytest.approx(-low, abs=1e-4)
    assert not result["own"]


def test_plan_runs_with_progress_and_gives_a_report(
    server: ViewServer, tilt_insert: Problem
) -> None:
    own = Mechanism.from_geometry(tilt_insert.robot.geometry)
    target = [0.0, math.radians(-100), 0.0, 0.005]
    start = [0.0, math.radians(-90), 0.0, 0.0]
    request = {
        "alpha": own.alpha,
        "beta": own.beta,
        "start": start,
        "motion": [{"pose": target}],
        "tilt_range": [-2.4, -1.45],
    }
    replaced = ask(server, "/plan", request)["job"]
    job = ask(server, "/plan", request)["job"]
    answer = ask(server, "/progress", {"job": replaced})
    assert answer["done"]
    assert answer["message"] == "cancelled, because a newer motion is planned"
    for _ in range(600):
        answer = ask(server, "/progress", {"job": job})
        if answer["done"]:
            break
        time.sleep(0.05)
    assert "check passed" in answer["message"]
    assert len(answer["steps"]) >= 3
    status, page = send(server, "GET", answer["plan"].replace("plan", "report", 1))
    assert status == 200
    data = json.loads(re.search(r'id="data">(.*?)</script>', page).group(1))  # type: ignore[union-attr]
    q = [np.frombuffer(base64.b64decode(data["channels"][f"q{i}"]), "<f8")[-1] for i in range(4)]
    assert task_from_joints(own, [q])[0] == pytest.approx(target, abs=1e-6)


def test_motion_outside_the_limits_is_explained(server: ViewServer, tilt_insert: Problem) -> None:
    own = Mechanism.from_geometry(tilt_insert.robot.geometry)
    request = {
        "alpha": own.alpha,
        "beta": own.beta,
        "start": [0.0, -1.6, 0.0, 0.0],
        "motion": [{"pose": [0.0, -2.2, 0.0, 0.0]}],
    }
    status, text = send(server, "POST", "/plan", {**request, "tilt_range": [-2.0, -1.5]})
    result = json.loads(text)
    assert status == 400
    assert result["key"].endswith("tilt")
    assert "motion[0]" in result["key"]
    assert "deg" in result["reason"]


def finished(server: ViewServer, job: str, seconds: float = 60.0) -> dict[str, Any]:
    for _ in range(int(seconds / 0.05)):
        answer = ask(server, "/progress", {"job": job})
        if answer["done"]:
            return answer
        time.sleep(0.05)
    raise AssertionError("never done")


@pytest.mark.slow
def test_a_plan_is_cancelled_at_once_and_the_next_one_works(
    server: ViewServer, tilt_insert: Problem
) -> None:
    job = ask(server, "/plan", own_motion(server))["job"]
    for _ in range(12_000):
        if ask(server, "/progress", {"job": job})["steps"]:
            break
        time.sleep(0.005)
    assert ask(server, "/cancel", {"job": job})["done"]
    assert ask(server, "/progress", {"job": job})["message"] == "cancelled"
    assert (
        "check passed"
        in finished(server, ask(server, "/plan", own_motion(server))["job"])["message"]
    )


def test_a_plan_that_ends_while_its_progress_is_told_is_told_whole_the_next_time(
    tmp_path: Path,
) -> None:
    class Steps(type(tmp_path)):  # type: ignore[misc]
        def read_text(self, *_: Any, **__: Any) -> str:
            job.outcome = PlanningOutcome("planned", load_plan(PLAN))
            return ""

    job = PlanningJob("identity", Steps(tmp_path / "steps"))
    assert job.to_dict() == {
        **dict.fromkeys(("desk", "plan", "relaxation")),
        "steps": [],
        "changes": [],
        "done": False,
        "message": "",
    }
    assert job.to_dict()["done"]
    assert job.to_dict()["plan"] == "/plan/identity"


def test_waypoints_and_dwells_are_planned_and_saved(
    server: ViewServer, tilt_insert: Problem, tmp_path: Path
) -> None:
    """The problem that is saved as YAML is the problem that is planned.

    The plan can be downloaded as plan.json.
    """
    own = Mechanism.from_geometry(tilt_insert.robot.geometry)
    request = {
        "alpha": own.alpha,
        "beta": own.beta,
        "start": [0.0, math.radians(-90), 0.0, 0.0],
        "motion": [
            {"pose": [0.0, math.radians(-100), 0.0, 0.0]},
            {"dwell": 0.2},
            {"pose": [0.0, -1.8, 0.0, 0.004]},
        ],
        "tilt_range": [math.radians(-139), math.radians(-81)],
    }
    path = tmp_path / "saved.yaml"
    status, text = send(server, "POST", "/yaml", request | {"relaxed": 1})
    assert status == 400
    assert "a changed limit cannot be saved" in text
    path.write_text(ask(server, "/yaml", request)["text"], encoding="utf-8")
    saved, result = load_problem(path), server.jobs.requested_page({}).requested_problem(request)
    assert saved.start == result.start
    assert [step.kind for step in saved.motion] == ["straight", "dwell", "straight"]
    ends = [
        [getattr(step, name) for name in ("roll", "tilt", "spin", "depth")]
        for step in (saved.motion[2], result.motion[2])
    ]
    assert ends[0] == pytest.approx(ends[1], abs=1e-12)
    assert saved.ranges["tilt"] == pytest.approx(result.ranges["tilt"], abs=1e-12)
    answer = finished(server, ask(server, "/plan", request)["job"])
    assert json.loads(send(server, "GET", answer["plan"])[1])["status"] == "solved"


def test_other_angles_are_planned_with_the_links_of_the_robot(
    server: ViewServer, tilt_insert: Problem, tmp_path: Path
) -> None:
    request = {
        "alpha": math.radians(38),
        "beta": math.radians(104),
        "start": [0.0, math.radians(-95), 0.0, 0.0],
        "motion": [{"pose": [0.0, math.radians(-100), 0.0, 0.004]}],
        "tilt_range": [math.radians(-130), math.radians(-81)],
    }
    result = server.jobs.requested_page({}).requested_problem(request)
    turned, original = result.robot, tilt_insert.robot
    mechanism = Mechanism.from_geometry(turned.geometry)
    assert (mechanism.alpha, mechanism.beta) == pytest.approx(
        (request["alpha"], request["beta"]), abs=1e-12
    )
    for joint, own in zip(turned.joints, original.joints, strict=True):
        assert joint == own
    assert turned.name == "vitreoretinal with α 38°, β 104°"
    for body, known in zip(turned.bodies, original.bodies, strict=True):
        assert replace(body, frame=known.frame) == known
    # The z axis of each body stays along the axis of its joint.
    for body, axis in zip(turned.bodies, turned.geometry.axes, strict=True):
        assert body.frame[:, 2] == pytest.approx(axis, abs=1e-12)
    drawn = server.jobs.requested_page({}).ik({**request, "pose": request["motion"][0]["pose"]})[
        "branches"
    ]
    answer = finished(server, ask(server, "/plan", request)["job"])
    assert "check passed" in answer["message"]
    planned = tmp_path / "plan.json"
    planned.write_text(send(server, "GET", answer["plan"])[1], encoding="utf-8")
    trajectory = load_plan(planned).motion
    end = trajectory.positions(trajectory.breaks[-1:])[0]
    assert min(np.abs(end - branch["joints"]).max() for branch in drawn) < 1e-8
    saved = tmp_path / "saved.yaml"
    saved.write_text(ask(server, "/yaml", request)["text"], encoding="utf-8")
    robot = load_problem(saved).robot
    assert robot.geometry.omega3 == pytest.approx(turned.geometry.omega3, abs=1e-12)
    assert robot.bodies[1].frame == pytest.approx(turned.bodies[1].frame, abs=1e-12)


def test_a_relaxation_can_be_planned(tmp_path: Path) -> None:
    file = tmp_path / "weak.yaml"
    text = (PROBLEMS / "tilt_insert.yaml").read_text(encoding="utf-8")
    text = text.replace("to: -135 deg", "to: -135 deg, duration: 0.5 s")
    file.write_text(text.replace("robots/vitreoretinal.yaml", "vitreoretinal"), encoding="utf-8")
    with ViewServer(load_problem(file)) as running:
        threading.Thread(
            target=running.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True
        ).start()
        request = own_motion(running)
        first = finished(running, ask(running, "/plan", request)["job"])
        assert first["plan"] is first["desk"] is None
        assert first["relaxation"]
        relaxed = ask(running, "/plan", {**request, "relaxed": True})
        answer = finished(running, relaxed["job"])
        assert "check passed" in answer["message"]
        assert answer["desk"]["names"] == ["B"]
        running.shutdown()


def test_a_larger_share_of_a_relaxation_moves_the_limit_farther(tmp_path: Path) -> None:
    """The server lists changes of a limit with which the motion can be planned.

    It plans the chosen change with the value of the limit that the list states.
    """
    file = tmp_path / "close.yaml"
    text = (PROBLEMS / "eye_approach.yaml").read_text(encoding="utf-8")
    text = text.replace("-17.66 mm", "-18.4 mm").replace(
        "robots/vitreoretinal.yaml", "vitreoretinal"
    )
    file.write_text(text, encoding="utf-8")
    with ViewServer(load_problem(file)) as running:
        threading.Thread(
            target=running.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True
        ).start()
        request = own_motion(running)
        first = finished(running, ask(running, "/plan", request)["job"])
        share, words = first["changes"][-1]
        assert share > 1
        assert "clearance from the retina" in words
        job = ask(running, "/plan", {**request, "relaxed": share})["job"]
        answer = finished(running, job)
        assert answer["changes"] == first["changes"]
        content = json.loads(send(running, "GET", answer["plan"])[1])
        assert f"{1e3 * content['problem']['eye']['clearance']:.6g} mm" in words
        running.shutdown()


def without_files(value: Any) -> Any:
    """Return a value as plain data without file names, and with None in place of its name."""

    def cleaned(tree: Any) -> Any:
        if isinstance(tree, dict):
            return {key: cleaned(item) for key, item in tree.items() if key != "file"}
        return [cleaned(item) for item in tree] if isinstance(tree, list) else tree

    return {**cleaned(to_plain(value)), "name": None}


def test_a_changed_part_gives_the_robot_of_the_same_study(server: ViewServer) -> None:
    """The page and `study` build the same robot from the same design."""
    from ssm_planner.loading.files import section_from_data
    from ssm_planner.studies.evaluation import candidate_problems
    from ssm_planner.studies.study_file import study_from

    design = {RATIO: 100.0, MU: 0.26, "joints.insertion.motor": "rig_motor"}
    vary = {
        RATIO: {"from": "100", "to": "140"},
        MU: {"from": "0.26", "to": "0.27"},
        f"{MU}_static": {"from": "0.3", "to": "0.4"},
        "joints.insertion.motor": {"choices": ["rig_motor"]},
    }
    study = study_from(
        section_from_data(
            {
                "robot": "vitreoretinal",
                "motions": ["tilt_insert"],
                "vary": vary,
                "minimise": ["duration"],
            }
        )
    )
    ((_, expected),) = candidate_problems(study, study.design([0.0] * 4))
    result = server.jobs.requested_page({}).requested_problem(own_motion(server, design=design))
    assert without_files(result.robot) == without_files(expected.robot)
    assert (
        result.robot.joints[1].drive
        != server.jobs.requested_page({})
        .requested_problem(own_motion(server))
        .robot.joints[1]
        .drive
    )


def test_a_real_figure_replaces_its_stand_in_and_no_other(server: ViewServer) -> None:
    page = server.jobs.requested_page({})

    def motors(figures: dict[str, str]) -> dict[str, Any]:
        problem = page.requested_problem(own_motion(server, design=figures))
        return {joint.name: joint.motor for joint in problem.robot.joints if joint.motor}

    assumed = motors({})
    real = motors({"joints.roll.motor.max_torque": "90 mN*m"})
    assert real["roll"].max_torque == pytest.approx(0.09)
    assert set(real["roll"].placeholders) == set(assumed["roll"].placeholders) - {"max_torque"}
    for name in ("tilt", "insertion"):
        assert real[name].placeholders == assumed[name].placeholders
    confirmed = motors(page.stand_ins)
    for name, motor in assumed.items():
        assert motor.placeholders
        assert confirmed[name].placeholders == ()
        assert confirmed[name].max_torque == motor.max_torque
    with pytest.raises(ProblemError, match=r"roll\.motor\.max_torque.*not a torque"):
        motors({"joints.roll.motor.max_torque": "90 mm"})
    with pytest.raises(ProblemError, match="no such part or figure"):
        motors({"joints.roll.motor.max_torque": 90})  # type: ignore[dict-item]


def test_a_changed_friction_is_assumed_if_the_original_one_was(
    server: ViewServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = server.jobs.requested_page({})
    friction = page.document["robot"]["joints"]["roll"]["drive"]["friction"]
    monkeypatch.setitem(friction, "mu", {"value": 0.13, "placeholder": True})

    def changed(mu: float) -> Any:
        robot = page.changed_robot(own_motion(server, design={MU: mu}))
        return robot["joints"]["roll"]["drive"]["friction"]

    assert changed(0.26)["mu"] == {"value": pytest.approx(0.26), "placeholder": True}
    assert changed(0.26)["mu_static"] == {"value": pytest.approx(0.3), "placeholder": False}
    drive = page.requested_problem(own_motion(server, design={MU: 0.26})).robot.joints[0].drive
    assert drive is not None
    assert "mu" in str(drive.placeholders)


def test_a_saved_design_plans_the_same_elsewhere(server: ViewServer, tmp_path: Path) -> None:
    design = {MU: 0.3, RATIO: 150.0, "joints.tilt.motor.max_speed": "15000 rpm"}
    request = own_motion(server, design=design, payload=0.05)
    answer = finished(server, ask(server, "/plan", request)["job"])
    saved = tmp_path / "elsewhere.yaml"
    saved.write_text(ask(server, "/yaml", request)["text"], encoding="utf-8")
    problem, result = load_problem(saved), server.jobs.requested_page({}).requested_problem(request)
    assert without_files(problem.robot) == without_files(result.robot)
    assert problem.robot.bodies[3].mass == pytest.approx(0.09964338 + 0.05, abs=1e-12)
    assert str(PROBLEMS) not in saved.read_text(encoding="utf-8")
    document = json.loads(send(server, "GET", answer["plan"])[1])
    assert plan(problem, relaxations=False).duration == pytest.approx(
        document["duration"], rel=1e-6
    )


def channel(desk: dict[str, Any], side: int, name: str) -> Any:
    return np.frombuffer(base64.b64decode(desk["channels"][side][name]), "<f8")


def test_a_pinned_plan_is_compared_with_the_present_one(server: ViewServer) -> None:
    """The pinned plan and the present one appear side by side, and more friction takes more torque.

    The pinned plan has the same duration as when it is shown alone.
    """
    pinned = own_motion(server)
    request = own_motion(server, design={MU: 0.3}, pinned=pinned)
    desk = finished(server, ask(server, "/plan", request)["job"])["desk"]
    assert desk["names"] == ["A", "B"]
    assert [row[0].strip() for row in desk["rows"]] == ["time", "check", "closest", "motors"]
    assert all(len(row) == 3 for row in desk["rows"])
    assert desk["ends"][0] < desk["ends"][1]
    torques = [np.abs(channel(desk, side, "tau0")).max() for side in (0, 1)]
    assert torques[0] < torques[1]
    titles = {panel["channel"]: panel["sides"] for panel in desk["panels"]}
    assert titles == {f"{kind}{i}": [0, 1] for kind in ("w", "tau", "margin") for i in (0, 1, 3)}
    alone = finished(server, ask(server, "/plan", pinned)["job"])["desk"]
    assert alone["names"] == ["B"]
    assert alone["ends"][0] == pytest.approx(desk["ends"][0])
    motor = server.jobs.requested_page({}).requested_problem(pinned).robot.joints[0].motor
    assert motor is not None
    use = np.maximum(
        np.abs(channel(alone, 0, "tau0")) / motor.max_torque,
        np.abs(channel(alone, 0, "w0")) / motor.max_speed,
    )
    assert np.allclose(channel(alone, 0, "margin0"), 1 - use)


def test_suggested_angles_reach_the_range(server: ViewServer) -> None:
    expected = [math.radians(-130), math.radians(-90)]
    result = ask(server, "/suggest", {"tilt_range": expected})
    reached = ask(
        server,
        "/workspace",
        {"alpha": result["alpha"], "beta": result["beta"], "tilt_range": expected},
    )
    assert reached["margin"] == pytest.approx(result["margin"], abs=1e-9)
    status, text = send(server, "POST", "/suggest", {"tilt_range": [-1.0, 1.0]})
    assert status == 400
    assert json.loads(text)["key"] == "tilt_range"


def test_a_motion_planned_here_keeps_every_limit_of_the_problem() -> None:
    problem = load_problem(APPROACH)
    own = ViewedProblem(problem).robot_mechanism
    result = ViewedProblem(problem).requested_problem(
        {
            "alpha": own.alpha,
            "beta": own.beta,
            "start": [0.0, -1.8, 0.0, 0.002],
            "motion": [{"pose": [0.0, -2.0, 0.0, 0.015]}],
            "tilt_range": list(problem.ranges["tilt"]),
        }
    )
    ours, theirs = (
        sorted(map(str, to_plain(item.task_limits)["limits"])) for item in (result, problem)
    )
    assert len(ours) == len(theirs)
    assert to_plain(result.eye) == to_plain(problem.eye)
    assert dict(result.rates) == dict(problem.rates)
    for name, ends in problem.ranges.items():
        assert result.ranges[name] == pytest.approx(ends)


def test_the_eye_is_drawn_where_the_problem_has_one(tilt_insert: Problem) -> None:
    request = {**ANGLES, "tilt_range": [-2.0, -1.5]}
    problem = load_problem(APPROACH)
    assert ViewedProblem(problem).workspace(request)["scene"]["eye"] == to_plain(problem.eye)
    assert ViewedProblem(tilt_insert).workspace(request)["scene"]["eye"] is None


def test_without_a_problem_there_is_a_mechanism_but_no_plan() -> None:
    with ViewServer(None) as alone:
        assert alone.jobs.requested_page({}).start()["can_plan"] is False
        assert alone.jobs.requested_page({}).ik({**ANGLES, "pose": POSE})["reachable"]
        with pytest.raises(ProblemError, match="problem file"):
            alone.jobs.start({"own": True})


@pytest.mark.slow
def test_port_in_use_is_bad_input(server: ViewServer) -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser, "view")
    with pytest.raises(ProblemError, match="cannot be used"):
        pages.run_view(parser.parse_args(["--no-browser", "--port", str(server.server_port)]))


def test_a_text_replaces_the_problem_and_names_its_faults(server: ViewServer) -> None:
    """An edited text gets a new page that has its values.

    The earlier page and a pinned motion keep their values. A faulty text is refused with the line
    of the fault.
    """
    text = ask(server, "/yaml", own_motion(server))["text"]
    slow = text.replace("ratio:\n            value: 120", "ratio:\n            value: 90")
    slow = slow.replace("velocity: 65 deg/s", "velocity: 40 deg/s")
    page = ask(server, "/edit", {"text": slow})["page"]
    assert page != "/"
    status, html = send(server, "GET", page)
    assert status == 200
    assert f'"{RATIO}":90' in html.replace(".0", "")
    edited, before = (server.jobs.requested_page({"of": item}) for item in (page, "/"))
    assert edited.requested_problem(own_motion(server)).robot.joints[0].velocity == pytest.approx(
        math.radians(40.0)
    )
    assert before.requested_problem(own_motion(server)).robot.joints[0].velocity == pytest.approx(
        math.radians(65.0)
    )
    request = own_motion(server, of=page, pinned=own_motion(server, of="/"))
    answer = finished(server, ask(server, "/plan", request)["job"])
    times = next(row for row in answer["desk"]["rows"] if row[0].strip() == "time")
    assert answer["desk"]["names"] == ["A", "B"]
    assert float(times[1].split()[0]) < float(times[2].split()[0]), "B is slower than A"
    line = 1 + text[: text.index("velocity:")].count("\n")
    for wrong, message in (
        (text.replace("velocity: 65 deg/s", "velocity: 65 deg", 1), f":{line}: robot.joints.roll"),
        ("start: [1", "line 2: not valid YAML"),
        ("- a", "a list"),
    ):
        status, answer_text = send(server, "POST", "/edit", {"text": wrong})
        assert status == 400
        assert message in json.loads(answer_text)["error"]
    status, answer_text = send(server, "POST", "/ik", {**ANGLES, "pose": POSE, "of": "/elsewhere"})
    assert status == 400
    assert "no such" in json.loads(answer_text)["error"]


def test_a_gear_of_a_catalogue_replaces_that_of_the_robot(server: ViewServer) -> None:
    study = server.jobs.requested_page({})
    (path,) = (part.path for part in study.variables if part.path == "joints.roll.drive.worm")
    design = {path: "worm m0.3 1:80"}
    drive = study.requested_problem(own_motion(server, design=design)).robot.joints[0].drive
    own = study.requested_problem(own_motion(server, design={path: ""})).robot.joints[0].drive
    assert drive is not None
    assert own is not None
    assert drive.ratio == pytest.approx(80.0)
    assert own.ratio == pytest.approx(120.0)
    assert own.friction == drive.friction

"""Studies are tested from their files to their pages.

Variations change the robot, and screens only reject candidates that cannot be planned. The results
do not depend on the number and kind of workers.
"""

from __future__ import annotations

import math
import os
import pickle
import random
import re
import shutil
import signal
import subprocess
import sys
from concurrent.futures import Executor, Future
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import ExportError, ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.loading.files import section_from_data
from ssm_planner.studies import run as driver
from ssm_planner.studies.evaluation import Evaluation, candidate_problems, evaluate_batch
from ssm_planner.studies.page import correlation_ratio, write_study_page
from ssm_planner.studies.run import STORE_FILE, StudyError, StudyResult
from ssm_planner.studies.run import study as run_study
from ssm_planner.studies.screens import Screens
from ssm_planner.studies.show import write_candidate
from ssm_planner.studies.store import Candidate, Store, pareto_front
from ssm_planner.studies.study import Search, Varied
from ssm_planner.studies.study_file import load_study, study_from
from ssm_planner.studies.workers import WorkerDied
from tests.studies.support import pids
from tests.support.once import made_once
from tests.support.paths import PROBLEMS, ROOT

CATALOGUE = PROBLEMS / "catalogues" / "motors_24v.csv"
GEOMETRY = {
    "geometry.alpha": {"from": "26 deg", "to": "40 deg"},
    "geometry.home_tilt": {"from": "-120 deg", "to": "-106 deg"},
}
FILE = {
    "robot": "vitreoretinal",
    "motions": ["tilt_insert"],
    "vary": GEOMETRY,
    "require": {"reach": ["-135 deg", "-85 deg"]},
    "minimise": ["duration", "peak_torque"],
    "search": {"points": 8, "seed": 3},
}


def study(**changes):
    return study_from(section_from_data({**FILE, **changes}))


@pytest.fixture(scope="session")
def table(tmp_path_factory):
    """Return the bytes of the table that one worker writes for `study()`."""
    make = partial(run_study, study(), workers=1)
    return (made_once(tmp_path_factory, "study", make) / "table.csv").read_bytes()


def test_bodies_follow_a_varied_geometry():
    """A varied geometry turns each body, so that its z axis stays along the joint axis."""
    of = study()
    design = {"geometry.alpha": "35 deg", "geometry.home_tilt": "-110 deg"}
    ((_, problem),) = candidate_problems(of, design)
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    assert np.isclose(mechanism.alpha, np.radians(35))
    assert np.isclose(mechanism.home_tilt, np.radians(-110))
    axes = (
        problem.robot.geometry.omega1,
        problem.robot.geometry.omega2,
        problem.robot.geometry.omega3,
    )
    for body, axis in zip(problem.robot.bodies, axes, strict=False):
        assert np.allclose(body.frame[:, 2], axis)


def test_designs_are_the_same_for_the_same_seed_and_fill_the_space():
    of = study()
    first, again, other = (
        list(of.designs()),
        list(of.designs()),
        list(replace(of, search=Search(seed=4)).designs()),
    )
    assert first == again != other[:8]
    alphas = sorted(float(design["geometry.alpha"].split()[0]) for design in first)
    assert all(
        26 + 14 * i / 8 <= alpha <= 26 + 14 * (i + 1) / 8 for i, alpha in enumerate(alphas)
    )  # A Sobol sequence has one point in each interval.
    grid = list(replace(of, search=Search("grid", 3)).designs())
    assert len(grid) == len({tuple(design.items()) for design in grid}) == 9


def test_the_weight_on_the_screen_is_that_of_the_robot_built():
    of = study()
    screens = Screens(of)
    designs = list(of.designs())
    family = screens._geometry_family(designs)
    q = family.joints(np.array([[0.0, -1.9, 0.0, 0.0], [0.1, -2.0, 0.2, 0.01]]), 1)
    loads = screens._weight_efforts(family, q)
    for i, design in enumerate(designs):
        ((_, problem),) = candidate_problems(of, design)
        assert np.allclose(
            loads[i], RigidBody.from_robot(problem.robot).gravity_load(q[i]), rtol=0, atol=1e-9
        )


def test_a_screen_drops_nothing_that_can_be_planned():
    """Every candidate that a screen rejects is also infeasible when it is evaluated.

    Candidates that the screen of the reach rejects are left out. The motors are weak, so that the
    static torque decides for some candidates.
    """
    weak = {
        "nominal_torque": "6 mN*m",
        "max_torque": "14.2 mN*m",
        "max_speed": "15000 rpm",
        "name": "weak",
        "source": "test",
    }
    of = study(
        vary={
            **GEOMETRY,
            "joints.tilt.motor": {
                "choices": [weak, {**weak, "name": "strong", "max_torque": "90 mN*m"}]
            },
        }
    )
    designs = list(of.designs())
    fallen = Screens(of).reject(designs)
    assert {item.stage for item in fallen if item is not None} >= {"reach"}
    for design, item in zip(designs, fallen, strict=True):
        if item is not None and item.stage != "reach":
            assert Evaluation(of)(0, design).state == "infeasible"


@pytest.mark.slow
def test_two_workers_give_the_same_table_as_one_and_as_a_killed_run(tmp_path, table):
    of = study()
    assert table.count(b"\n") == 9
    run_study(of, tmp_path / "two", workers=2)
    assert (tmp_path / "two" / "table.csv").read_bytes() == table
    # The driver kills itself after three stored results. Then the same call continues the study.
    code = (
        "import os, signal, sys\n"
        "from ssm_planner.studies import run\n"
        "class Store(run.Store):\n"
        "    stored = 0\n"
        "    def write_results(self, rows):\n"
        "        for row in rows:\n"
        "            super().write_results([row])\n"
        "            Store.stored += 1\n"
        "            if Store.stored == 3:\n"
        "                os.kill(os.getpid(), signal.SIGKILL)\n"
        "run.Store = Store\n"
        "run.study(sys.argv[2], sys.argv[1], workers=2)"
    )
    import yaml

    file = tmp_path / "study.yaml"
    file.write_text(yaml.safe_dump(FILE), encoding="utf-8")
    command = [sys.executable, "-c", code, tmp_path / "killed", file]
    assert subprocess.run(command, cwd=ROOT, check=False).returncode == -signal.SIGKILL
    with Store(tmp_path / "killed" / STORE_FILE) as store:
        states = [row.state for row in store.rows() if row.number >= 0]
    assert "waiting" in states
    assert set(states) > {"waiting"}
    result = run_study(load_study(file), tmp_path / "killed", workers=2)
    assert result.finished
    assert (tmp_path / "killed" / "table.csv").read_bytes() == table
    # All candidates are done, so another call changes nothing.
    run_study(load_study(file), tmp_path / "killed", workers=2)
    assert (tmp_path / "killed" / "table.csv").read_bytes() == table


@pytest.mark.slow
def test_killed_workers_change_nothing(tmp_path, table):
    from ssm_planner.studies.workers import Workers

    of = study()
    with Workers(2, attempts=100) as workers:

        def kill(done: int, count: int, states: object) -> None:
            if done % 3 == 0 and pids(workers):
                os.kill(random.choice(pids(workers)), signal.SIGKILL)

        run_study(of, tmp_path / "killed", executor=workers, progress=kill)
    assert (tmp_path / "killed" / "table.csv").read_bytes() == table


class Here(Executor):
    """An executor that evaluates at once and cancels every call after the first `lost` ones.

    An executor whose scheduler has died cancels calls in the same way.
    """

    def __init__(self, lost: float = math.inf) -> None:
        self.left, self.count = lost, 0

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        self.left -= 1
        self.count += 1
        if self.left < 0:
            future.cancel()
            future.set_running_or_notify_cancel()
        else:
            future.set_result(fn(*args, **kwargs))
        return future


@pytest.mark.slow
def test_a_lost_engine_is_named_and_nothing_is_done_twice(tmp_path):
    of = study()
    undisturbed = Here()
    run_study(of, tmp_path / "calm", executor=undisturbed)
    with pytest.raises(
        StudyError, match=r"the workers are lost .*the same command continues the study"
    ):
        run_study(of, tmp_path / "lost", executor=Here(3))
    rest = Here()
    run_study(of, tmp_path / "lost", executor=rest)
    assert rest.count == undisturbed.count - 3
    assert (tmp_path / "lost" / "table.csv").read_bytes() == (
        tmp_path / "calm" / "table.csv"
    ).read_bytes()


class Deadly(Here):
    """An executor that loses every batch with candidate 40, as if it had ended the workers.

    It records the sizes of the batches.
    """

    def __init__(self) -> None:
        super().__init__()
        self.sizes: list[int] = []

    def submit(self, fn, evaluation, batch):
        self.sizes.append(len(batch))
        if 40 not in [number for number, _ in batch]:
            return super().submit(fn, evaluation, batch)
        future = Future()
        future.set_exception(WorkerDied("ended its worker process 3 times"))
        return future


def test_a_batch_that_ends_its_workers_is_split_and_one_candidate_is_to_blame(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(
        Evaluation, "__call__", lambda self, number, design: Candidate(number, "done", design)
    )
    monkeypatch.setattr(driver, "BATCH_DURATION", 1e3)  # batches grow on any machine
    monkeypatch.setattr(driver, "QUEUED_BATCHES_FOR_EXECUTOR", 1)
    deadly = Deadly()
    result = run_study(study(search={"points": 64, "seed": 3}), tmp_path, executor=deadly)
    sent = [row.number for row in result.rows if row.stage != "reach"]
    assert [row.number for row in result.rows if row.state == "quarantined"] == [40]
    assert all(
        row.state == "done" for row in result.rows if row.number in sent and row.number != 40
    )
    assert max(deadly.sizes) > 4
    assert 40 in sent


def test_a_full_disk_stops_with_a_message_and_the_store_goes_on_when_there_is_room(
    tmp_path, monkeypatch
):
    """A limit on the pages of the database causes the error that SQLite reports on a full disk."""
    of = study(search={"points": 64, "seed": 3}, motions=["tilt_insert"])
    many = replace(of, vary=(*of.vary, Varied("pace", 1.0, 2.0, "x" * 4000)))  # one page per row
    plain = Store._open_database

    def small(store):
        plain(store)
        store._connection.execute("PRAGMA max_page_count = 24")

    monkeypatch.setattr(
        Evaluation,
        "__call__",
        lambda self, number, design: Candidate(number, "done", design, figures={}),
    )
    monkeypatch.setattr(Store, "_open_database", small)
    with pytest.raises(
        ExportError, match=r"study\.sqlite: cannot be written: database or disk is full"
    ):
        run_study(many, tmp_path, executor=Here())
    monkeypatch.setattr(Store, "_open_database", plain)
    with Store(tmp_path / "study.sqlite") as store:
        assert store._query("PRAGMA integrity_check") == [("ok",)]
    result = run_study(many, tmp_path, executor=Here())
    assert result.finished
    assert len(result.rows) == 64
    assert "waiting" not in result.states


@pytest.fixture
def small_disk(tmp_path):
    """Mount a file system of 1 MB and return its path."""
    place = tmp_path / "disk"
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(place)]
    if (
        shutil.which("mount") is None
        or subprocess.run(command, capture_output=True, check=False).returncode != 0
    ):
        pytest.skip("no file system of 1 MB can be mounted here: that takes root")
    yield place
    subprocess.run(["umount", place], check=True)


def test_a_file_system_without_room_leaves_a_whole_store(small_disk, monkeypatch):
    monkeypatch.setattr(
        Evaluation, "__call__", lambda self, number, design: Candidate(number, "done", design)
    )
    of = study(search={"points": 4096, "seed": 3})
    of = replace(of, motions={}, require=replace(of.require, reach=None))
    with pytest.raises(
        ExportError, match=r"study\.sqlite: cannot be written: database or disk is full"
    ):
        run_study(of, small_disk, executor=Here())
    with Store(small_disk / "study.sqlite") as store:
        assert store._query("PRAGMA integrity_check") == [("ok",)]
    subprocess.run(["mount", "-o", "remount,size=32m", small_disk], check=True)
    assert run_study(of, small_disk, executor=Here()).states == {"done": 4096}


@pytest.mark.slow
def test_dask_gives_the_same_table(tmp_path, table):
    distributed = pytest.importorskip("distributed")
    of = study()
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        run_study(of, tmp_path / "dask", executor=client.get_executor(retries=3))
    assert (tmp_path / "dask" / "table.csv").read_bytes() == table


def test_a_catalogue_of_motors_becomes_choices_with_their_rotors_in_the_drive():
    of = study(vary={"joints.roll.motor": {"catalogue": str(CATALOGUE)}})
    (variable,) = of.vary
    assert len(variable.contents) == 48
    base = {
        design: problem.robot.joints[0]
        for design in variable.contents
        for _, problem in candidate_problems(of, {"joints.roll.motor": design})
    }
    rotors = {
        name: joint.drive.input_inertia - joint.motor.rotor_inertia for name, joint in base.items()
    }
    assert (
        np.ptp(list(rotors.values())) < 1e-12
    )  # The rest of the drive does not depend on the motor.
    assert all(joint.motor.mass > 0.01 for joint in base.values())


@pytest.mark.parametrize("inertia", ["1 mm", "0.2", {"value": "1 mm"}, {}, [1]])
def test_a_motor_whose_rotor_is_no_inertia_falls_out_with_the_reason(inertia):
    motor = {
        "name": "m",
        "source": "s",
        "nominal_torque": "30 mN*m",
        "max_torque": "90 mN*m",
        "max_speed": "9000 rpm",
    }
    with pytest.raises(ProblemError, match="rotor_inertia"):  # noqa: PT012 either may raise
        of = study(vary={"joints.roll.motor": {"choices": [{**motor, "rotor_inertia": inertia}]}})
        list(candidate_problems(of, next(of.designs())))


def test_a_worm_of_a_catalogue_replaces_the_gear_and_keeps_the_rest(tmp_path):
    (tmp_path / "worms.csv").write_text(
        "name,geometry.ratio,geometry.worm_diameter [mm],geometry.wheel_diameter [mm],input_inertia,source\n"
        "P30-60,60,10,30,6.5e-7 kg*m^2,made up\nP30-120,120,10,30,6.5e-7 kg*m^2,made up\n",
        encoding="utf-8",
    )
    of = study(vary={"joints.tilt.drive.worm": {"catalogue": str(tmp_path / "worms.csv")}})
    ratios = {}
    for name in ("P30-60", "P30-120"):
        ((_, problem),) = candidate_problems(of, {"joints.tilt.drive.worm": name})
        ratios[name] = problem.robot.joints[1].drive.ratio
        assert (
            problem.robot.joints[1].drive.friction.mu == 0.13
            or problem.robot.joints[1].drive.friction.mu > 0
        )
    assert ratios == {"P30-60": 60, "P30-120": 120}


def test_a_study_over_fixed_bodies_says_so_and_one_of_parts_moves_their_mass():
    of = study()
    (note,) = of.notes
    assert "link 1" in note
    assert study(vary={"joints.insertion.drive.friction.mu": {"choices": [0.15, 0.17]}}).notes == []
    arc = {
        "shape": "arc",
        "radius": "218 mm",
        "width": "40 mm",
        "height": "20 mm",
        "density": "2700 kg/m^3",
    }
    parts = [
        {
            **body,
            "parts": [
                {
                    "shape": "box",
                    "mass": "0.3 kg",
                    "at": ["0 mm", "0 mm", "0.1 m"],
                    "size": ["9 mm"] * 3,
                }
            ],
        }
        for body in of.robot["bodies"]
    ]
    for body in parts:
        for key in ("mass", "com", "inertia", "products_of_inertia"):
            body.pop(key, None)
    parts[0]["parts"] = [arc]
    of = replace(of, robot={**of.robot, "bodies": parts})
    assert of.notes == []
    masses = []
    for alpha in ("28 deg", "35 deg"):
        ((_, problem),) = candidate_problems(
            of, {"geometry.alpha": alpha, "geometry.home_tilt": "-112 deg"}
        )
        masses.append(problem.robot.bodies[0].mass)
    assert masses[1] / masses[0] == pytest.approx(35 / 28)


def test_the_front_holds_what_nothing_beats():
    rng = np.random.default_rng(2)
    rows = [
        Candidate(i, "done", {}, figures={"a": float(x), "b": float(y)})
        for i, (x, y) in enumerate(rng.random((200, 2)))
    ]
    front = pareto_front(rows, ("a", "b"))
    for row in rows:
        better = [
            o for o in rows if o is not row and all(o.figures[k] <= row.figures[k] for k in "ab")
        ]
        assert (row in front) == (not better)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"vary": {}}, "varies nothing"),
        (
            {"vary": {"geometry.alfa.x": {"from": "1 deg", "to": "2 deg"}}},
            "does not contain this path",
        ),
        ({"vary": {"geometry.alpha": {"from": "1 deg", "to": "2 rad"}}}, "unit differs"),
        ({"vary": {"geometry.alpha": {"from": "3 deg", "to": "2 deg"}}}, "not above from"),
        ({"vary": {"geometry.alpha": {"form": "3 deg", "to": "2 deg"}}}, "not a variation"),
        ({"vary": {"joints.roll.motor": {"catalogue": "nowhere.csv"}}}, "does not exist"),
        ({"vary": {"joints.roll.motor": {"catalogue": "m" + "9" * 5000}}}, "does not exist"),
        (
            {"vary": {"joints.roll.motor": {"choices": ["m" + "9" * 5000]}}},
            "no such file|cannot be read",
        ),
        ({"minimise": ["cost"]}, "minimise"),
        ({"motions": ["nowhere.yaml"]}, r"motions\[0\] = nowhere.yaml: .*does not exist"),
        ({"require": {"motor_margin": "120 %"}}, "not a share"),
        ({"search": {"points": 0}}, "points"),
    ],
)
def test_bad_input_is_named(change, words):
    with pytest.raises(ProblemError, match=words):
        study(**change)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "tilt_insert",
            "tilt_inser",
            r"study\.yaml:2: motions\[0\] = tilt_inser: .*does not exist",
        ),
        ("tilt_insert", "x" * 5000, r"study\.yaml:2: motions\[0\]"),
        ("motors.csv", "none.csv", r"study\.yaml:4: .*none\.csv does not exist"),
        ("name,", "name," + "x" * 200_000 + ",", r"motors\.csv:1: invalid table: field larger"),
    ],
)
def test_a_file_that_cannot_be_used_is_named_with_its_line(tmp_path, old, new, message):
    vary = "vary:\n  joints.roll.motor: {catalogue: motors.csv}\nminimise: [duration]\nsearch: {points: 4}\n"
    files = {
        "study.yaml": f"robot: vitreoretinal\nmotions: [tilt_insert]\n{vary}",
        "motors.csv": CATALOGUE.read_text(encoding="utf-8"),
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ProblemError, match=message):
        load_study(tmp_path / "study.yaml")


@pytest.mark.slow
def test_the_page_shows_front_reasons_and_what_moves_the_objectives(tmp_path):
    of = study(minimise=["duration"])
    result = run_study(of, tmp_path, workers=2)
    text = (tmp_path / "study.html").read_text(encoding="utf-8")
    namespace = "http://www.w3.org/2000/svg"
    assert "http" not in text.replace("http-equiv", "").replace(namespace, "")
    assert all(f'<td class="number">{row.number}</td>' in text for row in result.front)
    assert (
        f"The study&#39;s own robot as it stands: duration 3.349 s; {len(result.better)} of the front beat"
        in text
    )
    assert result.own.state == "done"
    assert result.better
    assert all(row.figures["duration"] <= result.own.figures["duration"] for row in result.better)
    assert 'href="candidate_' not in text
    best = result.front[0].number
    write_candidate(of, tmp_path, best)
    linked = (tmp_path / "study.html").read_text(encoding="utf-8")
    (link,) = re.findall(r'href="(candidate_.*?)"', linked)
    assert link == f"candidate_{best}/tilt_insert/report.html"
    assert (tmp_path / link).is_file()
    line = f'<p>Play the motions of a candidate: <a href="{link}">candidate {best}, tilt insert</a>.</p>'
    unlinked = linked.replace(line, "").replace(f'"reports":["{link}"]', '"reports":[]')
    assert unlinked == text, "all else stays"


def test_explained_variance_is_that_of_a_known_law():
    rng = np.random.default_rng(4)
    x, y = rng.random((2, 20000))
    value = 3 * x + 4 * y  # variances 9/12 and 16/12
    assert correlation_ratio(x, value) == pytest.approx(9 / 25, abs=0.01)
    assert correlation_ratio(y, value) == pytest.approx(16 / 25, abs=0.01)
    assert correlation_ratio(rng.random(20000), value) < 0.002
    assert correlation_ratio(np.floor(3 * x), np.floor(3 * x)) == pytest.approx(1)


@pytest.mark.slow
def test_a_page_of_many_candidates_stays_small(tmp_path):
    of = study()
    rng = np.random.default_rng(1)
    designs = [of.design(place) for place in rng.random((20_000, 2))]
    values = rng.random((len(designs), 2))
    figures = [{"duration": a, "peak_torque": b} for a, b in values.tolist()]
    result = enumerate(zip(designs, figures, strict=True))
    rows = [Candidate(i, "done", design, figures=item) for i, (design, item) in result]
    write_study_page(of, (rows[0], *rows), tmp_path / "page.html", finished=True)
    assert (tmp_path / "page.html").stat().st_size < 4_000_000


PARTS = {
    "joints.roll.motor": {"catalogue": str(CATALOGUE), "select": "mass"},
    "joints.tilt.motor": {"catalogue": str(CATALOGUE), "select": "mass"},
}


def with_friction_of_its_motor(robot, index):
    """Return the robot with the friction k·I_0 of a motor added to the drive of joint `index`.

    A study adds this friction when it takes a motor from a catalogue, because the drive was
    identified with another motor.
    """
    joints = list(robot.joints)
    drive, motor = joints[index].drive, joints[index].motor
    b_c = drive.friction.b_c + motor.torque_constant * motor.no_load_current
    drive = replace(drive, friction=replace(drive.friction, b_c=b_c))
    joints[index] = replace(joints[index], drive=drive)
    return replace(robot, joints=tuple(joints))


@pytest.mark.slow
def test_selected_motors_are_the_lightest_that_hold_the_motion_with_the_margin():
    """No lighter motor of the catalogue has the required margin.

    The reference judges each motor separately with `size_motion` on the motion of the plan.
    """
    from ssm_planner.sizing.size import size_motion
    from ssm_planner.studies.evaluation import plan_candidate

    of = study(vary={**GEOMETRY, **PARTS}, require={"motor_margin": "20 %"})
    row = Evaluation(of)(0, {"geometry.alpha": "33 deg", "geometry.home_tilt": "-112 deg"})
    assert row.state == "done"
    assert row.figures["motor_margin"] >= 0.2
    result = plan_candidate(of, row)["tilt_insert"]
    assert result.passed
    assert result.duration == pytest.approx(
        row.figures["duration"], rel=1e-4
    )  # The limits of these motors are not active.
    for path in PARTS:
        variable = next(item for item in of.selected if item.path == path)
        joint = ("roll", "tilt").index(path.split(".")[1])
        chosen = result.problem.robot.joints[joint].motor
        for label in variable.contents:
            design = {**row.design, **{p: row.figures[p] for p in PARTS}, path: label}
            ((_, problem),) = candidate_problems(of, design)
            if problem.robot.joints[joint].motor.mass >= chosen.mass:
                continue
            robot = with_friction_of_its_motor(problem.robot, joint)
            verdict = size_motion(result.trajectory, robot).verdicts[joint]
            assert min(check.margin for check in verdict.checks if check.margin is not None) < 0.2


@pytest.mark.skipif(
    not Path("/proc/self/statm").exists(), reason="the system does not say what a process holds"
)
def test_a_worker_that_has_grown_forgets_its_programs(monkeypatch):
    from ssm_planner.planning.ocp.transcription import Transcription

    candidates = [(0, {"geometry.alpha": "33 deg", "geometry.home_tilt": "-112 deg"})]
    pickled = pickle.dumps(Evaluation(study()))
    # Plan with Ipopt instead of the fast planner, because the programs of Ipopt take the memory.
    monkeypatch.setattr("ssm_planner.studies.evaluation.with_fast_planner", lambda problem: problem)
    monkeypatch.setattr("ssm_planner.studies.evaluation.MEMORY_THRESHOLD", math.inf)
    ((cached,), *_) = evaluate_batch(pickled, candidates)
    assert Transcription.build.cache_info().currsize > 0
    monkeypatch.setattr("ssm_planner.studies.evaluation.MEMORY_THRESHOLD", 0)
    monkeypatch.setattr("ssm_planner.studies.evaluation.MEMORY_GROWTH_THRESHOLD", -math.inf)
    ((forgotten,), *_) = evaluate_batch(pickled, candidates)
    assert Transcription.build.cache_info().currsize == 0
    assert cached == forgotten


@pytest.mark.parametrize("rank", ["mass", "length"])
def test_the_selection_ranks_by_the_mass_and_length_in_the_catalogue(tmp_path, rank):
    """The selection takes the screw and the motor that come first by mass or length.

    The two screws, and the two motors, differ only in their stated mass and length.
    """
    light = "name,geometry.diameter [mm],geometry.lead [mm],mass [g],length [mm]\n"
    (tmp_path / "screws.csv").write_text(
        f"{light}heavy,4.8,1.4,90,80\nlight,4.8,1.4,20,30\n", encoding="utf-8"
    )
    motor = ["33 mN*m,99 mN*m,20000 rpm", "40 g,20 mm"]
    columns = "name,nominal_torque,max_torque,max_speed,mass,length,source\n"
    rows = [f"long,{motor[0]},41 g,30 mm,made up", f"short,{motor[0]},{motor[1]},made up"]
    (tmp_path / "motors.csv").write_text(columns + "\n".join(rows) + "\n", encoding="utf-8")
    parts = {"screw": tmp_path / "screws.csv", "motor": tmp_path / "motors.csv"}
    paths = {
        name: f"joints.insertion.{'drive.screw' if name == 'screw' else 'motor'}" for name in parts
    }
    of = study(
        vary={
            **GEOMETRY,
            **{
                paths[name]: {"catalogue": str(file), "select": rank}
                for name, file in parts.items()
            },
        }
    )
    row = Evaluation(of)(0, {"geometry.alpha": "33 deg", "geometry.home_tilt": "-112 deg"})
    assert row.state == "done", row.reason
    assert [row.figures[paths[name]] for name in ("screw", "motor")] == ["light", "short"]


def test_a_slower_pace_allows_lighter_motors_and_none_is_said():
    pace = {"pace": {"choices": [1, 2]}}
    of = study(vary={**GEOMETRY, **PARTS, **pace}, require={"motor_margin": "20 %"})
    design = {"geometry.alpha": "33 deg", "geometry.home_tilt": "-112 deg"}
    fast, slow = (Evaluation(of)(0, {**design, "pace": pace}) for pace in ("1", "2"))
    assert fast.state == slow.state == "done"
    assert slow.figures["motor_mass"] <= fast.figures["motor_mass"]
    assert (
        fast.figures["duration"] <= slow.figures["duration"] <= 2 * fast.figures["duration"] + 1e-9
    )
    none = Evaluation(replace(of, require=replace(of.require, motor_margin=0.9)))(
        0, {**design, "pace": "1"}
    )
    assert (none.state, none.stage) == ("infeasible", "selection")
    assert "none of 48 motors holds" in none.reason


def test_a_margin_required_of_the_motors_is_kept_by_the_motion():
    """A required margin of the motors is kept by a slower motion.

    The fastest motion without the margin uses the full torque of the motor.
    """
    motor = {
        "name": "m",
        "source": "s",
        "nominal_torque": "33 mN*m",
        "max_torque": "33 mN*m",
        "max_speed": "20000 rpm",
    }
    rows = []
    for margin in (0, 0.2):
        of = study(
            vary={**GEOMETRY, "joints.roll.motor": {"choices": [motor]}},
            require={"motor_margin": margin},
        )
        rows.append(
            Evaluation(of)(
                0,
                {
                    "geometry.alpha": "33 deg",
                    "geometry.home_tilt": "-112 deg",
                    "joints.roll.motor": "m",
                },
            )
        )
    assert [row.state for row in rows] == ["done", "done"]
    assert rows[1].figures["motor_margin"] >= 0.2
    assert rows[0].figures["duration"] <= rows[1].figures["duration"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"vary": PARTS}, "nothing is searched"),
        ({"vary": {**GEOMETRY, "pace": {"choices": [1, 2]}}}, "without a selected part"),
        ({"vary": {**GEOMETRY, **PARTS, "pace": {"choices": [0.5, 2]}}}, "invalid pace"),
        (
            {
                "vary": {
                    **GEOMETRY,
                    "joints.roll.motor": {"catalogue": str(CATALOGUE), "select": "price"},
                }
            },
            "unknown rank",
        ),
    ],
)
def test_a_selection_that_cannot_be_is_named(change, words):
    with pytest.raises(ProblemError, match=words):
        study(**change)


def test_nothing_beats_a_robot_of_unknown_mass():
    """No candidate counts as lighter than a robot whose motors have no stated mass."""
    own = Candidate(-1, "done", {}, figures={"duration": 3.0, "motor_mass": None})
    row = Candidate(0, "done", {}, figures={"duration": 2.0, "motor_mass": 0.1})
    result = StudyResult(study(minimise=["duration", "motor_mass"]), (row,), Path(), True, own)
    assert result.front == (row,)
    assert result.better == ()

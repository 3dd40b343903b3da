"""Plans, exports and reports that are changed by hand must never be presented as certified.

Changed export folders whose hashes match are compared with the motion that tests/support/oracle.py
plays.
"""

from __future__ import annotations

import copy
import json
import random
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from ssm_planner.formats.agreement import EXPLANATORY_KEYS, _without_explanations
from ssm_planner.publishing import file_hashes
from tests.support import oracle

from .rows import ROBOT, Count, Row, command

if TYPE_CHECKING:
    from ssm_planner.formats.points import Reading
    from ssm_planner.problem.robot import Robot
    from ssm_planner.trajectory import Trajectory

JUDGED = (
    ("trajectory", "breaks_s"),
    ("trajectory", "coefficients"),
    ("certificate",),
    ("problem", "robot"),
)
"""Parts of plan.json that the certificate covers in addition to the limits of the task."""
LIMITS = ("limits", "tip_speed", "rates", "eye", "start_rate", "end_rate")


def run(count: int, seed: int) -> list[Row]:
    """Run three kinds of cases with a third of the count each.

    The kinds are changed plans, changed export folders, and changed export folders with new hashes.
    """
    with tempfile.TemporaryDirectory() as name:
        return [
            _plans(Path(name), count // 3, random.Random(f"{seed} plans")),
            *_exports(Path(name), count // 3, seed),
            *resealed(Path(name) / "resealed", count // 3, seed),
        ]


def _plans(folder: Path, count: int, rng: random.Random) -> Row:
    from ssm_planner.loading.load import load_robot
    from tests.support.plans import of_task, trapezoids, write_plan

    robot = load_robot(ROBOT)
    limits = of_task({"tilt": (-2.4, -1.42), "depth": (-0.001, 0.03)}, tip_speed=0.5)
    text = write_plan(folder / "plan.json", robot, trapezoids(robot), limits).read_text(
        encoding="utf-8"
    )
    counted = Count("plans changed by hand")
    path = folder / "changed" / "plan.json"
    path.parent.mkdir()
    while counted.cases < count:
        document = json.loads(text)
        place = tampered(rng, document)
        if document == json.loads(text):
            continue
        path.write_text(json.dumps(document), encoding="utf-8")
        if _same(path, folder / "plan.json"):
            continue  # the changed value is weaker than a limit of the robot and has no effect
        counted.add(_shown(path, place, page=counted.cases % 20 == 0))
    return counted.row


def tampered(rng: random.Random, document: dict[str, Any]) -> str:
    """Change one value in the document that the certificate covers, and return its path."""
    ways = [*JUDGED, *(("problem", key) for key in LIMITS)]
    place: Any = document
    path = list(rng.choice(ways))
    if path == ["certificate"] and rng.random() < 0.2:
        certificate = place["certificate"]
        drop = rng.choice(("sha256", "limits"))
        certificate[drop] = (
            None if drop == "sha256" else rng.choice(([], certificate["limits"][1:]))
        )
        return f"certificate.{drop}"
    for key in path[:-1]:
        place = place[key]
    key: Any = path[-1]
    while isinstance(place[key], (dict, list)) and place[key]:
        place = place[key]
        key = rng.choice(
            [k for k in place if k not in ("file",)]
            if isinstance(place, dict)
            else range(len(place))
        )
        path.append(key)
    _change(rng, place, key)
    return ".".join(map(str, path))


def _change(rng: random.Random, place: Any, key: Any) -> None:
    value = place[key]
    if isinstance(value, bool) or value is None:
        place[key] = rng.choice((True, False, 0.1))
    elif isinstance(value, (int, float)):
        share = 10 ** rng.uniform(-6, 0) * rng.choice((-1, 1))
        place[key] = value * (1 + share) if value else share
    elif isinstance(value, str):
        place[key] = rng.choice((value + "x", "", value[:-1]))
    else:
        place[key] = rng.choice(({"tilt": [-3.0, -1.0]}, {"tilt": 0.1}, [1.0]))


def _same(path: Path, original: Path) -> bool:
    """Return whether two files describe the same plan."""
    from ssm_planner.errors import SsmPlannerError
    from ssm_planner.plans import load_plan

    try:
        plan, other = load_plan(path), load_plan(original)
    except SsmPlannerError:
        return False
    assert plan.trajectory is not None
    assert other.trajectory is not None
    moves = plan.trajectory.to_dict() == other.trajectory.to_dict()
    return moves and plan.problem == other.problem and plan.certificate == other.certificate


def _shown(path: Path, place: str, page: bool) -> str | None:
    """Return a description if a changed plan is still presented as certified, or None."""
    from ssm_planner.errors import SsmPlannerError
    from ssm_planner.formats.export import recheck_plan
    from ssm_planner.plans import load_plan
    from ssm_planner.reporting.html.report import report_page, verdict_marks
    from ssm_planner.reporting.text import answer_lines

    try:
        plan = load_plan(path)
    except SsmPlannerError:
        return None  # the file is no longer a plan
    if plan.passed or plan.summary()["passed"]:
        return f"{place}: the plan passes"
    if verdict_marks(plan)[1][1] != "Not certified":
        return f"{place}: the report says {verdict_marks(plan)[1]}"
    if any("PASSED" in line for line in answer_lines(plan)):
        return f"{place}: the summary says PASSED"
    try:
        if recheck_plan(plan, force=False)[1]:
            return f"{place}: it is exported as verified"
    except SsmPlannerError:
        pass
    if page and "Not certified" not in report_page(plan):
        return f"{place}: the page does not say that it is not certified"
    return None


FORMS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("csv", {}),
    ("ros2", {"rate": 10.0}),
    ("epos4", {"counts_per_turn": 4096, "rate": 100.0}),
    ("pvt", {}),
)
"""Formats that contain a motion, and the options of their exports."""
RESEALED: tuple[tuple[str, str, dict[str, Any]], ...] = (
    *((form, form, options) for form, options in FORMS),
    ("csv with stops", "csv", {"stops": 9}),
    ("epos4 with stops", "epos4", {"counts_per_turn": 4096, "rate": 100.0, "stops": 9}),
)
"""Exports that are changed together with their hashes: a name, the format and its options."""
UNREAD = {"file", "software", "speed", "warning"} | EXPLANATORY_KEYS
"""Entries that explain, or that name the origin of the motion. Only a signature covers them."""
ALLOWED = 1e-3 + 1e-5
"""Excess over a limit, relative to the limit, that is tolerated."""
SAME_MOTION = 1e-9
"""Largest difference at which two motions count as the same.

`plays_alike` applies it to positions in rad or m, and `compared` to the result of `farthest`.
"""


def resealed(folder: Path, count: int, seed: int, kinds: Counter[str] | None = None) -> list[Row]:
    """Change one entry of a manifest, an object or a table, and renew the hashes.

    Every change must be found or harmless. A change is harmless if no quantity differs that a
    client interprets. A different motion is harmless only if the independent oracle finds that it
    exceeds no limit and misses no target.
    """
    from ssm_planner.formats.export import export
    from ssm_planner.loading.load import load_robot
    from tests.support.plans import smooth, trapezoids, write_plan

    robot = load_robot(ROBOT)
    folder.mkdir()
    rows = []
    for name, form, options in RESEALED:
        # rows at a fixed rate do not show jumps
        motion = smooth(robot) if name == "csv" else trapezoids(robot)
        plan = write_plan(folder / "plan.json", robot, motion)
        if name == "csv":
            options = {"rate": 50.0, "columns": ["q", "qd", "qdd", "torque", "counts"]}
        rng = random.Random(f"{seed} {name} resealed")
        counted = Count(f"export folders changed with their hashes: {name}")
        export(plan, form, folder / name, **options)
        reference = judged(folder / name, robot)
        assert reference is not None
        assert plays_alike(played(folder / name, robot), reference.trajectory)
        for _ in range(count // len(RESEALED)):
            shutil.rmtree(folder / "changed", ignore_errors=True)
            shutil.copytree(folder / name, folder / "changed")
            where = change_folder(rng, folder / "changed")
            outcome = compared(folder / name, folder / "changed", robot, reference)
            if kinds is not None:
                kinds[f"{name}: {outcome}"] += 1
            counted.add(f"{where}: {outcome}" if outcome == "missed" else None)
        rows.append(counted.row)
    return rows


def judged(folder: Path, robot: Robot) -> Reading | None:
    """Return the motion of a folder, or None if the check does not accept it."""
    from ssm_planner.errors import SsmPlannerError
    from ssm_planner.formats.read import read_trajectory
    from ssm_planner.problem import TaskLimits

    try:
        reading = read_trajectory(folder, robot)
    except SsmPlannerError:
        return None
    limits = reading.add_declared_rates(TaskLimits(robot.limits))
    return None if reading.check(robot, limits).violations else reading


def compared(original: Path, folder: Path, robot: Robot, reference: Reading | None) -> str:
    """Return the outcome of a change.

    The change is found if the check refuses the folder. It is harmless if the folder is identical
    for every client, or if only a feed-forward offset differs within the tolerance of the motor
    law. It is also harmless if an independent simulation of the new motion keeps every limit and
    ends at the target. Any other change is missed.
    """
    assert reference is not None
    reading = judged(folder, robot)
    if reading is None:
        return "found"
    if farthest(reading.trajectory, reference.trajectory) > SAME_MOTION:
        return "harmless by simulation" if harmless(original, folder, robot) else "missed"
    before, after = (
        json.loads((place / "manifest.json").read_text(encoding="utf-8"))
        for place in (original, folder)
    )
    for document in (before, after):
        # The check has compared `plan` and `stretch` with the motion. A missing rate means zero.
        for key in ("files", "plan", "stretch"):
            document.pop(key, None)
        document |= {key: document.get(key, {}) for key in ("start_rate", "end_rate")}
    stops = [place / "stops.csv" for place in (original, folder)]
    if stops[0].exists() and reference.resolution is not None:
        # No client reads these summaries of a table that is played.
        for document in (before, after):
            for key in ("longest_s", "farthest_m"):
                document["stops"].pop(key, None)
    if _different(before, after):
        return "missed"
    if stops[0].exists() and stops[0].read_bytes() != stops[1].read_bytes():
        if reference.resolution is None:
            return "identical" if _close(*stops) else "missed"
        scales = [after["axes"][j.name].get("increments_per_unit", 1.0) for j in robot.joints]
        return (
            "stops harmless by simulation"
            if harmless_stops(*map(_stops, stops), np.array(scales), robot)
            else "missed"
        )
    for name in {file.name for file in folder.rglob("*.csv")}:
        texts = ((place / name).read_text(encoding="utf-8") for place in (original, folder))
        before[name], after[name] = map(_without_explanations, texts)
    return "offsets within their tolerance" if _different(before, after) else "identical"


def farthest(motion: Trajectory, reference: Trajectory) -> float:
    """Return the largest distance of two motions at equal times.

    The distance is in units of the tolerance of a target. A difference of the durations adds 1000
    per second.
    """
    end = min(motion.breaks[-1], reference.breaks[-1])
    t = np.union1d(motion.breaks, reference.breaks)
    t = np.append(t, np.linspace(t[0], end, 2000))
    a, b = (m.sample(t[t <= end], clamp=True).q for m in (motion, reference))
    late = abs(float(motion.breaks[-1] - reference.breaks[-1]))
    return float(np.abs((a - b) / oracle.TARGET).max()) + 1e3 * late


def harmless(original: Path, folder: Path, robot: Robot) -> bool:
    """Return whether the client of a changed folder keeps all limits and reaches the targets."""
    before, motion = (played(place, robot) for place in (original, folder))
    result = oracle.violations(motion, robot, ranges=dict(robot.ranges))
    target = oracle.at(before, np.array([-1]), np.ones(1), 0)
    start = np.linalg.norm((motion.powers[0, 0] - before.powers[0, 0]) / oracle.TARGET)
    return (
        max(result.values()) <= ALLOWED and start <= 1 and oracle.missed(motion, list(target)) <= 0
    )


def _close(*tables: Path) -> bool:
    """Return whether two tables have the same numbers within rounding."""
    first, second = (np.loadtxt(path, delimiter=",", skiprows=1) for path in tables)
    return first.shape == second.shape and np.allclose(first, second, rtol=1e-9, atol=1e-11)


def _stops(path: Path) -> list[np.ndarray]:
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    return np.split(rows, np.flatnonzero(np.diff(rows[:, 0])) + 1)


def harmless_stops(
    before: list[np.ndarray], after: list[np.ndarray], scales: np.ndarray, robot: Robot
) -> bool:
    """Return whether a controller that plays changed stops keeps its limits and ends at rest.

    The limits are those of position, speed and acceleration. The controller must begin at the
    current state of the motion and stay near the stops of the original.
    """
    if len(before) != len(after):
        return False
    for old, new in zip(before, after, strict=True):
        t, q = new[:, 1], new[:, 2:] / scales
        if t[0] != 0 or np.any(np.diff(t) < 0) or np.abs(old[0, :2] - new[0, :2]).max() > 0.01:
            return False
        keep = np.append(t[:-1] < t[-1] - 5e-4, True)
        t, q = t[keep], q[keep]
        h = np.diff(t)[:, None]
        rounding = np.where(scales == 1, 0.0, 0.5 / np.abs(scales)) + 1e-11
        speed = np.abs(np.diff(q, axis=0) / h) - 2 * rounding / h
        inside = [low <= x.min() and x.max() <= high for x, (low, high) in _ranges(q, robot)]
        over = speed.max(axis=0) > robot.velocities * (1 + ALLOWED)
        v = np.vstack([np.diff(q, axis=0) / h, np.zeros((1, 4))])
        length = np.append(h, 0.0)
        jumps = (
            np.abs(np.diff(v, axis=0))
            - 2
            * rounding
            * (1 / length[:-1] + np.where(length[1:] > 0, 1 / np.maximum(length[1:], 1e-9), 0.0))[
                :, None
            ]
        )
        allowed = robot.accelerations * ((length[:-1] + length[1:]) / 2)[:, None]
        rows = old[:, 2:] / scales
        off = np.abs(q[:, None] - rows[None]) / (10 * oracle.TARGET)
        if over.any() or not all(inside) or np.any(jumps > allowed * (1 + ALLOWED)):
            return False
        if off.max(axis=2).min(axis=1).max() > 1:
            return False
    return True


def _ranges(q: np.ndarray, robot: Robot) -> Iterator[tuple[np.ndarray, tuple[float, float]]]:
    return zip(q.T, (joint.position for joint in robot.joints), strict=True)


def plays_alike(motion: oracle.Played, reference: Trajectory) -> bool:
    """Return whether the independent player of a folder and its reader give the same motion."""
    dense = oracle.sampled(motion)
    q = reference.sample(dense.t.ravel(), clamp=True).q
    return bool(np.abs(q - dense.states[0].reshape(-1, 4)).max() < SAME_MOTION)


def played(folder: Path, robot: Robot) -> oracle.Played:
    """Return the motion that the client of an export folder plays.

    The function does not use the readers of the package.
    """
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    kind = manifest["kind"]
    if kind == "csv":
        header, *_ = (folder / "trajectory.csv").read_text(encoding="utf-8").splitlines()
        rows = np.loadtxt(folder / "trajectory.csv", delimiter=",", skiprows=1)
        names = header.split(",")
        tables = [
            rows[:, [k for k, name in enumerate(names) if re.match(rf"q{order}\d_", name)]]
            for order in ("", "d", "dd")
        ]
        return oracle.through(rows[:, 0], *(table for table in tables if table.size))
    if kind == "ros2":
        goal = yaml.safe_load((folder / "goal.yaml").read_text(encoding="utf-8"))
        points = next(goal[key] for key in ("trajectory", "goal") if key in goal)
        points = points.get("trajectory", points)["points"]
        stamps = [point["time_from_start"] for point in points]
        t = np.array([stamp["sec"] + stamp["nanosec"] / 1e9 for stamp in stamps])
        keys = ("positions", "velocities", "accelerations")
        tables = [np.array([point[key] or [np.nan] * 4 for point in points]) for key in keys]
        return oracle.through(t, *tables)
    columns = []
    for joint in robot.joints:
        table = np.loadtxt(folder / f"{joint.name}.csv", delimiter=",", skiprows=1)
        turn = manifest["axes"][joint.name].get("increments_per_motor_turn")
        ratio = 1.0 if joint.drive is None else joint.drive.ratio * turn / (2 * np.pi)
        columns.append(table[:, 1:3] / (ratio * joint.motor_direction))
    columns = [column if kind == "pvt" else column[:, :1] for column in columns]
    t = table[:, 0]
    state = np.stack(columns, axis=2).transpose(1, 0, 2)
    return oracle.through(np.cumsum(t) / 1000 if kind == "pvt" else t, *state)


def _different(before: Any, after: Any) -> bool:
    if isinstance(before, dict) and isinstance(after, dict):
        keys = (before.keys() | after.keys()) - UNREAD
        return any(_different(before.get(key), after.get(key)) for key in keys)
    if isinstance(before, float) and isinstance(after, (int, float)):
        return not np.isclose(before, after, rtol=1e-9, atol=1e-11)
    return bool(before != after)


def change_folder(rng: random.Random, folder: Path) -> str:
    """Change one entry of the manifest or one file, renew the hashes, and name the change."""
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text(encoding="utf-8"))
    names = sorted(manifest["files"])
    if rng.random() < 0.5:
        where = _change_entry(rng, manifest)
    else:
        where = rng.choice(names)
        _change_file(rng, folder, where, names)
    manifest["files"] = file_hashes(folder)
    path.write_text(json.dumps(manifest), encoding="utf-8")
    return where


def _change_entry(rng: random.Random, manifest: dict[str, Any]) -> str:
    """Change, remove or exchange an entry of the manifest, and return its path."""
    while True:
        place: Any = manifest
        keys: list[Any] = []
        while isinstance(place, (dict, list)) and place:
            parent = place
            key = rng.choice(list(place) if isinstance(place, dict) else range(len(place)))
            keys.append(key)
            place = place[key]
            if len(keys) > 1 and rng.random() < 0.1:
                break
        if keys[0] in ("files", "certificate") or UNREAD & set(keys):
            continue
        way = rng.random()
        other = rng.choice(list(parent) if isinstance(parent, dict) else range(len(parent)))
        if way < 0.15:
            del parent[key]
        elif way < 0.3 and other != key:
            parent[key], parent[other] = parent[other], parent[key]
        else:
            _change(rng, parent, key)
        return ".".join(map(str, keys))


def _change_file(rng: random.Random, folder: Path, name: str, names: list[str]) -> None:
    """Change a number or a bit, remove a line or the file, or exchange two files."""
    file = folder / name
    way = rng.random()
    if way < 0.05:
        file.unlink()
    elif way < 0.1:
        other = folder / rng.choice(names)
        data, theirs = file.read_bytes(), other.read_bytes()
        file.write_bytes(theirs)
        other.write_bytes(data)
    elif file.suffix == ".mcap":
        data = bytearray(file.read_bytes())
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        file.write_bytes(data)
    else:
        text = file.read_text(encoding="utf-8")
        lines = text.splitlines(keepends=True)
        if way < 0.2:
            del lines[rng.randrange(len(lines))]
            text = "".join(lines)
        else:
            numbers = list(re.finditer(r"-?\d+(\.\d+)?(e[+-]?\d+)?", text))
            match = rng.choice(numbers)
            text = text[: match.start()] + _other(rng, match.group()) + text[match.end() :]
        file.write_text(text, encoding="utf-8")


def _other(rng: random.Random, number: str) -> str:
    """Return another number of the same kind."""
    share = 10 ** rng.uniform(-6, 0.5) * rng.choice((-1, 1))
    if re.fullmatch(r"-?\d+", number):
        step = round(float(number) * share) or rng.choice((-1, 1))
        return str(int(number) + step)
    return repr(float(number) * (1 + share) or share)


def _exports(folder: Path, count: int, seed: int) -> list[Row]:
    from ssm_planner.formats.export import export
    from ssm_planner.loading.load import load_robot
    from tests.support.plans import trapezoids, write_plan

    robot = load_robot(ROBOT)
    plan = write_plan(folder / "plan.json", robot, trapezoids(robot))
    rows = []
    for form, options in FORMS:
        rng, counted = (
            random.Random(f"{seed} {form}"),
            Count(f"export folders changed by hand: {form}"),
        )
        _, manifest = export(plan, form, folder / form, **options)
        names = sorted(manifest["files"])
        healthy = command("check", str(folder / form), "--robot", str(ROBOT))
        if healthy[0] not in (0, 4):
            counted.add(f"the healthy folder does not pass: {healthy[2][-200:]}")
        for _ in range(count // len(FORMS)):
            file = folder / form / rng.choice(names)
            data = file.read_bytes()
            offset = rng.randrange(len(data))
            other = (
                copy.copy(data[:offset])
                + bytes([data[offset] ^ (1 << rng.randrange(8))])
                + data[offset + 1 :]
            )
            file.write_bytes(other)
            status, out, err, fault = command("check", str(folder / form), "--robot", str(ROBOT))
            file.write_bytes(data)
            passed = status in (0, 4) or "PASSED" in out
            named = file.name in err
            counted.add(
                fault
                or (
                    f"{file.name}: passes"
                    if passed
                    else None
                    if named
                    else f"not named: {err[-200:]}"
                )
            )
        rows.append(counted.row)
    return rows

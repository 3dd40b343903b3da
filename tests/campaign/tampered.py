"""Plans, exports and reports changed by hand: nowhere shown as certified."""

from __future__ import annotations

import copy
import json
import random
import tempfile
from pathlib import Path
from typing import Any

from .rows import ROBOT, Count, Row, command

JUDGED = (
    ("trajectory", "breaks_s"),
    ("trajectory", "coefficients"),
    ("certificate",),
    ("problem", "robot"),
)
"""Parts of plan.json that a certificate is of, beside the limits of the task."""
LIMITS = ("limits", "tip_speed", "rates", "eye", "start_rate", "end_rate")


def run(count: int, seed: int) -> list[Row]:
    """Half of the count are plans, shown and exported; half are export folders."""
    with tempfile.TemporaryDirectory() as name:
        return [
            _plans(Path(name), count // 2, random.Random(f"{seed} plans")),
            *_exports(Path(name), count // 2, seed),
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
            continue  # what the robot itself allows less of is no change
        counted.add(_shown(path, place, page=counted.cases % 20 == 0))
    return counted.row


def tampered(rng: random.Random, document: dict[str, Any]) -> str:
    """Change one value that the certificate is of, in place; where it was."""
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
    """A plan that is the other one, however it is written."""
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
    """Where a changed plan is still shown as certified."""
    from ssm_planner.errors import SsmPlannerError
    from ssm_planner.formats.export import verified
    from ssm_planner.plans import load_plan
    from ssm_planner.reporting.html.report import report_page, verdict
    from ssm_planner.reporting.text import answers

    try:
        plan = load_plan(path)
    except SsmPlannerError:
        return None  # not a plan any more
    if plan.passed or plan.summary()["passed"]:
        return f"{place}: the plan passes"
    if verdict(plan)[1][1] != "Not certified":
        return f"{place}: the report says {verdict(plan)[1]}"
    if any("PASSED" in line for line in answers(plan)):
        return f"{place}: the summary says PASSED"
    try:
        if verified(plan, force=False)[1]:
            return f"{place}: it is exported as verified"
    except SsmPlannerError:
        pass
    if page and "Not certified" not in report_page(plan):
        return f"{place}: the page does not say that it is not certified"
    return None


def _exports(folder: Path, count: int, seed: int) -> list[Row]:
    from ssm_planner.formats.export import export
    from ssm_planner.loading.load import load_robot
    from tests.support.plans import trapezoids, write_plan

    robot = load_robot(ROBOT)
    plan = write_plan(folder / "plan.json", robot, trapezoids(robot))
    rows = []
    forms: tuple[tuple[str, dict[str, Any]], ...] = (
        ("csv", {}),
        ("ros2", {"rate": 10.0}),
        ("epos4", {"counts_per_turn": 4096, "rate": 20.0}),
        ("pvt", {}),
    )
    for form, options in forms:
        rng, counted = (
            random.Random(f"{seed} {form}"),
            Count(f"export folders changed by hand: {form}"),
        )
        _, manifest = export(plan, form, folder / form, **options)
        names = sorted(manifest["files"])
        healthy = command("check", str(folder / form), "--robot", str(ROBOT))
        if healthy[0] not in (0, 4):
            counted.add(f"the healthy folder does not pass: {healthy[2][-200:]}")
        for _ in range(count // len(forms)):
            file = folder / form / rng.choice(names)
            data = file.read_bytes()
            at = rng.randrange(len(data))
            other = (
                copy.copy(data[:at]) + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]
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

"""Problem files: the keys of motions, objective, durations and rates have the stated meaning. Each
mistake leads to one message that names the file, the line and the key.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from ssm_planner.cli import main
from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import json_schema
from ssm_planner.planning.planner import plan_motion

NAME = "tilt_insert.yaml"
TILT = (
    "  - tilt:   {to: -135 deg}     # straight in task space; the other coordinates do not change"
)
OBJECTIVE = "objective: time"
LIMIT = "  tilt: [-139 deg, -81 deg]"
START = "start: {roll: 0 deg, tilt: -85 deg, spin: 0 deg, depth: 0 mm}"
SCAN = "laser_scan.yaml"
AT = "      at: {roll: 0 deg, tilt: -115.3 deg}  # the tool points at the macula"
RING = "      pattern: ring"
DIAMETER = "      diameter: 2 mm"
D = math.radians


@pytest.fixture(autouse=True)
def without_eye(files: Any) -> None:
    """Remove the eye from the problem before each test."""
    files.without_eye(NAME)


def test_points_on_the_way(files: Any) -> None:
    motion = """
  - free:
      to: {tilt: -135 deg}
      through:
        - {tilt: -100 deg, depth: 5 mm}
        - {joints: [0 deg, 10 deg, 20 deg, -5 mm]}
        - {tip: [1 mm, 2 mm, -10 mm], spin: 5 deg}"""
    files.edit(NAME, TILT, motion)
    free, insert = files.load(NAME).motion
    assert (free.kind, insert.kind) == ("free", "straight")
    first, second, third = free.through
    assert first.set_coordinates == pytest.approx({"tilt": D(-100), "depth": 0.005})
    assert second.values == pytest.approx((0, D(10), D(20), -0.005))
    assert (third.position, third.spin) == (
        pytest.approx((0.001, 0.002, -0.01)),
        pytest.approx(D(5)),
    )
    lines = (files.root / NAME).read_text(encoding="utf-8").splitlines()
    assert "{tilt: -100 deg" in lines[first.line - 1]
    assert free.to.set_coordinates == pytest.approx({"tilt": D(-135)})


def test_corners_on_the_way_are_motions_of_their_own(files: Any) -> None:
    motion = """
  - straight:
      through: [{roll: 5 deg}, {tilt: -100 deg, depth: 5 mm}]
      to: {tilt: -110 deg}
      blend: 0.3 mm
  - line: {to: {tip: [2 mm, 0 mm, -12 mm], spin: 0 deg}, duration: 2 s}"""
    files.edit(NAME, TILT, motion)
    first, second, third, line, _ = files.load(NAME).motion
    assert [item.to.set_coordinates for item in (first, second, third)] == [
        pytest.approx({"roll": D(5)}), pytest.approx({"tilt": D(-100), "depth": 0.005}), pytest.approx({"tilt": D(-110)})
    ]  # fmt: skip
    assert [item.blend for item in (first, second, third, line)] == [
        pytest.approx(3e-4),
        pytest.approx(3e-4),
        None,
        None,
    ]
    lines = (files.root / NAME).read_text(encoding="utf-8").splitlines()
    assert "through: [{roll" in lines[first.to.line - 1]
    assert line.duration == 2


@pytest.mark.parametrize("entry", ["tilt: {to: -135 deg, duration: 2 s}", "insert: {to: 5 mm, duration: 2000 ms}",
                                   "straight: {to: {roll: 5 deg}, duration: 2 s}", "free: {to: {roll: 5 deg}, duration: 2 s}",
                                   "roll: {to: 5 deg, duration: 2 s}", "spin: {to: 5 deg, duration: 2 s}"])  # fmt: skip
def test_a_duration_of_a_motion(files: Any, entry: str) -> None:
    files.edit(NAME, TILT, f"  - {entry}")
    assert files.load(NAME).motion[0].duration == pytest.approx(2)


@pytest.mark.parametrize(
    ("text", "objective", "duration"),
    [
        ("", "time then heat", None),
        ("objective: time then heat", "time then heat", None),
        ("objective: effort\nduration: 5 s", "effort", 5),
        ("duration: 5 s", "time then heat", 5),
    ],
)
def test_the_objective_is_read(
    files: Any, text: str, objective: str, duration: float | None
) -> None:
    files.edit(NAME, OBJECTIVE, text)
    problem = files.load(NAME)
    assert (problem.objective, problem.duration) == (objective, duration)


def test_effort_may_have_a_duration_for_every_motion(files: Any) -> None:
    files.edit(NAME, OBJECTIVE, "objective: effort")
    files.edit(NAME, TILT, "  - tilt: {to: -135 deg, duration: 2 s}\n  - dwell: 1 s")
    files.edit(NAME, "insert: {to: 20 mm}", "insert: {to: 20 mm, duration: 3 s}")
    assert [motion.duration for motion in files.load(NAME).motion] == [2, 1, 3]


def test_rates_at_the_two_ends(files: Any) -> None:
    files.edit(
        NAME, OBJECTIVE, "start_rate: {tilt: -10 deg/s, roll: 0 deg/s}\nend_rate: {depth: 5 mm/s}"
    )
    problem = files.load(NAME)
    assert problem.start_rate == pytest.approx({"tilt": D(-10)})
    assert problem.end_rate == pytest.approx({"depth": 0.005})


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("pattern: ring\n      diameter: 2 mm", ("ring", (0.002,), 0, 0)),
        ("pattern: triple ring", ("triple ring", (0.001, 0.002, 0.003), 0, 0)),
        (
            "pattern: triple ring\n      diameters: (1, 2, 4) mm",
            ("triple ring", (0.001, 0.002, 0.004), 0, 0),
        ),
        ("pattern: raster\n      rows: 3\n      columns: 4", ("raster", (), 3, 4)),
    ],
)
def test_every_pattern_of_a_scan(files: Any, pattern: str, expected: tuple[Any, ...]) -> None:
    files.edit(SCAN, DIAMETER + "\n", "")
    files.edit(SCAN, RING, f"      {pattern}")
    motion = files.load(SCAN).motion[0]
    scan = motion
    assert (motion.kind, motion.name, scan.rows, scan.columns) == (
        "scan",
        expected[0],
        *expected[2:],
    )
    assert scan.diameters == pytest.approx(expected[1])
    assert (scan.spacing, scan.distance, scan.dwell) == pytest.approx((0.001, 0.0015, 0.05))
    assert motion.at.set_coordinates == pytest.approx({"roll": 0, "tilt": D(-115.3)})


def test_a_scan_without_dwell_and_spacing_has_defaults(files: Any) -> None:
    files.edit(SCAN, "      spacing: 1 mm ", "      # ")
    files.edit(SCAN, "      dwell: 0.05 s ", "      # ")
    scan = files.load(SCAN).motion[0]
    assert (scan.spacing, scan.dwell, scan.order) == (0.6e-3, 0.0, "given")
    files.edit(SCAN, RING, RING + "\n      order: fastest")
    assert files.load(SCAN).motion[0].order == "fastest"


MISTAKES: list[tuple[str, str, tuple[str, ...]]] = [
    # motions
    (TILT, "  - tilt: {to: .nan deg}", ("motion[0].tilt.to = .nan deg", "an angle")),
    (TILT, "  - tilt: {to: nan deg}", ("motion[0].tilt.to = nan deg", "an angle")),
    (TILT, "  - insert: {to: .inf mm}", ("motion[0].insert.to = .inf mm", "a length")),
    (TILT, "  - tilt: {to: -110 rad}", ("motion[0].tilt.to = -110 rad", "did you mean deg?")),
    (TILT, "  - insert: {to: 20 km}", ("motion[0].insert.to = 20 km",)),
    (TILT, "  - tilt: {}", ("motion[0].tilt.to", "missing")),
    (
        TILT,
        "  - tilt: {to: -135 deg, duration: 0 s}",
        ("tilt.duration = 0 s", "not greater than zero"),
    ),
    (TILT, "  - tilt: {to: -135 deg, duration: 2}", ("tilt.duration = 2", "a time such as 0.2 s")),
    (TILT, "  - tilt: {to: -135 deg, through: []}", ("tilt.through", "unknown key", "to")),
    (TILT, "  - dwell: {duration: 1 s}", ("motion[0].dwell", "a time such as 0.2 s")),
    (TILT, "  - dwell: 0 s", ("motion[0].dwell = 0 s", "not greater than zero", "a time above 0")),
    (TILT, "  - dwell: .nan s", ("motion[0].dwell = .nan s", "a time")),
    (
        TILT,
        "  - free: {to: {tilt: -100 deg}, through: {tilt: -90 deg}}",
        ("motion[0].free.through", "not a list"),
    ),
    (
        TILT,
        "  - free: {to: {tilt: -100 deg}, through: [{}]}",
        ("free.through[0]", "the point is empty", "joints"),
    ),
    (
        TILT,
        "  - free: {to: {tilt: -100 deg}, through: [{tilt: -90 deg}, {tilt: -140 deg}]}",
        ("free.through[1].tilt = -140 deg", "outside the limits", "-139 deg to -81 deg"),
    ),
    (
        TILT,
        "  - free: {to: {tilt: -100 deg}, through: [{joints: [0 deg, 0 deg, 0 deg, 1 mm]}]}",
        ("free.through[0].joints[3] = 1 mm", "-30 mm to 0 mm"),
    ),
    (TILT, "  - free: {through: [{tilt: -90 deg}]}", ("motion[0].free.to", "missing")),
    # corners
    (
        TILT,
        "  - tilt: {to: -135 deg, blend: 0 mm}",
        ("motion[0].tilt.blend = 0 mm", "not greater than zero"),
    ),
    (TILT, "  - free: {to: {tilt: -135 deg}, blend: 1 mm}", ("free.blend", "unknown key")),
    (
        TILT,
        "  - straight: {to: {tilt: -135 deg}, through: [{roll: 5 deg}]}",
        ("straight.blend", "missing", "0.3 mm"),
    ),
    (
        TILT,
        "  - tilt: {to: -135 deg, blend: 1 mm, duration: 2 s}",
        ("motion[0].tilt.duration = 2 s", "cannot have a duration", "no blend"),
    ),
    (
        TILT,
        "  - line: {to: {depth: 5 mm}, constant_speed: 2 mm/s, duration: 2 s}",
        ("motion[0].line.constant_speed = 2 mm/s", "excludes a constant speed"),
    ),
    (
        TILT,
        "  - line: {to: {depth: 5 mm}, constant_speed: 2 deg/s}",
        ("line.constant_speed = 2 deg/s", "20 mm/s"),
    ),
    # objective and durations
    (OBJECTIVE, "objective: heat", ("objective = heat", "'time', 'time then heat' or 'effort'")),
    (
        OBJECTIVE,
        "objective: effort",
        ("objective = effort", "needs a duration", "one for every motion"),
    ),
    (OBJECTIVE, "duration: 0 s", ("duration = 0 s", "not greater than zero")),
    (OBJECTIVE, "duration: soon", ("duration = soon", "a time such as 0.2 s")),
    # rates
    (
        OBJECTIVE,
        "start_rate: {tilt: 10 mm/s}",
        ("start_rate.tilt = 10 mm/s", "a speed such as 65 deg/s"),
    ),
    (
        OBJECTIVE,
        "end_rate: {depth: 10 deg/s}",
        ("end_rate.depth = 10 deg/s", "a speed such as 20 mm/s"),
    ),
    (OBJECTIVE, "end_rate: {depht: 10 mm/s}", ("end_rate.depht", "did you mean 'depth'?")),
    (OBJECTIVE, "start_rate: 10 deg/s", ("start_rate = 10 deg/s", "roll, tilt, spin, depth")),
    # ranges that contradict each other
    (LIMIT, "  tilt: [-90 deg, -100 deg]", ("limits.tilt", "not below")),
    (
        LIMIT,
        "  tilt: [-80 deg, -70 deg]",
        ("limits.tilt", "no overlap", "-139 deg to -81 deg"),
    ),
    (LIMIT, LIMIT + "\n  spin: [10 deg, 10 deg]", ("limits.spin", "not below")),
]


@pytest.mark.parametrize(("old", "new", "parts"), MISTAKES)
def test_a_mistake_is_one_message_with_its_place(
    files: Any, old: str, new: str, parts: tuple[str, ...]
) -> None:
    message = files.rejection(NAME, old, new, at=new.splitlines()[-1])
    for part in parts:
        assert part in message
    assert "\n" not in message
    assert "pydantic" not in message


def test_along_the_retina(files: Any) -> None:
    path = files.root / SCAN
    text = (
        "  - retina: {to: {roll: 4 deg, tilt: -118 deg}, distance: 1.5 mm, constant_speed: 2 mm/s}"
    )
    files.edit(SCAN, "  - insert: {to: 12 mm}", text)
    motion = files.load(SCAN).motion[1]
    assert (motion.curve, motion.distance, motion.constant_speed) == ("retina", 0.0015, 0.002)
    assert motion.to.set_coordinates == pytest.approx({"roll": D(4), "tilt": D(-118)})
    for old, new, parts in (
        ("distance: 1.5 mm, const", "distance: 0.5 mm, const", ("retina.distance = 0.5 mm", "smaller than the clearance")),
        ("distance: 0.5 mm, const", "const", ("motion[1].retina.distance", "missing")),
        ("const", "distance: 1.5 mm, const", ()),
        ("tilt: -118 deg}", "depth: 5 mm}", ("retina.to.depth = 5 mm", "distance already determines it")),
    ):  # fmt: skip
        path.write_text(path.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
        if parts:
            with pytest.raises(ProblemError) as caught:
                files.load(SCAN)
            assert all(part in str(caught.value) for part in parts), caught.value


SCAN_MISTAKES: list[tuple[str, str, tuple[str, ...]]] = [
    (RING, "      pattern: spiral", ("scan.pattern = spiral", "'raster', 'ring' or 'triple ring'")),
    (
        RING,
        "      pattern: raster",
        ("scan.diameter", "not allowed for the pattern 'raster'", "rows, columns"),
    ),
    (
        RING,
        "      pattern: triple ring",
        ("scan.diameter", "not allowed for the pattern 'triple ring'", "diameters"),
    ),
    (DIAMETER, "      rows: 3", ("scan.rows", "not allowed for the pattern 'ring'", "diameter")),
    (DIAMETER, "      # none", ("scan.diameter", "missing", "'ring' needs it")),
    (DIAMETER, "      diameter: 0 mm", ("scan.diameter = 0 mm", "not greater than zero")),
    (DIAMETER, "      diameter: 12 mm", ("scan.diameter = 12 mm", "larger than the eye's radius")),
    (
        AT,
        "      at: {tilt: -115 deg, tip: [0 mm, 0 mm, -10 mm]}",
        ("scan.at.tip", "unknown key", "roll, tilt, spin"),
    ),
    (AT, "      at: {roll: 5 deg}", ("scan.at", "missing", "needs a tilt", "roll, tilt, spin")),
    (
        AT,
        "      at: {tilt: -115 deg, depth: 9 mm}",
        ("scan.at", "do not give depth: distance already determines it"),
    ),
    (AT, "      at: {tilt: -140 deg}", ("scan.at.tilt = -140 deg", "outside the limits")),
    (
        "distance: 1.5 mm",
        "distance: 0.5 mm",
        ("scan.distance = 0.5 mm", "smaller than the clearance", "at least", "1 mm"),
    ),
    ("distance: 1.5 mm", "distance: -1 mm", ("scan.distance = -1 mm", "not greater than zero")),
    ("spacing: 1 mm", "spacing: 0 mm", ("scan.spacing = 0 mm", "not greater than zero")),
    ("dwell: 0.05 s", "dwell: -1 s", ("scan.dwell = -1 s", "negative", "at least 0")),
    ("dwell: 0.05 s", "order: shortest", ("scan.order = shortest", "'given' or 'fastest'")),
    ("dwell: 0.05 s", "laser: on", ("scan.laser", "unknown key", "pattern, at, distance")),
]


@pytest.mark.parametrize(("old", "new", "parts"), SCAN_MISTAKES)
def test_a_mistake_in_a_scan(files: Any, old: str, new: str, parts: tuple[str, ...]) -> None:
    place = (
        "- scan:"
        if "missing" in parts and old == DIAMETER
        else "diameter: 2 mm"
        if "scan.diameter" in parts and old == RING
        else None
    )
    message = files.rejection(SCAN, old, new, place)
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    ("keys", "parts"),
    [
        ("rows: 0\n      columns: 2", ("scan.rows = 0", "a whole number from 1 to 50")),
        ("rows: 2.5\n      columns: 2", ("scan.rows = 2.5", "a whole number from 1 to 50")),
        ("rows: 51\n      columns: 2", ("scan.rows = 51", "a whole number from 1 to 50")),
        ("rows: 2", ("scan.columns", "missing", "'raster' needs it")),
    ],
)
def test_a_mistake_in_a_raster(files: Any, keys: str, parts: tuple[str, ...]) -> None:
    files.edit(SCAN, RING, "      pattern: raster")
    place = "- scan:" if "missing" in parts else "rows:"
    message = files.rejection(SCAN, DIAMETER, f"      {keys}", at=place)
    for part in parts:
        assert part in message


@pytest.mark.parametrize("diameters", ["(3, 2, 1) mm", "(1, 1, 2) mm", "(0, 1, 2) mm", "(1, 2) mm"])
def test_three_rings_are_one_around_the_other(files: Any, diameters: str) -> None:
    files.edit(SCAN, RING, "      pattern: triple ring")
    message = files.rejection(SCAN, DIAMETER, f"      diameters: {diameters}")
    assert "scan.diameters" in message
    assert "three increasing lengths" in message or "3 values" in message


def test_a_scan_needs_an_eye(files: Any) -> None:
    path = files.root / SCAN
    text = path.read_text(encoding="utf-8")
    path.write_text(text[: text.index("eye:\n")] + "# eye:\n", encoding="utf-8")
    message = files.rejection(SCAN, "# eye:", "name: without eye", at="- scan:")
    assert "a motion along the retina needs an eye (allowed: a problem with an eye)" in message


def test_durations_that_contradict_each_other(files: Any) -> None:
    files.edit(NAME, TILT, "  - tilt: {to: -135 deg, duration: 2 s}\n  - dwell: 1 s")
    message = files.rejection(NAME, OBJECTIVE, "duration: 3 s")
    assert "duration = 3 s: dwells and timed motions alone take 3 s" in message
    files.edit(NAME, "insert: {to: 20 mm}", "insert: {to: 20 mm, duration: 3 s}")
    message = files.rejection(NAME, "duration: 3 s\n", "duration: 9 s\n", at="duration: 9 s")
    assert "every motion already has a duration" in message


def test_too_many_points(files: Any) -> None:
    points = ", ".join(f"{{depth: {k % 2 + 1} mm}}" for k in range(10_000))
    message = files.rejection(NAME, TILT, f"  - free: {{to: {{depth: 3 mm}}, through: [{points}]}}")
    assert "free.through: 10000 entries (allowed: at most 200)" in message


def test_the_schema_for_editors_knows_every_key() -> None:
    text = str(json_schema("problem"))
    for key in (
        "through",
        "duration",
        "start_rate",
        "end_rate",
        "scan",
        "pattern",
        "diameters",
        "objective",
        "eye",
    ):
        assert f"'{key}'" in text


PLANNING = {
    "NaN": ("  - tilt: {to: .nan deg}", "motion[0].tilt.to = .nan deg"),
    "no motion": ("  - {}", "motion[0]: the entry has no motion"),
    "absurd unit": ("  - tilt: {to: -110 rad}", "did you mean deg?"),
    "scan without eye": (
        "  - scan: {pattern: triple ring, at: {tilt: -100 deg}, distance: 1 mm}",
        "needs an eye",
    ),
    "dwell of zero": ("  - dwell: 0 s", "not greater than zero"),
    "a rate across the motion": (
        "  - tilt: {to: -135 deg}\nstart_rate: {roll: 5 deg/s}\nx: 1",
        "start_rate",
    ),
}


@pytest.mark.parametrize("case", PLANNING)
def test_through_the_command_line(
    files: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], case: str
) -> None:
    """The command returns status 2 with one message on stderr and nothing on stdout.

    Earlier results remain unchanged.
    """
    new, expected = PLANNING[case]
    path = files.edit(NAME, TILT, new)
    if "start_rate" in new:
        text = (
            path.read_text(encoding="utf-8")
            .replace(new, "  - tilt: {to: -135 deg}")
            .replace(OBJECTIVE, "start_rate: {roll: 5 deg/s}")
        )
        path.write_text(text, encoding="utf-8")
    out = tmp_path / "out"
    out.mkdir()
    (out / "plan.json").write_text("earlier", encoding="utf-8")
    assert main(["plan", str(path), "-o", str(out)]) == 2
    captured = capsys.readouterr()
    (message,) = [line for line in captured.err.splitlines() if not line.startswith("[")]
    assert message.startswith(f"ssm-planner: {path}")
    assert expected in message
    assert "Traceback" not in captured.err
    assert captured.out == ""
    assert [file.name for file in out.iterdir()] == ["plan.json"]
    assert (out / "plan.json").read_text(encoding="utf-8") == "earlier"


BEGIN = "start: {roll: 0 deg, tilt: -95 deg, spin: 0 deg, depth: 5 mm}"


@pytest.mark.parametrize(
    ("motion", "line", "parts"),
    [
        ("  - tilt: {to: -110 deg, blend: 1 um}", 0, ("motion[0].tilt.blend = 1 um", "at least 0.01 mm")),
        ("  - tilt: {to: -100 deg, blend: 5 mm}", 0, ("motion[0].tilt.blend = 5 mm", "more than half", "mm here")),
        ("  - dwell: 1 s\n  - straight: {to: {tilt: -95 deg}, blend: 1 mm}", 1, ("motion[1].straight.blend", "rounded")),
        ("  - arc: {through: {depth: 6 mm}, to: {depth: 7 mm}}", 0, ("motion[0].arc: ", "lie on one line")),
        ("  - line: {to: {spin: 10 deg}, constant_speed: 1 mm/s}", 0, ("motion[0].line.constant_speed = 1 mm/s", "keep")),
        ("  - tilt: {to: -178 deg}", 0, ("motion[0].tilt.to = -178 deg", "cannot reach")),
        ("  - straight: {to: {tilt: -178 deg, depth: 6 mm}}", 0, ("motion[0].straight.to.tilt = -178 deg",)),
        ("  - free: {to: {tilt: -178 deg}}", 0, ("motion[0].free.to.tilt = -178 deg",)),
        ("  - free: {through: [{spin: 0 deg}, {tilt: -178 deg}], to: {depth: 0 mm}}", 0, ("motion[0].free.through[1].tilt",)),
        ("  - spline: {through: [{tilt: -178 deg}], to: {tilt: -98 deg}}", 0, ("motion[0].spline.through[0].tilt = -178",)),
        ("  - line: {to: {tip: [10 mm, 0 mm, 0 mm], spin: 0 deg}}", 0, ("motion[0].line.to.tip = 10 mm, 0 mm, 0 mm",)),
        ("  - arc: {through: {tip: [10 mm, 0 mm, 0 mm], spin: 0 deg}, to: {depth: 6 mm}}", 0, ("motion[0].arc.through.tip",)),
        ("  - free: {to: {tip: [10 mm, 0 mm, 0 mm], spin: 0 deg}}", 0, ("motion[0].free.to.tip",)),
        ("  - tilt: {to: -95 deg}", 0, ("motion[0].tilt: ", "has length zero")),
    ],
)  # fmt: skip
def test_a_mistake_found_while_a_path_is_made_names_its_place(
    files: Any, motion: str, line: int, parts: tuple[str, ...]
) -> None:
    text = (files.root / NAME).read_text(encoding="utf-8")
    head, tail = text[: text.index("motion:")], text[text.index("limits:") :]
    head = head.replace(START, BEGIN)
    tail = "" if "178" in motion or "10 mm, 0 mm" in motion else tail
    after = "\n  - insert: {to: 12 mm}" if "has length zero" not in parts else ""
    if not tail:  # The limits of the robot would refuse the motion earlier.
        robot = (files.root / "robots/vitreoretinal.yaml").read_text(encoding="utf-8")
        files.edit("robots/vitreoretinal.yaml", robot[robot.index("\nlimits:") + 1 :], "")
    (files.root / NAME).write_text(f"{head}motion:\n{motion}{after}\n{tail}", encoding="utf-8")
    with pytest.raises(ProblemError) as caught:
        plan_motion(files.load(NAME))
    place = (files.root / NAME).read_text(encoding="utf-8").splitlines().index(
        motion.split("\n")[line]
    ) + 1
    assert str(caught.value).startswith(f"{files.root / NAME}:{place}: {parts[0]}"), str(
        caught.value
    )
    for part in parts:
        assert part in str(caught.value)

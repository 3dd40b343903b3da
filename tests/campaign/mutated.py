"""Mutated files of every kind that is read: no traceback, no hang, and a message that names the file."""

from __future__ import annotations

import copy
import json
import random
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from .rows import ROBOT, ROOT, Count, Row, command

TOKENS = (
    "1e999", "-1e999", "1e-99999999999999999999", "1e99999999999999999999", "9" * 400, "-" + "9" * 5000, "2001-99-99",
    "2001-01-01", "!!int x", "!!float x", "!!timestamp 2001-99-99", "!!binary x", "!!python/object:os.system x", "nan",
    ".nan", ".inf", "inf", "NaN", "Infinity", "0", "-0", "-1", "1e308", "-1e308", "5e-324", "[" * 300, "{" * 300,
    "[[]]", "{}", "[]", "null", "true", "~", "''", '"\\ud800"', '"\\u0000"', "\0", "..", ".", "/dev/zero", "/dev/null",
    "&a [*a]", "*a", "<<: *a", "- ", ": ", "? ", "---", "...", "\t", "💥", "\ufeff", "\ud83d", "1_000", "0x10", "0o7",
    "1:30", "on", ",", ";", "1,2", "%", "#", "@", "`", "65 deg/s", "1 mm", "-1 deg", "1e400 deg", "m**9**9**9", "nan deg",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 10**30, -(10**400), 1e308, -1e308, 5e-324, 1e-300, "", "x", "..", "/dev/null", "\0",
    "\ud800", "a" * 300, "../../x", [], {}, [[]], [None], {"": 0}, [1, 2, 3, 4], "2001-99-99", "1e999", 1.5, [1e308] * 4,
)  # fmt: skip


def bombs() -> list[bytes]:
    """Whole files that are hostile whatever their kind."""
    laughs = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n"
    laughs += "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 25))
    merges = "a0: &a0 {x: 1}\n" + "".join(
        f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 9)}]}}\n" for i in range(1, 25)
    )
    return [
        b"", b"\n", b"\0", b"\xff\xfe", b"[" * 40_000, b"{" * 40_000, b"[" * 1_000_000, b'{"a":' * 40_000, b"- " * 40_000,
        b"'" * 10_000, laughs.encode(), merges.encode(), b"a: &a [*a]\n", b"? " * 40_000, b"&a " * 1000, b"9" * 100_000,
        b"1" + b"," * 100_000, b"\n" * 100_000, b"!!int x", b"2001-99-99", b"--- \n" * 1000, b"a,b\n" * 2,
    ]  # fmt: skip


def mutated_bytes(rng: random.Random, data: bytes) -> bytes:
    """One to four changes: bytes flipped, cut, repeated, moved, numbers and words replaced by hostile ones."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        at = rng.randrange(len(data) + 1)
        size = rng.choice((1, 1, 2, 8, 64, 1000))
        what = rng.randrange(7)
        if what == 0:
            data = data[:at] + bytes(rng.randrange(256) for _ in range(size % 9)) + data[at + size % 9 :]
        elif what == 1:
            data = data[:at] + data[at + size :]
        elif what == 2:
            data = data[:at]
        elif what == 3:
            data = data[:at] + data[at : at + size] * rng.choice((2, 3, 50)) + data[at + size :]
        elif what == 4:
            data = data[:at] + rng.choice(TOKENS).encode("utf-8", "surrogatepass") + data[at:]
        else:
            data = _replaced_word(rng, data, at)
    return data


def _replaced_word(rng: random.Random, data: bytes, at: int) -> bytes:
    """The word or number about a place becomes a hostile one."""
    stops = b" \n,:;[]{}\"'\t"
    first, last = at, at
    while first > 0 and data[first - 1] not in stops and at - first < 60:
        first -= 1
    while last < len(data) and data[last] not in stops and last - at < 60:
        last += 1
    return data[:first] + rng.choice(TOKENS).encode("utf-8", "surrogatepass") + data[last:]


def mutated_tree(rng: random.Random, text: str) -> bytes:
    """A JSON document with one to three of its values replaced, removed, repeated or renamed."""
    tree = json.loads(text)
    for _ in range(rng.choice((1, 1, 2, 3))):
        place: Any = tree
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            if not keys:
                break
            key = rng.choice(keys)
            if isinstance(place[key], (dict, list)) and place[key] and rng.random() < 0.85:
                place = place[key]
                continue
            _change(rng, place, key)
            break
    return json.dumps(tree).encode("utf-8", "surrogatepass")


def _change(rng: random.Random, place: Any, key: Any) -> None:
    what = rng.randrange(5)
    if what == 0:
        del place[key]
    elif what == 1 and isinstance(place, dict):
        place[rng.choice(("x", "", "name", "\0"))] = place.pop(key)
    elif what == 2 and isinstance(place, list):
        place.append(copy.deepcopy(place[key]))
    elif what == 3 and type(place[key]) in (int, float):
        place[key] = (-place[key], 0, 1e300, place[key] * 1e6 if abs(place[key]) < 1e300 else 0.1)[rng.randrange(4)]
    else:
        place[key] = copy.deepcopy(rng.choice(VALUES))


def run(count: int, seed: int) -> list[Row]:
    """About `count` mutated files, a share for every kind."""
    with tempfile.TemporaryDirectory() as folder:
        return Kinds(Path(folder)).run(count, seed)


class Kinds:
    """The files that are mutated, and the command that reads each kind."""

    def __init__(self, folder: Path) -> None:
        from plans import trapezoids, write_plan

        from ssm_planner.formats.export import export
        from ssm_planner.loading.load import load_robot

        self.folder = folder
        robot = load_robot(ROBOT)
        self.plan = write_plan(folder / "plan.json", robot, trapezoids(robot))
        for form, options in (
            ("csv", {}),
            ("ros2", {"rate": 10.0}),
            ("epos4", {"counts_per_turn": 4096, "rate": 20.0}),
        ):
            export(self.plan, form, folder / form, **options)
        robots = ["--robot", str(ROBOT)]
        yaml = (ROOT / "problems/tilt_insert.yaml", ROOT / "problems/laser_scan.yaml")
        recording = next((ROOT / "problems").glob("recordings/**/*.csv"), None)
        drive = str(ROOT / "problems/drives/rig1_lead_screw.yaml")
        self.kinds: list[tuple[str, Sequence[Path], Callable[[Path], list[str]], bool]] = [
            ("problem YAML", yaml, lambda path: ["ik", str(path), "--roll", "0deg"], False),
            ("robot YAML", (ROBOT,), lambda path: ["workspace", str(path), "--json"], False),
            ("plan.json, tree", (self.plan,), lambda path: ["check", str(path), "--json"], True),
            ("plan.json, bytes", (self.plan,), lambda path: ["check", str(path), "--json"], False),
            ("CSV", (folder / "csv/trajectory.csv",), lambda path: ["check", str(path), *robots, "--json"], False),
            ("JointTrajectory", (folder / "ros2/joint_trajectory.yaml",), lambda p: ["check", str(p), *robots], False),
            ("bag", (folder / "ros2/bag/bag.mcap",), lambda path: ["check", str(path), *robots], False),
            ("bag metadata", (folder / "ros2/bag/metadata.yaml",), lambda p: ["check", str(p.parent), *robots], False),
            ("manifest, tree", (folder / "epos4/manifest.json",), lambda p: ["check", str(p.parent), *robots], True),
            ("manifest, bytes", (folder / "epos4/manifest.json",), lambda p: ["check", str(p.parent), *robots], False),
        ]
        if recording is not None:
            self.kinds.append(("recording", (recording,), lambda p: ["predict", drive, str(p), "--json"], False))

    def run(self, count: int, seed: int) -> list[Row]:
        """A share of the count for every kind."""
        rows = []
        for number, (kind, files, words, tree) in enumerate(self.kinds):
            rng, counted = random.Random(f"{seed} {number}"), Count(kind)
            sources = [(file, file.read_bytes()) for file in files]
            cases: list[bytes | None] = [*bombs(), *([None] * max(count // len(self.kinds) - len(bombs()), 0))]
            cases: list[bytes | None] = cases[: max(count // len(self.kinds), 1)]
            for case in cases:
                file, data = rng.choice(sources)
                content = case
                if content is None:
                    content = mutated_tree(rng, data.decode()) if tree else mutated_bytes(rng, data)
                counted.add(self.fault(kind, file, content, words))
            rows.append(counted.row)
        return rows

    def fault(self, kind: str, file: Path, content: bytes, words: Callable[[Path], list[str]]) -> str | None:
        """What is wrong with the answer to a mutated file."""
        shipped = self.folder not in file.parents
        path = self.folder / f"mutated{file.suffix}" if shipped else file
        original = None if shipped else file.read_bytes()
        path.write_bytes(content)
        try:
            if kind == "problem YAML":
                return _load(path)
            status, _, err, fault = command(*words(path))
        finally:
            if original is not None:
                path.write_bytes(original)
        if fault is not None:
            return f"{fault}: {content[:80]!r}"
        if status not in (0, 1, 2):
            return f"exit status {status}: {err[-200:]}"
        if status == 2 and path.name not in err and str(path.parent) not in err:
            return f"the message does not name the file: {err[-200:]}"
        return None


def _load(path: Path) -> str | None:
    from ssm_planner.errors import SsmPlannerError
    from ssm_planner.loading.load import load_problem

    from .rows import Hang, watchdog

    try:
        with watchdog():
            load_problem(path)
    except SsmPlannerError as error:
        # a fault of the robot that the problem names is said of that file
        return None if ".yaml" in str(error) else f"the message does not name the file: {error}"
    except Hang:
        return "hangs"
    except Exception as error:  # noqa: BLE001 - any is a finding
        return f"{type(error).__name__}: {error}"
    return None

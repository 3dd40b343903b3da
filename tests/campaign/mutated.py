"""Mutated files must cause no traceback, no hang and no message without the name of the file."""

from __future__ import annotations

import copy
import json
import math
import random
import resource
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ssm_planner.publishing import sha256

from .rows import ROBOT, ROOT, Count, Hang, Row, command, watchdog

BOMBS = 0.05
"""Fraction of the cases that use a file which is hostile to every reader."""
GROWTH = 0.85
"""Memory in GB that the process may use beyond its earlier peak.

The program itself uses 0.15 GB, and 1 GB is allowed in total.
"""

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

STUDY = """robot: vitreoretinal
motions: [tilt_insert]
vary:
  geometry.alpha: {from: 26 deg, to: 40 deg}
  joints.roll.motor: {catalogue: motors.csv}
  joints.insertion.drive.friction.mu: {choices: [0.10, 0.13, 0.16]}
require: {reach: [-135 deg, -85 deg], self_locking: true, motor_margin: 20 %}
minimise: [duration, motor_mass]
search: {method: sobol, points: 64, seed: 1}
"""


def bombs() -> list[bytes]:
    """Return complete files that are hostile to every reader."""
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
    """Make one to four changes of the bytes.

    A change flips, cuts or repeats bytes, or replaces words and numbers by hostile ones.
    """
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        offset = rng.randrange(len(data) + 1)
        size = rng.choice((1, 1, 2, 8, 64, 1000))
        what = rng.randrange(7)
        if what == 0:
            data = (
                data[:offset]
                + bytes(rng.randrange(256) for _ in range(size % 9))
                + data[offset + size % 9 :]
            )
        elif what == 1:
            data = data[:offset] + data[offset + size :]
        elif what == 2:
            data = data[:offset]
        elif what == 3:
            data = (
                data[:offset]
                + data[offset : offset + size] * rng.choice((2, 3, 50))
                + data[offset + size :]
            )
        elif what == 4:
            data = (
                data[:offset] + rng.choice(TOKENS).encode("utf-8", "surrogatepass") + data[offset:]
            )
        else:
            data = _replaced_word(rng, data, offset)
    return data


def _peak() -> float:
    """Return the peak memory of this process in GB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def _replaced_word(rng: random.Random, data: bytes, at: int) -> bytes:
    """Replace the word or number at a position by a hostile one."""
    stops = b" \n,:;[]{}\"'\t"
    first, last = at, at
    while first > 0 and data[first - 1] not in stops and at - first < 60:
        first -= 1
    while last < len(data) and data[last] not in stops and last - at < 60:
        last += 1
    return data[:first] + rng.choice(TOKENS).encode("utf-8", "surrogatepass") + data[last:]


def mutated_tree(rng: random.Random, text: str) -> bytes:
    """Replace, remove, repeat or rename one to three values of a JSON document."""
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
        place[key] = (-place[key], 0, 1e300, place[key] * 1e6 if abs(place[key]) < 1e300 else 0.1)[
            rng.randrange(4)
        ]
    else:
        place[key] = copy.deepcopy(rng.choice(VALUES))


def run(count: int, seed: int) -> list[Row]:
    """Check about `count` mutated files, with the same number for every kind."""
    with tempfile.TemporaryDirectory() as folder:
        return Kinds(Path(folder)).run(count, seed)


class Kind(NamedTuple):
    """Files of one kind, and the command or function that reads them."""

    name: str
    files: Sequence[Path]
    reader: Callable[[Path], Any]
    """Function from a path to the words of a command, or function that loads the file directly."""
    tree: bool = False
    """True if values of the JSON are changed instead of bytes."""
    loads: bool = False


class Kinds:
    """The files to mutate, and the command or function that reads each kind."""

    def __init__(self, folder: Path) -> None:
        from ssm_planner.formats.export import export
        from ssm_planner.loading import load
        from ssm_planner.publishing import publishing_results
        from ssm_planner.studies.study_file import load_study
        from tests.support.plans import trapezoids, write_plan

        self.folder, self.large, self.before = folder, False, _peak()
        robot = load.load_robot(ROBOT)
        plan = write_plan(folder / "plan.json", robot, trapezoids(robot))
        for form, options in (
            ("csv", {}),
            ("ros2", {"rate": 10.0}),
            ("epos4", {"counts_per_turn": 4096, "rate": 20.0}),
        ):
            export(plan, form, folder / form, **options)
        with publishing_results(folder / "results", sha256(plan)) as results:
            shutil.copy(plan, results / "plan.json")
        drive = folder / "drive.yaml"
        rig = ROOT / "problems/drives/rig3_worm.yaml"
        identified = command("identify", str(rig), "-o", str(drive), seconds=60)
        assert identified[0] == 0, f"identify: {identified}"
        recording, recorder = _recordings(folder)
        study, catalogue, store = _study(folder)

        def shipped(pattern: str) -> list[Path]:
            return sorted((ROOT / "problems").glob(pattern))

        def check(path: Path) -> list[str]:
            return ["check", str(path), "--robot", str(ROBOT)]

        manifest, metadata = folder / "epos4/manifest.json", folder / "ros2/bag/metadata.yaml"
        self.kinds = [
            Kind("problem YAML", shipped("*.yaml"), load.load_problem, loads=True),
            Kind("robot YAML", [ROBOT], load.load_robot, loads=True),
            Kind("drive YAML", shipped("drives/*.yaml"), load.load_drive, loads=True),
            Kind("drive YAML with posterior", [drive], load.load_drive, loads=True),
            Kind("motor YAML", shipped("motors/*.yaml"), load.load_motor, loads=True),
            Kind("controller YAML", shipped("controllers/*.yaml"), load.load_controller, loads=True),
            Kind("motorisation YAML", shipped("motorisation/*.yaml"), load.load_motorisation, loads=True),
            Kind("plan.json, tree", [plan], lambda path: ["check", str(path), "--json"], tree=True),
            Kind("plan.json, bytes", [plan], lambda path: ["check", str(path), "--json"]),
            Kind("results with manifest", [folder / "results/plan.json"], lambda path: ["check", str(path)], tree=True),
            Kind("manifest of results", [folder / "results/manifest.json"], lambda p: ["check", str(p.parent / "plan.json")]),
            Kind("CSV", [folder / "csv/trajectory.csv"], check),
            Kind("JointTrajectory", [folder / "ros2/joint_trajectory.yaml"], check),
            Kind("bag, mcap", [folder / "ros2/bag/bag.mcap"], check),
            Kind("bag, metadata", [metadata], lambda path: check(path.parent)),
            Kind("manifest, tree", [manifest], lambda path: check(path.parent), tree=True),
            Kind("manifest, bytes", [manifest], lambda path: check(path.parent)),
            Kind("study YAML", [study], load_study, loads=True),
            Kind("catalogue of a study", [catalogue], lambda _: load_study(study), loads=True),
            Kind("store of a study", [store], _read_store, loads=True),
            Kind("recording", [recording], lambda path: ["predict", str(drive), str(path), "--json"]),
            Kind("recording of a recorder", [recorder], lambda path: ["compare", str(plan), f"roll={path}", "--json"]),
        ]  # fmt: skip

    def run(self, count: int, seed: int) -> list[Row]:
        """Check an equal number of mutated files for every kind."""
        rows, hostile = [], bombs()
        for number, kind in enumerate(self.kinds):
            rng, counted = random.Random(f"{seed} {number}"), Count(kind.name)
            for _ in range(max(count // len(self.kinds), 1)):
                file = rng.choice(kind.files)
                data = file.read_bytes()
                if rng.random() < BOMBS:
                    content = rng.choice(hostile)
                else:
                    content = (
                        mutated_tree(rng, data.decode()) if kind.tree else mutated_bytes(rng, data)
                    )
                counted.add(self.fault(kind, file, content))
            rows.append(counted.row)
        return rows

    def fault(self, kind: Kind, file: Path, content: bytes) -> str | None:
        """Return the fault in the answer to a mutated file, or None."""
        shipped = self.folder not in file.parents
        path = self.folder / f"mutated{file.suffix}" if shipped else file
        original = None if shipped else file.read_bytes()
        path.write_bytes(content)
        try:
            if kind.loads:
                return _load(kind.reader, path)
            status, _, err, fault = command(*kind.reader(path))
        finally:
            if original is not None:
                path.write_bytes(original)
        if fault is not None:
            return f"{fault}: {content[:80]!r}"
        if status not in (0, 1, 2, 4):
            return f"exit status {status}: {err[-200:]}"
        if status == 2 and path.name not in err and str(path.parent) not in err:
            return f"the message does not name the file: {err[-200:]}"
        largest = _peak()
        if largest - self.before > GROWTH and not self.large:
            self.large = True  # the peak memory of the process never decreases
            return f"{largest:.2f} GB of memory: {content[:80]!r}"
        return None


def _recordings(folder: Path) -> tuple[Path, Path]:
    """Write a recording with named columns and one in the format of an EPOS recorder."""
    time = [0.002 * k for k in range(300)]
    rows = [
        f"{t:.3f},{100 + math.sin(9 * t):.4f},{0.01 + 0.001 * math.sin(5 * t):.6f}" for t in time
    ]
    named, recorder = folder / "steady.csv", folder / "roll.csv"
    named.write_text(
        "\n".join(["time [s],velocity [rad/s],torque [N*m]", *rows]) + "\n", encoding="utf-8"
    )
    head = ["Date:;2024-01-01 10:00:00", f"Recorded samples:;{len(time)}", "Sampling period:;2.000"]
    head += [";Velocity actual value averaged;Torque actual value averaged", "ms;rpm;%"]
    rows = [
        f"{1e3 * t:.0f};{round(2000 * math.sin(3 * t))};{20 * math.sin(3 * t):.1f}" for t in time
    ]
    recorder.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    return named, recorder


def _study(folder: Path) -> tuple[Path, Path, Path]:
    """Write a study, its catalogue and a store of three candidates."""
    from ssm_planner.studies.store import Candidate, Store

    catalogue, study, store = folder / "motors.csv", folder / "study.yaml", folder / "store.sqlite"
    shutil.copy(ROOT / "problems/catalogues/motors_24v.csv", catalogue)
    study.write_text(STUDY, encoding="utf-8")
    with Store(store) as open_store:
        open_store.add_candidates(
            (k, f"{k:032x}", {"geometry.alpha": f"{26 + k} deg"}) for k in range(3)
        )
        result = Candidate(
            0, "done", {"geometry.alpha": "26 deg"}, figures={"duration": 1.5, "motor_mass": 0.2}
        )
        open_store.write_results([(f"{0:032x}", result)])
    return study, catalogue, store


def _read_store(path: Path) -> None:
    from ssm_planner.studies.store import Store

    for suffix in ("-wal", "-shm"):  # files that belong to the previous store
        path.with_name(path.name + suffix).unlink(missing_ok=True)
    with Store(path) as store:
        store.rows()


def _load(reader: Callable[[Path], Any], path: Path) -> str | None:
    from ssm_planner.errors import SsmPlannerError

    try:
        with watchdog():
            reader(path)
    except SsmPlannerError as error:
        # The message may name a file to which this one refers, if the fault is in that file.
        return (
            None
            if ".yaml" in str(error) or path.name in str(error)
            else f"the message does not name the file: {error}"
        )
    except Hang:
        return "hangs"
    except Exception as error:  # noqa: BLE001 - any is a finding
        return f"{type(error).__name__}: {error}"
    return None

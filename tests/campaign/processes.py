"""Processes that are killed, interrupted or obstructed leave consistent results and clear messages.

The cases cover signals at random instants, files that cannot grow, closed streams, two writers at
once, and hostile names.
"""

from __future__ import annotations

import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ssm_planner import load_plan
from ssm_planner.errors import TrajectoryError
from ssm_planner.formats.c import robot_code
from ssm_planner.formats.urdf import robot_urdf
from ssm_planner.publishing import MANIFEST, check_generation, file_hashes, file_name

from .rows import ROOT, Count, Row

KINDS = ("plan", "report", "csv", "ros2")
PATIENCE = 120.0
ORPHANS = 2.0
"""Time in s after the end of a process within which its children must end."""
MARK = "SSM_PLANNER_CAMPAIGN"
STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143}
NAMES = (
    "../../x", "/tmp/x", "..", ".", "a/b", "a\\b", "a\nb", "*/ int x; /*", "*\\\n/ int x;", "??/", "-->", "]]>", "<x>&",
    "\"'", "é ü 中", "a" * 500, "\x07\x1b[31m", "\u2028", "$(touch x)", "`touch x`", "; touch x", "%n%s", "CON", "--", "-o",
    "//", "*??/\n/", "\x7f", "\ufeff", "\u202e", "{{7*7}}", "</script>", "-", "--->", "\r\n#define x",
)  # fmt: skip


@dataclass(frozen=True)
class Stage:
    """Two problems, their results and exports, which all cases share."""

    folder: Path
    problems: tuple[Path, Path]
    results: tuple[Path, Path]
    exports: dict[str, Path]
    """Exports of the second results by format."""
    seconds: dict[str, float]
    """Duration in s of each command on this machine when nothing disturbs it."""

    @classmethod
    def prepared(cls, folder: Path) -> Stage:
        shutil.copytree(ROOT / "problems", folder / "problems")
        first = folder / "problems/tilt_insert.yaml"
        second = folder / "problems/less.yaml"
        second.write_text(
            first.read_text(encoding="utf-8").replace("to: 20 mm", "to: 12 mm"), encoding="utf-8"
        )
        results = folder / "first", folder / "second"
        stage = cls(
            folder, (first, second), results, {form: folder / form for form in ("csv", "ros2")}, {}
        )
        for problem, result in zip((first, second), results, strict=True):
            stage.timed("plan", "plan", str(problem), "-o", str(result))
        for form, out in stage.exports.items():
            stage.timed(form, "export", str(results[1]), "--to", form, "-o", str(out))
        shutil.copytree(results[0], folder / "again")
        stage.timed("report", "report", str(folder / "again"), "--figures", str(folder / "again"))
        return stage

    def timed(self, kind: str, *words: str) -> None:
        begin = time.monotonic()
        ended = start(self.folder, *words).wait(PATIENCE)
        assert ended == 0, f"{words}: exit status {ended}"
        self.seconds[kind] = time.monotonic() - begin


def run(count: int, seed: int) -> list[Row]:
    """Run all kinds of cases. Nine tenths of the count are interruptions."""
    with tempfile.TemporaryDirectory() as name:
        stage = Stage.prepared(Path(name))
        rows = [
            interrupted(stage, 3 * count // 10, number, random.Random(f"{seed} {number}"))
            for number in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
        ]
        few = max(count // 40, min(3, count // 4))
        rng = random.Random(f"{seed} others")
        rows += [
            full_disk(stage, few, rng),
            closed_streams(stage, few, rng),
            two_writers(stage, few, rng),
        ]
        return [*rows, hostile_folders(stage, few, rng), hostile_texts(4 * count, rng)]


def start(
    cwd: Path,
    *words: str,
    mark: str = "",
    limit: int | None = None,
    streams: dict[str, Any] | None = None,
) -> subprocess.Popen[bytes]:
    """Start the program in a process of its own.

    `mark` identifies the children of the process through their environment.
    """

    def begin() -> None:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    pipes = {
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
        **(streams or {}),
    }
    environment = {**os.environ, "PYTHONPATH": str(ROOT), MARK: mark}
    command = [sys.executable, "-m", "ssm_planner", *words]
    return subprocess.Popen(
        command, cwd=cwd, env=environment, preexec_fn=begin, start_new_session=True, **pipes
    )


def interrupted(stage: Stage, count: int, number: signal.Signals, rng: random.Random) -> Row:
    """Send signals at random instants of the run.

    Every second instant lies in the last part of the run, where files are written.
    """
    counted = Count(f"interruption, {number.name}")
    for k in range(count):
        case = stage.folder / "case"
        shutil.rmtree(case, ignore_errors=True)
        kind = rng.choice(KINDS)
        out, words, earlier = _command(stage, case, kind)
        # Instants of odd cases cover the whole run. Instants of even cases cover its last part,
        # where files are written.
        instant = stage.seconds[kind] * (rng.uniform(0.0, 1.1) if k % 2 else rng.uniform(0.6, 1.1))
        mark = f"{number.name}-{k}-{os.getpid()}"
        errors = case / "stderr"
        with errors.open("wb") as stream:
            process = start(case, *words, mark=mark, streams={"stderr": stream})
            time.sleep(instant)
            process.send_signal(number)
            try:
                status = process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                counted.add(f"{kind}: still there after {PATIENCE:g} s")
                continue
        fault = _orphans(mark) or _left(out, earlier, case) if number == signal.SIGKILL else None
        if number != signal.SIGKILL:
            fault = _orphans(mark) or _said(
                number, status, errors.read_text("utf-8", "replace"), out, earlier
            )
        counted.add(fault and f"{kind}: {fault}")
    return counted.row


def _command(stage: Stage, case: Path, kind: str) -> tuple[Path, list[str], dict[str, str]]:
    """Return the output folder, the words of the command and the earlier content for one case."""
    out = case / "out"
    first, second = stage.results
    case.mkdir()
    if kind == "plan":
        shutil.copytree(second, out)
        words = ["plan", str(stage.problems[0]), "-o", str(out)]
    elif kind == "report":
        shutil.copytree(first, out)
        words = ["report", str(out), "--figures", str(out)]
    else:
        shutil.copytree(stage.exports[kind], out)
        words = ["export", str(first), "--to", kind, "-o", str(out)]
    return out, words, file_hashes(out) | {MANIFEST: (out / MANIFEST).read_text(encoding="utf-8")}


def _left(out: Path, earlier: dict[str, str], case: Path) -> str | None:
    """Return the fault of the folder that a killed process leaves, or None."""
    result = file_hashes(out)
    result = {name: sha for name, sha in result.items() if not name.startswith(".")}
    before = {name: sha for name, sha in earlier.items() if name != MANIFEST}
    if result == before and (out / MANIFEST).read_text(encoding="utf-8") == earlier[MANIFEST]:
        return None
    try:
        check_generation(out)
    except TrajectoryError:
        return None  # the folder is a mixture, and the check notices it
    listed = json.loads((out / MANIFEST).read_text(encoding="utf-8"))["files"]
    return None if listed == result else f"a mixture that is not noticed: {sorted(result)}"


def _said(
    number: signal.Signals, status: int, said: str, out: Path, earlier: dict[str, str]
) -> str | None:
    """Return the fault of a process that was asked to end, or None.

    The function judges its messages, its exit status and its folder.
    """
    begun = "] reading" in said
    if "Traceback" in said and begun:
        return f"traceback: {said[-300:]}"
    if status not in (0, STATUS[number]) and begun:
        return f"exit status {status}: {said[-300:]}"
    if list(out.parent.glob(".out-*")) or list(out.glob(".*")):
        return f"left behind: {sorted(path.name for path in out.glob('.*'))}"
    now = file_hashes(out) | {MANIFEST: (out / MANIFEST).read_text(encoding="utf-8")}
    if "unchanged" in said and now != earlier:
        return "said that earlier results are unchanged"
    check_generation(out)
    if (
        status == STATUS[number]
        and "unchanged" not in said
        and "completed before" not in said
        and begun
    ):
        return f"does not say what is left: {said[-300:]}"
    return None


def _orphans(mark: str) -> str | None:
    """Return a fault if processes with the mark in their environment live too long, or None."""
    end = time.monotonic() + ORPHANS
    while result := list(_marked(mark)):
        if time.monotonic() > end:
            return f"{len(result)} processes after {ORPHANS:g} s"
        time.sleep(0.05)
    return None


def _marked(mark: str) -> list[str]:
    expected = f"{MARK}={mark}\0".encode()
    result = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if expected in (folder / "environ").read_bytes() and ") Z " not in (
                folder / "stat"
            ).read_text(encoding="utf-8"):
                result.append(folder.name)
        except OSError:
            continue
    return result


def full_disk(stage: Stage, count: int, rng: random.Random) -> Row:
    """Limit the size of files. The program must report this with status 2 and change nothing."""
    counted = Count("no room for a file")
    for k in range(count):
        case = stage.folder / "case"
        shutil.rmtree(case, ignore_errors=True)
        out, words, earlier = _command(stage, case, KINDS[k % 4])
        sizes = [path.stat().st_size for path in stage.results[0].iterdir()]
        with (case / "stderr").open("wb") as stream:
            limit = rng.randrange(100, max(sizes))
            pipe = {"stderr": subprocess.PIPE}
            process = start(case, *words, limit=limit, streams=pipe)
            _, said = process.communicate(timeout=PATIENCE)
            stream.write(said)
        text = said.decode("utf-8", "replace")
        now = file_hashes(out) | {MANIFEST: (out / MANIFEST).read_text(encoding="utf-8")}
        fault = None
        if process.returncode == 0:
            fault = (
                None if (check_generation(out) is None) else "not whole"
            )  # no file that it writes is that large
        elif process.returncode != 2 or "Traceback" in text or "cannot be written" not in text:
            fault = f"exit status {process.returncode}: {text[-300:]}"
        elif now != earlier:
            fault = "changed the earlier results"
        counted.add(fault and f"{words[0]}, {limit} bytes: {fault}")
    return counted.row


def closed_streams(stage: Stage, count: int, rng: random.Random) -> Row:
    """Run commands with standard streams that are closed, full or end early."""
    counted = Count("closed and full streams")
    for k in range(count):
        plan = str(stage.results[0] / "plan.json")
        words = (
            ["check", plan],
            ["check", plan, "--json"],
            ["workspace", str(stage.folder / "problems/robots/vitreoretinal.yaml")],
        )[k % 3]
        how = ("<&-", ">&-", "2>&-", ">&- 2>&-", "> /dev/full", "2> /dev/full", "| head -c 1")[
            k % 7
        ]
        command = f'set -o pipefail; "$@" {how}'
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        if rng.random() < 0.5:
            environment |= {"PYTHONIOENCODING": "ascii", "LC_ALL": "C"}
        done = subprocess.run(
            ["bash", "-c", command, "bash", sys.executable, "-m", "ssm_planner", *words],
            cwd=stage.folder, env=environment, capture_output=True, timeout=PATIENCE,
        )  # fmt: skip
        said = done.stderr.decode("utf-8", "replace")
        bad = "Traceback" in said or "internal fault" in said or done.returncode in (1, 3)
        counted.add(
            f"{' '.join(words[:1])} {how}: exit status {done.returncode}: {said[-300:]}"
            if bad
            else None
        )
    return counted.row


def two_writers(stage: Stage, count: int, rng: random.Random) -> Row:
    """Write two plans into one folder at the same time.

    The folder must finally hold one of them completely.
    """
    counted = Count("two writers at once")
    for k in range(count):
        case = stage.folder / "case"
        shutil.rmtree(case, ignore_errors=True)
        case.mkdir()
        out = case / "out"
        if k % 2:
            shutil.copytree(stage.results[0], out)
        writers = []
        for problem in stage.problems:
            writers.append(start(case, "plan", str(problem), "-o", str(out)))
            time.sleep(rng.uniform(0.0, 0.1))
        ended = [writer.wait(PATIENCE) for writer in writers]
        plans = [(result / "plan.json").read_bytes() for result in stage.results]
        fault = None if ended == [0, 0] else f"exit status {ended}"
        try:
            check_generation(out)
        except TrajectoryError as error:
            fault = str(error)
        if (out / "plan.json").read_bytes() not in plans or sorted(file_hashes(out)) != sorted(
            file_hashes(stage.results[0])
        ):
            fault = f"neither of the plans: {sorted(file_hashes(out))}"
        counted.add(fault)
    return counted.row


def hostile_folders(stage: Stage, count: int, rng: random.Random) -> Row:
    """Plan problems whose names look like paths. Results must stay below the working directory."""
    counted = Count("hostile names of problems")
    for _ in range(count):
        name = rng.choice(NAMES)
        case = stage.folder / "case"
        shutil.rmtree(case, ignore_errors=True)
        folder = case / "a/b"
        folder.mkdir(parents=True)
        problem = stage.folder / "problems/hostile.yaml"
        problem.write_text(
            stage.problems[0].read_text(encoding="utf-8") + f"name: {json.dumps(name)}\n",
            encoding="utf-8",
        )
        process = start(folder, "plan", str(problem), streams={"stderr": subprocess.PIPE})
        _, said = process.communicate(timeout=PATIENCE)
        outside = [
            path
            for path in case.rglob("*")
            if path.is_file() and folder / "results" not in path.parents
        ]
        outside = [path for path in outside if folder / "cache" not in path.parents]
        fault = None
        if outside:
            fault = f"{name!r}: wrote {outside[0]}"
        elif process.returncode not in (0, 2) or b"Traceback" in said:
            fault = f"{name!r}: exit status {process.returncode}"
        counted.add(fault)
    return counted.row


def hostile_texts(count: int, rng: random.Random) -> Row:
    """Export robots with hostile names. A name must never become code, markup or a path."""
    import dataclasses

    counted = Count("hostile names of robots")
    robot = load_plan(ROOT / "results/tilt_insert").robot
    judges: tuple[Callable[[str], str | None], ...] = (_xml_fault, _c_fault, _path_fault)
    for k in range(count):
        name = "".join(rng.choice(NAMES) for _ in range(rng.randrange(1, 4)))
        hostile = dataclasses.replace(robot, name=name)
        text = (robot_urdf(hostile), robot_code(hostile)[k % 2], name)[k % 3]
        fault = judges[k % 3](text)
        counted.add(fault and f"{name!r}: {fault}")
    return counted.row


def _xml_fault(text: str) -> str | None:
    try:
        tags = [node.tag for node in ElementTree.fromstring(text)]
    except ElementTree.ParseError as error:
        return f"no XML: {error}"
    return None if tags.count("link") == 6 else f"other elements: {tags}"


def _c_fault(text: str) -> str | None:
    end = text.index("*/")
    comment = text[:end]
    odd = [word for word in ("\\\n", "??/", "/*") if word in comment[2:]]
    rest = text[end + 2 :].lstrip()
    return (
        f"{odd} in a comment"
        if odd
        else None
        if rest.startswith("#")
        else f"code behind it: {rest[:40]!r}"
    )


def _path_fault(text: str) -> str | None:
    result = file_name(text)
    return (
        None
        if Path(result).name == result and result not in ("", ".", "..")
        else f"a path: {result!r}"
    )

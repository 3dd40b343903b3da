"""Measure how many mutants of each part of the package its tests kill, and list the survivors.

    python -m tests.mutation --count 300 --seed 1 --rooms verification,retiming

Each part is measured in a separate process, and two processes run at a time. A mutant counts as
equivalent if `equivalent.json` lists it with a reason. The tests in `test_mutation.py` check this
list.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
EQUIVALENT = Path(__file__).with_name("equivalent.json")
PACKAGE = "ssm_planner"
ROOMS: dict[str, tuple[str, tuple[str, ...]]] = {
    "verification": ("verification", ("tests/verification", "tests/test_stopping.py")),
    "retiming": ("planning/retiming", ("tests/planning/retiming", "tests/planning/test_curves.py")),
    "formats": ("formats", ("tests/formats",)),
    "simulation": ("simulation", ("tests/simulation",)),
    "plans": (
        "plans.py",
        ("tests/test_plans.py", "tests/test_notebooks.py", "tests/formats/test_plan_file.py"),
    ),
}
"""Modules of each part of the package, and the tests that must kill its mutants."""

Row = dict[str, Any]


def equivalent() -> dict[tuple[str, str, str, str], str]:
    """Return the reasons why mutants are equivalent to the original, by the keys of the mutants."""
    entries = json.loads(EQUIVALENT.read_text(encoding="utf-8"))
    names = ("file", "function", "original", "mutated")
    return {tuple(entry[name] for name in names): entry["reason"] for entry in entries}  # type: ignore[misc]


def _work(name: str, count: int, seed: int, output: Path) -> None:
    """Measure one part of the package in this process and append each outcome to a file."""
    from tests.mutation.running import Outcome, Room, measure, sample

    place, tests = ROOMS[name]
    path = ROOT / PACKAGE / place
    room = Room(name, tuple(sorted(path.rglob("*.py"))) or (path,), tests, ROOT)
    drawn = sample(room, count, seed)
    listed = equivalent()

    def note(outcome: Outcome) -> None:
        row = dataclasses.asdict(outcome) | {"room": name}
        with output.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(row) + "\n")

    measure(room, [mutant for mutant in drawn if mutant.key not in listed], note)
    for mutant in drawn:
        if mutant.key in listed:
            note(Outcome(mutant, "equivalent", 0, 0.0))


def _room(name: str, count: int, seed: int, folder: Path) -> tuple[list[Row], float]:
    """Measure one part of the package in a new process.

    Return the outcomes and the CPU time in s.
    """
    output = folder / f"{name}.jsonl"
    command = [sys.executable, "-m", "tests.mutation", "--room", name, "--output", str(output)]
    command += ["--count", str(count), "--seed", str(seed)]
    process = subprocess.Popen(command, cwd=ROOT)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{name}: exit status {process.returncode}")
    rows = [json.loads(line) for line in output.read_text(encoding="utf-8").splitlines()]
    return rows, usage.ru_utime + usage.ru_stime


def _difference(row: Row) -> str:
    mutant = row["mutant"]
    lines = [f"-{line}" for line in mutant["original"].splitlines()]
    lines += [f"+{line}" for line in mutant["mutated"].splitlines()]
    where = f"`{mutant['file']}:{mutant['line']}` in `{mutant['function']}`"
    covered = "" if row["covering"] else ", which no test runs"
    return "\n".join([f"{where}{covered}", "", "```diff", *lines, "```", ""])


def report(rooms: dict[str, tuple[list[Row], float]], count: int, seed: int) -> str:
    """Return the kill rates and the survivors of all parts as Markdown."""
    text = ["# Mutants", ""]
    text += [
        f"`make mutants MUTANTS='--count {count} --seed {seed}'` changed one operation of the",
        "package at a time and ran the tests that execute it. A mutant is killed when one of",
        "them fails. Equivalent mutants cannot be told from the original; the reason stands in",
        "`tests/mutation/equivalent.json`. The rate leaves them out.",
        "",
        "| room | mutants | equivalent | killed | rate |",
        "|---|---|---|---|---|",
    ]
    survivors = []
    for name, (rows, _) in rooms.items():
        same = sum(row["killer"] == "equivalent" for row in rows)
        alive = [row for row in rows if row["killer"] is None]
        killed = len(rows) - same - len(alive)
        rate = killed / max(len(rows) - same, 1)
        text.append(f"| {name} | {len(rows)} | {same} | {killed} | {rate:.0%} |")
        survivors += [f"### {name}", "", *map(_difference, alive)] if alive else []
    minutes = sum(seconds for _, seconds in rooms.values()) / 60
    text += ["", f"It took {minutes:.0f} minutes of CPU.", "", "## Survivors", ""]
    return "\n".join([*text, *(survivors or ["None.", ""])])


def main() -> None:
    """Measure the parts of the package and write the report.

    With the option `--room`, measure only one part, as the child process of such a run does.
    """
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--count", type=int, default=300, help="mutants of all rooms together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rooms", default=",".join(ROOMS), help=f"of {', '.join(ROOMS)}")
    parser.add_argument("--output", type=Path, default=ROOT / "results/mutants.md")
    parser.add_argument("--room", choices=ROOMS, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.room:
        _work(arguments.room, arguments.count, arguments.seed, arguments.output)
        return
    names = arguments.rooms.split(",")
    if unknown := [name for name in names if name not in ROOMS]:
        parser.error(f"--rooms: {unknown[0]} is none of {', '.join(ROOMS)}")
    share = max(arguments.count // len(names), 1)
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:
        jobs = [pool.submit(_room, n, share, arguments.seed, Path(folder)) for n in names]
        rooms = {name: job.result() for name, job in zip(names, jobs, strict=True)}
    rows = [row for measured, _ in rooms.values() for row in measured]
    arguments.output.write_text(report(rooms, arguments.count, arguments.seed), encoding="utf-8")
    log = arguments.output.with_suffix(".jsonl")
    if os.environ.get("MUTANTS_LOG"):
        log.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    print(f"{arguments.output}: {sum(r['killer'] is None for r in rows)} survivors of {len(rows)}")


if __name__ == "__main__":
    main()

"""Measure time and memory of commands on a long mission.

    python -m tests.benchmarks.bench_long [PHASES]

The default is 200 phases. Every row is a command in a process of its own. The time is CPU time
including that of the children, and the memory is the largest of any of its processes.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.support.cli import environment
from tests.support.paths import PROBLEMS, ROOT

MOTIONS = (
    "tilt: {to: -135 deg}",
    "insert: {to: 20 mm}",
    "insert: {to: 0 mm}",
    "tilt: {to: -85 deg}",
)


def mission(count: int) -> str:
    """Return the text of a problem with `count` straight motions, based on the shipped problem."""
    text = (PROBLEMS / "tilt_insert.yaml").read_text(encoding="utf-8")
    before, _, rest = text.partition("motion:\n")
    after = rest[rest.index("limits:") :]
    robot = str(PROBLEMS / "robots/vitreoretinal.yaml")
    motions = "".join(f"  - {MOTIONS[k % 4]}\n" for k in range(count))
    return f"{before.replace('robots/vitreoretinal.yaml', robot)}motion:\n{motions}{after}planner: fast\n"


def measured(*words: object) -> tuple[float, float]:
    """Return CPU time in s and peak memory in MB of a command."""
    process = subprocess.Popen(
        [sys.executable, "-m", "ssm_planner", *map(str, words)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=ROOT,
        env=environment(),
    )
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{words}: exit status {os.waitstatus_to_exitcode(status)}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        problem = folder / "mission.yaml"
        problem.write_text(mission(count), encoding="utf-8")
        commands: dict[str, tuple[object, ...]] = {
            "plan": ("plan", problem, "-o", folder / "plan"),
            "check": ("check", folder / "plan"),
            "size": ("size", folder / "plan"),
            **{
                f"export --to {kind}": (
                    "export",
                    folder / "plan",
                    "--to",
                    kind,
                    "-o",
                    folder / kind,
                )
                for kind in ("csv", "epos4")
            },
        }
        print("| command | CPU s | MB |\n|---|---|---|")
        for label, words in commands.items():
            seconds, megabytes = measured(*words)
            print(f"| `{label}` | {seconds:.1f} | {megabytes:.0f} |", flush=True)


if __name__ == "__main__":
    main()

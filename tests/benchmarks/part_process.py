"""Compare CPU time and memory of a plan in a fresh process with those of the imports alone."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

from tests.benchmarks.cases import PROBLEM, ROOT
from tests.benchmarks.measuring import Spread
from tests.benchmarks.section import Section

IMPORTS = "import casadi, matplotlib.pyplot"
TIMES, MEGABYTES = 1.5, 500.0

LAUNCHER = (
    "import resource, subprocess, sys\n"
    "done = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL)\n"
    "spent = resource.getrusage(resource.RUSAGE_CHILDREN)\n"
    "print(spent.ru_utime + spent.ru_stime, spent.ru_maxrss)\n"
    "sys.exit(done.returncode)"
)
"""Source of a small intermediate process.

A process starts with the peak memory of the process that forked it, so the parent must be small.
"""


def run(quick: bool) -> Section:
    section = Section("The first plan in a fresh process")
    section.say(
        f"`ssm-planner plan problems/{PROBLEM.name}` with all its output, beside `python -c '{IMPORTS}'`, in turns: CPU "
        "time of the process and of those it starts, and their peak resident set. Both find their modules compiled to "
        "bytecode, as an installed package has them."
    )
    imports = [sys.executable, "-c", IMPORTS]
    plan = [sys.executable, "-m", "ssm_planner", "plan", str(PROBLEM), "-o"]
    taken: dict[str, list[tuple[float, float]]] = {"imports": [], "plan": []}
    with tempfile.TemporaryDirectory() as folder:
        environment = {
            key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"
        }
        environment["PYTHONPYCACHEPREFIX"] = f"{folder}/bytecode"
        _process(imports, environment)
        _process([*plan, f"{folder}/first"], environment)
        for k in range(3 if quick else 7):
            taken["imports"].append(_process(imports, environment))
            taken["plan"].append(_process([*plan, f"{folder}/{k}"], environment))
    base = Spread.of([seconds for seconds, _ in taken["imports"]])
    rows = []
    for name, label in (("imports", "imports alone"), ("plan", "plan")):
        seconds = Spread.of([s for s, _ in taken[name]])
        memory = Spread.of([m for _, m in taken[name]])
        ratio = seconds.over(Spread(base.values[: len(seconds.values)]))
        rows.append(
            [
                label,
                seconds.seconds(),
                "" if name == "imports" else ratio.times(),
                memory.text("MB"),
            ]
        )
        if name == "plan":
            section.asked(
                "first plan in a fresh process, all output",
                f"≤ {TIMES:g} × the imports",
                ratio.times(),
                ratio.median <= TIMES,
            )
            section.asked(
                "memory of a plan",
                f"≤ {MEGABYTES:g} MB",
                memory.text("MB"),
                max(memory.values) <= MEGABYTES,
            )
    section.table(("", "time", "÷ imports", "memory"), rows)
    return section


def _process(command: list[str], environment: dict[str, str]) -> tuple[float, float]:
    """Return CPU time in s and peak memory in MB of a command that must succeed."""
    done = subprocess.run(
        [sys.executable, "-c", LAUNCHER, *command],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)} failed: {done.stderr[-500:]}")
    seconds, kilobytes = done.stdout.split()[-2:]
    return float(seconds), float(kilobytes) / 1024

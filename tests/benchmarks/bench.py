"""Compare this planner with others in one run on one machine, and write results/benchmarks.md.

    python -m tests.benchmarks.bench [--quick] [--only PART …] [--recordings DIR] [-o FILE]

Every part runs in a process of its own, so that the memory or a crash of one part does not affect
another. Figures that miss their targets are marked. The exit status is 1 if a part could not run.
"""

from __future__ import annotations

import os

# Every program uses one thread, so that the number of cores has no effect.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import argparse
import importlib
import importlib.metadata
import json
import platform
import subprocess
import sys
import tempfile
import time
from datetime import datetime, timezone
from pathlib import Path

from tests.benchmarks.section import Section, table_lines
from tests.support.paths import ROOT

PARTS = (
    "same_problem",
    "same_path",
    "rest_to_rest",
    "kinematics",
    "identification",
    "stages",
    "structured",
    "growth",
    "process",
    "simulation",
)
PEERS = ("rockit-meco", "toppra", "copp-py", "ruckig", "pin")
PACKAGES = ("ssm-planner", "casadi", "numpy", "scipy", "matplotlib", *PEERS)
LONGEST = 900.0
"""Time in s after which a part is stopped."""


def run_part(name: str, quick: bool) -> tuple[Section, str]:
    """Run a part in its own process, and return its section and the reason why it failed."""
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "section.json"
        command = [
            sys.executable,
            "-m",
            "tests.benchmarks.bench",
            "--part",
            name,
            "--answer",
            str(answer),
        ] + ["--quick"] * quick
        try:
            done = subprocess.run(
                command,
                check=False,
                timeout=LONGEST,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
        except subprocess.TimeoutExpired:
            return Section(name), f"given up after {LONGEST:g} s"
        if done.returncode != 0 or not answer.is_file():
            last = (done.stderr.strip().splitlines() or ["no word"])[-1]
            return Section(name), f"ended with {done.returncode}: {last}"
        return Section.from_dict(json.loads(answer.read_text(encoding="utf-8"))), ""


def document(sections: list[tuple[Section, str]], quick: bool, seconds: float) -> str:
    lines = [
        "# Benchmarks",
        "",
        f"Written by `make bench`{' (quick)' if quick else ''} in {seconds / 60:.1f} minutes. "
        "Medians with the range in brackets; ways of one table take turns in one run, ratios are of the same turn. "
        "One thread each.",
        "",
        "## What was asked",
        "",
    ]
    figures = [figure for section, _ in sections for figure in section.figures]
    rows = [[f.what, f.asked, f.found, "yes" if f.reached else "**MISSED**"] for f in figures]
    lines += [*table_lines(("figure", "asked", "found", "reached"), rows), ""]
    losses = [loss for section, _ in sections for loss in section.losses]
    lines += [
        "## Where others are better",
        "",
        *(f"* {loss}" for loss in losses or ["nowhere in what was measured"]),
        "",
    ]
    for section, fault in sections:
        lines += (
            section.lines()
            if not fault
            else [f"## {section.title}", "", f"Not measured: {fault}", ""]
        )
    return "\n".join([*lines, *machine_lines()])


def machine_lines() -> list[str]:
    versions = []
    for package in PACKAGES:
        try:
            versions.append([package, importlib.metadata.version(package)])
        except importlib.metadata.PackageNotFoundError:
            versions.append([package, "not installed"])
    memory = (
        os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
        if hasattr(os, "sysconf")
        else 0.0
    )
    load = f", load {os.getloadavg()[0]:.1f} at the end" if hasattr(os, "getloadavg") else ""
    return [
        "## Machine and versions",
        "",
        f"{processor()}, {os.cpu_count()} cores, {memory:.0f} GB, {platform.system()} {platform.machine()}, "
        f"Python {platform.python_version()}; {datetime.now(timezone.utc):%Y-%m-%d}{load}.",
        "",
        *table_lines(("package", "version"), versions),
        "",
    ]


def processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def main() -> int:
    parser = argparse.ArgumentParser(description="This planner beside others.")
    parser.add_argument("--quick", action="store_true", help="fewer motions and rounds")
    parser.add_argument(
        "--only", nargs="+", choices=PARTS, metavar="PART", help=f"of {', '.join(PARTS)}"
    )
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "results/benchmarks.md")
    parser.add_argument(
        "--recordings",
        type=Path,
        default=ROOT.parent / "shared/recordings",
        help="of the three rigs",
    )
    parser.add_argument("--part", choices=PARTS, help=argparse.SUPPRESS)
    parser.add_argument("--answer", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        section = importlib.import_module(f"tests.benchmarks.part_{options.part}").run(
            options.quick
        )
        options.answer.write_text(json.dumps(section.to_dict()), encoding="utf-8")
        return 0
    os.environ["BENCH_RECORDINGS"] = str(options.recordings)
    begin = time.perf_counter()
    sections = []
    for name in options.only or PARTS:
        start = time.perf_counter()
        section, fault = run_part(name, options.quick)
        sections.append((section, fault))
        print(f"{name}: {fault or 'done'} ({time.perf_counter() - start:.0f} s)", file=sys.stderr)
    text = document(sections, options.quick, time.perf_counter() - begin)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    unfinished = options.output.with_suffix(".unfinished")
    unfinished.write_text(text, encoding="utf-8")
    unfinished.replace(options.output)
    for section, _ in sections:
        for figure in section.figures:
            print(
                f"{'' if figure.reached else 'MISSED  '}{figure.what}: {figure.found} (asked {figure.asked})"
            )
    print(f"Results: {options.output}")
    return int(any(fault for _, fault in sections))


if __name__ == "__main__":
    sys.exit(main())

"""Run all campaigns on two processes and write their tables to results/campaign.md.

    python -m tests.campaign [--minutes N] [--full] [--seed N]

The file has one section for each campaign and contains no times or dates. Campaigns that do not run
keep their sections. The exit status is 1 if a case failed.
"""

from __future__ import annotations

import argparse
import importlib
import multiprocessing
import re
import sys
import time
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from .rows import ROOT, Row, one

HERE = Path(__file__).parent
SHARED = {"__init__", "__main__", "rows"}
SHARES = {"processes": 2.0}
"""Weights of the campaigns in the division of the time. The default is 1."""
SLICE = {"processes": 8, "opinions": 4, "adversary": 300, "executions": 150}
"""Number of cases of one task. The default is 100.

Every campaign runs at least one task in each process.
"""
FULL = {
    "adversary": 10_200,
    "healthy": 5_000,
    "mutated": 20_400,
    "tampered": 3_600,
    "violations": 7_600,
    "processes": 560,
    "opinions": 400,
    "executions": 4_800,
}
"""Number of cases with --full.

The numbers are slightly above the required ones, because the fractions of the kinds are rounded
down.
"""
WORKERS = 2
OUT = ROOT / "results/campaign.md"
HEAD = """# Campaign

Random cases of every kind; `make campaign` makes this file. How many there are depends on the time given and on the machine,
or with `--full` on what is asked for.
"""


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="campaign", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="for everything (default 60)")
    parser.add_argument("--full", action="store_true", help=f"as many cases as it takes: {FULL}")
    parser.add_argument("--cases", type=int, help=f"of one task (default 100, or {SLICE})")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", help="modules of this folder")
    parser.add_argument("-o", "--output", type=Path, default=OUT)
    options = parser.parse_args(words)
    names = options.only or sorted(
        path.stem for path in HERE.glob("*.py") if path.stem not in SHARED
    )
    complete = sum(SHARES.get(name, 1.0) for name in names)
    failures: list[Row] = []
    for name in names:
        seconds = 60 * options.minutes * SHARES.get(name, 1.0) / complete
        size = options.cases or SLICE.get(name, 100)
        rows = campaign(name, options.seed, None if options.full else seconds, size)
        failures += [row for row in rows if row.failures]
        module = importlib.import_module(f"{__package__}.{name}")
        text = getattr(module, "section", section)(rows, options.seed)
        publish(options.output, name, text)
    print(options.output.read_text(encoding="utf-8"), flush=True)
    # the failures are repeated, because readers often see only the end of a log
    for row in failures:
        print(
            f"FAILED {row.kind}: {row.failures} of {row.cases}",
            *row.examples,
            sep="\n  ",
            file=sys.stderr,
        )
    return 1 if failures else 0


def campaign(name: str, seed: int, seconds: float | None, size: int) -> list[Row]:
    """Run tasks of `size` cases of one module, each with its own seed, and return the sums.

    The number of tasks follows from the time, or from FULL if `seconds` is None. Every process runs
    at least one task.
    """
    start, started, cases = time.monotonic(), 0, 0
    sums: dict[str, Row] = {}
    running: list[Future[tuple[list[Row], float]]] = []
    pool = ProcessPoolExecutor(WORKERS, multiprocessing.get_context("spawn"))
    longest, died = 0.0, 0
    while True:
        while len(running) < WORKERS:
            left = (
                FULL[name] - cases
                if seconds is None
                else seconds - (time.monotonic() - start) - longest
            )
            if (left <= 0 and started >= WORKERS) or died > 2:
                break
            # The factor keeps the seeds of different campaigns apart.
            running.append(pool.submit(one, name, size, 100_000 * seed + started))
            started, cases = started + 1, cases + size
        if not running:
            pool.shutdown()
            return list(sums.values())
        try:
            rows, took = running.pop(0).result()
            longest = max(longest, took)
        except BrokenProcessPool:
            died += 1
            rows, running = (
                [Row(f"{name}: a process died", 1, 1, (f"slice {started - 1} or one before it",))],
                [],
            )
            pool = ProcessPoolExecutor(WORKERS, multiprocessing.get_context("spawn"))
        for row in rows:
            old = sums.get(row.kind, Row(row.kind, 0, 0, ()))
            examples = (*old.examples, *row.examples)[:5]
            sums[row.kind] = Row(
                row.kind, old.cases + row.cases, old.failures + row.failures, examples
            )
        print(
            *(example for row in rows for example in row.examples),
            sep="\n",
            file=sys.stderr,
            end="",
        )
        failed = sum(row.failures for row in sums.values())
        print(
            f"{name}: {cases} cases begun, {failed} failed, {time.monotonic() - start:.0f} s",
            file=sys.stderr,
            flush=True,
        )


def publish(path: Path, name: str, text: str) -> None:
    """Put the section of a campaign into the file of results."""
    path.parent.mkdir(parents=True, exist_ok=True)
    old = path.read_text(encoding="utf-8") if path.is_file() else ""
    sections = dict(re.findall(r"^## (\w+)\n+(.*?)(?=^## |\Z)", old, re.S | re.M)) | {name: text}
    parts = [HEAD, *(f"## {item}\n\n{sections[item].strip()}\n" for item in sorted(sections))]
    path.write_text("\n".join(parts), encoding="utf-8")


def section(rows: list[Row], seed: int) -> str:
    """Return the results of one campaign as Markdown."""
    lines = [
        f"Seed {seed}.",
        "",
        "| kind | cases | failed |",
        "|---|---:|---:|",
        *(f"| {row.kind} | {row.cases} | {row.failures} |" for row in rows),
        f"| together | {sum(row.cases for row in rows)} | {sum(row.failures for row in rows)} |",
        "",
    ]
    for row in (row for row in rows if row.failures):
        failures = (" ".join(text.replace("`", "'").split())[:300] for text in row.examples)
        lines += [f"* {row.kind}:", *(f"  * `{text}`" for text in failures)]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())

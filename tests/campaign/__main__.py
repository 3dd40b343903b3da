"""`python -m tests.campaign [--minutes N] [--seed N]`: every campaign for a share of the time, and their table.

It writes results/campaign.md: no times or dates in it. Exit status 1 where something failed.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from pathlib import Path

from .rows import ROOT, Row

HERE = Path(__file__).parent
SHARED = {"__init__", "__main__", "rows"}
SHARES = {"processes": 2.0}
"""Of the time, where not 1."""
FIRST = {"processes": 10}
"""Cases of the first round, where not 40."""
OUT = ROOT / "results/campaign.md"


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="campaign", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="for everything (default 60)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", help="modules of this folder")
    parser.add_argument("-o", "--output", type=Path, default=OUT)
    options = parser.parse_args(words)
    names = options.only or sorted(path.stem for path in HERE.glob("*.py") if path.stem not in SHARED)
    whole = sum(SHARES.get(name, 1.0) for name in names)
    rows: list[Row] = []
    for name in names:
        seconds = 60 * options.minutes * SHARES.get(name, 1.0) / whole
        rows += campaign(name, seconds, options.seed)
    text = table(rows, options.seed)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(text, encoding="utf-8")
    print(text)
    return 1 if any(row.failures for row in rows) else 0


def campaign(name: str, seconds: float, seed: int) -> list[Row]:
    """Rounds of one module, each with a seed of its own, as many as the time allows; their sums."""
    module = importlib.import_module(f"{__package__}.{name}")
    begin, count, done = time.monotonic(), FIRST.get(name, 40), 0
    sums: dict[str, Row] = {}
    while True:
        before = time.monotonic()
        for row in module.run(count, seed + done):
            old = sums.get(row.kind, Row(row.kind, 0, 0, ()))
            examples = (*old.examples, *row.examples)[:5]
            sums[row.kind] = Row(row.kind, old.cases + row.cases, old.failures + row.failures, examples)
        done += 1
        took, left = time.monotonic() - before, seconds - (time.monotonic() - begin)
        print(f"{name}: round {done}, {count} cases, {took:.0f} s, {left:.0f} s left", file=sys.stderr, flush=True)
        if left < took:
            return list(sums.values())
        count = min(max(count, int(count * left / took / 4)), 50 * count)


def table(rows: list[Row], seed: int) -> str:
    """The results as Markdown."""
    lines = [
        "# Campaign",
        "",
        f"Random cases of every kind, seed {seed}; `make campaign` makes this file. How many there are depends on the time "
        "given and on the machine.",
        "",
        "| kind | cases | failed |",
        "|---|---:|---:|",
        *(f"| {row.kind} | {row.cases} | {row.failures} |" for row in rows),
        f"| together | {sum(row.cases for row in rows)} | {sum(row.failures for row in rows)} |",
        "",
    ]
    failed = [row for row in rows if row.failures]
    lines += ["## What failed", ""] if failed else ["Nothing failed.", ""]
    for row in failed:
        lines += [
            f"* {row.kind}:",
            *(f"  * `{' '.join(text.replace('`', chr(39)).split())[:300]}`" for text in row.examples),
        ]
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    sys.exit(main())

"""Measure how often the intervals of separable parameters contain the true values.

    python -m tests.benchmarks.bench_coverage [FITS] [auto|given] [SEED] [ends of names of cases …]

The program fits many synthetic maps for every friction law. Each mean torque has noise of 1 % of
the range. A table of the results so far follows every TOLD rounds of one fit per case. The exit
status is 1 if a fraction is outside ASKED.
"""

from __future__ import annotations

import os
import sys
from collections import defaultdict

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from tests.identification.test_fit import CASES, covered

ASKED = (0.92, 0.98)
TOLD = 10


def main(fits: int = 300, told: str = "auto", seed: int = 7, *words: str) -> int:
    cases = [case for case in CASES if not words or case.endswith(words)]
    draws = {case: np.random.default_rng([seed, list(CASES).index(case)]) for case in cases}
    result: dict[tuple[str, str], list[bool]] = defaultdict(list)
    for done in range(1, fits + 1):
        for case in cases:
            for name, hit in covered(case, told, draws[case]).items():
                result[case, name].append(hit)
        if done % TOLD == 0 or done == fits:
            print(f"\n{done} fits of each case, law {told}: covered of those called separable")
            for case in cases:
                shares = [
                    f"{n} {np.mean(hits):.3f} of {len(hits)}"
                    for (c, n), hits in result.items()
                    if c == case
                ]
                print(f"{case:32} {', '.join(shares) or 'none'}", flush=True)
    return int(any(not ASKED[0] <= np.mean(hits) <= ASKED[1] for hits in result.values()))


if __name__ == "__main__":
    sys.exit(main(*(int(a) if a.isdigit() else a for a in sys.argv[1:])))

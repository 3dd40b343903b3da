"""Studies: closed-form screening, what store and engine cost, workers, a large store, Dask; run it as a script.

Ratios and rates of one run; the machine is said to be noisy, so each is the median of three.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Executor, wait
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from ssm_planner.studies.page import write_study_page
from ssm_planner.studies.screens import Screens
from ssm_planner.studies.store import Candidate, Store, key_of, pareto
from ssm_planner.studies.study_file import load_study
from ssm_planner.studies.workers import Workers

FILE = Path(__file__).parents[2] / "problems" / "studies" / "vitreoretinal.yaml"


def median(run: Callable[[], float], times: int = 3) -> float:
    return statistics.median(run() for _ in range(times))


def screening(count: int = 40_000) -> float:
    """Candidates per second of processor time, one process."""
    study = load_study(FILE)
    screens = Screens(study)
    designs = [study.design(place) for place in np.random.default_rng(0).random((count, len(study.vary)))]
    screens.fallen(designs[:100])

    def run() -> float:
        begin = time.process_time()
        screens.fallen(designs)
        return count / (time.process_time() - begin)

    return median(run)


def overhead(tasks: int = 60, seconds: float = 0.2) -> float:
    """Share of the time that workers and store add to evaluations that take 0.2 s, two workers."""

    def run() -> float:
        with tempfile.TemporaryDirectory() as folder, Store(Path(folder) / "s.sqlite") as store, Workers(2) as workers:
            wait([workers.submit(abs, -1) for _ in range(4)])  # they have started
            begin = time.perf_counter()
            store.add((i, str(i), {"x": str(i)}) for i in range(tasks))
            futures = [workers.submit(time.sleep, seconds) for _ in range(tasks)]
            for i, future in enumerate(futures):
                future.result()
                store.put([(str(i), Candidate(i, "done", {}, figures={"duration": 1.0}))])
            return (time.perf_counter() - begin) / (tasks / 2 * seconds) - 1

    return median(run)


def resuming(rows: int = 100_000) -> tuple[float, float, float]:
    """Seconds of processor time to open a store of so many rows and find what is left, and to make its page; MB of page."""
    study = load_study(FILE)
    rng = np.random.default_rng(1)
    designs = [study.design(place) for place in rng.random((rows, len(study.vary)))]
    values = rng.random((rows, 2)).tolist()
    found = [
        Candidate(i, "done", design, figures={"duration": a, "motor_mass": b})
        for i, (design, (a, b)) in enumerate(zip(designs, values, strict=True))
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "s.sqlite"
        keys = [key_of(design, "context") for design in designs]
        with Store(path) as store:
            store.add(zip(range(rows), keys, designs, strict=True))
            store.put(zip(keys, found, strict=True))
        begin = time.process_time()
        with Store(path) as store:
            store.add(zip(range(rows), [key_of(design, "context") for design in designs], designs, strict=True))
            store.waiting(keys)
        resumed = time.process_time() - begin
        begin = time.process_time()
        page = Path(folder) / "page.html"
        write_study_page(study, (found[0], *found), pareto(found, study.minimise), page, finished=True)
        return resumed, time.process_time() - begin, page.stat().st_size / 1e6


def rate(executor: Executor, tasks: int) -> float:
    """No-op tasks per second."""
    wait([executor.submit(abs, -i) for i in range(20)])
    begin = time.perf_counter()
    wait([executor.submit(abs, -i) for i in range(tasks)])
    return tasks / (time.perf_counter() - begin)


def main() -> None:
    print(f"screened in closed form: {screening():.0f} per second and core (20 000 asked)")
    print(f"store and engine beside 0.2 s evaluations: {100 * overhead():.2f} % (2 % asked)")
    resumed, page, size = resuming()
    print(f"10⁵ rows: {resumed:.2f} s to resume (2 s asked), {page:.2f} s for the page (5 s asked), {size:.1f} MB")
    with Workers(2) as workers:
        print(f"no-op tasks through two workers: {median(lambda: rate(workers, 2000)):.0f} per second")
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        return
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        print(
            f"no-op tasks through Dask: {median(lambda: rate(client.get_executor(), 2000)):.0f} per second (500 asked)"
        )


if __name__ == "__main__":
    main()

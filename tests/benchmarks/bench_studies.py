"""Measure screening, overhead of store and workers, a large store, and Dask in studies.

Run this module as a script. The figures are ratios and rates of one run. Because machines are
noisy, the repeated measurements are medians of three.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Executor, wait
from dataclasses import replace
from pathlib import Path

import numpy as np

from ssm_planner.studies import run
from ssm_planner.studies.evaluation import Evaluation
from ssm_planner.studies.page import write_study_page
from ssm_planner.studies.screens import Screens
from ssm_planner.studies.store import Candidate, Store, candidate_key
from ssm_planner.studies.study import Design, Requirements, Search
from ssm_planner.studies.study_file import load_study
from ssm_planner.studies.workers import Workers
from tests.benchmarks.faults_studies import FILE, cluster, free_port
from tests.support.paths import ROOT

ROWS = 100_000


def median(run: Callable[[], float], times: int = 3) -> float:
    return statistics.median(run() for _ in range(times))


def screening(count: int = 40_000) -> float:
    """Return the number of candidates that one process screens per second of CPU time."""
    study = load_study(FILE)
    screens = Screens(study)
    designs = [
        study.design(place) for place in np.random.default_rng(0).random((count, len(study.vary)))
    ]
    screens.reject(designs[:100])

    def run() -> float:
        start = time.process_time()
        screens.reject(designs)
        return count / (time.process_time() - start)

    return median(run)


def overhead(tasks: int = 60, seconds: float = 0.2) -> float:
    """Return the relative time that store and two workers add to evaluations of 0.2 s."""

    def run() -> float:
        with (
            tempfile.TemporaryDirectory() as folder,
            Store(Path(folder) / "s.sqlite") as store,
            Workers(2) as workers,
        ):
            wait([workers.submit(abs, -1) for _ in range(4)])  # until the workers have started
            start = time.perf_counter()
            store.add_candidates((i, str(i), {"x": str(i)}) for i in range(tasks))
            futures = [workers.submit(time.sleep, seconds) for _ in range(tasks)]
            for i, future in enumerate(futures):
                future.result()
                store.write_results([(str(i), Candidate(i, "done", {}, figures={"duration": 1.0}))])
            return (time.perf_counter() - start) / (tasks / 2 * seconds) - 1

    return median(run)


class NoOp(Evaluation):
    """Evaluation that does nothing and returns invented figures."""

    def __call__(self, number: int, design: Design) -> Candidate:
        figures = {"duration": 5.0 + number % 97, "motor_mass": 1.0 + number % 89}
        return Candidate(number, "done", design, figures=figures)


def rate(executor: Executor, folder: Path, candidates: int = 20_000) -> float:
    """Return the candidates per second of a study whose evaluations do nothing.

    The time runs from the first screening to the last result in the store.
    """
    run.Evaluation = NoOp
    study = replace(
        load_study(FILE), require=Requirements(), motions={}, search=Search("sobol", candidates, 1)
    )
    wait([executor.submit(abs, -i) for i in range(20)])
    with Store(folder / run.STORE_FILE) as store:
        start = time.perf_counter()
        run.StudyRunner(
            study, store, executor, run.QUEUED_BATCHES_FOR_EXECUTOR, lambda *_: None
        ).run()
        taken = time.perf_counter() - start
        assert {state for _, state in store.states().values()} == {"done"}
    return candidates / taken


def calls(executor: Executor, count: int = 2000) -> float:
    """Return the number of calls per second that do nothing. Each call is a task of its own."""
    start = time.perf_counter()
    wait([executor.submit(abs, -i) for i in range(count)])
    return count / (time.perf_counter() - start)


def resuming(folder: Path) -> tuple[float, float, float]:
    """Return CPU times in s for a store in which all is done, and the size of its page in MB.

    The first time is that of resuming the study, the second that of writing the page.
    """
    study = replace(
        load_study(FILE), require=Requirements(), motions={}, search=Search("sobol", ROWS, 1)
    )
    description = run.describe_study(study)
    context = run.context_hash(description)
    rng = np.random.default_rng(1)
    figures = [
        dict(zip(study.minimise, pair, strict=True)) for pair in rng.random((ROWS, 2)).tolist()
    ]
    done = [
        Candidate(i, "done", design, figures=item)
        for i, (design, item) in enumerate(zip(study.designs(), figures, strict=True))
    ]
    with Store(folder / run.STORE_FILE) as store:
        store.set_description(description, context)
        for chunk in ([Candidate(run.ORIGINAL_NUMBER, "done", {})], done):
            keys = [candidate_key(row.design, context) for row in chunk]
            store.add_candidates(
                (row.number, key, row.design) for key, row in zip(keys, chunk, strict=True)
            )
            store.write_results(zip(keys, chunk, strict=True))
    start = time.process_time()
    with Workers(1) as workers, Store(folder / run.STORE_FILE) as store:
        run.StudyRunner(study, store, workers, run.QUEUED_BATCHES_PER_WORKER, lambda *_: None).run()
    resumed = time.process_time() - start
    start = time.process_time()
    page = folder / "page.html"
    write_study_page(study, (done[0], *done), page, finished=True)
    return resumed, time.process_time() - start, page.stat().st_size / 1e6


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print(f"screened in closed form: {screening():.0f} per second and core (20 000 asked)")
        print(f"store and engine beside 0.2 s evaluations: {100 * overhead():.2f} % (2 % asked)")
        resumed, page, size = resuming(folder / "large")
        print(
            f"10⁵ rows: {resumed:.2f} s to resume (2 s asked), {page:.2f} s for the page (5 s asked), {size:.1f} MB"
        )
        with Workers(2) as workers:
            print(
                f"no-op calls through two workers: {median(lambda: calls(workers)):.0f} per second"
            )
            print(
                f"no-op evaluations through two workers: {rate(workers, folder / 'local'):.0f} per second"
            )
        try:
            from distributed import Client
        except ImportError:
            return
        with cluster(2, free_port()) as (address, _, _), Client(address, timeout="30s") as client:
            client.wait_for_workers(2, timeout=60)
            print(
                f"no-op calls through Dask: {median(lambda: calls(client.get_executor())):.0f} per second"
            )
            result = rate(client.get_executor(retries=3), folder / "dask")
            print(f"no-op evaluations through Dask: {result:.0f} per second (500 asked)")


if __name__ == "__main__":
    os.environ["PYTHONPATH"] = str(ROOT)
    from tests.benchmarks import bench_studies  # import under a name that workers also find

    bench_studies.main()

"""Interrupt studies by killing workers, the driver or the scheduler.

Run this module as a script. It includes Dask where it is installed. Every case must end with
exactly the table of an undisturbed run. The number of evaluations shows that none is lost and that
none in the store is repeated.
"""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from ssm_planner.studies.run import study
from ssm_planner.studies.store import Store
from ssm_planner.studies.study import Search, Study
from ssm_planner.studies.study_file import load_study
from ssm_planner.studies.workers import Workers
from tests.studies.support import pids
from tests.support.paths import ROOT

FILE = ROOT / "problems" / "studies" / "vitreoretinal.yaml"
POINTS = 48
EVERY = 5.0
"""Time in s between kills."""
DASK = (
    [sys.executable, "-m", "distributed.cli.dask_scheduler"],
    [sys.executable, "-m", "distributed.cli.dask_worker"],
)
DRIVER = (
    "import sys; sys.path.insert(0, sys.argv[1])\n"
    "from tests.benchmarks.faults_studies import driver; driver(*sys.argv[2:])"
)


def problem() -> Study:
    """Return the shipped study with the motion tilt_insert only and few points.

    It takes half a minute.
    """
    of = load_study(FILE)
    motions = {"tilt_insert": {**of.motions["tilt_insert"], "planner": "toppra"}}
    return replace(of, motions=motions, search=Search("sobol", POINTS, 1))


class Counting(Executor):
    """Executor that counts the evaluations submitted to another executor."""

    def __init__(self, inner: Executor) -> None:
        self.inner, self.count = inner, 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.count += len(args[-1])  # the candidates of a batch
        return self.inner.submit(fn, *args, **kwargs)


def driver(folder: str, address: str = "") -> None:
    """Run the study in a separate process that a test kills."""
    if not address:
        study(problem(), folder, workers=2)
        return
    from distributed import Client

    with Client(address) as client:
        study(problem(), folder, executor=client.get_executor(retries=3))


def started(folder: Path, address: str = "") -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", DRIVER, ROOT, folder, address])


@contextmanager
def killing(pids: Callable[[], list[int]]) -> Iterator[list[int]]:
    """Kill one of the processes every five seconds, and yield the list of killed ones."""
    over, killed = threading.Event(), []

    def kill() -> None:
        while not over.wait(EVERY):
            alive = pids()
            if alive:
                killed.append(random.choice(alive))
                os.kill(killed[-1], signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    try:
        yield killed
    finally:
        over.set()
        thread.join()


def children(pid: int) -> list[int]:
    result = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True, check=False
    )
    return [int(word) for word in result.stdout.split()]


@contextmanager
def cluster(
    count: int, port: int
) -> Iterator[tuple[str, subprocess.Popen[bytes], list[subprocess.Popen[bytes]]]]:
    """Start a scheduler and workers in separate processes. A nanny replaces a worker that ends."""
    quiet: dict[str, Any] = {
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
        "cwd": ROOT,
    }
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    address = f"tcp://127.0.0.1:{port}"
    options = ["--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
    scheduler = subprocess.Popen([*DASK[0], *options], env=environment, **quiet)
    workers = [
        subprocess.Popen(
            [*DASK[1], address, "--nthreads", "1", "--no-dashboard"], env=environment, **quiet
        )
        for _ in range(count)
    ]
    try:
        yield address, scheduler, workers
    finally:
        for process in (*workers, scheduler):
            process.terminate()
        for process in (*workers, scheduler):
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()


def free_port() -> int:
    with socket.socket() as result:
        result.bind(("127.0.0.1", 0))
        return int(result.getsockname()[1])


def done(folder: Path) -> int:
    """Return the number of finished candidates in a store that no process writes."""
    with Store(folder / "study.sqlite") as store:
        return sum(row.state != "waiting" for row in store.rows() if row.number >= 0)


def resumed(folder: Path, table: bytes, what: str, executor: Executor) -> None:
    before = done(folder)
    counting = Counting(executor)
    start = time.perf_counter()
    result = study(problem(), folder, executor=counting)
    same = (folder / "table.csv").read_bytes() == table
    print(
        f"{what}: {before} of {len(result.rows)} were done; resumed in {time.perf_counter() - start:.0f} s with "
        f"{counting.count} evaluations; the table is {'equal' if same else 'ANOTHER'}",
        flush=True,
    )


def local(folder: Path, table: bytes) -> None:
    with Workers(2) as workers, killing(lambda: pids(workers)) as killed:
        result = study(problem(), folder / "killed", executor=workers)
        states = result.states
    same = (folder / "killed" / "table.csv").read_bytes() == table
    print(
        f"workers killed {len(killed)} times: {states}; the table is {'equal' if same else 'ANOTHER'}",
        flush=True,
    )
    process = started(folder / "driver")
    time.sleep(12)
    process.kill()
    process.wait()
    with Workers(2) as workers:
        resumed(folder / "driver", table, "driver killed", workers)


def dask(folder: Path, table: bytes) -> None:
    from distributed import Client

    port = free_port()
    with cluster(4, port) as (address, scheduler, workers):
        with Client(address, timeout="30s") as client:
            client.wait_for_workers(4, timeout=60)
            start = time.perf_counter()
            study(problem(), folder / "calm", executor=client.get_executor(retries=3))
            same = (folder / "calm" / "table.csv").read_bytes() == table
            taken = time.perf_counter() - start
            print(
                f"Dask, undisturbed: {taken:.0f} s; the table is {'equal' if same else 'ANOTHER'}",
                flush=True,
            )
            with killing(
                lambda: [pid for nanny in workers for pid in children(nanny.pid)]
            ) as killed:
                result = study(problem(), folder / "shot", executor=client.get_executor(retries=3))
            same = (folder / "shot" / "table.csv").read_bytes() == table
            print(
                f"Dask's workers killed {len(killed)} times: {result.states}; the table is {'equal' if same else 'ANOTHER'}",
                flush=True,
            )
        process = started(folder / "scheduler", address)
        time.sleep(15)
        scheduler.kill()
        try:
            status: int | str = process.wait(120)
        except subprocess.TimeoutExpired:
            process.kill()
            status = "none: it hung for two minutes"
        print(f"scheduler killed: the driver's exit status is {status}", flush=True)
    with Workers(2) as local_workers:
        resumed(folder / "scheduler", table, "scheduler killed", local_workers)


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        start = time.perf_counter()
        study(problem(), folder / "calm2", workers=2)
        table = (folder / "calm2" / "table.csv").read_bytes()
        print(f"undisturbed: {time.perf_counter() - start:.0f} s", flush=True)
        local(folder, table)
        try:
            import distributed  # noqa: F401
        except ImportError:
            print("Dask is not installed: left out")
            return
        dask(folder, table)


if __name__ == "__main__":
    main()

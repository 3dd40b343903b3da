"""Worker processes do every task once, whichever of them are killed."""

from __future__ import annotations

import os
import random
import signal
import threading
import time
from concurrent.futures import wait

import pytest

from ssm_planner.studies.workers import WorkerDied, Workers, _start_worker
from tests.studies.support import pids


def test_tasks_come_back_in_their_futures():
    with Workers(2) as workers:
        futures = [workers.submit(pow, i, 2) for i in range(50)]
        assert [future.result() for future in futures] == [i**2 for i in range(50)]


def test_a_fault_is_the_tasks_own():
    with Workers(1) as workers:
        bad, good = workers.submit(divmod, 1, 0), workers.submit(divmod, 7, 2)
        with pytest.raises(ZeroDivisionError):
            bad.result()
        assert good.result() == (3, 1)


def test_a_task_that_ends_its_workers_is_given_up_and_the_others_go_on():
    with Workers(2) as workers:
        futures = [
            workers.submit(os._exit, 1) if i == 3 else workers.submit(abs, -i) for i in range(12)
        ]
        wait(futures)
        assert isinstance(futures[3].exception(), WorkerDied)
        assert [f.result() for i, f in enumerate(futures) if i != 3] == [
            i for i in range(12) if i != 3
        ]


def test_kills_lose_nothing():
    with Workers(2, attempts=50) as workers:
        futures = [workers.submit(time.sleep, 0.05) for _ in range(40)]
        done = threading.Event()

        def kill() -> None:
            while not done.wait(0.4):
                if pids(workers):
                    os.kill(random.choice(pids(workers)), signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        wait(futures)
        done.set()
        killer.join()
        assert all(future.exception() is None for future in futures)


def test_workers_are_gone_after_shutdown():
    workers = Workers(2)
    wait([workers.submit(abs, -1) for _ in range(4)])
    ended = pids(workers)
    workers.shutdown()
    assert ended
    for pid in ended:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_a_worker_that_starts_while_all_is_ended_does_not_outlive_it(monkeypatch):
    started = _start_worker

    def start_late():
        workers.shutdown(wait=False, cancel_futures=True)
        return started()

    monkeypatch.setattr("ssm_planner.studies.workers._start_worker", start_late)
    workers = Workers(1, attempts=1)
    assert isinstance(workers.submit(time.sleep, 60).exception(timeout=20), WorkerDied)

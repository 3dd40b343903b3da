"""Worker processes under supervision, behind the interface of `concurrent.futures.Executor`.

The standard process pool is lost as a whole when one of its processes dies. Here a process that dies is replaced and its
task tried again; a task that ends its worker `attempts` times is given up as `WorkerDied`, the others go on.
"""

from __future__ import annotations

import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from typing import Any, BinaryIO, ParamSpec, TypeVar

from ssm_planner.children import python_command
from ssm_planner.errors import SsmPlannerError

P = ParamSpec("P")
T = TypeVar("T")

ATTEMPTS = 3
"""Workers that one task may end before it is given up."""
_START = "from ssm_planner.studies.workers import serve; serve()"
_LENGTH = 8


class WorkerDied(SsmPlannerError):
    """A task ended every worker process that tried it."""


class Workers(Executor):
    """`count` processes that call what is submitted; arguments and results travel as pickles.

    attempts: workers that one task may end. patience: seconds after which a call counts as hung and its worker is ended.
    """

    def __init__(self, count: int, attempts: int = ATTEMPTS, patience: float | None = None) -> None:
        self._attempts, self._patience = attempts, patience
        self._tasks: queue.SimpleQueue[tuple[Future[Any], bytes] | None] = queue.SimpleQueue()
        self._closed = self._ended = False
        self._processes: dict[int, subprocess.Popen[bytes]] = {}
        self._threads = [
            threading.Thread(target=self._tend, args=(i,), daemon=True) for i in range(count)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def pids(self) -> tuple[int, ...]:
        """Process identifiers of the workers that run now."""
        return tuple(
            process.pid for process in list(self._processes.values()) if process.poll() is None
        )

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """A call on the next free worker. Raises RuntimeError after `shutdown`."""
        if self._closed:
            raise RuntimeError("the workers are shut down")
        future: Future[T] = Future()
        self._tasks.put((future, pickle.dumps((fn, args, kwargs), pickle.HIGHEST_PROTOCOL)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers when all that was submitted is done; with cancel_futures at once, what waits is cancelled."""
        self._closed = True
        if cancel_futures:
            self._ended = True
            while True:
                try:
                    task = self._tasks.get_nowait()
                except queue.Empty:
                    break
                if task is not None:
                    task[0].cancel()
            for process in list(self._processes.values()):
                process.kill()
        for _ in self._threads:
            self._tasks.put(None)
        if wait:
            for thread in self._threads:
                thread.join()

    def _tend(self, place: int) -> None:
        """One worker's supervisor: hands it tasks, replaces it when it has died."""
        process: subprocess.Popen[bytes] | None = None
        while (task := self._tasks.get()) is not None:
            future, message = task
            if not future.set_running_or_notify_cancel():
                continue
            answer: bytes | None = None
            died = 0
            while answer is None and died < self._attempts and not (died and self._closed):
                if process is None or process.poll() is not None:
                    process = self._processes[place] = _started()
                    if self._ended:  # it began after `shutdown` had ended the others
                        process.kill()
                answer = self._ask(process, message)
                died += answer is None
            _settle(future, answer, died)
        if process is not None:
            _end(process)

    def _ask(self, process: subprocess.Popen[bytes], message: bytes) -> bytes | None:
        """The worker's answer; None where it died, or was ended because it took too long."""
        assert process.stdin is not None
        assert process.stdout is not None
        timer = None if self._patience is None else threading.Timer(self._patience, process.kill)
        if timer is not None:
            timer.start()
        try:
            _send(process.stdin, message)
            return _receive(process.stdout)
        except (OSError, EOFError):
            _end(process)
            return None
        finally:
            if timer is not None:
                timer.cancel()


def _settle(future: Future[Any], answer: bytes | None, died: int) -> None:
    if answer is None:
        future.set_exception(WorkerDied(f"ended its worker process {died} times"))
        return
    fine, value = pickle.loads(answer)
    if fine:
        future.set_result(value)
    else:
        future.set_exception(value)


def _started() -> subprocess.Popen[bytes]:
    # one thread each: the workers share the processors already
    quiet = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    return subprocess.Popen(
        python_command(_START),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, **quiet},
        start_new_session=True,  # Ctrl-C is the driver's
    )


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()
    process.wait()


def _send(stream: BinaryIO | Any, message: bytes) -> None:
    stream.write(len(message).to_bytes(_LENGTH, "big") + message)
    stream.flush()


def _receive(stream: BinaryIO | Any) -> bytes:
    """The next message. Raises EOFError where the other side has ended."""
    message = _exactly(stream, int.from_bytes(_exactly(stream, _LENGTH), "big"))
    return message


def _exactly(stream: BinaryIO | Any, count: int) -> bytes:
    data: bytes = stream.read(count)
    if len(data) < count:
        raise EOFError
    return data


def serve() -> None:
    """The life of a worker: calls what comes on standard input, answers on standard output, ends when it is closed."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not stand among the answers
    while True:
        try:
            message = _receive(sys.stdin.buffer)
        except EOFError:
            return
        try:
            function, arguments, named = pickle.loads(message)
            answer = pickle.dumps((True, function(*arguments, **named)), pickle.HIGHEST_PROTOCOL)
        except Exception as error:  # noqa: BLE001 every fault is the caller's to judge
            answer = _fault(error)
        _send(answers, answer)


def _fault(error: Exception) -> bytes:
    try:
        pickle.loads(pickle.dumps(error))
        return pickle.dumps((False, error))
    except Exception:  # noqa: BLE001 an exception that does not survive pickling travels as its text
        return pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))

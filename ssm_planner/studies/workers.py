"""Run tasks in supervised worker processes.

`Workers` has the interface of `concurrent.futures.Executor`. If a process of Python's own process
pool dies, the entire pool fails. This pool replaces a dead process and repeats its task. If a task
has ended several workers, it fails with `WorkerDied`, and all other tasks continue.
"""

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

DEFAULT_ATTEMPTS = 3
"""Default number of workers that one task may end before it fails."""
_WORKER_PROGRAM = "from ssm_planner.studies.workers import serve; serve()"
"""Program of a worker process."""


class WorkerDied(SsmPlannerError):
    """Error for a task that ended every worker process that tried it."""


class Workers(Executor):
    """Pool of worker processes, which exchange calls and results as pickles.

    Parameters
    ----------
    count : int
        Number of processes.
    attempts : int
        Number of workers that one task may end before it fails.
    """

    def __init__(self, count: int, attempts: int = DEFAULT_ATTEMPTS) -> None:
        """Start one supervising thread for each worker process.

        A process itself starts with the first task that its thread receives. The parameters are
        those of the class.
        """
        self._attempts = attempts
        self._tasks: queue.SimpleQueue[tuple[Future[Any], bytes] | None] = queue.SimpleQueue()
        self._closed = self._ended = False
        self._processes: dict[int, subprocess.Popen[bytes]] = {}
        self._threads = [
            threading.Thread(target=self._supervise, args=(i,), daemon=True) for i in range(count)
        ]
        for thread in self._threads:
            thread.start()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Schedule a call of fn(*args, **kwargs) on the next free worker, and return its future.

        Raises RuntimeError after `shutdown`.
        """
        if self._closed:
            raise RuntimeError("the workers are shut down")
        future: Future[T] = Future()
        self._tasks.put((future, pickle.dumps((fn, args, kwargs), pickle.HIGHEST_PROTOCOL)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers after all submitted calls.

        Parameters
        ----------
        wait : bool
            If true, return after all workers have ended.
        cancel_futures : bool
            If true, kill the workers at once and cancel waiting calls.
        """
        self._closed = True
        if cancel_futures:
            self._ended = True
            with suppress(queue.Empty):
                while True:
                    task = self._tasks.get_nowait()
                    if task is not None:
                        task[0].cancel()
            for process in list(self._processes.values()):
                process.kill()
        for _ in self._threads:
            self._tasks.put(None)
        if wait:
            for thread in self._threads:
                thread.join()

    def _supervise(self, index: int) -> None:
        """Send tasks to one worker process, and replace the process if it dies.

        Each worker has a thread that runs this method until `shutdown`.

        Parameters
        ----------
        index : int
            Index of the worker.
        """
        process: subprocess.Popen[bytes] | None = None
        while True:
            task = self._tasks.get()
            if task is None:  # `shutdown` puts one None for each worker.
                break
            future, message = task
            if not future.set_running_or_notify_cancel():
                continue
            answer: bytes | None = None
            death_count = 0
            # A task that ends its worker is repeated, unless `shutdown` was called meanwhile.
            while (
                answer is None
                and death_count < self._attempts
                and not (death_count and self._closed)
            ):
                if process is None or process.poll() is not None:
                    process = self._processes[index] = _start_worker()
                    if self._ended:  # This worker started after `shutdown` had killed the others.
                        process.kill()
                answer = self._ask(process, message)
                death_count += answer is None
            _resolve_future(future, answer, death_count)
        if process is not None:
            _terminate_worker(process)

    def _ask(self, process: subprocess.Popen[bytes], message: bytes) -> bytes | None:
        """Send a task to a worker process, and return its answer.

        Parameters
        ----------
        process : Popen
            Process of the worker.
        message : bytes
            Pickled call.

        Returns
        -------
        bytes or None
            Pickled answer. None if the worker died, which this method then cleans up.
        """
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            _send_message(process.stdin, message)
            return _receive_message(process.stdout)
        except (OSError, EOFError):
            _terminate_worker(process)
            return None


def _resolve_future(future: Future[Any], answer: bytes | None, death_count: int) -> None:
    """Set the result or the exception of a future from a worker's answer.

    Parameters
    ----------
    future : Future
        Future of the task.
    answer : bytes or None
        Pickled answer. None if the task ended its worker at every attempt.
    death_count : int
        Number of workers that the task ended.
    """
    if answer is None:
        future.set_exception(WorkerDied(f"ended its worker process {death_count} times"))
        return
    succeeded, value = pickle.loads(answer)
    if succeeded:
        future.set_result(value)
    else:
        future.set_exception(value)


def _start_worker() -> subprocess.Popen[bytes]:
    """Start a worker process with a single thread for linear algebra."""
    # One thread for each worker is enough, because the workers share the processors.
    single_thread = dict.fromkeys(
        ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"
    )
    return subprocess.Popen(
        python_command(_WORKER_PROGRAM),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, **single_thread},
        start_new_session=True,  # only the driver receives Ctrl-C
    )


def _terminate_worker(process: subprocess.Popen[bytes]) -> None:
    """Kill a worker, close its pipes and wait for its end.

    Parameters
    ----------
    process : Popen
        Process of the worker, running or ended.
    """
    process.kill()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()
    process.wait()


def _send_message(stream: BinaryIO | Any, message: bytes) -> None:
    """Write a message as a pickle, which contains its own length."""
    pickle.dump(message, stream, pickle.HIGHEST_PROTOCOL)
    stream.flush()


def _receive_message(stream: BinaryIO | Any) -> bytes:
    """Read the next message. Raise EOFError if the other side has closed the stream."""
    try:
        message: bytes = pickle.load(stream)
    except pickle.UnpicklingError as error:
        raise EOFError from error
    return message


def serve() -> None:
    """Run a worker process: execute pickled calls from standard input until it closes.

    A call consists of the function, its arguments and its keyword arguments. The answer on standard
    output is a pickled pair: True and the result, or False and the exception.
    """
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # The output of libraries must not mix with the answers.
    while True:
        try:
            message = _receive_message(sys.stdin.buffer)
        except EOFError:
            return
        try:
            function, arguments, keywords = pickle.loads(message)
            answer = pickle.dumps((True, function(*arguments, **keywords)), pickle.HIGHEST_PROTOCOL)
        except Exception as error:  # noqa: BLE001 the caller handles every exception
            answer = _failed_answer(error)
        _send_message(answers, answer)


def _failed_answer(error: Exception) -> bytes:
    """Return the answer for a call that failed with an exception.

    An exception that cannot be pickled is replaced by a RuntimeError with its text.
    """
    try:
        pickle.loads(pickle.dumps(error))
        return pickle.dumps((False, error))
    except Exception:  # noqa: BLE001 pickling may raise any exception
        return pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))

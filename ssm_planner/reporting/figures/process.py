"""Draw figures in a child process while the planner works.

The child imports matplotlib during planning and draws during the check. It reads what to draw from
its standard input and returns the files' bytes on its standard output. It opens no file and has no
terminal, so it leaves nothing behind if it is killed.
"""

from __future__ import annotations

import gc
import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import TimeoutError as TookTooLong
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace, TracebackType
from typing import TYPE_CHECKING, Any

from ssm_planner.children import python_command
from ssm_planner.errors import ExportError
from ssm_planner.publishing import publishing_results
from ssm_planner.reporting.figures.plan import DRAWN, WIDE, motion_figure, motors_figure
from ssm_planner.reporting.figures.style import drawn, new_panels, save_drawn, save_figures

if TYPE_CHECKING:
    from ssm_planner.plans import Plan

PATIENCE = 60.0
"""Time in s after which the caller draws the missing figures."""
_START = "from ssm_planner.reporting.figures.process import serve; serve()"

Files = dict[str, dict[str, bytes]]
"""Content by figure and file extension."""


class _Plain(pickle.Pickler):
    """Pickler that converts sizing results to plain namespaces.

    The child therefore needs neither the sizing package nor CasADi.
    """

    def reducer_override(self, value: object) -> Any:
        if type(value).__module__.startswith("ssm_planner.sizing."):
            return SimpleNamespace, (), vars(value)
        return NotImplemented


class FigureProcess:
    """A child process that draws one plan.

    If it cannot start or fails, `result` is empty and the caller draws.
    """

    def __init__(self) -> None:
        self._process = _started() if (os.cpu_count() or 1) > 1 else None
        # A pipe may block its writer, but must not block the planner.
        self._pipe = ThreadPoolExecutor(1)

    def draw(self, name: str, *arguments: object) -> None:
        """Start drawing a figure of `plan.DRAWN` and return immediately.

        If a figure is started again, the last call counts.
        """
        if self._process is not None:
            with BytesIO() as message:
                _Plain(message).dump((name, arguments))
                self._pipe.submit(self._write, message.getvalue())

    def result(self) -> Files:
        """Wait for the started figures and return them."""
        process = self._process
        if process is None:
            return {}
        try:
            answer, _ = self._pipe.submit(process.communicate).result(PATIENCE)
            files: Files = pickle.loads(answer) if process.returncode == 0 else {}
        except (OSError, ValueError, TookTooLong, EOFError):
            return {}
        return files

    def _write(self, message: bytes) -> None:
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.write(message)
            self._process.stdin.flush()

    def __enter__(self) -> FigureProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._process is not None:
            self._process.kill()
            self._pipe.submit(self._process.communicate)
        self._pipe.shutdown()


def _started() -> subprocess.Popen[bytes] | None:
    """Start the child process. Return None if this interpreter is embedded in another program."""
    if not sys.executable or getattr(sys, "frozen", False):
        return None
    try:
        return subprocess.Popen(
            python_command(_START),
            cwd=Path(__file__).parent,  # Matplotlib reads settings from the working directory.
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C reaches only the planner, which ends this process.
        )
    except OSError:
        return None


def serve() -> None:
    """Run the child: draw the requested figures and return all of them at the end of the input."""
    gc.disable()  # Garbage collection would take a tenth of the time of this short process.
    answer = sys.stdout.buffer
    sys.stdout = sys.stderr
    # The first figure of a process loads fonts and half of matplotlib.
    warm, panels = new_panels(2.0, 2.0, rows=1, columns=1, edges=(0.5,) * 4, gaps=(0.0, 0.0))
    panels[0, 0].plot([0, 1], label="warm")
    warm.legend()
    drawn(warm, pdf=False)
    files: Files = {}
    while True:
        try:
            name, arguments = pickle.load(sys.stdin.buffer)
        except EOFError:
            break
        files[name] = drawn(DRAWN[name](*arguments), pdf=False)
    pickle.dump(files, answer)
    answer.flush()


def write_figures(plan: Plan, folder: Path, drawer: FigureProcess | None = None) -> dict[str, Path]:
    """Write the figures motion and motors as PNG and return their paths by name.

    A robot without drives has no figure motors. drawer: process that may have drawn some figures
    already. Raises ExportError.
    """
    trajectory, robot = plan.trajectory, plan.problem.robot
    if trajectory is None:
        raise ExportError("the plan has no trajectory to draw")
    arguments: dict[str, tuple[object, ...]] = {"motion": (trajectory, robot)}
    if plan.requirements:
        arguments["motors"] = trajectory, robot, plan.requirements
    files = {} if drawer is None else drawer.result()
    paths: dict[str, Path] = {}
    for name, values in arguments.items():
        endings = files.get(name) or drawn(DRAWN[name](*values), pdf=False)
        paths |= save_drawn(endings, folder / name, f"plan {plan.sha256}")
    return paths


def write_figures_of_file(plan: Plan, folder: Path, width: float = WIDE) -> dict[str, Path]:
    """Write the figures of a loaded plan as PNG and PDF and return their paths by name.

    width: inches. Raises ExportError.
    """
    from ssm_planner.sizing.requirements import motor_requirements

    trajectory, robot = plan.motion, plan.robot
    requirements = motor_requirements(trajectory, robot)
    with publishing_results(folder, plan.sha256) as temporary:
        figures = {"motion": motion_figure(trajectory, robot, width)}
        if requirements:
            figures["motors"] = motors_figure(trajectory, robot, requirements, width)
        paths = save_figures(figures, temporary, f"plan {plan.sha256}")
    return {name: folder / path.name for name, path in paths.items()}

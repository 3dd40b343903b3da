"""Draw figures, and judge and prove motions, in a child process while the planner works.

The command `plan` uses a `FigureProcess` to save time. The child imports matplotlib and toppra
during the planning, and works during the check. It reads requests from its standard input. It
writes every judgement to its standard output at once, and the content of the image files at the
end. It opens no files and is not connected to a terminal, so it can be killed at any time.
"""

import gc
import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import TimeoutError as TookTooLong
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from ssm_planner.children import python_command
from ssm_planner.errors import ExportError
from ssm_planner.publishing import publishing_results
from ssm_planner.reporting.figures.plan import (
    DEFAULT_WIDTH,
    PLAN_FIGURES,
    motion_figure,
    motors_figure,
)
from ssm_planner.reporting.figures.style import (
    new_panels,
    render_figure,
    save_figures,
    save_rendered,
)
from ssm_planner.typing import Files

if TYPE_CHECKING:
    from ssm_planner.plans import Plan
    from ssm_planner.problem import Problem
    from ssm_planner.trajectory import Trajectory
    from ssm_planner.verification.proof import Proof
    from ssm_planner.verification.second_opinion import Opinion

ANSWER_TIMEOUT = 60.0
"""Time for which the caller waits before it does the work of the child itself, s."""
JUDGEMENT_REQUEST = "judgement"
"""Name of the request for a second opinion and a proof."""
_CHILD_PROGRAM = "from ssm_planner.reporting.figures.process import serve; serve()"
"""Program of the child process."""

FigureContents = dict[str, dict[str, bytes]]
"""Content of the image files by name of the figure and by file extension."""
Judgement = tuple["tuple[Opinion, ...]", "tuple[Proof, ...]"]
"""Second opinions on the durations of the phases, and proofs of the limits of a motion."""


class FigureProcess:
    """A child process that draws the figures of a plan, judges its duration and proves its limits.

    If the process cannot start or fails, `result` returns an empty dict and `judgement` returns
    None. The caller then does the work. On exit from the context, the process is killed.
    """

    def __init__(self) -> None:
        """Start the process, unless the computer has only one processor."""
        self._process = _start_process() if (os.cpu_count() or 1) > 1 else None
        # Writing to a full pipe blocks. A thread writes, so that the planner never waits.
        self._pipe = ThreadPoolExecutor(1)
        self._questions = 0

    def judge(self, trajectory: "Trajectory", problem: "Problem") -> None:
        """Request second opinions and proofs for a motion, and return immediately.

        A second opinion is the duration that the independent program toppra obtains. A proof bounds
        the worst value of a limited quantity over the entire motion.

        Parameters
        ----------
        trajectory : Trajectory
            Motion that is judged.
        problem : Problem
            Problem that the motion solves, with its robot and its limits.
        """
        self._questions += 1
        self.draw(JUDGEMENT_REQUEST, trajectory, problem)

    def judgement(self) -> Judgement | None:
        """Wait for the answer to the last request of `judge`, and return it.

        Returns
        -------
        tuple or None
            The result of `second_opinions_and_proofs`. None if `judge` was not called, or if the
            process failed or took longer than `ANSWER_TIMEOUT`.
        """
        judgement = None
        try:
            for _ in range(self._questions):
                judgement = self._pipe.submit(self._read).result(ANSWER_TIMEOUT)
        except (OSError, ValueError, TookTooLong, EOFError):
            return None
        return judgement

    def draw(self, name: str, *arguments: object) -> None:
        """Request a figure and return immediately.

        Parameters
        ----------
        name : str
            "motion" or "motors" for a figure, or `JUDGEMENT_REQUEST`. A new request for the same
            figure replaces the earlier one.
        *arguments
            Arguments of the function that draws the figure.
        """
        if self._process is not None:
            self._pipe.submit(self._write, pickle.dumps((name, arguments)))

    def result(self) -> FigureContents:
        """Wait for the requested figures, and return the content of their files.

        Returns
        -------
        dict
            Content by name of the figure and file extension. It is empty if the process failed or
            took longer than `ANSWER_TIMEOUT`.
        """
        process = self._process
        if process is None:
            return {}
        try:
            answer, _ = self._pipe.submit(process.communicate).result(ANSWER_TIMEOUT)
            files: FigureContents = pickle.loads(answer) if process.returncode == 0 else {}
        except (OSError, ValueError, TookTooLong, EOFError):
            return {}
        return files

    def _read(self) -> Judgement | None:
        """Read the next judgement from the standard output of the child process."""
        if self._process is None or self._process.stdout is None:
            return None
        return pickle.load(self._process.stdout)

    def _write(self, message: bytes) -> None:
        """Write a pickled request to the standard input of the child process."""
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.write(message)
            self._process.stdin.flush()

    def __enter__(self) -> "FigureProcess":
        return self

    def __exit__(self, *_: object) -> None:
        """Kill the process."""
        if self._process is not None:
            self._process.kill()
            self._pipe.submit(self._process.communicate)
        self._pipe.shutdown()


def _start_process() -> subprocess.Popen[bytes] | None:
    """Start the child process.

    Returns
    -------
    Popen or None
        None if the start fails, or if the Python interpreter is embedded in another program.
    """
    if not sys.executable or getattr(sys, "frozen", False):
        return None
    try:
        return subprocess.Popen(
            python_command(_CHILD_PROGRAM),
            cwd=Path(__file__).parent,  # Matplotlib reads settings from the working directory.
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C reaches only the planner, which ends this process.
        )
    except OSError:
        return None


def serve() -> None:
    """Run the child process.

    It answers requests for judgements at once. When its standard input is closed, it writes all
    figures and ends.
    """
    gc.disable()  # Garbage collection would take a tenth of the time of this short process.
    answer = sys.stdout.buffer
    sys.stdout = sys.stderr
    # The first figure of a process loads fonts and half of matplotlib, so a dummy is drawn first.
    dummy, panels = new_panels(2.0, 2.0, rows=1, columns=1, edges=(0.5,) * 4, gaps=(0.0, 0.0))
    panels[0, 0].plot([0, 1], label="dummy")
    dummy.legend()
    render_figure(dummy, pdf=False)
    from ssm_planner.verification import second_opinions_and_proofs

    import_module("toppra")
    files: FigureContents = {}
    while True:
        try:
            name, arguments = pickle.load(sys.stdin.buffer)
        except EOFError:
            break
        if name == JUDGEMENT_REQUEST:
            pickle.dump(second_opinions_and_proofs(*arguments), answer)
            answer.flush()
        else:
            files[name] = render_figure(PLAN_FIGURES[name](*arguments), pdf=False)
    pickle.dump(files, answer)
    answer.flush()


def write_figures(plan: "Plan", folder: Path, drawer: FigureProcess | None = None) -> Files:
    """Write the figures of a new plan as PNG.

    The figures are "motion" and, if the robot has drives, "motors".

    Parameters
    ----------
    plan : Plan
        Plan that is reported.
    folder : Path
        Existing folder of the files.
    drawer : FigureProcess, optional
        Process that may already have drawn the figures. Missing figures are drawn here.

    Returns
    -------
    Files
        Paths by name, such as "motion_figure" for a PNG and "motion_pdf" for a PDF.

    Raises
    ------
    ExportError
        If the plan does not contain a trajectory, or if a file cannot be written.
    """
    trajectory, robot = plan.trajectory, plan.problem.robot
    if trajectory is None:
        raise ExportError("the plan does not contain a trajectory to draw")
    arguments: dict[str, tuple[object, ...]] = {"motion": (trajectory, robot)}
    if plan.requirements:
        arguments["motors"] = trajectory, robot, [item.figure_data() for item in plan.requirements]
    files = {} if drawer is None else drawer.result()
    paths: Files = {}
    for name, values in arguments.items():
        images = files.get(name) or render_figure(PLAN_FIGURES[name](*values), pdf=False)
        paths |= save_rendered(images, folder / name, f"plan {plan.sha256}")
    return paths


def write_figures_of_file(plan: "Plan", folder: Path, width: float = DEFAULT_WIDTH) -> Files:
    """Write the figures of a loaded plan as PNG and PDF.

    Parameters
    ----------
    plan : Plan
        Plan that is reported.
    folder : Path
        Folder of the figures.
    width : float
        Width of the figures, inches.

    Returns
    -------
    Files
        Paths by name, such as "motion_figure" for a PNG and "motion_pdf" for a PDF.

    Raises
    ------
    ExportError
        If a file cannot be written.
    """
    from ssm_planner.sizing import motor_requirements

    trajectory, robot = plan.motion, plan.robot
    requirements = motor_requirements(trajectory, robot)
    with publishing_results(folder, plan.sha256) as temporary:
        figures = {"motion": motion_figure(trajectory, robot, width)}
        if requirements:
            figures["motors"] = motors_figure(trajectory, robot, requirements, width)
        paths = save_figures(figures, temporary, f"plan {plan.sha256}")
    return {name: folder / path.name for name, path in paths.items()}

"""Plan motions for the view: one at a time, in a separate process that can be killed."""

from __future__ import annotations

import json
import secrets
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ssm_planner.errors import ProblemError, SsmPlannerError
from ssm_planner.problem.limits import TaskRange
from ssm_planner.problem.motion import Dwell, Straight, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.studies.workers import Workers
from ssm_planner.typing import Range, frozen
from ssm_planner.view.page import Pose, Study, number, pose, tilt_range

KEPT = 8
"""Number of runs whose results stay available."""
LONGEST_DWELL = 3600.0
"""Longest dwell, s."""


@frozen
class Outcome:
    """Answer of the planner's process."""

    message: str
    report: str | None = None
    """HTML of the report."""
    plan: str | None = None
    """Content of plan.json."""
    relaxation: str | None = None
    """Description of the relaxation in `relaxed`."""
    relaxed: Problem | None = None


@dataclass
class Job:
    """One planning run. steps: file to which its process writes its progress."""

    identity: str
    steps: Path
    outcome: Outcome | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the object that the page receives."""
        outcome = self.outcome  # read once: the planner may finish while this is written
        result = outcome or Outcome("")
        texts = {"report": result.report, "plan": result.plan}
        return {
            "steps": self.steps.read_text(encoding="utf-8").splitlines(),
            "done": outcome is not None,
            "message": result.message,
            "relaxation": result.relaxation if result.relaxed is not None else None,
            **{
                name: None if text is None else f"/{name}/{self.identity}"
                for name, text in texts.items()
            },
        }


class Jobs:
    """The planning runs of one server."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self._jobs: dict[str, Job] = {}
        self._lock = threading.Lock()
        self._workers: Workers | None = None
        self._folder = tempfile.TemporaryDirectory(prefix="ssm_planner_view_")

    def start(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Answer a motion as in `wanted`, {own: true} or {relaxed: job} with {job}.

        Raises ProblemError.
        """
        problem = (
            self._relaxed(request) if "relaxed" in request else self.requested_problem(request)
        )
        with self._lock:
            if any(job.outcome is None for job in self._jobs.values()):
                raise ProblemError("a plan is being made; one at a time")
            identity = secrets.token_urlsafe(16)
            job = self._jobs[identity] = Job(identity, Path(self._folder.name) / identity)
            job.steps.touch()
            for old in list(self._jobs)[:-KEPT]:
                del self._jobs[old]
            if self._workers is None:
                self._workers = Workers(1, attempts=1)
            self._workers.submit(run_plan, problem, job.steps).add_done_callback(
                lambda done: self._finish(job, done)
            )
        return {"job": identity}

    def progress(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Answer {job} with {steps, done, message, relaxation, report, plan}.

        Raises ProblemError.
        """
        return self._job(request, "job").to_dict()

    def cancel(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Kill the planner's process and answer {job} as `progress` does. Raises ProblemError."""
        job = self._job(request, "job")
        with self._lock:
            if job.outcome is None:
                job.outcome = Outcome("cancelled")
                self._end()
        return job.to_dict()

    def text(self, kind: str, identity: str) -> str | None:
        """Return the "report" or "plan" of a run, or None if it does not exist."""
        job = self._jobs.get(identity)
        return None if job is None or job.outcome is None else getattr(job.outcome, kind)

    def close(self) -> None:
        """Kill the planner's process and delete its files."""
        with self._lock:
            self._end()
        self._folder.cleanup()

    def requested_problem(self, request: Mapping[str, Any]) -> Problem:
        """Return the problem of a request.

        The request is {alpha, beta, start, tilt_range, target or motion: [{pose} or {dwell}, …]} or
        {own: true}. Raises ProblemError.
        """
        original = self.study.problem
        if original is None:
            raise ProblemError(
                "planning needs a robot with drives: start the view with a problem file"
            )
        if request.get("own") is True:
            return original
        robot = self.study.robot(original.robot, request)
        steps = request.get("motion", [{"pose": request.get("target")}])
        if (
            not isinstance(steps, list)
            or not steps
            or not all(isinstance(step, dict) for step in steps)
        ):
            raise ProblemError("not a motion", key="motion", allowed="a list of poses and dwells")
        return posed_problem(
            original,
            robot,
            pose(request, "start"),
            [_step(step) for step in steps],
            tilt_range(request),
        )

    def _relaxed(self, request: Mapping[str, Any]) -> Problem:
        """Return the relaxed problem of an earlier run. Raises ProblemError."""
        outcome = self._job(request, "relaxed").outcome
        if outcome is None or outcome.relaxed is None:
            raise ProblemError("no relaxation is known", key="relaxed")
        return outcome.relaxed

    def _job(self, request: Mapping[str, Any], key: str) -> Job:
        """Return the run that a request names. Raises ProblemError."""
        job = self._jobs.get(str(request.get(key)))
        if job is None:
            raise ProblemError("no such plan", key=key)
        return job

    def _finish(self, job: Job, future: Future[Outcome]) -> None:
        """Record the outcome of a run unless it was cancelled."""
        error = future.exception()
        with self._lock:
            if job.outcome is not None:
                return
            if error is None:
                job.outcome = future.result()
            elif isinstance(error, SsmPlannerError):
                job.outcome = Outcome(str(error))
            else:
                job.outcome = Outcome(f"stopped by a fault of the program: {error}")

    def _end(self) -> None:
        """Kill the planner's process."""
        if self._workers is not None:
            self._workers.shutdown(wait=False, cancel_futures=True)
            self._workers = None


def run_plan(problem: Problem, steps: Path) -> Outcome:
    """Plan a problem in the planner's process.

    steps: file for the progress. Raises ProblemError.
    """
    start = time.perf_counter()

    def progress(step: str) -> None:
        with steps.open("a", encoding="utf-8") as file:
            file.write(f"{time.perf_counter() - start:.1f} s  {step}\n")

    progress("loading the planner")
    from ssm_planner.pipeline.run import plan
    from ssm_planner.pipeline.thermal import quickly
    from ssm_planner.reporting.html.report import report_page

    relaxed: list[Problem] = []
    result = plan(quickly(problem), progress, on_relaxation=relaxed.append)
    if result.trajectory is None:
        reason = result.reason
        message = reason.message if reason else result.status
        return Outcome(
            message,
            relaxation=reason.relaxation if reason else None,
            relaxed=relaxed[-1] if relaxed else None,
        )
    progress("writing the report")
    verdict = "passed" if result.passed else "failed"
    text = f"planned: {result.duration:.4f} s, independent check {verdict}"
    return Outcome(text, report_page(result), json.dumps(result.to_dict(), allow_nan=False))


def posed_problem(
    problem: Problem, robot: Robot, start: Pose, steps: Sequence[Pose | float], tilt: Range
) -> Problem:
    """Return the problem of straight motions of a robot through poses (rad and m) and dwells (s).

    The limits are those of `problem` within the tilt range `tilt` (rad). Raises ProblemError.
    """
    low, high = problem.ranges.get("tilt", tilt)
    tilt_limit = TaskRange("tilt", max(low, tilt[0]), min(high, tilt[1]))
    return Problem(
        robot,
        start=Task(*start),
        motion=tuple(Dwell(step) if isinstance(step, float) else Straight(*step) for step in steps),
        limits=(*(limit for limit in problem.limits if limit.key != tilt_limit.key), tilt_limit),
        eye=problem.eye,
        name=f"{problem.name}, from the view",
    )


def _step(step: Mapping[str, Any]) -> Pose | float:
    """Return a pose or a dwell of a request. Raises ProblemError."""
    return (
        number(step, "dwell", 1e-3, LONGEST_DWELL, "s") if "dwell" in step else pose(step, "pose")
    )

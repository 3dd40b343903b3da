"""Plans made while the page waits: one at a time, in a process of its own that can be ended."""

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
from ssm_planner.studies.workers import Workers
from ssm_planner.typing import Range
from ssm_planner.view.page import SAME, Pose, Study, number, pose, tilt_range

KEPT = 8
LONGEST_DWELL = 3600.0
"""s."""


@dataclass(frozen=True)
class Outcome:
    """What the planner's process answers."""

    message: str
    report: str | None = None
    """The finished page."""
    plan: str | None = None
    """plan.json."""
    relaxation: str | None = None
    """In words, of what `relaxed` has."""
    relaxed: Problem | None = None


@dataclass
class Job:
    """One planning run; steps: the file that its process writes them to."""

    identity: str
    steps: Path
    outcome: Outcome | None = None

    def to_dict(self) -> dict[str, Any]:
        outcome = self.outcome  # read once: the planner may finish while this is written
        found = outcome or Outcome("")
        places = {"report": found.report, "plan": found.plan}
        return {
            "steps": self.steps.read_text(encoding="utf-8").splitlines(),
            "done": outcome is not None,
            "message": found.message,
            "relaxation": found.relaxation if found.relaxed is not None else None,
            **{
                name: None if text is None else f"/{name}/{self.identity}"
                for name, text in places.items()
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
        """A motion as in `wanted`, {own: true} or {relaxed: job} → {job}. Raises ProblemError."""
        problem = self._relaxed(request) if "relaxed" in request else self.wanted(request)
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
            self._workers.submit(planned, problem, job.steps).add_done_callback(
                lambda done: self._finish(job, done)
            )
        return {"job": identity}

    def progress(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """{job} → {steps, done, message, relaxation, report, plan}. Raises ProblemError."""
        return self._job(request, "job").to_dict()

    def cancel(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """{job} → as `progress`; the planner's process is ended. Raises ProblemError."""
        job = self._job(request, "job")
        with self._lock:
            if job.outcome is None:
                job.outcome = Outcome("cancelled")
                self._end()
        return job.to_dict()

    def text(self, kind: str, identity: str) -> str | None:
        """The "report" or "plan" of a run; None where there is none."""
        job = self._jobs.get(identity)
        return None if job is None or job.outcome is None else getattr(job.outcome, kind)

    def close(self) -> None:
        """End what runs."""
        with self._lock:
            self._end()
        self._folder.cleanup()

    def wanted(self, request: Mapping[str, Any]) -> Problem:
        """{alpha, beta, start, tilt_range, target or motion: [{pose} or {dwell}, …]} or {own: true} as a problem.

        Raises ProblemError.
        """
        if self.study.problem is None:
            raise ProblemError(
                "planning needs a robot with drives: start the view with a problem file"
            )
        if request.get("own") is True:
            return self.study.problem
        _, own = self.study.mechanism(request)
        if not own:
            raise ProblemError(
                f"the masses of the links are known for the robot's own alpha and beta only (within {SAME:g} rad)"
            )
        steps = request.get("motion", [{"pose": request.get("target")}])
        if (
            not isinstance(steps, list)
            or not steps
            or not all(isinstance(step, dict) for step in steps)
        ):
            raise ProblemError("not a motion", key="motion", allowed="a list of poses and dwells")
        return posed_problem(
            self.study.problem,
            pose(request, "start"),
            [_step(step) for step in steps],
            tilt_range(request),
        )

    def _relaxed(self, request: Mapping[str, Any]) -> Problem:
        outcome = self._job(request, "relaxed").outcome
        if outcome is None or outcome.relaxed is None:
            raise ProblemError("no relaxation is known", key="relaxed")
        return outcome.relaxed

    def _job(self, request: Mapping[str, Any], key: str) -> Job:
        job = self._jobs.get(str(request.get(key)))
        if job is None:
            raise ProblemError("no such plan", key=key)
        return job

    def _finish(self, job: Job, done: Future[Outcome]) -> None:
        error = done.exception()
        with self._lock:
            if job.outcome is not None:
                return
            if error is None:
                job.outcome = done.result()
            elif isinstance(error, SsmPlannerError):
                job.outcome = Outcome(str(error))
            else:
                job.outcome = Outcome(f"stopped by a fault of the program: {error}")

    def _end(self) -> None:
        if self._workers is not None:
            self._workers.shutdown(wait=False, cancel_futures=True)
            self._workers = None


def planned(problem: Problem, steps: Path) -> Outcome:
    """Plan a problem in the planner's own process; steps: the file that says how far it is. Raises ProblemError."""
    begin = time.perf_counter()

    def progress(step: str) -> None:
        with steps.open("a", encoding="utf-8") as file:
            file.write(f"{time.perf_counter() - begin:.1f} s  {step}\n")

    progress("loading the planner")
    from ssm_planner.pipeline.run import plan, quickly
    from ssm_planner.reporting.html.report import report_page

    relaxed: list[Problem] = []
    result = plan(quickly(problem), progress, cured=relaxed.append)
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
    problem: Problem, start: Pose, steps: Sequence[Pose | float], tilt: Range
) -> Problem:
    """Straight motions through poses, rad and m, and dwells, s, within the problem's limits and a tilt range.

    Raises ProblemError.
    """
    low, high = problem.ranges.get("tilt", tilt)
    wanted = TaskRange("tilt", max(low, tilt[0]), min(high, tilt[1]))
    return Problem(
        problem.robot,
        start=Task(*start),
        motion=tuple(Dwell(step) if isinstance(step, float) else Straight(*step) for step in steps),
        limits=(*(limit for limit in problem.limits if limit.key != wanted.key), wanted),
        eye=problem.eye,
        name=f"{problem.name}, from the view",
    )


def _step(step: Mapping[str, Any]) -> Pose | float:
    """A pose or a dwell of a request. Raises ProblemError."""
    return (
        number(step, "dwell", 1e-3, LONGEST_DWELL, "s") if "dwell" in step else pose(step, "pose")
    )

"""Plans made while the page waits: one at a time, in a thread, with progress."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ssm_planner.errors import ProblemError, SsmPlannerError
from ssm_planner.problem.limits import TaskRange
from ssm_planner.problem.motion import Straight, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.typing import Range
from ssm_planner.view.page import SAME, Pose, Study, pose, tilt_range

KEPT = 8
Wanted = tuple[Pose, Pose, Range]
"""Start, target and the tilt range, rad."""


@dataclass
class Job:
    """One planning run; report is the finished page."""

    identity: str
    begin: float = field(default_factory=time.perf_counter)
    steps: list[str] = field(default_factory=list)
    done: bool = False
    message: str = ""
    report: str | None = None

    def progress(self, step: str) -> None:
        self.steps.append(f"{time.perf_counter() - self.begin:.1f} s  {step}")

    def to_dict(self) -> dict[str, Any]:
        address = None if self.report is None else f"/report/{self.identity}"
        return {"steps": list(self.steps), "done": self.done, "message": self.message, "report": address}


class Jobs:
    """The planning runs of one server."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self._jobs: dict[str, Job] = {}
        self._busy = threading.Lock()

    def start(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """{alpha, beta, start, target, tilt_range} or {own: true} → {job}. Raises ProblemError."""
        wanted = self._wanted(request)
        if not self._busy.acquire(blocking=False):
            raise ProblemError("a plan is being made; one at a time")
        job = Job(secrets.token_urlsafe(16))
        self._jobs[job.identity] = job
        for old in list(self._jobs)[:-KEPT]:
            del self._jobs[old]
        threading.Thread(target=self._run, args=(job, wanted), daemon=True).start()
        return {"job": job.identity}

    def progress(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """{job} → {steps, done, message, report}. Raises ProblemError."""
        job = self._jobs.get(str(request.get("job")))
        if job is None:
            raise ProblemError("no such plan", key="job")
        return job.to_dict()

    def report(self, identity: str) -> str | None:
        job = self._jobs.get(identity)
        return None if job is None else job.report

    def _wanted(self, request: Mapping[str, Any]) -> Wanted | None:
        """The straight motion of a request; None for the problem's own motion. Raises ProblemError."""
        if self.study.problem is None:
            raise ProblemError("planning needs a robot with drives: start the view with a problem file")
        if request.get("own") is True:
            return None
        _, own = self.study.mechanism(request)
        if not own:
            raise ProblemError(
                f"the masses of the links are known for the robot's own alpha and beta only (within {SAME:g} rad)"
            )
        return pose(request, "start"), pose(request, "target"), tilt_range(request)

    def _run(self, job: Job, wanted: Wanted | None) -> None:
        job.message = "stopped by a fault of the program; the terminal shows it"
        try:
            job.message, job.report = self._outcome(job, wanted)
        except SsmPlannerError as error:
            job.message = str(error)
        finally:
            job.done = True
            self._busy.release()

    def _outcome(self, job: Job, wanted: Wanted | None) -> tuple[str, str | None]:
        job.progress("loading the planner")
        from ssm_planner.pipeline.run import plan
        from ssm_planner.reporting.html.report import report_page

        problem = self.study.problem
        if problem is None:
            raise ProblemError("planning needs a problem")
        if wanted is not None:
            problem = straight_problem(problem, *wanted)
        result = plan(problem, job.progress)
        if result.trajectory is None:
            return (result.reason.message if result.reason else result.status), None
        job.progress("writing the report")
        page = report_page(result)
        verdict = "passed" if result.passed else "failed"
        return f"planned: {result.duration:.4f} s, independent check {verdict}", page


def straight_problem(problem: Problem, start: Pose, target: Pose, tilt: Range) -> Problem:
    """A straight motion between two poses, rad and m, within the problem's limits and a tilt range. Raises ProblemError."""
    low, high = problem.ranges.get("tilt", tilt)
    wanted = TaskRange("tilt", max(low, tilt[0]), min(high, tilt[1]))
    return Problem(
        problem.robot,
        start=Task(*start),
        motion=(Straight(*target),),
        limits=(*(limit for limit in problem.limits if limit.key != wanted.key), wanted),
        eye=problem.eye,
        name=f"{problem.name}, from the view",
    )

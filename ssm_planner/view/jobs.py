"""Plans made while the page waits: one at a time, in a thread, with progress."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ssm_planner.errors import ProblemError, SsmPlannerError
from ssm_planner.loading.problems import eye_as_written
from ssm_planner.problem.limits import TASK, TaskRate
from ssm_planner.problem.problem import Problem
from ssm_planner.typing import Range
from ssm_planner.view.page import SAME, Study, pose, tilt_range

KEPT = 8


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
        stated = self._problem(request)
        if not self._busy.acquire(blocking=False):
            raise ProblemError("a plan is being made; one at a time")
        job = Job(secrets.token_urlsafe(16))
        self._jobs[job.identity] = job
        for old in list(self._jobs)[:-KEPT]:
            del self._jobs[old]
        threading.Thread(target=self._run, args=(job, stated), daemon=True).start()
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

    def _problem(self, request: Mapping[str, Any]) -> dict[str, Any] | None:
        """The problem of a request as a file states it; None for the problem's own motion. Raises ProblemError."""
        problem = self.study.problem
        if problem is None:
            raise ProblemError("planning needs a robot with drives: start the view with a problem file")
        if request.get("own") is True:
            return None
        _, own = self.study.mechanism(request)
        if not own:
            raise ProblemError(
                f"the masses of the links are known for the robot's own alpha and beta only (within {SAME:g} rad)"
            )
        return _straight(problem, pose(request, "start"), pose(request, "target"), tilt_range(request))

    def _run(self, job: Job, stated: dict[str, Any] | None) -> None:
        job.message = "stopped by a fault of the program; the terminal shows it"
        try:
            job.message, job.report = self._outcome(job, stated)
        except SsmPlannerError as error:
            job.message = str(error)
        finally:
            job.done = True
            self._busy.release()

    def _outcome(self, job: Job, stated: dict[str, Any] | None) -> tuple[str, str | None]:
        job.progress("loading the planner")
        from ssm_planner.pipeline.run import plan
        from ssm_planner.reporting.html.report import report_page

        problem = self.study.problem if stated is None else Problem.from_dict(stated)
        if problem is None:
            raise ProblemError("planning needs a problem")
        result = plan(problem, job.progress)
        if result.trajectory is None:
            return (result.reason.message if result.reason else result.status), None
        job.progress("writing the report")
        page = report_page(result)
        verdict = "passed" if result.passed else "failed"
        return f"planned: {result.duration:.4f} s, independent check {verdict}", page


def _straight(problem: Problem, start: list[float], target: list[float], tilt: Range) -> dict[str, Any]:
    """A straight motion between two poses, as a problem file states it: so it is checked like any other."""

    def quantities(values: list[float]) -> dict[str, str]:
        units = ("rad", "rad", "rad", "m")
        return {name: f"{value!r} {unit}" for name, value, unit in zip(TASK, values, units, strict=True)}

    limits: dict[str, Any] = {
        name: [f"{end!r} {'m' if name == 'depth' else 'rad'}" for end in ends] for name, ends in problem.ranges.items()
    }
    low, high = problem.ranges.get("tilt", tilt)
    limits["tilt"] = [f"{max(low, tilt[0])!r} rad", f"{min(high, tilt[1])!r} rad"]
    for speed in problem.speeds:
        limits[speed.field] = f"{speed.largest!r} {speed.unit}"
    for name, rate in problem.rates.items():
        limits[TaskRate.field_of(name)] = f"{rate!r} {'m' if name == 'depth' else 'rad'}/s"
    return {
        "name": f"{problem.name}, from the view",
        "robot": str(Path(str(problem.robot.file)).resolve()),
        "start": quantities(start),
        "motion": [{"straight": {"to": quantities(target)}}],
        "limits": limits,
        **({} if problem.eye is None else {"eye": eye_as_written(problem.eye)}),
    }

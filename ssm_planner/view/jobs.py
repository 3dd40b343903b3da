"""Plan motions for the local view: one at a time, in a separate process that can be killed.

`PlanningJobs` keeps the pages and the planning runs of one server.
"""

import secrets
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ssm_planner.errors import ProblemError, SsmPlannerError
from ssm_planner.problem import Problem
from ssm_planner.progress import Step
from ssm_planner.studies.workers import Workers
from ssm_planner.typing import JsonObject, frozen
from ssm_planner.view.page import ViewedProblem

if TYPE_CHECKING:
    from ssm_planner.plans import Plan

T = TypeVar("T")
MAX_KEPT_RUNS = 8
"""Number of runs whose results stay available."""


@frozen
class PlanningOutcome:
    """Result of one planning run.

    Attributes
    ----------
    message : str
        Result in words.
    plan : Plan or None
        The plan, if there is a motion.
    """

    message: str
    plan: "Plan | None" = None
    relaxation: str | None = None
    """Description of the smallest change of a limit that permits a motion."""
    changes: Mapping[float, str] = field(default_factory=dict)
    """Changes of limits in words, by the fraction of the full relaxation."""
    desk: JsonObject | None = None
    """Curves and results of the motions for the page, as JSON types."""


@dataclass
class PlanningJob:
    """One planning run.

    Attributes
    ----------
    identity : str
        Name of the run in requests.
    steps : Path
        File to which the planner's process writes its progress.
    outcome : PlanningOutcome or None
        Result, or None while the run is in progress.
    """

    identity: str
    steps: Path
    outcome: PlanningOutcome | None = None

    def to_dict(self) -> JsonObject:
        """Return the state of the run for the page.

        Returns
        -------
        dict
            `steps` lists the progress, and `done` is true after the end. `message`, `relaxation`,
            `changes` and `desk` are those of the outcome. `plan` is the path of plan.json, or None.
        """
        outcome = self.outcome  # The planner may finish during this call.
        result = outcome or PlanningOutcome("")
        return {
            "steps": self.steps.read_text(encoding="utf-8").splitlines(),
            "done": outcome is not None,
            "message": result.message,
            "relaxation": result.relaxation,
            "changes": list(result.changes.items()),
            "desk": result.desk,
            "plan": None if result.plan is None else f"/plan/{self.identity}",
        }


class PlanningJobs:
    """The planning runs of one server, and its pages by their path."""

    def __init__(self, page: ViewedProblem) -> None:
        """Create the first page, and a folder for the progress of the planning runs."""
        self.pages = {"/": page}
        self._jobs: dict[str, PlanningJob] = {}
        self._lock = threading.Lock()
        self._planner_process: Workers | None = None
        self._folder = tempfile.TemporaryDirectory(prefix="ssm_planner_view_")

    def requested_page(self, request: JsonObject) -> ViewedProblem:
        """Return the page that made a request. Raise ProblemError if it is unknown."""
        return _find_requested(self.pages, request, "of")

    def edit(self, request: JsonObject) -> JsonObject:
        """Create a page for a problem that the user has edited.

        Parameters
        ----------
        request : dict
            `text` is a problem in YAML.

        Returns
        -------
        dict
            `page` is the path of the new page.

        Raises
        ------
        ProblemError
            If the text is invalid.
        """
        page = f"/{secrets.token_urlsafe(16)}"
        self.pages[page] = self.requested_page(request).edit(str(request.get("text")))
        return {"page": page}

    def start(self, request: JsonObject) -> JsonObject:
        """Start to plan the motion of a request.

        A run in progress is cancelled, for example that of a page that was closed.

        Parameters
        ----------
        request : dict
            The keys of `ViewedProblem.problem_content`, and three others. `of` is the path of the
            page, "/" or one from `edit`. `relaxed` replaces an infeasible problem by its
            relaxation, a problem with changed limits that has a motion. It is true, or a fraction
            by which the change of the limits is multiplied. `pinned` is another request, whose
            motion A is planned for comparison with the motion B of this request.

        Returns
        -------
        dict
            `job` is the name of the planning run.

        Raises
        ------
        ProblemError
            If a request is invalid.
        """
        requests = []
        for name, item in (("A", request.get("pinned")), ("B", request)):
            if isinstance(item, dict):
                problem = self.requested_page(item).requested_problem(item)
                requests.append((name, problem, item.get("relaxed")))
        with self._lock:
            for active_job in self._jobs.values():
                self._cancel(active_job, "cancelled, because a newer motion is planned")
            identity = secrets.token_urlsafe(16)
            job = self._jobs[identity] = PlanningJob(identity, Path(self._folder.name) / identity)
            job.steps.touch()
            for old_identity in list(self._jobs)[:-MAX_KEPT_RUNS]:
                del self._jobs[old_identity]
            future = self._run_in_planner(run_plan, requests, job.steps)
            future.add_done_callback(partial(self._finish, job))
        return {"job": identity}

    def progress(self, request: JsonObject) -> JsonObject:
        """Return the state of a planning run.

        Parameters
        ----------
        request : dict
            `job` is the name of the run.

        Returns
        -------
        dict
            Result of `PlanningJob.to_dict`: the progress and, after the end, the outcome.

        Raises
        ------
        ProblemError
            If the run is unknown.
        """
        return _find_requested(self._jobs, request, "job").to_dict()

    def cancel(self, request: JsonObject) -> JsonObject:
        """Kill the planner's process, and return the state of the run as `progress` does.

        Parameters
        ----------
        request : dict
            `job` is the name of the run.

        Raises
        ------
        ProblemError
            If the run is unknown.
        """
        job = _find_requested(self._jobs, request, "job")
        with self._lock:
            self._cancel(job, "cancelled")
        return job.to_dict()

    def _cancel(self, job: PlanningJob, message: str) -> None:
        """Kill the planner's process if a run is in progress. The caller holds the lock."""
        if job.outcome is None:
            job.outcome = PlanningOutcome(message)
            self._kill_planner()

    def document(self, text_type: str, identity: str) -> str | None:
        """Return a document of a planning run, or None for a run without a plan.

        A run is one request of the user to plan. The planner's process produces the text.

        Parameters
        ----------
        text_type : str
            "report" for the HTML page, or "plan" for plan.json.
        identity : str
            Name of the run.
        """
        job = self._jobs.get(identity)
        if job is None or job.outcome is None or job.outcome.plan is None:
            return None
        with self._lock:
            future = self._run_in_planner(plan_document, text_type, job.outcome.plan)
        return future.result()

    def _run_in_planner(self, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Run a function in the planner's process. The caller holds the lock."""
        if self._planner_process is None:
            self._planner_process = Workers(1, attempts=1)
        return self._planner_process.submit(function, *arguments)

    def close(self) -> None:
        """Kill the planner's process and delete its files."""
        with self._lock:
            self._kill_planner()
        self._folder.cleanup()

    def _finish(self, job: PlanningJob, future: Future[PlanningOutcome]) -> None:
        """Store the outcome of a run unless it was cancelled.

        Parameters
        ----------
        job : PlanningJob
            The run.
        future : Future
            Finished call of `run_plan` in the planner's process.
        """
        error = future.exception()
        with self._lock:
            if job.outcome is not None:
                return
            if error is None:
                job.outcome = future.result()
            elif isinstance(error, SsmPlannerError):
                job.outcome = PlanningOutcome(str(error))
            else:
                job.outcome = PlanningOutcome(f"stopped by a fault of the program: {error}")

    def _kill_planner(self) -> None:
        """Kill the planner's process."""
        if self._planner_process is not None:
            self._planner_process.shutdown(wait=False, cancel_futures=True)
            self._planner_process = None


def _find_requested(items: Mapping[str, T], request: JsonObject, key: str) -> T:
    """Return the page or the run that a request names under a key.

    Without the key, the name is "/", which is the first page.

    Raises
    ------
    ProblemError
        If the name is unknown.
    """
    item = items.get(str(request.get(key, "/")))
    if item is None:
        raise ProblemError("no such plan or page", key=key)
    return item


def run_plan(requests: Sequence[tuple[str, Problem, Any]], steps: Path) -> PlanningOutcome:
    """Plan problems in the planner's process, and compare their motions.

    Parameters
    ----------
    requests : sequence of (str, Problem, Any)
        For each motion, its name, its problem, and whether a relaxation, that is, a problem with
        changed limits, replaces an infeasible problem: true, or a fraction of the changes.
    steps : Path
        File to which the progress is appended.

    Returns
    -------
    PlanningOutcome
        Result of the last problem, with the curves of all motions.

    Raises
    ------
    ProblemError
        If a problem is invalid.
    """
    start = time.perf_counter()

    def progress(step: Step) -> None:
        """Append a step with its time to the file."""
        with steps.open("a", encoding="utf-8") as file:
            file.write(f"{time.perf_counter() - start:.1f} s  {step}\n")

    progress(Step("loading the planner"))
    from ssm_planner.pipeline.relaxation import changes_of_limits
    from ssm_planner.pipeline.run import plan
    from ssm_planner.pipeline.thermal import with_fast_planner
    from ssm_planner.reporting import answer_lines, comparison_data

    plans: dict[str, Plan] = {}
    for name, problem, relaxation in requests:
        relaxed: list[Problem] = []
        result = plan(with_fast_planner(problem), progress, on_relaxation=relaxed.append)
        changes = changes_of_limits(problem, relaxed[-1]) if relaxed else {}
        if relaxation and result.trajectory is None and relaxed:
            _, easier = changes.get(relaxation, ("", relaxed[-1]))
            result = plan(with_fast_planner(easier), progress)
        if result.trajectory is not None:
            plans[name] = result
    descriptions = {fraction: description for fraction, (description, _) in changes.items()}
    desk = None
    if plans:
        # The first nine characters of a line are its label.
        columns = []
        for planned in plans.values():
            columns.append({line[:9]: line[9:] for line in answer_lines(planned)})
        rows = [[label] + [column.get(label, "") for column in columns] for label in columns[-1]]
        desk = comparison_data(tuple(plans.values()))
        desk["panels"] = [panel for panel in desk["panels"] if panel["section"] == "Motors"]
        desk["names"] = list(plans)
        desk["rows"] = rows
    if result.trajectory is None:
        reason = result.reason
        text = reason.message if reason else result.status
        relaxation = reason.relaxation if reason and relaxed else None
        return PlanningOutcome(text, None, relaxation, descriptions, desk)
    verdict = "passed" if result.passed else "failed"
    text = f"planned: {result.duration:.4f} s, independent check {verdict}"
    return PlanningOutcome(text, result, changes=descriptions, desk=desk)


def plan_document(text_type: str, plan: "Plan") -> str:
    """Return the report of a plan as HTML ("report"), or the content of plan.json ("plan")."""
    from ssm_planner.reporting import report_page

    return report_page(plan) if text_type == "report" else plan.to_json()

"""Run `ssm-planner study FILE`, which compares many candidate robots over a set of motions."""

import sys
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import ssm_planner as ssm
from ssm_planner.cli.shared import FAILED, OK, fill_in_template, print_result, progress_reporter
from ssm_planner.display import format_number, plain_words
from ssm_planner.errors import ProblemError
from ssm_planner.progress import Step
from ssm_planner.typing import Files, JsonObject

MAX_PRINTED_ROWS = 12
"""Largest number of candidates on the front, and of reasons, in the terminal."""


def run_study(options: Namespace) -> int:
    """Run a study, or show, compare or audit its results, and return the exit status.

    The first word of the arguments selects the action: "show", "compare" or "audit". Any other word
    is the study file to run.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status of the action.
    """
    verb, numbers, file = _parse_words(options.words)
    if verb == "audit":
        return _run_audit(Path(file), options)
    study = ssm.load_study(file)
    folder = options.output or Path("results") / study.name
    if verb == "study":
        return _run_candidates(study, folder, options)
    from ssm_planner.studies.show import compare_candidates, write_candidate

    if verb == "show":
        paths: list[Path] = []
        for number in numbers:
            paths += write_candidate(study, folder, number)
        print_result(options, {"files": paths}, [f"file: {path}" for path in paths])
        return OK
    document = compare_candidates(study, folder, *numbers)
    print_result(options, document, _comparison_lines(document))
    return OK


def _parse_words(words: Sequence[str]) -> tuple[str, list[int], str]:
    """Parse the words of the command.

    Parameters
    ----------
    words : sequence of str
        A study file, or "show", "compare" or "audit" with its arguments.

    Returns
    -------
    verb : str
        "study", "show", "compare" or "audit".
    numbers : list of int
        Numbers of candidates.
    file : str
        Study file, or folder of the results for "audit".

    Raises
    ------
    ProblemError
        If the arguments do not suit the verb.
    """
    verb = words[0]
    if verb not in ("show", "compare", "audit"):
        if len(words) > 1:
            raise ProblemError("give a single study file", value=" ".join(words), key="FILE")
        return "study", [], verb
    numbers = words[1:-1]
    if verb == "show":
        required = "at least one of the table's numbers and the study file"
        is_valid = len(words) > 2
    elif verb == "compare":
        required = "two of the table's numbers and the study file"
        is_valid = len(words) == 4
    else:
        required = "one folder of results"
        is_valid = len(words) == 2 and bool(words[1])
    if not is_valid or not all(map(str.isdecimal, numbers)):
        raise ProblemError(f"{verb} needs {required}", key=verb)
    return verb, list(map(int, numbers)), words[-1]


def _run_candidates(study: ssm.Study, folder: Path, options: Namespace) -> int:
    """Evaluate the candidates of a study, print the front, and return the exit status.

    Parameters
    ----------
    study : Study
        Study that is run.
    folder : Path
        Folder of the results.
    options : Namespace
        Options of the command.

    Returns
    -------
    int
        Exit status: 0, 1 if no candidate passed, and 130 after an interruption.
    """
    from ssm_planner.studies import run as studies
    from ssm_planner.studies.store import write_table

    with _dask_executor(options.scheduler) as executor:
        result = studies.study(study, folder, options.workers, executor, _progress_reporter())
    if options.table is not None:
        write_table(result.rows, options.table)
    files = {
        path.name: path
        for path in sorted(folder.iterdir())
        if path.suffix in (".csv", ".html", ".png")
    }
    document = {
        "study": study.name,
        "candidates": len(result.rows),
        "states": result.states,
        "front": [_candidate_entry(row) for row in result.front],
        "own": _candidate_entry(result.own),
        "better": [row.number for row in result.better],
        "reasons": result.reasons,
        "notes": result.notes,
        "finished": result.finished,
        "files": files,
    }
    print_result(options, document, _study_lines(study, result, files))
    if not result.finished:
        print("ssm-planner: interrupted; the same command continues", file=sys.stderr)
        return 130
    return OK if result.front else FAILED


def _run_audit(folder: Path, options: Namespace) -> int:
    """Audit the results of a study in a folder, and return the exit status.

    Parameters
    ----------
    folder : Path
        Folder of the results.
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status: 0 if the audit found no fault, and 1 otherwise.
    """
    audit = ssm.audit_study(
        folder, tolerance=options.tolerance, workers=options.workers, progress=_progress_reporter()
    )
    verdict = (
        f"audit: {'PASSED' if audit.passed else 'FAILED'}: {len(audit.planned)} candidates were "
        f"planned again; {len(audit.faults)} faults"
    )
    document = {**vars(audit), "passed": audit.passed}
    lines = list(audit.faults) + list(audit.notes) + [verdict]
    print_result(options, document, lines)
    return OK if audit.passed else FAILED


@contextmanager
def _dask_executor(address: str | None) -> Iterator[Executor | None]:
    """Yield the executor of a Dask scheduler, or None without an address.

    Parameters
    ----------
    address : str or None
        Address of the scheduler, the value of --scheduler.

    Yields
    ------
    Executor or None
        Executor whose connection ends with the `with` statement.

    Raises
    ------
    ProblemError
        If the package distributed is not installed, or if no scheduler answers.
    """
    if address is None:
        yield None
        return
    try:
        import distributed

        connect: Any = distributed.Client
        client = connect(address, timeout="10s")
    except ImportError:
        raise ProblemError(
            "needs the package distributed: pip install 'ssm_planner[dask]'",
            key="--scheduler",
            value=address,
        ) from None
    except (OSError, ValueError, TimeoutError) as error:
        raise ProblemError(
            f"no scheduler answers: {error}", key="--scheduler", value=address
        ) from None
    with client:
        yield client.get_executor(retries=3)


def _progress_reporter() -> Callable[[int, int, dict[str, int]], None]:
    """Return a function that reports on stderr how many candidates are finished.

    Returns
    -------
    callable
        Function of the number of finished candidates, the number of all candidates, and the number
        of finished candidates in each state.
    """
    progress = progress_reporter()

    def report(done: int, count: int, states: dict[str, int]) -> None:
        """Report the number of finished candidates, and how many are in each state."""
        text = ", ".join(f"{number} {state}" for state, number in sorted(states.items()))
        progress(Step(text, done, count))

    return report


def _candidate_entry(row: ssm.Candidate) -> JsonObject:
    """Return the number, the design and the figures of a candidate for --json."""
    return {"number": row.number, "design": dict(row.design), "figures": dict(row.figures)}


def _study_lines(study: ssm.Study, result: ssm.StudyResult, files: Files) -> list[str]:
    """Return the rejections, the front and the summary of a study as lines of text.

    Parameters
    ----------
    study : Study
        Study that was run.
    result : StudyResult
        Its results.
    files : dict
        Paths of the written files by name.

    Returns
    -------
    list of str
        Lines of text.
    """
    from ssm_planner.studies.page import compare_with_original, design_texts, format_result

    front = []
    for row in result.front:
        values = ", ".join(format_result(name, row.figures) for name in study.minimise)
        choices = ", ".join(f"{path} {value}" for path, value in design_texts(study, row).items())
        front.append((row.number, values, choices))
    return fill_in_template(
        "studied.txt",
        study=study,
        result=result,
        files=files,
        front=front,
        objectives=map(plain_words, study.minimise),
        comparison=compare_with_original(study, result.own, result.front),
        rows=MAX_PRINTED_ROWS,
    )


def _comparison_lines(document: JsonObject) -> list[str]:
    """Format the comparison of two candidates as a table.

    Parameters
    ----------
    document : dict
        Output of --json: pairs of values by name under `design` and `figures`, and the `numbers` of
        the candidates.

    Returns
    -------
    list of str
        Lines of the table.
    """
    from ssm_planner.reporting import Table
    from ssm_planner.studies.page import axis_title, result_unit

    rows = []
    for name, pair in {**document["design"], **document["figures"]}.items():
        _, scale = result_unit(name)
        row = [axis_title(name) if name in document["figures"] else name]
        for value in pair:
            row.append(format_number(scale * value, 5) if isinstance(value, float) else str(value))
        rows.append(row)
    header = [""] + list(map(str, document["numbers"]))
    return Table(header, rows, (1, 2)).lines()

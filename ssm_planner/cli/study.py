"""Run `ssm-planner study FILE`, which compares many candidate robots over a set of motions."""

import sys
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import ssm_planner as ssm
from ssm_planner.cli.shared import FAILED, OK, progress_reporter, show
from ssm_planner.display import number, plain_words
from ssm_planner.errors import ProblemError
from ssm_planner.progress import Step
from ssm_planner.typing import Files, JsonObject

MAX_ROWS = 12
"""Largest number of candidates on the front, and of reasons, in the terminal."""


def run_study(options: Namespace) -> int:
    verb, numbers, file = _request(options.words)
    if verb == "audit":
        return _audit(Path(file), options)
    study = ssm.load_study(file)
    folder = options.output or Path("results") / study.name
    if verb == "study":
        return _study(study, folder, options)
    from ssm_planner.studies.show import compare_candidates, write_candidate

    if verb == "show":
        paths = [path for number in numbers for path in write_candidate(study, folder, number)]
        show(options.json, {"files": paths}, lambda: [f"file: {path}" for path in paths])
        return OK
    document = compare_candidates(study, folder, *numbers)
    show(options.json, document, lambda: _compared_lines(document))
    return OK


def _request(words: Sequence[str]) -> tuple[str, list[int], str]:
    """Parse the words of the command.

    Returns "study", "show", "compare" or "audit", the numbers of the candidates, and the study file
    or the folder of the results. Raises ProblemError.
    """
    verb, *numbers = words
    if verb not in ("show", "compare", "audit"):
        if numbers:
            raise ProblemError("give a single study file", value=" ".join(words), key="FILE")
        return "study", [], verb
    *numbers, file = numbers or [""]
    required, enough = {
        "show": ("at least one of the table's numbers and the study file", len(numbers) > 0),
        "compare": ("two of the table's numbers and the study file", len(numbers) == 2),
        "audit": ("one folder of results", file and not numbers),
    }[verb]
    if not enough or not all(word.isdecimal() for word in numbers):
        raise ProblemError(f"{verb} needs {required}", key=verb)
    return verb, [int(word) for word in numbers], file


def _study(study: ssm.Study, folder: Path, options: Namespace) -> int:
    from ssm_planner.studies import run as studies
    from ssm_planner.studies.store import write_table

    with _executor(options.scheduler) as executor:
        result = studies.study(study, folder, options.workers, executor, _progress())
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
        "front": [_entry(row) for row in result.front],
        "own": _entry(result.own),
        "better": [row.number for row in result.better],
        "reasons": result.reasons,
        "notes": result.notes,
        "finished": result.finished,
        "files": files,
    }
    show(options.json, document, lambda: _lines(study, result, files))
    if not result.finished:
        print("ssm-planner: interrupted; the same command continues", file=sys.stderr)
        return 130
    return OK if result.front else FAILED


def _audit(folder: Path, options: Namespace) -> int:
    audit = ssm.audit_study(
        folder, tolerance=options.tolerance, workers=options.workers, progress=_progress()
    )
    verdict = (
        f"audit: {'PASSED' if audit.passed else 'FAILED'}: {len(audit.planned)} candidates were "
        f"planned again; {len(audit.faults)} faults"
    )
    document = {**vars(audit), "passed": audit.passed}
    show(options.json, document, lambda: [*audit.faults, *audit.notes, verdict])
    return OK if audit.passed else FAILED


@contextmanager
def _executor(address: str | None) -> Iterator[Executor | None]:
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


def _progress() -> Callable[[int, int, dict[str, int]], None]:
    """Return a function that reports on stderr how many candidates are finished."""
    progress = progress_reporter()
    return lambda done, count, states: progress(
        Step(", ".join(f"{n} {state}" for state, n in sorted(states.items())), done, count)
    )


def _entry(row: ssm.Candidate) -> JsonObject:
    return {"number": row.number, "design": dict(row.design), "figures": dict(row.figures)}


def _lines(study: ssm.Study, result: ssm.StudyResult, files: Files) -> list[str]:
    from ssm_planner.studies.page import against_own, displayed_choices, in_words

    states = ", ".join(f"{count} {state}" for state, count in result.states.items())
    front = result.front
    lines = [
        "Why candidates fall out",
        *(f"  {n:>6}  {reason}" for reason, n in list(result.reasons.items())[:MAX_ROWS]),
        *("", *result.notes, *(f"file: {path}" for path in files.values()), ""),
    ]
    lines += [f"Front in {', '.join(map(plain_words, study.minimise))}: {len(front)} candidates"]
    for row in front[:MAX_ROWS]:
        figures = ", ".join(in_words(name, row.figures) for name in study.minimise)
        choices = ", ".join(
            f"{path} {value}" for path, value in displayed_choices(study, row).items()
        )
        lines.append(f"  {row.number:>6}  {figures}  ({choices})")
    if len(front) > MAX_ROWS:
        lines.append(f"  … and {len(front) - MAX_ROWS} more in table.csv")
    summary = f"{study.name}: {len(result.rows)} candidates: {states}; {len(front)} on the front"
    return [*lines, "", against_own(study, result.own, front), summary]


def _compared_lines(document: JsonObject) -> list[str]:
    from ssm_planner.reporting import Table
    from ssm_planner.studies.page import title_of, unit_of

    rows = []
    for name, pair in {**document["design"], **document["figures"]}.items():
        scale = unit_of(name)[1]
        cells = (number(scale * x, 5) if isinstance(x, float) else str(x) for x in pair)
        rows.append((title_of(name) if name in document["figures"] else name, *cells))
    return Table(("", *map(str, document["numbers"])), rows, (1, 2)).lines()

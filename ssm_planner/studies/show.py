"""Write the robot file, the plans and the pages of one candidate, or compare two candidates.

The commands `study show` and `study compare` call this module. It reads the results that `study`
has stored.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from ssm_planner.atomic import write_text
from ssm_planner.errors import ProblemError
from ssm_planner.pipeline.folder import write_folder
from ssm_planner.reporting import write_report
from ssm_planner.studies.evaluation import plan_candidate
from ssm_planner.studies.page import write_study_page
from ssm_planner.studies.provenance import context_hash, describe_differences, describe_study
from ssm_planner.studies.run import PAGE_FILE, open_existing_store
from ssm_planner.studies.store import Candidate, check_not_link
from ssm_planner.studies.study import Study
from ssm_planner.typing import Fields, JsonObject


def load_candidates(study: Study, folder: Path) -> dict[int, Candidate]:
    """Return the stored candidates of a study by number.

    Parameters
    ----------
    study : Study
        Study whose results are read.
    folder : Path
        Folder of the results.

    Returns
    -------
    dict of Candidate
        Candidates with their results by number. The original robot has the number −1.

    Raises
    ------
    ProblemError
        If the folder does not contain a store, or contains that of another study or program.
    """
    current = describe_study(study)
    with open_existing_store(folder) as store:
        differing = describe_differences(store.description(), current)
        if differing:
            raise ProblemError(
                "the folder contains the results of another study or program: "
                f"{', '.join(differing)}",
                file=store.path,
                allowed="the results of this study; `study FILE -o DIR` computes them",
            )
        store.set_description(current, context_hash(current))
        return {row.number: row for row in store.rows()}


def find_candidate(rows: Mapping[int, Candidate], number: int) -> Candidate:
    """Return the candidate with a given number.

    Parameters
    ----------
    rows : mapping of int to Candidate
        Candidates with their results, by number.
    number : int
        Number of the candidate.

    Returns
    -------
    Candidate
        The candidate.

    Raises
    ------
    ProblemError
        If the candidate does not exist.
    """
    if number not in rows:
        raise ProblemError(
            "this candidate does not exist",
            value=number,
            key="number",
            allowed=f"0 to {max(rows, default=0)}",
        )
    return rows[number]


def write_candidate(study: Study, folder: Path, number: int) -> list[Path]:
    """Write the robot file, the plans and the pages of a candidate, and return their paths.

    The page of the study is written again, so that it links to the pages of the candidate.

    Parameters
    ----------
    study : Study
        Study that contains the candidate.
    folder : Path
        Folder of the results. The files are written into its subfolder candidate_N.
    number : int
        Number N of the candidate.

    Returns
    -------
    list of Path
        The robot file, and all files of the plans.

    Raises
    ------
    ProblemError
        If the candidate does not exist, or if one of its motions cannot be planned.
    ExportError
        If a file cannot be written.
    """
    rows = load_candidates(study, folder)
    row = find_candidate(rows, number)
    target = folder / f"candidate_{number}"
    robot = target / "robot.yaml"
    tree = study.resolved(study.complete_design(row.design, row.figures))
    tree["name"] = f"{tree['name']}, candidate {number}"
    tree["source"] = f"study {study.name}; {tree.get('source', '')}"
    text = yaml.safe_dump(tree, sort_keys=False, allow_unicode=True)
    check_not_link(robot)
    write_text(robot, f"# Candidate {number} of the study {study.name}.\n{text}")
    paths = [robot]
    for name, plan in plan_candidate(study, row).items():
        if not plan.passed:
            reason = "" if plan.reason is None else plan.reason.message
            raise ProblemError(f"candidate {number}: the motion {name} cannot be planned: {reason}")
        paths += write_folder(plan, target / name).values()
        paths.append(write_report(plan, target / name / "report.html"))
    write_study_page(study, tuple(rows.values()), folder / PAGE_FILE, finished=True)
    return paths


def compare_candidates(study: Study, folder: Path, number_1: int, number_2: int) -> JsonObject:
    """Return the designs and the results of two candidates side by side, as JSON types.

    Parameters
    ----------
    study : Study
        Study that contains the candidates.
    folder : Path
        Folder of the results.
    number_1, number_2 : int
        Numbers of the candidates.

    Returns
    -------
    dict
        `study` and `numbers` identify the candidates. `design` (values that define a candidate) and
        `figures` (its numerical results) contain pairs of values by name.

    Raises
    ------
    ProblemError
        If a candidate does not exist.
    """
    rows = load_candidates(study, folder)
    a = find_candidate(rows, number_1)
    b = find_candidate(rows, number_2)
    design_a = study.complete_design(a.design, a.figures)
    design_b = study.complete_design(b.design, b.figures)
    return {
        "study": study.name,
        "numbers": [number_1, number_2],
        "design": _value_pairs(design_a, design_b),
        "figures": _value_pairs(a.figures, b.figures),
    }


def _value_pairs(a: Fields, b: Fields) -> dict[str, tuple[Any, Any]]:
    """Return the values of two mappings as pairs by name. A missing value is None."""
    return {name: (a.get(name), b.get(name)) for name in {**a, **b}}

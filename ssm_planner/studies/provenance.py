"""Describe the program and the inputs that determine the results of a study.

A stored result is used again only if the hash of this description (`context_hash`) is the same.
"""

import hashlib
import json
import os
from dataclasses import asdict
from functools import cache
from importlib.metadata import entry_points, version
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from ssm_planner.errors import ProblemError
from ssm_planner.native.library import load
from ssm_planner.publishing import sha256
from ssm_planner.studies.store import hash_contents
from ssm_planner.studies.study import Study
from ssm_planner.typing import JsonObject

NUMERICAL_LIBRARIES = ("casadi", "numpy", "scipy", "toppra")
"""Packages whose version may change the results."""
SOURCE_SUFFIXES = (".py", ".c", ".h", ".csv")
"""Suffixes of the files of this package that may change the results."""


@cache
def describe_program() -> dict[str, str]:
    """Describe the program that computes the results.

    Returns
    -------
    dict
        Texts by name: the hash of the package's sources, whether the compiled part is in use, and
        the versions of the numerical libraries and of packages that extend this one.
    """
    folder = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.*")):
        if path.suffix in SOURCE_SUFFIXES:
            digest.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    result = {
        "ssm_planner": digest.hexdigest()[:16],
        "compiled part": "in use" if load() else "not in use",
    }
    for name in NUMERICAL_LIBRARIES:
        result[name] = version(name)
    for group in ("ssm_planner.drives", "ssm_planner.motions"):
        for point in entry_points(group=group):
            if point.dist:
                result[point.dist.name] = point.dist.version
    return result


def describe_study(study: Study) -> JsonObject:
    """Describe the program and all inputs of a study as JSON types.

    The name of the study and of its file are left out, because they do not affect the results. The
    hashes of tables that motions read are included.

    Parameters
    ----------
    study : Study
        Study that is described.

    Returns
    -------
    dict
        Fields of the study by name, the result of `describe_program` under "program", and the
        SHA-256 of each table by its path under "tables".
    """
    inputs = {**asdict(study), "program": describe_program(), "tables": {}}
    del inputs["name"], inputs["file"]
    for motion in study.motions.values():
        for entry in motion.get("motion", ()):
            if isinstance(entry, dict) and "path" in entry:
                path = str(entry["path"])
                inputs["tables"][path] = sha256(Path(path)) if os.path.isfile(path) else None
    return json.loads(json.dumps(inputs, default=str))


def study_from_description(description: JsonObject, name: str) -> Study:
    """Build the study that a stored description describes.

    Parameters
    ----------
    description : dict
        Result of `describe_study`.
    name : str
        Name of the study, which a description does not contain.

    Returns
    -------
    Study
        The study.

    Raises
    ------
    ProblemError
        If no study has this description.
    """
    try:
        return TypeAdapter(Study).validate_python({**description, "name": name})
    except ValidationError as error:
        raise ProblemError(f"this folder does not describe a study: {error}", file=name) from None


def context_hash(description: JsonObject) -> str:
    """Return the hash of everything that determines the result of a design.

    The search and the objectives are left out, so results remain valid if only these change.
    """
    return hash_contents(json.dumps({**description, "search": 0, "minimise": 0}, sort_keys=True))


def describe_differences(previous: JsonObject, current: JsonObject) -> list[str]:
    """Describe what differs between two descriptions of studies or programs.

    Parameters
    ----------
    previous, current : dict
        Results of `describe_study` or `describe_program`.

    Returns
    -------
    list of str
        Name of each entry that differs. For texts, both values are added.
    """
    texts = []
    for name in sorted(previous.keys() | current.keys()):
        old = previous.get(name)
        new = current.get(name)
        if name == "program":
            texts += describe_differences(old or {}, new or {})
        elif old != new:
            texts.append(f"{name} ({old} instead of {new})" if isinstance(old, str) else name)
    return texts

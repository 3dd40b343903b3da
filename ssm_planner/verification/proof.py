"""Run the program prove.py, which bounds every limited quantity of a plan over continuous time.

The program is one file that needs only NumPy and shares no code with this package (docs/trust.md).
`prove` runs it in a separate process on a plan.json. `prove_motion` runs it in this process on a
motion that has not been written yet.
"""

from __future__ import annotations

import json
import runpy
import subprocess
import sys
from collections.abc import Iterable
from math import isfinite
from pathlib import Path
from typing import Any, Literal

from ssm_planner.arguments import checked
from ssm_planner.atomic import write_text
from ssm_planner.errors import TrajectoryError
from ssm_planner.problem import Problem, to_plain
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import JsonObject, frozen

PACKAGE_FOLDER = Path(__file__).resolve().parents[1]
PROGRAM_PATHS = (
    PACKAGE_FOLDER / "checker/prove.py",
    PACKAGE_FOLDER.parent / "examples" / "prove.py",
)
"""Possible paths of the program, in an installed package and in the source tree.

When Python runs a program, it searches the folder of the program for modules first. The folder
`checker` therefore contains no modules.
"""

LimitKey = tuple[str, str | None]
"""Name of a limit in the certificate, and its joint."""


@frozen
class Proof:
    """Bounds on the worst value of one limit for all times.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> proofs = ssm.prove("results/tilt_insert")
    >>> {proof.verdict for proof in proofs}
    {'PROVEN'}
    """

    name: str
    """Name of the limit, as in the certificate."""
    joint: str | None
    low: float | None
    high: float | None
    """Ends of an interval that contains the worst value, in SI units. None stands for infinity."""
    limit: float
    time: float
    """Time of the worst value, s."""
    excess: float | None
    """Upper bound of the excess over the limit, as a share of the limit. None without a bound."""
    verdict: Literal["PROVEN", "REFUTED", "OPEN"]

    def to_dict(self) -> JsonObject:
        """Return the proof as a dict of its attributes, in SI units.

        plan.json and the output of `check --json` contain this dict as an entry of `proof`.
        """
        return dict(vars(self))


def _proof_from_claim(claim: dict[str, Any]) -> Proof:
    """Build a proof from one entry of the output of prove.py.

    Infinite bounds become None, because JSON does not contain infinite numbers.

    Parameters
    ----------
    claim : dict
        Values of the attributes of `Proof` by their names.

    Returns
    -------
    Proof
        The proof.
    """
    values = dict(claim)
    for name, value in claim.items():
        if isinstance(value, float) and not isfinite(value):
            values[name] = None
    return Proof(**values)


def _program_path() -> Path:
    """Return the first of `PROGRAM_PATHS` at which there is a file."""
    return next(path for path in PROGRAM_PATHS if path.is_file())


def prove_motion(trajectory: Trajectory, problem: Problem) -> tuple[Proof, ...]:
    """Bound every limit of a motion over continuous time by the program prove.py.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    problem : Problem
        The problem with robot and limits.

    Returns
    -------
    tuple of Proof
        One proof for each limit that the program knows.
    """
    document = {
        "problem": to_plain(problem),
        "trajectory": trajectory.to_dict(),
        "certificate": {"limits": []},
    }
    program = runpy.run_path(str(_program_path()))
    return tuple(_proof_from_claim(claim._asdict()) for claim in program["prove"](document))


def unproven_limits(proofs: Iterable[Proof], names: Iterable[LimitKey]) -> list[LimitKey]:
    """Select the limits that were not proven.

    Parameters
    ----------
    proofs : iterable of Proof
        Results of prove.py.
    names : iterable of (str, str or None)
        Names of limits and of their joints. The joint is None for a limit of the tool or the task.

    Returns
    -------
    list of (str, str or None)
        Entries of `names` without a proof, in the same order.
    """
    proven = {(proof.name, proof.joint) for proof in proofs if proof.verdict == "PROVEN"}
    return [name for name in names if name not in proven]


@checked
def prove(plan: str | Path, program: str | Path | None = None) -> tuple[Proof, ...]:
    """Bound every limit of a plan over continuous time by the separate program prove.py.

    Parameters
    ----------
    plan : str or Path
        plan.json, or the result folder that contains it.
    program : str or Path, optional
        File to which the program is copied before it runs. The default runs the shipped file.

    Returns
    -------
    tuple of Proof
        One value for each limit of the certificate.

    Raises
    ------
    TrajectoryError
        If the file is not a plan.
    ExportError
        If the program cannot be written.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> proofs = ssm.prove("results/tilt_insert")
    >>> len(proofs), all(proof.high <= abs(proof.limit) for proof in proofs[:2])
    (46, True)
    """
    file = Path(plan) / "plan.json" if Path(plan).is_dir() else Path(plan)
    source = _program_path()
    if program is not None:
        write_text(Path(program), source.read_text(encoding="utf-8"))
        source = Path(program)
    command = [sys.executable, str(source), str(file), "--json"]
    outcome = subprocess.run(command, capture_output=True, text=True, encoding="utf-8")
    # An exception in the program gives the same exit status as a refuted limit, but no output.
    if not outcome.stdout:
        raise TrajectoryError(f"{source}: {outcome.stderr.strip().splitlines()[-1]}")
    return tuple(map(_proof_from_claim, json.loads(outcome.stdout)))

"""Run the program prove.py, which bounds every limit of a plan.json over continuous time.

The program is one file that needs only NumPy and shares no code with this package
(docs/trust.md). It runs in a process of its own.
"""

from __future__ import annotations

import json
import subprocess
import sys
from math import isfinite
from pathlib import Path
from types import NoneType
from typing import Literal

from ssm_planner.arguments import checked
from ssm_planner.atomic import write_text
from ssm_planner.errors import TrajectoryError
from ssm_planner.typing import JsonObject, frozen

PACKAGE = Path(__file__).resolve().parents[1]
PROGRAMS = (PACKAGE / "checker/prove.py", PACKAGE.parent / "examples" / "prove.py")
"""Possible paths of the program: in an installed package, and in the source tree.

Python searches the folder of a program for modules first, so this folder contains no others.
"""


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
    low: float
    high: float
    """Ends of an interval that contains the worst value, in SI units."""
    limit: float
    time: float
    """Time of the worst value, s."""
    excess: float
    """Upper bound of the excess over the limit, as a share of the limit."""
    verdict: Literal["PROVEN", "REFUTED", "OPEN"]

    def to_dict(self) -> JsonObject:
        """Return the entry of `proof` in the output of `check --json`. Infinite ends are None."""
        return {
            name: value if isinstance(value, (str, NoneType)) or isfinite(value) else None
            for name, value in vars(self).items()
        }


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
    source = next(path for path in PROGRAMS if path.is_file())
    if program is not None:
        write_text(Path(program), source.read_text(encoding="utf-8"))
        source = Path(program)
    command = [sys.executable, str(source), str(file), "--json"]
    outcome = subprocess.run(command, capture_output=True, text=True, encoding="utf-8")
    # An exception of Python has the status of a refuted limit, but prints no result.
    if not outcome.stdout:
        raise TrajectoryError(f"{source}: {outcome.stderr.strip().splitlines()[-1]}")
    return tuple(Proof(**claim) for claim in json.loads(outcome.stdout))

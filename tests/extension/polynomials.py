"""An example of an external package adds an export format, which writes the polynomials of the
joints as a NumPy archive.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.formats.format import Format
from ssm_planner.formats.points import Reading
from ssm_planner.trajectory import Trajectory

POLYNOMIALS = Format(
    "polynomials",
    "polynomials:write",
    "polynomials of the joints as a NumPy archive",
    {"compressed": "yes or no (default no)"},
    reader="polynomials:read",
)


def write(plan: Any, certificate: Any, folder: Path, suffix: str, compressed: str = "no") -> Any:
    """Write motion.npz and return the entries of the manifest."""
    save = np.savez_compressed if compressed == "yes" else np.savez
    motion = plan.motion
    save(folder / f"motion{suffix}.npz", breaks=motion.breaks, coefficients=motion.coefficients)
    return {"units": "s, rad and m", "rate_hz": None}


def read(folder: Path, manifest: Any, intact: frozenset[str], robot: Any) -> Reading:
    """Read the archive of an export folder."""
    (name,) = intact
    with np.load(folder / name) as arrays:
        motion = Trajectory(arrays["breaks"], arrays["coefficients"], ())
    return Reading(motion, "polynomials", None)

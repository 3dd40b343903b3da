"""What moves a limit that the independent check found exceeded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.relaxation import relaxation_for
from ssm_planner.pipeline.run import _exceeded
from ssm_planner.problem.limits import Limit, RetinaClearance
from ssm_planner.verification.certificate import Certificate, LimitCheck

PROBLEM = load_problem(Path(__file__).parents[2] / "problems/eye_approach.yaml")

MOVABLE = [limit for limit in PROBLEM.all_limits if np.isfinite(limit.low) or np.isfinite(limit.high)]


def certificate(limit: Limit, worst: float, bound: float) -> Certificate:
    """A check that found one limit exceeded."""
    found = LimitCheck(
        name=limit.name, joint=limit.joint, worst=worst, limit=bound, margin=-0.1, time=0.5, unit=limit.unit
    )
    return Certificate((found,), "quintic polynomial pieces", 1000)


@pytest.mark.parametrize("limit", MOVABLE, ids=lambda limit: f"{limit.key}")
def test_an_exceeded_limit_is_moved_so_that_what_was_found_is_allowed(limit: Limit) -> None:
    bound = limit.low if limit.is_floor else limit.high
    worst = bound + (-0.1 if limit.is_floor else 0.1) * (abs(bound) or 1.0)
    reason = _exceeded(PROBLEM, certificate(limit, worst, bound))
    found = relaxation_for(PROBLEM, reason)
    if found is None:
        return
    moved = limit.relaxed(found.needed)
    assert moved is not None
    assert moved.allows(worst)
    assert not limit.allows(worst)


def test_a_clearance_that_was_not_kept_is_lowered_to_what_was_kept() -> None:
    clearance = next(limit for limit in PROBLEM.all_limits if isinstance(limit, RetinaClearance))
    kept = 0.9 * clearance.clearance
    found = relaxation_for(PROBLEM, _exceeded(PROBLEM, certificate(clearance, kept, clearance.clearance)))
    assert found is not None
    assert (found.needed, found.present) == (kept, clearance.clearance)

"""Small samples of the campaigns find no failure.

The campaigns check hostile, tampered, violating and healthy files, and faulty executions.
"""

from __future__ import annotations

import itertools
from types import ModuleType

import pytest

from ssm_planner.verification.certificate import LimitCheck
from tests.campaign import adversary, executions, healthy, mutated, tampered, violations

COUNTS = {adversary: 48, healthy: 20, mutated: 44, tampered: 40, violations: 80, executions: 24}


@pytest.mark.parametrize("campaign", COUNTS, ids=lambda module: module.__name__.split(".")[-1])
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.slow
def test_a_slice_of_the_campaign_finds_nothing(campaign: ModuleType) -> None:
    pytest.importorskip("rosbags")
    rows = campaign.run(COUNTS[campaign], seed=0)
    assert rows
    assert all(row.cases > 0 for row in rows)
    assert [(row.kind, row.examples) for row in rows if row.failures] == []


@pytest.mark.slow
def test_the_adversary_finds_a_check_that_looks_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """The adversary finds files that a check with too large tolerances accepts.

    This check accepts values up to 0.5 % beyond a limit. The oracle calls such values violated. The
    formats are searched one after the other until enough such files are found.
    """

    def looser(self: LimitCheck) -> bool:
        return self.margin >= -5e-3

    monkeypatch.setattr(LimitCheck, "passed", property(looser))
    failures = itertools.accumulate(row.failures for row in adversary.climbs(240, seed=1))
    assert any(total > 3 for total in failures)

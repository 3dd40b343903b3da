"""A small slice of the campaigns over hostile and tampered files and seeded violations."""

from __future__ import annotations

import pytest

from tests.campaign import mutated, tampered, violations


@pytest.mark.parametrize(
    "campaign", [mutated, tampered, violations], ids=lambda module: module.__name__.split(".")[-1]
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.slow
def test_a_slice_of_the_campaign_finds_nothing(campaign: object) -> None:
    pytest.importorskip("rosbags")
    count = {"mutated": 44, "tampered": 40, "violations": 80}[campaign.__name__.split(".")[-1]]  # type: ignore[attr-defined]
    rows = campaign.run(count, seed=0)  # type: ignore[attr-defined]
    assert rows
    assert all(row.cases > 0 for row in rows)
    assert [(row.kind, row.examples) for row in rows if row.failures] == []

"""Fixtures of the identification tests."""

from __future__ import annotations

import pytest

from ssm_planner.identification import sampling


@pytest.fixture
def few_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sample posteriors at few points, for tests that need no accurate intervals."""
    monkeypatch.setattr(sampling, "ADAPTATION", (2**11,) * 4)
    monkeypatch.setattr(sampling, "POINTS", 2**12)

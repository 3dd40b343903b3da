"""Fixtures that the tests of planning share."""

from tests.planning.conftest import weaker, with_jerk

__all__ = ["weaker", "with_jerk"]

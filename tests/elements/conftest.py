"""Import fixtures of the planner's tests."""

from tests.planning.conftest import weaker, with_jerk

__all__ = ["weaker", "with_jerk"]

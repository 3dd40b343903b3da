"""Guard a motion while it runs: an export format in C, and the same guard in Python."""

from ssm_planner.formats.format import Format
from ssm_planner_guard.export import write as write
from ssm_planner_guard.native import NativeGuard as NativeGuard
from ssm_planner_guard.native import guard_of as guard_of
from ssm_planner_guard.thresholds import Thresholds as Thresholds
from ssm_planner_guard.thresholds import thresholds_of as thresholds_of
from ssm_planner_guard.twin import Alarm as Alarm
from ssm_planner_guard.twin import Cause as Cause
from ssm_planner_guard.twin import Guard as Guard
from ssm_planner_guard.twin import Sample as Sample

GUARD = Format(
    "guard",
    "ssm_planner_guard.export:write",
    "the C export and a guard that compares measurements with the plan",
    {"rate": "ticks of the guard per second (default 1000)"},
)
"""The export format, which pyproject.toml registers."""

"""Tolerances that several modules of planning and pipeline share."""

from __future__ import annotations

ROUNDING = 1e-9
"""Distance (rad, m), or share of a value, that counts as rounding."""
SAME = 1e-6
"""Relative difference below which two durations count as equal.

Distances (rad, m) between given places count as equal below it too.
"""
GAP = 1e-4
"""Relative difference of durations below which no faster motion is looked for.

Iterations that change a duration, a speed, an amount of heat or its weight by less end, too.
"""
SAMPLES = 401
"""Number of samples of a path between which its extremes and reversals are sought."""

"""Tolerances that several modules of planning and pipeline share."""

ROUNDING_TOLERANCE = 1e-9
"""Distance (rad, m), or share of a value, that counts as rounding."""
EQUALITY_TOLERANCE = 1e-6
"""Relative difference below which two durations count as equal.

Points of a problem that are less than this distance (rad, m) apart count as equal too.
"""
GAP = 1e-4
"""Relative difference of durations below which planning does not look for a faster motion.

Iterations also end when they change a duration, a speed, an amount of heat or its weight by less.
"""
PATH_SAMPLES = 401
"""Number of samples of a path in a search for its extremes and reversals."""

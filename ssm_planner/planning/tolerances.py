"""Tolerances that several modules of planning and pipeline share."""

ROUNDING_TOLERANCE = 1e-9
"""Difference of positions (rad, m), or relative difference of values, that counts as rounding.

Rounding errors of double-precision numbers are about 1e-15 for values of the size 1, so 1e-9 is far
above them. It is also far too small to matter for a motion.
"""
EQUALITY_TOLERANCE = 1e-6
"""Relative difference below which a duration counts as the requested one.

Two solutions of one program agree if their durations differ by less, too. Whether a motion is worth
more work is decided by `GAP`.

Points of a problem that are less than this distance (rad, m) apart count as equal too.
"""
GAP = 1e-4
"""Relative difference of durations below which planning does not look for a faster motion.

The search solves a candidate (one way to move) only if it may be shorter than the best motion by
this share. Iterations also end when they change a duration, a speed, an amount of heat or the
weight of heat by a smaller share. No user notices 0.01 % of a duration.
"""
PATH_SAMPLES = 401
"""Number of samples of a path in a search for its extremes and reversals.

An odd number of evenly spaced samples includes the middle of the path.
"""

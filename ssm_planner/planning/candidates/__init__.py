"""Ways to move a phase, one file for each kind of candidate.

`listed` gives the order of suggestion.
"""

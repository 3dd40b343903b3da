"""Ways to move a phase (one entry of the motion list), called candidates.

There is one file for each kind of candidate. `candidate` contains the base class. `listed` lists
the kinds in the order in which the search asks them for suggestions.
"""

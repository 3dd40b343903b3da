"""Kinds of candidates for the motion of a phase, in the order in which the search asks them.

A phase is one entry of the motion list, and a candidate is one way to move it. The columns contain
the name of each kind, its motion, and the condition under which its class suggests a candidate.

============  ===========================================  =========================================
kind          motion                                       suggested
============  ===========================================  =========================================
direct        along the given path, or freely between the  at the beginning
              points
reversing     freely, with reversals that save time        after the estimate of `direct`, or if it
                                                           misses the requested duration
stop first    a stop in closed form, then from rest        if a phase begins at speed and `direct`
                                                           fails
in turn       some joints first, the others after a rest   if a motor is too weak for `direct`
detour        around the eye, with the tool drawn back     if the eye blocks `direct`
task line     along a straight line in task coordinates    if `direct` fails
============  ===========================================  =========================================

`search.find_fastest` computes a candidate in steps, from a lower bound of its duration to an
estimate (an approximate motion), and from there to its solution. The candidate with the smallest
known duration is always the next one. It is dropped if its bound or its estimate is not shorter
than the best motion by a share of `tolerances.GAP`, or if it failed. `Evaluation.to_dict`
states the reason, which `ssm-planner plan --explain` prints.

For a free motion between two points from rest to rest, the search therefore estimates `direct`,
then `reversing`, and solves the one with the smaller estimate. If `direct` fails, the kinds below
it in the table are asked in their order.

A new kind of candidate is a class in a file of its own, and one more line here. Candidates with
other joint positions at a target change the motion of the whole problem. They are therefore not in
this list, and `pipeline/mission.py` searches them.
"""

from ssm_planner.planning.candidates.candidate import PhaseCandidate
from ssm_planner.planning.candidates.detour import Detour
from ssm_planner.planning.candidates.direct import Direct
from ssm_planner.planning.candidates.in_parts import InTurn
from ssm_planner.planning.candidates.reversing import Reversing
from ssm_planner.planning.candidates.stop_first import StopFirst
from ssm_planner.planning.candidates.task_line import TaskLine

CANDIDATE_KINDS: list[type[PhaseCandidate]] = [
    Direct,
    Reversing,
    StopFirst,
    InTurn,
    Detour,
    TaskLine,
]

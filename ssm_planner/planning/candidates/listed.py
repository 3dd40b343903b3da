"""List of the kinds of candidates for a phase.

Other joints at a target move the whole problem, so `pipeline/mission.py` searches them. The search
asks the kinds for suggestions in this order. A new kind of candidate is one more line here.
"""

from ssm_planner.planning.candidates.candidate import PhaseCandidate
from ssm_planner.planning.candidates.detour import Detour
from ssm_planner.planning.candidates.direct import Direct
from ssm_planner.planning.candidates.in_parts import InTurn
from ssm_planner.planning.candidates.reversing import Reversing
from ssm_planner.planning.candidates.stop_first import StopFirst
from ssm_planner.planning.candidates.task_line import TaskLine

KINDS: list[type[PhaseCandidate]] = [
    Direct,
    Reversing,
    StopFirst,
    InTurn,
    Detour,
    TaskLine,
]

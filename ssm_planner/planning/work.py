"""Computational work that planning has spent. Searches end at a given amount of it.

Unlike time, work does not depend on the machine or its load, so neither of them changes a plan.
"""

from dataclasses import dataclass

SEARCH_BUDGET = 4.0
"""Work after which a search for faster motions or for relaxations begins no further attempt.

It corresponds to about 4 s of CPU time. A user of the command line waits that long for a better
answer once there is a first one.
"""
SOLVE_WORK = 0.02
"""Work of one solve without its iterations, about 1 for each second."""
ITERATION_WORK = {
    ("structured", False): 6e-6,
    ("structured", True): 8e-6,
    ("Ipopt", False): 1e-4,
    ("Ipopt", True): 3e-4,
}
"""Work of one iteration for each element of the mesh, about 1 for each second.

The keys are the solver, and whether the objective contains heat or effort.
"""


@dataclass(eq=False)
class Work:
    """Counter of computational work, which is comparable to seconds of CPU time."""

    spent: float = 0.0
    """Work so far, about 1 for each second."""

    def add_iterations(self, solver: str, iterations: int, elements: int, *, costs: bool) -> None:
        """Add the work of iterations of a solver.

        Parameters
        ----------
        solver : str
            "structured" or "Ipopt".
        iterations : int
            Number of iterations.
        elements : int
            Number of elements of the mesh.
        costs : bool
            True if the objective contains heat or effort.
        """
        self.spent += ITERATION_WORK[solver, costs] * iterations * elements

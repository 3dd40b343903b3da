"""Counter of the computational work that planning has spent.

A search ends after a given amount of work. A limit on time would let the speed and the load of the
machine decide which motion is found. Work counts iterations of the solvers instead, so the same
problem always gives the same motion.
"""

from dataclasses import dataclass

SEARCH_BUDGET = 4.0
"""Work after which a search for faster motions or for relaxations begins no further attempt.

It corresponds to about 4 s of CPU time. A user of the command line waits that long for a better
answer once there is a first one.
"""
SOLVE_WORK = 0.02
"""Work of one solve without its iterations. A work of 1 takes about one second."""
ITERATION_WORK = {
    ("structured", False): 6e-6,
    ("structured", True): 8e-6,
    ("Ipopt", False): 1e-4,
    ("Ipopt", True): 3e-4,
}
"""Work of one iteration, divided by the number of elements (time intervals) of the mesh.

The keys are the solver, and True if the objective contains heat or effort. A work of 1 takes about
one second.
"""


@dataclass(eq=False)
class Work:
    """Counter of computational work, which is comparable to seconds of CPU time."""

    spent: float = 0.0
    """Work so far. A work of 1 takes about one second."""

    def add_iterations(self, solver: str, iterations: int, elements: int, *, costs: bool) -> None:
        """Add the work of a solver's iterations, which is proportional to the number of elements.

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

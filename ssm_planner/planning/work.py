"""Counter of the computational work that planning has spent.

A search ends after a given amount of work. With a limit on time instead, the speed and the load of
the machine would decide which motion is found. Work counts iterations of the solvers, so the same
problem always gives the same motion.
"""

from dataclasses import dataclass

SEARCH_BUDGET = 4.0
"""Work after which a search for faster motions or for relaxations begins no further attempt.

It corresponds to about 4 s of CPU time. Users of the command line wait for about this time after
the first motion is found.
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

The keys are pairs of the name of the solver and a flag, which is True if the objective contains
heat or effort. The values were chosen so that a work of 1 takes about one second.
"""


@dataclass(eq=False)
class Work:
    """Counter of computational work. A work of 1 takes about one second of CPU time."""

    spent: float = 0.0
    """Work so far."""

    def add_iterations(self, solver: str, iterations: int, elements: int, *, costs: bool) -> None:
        """Add the work of a solver's iterations, which is proportional to the number of elements.

        Parameters
        ----------
        solver : str
            "structured" or "Ipopt".
        iterations : int
            Number of iterations.
        elements : int
            Number of elements (time intervals) of the mesh.
        costs : bool
            True if the objective contains the heat or the effort of the motors.
        """
        self.spent += ITERATION_WORK[solver, costs] * iterations * elements

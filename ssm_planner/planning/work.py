"""Work that planning has spent, by which searches are bounded.

Unlike time, it does not depend on the machine or its load, so neither changes a plan.
"""

from __future__ import annotations

from dataclasses import dataclass

SOLVE = 0.02
"""Work of a solve without its iterations, approximately in s."""
PRICES = {
    ("structured", False): 6e-6,
    ("structured", True): 8e-6,
    ("Ipopt", False): 1e-4,
    ("Ipopt", True): 3e-4,
}
"""Work of an iteration per element, approximately in s.

The keys are the solver, and whether heat or effort counts.
"""


@dataclass(eq=False)
class Work:
    """Work spent so far, approximately in seconds."""

    spent: float = 0.0

    def add_iterations(self, solver: str, iterations: int, elements: int, *, costs: bool) -> None:
        """Add iterations of a solver on a mesh. `costs` tells whether heat or effort counts."""
        self.spent += PRICES[solver, costs] * iterations * elements

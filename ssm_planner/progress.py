"""Represent the progress of long work by values that a caller can show, count or use to cancel."""

from collections.abc import Callable

from ssm_planner.typing import frozen


@frozen
class Step:
    """Start of a step of long work.

    Attributes
    ----------
    step : str
        Description of the step, for example "fitting the coulomb law".
    done : int
        Number of items that are finished, if the step counts items.
    total : int
        Number of all items, or 0 if the step counts no items.

    Examples
    --------
    >>> from ssm_planner import Step
    >>> print(Step("insert", done=1, total=3))
    insert (2 of 3)
    """

    step: str
    done: int = 0
    total: int = 0

    @property
    def message(self) -> str:
        """The step and the number of its present item, as one text."""
        if self.total == 0:
            return self.step
        return f"{self.step} ({min(self.done + 1, self.total)} of {self.total})"

    def __str__(self) -> str:
        """Return the message, so that `print` can report the progress."""
        return self.message


Progress = Callable[[Step], None]
"""Function that receives each step. An exception that it raises cancels the work."""


def silent(_: object) -> None:
    """Do nothing. This is the default of arguments that receive the progress."""

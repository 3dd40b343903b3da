"""Define the exceptions that the program raises deliberately."""

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path


def suggestion(name: object, known_names: Iterable[str]) -> str:
    """Return a suggestion for a misspelt name, as the end of an error message.

    Parameters
    ----------
    name : object
        Name that was not found.
    known_names : iterable of str
        Valid names.

    Returns
    -------
    str
        Text with the most similar name, such as "; did you mean 'roll'?", or "" if none is similar.
    """
    matches = difflib.get_close_matches(str(name), list(known_names), n=1, cutoff=0.65)
    return f"; did you mean {matches[0]!r}?" if matches else ""


class SsmPlannerError(Exception):
    """Base of all errors that the user can correct.

    The command line prints them and exits with status 2.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> try:
    ...     ssm.load_robot("no_such_robot")
    ... except ssm.SsmPlannerError as error:
    ...     print(type(error).__name__)
    ProblemError
    """


class ProblemError(SsmPlannerError):
    """Invalid user input.

    The message states file, line, key, value and allowed values if they are available.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> try:
    ...     ssm.Dwell(-1.0)
    ... except ssm.ProblemError as error:
    ...     print(error)
    Dwell.duration = -1.0: not greater than zero (allowed: above 0)
    """

    def __init__(
        self,
        reason: str,
        *,
        file: str | Path | None = None,
        line: int | None = None,
        key: str | None = None,
        value: object = None,
        allowed: str | None = None,
    ) -> None:
        """Store the parts of the message.

        Parameters
        ----------
        reason : str
            Fault, such as "not greater than zero".
        file : str or Path, optional
            File with the fault.
        line : int, optional
            Line of the file, from 1.
        key : str, optional
            Key of the value in the file, or name of the argument.
        value : object, optional
            Invalid value.
        allowed : str, optional
            Description of the allowed values.
        """
        self.reason = reason
        self.file = None if file is None else str(file)
        self.line = line
        self.key = key
        self.value = value
        self.allowed = allowed
        self.others: tuple[ProblemError, ...] = ()
        """Further faults of the same file."""
        self.unshown = 0
        """Number of further faults that are not in `others`."""
        super().__init__(reason)

    def __str__(self) -> str:
        """Return the message, followed by the messages of the further faults on separate lines."""
        text = ""
        if self.file is not None:
            text = f"{self.file}: " if self.line is None else f"{self.file}:{self.line}: "
        elif self.line is not None:
            text = f"line {self.line}: "
        if self.key is not None:
            value = "" if self.value is None else f" = {_shorten(self.value)}"
            text += f"{self.key}{value}: "
        text += self.reason
        if self.allowed is not None:
            text += f" (allowed: {self.allowed})"
        lines = [text, *(str(error) for error in self.others)]
        if self.unshown:
            lines.append(f"… and {self.unshown} more")
        return "\n".join(lines)


@contextmanager
def within(prefix: str) -> Iterator[None]:
    """Add the place of a value to the keys of the problem errors in a `with` block.

    Functions that check a part of a file do not know where this part is. The key `tilt` and the
    prefix `motion[0]` give `motion[0].tilt`.

    Parameters
    ----------
    prefix : str
        Key of the part.
    """
    try:
        yield
    except ProblemError as error:
        error.key = f"{prefix}.{error.key}" if error.key else prefix
        raise


class GeometryError(SsmPlannerError, ValueError):
    """Invalid array argument. The message states its name, shape and fault.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> try:
    ...     ssm.fk(ssm.load_robot("vitreoretinal"), [0.0, 0.0])
    ... except ssm.GeometryError as error:
    ...     print(error)
    q has shape (1, 2): must be (n, 4)
    """


class RecordingError(SsmPlannerError):
    """Recording that cannot be read or lacks data that the identification needs.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> try:
    ...     ssm.predict("rig1_lead_screw", ["no_such_file.csv"])
    ... except ssm.RecordingError as error:
    ...     print(error)
    no_such_file.csv: no such file
    """


class TrajectoryError(SsmPlannerError):
    """Trajectory file that cannot be read or does not describe a trajectory.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> try:
    ...     ssm.load_plan("no_such_folder")
    ... except ssm.TrajectoryError as error:
    ...     print(error)
    no_such_folder: no such file
    """


class ExportError(SsmPlannerError):
    """Plan that cannot be written in the requested format.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> try:
    ...     ssm.export("results/tilt_insert", "csv", "out", columns=["colour"])
    ... except ssm.ExportError as error:
    ...     print(error)
    unknown columns colour (allowed: q, qd, qdd, qddd, angle, speed, torque, task, counts)
    """


def _shorten(value: object) -> str:
    """Format a value as a text of at most 80 characters."""
    text = value if isinstance(value, str) else repr(value)
    return text if len(text) <= 80 else text[:79] + "…"

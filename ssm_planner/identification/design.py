"""Design the next recording session of a drive, and estimate the intervals that it will give.

Speeds are spaced logarithmically, in both directions and in random order, so that a change of
friction during the session does not look like a dependence on speed. The middle speed is recorded
at the beginning, in the middle and at the end, so that such a change is visible. Every recording
lasts whole turns of the motor, so that ripple does not change its mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ssm_planner.arguments import checked
from ssm_planner.atomic import write_text
from ssm_planner.errors import RecordingError
from ssm_planner.identification.fit import Estimate, fit_map
from ssm_planner.identification.identify import load_map, prior_centres, rig_load
from ssm_planner.identification.parameters import map_torque
from ssm_planner.identification.torque_map import TorqueMap
from ssm_planner.loading import load_drive
from ssm_planner.typing import Array, JsonObject, record
from ssm_planner.units import RPM

FEWEST_RECORDINGS = 12
"""Smallest number of recordings of a session."""
MIDDLE_SPEED_RECORDINGS = 3
"""Number of recordings of the middle speed in each direction."""
SMALLEST_SPEED_RATIO = 0.01
"""Smallest speed of a session, divided by its largest speed."""
SHORTEST_RECORDING = 10.0
"""Shortest recording, s."""
FEWEST_TURNS = 3
"""Smallest number of motor turns in a recording."""
TORQUE_SCATTER = 0.01
"""Simulated standard deviation of the mean torque from recording to recording.

It is a share of the torque. It is 0.3 to 2 % on the rigs of the paper.
"""


@record
class SessionDesign:
    """Recordings of a session in their order, and the intervals that they are expected to give.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> session = ssm.SessionDesign(np.array([20.0, -20.0]), np.full(2, 10.0), "coulomb", {})
    >>> session.to_dict()["recordings"][1]
    {'speed': -20.0, 'duration': 10.0}
    """

    speeds: Array
    """Motor speeds of the recordings in rad/s, (count,). The sign is the direction of motion."""
    durations: Array
    """Durations of the recordings at constant speed in s, (count,)."""
    law: str
    """Friction law that the identification selects for the simulated session."""
    expected: Mapping[str, Estimate]
    """Estimates with the 95 % intervals that the simulated session gives, by name of the parameter.
    """

    def to_dict(self) -> JsonObject:
        """Return the session as a dict of recordings, law and expected estimates, in SI units.

        The command `identify --design --json` prints this dict.
        """
        rows = zip(self.speeds.tolist(), self.durations.tolist(), strict=True)
        return {
            "recordings": [{"speed": speed, "duration": duration} for speed, duration in rows],
            "law": self.law,
            "parameters": {name: asdict(value) for name, value in self.expected.items()},
        }

    def save(self, path: str | Path) -> Path:
        """Write the recordings as CSV in their order.

        Parameters
        ----------
        path : str or Path
            File that is written. Its columns are the number of the recording, the speed in rpm, the
            duration in s and the number of motor turns.

        Returns
        -------
        Path
            The path of the file.

        Raises
        ------
        ExportError
            If the file cannot be written.
        """
        lines = ["recording,speed_rpm,duration_s,motor_turns"]
        rows = zip((RPM * self.speeds).tolist(), self.durations.tolist(), strict=True)
        for k, (speed, duration) in enumerate(rows, start=1):
            turns = round(abs(speed) / 60 * duration)
            lines.append(f"{k},{speed:.6g},{duration:.6g},{turns}")
        write_text(Path(path), "\n".join(lines) + "\n")
        return Path(path)


@checked
def design_session(
    drive: str | Path, count: int = 24, top_speed: float | None = None
) -> SessionDesign:
    """Design a session of recordings at constant speed, and simulate its identification.

    The simulation shows, before anything is recorded, how precise the parameters will be. The
    torque of each recording is that of the drive's friction with a random scatter of
    `TORQUE_SCATTER`, and `fit_map` is applied to these torques.

    Parameters
    ----------
    drive : str or Path
        Drive file, or the name of a shipped drive. The simulation uses its friction. If the file
        omits the friction, it is fitted to the table of mean speeds and torques in the folder of
        the file.
    count : int
        Number of recordings, an even number of at least 12.
    top_speed : float, optional
        Largest motor speed (rad/s). The default is the largest speed in the table.

    Returns
    -------
    SessionDesign
        Recordings and expected intervals.

    Raises
    ------
    RecordingError
        If the number of recordings or the speed is out of range, or if a table is needed for the
        friction or the speed and does not exist.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.design_session("rig3_worm").save("session.csv")  # doctest: +SKIP
    """
    if count < FEWEST_RECORDINGS or count % 2:
        raise RecordingError(
            f"{count} recordings (allowed: an even number of at least {FEWEST_RECORDINGS})"
        )
    if top_speed is not None and not 0 < top_speed < np.inf:
        raise RecordingError(
            f"the top speed {RPM * top_speed:g} rpm is out of range (allowed: > 0)"
        )
    template = load_drive(drive)
    load, _ = rig_load(template)
    simulated = template
    if template.friction is None or top_speed is None:
        table = load_map(drive)[0]
        top_speed = float(np.abs(table.w).max()) if top_speed is None else top_speed
        if template.friction is None:
            simulated = fit_map(template, table, load, reference=prior_centres(template)).drive
    speeds = _session_speeds(top_speed, count)
    turns = np.maximum(FEWEST_TURNS, np.ceil(SHORTEST_RECORDING * np.abs(speeds) / (2 * np.pi)))
    tau = np.asarray(map_torque(simulated, speeds, load))
    noise = np.random.default_rng(0).standard_normal(count)
    order = np.argsort(speeds)
    data = TorqueMap(
        tuple(f"{k + 1}" for k in order),
        speeds[order],
        (tau * (1 + TORQUE_SCATTER * noise))[order],
        w_deviation=np.zeros(count),
        tau_deviation=(TORQUE_SCATTER * np.abs(tau))[order],
        samples=np.full(count, 500.0),
        dates=order.astype(float),
    )
    fit = fit_map(simulated, data, load, reference=prior_centres(template))
    return SessionDesign(
        speeds, 2 * np.pi * turns / np.abs(speeds), fit.law, expected=dict(fit.estimates)
    )


def _session_speeds(top_speed: float, count: int) -> Array:
    """Choose the speeds of a session in the order of recording.

    The speeds are spaced logarithmically, from `SMALLEST_SPEED_RATIO` times the top speed to the
    top speed, in both directions. The middle speed is recorded `MIDDLE_SPEED_RECORDINGS` times in
    both directions: at the beginning, in the middle and at the end. All other speeds are recorded
    once in each direction, in random order between these recordings.

    Parameters
    ----------
    top_speed : float
        Largest motor speed (rad/s).
    count : int
        Number of recordings, which is even.

    Returns
    -------
    (count,) array
        Motor speeds (rad/s), negative in the negative direction.
    """
    distinct_speeds = count // 2 - MIDDLE_SPEED_RECORDINGS + 1
    magnitudes = np.geomspace(SMALLEST_SPEED_RATIO, 1.0, distinct_speeds) * top_speed
    middle = len(magnitudes) // 2
    other_speeds = np.delete(magnitudes, middle)
    rng = np.random.default_rng(0)
    shuffled_speeds = rng.permutation(np.concatenate([other_speeds, -other_speeds]))
    blocks = np.array_split(shuffled_speeds, MIDDLE_SPEED_RECORDINGS - 1)
    pair = magnitudes[middle] * np.array([1.0, -1.0])
    speeds = pair
    for block in blocks:
        speeds = np.concatenate([speeds, block, pair])
    return speeds

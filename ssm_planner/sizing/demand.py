"""Compute the demands of a motion on motor and gear, and their range if friction is uncertain.

The demands are peak and RMS torque, peak voltage, and peak and continuous effort in the mesh.
`compute_demands` evaluates them for given friction. `linear_band` and `monte_carlo` compute the
range of each demand from the uncertainty of the friction, a `FrictionSpread`: the first by
linearisation, the second by random draws.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import reduce
from typing import Any, Literal, get_args

import numpy as np

from ssm_planner.deprecation import Renamed
from ssm_planner.dynamics import (
    LINEARISED_DRAWS,
    RANDOM_SEED,
    FrictionSpread,
    drive_with_values,
    required_friction,
)
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import voltage_factors
from ssm_planner.typing import Array, record

DemandName = Literal[
    "peak_torque", "rms_torque", "peak_voltage", "peak_effort", "continuous_effort"
]
DEMAND_NAMES: tuple[DemandName, ...] = get_args(DemandName)
"""Names of the demands, in the order of the columns of every table of demands."""
MONTE_CARLO_INSTANTS = 500
"""Number of evenly spaced instants in a Monte Carlo simulation.

Instants at which the torque jumps or peaks are added.
"""
TORQUES_PER_BLOCK = 120_000
"""Number of torques that are evaluated at once. Smaller arrays fit into the processor's cache."""


@record
class Demands:
    """Demands of one motion without its pause, in SI units.

    Each demand is an array (draws,) with one value for each draw of the uncertain friction.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> demands = ssm.size("results/tilt_insert").joints[0].band.nominal
    >>> demands.peak_torque.round(4).tolist()
    [0.0303]
    """

    peak_torque: Array
    """Largest magnitude of the motor torque, N·m."""
    rms_torque: Array
    """Root mean square of the motor torque, N·m."""
    peak_voltage: Array
    """Largest voltage of the cold or the hot motor, V. NaN if the motor file lacks electrical data.
    """
    peak_effort: Array
    """Largest effort |F| in the mesh, N·m or N."""
    continuous_effort: Array
    """Root mean cube of the effort |F| over the time in motion, N·m or N.

    Wear grows with the cube of the load.
    """

    def array(self) -> Array:
        """Return the demands as a table.

        Returns
        -------
        (draws, 5) array
            One column for each demand, in the order of `DEMAND_NAMES`.
        """
        return np.stack([np.atleast_1d(getattr(self, name)) for name in DEMAND_NAMES], axis=1)

    @classmethod
    def from_table(cls, table: Array) -> "Demands":
        """Build the demands from a table.

        Parameters
        ----------
        table : (draws, 5) array
            One column for each demand, in the order of `DEMAND_NAMES`.

        Returns
        -------
        Demands
            The demands, (draws,) each.
        """
        return cls(*table.T)

    of = Renamed("from_table")


@record
class Band:
    """Demands at the stated friction, and their range if the friction is uncertain.

    `worst` and `best` contain one entry for each draw of the friction parameters that have a
    statistical distribution. Parameters with a stated range have their least favourable value in
    `worst` and their most favourable one in `best`.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> band = ssm.size("results/tilt_insert").joints[0].band
    >>> band.known
    False
    """

    nominal: Demands
    worst: Demands
    best: Demands
    known: bool
    """False if the drive file omits the uncertainty of the friction.

    Then the friction is used as stated.
    """
    smooth: Demands | None = None
    """`worst` without the torque ripple of the drive. None if the peaks include no ripple."""

    def high(self, name: DemandName, confidence: float) -> float:
        """Return the value that a demand does not exceed with the given confidence.

        It is the quantile of the draws in `worst` at this confidence.

        Parameters
        ----------
        name : DemandName
            Name of the demand.
        confidence : float
            Probability between 0 and 1.

        Returns
        -------
        float
            The demand in its SI unit.
        """
        return float(np.quantile(getattr(self.worst, name), confidence, method="inverted_cdf"))

    def low(self, name: DemandName, confidence: float) -> float:
        """Return the value that a demand does not fall below with the given confidence.

        It is the quantile of the draws in `best` at 1 − confidence.

        Parameters
        ----------
        name : DemandName
            Name of the demand.
        confidence : float
            Probability between 0 and 1.

        Returns
        -------
        float
            The demand in its SI unit.
        """
        return float(np.quantile(getattr(self.best, name), 1 - confidence, method="inverted_cdf"))

    def nominal_value(self, name: DemandName) -> float:
        """Return a demand at the stated friction.

        Parameters
        ----------
        name : DemandName
            Name of the demand, one of `DEMAND_NAMES`.

        Returns
        -------
        float
            The demand in its SI unit.
        """
        return float(getattr(self.nominal, name)[0])

    at = Renamed("nominal_value")


def compute_demands(load: JointLoad) -> Demands:
    """Compute the demands of one motion on the drive and the motor of a joint.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint. If friction parameters of its drive are columns (draws, 1),
        all draws are evaluated at once.

    Returns
    -------
    Demands
        One value (1,) of each demand, or (draws,) values.
    """
    torque = np.atleast_2d(load.torque())
    effort = np.atleast_2d(np.abs(load.effort()))
    in_motion = load.weight * (load.direction != 0)
    share = max(float(in_motion.sum()), 1e-300)
    mean_cube = (effort * effort * effort) @ in_motion / share
    return Demands(
        peak_torque=np.maximum(torque.max(axis=1), -torque.min(axis=1)),
        rms_torque=load.rms(torque),
        peak_voltage=_peak_voltage(torque, load),
        peak_effort=np.broadcast_to(effort.max(axis=1), (len(torque),)),
        continuous_effort=np.broadcast_to(np.cbrt(mean_cube), (len(torque),)),
    )


def _peak_voltage(torque: Array, load: JointLoad) -> Array:
    """Return the largest voltage that the cold or the hot motor needs during a motion.

    Parameters
    ----------
    torque : (draws, n) array
        Motor torque at n instants, N·m.
    load : JointLoad
        Motion of the joint with its motor.

    Returns
    -------
    (draws,) array
        Voltages, V.
    """
    speed = load.speed()
    volts = [
        np.abs(per_torque * torque + per_speed * speed).max(axis=1)
        for per_torque, per_speed in voltage_factors(load.motor)
    ]
    return np.max(volts, axis=0)


def linear_band(load: JointLoad, spread: FrictionSpread) -> Band:
    """Compute the range of the demands that uncertain friction permits, by linearisation.

    The largest and the smallest demand at all corners are found first. A corner is one combination
    of the ends of the stated ranges. Both are then shifted by random deviations of the other
    uncertain parameters times the slopes of the demands. The slopes are secants over ±1 σ of each
    parameter, where σ is its standard deviation. If the friction has a posterior, that is, a list
    of equally likely parameter values, all of them are evaluated exactly instead, because there are
    few of them.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint.
    spread : FrictionSpread
        Uncertainty of the friction.

    Returns
    -------
    Band
        Demands at the stated friction, and their range with `LINEARISED_DRAWS` draws.
    """
    if spread.posterior is not None:
        return monte_carlo(load, spread, len(spread.posterior.draws))
    nominal = compute_demands(load)
    corners = _corner_demands(load, spread)
    shifts = spread.deviations(LINEARISED_DRAWS) @ _secant_slopes(load, spread)
    highest = np.maximum(corners.max(axis=0) + shifts, 0.0)
    lowest = corners.min(axis=0) + shifts
    worst = Demands.from_table(highest)
    return Band(nominal, worst, _lower_bound(lowest, load, spread), spread.is_stated)


def _load_with(load: JointLoad, values: Mapping[str, Any]) -> JointLoad:
    """Return a load with other friction parameters of its drive.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint.
    values : mapping of str to float or array
        New values by name of the parameter. Other parameters keep their values.

    Returns
    -------
    JointLoad
        The changed load.
    """
    return replace(load, drive=drive_with_values(load.drive, values))


def _corner_demands(load: JointLoad, spread: FrictionSpread) -> Array:
    """Compute the demands at every combination of the ends of the stated ranges.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint.
    spread : FrictionSpread
        Uncertainty of the friction, with the ranges of some parameters.

    Returns
    -------
    (corners, 5) array
        One row for each combination in the order of `FrictionSpread.corners`, and one column for
        each demand in the order of `DEMAND_NAMES`.
    """
    tables = [compute_demands(_load_with(load, corner)).array() for corner in spread.corners()]
    return np.concatenate(tables)


def _lower_bound(lowest: Array, load: JointLoad, spread: FrictionSpread) -> Demands:
    """Reduce the smallest demands at the corners to a lower bound for all motors that are possible.

    If a motor file does not state the inertia of the rotor, the inertia J on the shaft has a range
    from J₁ to J₂. Peak and RMS torque are convex in J. Between J₁ and J₂, they are at least their
    mean minus (J₂ − J₁)/2 · |ẇ|, with the acceleration ẇ of the motor. The friction of the motor
    also has a range. It changes the torques at most by the width of this range.

    Parameters
    ----------
    lowest : (draws, 5) array
        Demands of the most favourable corner.
    load : JointLoad
        Motion and load of the joint.
    spread : FrictionSpread
        Uncertainty of the friction and of the inertia.

    Returns
    -------
    Demands
        Lower bounds (draws,), at least 0.
    """
    low, high = spread.inertia or (0.0, 0.0)
    wd = np.abs(load.acceleration())
    width = load.motor_friction[1] - load.motor_friction[0]
    half_range = (high - low) / 2
    peak = half_range * float(wd.max()) + width
    rms = half_range * float(load.rms(wd)) + width
    # The hot motor needs the larger voltage per torque.
    volts = peak * voltage_factors(load.motor)[1, 0]
    return Demands.from_table(np.maximum(lowest - [peak, rms, volts, 0.0, 0.0], 0.0))


def _secant_slopes(load: JointLoad, spread: FrictionSpread) -> Array:
    """Compute the change of each demand per unit of each uncertain parameter.

    The slope is the secant between the mean plus and the mean minus one standard deviation. The
    lower end is at least 0, because friction parameters are not negative.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint.
    spread : FrictionSpread
        Uncertainty of the friction, with mean and standard deviation of each parameter.

    Returns
    -------
    (parameters, 5) array
        Slopes in the order of `spread.names` and `DEMAND_NAMES`.
    """
    slopes = np.zeros((len(spread.names), len(DEMAND_NAMES)))
    for i, name in enumerate(spread.names):
        if spread.sigma[i] == 0:
            continue
        high = spread.mean[i] + spread.sigma[i]
        low = max(spread.mean[i] - spread.sigma[i], 0.0)
        demands_above = compute_demands(_load_with(load, {name: high})).array()[0]
        demands_below = compute_demands(_load_with(load, {name: low})).array()[0]
        slopes[i] = (demands_above - demands_below) / (high - low)
    return slopes


def monte_carlo(load: JointLoad, spread: FrictionSpread, count: int) -> Band:
    """Compute the range of the demands from random draws of the friction.

    The draws are evaluated only at the corners that are the highest or the lowest for some demand
    at the stated friction. A corner is one combination of the ends of the stated ranges. If no
    parameter is random, the corners alone give the range, and the result is that of `linear_band`.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint.
    spread : FrictionSpread
        Uncertainty of the friction.
    count : int
        Number of draws.

    Returns
    -------
    Band
        Demands at the stated friction, and their range with `count` draws.
    """
    if not spread.names:
        return linear_band(load, spread)
    nominal = compute_demands(load)
    at_corners = _corner_demands(load, spread)
    corners = spread.corners()
    selected_load = select_instants(load)
    deviations = spread.deviations(count)
    finite_demands = np.nan_to_num(at_corners)
    highest_corners = set(finite_demands.argmax(axis=0).tolist())
    lowest_corners = set(finite_demands.argmin(axis=0).tolist())
    tables = {
        i: _drawn_demands(selected_load, spread, deviations, corners[i])
        for i in highest_corners | lowest_corners
    }
    high = reduce(np.maximum, (tables[i] for i in highest_corners))
    low = reduce(np.minimum, (tables[i] for i in lowest_corners))
    smooth = Demands.from_table(high)
    worst = _with_ripple(smooth, load)
    best = _lower_bound(low, load, spread)
    return Band(nominal, worst, best, True, smooth=None if worst is smooth else smooth)


def _with_ripple(smooth: Demands, load: JointLoad) -> Demands:
    """Add the torque ripple of the screw or worm to the peak torques and voltages.

    The ripple is the deviation of the torque from its mean during motion at constant speed. Its
    peaks are drawn from recordings. If the torque is larger than in the recordings, the ripple is
    increased in proportion.

    Parameters
    ----------
    smooth : Demands
        Demands (draws,) without ripple.
    load : JointLoad
        Motion and load of the joint.

    Returns
    -------
    Demands
        Demands (draws,) with ripple, or `smooth` itself if the drive has no recorded ripple.
    """
    posterior = required_friction(load.drive).posterior
    if posterior is None:
        return smooth
    torque = load.torque()
    # The ripple is that of the direction with the largest torque.
    largest = torque[np.argmax(np.abs(torque))]
    ripple = posterior.ripple(1 if largest >= 0 else -1)
    if ripple is None:
        return smooth
    peak = ripple.draw_peak(np.random.default_rng(RANDOM_SEED), len(smooth.peak_torque))
    peak *= np.maximum(smooth.peak_torque / float(np.median(ripple.torque)), 1.0)
    # The hot motor needs the larger voltage per torque.
    voltage = smooth.peak_voltage + peak * voltage_factors(load.motor)[1, 0]
    return replace(smooth, peak_torque=smooth.peak_torque + peak, peak_voltage=voltage)


def _drawn_demands(
    load: JointLoad, spread: FrictionSpread, deviations: Array, corner: dict[str, float]
) -> Array:
    """Compute the demands for all draws of the random parameters at one corner of the ranges.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint at selected instants.
    spread : FrictionSpread
        Uncertainty of the friction.
    deviations : (draws, k) array
        Draws of the k random parameters minus their means.
    corner : dict of float
        Values of the parameters that have a stated range.

    Returns
    -------
    (draws, 5) array
        Demands in the order of `DEMAND_NAMES`.
    """
    moving = np.flatnonzero(load.direction != 0)
    resting = np.flatnonzero(load.direction == 0)
    # At any friction, a self-locking drive rests without torque, and its effort stays the same.
    torque_free = len(resting) > 0 and len(moving) > 0 and not np.any(load.torque()[resting])
    subset = replace(load.subset(moving), weight=load.weight[moving]) if torque_free else load
    values = spread.values(deviations)
    step = max(TORQUES_PER_BLOCK // len(subset.t), 1)
    tables = []
    for start in range(0, len(deviations), step):
        block = {name: value[start : start + step, None] for name, value in values.items()}
        tables.append(compute_demands(_load_with(subset, block | corner)).array())
    table = np.concatenate(tables)
    if torque_free:
        k = DEMAND_NAMES.index("peak_effort")
        table[:, k] = np.maximum(table[:, k], np.abs(load.effort()[resting]).max())
    return table


def select_instants(load: JointLoad) -> JointLoad:
    """Select the instants of a load that determine its demands, so that many draws are fast.

    The selection contains about `MONTE_CARLO_INSTANTS` evenly spaced instants, all jumps of the
    torque, all changes of direction, the 20 largest peaks of the torque, the extremes of
    torque, effort and speed, and the last instant.

    Parameters
    ----------
    load : JointLoad
        Load of a joint at n instants.

    Returns
    -------
    JointLoad
        Load at m ≤ n of these instants, with new weights.
    """
    torque = load.torque()
    size = np.abs(torque)
    step = np.diff(torque)
    jump = np.flatnonzero((np.diff(load.t) == 0) & (np.abs(step) > 1e-6 * size.max()))
    turn = np.flatnonzero(np.diff(load.direction) != 0)
    peaks = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:])) + 1
    peaks = peaks[np.argsort(size[peaks])[-20:]]
    evenly_spaced = np.arange(0, len(torque), max(len(torque) // MONTE_CARLO_INSTANTS, 1))
    extremes = [int(np.argmax(np.abs(values))) for values in (torque, load.effort(), load.qd)]
    extremes.append(len(torque) - 1)
    selected = [evenly_spaced, jump, jump + 1, turn, turn + 1, peaks, np.array(extremes)]
    return load.subset(np.unique(np.concatenate(selected)))

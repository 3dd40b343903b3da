"""Define the uncertainty of an identified drive: equally likely friction parameters and ripple.

The identification of a drive from recordings does not give one set of friction parameters, but many
sets that are equally likely (`Posterior`). `Ripple`, `Harmonics` and `Reaction` describe how the
torque of single samples differs from the mean torque that the friction law gives.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np

from ssm_planner.deprecation import Renamed
from ssm_planner.problem.value import NotNegative, Positive, Shape, Value
from ssm_planner.typing import Array, JsonObject, Range, record

CONFIDENCE = 0.95
"""Default probability of an interval."""
PRIOR_PEAK_DEVIATION = 0.3
"""Expected standard deviation of the logarithm of peaks before any recording (prior)."""
PRIOR_PEAK_WEIGHT = 4
"""Weight of `PRIOR_PEAK_DEVIATION`, as a number of recordings."""
LOAD_OFFSET = "load_offset"
"""Name of the column with the constant effort on the output in addition to the payload.

This effort belongs to the rig, not to the drive.
"""
LAW_COLUMN = "law"
"""Name of the column that contains the friction law of each set as an index into `FRICTION_LAWS`.

The column exists only if several laws are possible.
"""
FRICTION_LAWS = ("coulomb", "stribeck_exponential", "stribeck_gaussian")
"""Names of the friction laws. The column `LAW_COLUMN` contains indices into this tuple."""
LAW_PARAMETERS = (
    "mu",
    "mu_static",
    "mu_stribeck",
    "stribeck_speed",
    "b_c",
    "b_v",
    "b_oc",
    "b_ov",
)
"""Coefficients of the friction law that are fields of Friction."""
UNCERTAIN_PARAMETERS = (*LAW_PARAMETERS, "preload")
"""Parameters of a drive that may be uncertain, by their names in Friction (and preload)."""


def central_interval(draws: Array, confidence: float = CONFIDENCE) -> Range:
    """Return the central interval of equally likely values.

    Parameters
    ----------
    draws : (sets,) array
        Equally likely values.
    confidence : float
        Probability of the interval. Half of the rest is below it, and half above it.

    Returns
    -------
    low, high : float
        Ends of the interval.
    """
    low, high = np.quantile(draws, [(1 - confidence) / 2, (1 + confidence) / 2])
    return float(low), float(high)


@record
class Ripple(Value):
    """Deviation of the torque from its mean during motion at constant speed in one direction, N·m.

    Each tuple has one entry for each recording.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ripple = ssm.Ripple(
    ...     torque=(0.01, 0.02), ripple=(1e-3, 2e-3), noise=(1e-4, 1e-4), peak=(2e-3, 3e-3)
    ... )
    >>> ripple.torque
    (0.01, 0.02)
    """

    torque: tuple[Positive, ...]
    """Magnitude of the mean torque."""
    ripple: tuple[NotNegative, ...]
    """RMS of the part that is periodic in the motor angle."""
    noise: tuple[NotNegative, ...]
    """RMS of the remaining part."""
    peak: tuple[Positive, ...]
    """Largest deviation of |torque| above the mean."""

    def _check(self) -> None:
        """Raise ProblemError unless all fields have one value for each recording."""
        for name in ("ripple", "noise", "peak"):
            if not 0 < len(getattr(self, name)) == len(self.torque):
                raise self._field_error(
                    name,
                    "needs one value for each recording",
                    f"{len(self.torque)} values, at least 1",
                )

    def scaled(self, factor: float) -> "Ripple":
        """Return the ripple with all torques multiplied by a factor."""
        torques = (self.torque, self.ripple, self.noise, self.peak)
        return Ripple(*(tuple(factor * value for value in values) for values in torques))

    def draw(self, rng: np.random.Generator, count: int, known: float = 0.0) -> Array:
        """Draw random deviations of single samples from the mean torque.

        Each deviation is the sum of noise and of a sine wave with a random phase. The RMS values of
        both are those of a randomly selected recording.

        Parameters
        ----------
        rng : Generator
            Source of random numbers.
        count : int
            Number of draws.
        known : float
            Mean square of the part of the ripple that is predicted separately, N²·m². It is
            subtracted from the mean square of the sine wave.

        Returns
        -------
        (count,) array
            Deviations, N·m.
        """
        recording = rng.integers(len(self.torque), size=count)
        phase = rng.uniform(0, 2 * np.pi, count)
        remaining_ripple = np.sqrt(np.maximum(np.square(self.ripple) - known, 0.0))
        # The amplitude of a sine wave is √2 times its RMS value.
        wave = np.sqrt(2.0) * remaining_ripple[recording] * np.sin(phase)
        return wave + np.array(self.noise)[recording] * rng.standard_normal(count)

    def draw_peak(self, rng: np.random.Generator, count: int) -> Array:
        """Draw the largest deviations of the torque from the friction law in further recordings.

        The largest deviation of a recording is assumed to be log-normal. The mean and the standard
        deviation of its logarithm are estimated from the known recordings and are therefore
        uncertain, so the logarithm for a further recording is t-distributed.

        Parameters
        ----------
        rng : Generator
            Source of random numbers.
        count : int
            Number of draws, each for one recording.

        Returns
        -------
        (count,) array
            Largest deviations, N·m.
        """
        logs = np.log(self.peak)
        degrees = len(self.peak) - 1 + PRIOR_PEAK_WEIGHT
        variance = (
            np.sum((logs - logs.mean()) ** 2) + PRIOR_PEAK_WEIGHT * PRIOR_PEAK_DEVIATION**2
        ) / degrees
        # The term 1/n is the variance of the mean of n logarithms.
        scale = math.sqrt(variance * (1 + 1 / len(logs)))
        return np.exp(logs.mean() + scale * rng.standard_t(degrees, size=count))


@record
class Harmonics(Value):
    """Deviation of the torque from its mean in one direction, as a series in the motor angle θ.

    The series is Σ_k cosine_k cos(order_k θ) + sine_k sin(order_k θ).

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> series = ssm.Harmonics((1.0, 2.0), cosine=(3e-4, 0.0), sine=(4e-4, 1e-4), phased=True)
    >>> series.amplitudes.tolist()
    [0.0005, 0.0001]
    """

    orders: tuple[Positive, ...]
    """Periods per turn of the motor. Orders of the wheel are below 1."""
    cosine: tuple[float, ...]
    """Cosine coefficients, N·m."""
    sine: tuple[float, ...]
    """Sine coefficients, N·m."""
    phased: bool
    """True if the angle was recorded, so that the phases are valid for other recordings.

    If False, only the amplitudes are valid.
    """

    def _check(self) -> None:
        """Raise ProblemError unless each order has two coefficients."""
        for name in ("cosine", "sine"):
            if len(getattr(self, name)) != len(self.orders):
                raise self._field_error(
                    name, "needs one value for each order", f"{len(self.orders)} values"
                )

    @classmethod
    def from_coefficients(
        cls, orders: tuple[float, ...], coefficients: Any, phased: bool
    ) -> "Harmonics":
        """Build the series from complex coefficients.

        Parameters
        ----------
        orders : tuple of n floats
            Periods per turn of the motor.
        coefficients : (n,) array of complex
            Coefficients, N·m.
        phased : bool
            True if the phases are valid for other recordings.

        Returns
        -------
        Harmonics
            The series Re Σ_k c_k exp(i o_k θ), where c_k are the coefficients, o_k are the orders
            and θ is the motor angle.
        """
        sine = tuple((-coefficients.imag).tolist())
        return cls(orders, tuple(coefficients.real.tolist()), sine, phased)

    @property
    def coefficients(self) -> Any:
        """Complex coefficients of the series, (orders,), N·m, as in `from_coefficients`."""
        return np.array(self.cosine) - 1j * np.array(self.sine)

    @property
    def amplitudes(self) -> Array:
        """Amplitudes of the orders, (orders,), N·m."""
        return np.hypot(self.cosine, self.sine)

    def torque(self, angle: Array) -> Array:
        """Return the torque (samples,) in N·m at motor angles (samples,) in rad."""
        waves = np.outer(angle, self.orders)
        return np.cos(waves) @ np.array(self.cosine) + np.sin(waves) @ np.array(self.sine)

    def rotated(self, start: float) -> "Harmonics":
        """Return the same series as a function of an angle that is counted from another zero.

        Parameters
        ----------
        start : float
            Present angle at the new zero, rad.

        Returns
        -------
        Harmonics
            The series as a function of the new angle.
        """
        coefficients = self.coefficients * np.exp(1j * start * np.array(self.orders))
        return Harmonics.from_coefficients(self.orders, coefficients, self.phased)

    def to_dict(self) -> JsonObject:
        """Return the entry in the output of `identify --json` for one direction of motion."""
        return {
            "orders": self.orders,
            "amplitudes": self.amplitudes.tolist(),
            "cosine": self.cosine,
            "sine": self.sine,
            "phased": self.phased,
        }

    turned = Renamed("rotated")


@record
class Reaction(Value):
    """Torque with which the speed controller answers the recorded deviation of the speed.

    The torque is Σ_k taps_k · Δw(t − delays_k), where Δw is the deviation of the motor speed from
    its mean.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> reaction = ssm.Reaction(
    ...     (0.0,), taps=(-1e-3,), speeds=(5.0, 9.0), deviations=(1e-4, 3e-4), explained=(0.0, 0.8)
    ... )
    >>> reaction.explained_share(np.array([5.0, 9.0])).tolist()
    [0.0, 0.8]
    """

    delays: tuple[float, ...]
    """Delays, s. Negative ones are due to the averaging of the recorded speed."""
    taps: tuple[float, ...]
    """Torque per speed, N·m·s/rad."""
    speeds: tuple[float, ...]
    """Motor speeds of the recordings of the fit in increasing order, rad/s."""
    deviations: tuple[NotNegative, ...]
    """Standard deviation of the torque in each recording, N·m."""
    explained: tuple[NotNegative, ...]
    """Share of the variance of each recording's torque that the taps of the others explain."""

    def _check(self) -> None:
        """Raise ProblemError unless the pairs of fields have equal lengths."""
        for name, other in (
            ("taps", self.delays),
            ("deviations", self.speeds),
            ("explained", self.speeds),
        ):
            if not 0 < len(getattr(self, name)) == len(other):
                raise self._field_error(name, "has the wrong length", f"{len(other)} values")

    def explained_share(self, w: Array) -> Array:
        """Return the fraction of the torque's variance that the speed controller explains.

        Fractions below 1/2 count as 0, because the recorded speed is then mostly noise.

        Parameters
        ----------
        w : (n,) array
            Motor speeds, rad/s.

        Returns
        -------
        (n,) array
            Fractions from 0 to 1, interpolated between the recordings.
        """
        fraction = np.interp(w, self.speeds, self.explained)
        return np.where(fraction >= 0.5, fraction, 0.0)

    def remaining_rms(self, w: Array) -> Array:
        """Return the RMS of the torque that the speed controller does not explain.

        Parameters
        ----------
        w : (n,) array
            Motor speeds, rad/s.

        Returns
        -------
        (n,) array
            RMS values, N·m.
        """
        deviation = np.interp(w, self.speeds, self.deviations)
        return deviation * np.sqrt(np.maximum(1 - self.explained_share(w), 0.0))


@record
class Posterior(Value):
    """Equally likely sets of friction parameters after identification, in SI units.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> posterior = ssm.Posterior(("mu",), np.array([[0.12], [0.13], [0.14]]))
    >>> posterior.column("mu").tolist()
    [0.12, 0.13, 0.14]
    """

    names: tuple[str, ...]
    """Names of the columns: parameters of Friction, `preload` and `LOAD_OFFSET`.

    `LAW_COLUMN` is a further column if some sets have another friction law than the drive.
    """
    draws: Annotated[Array, Shape((-1, -1))]
    """Parameter sets, (sets, parameters)."""
    scatter: NotNegative = 0.0
    """Standard deviation of the mean torque between recordings, N·m.

    It is t-distributed because of outliers.
    """
    common: NotNegative = 0.0
    """Share of the scatter's variance that recordings at similar speeds have in common.

    This share is due to the error of the friction law itself.
    """
    speeds: tuple[float, ...] = ()
    """Motor speeds of the recordings without outliers, rad/s."""
    departures: tuple[float, ...] = ()
    """Differences between measured and modelled mean torque of these recordings, N·m."""
    forwards: Ripple | None = None
    """Ripple and noise in positive motion."""
    backwards: Ripple | None = None
    """Ripple and noise in negative motion."""
    harmonics_forwards: Harmonics | None = None
    """Periodic part of the ripple in positive motion, or None if it is unknown."""
    harmonics_backwards: Harmonics | None = None
    """Periodic part of the ripple in negative motion, or None if it is unknown."""
    reaction: Reaction | None = None
    """Reaction of the speed controller of the recordings, or None if it is unknown."""

    def _check(self) -> None:
        """Raise ProblemError if names, parameter sets and recordings do not fit each other."""
        allowed_names = (*UNCERTAIN_PARAMETERS, LOAD_OFFSET, LAW_COLUMN)
        for name in self.names:
            if name not in allowed_names:
                raise self._field_error(
                    "names", "unknown parameter", ", ".join(allowed_names), name
                )
        if len(self.speeds) != len(self.departures) or 0.0 in self.speeds:
            raise self._field_error(
                "departures",
                "needs one value for each moving recording",
                f"{len(self.speeds)} values",
            )
        if self.common >= 1:
            raise self._field_error(
                "common", "cannot exceed the whole scatter", "from 0 to below 1"
            )
        if len(set(self.names)) != len(self.names):
            raise self._field_error("names", "a name occurs twice", "each name once")
        if self.draws.shape[1] != len(self.names) or len(self.draws) < 2:
            raise self._field_error(
                "draws",
                "needs one column for each name",
                "two sets of parameters or more",
                f"shape {self.draws.shape}",
            )
        for name, column in zip(self.names, self.draws.T, strict=True):
            if name != LOAD_OFFSET and column.min() < 0:
                raise self._field_error(
                    "draws",
                    f"friction cannot be negative: {name}",
                    "0 or more",
                    float(column.min()),
                )
        if (
            LAW_COLUMN in self.names
            and not np.isin(self.column(LAW_COLUMN), range(len(FRICTION_LAWS))).all()
        ):
            allowed = ", ".join(f"{k} ({law})" for k, law in enumerate(FRICTION_LAWS))
            raise self._field_error("draws", "not the index of a friction law", allowed)

    @property
    def recordings(self) -> int:
        """Number of recordings with ripple data."""
        return sum(
            len(ripple.torque) for ripple in (self.forwards, self.backwards) if ripple is not None
        )

    def column(self, name: str) -> Array:
        """Return the values of one parameter, (sets,)."""
        return self.draws[:, self.names.index(name)]

    def scaled(self, factors: Mapping[str, float], torque: float) -> "Posterior":
        """Return the posterior for another shaft, such as the motor shaft before a gearhead.

        The result does not contain the data that refer to the speeds of the recordings.

        Parameters
        ----------
        factors : mapping of float
            Factors on parameters, by name. The other parameters do not change.
        torque : float
            Factor on the torques of the ripple.

        Returns
        -------
        Posterior
            The scaled posterior.
        """
        return Posterior(
            self.names,
            self.draws * [factors.get(name, 1.0) for name in self.names],
            forwards=self.forwards and self.forwards.scaled(torque),
            backwards=self.backwards and self.backwards.scaled(torque),
        )

    def interval(self, name: str, confidence: float = CONFIDENCE) -> Range:
        """Return the central interval (low, high) of one parameter, in SI units."""
        return central_interval(self.column(name), confidence)

    def law_shares(self, law: str) -> dict[str, float]:
        """Return the probability of each friction law, with the most likely law first.

        The probability is the share of the parameter sets with this law.

        Parameters
        ----------
        law : str
            Friction law of the drive. Without the column `LAW_COLUMN`, all sets have this law.

        Returns
        -------
        dict of float
            Probability by name of the law. Laws without a parameter set are left out.
        """
        if LAW_COLUMN not in self.names:
            return {law: 1.0}
        shares = {
            name: float(np.mean(self.column(LAW_COLUMN) == k))
            for k, name in enumerate(FRICTION_LAWS)
        }
        return {
            name: share
            for name, share in sorted(shares.items(), key=lambda pair: -pair[1])
            if share
        }

    def ripple(self, direction: int) -> Ripple | None:
        """Return ripple and noise in a direction of motion (±1), or None if they are unknown."""
        return self.forwards if direction > 0 else self.backwards

    def harmonics(self, direction: int) -> Harmonics | None:
        """Return the harmonics in a direction of motion (±1), or None if they are unknown."""
        return self.harmonics_forwards if direction > 0 else self.harmonics_backwards

    def values(self, count: int | None = None) -> Mapping[str, Array]:
        """Return the values of all parameters by name.

        Parameters
        ----------
        count : int, optional
            Number of values of each parameter. The default is the number of sets. If it is larger,
            the sets are repeated cyclically.

        Returns
        -------
        mapping of (count,) arrays
            Values in SI units.
        """
        rows = np.arange(len(self.draws) if count is None else count) % len(self.draws)
        return {name: self.draws[rows, i] for i, name in enumerate(self.names)}

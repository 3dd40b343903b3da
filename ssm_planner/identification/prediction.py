"""Predict motor torque from measured speed with 95 % bands, and compare it with measured torque."""

from dataclasses import replace

import numpy as np

from ssm_planner.dynamics import (
    STANDSTILL,
    drive_with,
    friction_coefficient,
    friction_of,
    remembered_speed,
    static_coefficient,
    stribeck_shape,
)
from ssm_planner.dynamics.transmission import (
    holding_torque,
    motor_torque,
    nut_contact,
    output_effort,
)
from ssm_planner.errors import RecordingError
from ssm_planner.identification.parameters import map_torque
from ssm_planner.identification.posterior import SCATTER_DEGREES, expected_departure, outside
from ssm_planner.identification.reaction import deviation_of, shifted
from ssm_planner.identification.recordings import Recording, rms, runs
from ssm_planner.identification.torque_map import kind_of, rest_mask
from ssm_planner.problem import CONFIDENCE, LOAD_OFFSET, Drive, Friction, Posterior, interval_of
from ssm_planner.typing import Array, Indices, JsonObject, Keywords, Range, record

START_LEAD = 0.05
"""Time before the first nonzero speed reading in which the motor already pushes, s.

The recorder averages and rounds the speed, so it shows motion only after the breakaway.
"""

EXTRAPOLATED = 0.25
"""Distance from the recorded speeds above which a speed counts as extrapolated, see `outside`."""
SEED = 20_210_521
"""Seed of the random numbers. With a fixed seed, equal calls give equal results."""
PEAK_CONFIDENCE = 0.99
"""Probability with which the largest torque is below its bound."""
IMPLAUSIBLE = 0.5
"""NRMSD, or relative error of the mean, above which a recording may be of another drive."""
LONG_REST = 10.0
"""Assumed time at rest before a recording that begins at rest, s."""


@record
class PredictionBand:
    """95 % band of the predicted motor torque of a recording, N·m.

    Arrays have the shape (samples,).

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> ssm.PredictionBand((0.9, 1.1), low=np.zeros(3), high=np.ones(3), peak=1.4).mean
    (0.9, 1.1)
    """

    mean: Range
    """Band of the mean torque, due to uncertain parameters and scatter between recordings."""
    low: Array
    """Lower end of the band of single samples, which includes ripple and noise."""
    high: Array
    """Upper end of the band of single samples."""
    peak: float
    """Value that the largest |torque| exceeds with a probability of 1 %."""


@record
class Prediction:
    """Predicted and measured motor torque of one recording, N·m. Arrays have the shape (samples,).

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> (result,) = ssm.predict("identified.yaml", ["recording.csv"])  # doctest: +SKIP
    >>> result.nrmsd, result.mean_inside  # doctest: +SKIP
    """

    recording: Recording
    """Measured speed and torque."""
    tau: Array
    """Predicted torque: the sum of the friction law, `position_ripple` and `reaction`."""
    rest: Array
    """Mask (samples,) of the samples at rest, for which the holding torque is predicted."""
    nrmsd: float
    """RMS error of the predicted torque, divided by the range of the measured torque."""
    contact_lost: float = 0.0
    """Share of the samples in which one half of the preloaded nut loses contact.

    The torque law does not hold in these samples.
    """
    band: PredictionBand | None = None
    """95 % band of the torque. None if the drive file does not contain a posterior."""
    position_ripple: Array | None = None
    """Part of `tau` that repeats with the motor angle. None if it is unknown."""
    reaction: Array | None = None
    """Part of `tau` with which the controller answers the recorded speed. None if it is unknown."""
    unseen: float | None = None
    """Motor speed that is farthest from the recordings of the fit, rad/s.

    None if these recordings cover all speeds.
    """

    @property
    def law(self) -> Array:
        """Torque (samples,) of the friction law alone, which planning uses."""
        known_parts = (self.position_ripple, self.reaction)
        return self.tau - sum(part for part in known_parts if part is not None)

    @staticmethod
    def _rms_of(part: Array | None) -> float | None:
        """Return the RMS of a part of the torque. None if it is unknown."""
        return None if part is None else rms(part)

    @property
    def mean_inside(self) -> bool | None:
        """True if the measured mean torque is within its band. None without a band."""
        if self.band is None:
            return None
        low, high = self.band.mean
        return bool(low <= self.recording.tau.mean() <= high)

    @property
    def sample_coverage(self) -> float | None:
        """Share of the moving samples whose torque is in the band. None without a band."""
        moving = np.logical_not(self.rest)
        if self.band is None or not moving.any():
            return None
        covered = (self.recording.tau >= self.band.low) & (self.recording.tau <= self.band.high)
        return float(covered[moving].mean())

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on extrapolated speeds, and on signs that another drive was recorded."""
        if self.unseen is None:
            return self._foreign
        text = f"extrapolated: the fit had no recording near {self.unseen * 30 / np.pi:.3g} rpm"
        return (*self._foreign, text)

    @property
    def _foreign(self) -> tuple[str, ...]:
        """Remarks on a measured torque that suggests another drive, load or unit."""
        moving = np.logical_not(self.rest)
        expected, measured = (
            float(np.abs(self.tau[moving]).mean()),
            float(np.abs(self.recording.tau[moving]).mean()),
        )
        ratio = measured / max(expected, 1e-300)
        if 7.0 < ratio < 14.0 or 7.0 < 1 / max(ratio, 1e-300) < 14.0:
            return (
                f"the measured torque is {ratio:.2g} times the predicted: are % and ‰ exchanged?",
            )
        if self.nrmsd > IMPLAUSIBLE or abs(ratio - 1) > IMPLAUSIBLE:
            return (
                f"the error is {self.nrmsd:.2g} of the torque's range, and the measured torque is "
                f"{ratio:.2g} times the predicted: is it a recording of this drive, load and "
                "direction?",
            )
        return ()

    def to_dict(self) -> JsonObject:
        """Return the output of `predict --json` for one recording, without file names."""
        return {
            "recording": self.recording.name,
            "nrmsd": self.nrmsd,
            "nrmsd_law": nrmsd(self.law, self.recording.tau),
            "position_ripple_rms": self._rms_of(self.position_ripple),
            "reaction_rms": self._rms_of(self.reaction),
            "mean_measured": float(self.recording.tau.mean()),
            "mean_band": None if self.band is None else list(self.band.mean),
            "mean_inside": self.mean_inside,
            "sample_coverage": self.sample_coverage,
            "peak_measured": float(np.abs(self.recording.tau).max()),
            "peak_99": None if self.band is None else self.band.peak,
            "repairs": list(self.recording.repairs),
            "remarks": list(self.remarks),
            "extrapolated_speed": self.unseen,
            "samples": len(self.recording.time),
            "rest_share": float(self.rest.mean()),
            "contact_lost": self.contact_lost,
        }


def nrmsd(predicted: Array, measured: Array) -> float:
    """Return the normalised RMS error of a predicted torque.

    It is the RMS of predicted − measured, divided by the range of the measured torque. Both arrays
    have the shape (samples,) and the same unit.

    Raises
    ------
    RecordingError
        If the measured torque is constant.
    """
    span = float(np.ptp(measured))
    if span == 0.0:
        raise RecordingError("the measured torque is constant: NRMSD is not defined")
    return rms(predicted - measured) / span


def predict_recording(
    drive: Drive, recording: Recording, load: float = 0.0, load_inertia: float = 0.0
) -> Prediction:
    """Predict the motor torque of a recording from its speed alone.

    For a steady-state recording, the speed is replaced by its mean. At rest, a self-locking drive
    holds without torque. The torque that the integrator of a controller leaves at rest is not
    predicted.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    recording : Recording
        Measured speed and torque.
    load : float
        Constant effort on the output, N·m or N.
    load_inertia : float
        Inertia of the payload at the output, kg·m² or kg.

    Returns
    -------
    Prediction
        Predicted torque, its band and its error.
    """
    w = recording.w
    is_steady = kind_of(recording) == "steady"
    if is_steady:
        w = np.full_like(w, w.mean())
    motion = Motion.from_speed(recording.time, w)
    deviation = recording.w - w if is_steady else deviation_of(w, motion.direction)
    tau = predict_torque(drive, motion, load, load_inertia)
    loaded = replace(drive, output_inertia=drive.output_inertia + load_inertia)
    effort = output_effort(
        loaded, load, motion.w / drive.ratio, motion.wd / drive.ratio, motion.direction
    )
    contact_lost = float(np.mean(nut_contact(loaded, effort, motion.wd) <= 0.0))
    tau = tau + departure(drive, motion, load)
    answer = controller_reaction(drive, motion, deviation)
    wave = repeating(drive, recording, motion)
    if wave is not None and answer is not None:
        # The answer of the controller contains the ripple that repeats with the angle.
        wave = np.where(answer == 0.0, wave, 0.0)
    band = band_of(drive, motion, tau, load, wave=wave, reaction=answer)
    for part in (wave, answer):
        tau = tau if part is None else tau + part
    return Prediction(
        recording,
        tau,
        rest=motion.direction == 0,
        nrmsd=nrmsd(tau, recording.tau),
        contact_lost=contact_lost,
        band=band,
        position_ripple=wave,
        reaction=answer,
        unseen=unseen_speed(drive, motion),
    )


def repeating(drive: Drive, recording: Recording, motion: "Motion") -> Array | None:
    """Return the part of the torque (samples,) in N·m that repeats with the motor angle.

    The result is None if the recording lacks the angle, or the drive file lacks the phases of the
    harmonics.
    """
    posterior = friction_of(drive).posterior
    if posterior is None or recording.angle is None:
        return None
    series = [(sign, posterior.harmonics(sign)) for sign in (1, -1)]
    waves = [
        np.where(motion.direction == sign, harmonics.torque(recording.angle), 0.0)
        for sign, harmonics in series
        if harmonics is not None and harmonics.phased
    ]
    return np.sum(waves, axis=0) if waves else None


def controller_reaction(drive: Drive, motion: "Motion", deviation: Array) -> Array | None:
    """Return the torque (samples,) in N·m with which the controller answers a deviation of the speed.

    The result is None if the drive file does not contain the reaction, and 0 at speeds at which the
    recordings of the fit do not confirm it. `deviation` (samples,) is in rad/s.
    """
    posterior = friction_of(drive).posterior
    if posterior is None or posterior.reaction is None:
        return None
    reaction = posterior.reaction
    torque = shifted(motion.time, deviation, np.array(reaction.delays)) @ np.array(reaction.taps)
    is_known = (reaction.explained_share(motion.w) > 0) & (motion.direction != 0)
    return np.where(is_known, torque, 0.0)


def unseen_speed(drive: Drive, motion: "Motion") -> float | None:
    """Return the motor speed that is farthest from the recordings of the fit, rad/s.

    The result is None if the recordings cover the speeds of the motion, or if the drive has no
    posterior.
    """
    posterior = friction_of(drive).posterior
    extremes = np.array(
        [end for end in (motion.w.max(), motion.w.min()) if end * np.sign(end) > STANDSTILL]
    )
    extremes = extremes[np.isin(np.sign(extremes), motion.direction)]
    if posterior is None or not posterior.speeds or not len(extremes):
        return None
    distance = outside(posterior, extremes)
    return float(extremes[np.argmax(distance)]) if distance.max() > EXTRAPOLATED else None


def departure(drive: Drive, motion: "Motion", load: float) -> Array:
    """Return the expected difference between the torque and that of the drive's parameters, N·m.

    The result (samples,) has two parts. The first is the error of the friction law, which is
    interpolated between the recordings of the fit. The second is the difference between the median
    of the equally likely parameter sets and the drive's own parameters: if several laws are
    possible, the selected law is not the best prediction at speeds without recordings. The result
    is 0 at rest, and for a drive without a posterior.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    motion : Motion
        Motion whose torque is predicted.
    load : float
        Constant effort on the output including the rig's load_offset, N·m or N.
    """
    posterior = friction_of(drive).posterior
    if posterior is None:
        return np.zeros(len(motion.w))
    w, direction, index = _kinds(motion)
    factors, _ = expected_departure(posterior, w)
    median = np.median(_sets(drive, posterior, w, load), axis=0)
    expected = median + factors @ np.array(posterior.departures)
    return np.where(direction == 0, 0.0, expected)[index]


def _kinds(motion: "Motion") -> tuple[Array, Array, Indices]:
    """Find the distinct pairs of speed and direction in a motion, which have equal torques.

    Returns
    -------
    w, direction : (kinds,)
        Motor speed in rad/s and sign of the motion of each pair. At rest, the speed is 1 rad/s, and
        the direction 0.
    index : (samples,)
        Index of the pair of each sample.
    """
    pairs = np.column_stack([motion.w, motion.direction])
    kinds, index = np.unique(pairs, axis=0, return_inverse=True)
    speed, direction = kinds.T
    w = np.where(direction == 0, 1.0, direction * np.maximum(np.abs(speed), STANDSTILL))
    return w, direction, index.reshape(-1)


def _sets(drive: Drive, posterior: Posterior, w: Array, load: float) -> Array:
    """Return the differences between the torque of each parameter set and that of the drive, N·m.

    Each parameter set has its own errors at the recordings of the fit. Their interpolation is
    subtracted, so that every set agrees with the recordings at their speeds.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    posterior : Posterior
        Equally likely parameter sets.
    w : (speeds,)
        Motor speeds, rad/s.
    load : float
        Constant effort on the output including the rig's load_offset, N·m or N.

    Returns
    -------
    (sets, speeds)
    """
    sets: Keywords = {name: column[:, None] for name, column in posterior.values().items()}
    offset = 0.0 if drive.rig is None else drive.rig.load_offset
    drawn_load = load - offset + sets.pop(LOAD_OFFSET, np.full((len(posterior.draws), 1), offset))
    drives = drive_with(drive, sets)

    def difference(v: Array) -> Array:
        return map_torque(drives, v, drawn_load) - map_torque(drive, v, load)

    factors, _ = expected_departure(posterior, w)
    return difference(w) - difference(np.array(posterior.speeds)) @ factors.T


def band_of(
    drive: Drive,
    motion: "Motion",
    tau: Array,
    load: float,
    *,
    wave: Array | None = None,
    reaction: Array | None = None,
) -> PredictionBand | None:
    """Return the 95 % band around a predicted torque, or None for a drive without a posterior.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    motion : Motion
        Motion whose torque is predicted.
    tau : (samples,)
        Predicted torque including `departure`, N·m.
    load : float
        Constant effort on the output including the rig's load_offset, N·m or N.
    wave : (samples,), optional
        Predicted torque that repeats with the angle, N·m. It reduces the unpredicted ripple.
    reaction : (samples,), optional
        Predicted reaction of the controller, N·m. It reduces the unpredicted ripple.
    """
    posterior = friction_of(drive).posterior
    if posterior is None:
        return None
    # Samples of equal speed and direction have equal bands: each index is drawn once.
    w, direction, index = _kinds(motion)
    rng, count = np.random.default_rng(SEED), len(posterior.draws)
    spread = _sets(drive, posterior, w, load)
    scatter = posterior.scatter * expected_departure(posterior, w)[1]
    spread += scatter * rng.standard_t(SCATTER_DEGREES, (count, 1)) - np.median(spread, axis=0)
    spread[:, direction == 0] = 0.0
    low, high = interval_of(
        tau.mean() + spread @ (np.bincount(index, minlength=len(w)) / len(index))
    )
    unexplained = np.ones(len(w))
    if reaction is not None and posterior.reaction is not None:
        unexplained -= posterior.reaction.explained_share(w)
    peaks = np.zeros(count)
    for sign in (1, -1):
        same, ripple = direction == sign, posterior.ripple(sign)
        if not same.any():
            continue
        top = int(np.argmax(np.abs(tau) * (motion.direction == sign)))
        peak = np.abs(tau[top] + spread[:, index[top]])
        if ripple is not None:
            peak += ripple.draw_peak(rng, count)
            series, known_square = posterior.harmonics(sign), 0.0
            remaining = np.sqrt(unexplained[same])
            if wave is not None and series is not None and series.phased and remaining.min() == 1:
                known_square = float(np.sum(series.amplitudes**2) / 2)
            spread[:, same] += remaining * ripple.draw(rng, count, known_square)[:, None]
        peaks = np.maximum(peaks, peak)
    ends = np.quantile(spread, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)[:, index]
    ends += sum((part for part in (wave, reaction) if part is not None), start=tau)
    return PredictionBand((low, high), ends[0], ends[1], float(np.quantile(peaks, PEAK_CONFIDENCE)))


@record
class Motion:
    """Motion of a drive, computed from a recorded speed. Arrays have the shape (samples,)."""

    time: Array
    """Time, s."""
    w: Array
    """Motor speed, rad/s."""
    wd: Array
    """Motor acceleration, rad/s²."""
    direction: Array
    """Direction in which the motor pushes, ±1, already START_LEAD before a start. 0 at rest."""
    rests: tuple[tuple[int, int], ...]
    """Index of the first sample and one past the last sample of each rest."""

    @staticmethod
    def from_speed(time: Array, w: Array) -> "Motion":
        """Find rests, directions and accelerations in a recorded speed.

        The speed channel averages and rounds, so it shows a start too late. The direction is
        therefore set START_LEAD before the end of each rest.

        Parameters
        ----------
        time : (samples,)
            Time, s.
        w : (samples,)
            Motor speed, rad/s.
        """
        rest = rest_mask(time, w)
        rests = [(start, stop) for start, stop in runs(rest)]
        direction = np.sign(_fill_gaps(np.where(rest, np.nan, w)))
        direction[rest] = 0.0
        for start, stop in rests:
            if stop < len(w):
                lead = time[start:stop] > time[stop] - START_LEAD
                lead[-1] = True
                direction[start:stop][lead] = direction[stop]
        return Motion(time, w, np.gradient(w, time), direction, tuple(rests))


def predict_torque(drive: Drive, motion: Motion, load: float, load_inertia: float) -> Array:
    """Compute the motor torque along a motion by the drive's friction law, (samples,) in N·m.

    The law includes frictional memory and the growth of friction at rest. At rest, the result is
    the holding torque.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    motion : Motion
        Motion of the motor.
    load : float
        Constant effort on the output, N·m or N.
    load_inertia : float
        Inertia of the payload at the output, kg·m² or kg.
    """
    drive = replace(drive, output_inertia=drive.output_inertia + load_inertia)
    moving = motion.direction != 0
    effort = output_effort(
        drive, load, motion.w / drive.ratio, motion.wd / drive.ratio, motion.direction
    )
    mu = coefficient_along(friction_of(drive), motion)
    tau = motor_torque(
        drive, effort, motion.w, motion.wd, direction=np.where(moving, motion.direction, 1.0), mu=mu
    )
    return np.where(moving, np.asarray(tau), holding_torque(drive, load))


def coefficient_along(friction: Friction, motion: Motion) -> Array:
    """Return the friction coefficient of the gear mesh along a motion, (samples,).

    The coefficient grows with the time at rest. After a rest, the Stribeck term starts at the
    coefficient of breakaway and decreases with the speed that frictional memory delays. Before the
    first rest, it starts at mu_stribeck.
    """
    speed = np.abs(remembered_speed(friction, motion.time, motion.w))
    mu = np.array(friction_coefficient(friction, speed), dtype=float)
    for k, (start, stop) in enumerate(motion.rests):
        dwell = (
            motion.time[min(stop, len(mu) - 1)]
            - motion.time[start]
            + (LONG_REST if start == 0 else 0.0)
        )
        breakaway_mu = float(static_coefficient(friction, dwell, mu[start - 1] if start else None))
        end = motion.rests[k + 1][0] if k + 1 < len(motion.rests) else len(mu)
        mu[start:stop] = breakaway_mu
        shape = np.zeros(end - stop)
        if friction.law != "coulomb" and friction.stribeck_speed:
            shape = stribeck_shape(friction.law, speed[stop:end] / friction.stribeck_speed)
        # Until the remembered speed leaves zero, friction is still that of breakaway.
        shape = np.where(speed[stop:end] > 0, shape, 1.0)
        mu[stop:end] = friction.mu + (breakaway_mu - friction.mu) * shape
    return mu


def _fill_gaps(values: Array) -> Array:
    """Replace zeros and NaN in values (samples,) by the last nonzero value before them.

    At the beginning, they are replaced by the first nonzero value.
    """
    values = np.where(values == 0, np.nan, values)
    valid = np.flatnonzero(np.isfinite(values))
    if not len(valid):
        return np.zeros(len(values))
    previous = np.searchsorted(valid, np.arange(len(values)), side="right") - 1
    return values[valid[np.maximum(previous, 0)]]

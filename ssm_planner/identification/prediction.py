"""Predict motor torque from measured speed with 95 % bands, and compare it with measured torque.

`predict_recording` is the main function. The predicted torque is the sum of the friction law, of
the ripple that repeats with the motor angle, and of the reaction of the speed controller. The band
follows from the posterior, that is, from the equally likely parameter sets in the drive file.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ssm_planner.dynamics import (
    RANDOM_SEED,
    STANDSTILL_SPEED,
    delayed_speed,
    drive_with_values,
    friction_coefficient,
    required_friction,
    static_coefficient,
    stribeck_shape,
)
from ssm_planner.dynamics.transmission import (
    holding_torque,
    motor_torque,
    nut_contact_force,
    output_effort,
)
from ssm_planner.errors import RecordingError
from ssm_planner.identification.parameters import map_torque
from ssm_planner.identification.posterior import (
    SCATTER_DEGREES,
    extrapolation_distance,
    predict_law_error,
)
from ssm_planner.identification.reaction import delayed_signals, speed_deviation
from ssm_planner.identification.recordings import Recording, largest_magnitude, rms, true_runs
from ssm_planner.identification.torque_map import recording_kind, rest_mask
from ssm_planner.problem import (
    CONFIDENCE,
    LOAD_OFFSET,
    Drive,
    Friction,
    Posterior,
    central_interval,
)
from ssm_planner.typing import Array, Indices, JsonObject, Keywords, Range, record

ONSET_ANGLE = 0.1
"""Angle that determines how long the motor pushes before the first nonzero speed reading, rad.

This time is the angle divided by the usual speed. During it, the motor winds up the drive, and the
recorder averages and rounds the speed. A slow start therefore takes longer than a fast one.
The angle agrees with the recordings of all three rigs.
"""

EXTRAPOLATION_THRESHOLD = 0.25
"""Distance from the recorded speeds above which a speed counts as extrapolated, see
`extrapolation_distance`.
"""
PEAK_CONFIDENCE = 0.99
"""Probability with which the largest torque is below its bound."""
IMPLAUSIBLE_ERROR = 0.5
"""NRMSD, or relative error of the mean |torque|, above which another drive is suspected."""
INITIAL_REST_TIME = 10.0
"""Assumed time at rest before a recording that begins at rest, s."""


@record
class PredictionBand:
    """95 % band of the predicted motor torque of a recording, N·m.

    The measured torque is expected to be in the band with a probability of 95 %. Arrays have the
    shape (samples,), with one value for each sample of the recording.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> ssm.PredictionBand((0.9, 1.1), low=np.zeros(3), high=np.ones(3), peak=1.4).mean
    (0.9, 1.1)
    """

    mean: Range
    """Lower and upper end of the band of the mean torque.

    Its width is due to uncertain parameters and to the scatter of the mean between recordings.
    """
    low: Array
    """Lower end of the band of single samples, which includes ripple and noise."""
    high: Array
    """Upper end of the band of single samples."""
    peak: float
    """Value that the largest |torque| exceeds with a probability of 1 %."""


@record
class Prediction:
    """Predicted and measured motor torque of one recording, N·m.

    Arrays have the shape (samples,), with one value for each sample of the recording. Ripple is the
    deviation of the torque from its mean during motion at constant speed.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> (result,) = ssm.predict("identified.yaml", ["recording.csv"])  # doctest: +SKIP
    >>> result.nrmsd, result.mean_inside  # doctest: +SKIP
    """

    recording: Recording
    """Measured speed and torque."""
    tau: Array
    """Predicted torque: the sum of `law`, `position_ripple` and `reaction`."""
    law: Array
    """Torque of the friction law alone, which planning uses."""
    position_ripple: Array
    """Torque that repeats with the motor angle. 0 if it is unknown."""
    reaction: Array
    """Torque with which the controller answers the recorded speed. 0 if it is unknown."""
    rest: Array
    """Mask (samples,) of the samples at rest, for which the holding torque is predicted."""
    nrmsd: float
    """RMS error of the predicted torque, divided by the range of the measured torque (`nrmsd`)."""
    contact_lost: float = 0.0
    """Share of the samples in which one half of the preloaded nut loses contact.

    The torque law does not hold in these samples.
    """
    band: PredictionBand | None = None
    """95 % band of the torque. None if the drive file does not contain a posterior."""
    unseen: float | None = None
    """Motor speed that is farthest from the speeds of the recordings of the fit, rad/s.

    None if these recordings cover all speeds of the predicted recording, see `unseen_speed`.
    """

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
        return tuple(self._remarks())

    def _remarks(self) -> Iterator[str]:
        """Yield remarks on signs that another drive was recorded, and on extrapolated speeds.

        The mean |torque| during motion is compared with the predicted one. A ratio of about 10 or
        0.1 suggests that the units % and ‰ of the torque were exchanged. Other large errors suggest
        another drive, load or direction.
        """
        moving = np.logical_not(self.rest)
        expected = np.abs(self.tau[moving]).mean()
        measured = np.abs(self.recording.tau[moving]).mean()
        ratio = measured / max(expected, 1e-300)  # the small number prevents a division by 0
        if 7.0 < ratio < 14.0 or 7.0 < 1 / max(ratio, 1e-300) < 14.0:
            yield f"the measured torque is {ratio:.2g} times the predicted: are % and ‰ exchanged?"
        elif self.nrmsd > IMPLAUSIBLE_ERROR or abs(ratio - 1) > IMPLAUSIBLE_ERROR:
            yield (
                f"the error is {self.nrmsd:.2g} of the torque's range, and the measured torque is "
                f"{ratio:.2g} times the predicted: is it a recording of this drive, load and "
                "direction?"
            )
        if self.unseen is not None:
            yield f"extrapolated: the fit had no recording near {self.unseen * 30 / np.pi:.3g} rpm"

    def to_dict(self) -> JsonObject:
        """Return the comparison of predicted and measured torque as a dict, in SI units.

        The command `predict --json` prints this dict for each recording. It contains no file names.
        """
        measured = self.recording.tau
        mean_band = None
        peak = None
        if self.band is not None:
            mean_band = list(self.band.mean)
            peak = self.band.peak
        return {
            "recording": self.recording.name,
            "nrmsd": self.nrmsd,
            "nrmsd_law": nrmsd(self.law, measured),
            "position_ripple_rms": rms(self.position_ripple),
            "reaction_rms": rms(self.reaction),
            "mean_measured": float(measured.mean()),
            "mean_band": mean_band,
            "mean_inside": self.mean_inside,
            "sample_coverage": self.sample_coverage,
            "peak_measured": largest_magnitude(measured),
            "peak_99": peak,
            "repairs": list(self.recording.repairs),
            "remarks": list(self.remarks),
            "extrapolated_speed": self.unseen,
            "samples": len(self.recording.time),
            "rest_share": float(self.rest.mean()),
            "contact_lost": self.contact_lost,
        }


def nrmsd(predicted: Array, measured: Array) -> float:
    """Compute the normalised RMS error of a predicted torque.

    It is the RMS of predicted − measured, divided by the range of the measured torque.

    Parameters
    ----------
    predicted, measured : (samples,) array
        Torques in the same unit.

    Returns
    -------
    float
        Error (dimensionless).

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

    The prediction is compared with the measured torque.

    For a steady-state recording, the friction law is evaluated at the mean speed. At rest, a
    self-locking drive holds without torque. The torque that the integrator of a controller leaves
    at rest is not predicted.

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
    is_steady = recording_kind(recording) == "steady"
    if is_steady:
        w = np.full_like(w, w.mean())
    motion = RecordedMotion.from_speed(recording.time, w)
    deviation = recording.w - w if is_steady else speed_deviation(w, motion.direction)
    law = predict_torque(drive, motion, load, load_inertia) + law_correction(drive, motion, load)
    loaded = replace(drive, output_inertia=drive.output_inertia + load_inertia)
    effort = output_effort(
        loaded, load, motion.w / drive.ratio, motion.wd / drive.ratio, motion.direction
    )
    contact_lost = float(np.mean(nut_contact_force(loaded, effort, motion.wd) <= 0.0))
    reaction = controller_reaction(drive, motion, deviation)
    # The reaction of the controller contains the ripple that repeats with the angle.
    wave = np.where(reaction == 0.0, position_ripple_torque(drive, recording, motion), 0.0)
    tau = law + wave + reaction
    return Prediction(
        recording,
        tau,
        law=law,
        position_ripple=wave,
        reaction=reaction,
        rest=motion.direction == 0,
        nrmsd=nrmsd(tau, recording.tau),
        contact_lost=contact_lost,
        band=prediction_band(drive, motion, law, load, position_ripple=wave, reaction=reaction),
        unseen=unseen_speed(drive, motion),
    )


def position_ripple_torque(drive: Drive, recording: Recording, motion: "RecordedMotion") -> Array:
    """Compute the part of the torque that repeats with the motor angle.

    Parameters
    ----------
    drive : Drive
        Drive with its friction. The harmonics of the ripple are in its posterior.
    recording : Recording
        Recording with the motor angle.
    motion : RecordedMotion
        Motion of the recording, which selects the harmonics of its direction.

    Returns
    -------
    (samples,) array
        Motor torques (N·m). They are 0 at rest, if the recording lacks the angle, and if the drive
        file lacks the phases of the harmonics.
    """
    wave = np.zeros(len(motion.w))
    posterior = required_friction(drive).posterior
    if posterior is None or recording.angle is None:
        return wave
    for sign in (1, -1):
        harmonics = posterior.harmonics(sign)
        if harmonics is not None and harmonics.phased:
            wave += np.where(motion.direction == sign, harmonics.torque(recording.angle), 0.0)
    return wave


def controller_reaction(drive: Drive, motion: "RecordedMotion", deviation: Array) -> Array:
    """Compute the torque with which the speed controller answers a deviation of the speed.

    The torque is the deviation filtered with the taps in the drive file, see the module `reaction`.

    Parameters
    ----------
    drive : Drive
        Drive with its friction and posterior.
    motion : RecordedMotion
        Motion whose torque is predicted.
    deviation : (samples,) array
        Deviation of the recorded speed from the usual one (rad/s), see `speed_deviation`.

    Returns
    -------
    (samples,) array
        Motor torques (N·m). They are 0 at rest, at speeds at which the recordings of the fit do not
        confirm the reaction, and if the drive file does not contain it.
    """
    posterior = required_friction(drive).posterior
    if posterior is None or posterior.reaction is None:
        return np.zeros(len(motion.w))
    reaction = posterior.reaction
    delayed = delayed_signals(motion.time, deviation, np.array(reaction.delays))
    torque = delayed @ np.array(reaction.taps)
    is_known = (reaction.explained_share(motion.w) > 0) & (motion.direction != 0)
    return np.where(is_known, torque, 0.0)


def unseen_speed(drive: Drive, motion: "RecordedMotion") -> float | None:
    """Find the motor speed of a motion that is farthest from the recordings of the fit.

    No recording tests the friction law at such a speed, so the user is warned of an extrapolation.

    Parameters
    ----------
    drive : Drive
        Drive with its friction and posterior.
    motion : RecordedMotion
        Motion whose torque is predicted. Its largest and its smallest signed speed are examined.

    Returns
    -------
    float or None
        Motor speed (rad/s). None if its `extrapolation_distance` is at most
        `EXTRAPOLATION_THRESHOLD`, or if the drive has no posterior with recordings.
    """
    posterior = required_friction(drive).posterior
    extremes = np.array([motion.w.max(), motion.w.min()])
    moves = np.isin(np.sign(extremes), motion.direction)
    extremes = extremes[moves & (np.abs(extremes) > STANDSTILL_SPEED)]
    if posterior is None or not posterior.speeds or not len(extremes):
        return None
    distance = extrapolation_distance(posterior, extremes)
    if distance.max() <= EXTRAPOLATION_THRESHOLD:
        return None
    return float(extremes[np.argmax(distance)])


def law_correction(drive: Drive, motion: "RecordedMotion", load: float) -> Array:
    """Compute the expected difference between the true torque and that of the drive's parameters.

    The correction has two parts. The first is the error of the friction law, which is known at the
    speeds of the recordings of the fit and is interpolated between them. The second is the median
    torque of the equally likely parameter sets minus the torque of the drive's own parameters. If
    several laws are possible, this median predicts better than the selected law at speeds without
    recordings.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    motion : RecordedMotion
        Motion whose torque is predicted.
    load : float
        Constant effort on the output including the load_offset of the rig (N·m or N).

    Returns
    -------
    (samples,) array
        Torques that must be added to those of the friction law (N·m). They are 0 at rest, and for a
        drive without a posterior.
    """
    posterior = required_friction(drive).posterior
    if posterior is None:
        return np.zeros(len(motion.w))
    w, direction, index = _distinct_speeds(motion)
    factors, _ = predict_law_error(posterior, w)
    median = np.median(_parameter_set_differences(drive, posterior, w, load), axis=0)
    expected = median + factors @ np.array(posterior.departures)
    return np.where(direction == 0, 0.0, expected)[index]


def _distinct_speeds(motion: "RecordedMotion") -> tuple[Array, Array, Indices]:
    """Find the distinct pairs of speed and direction in a motion.

    Samples with the same pair have the same torque, so a torque is computed only once for each
    pair.

    Parameters
    ----------
    motion : RecordedMotion
        Motion with `samples` samples.

    Returns
    -------
    w : (pairs,) array
        Signed motor speed of each pair (rad/s), at least `STANDSTILL_SPEED` in magnitude. It is 1
        rad/s at rest, where the torque at this speed is not used.
    direction : (pairs,) array
        Direction of motion of each pair, ±1, or 0 at rest.
    index : (samples,) array
        Index of the pair of each sample.
    """
    pairs = np.column_stack([motion.w, motion.direction])
    distinct_pairs, index = np.unique(pairs, axis=0, return_inverse=True)
    speed, direction = distinct_pairs.T
    w = np.where(direction == 0, 1.0, direction * np.maximum(np.abs(speed), STANDSTILL_SPEED))
    return w, direction, index.reshape(-1)


def _parameter_set_differences(drive: Drive, posterior: Posterior, w: Array, load: float) -> Array:
    """Compute by how much the torque of each parameter set differs from that of the drive itself.

    Each torque is first corrected by the interpolated errors of its friction law at the recordings
    of the fit. All of them nearly agree at the speeds of the recordings then, and the differences
    show the uncertainty at other speeds.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    posterior : Posterior
        Equally likely parameter sets.
    w : (speeds,) array
        Motor speeds (rad/s).
    load : float
        Constant effort on the output including the load_offset of the rig (N·m or N).

    Returns
    -------
    (sets, speeds) array
        Differences of the motor torque (N·m).

    Notes
    -----
    The differences are Δτ(w) − A(w)·Δτ(w_k), where Δτ is the torque of a set minus that of the
    drive, w_k are the speeds of the recordings, and A contains the factors of `predict_law_error`.
    """
    sets: Keywords = {name: column[:, None] for name, column in posterior.values().items()}
    offset = 0.0 if drive.rig is None else drive.rig.load_offset
    drawn_offset = sets.pop(LOAD_OFFSET, np.full((len(posterior.draws), 1), offset))
    drawn_load = load - offset + drawn_offset
    drives = drive_with_values(drive, sets)

    def difference(v: Array) -> Array:
        """Compute the differences Δτ (sets, speeds) at the motor speeds v (speeds,)."""
        return map_torque(drives, v, drawn_load) - map_torque(drive, v, load)

    factors, _ = predict_law_error(posterior, w)
    return difference(w) - difference(np.array(posterior.speeds)) @ factors.T


def prediction_band(
    drive: Drive,
    motion: "RecordedMotion",
    tau: Array,
    load: float,
    *,
    position_ripple: Array | float = 0.0,
    reaction: Array | float = 0.0,
) -> PredictionBand | None:
    """Compute the 95 % band around a predicted torque from the posterior of the drive.

    The band contains the uncertainty of the parameters, the scatter of the mean torque between
    recordings, and the ripple and noise that are not predicted. All of them are drawn at random
    once for each parameter set of the posterior, and the band consists of the quantiles of the
    draws.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    motion : RecordedMotion
        Motion whose torque is predicted.
    tau : (samples,) array
        Predicted torque including `law_correction`, without ripple (N·m).
    load : float
        Constant effort on the output including the load_offset of the rig (N·m or N).
    position_ripple, reaction : float or (samples,) array
        Predicted torque that repeats with the motor angle, and that of the controller (N·m).

    Returns
    -------
    PredictionBand or None
        Band of the mean torque, of single samples and of the largest torque. None for a drive
        without a posterior.
    """
    posterior = required_friction(drive).posterior
    if posterior is None:
        return None
    # Samples of equal speed and direction have equal bands, so each such pair is drawn once.
    w, direction, index = _distinct_speeds(motion)
    rng = np.random.default_rng(RANDOM_SEED)
    count = len(posterior.draws)
    # Deviations of the torque from the prediction, (parameter sets, pairs).
    spread = _parameter_set_differences(drive, posterior, w, load)
    _, remaining = predict_law_error(posterior, w)
    scatter = posterior.scatter * remaining
    spread += scatter * rng.standard_t(SCATTER_DEGREES, (count, 1)) - np.median(spread, axis=0)
    spread[:, direction == 0] = 0.0
    # The mean over all samples weights each distinct speed by its number of samples.
    sample_shares = np.bincount(index, minlength=len(w)) / len(index)
    mean_band = central_interval(tau.mean() + spread @ sample_shares)
    wave = np.broadcast_to(position_ripple, len(tau))
    peaks = np.zeros(count)
    for sign in (1, -1):
        in_direction = direction == sign
        unpredicted = posterior.ripple(sign)
        if not in_direction.any():
            continue
        sample_in_direction = motion.direction == sign
        # The largest torque occurs where the predicted one is largest.
        top_sample = int(np.argmax(np.abs(tau) * sample_in_direction))
        peak = np.abs(tau[top_sample] + spread[:, index[top_sample]])
        if unpredicted is not None:
            peak += unpredicted.draw_peak(rng, count)
            known_square = float(np.mean(wave[sample_in_direction] ** 2))
            draws = unpredicted.draw(rng, count, known_square)[:, None]
            if posterior.reaction is not None:
                square = posterior.reaction.remaining_rms(w[in_direction]) ** 2 - known_square
                draws = np.sqrt(np.maximum(square, 0.0)) * rng.standard_normal((count, 1))
            spread[:, in_direction] += draws
        peaks = np.maximum(peaks, peak)
    ends = np.quantile(spread, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)
    low, high = ends[:, index] + (tau + wave + reaction)
    return PredictionBand(mean_band, low, high, float(np.quantile(peaks, PEAK_CONFIDENCE)))


@record
class RecordedMotion:
    """Motion of a drive, computed from a recorded speed. Arrays have the shape (samples,)."""

    time: Array
    """Time, s."""
    w: Array
    """Motor speed, rad/s."""
    wd: Array
    """Motor acceleration, rad/s²."""
    direction: Array
    """Direction in which the motor pushes, ±1, already before a start (`ONSET_ANGLE`). 0 at rest.
    """
    rests: tuple[tuple[int, int], ...]
    """Index of the first sample and one past the last sample of each rest."""

    @staticmethod
    def from_speed(time: Array, w: Array) -> "RecordedMotion":
        """Find rests, directions and accelerations in a recorded speed.

        The speed channel shows a start too late. The direction is therefore set before the end of
        each rest, by the time in which the median speed of all motion passes the angle
        `ONSET_ANGLE`.

        Parameters
        ----------
        time : (samples,) array
            Times (s).
        w : (samples,) array
            Motor speeds (rad/s).

        Returns
        -------
        RecordedMotion
            The motion.
        """
        rest = rest_mask(time, w)
        rests = tuple((start, stop) for start, stop in true_runs(rest))
        direction = np.zeros(len(w))
        moving = np.flatnonzero(~rest & (w != 0))
        if len(moving):
            # A sample of speed 0 within a motion has the direction of the sample before it.
            previous = np.searchsorted(moving, np.arange(len(w)), side="right") - 1
            direction = np.where(rest, 0.0, np.sign(w[moving[np.maximum(previous, 0)]]))
        usual_speed = np.median(np.abs(w[~rest])) if not rest.all() else np.inf
        lead_time = ONSET_ANGLE / max(usual_speed, STANDSTILL_SPEED)
        for start, stop in rests:
            if stop < len(w):
                lead = time[start:stop] > time[stop] - lead_time
                lead[-1] = True
                direction[start:stop][lead] = direction[stop]
        return RecordedMotion(time, w, np.gradient(w, time), direction, rests)


def predict_torque(drive: Drive, motion: RecordedMotion, load: float, load_inertia: float) -> Array:
    """Compute the motor torque along a motion by the drive's friction law.

    The friction law includes frictional memory (friction follows the speed after a delay) and the
    growth of friction at rest.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    motion : RecordedMotion
        Motion of the motor.
    load : float
        Constant effort on the output (N·m or N).
    load_inertia : float
        Inertia of the payload at the output (kg·m² or kg).

    Returns
    -------
    (samples,) array
        Motor torques (N·m). At rest, they are the holding torque, which is 0 for a self-locking
        drive.
    """
    drive = replace(drive, output_inertia=drive.output_inertia + load_inertia)
    moving = motion.direction != 0
    effort = output_effort(
        drive, load, motion.w / drive.ratio, motion.wd / drive.ratio, motion.direction
    )
    mu = friction_coefficient_along(required_friction(drive), motion)
    tau = motor_torque(
        drive, effort, motion.w, motion.wd, direction=np.where(moving, motion.direction, 1.0), mu=mu
    )
    return np.where(moving, np.asarray(tau), holding_torque(drive, load))


def friction_coefficient_along(friction: Friction, motion: RecordedMotion) -> Array:
    """Compute the friction coefficient of the gear mesh along a motion.

    Before the first rest, the coefficient is that of `friction_coefficient` at the speed w that
    frictional memory delays. During each rest, it is the coefficient μ_s of breakaway that belongs
    to the whole duration of this rest. After a rest, it is

        μ = mu + (μ_s − mu) · s(|w| / stribeck_speed),

    with the function s of `stribeck_shape`, so it decreases from μ_s as the speed rises.

    Parameters
    ----------
    friction : Friction
        Parameters of the friction law.
    motion : RecordedMotion
        Motion of the motor. A rest at its beginning counts as longer by `INITIAL_REST_TIME`.

    Returns
    -------
    (samples,) array
        Friction coefficients (dimensionless).
    """
    speed = np.abs(delayed_speed(friction, motion.time, motion.w))
    mu = np.array(friction_coefficient(friction, speed), dtype=float)
    for k, (start, stop) in enumerate(motion.rests):
        dwell = motion.time[min(stop, len(mu) - 1)] - motion.time[start]
        previous_mu = None
        if start == 0:
            dwell += INITIAL_REST_TIME
        else:
            previous_mu = mu[start - 1]
        breakaway_mu = float(static_coefficient(friction, dwell, previous_mu))
        end = len(mu)
        if k + 1 < len(motion.rests):
            end, _ = motion.rests[k + 1]
        mu[start:stop] = breakaway_mu
        shape = np.zeros(end - stop)
        if friction.law != "coulomb" and friction.stribeck_speed:
            shape = stribeck_shape(friction.law, speed[stop:end] / friction.stribeck_speed)
        # Until the remembered speed leaves zero, friction is still that of breakaway.
        shape = np.where(speed[stop:end] > 0, shape, 1.0)
        mu[stop:end] = friction.mu + (breakaway_mu - friction.mu) * shape
    return mu

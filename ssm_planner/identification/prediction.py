"""Torque predicted from measured speed, against measured torque."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ssm_planner.dynamics.friction import (
    STANDSTILL,
    friction_coefficient,
    friction_of,
    remembered_speed,
    static_coefficient,
    stribeck_shape,
)
from ssm_planner.dynamics.spread import drive_with
from ssm_planner.dynamics.transmission import (
    holding_torque,
    motor_torque,
    nut_contact,
    output_effort,
)
from ssm_planner.errors import RecordingError
from ssm_planner.identification.parameters import map_torque
from ssm_planner.identification.posterior import SCATTER_DEGREES, expected_departure, outside
from ssm_planner.identification.recordings import Recording
from ssm_planner.identification.torque_map import kind_of, rest_mask
from ssm_planner.problem.drive import Drive, Friction
from ssm_planner.problem.posterior import CONFIDENCE, LOAD_OFFSET, Posterior, interval_of
from ssm_planner.representation import ShortRepr
from ssm_planner.typing import Array, Indices

START_LEAD = 0.05
"""Time before the first nonzero speed reading in which the motor already pushes, s; at least one sample.

The recorder's speed is averaged and rounded: a drive must have broken away before it shows.
"""

UNSEEN = 0.25
"""Share beyond the slowest or fastest recording of the fit, as a logarithm, from which a speed counts as extrapolated."""
SEED = 20_210_521
PEAK_CONFIDENCE = 0.99
IMPLAUSIBLE = 0.5
"""NRMSD, or departure of the mean as a share, beyond which a recording is hardly one of the drive."""
LONG_REST = 10.0
"""Rest assumed before a recording that begins at standstill, s."""


@dataclass(frozen=True, eq=False)
class PredictionBand(ShortRepr):
    """What motor torque is expected to stay within, at 95 %; N·m, arrays (samples,)."""

    mean: tuple[float, float]
    """Of the mean over the recording: what is not known of the parameters, and scatter between recordings."""
    low: Array
    """Of single samples: ripple and noise besides."""
    high: Array
    peak: float
    """Largest |torque| of the recording at 99 %."""


@dataclass(frozen=True, eq=False)
class Prediction(ShortRepr):
    """Predicted and measured motor torque of one recording, N·m, arrays (samples,)."""

    recording: Recording
    tau: Array
    rest: Array
    """(samples,) of bool: the drive stands; its torque is then what holding needs."""
    nrmsd: float
    contact_lost: float = 0.0
    """Share of the samples in which a half nut of an antibacklash screw lifts off: there the law does not hold."""
    band: PredictionBand | None = None
    """None where the drive file says nothing of its friction's uncertainty."""
    unseen: float | None = None
    """The motor speed, rad/s, furthest outside those that the friction was identified at; None: all within."""

    @property
    def mean_inside(self) -> bool | None:
        """Whether the measured mean lies in its band; None: no band."""
        if self.band is None:
            return None
        low, high = self.band.mean
        return bool(low <= self.recording.tau.mean() <= high)

    @property
    def sample_coverage(self) -> float | None:
        """Share of the samples in motion whose measured torque lies in its band; None: no band."""
        moving = np.logical_not(self.rest)
        if self.band is None or not moving.any():
            return None
        inside = (self.recording.tau >= self.band.low) & (self.recording.tau <= self.band.high)
        return float(inside[moving].mean())

    @property
    def remarks(self) -> tuple[str, ...]:
        """Why the recording is hardly one of this drive, and which of its speeds no recording of the fit had, in words."""
        if self.unseen is None:
            return self._foreign
        text = f"extrapolated: the fit had no recording near {self.unseen * 30 / np.pi:.3g} rpm"
        return (*self._foreign, text)

    @property
    def _foreign(self) -> tuple[str, ...]:
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
                f"off by {self.nrmsd:.2g} of the torque's range, {ratio:.2g} times the predicted torque: a recording of "
                "this drive, load and direction?",
            )
        return ()

    def to_dict(self) -> dict[str, Any]:
        """The object that `predict --json` prints of one recording, without files."""
        return {
            "recording": self.recording.name,
            "nrmsd": self.nrmsd,
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
    """Root mean square of predicted − measured (samples,) over (max − min) of measured. Raises RecordingError."""
    span = float(np.ptp(measured))
    if span == 0.0:
        raise RecordingError("the measured torque is constant: NRMSD is not defined")
    return float(np.sqrt(np.mean((predicted - measured) ** 2)) / span)


def predict_recording(
    drive: Drive, recording: Recording, load: float = 0.0, load_inertia: float = 0.0
) -> Prediction:
    """Predict the motor torque of a recording from its speed alone; of a steady one from its mean speed.

    load: constant effort on the output, N·m or N; load_inertia: what the payload adds to the output inertia.
    At rest a self-locking drive is predicted to need no torque; what a controller's integrator leaves there is unknown.
    """
    w = recording.w
    if kind_of(recording) == "steady":
        w = np.full_like(w, w.mean())
    motion = Motion.of(recording.time, w)
    tau = predict_torque(drive, motion, load, load_inertia)
    loaded = replace(drive, output_inertia=drive.output_inertia + load_inertia)
    effort = output_effort(
        loaded, load, motion.w / drive.ratio, motion.wd / drive.ratio, motion.direction
    )
    lost = float(np.mean(nut_contact(loaded, effort, motion.wd) <= 0.0))
    at_rest = motion.direction == 0
    tau = tau + departure(drive, motion, load)
    wave = repeating(drive, recording, motion)
    band = band_of(drive, motion, tau, load, wave=wave)
    tau = tau if wave is None else tau + wave
    error, unseen = nrmsd(tau, recording.tau), unseen_speed(drive, motion)
    return Prediction(
        recording, tau, at_rest, nrmsd=error, contact_lost=lost, band=band, unseen=unseen
    )


def repeating(drive: Drive, recording: Recording, motion: Motion) -> Array | None:
    """(samples,) torque that repeats with the angle, N·m; None where recording or drive file do not tell the phase."""
    posterior = friction_of(drive).posterior
    if posterior is None or recording.angle is None:
        return None
    known = [(sign, posterior.harmonics(sign)) for sign in (1, -1)]
    waves = [
        np.where(motion.direction == sign, harmonics.torque(recording.angle), 0.0)
        for sign, harmonics in known
        if harmonics is not None and harmonics.phased
    ]
    return np.sum(waves, axis=0) if waves else None


def unseen_speed(drive: Drive, motion: Motion) -> float | None:
    """The largest motor speed of a motion in a direction, rad/s, where it is outside those of the fit; None: within."""
    posterior = friction_of(drive).posterior
    fastest = np.array(
        [end for end in (motion.w.max(), motion.w.min()) if end * np.sign(end) > STANDSTILL]
    )
    fastest = fastest[np.isin(np.sign(fastest), motion.direction)]
    if posterior is None or not posterior.speeds or not len(fastest):
        return None
    apart = outside(posterior, fastest)
    return float(fastest[np.argmax(apart)]) if apart.max() > UNSEEN else None


def departure(drive: Drive, motion: Motion, load: float) -> Array:
    """(samples,) torque beyond that of the drive's own parameters, N·m; 0 at rest or without posterior.

    What recordings of near speed lead to expect, and the middle of the equally likely sets: where the recordings leave
    several laws possible, the one that was chosen is not the best guess at speeds that none of them had.
    load: constant effort on the output, the rig's load_offset included, N·m or N.
    """
    posterior = friction_of(drive).posterior
    if posterior is None:
        return np.zeros(len(motion.w))
    w, way, of = _kinds(motion)
    expected, _ = expected_departure(posterior, w)
    middle = np.median(_sets(drive, posterior, w, load), axis=0) + expected @ np.array(
        posterior.departures
    )
    return np.asarray(np.where(way == 0, 0.0, middle)[of])


def _kinds(motion: Motion) -> tuple[Array, Array, Indices]:
    """Speeds (kinds,) and directions (kinds,) that a motion has, and which of them each sample has, (samples,)."""
    kinds, of = np.unique(
        np.column_stack([motion.w, motion.direction]), axis=0, return_inverse=True
    )
    way = kinds[:, 1]
    return (
        np.where(way == 0, 1.0, way * np.maximum(np.abs(kinds[:, 0]), STANDSTILL)),
        way,
        of.reshape(-1),
    )


def _sets(drive: Drive, posterior: Posterior, w: Array, load: float) -> Array:
    """(sets, speeds) torque by each set of the posterior less that by the drive's parameters at speeds w, N·m.

    Where recordings were made the sets agree with them: their difference there is taken off as the recordings' departure is.
    """
    sets: dict[str, Any] = {name: column[:, None] for name, column in posterior.values().items()}
    offset = 0.0 if drive.rig is None else drive.rig.load_offset
    drawn_load = load - offset + sets.pop(LOAD_OFFSET, np.full((len(posterior.draws), 1), offset))
    each = drive_with(drive, sets)

    def beyond(at: Array) -> Array:
        return np.asarray(map_torque(each, at, drawn_load) - map_torque(drive, at, load))

    return beyond(w) - beyond(np.array(posterior.speeds)) @ expected_departure(posterior, w)[0].T


def band_of(
    drive: Drive, motion: Motion, tau: Array, load: float, *, wave: Array | None = None
) -> PredictionBand | None:
    """The band about the predicted torque tau (samples,), departure included; None where the drive has no posterior.

    load: constant effort on the output, the rig's load_offset included. wave: what repeats with the angle, (samples,),
    where it is known; the ripple is smaller by it.
    """
    posterior = friction_of(drive).posterior
    if posterior is None:
        return None
    # Samples of equal speed and direction have equal bands: only what differs is drawn.
    w, way, of = _kinds(motion)
    rng, count = np.random.default_rng(SEED), len(posterior.draws)
    spread = _sets(drive, posterior, w, load)
    own = (
        posterior.scatter
        * expected_departure(posterior, w)[1]
        * rng.standard_t(SCATTER_DEGREES, (count, 1))
    )
    spread = np.where(way == 0, 0.0, spread - np.median(spread, axis=0) + own)
    weight = np.bincount(of, minlength=len(w)) / len(of)
    low, high = interval_of(tau.mean() + spread @ weight)
    peaks = np.zeros(count)
    for sign in (1, -1):
        here, ripple, moved = (
            way == sign,
            posterior.ripple(sign),
            np.abs(tau) * (motion.direction == sign),
        )
        if here.any():
            top = int(np.argmax(moved))
            top_torque = np.abs(tau[top] + spread[:, of[top]])
            peaks = np.maximum(
                peaks, top_torque + (0.0 if ripple is None else ripple.draw_peak(rng, count))
            )
        if ripple is not None:
            harmonics = None if wave is None else posterior.harmonics(sign)
            known = (
                0.0
                if harmonics is None or not harmonics.phased
                else float(np.sum(harmonics.amplitudes**2) / 2)
            )
            spread[:, here] += ripple.draw(rng, count, known)[:, None]
    ends = np.quantile(spread, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)[:, of]
    ends += 0.0 if wave is None else wave
    return PredictionBand(
        (low, high), tau + ends[0], tau + ends[1], peak=float(np.quantile(peaks, PEAK_CONFIDENCE))
    )


@dataclass(frozen=True, eq=False)
class Motion:
    """What a recording of speed says: where the drive rests, where it moves or is about to, and how it accelerates."""

    time: Array
    w: Array
    wd: Array
    direction: Array
    """(samples,) −1, 0 or +1: sign of motion, also where it is about to start; 0 at rest."""
    rests: tuple[tuple[int, int], ...]
    """(first, one past last) sample of every rest."""

    @staticmethod
    def of(time: Array, w: Array) -> Motion:
        """From time (s) and motor speed (rad/s), arrays (samples,)."""
        rest = rest_mask(time, w)
        edges = np.flatnonzero(
            np.diff(np.concatenate([[False], rest, [False]]).astype(int))
        ).reshape(-1, 2)
        direction = np.sign(_held(np.where(rest, np.nan, w)))
        direction[rest] = 0.0
        for start, stop in edges:
            if stop < len(w):
                lead = time[start:stop] > time[stop] - START_LEAD
                lead[-1] = True
                direction[start:stop][lead] = direction[stop]
        return Motion(
            time, w, np.gradient(w, time), direction, tuple((int(a), int(b)) for a, b in edges)
        )


def predict_torque(drive: Drive, motion: Motion, load: float, load_inertia: float) -> Array:
    """(samples,) motor torque of the exact law along a motion, with friction's memory and growth at rest."""
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
    """(samples,) coefficient of the mesh: grown at rest, then fading with the speed that friction remembers.

    After a rest the Stribeck term starts from the coefficient at breakaway; before the first rest, from mu_stribeck.
    """
    felt = np.abs(remembered_speed(friction, motion.time, motion.w))
    mu = np.array(friction_coefficient(friction, felt), dtype=float)
    for k, (start, stop) in enumerate(motion.rests):
        dwell = (
            motion.time[min(stop, len(mu) - 1)]
            - motion.time[start]
            + (LONG_REST if start == 0 else 0.0)
        )
        broken = float(static_coefficient(friction, dwell, mu[start - 1] if start else None))
        until = motion.rests[k + 1][0] if k + 1 < len(motion.rests) else len(mu)
        mu[start:stop] = broken
        shape = np.zeros(until - stop)
        if friction.law != "coulomb" and friction.stribeck_speed:
            shape = stribeck_shape(friction.law, felt[stop:until] / friction.stribeck_speed)
        # Until the remembered speed leaves zero, friction is still that of breakaway.
        shape = np.where(felt[stop:until] > 0, shape, 1.0)
        mu[stop:until] = friction.mu + (broken - friction.mu) * shape
    return mu


def _held(values: Array) -> Array:
    """Zeros and gaps within motion take the last nonzero value, leading ones the next."""
    values = np.where(values == 0, np.nan, values)
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return np.zeros(len(values))
    at = np.clip(
        np.searchsorted(known, np.arange(len(values)), side="right") - 1, 0, len(known) - 1
    )
    return values[known[at]]

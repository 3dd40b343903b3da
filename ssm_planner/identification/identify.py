"""Identify the friction of a drive from recordings, and predict the torque of recordings.

`identify` and `predict` are the two functions for users. They read the recordings and the drive
file, and combine the other modules: `torque_map`, `fit`, `dynamic`, `harmonics` and `reaction` for
the identification, and `prediction` for the prediction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from ssm_planner.arguments import checked
from ssm_planner.dynamics import required_friction
from ssm_planner.errors import RecordingError
from ssm_planner.identification.drive_file import write_drive
from ssm_planner.identification.dynamic import DynamicFit, fit_dynamic
from ssm_planner.identification.fit import Estimate, MapFit, fit_map
from ssm_planner.identification.harmonics import fit_harmonics
from ssm_planner.identification.prediction import Prediction, predict_recording
from ssm_planner.identification.reaction import fit_reaction
from ssm_planner.identification.recordings import Recording, read_recordings, remove_repetitions
from ssm_planner.identification.session import session_notes
from ssm_planner.identification.torque_map import (
    TABLE_NAME,
    TorqueMap,
    compute_torque_map,
    read_torque_map,
    recording_kind,
)
from ssm_planner.loading import find_file, load_drive
from ssm_planner.problem import Drive, Harmonics, Reaction
from ssm_planner.progress import Progress, Step, silent
from ssm_planner.typing import JsonObject, Keywords, record


@record
class Identification:
    """Friction of a drive that was identified from recordings.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> result = ssm.identify("rig3_worm")  # doctest: +SKIP
    >>> result.drive.friction.mu  # doctest: +SKIP
    """

    fit: MapFit
    """Fit of the torque–velocity map."""
    dynamic: DynamicFit | None
    """Fit of the start–stop recordings. None without such recordings."""
    data: TorqueMap
    """Points of the torque–velocity map."""
    moving: tuple[Recording, ...]
    """Start–stop recordings."""
    harmonics: Mapping[str, Harmonics]
    """Part of the torque that repeats with the motor angle, by direction.

    The directions are `forwards` and `backwards`. One is missing if its recordings are shorter than
    two turns.
    """
    load: float
    """Constant effort on the output including an identified offset, N·m or N."""
    evidence: str
    """Text that describes the recordings or the table from which the map was computed."""
    file: Path
    """Drive file whose friction was identified."""

    @property
    def drive(self) -> Drive:
        """Drive with the identified friction."""
        return self.fit.drive if self.dynamic is None else self.dynamic.drive

    @property
    def dynamic_estimates(self) -> dict[str, Estimate]:
        """Estimates from the start–stop recordings by name. Empty without such recordings."""
        return {} if self.dynamic is None else dict(self.dynamic.estimates)

    def save(self, path: str | Path) -> Path:
        """Write a copy of the drive file with the identified friction.

        Parameters
        ----------
        path : str or Path
            File that is written.

        Returns
        -------
        Path
            The path of the file.

        Raises
        ------
        ExportError
            If the file cannot be written.
        """
        write_drive(
            path,
            self.file,
            self.drive,
            fit=self.fit,
            dynamic=self.dynamic_estimates,
            evidence=self.evidence,
        )
        return Path(path)

    def to_dict(self) -> JsonObject:
        """Return the result of the identification as a dict, in SI units.

        The command `identify --json` prints this dict. It contains no file names.
        """
        fit = self.fit
        estimates = fit.estimates | self.dynamic_estimates
        correlations = {}
        for name, row in zip(fit.correlation_names, fit.correlation.tolist(), strict=True):
            correlations[name] = dict(zip(fit.correlation_names, row, strict=True))
        repairs = list(self.data.repairs)
        for recording in self.moving:
            repairs += [f"{recording.name}: {repair}" for repair in recording.repairs]
        notes = list(fit.notes)
        start_stop = []
        if self.dynamic is not None:
            notes += self.dynamic.notes
            errors = zip(self.moving, self.dynamic.before, self.dynamic.after, strict=True)
            for recording, before, after in errors:
                start_stop.append(
                    {"recording": recording.name, "nrmsd_map_only": before, "nrmsd": after}
                )
        return {
            "law": fit.law,
            "law_shares": dict(fit.law_shares),
            "parameters": {name: asdict(estimate) for name, estimate in estimates.items()},
            "nrmsd": fit.nrmsd,
            "repairs": repairs,
            "points": len(self.data.w),
            "correlations": correlations,
            "inseparable": [list(group) for group in fit.inseparable],
            "outliers": [
                {"recording": name, "distance": distance, "weight": weight}
                for name, distance, weight in fit.outliers
            ],
            "combinations": {name: asdict(estimate) for name, estimate in fit.combinations.items()},
            "harmonics": {name: series.to_dict() for name, series in self.harmonics.items()},
            "criterion": {
                "name": "RMS error on recordings left out, N·m",
                "laws": dict(fit.criterion),
            },
            "start_stop": start_stop,
            "notes": notes,
        }


@checked
def identify(
    drive: str | Path,
    recordings: Sequence[str | Path] = (),
    *,
    law: str = "auto",
    fixed: Mapping[str, float] | None = None,
    free: Sequence[str] = (),
    progress: Progress = silent,
) -> Identification:
    """Identify the friction of a drive from recordings of its speed and torque.

    The torque–velocity map is fitted to the steady-state recordings. Breakaway, growth of friction
    at rest and frictional memory are fitted to the start–stop recordings. `fit_map` and
    `fit_dynamic` describe the methods.

    Parameters
    ----------
    drive : str or Path
        Drive file, or the name of a shipped drive.
    recordings : sequence of str or Path
        Files or folders. Without steady-state recordings, the map is read from the table of mean
        speeds and torques in the folder of the drive file.
    law : str
        Name of a friction law, or `auto` for the simplest law whose error on recordings that the
        fit has not used is close to the smallest.
    fixed : Mapping, optional
        Parameters that are not fitted, with their values by name, in SI units.
    free : sequence of str
        Parameters that are fitted in addition to those of the law (`b_ov`, `preload`).
    progress : callable
        Called with each step.

    Returns
    -------
    Identification
        The identified drive with the fits behind it.

    Raises
    ------
    RecordingError
        If a recording cannot be used, or if the recordings do not determine the parameters.
    ProblemError
        If the drive file is invalid.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> result = ssm.identify("rig3_worm")  # doctest: +SKIP
    >>> result.save("identified.yaml")  # doctest: +SKIP
    """
    template = load_drive(drive)
    recorded, repeated = remove_repetitions(_read_rig_recordings(template, recordings))
    kinds: dict[str, list[Recording]] = {"steady": [], "start_stop": []}
    for recording in recorded:
        kinds[recording_kind(recording)].append(recording)
    steady = kinds["steady"]
    moving = kinds["start_stop"]
    data, evidence = load_map(drive, steady, moving)
    data = replace(data, repairs=tuple(repeated) + data.repairs)
    load, inertia = rig_load(template)
    progress(Step(f"fitting the map of {len(data.w)} points"))
    fit = fit_map(
        template,
        data,
        load,
        law=law,
        fixed=fixed,
        reference=prior_centres(template),
        free=free,
        progress=progress,
    )
    wheel_ratio = None if template.slides else template.ratio
    harmonics = {
        "forwards": fit_harmonics(steady, 1, wheel_ratio),
        "backwards": fit_harmonics(steady, -1, wheel_ratio),
    }
    fit = replace(
        fit,
        drive=_with_ripple(fit.drive, harmonics, fit_reaction(steady)),
        notes=fit.notes + tuple(session_notes(data, moving)),
    )
    dynamic = None
    if moving:
        progress(Step(f"fitting {len(moving)} start–stop recordings"))
        dynamic = fit_dynamic(fit.drive, moving, fit.load, inertia)
    return Identification(
        fit=fit,
        dynamic=dynamic,
        data=data,
        moving=tuple(moving),
        harmonics={name: series for name, series in harmonics.items() if series is not None},
        load=fit.load,
        evidence=evidence,
        file=find_file(drive, "drives"),
    )


def _with_ripple(
    drive: Drive, harmonics: Mapping[str, Harmonics | None], reaction: Reaction | None
) -> Drive:
    """Add harmonics and the reaction of the speed controller to the posterior of a drive.

    Parameters
    ----------
    drive : Drive
        Drive with its identified friction.
    harmonics : Mapping
        Harmonics of the torque by direction (`forwards`, `backwards`). None if they are unknown.
    reaction : Reaction or None
        Reaction of the speed controller. None if it is unknown.

    Returns
    -------
    Drive
        The drive. It is unchanged if its friction has no posterior.
    """
    friction = required_friction(drive)
    if friction.posterior is None:
        return drive
    fields: Keywords = {f"harmonics_{name}": series for name, series in harmonics.items()}
    posterior = replace(friction.posterior, reaction=reaction, **fields)
    return replace(drive, friction=replace(friction, posterior=posterior))


@checked
def predict(
    drive: str | Path, recordings: Sequence[str | Path], progress: Progress = silent
) -> list[Prediction]:
    """Predict the motor torque of recordings from their measured speed.

    Parameters
    ----------
    drive : str or Path
        Drive file, or the name of a shipped drive. If it omits the friction, the friction is
        identified from the table of mean speeds and torques in its folder.
    recordings : sequence of str or Path
        Files or folders.
    progress : callable
        Called with each step.

    Returns
    -------
    list of Prediction
        One prediction for each recording.

    Raises
    ------
    RecordingError
        If a recording cannot be used.
    ProblemError
        If the drive file is invalid.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> (result,) = ssm.predict("identified.yaml", ["recording.csv"])  # doctest: +SKIP
    >>> result.nrmsd  # doctest: +SKIP
    """
    predicting = load_drive(drive)
    if not recordings:
        raise RecordingError("no recording to predict: name files or folders")
    recorded = _read_rig_recordings(predicting, recordings)
    load, inertia = rig_load(predicting)
    if predicting.friction is None:
        progress(Step("identifying from the table of figures"))
        data = load_map(drive)[0]
        predicting = fit_map(predicting, data, load, reference=prior_centres(predicting)).drive
    if predicting.rig is not None:
        load = predicting.rig.load
    predictions = []
    for k, recording in enumerate(recorded):
        progress(Step(f"predicting {recording.name}", k, len(recorded)))
        predictions.append(predict_recording(predicting, recording, load, inertia))
    return predictions


def friction_origin(drive: str | Path) -> str:
    """Describe where `predict` finds the friction of a drive.

    Parameters
    ----------
    drive : str or Path
        Drive file, or the name of a shipped drive.

    Returns
    -------
    str
        `the drive file`, or a description of the table of mean speeds and torques in its folder.
    """
    if load_drive(drive).friction is not None:
        return "the drive file"
    _, evidence = load_map(drive)
    return evidence


def _read_rig_recordings(drive: Drive, recordings: Sequence[str | Path]) -> list[Recording]:
    """Read recordings with the nominal torque and the direction of the drive's test rig.

    Parameters
    ----------
    drive : Drive
        Drive. Without a test rig, the nominal torque is unknown, and signs are kept.
    recordings : sequence of str or Path
        Files or folders.

    Returns
    -------
    list of Recording
        One recording for each file.
    """
    rig = drive.rig
    if rig is None:
        return read_recordings(recordings)
    return read_recordings(
        recordings, nominal_torque=rig.motor_nominal_torque, direction=rig.direction
    )


def rig_load(drive: Drive) -> tuple[float, float]:
    """Return the effort and the inertia of the payload on the test rig of a drive.

    Parameters
    ----------
    drive : Drive
        Drive with or without a test rig.

    Returns
    -------
    effort : float
        Effort on the output (N·m for a rotating drive, N for a sliding one). 0 without a test rig.
    inertia : float
        Inertia at the output (kg·m² or kg). 0 without a test rig.
    """
    if drive.rig is None:
        return 0.0, 0.0
    return drive.rig.F_payload, drive.rig.payload_inertia


def prior_centres(drive: Drive) -> dict[str, float]:
    """Return expected friction parameters, which become the centres of the prior.

    Parameters
    ----------
    drive : Drive
        Drive before the identification.

    Returns
    -------
    dict
        Values by name in SI units. They are the values published for the test rig or, without
        these, those of the friction in the drive file. The result is empty without both.
    """
    if drive.rig is not None and drive.rig.published:
        return dict(drive.rig.published)
    if drive.friction is None:
        return {}
    return {name: getattr(drive.friction, name) for name in ("mu", "b_c", "b_v", "b_oc")}


def load_map(
    drive_path: str | Path, steady: Sequence[Recording] = (), moving: Sequence[Recording] = ()
) -> tuple[TorqueMap, str]:
    """Compute or read the torque–velocity map that is fitted.

    Parameters
    ----------
    drive_path : str or Path
        Drive file, or the name of a shipped drive.
    steady : sequence of Recording
        Recordings at constant speed. If the sequence is empty, the map is read from the table in the
        folder of the drive file.
    moving : sequence of Recording
        Start–stop recordings, which are only mentioned in the description.

    Returns
    -------
    data : TorqueMap
        The map.
    evidence : str
        Description of its source.

    Raises
    ------
    RecordingError
        If there is neither a recording nor a table.
    """
    moving_text = f" and {len(moving)} start-stop recordings" if moving else ""
    if steady:
        data = compute_torque_map(steady)
        span = f"{data.names[0]} … {data.names[-1]}"
        return data, f"{len(data.w)} steady-state recordings ({span}){moving_text}"
    file = find_file(drive_path, "drives")
    table = file.parent / TABLE_NAME
    if not table.is_file():
        raise RecordingError(
            f"{drive_path}: no steady-state recording given, and no table of figures {table} to "
            "use instead"
        )
    data = read_torque_map(table, file.stem)
    evidence = f"the figures of {len(data.w)} steady-state recordings in {table.name}{moving_text}"
    return data, evidence

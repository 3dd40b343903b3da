"""From a drive file and recordings to the drive's friction, and from a drive to the torque of recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ssm_planner.arguments import checked
from ssm_planner.dynamics.friction import friction_of
from ssm_planner.errors import RecordingError
from ssm_planner.identification.drive_file import write_drive
from ssm_planner.identification.dynamic import DynamicFit, fit_dynamic
from ssm_planner.identification.fit import Estimate, MapFit, fit_map
from ssm_planner.identification.harmonics import fit_harmonics
from ssm_planner.identification.prediction import Prediction, predict_recording
from ssm_planner.identification.recordings import Recording, distinct, read_recordings
from ssm_planner.identification.torque_map import (
    TABLE,
    TorqueMap,
    kind_of,
    read_figures,
    torque_map,
)
from ssm_planner.loading.files import find
from ssm_planner.loading.load import load_drive
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.posterior import Harmonics
from ssm_planner.representation import ShortRepr


@dataclass(frozen=True, eq=False)
class Identification(ShortRepr):
    """What recordings say of a drive's friction."""

    fit: MapFit
    """Of the torque–velocity map."""
    dynamic: DynamicFit | None
    """Of start–stop recordings, where there are any."""
    data: TorqueMap
    moving: tuple[Recording, ...]
    """The start–stop recordings."""
    harmonics: Mapping[str, Harmonics]
    """What repeats with the angle, `forwards` and `backwards`; empty without recordings that turn twice."""
    load: float
    """Constant effort on the output, an offset that was found included, N·m or N."""
    evidence: str
    """Where the map comes from, in words."""
    file: Path
    """The drive file that was identified."""

    @property
    def drive(self) -> Drive:
        """With the identified friction."""
        return self.fit.drive if self.dynamic is None else self.dynamic.drive

    @property
    def dynamic_estimates(self) -> dict[str, Estimate]:
        """Of the start–stop recordings, by name; empty where there are none."""
        return {} if self.dynamic is None else dict(self.dynamic.estimates)

    def save(self, path: str | Path) -> Path:
        """Write a drive file like the one identified, with the identified friction. Raises ExportError."""
        write_drive(
            path,
            self.file,
            self.drive,
            fit=self.fit,
            dynamic=self.dynamic_estimates,
            evidence=self.evidence,
        )
        return Path(path)

    def to_dict(self) -> dict[str, Any]:
        """The object that `identify --json` prints, without files; SI."""
        fit, dynamic = self.fit, self.dynamic
        estimates = {**fit.estimates, **self.dynamic_estimates}
        rows = zip(fit.correlation_names, fit.correlation, strict=True)
        return {
            "law": fit.law,
            "law_shares": dict(fit.law_shares),
            "parameters": {name: _estimate(estimate) for name, estimate in estimates.items()},
            "nrmsd": fit.nrmsd,
            "repairs": [
                *self.data.repairs,
                *(f"{r.name}: {repair}" for r in self.moving for repair in r.repairs),
            ],
            "points": len(self.data.w),
            "correlations": {
                a: dict(zip(fit.correlation_names, map(float, row), strict=True)) for a, row in rows
            },
            "inseparable": [list(group) for group in fit.inseparable],
            "outliers": [{"recording": n, "distance": d, "weight": w} for n, d, w in fit.outliers],
            "combinations": {
                name: _estimate(estimate) for name, estimate in fit.combinations.items()
            },
            "harmonics": {way: harmonics.to_dict() for way, harmonics in self.harmonics.items()},
            "criterion": {
                "name": "RMS error on recordings left out, N·m",
                "laws": dict(fit.criterion),
            },
            "start_stop": []
            if dynamic is None
            else [
                {"recording": r.name, "nrmsd_map_only": before, "nrmsd": after}
                for r, before, after in zip(self.moving, dynamic.before, dynamic.after, strict=True)
            ],
            "notes": [*fit.notes, *(() if dynamic is None else dynamic.notes)],
        }


@checked
def identify(
    drive: str | Path,
    recordings: Sequence[str | Path] = (),
    *,
    law: str = "auto",
    fixed: Mapping[str, float] | None = None,
    free: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Identify the friction of the drive in a file.

    recordings: files or folders; steady-state ones make the torque–velocity map, start–stop ones give breakaway, dwell
    and memory. Without steady-state recordings the map comes from the table of figures beside the drive file. law: a
    law's name or `auto`. fixed: known parameters, SI. free: parameters fitted beyond the law's own (b_ov, preload).
    progress: is told each step.
    Raises RecordingError or ProblemError.
    """
    here = load_drive(drive)
    found, repeated = distinct(_read(here, recordings))
    steady, moving = _sorted_by_kind(found)
    data, evidence = _map(drive, steady, moving)
    data = replace(data, repairs=(*repeated, *data.repairs))
    load, inertia = _load(here)
    progress(f"fitting the map of {len(data.w)} points")
    reference = _reference(here)
    fit = fit_map(
        here, data, load, law=law, fixed=fixed, reference=reference, free=free, progress=progress
    )
    wheel = here.ratio if here.kind == "worm" else None
    by_way = {
        way: fit_harmonics(steady, sign, wheel)
        for way, sign in (("forwards", 1), ("backwards", -1))
    }
    fit = replace(fit, drive=_with_harmonics(fit.drive, by_way))
    if moving:
        progress(f"fitting {len(moving)} start–stop recordings")
    dynamic = fit_dynamic(fit.drive, moving, fit.load, inertia) if moving else None
    return Identification(
        fit=fit,
        dynamic=dynamic,
        data=data,
        moving=tuple(moving),
        harmonics={way: found for way, found in by_way.items() if found is not None},
        load=fit.load,
        evidence=evidence,
        file=find(drive, "drives"),
    )


def _with_harmonics(drive: Drive, found: Mapping[str, Harmonics | None]) -> Drive:
    """The drive with the harmonics, `forwards` and `backwards`, in its posterior."""
    friction = friction_of(drive)
    if friction.posterior is None:
        return drive
    own: dict[str, Any] = {f"harmonics_{way}": harmonics for way, harmonics in found.items()}
    return replace(drive, friction=replace(friction, posterior=replace(friction.posterior, **own)))


@checked
def predict(
    drive: str | Path,
    recordings: Sequence[str | Path],
    progress: Callable[[str], None] = lambda _: None,
) -> list[Prediction]:
    """Predict motor torque from the measured speed of recordings (files or folders), by the drive in a file.

    A drive whose friction is still to be identified is identified first from the table of figures beside its file.
    progress: is told each step. Raises RecordingError or ProblemError.
    """
    here = load_drive(drive)
    if not recordings:
        raise RecordingError("no recording to predict: name files or folders")
    found = _read(here, recordings)
    if here.friction is None:
        progress("identifying from the table of figures")
        here = fit_map(
            here, _map(drive, [], [])[0], _load(here)[0], reference=_reference(here)
        ).drive
    load = 0.0 if here.rig is None else here.rig.load
    predictions = []
    for k, recording in enumerate(found, 1):
        progress(f"predicting {recording.name} ({k} of {len(found)})")
        predictions.append(predict_recording(here, recording, load, _load(here)[1]))
    return predictions


def friction_origin(drive: str | Path) -> str:
    """Where the friction that `predict` takes comes from, in words."""
    return "the drive file" if load_drive(drive).friction is not None else _map(drive, [], [])[1]


def _read(drive: Drive, recordings: Sequence[str | Path]) -> list[Recording]:
    nominal, direction = (
        (None, 1) if drive.rig is None else (drive.rig.motor_nominal_torque, drive.rig.direction)
    )
    return read_recordings(list(recordings), nominal_torque=nominal, direction=direction)


def _sorted_by_kind(recordings: list[Recording]) -> tuple[list[Recording], list[Recording]]:
    kinds = [kind_of(recording) for recording in recordings]
    pairs = list(zip(recordings, kinds, strict=True))
    return [r for r, kind in pairs if kind == "steady"], [
        r for r, kind in pairs if kind == "start_stop"
    ]


def _load(drive: Drive) -> tuple[float, float]:
    return (0.0, 0.0) if drive.rig is None else (drive.rig.F_payload, drive.rig.payload_inertia)


def _reference(drive: Drive) -> dict[str, float]:
    """Values that decide what the data leave open: those published for a rig, else the friction the file has."""
    if drive.rig is not None and drive.rig.published:
        return dict(drive.rig.published)
    f = drive.friction
    return {} if f is None else {"mu": f.mu, "b_c": f.b_c, "b_v": f.b_v, "b_oc": f.b_oc}


def _map(
    drive_path: str | Path, steady: list[Recording], moving: list[Recording]
) -> tuple[TorqueMap, str]:
    """The map to fit, and where it comes from in words."""
    also = f" and {len(moving)} start-stop recordings" if moving else ""
    if steady:
        data = torque_map(steady)
        return (
            data,
            f"{len(data.w)} steady-state recordings ({data.names[0]} … {data.names[-1]}){also}",
        )
    file = find(drive_path, "drives")
    table, rig = file.parent / TABLE, file.stem
    if not table.is_file():
        raise RecordingError(
            f"{drive_path}: no steady-state recording given, and no table of figures {table} to use instead"
        )
    data = read_figures(table, rig)
    return data, f"the figures of {len(data.w)} steady-state recordings in {table.name}{also}"


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return {
        "value": float(estimate.value),
        "low": float(estimate.low),
        "high": float(estimate.high),
        "fixed": bool(estimate.fixed),
        "separable": bool(estimate.separable),
        "at_bound": bool(estimate.at_bound),
    }

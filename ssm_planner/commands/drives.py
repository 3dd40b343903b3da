"""What `identify` and `predict` compute: plain dictionaries of SI floats, ready for JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ssm_planner.errors import RecordingError
from ssm_planner.identify.drive_file import write_drive
from ssm_planner.identify.dynamic import DynamicFit, fit_dynamic
from ssm_planner.identify.estimates import Estimate
from ssm_planner.identify.fit import MapFit, fit_map
from ssm_planner.identify.prediction import Prediction, predict
from ssm_planner.identify.recording import Recording, read_recordings
from ssm_planner.identify.rig_figures import TABLE
from ssm_planner.identify.torque_map import TorqueMap, kind_of, read_figures, torque_map
from ssm_planner.problem.load import load_drive
from ssm_planner.problem.values import Drive


def identify_command(
    drive_path: str | Path,
    recordings: Sequence[str | Path] = (),
    output: str | Path | None = None,
    *,
    law: str = "auto",
    fixed: Mapping[str, float] | None = None,
    free: Sequence[str] = (),
    figures: bool = True,
) -> dict[str, Any]:
    """Identify the friction of a drive: {law, parameters, nrmsd, repairs, …}.

    recordings: files or folders; steady-state ones make the torque–velocity map, start–stop ones give breakaway, dwell
    and memory. Without steady-state recordings the map comes from the table of figures beside the drive file. law: a
    law's name or `auto`. fixed: known parameters, SI. free: parameters fitted beyond the law's own (b_ov, preload).
    output: drive file to write; the map figure goes beside it. Raises RecordingError or ProblemError.
    """
    drive = load_drive(drive_path)
    steady, moving = _sorted_by_kind(_read(drive, recordings))
    data, evidence = _map(drive_path, steady, moving)
    load, inertia = _load(drive)
    fit = fit_map(drive, data, load, law=law, fixed=fixed, reference=_reference(drive), free=free)
    dynamic = fit_dynamic(fit.drive, moving, load, inertia) if moving else None
    result = _result(fit, dynamic, data, moving)
    if output is not None:
        identified = fit.drive if dynamic is None else dynamic.drive
        estimates = {} if dynamic is None else dynamic.estimates
        result["files"] = _write(drive_path, output, identified, fit, estimates, data, load, evidence, figures)
    return result


def predict_command(
    drive_path: str | Path, recordings: Sequence[str | Path], output: str | Path | None = None
) -> list[dict[str, Any]]:
    """Predict motor torque from the measured speed of recordings: [{recording, nrmsd, repairs, …}].

    A drive whose friction is still to be identified is identified first from the table of figures beside its file.
    output: folder for one figure per recording. Raises RecordingError or ProblemError.
    """
    drive = load_drive(drive_path)
    if not recordings:
        raise RecordingError("no recording to predict: name files or folders")
    load, inertia = _load(drive)
    found = _read(drive, recordings)
    origin = "the drive file"
    if drive.friction is None:
        data, origin = _map(drive_path, [], [])
        drive = fit_map(drive, data, load, reference=_reference(drive)).drive
    results = []
    for recording in found:
        prediction = predict(drive, recording, load, inertia)
        results.append(_predicted(prediction, origin, output))
    return results


def default_output(drive_path: str | Path) -> Path:
    """Where `identify` writes its drive file when told nothing else."""
    stem = Path(drive_path).stem
    return Path("results") / stem / f"{stem}.yaml"


def _read(drive: Drive, recordings: Sequence[str | Path]) -> list[Recording]:
    nominal, direction = (None, 1) if drive.rig is None else (drive.rig.motor_nominal_torque, drive.rig.direction)
    return read_recordings(list(recordings), nominal_torque=nominal, direction=direction)


def _sorted_by_kind(recordings: list[Recording]) -> tuple[list[Recording], list[Recording]]:
    kinds = [kind_of(recording) for recording in recordings]
    pairs = list(zip(recordings, kinds, strict=True))
    return [r for r, kind in pairs if kind == "steady"], [r for r, kind in pairs if kind == "start_stop"]


def _load(drive: Drive) -> tuple[float, float]:
    return (0.0, 0.0) if drive.rig is None else (drive.rig.F_payload, drive.rig.payload_inertia)


def _reference(drive: Drive) -> dict[str, float]:
    """Values that decide what the data leave open: those published for a rig, else the friction the file has."""
    if drive.rig is not None and drive.rig.published:
        return dict(drive.rig.published)
    f = drive.friction
    return {} if f is None else {"mu": f.mu, "b_c": f.b_c, "b_v": f.b_v, "b_oc": f.b_oc}


def _map(drive_path: str | Path, steady: list[Recording], moving: list[Recording]) -> tuple[TorqueMap, str]:
    """The map to fit, and where it comes from in words."""
    also = f" and {len(moving)} start-stop recordings" if moving else ""
    if steady:
        data = torque_map(steady)
        return data, f"{len(data.w)} steady-state recordings ({data.names[0]} … {data.names[-1]}){also}"
    table, rig = Path(drive_path).parent / TABLE, Path(drive_path).stem
    if not table.is_file():
        raise RecordingError(f"no steady-state recording given, and no table of figures {table} to fall back on")
    data = read_figures(table, rig)
    return data, f"the figures of {len(data.w)} steady-state recordings in {table.name}{also}"


def _result(fit: MapFit, dynamic: DynamicFit | None, data: TorqueMap, moving: list[Recording]) -> dict[str, Any]:
    estimates = dict(fit.estimates)
    notes = list(fit.notes)
    if dynamic is not None:
        estimates |= dynamic.estimates
        notes += dynamic.notes
    rows = {a: dict(zip(fit.correlation_names, map(float, row), strict=True)) for a, row in _rows(fit)}
    return {
        "law": fit.law,
        "parameters": {name: _estimate(estimate) for name, estimate in estimates.items()},
        "nrmsd": fit.nrmsd,
        "repairs": [*data.repairs, *(f"{r.name}: {repair}" for r in moving for repair in r.repairs)],
        "points": len(data.w),
        "correlations": rows,
        "inseparable": [list(group) for group in fit.inseparable],
        "outliers": [{"recording": n, "distance": d, "weight": w} for n, d, w in fit.outliers],
        "criterion": {"name": "AICc", "laws": dict(fit.criterion)},
        "start_stop": []
        if dynamic is None
        else [
            {"recording": r.name, "nrmsd_map_only": before, "nrmsd": after}
            for r, before, after in zip(moving, dynamic.before, dynamic.after, strict=True)
        ],
        "notes": notes,
        "files": {},
    }


def _rows(fit: MapFit) -> list[tuple[str, Any]]:
    return list(zip(fit.correlation_names, fit.correlation, strict=True))


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return {
        "value": float(estimate.value),
        "low": float(estimate.low),
        "high": float(estimate.high),
        "fixed": bool(estimate.fixed),
        "separable": bool(estimate.separable),
        "at_bound": bool(estimate.at_bound),
    }


def _write(
    drive_path: str | Path,
    output: str | Path,
    drive: Drive,
    fit: MapFit,
    dynamic: Mapping[str, Estimate],
    data: TorqueMap,
    load: float,
    evidence: str,
    figures: bool,
) -> dict[str, str]:
    path = Path(output)
    if path.is_dir():
        path = path / f"{Path(drive_path).stem}.yaml"
    files = {"drive": write_drive(path, drive_path, drive, fit, dynamic, evidence)}
    if figures:
        from ssm_planner.report.drive_figures import map_figure
        from ssm_planner.report.style import save_figure

        written = save_figure(map_figure(fit, data, load), path.with_name(f"{path.stem}_map"))
        files |= zip(("map", "map_pdf"), map(str, written.values()), strict=True)
    return files


def _predicted(prediction: Prediction, origin: str, output: str | Path | None) -> dict[str, Any]:
    recording = prediction.recording
    result: dict[str, Any] = {
        "recording": recording.name,
        "nrmsd": prediction.nrmsd,
        "repairs": list(recording.repairs),
        "samples": len(recording.time),
        "rest_share": float(prediction.rest.mean()),
        "contact_lost": prediction.contact_lost,
        "friction": origin,
        "files": {},
    }
    if output is not None:
        from ssm_planner.report.drive_figures import prediction_figure
        from ssm_planner.report.style import save_figure

        name = recording.name.removesuffix(".csv").replace("/", "_")
        written = save_figure(prediction_figure(prediction), Path(output) / f"prediction_{name}")
        result["files"] = dict(zip(("figure", "pdf"), map(str, written.values()), strict=True))
    return result

"""What `identify` and `predict` compute: plain dictionaries of SI floats, ready for JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ssm_planner.identification.drive_file import write_drive
from ssm_planner.identification.identify import Identification, friction_origin, identify, predict
from ssm_planner.identification.prediction import Prediction


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
    """Identify the friction of a drive: {law, parameters, nrmsd, repairs, …, files}; arguments as of `identify`.

    output: drive file to write; the map figure goes beside it. Raises RecordingError or ProblemError.
    """
    found = identify(drive_path, recordings, law=law, fixed=fixed, free=free)
    return {**found.to_dict(), "files": {} if output is None else _write(drive_path, output, found, figures)}


def predict_command(
    drive_path: str | Path, recordings: Sequence[str | Path], output: str | Path | None = None
) -> list[dict[str, Any]]:
    """Predict motor torque from the measured speed of recordings: [{recording, nrmsd, repairs, …}].

    output: folder for one figure per recording. Raises RecordingError or ProblemError.
    """
    predictions = predict(drive_path, recordings)
    origin = friction_origin(drive_path)
    return [_predicted(prediction, origin, output) for prediction in predictions]


def default_output(drive_path: str | Path) -> Path:
    """Where `identify` writes its drive file when told nothing else."""
    stem = Path(drive_path).stem
    return Path("results") / stem / f"{stem}.yaml"


def _write(drive_path: str | Path, output: str | Path, found: Identification, figures: bool) -> dict[str, str]:
    path = Path(output)
    if path.is_dir():
        path = path / f"{Path(drive_path).stem}.yaml"
    files = {"drive": write_drive(path, drive_path, found.drive, found.fit, found.dynamic_estimates, found.evidence)}
    if figures:
        from ssm_planner.reporting.figures.drive import map_figure
        from ssm_planner.reporting.figures.style import save_figure

        written = save_figure(map_figure(found.fit, found.data, found.load), path.with_name(f"{path.stem}_map"))
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
        from ssm_planner.reporting.figures.drive import prediction_figure
        from ssm_planner.reporting.figures.style import save_figure

        name = recording.name.removesuffix(".csv").replace("/", "_")
        written = save_figure(prediction_figure(prediction), Path(output) / f"prediction_{name}")
        result["files"] = dict(zip(("figure", "pdf"), map(str, written.values()), strict=True))
    return result

"""`ssm-planner predict DRIVE RECORDING…`."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ssm_planner.cli.output import OK, progress_reporter, show

if TYPE_CHECKING:
    from ssm_planner.identification.prediction import Prediction


IMPLAUSIBLE = 0.5
"""NRMSD beyond which the recording is hardly one of this drive."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("drive", type=Path, help="drive file (YAML)")
    parser.add_argument("recordings", type=Path, nargs="+", metavar="RECORDING", help="recordings or folders of them")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="write a figure per recording there")
    parser.add_argument("--json", action="store_true", help="print one JSON list on stdout")


def run(options: argparse.Namespace) -> int:
    progress = progress_reporter()
    from ssm_planner.identification.identify import friction_origin, predict

    progress(f"predicting with {options.drive}")
    origin = friction_origin(options.drive)
    results = [
        {**prediction.to_dict(), "friction": origin, "files": _figures(prediction, options.output)}
        for prediction in predict(options.drive, options.recordings)
    ]
    progress("done")
    show(options.json, results, lambda: [line for result in results for line in _lines(result)])
    return OK


def _lines(result: dict[str, Any]) -> Iterator[str]:
    yield f"{result['recording']:<40}  NRMSD {result['nrmsd']:.4f}   friction from {result['friction']}"
    if result["mean_band"] is not None:
        low, high = (1e3 * end for end in result["mean_band"])
        where = "inside" if result["mean_inside"] else "OUTSIDE"
        yield f"  mean {1e3 * result['mean_measured']:.3f} mN·m, {where} its 95 % band {low:.3f} to {high:.3f}"
        if result["sample_coverage"] is not None:
            yield f"  {result['sample_coverage']:.0%} of the samples in motion inside their 95 % band"
    if result["nrmsd"] > IMPLAUSIBLE:
        yield "  off by more than half of the torque's range: a recording of this drive, load and direction?"
    if result["contact_lost"]:
        yield "  the preload does not keep both nuts in contact: the law does not hold there"
    yield from (f"  repaired: {repair}" for repair in result["repairs"])
    yield from (f"  figure: {path}" for path in result["files"].values())


def _figures(prediction: Prediction, folder: Path | None) -> dict[str, str]:
    """Write the figure of one recording; its paths by name. Raises ExportError."""
    if folder is None:
        return {}
    from ssm_planner.reporting.figures.sizing import prediction_figure
    from ssm_planner.reporting.figures.style import save_figure

    name = prediction.recording.name.removesuffix(".csv").replace("/", "_")
    written = save_figure(prediction_figure(prediction), folder / f"prediction_{name}")
    return dict(zip(("figure", "pdf"), map(str, written.values()), strict=True))

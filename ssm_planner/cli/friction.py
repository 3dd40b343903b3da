"""Run `ssm-planner identify DRIVE RECORDING…` and `ssm-planner predict DRIVE RECORDING…`."""

from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

import ssm_planner as ssm
from ssm_planner.cli.shared import OK, output_file, progress_reporter, show_with_page
from ssm_planner.errors import ProblemError
from ssm_planner.progress import Step
from ssm_planner.typing import Files, JsonObject


def run_identify(options: Namespace) -> int:
    """Identify the friction of a drive, write its file, and return the exit status."""
    fixed = dict(_fixed_parameter(text) for text in options.fix)
    progress = progress_reporter(f"identifying {options.drive}")
    identification = ssm.identify(
        options.drive,
        options.recordings,
        law=options.law,
        fixed=fixed,
        free=tuple(options.free),
        progress=progress,
    )
    result: JsonObject = {
        **identification.to_dict(),
        "files": _write_drive(identification, options.drive, options.output),
    }
    progress(Step("done"))
    lines = _identified_lines(result, identification.drive)
    show_with_page(options, options.drive.stem, result, lines, result["files"].values())
    return OK


def _write_drive(identification: ssm.Identification, drive: Path, output: Path | None) -> Files:
    """Write the drive file with the identified friction, and a figure of its torque–velocity map.

    Parameters
    ----------
    identification : Identification
        Identified drive.
    drive : Path
        Original drive file, which provides the default name.
    output : Path, optional
        Value of the option --output: a folder, or the name of the drive file.

    Returns
    -------
    dict
        Paths of the files by name.

    Raises
    ------
    ExportError
        If a file cannot be written.
    """
    from ssm_planner.publishing import publishing
    from ssm_planner.reporting import map_figure, save_figure

    path = output_file(output, ".yaml", Path("results") / drive.stem / f"{drive.stem}.yaml")
    with publishing(path.parent) as temporary:
        identification.save(temporary / path.name)
        figures = save_figure(
            map_figure(identification.fit, identification.data, identification.load),
            temporary / f"{path.stem}_map",
        )
    maps = (path.with_name(figure.name) for figure in figures.values())
    return {"drive": path, **dict(zip(("map", "map_pdf"), maps, strict=True))}


def _fixed_parameter(text: str) -> tuple[str, float]:
    """Parse NAME=VALUE, and return the name and the value in SI units.

    Raises ProblemError for other texts.
    """
    name, sign, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        reason = "the value is missing"
        if sign:
            reason = "a fixed parameter is NAME=VALUE with a number in SI"
        raise ProblemError(reason, key="--fix", value=text, allowed="such as mu=0.12") from None


def _identified_lines(result: JsonObject, drive: ssm.Drive) -> list[str]:
    """Return the result of `identify` as lines of text. The last line is the verdict.

    `result` is the output of --json, and `drive` the identified drive.
    """
    from ssm_planner.display import format_fixed, number
    from ssm_planner.identification import unit_of
    from ssm_planner.reporting import Table
    from ssm_planner.units import RPM

    shares = ", ".join(f"{law} {share:.0%}" for law, share in result["law_shares"].items())
    likely = f"  (how likely: {shares})" if len(result["law_shares"]) > 1 else ""
    lines, rows = [], []
    for name, parameter in result["parameters"].items():
        flags = [
            text
            for key, text in (("fixed", "fixed"), ("at_bound", "at its bound"))
            if parameter[key]
        ]
        if not parameter["separable"] and not parameter["fixed"]:
            flags.append("cannot be separated by these data")
        unit = (unit_of(drive, name) or "").replace("*", "·")
        scale, unit = (RPM, "rpm") if name == "stribeck_speed" else (1.0, unit)
        values = (number(scale * parameter[key], 4) for key in ("value", "low", "high"))
        rows.append((name, *values, unit, ", ".join(flags)))
    lines += Table("parameter, value, 95 % low, 95 % high, unit, ", rows, (1, 2, 3)).lines()
    if result["inseparable"]:
        torques = (
            f"{1e3 * c['value']:.3f} [{1e3 * c['low']:.3f}, {1e3 * c['high']:.3f}] mN·m {direction}"
            for direction, c in result["combinations"].items()
        )
        lines.append(f"together     {', '.join(torques)}, in slow motion")
    for row in result["start_stop"]:
        lines.append(
            f"start–stop  {row['recording']}: NRMSD {row['nrmsd_map_only']:.4f} by the map, "
            f"{row['nrmsd']:.4f} fitted"
        )
    ripple = []
    for direction, harmonics in result["harmonics"].items():
        pairs = zip(harmonics["orders"], harmonics["amplitudes"], strict=True)
        waves = (f"{1e3 * a:.3f} mN·m at {order:.3g} per motor turn" for order, a in pairs)
        ripple.append(f"{direction}: {', '.join(waves)}")
    sections = (
        ("Repeats with the angle", ripple),
        ("Repairs", result["repairs"]),
        ("Notes", result["notes"]),
    )
    for title, items in sections:
        if items:
            lines += ["", title, *(f"  {item}" for item in items)]
    if result["outliers"]:
        lines += ["", "Outliers (kept, with less weight)"]
        lines += [
            f"  {o['recording']}: {1e3 * o['distance']:.3f} mN·m from its neighbours, weight "
            f"{o['weight']:.2f}"
            for o in result["outliers"]
        ]
    lines += ["", *(f"{name}: {path}" for name, path in result["files"].items())]
    error = format_fixed(result["nrmsd"], 4)
    return [*lines, f"friction law {result['law']}{likely}, map NRMSD {error}"]


def run_predict(options: Namespace) -> int:
    """Predict the torque of recordings, and return the exit status."""
    progress = progress_reporter(f"predicting with {options.drive}")
    from ssm_planner.identification import friction_origin, predict

    origin = friction_origin(options.drive)
    predictions = predict(options.drive, options.recordings, progress)
    results = []
    for k, prediction in enumerate(predictions):
        if options.output is not None:
            progress(Step(f"drawing {prediction.recording.name}", k, len(predictions)))
        results.append(
            {
                **prediction.to_dict(),
                "friction": origin,
                "files": _write_figures(prediction, options.output),
            }
        )
    progress(Step("done"))
    lines = [line for result in results for line in _predicted_lines(result)]
    files = [path for result in results for path in result["files"].values()]
    worst = max(result["nrmsd"] for result in results)
    lines.append(f"largest NRMSD of {len(results)} recordings: {worst:.4f}")
    show_with_page(options, "prediction", results, lines, files)
    return OK


def _predicted_lines(result: JsonObject) -> Iterator[str]:
    """Yield the result of `predict` for one recording as lines of text."""
    name, nrmsd, origin = (result[key] for key in ("recording", "nrmsd", "friction"))
    yield f"{name:<40}  NRMSD {nrmsd:.4f}   friction from {origin}"
    if result["mean_band"] is not None:
        low, high = (1e3 * end for end in result["mean_band"])
        relation = "inside" if result["mean_inside"] else "OUTSIDE"
        mean, peak, bound = (
            1e3 * result[key] for key in ("mean_measured", "peak_measured", "peak_99")
        )
        yield f"  mean {mean:.3f} mN·m, {relation} its 95 % band {low:.3f} to {high:.3f} mN·m"
        coverage = result["sample_coverage"]
        if coverage is not None:
            yield f"  {coverage:.0%} of the samples in motion inside their 95 % band"
        yield f"  peak {peak:.3f} mN·m, {bound:.3f} mN·m at 99 %"
    yield from (f"  {remark}" for remark in result["remarks"])
    if result["contact_lost"]:
        yield "  the preload does not keep both nuts in contact: the law does not hold there"
    yield from (f"  repaired: {repair}" for repair in result["repairs"])
    yield from (f"  figure: {path}" for path in result["files"].values())


def _write_figures(prediction: ssm.Prediction, folder: Path | None) -> Files:
    """Draw the predicted and the measured torque of a recording as PNG and PDF.

    The result contains the paths by name. It is empty without a folder. Raises ExportError if a
    file cannot be written.
    """
    if folder is None:
        return {}
    from ssm_planner.reporting import prediction_figure, save_figure

    name = prediction.recording.name.removesuffix(".csv").replace("/", "_")
    paths = save_figure(prediction_figure(prediction), folder / f"prediction_{name}")
    return dict(zip(("figure", "pdf"), paths.values(), strict=True))

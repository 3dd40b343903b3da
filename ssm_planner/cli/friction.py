"""Run `ssm-planner identify DRIVE RECORDING…` and `ssm-planner predict DRIVE RECORDING…`."""

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

import ssm_planner as ssm
from ssm_planner.atomic import output_file
from ssm_planner.cli.shared import (
    OK,
    fill_in_template,
    print_result,
    print_result_with_page,
    progress_reporter,
)
from ssm_planner.errors import ProblemError
from ssm_planner.progress import Step
from ssm_planner.typing import Files, JsonObject

if TYPE_CHECKING:
    from ssm_planner.reporting import Table


def run_identify(options: Namespace) -> int:
    """Identify the friction of a drive, write its file, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status 0.
    """
    if options.design:
        return _run_design(options)
    fixed = dict(map(_fixed_parameter, options.fix))
    if len(fixed) < len(options.fix):
        raise ProblemError("a parameter occurs twice", key="--fix", value=" ".join(options.fix))
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
        "files": _write_drive_files(identification, options.drive, options.output),
    }
    progress(Step("done"))
    lines = [
        _parameter_table(result, identification.drive),
        *fill_in_template("identified.txt", result=result),
    ]
    print_result_with_page(options, options.drive.stem, result, lines, result["files"].values())
    return OK


def _run_design(options: Namespace) -> int:
    """Design a recording session, write it as CSV, and return the exit status.

    The output states how precisely a simulated session determines each parameter.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status 0.

    Raises
    ------
    ProblemError
        If an argument has no effect because --design is given.
    """
    unused = {"a recording": options.recordings, "--fix": options.fix, "--free": options.free}
    for name, value in unused.items():
        if value:
            raise ProblemError(f"{name} has no effect here", key=name, allowed="without --design")
    progress = progress_reporter(f"designing a session for {options.drive}")
    count = 24 if options.count is None else options.count
    session = ssm.design_session(options.drive, count, options.top_speed)
    name = f"{options.drive.stem}_session.csv"
    path = output_file(options.output, ".csv", Path("results") / options.drive.stem / name)
    result: JsonObject = {**session.to_dict(), "files": {"session": session.save(path)}}
    progress(Step("done"))
    minutes = session.durations.sum() / 60
    lines = [
        _parameter_table(result, ssm.load_drive(options.drive)),
        "",
        f"session: {path}",
        f"{count} recordings in {minutes:.1f} min of motion; the table shows what a "
        f"simulated session determines (law {session.law})",
    ]
    print_result(options, result, lines)
    return OK


def _write_drive_files(
    identification: ssm.Identification, drive: Path, output: Path | None
) -> Files:
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
    stem = f"{path.stem}_map"
    drawing = map_figure(identification.fit, identification.data, identification.load)
    with publishing(path.parent) as temporary:
        identification.save(temporary / path.name)
        save_figure(drawing, temporary / stem)
    return {
        "drive": path,
        "map": path.with_name(f"{stem}.png"),
        "map_pdf": path.with_name(f"{stem}.pdf"),
    }


def _fixed_parameter(text: str) -> tuple[str, float]:
    """Parse the value NAME=NUMBER of the option --fix.

    Parameters
    ----------
    text : str
        Value of the option, such as "mu=0.12".

    Returns
    -------
    name : str
        Name of the parameter.
    value : float
        Its value in SI units.

    Raises
    ------
    ProblemError
        If the text has another form.
    """
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise ProblemError(
            "a fixed parameter is NAME=VALUE with a number in SI",
            key="--fix",
            value=text,
            allowed="such as mu=0.12",
        ) from None


def _parameter_table(result: JsonObject, drive: ssm.Drive) -> "Table":
    """Build the table of the parameters and their intervals.

    Parameters
    ----------
    result : dict
        Output of --json.
    drive : Drive
        Drive of the parameters, which determines their units.

    Returns
    -------
    Table
        One row for each parameter. The column of remarks marks parameters that were fixed, that are
        at a bound, or that the data cannot separate from others.
    """
    from ssm_planner.display import format_number
    from ssm_planner.identification import parameter_unit
    from ssm_planner.reporting import Table
    from ssm_planner.units import RPM

    rows = []
    for name, parameter in result["parameters"].items():
        remarks = []
        if parameter["fixed"]:
            remarks.append("fixed")
        if parameter["at_bound"]:
            remarks.append("at its bound")
        if not parameter["separable"] and not parameter["fixed"]:
            remarks.append("cannot be separated by these data")
        unit = (parameter_unit(drive, name) or "").replace("*", "·")
        scale = 1.0
        if name == "stribeck_speed":
            unit = "rpm"
            scale = RPM
        values = [format_number(scale * parameter[key], 4) for key in ("value", "low", "high")]
        rows.append([name] + values + [unit, ", ".join(remarks)])
    return Table("parameter, value, 95 % low, 95 % high, unit, ", rows, (1, 2, 3))


def run_predict(options: Namespace) -> int:
    """Predict the torque of recordings, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status 0.
    """
    progress = progress_reporter(f"predicting with {options.drive}")
    from ssm_planner.identification import friction_origin, predict

    origin = friction_origin(options.drive)
    predictions = predict(options.drive, options.recordings, progress)
    results = []
    for k, prediction in enumerate(predictions):
        if options.output is not None:
            progress(Step(f"drawing {prediction.recording.name}", k, len(predictions)))
        files_of_one = _write_figures(prediction, options.output)
        results.append({**prediction.to_dict(), "friction": origin, "files": files_of_one})
    progress(Step("done"))
    lines = fill_in_template("predicted.txt", results=results)
    files: list[Path] = []
    for result in results:
        files += result["files"].values()
    max_nrmsd = max(result["nrmsd"] for result in results)
    lines.append(f"largest NRMSD of {len(results)} recordings: {max_nrmsd:.4f}")
    print_result_with_page(options, "prediction", results, lines, files)
    return OK


def _write_figures(prediction: ssm.Prediction, folder: Path | None) -> Files:
    """Draw the predicted and the measured torque of a recording as PNG and PDF.

    Parameters
    ----------
    prediction : Prediction
        Prediction for the recording.
    folder : Path or None
        Folder of the figures. None writes nothing.

    Returns
    -------
    dict
        Paths by name.

    Raises
    ------
    ExportError
        If a file cannot be written.
    """
    if folder is None:
        return {}
    from ssm_planner.reporting import prediction_figure, save_figure

    name = prediction.recording.name.removesuffix(".csv").replace("/", "_")
    paths = save_figure(prediction_figure(prediction), folder / f"prediction_{name}")
    return dict(zip(("figure", "pdf"), paths.values(), strict=True))

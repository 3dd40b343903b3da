"""`ssm-planner identify DRIVE RECORDING…`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ssm_planner.cli.output import OK, progress_reporter, show
from ssm_planner.errors import ProblemError

if TYPE_CHECKING:
    from ssm_planner.identification.identify import Identification

LAWS = ("auto", "coulomb", "stribeck_exponential", "stribeck_gaussian")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("drive", type=Path, help="drive file (YAML) with the rig's payload and recorder settings")
    parser.add_argument(
        "recordings",
        type=Path,
        nargs="*",
        metavar="RECORDING",
        help="EPOS recorder files, CSV with named columns, or folders; none: the shipped table of figures of the rig",
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="drive file to write (default: results/<drive>/)"
    )
    parser.add_argument("--law", choices=LAWS, default="auto", help="friction law (default: by blind error)")
    parser.add_argument(
        "--fix", action="append", default=[], metavar="NAME=VALUE", help="a known parameter, SI, such as preload=0.8"
    )
    parser.add_argument(
        "--free", action="append", default=[], metavar="NAME", help="fit this parameter too: b_ov, preload"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")


def run(options: argparse.Namespace) -> int:
    progress = progress_reporter()
    from ssm_planner.identification.identify import identify

    fixed = dict(_known(text) for text in options.fix)
    progress(f"identifying {options.drive}")
    found = identify(options.drive, options.recordings, law=options.law, fixed=fixed, free=tuple(options.free))
    result = {**found.to_dict(), "files": _write(found, options.drive, options.output)}
    progress("done")
    show(options.json, result, lambda: _lines(result))
    return OK


def _write(found: Identification, drive: Path, output: Path | None) -> dict[str, str]:
    """Write the identified drive file and its map; their paths by name. Raises ExportError."""
    from ssm_planner.publishing import publishing
    from ssm_planner.reporting.figures.sizing import map_figure
    from ssm_planner.reporting.figures.style import save_figure

    path = output or Path("results") / drive.stem / f"{drive.stem}.yaml"
    if path.is_dir():
        path = path / f"{drive.stem}.yaml"
    with publishing(path.parent) as temporary:
        found.save(temporary / path.name)
        figures = save_figure(map_figure(found.fit, found.data, found.load), temporary / f"{path.stem}_map")
    names = (str(path.with_name(figure.name)) for figure in figures.values())
    return {"drive": str(path), **dict(zip(("map", "map_pdf"), names, strict=True))}


def _known(text: str) -> tuple[str, float]:
    name, sign, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        reason = "a known parameter is NAME=VALUE with a number in SI" if sign else "the value is missing"
        raise ProblemError(reason, key="--fix", value=text, allowed="such as mu=0.12") from None


def _lines(result: dict[str, Any]) -> list[str]:
    lines = [f"law         {result['law']}", f"map NRMSD   {result['nrmsd']:.4f}", ""]
    lines.append(f"{'parameter':<16}{'value':>12}{'95 % low':>13}{'95 % high':>13}")
    for name, p in result["parameters"].items():
        flags = [text for key, text in (("fixed", "fixed"), ("at_bound", "at its bound")) if p[key]]
        if not p["separable"] and not p["fixed"]:
            flags.append("cannot be separated by these data")
        lines.append(f"{name:<16}{p['value']:>12.4g}{p['low']:>13.4g}{p['high']:>13.4g}   {', '.join(flags)}".rstrip())
    for row in result["start_stop"]:
        lines.append(
            f"start–stop  {row['recording']}: NRMSD {row['nrmsd_map_only']:.4f} by the map, {row['nrmsd']:.4f} fitted"
        )
    sections = (("Repairs", result["repairs"]), ("Notes", result["notes"]))
    for title, items in sections:
        if items:
            lines += ["", title, *(f"  {item}" for item in items)]
    if result["outliers"]:
        lines += ["", "Outliers (kept, with less weight)"]
        lines += [f"  {o['recording']}: {o['distance']:.1f} σ, weight {o['weight']:.2f}" for o in result["outliers"]]
    return [*lines, "", *(f"{name}: {path}" for name, path in result["files"].items())]

"""Run `ssm-planner export PLAN --to FORMAT`, which writes files for controllers and simulators."""

import re
from argparse import ArgumentParser, Namespace

import ssm_planner as ssm
from ssm_planner.cli.shared import OK, print_result, progress_reporter, rate_argument
from ssm_planner.errors import ExportError
from ssm_planner.formats import FORMATS
from ssm_planner.progress import Step
from ssm_planner.typing import Keywords


def add_format_arguments(parser: ArgumentParser) -> None:
    """Add the options of all formats to the command `export`.

    A format declares its options with their help texts. If formats have an option in common, its
    help lists the formats for each text.

    Parameters
    ----------
    parser : ArgumentParser
        Parser of the command `export`.
    """
    for option, texts in _format_options().items():
        parsed = ARGPARSE_SETTINGS.get(option, {})
        flag = f"--{'no-' if parsed.get('action') == 'store_false' else ''}{option}"
        text = "; ".join(f"{', '.join(names)}: {text}" for text, names in texts.items())
        parser.add_argument(
            flag.replace("_", "-"),
            dest=option,
            default=None,
            help=text.replace("%", "%%"),
            **parsed,
        )


def _format_options() -> dict[str, dict[str, list[str]]]:
    """Return the names of the formats by option and by the help text of the option.

    Formats may have the same option with different meanings.
    """
    options: dict[str, dict[str, list[str]]] = {}
    for form in FORMATS.values():
        for option, text in form.options.items():
            options.setdefault(option, {}).setdefault(text, []).append(form.name)
    return options


def run_export(options: Namespace) -> int:
    """Write a plan in another format, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status 0.
    """
    progress = progress_reporter(f"reading {options.plan}")

    settings: Keywords = {}
    for name in ["speed", "sign"] + list(_format_options()):
        value = getattr(options, name)
        if value is not None:
            settings[name] = value
    if "counts_per_turn" in settings:
        settings["counts_per_turn"] = _parse_encoder_counts(options.counts_per_turn)
    files, manifest = ssm.export(
        options.plan, options.to, options.output, force=options.force, **settings
    )
    progress(Step("done"))
    lines = [f"note: {note}" for note in manifest.get("notes", [])]
    if not manifest["verified"]:
        lines.append("UNVERIFIED: the plan has no passed certificate; every file is marked so")
    lines += [f"file: {path}" for path in files.values()]
    print_result(options, {**manifest, "files": files}, lines)
    return OK


def _parse_encoder_counts(texts: list[str]) -> int | dict[str, int]:
    """Parse the encoder increments per motor turn.

    Parameters
    ----------
    texts : list of str
        Values N or JOINT=N of the option --counts-per-turn.

    Returns
    -------
    int or dict
        One number for all joints, or a number by joint.

    Raises
    ------
    ExportError
        If a text has another form, if a joint occurs twice, or if a number for all joints and one
        for a joint are given.
    """
    counts: dict[str, int] = {}
    for text in texts:
        joint, _, number = text.rpartition("=")
        if not number.isdigit() or joint in counts:
            raise ExportError(
                f"--counts-per-turn {text}: expected [JOINT=]N with a whole number N, once per "
                "joint"
            )
        counts[joint] = int(number)
    if "" in counts and len(counts) > 1:
        raise ExportError("--counts-per-turn: give one number for all joints, or JOINT=N for each")
    return counts.get("", counts)


ARGPARSE_SETTINGS: dict[str, Keywords] = {
    "rate": {"type": rate_argument, "metavar": "HZ"},
    "columns": {"type": lambda text: re.split(r"\s*,\s*", text.strip()), "metavar": "LIST"},
    "mode": {"choices": ("csp", "csv", "cst")},
    "counts_per_turn": {"nargs": "+", "metavar": "[JOINT=]N"},
    "effort": {"action": "store_true"},
    "rigid_effort": {"action": "store_true"},
    "stops": {"type": int, "metavar": "N"},
    "bag": {"action": "store_false"},
}
"""Keyword arguments of `add_argument` by option. All other options are texts."""

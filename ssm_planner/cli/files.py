"""Run `ssm-planner schema KIND` and `ssm-planner new KIND`, which print keys and templates."""

import json
import os
from argparse import Namespace

from ssm_planner.cli.shared import OK
from ssm_planner.errors import ExportError
from ssm_planner.templates import schema, template


def run_schema(options: Namespace) -> int:
    """Print the JSON schema of a kind of file, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status 0.
    """
    print(json.dumps(schema(options.kind), indent=1, ensure_ascii=False))
    return OK


def run_new(options: Namespace) -> int:
    """Write or print a template of a file, and return the exit status.

    Raises ExportError if the file exists.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status 0.
    """
    name = options.file.stem if options.file is not None else f"my_{options.kind}"
    text = template(options.kind, name)
    if options.file is None:
        print(text, end="")
        return OK
    from ssm_planner.atomic import write_text

    if os.path.exists(options.file):
        raise ExportError(
            f"{options.file}: the file exists and is not overwritten: name another file"
        )
    write_text(options.file, text)
    print(f"file: {options.file}")
    return OK

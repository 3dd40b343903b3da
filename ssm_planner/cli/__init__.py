"""Command line: parse arguments, call the library, print results and return the exit status.

`main` is the entry. The tables commands.csv and arguments.csv define the commands and their
arguments. Each command is a function `run_<command>` in a module of this package.
"""

import argparse
import errno
import gc
import importlib
import io
import os
import re
import signal
import sys
import threading
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from types import FrameType
from typing import Any

from ssm_planner.errors import ProblemError, SsmPlannerError, suggestion
from ssm_planner.package_table import package_table

BAD_INPUT, INTERNAL_FAULT, INTERRUPTED, CLOSED_PIPE, TERMINATED = 2, 3, 130, 141, 143
"""Exit statuses that do not come from a command: invalid input, a fault of this program, Ctrl-C, a
reader that closed the pipe, and SIGTERM.
"""
DEBUG_VARIABLE = "SSM_PLANNER_DEBUG"
"""Environment variable that makes an internal fault show its traceback."""
ISSUE_LIST = "the issue list of ssm_planner"
"""Place where users report faults, as printed in messages."""
GARBAGE_THRESHOLD = 50_000
"""Number of new objects after which Python collects garbage.

Python's default is too small here, because imported modules create many objects that are never
garbage.
"""
RETRY_DELAY = 0.01
"""Delay before the program sends an interruption again that the interpreter ignored, s."""
OUTPUT_ERROR_NUMBERS = (errno.EBADF, errno.ENOSPC, errno.EIO)
"""Error numbers of the operating system which mean that stdout cannot be written."""

COMMANDS = {
    name: values for name, *values in package_table(Path(__file__).with_name("commands.csv"))
}
"""Module in ssm_planner.cli, help text, example and usage line (if it is special) of every command.

A module is imported only if one of its commands is used. arguments.csv lists the arguments of a
command. The function `run_<command>(options)` of its module runs the command and returns one of
these exit statuses:

    0  All checks passed.
    1  The problem is infeasible, or a check failed.
    2  The input is invalid.
    4  A limit could not be judged.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status.

    Parameters
    ----------
    arguments : sequence of str, optional
        Name of the command and its arguments. The default is the command line of the process.

    Returns
    -------
    int
        Exit status: 0 to 4 as `ssm-planner --help` lists them, 130 after Ctrl-C, 141 if the reader
        of stdout has closed the pipe, and 143 after SIGTERM.
    """
    if arguments is None:
        gc.set_threshold(GARBAGE_THRESHOLD)
    _prepare_streams()
    arguments_given = sys.argv[1:] if arguments is None else arguments
    command_line = [_protect_negative_value(argument) for argument in arguments_given]
    as_json = "--json" in command_line
    signals = _SignalHandling(ends_process=arguments is None)
    try:
        with signals:
            if arguments is None:
                _fix_numerical_kernels()
            if not command_line and "_ARGCOMPLETE" not in os.environ:
                _build_parser(command_line).print_help(sys.stderr)
                return BAD_INPUT
            options = _build_parser(command_line).parse_args(command_line)
            from ssm_planner.cli.shared import check_needs

            check_needs(options)
            status = int(options.run(options))
            sys.stdout.flush()
        return status if signals.received is None else _report_interruption(signals)
    except SsmPlannerError as error:
        if isinstance(error, ProblemError):
            _name_error_by_option(error, command_line)
        return _report_error(error, as_json)
    except BrokenPipeError:  # the reader has closed the pipe
        _discard_output()
        return CLOSED_PIPE
    except OSError as error:
        if error.filename is not None or error.errno not in OUTPUT_ERROR_NUMBERS:
            return _report_fault(error)
        _discard_output()
        return _report_error(
            SsmPlannerError(f"standard output: cannot be written: {error.strerror}")
        )
    except KeyboardInterrupt:
        return _report_interruption(signals)
    except Exception as error:  # noqa: BLE001 the user gets one line and a separate status
        if signals.received is not None:
            return _report_interruption(signals)
        return _report_fault(error)


def _fix_numerical_kernels() -> None:
    """Make NumPy and SciPy round alike on every processor with the instructions AVX2 and FMA.

    OpenBLAS and NumPy choose their kernels for the processor when they load, and each kernel rounds
    differently. Environment variables determine this choice, so this function sets them before
    NumPy loads. If the Python installation has already loaded NumPy, the command restarts in the
    same process. Child processes inherit the variables.
    """
    from ssm_planner.native import library

    choice = {"OPENBLAS_NUM_THREADS": "1"}  # short vectors gain nothing from threads
    if library.has_avx2():
        version = tuple(map(int, metadata.version("numpy").split(".")[:2]))
        avx512 = "AVX512F AVX512_SKX" if version < (2, 4) else "X86_V4"
        choice |= {"OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": avx512}
        os.environ.pop("NPY_ENABLE_CPU_FEATURES", None)  # NumPy refuses to load with both
    is_changed = any(os.environ.get(name) != value for name, value in choice.items())
    os.environ.update(choice)
    if is_changed and "numpy" in sys.modules:
        os.execv(sys.executable, [sys.executable] + sys.orig_argv[1:])


def _name_error_by_option(error: ProblemError, arguments: Sequence[str]) -> None:
    """Replace the name of a Python argument in an error by the option that the user typed.

    An error of the library names an argument such as `current_limit`. Its key and value are
    replaced by those of the option `--current-limit`, if the command line contains it. Errors in
    files are not changed.

    Parameters
    ----------
    error : ProblemError
        Error of the library, which is changed.
    arguments : sequence of str
        Command line.
    """
    names = [] if error.key is None or error.file is not None else error.key.split(".")
    for name in reversed(names):
        option = "--" + re.sub(r"_|(?<=[a-z])(?=[A-Z])", "-", name).lower()
        for k, argument in enumerate(arguments):
            typed, is_joined, joined_value = argument.partition("=")
            if len(typed) > 2 and option.startswith(typed):
                error.key = typed
                if error.value is not None:
                    following = arguments[k + 1] if k + 1 < len(arguments) else ""
                    error.value = joined_value if is_joined else following.strip()
                return


def _report_error(error: SsmPlannerError, as_json: bool = False) -> int:
    """Print an error on stderr, and return the exit status.

    Parameters
    ----------
    error : SsmPlannerError
        Error that ended the command.
    as_json : bool
        Also print the error as a JSON object on stdout.

    Returns
    -------
    int
        Exit status `BAD_INPUT`.
    """
    print(f"ssm-planner: {error}", file=sys.stderr)
    if as_json:
        import json

        document: dict[str, Any] = {"message": str(error)}
        for name in ("file", "line", "key", "value", "allowed"):
            document[name] = getattr(error, name, None)
        if document["value"] is not None:
            document["value"] = str(document["value"])
        print(json.dumps({"error": document}, indent=1))
    return BAD_INPUT


def _discard_output() -> None:
    """Redirect stdout to the null device, because Python writes its buffer again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class _SignalHandling:
    """Context in which SIGTERM and SIGHUP interrupt the command like Ctrl-C.

    Attributes
    ----------
    received : int or None
        Number of the signal that arrived, or None.
    ends_process : bool
        True if the program ends after the context. Further signals are then ignored.
    """

    def __init__(self, ends_process: bool) -> None:
        """Create the context. `ends_process` is true if the program ends after it."""
        self.received: int | None = None
        self.ends_process = ends_process
        self._previous_handlers: dict[int, Any] = {}

    def __enter__(self) -> None:
        if threading.current_thread() is threading.main_thread():
            for name in ("SIGINT", "SIGTERM", "SIGHUP"):
                number = getattr(signal, name, None)
                # A signal that is already ignored, for example by nohup, stays ignored.
                if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
                    self._previous_handlers[number] = signal.signal(number, self._receive_signal)
        if self._previous_handlers:
            self._previous_hook, sys.unraisablehook = sys.unraisablehook, self._repeat_ignored

    def __exit__(self, *_: object) -> None:
        if self._previous_handlers:
            sys.unraisablehook = self._previous_hook
        for number, handler in self._previous_handlers.items():
            signal.signal(number, signal.SIG_IGN if self.ends_process else handler)

    def _receive_signal(self, number: int, _: FrameType | None) -> None:
        """Handle a signal: store its number and interrupt the command."""
        self.received = number
        raise KeyboardInterrupt

    def _repeat_ignored(self, unraisable: Any) -> None:
        """Repeat an interruption that a finaliser or a weak reference's callback has swallowed.

        The interpreter passes exceptions that it ignores to this hook.
        """
        if not isinstance(unraisable.exc_value, KeyboardInterrupt):
            self._previous_hook(unraisable)
        elif self.received is not None:
            # An exception would be lost in this hook too, so a thread sends the signal.
            threading.Timer(RETRY_DELAY, self._send_signal).start()

    def _send_signal(self) -> None:
        """Send the signal again, unless the context has ended."""
        if sys.unraisablehook == self._repeat_ignored:
            signal.pthread_kill(threading.main_thread().ident or 0, self.received or signal.SIGINT)


def _report_interruption(signals: _SignalHandling) -> int:
    """Print which results were complete before an interruption, and return the exit status.

    Parameters
    ----------
    signals : _SignalHandling
        Context of the command. It contains the signal that arrived, or None if Ctrl-C came before
        the context began.

    Returns
    -------
    int
        Exit status `TERMINATED` after SIGTERM or SIGHUP, and `INTERRUPTED` after Ctrl-C.
    """
    # CPython records an interruption, and would later end the process by a signal instead of with
    # this exit status. Any call of exec() resets the record.
    exec("")
    from ssm_planner.atomic import remove_temporaries, written_files

    if signals.ends_process:
        remove_temporaries()
    results = ", ".join(map(str, written_files))
    state = f"completed before that: {results}" if results else "earlier results are unchanged"
    term = signals.received not in (None, signal.SIGINT)
    print(f"\nssm-planner: {'terminated' if term else 'interrupted'}; {state}", file=sys.stderr)
    return TERMINATED if term else INTERRUPTED


def _report_fault(error: Exception) -> int:
    """Print an internal fault with its place in the source, and return the exit status.

    An internal fault is an exception that this program should have handled. The message is one
    line. The variable `DEBUG_VARIABLE` adds the traceback.

    Parameters
    ----------
    error : Exception
        The exception.

    Returns
    -------
    int
        Exit status `INTERNAL_FAULT`.
    """
    import traceback

    if os.environ.get(DEBUG_VARIABLE):
        traceback.print_exception(error)
    frame = traceback.extract_tb(error.__traceback__)[-1]
    location = f"{os.path.basename(frame.filename)}:{frame.lineno}"
    text = " ".join(f"{type(error).__name__}: {error}".split())
    print(
        f"ssm-planner: internal fault at {location}: {text[:200]}; please report it in "
        f"{ISSUE_LIST}, with the command and its files ({DEBUG_VARIABLE}=1 shows the traceback)",
        file=sys.stderr,
    )
    return INTERNAL_FAULT


def _prepare_streams() -> None:
    """Replace closed streams, and escape characters that a stream cannot encode."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            null = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 used until the exit
            setattr(sys, name, null)
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _build_parser(command_line: Sequence[str]) -> argparse.ArgumentParser:
    """Build the argument parser.

    Only the commands whose names occur in the command line get their arguments, so that the program
    starts quickly.

    Parameters
    ----------
    command_line : sequence of str
        Name of the command and its arguments.

    Returns
    -------
    ArgumentParser
        Parser of the command line.

    Raises
    ------
    UsageError
        If the command is unknown.
    """
    from ssm_planner.cli.terminal import Parser, UsageError

    request = next((argument for argument in command_line if not argument.startswith("-")), None)
    asks_for_help = not {"-h", "--help", "--version"}.isdisjoint(command_line)
    if request is not None and request not in COMMANDS and not asks_for_help:
        hint = suggestion(request, COMMANDS)
        raise UsageError(f"unknown command {request!r}{hint} (one of {', '.join(COMMANDS)})")
    parser = Parser(
        prog="ssm-planner",
        description="Plan, verify and export motions of serial spherical mechanisms with "
        "self-locking drives.",
        epilog="Exit status: 0 all checks passed; 1 infeasible or a check failed; 2 invalid input; "
        "3 a fault of this program; 4 a limit could not be judged; 130 interrupted; 143 ended by "
        "SIGTERM.",
    )
    parser.add_argument(
        "--version", action="version", version=f"ssm-planner {metadata.version('ssm-planner')}"
    )
    requested = list(command_line) + os.environ.get("COMP_LINE", "").split()
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, (module, text, example, usage) in COMMANDS.items():
        command = commands.add_parser(
            name,
            help=text,
            description=text[0].upper() + text[1:] + ".",
            epilog=f"Example: ssm-planner {example}",
            usage=usage or None,
        )
        if name in requested:
            implementation = importlib.import_module(f"ssm_planner.cli.{module}")
            from ssm_planner.cli.shared import add_arguments

            add_arguments(command, name)
            if name == "export":
                implementation.add_format_arguments(command)
            command.set_defaults(run=getattr(implementation, f"run_{name}"))
    if "_ARGCOMPLETE" in os.environ:  # A shell requests completions.
        import argcomplete

        argcomplete.autocomplete(parser)
    return parser


def _protect_negative_value(word: str) -> str:
    """Prepend a space to a negative value such as `-140deg`, so that it is not read as an option.

    argparse treats a word that contains a space as a value.
    """
    return f" {word}" if re.match(r"-\.?\d", word) else word


if __name__ == "__main__":
    sys.exit(main())

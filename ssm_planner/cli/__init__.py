"""The command line: an outer skin that parses, calls, prints and sets the exit status."""

from __future__ import annotations

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
from types import FrameType
from typing import Any

from ssm_planner.errors import SsmPlannerError

BAD_INPUT, FAULT, INTERRUPTED, CLOSED_PIPE, TERMINATED = 2, 3, 130, 141, 143
DEBUG = "SSM_PLANNER_DEBUG"
"""With this environment variable set, an internal fault shows its traceback."""
ISSUES = "the issue list of ssm_planner"
OBJECTS = 50_000
"""New ones after which Python looks for those that nobody needs: modules that load make many, all of which stay."""
AGAIN = 0.01
"""s after which an interruption that the interpreter ignored comes once more."""
STREAM_FAULTS = (errno.EBADF, errno.ENOSPC, errno.EIO)

COMMANDS = {
    "plan": ("plan", "plan, cross-check, verify, size, report"),
    "retime": ("retime", "anyone's path of the joints, timed by TOPP-RA and checked"),
    "check": ("check", "certificate for a plan.json, a CSV or a JointTrajectory of anyone's"),
    "export": ("export", "files for the controller: csv, epos4, pvt, ros2, urdf, c"),
    "simulate": (
        "simulate",
        "the exported set points played on the simulated arm, and what may go wrong",
    ),
    "compare": ("compare", "a recording of the executed motion against the plan"),
    "size": ("size", "what the motion requires; which motors and gears satisfy it"),
    "study": (
        "study",
        "candidate robots by the thousand: geometry, gears and motors over a set of motions",
    ),
    "report": ("pages", "a page with mechanism, plots and certificate; of two plans, a comparison"),
    "view": ("pages", "a local page: workspace, inverse kinematics and planning by sliders"),
    "workspace": ("kinematics", "closed-form tilt range, or the (alpha, beta) that reach a range"),
    "identify": ("friction", "friction with confidence, map figure, a drive file to use"),
    "predict": ("friction", "predicted against measured torque, NRMSD"),
    "ik": ("kinematics", "closed-form inverse kinematics, all branches"),
    "new": ("files", "a commented file to start from: robot, drive, motor, problem, study, …"),
    "schema": ("files", "the JSON schema of a kind of file, for editors that complete and check"),
    "reproduce": ("pages", "the paper's tables and figures, ours beside the published values"),
}
"""Module in ssm_planner.cli and help of every command; the module is imported only when its command is used.

A module has, for each of its commands, <command>_arguments(parser) and run_<command>(options) -> exit status: 0 done and
every check passed, 1 infeasible or a failed check, 2 bad input.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status."""
    # Before NumPy loads: on vectors as short as these, threads of its linear algebra wait for each other more than they work.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if arguments is None:
        gc.set_threshold(OBJECTS)
    _prepare_streams()
    words = [_kept_apart(word) for word in (sys.argv[1:] if arguments is None else arguments)]
    signals = _Signals(for_good=arguments is None)
    try:
        with signals:
            if not words and "_ARGCOMPLETE" not in os.environ:
                _parser(words).print_help(sys.stderr)
                return BAD_INPUT
            options = _parser(words).parse_args(words)
            status = int(options.run(options))
            sys.stdout.flush()
        return status if signals.arrived is None else _interrupted(signals)
    except SsmPlannerError as error:
        return _refused(error, "--json" in words)
    except BrokenPipeError:  # the reader of a pipe has seen enough
        _discard_output()
        return CLOSED_PIPE
    except OSError as error:
        if error.filename is not None or error.errno not in STREAM_FAULTS:
            return _fault(error)
        _discard_output()
        return _refused(SsmPlannerError(f"standard output: cannot be written: {error.strerror}"))
    except KeyboardInterrupt:
        return _interrupted(signals)
    except Exception as error:  # noqa: BLE001 whatever it is, the user gets one line and a status of its own
        return _interrupted(signals) if signals.arrived is not None else _fault(error)


def _refused(error: SsmPlannerError, as_json: bool = False) -> int:
    """Say what is wrong, with --json on stdout too; the exit status."""
    print(f"ssm-planner: {error}", file=sys.stderr)
    if as_json:
        import json

        parts = {
            name: getattr(error, name, None) for name in ("file", "line", "key", "value", "allowed")
        }
        parts["value"] = None if parts["value"] is None else str(parts["value"])
        print(json.dumps({"error": {"message": str(error), **parts}}, indent=1))
    return BAD_INPUT


def _discard_output() -> None:
    """What is still to be flushed at the end goes nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class _Signals:
    """A request to end (SIGTERM, SIGHUP) ends the program as Ctrl-C does; which of them arrived."""

    def __init__(self, for_good: bool) -> None:
        """for_good: the program ends afterwards, and its last steps need no interruption."""
        self.arrived: int | None = None
        self.for_good = for_good
        self._before: dict[int, Any] = {}

    def __enter__(self) -> None:
        if threading.current_thread() is threading.main_thread():
            for name in ("SIGINT", "SIGTERM", "SIGHUP"):
                number = getattr(signal, name, None)
                # what was ignored from outside, such as by nohup, stays ignored
                if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
                    self._before[number] = signal.signal(number, self._arrive)
        if self._before:
            self._hook, sys.unraisablehook = sys.unraisablehook, self._ignored

    def __exit__(self, *_: object) -> None:
        if self._before:
            sys.unraisablehook = self._hook
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_IGN if self.for_good else handler)

    def _arrive(self, number: int, _: FrameType | None) -> None:
        self.arrived = number
        raise KeyboardInterrupt

    def _ignored(self, unraisable: Any) -> None:
        """An interruption within a weak reference's callback or a finaliser is lost there: let it come once more."""
        if not isinstance(unraisable.exc_value, KeyboardInterrupt):
            self._hook(unraisable)
        elif (
            self.arrived is not None
        ):  # else it stops a search; from a thread: here it would be lost again
            threading.Timer(AGAIN, self._again).start()

    def _again(self) -> None:
        if sys.unraisablehook == self._ignored:
            signal.pthread_kill(threading.main_thread().ident or 0, self.arrived or signal.SIGINT)


def _interrupted(signals: _Signals) -> int:
    """Say what an interruption leaves; its exit status."""
    exec(
        ""
    )  # CPython remembers an interruption within exec(), and would end by SIGINT; the next exec() forgets it
    atomic = sys.modules.get("ssm_planner.atomic")
    written = [str(path) for path in atomic.written] if atomic is not None else []
    if atomic is not None and signals.for_good:
        atomic.remove_temporaries()
    left = (
        f"written whole before that: {', '.join(written)}"
        if written
        else "earlier results are untouched"
    )
    term = signals.arrived is not None and signals.arrived != signal.SIGINT
    print(
        f"\nssm-planner: {'ended from outside' if term else 'interrupted'}; {left}", file=sys.stderr
    )
    return TERMINATED if term else INTERRUPTED


def _fault(error: Exception) -> int:
    """Say that the program itself is at fault, in one line; its exit status."""
    if os.environ.get(DEBUG):
        import traceback

        traceback.print_exception(type(error), error, error.__traceback__)
    place = error.__traceback__
    while place is not None and place.tb_next is not None:
        place = place.tb_next
    where = (
        ""
        if place is None
        else f" at {os.path.basename(place.tb_frame.f_code.co_filename)}:{place.tb_lineno}"
    )
    text = " ".join(f"{type(error).__name__}: {error}".split())
    print(
        f"ssm-planner: internal fault{where}: {text[:200]}; nothing of what you gave says so: please report it in {ISSUES}, "
        f"with the command and its files ({DEBUG}=1 shows where it arose)",
        file=sys.stderr,
    )
    return FAULT


def _prepare_streams() -> None:
    """A closed stream swallows what is written; one that cannot hold a character, as in the C locale, escapes it."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - for the rest of the process
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _parser(words: Sequence[str]) -> argparse.ArgumentParser:
    from ssm_planner.cli.terminal import Parser, UsageError, suggestion

    named = next((word for word in words if not word.startswith("-")), None)
    if (
        named is not None
        and named not in COMMANDS
        and not {"-h", "--help", "--version"} & set(words)
    ):
        raise UsageError(
            f"no command {named!r}{suggestion(named, COMMANDS)} (allowed: {', '.join(COMMANDS)})"
        )
    parser = Parser(
        prog="ssm-planner",
        description="Plan, verify and export motions of serial spherical mechanisms with self-locking drives.",
        epilog="Exit status: 0 done and every check passed; 1 infeasible, or a check failed; 2 bad input; "
        "3 a fault of this program; 130 interrupted; 143 ended by SIGTERM.",
    )
    parser.add_argument(
        "--version", action="version", version=f"ssm-planner {metadata.version('ssm-planner')}"
    )
    asked = [*words, *os.environ.get("COMP_LINE", "").split()]
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, (module, text) in COMMANDS.items():
        command = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        if name in asked:
            implementation = importlib.import_module(f"ssm_planner.cli.{module}")
            getattr(implementation, f"{name}_arguments")(command)
            command.set_defaults(run=getattr(implementation, f"run_{name}"))
    if "_ARGCOMPLETE" in os.environ:  # a shell asks for completions
        import argcomplete

        argcomplete.autocomplete(parser)
    return parser


def _kept_apart(word: str) -> str:
    """`-140deg` is a value, not an option: argparse takes a word with a space in it as a value."""
    return f" {word}" if re.match(r"-\.?\d", word) else word


if __name__ == "__main__":
    sys.exit(main())

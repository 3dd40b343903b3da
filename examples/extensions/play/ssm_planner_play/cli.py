"""Command `ssm-planner-play`: play an exported EPOS4 folder on CiA 402 drives."""

from __future__ import annotations

import json
import os
import signal
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

import can
from ssm_planner_guard import guard_of, thresholds_of

from ssm_planner.errors import SsmPlannerError
from ssm_planner_play.client import Drive, Link
from ssm_planner_play.clock import RealClock, SimulatedClock
from ssm_planner_play.player import Outcome, Player
from ssm_planner_play.program import PlayError, Program, prepare
from ssm_planner_play.simulated import SimulatedBus, SimulatedDrive
from ssm_planner_play.stops import stop_table

OK, FAILED, BAD_INPUT, FAULT = 0, 1, 2, 3
"""Exit statuses: played to the end; not started or stopped early; bad input; internal fault."""
UNVERIFIED = (
    "nothing in this program has run on a real drive; only simulated drives have played an export",
    "0x3010:01 as the number of encoder pulses, and the reactions of the drive to a lost heartbeat "
    "(0x1016:01, 0x6007), come from public code of other authors",
    "Python and the operating system give no guarantee of timing: late set points are counted, and "
    "a gap longer than the permitted lag begins a controlled stop",
    "the thresholds of the guard were tested with simulated recordings only",
    "with --home, nothing can show that two node IDs are swapped: compare the labels of the drives",
    "an emergency stop that cuts the power is necessary: this program cannot stop a drive over a "
    "bus that is lost",
)
"""Parts that no test on hardware covers, beside those that the manifest names."""
PRIORITY = 10
"""Priority of the real-time scheduling class. Any value comes before all normal programs."""
SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status."""
    options = _parser().parse_args(arguments)
    try:
        return _run(options)
    except PlayError as error:
        print(f"not played: {error}", file=sys.stderr)
        return FAILED
    except SsmPlannerError as error:
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT
    except Exception as error:  # noqa: BLE001 - the drives are disabled; nobody needs a traceback
        print(f"internal fault: {type(error).__name__}: {error}", file=sys.stderr)
        return FAULT


def _parser() -> ArgumentParser:
    parser = ArgumentParser(
        prog="ssm-planner-play",
        description="Play an export for EPOS4 drives (CSP). Without --bus, simulated drives move.",
    )
    add = parser.add_argument
    add("folder", type=Path, metavar="EXPORT", help="folder of `ssm-planner export --to epos4`")
    add("--plan", type=Path, help="plan.json of the export (default: the one above the folder)")
    add("--bus", metavar="CHANNEL", help="CAN channel with real drives, such as can0")
    add("--interface", default="socketcan", help="interface of python-can (default: socketcan)")
    add("--bitrate", type=int, default=1_000_000, help="bits per second (default: 1000000)")
    add("--nodes", nargs="+", type=_node, metavar="JOINT=ID", help="node IDs of the drives")
    add("--home", action="store_true", help="the arm stands at the start of the plan: home there")
    add("--dry-run", action="store_true", help="check and read everything, but write nothing")
    add("--enable-drives", action="store_true", help="first confirmation for scripts")
    add("--confirm", metavar="CHANNEL", help="second confirmation for scripts: the channel again")
    add("--real-time", action="store_true", help="play at real speed (always with real drives)")
    add("--priority", action="store_true", help="ask for the real-time scheduling class (Linux)")
    add("--stop-at", type=float, metavar="S", help="request a controlled stop after this time")
    add("-o", dest="output", type=Path, metavar="DIR", help="folder of the log (default: played)")
    add("--json", action="store_true", help="print the outcome as JSON")
    return parser


def _node(text: str) -> tuple[str, int]:
    """Parse JOINT=ID."""
    joint, _, number = text.partition("=")
    if not number.isdigit() or not 0 < int(number) < 127:
        raise ArgumentTypeError(f"{text!r}: expected JOINT=ID with an ID from 1 to 126")
    return joint, int(number)


class Usage(SsmPlannerError):
    """Options that do not fit each other (exit status 2)."""


def _run(options: Namespace) -> int:
    say = _printer(options.json)
    _require_options(options)
    output = options.output or Path("played")
    output.mkdir(parents=True, exist_ok=True)  # a log that cannot be written must not surprise
    say(f"checking {options.folder}")
    program = prepare(options.folder, options.plan)
    nodes = _nodes(options, program)
    count, period = len(program.rows), program.period
    say(f"the export is intact and exceeds no limit: {count} set points, {1000 * period:g} ms")
    load = bus_load(program, options.bitrate)
    share = f"{100 * load:.0f} % of a bus with {options.bitrate} bit/s"
    if load > 1 and options.bus:
        raise PlayError(f"the messages need {share}: export with a lower --rate")
    if load > 1:
        say(f"note: on a real bus, the messages would need {share}: export with a lower --rate")
    for note in program.notes:
        say(f"note: {note}")
    thresholds = thresholds_of(
        program.plan, period, {axis.name: axis.counts_per_turn for axis in program.axes}
    )
    if 2 * period > thresholds.lag:
        raise PlayError(
            f"a period of {1000 * period:g} ms is too long for the guard (allowed: up to "
            f"{500 * thresholds.lag:g} ms): export with a higher --rate"
        )
    guard, kind = guard_of(program.plan, thresholds)
    say(kind)
    stops = stop_table(program)
    count = len(stops.first) - 1
    longest = f"the longest takes {stops.longest:.3f} s"
    say(f"controlled stops from {count} instants keep every limit; {longest}")
    if stops.every > 1:
        say(f"note: a stop begins up to {1000 * period * (stops.every - 1):.0f} ms after its cause")
    for text in (*UNVERIFIED, *program.manifest.get("not_verified", [])) if options.bus else ():
        say(f"not verified: {text}")
    link = _open(options, program, nodes)
    try:
        drives = [Drive(link, nodes[axis.name], axis, program) for axis in program.axes]
        player = Player(program, stops, guard, link, drives)
        return _play(options, player, output, say)
    finally:
        with suppress(can.CanError, OSError):
            link.bus.shutdown()


def _play(options: Namespace, player: Player, output: Path, say: Callable[[str], None]) -> int:
    """Set the drives up, ask for the confirmations, play, and write the log."""
    restore = _catch_signals(player)
    try:
        differences = player.inspect()
        if differences:
            raise PlayError("\n".join(differences))
        if options.dry_run:
            if not options.home:
                player.require_start()
            say("dry run: nothing was written, and no drive was enabled")
            return OK
        player.set_up()
        say("the drives have the settings of the export")
        if not options.home:
            player.require_start()
            say("every axis stands at the start of the plan")
        _confirm(options)
        player.request.check()
        if options.stop_at is not None:
            _stop_at(player, options.stop_at)
        _prioritise(options, say)
        outcome = player.run(options.home)
    finally:
        restore()
    paths = player.log.write(output, _described(outcome, player))
    if options.json:
        print(json.dumps(_described(outcome, player)))
    _report(outcome, player, paths, say)
    return OK if outcome.finished else FAILED


def _require_options(options: Namespace) -> None:
    """Raise Usage if options contradict each other."""
    if options.bus is None and (options.enable_drives or options.confirm or options.nodes):
        raise Usage("--enable-drives, --confirm and --nodes need --bus")
    if options.confirm is not None and options.confirm != options.bus:
        raise Usage(f"--confirm {options.confirm} is not the channel of --bus {options.bus}")
    if options.enable_drives != (options.confirm is not None):
        raise Usage("--enable-drives and --confirm CHANNEL are only valid together")
    if options.bus and not options.nodes:
        raise Usage("--bus needs --nodes, because a wrong node would move the wrong axis")
    if options.stop_at is not None and not options.stop_at >= 0:
        raise Usage("--stop-at must not be negative")
    if options.bitrate <= 0:
        raise Usage(f"--bitrate {options.bitrate} is out of range (allowed: above 0)")


def _nodes(options: Namespace, program: Program) -> dict[str, int]:
    """Return the node IDs by joint."""
    names = [axis.name for axis in program.axes]
    if options.bus is None:
        return {name: number for number, name in enumerate(names, start=1)}
    nodes = dict(options.nodes)
    if sorted(nodes) != sorted(names) or len(options.nodes) != len(names):
        raise Usage(f"--nodes must state each of these joints once: {', '.join(names)}")
    if len(set(nodes.values())) < len(nodes):
        raise Usage("--nodes states one node for two joints")
    return nodes


def bus_load(program: Program, bitrate: int) -> float:
    """Return the share of a bus that the messages of one period occupy at most.

    A frame with n bytes has up to 8n + 47 bits and one stuffed bit after each four of 34 + 8n − 1.
    """
    pdos = [*program.manifest["pdo"]["receive"][1:], *program.manifest["pdo"]["transmit"][1:]]
    sizes = [sum(entry["bits"] for entry in pdo["objects"]) for pdo in pdos] * len(program.axes)
    bits = sum(size + 47 + (33 + size) // 4 for size in [*sizes, 0])
    return bits / bitrate / program.period


def _open(options: Namespace, program: Program, nodes: dict[str, int]) -> Link:
    """Open the bus. Without --bus, it has simulated drives that stand at the start of the plan."""
    if options.bus is None:
        clock = RealClock() if options.real_time else SimulatedClock()
        bus = SimulatedBus(clock)
        for k, axis in enumerate(program.axes):
            SimulatedDrive(
                bus,
                nodes[axis.name],
                position=int(program.rows.counts[0, k]),
                rated_torque=axis.objects[(0x6076, 0)],
                pulses=axis.counts_per_turn // 4,
            )
        return Link(bus, clock, "simulated bus")
    try:
        real = can.Bus(channel=options.bus, interface=options.interface, bitrate=options.bitrate)
    except (can.CanError, OSError, ValueError, ImportError) as error:
        raise Usage(
            f"the bus {options.bus} ({options.interface}) cannot be opened: {error}"
        ) from error
    return Link(real, RealClock(), options.bus)


def _confirm(options: Namespace) -> None:
    """Require the second confirmation before real drives are enabled."""
    if options.bus is None or (options.enable_drives and options.confirm == options.bus):
        return
    phrase = f"move {options.bus}"
    if not sys.stdin.isatty():
        raise PlayError(
            "real drives need two confirmations: type the phrase in a terminal, or state "
            f"--enable-drives and --confirm {options.bus}"
        )
    print(f"The drives on {options.bus} will move. Type `{phrase}` to enable them: ", end="")
    sys.stdout.flush()
    if sys.stdin.readline().strip() != phrase:
        raise PlayError("the phrase was not typed: no drive was enabled")


def _catch_signals(player: Player) -> Callable[[], None]:
    """Turn Ctrl-C and the end of the terminal into a request to stop.

    Returns the function that restores the former reaction.
    """

    def request(number: int, frame: FrameType | None) -> None:
        player.request.set(f"stop requested ({signal.Signals(number).name})")

    former = {number: signal.signal(number, request) for number in SIGNALS}

    def restore() -> None:
        for number, handler in former.items():
            signal.signal(number, handler)

    return restore


def _stop_at(player: Player, seconds: float) -> None:
    """Request a stop as soon as the set point of an instant has been sent."""
    program, send = player.program, player.link.send

    def watch(can_id: int, data: bytes = b"") -> None:
        send(can_id, data)
        if player.outcome.sent * program.period >= seconds:
            player.request.set(f"stop requested (--stop-at {seconds:g})")

    player.link.send = watch  # type: ignore[method-assign]


def _prioritise(options: Namespace, say: Callable[[str], None]) -> None:
    """Ask the operating system to run this program before all others."""
    if not options.priority:
        return
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        say("real-time scheduling class: granted")
    except (AttributeError, OSError) as error:
        say(f"real-time scheduling class: refused ({error})")


def _described(outcome: Outcome, player: Player) -> dict[str, Any]:
    """Return the outcome with the identity of the export."""
    manifest = player.program.manifest
    return {
        **outcome.to_dict(),
        "bus": player.link.name,
        "period_s": player.program.period,
        "plan_sha256": manifest["plan"]["sha256"],
        "speed": manifest.get("speed", 1.0),
    }


def _report(
    outcome: Outcome, player: Player, paths: Sequence[Path], say: Callable[[str], None]
) -> None:
    """Print what happened."""
    lateness = f"{outcome.late} of {outcome.sent} set points were late"
    say(f"{lateness} (by up to {1000 * outcome.latest_s:.2f} ms)")
    if outcome.finished:
        say("played to the end; every drive is disabled")
    else:
        say(f"ended early: {outcome.cause}")
        if outcome.disabled:
            say("every drive is disabled")
    for path in paths:
        say(f"log: {path}")


def _printer(to_stderr: bool) -> Callable[[str], None]:
    """Return the function that prints lines."""
    stream = sys.stderr if to_stderr else sys.stdout

    def say(text: str) -> None:
        print(text, file=stream, flush=True)

    return say

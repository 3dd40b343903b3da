"""The player sends every set point of an export, and stops on the certified path. No motion and no
fault leaves a drive enabled. The drives and the bus are simulated.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import pkgutil
import re
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

pytest.importorskip("canopen", reason="the package canopen (extra test) plays the client")

from ssm_planner.api import compare
from ssm_planner.errors import TrajectoryError
from ssm_planner.formats.export import export
from ssm_planner.plans import Plan
from ssm_planner.problem import Robot
from ssm_planner.stopping import Stops, controlled_stops
from tests.support.paths import ROOT
from tests.support.playing import short_plan  # makes the next packages importable

# isort: split
import can
from ssm_planner_guard import Guard, thresholds_of
from ssm_planner_play import Player, PlayError, Program, StopTable, cli, prepare, stop_table
from ssm_planner_play.client import HEARTBEAT, Drive, Link
from ssm_planner_play.clock import SimulatedClock
from ssm_planner_play.simulated import HEARTBEAT_FAULT, SimulatedBus, SimulatedDrive

EVERY_CASE = bool(os.environ.get("EVERY_CASE"))
COUNTS = 4096
RATE = 250.0
MOVING = 75
"""In this row, every axis of the first motion moves."""
SYNC = 0x80


@dataclasses.dataclass(frozen=True)
class Export:
    """An export has a folder. A playback computes its program and its table of stops."""

    folder: Path
    program: Program
    stops: StopTable


@pytest.fixture(scope="module")
def plan(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return short_plan(tmp_path_factory.mktemp("plan"), robot)


@pytest.fixture(scope="module")
def exported(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Export:
    folder = tmp_path_factory.mktemp("play")
    shutil.copy(plan.path, folder / "plan.json")
    export(folder / "plan.json", "epos4", folder / "epos4", counts_per_turn=COUNTS, rate=RATE)
    program = prepare(folder / "epos4")
    return Export(folder / "epos4", program, stop_table(program))


class Machine:
    """A machine has simulated drives on a simulated bus, and a player that controls them."""

    def __init__(self, exported: Export) -> None:
        program = exported.program
        self.clock = SimulatedClock()
        self.bus = SimulatedBus(self.clock)
        self.drives = [
            SimulatedDrive(
                self.bus,
                node,
                position=int(program.rows.counts[0, node - 1]),
                rated_torque=axis.objects[(0x6076, 0)],
                pulses=axis.counts_per_turn // 4,
            )
            for node, axis in enumerate(program.axes, start=1)
        ]
        self.link = Link(self.bus, self.clock, "bench")
        clients = [
            Drive(self.link, node, axis, program) for node, axis in enumerate(program.axes, start=1)
        ]
        guard = Guard(thresholds_of(program.plan, program.period, COUNTS))
        self.player = Player(program, exported.stops, guard, self.link, clients)

    def at_sync(self, number: int, action: Callable[[], Any]) -> None:
        """Call a function when the controller sends its SYNC of this number, counted from 0."""
        count = iter(range(10**6))

        def listen(message: can.Message) -> None:
            if message.arbitration_id == SYNC and next(count) == number:
                action()

        self.bus.listeners.append(listen)

    def play(self) -> Any:
        self.player.inspect()
        self.player.set_up()
        self.player.require_start()
        return self.player.run()

    def received(self) -> np.ndarray:
        """Return the target positions (n, m) that the drives have executed."""
        return np.array([[row[0] for row in drive.received] for drive in self.drives]).T

    @property
    def enabled(self) -> list[int]:
        """Return the nodes of the drives that are enabled."""
        return [drive.node_id for drive in self.drives if drive.state == "enabled"]


@pytest.fixture
def machine(exported: Export) -> Iterator[Machine]:
    machine = Machine(exported)
    yield machine
    machine.bus.shutdown()


# Motion without faults


def test_the_drives_receive_every_set_point_and_end_disabled(
    exported: Export, machine: Machine, tmp_path: Path
) -> None:
    outcome = machine.play()
    rows = exported.program.rows
    assert outcome.finished, outcome.cause
    assert outcome.late == 0
    received = np.array([drive.received for drive in machine.drives])
    for k, values in enumerate((rows.counts, rows.velocity, rows.torque)):
        sent = received[:, : len(rows), k].T
        assert np.array_equal(sent, values)
        assert (received[:, len(rows) :, k] == values[-1][:, None]).all()
    assert machine.enabled == []
    assert all(drive.was_enabled and drive.fault == 0 for drive in machine.drives)
    assert all(drive.value(0x1016, 1) == 0 for drive in machine.drives)


def test_compare_reads_the_log(exported: Export, machine: Machine, tmp_path: Path) -> None:
    outcome = machine.play()
    paths = machine.player.log.write(tmp_path, outcome.to_dict())
    recordings = {path.stem: path for path in paths if path.suffix == ".csv"}
    comparison = compare(exported.program.plan, recordings, counts_per_turn=COUNTS)
    assert comparison.verdict == "held", comparison
    assert json.loads((tmp_path / "play.json").read_text(encoding="utf-8"))["finished"]


def test_the_syncs_come_at_the_period(exported: Export, machine: Machine) -> None:
    times: list[float] = []
    machine.bus.listeners.append(
        lambda message: (
            times.append(machine.clock.now()) if message.arbitration_id == SYNC else None
        )
    )
    machine.play()
    assert np.diff(times) == pytest.approx(exported.program.period, abs=1e-9)


def test_a_late_set_point_delays_the_rest(exported: Export, machine: Machine) -> None:
    """The delay is counted, and no drive gets two set points within one period."""
    times: list[float] = []
    period = exported.program.period
    machine.at_sync(MOVING, lambda: machine.clock.wait(0.6 * period))
    machine.bus.listeners.append(
        lambda message: (
            times.append(machine.clock.now()) if message.arbitration_id == SYNC else None
        )
    )
    outcome = machine.play()
    assert outcome.finished, outcome.cause
    assert outcome.late == 1
    assert outcome.latest_s == pytest.approx(0.6 * period, abs=1e-9)
    assert np.diff(times).min() >= period * (1 - 1e-6)


# Stops


@pytest.fixture(scope="module")
def certified(exported: Export) -> Stops:
    """Return the certified stops of the plan from all set points."""
    program = exported.program
    times = np.minimum(program.t, program.plan.motion.duration)
    return controlled_stops(program.plan.motion, program.plan.robot, program.plan.limits, times)


def certified_counts(program: Program, certified: Stops, row: int) -> np.ndarray:
    """Return the target positions (n, m) after a row in its certified stop."""
    assert certified.passed
    stop = certified.motions[row]
    if stop is None:
        return np.zeros((0, len(program.axes)))
    early = min(row * program.period, program.plan.motion.duration) - certified.time[row]
    assert abs(early) <= 2e-4
    count = int(np.ceil((stop.duration - early) / program.period - 1e-9))
    t = np.minimum(early + np.arange(1, count + 1) * program.period, stop.duration)
    scale = np.array([axis.per_unit for axis in program.axes])
    return np.round(stop.sample(t).q[:, [axis.index for axis in program.axes]] * scale)


def test_every_row_has_its_certified_stop(exported: Export, certified: Stops) -> None:
    program, stops = exported.program, exported.stops
    assert stops.every == 1
    for row in range(len(program.rows)):
        stop = stops.stop_at(row)
        assert stop is not None
        assert np.array_equal(stop.counts, certified_counts(program, certified, row))
        if len(stop):
            step = np.abs(np.diff(stop.counts, axis=0, prepend=program.rows.counts[row][None]))
            bound = [
                program.plan.robot.joints[axis.index].velocity * abs(axis.per_unit)
                for axis in program.axes
            ]
            assert (step <= np.array(bound) * program.period * 1.001 + 1).all()
            assert (stop.velocity[-1] == 0).all()
            assert (stop.torque[-1] == 0).all()


@pytest.mark.parametrize("row", range(171) if EVERY_CASE else (0, 1, 29, MOVING, 140, 170))
def test_a_stop_begins_within_one_cycle_and_follows_the_certified_stop(
    row: int, exported: Export, machine: Machine, certified: Stops
) -> None:
    program = exported.program
    machine.at_sync(row, lambda: machine.player.request.set("test"))
    outcome = machine.play()
    assert outcome.stop_row == row
    assert not outcome.finished
    expected = np.vstack(
        [program.rows.counts[: row + 1], certified_counts(program, certified, row)]
    )
    received = machine.received()
    assert np.array_equal(received[: len(expected)], expected)
    assert (received[len(expected) :] == expected[-1]).all()
    assert machine.enabled == []


def test_stops_of_a_long_stream_begin_at_every_nth_row(
    exported: Export, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ssm_planner_play.stops.MOST", 50)
    sparse = stop_table(exported.program)
    assert sparse.every == int(np.ceil(len(exported.program.rows) / 50))
    machine = Machine(dataclasses.replace(exported, stops=sparse))
    machine.at_sync(MOVING + 1, lambda: machine.player.request.set("test"))
    outcome = machine.play()
    assert outcome.stop_row is not None
    assert outcome.stop_row % sparse.every == 0
    assert MOVING < outcome.stop_row <= MOVING + 1 + sparse.every
    assert machine.enabled == []


# Faults during the motion


def sticks(machine: Machine) -> None:
    machine.drives[0].follow = lambda position, target: position


def reverses(machine: Machine) -> None:
    start = machine.drives[1].position
    machine.drives[1].follow = lambda position, target: 2 * start - target


def loses_power(machine: Machine) -> None:
    machine.drives[2].dead = True


def faults(machine: Machine) -> None:
    machine.drives[1]._fail(0x8611)


def is_switched_off(machine: Machine) -> None:
    machine.drives[0]._control(0x00)
    machine.drives[0]._report()


def changes_mode(machine: Machine) -> None:
    machine.drives[0]._put(0x6061, 1)
    machine.drives[0]._report()


def loses_the_bus(machine: Machine) -> None:
    machine.bus.lost = True


def clock_forward(machine: Machine) -> None:
    machine.clock.time += 0.05


def clock_back(machine: Machine) -> None:
    machine.clock.time -= 5.0


def clock_forward_far(machine: Machine) -> None:
    machine.clock.time += 3600.0


TROUBLE = {
    "does not follow": (sticks, 0, "left the tube|velocity differs"),
    "reversed axis": (reverses, 0, "left the tube|velocity differs|0x8611"),
    "a drive loses its power": (loses_power, MOVING, "MAY STILL BE ENABLED"),
    "a drive goes to fault": (faults, MOVING, "0x8611"),
    "somebody switches a drive off": (is_switched_off, MOVING, "switch on disabled"),
    "somebody changes the mode": (changes_mode, MOVING, "mode 1"),
    "the bus disappears": (loses_the_bus, MOVING, "bench is lost(.|\n)*MAY STILL BE ENABLED"),
    "the clock jumps by 50 ms": (clock_forward, MOVING, "hold their last set points"),
    "the clock jumps back": (clock_back, MOVING, "clock jumped back|0x8130"),
    "the clock jumps by an hour": (clock_forward_far, MOVING, "0x8130"),
}
"""Each entry has the cause, the number of the SYNC at which it occurs, and a pattern of the
outcome.
"""


@pytest.mark.parametrize("kind", TROUBLE)
def test_trouble_ends_the_motion_without_an_enabled_drive(
    kind: str, exported: Export, machine: Machine
) -> None:
    action, row, text = TROUBLE[kind]
    machine.at_sync(row, lambda: action(machine))
    outcome = machine.play()
    assert not outcome.finished
    assert outcome.cause is not None
    assert re.search(text, outcome.cause), outcome.cause
    if "lost" in kind or "disappears" in kind or "power" in kind:
        assert not outcome.disabled
        # Drives that the program cannot reach stop by themselves, because its heartbeat is missing.
        machine.bus.lost = False
        for drive in machine.drives:
            drive.dead = False
        machine.clock.wait(2 * HEARTBEAT)
        for drive in machine.drives:
            drive.watch()
        assert all(drive.fault in (0, HEARTBEAT_FAULT) for drive in machine.drives)
    else:
        assert outcome.disabled
    assert machine.enabled == []


def test_an_alarm_during_a_requested_stop_is_stated(exported: Export, machine: Machine) -> None:
    machine.at_sync(MOVING, lambda: machine.player.request.set("Ctrl-C"))
    machine.at_sync(MOVING + 2, lambda: sticks(machine))
    outcome = machine.play()
    assert outcome.cause is not None
    assert re.match(r"Ctrl-C: controlled stop(.|\n)*then: alarm: joint roll", outcome.cause)
    assert machine.enabled == []


@pytest.mark.parametrize("where", ["before the SYNC", "at the SYNC"])
def test_after_a_pause_the_drives_hold_their_last_set_points(
    where: str, exported: Export, machine: Machine
) -> None:
    """The drives are already at rest after the pause.

    A set point on the path would make them jump to the speed of the motion.
    """

    def pause(message: can.Message) -> None:
        expected = SYNC if where == "at the SYNC" else 0x301
        if message.arbitration_id == expected and machine.player.outcome.sent == MOVING:
            machine.clock.wait(0.018)

    machine.bus.listeners.append(pause)
    outcome = machine.play()
    assert outcome.cause is not None
    assert "this program paused for more than 10 ms" in outcome.cause
    last = MOVING - (where == "before the SYNC")
    received = machine.received()
    assert np.array_equal(received[: last + 1], exported.program.rows.counts[: last + 1])
    assert (received[last:] == exported.program.rows.counts[last]).all()
    assert machine.enabled == []


def test_a_drive_that_does_not_follow_is_found_within_20_ms(
    exported: Export, machine: Machine
) -> None:
    machine.at_sync(MOVING, lambda: sticks(machine))
    outcome = machine.play()
    assert outcome.stop_row is not None
    assert (outcome.stop_row - MOVING) * exported.program.period <= 0.02


def test_an_error_in_the_program_disables_the_drives(
    machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*arguments: Any) -> None:
        raise RuntimeError("a defect")

    machine.at_sync(MOVING, lambda: monkeypatch.setattr(machine.player, "_sample", fail))
    with pytest.raises(RuntimeError, match="a defect"):
        machine.play()
    assert machine.enabled == []


def test_an_interruption_at_any_message_before_the_motion_moves_nothing(exported: Export) -> None:
    total = Machine(exported)
    messages: list[int] = []
    total.bus.listeners.append(lambda message: messages.append(message.arbitration_id))
    total.play()
    before = messages.index(SYNC)
    step = 1 if EVERY_CASE else 80
    for number in range(0, before - 20, step):
        machine = Machine(exported)
        count = iter(range(10**6))

        def listen(message: can.Message, machine: Machine = machine, count: Any = count) -> None:
            if next(count) == number:  # noqa: B023
                machine.player.request.set("Ctrl-C")

        machine.bus.listeners.append(listen)
        with suppress(PlayError):  # It is interrupted before the drives are enabled.
            assert not machine.play().finished
        assert machine.enabled == []
        moved = [
            drive.position - int(exported.program.rows.counts[0, k])
            for k, drive in enumerate(machine.drives)
        ]
        assert np.abs(moved).max() <= 3


# Faults before the motion


def wrong_encoder(machine: Machine) -> None:
    machine.drives[0].node.data_store[0x3010][1] = (512).to_bytes(4, "little")


def wrong_motor(machine: Machine) -> None:
    machine.drives[1]._put(0x6076, 12345)


def in_fault(machine: Machine) -> None:
    machine.drives[0]._fail(0x7500)


def in_use(machine: Machine) -> None:
    for word in (6, 7, 15):
        machine.drives[0]._control(word)
    machine.drives[0]._report()


def silent(machine: Machine) -> None:
    machine.drives[2].dead = True


def elsewhere(machine: Machine) -> None:
    machine.drives[0].position += 40
    machine.drives[0]._report()


def stubborn(machine: Machine) -> None:
    """Let the first drive keep its following-error window."""
    data = machine.drives[0].node.data_store

    class Kept(dict[int, bytes]):
        def __setitem__(self, key: int, value: bytes) -> None:
            pass

    data[0x6065] = Kept({0: (77).to_bytes(4, "little")})


BEFORE = {
    "wrong counts per turn": (wrong_encoder, "2048 increments per turn"),
    "wrong rated torque": (wrong_motor, "0x6076:00 is 12345"),
    "drive in fault": (in_fault, "in fault .error 0x7500"),
    "drive in use": (in_use, "already in use"),
    "silent drive": (silent, "does not answer"),
    "arm elsewhere": (elsewhere, "move the arm to the start"),
    "window not accepted": (stubborn, "0x6065:00 is 77"),
    "no bus": (loses_the_bus, "is lost"),
}


@pytest.mark.parametrize("kind", BEFORE)
def test_nothing_is_enabled_if_a_drive_differs_from_the_export(kind: str, machine: Machine) -> None:
    action, text = BEFORE[kind]
    action(machine)
    used = machine.enabled
    with pytest.raises(PlayError, match=text):
        prepare_only(machine)
    assert machine.enabled == used
    assert all(not drive.received for drive in machine.drives)


def prepare_only(machine: Machine) -> None:
    """Perform all steps of the command before it enables the drives."""
    differences = machine.player.inspect()
    if differences:
        raise PlayError("\n".join(differences))
    machine.player.set_up()
    machine.player.require_start()


def test_homing_declares_the_start(exported: Export, machine: Machine) -> None:
    """Homing takes the present positions of the drives as the start of the motion."""
    for drive in machine.drives:
        drive.position = 17
        drive._report()
    machine.player.set_up()
    with pytest.raises(PlayError, match="stands at 17"):
        machine.player.require_start()
    outcome = machine.player.run(home=True)
    assert outcome.finished, outcome.cause
    assert (machine.received()[-1] == exported.program.rows.counts[-1]).all()


def copied(exported: Export, folder: Path) -> Path:
    shutil.copytree(exported.folder.parent, folder / "copy")
    return folder / "copy" / "epos4"


def rehashed(folder: Path, name: str, text: str) -> None:
    (folder / name).write_text(text, encoding="utf-8")
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    manifest["files"][name] = hashlib.sha256((folder / name).read_bytes()).hexdigest()
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")


def test_a_folder_that_is_not_the_plan_s_is_refused(
    exported: Export, plan: Plan, tmp_path: Path
) -> None:
    folder = copied(exported, tmp_path)
    with pytest.raises(TrajectoryError, match=r"manifest\.json"):
        prepare(tmp_path)
    export(plan, "csv", tmp_path / "csv")
    with pytest.raises(PlayError, match="cannot be played"):
        prepare(tmp_path / "csv", plan.path)
    lines = (folder / "roll.csv").read_text(encoding="utf-8").splitlines()
    changed = [*lines[:50], lines[50].replace(",", ",9", 1), *lines[51:]]
    (folder / "roll.csv").write_text("\n".join(changed) + "\n", encoding="utf-8")
    with pytest.raises(TrajectoryError, match="was modified after the export"):
        prepare(folder)
    rehashed(folder, "roll.csv", "\n".join(changed) + "\n")
    with pytest.raises((PlayError, TrajectoryError), match=r"exceed|changed after"):
        prepare(folder)
    shutil.copy(exported.folder / "roll.csv", folder)
    objects = (exported.folder / "objects.csv").read_text(encoding="utf-8")
    rehashed(folder, "roll.csv", (exported.folder / "roll.csv").read_text(encoding="utf-8"))
    rehashed(folder, "objects.csv", objects.replace("0x6065:00", "0x6066:00"))
    with pytest.raises(TrajectoryError, match="changed after the export"):
        prepare(folder)


def test_a_motion_that_keeps_the_limits_but_is_not_the_plan_s_is_refused(
    exported: Export, tmp_path: Path
) -> None:
    """The check accepts this motion, but the comparison with the plan refuses it."""
    folder = copied(exported, tmp_path)
    program = exported.program
    exact = program.plan.motion.positions(program.t[:-1])[:, 0] * program.axes[0].per_unit
    error = program.rows.counts[:-1, 0] - exact
    k = 1 + int(np.argmin(error))  # Row 0 is the header. Row k is rounded down most.
    for name in ("roll.csv", "roll_time_position.csv"):
        lines = (folder / name).read_text(encoding="utf-8").splitlines()
        words = lines[k].split(",")
        words[1] = str(int(words[1]) + 1)
        rehashed(folder, name, "\n".join([*lines[:k], ",".join(words), *lines[k + 1 :]]) + "\n")
    with pytest.raises(PlayError, match="increments away from the plan"):
        prepare(folder)


def test_another_plan_is_refused(exported: Export, tmp_path: Path) -> None:
    folder = copied(exported, tmp_path)
    text = (folder.parent / "plan.json").read_text(encoding="utf-8")
    (folder.parent / "plan.json").write_text(text + "\n", encoding="utf-8")
    with pytest.raises(PlayError, match="was not exported from"):
        prepare(folder)


# The command


@pytest.fixture
def command(
    exported: Export, machine: Machine, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> SimpleNamespace:
    """Return the command, which uses the simulated machine for every bus that its options name."""
    monkeypatch.setattr(cli, "_open", lambda *_: machine.link)
    monkeypatch.setattr(cli, "stop_table", lambda program: exported.stops)
    monkeypatch.setattr(cli, "bus_load", lambda *_: 0.5)
    monkeypatch.setenv("CC", "no-compiler")
    run = lambda *words: cli.main([str(exported.folder), "-o", str(tmp_path / "log"), *words])  # noqa: E731
    nodes = [f"{axis.name}={axis.index + 1}" for axis in exported.program.axes]
    real = ("--bus", "can0", "--nodes", "roll=1", "tilt=2", "insertion=3")
    return SimpleNamespace(run=run, machine=machine, real=real, nodes=nodes, log=tmp_path / "log")


def test_the_command_plays_on_simulated_drives(
    command: SimpleNamespace, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.run() == 0
    printed = capsys.readouterr()
    assert "played to the end; every drive is disabled" in printed.out
    assert sorted(path.name for path in command.log.iterdir()) == [
        "insertion.csv",
        "play.json",
        "roll.csv",
        "tilt.csv",
    ]


def test_a_dry_run_writes_nothing(command: SimpleNamespace) -> None:
    output: list[can.Message] = []

    def listen(message: can.Message) -> None:
        is_upload = message.arbitration_id & 0x780 == 0x600 and message.data[0] >> 5 == 2
        if not is_upload:
            output.append(message)

    command.machine.bus.listeners.append(listen)
    assert command.run("--dry-run") == 0
    assert command.run(*command.real, "--dry-run") == 0
    assert output == []


@pytest.mark.parametrize(
    ("words", "status"),
    [
        ((), 1),
        (("--enable-drives",), 2),
        (("--confirm", "can0"), 2),
        (("--enable-drives", "--confirm", "can1"), 2),
        (("--enable-drives", "--confirm", "can0"), 0),
    ],
)
def test_real_drives_need_two_confirmations(
    words: tuple[str, ...],
    status: int,
    command: SimpleNamespace,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert command.run(*command.real, *words) == status
    assert any(drive.was_enabled for drive in command.machine.drives) == (status == 0)
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(("typed", "status"), [("move can0\n", 0), ("move can1\n", 1), ("", 1)])
def test_the_typed_phrase_names_the_bus(
    typed: str, status: int, command: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = SimpleNamespace(isatty=lambda: True, readline=lambda: typed)
    monkeypatch.setattr(sys, "stdin", terminal)
    assert command.run(*command.real) == status
    assert any(drive.was_enabled for drive in command.machine.drives) == (status == 0)


def test_ctrl_c_stops_on_the_path(
    command: SimpleNamespace, capsys: pytest.CaptureFixture[str]
) -> None:
    command.machine.at_sync(MOVING, lambda: os.kill(os.getpid(), signal.SIGINT))
    assert command.run() == 1
    printed = capsys.readouterr()
    assert f"stop requested (SIGINT): controlled stop on the path from row {MOVING}" in printed.out
    assert printed.err == ""
    assert command.machine.enabled == []
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize(
    "words",
    [
        ("--bus", "can0"),
        ("--nodes", "roll=1"),
        ("--bus", "can0", "--nodes", "roll=1", "tilt=1", "insertion=3"),
        ("--bus", "can0", "--nodes", "roll=1", "tilt=2"),
        ("--bitrate", "0"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    words: tuple[str, ...], command: SimpleNamespace, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.run(*words) == 2
    assert capsys.readouterr().err.startswith("error: ")


def test_a_bus_that_is_too_slow_is_refused(
    exported: Export, command: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    assert cli.bus_load(exported.program, 1_000_000) == pytest.approx(0.33, abs=0.01)
    words = (*command.real, "--bitrate", "250000")
    assert cli.main([str(exported.folder), *words]) == 1


def test_a_bus_that_does_not_exist_is_bad_input(
    exported: Export, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli, "stop_table", lambda program: exported.stops)
    words = ("--bus", "can77", "--nodes", "roll=1", "tilt=2", "insertion=3")
    assert cli.main([str(exported.folder), *words]) == 2
    assert "cannot be opened" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["guard", "play"])
def test_the_packages_name_objects_that_exist(name: str) -> None:
    file = ROOT / "examples/extensions" / name / "pyproject.toml"
    project = tomllib.loads(file.read_text(encoding="utf-8"))["project"]
    groups = [project.get("scripts", {}), *project.get("entry-points", {}).values()]
    entries = [entry for group in groups for entry in group.values()]
    assert entries
    assert all(pkgutil.resolve_name(entry) is not None for entry in entries)
    assert (file.parent / "README.md").is_file()

"""Talk to CiA 402 drives: set them up, compare their objects, enable and disable them.

All communication runs in the calling thread. While the program waits for a reply, it receives
messages, and it sends the heartbeat that the drives expect.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import can
import canopen
from canopen.sdo.base import SdoVariable
from canopen.sdo.client import SdoClient

from ssm_planner_play.clock import Clock
from ssm_planner_play.program import AxisProgram, PlayError, Program, object_key
from ssm_planner_play.simulated import dictionary

MASTER = 127
"""Node of this program in the heartbeat."""
HEARTBEAT = 0.2
"""Time after which a drive without a heartbeat must go to fault by itself, s.

It is longer than the reply to an SDO request may take (`REPLY`), during which the program sends
heartbeats as well, and shorter than the longest controlled stop of the shipped plans.
"""
BEATS = 4
"""Number of heartbeats within HEARTBEAT, so that one lost message has no effect."""
REPLY = 0.1
"""Time within which a drive must reply to an SDO request, s."""
SETTLE = 1.0
"""Time within which a drive must change its state, s."""
SYNC = 0x80
RESET = {
    "pre-operational": 0x80,
    "operational": 0x01,
}
"""Commands of the network management."""
STATE_MASK, ENABLED, FAULT = 0x6F, 0x27, 0x08
HOMED = 0x1400
CSP, HOMING = 8, 6
FORMATS = {
    0x6041: "H",
    0x6061: "b",
    0x6064: "i",
    0x606C: "i",
    0x6077: "h",
    0x607A: "i",
    0x60B1: "i",
    0x60B2: "h",
}
"""Format of each mapped object, as in the module struct."""
READ_ONLY = {(0x6076, 0)}
"""Objects of objects.csv that the drive does not let anybody write."""
PULSES = (0x3010, 1)
"""Pulses of the encoder per turn, a quarter of the increments. Public code states this object."""
STATES = {
    0x00: "not ready to switch on",
    0x40: "switch on disabled",
    0x21: "ready to switch on",
    0x23: "switched on",
    0x27: "operation enabled",
    0x07: "quick stop active",
    0x0F: "fault reaction active",
    0x08: "fault",
}


class DriveError(PlayError):
    """A drive or the bus does not do what it must (exit status 1)."""


class Interrupted(PlayError):
    """The user has interrupted the preparation (exit status 1)."""


class Link:
    """The bus, the clock and the distribution of received messages."""

    def __init__(self, bus: Any, clock: Clock, name: str) -> None:
        """Use an open bus."""
        self.bus, self.clock, self.name = bus, clock, name
        self.network = canopen.Network()
        self.network.bus = bus
        self.beating = False
        """True while the drives expect a heartbeat."""
        self._beat = clock.now()

    def send(self, can_id: int, data: bytes = b"") -> None:
        """Send a message. Raises DriveError if the bus is gone."""
        message = can.Message(arbitration_id=can_id, is_extended_id=False, data=data)
        with self.guarded():
            self.bus.send(message)

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """Turn errors of the bus into a DriveError."""
        try:
            yield
        except (can.CanError, OSError) as error:
            raise DriveError(f"the bus {self.name} is lost: {error}") from error

    def receive(self, until: float, done: Callable[[], bool] = lambda: False) -> None:
        """Distribute messages until an instant, or until `done` is true."""
        while not done():
            self.beat()
            remaining = until - self.clock.now()
            if remaining <= 0:
                return
            if self.beating:
                remaining = min(remaining, HEARTBEAT / BEATS)
            with self.guarded():
                message = self.bus.recv(remaining)
            self.deliver(message)

    def drain(self) -> None:
        """Distribute all messages that have arrived."""
        while True:
            with self.guarded():
                message = self.bus.recv(0)
            if message is None:
                return
            self.deliver(message)

    def deliver(self, message: can.Message | None) -> None:
        """Call the functions that wait for a message."""
        if message is not None and not message.is_error_frame and not message.is_remote_frame:
            self.network.notify(message.arbitration_id, message.data, message.timestamp)

    def beat(self) -> None:
        """Send the heartbeat if it is due."""
        now = self.clock.now()
        if self.beating and now - self._beat >= HEARTBEAT / BEATS:
            self._beat = now
            self.send(0x700 + MASTER, b"\x05")


class _Sdo(SdoClient):
    """An SDO client that receives messages while it waits."""

    def __init__(self, link: Link, node_id: int) -> None:
        super().__init__(0x600 + node_id, 0x580 + node_id, dictionary(node_id))
        self.link = link
        self.network = link.network
        self.RESPONSE_TIMEOUT = 0.001  # the reply has arrived when the queue is read
        link.network.subscribe(0x580 + node_id, self.on_response)

    def read_response(self) -> bytes:
        """Return the next reply."""
        end = self.link.clock.now() + REPLY
        self.link.receive(end, lambda: not self.responses.empty())
        return bytes(super().read_response())


class Drive:
    """One drive on the bus, with its latest status and measurements."""

    def __init__(self, link: Link, node_id: int, axis: AxisProgram, program: Program) -> None:
        """Subscribe to the messages of a drive. Nothing is sent."""
        self.link, self.node_id, self.axis = link, node_id, axis
        self.sdo = _Sdo(link, node_id)
        self.pdo = program.manifest["pdo"]
        self.values: dict[int, int] = {}
        """Latest values of the transmitted objects, by index."""
        self.measured = 0.0
        """Instant of the SYNC to which the latest measurement belongs, s."""
        self.synced = 0.0
        """Instant of the latest SYNC."""
        self.emergency = 0
        """Latest error code, or 0."""
        self.written = False
        """True from the first command that could have enabled the drive."""
        for number, pdo in enumerate(self.pdo["transmit"]):
            objects = [object_key(entry["object"])[0] for entry in pdo["objects"]]
            layout = struct.Struct("<" + "".join(FORMATS[index] for index in objects))
            link.network.subscribe(self._cob(pdo), self._reader(objects, layout, number))
        link.network.subscribe(0x80 + node_id, self._on_emergency)
        streamed = self.pdo["receive"][1:]
        self._streams = [
            (
                self._cob(pdo),
                [object_key(entry["object"])[0] for entry in pdo["objects"]],
                struct.Struct(
                    "<" + "".join(FORMATS[object_key(x["object"])[0]] for x in pdo["objects"])
                ),
            )
            for pdo in streamed
        ]

    def __str__(self) -> str:
        return f"drive {self.axis.name} (node {self.node_id} on {self.link.name})"

    def _cob(self, pdo: dict[str, Any]) -> int:
        return int(pdo["cob_id"].split()[0], 16) + self.node_id

    def _reader(
        self, objects: Sequence[int], layout: struct.Struct, number: int
    ) -> Callable[[int, bytearray, float], None]:
        """Return the function that stores the content of a PDO."""

        def read(can_id: int, data: bytearray, timestamp: float) -> None:
            if len(data) == layout.size:
                self.values.update(zip(objects, layout.unpack(data), strict=True))
                if 0x6064 in objects:
                    self.measured = self.synced

        return read

    def _on_emergency(self, can_id: int, data: bytearray, timestamp: float) -> None:
        if len(data) >= 2:
            self.emergency = int.from_bytes(data[:2], "little")

    # --- cyclic messages --------------------------------------------------------------------------

    def send(self, setpoint: dict[int, int]) -> None:
        """Send a set point, values by index of the object."""
        for cob_id, objects, layout in self._streams:
            self.link.send(cob_id, layout.pack(*(setpoint[index] for index in objects)))

    @property
    def trouble(self) -> str | None:
        """Reason why the drive does not execute the motion, or None."""
        status, mode = self.values.get(0x6041), self.values.get(0x6061)
        if self.emergency:
            return f"{self} reports the error 0x{self.emergency:04X}"
        if status is not None and status & STATE_MASK != ENABLED:
            return f"{self} left the state operation enabled: {state_name(status)}"
        if mode is not None and mode != CSP:
            return f"{self} left the cyclic synchronous position mode (mode {mode})"
        return None

    # --- SDO --------------------------------------------------------------------------------------

    def read(self, key: tuple[int, int]) -> int:
        """Return the value of an object. Raises DriveError."""
        with self._explained(f"does not let 0x{key[0]:04X}:{key[1]:02X} be read"):
            return int(self._variable(key).raw)

    def write(self, key: tuple[int, int], value: int) -> None:
        """Write an object. Raises DriveError."""
        with self._explained(f"does not accept 0x{key[0]:04X}:{key[1]:02X} = {value}"):
            self._variable(key).raw = value

    def _variable(self, key: tuple[int, int]) -> Any:
        index, subindex = key
        entry = self.sdo[index]
        return entry if isinstance(entry, SdoVariable) else entry[subindex]

    @contextmanager
    def _explained(self, text: str) -> Iterator[None]:
        """Turn errors of the SDO protocol and of the bus into a DriveError."""
        try:
            with self.link.guarded():
                yield
        except canopen.SdoAbortedError as error:
            raise DriveError(f"{self} {text}: {error}") from error
        except canopen.SdoCommunicationError as error:
            raise DriveError(f"{self} does not answer: {error}") from error

    # --- set-up -----------------------------------------------------------------------------------

    def require_at_rest(self) -> None:
        """Raise DriveError if the drive is silent, in fault, or already enabled."""
        status = self.read((0x6041, 0))
        if status & FAULT:
            code = self.read((0x603F, 0))
            raise DriveError(f"{self} is in fault (error 0x{code:04X}): clear the fault first")
        if status & STATE_MASK in (ENABLED, 0x23, 0x07):
            raise DriveError(f"{self} is already in use: {state_name(status)}")

    def set_up(self) -> None:
        """Map the PDOs and write the objects of the export. The drive stays disabled."""
        self.link.send(0, bytes([RESET["pre-operational"], self.node_id]))
        for pdo in (*self.pdo["receive"], *self.pdo["transmit"]):
            communication, mapping = int(pdo["communication"], 16), int(pdo["mapping"], 16)
            cob_id = self._cob(pdo)
            self.write((communication, 1), cob_id | 1 << 31)
            self.write((communication, 2), pdo["transmission_type"])
            self.write((mapping, 0), 0)
            for subindex, entry in enumerate(pdo["objects"], start=1):
                self.write((mapping, subindex), int(entry["value"], 16))
            self.write((mapping, 0), len(pdo["objects"]))
            self.write((communication, 1), cob_id)
        for key, value in self.axis.objects.items():
            if key not in READ_ONLY:
                self.write(key, value)

    def differences(self, written: bool = True) -> list[str]:
        """Return the objects whose values differ from the export, one sentence each.

        `written` is False before `set_up`. Then only objects that it does not write count.
        """
        expected = {
            key: value for key, value in self.axis.objects.items() if written or key in READ_ONLY
        }
        sentences = []
        for key, value in expected.items():
            actual = self.read(key)
            if actual != value:
                sentences.append(
                    f"{self}: 0x{key[0]:04X}:{key[1]:02X} is {actual}, the export needs {value}"
                )
        increments = 4 * self.read(PULSES)
        if increments != self.axis.counts_per_turn:
            sentences.append(
                f"{self}: its encoder has {increments} increments per turn, the export "
                f"{self.axis.counts_per_turn}"
            )
        return sentences

    @property
    def position(self) -> int:
        """Present position, read by SDO, increments."""
        return self.read((0x6064, 0))

    def home(self) -> None:
        """Declare that the axis stands at the start of the plan. The drive is enabled meanwhile."""
        for key, value in self.axis.homing.items():
            self.write(key, value)
        self.set_mode(HOMING)
        self.enable()
        self.command(0x1F, HOMED, HOMED, "has not finished homing")
        self.disable()

    def set_mode(self, mode: int) -> None:
        """Select a mode of operation."""
        self.write((0x6060, 0), mode)
        self._wait(lambda: self.read((0x6061, 0)) == mode, f"does not select mode {mode}")

    def expect_heartbeat(self) -> None:
        """Let the drive go to fault if this program ends without disabling it."""
        self.write((0x6007, 0), 1)
        self.write((0x1016, 1), MASTER << 16 | round(1000 * HEARTBEAT))

    def forget_heartbeat(self) -> None:
        """End the supervision by the heartbeat."""
        self.write((0x1016, 1), 0)

    def enable(self) -> None:
        """Enable the drive at its present position."""
        self.written = True
        self.command(0x06, STATE_MASK, 0x21, "does not become ready")
        self.command(0x07, STATE_MASK, 0x23, "does not switch on")
        self.command(0x0F, STATE_MASK, ENABLED, "does not enable the operation")

    def require_reports(self) -> None:
        """Raise DriveError unless the drive also reports its state by PDO."""
        self.emergency = 0
        self._wait(
            lambda: self.values.get(0x6041, 0) & STATE_MASK == ENABLED,
            "does not report its state by PDO",
        )

    def disable(self) -> None:
        """Switch the motor off. Raises DriveError if the drive does not confirm it."""
        self.write((0x6040, 0), 0x06)
        self.write((0x6040, 0), 0x00)
        self._wait(
            lambda: self.read((0x6041, 0)) & STATE_MASK in (0x40, 0x00, 0x21, 0x08),
            "does not confirm that it is disabled",
        )
        self.written = False

    def command(self, word: int, mask: int, state: int, text: str) -> None:
        """Write a controlword, and wait for a state."""
        self.write((0x6040, 0), word)
        self._wait(lambda: self.read((0x6041, 0)) & mask == state, text)

    def _wait(self, done: Callable[[], bool], text: str) -> None:
        end = self.link.clock.now() + SETTLE
        while not done():
            if self.link.clock.now() >= end:
                raise DriveError(f"{self} {text}")
            self.link.receive(self.link.clock.now() + REPLY / 10)


def state_name(status: int) -> str:
    """Return the name of the state in a statusword."""
    return STATES.get(status & STATE_MASK, f"statusword 0x{status:04X}")


def disable_all(drives: Sequence[Drive]) -> list[str]:
    """Disable every drive that may be enabled, and return a sentence for each that is not."""
    sentences = []
    for _ in range(2):  # the second attempt covers a lost message
        remaining = [drive for drive in drives if drive.written]
        for drive in remaining:
            with suppress(DriveError):
                drive.disable()
    for drive in drives:
        if drive.written:
            sentences.append(
                f"{drive} MAY STILL BE ENABLED: it has not confirmed that it is disabled. Switch "
                "off its power."
            )
    return sentences

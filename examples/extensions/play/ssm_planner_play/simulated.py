"""Simulated CiA 402 drives in cyclic synchronous position mode, on a bus without threads.

A message that the controller sends is processed at once. The drives refuse what a real drive
refuses: a target outside the software limits, a step larger than the speed limit or the window of
the following error, a PDO of another length than its mapping, or a missing heartbeat of the
controller. A real drive adds friction, noise and delays, so a playback that works here is not
verified on hardware.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import can
import canopen
from canopen.objectdictionary import ODArray, ODRecord, ODVariable, datatypes

from ssm_planner_play.clock import Clock

U8, U16, U32 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32
I8, I16, I32 = datatypes.INTEGER8, datatypes.INTEGER16, datatypes.INTEGER32
VARIABLES = {
    (0x1017, 0): ("Producer heartbeat time", U16, 0),
    (0x30B0, 0): ("Home position", I32, 0),
    (0x30B1, 0): ("Home offset move distance", I32, 0),
    (0x603F, 0): ("Error code", U16, 0),
    (0x6007, 0): ("Abort connection option code", I16, 0),
    (0x6040, 0): ("Controlword", U16, 0),
    (0x6041, 0): ("Statusword", U16, 0x0240),
    (0x6060, 0): ("Modes of operation", I8, 0),
    (0x6061, 0): ("Modes of operation display", I8, 0),
    (0x6064, 0): ("Position actual value", I32, 0),
    (0x6065, 0): ("Following error window", U32, 2000),
    (0x606C, 0): ("Velocity actual value", I32, 0),
    (0x6071, 0): ("Target torque", I16, 0),
    (0x6076, 0): ("Motor rated torque", U32, 0),
    (0x6077, 0): ("Torque actual value", I16, 0),
    (0x607A, 0): ("Target position", I32, 0),
    (0x607F, 0): ("Max profile velocity", U32, 50_000),
    (0x6080, 0): ("Max motor speed", U32, 50_000),
    (0x6098, 0): ("Homing method", I8, 7),
    (0x60A9, 0): ("SI unit velocity", U32, 0x00B44700),
    (0x60B1, 0): ("Velocity offset", I32, 0),
    (0x60B2, 0): ("Torque offset", I16, 0),
    (0x60C5, 0): ("Max acceleration", U32, 10_000),
    (0x60FF, 0): ("Target velocity", I32, 0),
}
ARRAYS = {
    0x1016: ("Consumer heartbeat time", U32, (0,)),
    0x3001: ("Motor data", U32, (0, 0)),
    0x3010: ("Digital incremental encoder 1", U32, (1024,)),
    0x607D: ("Software position limit", I32, (-(2**31), 2**31 - 1)),
    0x60C2: ("Interpolation time period", I8, (1, -3)),
}
"""Objects of a drive: name, type and default value."""
PDOS, MAPPED = 4, 8
"""Numbers of PDOs in each direction, and of objects in one PDO."""
READ_ONLY = frozenset((0x6076, 0x6041, 0x6061, 0x6064, 0x3010))
HOMING, CSP = 6, 8
PRESENT_POSITION = 37
MILLI_RPM = 0xFDB44700
DISABLED = 1 << 31
STATES = {
    "disabled": 0x0240,
    "ready": 0x0221,
    "switched on": 0x0223,
    "enabled": 0x0227,
    "fault": 0x0208,
}
HOMED = 0x1400
HEARTBEAT_FAULT, LIMIT_FAULT, SPEED_FAULT, LAG_FAULT, LENGTH_FAULT = (
    0x8130,
    0x8612,
    0x8402,
    0x8611,
    0x8210,
)
"""Error codes of the simulated faults."""


def dictionary(node_id: int) -> canopen.ObjectDictionary:
    """Return the object dictionary of a drive. No PDO is mapped."""
    od = canopen.ObjectDictionary()
    od.node_id = node_id
    for (index, subindex), (name, kind, default) in VARIABLES.items():
        od.add_object(_variable(name, (index, subindex), kind, default))
    for index, (name, kind, defaults) in ARRAYS.items():
        array = ODArray(name, index)
        array.add_member(_variable(f"{name} 0", (index, 0), U8, len(defaults)))
        for subindex, default in enumerate(defaults, start=1):
            array.add_member(_variable(f"{name} {subindex}", (index, subindex), kind, default))
        od.add_object(array)
    for k in range(PDOS):
        for base, cob_id in ((0x1400, 0x200), (0x1800, 0x180)):
            cob = DISABLED | (cob_id + 0x100 * k + node_id)
            _add_record(od, base + k, ((U8, 2), (U32, cob), (U8, 255)))
            _add_record(od, base + 0x200 + k, ((U8, 0), *((U32, 0),) * MAPPED))
    return od


def _variable(name: str, key: tuple[int, int], kind: int, default: int) -> ODVariable:
    variable = ODVariable(name, *key)
    variable.data_type, variable.default, variable.access_type = kind, default, "rw"
    return variable


def _add_record(
    od: canopen.ObjectDictionary, index: int, members: tuple[tuple[int, int], ...]
) -> None:
    record = ODRecord(f"PDO {index:X}", index)
    for subindex, (kind, value) in enumerate(members):
        record.add_member(_variable(f"{index:X} sub {subindex}", (index, subindex), kind, value))
    od.add_object(record)


class SimulatedBus(can.BusABC):
    """A CAN bus with simulated drives. Nothing runs in the background."""

    def __init__(self, clock: Clock, channel: str = "simulated") -> None:
        """Create a bus without drives."""
        super().__init__(channel)
        self.channel_info = channel
        self.clock = clock
        self.lost = False
        """True makes the bus disappear, like an adapter that somebody unplugs."""
        self.listeners: list[Callable[[can.Message], None]] = []
        """Functions that see every message of the controller."""
        self.drives: list[SimulatedDrive] = []
        self._waiting: deque[can.Message] = deque()
        self.network = canopen.Network()
        self.network.bus = _DriveSide(self._waiting)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Deliver a message to all drives."""
        if self.lost:
            raise can.CanOperationError("the simulated bus is gone")
        for listener in self.listeners:
            listener(msg)
        self.network.notify(msg.arbitration_id, msg.data, self.clock.now())

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next message of the drives. Without one, the time passes."""
        if self.lost:
            raise can.CanOperationError("the simulated bus is gone")
        if not self._waiting:
            self.clock.wait(timeout or 0.0)
            for drive in self.drives:
                drive.watch()
        return self._waiting.popleft() if self._waiting else None

    def shutdown(self) -> None:
        """Forget the drives."""
        super().shutdown()
        self.drives.clear()


class _DriveSide:
    """The side of the bus on which the drives send."""

    channel_info = "simulated drives"

    def __init__(self, waiting: deque[can.Message]) -> None:
        self.waiting = waiting

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Put a message into the queue of the controller."""
        self.waiting.append(msg)


class SimulatedDrive:
    """One simulated drive."""

    def __init__(
        self, bus: SimulatedBus, node_id: int, *, position: int, rated_torque: int, pulses: int
    ) -> None:
        """Connect a drive to a bus.

        Parameters
        ----------
        bus : SimulatedBus
        node_id : int
        position : int
            Position at which the drive stands, increments.
        rated_torque : int
            Rated torque of the motor, µN·m.
        pulses : int
            Pulses of the encoder per turn.
        """
        self.bus, self.node_id = bus, node_id
        self.node = canopen.LocalNode(node_id, dictionary(node_id))
        bus.network.add_node(self.node)
        bus.drives.append(self)
        self.position, self.state, self.fault = position, "disabled", 0
        self.target = position
        self.speed = self.torque = 0
        self.received: list[tuple[int, int, int]] = []
        """Target position, velocity offset and torque offset at every SYNC while enabled."""
        self.was_enabled = False
        self.dead = False
        """True makes the drive silent, as without power."""
        self.follow: Callable[[int, int], int] = lambda position, target: target
        """Function that returns the next position from the present one and the target."""
        self.heard = bus.clock.now()
        self.homed = False
        self.pulses = pulses
        # Decoded values and PDO mappings, because the object dictionary is slow.
        self._values: dict[tuple[int, int], int] = {}
        self._mappings: dict[tuple[int, int], list[tuple[int, int]]] = {}
        self.waiting: dict[int, bytes] = {}
        """Content of synchronous PDOs since the last SYNC, by number of the PDO."""
        self._put(0x6064, position)
        self._put(0x6076, rated_torque)
        self.node.data_store.setdefault(0x3010, {})[1] = pulses.to_bytes(4, "little")
        self.node.add_write_callback(self._written)
        for k in range(PDOS):
            bus.network.subscribe(0x200 + 0x100 * k + node_id, self._receiver(k))
        bus.network.subscribe(0x80, self._sync)
        self.node.nmt.state = "PRE-OPERATIONAL"
        self._silence()

    def _silence(self) -> None:
        """Let a dead drive ignore its SDO requests."""
        respond = self.node.sdo.on_request
        callbacks = self.bus.network.subscribers[0x600 + self.node_id]
        callbacks.remove(respond)

        def answer(can_id: int, data: bytearray, timestamp: float) -> None:
            if not self.dead:
                respond(can_id, data, timestamp)

        callbacks.append(answer)

    def value(self, index: int, subindex: int = 0) -> int:
        """Return the value of an object."""
        value = self._values.get((index, subindex))
        if value is None:
            entry = self.node.object_dictionary[index]
            variable = entry if isinstance(entry, ODVariable) else entry[subindex]
            value = int(variable.decode_raw(self.node.get_data(index, subindex)))
            self._values[index, subindex] = value
        return value

    def watch(self) -> None:
        """Go to fault if the heartbeat of the controller is missing."""
        consumer = self.value(0x1016, 1)
        allowed = (consumer & 0xFFFF) / 1000
        if allowed and self.state == "enabled" and self.bus.clock.now() - self.heard > allowed:
            self._fail(HEARTBEAT_FAULT)

    def _put(self, index: int, value: int) -> None:
        if self._values.get((index, 0)) != value:
            encoded = self.node.object_dictionary[index].encode_raw(value)
            self.node.data_store.setdefault(index, {})[0] = encoded
            self._values[index, 0] = value

    def _mapped(self, communication: int, k: int) -> list[tuple[int, int]]:
        """Return index and bytes of the objects of a PDO, or nothing if it is disabled."""
        mapped = self._mappings.get((communication, k))
        if mapped is None:
            count = self.value(communication + 0x200 + k)
            entries = [self.value(communication + 0x200 + k, sub + 1) for sub in range(count)]
            mapped = [(entry >> 16, (entry & 0xFF) // 8) for entry in entries]
            if self.value(communication + k, 1) & DISABLED:
                mapped = []
            self._mappings[communication, k] = mapped
        return mapped

    def _receiver(self, k: int) -> Callable[[int, bytearray, float], None]:
        """Return the function that receives PDO k."""

        def receive(can_id: int, data: bytearray, timestamp: float) -> None:
            mapped = [] if self.dead else self._mapped(0x1400, k)
            if not mapped:
                return
            if len(data) != sum(size for _, size in mapped):
                self._fail(LENGTH_FAULT)
            elif self.value(0x1400 + k, 2) >= 254:
                self._take(mapped, bytes(data))
                self._report()
            else:
                self.waiting[k] = bytes(data)

        return receive

    def _take(self, mapped: list[tuple[int, int]], data: bytes) -> None:
        for index, size in mapped:
            self.node.data_store.setdefault(index, {})[0], data = data[:size], data[size:]
            self._values.pop((index, 0), None)
            if index == 0x6040:
                self._control(self.value(0x6040))
            if index == 0x6060:
                self._put(0x6061, self.value(0x6060))

    def _written(self, index: int, subindex: int, od: Any, data: bytes) -> None:
        """React to an object that the controller writes by SDO."""
        if index in READ_ONLY:
            raise canopen.SdoAbortedError(0x06010002)
        self._values.pop((index, subindex), None)
        self._mappings.clear()
        if index == 0x6060:
            self._put(0x6061, int(od.decode_raw(data)))
        if index == 0x1016 and subindex == 1:
            producer = 0x700 + (int(od.decode_raw(data)) >> 16)
            self.bus.network.subscribe(producer, self._hear)
            self.heard = self.bus.clock.now()
        if index == 0x6040:
            self._control(int(od.decode_raw(data)))
            self._report()

    def _hear(self, can_id: int, data: bytearray, timestamp: float) -> None:
        self.heard = self.bus.clock.now()

    def _control(self, word: int) -> None:
        """Change the state as the state machine of CiA 402 does. Bit 4 starts homing."""
        if self.state == "fault":
            if word & 0x80:
                self.state, self.fault = "disabled", 0
        elif not word & 0x02:
            self.state = "disabled"
        elif word & 0x0F == 0x06:
            self.state = "ready"
        elif word & 0x0F == 0x07 and self.state in ("ready", "enabled"):
            self.state = "switched on"
        elif word & 0x0F == 0x0F and self.state in ("ready", "switched on"):
            self.state = "enabled"
            self.was_enabled = True
            self.heard = self.bus.clock.now()
        homing = self.state == "enabled" and self.value(0x6061) == HOMING
        if homing and word & 0x10 and self.value(0x6098) == PRESENT_POSITION:
            self.position, self.homed = self.value(0x30B0), True

    def _report(self, synchronous: bool = False) -> None:
        """Send the status and the measurements whose PDOs are due."""
        homed = HOMED if self.homed and self.value(0x6061) == HOMING else 0
        values = {
            0x6041: STATES[self.state] | homed,
            0x603F: self.fault,
            0x6064: self.position,
            0x606C: self.speed,
            0x6077: self.torque,
        }
        for index, value in values.items():
            self._put(index, value)
        for k in range(PDOS):
            mapped = self._mapped(0x1800, k)
            if mapped and (self.value(0x1800 + k, 2) < 254) == synchronous and not self.dead:
                data = b"".join(self.node.get_data(index, 0)[:size] for index, size in mapped)
                self.bus.network.send_message(self.value(0x1800 + k, 1) & 0x7FF, data)

    def _sync(self, can_id: int, data: bytearray, timestamp: float) -> None:
        """Report the state at the SYNC, and move to the new target."""
        if self.dead:
            return
        self.watch()
        self._report(synchronous=True)
        for k in sorted(self.waiting):
            self._take(self._mapped(0x1400, k), self.waiting.pop(k))
        if self.state != "enabled" or self.value(0x6061) != CSP:
            return
        target = self.value(0x607A)
        fault = self._refused(target)
        if fault:
            self._fail(fault)
            return
        self.target = target
        self.speed, self.torque = self.value(0x60B1), self.value(0x60B2)
        self.received.append((target, self.speed, self.torque))
        self.position = self.follow(self.position, target)

    def _fail(self, fault: int) -> None:
        self.state, self.fault = "fault", fault
        self.speed = self.torque = 0
        self.node.emcy.send(fault, 0x21)
        self._report()

    def _refused(self, target: int) -> int:
        """Return the error code of a target that the drive cannot follow, or 0."""
        period = self.value(0x60C2, 1) * 10.0 ** self.value(0x60C2, 2)
        if not self.value(0x607D, 1) <= target <= self.value(0x607D, 2):
            return LIMIT_FAULT
        if abs(target - self.position) > self.value(0x6065):
            return LAG_FAULT
        rpm = abs(target - self.target) / period / (4 * self.pulses) * 60
        unit = 1e-3 if self.value(0x60A9) == MILLI_RPM else 1.0
        return SPEED_FAULT if rpm > self.value(0x607F) * unit else 0

"""Simulated CiA 402 drive in cyclic synchronous position mode on a virtual CAN bus.

The simulation covers the state machine, the limits and the faults. A client maps the PDOs by SDO.
The drive takes a setpoint at every SYNC. Like a real drive, it refuses a SYNC that does not come at
the interpolation period, and a target beyond the software limits. It also refuses a step above the
speed limit or the following-error window, and a PDO whose length differs from its mapping.
"""

from __future__ import annotations

import canopen
from canopen.objectdictionary import ODArray, ODRecord, ODVariable, datatypes

U8, U16, U32 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32
I8, I16, I32 = datatypes.INTEGER8, datatypes.INTEGER16, datatypes.INTEGER32
VARIABLES = {
    (0x1017, 0): ("Producer heartbeat time", U16, 0),
    (0x30B0, 0): ("Home position", I32, 0),
    (0x30B1, 0): ("Home offset move distance", I32, 0),
    (0x6040, 0): ("Controlword", U16, 0),
    (0x6041, 0): ("Statusword", U16, 0x0240),
    (0x6060, 0): ("Modes of operation", I8, 0),
    (0x6061, 0): ("Modes of operation display", I8, 0),
    (0x6064, 0): ("Position actual value", I32, 0),
    (0x6065, 0): ("Following error window", U32, 2000),
    (0x606C, 0): ("Velocity actual value", I32, 0),
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
    (0x6502, 0): ("Supported drive modes", U32, 0x03A0),
}
ARRAYS = {
    0x3001: ("Motor data", U32, (0, 0)),
    0x607D: ("Software position limit", I32, (-(2**31), 2**31 - 1)),
    0x60C2: ("Interpolation time period", I8, (1, -3)),
}
PDOS, MAPPED = 4, 8
READ_ONLY = 0x6076
HOMING, CSP = 6, 8
PRESENT_POSITION = 37
MILLI_RPM = 0xFDB44700
WINDOW = 40
"""Number of SYNCs over which their mean period is judged."""
STATES = {
    "disabled": 0x0240,
    "ready": 0x0221,
    "switched on": 0x0223,
    "enabled": 0x0227,
    "fault": 0x0208,
}
HOMED = 0x1400
PERIOD_FAULT, LIMIT_FAULT, SPEED_FAULT, LAG_FAULT, LENGTH_FAULT = (
    0x6320,
    0x8612,
    0x8402,
    0x8611,
    0x8210,
)
DISABLED = 1 << 31


def dictionary(node_id: int) -> canopen.ObjectDictionary:
    """Return the object dictionary of the drive. No PDO is mapped."""
    od = canopen.ObjectDictionary()
    od.node_id = node_id
    for (index, sub), (name, kind, default) in VARIABLES.items():
        od.add_object(_variable(name, index, sub, kind, default))
    for index, (name, kind, defaults) in ARRAYS.items():
        array = ODArray(name, index)
        for sub, default in enumerate((len(defaults), *defaults)):
            array.add_member(_variable(f"{name} {sub}", index, sub, kind if sub else U8, default))
        od.add_object(array)
    for k in range(PDOS):
        for base, cob_id in ((0x1400, 0x200), (0x1800, 0x180)):
            cob = DISABLED | (cob_id + 0x100 * k + node_id)
            _record(od, base + k, ((U8, 2), (U32, cob), (U8, 255)))
            _record(od, base + 0x200 + k, ((U8, 0), *((U32, 0),) * MAPPED))
    return od


def _variable(name: str, index: int, sub: int, kind: int, default: int) -> ODVariable:
    variable = ODVariable(name, index, sub)
    variable.data_type, variable.default, variable.access_type = kind, default, "rw"
    return variable


def _record(od: canopen.ObjectDictionary, index: int, members: tuple[tuple[int, int], ...]) -> None:
    record = ODRecord(f"PDO {index:X}", index)
    for sub, (kind, value) in enumerate(members):
        record.add_member(_variable(f"{index:X} sub {sub}", index, sub, kind, value))
    od.add_object(record)


class SimulatedDrive:
    """One drive on a virtual bus.

    `position` is the initial position in increments, and `rated_torque` is in µN·m.
    """

    counts_per_turn = 4096

    def __init__(self, channel: str, node_id: int, position: int, rated_torque: int) -> None:
        self.network = canopen.Network()
        self.network.connect(interface="virtual", channel=channel)
        self.node = canopen.LocalNode(node_id, dictionary(node_id))
        self.network.add_node(self.node)
        self.position, self.state, self.fault = position, "disabled", 0
        self.received: list[tuple[int, int, int]] = []
        """Target position, velocity offset and torque offset at every SYNC in state "enabled"."""
        self.syncs: list[float] = []
        self.waiting: dict[int, bytes] = {}
        """Data of synchronous PDOs since the last SYNC, by number of the PDO."""
        self.homed = False
        self._put(0x6064, position)
        self._put(READ_ONLY, rated_torque)
        self.node.add_write_callback(self._written)
        for k in range(PDOS):
            self.network.subscribe(
                0x200 + 0x100 * k + node_id, lambda _, data, __, k=k: self._pdo(k, bytes(data))
            )
        self.network.subscribe(0x80, self._sync)
        self.node.nmt.state = "PRE-OPERATIONAL"

    def close(self) -> None:
        self.network.disconnect()

    def value(self, index: int, sub: int = 0) -> int:
        entry = self.node.object_dictionary[index]
        variable = entry if isinstance(entry, ODVariable) else entry[sub]
        return int(variable.decode_raw(self.node.get_data(index, sub)))

    def _put(self, index: int, value: int) -> None:
        self.node.data_store.setdefault(index, {})[0] = self.node.object_dictionary[
            index
        ].encode_raw(value)

    def _mapped(self, communication: int, k: int) -> list[tuple[int, int]]:
        """Return index and size in bytes of the objects in a PDO. A disabled PDO is empty."""
        if self.value(communication + k, 1) & DISABLED:
            return []
        entries = [
            self.value(communication + 0x200 + k, sub + 1)
            for sub in range(self.value(communication + 0x200 + k))
        ]
        return [(entry >> 16, (entry & 0xFF) // 8) for entry in entries]

    def _pdo(self, k: int, data: bytes) -> None:
        mapped = self._mapped(0x1400, k)
        if not mapped:
            return
        if len(data) != sum(size for _, size in mapped):
            self._fail(LENGTH_FAULT)
        elif self.value(0x1400 + k, 2) >= 254:
            self._take(mapped, data)
            self._report()
        else:
            self.waiting[k] = data

    def _take(self, mapped: list[tuple[int, int]], data: bytes) -> None:
        for index, size in mapped:
            self.node.data_store.setdefault(index, {})[0], data = data[:size], data[size:]
            if index == 0x6040:
                self._control(self.value(0x6040))
            if index == 0x6060:
                self._put(0x6061, self.value(0x6060))

    def _written(self, index: int, subindex: int, od: ODVariable, data: bytes) -> None:
        if index == READ_ONLY:
            raise canopen.SdoAbortedError(0x06010002)
        if index == 0x6040:
            self._control(int(od.decode_raw(data)))
            self._report()

    def _control(self, word: int) -> None:
        """Apply the transitions of the CiA 402 state machine. Bit 4 starts homing."""
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
            self.syncs = []
        if self.state == "enabled" and word & 0x10 and self.value(0x6061) == HOMING:
            assert self.value(0x6098) == PRESENT_POSITION, "no other homing is simulated"
            self.position, self.homed = self.value(0x30B0), True

    def _report(self, synchronous: bool = False) -> None:
        self._put(
            0x6041,
            STATES[self.state] | (HOMED if self.homed and self.value(0x6061) == HOMING else 0),
        )
        self._put(0x6064, self.position)
        for k in range(PDOS):
            mapped = self._mapped(0x1800, k)
            if mapped and (self.value(0x1800 + k, 2) < 254) == synchronous:
                data = b"".join(self.node.get_data(index, 0)[:size] for index, size in mapped)
                self.network.send_message(self.value(0x1800 + k, 1) & 0x7FF, data)

    def _sync(self, can_id: int, data: bytes, timestamp: float) -> None:
        for k in sorted(self.waiting):
            self._take(self._mapped(0x1400, k), self.waiting.pop(k))
        if self.state == "enabled" and self.value(0x6061) == CSP:
            self.syncs.append(timestamp)
            target = self.value(0x607A)
            fault = self._refused(target)
            if fault:
                self._fail(fault)
            else:
                self.received.append((target, self.value(0x60B1), self.value(0x60B2)))
                self.position = target
        self._report(synchronous=True)

    def _fail(self, fault: int) -> None:
        self.state, self.fault = "fault", fault
        self.node.emcy.send(fault, 0x21)
        self._report()

    def _refused(self, target: int) -> int:
        period = self.value(0x60C2, 1) * 10.0 ** self.value(0x60C2, 2)
        if len(self.syncs) > WINDOW:
            mean = (self.syncs[-1] - self.syncs[-1 - WINDOW]) / WINDOW
            if not 0.5 < mean / period < 50:  # The host may stall, but it does not run ahead.
                return PERIOD_FAULT
        if not self.value(0x607D, 1) <= target <= self.value(0x607D, 2):
            return LIMIT_FAULT
        step = abs(target - self.position)
        if step > self.value(0x6065):
            return LAG_FAULT
        rpm = step / period / self.counts_per_turn * 60
        unit = 1e-3 if self.value(0x60A9) == MILLI_RPM else 1.0
        return SPEED_FAULT if rpm > self.value(0x607F) * unit else 0

"""A CiA 402 drive in cyclic synchronous position mode on a virtual CAN bus: its state machine, its limits, its faults.

It takes a setpoint at every SYNC and refuses what a real drive refuses: a SYNC that does not come at the interpolation
period, a target beyond the software limits, a step larger than the speed limit or the following-error window.
"""

from __future__ import annotations

import canopen
from canopen.objectdictionary import ODArray, ODRecord, ODVariable, datatypes

U8, U16, U32 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32
I8, I16, I32 = datatypes.INTEGER8, datatypes.INTEGER16, datatypes.INTEGER32
VARIABLES = {
    (0x1017, 0): ("Producer heartbeat time", U16, 0),
    (0x6040, 0): ("Controlword", U16, 0),
    (0x6041, 0): ("Statusword", U16, 0x0240),
    (0x6060, 0): ("Modes of operation", I8, 0),
    (0x6061, 0): ("Modes of operation display", I8, 0),
    (0x6064, 0): ("Position actual value", I32, 0),
    (0x6065, 0): ("Following error window", U32, 2000),
    (0x6072, 0): ("Max torque", U16, 1000),
    (0x6076, 0): ("Motor rated torque", U32, 0),
    (0x607A, 0): ("Target position", I32, 0),
    (0x607F, 0): ("Max profile velocity", U32, 50_000),
    (0x6080, 0): ("Max motor speed", U32, 50_000),
    (0x60A9, 0): ("SI unit velocity", U32, 0x00B44700),
    (0x60B1, 0): ("Velocity offset", I32, 0),
    (0x60B2, 0): ("Torque offset", I16, 0),
    (0x60C5, 0): ("Max acceleration", U32, 10_000),
    (0x6502, 0): ("Supported drive modes", U32, 0x0380),
}
ARRAYS = {
    0x607D: ("Software position limit", I32, (-(2**31), 2**31 - 1)),
    0x60C2: ("Interpolation time period", I8, (1, -3)),
}
RECEIVED = ((0x6040, 16), (0x6060, 8), (0x60B2, 16)), ((0x607A, 32), (0x60B1, 32))
SENT = (((0x6041, 16), (0x6061, 8), (0x6064, 32)),)
READ_ONLY = 0x6076
CSP = 8
MILLI_RPM = 0xFDB44700
WINDOW = 40
"""SYNCs over which their period is judged."""
STATES = {"disabled": 0x0240, "ready": 0x0221, "switched on": 0x0223, "enabled": 0x0227, "fault": 0x0208}
PERIOD_FAULT, LIMIT_FAULT, SPEED_FAULT, LAG_FAULT = 0x6320, 0x8612, 0x8402, 0x8611


def dictionary(node_id: int) -> canopen.ObjectDictionary:
    """The object dictionary of the drive, built in code; transmission type 255, so that nothing waits for a SYNC."""
    od = canopen.ObjectDictionary()
    od.node_id = node_id
    for (index, sub), (name, kind, default) in VARIABLES.items():
        od.add_object(_variable(name, index, sub, kind, default))
    for index, (name, kind, defaults) in ARRAYS.items():
        array = ODArray(name, index)
        for sub, default in enumerate((len(defaults), *defaults)):
            array.add_member(_variable(f"{name} {sub}", index, sub, kind if sub else U8, default))
        od.add_object(array)
    for k, mapped in enumerate(RECEIVED):
        _pdo(od, 0x1400 + k, 0x1600 + k, 0x200 + 0x100 * k + node_id, mapped)
    for k, mapped in enumerate(SENT):
        _pdo(od, 0x1800 + k, 0x1A00 + k, 0x180 + 0x100 * k + node_id, mapped)
    return od


def _variable(name: str, index: int, sub: int, kind: int, default: int) -> ODVariable:
    variable = ODVariable(name, index, sub)
    variable.data_type, variable.default, variable.access_type = kind, default, "rw"
    return variable


def _pdo(
    od: canopen.ObjectDictionary, com: int, mapping: int, cob_id: int, mapped: tuple[tuple[int, int], ...]
) -> None:
    record = ODRecord(f"PDO communication {com:X}", com)
    for sub, (kind, value) in enumerate(((U8, 2), (U32, cob_id), (U8, 255))):
        record.add_member(_variable(f"{com:X} sub {sub}", com, sub, kind, value))
    od.add_object(record)
    array = ODRecord(f"PDO mapping {mapping:X}", mapping)
    entries = [len(mapped), *((index << 16) | size for index, size in mapped)]
    for sub, value in enumerate(entries):
        array.add_member(_variable(f"{mapping:X} sub {sub}", mapping, sub, U32 if sub else U8, value))
    od.add_object(array)


class SimulatedDrive:
    """One drive on a virtual bus; `position`: where it stands, increments; rated torque in µN·m."""

    def __init__(self, channel: str, node_id: int, position: int, rated_torque: int) -> None:
        self.network = canopen.Network()
        self.network.connect(interface="virtual", channel=channel)
        self.node = canopen.LocalNode(node_id, dictionary(node_id))
        self.network.add_node(self.node)
        self.position, self.state, self.fault = position, "disabled", 0
        self.received: list[tuple[int, int, int]] = []
        """(target position, velocity offset, torque offset) at every SYNC while enabled."""
        self.syncs: list[float] = []
        self.enabled = False
        self._put(0x6064, position)
        self._put(READ_ONLY, rated_torque)
        self.node.add_write_callback(self._written)
        for pdo in (self.node.rpdo, self.node.tpdo):
            pdo.read()
        for pdo in self.node.rpdo.values():
            pdo.add_callback(self._pdo_received)
        self.network.subscribe(0x80, self._sync)
        self.node.nmt.state = "PRE-OPERATIONAL"

    def close(self) -> None:
        self.network.disconnect()

    def value(self, index: int, sub: int = 0) -> int:
        entry = self.node.object_dictionary[index]
        variable = entry if isinstance(entry, ODVariable) else entry[sub]
        return int(variable.decode_raw(self.node.get_data(index, sub)))

    def _put(self, index: int, value: int) -> None:
        self.node.data_store.setdefault(index, {})[0] = self.node.object_dictionary[index].encode_raw(value)

    def _pdo_received(self, pdo: canopen.pdo.PdoMap) -> None:
        for variable in pdo:
            self._put(variable.index, variable.raw)
            if variable.index == 0x6040:
                self._control(int(variable.raw))
            if variable.index == 0x6060:
                self._put(0x6061, int(variable.raw))
        self._report()

    def _written(self, index: int, subindex: int, od: ODVariable, data: bytes) -> None:
        if index == READ_ONLY:
            raise canopen.SdoAbortedError(0x06010002)
        if index == 0x6040:
            self._control(int(od.decode_raw(data)))
            self._report()

    def _control(self, word: int) -> None:
        """Transitions of the CiA 402 state machine."""
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

    def _report(self) -> None:
        self._put(0x6041, STATES[self.state])
        self._put(0x6064, self.position)
        pdo = self.node.tpdo[1]
        for variable in pdo:
            variable.raw = self.value(variable.index)
        pdo.transmit()

    def _sync(self, can_id: int, data: bytes, timestamp: float) -> None:
        if self.state != "enabled" or self.value(0x6061) != CSP:
            return
        self.syncs.append(timestamp)
        target = self.value(0x607A)
        fault = self._refused(target)
        if fault:
            self.state, self.fault = "fault", fault
            self.node.emcy.send(fault, 0x21)
        else:
            self.received.append((target, self.value(0x60B1), self.value(0x60B2)))
            self.position = target
        self._report()

    def _refused(self, target: int) -> int:
        period = self.value(0x60C2, 1) * 10.0 ** self.value(0x60C2, 2)
        if len(self.syncs) > WINDOW:
            mean = (self.syncs[-1] - self.syncs[-1 - WINDOW]) / WINDOW
            if not 0.5 < mean / period < 50:  # the host may stall, but does not run ahead
                return PERIOD_FAULT
        if not self.value(0x607D, 1) <= target <= self.value(0x607D, 2):
            return LIMIT_FAULT
        step = abs(target - self.position)
        if step > self.value(0x6065):
            return LAG_FAULT
        rpm = step / period / self.counts_per_turn * 60
        unit = 1e-3 if self.value(0x60A9) == MILLI_RPM else 1.0
        return SPEED_FAULT if rpm > self.value(0x607F) * unit else 0

    counts_per_turn = 4096

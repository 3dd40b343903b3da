"""What a given set of motors and gears allows: the largest payload at the tip, the shortest duration of a motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ssm_planner.problem.motor import Motor
from ssm_planner.sizing.assess import CONFIDENCE, assess
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import Conditions

HEAVIEST = 50.0
"""kg at the tip; motors that carry more are not what limits a surgical tool."""
SLOWEST, FASTEST = 1e3, 1e-3
"""Factors on the duration between which an answer is looked for."""
HALVINGS = 16


@dataclass(frozen=True)
class WhatIf:
    """status: "found", "never" (the motors do not suffice for any value) or "unlimited" (nothing checked binds).

    value: kg, or factor on the duration; None unless found. joint, binds: what would be exceeded first beyond it.
    """

    status: str
    value: float | None
    joint: str | None
    binds: str | None
    not_checked: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        return {
            "status": self.status,
            "value": self.value,
            "joint": self.joint,
            "binds": self.binds,
            "not_checked": list(self.not_checked),
        }


def largest_payload(
    duty: DutyCycle, motors: Mapping[str, Motor], conditions: Conditions, payload: float = 0.0
) -> WhatIf:
    """The heaviest point mass at the tip, beside `payload` (kg), with which every check that can be made still passes."""
    empty, loaded = duty.loads(payload), duty.loads(payload + 1.0)

    def judge(mass: float) -> _Judgement:
        return _judge([a.plus(b, mass) for a, b in zip(empty, loaded, strict=True)], motors, conditions)

    return _largest(judge, start=1e-3, most=HEAVIEST, least=0.0)


def shortest_duration(
    duty: DutyCycle, motors: Mapping[str, Motor], conditions: Conditions, payload: float = 0.0
) -> WhatIf:
    """The smallest factor on the duration, all of the motion faster alike, with which every check made still passes.

    The joints' own limits of speed and acceleration are left aside.
    """

    loads = duty.loads(payload)

    def judge(speed: float) -> _Judgement:
        return _judge([load.stretched(1.0 / speed) for load in loads], motors, conditions)

    found = _largest(judge, start=1.0, most=1.0 / FASTEST, least=1.0 / SLOWEST)
    return replace(found, value=None if found.value is None else 1.0 / found.value)


@dataclass(frozen=True)
class _Judgement:
    margin: float
    joint: str | None
    binds: str | None
    not_checked: tuple[str, ...]


def _judge(loads: Sequence[JointLoad], motors: Mapping[str, Motor], conditions: Conditions) -> _Judgement:
    """The smallest margin of all checks that can be made."""
    worst: tuple[float, str | None, str | None] = (float("inf"), None, None)
    missing = []
    for load in loads:
        motor = motors.get(load.joint, load.motor)
        if motor is None:
            missing.append(f"{load.joint}: a motor")
            continue
        verdict = assess(load, motor, conditions)
        for check in (*verdict.checks, *verdict.gear):
            if check.margin is None:
                missing.append(f"{load.joint}: {check.name}")
            elif check.name != CONFIDENCE:
                worst = min(worst, (check.margin, load.joint, check.name), key=lambda each: each[0])
    return _Judgement(*worst, tuple(missing))


def _largest(judge: Callable[[float], _Judgement], start: float, most: float, least: float) -> WhatIf:
    """Largest value up to which no margin is negative: doubled or halved from `start`, then bisected."""
    at = judge(start)
    low, high = start, start
    if at.margin < 0:
        while at.margin < 0:
            high, failed = low, at
            if low <= least:
                return WhatIf("never", None, at.joint, at.binds, at.not_checked)
            low = low / 2 if least > 0 or low > start / 64 else 0.0
            low = max(low, least)
            at = judge(low)
    else:
        while at.margin >= 0:
            low = high
            if high >= most:
                return WhatIf("unlimited", None, None, None, at.not_checked)
            high = min(2 * high, most)
            at = judge(high)
        failed = at
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        at = judge(middle)
        if at.margin < 0:
            high, failed = middle, at
        else:
            low = middle
    return WhatIf("found", low, failed.joint, failed.binds, failed.not_checked)

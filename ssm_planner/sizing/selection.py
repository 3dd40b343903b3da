"""Assess every motor with every gear of a catalogue on every joint, by operations on arrays.

The answers equal those of `assess` for each pair. A rotor only adds J·ẇ to the motor torque, so the
torque of a gear is evaluated once for all motors. Two bounds on the winding temperature decide most
pairs. The function `assess` decides the other pairs, and all pairs whose friction is random.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ssm_planner.dynamics import RigidBody, drive_with, with_payload
from ssm_planner.loading import Part
from ssm_planner.problem import Drive, Motor
from ssm_planner.sizing.assess import (
    CONFIDENCE,
    MotorVerdict,
    assess,
    gear_case,
    limits_of,
    motor_friction,
    shaft_inertia,
    with_motor,
)
from ssm_planner.sizing.checks import TOLERANCE, Check, gear_checks, margin_of
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.heat_check import heat_of
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import (
    Conditions,
    missing,
    require_value,
    resistance,
    torque_constant,
    voltage_factors,
)
from ssm_planner.sizing.thermal_network import FIGURES, Modes, ThermalModel
from ssm_planner.typing import Array, Arrays, JsonObject, Keywords, Mask, record

Rank = Literal["mass", "length", "torque", "margin"]
RANKS: tuple[Rank, ...] = get_args(Rank)
Answers = NDArray[np.int8]
"""Answers (gears, motors): 1 means passed, 0 not known, and −1 failed."""
ANSWERS = {True: 1, None: 0, False: -1}
"""Numbers that represent the answers of checks."""
MARGINS = ("torque", "speed", "continuous_torque", "voltage")
NEAR = 0.01
"""Margin of the temperature bounds, K. Pairs that are closer to the limit are left to `assess`."""
RISES = 50
"""Number of temperatures at which thermal runaway is checked."""
INSTANTS = 200
"""Number of instants of each motion at which the inertia of the load is evaluated."""


@record
class JointSelection:
    """The assessment of every motor (m) with every gear (g) on one joint."""

    load: JointLoad
    conditions: Conditions
    motors: Sequence[Part[Motor]]
    gears: Sequence[Part[Drive]]
    answers: Mapping[str, Answers]
    """Answers by name of the check.

    The answer for heat is 0 if it was not evaluated because another check fails.
    """
    margins: Mapping[str, Array]
    """Margins (gears, motors) by name of the check. NaN if data are missing."""
    of_gear: Sequence[tuple[Check, ...]]
    """Checks of each gear."""
    load_inertia: float
    """Largest inertia of the moved bodies about the joint's axis, kg·m² or kg."""

    @property
    def adequate(self) -> Answers:
        """Answers for each pair, equal to `MotorVerdict.adequate`."""
        gear = [
            min(part.of.placeholders == (), *(ANSWERS[check.passed] for check in checks))
            for part, checks in zip(self.gears, self.of_gear, strict=True)
        ]
        return np.minimum(self._of_motors, np.array(gear, np.int8)[:, None])

    @property
    def _of_motors(self) -> Answers:
        """Answers for each pair by the checks of its motor alone."""
        answers = np.min(list(self.answers.values()), axis=0)
        is_stated = [not part.of.placeholder for part in self.motors]
        return np.minimum(answers, np.array(is_stated, np.int8))

    def checks_with(self, answer: int, g: int, m: int) -> list[str]:
        """Return the names of the checks of a pair that have an answer: 1, 0 or −1."""
        motor = [name for name, answers in self.answers.items() if answers[g, m] == answer]
        return motor + [c.name for c in self.of_gear[g] if ANSWERS[c.passed] == answer]

    def ranked(self, by: Rank = "mass") -> list[tuple[int, int]]:
        """Return the pairs (gear, motor) that no check rules out.

        Adequate pairs come first. Pairs whose motor passes all its own checks come next, so that
        only figures of the gear are open. Each group is sorted by rank. Pairs for which the
        quantity of the rank is not known are last in their group.
        """
        adequate = self.adequate
        of_motors = self._of_motors
        key = self._key(by)
        nominal = [candidate.of.nominal_torque for candidate in self.motors]
        return sorted(
            ((int(g), int(m)) for g, m in np.argwhere(adequate >= 0)),
            key=lambda pair: (
                -adequate[pair],
                -of_motors[pair],
                key[pair],
                nominal[pair[1]],
                pair,
            ),
        )

    def _key(self, by: Rank) -> Array:
        """Return the sort key (gears, motors) of a rank. Pairs with small keys come first.

        The key is infinite if a part does not state the quantity. A quantity that no gear states
        does not distinguish gears, and motors alone determine the key.
        """
        if by == "margin":
            return np.nan_to_num(-np.min(list(self.margins.values()), axis=0), nan=np.inf)
        if by == "torque":
            motor, gear = ([part.of.nominal_torque for part in self.motors], [])
        else:
            motor, gear = (
                [getattr(part, by) for part in parts] for parts in (self.motors, self.gears)
            )
        if not any(gear):
            gear = [0.0] * len(self.gears)
        sizes = (np.array(values, dtype=float) for values in (gear, motor))
        return np.nan_to_num(np.add.outer(*sizes), nan=np.inf)

    def verdict(self, g: int, m: int) -> MotorVerdict:
        """Assess one pair by `assess`, which computes all margins and the temperatures."""
        return assess(
            replace(self.load, drive=self.gears[g].of), self.motors[m].of, self.conditions
        )

    def reasons(self) -> dict[str, int]:
        """Return the number of pairs that each check rules out, in descending order.

        A pair counts for each of its failed checks.
        """
        failed = (name for row in self._table(-1) for names in row for name in names)
        counts = Counter(failed).items()
        return dict(sorted(counts, key=lambda item: (-item[1], item[0])))

    def inertia_ratio(self, g: int, m: int) -> float | None:
        """Return the inertia of load and gear at the motor shaft divided by that of the rotor.

        None if the inertia of the rotor is not stated.
        """
        motor = self.motors[m].of
        drive = self.gears[g].of
        if motor.rotor_inertia is None:
            return None
        shaft = shaft_inertia(replace(self.load, drive=drive), motor)[1] - motor.rotor_inertia
        return (
            shaft + (self.load_inertia + drive.output_inertia) / drive.ratio**2
        ) / motor.rotor_inertia

    def to_dict(self, rank: Rank, count: int) -> JsonObject:
        """Return an entry of `selection` in the output of `size --json`, in SI units.

        The entry `best` contains the full description of the first `count` pairs.
        """
        adequate = self.adequate
        as_json = {1: True, 0: None, -1: False}
        return {
            "joint": self.load.joint,
            "motors": [candidate.label for candidate in self.motors],
            "gears": [candidate.label for candidate in self.gears],
            "adequate": [[as_json[int(answer)] for answer in row] for row in adequate],
            "ruled_out_by": self._table(-1),
            "open": self._table(0),
            "reasons": self.reasons(),
            "rank": rank,
            "best": [self.pair_dict(g, m) for g, m in self.ranked(rank)[:count]],
        }

    def _table(self, answer: int) -> list[list[list[str]]]:
        """Return the checks that give each pair (gears, motors) an answer, which is −1 or 0.

        The list of a pair with another answer is empty.
        """
        adequate = self.adequate
        return [
            [
                self.checks_with(answer, g, m) if adequate[g, m] == answer else []
                for m in range(len(self.motors))
            ]
            for g in range(len(self.gears))
        ]

    def pair_dict(self, g: int, m: int) -> JsonObject:
        """Return the full description of one pair."""
        motor = self.motors[m]
        gear = self.gears[g]
        verdict = self.verdict(g, m)
        return {
            **verdict.to_dict(),
            "motor": motor.label,
            "gear": gear.label,
            "mass": motor.mass,
            "gear_mass": gear.mass,
            "length": motor.length,
            "inertia_ratio": self.inertia_ratio(g, m),
            "energy_to_bus": energy_to_bus(verdict.load, motor.of),
        }


def select(
    duty: DutyCycle,
    motors: Sequence[Part[Motor]],
    gears: Mapping[str, Sequence[Part[Drive]]],
    conditions: Conditions | None = None,
    payload: float = 0.0,
) -> tuple[JointSelection, ...]:
    """Assess every motor with every gear on every joint that a duty cycle moves.

    Parameters
    ----------
    duty
        Motions of one robot.
    motors
        Candidate motors.
    gears
        Candidate gears by joint. A joint without an entry keeps its present drive.
    conditions
        Operating conditions. The default is `Conditions()`.
    payload
        Point mass at the tip, kg.

    Returns
    -------
    tuple of JointSelection
        One entry for each load of the duty cycle.
    """
    conditions = conditions or Conditions()
    inertias = load_inertias(duty, payload)
    return tuple(
        select_joint(
            load,
            motors,
            gears.get(load.joint) or [Part(load.drive.name, load.drive)],
            conditions,
            inertias[load.joint],
        )
        for load in duty.loads(payload)
    )


def load_inertias(duty: DutyCycle, payload: float = 0.0) -> dict[str, float]:
    """Return the largest diagonal entries of the mass matrix by joint, kg·m² or kg."""
    body = RigidBody.from_robot(with_payload(duty.robot, payload))
    q = np.concatenate(
        [run.sample(np.linspace(0, run.duration, INSTANTS)).q for run, _ in duty.runs]
    )
    diagonal = np.max([np.diag(matrix) for matrix in body.mass_matrix(q)], axis=0)
    return dict(zip((joint.name for joint in duty.robot.joints), map(float, diagonal), strict=True))


def energy_to_bus(load: JointLoad, motor: Motor) -> float | None:
    """Return the energy that the braking motor returns to its supply in one motion at 25 °C, J.

    The energy is ∫ max(−(R·I² + τ·w), 0) dt. The result is None if the motor file does not state
    the torque constant or the resistance.
    """
    if missing(motor, "torque_constant", "terminal_resistance"):
        return None
    torque = load.torque()
    power = resistance(motor) * np.square(torque / torque_constant(motor)) + torque * load.speed()
    return float(load.duration * (load.weight @ np.maximum(-power, 0.0)))


def select_joint(
    load: JointLoad,
    motors: Sequence[Part[Motor]],
    gears: Sequence[Part[Drive]],
    conditions: Conditions,
    inertia: float = math.nan,
) -> JointSelection:
    """Assess every motor with every gear on one joint.

    `inertia` is the largest inertia of the moved bodies about the joint's axis, kg·m² or kg.
    """
    fleet = _Fleet(
        [candidate.of for candidate in motors], conditions, load.duration + conditions.pause
    )
    rows = [_assess_gear(replace(load, drive=gear.of), fleet, conditions) for gear in gears]
    answers, margins, of_gear = zip(*rows, strict=True)
    return JointSelection(
        load,
        conditions,
        motors,
        gears,
        {name: np.stack([answer[name] for answer in answers]) for name in answers[0]},
        margins={name: np.stack([margin[name] for margin in margins]) for name in MARGINS},
        of_gear=of_gear,
        load_inertia=inertia,
    )


class _Fleet:
    """Data of all motors (m) that the checks need, as arrays (m,)."""

    def __init__(self, motors: Sequence[Motor], conditions: Conditions, period: float) -> None:
        self.motors = motors
        self.limits = [limits_of(motor, conditions, 1.0, None) for motor in motors]
        self.max_speed = np.array([motor.max_speed for motor in motors])
        self.balance = np.array([voltage_factors(motor) for motor in motors])
        self.cool, self.hot = np.array([_certain(motor, conditions, period) for motor in motors]).T

    def limit(self, name: str) -> Array:
        """Return the limits (m,) of a check. NaN if not known."""
        bounds = (limits[name][2] for limits in self.limits)
        return np.array([np.nan if limit is None else limit for limit in bounds])


def _certain(motor: Motor, conditions: Conditions, period: float) -> tuple[float, float]:
    """Return an RMS torque below which heat certainly passes, and one above which it fails.

    Both are in N·m and apply to any motion that repeats with `period` (s). They are NaN if thermal
    data are missing. The winding temperature responds to power by two decaying modes with positive
    amplitudes, and the loss grows with the temperature. The temperature is highest if all power of
    a period occurs at one instant, at the resistance of the hottest permitted winding. This gives
    the first torque. The second torque follows from the smallest response to a mean power, at the
    coldest instant, and from the loss at this temperature, which is the smallest possible loss.
    """
    if missing(motor, *FIGURES):
        return np.nan, np.nan
    model = ThermalModel.from_motor(motor, conditions.ambient)
    limit = require_value(motor, "max_winding_temperature")
    allowed = limit - model.ambient
    if allowed <= 2 * NEAR:
        return -1.0, np.inf
    modes = Modes.from_network(
        model.r_winding_housing, model.r_housing_ambient, model.c_winding, model.c_housing
    )
    shares = modes.input * modes.shape[0] / -modes.rates
    x = -modes.rates * period
    # Beyond 700, e^x overflows, and the remaining heat of a period is negligible.
    highest = float(shares @ (x / -np.expm1(-x)))
    lowest = float(shares @ (x / np.expm1(np.minimum(x, 700.0))))
    # Mean squares at which the coldest instant has each temperature up to the one that corresponds
    # to a mean at the limit.
    rise = (allowed + NEAR) * lowest / float(shares.sum()) * np.linspace(0.01, 1.0, RISES)
    unit = np.ones(RISES)
    passes = (allowed - NEAR) / (highest * model.power(unit, limit * unit)[0][0])
    fails = 1.001 * np.max(rise / (lowest * model.power(unit, model.ambient + rise)[0]))
    return float(np.sqrt(passes)), float(np.sqrt(fails))


Row = tuple[dict[str, Answers], Arrays, tuple[Check, ...]]
"""Answers (m,) and margins (m,) of one gear with all motors, and the checks of the gear."""


def _assess_gear(load: JointLoad, fleet: _Fleet, conditions: Conditions) -> Row:
    """Assess all motors with the gear in `load.drive`."""
    case = gear_case(load, conditions)
    spread = case.spread
    gear = gear_checks(case)
    speed = margin_of(load.peak_speed, fleet.max_speed)
    if spread.names:
        return _assess_by_draws(load, fleet, conditions, gear, speed)
    ends = np.array([(shaft_inertia(load, x), motor_friction(load.motor, x)) for x in fleet.motors])
    highest, lowest = _bands(load, [dict(corner) for corner in spread.corners()], ends, fleet)
    answers = {"speed": _answer(speed, speed)}
    margins = {"speed": speed}
    share = float(np.sqrt(load.duration / (load.duration + conditions.pause)))
    limited = {
        "torque": ("peak", 1.0),
        "continuous_torque": ("rms", share),
        "voltage": ("volts", 1.0),
    }
    for name, (demand, factor) in limited.items():
        limit = fleet.limit(name)
        margins[name] = margin_of(factor * highest[demand], limit)
        answers[name] = _answer(margins[name], margin_of(factor * lowest[demand], limit))
    fails = np.min(list(answers.values()), axis=0) < 0
    fails |= any(check.passed is False for check in gear)
    answers["heat"] = _heat(
        load, fleet, conditions, band=(share * highest["rms"], share * lowest["rms"]), fails=fails
    )
    combined = np.min([answers[name] for name in (*limited, "heat")], axis=0)
    answers[CONFIDENCE] = combined if spread.is_stated else 0 * combined
    return answers, margins, gear


def _assess_by_draws(
    load: JointLoad, fleet: _Fleet, conditions: Conditions, gear: tuple[Check, ...], speed: Array
) -> Row:
    """Assess the pairs one by one if draws describe the friction.

    Motors that are too slow and gears that fail are not assessed further.
    """
    count = len(fleet.motors)
    names = (*MARGINS, "heat", CONFIDENCE)
    answers = {name: np.zeros(count, np.int8) for name in names} | {"speed": _answer(speed, speed)}
    margins = {name: np.full(count, np.nan) for name in MARGINS} | {"speed": speed}
    if any(check.passed is False for check in gear):
        return answers, margins, gear
    for m in np.flatnonzero(answers["speed"] > 0).tolist():
        for check in assess(load, fleet.motors[m], conditions).checks:
            answers[check.name][m] = ANSWERS[check.passed]
            if check.name in margins and check.margin is not None:
                margins[check.name][m] = check.margin
    return answers, margins, gear


def _bands(
    load: JointLoad, corners: Sequence[Keywords], ends: Array, fleet: _Fleet
) -> tuple[Arrays, Arrays]:
    """Return the largest and smallest demands of every motor, each as arrays (m,) by name.

    `ends` (m, 2, 2) contains the smallest and largest inertia (kg·m²) of each motor's shaft, and
    the least and largest friction torque (N·m) of the motor. The torque is linear in both.
    """
    turning = load.acceleration() * (load.direction != 0)
    inertias, friction = ends[:, 0], ends[:, 1]
    demands = []
    for corner in corners:
        drive = drive_with(load.drive, {**corner, "input_inertia": 0.0})
        parts = np.stack([replace(load, drive=drive).torque(), turning, load.direction])
        products = parts * load.weight @ parts.T
        for inertia in np.unique(inertias, axis=1).T:
            factors = np.stack([np.ones(len(inertia)), inertia, friction[:, 1]], axis=1)
            rms = np.sqrt(np.maximum(np.sum(factors @ products * factors, axis=1), 0.0))
            demands.append([*_peaks(parts, factors, load.speed(), fleet), rms])
    peak, volts, rms = np.max(demands, axis=0)
    low_peak, low_volts, low_rms = np.min(demands, axis=0)
    # The demands are convex in the inertia, so between its ends they fall by at most half of its
    # width times |ẇ|. The friction changes them at most by the width of its range.
    half_width = np.diff(inertias)[:, 0] / 2
    width = np.diff(friction)[:, 0]
    wd = np.abs(load.acceleration())
    low_peak = low_peak - half_width * wd.max() - width
    low_rms = low_rms - half_width * float(load.rms(wd)) - width
    low_volts = low_volts - (half_width * wd.max() + width) * fleet.balance[:, 1, 0]
    lowest = {"peak": low_peak, "volts": low_volts, "rms": low_rms}
    return {"peak": peak, "volts": volts, "rms": rms}, {
        name: np.maximum(low, 0.0) for name, low in lowest.items()
    }


def _peaks(parts: Array, factors: Array, speed: Array, fleet: _Fleet) -> tuple[Array, Array]:
    """Return the peak torques and voltages (m,) of motors with the torques factors @ parts.

    `parts` (3, n) contains the torque without rotor, the motor acceleration, and the direction.
    `factors` (m, 3) contains 1, the inertia of the shaft, and the friction torque of the motor.
    """
    peak = np.empty(len(factors))
    volts = np.empty(len(factors))
    for m, factor in enumerate(factors):
        torque = factor @ parts
        peak[m] = max(torque.max(), -torque.min())
        volts[m] = np.abs(fleet.balance[m] @ np.stack([torque, speed])).max()
    return peak, volts


def _heat(
    load: JointLoad,
    fleet: _Fleet,
    conditions: Conditions,
    band: tuple[Array, Array],
    fails: Mask,
) -> Answers:
    """Return the answers (m,) of the thermal check.

    `band` contains the largest and the smallest RMS torque over motion and pause. An answer is 0 if
    the temperature bounds do not decide it and the motor `fails` another check.
    """
    highest, lowest = band
    answers = np.where(highest <= fleet.cool, 1, np.where(lowest > fleet.hot, -1, 0)).astype(
        np.int8
    )
    open_ = (
        (answers == 0)
        & ~fails
        & np.isfinite(fleet.cool)
        & ~((highest > fleet.hot) & (lowest <= fleet.cool))
    )
    for m in np.flatnonzero(open_).tolist():
        motor = fleet.motors[m]
        heat = heat_of(with_motor(load, motor)[0], motor, conditions, highest[m])
        if heat is not None:
            limit = np.array(heat.capacity)
            answers[m] = _answer(margin_of(highest[m], limit), margin_of(lowest[m], limit))
    return answers


def _answer(highest_margin: Array, lowest_margin: Array) -> Answers:
    """Return answers equal to `Check.passed` for the margins at both ends of the uncertain data."""
    return np.where(
        highest_margin >= -TOLERANCE, 1, np.where(lowest_margin < -TOLERANCE, -1, 0)
    ).astype(np.int8)

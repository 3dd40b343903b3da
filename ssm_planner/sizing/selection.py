"""Every motor with every gear of a catalogue on every joint, in one pass over arrays.

Equal, pair by pair, to `assess`. A rotor only adds J·ẇ to the motor torque, so a gear's torque is evaluated once and the
motors are rows of a matrix. Of the winding's temperature two bounds decide most pairs; `assess` decides the others, and all
that need draws of the friction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ssm_planner.dynamics.rigid_body import RigidBody, with_payload
from ssm_planner.dynamics.spread import drawn, spread_of
from ssm_planner.loading.catalogues import Part
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motor import Motor
from ssm_planner.sizing.assess import (
    CONFIDENCE,
    MotorVerdict,
    assess,
    band_of,
    limits_of,
    shaft_inertia,
    with_rotor,
)
from ssm_planner.sizing.checks import TOLERANCE, Case, Check, gear_checks
from ssm_planner.sizing.demand import ELECTRICAL, volts_per_torque
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.heat_check import heat_of
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import (
    REFERENCE_TEMPERATURE,
    Conditions,
    figure,
    missing,
    resistance,
    torque_constant,
)
from ssm_planner.sizing.thermal_network import FIGURES, Modes, ThermalModel
from ssm_planner.typing import Array

Rank = Literal["mass", "length", "torque", "margin"]
RANKS: tuple[Rank, ...] = ("mass", "length", "torque", "margin")
Answers = NDArray[np.int8]
"""(gears, motors): 1 holds, 0 not known, −1 fails."""
MARGINS = ("torque", "speed", "continuous_torque", "voltage")
NEAR = 0.01
"""K; what the bounds of the temperature leave closer to the limit, `assess` decides."""
RISES = 50
"""Temperatures at which a runaway is looked for."""
INSTANTS = 200
"""Of each motion, at which the load's inertia is looked at."""


@dataclass(frozen=True, eq=False)
class JointSelection:
    """Every motor (m) with every gear (g) on one joint."""

    load: JointLoad
    conditions: Conditions
    motors: Sequence[Part[Motor]]
    gears: Sequence[Part[Drive]]
    answers: Mapping[str, Answers]
    """Of the motor's checks, by name; heat is 0 where it was not needed, another check fails."""
    margins: Mapping[str, Array]
    """(gears, motors) each; NaN where a figure is missing."""
    of_gear: Sequence[tuple[Check, ...]]
    load_inertia: float
    """Largest inertia of the moved bodies about the joint's axis, kg·m² or kg."""

    @property
    def adequate(self) -> Answers:
        """As `MotorVerdict.adequate` says of each pair."""
        worst = np.min(list(self.answers.values()), axis=0)
        fails = np.array(
            [any(check.passed is False for check in checks) for checks in self.of_gear]
        )
        return np.where(fails[:, None], np.int8(-1), worst)

    def ruled_out_by(self, g: int, m: int) -> list[str]:
        """Names of the checks that fail."""
        motor = [name for name, answer in self.answers.items() if answer[g, m] < 0]
        return motor + [check.name for check in self.of_gear[g] if check.passed is False]

    def ranked(self, by: Rank = "mass") -> list[tuple[int, int]]:
        """The pairs (g, m) that nothing rules out, those that suffice first, then by rank; what is not stated comes last."""
        adequate = self.adequate
        key = self._key(by)
        pairs = [(int(g), int(m)) for g, m in np.argwhere(adequate >= 0)]
        nominal = [part.of.nominal_torque for part in self.motors]
        return sorted(pairs, key=lambda at: (-adequate[at], key[at], nominal[at[1]], at))

    def _key(self, by: Rank) -> Array:
        """(gears, motors), small first."""
        shape = (len(self.gears), len(self.motors))
        if by == "margin":
            return -np.nan_to_num(np.nanmin(list(self.margins.values()), axis=0), nan=-1.0)
        if by == "torque":
            return np.broadcast_to([part.of.nominal_torque for part in self.motors], shape)
        motor = np.array(
            [np.inf if (x := getattr(part, by)) is None else x for part in self.motors]
        )
        gear = np.array([getattr(part, by) or 0.0 for part in self.gears])
        return motor + gear[:, None]

    def verdict(self, g: int, m: int) -> MotorVerdict:
        """The pair as `assess` judges it, with every margin and the temperatures."""
        return assess(
            replace(self.load, drive=self.gears[g].of), self.motors[m].of, self.conditions
        )

    def reasons(self) -> dict[str, int]:
        """How many pairs each check rules out, the commonest first; a pair may count for several."""
        shape = (len(self.gears), len(self.motors))
        counts = {name: int((answer < 0).sum()) for name, answer in self.answers.items()}
        for checks in self.of_gear:
            for check in checks:
                if check.passed is False:
                    counts[check.name] = counts.get(check.name, 0) + shape[1]
        return dict(
            sorted(((k, n) for k, n in counts.items() if n), key=lambda each: (-each[1], each[0]))
        )

    def inertia_ratio(self, g: int, m: int) -> float | None:
        """Inertia of load and gear seen by the motor over its rotor's; None where the rotor's is not stated."""
        motor, drive = self.motors[m].of, self.gears[g].of
        if motor.rotor_inertia is None:
            return None
        shaft = shaft_inertia(replace(self.load, drive=drive), motor)[1] - motor.rotor_inertia
        return (
            shaft + (self.load_inertia + drive.output_inertia) / drive.ratio**2
        ) / motor.rotor_inertia

    def to_dict(self, rank: Rank, shown: int) -> dict[str, Any]:
        """An entry of `selection` in what `size --json` prints; `best` holds the first `shown` in full, SI."""
        adequate = self.adequate
        words = {1: True, 0: None, -1: False}
        return {
            "joint": self.load.joint,
            "motors": [part.label for part in self.motors],
            "gears": [part.label for part in self.gears],
            "adequate": [[words[int(each)] for each in row] for row in adequate],
            "ruled_out_by": [
                [self.ruled_out_by(g, m) for m in range(len(self.motors))]
                for g in range(len(self.gears))
            ],
            "reasons": self.reasons(),
            "rank": rank,
            "best": [self.pair_dict(g, m) for g, m in self.ranked(rank)[:shown]],
        }

    def pair_dict(self, g: int, m: int) -> dict[str, Any]:
        """One pair in full."""
        motor, gear, verdict = self.motors[m], self.gears[g], self.verdict(g, m)
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
    """Judge every motor with every gear on every joint that a duty moves, as `assess` judges one.

    gears: by joint; a joint that is not named, or with none, keeps its own. payload: kg at the tip.
    """
    conditions = conditions or Conditions()
    inertias = load_inertias(duty, payload)
    found = []
    for load in duty.loads(payload):
        own = [Part(load.drive.name, load.drive)]
        options = gears.get(load.joint) or own
        found.append(select_joint(load, motors, options, conditions, inertias[load.joint]))
    return tuple(found)


def load_inertias(duty: DutyCycle, payload: float = 0.0) -> dict[str, float]:
    """Largest diagonal entry of the mass matrix over the motions, by joint; kg·m², kg."""
    body = RigidBody.from_robot(with_payload(duty.robot, payload))
    q = np.concatenate(
        [run.sample(np.linspace(0, run.duration, INSTANTS)).q for run, _ in duty.runs]
    )
    largest = np.max([np.diag(matrix) for matrix in body.mass_matrix(q)], axis=0)
    return dict(zip((joint.name for joint in duty.robot.joints), map(float, largest), strict=True))


def energy_to_bus(load: JointLoad, motor: Motor) -> float | None:
    """What the motor gives back to its supply while it brakes, J in one motion at 25 °C: ∫ max(−(R·I² + τ·w), 0) dt.

    None where torque constant or resistance is not stated.
    """
    if missing(motor, "torque_constant", "terminal_resistance"):
        return None
    torque = load.torque()
    power = resistance(motor) * np.square(torque / torque_constant(motor)) + torque * load.speed()
    return float(load.duration * (load.weight @ np.maximum(-power, 0.0)))


def _balance(motor: Motor, hot: bool) -> tuple[float, float]:
    at = figure(motor, "max_winding_temperature") if hot else REFERENCE_TEMPERATURE
    return resistance(motor, at) / torque_constant(motor, at), torque_constant(motor, at)


def select_joint(
    load: JointLoad,
    motors: Sequence[Part[Motor]],
    gears: Sequence[Part[Drive]],
    conditions: Conditions,
    inertia: float = math.nan,
) -> JointSelection:
    """Judge every motor with every gear on one joint; inertia: largest of the moved bodies about its axis, kg·m² or kg."""
    fleet = _Fleet([part.of for part in motors], conditions, load.duration + conditions.pause)
    rows = [_judged(replace(load, drive=gear.of), fleet, conditions) for gear in gears]
    answers = {name: np.stack([answer[name] for answer, _, _ in rows]) for name in rows[0][0]}
    margins = {name: np.stack([margin[name] for _, margin, _ in rows]) for name in MARGINS}
    of_gear = [checks for _, _, checks in rows]
    return JointSelection(
        load,
        conditions,
        motors,
        gears,
        answers=answers,
        margins=margins,
        of_gear=of_gear,
        load_inertia=inertia,
    )


class _Fleet:
    """What the checks need of all motors (m), as columns (m, 1) or rows (m,)."""

    def __init__(self, motors: Sequence[Motor], conditions: Conditions, period: float) -> None:
        self.motors = motors
        self.limits = [limits_of(motor, conditions, 1.0, None) for motor in motors]
        self.max_speed = np.array([motor.max_speed for motor in motors])
        electrical = [motor for motor in motors if not missing(motor, *ELECTRICAL)]
        self.electrical = np.array([not missing(motor, *ELECTRICAL) for motor in motors])
        self.balance = [
            np.array([_balance(motor, hot) for motor in electrical]).reshape(-1, 2, 1)
            for hot in (False, True)
        ]
        """R/k and k of a cold and of a hot motor, (electrical, 2, 1) each."""
        self.volts = np.array([volts_per_torque(motor) for motor in motors])
        self.cool, self.hot = np.array([_certain(motor, conditions, period) for motor in motors]).T

    def limit(self, name: str) -> Array:
        """(m,); NaN where it is not known."""
        known = (limits[name][2] for limits in self.limits)
        return np.array([np.nan if limit is None else limit for limit in known])


def _certain(motor: Motor, conditions: Conditions, period: float) -> tuple[float, float]:
    """RMS torques (N·m) of a motion that repeats up to which the winding surely stays below its limit, and beyond which not.

    NaN without the figures. The winding answers to power by two decaying modes, both positive, and the losses grow with
    its temperature: power at the limit's resistance, all of it at one instant of each period, gives the most, the least
    answer to a mean power its coldest instant, and the loss there the least mean.
    """
    if missing(motor, *FIGURES):
        return np.nan, np.nan
    model, limit = (
        ThermalModel.from_motor(motor, conditions.ambient),
        figure(motor, "max_winding_temperature"),
    )
    allowed = limit - model.ambient
    if allowed <= 2 * NEAR:
        return -1.0, np.inf
    modes = Modes.of(
        model.r_winding_housing, model.r_housing_ambient, model.c_winding, model.c_housing
    )
    shares, x = modes.input * modes.shape[0] / -modes.rates, -modes.rates * period
    # beyond 700 e^x overflows, and what is left of a period's heat is nothing
    most, least = (
        float(shares @ (x / -np.expm1(-x))),
        float(shares @ (x / np.expm1(np.minimum(x, 700.0)))),
    )
    # the mean square at which the coldest instant would have each temperature up to the one whose mean is the limit
    rise = (allowed + NEAR) * least / float(shares.sum()) * np.linspace(0.01, 1.0, RISES)
    one = np.ones(RISES)
    holds = (allowed - NEAR) / (most * model.power(one, limit * one)[0])
    fails = 1.001 * np.max(rise / (least * model.power(one, model.ambient + rise)))
    return float(np.sqrt(holds)), float(np.sqrt(fails))


Row = tuple[dict[str, NDArray[np.int8]], dict[str, Array], tuple[Check, ...]]
"""One gear with all motors: answers (m,) and margins (m,) by check, and the checks of the gear."""


def _judged(load: JointLoad, fleet: _Fleet, conditions: Conditions) -> Row:
    spread = spread_of(load.drive, conditions.spread)
    gear = gear_checks(Case(load, band_of(load, None, spread, conditions), spread, conditions))
    fastest = float(np.abs(load.speed()).max())
    speed = _margin(fastest, fleet.max_speed)
    if spread.names:
        return _drawn(load, fleet, conditions, gear, speed)
    ends = np.array([shaft_inertia(load, motor) for motor in fleet.motors])
    worst, best = _bands(load, [dict(corner) for corner in spread.corners()], ends, fleet)
    answers, margins = {"speed": _answer(speed, speed)}, {"speed": speed}
    share = float(np.sqrt(load.duration / (load.duration + conditions.pause)))
    for name, demand, factor in (
        ("torque", "peak", 1.0),
        ("continuous_torque", "rms", share),
        ("voltage", "volts", 1.0),
    ):
        limit = fleet.limit(name)
        margins[name] = _margin(factor * worst[demand], limit)
        answers[name] = _answer(margins[name], _margin(factor * best[demand], limit))
    fails = np.min(list(answers.values()), axis=0) < 0
    if any(check.passed is False for check in gear):
        fails[:] = True
    answers["heat"] = _heat(
        load, fleet, conditions, band=(share * worst["rms"], share * best["rms"]), fails=fails
    )
    limited = np.array(
        [answers[name] for name in ("torque", "continuous_torque", "voltage", "heat")]
    )
    known = np.array(
        [np.isfinite(fleet.limit(name)) for name in ("torque", "continuous_torque", "voltage")]
    )
    known = np.vstack([known, np.isfinite(fleet.cool)])
    together = np.where(known, limited, 1).min(axis=0)
    answers[CONFIDENCE] = (
        together.astype(np.int8) if spread.known else np.zeros(len(fails), np.int8)
    )
    return answers, margins, gear


def _drawn(
    load: JointLoad, fleet: _Fleet, conditions: Conditions, gear: tuple[Check, ...], speed: Array
) -> Row:
    """Pair by pair, for a friction that is known by draws; a motor too slow, or with a gear that fails, needs none."""
    count = len(fleet.motors)
    names = ("torque", "continuous_torque", "voltage", "heat", CONFIDENCE)
    answers = {name: np.zeros(count, np.int8) for name in names} | {"speed": _answer(speed, speed)}
    margins = {name: np.full(count, np.nan) for name in MARGINS} | {"speed": speed}
    if any(check.passed is False for check in gear):
        return answers, margins, gear
    for m in np.flatnonzero(answers["speed"] > 0).tolist():
        for check in assess(load, fleet.motors[m], conditions).checks:
            answers[check.name][m] = _WORDS[check.passed]
            if check.name in margins and check.margin is not None:
                margins[check.name][m] = check.margin
    return answers, margins, gear


_WORDS = {True: 1, None: 0, False: -1}


def _bands(
    load: JointLoad, corners: Sequence[dict[str, Any]], ends: Array, fleet: _Fleet
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Largest and smallest demands (m,) of every motor; ends (m, 2): inertia of its shaft, kg·m²."""
    turning = load.acceleration() * (load.direction != 0)
    found = []
    for corner in corners:
        bare = load.torque(drawn(load.drive, {**corner, "input_inertia": 0.0}))
        sums = [
            float(load.weight @ (a * b))
            for a, b in ((bare, bare), (bare, turning), (turning, turning))
        ]
        for inertia in ends.T if np.any(ends[:, 0] != ends[:, 1]) else ends.T[:1]:
            rms = np.sqrt(np.maximum(sums[0] + 2 * inertia * sums[1] + inertia**2 * sums[2], 0.0))
            found.append([*_peaks(bare, turning, load.speed(), inertia, fleet), rms])
    peak, volts, rms = np.max(found, axis=0)
    low_peak, low_volts, low_rms = np.min(found, axis=0)
    # the demands are convex in the inertia: between its ends they fall by no more than this
    fall, wd = (ends[:, 1] - ends[:, 0]) / 2, np.abs(load.acceleration())
    low_peak, low_rms = low_peak - fall * wd.max(), low_rms - fall * float(load.rms(wd))
    low_volts = low_volts - fall * wd.max() * fleet.volts
    best = {"peak": low_peak, "volts": low_volts, "rms": low_rms}
    return {"peak": peak, "volts": volts, "rms": rms}, {
        name: np.maximum(low, 0.0) for name, low in best.items()
    }


def _peaks(
    bare: Array, turning: Array, speed: Array, inertia: Array, fleet: _Fleet
) -> tuple[Array, Array]:
    """Peak torque and voltage (m,) of motors whose shafts have an inertia (m,)."""
    peak, volts = np.empty(len(inertia)), np.full(len(inertia), np.nan)
    place = np.cumsum(fleet.electrical) - 1
    for m, shaft in enumerate(inertia):
        torque = bare + shaft * turning
        peak[m] = max(torque.max(), -torque.min())
        if fleet.electrical[m]:
            needs = [
                each[place[m]][0] * torque + each[place[m]][1] * speed for each in fleet.balance
            ]
            volts[m] = max(max(need.max(), -need.min()) for need in needs)
    return peak, volts


def _heat(
    load: JointLoad,
    fleet: _Fleet,
    conditions: Conditions,
    band: tuple[Array, Array],
    fails: NDArray[np.bool_],
) -> NDArray[np.int8]:
    """Answers (m,) to the worst and best RMS torque over motion and pause; 0 where the bounds say nothing and `fails`."""
    worst, best = band
    answers = np.where(worst <= fleet.cool, 1, np.where(best > fleet.hot, -1, 0)).astype(np.int8)
    open_ = (
        (answers == 0)
        & ~fails
        & np.isfinite(fleet.cool)
        & ~((worst > fleet.hot) & (best <= fleet.cool))
    )
    for m in np.flatnonzero(open_).tolist():
        motor = fleet.motors[m]
        turned = replace(load, drive=with_rotor(load, motor)[0], motor=motor)
        heat = heat_of(turned, motor, conditions, worst[m])
        if heat is not None:
            limit = np.array(heat.capacity)
            answers[m] = _answer(_margin(worst[m], limit), _margin(best[m], limit))
    return answers


def _margin(worst: Array | float, limit: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(limit <= 0, -1.0, (limit - worst) / limit)


def _answer(worst: Array, best: Array) -> NDArray[np.int8]:
    """As Check.passed says of the margins at both ends of what is not known."""
    return np.where(worst >= -TOLERANCE, 1, np.where(best < -TOLERANCE, -1, 0)).astype(np.int8)

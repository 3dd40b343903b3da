"""Assess every motor with every gear of a catalogue on every joint, by operations on arrays.

The function `assess` would be too slow for every pair of a large catalogue. The main entry of this
module, `select_motors`, gives the same answers as `assess` for each pair of a motor and a gear. It
is fast because a rotor only adds J·ẇ to the motor torque (J is its inertia and ẇ the acceleration
of the motor), and a gearhead only divides the torque of the gear by ratio and efficiency. The
torque of a gear is therefore evaluated once for all gearheads and motors. Two bounds on the winding
temperature decide most pairs. The function `assess` decides the other pairs, and all pairs whose
friction has a statistical distribution.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ssm_planner.dynamics import RigidBody, drive_with_values, with_payload
from ssm_planner.loading import CatalogueEntry
from ssm_planner.problem import Drive, Gearhead, Motor
from ssm_planner.sizing.assess import (
    CONFIDENCE_CHECK,
    MotorVerdict,
    assess,
    motor_friction,
    motor_limits,
    shaft_inertia,
    with_motor,
)
from ssm_planner.sizing.chain import DriveChain
from ssm_planner.sizing.checks import (
    MARGIN_TOLERANCE,
    Check,
    JointCase,
    drive_checks,
    gear_case,
    is_certainly_self_locking,
    relative_margin,
)
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.heat_check import compute_heat
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import (
    Conditions,
    missing_data,
    require_value,
    resistance,
    torque_constant,
    voltage_factors,
)
from ssm_planner.sizing.thermal_network import THERMAL_DATA, ThermalModel, ThermalModes
from ssm_planner.typing import Array, Arrays, Indices, JsonObject, Keywords, Mask, record

Rank = Literal["mass", "length", "torque", "margin"]
RANKS: tuple[Rank, ...] = get_args(Rank)
"""Quantities by which pairs can be sorted."""
Answers = NDArray[np.int8]
"""Answers of one check for each pair, (gears, motors): 1 passed, 0 not known, −1 failed."""
ANSWER_CODES = {True: 1, None: 0, False: -1}
"""Numbers in `Answers` that represent the values of `Check.passed`."""
MARGIN_CHECKS = ("torque", "speed", "continuous_torque", "voltage")
"""Names of the checks whose margin is computed for every pair."""
TEMPERATURE_MARGIN = 0.01
"""Margin of the temperature bounds, K. Pairs that are closer to the limit are left to `assess`."""
RUNAWAY_TEMPERATURES = 50
"""Number of temperatures at which thermal runaway is checked."""
INERTIA_INSTANTS = 200
"""Number of instants of each motion at which the inertia of the load is evaluated."""


@record
class JointSelection:
    """The assessment of every motor with every gear on one joint.

    A pair is one gear and one motor. In all methods, g is the index of the gear in `gears`, and m
    is the index of the motor in `motors`.
    """

    load: JointLoad
    conditions: Conditions
    motors: Sequence[CatalogueEntry[Motor]]
    gears: Sequence[DriveChain]
    """Drives of the catalogue, each without and with every gearhead."""
    answers: Mapping[str, Answers]
    """Answers by name of the check.

    The answer for heat is 0 if it was not evaluated because another check fails.
    """
    margins: Mapping[str, Array]
    """Margins (gears, motors) by name of the check. NaN if data are missing."""
    of_gear: Sequence[tuple[Check, ...]]
    """Checks of each gear, which do not depend on the motor."""
    load_inertia: float
    """Largest inertia of the moved bodies about the joint's axis, kg·m² or kg."""

    @property
    def adequate(self) -> Answers:
        """Answers (gears, motors) of all checks together, equal to `MotorVerdict.adequate`.

        A pair is adequate (1) if every check of its motor and of its gear passes. It is not
        adequate (−1) if a check fails. Otherwise, or if a figure of a part is a placeholder, the
        answer is 0.
        """
        gear = [
            min(not chain.placeholder, *(ANSWER_CODES[check.passed] for check in checks))
            for chain, checks in zip(self.gears, self.of_gear, strict=True)
        ]
        return np.minimum(self._of_motors, np.array(gear, np.int8)[:, None])

    @property
    def _of_motors(self) -> Answers:
        """Answers (gears, motors) of the checks of the motors alone, without those of the gears.

        The answer is at most 0 (not known) for a motor with placeholder figures.
        """
        answers = np.min(list(self.answers.values()), axis=0)
        is_stated = [not part.of.placeholder for part in self.motors]
        return np.minimum(answers, np.array(is_stated, np.int8))

    def checks_with(self, answer: int, g: int, m: int) -> list[str]:
        """Return the names of the checks of one pair that have a given answer.

        Parameters
        ----------
        answer : int
            1 (passed), 0 (not known) or −1 (failed).
        g, m : int
            Indices of the gear and the motor.

        Returns
        -------
        list of str
            Names of the checks of the motor, then of the gear.
        """
        motor = [name for name, answers in self.answers.items() if answers[g, m] == answer]
        return motor + [c.name for c in self.of_gear[g] if ANSWER_CODES[c.passed] == answer]

    def ranked(self, by: Rank = "mass") -> list[tuple[int, int]]:
        """Sort the pairs that no check rules out, the best first.

        The list has three groups. Pairs that pass all checks are first. In the second group, all
        checks of the motor pass, and only data of the gear are missing. The other pairs, for which
        data of the motor are missing, are last. Within a group, the pairs are sorted by the
        quantity `by`. Pairs with an unknown quantity are at the end of their group. Equal pairs are
        sorted by the nominal torque of the motor.

        Parameters
        ----------
        by : Rank
            "mass" or "length" of motor, gearhead and gear together, nominal "torque" of the motor
            (each the smallest first), or smallest "margin" of the checks of the motor (the largest
            first).

        Returns
        -------
        list of (int, int)
            Indices (g, m) of gear and motor of each pair.
        """
        # The answers are 1 (passed), 0 (not known) and −1 (failed).
        adequate = self.adequate
        motor_answers = self._of_motors
        key = self._key(by)
        nominal = [candidate.of.nominal_torque for candidate in self.motors]
        return sorted(
            ((int(g), int(m)) for g, m in np.argwhere(adequate >= 0)),
            key=lambda pair: (
                -adequate[pair],
                -motor_answers[pair],
                key[pair],
                nominal[pair[1]],
                pair,
            ),
        )

    def _key(self, by: Rank) -> Array:
        """Compute the numbers by which `ranked` sorts the pairs in ascending order.

        The number is infinite if a part of the pair does not state the quantity. If no gear states
        it, the gears cannot be compared, and they count as 0, so that only motors and gearheads
        matter.

        Parameters
        ----------
        by : Rank
            Quantity of the numbers: "mass", "length", "torque" or "margin". For "margin", the
            number is the negative of the smallest margin.

        Returns
        -------
        (gears, motors) array
            One number for each pair.
        """
        if by == "margin":
            return np.nan_to_num(-np.min(list(self.margins.values()), axis=0), nan=np.inf)
        if by == "torque":
            nominal = np.array([part.of.nominal_torque for part in self.motors])
            return np.tile(nominal, (len(self.gears), 1))
        gears = (chain.gear for chain in self.gears)
        gearheads = (chain.gearhead for chain in self.gears)
        gear, motor, gearhead = (
            np.array([0.0 if part is None else getattr(part, by) for part in parts], dtype=float)
            for parts in (gears, self.motors, gearheads)
        )
        if np.isnan(gear).all():
            gear = np.zeros(len(gear))
        return np.nan_to_num(np.add.outer(gear + gearhead, motor), nan=np.inf)

    def verdict(self, g: int, m: int) -> MotorVerdict:
        """Assess one pair in full, with all margins and the temperatures.

        Parameters
        ----------
        g, m : int
            Indices of the gear and the motor.

        Returns
        -------
        MotorVerdict
            Result of `assess` for this pair.
        """
        return assess(self.gears[g].load(self.load), self.motors[m].of, self.conditions)

    def reasons(self) -> dict[str, int]:
        """Count the pairs that each check rules out.

        A pair counts for each of its failed checks.

        Returns
        -------
        dict of int
            Number of pairs by name of the check, the largest number first. Checks that rule out no
            pair are missing.
        """
        failed = (name for row in self._table(-1) for names in row for name in names)
        counts = Counter(failed).items()
        return dict(sorted(counts, key=lambda item: (-item[1], item[0])))

    def inertia_ratio(self, g: int, m: int) -> float | None:
        """Compute the inertia of load and gear at the motor shaft, divided by that of the rotor.

        The ratio is (J_shaft + (J_load + J_out) / ratio²) / J_rotor. J_shaft is the largest
        possible inertia on the motor shaft without the rotor, J_load the inertia of the moved
        bodies (`load_inertia`), J_out the inertia of the output side of the drive, and ratio its
        total transmission ratio.

        Parameters
        ----------
        g, m : int
            Indices of the gear and the motor.

        Returns
        -------
        float or None
            The ratio. None if the inertia of the rotor is not stated.
        """
        motor = self.motors[m].of
        if motor.rotor_inertia is None:
            return None
        load = self.gears[g].load(self.load)
        drive = load.drive
        shaft = shaft_inertia(load, motor)[1] - motor.rotor_inertia
        return (
            shaft + (self.load_inertia + drive.output_inertia) / drive.ratio**2
        ) / motor.rotor_inertia

    def to_dict(self, rank: Rank, count: int) -> JsonObject:
        """Return the assessment as a dict, in SI units.

        The output of `size --json` contains this dict as an entry of `selection`.

        Parameters
        ----------
        rank : Rank
            Quantity by which the pairs are sorted: "mass", "length", "torque" or "margin".
        count : int
            Number of pairs that are described in full under `best`.

        Returns
        -------
        dict
            Labels of motors and gears, answers, reasons, and the best pairs.
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
        """List the names of the checks that make each pair fail or leave it undecided.

        Parameters
        ----------
        answer : int
            −1 for pairs that fail, or 0 for undecided pairs.

        Returns
        -------
        list of list of list of str
            Names of the checks with this answer, indexed by gear and motor. The list of a pair that
            has another answer is empty.
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
        """Describe one pair in full as a dict.

        The output of `size --json` contains this dict.

        The pair is assessed by `assess`, which computes all margins and the temperatures.

        Parameters
        ----------
        g, m : int
            Indices of the gear and the motor.

        Returns
        -------
        dict
            Entries of `MotorVerdict.to_dict` and the names, masses (kg) and length (m) of the
            parts. `inertia_ratio` and `energy_to_bus` (J) are the results of the functions of the
            same name.
        """
        motor = self.motors[m]
        chain = self.gears[g]
        gearhead = chain.gearhead
        verdict = self.verdict(g, m)
        return {
            **verdict.to_dict(),
            "motor": motor.label,
            "gear": chain.label,
            "gearhead": None if gearhead is None else gearhead.label,
            "mass": motor.mass,
            "gear_mass": chain.gear.mass,
            "gearhead_mass": None if gearhead is None else gearhead.mass,
            "length": motor.length,
            "inertia_ratio": self.inertia_ratio(g, m),
            "energy_to_bus": energy_to_bus(verdict.load, motor.of),
        }


def select_motors(
    duty: DutyCycle,
    motors: Sequence[CatalogueEntry[Motor]],
    gears: Mapping[str, Sequence[CatalogueEntry[Drive]]],
    conditions: Conditions | None = None,
    payload: float = 0.0,
    *,
    gearheads: Sequence[CatalogueEntry[Gearhead]] = (),
) -> tuple[JointSelection, ...]:
    """Assess every motor with every gear on every joint that a duty cycle moves.

    Parameters
    ----------
    duty : DutyCycle
        Motions of one robot.
    motors : sequence of CatalogueEntry of Motor
        Candidate motors.
    gears : mapping of str to sequence of CatalogueEntry of Drive
        Candidate gears by joint. A joint without an entry keeps its present drive.
    conditions : Conditions, optional
        Operating conditions. The default is `Conditions()`.
    payload : float
        Point mass at the tip, kg.
    gearheads : sequence of CatalogueEntry of Gearhead
        Candidate gearheads between motor and gear. Each gear is also assessed without a gearhead.

    Returns
    -------
    tuple of JointSelection
        One entry for each load of the duty cycle, that is, for each motion of a joint.
    """
    conditions = conditions or Conditions()
    inertias = load_inertias(duty, payload)
    return tuple(
        select_joint(
            load,
            motors,
            gears.get(load.joint) or [CatalogueEntry(load.drive.name, load.drive)],
            conditions,
            inertias[load.joint],
            gearheads=gearheads,
        )
        for load in duty.loads(payload)
    )


def load_inertias(duty: DutyCycle, payload: float = 0.0) -> dict[str, float]:
    """Compute the largest inertia that each joint moves during a duty cycle.

    The inertia of a joint is the diagonal entry of the mass matrix M(q). It is evaluated at
    `INERTIA_INSTANTS` instants of each motion.

    Parameters
    ----------
    duty : DutyCycle
        Motions of one robot.
    payload : float
        Point mass at the tip, kg.

    Returns
    -------
    dict of float
        Largest inertia by joint, kg·m², or kg for the sliding joint.
    """
    body = RigidBody.from_robot(with_payload(duty.robot, payload))
    q = np.concatenate(
        [
            motion.sample(np.linspace(0, motion.duration, INERTIA_INSTANTS)).q
            for motion, _ in duty.runs
        ]
    )
    diagonal = np.max([np.diag(matrix) for matrix in body.mass_matrix(q)], axis=0)
    return dict(zip((joint.name for joint in duty.robot.joints), map(float, diagonal), strict=True))


def energy_to_bus(load: JointLoad, motor: Motor) -> float | None:
    """Compute the electrical energy that a braking motor returns to its supply in one motion.

    The supply must absorb or store this energy. It is ∫ max(−(R·I² + τ·w), 0) dt with the current I
    = τ/k, where R and k are the resistance and the torque constant of the motor at 25 °C, τ is its
    torque and w its speed.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint.
    motor : Motor
        Motor with its electrical data.

    Returns
    -------
    float or None
        Energy, J. None if the motor file does not state the torque constant or the resistance.
    """
    if missing_data(motor, "torque_constant", "terminal_resistance"):
        return None
    torque = load.torque()
    power = resistance(motor) * np.square(torque / torque_constant(motor)) + torque * load.speed()
    return float(load.duration * (load.weight @ np.maximum(-power, 0.0)))


def select_joint(
    load: JointLoad,
    motors: Sequence[CatalogueEntry[Motor]],
    gears: Sequence[CatalogueEntry[Drive]],
    conditions: Conditions,
    inertia: float = math.nan,
    *,
    gearheads: Sequence[CatalogueEntry[Gearhead]] = (),
) -> JointSelection:
    """Assess every motor with every gear on one joint, without and with every gearhead.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint.
    motors, gears, gearheads : sequences of CatalogueEntry
        Candidate motors, gears and gearheads.
    conditions : Conditions
        Operating conditions.
    inertia : float
        Largest inertia of the moved bodies about the joint's axis, kg·m² or kg. It is reported in
        the ratio of inertias and does not affect the checks. The default, NaN, means not known.

    Returns
    -------
    JointSelection
        Answers and margins of all pairs. Each gear is followed by its combinations with gearheads.
    """
    motor_data = _MotorData(
        [candidate.of for candidate in motors], conditions, load.duration + conditions.pause
    )
    chains: list[DriveChain] = []
    rows: list[GearAssessment] = []
    for gear in gears:
        group = [DriveChain(gear, gearhead) for gearhead in (None, *gearheads)]
        chains += group
        rows += _assess_gear([chain.load(load) for chain in group], motor_data, conditions)
    answers, margins, of_gear = zip(*rows, strict=True)
    return JointSelection(
        load,
        conditions,
        motors,
        chains,
        {name: np.stack([answer[name] for answer in answers]) for name in answers[0]},
        margins={name: np.stack([margin[name] for margin in margins]) for name in MARGIN_CHECKS},
        of_gear=of_gear,
        load_inertia=inertia,
    )


class _MotorData:
    """Data of all candidate motors (m) that the checks need, as arrays with one entry per motor.

    Attributes
    ----------
    limits : list of dict
        Limits of each motor, see `motor_limits`.
    max_speed : (m,) array
        Largest permitted speed, rad/s.
    balance : (m, 2, 2) array
        Factors of the voltage for the cold and the hot motor, see `voltage_factors`.
    cool, hot : (m,) array
        RMS torque below which the winding certainly stays below its limit, and RMS torque above
        which it certainly exceeds the limit, see `_certain_torques`, N·m.
    """

    def __init__(self, motors: Sequence[Motor], conditions: Conditions, period: float) -> None:
        """Collect the data of the motors.

        Parameters
        ----------
        motors : sequence of Motor
            Candidate motors.
        conditions : Conditions
            Operating conditions.
        period : float
            Duration of the motion and its pause, s.
        """
        self.motors = motors
        self.limits = [motor_limits(motor, conditions, 1.0, None) for motor in motors]
        self.max_speed = np.array([motor.max_speed for motor in motors])
        self.balance = np.array([voltage_factors(motor) for motor in motors])
        self.cool, self.hot = np.array(
            [_certain_torques(motor, conditions, period) for motor in motors]
        ).T

    def limit(self, name: str) -> Array:
        """Return the upper limits of one check for all motors.

        Parameters
        ----------
        name : str
            Name of the check: "torque", "continuous_torque", "voltage" or "heat".

        Returns
        -------
        (m,) array
            Limits in the SI unit of the check. NaN if not known.
        """
        bounds = (limits[name][2] for limits in self.limits)
        return np.array([np.nan if limit is None else limit for limit in bounds])


def _certain_torques(motor: Motor, conditions: Conditions, period: float) -> tuple[float, float]:
    """Compute two RMS torques between which the thermal check must be evaluated in full.

    The check certainly passes below the first torque and certainly fails above the second one,
    for any motion that repeats with this period.

    Parameters
    ----------
    motor : Motor
        Motor with its thermal data.
    conditions : Conditions
        Operating conditions, of which the ambient temperature is used.
    period : float
        Duration of the motion and its pause, s.

    Returns
    -------
    passes, fails : float
        RMS torques over motion and pause, N·m. Both are NaN if thermal data are missing. If the
        ambient temperature nearly reaches the limit, they are −1 and infinity, which decide
        nothing.

    Notes
    -----
    Two facts give the bounds. The winding temperature responds to power by two decaying
    exponentials with positive amplitudes (`ThermalModes`), and the loss grows with the temperature.

    For a given mean power, the winding becomes hottest if all energy of a period enters at one
    instant. The first torque gives a temperature just below the limit in this case, with the
    resistance of the hottest permitted winding. Just before such an instant, the winding has the
    lowest temperature that is possible with this mean power. The second torque follows from this
    lowest temperature and from the loss at this temperature, which is the smallest possible loss.
    """
    if missing_data(motor, *THERMAL_DATA):
        return np.nan, np.nan
    model = ThermalModel.from_motor(motor, conditions.ambient)
    limit = require_value(motor, "max_winding_temperature")
    allowed = limit - model.ambient
    if allowed <= 2 * TEMPERATURE_MARGIN:
        return -1.0, np.inf
    modes = ThermalModes.from_network(
        model.r_winding_housing, model.r_housing_ambient, model.c_winding, model.c_housing
    )
    # Thermal resistance of each mode (K/W). Its response to one pulse of heat per period falls from
    # x/(1 − e^−x) to x/(e^x − 1) times its mean.
    shares = modes.input * modes.shape[0] / -modes.rates
    x = -modes.rates * period
    # Beyond 700, e^x overflows, and the remaining heat of a period is negligible.
    highest = float(shares @ (x / -np.expm1(-x)))
    lowest = float(shares @ (x / np.expm1(np.minimum(x, 700.0))))
    # Temperature rises of the winding at its coldest instant. At the largest one, the mean
    # temperature is at the limit, so the peak exceeds it. Each rise needs a certain mean squared
    # torque. Above the largest of these values, the winding becomes too hot.
    rise = (
        (allowed + TEMPERATURE_MARGIN)
        * lowest
        / float(shares.sum())
        * np.linspace(0.01, 1.0, RUNAWAY_TEMPERATURES)
    )
    # The torque is 1 N·m, so the power is that per squared torque. The factor 1.001 covers the
    # distance between two of the temperatures.
    unit = np.ones(RUNAWAY_TEMPERATURES)
    passes = (allowed - TEMPERATURE_MARGIN) / (highest * model.power(unit, limit * unit)[0][0])
    fails = 1.001 * np.max(rise / (lowest * model.power(unit, model.ambient + rise)[0]))
    return float(np.sqrt(passes)), float(np.sqrt(fails))


GearAssessment = tuple[dict[str, Answers], Arrays, tuple[Check, ...]]
"""Answers (m,) and margins (m,) of one gear with all motors, and the checks of the gear."""


def _assess_gear(
    chains: Sequence[JointLoad], motor_data: _MotorData, conditions: Conditions
) -> Iterator[GearAssessment]:
    """Assess all motors with one gear, without and with gearheads.

    A chain is the gear, alone or with one gearhead. If the gear is certainly self-locking, the
    torque of every chain is that of the gear, divided by the ratio and the efficiency of the
    gearhead, so it is computed once. Otherwise, the load can drive the gearheads, and each chain is
    assessed on its own. The same applies if the friction has a statistical distribution.

    Parameters
    ----------
    chains : sequence of JointLoad
        Loads of the joint. The first load has the gear alone, and each other load has one gearhead
        in addition.
    motor_data : _MotorData
        Data of the motors.
    conditions : Conditions
        Operating conditions.

    Yields
    ------
    GearAssessment
        Answers and margins of all motors, and the checks of the gear, for each chain.
    """
    load = chains[0]
    case = gear_case(load, conditions)
    if len(chains) > 1 and (case.spread.names or not is_certainly_self_locking(case)):
        # The torque of each chain has another distribution or another form.
        for geared in chains:
            yield from _assess_gear([geared], motor_data, conditions)
        return
    if case.spread.names:
        yield _assess_by_draws(load, motor_data, conditions, drive_checks(case))
        return
    share = float(np.sqrt(load.duration / (load.duration + conditions.pause)))
    limited = {"torque": 1.0, "continuous_torque": share, "voltage": 1.0}
    for geared, (highest, lowest) in zip(
        chains, _demand_ranges(chains, case, motor_data), strict=True
    ):
        checks = drive_checks(case, geared.drive)
        speed = relative_margin(geared.peak_speed, motor_data.max_speed)
        answers = {"speed": _answers_from_margins(speed, speed)}
        margins = {"speed": speed}
        for (name, factor), high, low in zip(limited.items(), highest, lowest, strict=True):
            limit = motor_data.limit(name)
            margins[name] = relative_margin(factor * high, limit)
            answers[name] = _answers_from_margins(
                margins[name], relative_margin(factor * low, limit)
            )
        fails = np.min(list(answers.values()), axis=0) < 0
        fails |= any(check.passed is False for check in checks)
        band = (share * highest[1], share * lowest[1])
        answers["heat"] = _heat_answers(geared, motor_data, conditions, band=band, fails=fails)
        combined = np.min([answers[name] for name in (*limited, "heat")], axis=0)
        answers[CONFIDENCE_CHECK] = combined if case.spread.is_stated else 0 * combined
        yield answers, margins, checks


def _assess_by_draws(
    load: JointLoad, motor_data: _MotorData, conditions: Conditions, gear: tuple[Check, ...]
) -> GearAssessment:
    """Assess the motors one by one, for friction with a statistical distribution.

    Parameters
    ----------
    load : JointLoad
        Load of the joint with the gear.
    motor_data : _MotorData
        Data of the motors (m).
    conditions : Conditions
        Operating conditions.
    gear : tuple of Check
        Checks of the gear.

    Returns
    -------
    GearAssessment
        Answers and margins of all motors, and the checks of the gear.
    """
    checks = [assess(load, motor, conditions).checks for motor in motor_data.motors]
    answers, margins = {}, {}
    for of_motors in zip(*checks, strict=True):
        name = of_motors[0].name
        answers[name] = np.array([ANSWER_CODES[check.passed] for check in of_motors], np.int8)
        if name in MARGIN_CHECKS:
            margins[name] = np.array([check.margin for check in of_motors], dtype=float)
    return answers, margins, gear


def _demand_ranges(
    chains: Sequence[JointLoad], case: JointCase, motor_data: _MotorData
) -> Iterator[tuple[Array, Array]]:
    """Compute the largest and the smallest demands on every motor for each chain of a gear.

    The demands are peak torque (N·m), RMS torque over the motion (N·m) and peak voltage (V). The
    torque of a motor is linear in the inertia on its shaft and in its friction torque, so the
    torque of the gear is evaluated once and scaled for each chain and motor. The demands are
    evaluated at every corner, that is, at every combination of the ends of the stated friction
    ranges, and at both ends of the range of the inertia.

    Parameters
    ----------
    chains : sequence of JointLoad
        Loads of the joint for k chains. The first one is the load of `case`, which has no gearhead
        of a catalogue, and each other load has one.
    case : JointCase
        Load and friction ranges of the gear.
    motor_data : _MotorData
        Data of the motors (m).

    Returns
    -------
    iterator of (largest, smallest)
        Arrays (3, m) of the demands for each chain. The smallest peaks are lower bounds, and they
        are exact wherever an answer depends on it.
    """
    load = case.load
    inertias = np.array([[shaft_inertia(chain, x) for x in motor_data.motors] for chain in chains])
    friction = np.array([[motor_friction(chain, x) for x in motor_data.motors] for chain in chains])
    heads = [chain.drive.gearhead for chain in chains[1:]]
    factors_of = [(head.forwards, head.ratio) for head in heads if head is not None]
    forwards, ratio = np.array([(1.0, 1.0), *factors_of]).T[..., None]
    ones = np.ones(friction.shape[:2])
    # The first entry is the smallest inertia of each pair, and the second is the largest.
    factors = np.array(
        [
            np.stack([forwards * ones, ratio * inertia, friction[..., 1], 0 * ones], axis=-1)
            for inertia in np.moveaxis(np.unique(inertias, axis=2), 2, 0)
        ]
    )
    corners = CornerTorques(load, case.spread.corners())
    # The demands are convex in the inertia, so between its ends they fall by at most half of its
    # width times |ẇ|. The friction changes them at most by the width of its range.
    half_width = ratio * np.diff(inertias)[..., 0] / 2
    width = np.diff(friction)[..., 0]
    wd = np.abs(load.acceleration())
    torque_drop = half_width * wd.max() + width
    rms_drop = half_width * float(load.rms(wd)) + width
    voltage_drop = torque_drop * motor_data.balance[:, 1, 0]
    torque_limit = motor_data.limit("torque") + torque_drop
    peak, least_peak = corners.peaks([factors], corners.torque_extremes, torque_limit)
    # The voltage is the larger one of the cold and the hot motor.
    per_speed = np.array([0.0, 0.0, 0.0, 1.0]) * ratio[..., None]
    of_states = [
        a[:, None] * factors + b[:, None] * per_speed
        for a, b in np.moveaxis(motor_data.balance, 0, 2)
    ]
    voltage_limit = motor_data.limit("voltage") + voltage_drop
    volts, least_volts = corners.peaks(of_states, corners.extremes, voltage_limit)
    rms = corners.rms(factors)
    largest = np.stack([peak, rms.max(axis=(0, 1)), volts], axis=1)
    smallest = np.stack([least_peak, rms.min(axis=(0, 1)), least_volts], axis=1)
    drops = np.stack([torque_drop, rms_drop, voltage_drop], axis=1)
    return zip(largest, np.maximum(smallest - drops, 0.0), strict=True)


class CornerTorques:
    """Torques of one gear at all corners, from which the peaks of all motors are computed.

    The torques and voltages of all motors are linear combinations of four parts: the torque of the
    gear without inertia, and the acceleration, the direction and the speed of its shaft. At each
    instant, the first part lies between its smallest and its largest value over all corners. These
    two ends give the largest peak exactly, and a lower bound of the smallest peak.

    Attributes
    ----------
    extremes : (4, v) array
        Parts at the instants and ends at which a combination of all parts can be extreme.
    torque_extremes : (4, u) array
        The same for combinations without the speed, which need fewer instants.
    """

    def __init__(self, load: JointLoad, corners: Sequence[Keywords]) -> None:
        """Evaluate the torques and select the instants that can be extreme.

        Parameters
        ----------
        load : JointLoad
            Load of the joint with the gear, at n instants.
        corners : sequence of dict
            Combinations (c) of the ends of the friction parameters with a stated range, by name.
        """
        drives = (drive_with_values(load.drive, {**x, "input_inertia": 0.0}) for x in corners)
        self._torques = np.array([replace(load, drive=drive).torque() for drive in drives])
        turning = load.acceleration() * (load.direction != 0)
        self._motion = np.stack([turning, load.direction, load.speed()])
        self._weight = load.weight
        ends = [
            np.vstack([end, self._motion])
            for end in (self._torques.min(axis=0), self._torques.max(axis=0))
        ]
        both = np.hstack(ends)
        self.extremes = both[:, _extreme_instants(both)]
        self._least, self._most = (end[:, _extreme_instants(end[:3])] for end in ends)
        self.torque_extremes = np.hstack([self._least, self._most])

    def rms(self, factors: Array) -> Array:
        """Compute the RMS torques of all motors.

        Parameters
        ----------
        factors : (e, k, m, 4) array
            Factors of the four parts.

        Returns
        -------
        (c, e, k, m) array
            RMS torques at every corner, N·m.
        """
        parts = (np.vstack([torque, self._motion]) for torque in self._torques)
        # The mean square of Σ f_i part_i is fᵀ P f with the mean products P of the parts.
        products = [part * self._weight @ part.T for part in parts]
        squares = [np.sum(factors @ product * factors, axis=-1) for product in products]
        return np.sqrt(np.maximum(squares, 0.0))

    def peaks(self, states: Sequence[Array], parts: Array, limit: Array) -> tuple[Array, Array]:
        """Compute the largest and the smallest peak of a torque or voltage over all corners.

        Parameters
        ----------
        states : sequence of (e, k, m, 4) arrays
            Factors of the four parts for each state of the motor. The axes are the e ends of the
            inertia's range, the k chains and the m motors. The factors of the torque are positive.
        parts : (4, v) array
            `extremes` or `torque_extremes`.
        limit : (k, m) array
            Limit with which the smallest peak is compared. NaN if not known.

        Returns
        -------
        largest, smallest : (k, m) arrays
            The peaks, N·m or V. The smallest one is a lower bound if this bound exceeds the limit
            or if the largest one keeps it.
        """
        peak = np.max([_largest(np.abs, factors, parts).max(axis=0) for factors in states], axis=0)
        # At every instant, the smallest magnitude over all corners is at least the value with the
        # smallest torque, and at least minus the value with the largest torque.
        bounds = [
            np.maximum(
                _largest(np.positive, factors, self._least),
                _largest(np.negative, factors, self._most),
            ).min(axis=0)
            for factors in states
        ]
        smallest = np.max(bounds, axis=0)
        is_open = (peak > limit) & (smallest <= limit * (1 + 2 * MARGIN_TOLERANCE))
        for k, m in np.argwhere(is_open):
            rows = np.array([factors[:, k, m] for factors in states])
            values = (
                rows[..., :1, None] * self._torques + (rows[..., 1:] @ self._motion)[:, :, None]
            )
            smallest[k, m] = np.abs(values).max(axis=(0, 3)).min()
        return peak, smallest


def _extreme_instants(parts: Array) -> Indices:
    """Find the instants at which a linear combination of the torque parts can be extreme.

    A linear function on a set of points is largest at a vertex of their convex hull. The vertices
    are fewer than the instants, so the peaks of all motors can be computed from them alone.

    Parameters
    ----------
    parts : (p, n) array
        Values of the parts, see `CornerTorques`. The third one is the direction. The hull is
        computed separately for each direction of motion.

    Returns
    -------
    (v,) array of int
        Indices of the instants. If a direction has too few instants for a hull, all its distinct
        ones are included.
    """
    from scipy.spatial import ConvexHull, QhullError  # They take long to import.

    direction = parts[2]
    indices = []
    for sign in np.unique(direction):
        (members,) = np.nonzero(direction == sign)
        points = parts[:, members]
        varying = points[np.ptp(points, axis=1) > 0]
        try:
            varying = varying / np.abs(varying).max(axis=1, keepdims=True)
            # The option QJ moves the points slightly, so that points in one plane have a hull.
            hull = ConvexHull(varying.T, qhull_options="QJ")
            indices.append(members[hull.vertices])
        except (QhullError, ValueError):  # too few points or dimensions for a hull
            _, distinct = np.unique(points, axis=1, return_index=True)
            indices.append(members[distinct])
    return np.concatenate(indices)


def _largest(sign: Callable[[Array], Array], factors: Array, parts: Array) -> Array:
    """Compute the largest value or magnitude over n instants of each combination of parts.

    Parameters
    ----------
    sign : callable
        Function of the values whose largest result is wanted, for example `numpy.abs`.
    factors : (e, k, m, p) array
        Factors of the p parts for each end of the inertia, chain and motor.
    parts : (p, n) array
        Values of the parts at each instant.

    Returns
    -------
    (e, k, m) array
        Largest values of `sign(factors @ parts)`.
    """
    # The values of one chain fit into the processor's cache.
    return np.array([[sign(motors @ parts).max(axis=1) for motors in chains] for chains in factors])


def _heat_answers(
    load: JointLoad,
    motor_data: _MotorData,
    conditions: Conditions,
    band: tuple[Array, Array],
    fails: Mask,
) -> Answers:
    """Answer for each motor whether its winding stays below its temperature limit.

    The two bounds of `_certain_torques` decide most motors. For the others, the largest permitted
    torque is computed, unless the motor fails another check or the two bounds show that the answer
    is open. In these cases, the answer is 0.

    Parameters
    ----------
    load : JointLoad
        Load of the joint with the gear.
    motor_data : _MotorData
        Data of the motors (m).
    conditions : Conditions
        Operating conditions.
    band : two (m,) arrays
        Largest and smallest RMS torque over motion and pause, N·m.
    fails : (m,) array of bool
        True for motors that fail another check.

    Returns
    -------
    (m,) array
        1 passed, 0 not known or not evaluated, −1 failed.
    """
    highest, lowest = band
    answers = np.where(
        highest <= motor_data.cool, 1, np.where(lowest > motor_data.hot, -1, 0)
    ).astype(np.int8)
    needs_evaluation = (
        (answers == 0)
        & ~fails
        & np.isfinite(motor_data.cool)
        & ~((highest > motor_data.hot) & (lowest <= motor_data.cool))
    )
    for m in np.flatnonzero(needs_evaluation).tolist():
        motor = motor_data.motors[m]
        heat = compute_heat(with_motor(load, motor)[0], motor, conditions, highest[m])
        if heat is not None:
            limit = np.array(heat.capacity)
            answers[m] = _answers_from_margins(
                relative_margin(highest[m], limit), relative_margin(lowest[m], limit)
            )
    return answers


def _answers_from_margins(highest_margin: Array, lowest_margin: Array) -> Answers:
    """Convert bounds of a margin into answers.

    The answers are those that `Check.passed` gives for single pairs.

    Parameters
    ----------
    highest_margin, lowest_margin : (m,) arrays
        Margins at the highest and at the lowest possible demand. The first one is thus the smaller.

    Returns
    -------
    (m,) array
        1 if the highest demand keeps the limit, −1 if even the lowest demand exceeds it, otherwise
        0.
    """
    return np.where(
        highest_margin >= -MARGIN_TOLERANCE, 1, np.where(lowest_margin < -MARGIN_TOLERANCE, -1, 0)
    ).astype(np.int8)

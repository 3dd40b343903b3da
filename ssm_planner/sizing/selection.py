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
    gear_checks: Sequence[tuple[Check, ...]]
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
        gear_answers = []
        for chain, checks in zip(self.gears, self.gear_checks, strict=True):
            answers = [ANSWER_CODES[check.passed] for check in checks]
            # With a placeholder figure, the answer is at most 0.
            answers.append(0 if chain.placeholder else 1)
            gear_answers.append(min(answers))
        return np.minimum(self._motor_answers, np.array(gear_answers, np.int8)[:, None])

    @property
    def _motor_answers(self) -> Answers:
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
        names = [name for name, answers in self.answers.items() if answers[g, m] == answer]
        for check in self.gear_checks[g]:
            if ANSWER_CODES[check.passed] == answer:
                names.append(check.name)
        return names

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
        motor_answers = self._motor_answers
        values = self._rank_values(by)
        nominal = [candidate.of.nominal_torque for candidate in self.motors]
        rows = []
        for g, m in np.argwhere(adequate >= 0).tolist():
            row = -adequate[g, m], -motor_answers[g, m], values[g, m], nominal[m], g, m
            rows.append(row)
        return [(g, m) for *_, g, m in sorted(rows)]

    def _rank_values(self, by: Rank) -> Array:
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
        gear = np.array([getattr(chain.gear, by) for chain in self.gears], dtype=float)
        motor = np.array([getattr(part, by) for part in self.motors], dtype=float)
        # A chain without a gearhead has the default 0.
        gearhead = np.array([getattr(chain.gearhead, by, 0.0) for chain in self.gears], dtype=float)
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
        counts: Counter[str] = Counter()
        for row in self._checks_of_pairs(-1):
            for names in row:
                counts.update(names)
        return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))

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
        _, largest_inertia = shaft_inertia(load, motor)
        shaft = largest_inertia - motor.rotor_inertia
        output = (self.load_inertia + drive.output_inertia) / drive.ratio**2
        return (shaft + output) / motor.rotor_inertia

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
        as_json = {code: answer for answer, code in ANSWER_CODES.items()}
        return {
            "joint": self.load.joint,
            "motors": [candidate.label for candidate in self.motors],
            "gears": [candidate.label for candidate in self.gears],
            "adequate": [[as_json[code] for code in row] for row in self.adequate.tolist()],
            "ruled_out_by": self._checks_of_pairs(-1),
            "open": self._checks_of_pairs(0),
            "reasons": self.reasons(),
            "rank": rank,
            "best": [self.pair_dict(g, m) for g, m in self.ranked(rank)[:count]],
        }

    def _checks_of_pairs(self, answer: int) -> list[list[list[str]]]:
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
        table: list[list[list[str]]] = []
        for g, row in enumerate(self.adequate):
            table.append([])
            for m, pair_answer in enumerate(row):
                names = self.checks_with(answer, g, m) if pair_answer == answer else []
                table[-1].append(names)
        return table

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
            "gearhead": gearhead and gearhead.label,
            "mass": motor.mass,
            "gear_mass": chain.gear.mass,
            "gearhead_mass": gearhead and gearhead.mass,
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
    positions = []
    for motion, _ in duty.runs:
        times = np.linspace(0, motion.duration, INERTIA_INSTANTS)
        positions.append(motion.sample(times).q)
    inertias = np.diagonal(body.mass_matrix(np.concatenate(positions)), axis1=1, axis2=2)
    names = [joint.name for joint in duty.robot.joints]
    return dict(zip(names, inertias.max(axis=0).tolist(), strict=True))


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
    period = load.duration + conditions.pause
    motor_data = _MotorData([candidate.of for candidate in motors], conditions, period)
    chains: list[DriveChain] = []
    assessments: list[GearAssessment] = []
    for gear in gears:
        group = [DriveChain(gear)] + [DriveChain(gear, gearhead) for gearhead in gearheads]
        chains += group
        assessments += _assess_gear([chain.load(load) for chain in group], motor_data, conditions)
    answers = {
        name: np.stack([row[name] for row, _, _ in assessments]) for name in assessments[0][0]
    }
    margins = {name: np.stack([row[name] for _, row, _ in assessments]) for name in MARGIN_CHECKS}
    return JointSelection(
        load,
        conditions,
        motors,
        chains,
        answers,
        margins=margins,
        gear_checks=[checks for _, _, checks in assessments],
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
        torques = np.array([_certain_torques(motor, conditions, period) for motor in motors])
        self.cool, self.hot = torques.T

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
        # None becomes NaN.
        return np.array([limits[name].limit for limits in self.limits], dtype=float)


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
    largest_rise = (allowed + TEMPERATURE_MARGIN) * lowest / float(shares.sum())
    rise = largest_rise * np.linspace(0.01, 1.0, RUNAWAY_TEMPERATURES)
    # The torque is 1 N·m, so the power is that per squared torque. The factor 1.001 covers the
    # distance between two of the temperatures.
    unit = np.ones(RUNAWAY_TEMPERATURES)
    power_at_limit, _ = model.power(unit, limit * unit)
    power_at_rise, _ = model.power(unit, model.ambient + rise)
    passes = (allowed - TEMPERATURE_MARGIN) / (highest * power_at_limit[0])
    fails = 1.001 * np.max(rise / (lowest * power_at_rise))
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
    # Checks of the three demands, and factors from the motion to the motion with its pause
    factors = {"torque": 1.0, "continuous_torque": share, "voltage": 1.0}
    demand_ranges = _demand_ranges(chains, case, motor_data)
    for geared, (highest, lowest) in zip(chains, demand_ranges, strict=True):
        checks = drive_checks(case, geared.drive)
        speed_margin = relative_margin(geared.peak_speed, motor_data.max_speed)
        answers = {"speed": _answers_from_margins(speed_margin, speed_margin)}
        margins = {"speed": speed_margin}
        for row, (name, factor) in enumerate(factors.items()):
            limit = motor_data.limit(name)
            margins[name] = relative_margin(factor * highest[row], limit)
            best_margin = relative_margin(factor * lowest[row], limit)
            answers[name] = _answers_from_margins(margins[name], best_margin)
        fails = np.min(list(answers.values()), axis=0) < 0
        fails |= any(check.passed is False for check in checks)
        band = (share * highest[1], share * lowest[1])
        answers["heat"] = _heat_answers(geared, motor_data, conditions, band=band, fails=fails)
        combined = np.min([answers[name] for name in answers if name != "speed"], axis=0)
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
    checks_of_motors = [assess(load, motor, conditions).checks for motor in motor_data.motors]
    answers = {}
    margins = {}
    for k, first_check in enumerate(checks_of_motors[0]):
        name = first_check.name
        checks = [motor_checks[k] for motor_checks in checks_of_motors]
        answers[name] = np.array([ANSWER_CODES[check.passed] for check in checks], np.int8)
        if name in MARGIN_CHECKS:
            margins[name] = np.array([check.margin for check in checks], dtype=float)
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
    # Ends of the ranges of the inertia and of the friction torque, (k, m, 2).
    inertias = np.empty((len(chains), len(motor_data.motors), 2))
    friction = np.empty_like(inertias)
    # Torque factor and ratio of the gearhead of each chain, (k, 1).
    forwards = np.ones((len(chains), 1))
    ratio = np.ones((len(chains), 1))
    for k, chain in enumerate(chains):
        if k and chain.drive.gearhead is not None:
            forwards[k] = chain.drive.gearhead.forwards
            ratio[k] = chain.drive.gearhead.ratio
        for m, motor in enumerate(motor_data.motors):
            inertias[k, m] = shaft_inertia(chain, motor)
            friction[k, m] = motor_friction(chain, motor)
    # Smallest and largest inertia of each pair, or one inertia if all of them are certain.
    inertia_ends = np.moveaxis(np.unique(inertias, axis=2), 2, 0)
    # Factors of the four parts of `CornerTorques`, (ends, k, m, 4).
    factors = np.zeros(inertia_ends.shape + (4,))
    factors[..., 0] = forwards
    factors[..., 1] = ratio * inertia_ends
    factors[..., 2] = friction[..., 1]
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
    speed_factors = np.array([0.0, 0.0, 0.0, 1.0]) * ratio[..., None]
    voltage_states = []
    for state in (0, 1):
        per_torque, per_speed = motor_data.balance[:, state].T[..., None]
        voltage_states.append(per_torque * factors + per_speed * speed_factors)
    voltage_limit = motor_data.limit("voltage") + voltage_drop
    voltage, least_voltage = corners.peaks(voltage_states, corners.extremes, voltage_limit)
    rms = corners.rms(factors)
    largest = np.stack([peak, rms.max(axis=(0, 1)), voltage], axis=1)
    smallest = np.stack([least_peak, rms.min(axis=(0, 1)), least_voltage], axis=1)
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
        torques = []
        for corner in corners:
            drive = drive_with_values(load.drive, corner | {"input_inertia": 0.0})
            torques.append(replace(load, drive=drive).torque())
        self._torques = np.array(torques)
        turning = load.acceleration() * (load.direction != 0)
        self._motion = np.stack([turning, load.direction, load.speed()])
        self._weight = load.weight
        least = np.vstack([self._torques.min(axis=0), self._motion])
        most = np.vstack([self._torques.max(axis=0), self._motion])
        both = np.hstack([least, most])
        self.extremes = both[:, _extreme_instants(both)]
        self._least = least[:, _extreme_instants(least[:3])]
        self._most = most[:, _extreme_instants(most[:3])]
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
        squares = []
        for torque in self._torques:
            parts = np.vstack([torque, self._motion])
            # The mean square of Σ f_i part_i is fᵀ P f with the mean products P of the parts.
            mean_products = parts * self._weight @ parts.T
            squares.append(np.sum(factors @ mean_products * factors, axis=-1))
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
        peaks = []
        bounds = []
        for factors in states:
            peaks.append(_largest_values(np.abs, factors, parts).max(axis=0))
            # At every instant, the smallest magnitude over all corners is at least the value with
            # the smallest torque, and at least minus the value with the largest torque.
            forwards = _largest_values(np.positive, factors, self._least)
            backwards = _largest_values(np.negative, factors, self._most)
            bounds.append(np.maximum(forwards, backwards).min(axis=0))
        peak = np.max(peaks, axis=0)
        smallest = np.max(bounds, axis=0)
        is_open = (peak > limit) & (smallest <= limit * (1 + 2 * MARGIN_TOLERANCE))
        for k, m in np.argwhere(is_open):
            # All instants at every corner decide, (states, ends, corners, instants).
            rows = np.array([factors[:, k, m] for factors in states])
            torques = rows[..., :1, None] * self._torques
            values = torques + (rows[..., 1:] @ self._motion)[:, :, None]
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


def _largest_values(transform: Callable[[Array], Array], factors: Array, parts: Array) -> Array:
    """Compute the largest transformed value over n instants of each combination of parts.

    Parameters
    ----------
    transform : callable
        Function of the values whose largest result is wanted, for example `numpy.abs`.
    factors : (e, k, m, p) array
        Factors of the p parts for each end of the inertia, chain and motor.
    parts : (p, n) array
        Values of the parts at each instant.

    Returns
    -------
    (e, k, m) array
        Largest values of `transform(factors @ parts)`.
    """
    largest = np.empty(factors.shape[:3])
    # The values of one chain fit into the processor's cache.
    for end, k in np.ndindex(factors.shape[:2]):
        largest[end, k] = transform(factors[end, k] @ parts).max(axis=1)
    return largest


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
    answers = _answers(highest <= motor_data.cool, lowest > motor_data.hot)
    is_known = np.isfinite(motor_data.cool)
    stays_open = (highest > motor_data.hot) & (lowest <= motor_data.cool)
    for m in np.flatnonzero((answers == 0) & ~fails & is_known & ~stays_open).tolist():
        motor = motor_data.motors[m]
        motor_load, *_ = with_motor(load, motor)
        heat = compute_heat(motor_load, motor, conditions, highest[m])
        if heat is not None:
            margin = relative_margin(highest[m], heat.capacity)
            best_margin = relative_margin(lowest[m], heat.capacity)
            answers[m] = _answers_from_margins(margin, best_margin)
    return answers


def _answers_from_margins(margin: Array, best_margin: Array) -> Answers:
    """Convert bounds of a margin into answers.

    The answers are those that `Check.passed` gives for single pairs.

    Parameters
    ----------
    margin, best_margin : (m,) arrays
        Margins at the highest and at the lowest possible demand. The first one is thus the smaller.

    Returns
    -------
    (m,) array
        1 if the highest demand keeps the limit, −1 if even the lowest demand exceeds it, otherwise
        0.
    """
    return _answers(margin >= -MARGIN_TOLERANCE, best_margin < -MARGIN_TOLERANCE)


def _answers(passes: Mask, fails: Mask) -> Answers:
    """Combine the masks of passed and of failed checks into answers.

    Parameters
    ----------
    passes, fails : arrays of bool of the same shape
        True if the check certainly passes, and if it certainly fails.

    Returns
    -------
    array of the same shape
        1 passed, −1 failed, 0 not known.
    """
    return np.select([passes, fails], [1, -1]).astype(np.int8)

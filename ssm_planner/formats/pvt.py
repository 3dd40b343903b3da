"""Export tables of position, velocity and time (PVT) for drives that interpolate with cubics.

Elmo's PVT mode and the IPM mode of maxon EPOS2 and EPOS3 use such tables. Times are whole
milliseconds, and positions are whole increments. Therefore, the rows cannot lie exactly at the
acceleration jumps of the plan or exactly on the plan. Cubics through rounded samples of the plan
would exceed its limits.

For this reason, a linear program determines the positions and velocities in the table of each joint
(class `_RowFit`, which states the program). It finds the rows nearest to a slightly slower plan for
which the cubics stay within the accelerations, velocities and positions that the plan has nearby.
`export_pvt` then checks the motion that the drives will execute. `read_pvt` reads exported tables
again.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.agreement import ExportContent, file_name_suffix
from ssm_planner.formats.csv import table_text
from ssm_planner.formats.epos4 import increments_per_unit, read_joint_tables, replace_end_rates
from ssm_planner.formats.epos4_setup import (
    INT32_MAX,
    Axis,
    CountsPerTurn,
    check_integer_range,
    drive_axes,
    encoder_notes,
)
from ssm_planner.formats.points import Points, Reading, interpolate_points
from ssm_planner.formats.spline_points import sample_slowed_plan
from ssm_planner.plans import Plan
from ssm_planner.problem import Joint, Robot, TaskLimits
from ssm_planner.typing import Array, JsonObject, record
from ssm_planner.verification import Certificate

INT24_MAX = 2**23 - 1
"""Largest velocity in increments/s that the drives accept (24 bits with sign)."""
LARGEST_ROW_MS = 255
"""Largest duration of one row, ms (8 bits)."""
ROW_INTERVALS_MS = (40, 60, 25, 100)
"""Times between rows (ms) in the order of trial.

Short intervals suffer from the rounding to increments. Long intervals deviate from the plan.
"""
SLOWDOWNS = (0.002, 0.005, 0.01, 0.02, 0.05)
"""Relative increases of the plan's duration in the order of trial."""
ACCELERATION_TOLERANCE = 0.01
"""Largest excess over the nearby accelerations of the plan, relative to the acceleration limit."""
PLAN_SAMPLES_PER_ROW = 40
"""Number of samples of the plan per row that determine its nearby extremes."""
UNDRIVEN_UNITS = 1e5
"""Units per rad or m of a joint without a drive, in place of increments. They are not rounded."""
EXCESS_COST = 1e6
"""Cost of exceeding an acceleration bound by the whole limit, as a deviation in increments."""
TIME_COLUMN = "time_ms"
"""Name of the column with the time since the previous row."""
POSITION_COLUMN = "position"
"""Beginning of the name of the column with positions. The unit follows."""
VELOCITY_COLUMN = "velocity"
"""Beginning of the name of the column with velocities. The unit follows."""
COLUMN_EXPLANATIONS = {
    "time_ms": "time since the previous row, 1 to 255; 0 in the first row, whose time is not used",
    "position_inc": "absolute, INT32",
    "velocity_inc_per_s": "velocity at the row, 24 bits with sign; for a drive with the unit 1e-3 "
    "rpm, multiply by mrpm_per_inc_per_s",
    "between": "cubic polynomial with the positions and velocities of both rows",
    "start": "first row: position and velocity that the axis must have at the start",
    "end": "last row: the target; the command that ends a table depends on the drive",
}
"""Entry of the manifest that explains the columns and the motion between the rows."""
UNTESTED_ASSUMPTIONS = (
    "the export was not tested on a drive: format and interpolation follow Elmo's SimplIQ manual "
    "(P 32, V 24, T 8 bits; ms, counts/s) and maxon's IPM application note for the EPOS2 (0x20C1); "
    "the EPOS4 does not have this mode",
    "both drives hold 64 rows at a time: send the rest of a longer table while it runs",
    "no source states the velocity unit of the drives and the command that ends a table: see the "
    "manual of the drive",
)
"""Statements about the drives that were not tested."""


@record
class PvtTable:
    """Rows of all joints at n times, and the certificate of the cubics between them."""

    t: Array
    """Times in s (n,), multiples of 1 ms."""
    rows: dict[str, tuple[Array, Array]]
    """Positions and velocities (n,) by name of the joint, in increments and increments/s.

    A joint without a drive has rad and rad/s (joints 1 to 3), or m and m/s (joint 4).
    """
    stretch: float
    """Duration of the table divided by the duration of the plan."""
    limits: TaskLimits
    """Limits of the slower motion, with the rates at both ends of the table."""
    certificate: Certificate
    """Certificate of the motion that the drives execute for these rows."""


def export_pvt(
    plan: Plan,
    certificate: Certificate,
    folder: Path,
    suffix: str,
    counts_per_turn: CountsPerTurn = None,
) -> JsonObject:
    """Write one table per joint and return the entries of the manifest.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    certificate : Certificate
        Certificate of the plan.
    folder : Path
        Export folder.
    suffix : str
        Text before the extension of all file names: "" for a verified plan, or "_unverified".
    counts_per_turn : int or mapping from joint to int, optional
        Increments per motor turn (4 × encoder counts), for all joints or by joint. The default
        comes from the motor files.

    Returns
    -------
    dict
        Entries that this format adds to the manifest. They contain the certificate of the cubics
        and the largest deviation of the rows from the plan.

    Raises
    ------
    ExportError
        If no table keeps the limits, an encoder resolution is missing, or a number does not fit.
    """
    axes = drive_axes(plan.robot, counts_per_turn)
    table = _feasible_table(plan, certificate, axes)
    files = pvt_content(plan.robot, axes, table.t, table.rows, limits=table.limits, suffix=suffix)
    entries = files.write(folder)
    notes = [
        f"{len(table.t)} rows, {100 * (table.stretch - 1):.2g} % slower than the plan; "
        f"{table.certificate.interpolation}"
    ]
    planned = sample_slowed_plan(plan, plan.motion.breaks[0] + table.t, table.stretch)
    for joint, q in zip(plan.robot.joints, planned.q.T, strict=True):
        if joint.name in axes:
            position = table.rows[joint.name][0] / increments_per_unit(axes, joint.name)
            deviation = float(np.abs(position - q).max())
            entries["axes"][joint.name]["deviation"] = deviation
            notes.append(
                f"joint {joint.name}: up to {deviation:.2g} {joint.unit} from the plan at the rows"
            )
    return {
        **entries,
        "spline": {
            "interpolation": table.certificate.interpolation,
            "certificate": table.certificate.to_dict(),
        },
        "form": COLUMN_EXPLANATIONS,
        "stretch": table.stretch,
        "not_verified": list(UNTESTED_ASSUMPTIONS),
        "notes": notes + encoder_notes(axes),
    }


def pvt_content(
    robot: Robot,
    axes: Mapping[str, Axis],
    t: Array,
    rows: Mapping[str, tuple[Array, Array]],
    *,
    limits: TaskLimits,
    suffix: str,
) -> ExportContent:
    """Return the files and the entries of the manifest for a table.

    Parameters
    ----------
    robot : Robot
        Robot that performs the motion.
    axes : mapping of str to Axis
        Drives by joint.
    t : (n,) array
        Times of the rows, s.
    rows : mapping of str to two (n,) arrays
        Positions and velocities by name of the joint, in increments and increments/s. A joint
        without a drive has rad and rad/s (joints 1 to 3), or m and m/s (joint 4).
    limits : TaskLimits
        Limits of the task, of which the manifest states the declared rates at both ends.
    suffix : str
        Text before the extension of all file names: "" for a verified plan, or "_unverified".

    Returns
    -------
    ExportContent
        One CSV file for each joint, and the entries rate_hz, units, axes and rates of the manifest.

    Raises
    ------
    ExportError
        If a number does not fit into the table of a drive.
    """
    files = {}
    entries: JsonObject = {}
    times = np.round(np.diff(t, prepend=t[0]) * 1000)
    for joint in robot.joints:
        name = f"{joint.name}{suffix}.csv"
        axis = axes.get(joint.name)
        position, velocity = rows[joint.name]
        form = "%.17g" if axis is None else "%d"
        columns = dict(
            zip(_column_names(joint, axis is not None), (position, velocity), strict=True)
        )
        entries[joint.name] = {
            "file": name,
            "start": float(position[0]),
            "start_velocity": float(velocity[0]),
            "end": float(position[-1]),
            "end_velocity": float(velocity[-1]),
        }
        if axis is None:
            note = "no drive: the file shows the joint's motion for reference"
            entries[joint.name]["note"] = note
        else:
            check_integer_range(position, INT32_MAX, joint.name, "position", "increments")
            check_integer_range(velocity, INT24_MAX, joint.name, "velocity", "increments/s")
            mrpm = {"mrpm_per_inc_per_s": 60_000 / axis.counts_per_turn}
            entries[joint.name] |= {**axis.to_dict(), **mrpm}
        files[name] = table_text({TIME_COLUMN: times, **columns}, ("%d", form))
    return ExportContent(
        {
            "rate_hz": None,
            "units": {
                "time": "ms",
                "position": "increments",
                "velocity": "increments/s; without a drive rad, m and s",
            },
            "axes": entries,
            **limits.declared_rates,
        },
        files,
    )


def read_pvt(folder: Path, manifest: JsonObject, names: Collection[str], robot: Robot) -> Reading:
    """Read the motion that drives execute for exported tables.

    The motion consists of cubics between the rows of the tables.

    Parameters
    ----------
    folder : Path
        Export folder.
    manifest : dict
        Content of the manifest.json of the folder.
    names : collection of str
        Files of the manifest whose content is unchanged since the export.
    robot : Robot
        Robot that performs the motion.

    Returns
    -------
    Reading
        The motion, and the content that the folder must have for this motion.

    Raises
    ------
    TrajectoryError
        If a table is damaged, or if it does not belong to the robot.
    """
    axes, steps, tables = read_joint_tables(folder, manifest, robot, TIME_COLUMN, _column_names)
    if steps[0] != 0 or np.any(steps[1:] != np.clip(np.round(steps[1:]), 1, LARGEST_ROW_MS)):
        raise TrajectoryError(
            f"{folder}: {TIME_COLUMN} must be 0 in the first row and an integer from 1 to "
            f"{LARGEST_ROW_MS} in all others"
        )
    t = np.cumsum(steps) / 1000
    scales = [increments_per_unit(axes, name) for name in tables]
    q, qd = np.stack(list(tables.values()), axis=2) / scales
    reading = interpolate_points(Points(t, q, qd, point_name=f"{folder}: row {{}}".format), robot)
    declared = TaskLimits(start_rate=manifest.get("start_rate"), end_rate=manifest.get("end_rate"))
    rows = {name: (table[0], table[1]) for name, table in tables.items()}
    limits = replace_end_rates(declared, robot, q, qd)
    suffix = file_name_suffix(manifest)
    derived = pvt_content(robot, axes, t, rows, limits=limits, suffix=suffix)
    return replace(reading, content=derived)


def _column_names(joint: Joint, driven: bool) -> tuple[str, str]:
    """Return the names of the columns with the positions and the velocities of a joint.

    Parameters
    ----------
    joint : Joint
        Joint of the table.
    driven : bool
        True if the joint has a drive, so that its positions are in increments.

    Returns
    -------
    position, velocity : str
        Names such as "position_inc" and "velocity_inc_per_s".
    """
    unit = "inc" if driven else joint.unit
    return f"{POSITION_COLUMN}_{unit}", f"{VELOCITY_COLUMN}_{unit}_per_s"


def _feasible_table(plan: Plan, certificate: Certificate, axes: dict[str, Axis]) -> PvtTable:
    """Return the first candidate table whose cubics keep every limit.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    certificate : Certificate
        Certificate of the plan. If it did not pass, the result is the first table, even if this
        table exceeds a limit.
    axes : dict of Axis
        Drives by name of the joint.

    Returns
    -------
    PvtTable
        Rows of all joints with the certificate of the cubics between them.

    Raises
    ------
    ExportError
        If every table exceeds a limit. The message describes the violation of the best table.
    """
    certificates = []
    for table in _candidate_tables(plan, axes, SLOWDOWNS if certificate.passed else (0.0,)):
        if table.certificate.passed or not certificate.passed:
            return table
        certificates.append(table.certificate)
    violation = max(certificates, key=lambda certificate: certificate.worst.margin).worst
    jerk = ""
    if plan.robot.jerk_limited:
        jerk = "; cubics have acceleration jumps at the rows, which jerk limits forbid"
    raise ExportError(
        f"{plan.path}: no PVT table was found that keeps the limits: the best one exceeds "
        f"{violation.excess}{jerk}"
    )


def _candidate_tables(
    plan: Plan, axes: dict[str, Axis], slowdowns: Collection[float]
) -> Iterator[PvtTable]:
    """Yield candidate tables of a plan that differ in duration and in the time between rows.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    axes : dict of Axis
        Drives by name of the joint.
    slowdowns : collection of float
        Relative increases of the plan's duration, in the order of trial. For each of them, the
        function tries all times between rows in `ROW_INTERVALS_MS`.

    Yields
    ------
    PvtTable
        Rows of all joints with the certificate of the cubics between them.

    Raises
    ------
    ExportError
        If the motion is too short for a table.
    """
    for slowdown in slowdowns:
        for interval_ms in ROW_INTERVALS_MS:
            total_ms = int(np.ceil(plan.motion.duration * (1 + slowdown) * 1000 - 1e-6))
            intervals = max(int(np.ceil(total_ms / interval_ms)), 2)
            if total_ms < intervals:
                raise ExportError(
                    f"{plan.path}: the motion of {total_ms} ms is too short for a table"
                )
            t = np.round(np.linspace(0, total_ms, intervals + 1)) / 1000
            stretch = total_ms / 1000 / plan.motion.duration
            rows = {}
            q = np.empty((len(t), 4))
            qd = np.empty((len(t), 4))
            for i, joint in enumerate(plan.robot.joints):
                axis = axes.get(joint.name)
                unit = UNDRIVEN_UNITS if axis is None else axis.increments_per_unit
                fit = _RowFit(plan, i, t, stretch, unit)
                position, velocity = fit.rows(round_to_units=axis is not None)
                q[:, i] = position / unit
                qd[:, i] = velocity / unit
                rows[joint.name] = (q[:, i], qd[:, i]) if axis is None else (position, velocity)
            reading = interpolate_points(Points(t, q, qd), plan.robot)
            limits = replace_end_rates(plan.limits.slower(stretch), plan.robot, q, qd)
            yield PvtTable(t, rows, stretch, limits, reading.check(plan.robot, limits))


class _RowFit:
    """Linear program that determines the positions and velocities in the table of one joint.

    The table has n rows with a position p and a velocity v each. Positions are in increments of the
    encoder, and velocities in increments per τ, the mean time between rows. The unknowns are the
    deviations d of the n positions and w of the n velocities from the plan, bounds e of |d|, and an
    excess ε. The linear program is

        minimise    Σ e + EXCESS_COST · ε
        subject to  −e ≤ d ≤ e,  ε ≥ 0

    and on each interval between two rows

        a_low − ε·a_max ≤ accelerations at both ends ≤ a_high + ε·a_max
        v_low ≤ middle Bernstein coefficient of the velocity ≤ v_high
        p_low ≤ inner Bernstein coefficients of the position ≤ p_high

    The acceleration of a cubic is linear in time, so its values at both ends bound it. All
    conditions are linear in d and w: with the interval's length h (in τ) and the rows 0 and 1 at
    its ends, the accelerations are 6 (p₁ − p₀)/h² − (4 v₀ + 2 v₁)/h and
    −6 (p₁ − p₀)/h² + (2 v₀ + 4 v₁)/h. The velocity coefficient is 3 (p₁ − p₀)/h − v₀ − v₁. The
    position coefficients are p₀ + h v₀/3 and p₁ − h v₁/3. The bounds a_low to p_high are the
    extremes of the plan on the interval and on its two neighbours. The bounds of the acceleration
    are widened by `ACCELERATION_TOLERANCE`, but stay below the limit by the effect of rounding.
    a_max is the acceleration limit of the joint. d is fixed at the ends of the motion and, in a
    second step, for rounded positions. w is 0 at the ends of the motion.
    """

    def __init__(self, plan: Plan, i: int, t: Array, stretch: float, unit: float) -> None:
        """Compute the coefficients and bounds of the linear program for one joint.

        Parameters
        ----------
        plan : Plan
            Plan that is exported.
        i : int
            Index of the joint, from 0.
        t : (n,) array
            Times of the rows, s.
        stretch : float
            Duration of the table divided by the duration of the plan.
        unit : float
            Increments of the encoder per rad or m of the joint.
        """
        joint = plan.robot.joints[i]
        motion = plan.motion
        n = len(t)
        tau = float(t[-1]) / (n - 1)
        planned = sample_slowed_plan(plan, motion.breaks[0] + t, stretch)
        self.rate = 1 / tau
        self.positions = planned.q[:, i] * unit
        self.velocities = planned.qd[:, i] * unit * tau
        low, high = sorted(bound * unit for bound in joint.position)
        # The range in whole increments. The tolerance keeps a bound that is itself an increment.
        self.range = np.ceil(low - 1e-6), np.floor(high + 1e-6)
        breaks = (motion.breaks - motion.breaks[0]) * stretch
        self._sample_times = np.unique(
            np.concatenate([t, breaks, np.linspace(0, t[-1], PLAN_SAMPLES_PER_ROW * n)])
        )
        self._interval_starts = np.searchsorted(self._sample_times, t[:-1])
        instants = motion.breaks[0] + self._sample_times / stretch
        # The left and right values differ where the acceleration of the plan jumps.
        sides = [motion.sample(instants, "left"), motion.sample(instants, "right")]
        positions = np.array([samples.q[:, i] for samples in sides]) * unit
        velocities = np.array([samples.qd[:, i] for samples in sides]) * unit * tau
        planned_accelerations = np.array([samples.qdd[:, i] for samples in sides]) * unit * tau**2
        # The bounds include the accelerations of the plan and those of the slower plan.
        accelerations = np.concatenate([planned_accelerations, planned_accelerations / stretch**2])
        p = self._neighbourhood_extremes(positions)
        v = self._neighbourhood_extremes(velocities)
        a = self._neighbourhood_extremes(accelerations)
        limit = abs(joint.acceleration * unit * tau**2)
        h = np.diff(t) / tau
        # Rounding both positions by half an increment changes an acceleration by at most
        # 6 / h², and seldom by more than 3 / h².
        maximum = max(limit, float(np.abs(accelerations).max())) - 3 / h**2
        slack = ACCELERATION_TOLERANCE * limit
        a = np.maximum(a[0] - slack, -maximum), np.minimum(a[1] + slack, maximum)
        zeros = np.zeros(n - 1)
        ones = np.ones(n - 1)
        self.constraints = (
            ((-6 / h**2, 6 / h**2, -4 / h, -2 / h), a, limit),
            ((6 / h**2, -6 / h**2, 2 / h, 4 / h), a, limit),
            ((-3 / h, 3 / h, -ones, -ones), v, 0.0),
            ((ones, zeros, h / 3, zeros), p, 0.0),
            ((zeros, ones, zeros, -h / 3), p, 0.0),
        )
        """Conditions of the linear program on every interval.

        A condition consists of the factors of p₀, p₁, v₀ and v₁, the bounds of the sum of these
        products, and the amount by which the sum may exceed the bounds if ε = 1.
        """

    def _neighbourhood_extremes(self, values: Array) -> tuple[Array, Array]:
        """Return the extremes of a quantity on each interval together with its two neighbours.

        Parameters
        ----------
        values : (k, m) array
            Values of the quantity at m instants of the plan (`_sample_times`). The extremes are
            taken over all k rows of the array. Two rows contain the values just before and just
            after each instant, which differ at a jump. For accelerations, two more rows contain
            those of the slower plan.

        Returns
        -------
        lowest, highest : (n − 1,) arrays
            Extremes for each interval between two rows.
        """
        # Each interval is combined with its neighbours. The first and the last one are repeated.
        low = np.pad(np.minimum.reduceat(values.min(axis=0), self._interval_starts), 1, mode="edge")
        high = np.pad(
            np.maximum.reduceat(values.max(axis=0), self._interval_starts), 1, mode="edge"
        )
        lowest = np.min([low[:-2], low[1:-1], low[2:]], axis=0)
        highest = np.max([high[:-2], high[1:-1], high[2:]], axis=0)
        return lowest, highest

    def rows(self, round_to_units: bool) -> tuple[Array, Array]:
        """Return the positions and velocities of the joint at all rows of its table.

        The drive interpolates the rows by cubic polynomials. The linear program of the class moves
        the positions as little as possible from the plan so that these polynomials stay within
        the accelerations, velocities and positions that the plan has nearby.

        Parameters
        ----------
        round_to_units : bool
            True to round the results to integers. The method then solves the program twice: the
            positions of the first solution are rounded, and the second solution determines the
            velocities for these fixed positions.

        Returns
        -------
        positions, velocities : (n,) arrays
            Rows in increments and increments/s.
        """
        free = np.pad(np.ones(len(self.positions) - 2), 1)
        if not round_to_units:
            d, w = self._solve(np.zeros(len(self.positions)), free)
            return self.positions + d, (self.velocities + w) * self.rate
        ends = np.clip(np.round(self.positions), *self.range) - self.positions
        d, _ = self._solve(ends, free)
        position = np.clip(np.round(self.positions + d), *self.range)
        _, w = self._solve(position - self.positions, np.zeros(len(ends)))
        return position, np.round((self.velocities + w) * self.rate)

    def _solve(self, d: Array, free: Array) -> tuple[Array, Array]:
        """Solve the linear program of the class for given values of some positions.

        Parameters
        ----------
        d : (n,) array
            Deviations of the fixed positions from the plan, in increments. Entries for positions
            that are not fixed are ignored.
        free : (n,) array
            0 for a fixed position, and 1 for a position whose deviation is unknown.

        Returns
        -------
        d : (n,) array
            Deviations of the positions from the plan, increments.
        w : (n,) array
            Deviations of the velocities from the plan, increments per mean time between rows. Both
            arrays are 0 if the solver finds no solution.
        """
        # SciPy's solver takes long to import, and other exports do not need it.
        from scipy import sparse
        from scipy.optimize import Bounds, LinearConstraint, milp

        n = len(d)
        # These matrices select the row at the beginning, and the row at the end, of each interval.
        first_rows = sparse.eye(n - 1, n)
        second_rows = sparse.eye(n - 1, n, k=1)
        eye = sparse.eye(n)
        is_fixed = free == 0
        fixed_positions = np.where(is_fixed, d, 0.0) + self.positions
        blocks: list[list[Any]] = []
        upper: list[Array] = []
        for (p0, p1, v0, v1), (low, high), tolerance in self.constraints:
            positions: Any = sparse.diags(p0) @ first_rows + sparse.diags(p1) @ second_rows
            velocities: Any = sparse.diags(v0) @ first_rows + sparse.diags(v1) @ second_rows
            planned = positions @ self.positions + velocities @ self.velocities
            rounded = positions @ fixed_positions + velocities @ self.velocities
            for sign, bound in ((1, high), (-1, -low)):
                # Samples of the plan and rounded positions may lie slightly beyond the nearby
                # extremes. A condition without a tolerance must allow them.
                if not tolerance:
                    bound = np.max([bound, sign * planned, sign * rounded], axis=0)
                blocks.append(
                    [sign * positions, sign * velocities, None, np.full((n - 1, 1), -tolerance)]
                )
                upper.append(bound - sign * planned)
        # The deviations d lie between −e and e.
        for sign in (1, -1):
            blocks.append([sign * eye, None, -eye, None])
            upper.append(np.zeros(n))
        # The velocities at both ends of the motion are those of the plan.
        velocity_range = np.pad(np.full(n - 2, np.inf), 1)
        low = np.where(is_fixed, d, -np.inf)
        high = np.where(is_fixed, d, np.inf)
        # The unknowns are d, w and e with n entries each, and then ε.
        costs = np.r_[np.zeros(2 * n), np.ones(n), EXCESS_COST]
        matrix = sparse.bmat(blocks, format="csr")
        lowest = np.r_[low, -velocity_range, np.zeros(n + 1)]
        highest = np.r_[high, velocity_range, np.full(n + 1, np.inf)]
        solution = milp(
            costs,
            constraints=LinearConstraint(matrix, -np.inf, np.concatenate(upper)),
            bounds=Bounds(lowest, highest),
        )
        x = np.zeros(3 * n + 1) if solution.x is None else solution.x
        return x[:n], x[n : 2 * n]

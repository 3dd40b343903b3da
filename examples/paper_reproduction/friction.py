"""Compare friction with the paper: the torque–velocity maps of Table II, and the three test rigs.

For the rigs, the section compares parameters that were identified from the shipped tables with
those of the authors, and predicted torque with measured torque.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from paper_reproduction import published
from paper_reproduction.published import (
    DRIVEN,
    NUMBER,
    PACKAGE_FRICTION,
    RIGS,
    TABLE_II,
    FrictionRow,
    Inputs,
)
from paper_reproduction.section import Section
from ssm_planner.display import MISSING_VALUE, format_number, format_percent
from ssm_planner.dynamics import RigidBody, breakaway_torque, required_friction
from ssm_planner.errors import RecordingError
from ssm_planner.identification import (
    TABLE_NAME,
    MapFit,
    TorqueMap,
    drive_with_parameters,
    fit_map,
    map_torque,
    nrmsd,
    predict_recording,
    read_recordings,
    read_torque_map,
)
from ssm_planner.kinematics import Mechanism, inverse_task
from ssm_planner.problem import JOINTS, Drive, Friction, FrictionLawName, Joint, Rig, Robot
from ssm_planner.reporting import (
    COLOURS,
    FIFTH_COLOUR,
    FONT_SIZE,
    draw_legend,
    draw_legend_above,
    draw_zero_lines,
    finish_axes,
    map_speeds,
    new_figure,
)
from ssm_planner.typing import Array, record
from ssm_planner.units import RPM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAP_SPEEDS = {
    "roll": published.ROTARY_SPEED,
    "tilt": published.ROTARY_SPEED,
    "insertion": published.LINEAR_SPEED,
}
"""Largest joint speed of each map, which the application requires, rad/s and m/s."""
POINTS = 121
"""Number of speeds in a map, including 0."""
LOADS = 81
"""Number of samples in the range of gravity loads."""
CURVES = ("under the arm's weight", "Table II, no load", "package, no load", "breakaway, no load")
"""Labels of the curves in the figure."""


@record
class FrictionMap:
    """Torque–velocity map of one joint.

    The motor speeds (n,) are positive, in rad/s. The torques (n,) are in N·m.
    """

    joint: str
    drive: Drive
    w: Array
    unloaded: tuple[Array, Array]
    """Torque without load in forward motion (at w) and in backward motion (at −w)."""
    package: tuple[Array, Array]
    """Torque without load, with the package's parameters."""
    loaded: tuple[tuple[Array, Array], tuple[Array, Array]]
    """Smallest and largest torque under the arm's weight, for both directions."""
    gravity: tuple[float, float]
    """Range of the effort of gravity, N·m or N."""
    start: float
    """Breakaway torque without load, N·m."""

    @property
    def mesh(self) -> float:
        """Part of the torque at the largest speed without load that the gear mesh causes, N·m."""
        row = TABLE_II[self.joint]
        return float(self.unloaded[0][-1] - row.b_c - row.b_v * self.w[-1])

    @property
    def max_friction(self) -> float:
        """Largest motor torque under the arm's weight in both directions, N·m."""
        forwards, backwards = self.loaded
        return float(max(forwards[1].max(), -backwards[0].min()))


def driven(robot: Robot, joint: str) -> Drive:
    """Return the drive of a joint, which must have one."""
    drive = robot.joints[JOINTS.index(joint)].drive
    assert drive is not None, joint
    return drive


def with_friction(drive: Drive, row: FrictionRow) -> Drive:
    """Return a drive with the friction parameters of a row of a published table.

    The friction on the output side does not change.
    """
    current = drive.friction or Friction(row.mu, row.mu_static, row.b_c, row.b_v)
    return replace(
        drive,
        friction=replace(current, mu=row.mu, mu_static=row.mu_static, b_c=row.b_c, b_v=row.b_v),
    )


def gravity_ranges(robot: Robot) -> tuple[Array, Array]:
    """Return the smallest and the largest effort of gravity on each joint, (4,) each, N·m and N.

    The poses cover the robot's tilt range, ±30° of roll and the required travel.
    """
    mechanism = Mechanism.from_robot(robot)
    low, high = robot.ranges["tilt"]
    half = published.REQUIRED_ROLL / 2
    axes = (
        np.linspace(-half, half, 13),
        np.linspace(low, high, 60),
        [0.0],
        [0.0, published.REQUIRED_TRAVEL],
    )
    task = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 4)
    solutions = inverse_task(mechanism, task)
    home = int(np.flatnonzero(solutions.branch[0] == mechanism.home_branch)[0])
    load = RigidBody.from_robot(robot).gravity_load(np.ascontiguousarray(solutions.joints[:, home]))
    return load.min(axis=0), load.max(axis=0)


def friction_maps(robot: Robot) -> tuple[FrictionMap, ...]:
    """Compute the torque–velocity maps of the driven joints, which are joints 1, 2 and 4."""
    low, high = gravity_ranges(robot)
    maps = []
    for joint in DRIVEN:
        drive = driven(robot, joint)
        i = JOINTS.index(joint)
        paper = with_friction(drive, TABLE_II[joint])
        package = with_friction(drive, PACKAGE_FRICTION[joint])
        w = np.linspace(0.0, drive.ratio * MAP_SPEEDS[joint], POINTS)[1:]
        loads = np.linspace(low[i], high[i], LOADS)
        loads = np.append(loads, np.clip(0.0, low[i], high[i]))
        sheets = [
            np.array([map_torque(paper, sign * w, load) for load in loads]) for sign in (1.0, -1.0)
        ]
        maps.append(
            FrictionMap(
                joint,
                drive=paper,
                w=w,
                unloaded=(map_torque(paper, w, 0.0), map_torque(paper, -w, 0.0)),
                package=(map_torque(package, w, 0.0), map_torque(package, -w, 0.0)),
                loaded=(
                    (sheets[0].min(axis=0), sheets[0].max(axis=0)),
                    (sheets[1].min(axis=0), sheets[1].max(axis=0)),
                ),
                gravity=(float(low[i]), float(high[i])),
                start=float(breakaway_torque(paper, 0.0, 1.0)),
            )
        )
    return tuple(maps)


def friction_section(robot: Robot) -> Section:
    """Build the section about Table II with the torque–velocity maps."""
    maps, (low, high) = friction_maps(robot), robot.ranges["tilt"]
    parameters = (
        _parameter(robot, "mu", "μ_c", 1.0),
        _parameter(robot, "mu_static", "μ_s", 1.0),
        _parameter(robot, "b_c", "10³ b_c (N·m)", 1e3),
        _parameter(robot, "b_v", "10⁵ b_v (N·m·s/rad)", 1e5),
    )
    columns = [_torques(friction_map) for friction_map in maps]
    values = {
        "parameters": parameters,
        "ratios": [PACKAGE_FRICTION[joint].b_c / TABLE_II[joint].b_c for joint in DRIVEN],
        "torques": [(name, *(column[name] for column in columns)) for name in columns[0]],
        "low": low,
        "high": high,
    }
    return Section("friction", values, {"friction_maps": _maps_figure(maps)})


def _torques(friction_map: FrictionMap) -> dict[str, str]:
    """Return the cells of a joint in the table of torques, by name of the row.

    Torques are in mN·m.
    """
    row = TABLE_II[friction_map.joint]
    torques = {
        "no load, slow": friction_map.unloaded[0][0],
        "no load, top speed": friction_map.unloaded[0][-1],
        "of which bearing, Coulomb": row.b_c,
        "of which bearing, viscous": row.b_v * friction_map.w[-1],
        "of which mesh, by μ_c": friction_map.mesh,
        "no load, breakaway, by μ_s": friction_map.start,
        "the package's parameters, no load, top speed": friction_map.package[0][-1],
    }
    return {
        "top speed of the map (rpm)": f"{RPM * friction_map.w[-1]:.0f}",
        **{name: format_number(1e3 * torque) for name, torque in torques.items()},
        "effort of the arm's weight (N·m, N·m, N)": " … ".join(
            map(format_number, friction_map.gravity)
        ),
        "under the arm's weight, largest": format_number(1e3 * friction_map.max_friction),
    }


def _parameter(robot: Robot, name: str, symbol: str, scale: float) -> tuple[str, ...]:
    """Return a row of the table of parameters.

    The cells are the symbol, the values of the paper, those of the robot file, their differences,
    and the values of the package, each for all driven joints.

    Parameters
    ----------
    robot : Robot
        Robot with its drives.
    name : str
        Name of the parameter.
    symbol : str
        Symbol with its unit.
    scale : float
        Factor from SI units to this unit.
    """
    paper, package = (
        [getattr(rows[joint], name) for joint in DRIVEN] for rows in (TABLE_II, PACKAGE_FRICTION)
    )
    ours = [float(getattr(driven(robot, joint).friction, name)) for joint in DRIVEN]
    difference = [mine - theirs for mine, theirs in zip(ours, paper, strict=True)]
    columns = (paper, ours, difference, package)
    return (
        symbol,
        *(" / ".join(format_number(scale * value) for value in values) for values in columns),
    )


def _maps_figure(maps: tuple[FrictionMap, ...]) -> "Figure":
    """Draw the torque–velocity maps of all joints side by side."""
    figure = new_figure(9.6, 3.6)
    panels = figure.subplots(1, len(maps))
    for axes, curves in zip(panels, maps, strict=True):
        colour = COLOURS[JOINTS.index(curves.joint)]
        for k, sign in enumerate((1.0, -1.0)):
            x, (low, high) = sign * RPM * curves.w, curves.loaded[k]
            loaded, ours, package, start = CURVES if k == 0 else (None,) * 4
            axes.fill_between(x, 1e3 * low, 1e3 * high, color="0.87", label=loaded)
            axes.plot(x, 1e3 * curves.unloaded[k], "--", color=colour, linewidth=1.6, label=ours)
            axes.plot(x, 1e3 * curves.package[k], ":", color="0.2", label=package)
            axes.plot(
                [0.0],
                [sign * 1e3 * curves.start],
                "D",
                color=colour,
                markersize=4,
                label=start,
            )
        draw_zero_lines(axes, down=True)
        axes.locator_params(axis="x", nbins=5)
        torque = "motor torque (mN·m)" if curves is maps[0] else ""
        finish_axes(
            axes,
            "motor speed (rpm)",
            torque,
            f"joint {NUMBER[curves.joint]} ({curves.joint})",
        )
    draw_legend_above(figure, panels[-1], 4, FONT_SIZE - 1)
    return figure


def with_rows(robot: Robot, rows: Mapping[str, FrictionRow]) -> Robot:
    """Return a robot with published friction in its drives, by joint."""

    def with_published(joint: Joint) -> Joint:
        row = rows.get(joint.name)
        if joint.drive is None or row is None:
            return joint
        return replace(joint, drive=with_friction(joint.drive, row))

    joint1, joint2, joint3, joint4 = (with_published(joint) for joint in robot.joints)
    return replace(robot, joints=(joint1, joint2, joint3, joint4))


LAWS = ("coulomb", "stribeck_exponential")
"""Laws that the package fits."""


@record
class Tested:
    """Errors of the predicted torque of one start–stop recording of a test rig."""

    recording: str
    """Name of the recording."""
    published: float
    """Relative error (NRMSD) with the parameters of the authors."""
    ours: float
    """Relative error (NRMSD) with the parameters that this program identified."""
    repairs: tuple[str, ...]
    """Repairs of the file."""


@record
class RigResult:
    """Identified friction of one test rig, and its comparison with the authors' parameters."""

    name: str
    """Name of the drive file without suffix."""
    rig: Rig
    """Payload and recorder settings of the test rig."""
    data: TorqueMap
    """Mean speeds and torques of the steady-state recordings."""
    published: Drive
    """Drive with the parameters and the Stribeck form of the authors."""
    fits: Mapping[str, MapFit]
    """Fits by friction law."""
    chosen: str
    """Law with the smaller error on recordings that the fit has not used."""
    tested: tuple[Tested, ...] = ()
    left_out: str = ""
    """Reason for missing predictions. Empty if there are predictions."""

    @property
    def title(self) -> str:
        """Name of the drive, such as `rig 3, worm gear`."""
        return self.published.name

    def map_nrmsd(self, drive: Drive) -> float:
        """Return the relative error (NRMSD) of the torque–velocity map that a drive predicts."""
        return nrmsd(map_torque(drive, self.data.w, _rig(drive).load), self.data.tau)

    def parameters(self) -> Iterator[list[str]]:
        """Yield the rows of the table that compares identified and published parameters.

        The cells of a row are the symbol, the published value and, for each friction law, the
        estimate and its difference from the published value.
        """
        for name, (symbol, scale) in SHOWN.items():
            value = self.rig.published.get(name)
            estimates = (
                cell for fit in self.fits.values() for cell in _estimate(fit, name, scale, value)
            )
            yield [
                symbol,
                MISSING_VALUE if value is None else format_number(scale * value),
                *estimates,
            ]

    def reasons(self) -> list[str]:
        """Return sentences that explain why identified and published parameters differ."""
        return [reason for law, fit in self.fits.items() for reason in _reasons(fit, NAMES[law])]


def published_drive(drive: Drive, law: FrictionLawName = "stribeck_exponential") -> Drive:
    """Return the drive of a test rig with the parameters of the authors.

    `law` is the form of the Stribeck term. If the authors do not state a Stribeck speed, the drive
    has Coulomb friction.
    """
    values = dict(_rig(drive).published)
    form = law if values.get("stribeck_speed") else "coulomb"
    result = drive_with_parameters(drive, form, values)
    friction = replace(
        required_friction(result),
        mu_static=values["mu"] + values.get("mu_stribeck", 0.0),
        dwell_constant=values.get("dwell_constant"),
        memory=values.get("memory", 0.0),
    )
    return replace(result, friction=friction)


def rig_result(inputs: Inputs, name: str) -> RigResult:
    """Identify the friction of one test rig from the shipped table, and predict its recordings.

    Predictions are left out if the recordings are missing.

    Parameters
    ----------
    inputs : Inputs
        Drives and recordings of the project.
    name : str
        Name of the rig.

    Raises
    ------
    RecordingError
        If the table cannot be read.
    """
    drive = inputs.rigs[name]
    rig = _rig(drive)
    data = read_torque_map(inputs.folder / "drives" / TABLE_NAME, name)
    map_fits = {
        law: fit_map(drive, data, rig.F_payload, law=law, reference=rig.published) for law in LAWS
    }
    criterion = {law: fit.criterion[law] for law, fit in map_fits.items()}
    best_law = min(criterion, key=lambda law: criterion[law])
    result = RigResult(
        name, rig, data, published=published_drive(drive), fits=map_fits, chosen=best_law
    )
    folder = inputs.recordings / RIGS[name] / "start_stop"
    if not folder.is_dir():
        return replace(
            result, left_out="the recordings are not here: name their folder by --recordings"
        )
    try:
        return replace(result, tested=_tested(result, folder))
    except RecordingError as error:
        return replace(result, left_out=_plain(error, folder))


def _tested(result: RigResult, folder: Path) -> tuple[Tested, ...]:
    """Predict the torque of all recordings in a folder, and return the errors.

    Raises RecordingError if a recording is invalid.
    """
    rig = result.rig
    fit = result.fits[result.chosen]
    recordings = read_recordings(
        [folder], nominal_torque=rig.motor_nominal_torque, direction=rig.direction
    )
    load = rig.F_payload
    inertia = rig.payload_inertia
    return tuple(
        Tested(
            recording.name,
            predict_recording(result.published, recording, load, inertia).nrmsd,
            predict_recording(fit.drive, recording, fit.load, inertia).nrmsd,
            recording.repairs,
        )
        for recording in recordings
    )


def _plain(error: RecordingError, folder: Path) -> str:
    """Return an error message without the path of the folder, which differs between computers."""
    return str(error).replace(f"{folder}/", "").replace(str(folder), folder.name).replace("|", "/")


def _rig(drive: Drive) -> Rig:
    """Return the test rig of a drive, which must have one."""
    assert drive.rig is not None, drive.name
    return drive.rig


SYMBOLS = {
    "b_c": "b_c",
    "b_v": "b_v",
    "b_oc": "b_oc",
    "mu": "μ_c",
    "mu_stribeck": "μ_str",
    "stribeck_speed": "w_s",
}
SHOWN = {
    "b_c": ("10³ b_c (N·m)", 1e3),
    "b_v": ("10⁵ b_v (N·m·s/rad)", 1e5),
    "b_oc": ("10³ b_oc (N·m; N)", 1e3),
    "mu": ("μ_c", 1.0),
    "mu_stribeck": ("μ_str", 1.0),
    "stribeck_speed": ("w_s (rad/s)", 1.0),
}
"""Symbol with unit, and factor from SI units, of each parameter in the table."""
NAMES = dict(zip(LAWS, ("Coulomb", "Stribeck"), strict=True))
"""Names of the friction laws in the document."""


def rigs_section(results: tuple[RigResult, ...]) -> Section:
    """Build the section about parameters, maps and predictions of the three test rigs."""
    return Section("rigs", {"rigs": results, "NAMES": NAMES}, {"rig_maps": _rigs_figure(results)})


def _estimate(fit: MapFit, name: str, scale: float, published: float | None) -> tuple[str, str]:
    """Return two cells: the estimate of a parameter with its interval, and its relative difference.

    Parameters
    ----------
    fit : MapFit
        Fit of one friction law.
    name : str
        Name of the parameter.
    scale : float
        Factor from SI units to the unit of the table.
    published : float, optional
        Value of the authors in SI units.
    """
    estimate = fit.estimates.get(name)
    if estimate is None:
        return MISSING_VALUE, MISSING_VALUE
    low, high = (format_number(scale * end) for end in (estimate.low, estimate.high))
    text = f"{format_number(scale * estimate.value)} ({low} … {high})"
    if published is None:
        return text, MISSING_VALUE
    position = "inside" if estimate.low <= published <= estimate.high else "outside"
    return text, f"{format_percent(estimate.value / published - 1.0, 0)}, {position}"


def _reasons(fit: MapFit, law: str) -> list[str]:
    """Return sentences that explain why the parameters of one fit differ from the published ones.

    `law` is the name of the friction law in the document.
    """
    reasons = []
    if fit.inseparable:
        groups = " and ".join(
            ", ".join(SYMBOLS.get(name, "the load") for name in group) for group in fit.inseparable
        )
        reasons.append(
            f"with {law} the map gives {groups} only in combination, so that values far apart fit "
            "alike"
        )
    if fit.estimates["mu"].at_bound:
        reasons.append(
            f"with {law} the likeliest μ_c is the least with which the drive still locks itself"
        )
    return reasons


def _rigs_figure(results: tuple[RigResult, ...]) -> "Figure":
    """Draw the torque–velocity maps of the test rigs with the published and the fitted laws."""
    figure = new_figure(9.6, 3.6)
    for axes, result in zip(figure.subplots(1, len(results)), results, strict=True):
        data = result.data
        axes.plot(
            RPM * data.w,
            1e3 * data.tau,
            "o",
            color="black",
            fillstyle="none",
            markersize=4,
            label="recordings",
        )
        drives = (
            ("published", result.published, ":", FIFTH_COLOUR),
            ("ours, Coulomb", result.fits[LAWS[0]].drive, "--", COLOURS[1]),
            ("ours, Stribeck", result.fits[LAWS[1]].drive, "-", COLOURS[0]),
        )
        for label, drive, dash, colour in drives:
            for w, named in zip(map_speeds(data.w), (None, label), strict=True):
                torque = 1e3 * map_torque(drive, w, _rig(drive).load)
                axes.plot(RPM * w, torque, dash, color=colour, linewidth=1.4, label=named)
        draw_zero_lines(axes)
        finish_axes(
            axes,
            "motor speed (rpm)",
            "motor torque (mN·m)" if result is results[0] else "",
            result.title,
        )
        draw_legend(axes, fontsize=FONT_SIZE - 2, loc="lower right")
    return figure

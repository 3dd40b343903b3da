"""Compute the requirements of a motion on each motor: torque, its components, speed, power, energy.

Without friction, the torque law of dynamics/transmission.py is linear in load and acceleration.
Therefore, the motor torque tau is a sum of components:

    tau = tau_lossless(inertia) + tau_lossless(load) + bearings
          + (mesh with friction − mesh without)

tau_lossless is the torque of a drive without friction. "Inertia" stands for the effort that
accelerates all parts, "load" for gravity, Coriolis and centrifugal effort, "bearings" for the
friction of the bearings, and "mesh" for the torque with sliding friction of screw or worm. The main
entry is `motor_requirements`.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from ssm_planner.deprecation import Renamed
from ssm_planner.dynamics import required_friction
from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.problem import Drive, Motor, Robot, get_attributes, unchecked_copy
from ssm_planner.sizing.joint_load import MOST_INSTANTS, SAMPLING_RATE, JointLoad, joint_loads
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, JsonObject, record


@record
class MotorRequirement:
    """Requirements of one motion on the motor of one joint, in SI units.

    The arrays `t`, `speed`, `torque` and `split` are computed from `load` on each use, so that a
    long motion needs little memory.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> requirement = ssm.load_plan("results/tilt_insert").requirements[0]
    >>> requirement.joint, round(requirement.peak_torque, 4)
    ('roll', 0.0303)
    """

    joint: str
    motor: Motor | None
    """Motor of the joint, or None if none is chosen."""
    peak_torque: float
    """Largest magnitude of the motor torque, N·m."""
    rms_torque: float
    """Root mean square of the motor torque over the motion, N·m."""
    mean_torque: float
    """Mean motor torque over the motion, N·m."""
    peak_speed: float
    """Largest motor speed, rad/s."""
    peak_acceleration: float
    """Largest motor acceleration, rad/s²."""
    peak_power: float
    """Largest mechanical output power, W."""
    mean_power: float
    """Mean mechanical power, W. Power that the load returns counts as negative."""
    energy: float
    """Mechanical output energy, J. Energy that the load returns is not subtracted."""
    returned_energy: float
    """Mechanical energy that the load puts into the motor, J, ≥ 0."""
    joule_power: float | None
    """Mean heat in the winding at 25 °C, W. None without torque constant or resistance."""
    joule_energy: float | None
    """Heat in the winding over one motion, J."""
    load: JointLoad
    """Motion and load of the joint."""
    components: JsonObject
    """Value at the largest torque and RMS value of each component of the torque, N·m."""

    @property
    def t(self) -> Array:
        """Instants (n,), s."""
        return self.load.t

    @property
    def speed(self) -> Array:
        """Motor speed (n,), rad/s."""
        return self.load.speed()

    @property
    def torque(self) -> Array:
        """Motor torque (n,), N·m."""
        return self.load.torque()

    @property
    def split(self) -> "TorqueBreakdown":
        """Components of the motor torque, with arrays (n,)."""
        return torque_split(self.load)

    @property
    def placeholder(self) -> bool:
        """True if the joint lacks a motor or if values of the motor are placeholders."""
        return self.motor is None or self.motor.placeholder

    shown = Renamed("figure_data")

    def figure_data(self) -> Any:
        """Return the data that a figure of the motor draws.

        The result is a plain namespace with the attributes `FIGURE_FIELDS`, so that another process
        can read it without this package. A long motion is thinned out: if it has more than
        `MOST_INSTANTS` instants, consecutive instants form groups, and only the instants of the
        smallest and of the largest torque of each group are kept.

        Returns
        -------
        SimpleNamespace
            Attributes `FIGURE_FIELDS` in SI units, with arrays (n,).
        """
        torque = self.torque
        group = math.ceil(len(torque) / MOST_INSTANTS)
        # The last torque is repeated until the groups have equal lengths.
        groups = np.pad(torque, (0, -len(torque) % group), mode="edge").reshape(-1, group)
        extremes = np.concatenate([groups.argmin(axis=1), groups.argmax(axis=1)])
        keep = np.unique(extremes + np.tile(np.arange(0, len(torque), group), 2))
        thinned = replace(self, load=self.load.subset(np.minimum(keep, len(torque) - 1)))
        return SimpleNamespace(**{name: getattr(thinned, name) for name in FIGURE_FIELDS})

    def to_dict(self) -> JsonObject:
        """Return the requirement as a dict, in SI units.

        The output of `plan --json` contains this dict as an entry of `motors`. It states the
        attributes `RESULT_FIELDS`, and the components of the torque as `split`.
        """
        return {
            "joint": self.joint,
            "motor": None if self.motor is None else self.motor.name,
            **get_attributes(self, RESULT_FIELDS),
            "split": self.components,
            "placeholder": self.placeholder,
        }


def motor_requirements(
    trajectory: Trajectory, robot: Robot, rate: float = SAMPLING_RATE
) -> tuple[MotorRequirement, ...]:
    """Compute the requirements on the motor of every driven joint, with the exact friction law.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    robot : Robot
        Robot that performs the motion.
    rate : float
        Sampling rate, Hz. Both sides of every instant at which a torque may jump are added.

    Returns
    -------
    tuple of MotorRequirement
        One entry for each joint that has a drive.
    """
    return tuple(motor_requirement(load) for load in joint_loads(trajectory, robot, rate))


def motor_requirement(load: JointLoad) -> MotorRequirement:
    """Compute the requirements on the motor of one joint from its load.

    Means and RMS values are weighted by the duration that each instant of the load represents.
    Power is torque times speed.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint.

    Returns
    -------
    MotorRequirement
        Peak, mean and RMS values over the motion without pause.
    """
    torque = load.torque()
    power = torque * load.speed()
    rms = float(load.rms(torque))
    joule = joule_power(load.motor, rms)
    return MotorRequirement(
        load.joint,
        load.motor,
        peak_torque=float(np.abs(torque).max()),
        rms_torque=rms,
        mean_torque=float(load.weight @ torque),
        peak_speed=load.peak_speed,
        peak_acceleration=float(np.abs(load.acceleration()).max()),
        peak_power=float(max(power.max(), 0.0)),
        mean_power=float(load.weight @ power),
        energy=float(load.weight @ np.maximum(power, 0.0)) * load.duration,
        returned_energy=float(load.weight @ np.maximum(-power, 0.0)) * load.duration,
        joule_power=joule,
        joule_energy=None if joule is None else joule * load.duration,
        load=load,
        components=torque_split(load).to_dict(),
    )


def joule_power(motor: Motor | None, rms_torque: float) -> float | None:
    """Compute the mean heat in the winding at 25 °C.

    The heat is R·(tau_rms/k)², where R is the terminal resistance, k the torque constant, and
    tau_rms the RMS torque of the motor.

    Parameters
    ----------
    motor : Motor or None
        Motor with its electrical data, or None.
    rms_torque : float
        RMS torque, N·m.

    Returns
    -------
    float or None
        Heat, W. None if the motor, k or R is missing.
    """
    if motor is None or motor.torque_constant is None or motor.terminal_resistance is None:
        return None
    return motor.terminal_resistance * (rms_torque / motor.torque_constant) ** 2


@record
class TorqueBreakdown:
    """Components of the motor torque (n,), N·m. Their sum is the torque.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> split = ssm.load_plan("results/tilt_insert").requirements[0].split
    >>> max(split.rms, key=split.rms.get)
    'mesh_friction'
    """

    input_inertia: Array
    """Torque that accelerates the motor shaft and all parts that turn with it."""
    output_inertia: Array
    """Torque that accelerates the bodies and the output side of the drive."""
    load: Array
    """Torque for gravity, Coriolis and centrifugal effort."""
    mesh_friction: Array
    """Torque with sliding friction in the mesh minus torque without it. At rest, it holds the load.
    """
    bearing_friction: Array
    """Torque for the bearings of the input side and, through the mesh, of the output side.

    It contains the friction torque of the motor.
    """
    at_peak: dict[str, float]
    """Components at the instant of the largest torque, N·m."""
    rms: dict[str, float]
    """RMS of each component over the motion, N·m."""

    def components(self) -> Iterator[tuple[str, Array]]:
        """Yield the name and the values (n,) of every component, N·m."""
        for name in TORQUE_COMPONENTS:
            yield name, getattr(self, name)

    def to_dict(self) -> dict[str, dict[str, float]]:
        """Return the value at the largest torque, and the RMS, of every component, N·m."""
        return {
            name: {"at_peak": self.at_peak[name], "rms": self.rms[name]}
            for name in TORQUE_COMPONENTS
        }

    parts = Renamed("components")


RESULT_FIELDS = (
    "peak_torque",
    "rms_torque",
    "mean_torque",
    "peak_speed",
    "peak_acceleration",
    "peak_power",
    "mean_power",
    "energy",
    "returned_energy",
    "joule_power",
    "joule_energy",
)
"""Attributes of a requirement that results contain."""
FIGURE_FIELDS = (
    "joint",
    "motor",
    "peak_torque",
    "rms_torque",
    "mean_torque",
    "t",
    "speed",
    "torque",
)
"""Attributes of a requirement that a figure shows."""
TORQUE_COMPONENTS = ("input_inertia", "output_inertia", "load", "mesh_friction", "bearing_friction")
"""Names of the components of the motor torque, which are described in `TorqueBreakdown`."""


def torque_split(load: JointLoad) -> TorqueBreakdown:
    """Divide the motor torque of a joint into its components.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint at n instants.

    Returns
    -------
    TorqueBreakdown
        Components (n,), and their values at the largest torque and over the motion.
    """
    *values, total = load.by_parts(_stacked_components)
    peak = int(np.argmax(np.abs(total)))
    components = dict(zip(TORQUE_COMPONENTS, values, strict=True))
    return TorqueBreakdown(
        **components,
        at_peak={name: float(values[peak]) for name, values in components.items()},
        rms={name: float(load.rms(values)) for name, values in components.items()},
    )


def _stacked_components(load: JointLoad) -> Array:
    """Compute the components of the motor torque at all instants of a load.

    Each component is the torque of a drive in which some causes of torque are set to zero. The
    friction in the mesh is the remainder: the full torque minus the torque of a drive without
    losses in the mesh and in the gear stages. At rest, bearings cause no torque.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint at n instants.

    Returns
    -------
    (6, n) array
        Components in the order of `TORQUE_COMPONENTS`, and their sum in the last row, N·m.
    """
    drive = load.drive
    moving = load.direction != 0
    zero = np.zeros_like(load.t)
    lossless = _without_mesh_losses(drive, b_c=0.0, b_v=0.0, b_oc=0.0, b_ov=0.0)
    drive_with_bearings = _without_mesh_losses(drive)
    w = load.speed()
    wd = load.acceleration()
    sign = np.where(moving, load.direction, 1.0)
    carried = output_effort(lossless, load.inertia, zero, load.qdd, sign)
    friction_effort = output_effort(drive, zero, load.qd, zero, load.direction)
    # An antibacklash nut accelerates with wd, so its inertia and its lossless preload (which
    # cancels) belong to the input side.
    input_inertia = motor_torque(lossless, zero, zero, wd, direction=sign)
    output_inertia = _lossless_mesh_torque(lossless, carried, sign)
    load_torque = _lossless_mesh_torque(lossless, load.velocity + load.gravity, sign)
    motor_friction = load.motor_friction[1] * load.direction
    bearing_torque = motor_torque(drive_with_bearings, friction_effort, w, zero, direction=sign)
    bearing_friction = motor_friction + np.where(moving, bearing_torque, 0.0)
    total = load.torque()
    effort = load.effort()
    torque_in_motion = motor_torque(drive_with_bearings, effort, w, wd, direction=sign)
    torque_at_rest = _lossless_mesh_torque(lossless, effort, sign)
    without_mesh_friction = motor_friction + np.where(moving, torque_in_motion, torque_at_rest)
    mesh_friction = total - without_mesh_friction
    components = [input_inertia, output_inertia, load_torque, mesh_friction, bearing_friction]
    return np.stack(components + [total])


def _lossless_mesh_torque(lossless: Drive, effort: Array, direction: Array) -> Array:
    """Return the motor torque of a lossless drive at constant speed.

    Parameters
    ----------
    lossless : Drive
        Drive without friction.
    effort : (n,) array
        Effort in the mesh, N·m or N.
    direction : (n,) array
        Direction of motion, ±1.

    Returns
    -------
    (n,) array
        Torques, N·m.
    """
    zero = np.zeros_like(effort)
    return motor_torque(lossless, effort, zero, zero, direction=direction)


def _without_mesh_losses(drive: Drive, **bearings: float) -> Drive:
    """Return the drive without losses in the mesh and in the gear stages.

    The transmission ratio of motor to joint stays the same, so the stages are removed and their
    ratio is included in the lever arm γ of the mesh. A drive with efficiencies instead of a thread
    has γ = 1/ratio if it has no losses.

    Parameters
    ----------
    drive : Drive
        Drive with its friction and gear stages.
    **bearings : float
        Friction parameters of the bearings that are replaced, such as b_c=0.0.

    Returns
    -------
    Drive
        The changed drive, whose values are not checked.
    """
    friction = unchecked_copy(
        required_friction(drive), mu=0.0, mu_static=0.0, mu_stribeck=0.0, **bearings
    )
    gamma = drive.gamma / drive.stage_ratio if drive.threaded else 1.0 / drive.ratio
    return unchecked_copy(drive, friction=friction, gamma=gamma, gearhead=None, belt=None)

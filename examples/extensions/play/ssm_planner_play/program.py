"""Verify an exported EPOS4 folder, and read everything that a playback needs from it."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import ssm_planner as ssm
from ssm_planner.errors import SsmPlannerError
from ssm_planner.formats.export import slowed_plan
from ssm_planner.formats.read import read_manifest
from ssm_planner.formats.spline_points import REST_SPEED
from ssm_planner.plans import Plan
from ssm_planner.publishing import MANIFEST
from ssm_planner.typing import Array
from ssm_planner.units import rpm
from ssm_planner.verification import end_velocities

ROUNDED = 0.5 + 1e-6
"""Largest distance of a set point from the plan, increments."""
STREAM = ("target_position_inc", "velocity_offset_mrpm", "torque_offset_permille")
"""Columns of a stream."""


class PlayError(SsmPlannerError):
    """A check before the motion has failed, so nothing moves (exit status 1)."""


@dataclass(frozen=True)
class AxisProgram:
    """Units, drive objects and homing of one axis."""

    name: str
    index: int
    """Index of the joint."""
    per_unit: float
    """Increments per rad or m, with the sign of the motor's direction."""
    counts_per_turn: int
    direction: int
    rated_torque: float
    """Rated torque of the motor, N·m."""
    ratio: float
    """Motor angle per joint coordinate, rad/rad or rad/m."""
    objects: dict[tuple[int, int], int]
    """Values of the drive objects by index and subindex."""
    homing: dict[tuple[int, int], int]


@dataclass(frozen=True)
class Rows:
    """Set points of m axes in n periods, in the units of the drives. Arrays are integers (n, m)."""

    counts: Array
    velocity: Array
    """Velocity offsets, 1e-3 rpm."""
    torque: Array
    """Torque offsets, per mille of the rated torque."""

    def __len__(self) -> int:
        return len(self.counts)


@dataclass(frozen=True)
class Program:
    """A verified motion and the settings of the drives that play it."""

    folder: Path
    manifest: dict[str, Any]
    plan: Plan
    """The plan at the speed of the export."""
    axes: tuple[AxisProgram, ...]
    period: float
    """Interval between set points, s."""
    rows: Rows
    notes: tuple[str, ...]

    @property
    def t(self) -> Array:
        """Instants (n,) of the set points since the start, s."""
        return np.arange(len(self.rows)) * self.period

    def reference(self, rows: Rows) -> tuple[Array, Array, Array, Array]:
        """Return q, qd, qdd and motor torques (n, 4) of set points, with the signs of the joints.

        Joints without a drive are at rest at their planned start.
        """
        start = self.plan.motion.positions(self.plan.motion.breaks[:1])
        q = np.repeat(start, len(rows), axis=0)
        qd, tau = np.zeros_like(q), np.zeros_like(q)
        for k, axis in enumerate(self.axes):
            q[:, axis.index] = rows.counts[:, k] / axis.per_unit
            speed = axis.direction * rows.velocity[:, k] * rpm / 1000
            qd[:, axis.index] = speed / axis.ratio
            share = axis.direction * rows.torque[:, k] / 1000
            tau[:, axis.index] = share * axis.rated_torque
        qdd = np.diff(qd, axis=0, append=qd[-1:]) / self.period
        return q, qd, qdd, tau


def prepare(folder: Path, plan: Path | None = None) -> Program:
    """Verify an export folder and its plan, and return the program.

    The hashes of the folder, the content of every file and the limits are checked again by
    `ssm_planner.check`. The plan must be the one of the manifest, it must pass its check, and the
    set points must be its positions.

    Parameters
    ----------
    folder : Path
        Folder that `ssm-planner export --to epos4` wrote.
    plan : Path, optional
        The plan.json of the export. The default is the file that the manifest names, in the folder
        above.

    Raises
    ------
    PlayError
        If a check fails.
    TrajectoryError or ProblemError
        If the folder or the plan cannot be read.
    """
    manifest = read_manifest(folder)
    _require_playable(folder, manifest)
    stated = manifest.get("plan", {})
    path = plan or folder.resolve().parent / str(stated.get("file", "plan.json"))
    loaded = ssm.load_plan(path)
    if loaded.sha256 != stated.get("sha256"):
        raise PlayError(
            f"{folder}: it was not exported from {path}: the SHA-256 in {MANIFEST} differs "
            "(state the plan with --plan)"
        )
    speed = manifest.get("speed", 1.0)
    if not isinstance(speed, (int, float)) or not 0 < speed <= 1:
        raise PlayError(f"{folder / MANIFEST}: speed = {speed!r} is not a share (allowed: 0 to 1)")
    certificate = ssm.check(loaded)
    if not certificate.passed or loaded.certificate is None:
        raise PlayError(f"{path}: the plan does not pass its check")
    played = slowed_plan(loaded, float(speed), True) if speed != 1 else loaded
    if played.certificate is None or not played.certificate.passed:
        raise PlayError(f"{path}: the plan does not pass its check at {100 * speed:g} % speed")
    if np.abs(np.concatenate(end_velocities(played.motion))).max() > REST_SPEED:
        raise PlayError(f"{path}: the motion must start and end at rest")
    _require_kept(folder, played)
    program = _read(folder, manifest, played)
    _require_same_motion(program)
    return program


def _require_playable(folder: Path, manifest: dict[str, Any]) -> None:
    """Raise PlayError unless a manifest describes a verified stream of positions."""
    kind, mode = manifest.get("kind"), manifest.get("mode")
    if kind != "epos4" or mode != "csp":
        raise PlayError(
            f"{folder}: an export of kind {kind!r} and mode {mode!r} cannot be played (allowed: "
            "epos4 in the mode csp)"
        )
    if manifest.get("verified") is not True:
        raise PlayError(f"{folder}: the export is marked unverified, so it is not played")


def _require_kept(folder: Path, plan: Plan) -> None:
    """Raise PlayError if the set points exceed a limit, or if the folder was changed."""
    certificate = ssm.check(folder, plan.robot, plan.limits)
    if certificate.violations:
        raise PlayError(f"{folder}: the set points exceed {certificate.worst.excess}")
    # The positions do not determine these limits. The plan keeps them.
    assert plan.certificate is not None
    judged = {limit.name for limit in plan.certificate.limits}
    unknown = {limit.name for limit in certificate.unjudged} - judged
    if unknown:
        raise PlayError(f"{folder}: neither plan nor folder prove {', '.join(sorted(unknown))}")


def _read(folder: Path, manifest: dict[str, Any], plan: Plan) -> Program:
    """Read streams and objects of a folder that the check has accepted."""
    with (folder / "objects.csv").open(encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    axes, columns = [], []
    for index, joint in enumerate(plan.robot.joints):
        if joint.drive is None:
            continue
        entry = manifest["axes"][joint.name]
        homing = [entry["homing"][key] for key in ("home_position", "home_offset", "method")]
        axes.append(
            AxisProgram(
                name=joint.name,
                index=index,
                per_unit=entry["increments_per_unit"],
                counts_per_turn=entry["increments_per_motor_turn"],
                direction=entry["direction"],
                rated_torque=entry["rated_torque_Nm"],
                ratio=joint.drive.ratio,
                objects={
                    object_key(row["object"]): int(row["value"], 0)
                    for row in table
                    if row["joint"] == joint.name
                },
                homing={object_key(item["object"]): int(item["value"]) for item in homing},
            )
        )
        path = folder / entry["file"]
        names = path.open(encoding="utf-8").readline().strip().split(",")
        values = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
        columns.append([values[:, names.index(name)] for name in STREAM])
    numbers = np.rint(np.array(columns)).astype(np.int64)
    rows = Rows(*(np.ascontiguousarray(numbers[:, part].T) for part in range(len(STREAM))))
    notes = [
        f"joint {joint.name} has no drive, but the plan moves it"
        for k, joint in enumerate(plan.robot.joints)
        if joint.drive is None and np.ptp(plan.motion.sample(plan.motion.breaks).q[:, k]) > 0
    ]
    period = manifest["interpolation_period_ms"] / 1000
    return Program(folder, manifest, plan, tuple(axes), period, rows, tuple(notes))


def object_key(text: str) -> tuple[int, int]:
    """Return index and subindex of an object such as 0x60C2:01."""
    index, subindex = text.split(":")
    return int(index, 16), int(subindex, 16)


def _require_same_motion(program: Program) -> None:
    """Raise PlayError unless every set point is the plan's position, rounded to increments."""
    motion = program.plan.motion
    times = np.minimum(motion.breaks[0] + program.t, motion.breaks[-1])
    q = motion.positions(times)
    for k, axis in enumerate(program.axes):
        distance = np.abs(program.rows.counts[:, k] - q[:, axis.index] * axis.per_unit)
        row = int(np.argmax(distance))
        if distance[row] > ROUNDED:
            raise PlayError(
                f"{program.folder}: set point {row} of joint {axis.name} is {distance[row]:.1f} "
                "increments away from the plan"
            )

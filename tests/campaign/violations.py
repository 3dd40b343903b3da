"""Every seeded violation must be found, and every healthy motion must pass.

The violations exceed a limit by 0.001–1 % and last 1–200 µs.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .rows import ROBOT, Count, Row, command

SMALLEST, LARGEST = 1e-5, 1e-2
SPARE = 1e-6
"""Smallest relative margin of healthy motions."""


def run(count: int, seed: int) -> list[Row]:
    """Run about 0.7 × count violations and 0.3 × count healthy motions.

    The cases are pieces of motions, CSV files, bags and EPOS4 folders.
    """
    with tempfile.TemporaryDirectory() as name:
        return Violations(Path(name), seed).run(count)


class Violations:
    """Cases made from one motion near its limits, in every format that is read."""

    def __init__(self, folder: Path, seed: int) -> None:
        from ssm_planner.loading.load import load_robot
        from tests.support.plans import trapezoids

        self.folder, self.rng = folder, np.random.default_rng(seed)
        self.robot = load_robot(ROBOT)
        self.trajectory = trapezoids(self.robot)
        self.rows: dict[str, Count] = {}

    def run(self, count: int) -> list[Row]:
        """Run the cases of every format with their fractions of the count."""
        self.pieces(count // 2)
        self.csv(count // 5)
        self.bags(max(count // 25, 3))
        self.epos4(count // 4)
        return [item.row for item in self.rows.values()]

    def count(self, kind: str, fault: str | None) -> None:
        """Add one case of a kind."""
        self.rows.setdefault(kind, Count(kind)).add(fault)

    def excess(self) -> float:
        """Return a random relative excess over a limit."""
        return float(10 ** self.rng.uniform(np.log10(SMALLEST), np.log10(LARGEST)))

    def acceleration(self, factor: float) -> Any:
        """Return the robot with all acceleration limits multiplied by a factor."""
        joints = tuple(
            dataclasses.replace(j, acceleration=j.acceleration * factor) for j in self.robot.joints
        )
        return dataclasses.replace(self.robot, joints=joints)

    def pieces(self, count: int) -> None:
        """Check motions with an acceleration pulse of 1–200 µs in one joint.

        The pulse lies just above its limit, or just below it.
        """
        from ssm_planner.verification.check import check

        for k in range(count):
            excess, healthy = self.excess(), k % 3 == 0
            peak = 1 - max(excess, SPARE) if healthy else 1 + excess
            trajectory, where = self.pulse(peak)
            result = check(trajectory, self.robot)
            if healthy:
                named = [f"{v.name} {v.joint} {v.margin:.2e}" for v in result.violations]
                self.count(
                    "healthy: pieces", None if result.passed else f"{where}, {-excess:.1e}: {named}"
                )
            else:
                seen = [v for v in result.violations if v.name == "acceleration"]
                self.count(
                    "violations: pieces", None if seen else f"{where}, {excess:.1e}: not found"
                )

    def pulse(self, peak: float) -> tuple[Any, str]:
        """Return the motion with q + A s² (1 − s)² added on a short interval, and where it is.

        At the ends of the interval q̈ peaks at `peak` times the limit.
        """
        from ssm_planner.trajectory import Trajectory

        motion, rng = self.trajectory, self.rng
        lengths = np.diff(motion.breaks)
        while True:
            piece, joint = int(rng.integers(len(lengths))), int(rng.integers(4))
            width = float(10 ** rng.uniform(-6, np.log10(2e-4)))
            start = float(rng.uniform(0.05, 0.9)) * lengths[piece]
            if start + width > 0.95 * lengths[piece]:
                continue
            coefficients = motion.coefficients[piece]
            split = [shifted(coefficients, time) for time in (0.0, start, start + width)]
            limit, now = self.robot.joints[joint].acceleration, 2 * split[1][2, joint]
            sign = float(rng.choice((-1, 1)))
            size = (sign * peak * limit - now) * width**2 / 2
            # Between its ends the pulse reaches half the value with the opposite sign. This value
            # must keep the limit.
            if abs(now - size / width**2) < 0.99 * limit:
                break
        split[1][2:5, joint] += size * np.array([1 / width**2, -2 / width**3, 1 / width**4])
        breaks = motion.breaks[piece] + np.array([start, start + width])
        times = np.concatenate([motion.breaks[: piece + 1], breaks, motion.breaks[piece + 1 :]])
        parts = [motion.coefficients[:piece], np.stack(split), motion.coefficients[piece + 1 :]]
        where = f"joint {joint}, {1e6 * width:.1f} µs at {breaks[0]:.4f} s"
        return Trajectory(times, np.concatenate(parts), motion.phases), where

    def table(self, ticks: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return times, positions and velocities of points from which cubics restore the motion.

        Two of the points are 1–200 µs apart. `ticks` is the resolution of time in s, or 0.
        """
        breaks = self.trajectory.breaks
        more = np.sort(self.rng.uniform(*breaks[[0, -1]], 30))
        # The points include the breaks, where the acceleration jumps. Other points keep a distance
        # from them and from each other.
        apart = np.abs(more[:, None] - breaks).min(axis=1) > 1e-3
        more = more[apart & np.append(True, np.diff(more) > 1e-3)]
        near = self.rng.choice(more) + 10 ** self.rng.uniform(-6, np.log10(2e-4))
        t = np.sort(np.append(np.concatenate([breaks, more]), near))
        if ticks:  # the sum of seconds and nanoseconds, as a reader computes it
            nanoseconds = np.round(t / ticks)
            t = nanoseconds // 1e9 + nanoseconds % 1e9 * ticks
        samples = self.trajectory.sample(t)
        samples.qd[[0, -1]] = 0.0
        return t, samples.q.copy(), samples.qd.copy()

    def beyond(
        self, peak: float, ticks: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
        """Return the table with one changed velocity, and where it is.

        The change makes q̈ at the start of an interval reach `peak` times its limit.
        """
        t, q, qd = self.table(ticks)
        k, joint = int(self.rng.integers(1, len(t) - 2)), int(self.rng.integers(4))
        if self.rng.random() < 0.5:  # the shortest interval
            k = int(np.argmin(np.diff(t)))
        h = t[k + 1] - t[k]
        limit, sign = self.robot.joints[joint].acceleration, float(self.rng.choice((-1, 1)))
        # q̈ at the start of a cubic: (6 (q1 − q0) / h − 4 v0 − 2 v1) / h
        qd[k, joint] = (
            6 * (q[k + 1, joint] - q[k, joint]) / h - 2 * qd[k + 1, joint] - sign * peak * limit * h
        ) / 4
        return t, q, qd, f"joint {joint} at {t[k]:.4f} s for {1e6 * h:.1f} µs"

    def csv(self, count: int) -> None:
        """Check CSV files whose rows contain velocities."""
        header = [
            *(f"q{i}_rad" for i in (1, 2, 3)),
            "q4_m",
            *(f"qd{i}_rad_per_s" for i in (1, 2, 3)),
            "qd4_m_per_s",
        ]
        path = self.folder / "points.csv"
        for k in range(count):
            healthy, excess = k % 3 == 0, self.excess()
            t, q, qd, where = (*self.table(), "") if healthy else self.beyond(1 + excess)
            np.savetxt(
                path,
                np.column_stack([t, q, qd]),
                "%.17g",
                ",",
                header=",".join(["time_s", *header]),
                comments="",
            )
            self.judge("CSV", path, healthy, f"{where}, {excess:.1e}")

    def judge(self, form: str, path: Path, healthy: bool, where: str) -> None:
        """Check a file with the command `check` and count the result."""
        status, out, err, fault = command("check", str(path), "--robot", str(ROBOT))
        if healthy:
            self.count(
                f"healthy: {form}",
                fault
                or (
                    None
                    if status == (4 if form == "EPOS4 folders" else 0)
                    else f"{where}: {err[-200:]}{out[-200:]}"
                ),
            )
        else:
            result = status == 1 and "FAILED" in out
            self.count(
                f"violations: {form}",
                fault or (None if result else f"{where}: status {status} {err[-200:]}"),
            )

    def bags(self, count: int) -> None:
        """Check the same points as a rosbag2."""
        from ssm_planner.formats.joint_trajectory import TrajectoryMessage
        from ssm_planner.formats.ros2 import write_bag

        empty: list[Any]
        for k in range(count):
            healthy, excess = k % 3 == 0, self.excess()
            t, q, qd, where = (*self.table(1e-9), "") if healthy else self.beyond(1 + excess, 1e-9)
            empty = [[] for _ in t]
            names = tuple(joint.name for joint in self.robot.joints)
            message = TrajectoryMessage(
                names, t, q.tolist(), qd.tolist(), accelerations=empty, effort=empty
            )
            folder = self.folder / f"bag{k}"
            write_bag(folder, self.robot, message, 1.0)
            self.judge("bags", folder, healthy, f"{where}, {excess:.1e}")

    def epos4(self, count: int) -> None:
        """Check EPOS4 folders with changed streams.

        A change of any number must be found by its hash. A change of offsets together with the hash
        must be found by the motion.
        """
        from ssm_planner.formats.export import export
        from tests.support.plans import read_back

        plan = read_back(self.folder / "plan.json", self.robot, self.trajectory)
        for number, rate in enumerate((1000.0, 500.0, 200.0, 100.0, 50.0, 20.0)):
            folder = self.folder / f"epos4_{number}"
            export(
                plan,
                "epos4",
                folder,
                rate=rate,
                counts_per_turn=int(self.rng.choice((1024, 4096, 65536))),
            )
            for k in range(max(count // 6, 2)):
                if k % 8 == 0:
                    self.judge("EPOS4 folders", folder, True, f"{rate:g} Hz")
                elif k % 2:
                    self.changed(folder, self.nudge, rehash=False)
                else:
                    self.changed(folder, self.scaled, rehash=True)

    def changed(self, folder: Path, change: Callable[[list[list[str]]], str], rehash: bool) -> None:
        """Check a folder in which one of the streams is changed."""
        file = folder / f"{self.rng.choice(('roll', 'tilt', 'insertion'))}.csv"
        text, listed = (
            file.read_text(encoding="utf-8"),
            (folder / "manifest.json").read_text(encoding="utf-8"),
        )
        rows = [line.split(",") for line in text.splitlines()]
        what = change(rows)
        other = "\n".join(",".join(row) for row in rows) + "\n"
        if what and other != text:
            file.write_text(other, encoding="utf-8")
            if rehash:
                manifest = json.loads(listed)
                manifest["files"][file.name] = hashlib.sha256(other.encode()).hexdigest()
                (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
            status, out, err, fault = command("check", str(folder), "--robot", str(ROBOT))
            kind = "violations: EPOS4 folders" + (", hashes changed too" if rehash else "")
            result = status in (1, 2) and "PASSED" not in out
            self.count(
                kind,
                fault
                or (
                    None
                    if result
                    else f"{folder.name} {file.name} {what}: status {status} {err[-100:]}"
                ),
            )
        file.write_text(text, encoding="utf-8")
        (folder / "manifest.json").write_text(listed, encoding="utf-8")

    def nudge(self, rows: list[list[str]]) -> str:
        """Change one number by 0.001–1 %, and by at least 1."""
        row, column = int(self.rng.integers(1, len(rows))), int(self.rng.integers(1, len(rows[0])))
        value = int(rows[row][column])
        step = max(round(abs(value) * self.excess()), 1) * int(self.rng.choice((-1, 1)))
        rows[row][column] = str(value + step)
        return f"row {row} column {column} by {step}"

    def scaled(self, rows: list[list[str]]) -> str:
        """Multiply all offsets of one kind by a factor."""
        column = int(self.rng.integers(2, len(rows[0])))
        factor = (
            (50, 9, -1, 0)[int(self.rng.integers(4))]
            if column == 2
            else (50, 9)[int(self.rng.integers(2))]
        )
        if max(abs(int(row[column])) for row in rows[1:]) < 20:
            return ""  # all values are too small to scale
        for row in rows[1:]:
            row[column] = str(int(row[column]) * factor)
        return f"{rows[0][column]} × {factor}"


def shifted(coefficients: np.ndarray, at: float) -> np.ndarray:
    """Return the coefficients (6, 4) of the same polynomial in powers of t − at."""
    from math import comb

    powers = [
        sum(comb(k, n) * at ** (k - n) * coefficients[k] for k in range(n, len(coefficients)))
        for n in range(len(coefficients))
    ]
    return np.array(powers)

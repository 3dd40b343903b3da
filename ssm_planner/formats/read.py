"""Anybody's trajectory file → a trajectory; which reader a file needs is told by its name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

from ssm_planner.errors import TrajectoryError
from ssm_planner.formats.csv import read_csv
from ssm_planner.formats.epos4 import read_epos4
from ssm_planner.formats.joint_trajectory import read_yaml
from ssm_planner.formats.points import Reading
from ssm_planner.formats.pvt import read_pvt
from ssm_planner.formats.ros2 import read_rosbag
from ssm_planner.loading.json_files import read_json
from ssm_planner.problem.limits import TASK
from ssm_planner.problem.robot import Robot
from ssm_planner.publishing import EXPORT, INCOMPLETE, MANIFEST, sha256

ACCEPTED = "plan.json, .csv, .yaml (JointTrajectory), a rosbag2 folder or .mcap, or a folder that export wrote"
READERS = {"epos4": read_epos4, "pvt": read_pvt}
"""Of exports that hold a file for each axis."""
LARGEST_MANIFEST = 20_000_000
"""Bytes."""
LARGEST_RATE = 1e3
"""rad/s or m/s: of what a manifest may declare."""


def read_trajectory(path: str | Path, robot: Robot) -> Reading:
    """The trajectory in a CSV, a YAML JointTrajectory, a rosbag2 or an export folder. Raises TrajectoryError."""
    path = Path(path)
    try:
        found, folder = path.exists(), path.is_dir()
    except (OSError, ValueError) as error:
        raise TrajectoryError(f"{path}: cannot be read: {error}") from error
    if not found:
        raise TrajectoryError(f"{path}: no such file or folder")
    if folder:
        return _read_folder(path, robot)
    return _read_file(path, robot)


def _read_file(path: Path, robot: Robot) -> Reading:
    suffix = path.suffix.lower()
    if not path.is_file():
        raise TrajectoryError(f"{path}: not a regular file")
    if suffix in (".csv", ".txt"):
        return read_csv(path, robot)
    if suffix in (".yaml", ".yml"):
        return read_yaml(path, robot)
    if suffix in (".mcap", ".db3"):
        return read_rosbag(path, robot)
    raise TrajectoryError(f"{path}: not a kind of file that is read here (allowed: {ACCEPTED})")


def _read_folder(folder: Path, robot: Robot) -> Reading:
    if (folder / "metadata.yaml").is_file():
        _check_hashes(folder.parent, below=folder.name)
        return read_rosbag(folder, robot)
    manifest = read_manifest(folder)
    listed = _check_hashes(folder, manifest)
    kind = str(manifest.get("kind"))
    if kind in READERS:
        reading = READERS[kind](folder, manifest, listed, robot)
    else:
        name = manifest.get("trajectory")
        if not isinstance(name, str):
            raise TrajectoryError(f"{folder}: this export ({kind[:80]}) holds no trajectory")
        if name not in listed:
            raise TrajectoryError(
                f"{folder / MANIFEST}: its trajectory {name[:80]!r} is none of the files it lists"
            )
        reading = _read_file(folder / name, robot)
    start, end = (_declared(folder, manifest, key) for key in ("start_rate", "end_rate"))
    return replace(reading, start_rate=start, end_rate=end)


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of an export folder. Raises TrajectoryError."""
    path = folder / MANIFEST
    if not path.exists():
        raise TrajectoryError(
            f"{folder}: neither a rosbag2 nor an export (no {MANIFEST}; allowed: {ACCEPTED})"
        )
    manifest = read_json(path, LARGEST_MANIFEST)
    if not isinstance(manifest, dict) or manifest.get("format") != EXPORT:
        raise TrajectoryError(f"{path}: not the manifest of an export")
    return manifest


def _check_hashes(
    folder: Path, manifest: dict[str, Any] | None = None, below: str = ""
) -> frozenset[str]:
    """Names of the files that the manifest lists, all of which are as the export wrote them. Raises TrajectoryError.

    below: only those in this folder; without a manifest that lists some, there is nothing to compare.
    """
    path = folder / MANIFEST
    if manifest is None:
        if not path.is_file():
            return frozenset()
        manifest = read_json(path, LARGEST_MANIFEST)
    files = manifest.get("files") if isinstance(manifest, dict) else None
    if isinstance(manifest, dict) and manifest.get(INCOMPLETE):
        raise TrajectoryError(
            f"{folder}: the export was interrupted while its files were put in place: export again"
        )
    if not isinstance(files, dict):
        raise TrajectoryError(f"{path}: lists no files with their SHA-256")
    for name, stated in files.items():
        parts = PurePosixPath(name).parts
        if not parts or "\0" in name or name.startswith("/") or ".." in parts or "\\" in name:
            raise TrajectoryError(f"{path}: {name[:80]!r} is no name of a file in this folder")
        if below and parts[0] != below:
            continue
        try:
            found = sha256(folder / name) if (folder / name).is_file() else None
        except (OSError, ValueError) as error:
            raise TrajectoryError(f"{folder / name}: cannot be read: {error}") from error
        if found is None:
            raise TrajectoryError(f"{folder / name}: is missing, though {MANIFEST} lists it")
        if found != stated:
            raise TrajectoryError(
                f"{folder / name}: changed since the export: its SHA-256 is not that in {MANIFEST}"
            )
    return frozenset(files)


def _declared(folder: Path, manifest: dict[str, Any], key: str) -> dict[str, float]:
    """Rates of task coordinates that a manifest declares at one end. Raises TrajectoryError."""
    rates = manifest.get(key, {})
    if not isinstance(rates, dict) or not set(rates) <= set(TASK):
        raise TrajectoryError(
            f"{folder / MANIFEST}: {key} is no mapping of rates (allowed: {', '.join(TASK)})"
        )
    for name, rate in rates.items():
        if type(rate) not in (int, float) or not abs(rate) < LARGEST_RATE:
            raise TrajectoryError(
                f"{folder / MANIFEST}: {key}.{name} is not a rate: {str(rate)[:40]}"
            )
    return {name: float(rate) for name, rate in rates.items()}

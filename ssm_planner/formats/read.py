"""Anybody's trajectory file → a trajectory; which reader a file needs is told by its name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ssm_planner.errors import TrajectoryError
from ssm_planner.formats.csv import read_csv
from ssm_planner.formats.epos4 import read_epos4
from ssm_planner.formats.joint_trajectory import read_yaml
from ssm_planner.formats.points import Reading
from ssm_planner.formats.rosbag import read_rosbag
from ssm_planner.problem.robot import Robot

MANIFEST = "manifest.json"
EXPORT = "ssm_planner export"
ACCEPTED = "plan.json, .csv, .yaml (JointTrajectory), a rosbag2 folder or .mcap, or a folder that export wrote"


def read_trajectory(path: str | Path, robot: Robot) -> Reading:
    """The trajectory in a CSV, a YAML JointTrajectory, a rosbag2 or an export folder. Raises TrajectoryError."""
    path = Path(path)
    if not path.exists():
        raise TrajectoryError(f"{path}: no such file or folder")
    if path.is_dir():
        return _read_folder(path, robot)
    suffix = path.suffix.lower()
    if suffix in (".csv", ".txt"):
        return read_csv(path, robot)
    if suffix in (".yaml", ".yml"):
        return read_yaml(path, robot)
    if suffix in (".mcap", ".db3"):
        return read_rosbag(path, robot)
    raise TrajectoryError(f"{path}: not a kind of file that is read here (allowed: {ACCEPTED})")


def _read_folder(folder: Path, robot: Robot) -> Reading:
    if (folder / "metadata.yaml").is_file():
        return read_rosbag(folder, robot)
    manifest = read_manifest(folder)
    trajectory = manifest.get("trajectory")
    if manifest.get("kind") == "epos4":
        return read_epos4(folder, manifest, robot)
    if not isinstance(trajectory, str):
        raise TrajectoryError(f"{folder}: this export ({manifest.get('kind')}) holds no trajectory")
    return read_trajectory(folder / trajectory, robot)


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of an export folder. Raises TrajectoryError."""
    path = folder / MANIFEST
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise TrajectoryError(
            f"{folder}: neither a rosbag2 nor an export (no {MANIFEST}; allowed: {ACCEPTED})"
        ) from error
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise TrajectoryError(f"{path}: cannot be read: {error}") from error
    if not isinstance(manifest, dict) or manifest.get("format") != EXPORT:
        raise TrajectoryError(f"{path}: not the manifest of an export")
    return manifest

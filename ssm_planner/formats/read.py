"""Read a trajectory file of any supported format.

`read_trajectory` is the entry for all commands that accept a trajectory. The suffix of the file
name determines the reader. For an export folder, the manifest determines the reader, and the folder
is first checked for changes: The hashes of its files must be those in the manifest, and the files
must agree with each other.
"""

import pkgutil
from dataclasses import replace
from pathlib import Path, PurePosixPath

from ssm_planner.errors import TrajectoryError
from ssm_planner.formats.agreement import check_export_content, require_same_robot
from ssm_planner.formats.csv import read_csv
from ssm_planner.formats.format import FORMATS
from ssm_planner.formats.joint_trajectory import read_yaml
from ssm_planner.formats.points import Reading
from ssm_planner.formats.ros2 import read_rosbag
from ssm_planner.formats.stop_table import add_stops
from ssm_planner.loading.json_files import read_json
from ssm_planner.problem import TASK_COORDINATES, Robot
from ssm_planner.publishing import (
    EXPORT_FORMAT,
    INCOMPLETE_KEY,
    MANIFEST,
    MANIFEST_VERSION,
    is_inside,
    sha256,
)
from ssm_planner.typing import JsonObject

ACCEPTED_FILES = (
    "plan.json, .csv, .yaml (JointTrajectory), a rosbag2 folder or .mcap, or an export folder"
)
"""Description of the supported files for error messages."""
LARGEST_MANIFEST = 20_000_000
"""Largest size of a manifest, bytes."""
LARGEST_TASK_RATE = 1e3
"""Largest rate of a task coordinate that a manifest may declare, rad/s or m/s."""


def read_trajectory(path: str | Path, robot: Robot) -> Reading:
    """Read a trajectory from a CSV file, a YAML JointTrajectory, a rosbag2 or an export folder.

    Parameters
    ----------
    path : str or Path
        File or folder.
    robot : Robot
        Robot that defines the joints of the file.

    Returns
    -------
    Reading
        Trajectory, interpolation, and the rates that the file declares at both ends.

    Raises
    ------
    TrajectoryError
        If the file is missing, has an unsupported format, was modified after its export, or is not
        a trajectory of this robot.
    """
    path = Path(path)
    try:
        exists = path.exists()
        folder = path.is_dir()
    except (OSError, ValueError) as error:
        raise TrajectoryError(f"{path}: cannot be read: {error}") from error
    if not exists:
        raise TrajectoryError(f"{path}: no such file or folder")
    if folder:
        return _read_folder(path, robot)
    return _read_file(path, robot)


def _read_file(path: Path, robot: Robot) -> Reading:
    """Read a trajectory from a single file in the format that the suffix of its name denotes.

    Parameters
    ----------
    path : Path
        File with the suffix .csv, .txt, .yaml, .yml, .mcap or .db3.
    robot : Robot
        Robot that defines the joints of the file.

    Returns
    -------
    Reading
        The trajectory and the other data of the file.

    Raises
    ------
    TrajectoryError
        If the suffix is unknown, or if the file is not a trajectory of the robot.
    """
    suffix = path.suffix.lower()
    if not path.is_file():
        raise TrajectoryError(f"{path}: not a regular file")
    if suffix in (".csv", ".txt"):
        return read_csv(path, robot)
    if suffix in (".yaml", ".yml"):
        return read_yaml(path, robot)
    if suffix in (".mcap", ".db3"):
        return read_rosbag(path, robot)
    raise TrajectoryError(f"{path}: unknown file type (allowed: {ACCEPTED_FILES})")


def _read_folder(folder: Path, robot: Robot) -> Reading:
    """Read a rosbag2 folder or an export folder.

    The files of an export must have the hashes that its manifest (manifest.json) states, and they
    must agree with the motion. A rosbag2 within an export folder is compared with the hashes of
    that export.

    Parameters
    ----------
    folder : Path
        Folder that is read.
    robot : Robot
        Robot that performs the motion.

    Returns
    -------
    Reading
        The trajectory with its controlled stops and the rates that the manifest declares.

    Raises
    ------
    TrajectoryError
        If the folder was changed, was exported for another robot, or does not contain a trajectory.
    """
    if (folder / "metadata.yaml").is_file():
        _check_hashes(folder.parent, below=folder.name)
        return read_rosbag(folder, robot)
    manifest = read_manifest(folder)
    intact = _check_hashes(folder, manifest)
    require_same_robot(folder, manifest, robot)
    start = _declared_rates(folder, manifest, "start_rate")
    end = _declared_rates(folder, manifest, "end_rate")
    format_name = str(manifest.get("kind"))
    form = FORMATS.get(format_name)
    if form is None:
        raise TrajectoryError(f"{folder / MANIFEST}: unknown kind of export: {format_name[:80]}")
    if form.reader:
        reading: Reading = pkgutil.resolve_name(form.reader)(folder, manifest, intact, robot)
    else:
        name = manifest.get("trajectory")
        if not isinstance(name, str):
            raise TrajectoryError(
                f"{folder}: this export ({format_name[:80]}) does not contain a trajectory"
            )
        if name not in intact:
            raise TrajectoryError(
                f"{folder / MANIFEST}: the trajectory {name[:80]!r} is not in the list of files"
            )
        reading = _read_file(folder / name, robot)
    reading = add_stops(folder, manifest, reading, robot)
    if reading.content is not None:
        check_export_content(folder, manifest, reading.content, reading.trajectory.duration)
    return replace(reading, start_rate=start, end_rate=end)


def read_manifest(folder: Path) -> JsonObject:
    """Read the manifest of an export folder.

    Parameters
    ----------
    folder : Path
        Export folder.

    Returns
    -------
    dict
        Content of manifest.json.

    Raises
    ------
    TrajectoryError
        If the folder does not contain the manifest of an export.
    """
    path = folder / MANIFEST
    if not path.exists():
        raise TrajectoryError(
            f"{folder}: not a rosbag2 and not an export (without {MANIFEST}; allowed: "
            f"{ACCEPTED_FILES})"
        )
    manifest = read_json(path, LARGEST_MANIFEST)
    expected = EXPORT_FORMAT, MANIFEST_VERSION
    if (
        not isinstance(manifest, dict)
        or (manifest.get("format"), manifest.get("version")) != expected
    ):
        raise TrajectoryError(f"{path}: not the manifest of an export")
    return manifest


def _check_hashes(
    folder: Path, manifest: JsonObject | None = None, below: str = ""
) -> frozenset[str]:
    """Check that the files of an export are unchanged.

    The SHA-256 of each file is compared with the manifest.

    Parameters
    ----------
    folder : Path
        Folder of the export.
    manifest : dict, optional
        Content of its manifest. By default, the function reads manifest.json if this file exists.
    below : str
        Name of a subfolder. If it is not empty, only the files in this subfolder are compared.

    Returns
    -------
    frozenset of str
        Names of all files in the manifest. Empty without a manifest.

    Raises
    ------
    TrajectoryError
        If a file is missing or was modified.
    """
    path = folder / MANIFEST
    if manifest is None:
        if not path.is_file():
            return frozenset()
        manifest = read_json(path, LARGEST_MANIFEST)
    files = manifest.get("files") if isinstance(manifest, dict) else None
    if isinstance(manifest, dict) and manifest.get(INCOMPLETE_KEY):
        raise TrajectoryError(
            f"{folder}: the export was interrupted while its files were put in place: export again"
        )
    if not isinstance(files, dict):
        raise TrajectoryError(f"{path}: the list of files with their SHA-256 is missing")
    for name, expected in files.items():
        if not is_inside(name):
            raise TrajectoryError(f"{path}: {name[:80]!r} is not the name of a file in this folder")
        if below and PurePosixPath(name).parts[:1] != (below,):
            continue
        try:
            digest = sha256(folder / name) if (folder / name).is_file() else None
        except (OSError, ValueError) as error:
            raise TrajectoryError(f"{folder / name}: cannot be read: {error}") from error
        if digest is None:
            raise TrajectoryError(f"{folder / name}: the file is missing, but {MANIFEST} lists it")
        if digest != expected:
            raise TrajectoryError(
                f"{folder / name}: the file was modified after the export: its SHA-256 differs "
                f"from {MANIFEST}"
            )
    return frozenset(files)


def _declared_rates(folder: Path, manifest: JsonObject, key: str) -> dict[str, float]:
    """Return the rates of task coordinates that a manifest declares for one end of the motion.

    The task coordinates are roll, tilt, spin and depth.

    Parameters
    ----------
    folder : Path
        Export folder, for messages.
    manifest : dict
        Content of the manifest.json of the folder.
    key : str
        Key of the rates: "start_rate" or "end_rate".

    Returns
    -------
    dict of float
        Rates by task coordinate, in m/s for the depth and in rad/s for the others. Coordinates
        without a rate are at rest.

    Raises
    ------
    TrajectoryError
        If the entry is not a mapping from task coordinates to numbers.
    """
    rates = manifest.get(key, {})
    if not isinstance(rates, dict) or not set(rates) <= set(TASK_COORDINATES):
        raise TrajectoryError(
            f"{folder / MANIFEST}: {key} is not a mapping of rates (allowed keys: "
            f"{', '.join(TASK_COORDINATES)})"
        )
    for name, rate in rates.items():
        if type(rate) not in (int, float) or not abs(rate) < LARGEST_TASK_RATE:
            raise TrajectoryError(
                f"{folder / MANIFEST}: {key}.{name} is not a rate: {str(rate)[:40]}"
            )
    return {name: float(rate) for name, rate in rates.items()}

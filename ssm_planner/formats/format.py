"""Declarations of the export formats.

`FORMATS` lists every format with its writer, its reader and its options. `export` and
`read_trajectory` look a format up in this list, and the command line derives its options from it.
To add a format, declare a `Format` and register it, as docs/architecture.md describes.
"""

from collections.abc import Mapping
from dataclasses import field

from ssm_planner.registry import Registry
from ssm_planner.typing import record

_STOPS_OPTION = "also write controlled stops that begin at N instants of the motion"
_COUNTS_OPTION = (
    "encoder increments per motor turn (4 × encoder counts), for motor files without an encoder"
)


@record
class Format:
    """Export format.

    It names its functions. They are loaded on first use, so that other commands start quickly.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> from ssm_planner.formats.format import FORMATS
    >>> FORMATS["csv"].name
    'csv'
    """

    name: str
    """Name in commands."""
    writer: str
    """Function that writes the files, as `module:function`.

    Its parameters are the plan, its certificate, the folder, the suffix of the file names and the
    options. It returns the entries that the format adds to the manifest.
    """
    description: str
    """Content of the files."""
    options: Mapping[str, str] = field(default_factory=dict)
    """Meaning of each option, by the name of its parameter. The command line offers them all.

    A format with the option `stops` can include controlled stops, which `export` writes.
    """
    reader: str | None = None
    """Function that reads the folder, as `module:function`.

    Its parameters are the folder, the manifest, the names of the unchanged files, and the robot. It
    returns a `formats.points.Reading`. If it is None, the entry `trajectory` of the manifest names
    the file to read.
    """


FORMATS = Registry(
    "ssm_planner.formats",
    "export format",
    *(
        Format(
            "csv",
            "ssm_planner.formats.csv:export_csv",
            "table with units in the header",
            {
                "rate": "number of equidistant rows per second (default: as the limits require)",
                "columns": "groups of columns to write, such as q,qd,torque, or counts",
                "counts_per_turn": _COUNTS_OPTION,
                "stops": _STOPS_OPTION,
            },
            reader="ssm_planner.formats.csv:read_csv_export",
        ),
        Format(
            "epos4",
            "ssm_planner.formats.epos4:export_epos4",
            "set points and drive objects for maxon EPOS4",
            {
                "rate": "number of set points per second (default: 1000)",
                "mode": "cyclic mode: position (csp, the default), velocity (csv) or torque (cst)",
                "counts_per_turn": _COUNTS_OPTION,
                "stops": _STOPS_OPTION,
            },
            reader="ssm_planner.formats.epos4:read_epos4",
        ),
        Format(
            "pvt",
            "ssm_planner.formats.pvt:export_pvt",
            "tables of time, position and velocity",
            {"counts_per_turn": _COUNTS_OPTION},
            reader="ssm_planner.formats.pvt:read_pvt",
        ),
        Format(
            "ros2",
            "ssm_planner.formats.ros2:export_ros2",
            "JointTrajectory and rosbag2",
            {
                "rate": "number of joint states per second in the bag (default: 100)",
                "effort": "also write joint efforts: motor torque with friction, times the ratio",
                "bag": "do not write a rosbag2",
                "rigid_effort": "also write joint efforts without drives and friction",
            },
            reader="ssm_planner.formats.ros2:read_ros2",
        ),
        Format(
            "urdf", "ssm_planner.formats.urdf:export_urdf", "mechanism and controllers for ROS 2"
        ),
        Format("c", "ssm_planner.formats.c:export_c", "C99 code of the mechanism and the plan"),
    ),
)
"""All export formats."""

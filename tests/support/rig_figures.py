"""Write the table of figures of the three rigs. From the project's folder:

python -m tests.support.rig_figures problems/drives/rig_figures.csv \
    problems/drives/rig1_lead_screw.yaml=RECORDINGS/drive1_lead_screw/steady_state …
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

from ssm_planner.errors import SsmPlannerError
from ssm_planner.identification.recordings import read_recordings
from ssm_planner.identification.torque_map import (
    TABLE_HEADER,
    TorqueMap,
    compute_torque_map,
    recording_kind,
)
from ssm_planner.loading.load import load_drive

SOURCE = """Mean motor speed and torque of steady-state recordings of three rigs, in each rig's positive direction.
Computed by ssm_planner.identification.torque_map from the maxon EPOS4 recordings in the public repository
RViMLab/TRO2021-Dynamic-Modelling (MIT licence, copyright its authors), made for "Friction-Inclusive Modeling of
Sliding Contact Transmission Systems in Robotics", IEEE Transactions on Robotics 37(4), 2021."""


def write_figures(path: str | Path, maps: dict[str, TorqueMap], source: str) -> None:
    """Write a table of figures, one map per rig name; `source` becomes its comment lines."""
    with Path(path).open("w", newline="", encoding="utf-8") as stream:
        for line in source.splitlines():
            stream.write(f"# {line}\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(TABLE_HEADER)
        for rig, m in maps.items():
            for k, name in enumerate(m.names):
                assert m.ripple is not None
                assert m.peak is not None
                numbers = (
                    m.w[k],
                    m.tau[k],
                    m.w_deviation[k],
                    m.tau_deviation[k],
                    m.ripple[k],
                    m.peak[k],
                )
                writer.writerow(
                    [
                        rig,
                        name,
                        *(f"{v:.9g}" for v in numbers),
                        int(m.samples[k]),
                        f"{m.times[k]:.0f}",
                    ]
                )


def rig_map(drive_path: str | Path, recordings: str | Path) -> TorqueMap:
    """Return the torque–velocity map of a rig from a folder of recordings.

    Start–stop recordings are ignored.
    """
    rig = load_drive(drive_path).rig
    nominal, direction = (None, 1) if rig is None else (rig.motor_nominal_torque, rig.direction)
    result = read_recordings([recordings], nominal_torque=nominal, direction=direction)
    return compute_torque_map(
        [recording for recording in result if recording_kind(recording) == "steady"]
    )


def main(arguments: list[str]) -> int:
    """Write the table for the arguments OUTPUT DRIVE=RECORDINGS …, and return the exit status."""
    if len(arguments) < 2 or any("=" not in pair for pair in arguments[1:]):
        print(
            "usage: python -m tests.support.rig_figures OUTPUT DRIVE=RECORDINGS ...",
            file=sys.stderr,
        )
        return 2
    try:
        pairs = [pair.split("=", 1) for pair in arguments[1:]]
        maps = {Path(drive).stem: rig_map(drive, recordings) for drive, recordings in pairs}
    except SsmPlannerError as error:
        print(error, file=sys.stderr)
        return 2
    write_figures(arguments[0], maps, SOURCE)
    for rig, points in maps.items():
        print(f"{rig}: {len(points.w)} recordings", *points.repairs, sep="\n  ", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

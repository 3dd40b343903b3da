"""Export format `rrd`: a plan to watch in the Rerun viewer.

The recording contains the robot as URDF, which moves with the plan, and channels of the joints, of
the motor torques and of the tip. The time of the plan is the timeline `plan`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner import ExportError, Format, Plan, fk, motor_torque
from ssm_planner.formats.ros2 import LARGEST_STATE_RATE
from ssm_planner.formats.urdf import robot_urdf

TIMELINE = "plan"
"""Name of the timeline, whose values are the times since the start of the plan."""

RRD = Format(
    "rrd",
    "ssm_planner_rerun:write",
    "plan to watch in the Rerun viewer (RRD, URDF)",
    {"rate": "samples per second in each channel (default 100)"},
)


def write(
    plan: Plan, certificate: Any, folder: Path, suffix: str, rate: float = 100.0
) -> dict[str, Any]:
    """Write motion.rrd and robot.urdf, and return the entries of the manifest.

    The parameters are those of every writer of a format, see `ssm_planner.Format`. `rate` is the
    number of samples per second, Hz.

    Raises
    ------
    ExportError
        If the rate is out of range.
    """
    import rerun as rr
    from rerun.urdf import UrdfTree

    if not 0 < rate <= LARGEST_STATE_RATE:
        raise ExportError(f"rate = {rate:g} Hz (allowed: above 0, up to {LARGEST_STATE_RATE:g} Hz)")
    robot, motion = plan.robot, plan.motion
    mark = "UNVERIFIED: the exported plan has no passed certificate." if suffix else ""
    path = folder / f"robot{suffix}.urdf"
    path.write_text(robot_urdf(robot, mark), encoding="utf-8")
    s = motion.uniform(rate)
    times = s.t - s.t[0]
    channels = {"q": s.q, "qd": s.qd, "qdd": s.qdd}
    channels["motor_torque"] = motor_torque(robot, s.q, s.qd, s.qdd)
    recording = rr.RecordingStream("ssm_planner", recording_id=plan.sha256)
    recording.save(folder / f"motion{suffix}.rrd")
    index = [rr.TimeColumn(TIMELINE, duration=times)]

    def send(entity: str, columns: Any) -> None:
        recording.send_columns(entity, indexes=index, columns=columns)

    tree = UrdfTree.from_file_path(path)
    tree.log_urdf_to_recording(recording)
    for k, joint in enumerate(robot.joints):
        drawn = tree.get_joint_by_name(joint.name)
        send(f"transforms/{joint.name}", drawn.compute_transform_columns(s.q[:, k], clamp=False))
        for name, values in channels.items():
            if np.all(np.isfinite(values[:, k])):
                send(f"{name}/{joint.name}", rr.Scalars.columns(scalars=values[:, k]))
    for name, values in zip("xyz", fk(robot, s.q).position.T, strict=True):
        send(f"tip/{name}", rr.Scalars.columns(scalars=values))
    note = rr.TextDocument(f"{robot.name}, plan {plan.sha256}. {mark}")
    recording.log("about", note, static=True)
    recording.flush()
    recording.disconnect()
    notes = [f"joint {j.name} has no drive: no motor torque" for j in robot.joints if not j.drive]
    return {"rate_hz": rate, "units": {"all": "rad, m, s, N*m"}, "notes": notes}

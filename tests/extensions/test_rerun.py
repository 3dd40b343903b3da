"""The package rerun-sdk reads the values of the plan from the exported recording."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.dynamics.robot_dynamics import motor_torque
from ssm_planner.kinematics.robot_kinematics import fk
from ssm_planner.plans import Plan

pytest.importorskip("rerun", reason="rerun-sdk is not installed: with pyarrow it has 660 MB")
AGREEMENT = 1e-9


def test_the_recording_has_the_values_of_the_plan(
    exported: Callable[[str], Path], shipped: Plan
) -> None:
    from rerun.chunk import RrdReader

    chunks = {}
    for chunk in RrdReader(exported("rerun") / "motion.rrd").stream():
        if not chunk.is_static:
            chunks[chunk.entity_path] = chunk.to_record_batch()
    motion, robot = shipped.motion, shipped.robot

    def scalars(entity: str) -> np.ndarray:
        batch = chunks[entity]
        (label,) = (name for name in batch.schema.names if "Scalars" in name)
        return np.array(batch.column(label).to_pylist())[:, 0]

    times = chunks["/q/roll"].column("plan").to_numpy() / np.timedelta64(1, "s")
    exact = np.minimum(np.arange(len(times)) / 100, motion.duration)
    assert np.abs(times - exact).max() <= 2e-9  # whole nanoseconds
    s = motion.sample(motion.breaks[0] + exact, clamp=True)
    torque = motor_torque(robot, s.q, s.qd, s.qdd)
    for name, values in {"q": s.q, "qd": s.qd, "qdd": s.qdd, "motor_torque": torque}.items():
        for k, joint in enumerate(robot.joints):
            if name == "motor_torque" and joint.drive is None:
                continue
            read = scalars(f"/{name}/{joint.name}")
            assert np.abs(read - values[:, k]).max() <= AGREEMENT
    for axis, values in zip("xyz", fk(robot, s.q).position.T, strict=True):
        assert np.abs(scalars(f"/tip/{axis}") - values).max() <= AGREEMENT
    assert all(f"/transforms/{joint.name}" in chunks for joint in robot.joints)

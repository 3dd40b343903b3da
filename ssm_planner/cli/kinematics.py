"""What `workspace` and `ik` compute: plain dictionaries of SI floats and radians, ready for JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.design import design_margin, design_region
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.workspace import boundary_distance, extremes, tilt_interval
from ssm_planner.problem.robot import Robot

SAME = 1e-7
"""Two solutions count as one, as at the workspace boundary, if no joint differs by more (rad, m)."""


def workspace_command(
    robot: Robot | None,
    reach: tuple[float, float] | None = None,
    figures_dir: str | Path | None = None,
    margin: float = 0.0,
) -> dict[str, Any]:
    """The tilt range of a robot, or with `reach` (two signed tilts, rad) the (α, β) that reach it.

    Without reach {alpha, beta, tilt_range, home, extremes}; with it {alpha, beta, region, margin, reachable}: the
    choice of smallest α (None if nothing reaches the range) and the corners [alpha, beta] of all that reach it with
    `margin` rad to spare; with a robot also `robot`: its own angles and what it has to spare. With `figures_dir`
    figures are written there and `files` names them.
    """
    mechanism = None if robot is None else Mechanism.from_geometry(robot.geometry)
    if reach is not None:
        return _reach(mechanism, reach, margin, figures_dir)
    if mechanism is None:
        raise GeometryError("a robot file or a tilt range to reach is needed")
    result: dict[str, Any] = {
        "alpha": mechanism.alpha,
        "beta": mechanism.beta,
        "tilt_range": list(tilt_interval(mechanism)),
        "home": {"roll": mechanism.home_roll, "tilt": mechanism.home_tilt},
        "extremes": [
            {"theta2": each.theta2, "tilt": mechanism.side * each.tilt, "c1": each.c1, "c2": each.c2}
            for each in extremes(mechanism)
        ],
    }
    if figures_dir is not None:
        from ssm_planner.reporting.figures.workspace import save_figures, workspace_figures

        result["files"] = save_figures(workspace_figures(mechanism), figures_dir)
    return result


def ik_command(
    robot: Robot,
    roll: float,
    tilt: float,
    spin: float = 0.0,
    depth: float = 0.0,
    *,
    within_limits: bool = False,
    reference: tuple[float, float, float, float] | None = None,
) -> dict[str, Any]:
    """All joint solutions of task coordinates, rad and m: {reachable, branches, in_limits, error, boundary_distance}.

    `branches` are [q1, q2, q3, q4] each: first those within the robot's joint limits (`in_limits`), in order of
    distance to `reference` (None: home), revolute joints moved by whole turns to be near it; with `within_limits` only
    those. Where the target is outside the workspace, `reachable` is False, the branches reach the nearest target that
    is inside, and `error` {orientation (rad), tip (m)} says by how much they miss; else it is 0.
    """
    mechanism = Mechanism.from_geometry(robot.geometry)
    limits = np.array([joint.position for joint in robot.joints])
    start = (0.0, 0.0, 0.0, 0.0) if reference is None else reference
    found = inverse_task(mechanism, [[roll, tilt, spin, depth]], limits=limits, reference=start)
    branches: list[list[float]] = []
    in_limits: list[bool] = []
    for joints, inside in zip(found.joints[0].tolist(), found.in_limits[0].tolist(), strict=True):
        if (inside or not within_limits) and not any(_same(joints, other) for other in branches):
            branches.append(joints)
            in_limits.append(inside)
    return {
        "reachable": bool(found.reachable[0]),
        "branches": branches,
        "in_limits": in_limits,
        "error": {"orientation": float(found.orientation_error[0]), "tip": float(found.tip_error[0])},
        "boundary_distance": float(boundary_distance(mechanism, tilt)),
    }


def _reach(
    mechanism: Mechanism | None, reach: tuple[float, float], margin: float, figures_dir: str | Path | None
) -> dict[str, Any]:
    low, high = sorted(reach)
    region = design_region(low, high, margin)
    alpha, beta = region.smallest_alpha
    result: dict[str, Any] = {
        "alpha": None if region.empty else alpha,
        "beta": None if region.empty else beta,
        "region": region.vertices.tolist(),
        "margin": margin,
        "reachable": not region.empty,
    }
    built = None
    if mechanism is not None:
        built = mechanism.alpha, mechanism.beta
        result["robot"] = {"alpha": built[0], "beta": built[1], "margin": design_margin(*built, (low, high))}
    if figures_dir is not None:
        from ssm_planner.reporting.figures.workspace import design_region_figure, save_figures

        result["files"] = save_figures({"design_region": design_region_figure(region, built)}, figures_dir)
    return result


def _same(joints: list[float], other: list[float]) -> bool:
    return all(abs(a - b) <= SAME for a, b in zip(joints, other, strict=True))

"""Seeded random problems whose motions prescribe a path of the tip.

The paths are lines, arcs, blended corners, paths at constant speed, and paths along the retina.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ssm_planner.problem.motion import Follow, Free, Motion, Straight, Task, Tip
from ssm_planner.problem.problem import Problem
from ssm_planner.units import deg, mm


def path_problem(base: Problem, seed: int) -> Problem:
    """Return a random path problem for the robot of `base`.

    If `base` has an eye and the seed is a multiple of 4, the path follows the retina.
    """
    rng = np.random.default_rng(seed)
    if base.eye is not None and seed % 4 == 0:
        return _along_the_retina(base, rng)
    constant = rng.random() < 0.4
    count = 1 if constant else int(rng.integers(1, 5))
    tip = _tip(rng)
    motions: list[Motion] = [Free(Tip(tuple(tip), 0.0))]
    for k in range(count):
        blend = float(rng.uniform(0.1, 0.4)) * mm if k < count - 1 else None
        speed = float(rng.uniform(2, 8)) * mm if constant else None
        motions.append(_curve(tip, rng, blend, speed))
        to = motions[-1].to
        tip = np.array(to.position) if isinstance(to, Tip) else tip
        if not isinstance(to, Tip):
            break
    motions[-1] = replace(motions[-1], blend=None)
    return replace(base, name=f"path {seed}", motion=tuple(motions), eye=None)


def _tip(rng: np.random.Generator) -> np.ndarray:
    return np.array([rng.uniform(3, 7), rng.uniform(-3, 3), rng.uniform(-15, -12)]) * mm


def _curve(
    tip: np.ndarray, rng: np.random.Generator, blend: float | None, speed: float | None
) -> Motion:
    """Return a line, an arc of up to 300°, or a straight motion in task coordinates."""
    kind = rng.choice(["line", "arc", "straight"]) if speed is None else rng.choice(["line", "arc"])
    if kind == "straight":
        task = {
            "depth": float(rng.uniform(12, 20)) * mm,
            "tilt": float(rng.uniform(-120, -100)) * deg,
        }
        if rng.random() < 0.5:
            task["roll"] = float(rng.uniform(-15, 15)) * deg
        return Straight(**task, blend=blend)
    if kind == "line":
        return Follow(Tip(tuple(_tip(rng)), 0.0), curve="line", blend=blend, constant_speed=speed)
    first, second = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
    radius, angle = rng.uniform(1, 3) * mm, rng.uniform(0.3, 5.0)
    through, to = (
        tip + radius * ((np.cos(x) - 1) * first + np.sin(x) * second) for x in (angle / 2, angle)
    )
    return Follow(
        Tip(tuple(to), 0.0),
        (Tip(tuple(through), 0.0),),
        curve="arc",
        blend=blend,
        constant_speed=speed,
    )


def _along_the_retina(base: Problem, rng: np.random.Generator) -> Problem:
    start = Task(roll=rng.uniform(-5, 5) * deg, tilt=rng.uniform(-118, -108) * deg, depth=12 * mm)
    to = Task(roll=float(rng.uniform(-12, 12)) * deg, tilt=float(rng.uniform(-122, -108)) * deg)
    speed = float(rng.uniform(2, 5)) * mm if rng.random() < 0.5 else None
    distance = float(rng.uniform(1.2, 2.5)) * mm
    curve = Follow(to, curve="retina", distance=distance, constant_speed=speed)
    return replace(base, start=start, motion=(curve,))

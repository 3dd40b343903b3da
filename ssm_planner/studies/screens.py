"""The funnel's first stages: closed forms over all candidates at once, that only drop what surely falls out.

Reach (paper, eq. 9), self-locking of every drive, and the torque that starts each straight motion from rest: of the load's
weight and the static friction alone. What a screen cannot look at, it lets pass.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ssm_planner.dynamics.rigid_body import static_loads
from ssm_planner.dynamics.transmission import breakaway_torque
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.family import Family
from ssm_planner.loading.files import of_data
from ssm_planner.loading.load import problem_from_dict
from ssm_planner.loading.robots import robot_from
from ssm_planner.problem.limits import TASK
from ssm_planner.problem.motion import Straight, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import JOINTS, Joint, Robot
from ssm_planner.studies.study import Choice, Design, Study
from ssm_planner.typing import Array
from ssm_planner.units import quantity

ANGLES = ("alpha", "home_tilt", "home_roll")
FIRST_STEP = 1e-6
"""Of a straight motion, relative, in which its joints' directions are looked at."""
DEGREE = math.pi / 180


@dataclass(frozen=True)
class Fallen:
    """Why a candidate falls out."""

    stage: str
    reason: str


@dataclass(frozen=True, eq=False)
class Move:
    """A straight motion between task coordinates (4,)."""

    start: Array
    end: Array


class Screens:
    """The screens of one study."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self._first: Design = {variable.path: variable.at(0.0) for variable in study.vary}
        problems = list(self._problems())
        self.robot: Robot | None = problems[0].robot if problems else None
        self._tilts, self._moves = _demands(problems)
        self._joints = self._alternatives()

    def fallen(self, designs: Sequence[Design]) -> list[Fallen | None]:
        """What each candidate falls out by; None: it goes on."""
        if not designs:
            return []
        found: list[Fallen | None] = [None] * len(designs)
        family = self._family(designs)
        if family is not None:
            self._reach(family, found)
        self._parts(designs, found)
        if family is not None and self._moves and not self._bodies_vary:
            self._start(designs, family, found)
        return found

    @property
    def _bodies_vary(self) -> bool:
        if any(path.startswith(("bodies", "gravity")) for path in self.study.paths):
            return True
        return any("parts" in body for body in self.study.robot["bodies"])

    def _problems(self) -> Iterator[Problem]:
        """The motions with the first candidates that a robot and its motions can be made of."""
        for place in (0.0, 0.5, 1.0):
            design = self.study.design([place] * len(self.study.vary))
            try:
                tree = self.study.resolved(design)
                found = [
                    problem_from_dict({**motion, "robot": tree})
                    for motion in self.study.motions.values()
                ]
            except ProblemError:
                continue
            self._first = design
            yield from found
            return

    def _family(self, designs: Sequence[Design]) -> Family | None:
        """The candidates' geometries; None where they are not given by alpha, home_tilt and home_roll."""
        geometry = self.study.robot["geometry"]
        if (
            "alpha" not in geometry
            or "beta" in geometry
            or any(path.startswith("geometry.axes") for path in self.study.paths)
        ):
            return None
        columns = []
        for name in ANGLES:
            path = f"geometry.{name}"
            texts = (
                [d[path] for d in designs]
                if path in self.study.paths
                else [str(geometry.get(name, "0 deg"))]
            )
            angles = _angles(texts)
            columns.append(np.broadcast_to(angles, (len(designs),)))
        sign = -1 if geometry["insertion"] == "negative" else 1
        return Family(columns[0], columns[1], columns[2], sign)

    def _reach(self, family: Family, found: list[Fallen | None]) -> None:
        require = self.study.require
        wanted: list[tuple[str, Array, float]] = []
        if require.reach is not None:
            wanted.append(("the tilts required", np.array(require.reach), require.reach_margin))
        if len(self._tilts):
            wanted.append(("the tilts of the motions", self._tilts, 0.0))
        for what, tilts, margin in wanted:
            distance = family.boundary_distance(tilts)
            for i in np.flatnonzero(distance < margin):
                if found[i] is None:
                    low, high = (ends[i] / DEGREE for ends in family.tilt_magnitudes)
                    ends = f"{tilts.min() / DEGREE:.5g} to {tilts.max() / DEGREE:.5g} deg"
                    found[i] = Fallen(
                        "reach",
                        f"{what}, {ends}, are not within {low:.5g} to {high:.5g} deg of joint 1",
                    )

    def _parts(self, designs: Sequence[Design], found: list[Fallen | None]) -> None:
        """Drives and motors that cannot be, or do not lock."""
        for path, options in self._joints.items():
            faults = {label: self._fault(option) for label, option in options.items()}
            for i, design in enumerate(designs):
                if found[i] is None:
                    found[i] = faults[design[path]]

    def _fault(self, joint: Joint | ProblemError) -> Fallen | None:
        if isinstance(joint, ProblemError):
            return Fallen("parts", joint.reason)
        drive = joint.drive
        if drive is None or not (self.study.require.self_locking or drive.self_locking):
            return None
        try:
            replace(drive, self_locking=True).check_locking()
        except ProblemError as error:
            return Fallen("locking", f"joint {joint.name}: {error.reason}")
        return None

    def _alternatives(self) -> dict[str, dict[str, Joint | ProblemError]]:
        """The joint with each entry of each choice of its drive or motor, all else as at first."""
        found: dict[str, dict[str, Joint | ProblemError]] = {}
        for variable in self.study.vary:
            parts = variable.path.split(".")
            if (
                not isinstance(variable, Choice)
                or parts[0] != "joints"
                or not {"drive", "motor"} & set(parts)
            ):
                continue
            place = JOINTS.index(parts[1])
            options: dict[str, Joint | ProblemError] = {}
            for label in variable.contents:
                try:
                    tree = self.study.resolved({**self._first, variable.path: label})
                    options[label] = robot_from(of_data(tree)).joints[place]
                except ProblemError as error:
                    options[label] = error
            found[variable.path] = options
        return found

    def _start(self, designs: Sequence[Design], family: Family, found: list[Fallen | None]) -> None:
        """The torque that starts each motion from rest against the motor's largest, on the better branch."""
        if self.robot is None:
            return
        alive = np.array([each is None for each in found])
        if not alive.any():
            return
        members = family.some(alive)
        some = [design for design, lives in zip(designs, alive, strict=True) if lives]
        lacks = [self._lacking(members, branch, some) for branch in (1, -1)]
        for position, i in enumerate(np.flatnonzero(alive)):
            home, other = lacks[0][position], lacks[1][position]
            if home is not None and other is not None:
                found[i] = home

    def _lacking(
        self, family: Family, branch: int, designs: Sequence[Design]
    ) -> list[Fallen | None]:
        assert self.robot is not None
        starts = np.array([move.start for move in self._moves])
        steps = starts + FIRST_STEP * (np.array([move.end for move in self._moves]) - starts)
        with np.errstate(invalid="ignore", divide="ignore"):
            q, after = family.joints(starts, branch), family.joints(steps, branch)
            step = after - q
            step[..., :3] = np.arctan2(np.sin(step[..., :3]), np.cos(step[..., :3]))
            direction = np.where(np.abs(step) > 1e-12, np.sign(step), 0.0)
            load = self._loads(family, q)
        found: list[Fallen | None] = [None] * len(designs)
        selected = {choice.path.split(".")[1] for choice in self.study.selected}
        for k, name in enumerate(JOINTS):
            for joint, members in self._groups(name, designs):
                if (
                    joint.drive is None
                    or joint.motor is None
                    or joint.drive.friction is None
                    or name in selected
                ):
                    continue
                sign = direction[members, :, k]
                torque = np.abs(
                    breakaway_torque(
                        joint.drive, load[members, :, k], np.where(sign == 0, 1.0, sign)
                    )
                )
                torque = np.where((sign == 0) | ~np.isfinite(torque), 0.0, torque).max(axis=1)
                for i in np.flatnonzero(torque > joint.motor.max_torque):
                    if found[members[i]] is None:
                        needs, has = 1e3 * torque[i], 1e3 * joint.motor.max_torque
                        reason = f"joint {name} starts against {needs:.4g} mN·m, {joint.motor.name} has {has:.4g} mN·m"
                        found[members[i]] = Fallen("static torque", reason)
        return found

    def _loads(self, family: Family, q: Array) -> Array:
        """Efforts (n, k, 4) of the weight; the bodies as the robot file gives them, turned with their joints' axes."""
        assert self.robot is not None
        count = len(family.alpha)
        axes = np.stack([family.omega1, family.omega2, family.omega3], axis=1)
        masses = np.tile([body.mass for body in self.robot.bodies], (count, 1))
        return static_loads(axes, masses, self._coms(family), self.robot.gravity, q)

    def _coms(self, family: Family) -> Array:
        """Centres of mass in the base frame at q = 0, (n, 4, 3): a frame's z stays along its joint's axis."""
        assert self.robot is not None
        geometry = self.robot.geometry
        olds = (geometry.omega1, geometry.omega2, geometry.omega3, geometry.omega3)
        news = (family.omega1, family.omega2, family.omega3, family.omega3)
        places = [body.frame @ body.com for body in self.robot.bodies]
        return np.stack(
            [_turned(place, old, new) for place, old, new in zip(places, olds, news, strict=True)],
            axis=1,
        )

    def _groups(self, name: str, designs: Sequence[Design]) -> Iterator[tuple[Joint, Array]]:
        """Each drive with motor of a joint, and which candidates have it."""
        assert self.robot is not None
        own = self.robot.joints[JOINTS.index(name)]
        paths = [path for path in self._joints if path.split(".")[1] == name]
        chosen: dict[tuple[str, ...], list[int]] = {}
        for i, design in enumerate(designs):
            chosen.setdefault(tuple(design[path] for path in paths), []).append(i)
        for labels, members in chosen.items():
            joint: Any = own
            for path, label in zip(paths, labels, strict=True):
                option = self._joints[path][label]
                assert isinstance(option, Joint)  # others have fallen out already
                part = "motor" if path.endswith("motor") else "drive"
                try:
                    joint = replace(joint, **{part: getattr(option, part)})
                except ProblemError:
                    joint = None
                    break
            if joint is not None:
                yield joint, np.array(members)


def _angles(texts: Sequence[str]) -> Array:
    """rad; each number with its unit's factor, so that many are fast."""
    unit = texts[0].strip().partition(" ")[2]
    factor = quantity(f"1 {unit}", "angle")
    return np.array([float(text.strip().partition(" ")[0]) for text in texts]) * factor


def _turned(place: Array, old: Array, new: Array) -> Array:
    """A point (3,) carried along by the smallest rotation that takes the axis `old` (3,) to each of `new` (n, 3)."""
    axis = np.cross(old, new)
    cosine = new @ old
    along = np.cross(axis, place)
    return np.asarray(place + along + np.cross(axis, along) / (1.0 + cosine)[:, None])


def _demands(problems: Sequence[Problem]) -> tuple[Array, list[Move]]:
    """Tilts (k,) that the motions pass for certain, and their straight motions, as far as task coordinates tell."""
    tilts: list[float] = []
    moves: list[Move] = []
    for problem in problems:
        at = problem.start
        if not isinstance(at, Task):
            continue
        here = {name: getattr(at, name) or 0.0 for name in TASK}
        tilts.append(here["tilt"])
        for motion in problem.motion:
            if not isinstance(motion, Straight):
                break
            there = {**here, **motion.to.given}
            moves.append(Move(_vector(here), _vector(there)))
            tilts.append(there["tilt"])
            here = there
    return np.array(tilts), moves


def _vector(task: dict[str, float]) -> Array:
    return np.array([task[name] for name in TASK])

"""The proof encloses the distances and speeds that are promised along paths. It must not accept
motions that break these promises.
"""

from __future__ import annotations

import copy
import json
import math
from functools import cache
from typing import Any

import numpy as np
import pytest

import ssm_planner as ssm
from examples import prove
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.pipeline.run import plan as plan_of
from ssm_planner.problem.motion import Follow, Free, Straight, Task, Tip
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.units import deg, mm
from tests.support.random_paths import path_problem

PROMISES = {"path departure", "corner rounding", "retina distance", "constant speed"}
Document = dict[str, Any]


def eye_problem() -> Problem:
    return ssm.load_problem("eye_approach")


def tip(x: float, y: float, z: float) -> Tip:
    return Tip((x * mm, y * mm, z * mm), 0.0)


@cache
def planned(kind: str) -> Document:
    """Return the plan of a problem whose motions promise a path of the tip."""
    middle = tip(2, -1, -13)
    end = tip(3, 2, -13)
    motions: dict[str, tuple[Any, ...]] = {
        "line": (Follow(tip(3, -4, -13), curve="line", constant_speed=5 * mm),),
        "arc": (Follow(end, (middle,), curve="arc", constant_speed=5 * mm),),
        "corners": (
            Follow(tip(3, -4, -13), curve="line", blend=0.3 * mm),
            Follow(end, (middle,), curve="arc", blend=0.2 * mm),
            Straight(depth=18 * mm),
        ),
        "retina": (
            Follow(Task(roll=10 * deg, tilt=-112 * deg), curve="retina", distance=1.5 * mm),
        ),
    }
    base, eye = ssm.load_problem("rounded_corners"), eye_problem()
    problem = (
        unchecked_copy(eye, motion=(*eye.motion, *motions[kind]))
        if kind == "retina"
        else unchecked_copy(base, motion=(Free(tip(6, -3, -13)), *motions[kind]))
    )
    result = plan_of(unchecked_copy(problem, planner="fast"), relaxations=False)
    assert result.passed
    return json.loads(result.to_json())


def claims_of(document: Document) -> dict[str, Any]:
    """Prove only the promises, which takes less time, and return the claims by name."""
    with np.errstate(all="ignore"):
        proof = prove.Proof(document)
        proof.promises(*proof.task())
    claims = (prove.claim(*key, parts) for key, parts in proof.parts.items())
    return {claim.name: claim for claim in claims if claim.name in PROMISES}


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("line", {"path departure", "constant speed"}),
        ("arc", {"path departure", "constant speed"}),
        ("corners", {"path departure", "corner rounding"}),
        ("retina", {"path departure", "retina distance"}),
    ],
)
def test_promises_along_paths_are_proven(kind: str, names: set[str]) -> None:
    document = planned(kind)
    claims = claims_of(document)
    assert claims.keys() == names
    for line in document["certificate"]["limits"]:
        if line["name"] in claims:
            claim = claims[line["name"]]
            assert claim.verdict == "PROVEN", claim
            assert claim.excess >= -line["margin"] - 1e-6, claim
    if "corner rounding" in claims:  # The check only samples this value.
        assert claims["corner rounding"].excess == pytest.approx(-0.113, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(0, 40, 4))
def test_random_paths_are_proven(seed: int) -> None:
    problem = path_problem(eye_problem(), seed)
    result = plan_of(unchecked_copy(problem, planner="fast"), relaxations=False)
    if result.passed:
        for claim in prove.prove(json.loads(result.to_json())):
            assert claim.verdict == "PROVEN", claim


def at_rest(document: Document, *, shift: np.ndarray, piece: int, time: float) -> np.ndarray:
    """Return the tip position (3,) at a time of a piece, after a shift (4,) of the joints."""
    robot = ssm.load_problem("rounded_corners").robot
    powers = time ** np.arange(6)
    position = powers @ np.array(document["trajectory"]["coefficients"][piece]) + shift
    return tip_position(Mechanism.from_robot(robot), position[None])[0]


def from_line(document: Document, place: np.ndarray) -> float:
    """Return the distance of a point from the line of the last motion, m."""
    first = document["trajectory"]["breaks_s"].index(
        document["trajectory"]["phases"][-1]["start_s"]
    )
    start = at_rest(document, shift=np.zeros(4), piece=first, time=0.0)
    way = np.array(document["problem"]["motion"][-1]["target"]["tip"]) - start
    return float(np.linalg.norm(np.cross(place - start, way)) / np.linalg.norm(way))


def with_bump(document: Document, piece: int, width: float, amplitude: np.ndarray) -> Document:
    """Return a plan with a bump 16 t² (w − t)² / w⁴ at the start of a piece.

    The bump of each joint has an amplitude (4,).
    """
    plan = copy.deepcopy(document)
    trajectory = plan["trajectory"]
    coefficients = np.array(trajectory["coefficients"][piece])
    bump = np.zeros((6, 1))
    bump[2:5, 0] = np.array([width**2, -2 * width, 1.0]) * 16 / width**4
    rest = [
        sum(math.comb(i, k) * width ** (i - k) * coefficients[i] for i in range(k, 6))
        for k in range(6)
    ]
    trajectory["breaks_s"].insert(piece + 1, trajectory["breaks_s"][piece] + width)
    trajectory["coefficients"][piece : piece + 1] = [
        (coefficients + bump * amplitude).tolist(),
        np.array(rest).tolist(),
    ]
    return plan


def piece_at(document: Document, share: float) -> int:
    """Return the index of a piece of the last phase, at a fraction of the duration of the phase."""
    trajectory = document["trajectory"]
    span = trajectory["phases"][-1]
    time = span["start_s"] + share * (span["end_s"] - span["start_s"])
    return int(np.searchsorted(trajectory["breaks_s"], time)) - 1


@pytest.mark.parametrize("seed", range(3))
def test_a_tip_that_leaves_its_line_for_a_moment_is_not_proven(seed: int) -> None:
    document, rng = planned("line"), np.random.default_rng(seed)
    piece, width = piece_at(document, rng.uniform(0.05, 0.95)), 10 ** rng.uniform(-6, -3)
    shift = np.eye(4)[rng.choice([0, 1])] * 1e-4

    def departure(share: float) -> float:
        place = at_rest(document, shift=share * shift, piece=piece, time=width / 2)
        return from_line(document, place)

    share = 1e-6 / departure(1.0)
    for excess, verdicts in ((2e-6, {"REFUTED", "OPEN"}), (-0.7, {"PROVEN"})):
        share *= 1e-6 * (1 + excess) / departure(share)
        share *= 1e-6 * (1 + excess) / departure(share)
        assert departure(share) == pytest.approx(1e-6 * (1 + excess), rel=1e-7)
        changed = with_bump(document, piece, width, share * shift)
        assert claims_of(changed)["path departure"].verdict in verdicts


@pytest.mark.parametrize("seed", range(2))
def test_a_tip_that_changes_its_speed_for_a_moment_is_refuted(seed: int) -> None:
    document, rng = planned("arc"), np.random.default_rng(seed)
    piece, width = piece_at(document, rng.uniform(0.2, 0.8)), 10 ** rng.uniform(-6, -3)
    velocity = np.array(document["trajectory"]["coefficients"][piece])[1]
    steepest = 32 / (6 * math.sqrt(3))  # slope of 16 x² (1 − x)² at x = 1/2 ± 1/(2 √3)
    for excess, verdict in ((2e-6, "REFUTED"), (0.9e-6, "PROVEN")):
        shift = velocity * excess * width / steepest
        changed = with_bump(document, piece, width, shift)
        assert claims_of(changed)["constant speed"].verdict == verdict


def test_a_tip_off_the_height_above_the_retina_is_refuted() -> None:
    document = planned("retina")
    piece, width = piece_at(document, 0.5), 2e-5
    shift = np.array([0.0, 0.0, 0.0, 1e-6])

    def deviation(share: float) -> float:
        return abs(height(document, share * shift, piece, width / 2) - 1.5 * mm)

    share = 1.0
    for excess, verdict in ((2e-6, "REFUTED"), (-1e-4, "PROVEN")):
        for _ in range(2):
            share *= 1e-6 * (1 + excess) / deviation(share)
        claim = claims_of(with_bump(document, piece, width, share * shift))["retina distance"]
        assert excess - 1e-7 <= claim.excess <= excess + 1e-4
        assert claim.verdict == verdict


def height(document: Document, shift: np.ndarray, piece: int, time: float) -> float:
    eye = document["problem"]["eye"]
    place = at_rest(document, shift=shift, piece=piece, time=time)
    return float(eye["radius"] - np.linalg.norm(place - np.array(eye["centre"])))


@pytest.mark.parametrize(
    ("blends", "unproven"),
    [((0.26, 0.2), {"corner rounding"}), ((0.1, 0.1), {"corner rounding", "path departure"})],
)
def test_a_corner_that_is_cut_early_is_not_proven(
    blends: tuple[float, float], unproven: set[str]
) -> None:
    document = copy.deepcopy(planned("corners"))
    for motion, blend in zip(document["problem"]["motion"][1:], blends, strict=False):
        motion["blend"] = blend * mm  # less than the motion needs
    claims = claims_of(document)
    assert {name for name, claim in claims.items() if claim.verdict != "PROVEN"} == unproven


@pytest.mark.parametrize(
    ("change", "names"),
    [
        ({"name": "other"}, {"path departure", "constant speed"}),
        ({"end_s": 1.5}, {"path departure", "constant speed"}),
        ({"start_s": 0.0}, {"path departure", "constant speed"}),
    ],
)
def test_promises_without_their_phase_are_open(change: dict[str, Any], names: set[str]) -> None:
    document = copy.deepcopy(planned("line"))
    document["trajectory"]["phases"][-1] |= change
    assert {name: claim.verdict for name, claim in claims_of(document).items()} == dict.fromkeys(
        names, "OPEN"
    )


def test_a_wrong_end_of_a_curve_is_refuted() -> None:
    for kind in ("line", "arc", "retina"):
        document = copy.deepcopy(planned(kind))
        target = document["problem"]["motion"][-1]["target"]
        if kind == "retina":
            target["task"]["tilt"] += 0.001
        else:
            target["tip"][0] += 1e-5
        assert claims_of(document)["path departure"].verdict == "REFUTED"


@pytest.mark.parametrize("angle", [0.2, 1.5, 3.0, 3.3, 6.0])
def test_curves_contain_their_points_and_no_others(angle: float) -> None:
    rng = np.random.default_rng(7)
    first, second, normal = np.linalg.qr(rng.normal(size=(3, 3)))[0].T
    centre, radius = np.array([0.01, -0.02, 0.03]), 0.003

    def circle(x: float) -> np.ndarray:
        return centre + radius * (np.cos(x) * first + np.sin(x) * second)

    path = prove.Path.__new__(prove.Path)
    tips = [prove.given(circle(x)) for x in (0.0, angle / 2, angle)]
    for share, off, inside in (
        (0.3, 0.0, True), (0.99, 0.9e-6, True), (0.3, 1.1e-6, False),
        (-0.001, 0.0, False), (1.001, 0.0, False), (0.5 + math.pi / angle, 0.0, False),
    ):  # fmt: skip
        path.tip = prove.given(circle(share * angle) + off * normal)
        path.curves = path.arc(*prove.circle(*tips))
        zero = np.zeros(1)
        with np.errstate(all="ignore"):
            high = prove.supremum(path.on(1e-6), zero == 0, zero, zero + 1, 1.0)[1]
        assert (high <= 0) == inside, (share, off)


def test_the_first_time_of_a_value_is_found() -> None:
    starts = np.arange(4.0)
    line = prove.Model(np.array([starts + 0.5, np.full(4, 0.5)]), np.zeros(4))  # f(t) = t
    b, e = prove.bernstein(line)
    time = prove.arrival(b, e, starts, starts + 1, 2.3)
    assert 2.3 <= time <= 2.3 + 2e-8
    assert prove.arrival(b, e, starts, starts + 1, 5.0) == np.inf


def test_coordinates_lie_within_their_errors() -> None:
    document = planned("arc")
    mechanism = Mechanism.from_robot(ssm.load_problem("rounded_corners").robot)
    with np.errstate(all="ignore"):
        boxes = prove.Proof(document).boxes
    sign = float(document["problem"]["robot"]["geometry"]["insertion_sign"])
    places, errors = boxes.coordinates(boxes.tool, boxes.motion[0][3] * sign)
    joints = prove.bernstein(boxes.motion[0])[0][0].T
    tasks = dict(
        zip(("roll", "tilt", "spin", "depth"), task_from_joints(mechanism, joints).T, strict=True)
    )
    assert max(float(errors[name].max()) for name in places) < 1e-10
    for name, values in places.items():
        assert np.all(np.abs(values - tasks[name]) <= errors[name] + 4e-15), name


def test_a_whole_turn_of_the_roll_does_not_count() -> None:
    base = ssm.load_problem("tilt_insert")
    motion = (Straight(roll=12 * deg, tilt=-100 * deg), Straight(roll=-5 * deg, depth=12 * mm))
    result = plan_of(unchecked_copy(base, motion=motion, planner="fast"), relaxations=False)
    document = json.loads(result.to_json())
    for turns, verdict in ((0, "PROVEN"), (1, "PROVEN"), (0.5, "REFUTED")):
        changed = copy.deepcopy(document)
        for entry in changed["problem"]["motion"]:
            entry["target"]["task"]["roll"] += turns * 2 * math.pi
        assert claims_of(changed)["path departure"].verdict == verdict

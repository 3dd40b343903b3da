"""The proof over ranges of friction and payload covers every case in the ranges. It refutes a limit
that a corner of the ranges exceeds.
"""

from __future__ import annotations

import copy
import json
from typing import Any

import numpy as np
import pytest

from examples import prove
from tests.support.paths import ROOT

PLAN = json.loads((ROOT / "results/tilt_insert/plan.json").read_text(encoding="utf-8"))

# The tests use the end of the first motion and the start of the second one, which takes less time
# than the whole plan.
BETWEEN = PLAN["trajectory"]["breaks_s"].index(PLAN["trajectory"]["phases"][0]["end_s"])
PLAN["trajectory"] = {
    "breaks_s": PLAN["trajectory"]["breaks_s"][BETWEEN - 60 : BETWEEN + 61],
    "coefficients": PLAN["trajectory"]["coefficients"][BETWEEN - 60 : BETWEEN + 60],
    "phases": [],
}
TORQUES = {"motor torque", "continuous torque", "self-locking"}
SPREAD = {"mu": (0.9, 1.2), "b_c": (0.8, 1.3), "b_v": (0.7, 1.1), "b_oc": (0.2, 3), "b_ov": (0, 3)}
Document = dict[str, Any]


def changed(seed: int, *, friction: bool, payload: bool) -> Document:
    """Return a plan with ranges of friction and payload.

    The seed decides whether the drives lock themselves, and gives the direction of gravity.
    """
    rng, plan = np.random.default_rng(seed), copy.deepcopy(PLAN)
    problem = plan["problem"]
    problem["payload"] = [0.01, 0.2] if payload else None
    problem["friction"] = 0.9 if friction else None
    gravity = rng.normal(size=3)
    problem["robot"]["gravity"] = (9.81 * gravity / np.linalg.norm(gravity)).tolist()
    for drive in (joint["drive"] for joint in problem["robot"]["joints"] if joint["drive"]):
        drive["friction"]["b_ov"] = 1e-3
        if seed % 2:
            drive["friction"] |= {"mu": 0.01, "mu_static": 0.012}
            drive["self_locking"] = False
        drive["friction_ranges"] = {
            name: [drive["friction"][name] * share for share in shares]
            for name, shares in SPREAD.items()
        }
    return plan


def claims_of(plan: Document) -> dict[tuple[str, str | None], Any]:
    with np.errstate(all="ignore"):
        proof = prove.Proof(plan)
        for j, joint in enumerate(proof.robot["joints"]):
            proof.joint(j, joint)
    claims = (prove.claim(*key, parts) for key, parts in proof.parts.items())
    return {(claim.name, claim.joint): claim for claim in claims if claim.name in TORQUES}


def case_of(plan: Document, rng: np.random.Generator) -> Document:
    """Return the plan with one friction and one payload from its ranges in place of the ranges."""
    case = copy.deepcopy(plan)
    problem = case["problem"]
    for drive in (joint["drive"] for joint in problem["robot"]["joints"] if joint["drive"]):
        ranges, drive["friction_ranges"] = drive["friction_ranges"], {}
        if problem["friction"]:
            ratio = drive["friction"]["mu_static"] / drive["friction"]["mu"]
            for name, ends in ranges.items():
                drive["friction"][name] = rng.choice([*ends, rng.uniform(*ends)])
            drive["friction"]["mu_static"] = ratio * drive["friction"]["mu"]
    if problem["payload"]:
        mass = rng.choice([0.0, *problem["payload"], rng.uniform(*problem["payload"])])
        tool = problem["robot"]["bodies"][3]
        total = tool["mass"] + mass
        tool["com"] = [x * tool["mass"] / total for x in tool["com"]]
        tool["mass"] = total
    problem["friction"] = problem["payload"] = None
    return case


@pytest.mark.parametrize(
    ("seed", "friction", "payload"),
    [(0, True, True), (1, True, True), (3, True, False), (4, False, True)],
)
def test_no_case_exceeds_what_is_proven_of_a_range(
    seed: int, *, friction: bool, payload: bool
) -> None:
    plan = changed(seed, friction=friction, payload=payload)
    complete, rng = claims_of(plan), np.random.default_rng(seed)
    for _ in range(3):
        for key, claim in claims_of(case_of(plan, rng)).items():
            assert claim.excess <= complete[key].excess + 1e-9 * (1 + abs(claim.excess)), key


def test_limits_just_kept_and_just_exceeded_by_a_corner() -> None:
    """A torque limit that exceeds the worst corner by 1e-8 is proven.

    A limit that is smaller by 3e-6 is refuted.
    """
    plan = changed(0, friction=True, payload=True)
    complete = claims_of(plan)
    for share, verdict in ((1 + 1e-8, "PROVEN"), (1 - 3e-6, "REFUTED")):
        for joint in plan["problem"]["robot"]["joints"]:
            if joint["drive"]:
                worst = complete["motor torque", joint["name"]]
                joint["motor"]["max_torque"] = max(abs(worst.low), abs(worst.high)) * share
        result = {key: claim for key, claim in claims_of(plan).items() if key[0] == "motor torque"}
        assert {claim.verdict for claim in result.values()} == {verdict}


def test_self_locking_is_that_of_the_least_friction() -> None:
    plan = changed(0, friction=True, payload=False)
    drive = plan["problem"]["robot"]["joints"][3]["drive"]
    assert claims_of(plan)["self-locking", "insertion"].verdict == "PROVEN"
    drive["friction_ranges"]["mu"][0] = 0.114
    assert claims_of(plan)["self-locking", "insertion"].verdict == "REFUTED"


@pytest.mark.parametrize(("preload", "verdict"), [(60.0, "PROVEN"), (1e-6, "OPEN")])
def test_corners_suffice_only_if_the_nuts_touch(preload: float, verdict: str) -> None:
    plan = changed(0, friction=True, payload=False)
    plan["problem"]["robot"]["gravity"] = [0.0, 0.0, 0.0]
    joint = plan["problem"]["robot"]["joints"][3]
    joint["drive"] |= {"kind": "antibacklash_screw", "preload": preload, "second_nut_mass": 0.01}
    joint["motor"]["max_torque"] = 1.0
    assert claims_of(plan)["motor torque", "insertion"].verdict == verdict


def test_a_range_in_which_the_gear_jams_is_open() -> None:
    plan = changed(0, friction=True, payload=False)
    plan["problem"]["robot"]["joints"][3]["drive"]["friction_ranges"]["mu"][1] = 9.0
    assert claims_of(plan)["motor torque", "insertion"].verdict in {"OPEN", "REFUTED"}


def test_a_statistical_range_is_open() -> None:
    plan = changed(0, friction=True, payload=False)
    plan["problem"]["robot"]["joints"][0]["drive"]["friction"]["covariance"] = {"mu": {"mu": 1e-4}}
    claims = {claim.name: claim for claim in prove.prove(plan)}
    assert claims["friction"].verdict == "OPEN"

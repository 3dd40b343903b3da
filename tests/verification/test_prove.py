"""The proof encloses every limited value at all times. Exact arithmetic gives the references, and
the proof must not accept motions that exceed a limit.
"""

from __future__ import annotations

import ast
import copy
import json
import math
import subprocess
import sys
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ssm_planner
from examples import prove
from ssm_planner.cli import main
from ssm_planner.errors import TrajectoryError
from ssm_planner.pipeline.run import plan as plan_of
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.verification.proof import prove_motion
from tests.mutation.of_proof import survivors
from tests.support.cases import EVERY_CASE, drawn
from tests.support.exact_points import Instant
from tests.support.paths import ROOT
from tests.support.random_problems import random_problem

FILE = Path(prove.__file__)
SHIPPED = sorted(ROOT.glob("results/*/plan.json"))
Document = dict[str, Any]


@pytest.fixture(scope="module")
def document() -> Document:
    return json.loads((ROOT / "results/eye_approach/plan.json").read_text(encoding="utf-8"))


def proven(document: Document) -> dict[tuple[str, str | None], Any]:
    return {(claim.name, claim.joint): claim for claim in prove.prove(document)}


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.parent.name)
def test_every_limit_of_the_shipped_plans_is_proven(file: Path) -> None:
    plan = json.loads(file.read_text(encoding="utf-8"))
    claims = proven(plan)
    assert {claim.verdict for claim in claims.values()} == {"PROVEN"}
    for line in plan["certificate"]["limits"]:
        claim = claims[line["name"], line["joint"]]
        width = max(abs(claim.low), abs(claim.high), abs(claim.limit), 1e-9)
        if "jump" not in line["name"] and line["name"] not in ("path departure", "end velocity"):
            assert claim.high - claim.low <= 1e-7 * width, line["name"]
            assert abs(claim.excess + line["margin"]) <= 2e-6, line["name"]


def test_the_file_is_a_checker_of_its_own(tmp_path: Path) -> None:
    text = FILE.read_text(encoding="utf-8")
    imported = {
        name
        for node in ast.walk(ast.parse(text))
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or "ssm_planner"]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    assert {name.split(".")[0] for name in imported} - sys.stdlib_module_names == {"numpy"}
    checker = tmp_path / "prove.py"
    checker.write_text(text, encoding="utf-8")
    statuses = {}
    for name, change in (("kept", 1.0), ("refuted", 0.9), ("unknown", None)):
        plan = json.loads(SHIPPED[0].read_text(encoding="utf-8"))
        if change is None:
            plan["certificate"]["limits"][0]["name"] = "something else"
        else:
            plan["problem"]["robot"]["joints"][1]["acceleration"] *= change
        (tmp_path / "plan.json").write_text(json.dumps(plan), encoding="utf-8")
        words = [sys.executable, "-I", str(checker), str(tmp_path / "plan.json")]
        result = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, check=False)
        statuses[name] = result.returncode
        verdict = {"kept": "PROVEN", "refuted": "REFUTED", "unknown": "OPEN"}[name]
        assert verdict in result.stdout, result.stderr
    assert statuses == {"kept": 0, "refuted": 1, "unknown": 4}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[]", "TypeError"),
        ("{", "JSONDecodeError"),
        ('{"mu": NaN}', "NaN is not a finite number"),
        ('{"mu": 1e999}', "1e999 is not a finite number"),
    ],
)
def test_a_file_that_is_no_plan_has_status_2(text: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text(text, encoding="utf-8")
    words = [sys.executable, "-I", str(FILE), str(tmp_path / "plan.json")]
    result = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    assert result.returncode == 2
    assert result.stdout == ""
    assert "plan.json cannot be read as a plan" in result.stderr
    assert reason in result.stderr


def value_at(model: Any, index: tuple[int, ...], s: Decimal) -> tuple[Decimal, float]:
    """Return the exact value of a model's polynomial at s, and the error bound of the model."""
    value = sum((Decimal(float(c[index])) * s**k for k, c in enumerate(model.c)), start=Decimal(0))
    return value, float(model.r[index])


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.parent.name)
def test_points_by_other_arithmetic_lie_in_the_models(file: Path) -> None:
    """Exact decimal values of motions, efforts and torques lie within the enclosures."""
    plan = json.loads(file.read_text(encoding="utf-8"))
    with np.errstate(all="ignore"):
        proof = prove.Proof(plan)
    boxes, rng = proof.boxes, np.random.default_rng(1)
    tau, used = proof.tau, 0.0
    drives = [joint["drive"] for joint in plan["problem"]["robot"]["joints"]]
    for k in rng.choice(len(boxes.piece), 25):
        s = Decimal(float(rng.choice([-1.0, 1.0, rng.uniform(-1, 1)])))
        middle, half = float((boxes.begin[k] + boxes.end[k]) / 2), float(boxes.half[k])
        instant = Instant(plan, int(boxes.piece[k]), Decimal(middle) + Decimal(half) * s)
        pairs = [
            (model, (j, k), exact)
            for model, values in zip(boxes.motion, instant.derivatives, strict=True)
            for j, exact in enumerate(values)
        ]
        pairs += [(model, (k,), exact) for model, exact in zip(tau, instant.efforts(), strict=True)]
        pairs += [(boxes.tool, (i, k), x) for i, x in enumerate(instant.tool)]
        for j, drive in enumerate(drives):
            if drive and not boxes.idle[j, k]:
                sign = 1 if boxes.up[j, k] else -1
                v, a = (x[j][[k]] for x in boxes.motion[1:3])
                mu = prove.friction(drive, v * float(sign))
                _, rows = prove.rows(drive, (tau[j][[k]], v, a), float(sign), mu)
                exact = sign * instant.motor_torque(
                    j, instant.efforts()[j], sign, Decimal(drive["friction"]["mu"])
                )
                ends = [value_at(row, (0,), s) for row in rows]
                larger = max(ends, key=lambda pair: pair[0])
                assert abs(larger[0] - exact) <= Decimal(max(r for _, r in ends)), drive["name"]
        for model, index, exact in pairs:
            value, error = value_at(model, index, s)
            assert abs(value - exact) <= Decimal(error)
            used = max(used, float(abs(value - exact)) / error)
    assert used > 1e-4  # The errors are not overestimated by much.


def test_angles_and_tips_lie_within_the_claims(document: Document) -> None:
    claims = proven(document)
    limits, eye = document["problem"]["limits"], document["problem"]["eye"]
    breaks = document["trajectory"]["breaks_s"]
    for piece in range(0, len(breaks) - 1, 8):
        instant = Instant(document, piece, Decimal((breaks[piece + 1] - breaks[piece]) * 0.37))
        roll, tilt = map(float, instant.task())
        for name, value in (("roll", roll), ("tilt", tilt)):
            low, high = limits[name]
            excess = max(value - high, low - value) / ((high - low) / 2)
            assert excess <= claims[f"{name} range", None].excess + 1e-12
        tip = np.array([float(x * instant.q[3]) for x in instant.tool])
        away = float(np.linalg.norm(tip - eye["centre"]))
        distance = max(eye["radius"] - away, eye["clearance"] + eye["port"] - np.linalg.norm(tip))
        assert distance >= claims["retina clearance", None].low - 1e-12


JOINT = {"velocity", "acceleration"}
MOTOR = {
    "motor torque": "max_torque",
    "continuous torque": "nominal_torque",
    "motor speed": "max_speed",
}


def test_limits_just_kept_and_just_exceeded(document: Document) -> None:
    """Limits that exceed the worst values by 1e-8 are proven.

    Limits that are smaller than the worst values by 3e-6 are refuted.
    """
    claims = proven(document)
    for share, verdict in ((-1e-8, "PROVEN"), (3e-6, "REFUTED")):
        plan, names = copy.deepcopy(document), set()
        problem = plan["problem"]
        joints = {joint["name"]: joint for joint in problem["robot"]["joints"]}
        for (name, joint), claim in claims.items():
            value = max(abs(claim.low), abs(claim.high)) * (1 - share)
            if name in JOINT:
                joints[joint][name] = value
            elif name in MOTOR:
                joints[joint]["motor"][MOTOR[name]] = value
            elif name.endswith(" rate"):
                problem["rates"][name[:-5]] = value
            else:
                continue
            names.add((name, joint))
        assert len(names) >= 20
        result = proven(plan)
        assert {result[key].verdict for key in names} == {verdict}


def shifted(c: np.ndarray, x: float) -> np.ndarray:
    """Return coefficients (6, 4) about an instant that is later by x."""
    return np.array(
        [sum(c[k] * math.comb(k, i) * x ** (k - i) for k in range(i, 6)) for i in range(6)]
    )


def with_bump(document: Document, rng: np.random.Generator) -> tuple[Document, float]:
    """Return a plan with a short bump 4 x (1 − x) in the acceleration of one joint.

    The argument x goes from 0 to 1 during the bump. The second result is the peak of the bump,
    relative to the acceleration limit.
    """
    plan = copy.deepcopy(document)
    trajectory = plan["trajectory"]
    breaks, pieces = trajectory["breaks_s"], [np.array(c) for c in trajectory["coefficients"]]
    j, piece = int(rng.integers(4)), int(rng.integers(len(pieces)))
    length = breaks[piece + 1] - breaks[piece]
    width = min(10 ** rng.uniform(-6, -3), length / 3)
    start = float(rng.choice([0.0, rng.uniform(0, length - width), length - 1.01 * width]))
    top = plan["problem"]["robot"]["joints"][j]["acceleration"]
    share = 10 ** rng.uniform(0.4, 1)
    middle = shifted(pieces[piece], start)
    # The added acceleration is a parabola that rises from 0 to its peak and returns to 0.
    middle[3, j] += 4 * share * top / width / 6
    middle[4, j] -= 4 * share * top / width**2 / 12
    end = shifted(pieces[piece], start + width)
    parts = ([pieces[piece]] if start > 0 else []) + [middle, end]
    times = ([breaks[piece] + start] if start > 0 else []) + [breaks[piece] + start + width]
    trajectory["breaks_s"] = breaks[: piece + 1] + times + breaks[piece + 1 :]
    every = pieces[:piece] + parts + pieces[piece + 1 :]
    trajectory["coefficients"] = [c.tolist() for c in every]
    return plan, share


@pytest.mark.parametrize("seed", range(3))
def test_a_short_bump_is_never_proven(document: Document, seed: int) -> None:
    plan, _ = with_bump(document, np.random.default_rng(seed))
    assert {claim.verdict for claim in prove.prove(plan)} - {"PROVEN"}


def test_open_boxes_are_no_witnesses() -> None:
    boxes = prove.constant(np.array([5.0, 1.0]))
    sure = np.array([False, True])
    low, high, _ = prove.supremum([boxes], sure, np.zeros(2), np.ones(2))
    assert (low, high) == (pytest.approx(1.0), pytest.approx(5.0))


def test_a_model_that_is_not_finite_is_open() -> None:
    for bad in (np.nan, np.inf):
        c = np.array([[1.0, bad]])
        model = prove.Model(c, np.zeros(2))
        with np.errstate(all="ignore"):
            low, high, _ = prove.supremum([model], np.ones(2, bool), np.zeros(2), np.ones(2))
        assert high == np.inf
        assert low == pytest.approx(1.0)
        part = ([low - 2.0, high - 2.0], 2.0, 1.0, 0.0, 1.0)
        assert prove.claim("x", None, [part]).verdict == "OPEN"
    with pytest.raises(ValueError, match="number"):
        prove.claim("x", None, [([np.nan, np.nan], 2.0, 1.0, 0.0, 1.0)])


@pytest.mark.parametrize("seed", range(20))
def test_the_heat_is_the_integral_of_the_larger_row(seed: int) -> None:
    rng = np.random.default_rng(seed)
    decay = 10.0 ** (-2 * np.arange(4)[:, None])
    effort = prove.Model(rng.normal(size=(4, 3)) * decay, np.full(3, 1e-15))
    effort.c[0] *= 0.01  # The load changes its sign within the box.
    up, down, base = 0.5, -0.3, prove.Model(rng.normal(size=(3, 3)) * decay[:3], np.zeros(3))
    rows = [effort * up + base, effort * down + base]
    low, high = prove.heat(effort, rows)
    s = np.linspace(-1, 1, 200_001)
    for k in range(3):
        f, b = (np.polyval(x.c[::-1, k], s) for x in (effort, base))
        truth = np.trapezoid(np.maximum(up * f + b, down * f + b) ** 2, s)
        assert low[k] - 1e-9 <= truth <= high[k] + 1e-9
        assert high[k] - low[k] <= 1e-6 * high[k]


def test_a_body_without_mass_has_no_effort(document: Document) -> None:
    plan = copy.deepcopy(document)
    for body in plan["problem"]["robot"]["bodies"]:
        body["mass"], body["inertia"] = 0.0, [[0.0] * 3] * 3
    with np.errstate(all="ignore"):
        tau = prove.Proof(plan).tau
    for model in tau:
        assert np.all(model.size < 1e-200)


@pytest.mark.parametrize(
    ("function", "exact"),
    [
        (lambda x: prove.sin_cos(x)[0], np.sin),
        (lambda x: prove.sin_cos(x)[1], np.cos),
        (lambda x: prove.exponential(x * 0.1 - 2.0), lambda x: np.exp(0.1 * x - 2.0)),
        (lambda x: prove.power(x + 9.0, -1), lambda x: 1 / (x + 9)),
        (lambda x: prove.power(x - 9.0, -1), lambda x: 1 / (x - 9)),
        (lambda x: prove.power(x + 9.0, 0.5), lambda x: np.sqrt(x + 9)),
        (lambda x: prove.power(x + 9.0, -0.5), lambda x: 1 / np.sqrt(x + 9)),
        (lambda x: x * x - x, lambda x: x * x - x),
    ],
)
def test_functions_of_models(function: Any, exact: Any) -> None:
    rng = np.random.default_rng(0)
    model = prove.Model(np.array([rng.uniform(-3, 3, 50), np.full(50, 0.05)]), np.zeros(50))
    result = function(model)
    for s in (-1.0, -0.3, 0.6, 1.0):
        value = sum(c * s**k for k, c in enumerate(result.c))
        error = np.abs(value - exact(model.c[0] + model.c[1] * s))
        assert np.all(error <= result.r + 4e-16 * np.abs(value))
        assert np.all(result.r < 1e-7)


@pytest.mark.parametrize(
    ("low", "high"), [(-0.5, 0.7), (-2.5, 2.0), (-4.0, 4.0), (0.3, 0.3), (3.0, 3.5)]
)
def test_ranges_of_angles(low: float, high: float) -> None:
    for psi in np.linspace(-np.pi + 1e-3, np.pi - 1e-3, 41):
        c, s = (prove.constant(np.array([x])) for x in (np.cos(psi), np.sin(psi)))
        worst = max(
            value(prove.supremum(f, np.ones(1, bool), np.zeros(1), np.ones(1))[1]) - limit
            for f, limit, _, value in prove.angle(c, s, low, high)
        )
        assert (worst <= 1e-12) == (low <= psi <= high), psi


@pytest.mark.parametrize("seed", range(5))
def test_errors_of_the_factors_are_in_the_product(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, two = (
        prove.Model(rng.normal(size=(6, 4)), np.abs(rng.normal(size=4)) * rng.choice([0, 1], 4))
        for _ in range(2)
    )
    result = {
        "sum": (one + two, lambda a, b: a + b),
        "difference": (one - two, lambda a, b: a - b),
        "product": (one * two, lambda a, b: a * b),
    }
    for model, operation in result.values():
        assert np.all(model.r > 0)
        for k in range(4):
            for s in (-1.0, -0.2, 0.7, 1.0):
                a, b, c = (
                    sum(Decimal(float(x)) * Decimal(s) ** i for i, x in enumerate(f.c[:, k]))
                    for f in (one, two, model)
                )
                for first in (-1, 1):
                    for second in (-1, 1):
                        ends = (
                            a + first * Decimal(float(one.r[k])),
                            b + second * Decimal(float(two.r[k])),
                        )
                        assert abs(operation(*ends) - c) <= Decimal(float(model.r[k]))


@pytest.mark.parametrize("seed", range(5))
def test_bounds_contain_values_and_halves_are_the_same_polynomial(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = prove.Model(rng.normal(size=(6, 3)), np.array([0.0, 0.1, 1.0]))
    low, high = prove.bounds(model)
    s = np.linspace(-1, 1, 101)
    values = np.array([np.polyval(model.c[::-1, k], s) for k in range(3)])
    assert np.all(values.min(axis=1) - model.r >= low)
    assert np.all(values.max(axis=1) + model.r <= high)
    b, _ = prove.bernstein(model)
    parts = prove.halves(b)
    np.testing.assert_allclose(parts[[0, -1], :3], [b[0], values[:, 50]], atol=1e-13)
    np.testing.assert_allclose(parts[[0, -1], 3:], [values[:, 50], b[-1]], atol=1e-13)


WITHOUT_PLAN = {4, 7, 11, 35, 37, 38, 43, 47, 51, 58, 65, 67, 68, 79, 80, 83, 84, 86, 96, 98, 109}
"""Seeds of random problems for which there is no plan."""
SEEDS = drawn(10, sorted({*range(110 if EVERY_CASE else 50)} - WITHOUT_PLAN))


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_plans_of_random_problems_are_proven(seed: int, tilt_insert: Problem) -> None:
    problem = random_problem(tilt_insert, seed)
    result = plan_of(unchecked_copy(problem, planner="fast"), relaxations=False)
    assert result.passed
    for claim in proven(json.loads(result.to_json())).values():
        assert claim.verdict == "PROVEN", claim


def test_every_plan_contains_its_proof(tilt_insert: Problem, tmp_path: Path) -> None:
    plan_of(tilt_insert, relaxations=False).save(tmp_path)
    saved = ssm_planner.load_plan(tmp_path)
    assert saved.passed
    assert not saved.unproven
    assert {proof.verdict for proof in saved.proof} == {"PROVEN"}
    assert {(limit.name, limit.joint) for limit in saved.certificate.limits} == {
        (proof.name, proof.joint) for proof in saved.proof
    }
    # The separate program finds the same bounds in the written file.
    assert ssm_planner.prove(tmp_path) == saved.proof


def test_a_refuted_limit_fails_the_plan(tilt_insert: Problem) -> None:
    plan = ssm_planner.load_plan(ROOT / "results/tilt_insert")
    slow = replace(plan.robot.joints[0], velocity=0.9 * plan.robot.joints[0].velocity)
    robot = replace(plan.robot, joints=(slow, *plan.robot.joints[1:]))
    proof = prove_motion(plan.motion, unchecked_copy(plan.problem, robot=robot))
    assert [item.name for item in proof if item.verdict == "REFUTED"] == ["velocity"]
    refuted = replace(plan, proof=proof)
    assert not refuted.passed
    assert "the proof refutes a limit: velocity roll at" in refuted.disagreements[0]


def test_a_limit_outside_of_the_proof_is_named() -> None:
    plan = ssm_planner.load_plan(ROOT / "results/tilt_insert")
    partial = replace(plan, proof=tuple(item for item in plan.proof if item.name != "jerk")[1:])
    name, joint = plan.proof[0].name, plan.proof[0].joint
    assert partial.unproven == [(name, joint)]
    assert f"not proven at every instant: {name} of {joint}" in "\n".join(partial.notes)
    assert partial.passed


@pytest.mark.slow
def test_mutants_of_the_proof_are_found() -> None:
    found = [is_found for *_, is_found in survivors(12, seed=6)]
    assert sum(found) >= 10


def test_check_runs_the_separate_program(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = ROOT / "results/tilt_insert"
    copy = tmp_path / "prove.py"
    assert main(["check", str(plan), "--proof", "--checker", str(copy), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert {entry["verdict"] for entry in document["proof"]} == {"PROVEN"}
    limits = {(entry["name"], entry["joint"]) for entry in document["limits"]}
    assert limits <= {(entry["name"], entry["joint"]) for entry in document["proof"]}
    assert copy.read_bytes() == (ROOT / "examples/prove.py").read_bytes()
    assert main(["check", str(plan), "--proof"]) == 0
    assert "proof for all times: 46 PROVEN" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("verdicts", "status"),
    [(("PROVEN", "OPEN"), 4), (("OPEN", "REFUTED"), 1), (("PROVEN",), 0)],
)
def test_a_limit_that_is_not_proven_is_not_kept(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    verdicts: tuple[str, ...],
    status: int,
) -> None:
    ends = {"PROVEN": (0.0, 0.5), "OPEN": (None, None), "REFUTED": (2.0, 2.0)}
    proofs = tuple(
        ssm_planner.Proof("velocity", "roll", *ends[verdict], 1.0, 0.0, 0.0, verdict)
        for verdict in verdicts
    )
    monkeypatch.setattr(ssm_planner, "prove", lambda *_: proofs, raising=False)
    assert main(["check", str(ROOT / "results/tilt_insert"), "--proof", "--json"]) == status
    entries = json.loads(capsys.readouterr().out)["proof"]
    assert [entry["low"] for entry in entries] == [ends[verdict][0] for verdict in verdicts]


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["--proof", "--robot", "vitreoretinal"], "without --robot"),
        (["--proof", "--speed", "10%"], "without --speed"),
        (["--proof", "--tip-speed", "25mm/s"], "without --tip-speed"),
        (["--checker", "prove.py"], "--checker: needs --proof"),
        (["--proof", "--checker", "missing/folder/prove.py/x"], "missing"),
    ],
)
def test_a_proof_is_never_left_out_in_silence(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    fault: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "missing").write_text("a file in place of the folder", encoding="utf-8")
    assert main(["check", str(ROOT / "results/tilt_insert"), *words]) == 2
    assert fault in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["missing"]


def test_a_file_that_is_no_plan_has_no_proof(tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text("{}", encoding="utf-8")
    with pytest.raises(TrajectoryError, match="cannot be read as a plan"):
        ssm_planner.prove(tmp_path)

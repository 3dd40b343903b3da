"""Drive files: any sufficient set of dimensions gives the same geometry, and wrong values are
refused with a message. The references are the equations of worms and screws.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.loading.load import load_drive
from ssm_planner.problem.drive_geometry import (
    SCREW_FAMILY,
    WORM_FAMILY,
    DimensionError,
    GearFamily,
    resolve_dimensions,
)

WORM = "drives/vitreoretinal_joint1_worm.yaml"
SCREW = "drives/vitreoretinal_joint4_screw.yaml"
RIG = "drives/rig3_worm.yaml"

diameters = st.floats(0.002, 0.2)


@given(diameters, diameters, st.floats(0.0003, 0.01))
def test_any_sufficient_set_gives_the_same_worm(worm: float, wheel: float, lead: float) -> None:
    full = {
        "ratio": math.pi * wheel / lead,
        "worm_diameter": worm,
        "wheel_diameter": wheel,
        "lead": lead,
        "lead_angle": math.atan(lead / (math.pi * worm)),
    }
    # Three dimensions that one equation relates do not determine the worm.
    dependent = ({"ratio", "wheel_diameter", "lead"}, {"worm_diameter", "lead", "lead_angle"})
    for names in itertools.combinations(full, 3):
        given_ = {name: full[name] for name in names}
        if set(names) in dependent:
            with pytest.raises(DimensionError, match="do not determine"):
                resolve_dimensions(WORM_FAMILY, given_)
        else:
            assert_same(resolve_dimensions(WORM_FAMILY, given_), full)
    assert_same(resolve_dimensions(WORM_FAMILY, full), full)


@given(diameters, st.floats(0.0003, 0.01), st.integers(1, 4))
def test_any_sufficient_set_gives_the_same_screw(diameter: float, lead: float, starts: int) -> None:
    full = {
        "diameter": diameter,
        "lead": lead,
        "lead_angle": math.atan(lead / (math.pi * diameter)),
    }
    for names in itertools.combinations(full, 2):
        result = resolve_dimensions(SCREW_FAMILY, {name: full[name] for name in names})
        assert_same(result, full)
        assert result["ratio"] == pytest.approx(2 * math.pi / lead)
    assert_same(
        resolve_dimensions(
            SCREW_FAMILY, {"effective_diameter": diameter, "starts": starts, "pitch": lead / starts}
        ),
        full,
    )


@given(diameters, diameters, st.floats(0.0003, 0.01))
def test_a_drive_without_friction_loses_no_power(worm: float, wheel: float, lead: float) -> None:
    result = resolve_dimensions(
        WORM_FAMILY, {"worm_diameter": worm, "wheel_diameter": wheel, "lead": lead}
    )
    gamma = result["worm_diameter"] / result["wheel_diameter"]
    assert gamma * math.tan(result["lead_angle"]) * result["ratio"] == pytest.approx(1)


def assert_same(result: dict[str, float], full: dict[str, float]) -> None:
    """Assert that the result contains all values of `full`."""
    for name, value in full.items():
        assert result[name] == pytest.approx(value, rel=1e-9), name


@pytest.mark.parametrize(
    ("family", "given_", "part"),
    [
        (WORM_FAMILY, {}, "do not determine"),
        (WORM_FAMILY, {"ratio": 120.0, "worm_diameter": 0.01}, "do not determine the worm"),
        (SCREW_FAMILY, {"lead": 0.002}, "do not determine the screw"),
        (SCREW_FAMILY, {"starts": 1.0, "pitch": 0.002}, "do not determine the screw"),
        (
            SCREW_FAMILY,
            {"diameter": 0.012, "effective_diameter": 0.011, "lead": 0.002},
            "differs from diameter",
        ),
        (
            SCREW_FAMILY,
            {"diameter": 0.012, "lead": 0.002, "lead_angle": 0.1},
            "contradicts the other dimensions",
        ),
        (
            SCREW_FAMILY,
            {"diameter": 0.012, "lead": 0.002, "starts": 2.0, "pitch": 0.002},
            "contradicts",
        ),
        (SCREW_FAMILY, {"diameter": 0.012, "lead_angle": 1.2}, "between 0 and 60 deg"),
    ],
)
def test_wrong_sets(family: GearFamily, given_: dict[str, float], part: str) -> None:
    with pytest.raises(DimensionError, match=part):
        resolve_dimensions(family, given_)


def test_consistent_surplus_is_accepted_and_an_inconsistent_one_is_not() -> None:
    exact = math.atan(0.002 / (math.pi * 0.012))
    resolve_dimensions(
        SCREW_FAMILY, {"diameter": 0.012, "lead": 0.002, "lead_angle": exact * 1.004}
    )
    with pytest.raises(DimensionError):
        resolve_dimensions(
            SCREW_FAMILY, {"diameter": 0.012, "lead": 0.002, "lead_angle": exact * 1.006}
        )


@pytest.mark.parametrize(
    ("file", "old", "new", "parts"),
    [
        (WORM, "kind: worm", "kind: wurm", ("kind = wurm", "worm, lead_screw, antibacklash_screw")),
        (WORM, "kind: worm", "kind: [worm]", ("kind", "worm, lead_screw")),
        (
            WORM,
            "geometry:",
            "geomtry:",
            ("geomtry", "unknown key; did you mean 'geometry'?", "allowed: "),
        ),
        (
            WORM,
            "mu: {value: 0.13,",
            "mu: {value: 0.13 N,",
            ("friction.mu.value = 0.13 N", "has no unit"),
        ),
        (
            WORM,
            "mu: {value: 0.13,",
            "mu: {value: -0.13,",
            ("friction.mu.value = -0.13", "negative"),
        ),
        (WORM, "mu: {value: 0.13,", "mu: {value: 13,", ("friction.mu", "implausible", "0 to 1.5")),
        (
            WORM,
            "mu: {value: 0.13,",
            "mu: {val: 0.13,",
            ("friction.mu.val", "unknown key; did you mean 'value'?"),
        ),
        (WORM, "mu: {value: 0.13,", "mu: {source: x} # ", ("friction.mu.value", "missing")),
        (
            WORM,
            "mu: {value: 0.13,",
            "mu: {placeholder: maybe, value: 0.13,",
            ("placeholder", "true or false"),
        ),
        (
            WORM,
            "mu_static: {value: 0.15,",
            "mu_static: {value: 0.1,",
            ("mu_static", "smaller than mu", "0.13"),
        ),
        (WORM, "law: coulomb", "law: coulom", ("friction.law = coulom", "stribeck_gaussian")),
        (
            WORM,
            "law: coulomb",
            "law: stribeck_gaussian",
            ("friction.law", "mu_stribeck and stribeck_speed"),
        ),
        (WORM, "  law: coulomb", "  mu_lowest: 0.2", ("mu_lowest = 0.2", "larger than mu")),
        (
            WORM,
            "  law: coulomb",
            "  mu_stribeck: 0.1",
            ("mu_stribeck", "not a parameter of the coulomb law"),
        ),
        (
            WORM,
            "b_oc: {value: 4e-3 N*m,",
            "b_oc: {value: 4e-3 N,",
            ("b_oc.value = 4e-3 N", "a force, not a torque"),
        ),
        (
            SCREW,
            "b_oc: {value: 4e-3 N,",
            "b_oc: {value: 4e-3 N*m,",
            ("b_oc.value = 4e-3 N*m", "not a force"),
        ),
        (
            WORM,
            "b_c: {value: 3.82e-3 N*m",
            "b_c: {value: 3.82e-3 mm",
            ("a length, not a torque", "80 mN*m"),
        ),
        (
            WORM,
            "self_locking: required",
            "self_locking: maybe",
            ("self_locking = maybe", "'required' or 'not required'"),
        ),
        (
            WORM,
            "ratio: {value: 120",
            "ratio: {value: 0",
            ("geometry.ratio.value = 0", "not greater than zero"),
        ),
        (
            WORM,
            "thread_angle: {value: 40 deg",
            "thread_angle: {value: 140 deg",
            ("implausible", "below 120 deg"),
        ),
        (
            WORM,
            "output_inertia: {value: 8.5e-6 kg*m^2",
            "output_inertia: {value: 8.5e-6 kg",
            ("a mass, not a moment",),
        ),
        (WORM, "self_locking: required", "preload: 1 N", ("preload", "unknown key")),
        (
            RIG,
            "friction: to_identify",
            "friction: to_indentify",
            ("friction = to_indentify", "to_identify"),
        ),
        (RIG, "direction: -1", "direction: -2", ("rig.direction = -2", "-1 or 1")),
        (
            RIG,
            "payload_arm: 20 mm",
            "payload_arm: 0 mm",
            ("rig.payload_arm = 0 mm", "not greater than zero"),
        ),
        (
            RIG,
            "payload_mass: 0.096 kg",
            "payload_mass: 0.096",
            ("rig.payload_mass = 0.096", "without a unit"),
        ),
    ],
)
def test_bad_drives(files: Any, file: str, old: str, new: str, parts: tuple[str, ...]) -> None:
    message = files.rejection(file, old, new)
    for part in parts:
        assert part in message


def test_contradicting_geometry_names_file_line_and_what_would_fit(files: Any) -> None:
    message = files.rejection(
        WORM, "  thread_angle", "  lead: 2 mm\n  thread_angle", at="  wheel_diameter"
    )
    # Ratio and lead are kept. They require a wheel diameter of 120 · 2 mm / π.
    assert (
        "geometry.wheel_diameter = 30 mm: contradicts the other dimensions, which give 76.394 mm"
        in message
    )


def test_insufficient_geometry(files: Any) -> None:
    message = files.rejection(WORM, "  wheel_diameter", "  # wheel_diameter", at="geometry:")
    assert "do not determine the worm" in message
    assert "ratio, worm_diameter" in message


def test_friction_may_only_be_missing_on_a_rig(files: Any) -> None:
    text = (files.root / RIG).read_text(encoding="utf-8")
    (files.root / RIG).write_text(text[: text.index("rig:")], encoding="utf-8")
    message = files.rejection(RIG, "friction: to_identify", "friction: to_identify")
    assert "only a drive with a rig" in message


class TestSelfLocking:
    def test_rejected_with_all_that_is_needed(self, files: Any) -> None:
        message = files.rejection(SCREW, "mu: {value: 0.17", "mu: {value: 0.11")
        lead_angle = math.atan(1.2192 / (math.pi * 3.175))
        across = math.cos(math.atan(math.tan(math.radians(20)) * math.cos(lead_angle)))
        for part in (
            "friction.mu = 0.11: ",
            f"λ = {math.degrees(lead_angle):.4g} deg",
            f"φ_f = {math.degrees(math.atan(0.11 / across)):.4g} deg",
            f"mu above {math.tan(lead_angle) * across:.4g}",
            "self_locking: not required",
        ):
            assert part in message

    def test_the_lowest_mu_counts(self, files: Any) -> None:
        message = files.rejection(SCREW, "  law: coulomb", "  mu_lowest: 0.1")
        assert "is not self-locking" in message

    def test_friction_at_rest_does_not_count(self, files: Any) -> None:
        files.edit(SCREW, "mu_static: {value: 0.17", "mu_static: {value: 0.5")
        assert "is not self-locking" in files.rejection(
            SCREW, "mu: {value: 0.17", "mu: {value: 0.11"
        )

    @pytest.mark.parametrize("offset", [-1e-3, 1e-3])
    def test_the_bound_named_is_the_bound(self, files: Any, offset: float) -> None:
        drive = load_drive(files.root / SCREW)
        bound = math.tan(drive.lead_angle) * math.cos(drive.pressure_angle)
        new = f"mu: {{value: {bound * (1 + offset)!r}"
        if offset < 0:
            message = files.rejection(SCREW, "mu: {value: 0.17", new)
            assert f"mu above {bound:.4g}" in message
        else:
            files.edit(SCREW, "mu: {value: 0.17", new)
            files.load(SCREW)

    def test_may_be_waived(self, files: Any) -> None:
        files.edit(SCREW, "self_locking: required", "self_locking: not required")
        files.edit(SCREW, "mu: {value: 0.17", "mu: {value: 0.01")
        assert not files.load(SCREW).self_locking


def test_stribeck_law_and_identified_friction(files: Any) -> None:
    extras = """  law: stribeck_gaussian
  mu_stribeck: 0.03
  stribeck_speed: 10 rpm
  identified_speed: 200 rpm
  dwell_constant: 1.5 s
  memory: 0.25 s
  covariance: {mu: {mu: 1e-6}}
  source: identified"""
    files.edit(WORM, "  law: coulomb", extras)
    friction = files.load(WORM).friction
    assert friction.law == "stribeck_gaussian"
    assert friction.stribeck_speed == pytest.approx(math.pi / 3)
    assert friction.identified_speed == pytest.approx(20 * math.pi / 3)
    assert friction.covariance == {"mu": {"mu": 1e-6}}


class TestRigs:
    def test_worm(self, files: Any) -> None:
        drive = files.load(RIG)
        assert drive.friction is None
        rig = drive.rig
        # The weight turns the wheel forwards, so the payload torque is negative.
        assert rig.F_payload == pytest.approx(-0.096 * 9.812 * 0.02)
        assert rig.payload_inertia == pytest.approx(0.096 * 0.02**2)
        assert rig.direction == -1
        assert rig.motor_nominal_torque == pytest.approx(9.84e-3)
        assert rig.published["mu"] == 0.12
        assert drive.dimensions["wheel_diameter"] == pytest.approx(0.03, rel=1e-4)

    @pytest.mark.parametrize("name", ["rig1_lead_screw", "rig2_antibacklash_screw"])
    def test_screws(self, files: Any, name: str) -> None:
        drive = files.load(f"drives/{name}.yaml")
        assert drive.rig.F_payload == pytest.approx(-0.096 * 9.812)
        assert drive.rig.payload_inertia == pytest.approx(0.096)
        assert drive.gamma == pytest.approx(0.0055)
        assert drive.dimensions["outer_diameter"] == pytest.approx(0.012)
        assert drive.lead_angle == pytest.approx(math.atan(2 / (math.pi * 11)))

    def test_without_friction_not_in_a_robot(self, files: Any) -> None:
        message = files.rejection(
            "robots/vitreoretinal.yaml",
            "../drives/vitreoretinal_joint1_worm.yaml",
            "../drives/rig3_worm.yaml",
        )
        assert "joints.roll.drive" in message
        assert "has not been identified" in message

"""Robot files: axes, bodies and joints are read, and wrong values are refused with a message. The
references are the definition of the inertia tensor and the published chains of rotations.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.loading.robots import chain_rotation, is_possible_inertia, principal_moments

ROBOT = "robots/vitreoretinal.yaml"

seeds = st.integers(0, 2**32 - 1)


def inertia_of(points: np.ndarray, masses: np.ndarray) -> np.ndarray:
    """Return the inertia tensor ∑ m (|r|² I − r rᵀ) about the origin (3, 3) of point masses."""
    return sum(
        m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, points, strict=True)
    )


@given(seeds)
def test_every_cloud_of_masses_is_a_possible_body(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(6, 3)) * rng.uniform(0.01, 0.1, 3) + rng.normal(size=3) * 0.2
    masses = rng.uniform(0.01, 1, 6)
    moments = principal_moments(
        masses.sum(), masses @ points / masses.sum(), inertia_of(points, masses)
    )
    assert is_possible_inertia(moments)
    # the same body turned and moved has the same principal moments
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    moved = points @ turn.T + rng.normal(size=3)
    again = principal_moments(
        masses.sum(), masses @ moved / masses.sum(), inertia_of(moved, masses)
    )
    assert again == pytest.approx(moments, rel=1e-6, abs=1e-9)


@given(seeds)
def test_flipped_products_are_judged_by_their_own_moments(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(6, 3)) * 0.02 + np.array([0.1, -0.15, 0.2]) * rng.choice([-1, 1], 3)
    masses = rng.uniform(0.01, 1, 6)
    inertia = inertia_of(points, masses)
    flipped = 2 * np.diag(np.diag(inertia)) - inertia
    com = masses @ points / masses.sum()
    # Far from the origin, the parallel-axis term dominates the products. Products with the opposite
    # sign are impossible there.
    assert not is_possible_inertia(principal_moments(masses.sum(), com, flipped))


@pytest.mark.parametrize("moments", [(-1, 2, 2), (0, 1, 1), (1, 1, 2.1), (1, 2, math.nan)])
def test_impossible_moments(moments: tuple[float, ...]) -> None:
    assert not is_possible_inertia(np.array(moments))


def test_flat_body_is_possible() -> None:
    assert is_possible_inertia(np.array([1.0, 2.0, 3.0]))


class TestShippedBodies:
    def test_moments(self, files: Any) -> None:
        for body in files.load(ROBOT).bodies:
            assert body.inertia == pytest.approx(body.inertia.T)
            if body.mass > 0:
                assert is_possible_inertia(principal_moments(body.mass, body.com, body.inertia))

    def test_wrong_convention_is_explained(self, files: Any) -> None:
        message = files.rejection(
            ROBOT, "products_of_inertia: cad", "products_of_inertia: tensor", at="inertia:\n"
        )
        for part in (
            "bodies[0].inertia",
            "impossible principal moments",
            "sign of the products",
            "cad gives possible moments",
        ):
            assert part in message

    def test_frames_have_z_along_their_joint(self, files: Any) -> None:
        robot = files.load(ROBOT)
        g = robot.geometry
        for body, axis in zip(robot.bodies, (g.omega1, g.omega2, g.omega3, g.omega3), strict=True):
            assert body.frame[:, 2] == pytest.approx(axis, abs=1e-12)
            assert body.frame @ body.frame.T == pytest.approx(np.eye(3), abs=1e-12)

    def test_frames_are_the_published_chains(self, files: Any) -> None:
        def r(axis: str, degrees: float) -> np.ndarray:
            c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
            return np.array(
                {
                    "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
                    "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
                    "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
                }[axis]
            )

        first = r("x", 90) @ r("y", 90)
        second = first @ r("y", 30)
        third = second @ r("y", -30) @ r("x", -90 - 23) @ r("z", -90)
        bodies = files.load(ROBOT).bodies
        for body, frame in zip(bodies, (first, second, third, third), strict=True):
            assert body.frame == pytest.approx(frame, abs=1e-12)


class TestShippedGeometry:
    def test_axes(self, files: Any) -> None:
        g = files.load(ROBOT).geometry
        c, s = math.cos(math.radians(23)), math.sin(math.radians(23))
        assert g.omega1 == pytest.approx([1, 0, 0])
        assert g.omega2 == pytest.approx(
            [math.cos(math.radians(30)), math.sin(math.radians(30)), 0]
        )
        assert g.omega3 == pytest.approx([-s, 0, c])
        assert math.degrees(math.acos(g.omega2 @ g.omega3)) == pytest.approx(109.778, abs=5e-4)
        assert g.tool_home[:, 2] == pytest.approx(g.omega3)
        assert g.insertion_sign == -1

    def test_arrays_are_read_only(self, files: Any) -> None:
        g = files.load(ROBOT).geometry
        with pytest.raises(ValueError, match="read-only"):
            g.omega1[0] = 0

    def test_axes_and_angles_give_the_same_robot(self, files: Any) -> None:
        by_angles = files.load(ROBOT).geometry
        rows = [
            ", ".join(repr(float(x)) for x in w)
            for w in (by_angles.omega1, by_angles.omega2, by_angles.omega3)
        ]
        axes = "".join(f"\n    joint{i}: [{row}]" for i, row in enumerate(rows, 1))
        files.edit(ROBOT, "  home_tilt: -113 deg", f"  axes:{axes}")
        files.edit(ROBOT, "  alpha: 30 deg ", "  # ")
        name_no_angles(files)
        by_axes = files.load(ROBOT).geometry
        for name in ("omega1", "omega2", "omega3", "tool_home"):
            assert getattr(by_axes, name) == pytest.approx(getattr(by_angles, name), abs=1e-12)

    @pytest.mark.parametrize("roll", [-70.0, 12.0, 45.0])
    def test_beta_fixes_the_roll_at_home(self, files: Any, roll: float) -> None:
        a, t, p = math.radians(30), math.radians(-113), math.radians(roll)
        beta = math.acos(math.cos(a) * math.cos(t) + math.sin(a) * math.sin(t) * math.sin(p))
        files.edit(
            ROBOT, "insertion: negative", f"beta: {math.degrees(beta)!r} deg\n  insertion: negative"
        )
        chain = f"[x {roll!r} deg, y -113 deg, y 90 deg]"
        files.edit(ROBOT, "insertion: negative", f"tool_home: {chain}\n  insertion: negative")
        g = files.load(ROBOT).geometry
        assert math.acos(g.omega2 @ g.omega3) == pytest.approx(beta, abs=1e-9)
        assert g.omega3 == pytest.approx(chain_rotation((("x", p), ("y", t)))[:, 0], abs=1e-9)

    def test_rounded_beta_is_taken_as_a_check(self, files: Any) -> None:
        files.edit(ROBOT, "insertion: negative", "beta: 110 deg\n  insertion: negative")
        assert files.load(ROBOT).geometry.omega3[1] == 0


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("alpha: 30 deg ", "alpha: 30 ", ("geometry.alpha = 30", "without a unit", "-110 deg")),
        ("alpha: 30 deg ", "alpha: 0.01 deg ", ("geometry.alpha", "parallel", "0.1 and 179.9 deg")),
        ("alpha: 30 deg ", "beta: 110 deg ", ("geometry.alpha", "missing")),
        (
            "insertion: negative",
            "beta: 100 deg\n  home_roll: 0 deg\n  insertion: negative",
            ("within 0.5 deg",),
        ),
        (
            "insertion: negative",
            "beta: 20 deg\n  insertion: negative",
            ("no home_roll", "83 to 143 deg"),
        ),
        (
            "insertion: negative",
            "insertion: inwards",
            ("insertion = inwards", "'negative' or 'positive'"),
        ),
        (
            "insertion: negative",
            "tool_home: [x 90 deg]\n  insertion: negative",
            ("z axis of the tool",),
        ),
        (
            "gravity: [0 m/s^2, 0 m/s^2, -9.81 m/s^2]",
            "gravity: [0, 0, -9.81]",
            ("gravity = [0, 0, -9.81]", "unit"),
        ),
        (
            "mass: 0.72278480 kg",
            "mass: -0.72278480 kg",
            ("bodies[0].mass = -0.72278480 kg", "negative"),
        ),
        ("mass: 0.72278480 kg", "mass: 722 kg", ("did you mean g",)),
        (
            "    mass: 0 kg ",
            "    inertia: {xx: 1 kg*m^2, yy: 1 kg*m^2, zz: 1 kg*m^2}\n    mass: 0 kg ",
            ("without mass",),
        ),
        (
            "velocity: 65 deg/s",
            "velocity: 0 deg/s",
            ("joints.roll.velocity = 0 deg/s", "not greater than zero"),
        ),
        ("velocity: 65 deg/s", "velocity: 65 mm/s", ("not a speed", "65 deg/s")),
        (
            "velocity: 20 mm/s",
            "velocity: 20 deg/s",
            ("joints.insertion.velocity = 20 deg/s", "20 mm/s"),
        ),
        (
            "position: [-360 deg, 360 deg]",
            "position: [360 deg, -360 deg]",
            ("not below", "[360 deg, -360 deg]"),
        ),
        ("position: [-30 mm, 0 mm]", "position: [-30 deg, 0 deg]", ("an angle, not a length",)),
        (
            "tilt: [-139 deg, -81 deg]",
            "tilt: [-139, -81]",
            ("limits.tilt = [-139, -81]", "without a unit"),
        ),
        (
            "tilt: [-139 deg, -81 deg]",
            "tlt: [-139 deg, -81 deg]",
            ("limits.tlt", "did you mean 'tilt'?"),
        ),
        ("tilt: [-139 deg, -81 deg]", "depth: [40 mm, 50 mm]", ("limits.depth", "0 mm to 30 mm")),
        ("frame: [y alpha]", "frame: [w 30 deg]", ("bodies[1].frame", "'w 30 deg'", "x 90 deg")),
        ("frame: [y alpha]", "frame: [y 30]", ("without a unit",)),
        ("frame: [y alpha]", "frame: y 30 deg", ("invalid chain",)),
        (
            "../motors/maxon_ecx_torque_22_m.yaml",
            "../motors/nothing.yaml",
            ("joints.tilt.motor", "does not exist"),
        ),
        (
            "../motors/maxon_ecx_torque_22_m.yaml",
            "../motors",
            ("joints.tilt.motor", "is not a file"),
        ),
        (
            "../motors/maxon_ecx_torque_22_m.yaml",
            "7",
            ("joints.tilt.motor = 7", "neither a file name nor a mapping"),
        ),
        (
            "../drives/vitreoretinal_joint1_worm.yaml",
            "../drives/vitreoretinal_joint4_screw.yaml",
            ("does not fit", "worm"),
        ),
        (
            "../drives/vitreoretinal_joint4_screw.yaml",
            "../drives/vitreoretinal_joint1_worm.yaml",
            ("does not fit",),
        ),
    ],
)
def test_bad_robots(files: Any, old: str, new: str, parts: tuple[str, ...]) -> None:
    place = "geometry:" if new.startswith("beta: 110 deg") else None
    message = files.rejection(ROBOT, old, new, place)
    for part in parts:
        assert part in message


def test_convention_is_required_with_products(files: Any) -> None:
    message = files.rejection(ROBOT, "    products_of_inertia: cad\n", "", at="  - name: link 1")
    assert "bodies[0].products_of_inertia" in message
    assert "cad (∫xy dm" in message


def test_wrong_number_of_bodies(files: Any) -> None:
    text = (files.root / ROBOT).read_text(encoding="utf-8")
    start, end = text.index("  - name: spin axis"), text.index("  - name: translation")
    (files.root / ROBOT).write_text(text[:start] + text[end:], encoding="utf-8")
    message = files.rejection(ROBOT, "bodies:", "bodies:")
    assert "3 entries" in message
    assert "at least 4" in message


def test_wrong_unit_of_inertia(files: Any) -> None:
    for old in ("xx: 0.00123747 kg*m^2", "yy: 0.00168529 kg*m^2", "zz: 0.00045452 kg*m^2"):
        name, value, _ = old.split(" ")
        files.edit(ROBOT, old, f"{name} {float(value) * 1000} kg*m^2")
    with pytest.raises(Exception, match="radius of gyration"):
        files.load(ROBOT)


def name_no_angles(files: Any) -> None:
    """Replace the names of angles by numbers, because the geometry does not give these angles."""
    for name, angle in (
        ("[y alpha]", "[y 30 deg]"),
        ("[y -alpha, x home_tilt,", "[y -30 deg, x -113 deg,"),
    ):
        files.edit(ROBOT, name, angle)


def test_axes_must_be_unit_and_not_parallel(files: Any) -> None:
    name_no_angles(files)
    files.edit(
        ROBOT,
        "  home_tilt: -113 deg",
        "  axes: {joint1: [1, 0, 0], joint2: [1, 1, 0], joint3: [0, 0, 1]}",
    )
    message = files.rejection(ROBOT, "  alpha: 30 deg ", "  # ", at="  axes:")
    assert "geometry.axes.joint2 = [1, 1, 0]" in message
    assert "length 1.414214" in message
    message = files.rejection(ROBOT, "joint2: [1, 1, 0]", "joint2: [-1, 0, 0]")
    assert "joints 1 and 2 are parallel" in message


def test_axes_and_angles_exclude_each_other(files: Any) -> None:
    message = files.rejection(
        ROBOT,
        "  insertion: negative",
        "  axes: {joint1: [1, 0, 0], joint2: [0, 1, 0], joint3: [0, 0, 1]}\n  insertion: negative",
        at="  alpha:",
    )
    assert "redundant: axes are given" in message


def test_rotor_heavier_than_the_input_side(files: Any) -> None:
    files.edit(
        "motors/maxon_ecx_speed_13_m.yaml",
        "rotor_inertia: 0.244 g*cm^2",
        "rotor_inertia: 2.44 g*cm^2",
    )
    message = files.rejection(
        ROBOT, "../motors/maxon_ecx_speed_13_m.yaml", "../motors/maxon_ecx_speed_13_m.yaml"
    )
    assert "joints.insertion.motor" in message
    assert "more inertia than the input side" in message


def test_drive_and_motor_written_inline(files: Any) -> None:
    inline = """drive:
      name: inline screw
      kind: lead_screw
      geometry: {lead: 1 mm, diameter: 4 mm, thread_angle: 30 deg}
      input_inertia: 1e-7 kg*m^2
      output_inertia: 1 g
      friction: {mu: 0.2, b_c: 0.1 mN*m, b_v: 0 N*m*s/rad}
    # """
    files.edit(ROBOT, "drive: ../drives/vitreoretinal_joint4_screw.yaml", inline)
    drive = files.load(ROBOT).joints[3].drive
    assert drive.ratio == pytest.approx(2000 * math.pi)
    assert drive.output_inertia == pytest.approx(0.001)
    assert drive.friction.mu_static == 0.2
    message = files.rejection(ROBOT, "mu: 0.2", "mu: 0.02")
    assert "joints.insertion.drive.friction.mu = 0.02" in message


def test_errors_in_a_named_file_point_into_that_file(files: Any) -> None:
    path = files.edit("drives/vitreoretinal_joint2_worm.yaml", "kind: worm", "kind: hypoid")
    with pytest.raises(Exception, match="kind = hypoid") as caught:
        files.load(ROBOT)
    assert str(caught.value).startswith(f"{path}:3: ")

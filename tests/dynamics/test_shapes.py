"""The closed forms of simple solids are compared with midpoint sums over small cells.

Robot files combine such solids into bodies.
"""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from ssm_planner.dynamics import shapes
from ssm_planner.errors import ProblemError
from ssm_planner.loading.files import find_file, follow_reference, read_section, section_from_data
from ssm_planner.loading.load import load_robot
from ssm_planner.loading.robots import robot_from


def summed(points, masses):
    """Return the moments of point masses (n,) in kg at points (n, 3) in m."""
    return shapes.MassMoments(
        masses.sum(), masses @ points, np.einsum("n,ni,nj->ij", masses, points, points)
    )


def close(a, b, tolerance):
    assert a.mass == pytest.approx(b.mass, rel=tolerance)
    for one, other in ((a.first, b.first), (a.second, b.second)):
        assert np.abs(one - other).max() <= tolerance * np.abs(other).max()


def middles(low, high, count):
    edges = np.linspace(low, high, count + 1)
    return (edges[:-1] + edges[1:]) / 2


@pytest.mark.parametrize("seed", range(5))
def test_an_arc_is_the_sum_of_its_cells(seed):
    rng = np.random.default_rng(seed)
    start, end = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    radius, (width, height), density = 0.2, rng.uniform(0.01, 0.1, 2), 2700.0
    angle = np.arccos(start @ end)
    normal = np.cross(start, end) / np.sin(angle)
    r, phi, z = np.meshgrid(
        middles(radius - width / 2, radius + width / 2, 60),
        middles(0, angle, 300),
        middles(-height / 2, height / 2, 60),
        indexing="ij",
    )
    ahead = np.cross(normal, start)
    points = (
        r[..., None] * (np.cos(phi)[..., None] * start + np.sin(phi)[..., None] * ahead)
        + z[..., None] * normal
    ).reshape(-1, 3)
    cell = width / 60 * angle / 300 * height / 60
    masses = density * (r * cell).ravel()
    close(
        shapes.arc_moments(start, end, radius, (width, height), density),
        summed(points, masses),
        1e-3,
    )


def test_a_box_and_a_rod_are_the_sums_of_their_cells():
    centre, size = np.array([0.02, -0.05, 0.11]), np.array([0.03, 0.07, 0.05])
    grid = np.stack(
        np.meshgrid(*(middles(-side / 2, side / 2, 60) for side in size)), axis=-1
    ).reshape(-1, 3)
    close(
        shapes.box_moments(0.3, centre, size),
        summed(centre + grid, np.full(len(grid), 0.3 / len(grid))),
        1e-3,
    )
    start, end, diameter = np.array([0.0, 0.01, 0.05]), np.array([0.04, 0.1, 0.2]), 0.03
    way = (end - start) / np.linalg.norm(end - start)
    side = np.cross(way, [1.0, 0, 0])
    side /= np.linalg.norm(side)
    share, r, phi = (
        item.ravel()
        for item in np.meshgrid(
            middles(0, 1, 80), middles(0, diameter / 2, 80), middles(0, 2 * np.pi, 80)
        )
    )
    points = start + share[:, None] * (end - start)
    points = points + r[:, None] * (
        np.cos(phi)[:, None] * side + np.sin(phi)[:, None] * np.cross(way, side)
    )
    rod = shapes.rod_moments(start, end, diameter, 7850.0)
    close(rod, summed(points, rod.mass * r / r.sum()), 1e-3)


PARTS = """
- {shape: arc, radius: 218 mm, width: 40 mm, height: 20 mm, density: 2700 kg/m^3, sides: [negative, negative]}
- {shape: point, mass: motor tilt, at: [0 mm, 0 mm, -240 mm], frame: next}
- {shape: box, mass: 100 g, at: [0 mm, 0 mm, -200 mm], size: [40 mm, 40 mm, 30 mm], frame: next}
- {shape: rod, start: [0 mm, 0 mm, -150 mm], end: [0 mm, 0 mm, -200 mm], diameter: 20 mm, density: 2700 kg/m^3}
"""


def tree(alpha="30 deg", parts=PARTS, **motor):
    section = read_section(find_file("vitreoretinal", "robots"))
    said = dict(section.value)
    said["geometry"] = {**said["geometry"], "alpha": alpha}
    said["joints"] = dict(said["joints"])
    for name, joint in said["joints"].items():
        inputs = {
            part: follow_reference(section, "joints", name, part).value
            for part in ("drive", "motor")
            if part in joint
        }
        said["joints"][name] = {
            key: value for key, value in {**joint, **inputs}.items() if key != "alternatives"
        }
    said["joints"]["tilt"]["motor"] = {
        **said["joints"]["tilt"]["motor"],
        "mass": "95 g",
        "source": "a test",
        **motor,
    }
    first, *others = said["bodies"]
    said["bodies"] = [
        {"name": "link 1", "frame": first["frame"], "parts": yaml.safe_load(parts)},
        *others,
    ]
    return said


def link(**given):
    return robot_from(section_from_data(tree(**given))).bodies[0]


def test_a_body_of_parts_follows_the_geometry_and_the_motor():
    """The mass and inertia of a body of parts depend on the geometry and on the motor.

    A longer arc has a proportionally larger mass. A part in the frame of the next axis moves with
    this axis. A heavier motor increases the mass and the inertia of the body.
    """
    body, longer, heavier = link(), link(alpha="40 deg"), link(mass="195 g")
    of_arc = 2700 * 0.04 * 0.02 * 0.218 * np.radians(30)
    assert body.mass == pytest.approx(of_arc + 0.095 + 0.1 + 2700 * np.pi / 4 * 0.02**2 * 0.05)
    assert longer.mass - body.mass == pytest.approx(of_arc / 3)
    assert heavier.mass - body.mass == pytest.approx(0.1)
    place = (heavier.mass * heavier.com - body.mass * body.com) / 0.1
    axis = np.array([np.sin(np.radians(30)), 0, np.cos(np.radians(30))])
    assert np.allclose(place, -0.24 * axis)
    added = 0.1 * (place @ place * np.eye(3) - np.outer(place, place))
    assert np.allclose(heavier.inertia - body.inertia, added)


def test_an_arc_of_the_second_link_ends_on_the_third_axis():
    """An arc of link 2 extends between the negative second axis and the third axis."""
    said = tree()
    parts = {
        "shape": "arc",
        "radius": "150 mm",
        "width": "30 mm",
        "height": "10 mm",
        "density": "2700 kg/m^3",
    }
    said["bodies"][1] = {
        "name": "link 2",
        "frame": ["y alpha"],
        "parts": [{**parts, "sides": ["negative", "positive"]}],
    }
    robot = robot_from(section_from_data(said))
    beta = np.arccos(robot.geometry.omega2 @ robot.geometry.omega3)
    body = robot.bodies[1]
    assert body.mass == pytest.approx(2700 * 0.03 * 0.01 * 0.15 * (np.pi - beta))
    middle = robot.geometry.omega3 - robot.geometry.omega2
    assert np.allclose(np.cross(body.frame @ body.com, middle), 0, atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("motor tilt", "motor spin", "mass = motor spin: this joint has no motor"),
        ("motor tilt", "motor knee", "mass"),
        ("shape: rod", "shape: tube", "shape"),
        ("width: 40 mm", "width: 500 mm", "beyond the remote centre"),
        ("end: [0 mm, 0 mm, -200 mm]", "end: [0 mm, 0 mm, -150 mm]", "no length"),
        ("100 g", "-100 g", "a mass cannot be negative"),
        ("density: 2700 kg/m^3", "density: 2700 kg", r"bodies\[0\]\.parts"),
    ],
)
def test_an_impossible_part_is_refused_by_name(old, new, message):
    """An impossible part is refused with a message that names the error."""
    with pytest.raises(ProblemError, match=message):
        link(parts=PARTS.replace(old, new))


def test_a_body_says_its_mass_once():
    """A body must state its mass exactly once, either directly or by its parts."""
    for body in (
        {"name": "a", "frame": []},
        {"name": "a", "frame": [], "mass": "1 kg", "parts": yaml.safe_load(PARTS)},
    ):
        said = tree()
        said["bodies"] = [{**body, "frame": said["bodies"][0]["frame"]}, *said["bodies"][1:]]
        with pytest.raises(ProblemError, match="mass"):
            robot_from(section_from_data(said))


def test_moments_add_up_and_turn():
    rng = np.random.default_rng(1)
    one, other = (
        shapes.box_moments(0.2, rng.normal(size=3), np.ones(3)),
        shapes.point_moments(0.1, rng.normal(size=3)),
    )
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    both = (one + other).rotated(turn)
    assert np.allclose(both.com, turn @ (one.first + other.first) / 0.3)
    assert np.allclose(both.inertia, turn @ (one.inertia + other.inertia) @ turn.T)


def test_how_far_a_simple_arc_is_off_the_published_bodies():
    """A simple arc approximates the published body of link 1 but not that of link 2.

    The arc and the CAD body have the same mass and the same distance between centre of mass and
    remote centre.
    """
    robot = load_robot("vitreoretinal")
    axes = (robot.geometry.omega1, robot.geometry.omega2, robot.geometry.omega3)
    result = []
    for i, sides in enumerate(((-1, -1), (-1, 1))):
        body = robot.bodies[i]
        start, end = (side * body.frame.T @ axes[i + k] for k, side in enumerate(sides))
        angle = np.arccos(start @ end)
        radius = np.linalg.norm(body.com) * angle / 2 / np.sin(angle / 2)
        width = np.sqrt(body.mass / (2700 * radius * angle))
        bar = shapes.arc_moments(start, end, radius, (width, width), 2700.0)
        assert bar.mass == pytest.approx(body.mass)
        inertia = np.linalg.norm(bar.inertia - body.inertia) / np.linalg.norm(body.inertia)
        result.append((np.linalg.norm(bar.com - body.com), inertia))
    (near, little), (far, much) = result
    assert near < 0.006
    assert little < 0.07
    assert 0.07 < far < 0.08
    assert 0.35 < much < 0.45

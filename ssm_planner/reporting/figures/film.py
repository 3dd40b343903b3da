"""Draw the motion of a plan as a film of the arm and the eye, without a GPU or a network.

`film` is the entry. The report uses `mechanism_still` for its picture of the mechanism.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING, Any

import numpy as np

from ssm_planner.arguments import checked
from ssm_planner.errors import ExportError, ProblemError
from ssm_planner.kinematics import Mechanism, fk, rotation
from ssm_planner.plans import Plan, as_plan
from ssm_planner.problem import Eye, Robot
from ssm_planner.publishing import publishing_results, replacing_result
from ssm_planner.reporting.figures.style import new_panels
from ssm_planner.reporting.figures.workspace import great_circle_arc
from ssm_planner.reporting.html.scene import link_sides
from ssm_planner.typing import Array, JsonObject, Keywords

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from PIL.Image import Image

FRAME_RATE = 25.0
"""Pictures per second. A GIF states the duration of a picture in hundredths of a second."""
MAX_FILM_DURATION = 30.0
"""Longest film, s. Longer motions are shown faster."""
STILL_COUNT = 5
"""Number of single pictures, which also form the strip."""
LINK_RADIUS, TOOL_TAIL_LENGTH = 0.026, 0.030
"""Radius of the arcs that represent links, and length of the tool outside the eye, m."""
PROJECTION = (rotation([1, 0, 0], np.radians(20.0)) @ rotation([0, 0, 1], np.radians(-28.0)))[
    [0, 2]
]
"""Matrix (2, 3) with orthonormal rows that projects base coordinates onto the picture.

The view is turned by −28° about z, and then tilted by 20° about x. Its x- and z-axes are kept.
"""
JOINT_MARKER = {"linewidth": 5.0, "marker": "o", "markevery": [0], "markersize": 7, "mfc": "white"}
"""Style of a line with a circle at its first point, which marks a joint."""
LINE_STYLES: tuple[Keywords, ...] = (
    {"color": "#4d5966", **JOINT_MARKER},
    {"color": "#8694a3", **JOINT_MARKER},
    {"color": "black"},
)
"""Styles of link 1, link 2 and the tool."""
LABEL_STYLE: Keywords = {"ha": "center", "va": "bottom", "fontsize": 7}
"""Style of a label."""


@checked
def film(plan: Plan | str | Path, path: str | Path, speed: float = 1.0) -> dict[str, Path]:
    """Write the motion of a plan as film.gif, film.mp4, strip.png and single pictures.

    The file film.mp4 requires the program ffmpeg. Without ffmpeg, it is not written.

    Parameters
    ----------
    plan : Plan, str or Path
        Plan that is filmed, or its plan.json.
    path : str or Path
        Folder of the files, or the path of a single .gif or .mp4.
    speed : float
        Playback speed relative to the planned speed. A film that would last longer than 30 s is
        played faster.

    Returns
    -------
    dict[str, Path]
        Paths of the files by file name.

    Raises
    ------
    ExportError
        If the files cannot be written, or if an MP4 is requested without ffmpeg.
    ProblemError
        If the speed is not above 0.

    Examples
    --------
    >>> from ssm_planner import film
    >>> files = film("results/eye_approach", "film")  # doctest: +SKIP
    """
    if speed <= 0.0:
        raise ProblemError("invalid speed", key="speed", value=speed, allowed="above 0")
    plan, path = as_plan(plan), Path(path)
    pictures = list(_film_frames(plan, max(speed, plan.motion.duration / MAX_FILM_DURATION)))
    with BytesIO() as file:
        # Duration of each picture in ms. The last picture is shown for one second.
        times = [round(1000 / FRAME_RATE)] * (len(pictures) - 1) + [1000]
        pictures[0].save(
            file, "GIF", save_all=True, append_images=pictures[1:], duration=times, loop=0
        )
        gif = file.getvalue()
    if path.suffix in (".gif", ".mp4"):
        beginning = "GIF89a" if path.suffix == ".gif" else ""
        with replacing_result(path, plan.sha256, beginning) as single:
            _write_film(gif, single)
        return {path.name: path}
    with publishing_results(path, plan.sha256) as folder:
        _write_film(gif, folder / "film.gif")
        if shutil.which("ffmpeg"):
            _write_film(gif, folder / "film.mp4")
        _write_stills(pictures, folder)
        return {file.name: path / file.name for file in sorted(folder.iterdir())}


def _write_film(gif: bytes, path: Path) -> None:
    """Write a film as GIF or, with ffmpeg, as MP4.

    Parameters
    ----------
    gif : bytes
        Content of the GIF file.
    path : Path
        File to write. Its suffix selects the format.

    Raises
    ------
    ExportError
        If ffmpeg is missing or fails.
    """
    if path.suffix == ".gif":
        path.write_bytes(gif)
        return
    try:
        with NamedTemporaryFile(suffix=".gif") as source:
            source.write(gif)
            source.flush()
            command = ["ffmpeg", "-v", "error", "-i", source.name, "-pix_fmt", "yuv420p", str(path)]
            subprocess.run(command, capture_output=True, check=True)
    except FileNotFoundError:
        raise ExportError(f"{path}: needs the program ffmpeg, which is not on the PATH") from None
    except subprocess.CalledProcessError as error:
        raise ExportError(f"{path}: ffmpeg failed: {error.stderr!r}") from None


def _write_stills(pictures: list[Image], folder: Path) -> None:
    """Write single pictures of the motion, and all of them side by side as strip.png.

    Parameters
    ----------
    pictures : list of Image
        All pictures of the film.
    folder : Path
        Existing folder of the files.
    """
    from PIL import Image

    indices = np.linspace(0, len(pictures) - 1, STILL_COUNT).round().astype(int)
    stills = [pictures[k] for k in indices]
    for k, picture in enumerate(stills, start=1):
        picture.save(folder / f"picture_{k}.png")
    strip = np.hstack([np.asarray(picture.convert("RGB")) for picture in stills])
    Image.fromarray(strip).quantize(64).save(folder / "strip.png")


def project_mechanism(robot: Robot, q: Array) -> tuple[Array, Array, Array]:
    """Project the links and the tool onto the plane of the picture.

    Robot files do not contain the shapes of links, so each link is drawn as an arc between its
    axes.

    Parameters
    ----------
    robot : Robot
        Robot that performs the motion.
    q : (n, 4) array
        Positions of joints 1 to 3 in rad, and of joint 4 in m.

    Returns
    -------
    link1, link2 : (n, 61, 2) arrays
        Points of the arcs that represent the links, m.
    tool : (n, 2, 2) array
        Both ends of the tool, m. The tip is the first one.
    """
    mechanism = Mechanism.from_robot(robot)
    sides, tip = link_sides(robot, mechanism), fk(robot, q).position
    # With an insertion of 1 m, the position of the tip is the unit vector of the tool axis.
    inserted = q.copy()
    inserted[:, 3] = mechanism.insertion_sign
    outward = -fk(robot, inserted).position
    axis1 = np.tile(sides[0] * mechanism.omega1, (len(q), 1))
    axis2 = rotation(mechanism.omega1, q[:, 0]) @ (sides[1] * mechanism.omega2)
    length = TOOL_TAIL_LENGTH + np.linalg.norm(tip, axis=1).max()
    tool = np.stack([tip, tip + length * outward], axis=1)
    link1, link2 = (
        LINK_RADIUS * great_circle_arc(axis1, axis2),
        LINK_RADIUS * great_circle_arc(axis2, outward),
    )
    return link1 @ PROJECTION.T, link2 @ PROJECTION.T, tool @ PROJECTION.T


def mechanism_still(plan: Plan) -> JsonObject:
    """Return a line drawing of the mechanism at the start, halfway and at the end of a motion.

    Parameters
    ----------
    plan : Plan
        A plan with a trajectory.

    Returns
    -------
    dict
        Coordinates for an SVG in mm. `reach` is half the width of the picture. `instants` contains
        the time in s and the lines of each instant. `eye` contains the two coordinates of the
        centre of the retina and its radius, or is None.
    """
    t = plan.motion.duration * np.array([0.0, 0.5, 1.0])
    eye = plan.limits.eye
    to_svg = np.array([1e3, -1e3])  # From m to mm. The y-axis of an SVG points down.
    q = plan.motion.sample(plan.motion.breaks[0] + t).q
    lines = [(to_svg * line).round(2).reshape(3, -1) for line in project_mechanism(plan.robot, q)]
    circle = None
    if eye is not None:
        circle = np.append(to_svg * (PROJECTION @ eye.centre), 1e3 * eye.radius).tolist()
    return {
        # A margin of 5 % keeps the lines inside the picture.
        "reach": 1.05 * max(np.abs(line).max() for line in lines),
        "instants": [(time, [line[k] for line in lines]) for k, time in enumerate(t.tolist())],
        "eye": circle,
    }


def _film_frames(plan: Plan, speed: float) -> Iterator[Image]:
    """Yield the pictures of a film, with a common palette of 64 colours.

    The left half of a picture shows the arm. If the plan has an eye, the right half shows the tool
    in the eye. Otherwise, the arm fills the picture.

    Parameters
    ----------
    plan : Plan
        Plan that is filmed.
    speed : float
        Speed of the film relative to the planned speed.

    Yields
    ------
    Image
        Picture with a palette. There are `FRAME_RATE` pictures per second of the film.
    """
    from PIL import Image

    motion = plan.motion
    eye = plan.limits.eye
    count = max(2, round(FRAME_RATE * motion.duration / speed) + 1)
    t = np.linspace(0.0, motion.duration, count)
    lines = project_mechanism(plan.robot, motion.sample(motion.breaks[0] + t).q)
    # The extent of each box determines what a plot shows: the arm, and the eye.
    boxes = [np.concatenate([line.reshape(-1, 2) for line in lines])]
    if eye is not None:
        boxes.append(PROJECTION @ eye.centre + eye.radius * np.array([[-1.0, -1.0], [1.0, 1.0]]))
        boxes[0] = np.concatenate(boxes)
    figure, panels = new_panels(
        2.1 * len(boxes), 2.3, rows=1, columns=len(boxes), edges=(0, 0, 0, 0.2), gaps=(0, 0)
    )
    moving: list[tuple[Any, Any, Array]] = []
    for axes, box in zip(panels[0], boxes, strict=True):
        x, y = (box.min(axis=0) + box.max(axis=0)) / 2
        half = 0.54 * np.ptp(box, axis=0).max()  # half the extent, and a margin of 8 %
        axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
        axes.set_axis_off()
        if eye is not None:
            _draw_eye(axes, eye)
        tip_path = lines[2][:, 0]
        axes.plot(tip_path[:, 0], tip_path[:, 1], color="#d55e00", linewidth=1.2)
        axes.plot(0, 0, "o", color="black", markersize=4)
        axes.annotate("port", (0, 0), (-16, -8), textcoords="offset points", **LABEL_STYLE)
        for line, style in zip(lines, LINE_STYLES, strict=True):
            (artist,) = axes.plot([], animated=True, **style)
            moving.append((axes, artist, line))
    text = figure.text(0.01, 0.94, "", fontsize=8, animated=True)
    canvas: Any = figure.canvas
    canvas.draw()
    # The background is drawn once, and only the moving lines are drawn in every picture.
    background = canvas.copy_from_bbox(figure.bbox)
    palette = None
    speed_text = "" if speed == 1.0 else f", at {speed:.3g} × speed"
    for k, time in enumerate(t):
        canvas.restore_region(background)
        text.set_text(f"{time:.2f} s{speed_text}")
        figure.draw_artist(text)
        for axes, artist, line in moving:
            artist.set_data(line[k, :, 0], line[k, :, 1])
            axes.draw_artist(artist)
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        palette = palette or picture.quantize(64)
        yield picture.quantize(palette=palette, dither=Image.Dither.NONE)


def _draw_eye(axes: Axes, eye: Eye) -> None:
    """Draw the retina, the sphere that the tip must not leave, and the lens.

    Parameters
    ----------
    axes : Axes
        Plot of matplotlib in which the function draws, in m in the plane of the picture.
    eye : Eye
        Eye in the base frame.
    """
    from matplotlib.patches import Circle, Polygon

    x, y = PROJECTION @ eye.centre
    for radius, style in ((eye.radius, "-"), (eye.radius - eye.clearance, "--")):
        axes.add_patch(Circle((x, y), radius, facecolor="#f6d9cf", edgecolor="#c98a76", ls=style))
    axes.annotate("retina", (x, y - eye.radius), **LABEL_STYLE)
    if eye.lens is not None:
        # With the projected semi-axes as the columns of a matrix A, an ellipsoid appears as the
        # ellipse whose squared semi-axes are the eigenvalues of A Aᵀ.
        projected_axes = PROJECTION @ (eye.lens.frame * eye.lens.semi_axes)
        squared_axes, directions = np.linalg.eigh(projected_axes @ projected_axes.T)
        angles = np.linspace(0.0, 2 * np.pi, 90)
        ellipse = np.sqrt(squared_axes) * np.column_stack([np.cos(angles), np.sin(angles)])
        middle = PROJECTION @ eye.lens.centre
        axes.add_patch(Polygon(middle + ellipse @ directions.T, color="#8fb8de"))
        axes.annotate("lens", tuple(middle), **LABEL_STYLE)

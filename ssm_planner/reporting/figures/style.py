"""Define the style of all figures: units, legends and colours.

The colours remain distinguishable for colour-blind readers and in grey print.
"""

import struct
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import compress, crc32

import numpy as np

from ssm_planner.atomic import replacing
from ssm_planner.problem import JOINTS
from ssm_planner.typing import Files, Keywords
from ssm_planner.units import display_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from ssm_planner.trajectory import Trajectory

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#000000")
"""Colours of joints 1 to 4 (Okabe–Ito). Line styles distinguish them in grey print."""
FIFTH_COLOUR = "#A0457E"
"""Colour of a fifth curve. Its line style differs from those of the joints."""
LINE_DASHES = ("-", "--", "-.", ":")
"""Line styles of joints 1 to 4."""
LIMIT_STYLE: Keywords = {"color": "0.45", "linewidth": 0.9, "linestyle": (0, (4, 2))}
"""Style of a line at a limit."""
DOT_STEP = 10
"""Number of samples from one dot to the next one, in plots that show how long a motion stays."""
DOT_STYLE: Keywords = {"s": 22, "alpha": 0.12, "linewidths": 0}
"""Style of these dots. They overlap where the motion stays longer."""
ZERO_LINE_STYLE: Keywords = {"color": "0.7", "linewidth": 0.6, "zorder": 0}
"""Style of a line at zero."""
FONT_SIZE = 9.0
"""Font size of labels, points."""
DPI = 200
"""Resolution of PNG files, pixels per inch."""
LETTER_WIDTH = 0.58
"""Mean width of a letter, relative to the font size."""
AXIS_MARGIN = 0.05
"""Margin that matplotlib adds at each end of an axis, relative to the range of the data."""
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
"""First bytes of every PNG file."""
PNG_HEADER_SIZE = 33
"""Number of bytes in a PNG file up to the end of its first chunk."""


def display_unit_of(unit: str) -> tuple[str, float]:
    """Return the display unit of an SI unit, and the factor that converts SI values to it.

    Degrees have the symbol °, as in all pages and figures. For example, "rad/s" gives ("°/s",
    180/π).
    """
    return display_unit(unit, "°")


def joint_label(name: str) -> str:
    """Return the number and the name of a joint for a label."""
    return f"joint {JOINTS.index(name) + 1} ({name})"


def new_figure(width: float, height: float) -> "Figure":
    """Create an empty figure that does not use pyplot's global state.

    Matplotlib arranges the plots in the figure when it draws the figure, so that all labels fit.

    Parameters
    ----------
    width, height : float
        Size of the figure, inches.

    Returns
    -------
    Figure
        Figure without plots.
    """
    figure = _empty_figure(width, height)
    figure.set_layout_engine("constrained")
    return figure


def new_panels(
    width: float,
    height: float,
    rows: int,
    columns: int,
    edges: Sequence[float],
    gaps: Sequence[float],
    **options: Any,
) -> "tuple[Figure, NDArray[Any]]":
    """Create a figure with empty plots (panels) at fixed positions.

    An automatic layout would take longer than the drawing itself.

    Parameters
    ----------
    width, height : float
        Size of the figure, inches.
    rows, columns : int
        Numbers of rows and columns of plots.
    edges : (4,)
        Space to the left, to the right, below and above all plots, inches.
    gaps : (2,)
        Space between columns and between rows, inches.
    **options
        Options of `Figure.subplots`.

    Returns
    -------
    figure : Figure
        The figure.
    panels : (rows, columns) array
        Plots, which are objects `Axes` of matplotlib.
    """
    figure = _empty_figure(width, height)
    left_edge, right_edge, bottom_edge, top_edge = edges
    panel_width = (width - left_edge - right_edge - (columns - 1) * gaps[0]) / columns
    panel_height = (height - bottom_edge - top_edge - (rows - 1) * gaps[1]) / rows
    # Matplotlib states edges relative to the figure, and gaps relative to a plot.
    figure.subplots_adjust(
        left=left_edge / width,
        right=1 - right_edge / width,
        bottom=bottom_edge / height,
        top=1 - top_edge / height,
        wspace=gaps[0] / panel_width,
        hspace=gaps[1] / panel_height,
    )
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def _empty_figure(width: float, height: float) -> "Figure":
    """Create a figure with a given width and height in inches, and with a canvas for PNG files."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=DPI)
    FigureCanvasAgg(figure)
    return figure


def finish_axes(axes: "Axes", x: str, y: str, title: str | None = None) -> None:
    """Add labels and a light grid to a plot, and remove its frame at the top and on the right.

    Parameters
    ----------
    axes : Axes
        Plot of matplotlib in which the function draws.
    x, y : str
        Labels of the axes.
    title : str, optional
        Text above the plot.
    """
    axes.set_xlabel(x, fontsize=FONT_SIZE)
    axes.set_ylabel(y, fontsize=FONT_SIZE)
    if title is not None:
        axes.set_title(title, fontsize=FONT_SIZE)
    axes.tick_params(labelsize=FONT_SIZE - 1)
    axes.grid(True, color="0.9", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def render_figure(
    figure: "Figure", pdf: bool = True, subject: str | None = None
) -> dict[str, bytes]:
    """Render a figure as the content of its files.

    Equal figures give equal bytes. PDF files embed TrueType fonts (type 42). The function calls the
    canvases directly, because Figure.savefig draws everything twice.

    Parameters
    ----------
    figure : Figure
        Figure that is converted.
    pdf : bool
        Render a PDF file, too.
    subject : str, optional
        Subject of the PDF file.

    Returns
    -------
    dict of bytes
        Content by suffix, "png" and "pdf".
    """
    from matplotlib import rc_context

    with BytesIO() as file, rc_context({"pdf.fonttype": 42}):
        files = {"png": _render_png(figure)}
        if pdf:
            from matplotlib.backends.backend_pdf import FigureCanvasPdf

            figure.set_layout_engine("none")
            metadata = {"CreationDate": None, "Subject": subject}
            canvas = FigureCanvasPdf(figure)
            canvas.print_pdf(file, metadata=metadata)  # type: ignore[no-untyped-call]
            files["pdf"] = file.getvalue()
    return files


def save_figure(
    figure: "Figure", path: Path, pdf: bool = True, subject: str | None = None
) -> Files:
    """Write a figure as path.png and optionally path.pdf.

    Parameters
    ----------
    figure : Figure
        Figure that is written.
    path : Path
        Path of the files without suffix.
    pdf : bool
        Also write a PDF file.
    subject : str, optional
        Text that identifies the content, such as the hash of a plan.

    Returns
    -------
    Files
        Paths by name: `<name>_figure` for the PNG file, and `<name>_pdf` for the PDF file, where
        `<name>` is the last part of `path`.

    Raises
    ------
    ExportError
        If a file cannot be written.
    """
    return save_rendered(render_figure(figure, pdf, subject), path, subject)


def save_figures(
    figures: "Mapping[str, Figure]", folder: Path, subject: str | None = None
) -> Files:
    """Write each figure as PNG and PDF into a folder, under its name.

    Parameters
    ----------
    figures : mapping of str to Figure
        Figures by name.
    folder : Path
        Folder of the files.
    subject : str, optional
        Text that identifies the content, such as the hash of a plan.

    Returns
    -------
    Files
        Paths by name: `<name>_figure` for a PNG file, and `<name>_pdf` for a PDF file.

    Raises
    ------
    ExportError
        If a file cannot be written.
    """
    paths: Files = {}
    for name, figure in figures.items():
        paths |= save_figure(figure, folder / name, subject=subject)
    return paths


def save_rendered(files: Mapping[str, bytes], path: Path, subject: str | None = None) -> Files:
    """Write the files of a rendered figure atomically.

    Parameters
    ----------
    files : Mapping[str, bytes]
        Result of `render_figure`.
    path : Path
        Path of the files without suffix.
    subject : str, optional
        Text that identifies the content, such as the hash of a plan. It is added to PNG files.

    Returns
    -------
    Files
        Paths by name: `<name>_figure` for the PNG file, and `<name>_pdf` for the PDF file.

    Raises
    ------
    ExportError
        If a file cannot be written.
    """
    paths = {}
    for suffix, content in files.items():
        target = path.with_name(f"{path.name}.{suffix}")
        if suffix == "png" and subject:
            content = png_with_text(content, "Source", subject)
        with replacing(target) as temporary:
            temporary.write_bytes(content)
        paths[f"{path.name}_{'figure' if suffix == 'png' else suffix}"] = target
    return paths


def png_with_text(png: bytes, key: str, text: str) -> bytes:
    """Insert a text chunk into a PNG image, after its header.

    Parameters
    ----------
    png : bytes
        Content of the PNG file.
    key, text : str
        Keyword and text of the chunk (PNG specification, tEXt).

    Returns
    -------
    bytes
        Content of the changed PNG file.
    """
    chunk = _png_chunk(b"tEXt", key.encode("ascii") + b"\0" + text.encode("latin-1"))
    return png[:PNG_HEADER_SIZE] + chunk + png[PNG_HEADER_SIZE:]


def _render_png(figure: "Figure") -> bytes:
    """Render a figure as an opaque PNG image with a palette of 256 colours.

    The palette reduces the file to a third of its size. Python's zlib compresses the image, because
    the output of Pillow's own compressor depends on the processor.

    Parameters
    ----------
    figure : Figure
        Figure that is rendered.

    Returns
    -------
    bytes
        Content of the PNG file.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    image = Image.fromarray(pixels).convert("RGB").quantize(dither=Image.Dither.NONE)
    width, height = image.size
    rows = np.zeros((height, width + 1), np.uint8)  # Each row begins with 0: no filter.
    rows[:, 1:] = np.asarray(image)
    header = struct.pack(">2I", width, height) + bytes((8, 3, 0, 0, 0))  # 8 bits with a palette.
    per_metre = round(figure.dpi / 0.0254)  # pixels per metre; an inch has 0.0254 m
    chunks = (
        _png_chunk(b"IHDR", header),
        _png_chunk(b"pHYs", struct.pack(">2IB", per_metre, per_metre, 1)),
        _png_chunk(b"PLTE", bytes(image.getpalette() or ())),
        _png_chunk(b"IDAT", compress(rows.data)),
        _png_chunk(b"IEND", b""),
    )
    return PNG_SIGNATURE + b"".join(chunks)


def _png_chunk(chunk_type: bytes, content: bytes) -> bytes:
    """Return a chunk of a PNG file: length, type, content and checksum."""
    body = chunk_type + content
    return struct.pack(">I", len(content)) + body + struct.pack(">I", crc32(body))


def draw_legend(axes: "Axes", fontsize: float = FONT_SIZE - 1, **options: Any) -> None:
    """Draw a legend inside a plot. Further options are those of `Axes.legend`."""
    axes.legend(fontsize=fontsize, frameon=False, **options)


def draw_zero_lines(axes: "Axes", down: bool = False) -> None:
    """Draw a horizontal line at zero in a plot and, if `down` is true, a vertical line as well."""
    axes.axhline(0.0, **ZERO_LINE_STYLE)
    if down:
        axes.axvline(0.0, **ZERO_LINE_STYLE)


def shade_phases(axes: "Axes", trajectory: "Trajectory", with_names: bool = False) -> None:
    """Shade every second phase of a motion in a plot whose horizontal axis is the time in s.

    Parameters
    ----------
    axes : Axes
        Plot of matplotlib in which the function draws.
    trajectory : Trajectory
        Motion that is drawn.
    with_names : bool
        Write the name of each phase above the plot, in the longest form that fits.
    """
    size = FONT_SIZE - 1
    shown_time = trajectory.duration * (1 + 2 * AXIS_MARGIN)
    inches_per_second = axes.bbox.width / DPI / shown_time
    for k, phase in enumerate(trajectory.phases):
        if k % 2:
            axes.axvspan(phase.start, phase.end, color="0.95", zorder=0, linewidth=0)
        if with_names:
            # An inch has 72 points, and a letter is LETTER_WIDTH times the font size wide.
            points = 72 * inches_per_second * (phase.end - phase.start)
            letters = int(points / (LETTER_WIDTH * size))
            middle = (phase.start + phase.end) / 2
            name = fit_phase_name(phase.name, letters)
            # The vertical position is relative to the plot, whose upper edge is at 1.
            across = axes.get_xaxis_transform()
            axes.text(middle, 1.02, name, transform=across, ha="center", fontsize=size)


def fit_phase_name(name: str, letters: int) -> str:
    """Return the longest form of a phase's name that has at most `letters` characters.

    For example, the forms of "ring, spot 12" are "ring, spot 12", "spot 12", "12" and "".
    """
    short_name = name.rpartition(", ")[2]
    number = short_name.rpartition(" ")[2]
    forms = name, short_name, number if number.isdigit() else "", ""
    return next(form for form in forms if len(form) <= letters)


def draw_legend_above(
    figure: "Figure", axes: "Axes", columns: int, size: float = FONT_SIZE
) -> None:
    """Draw the legend of one plot above all plots of a figure, in several columns.

    Parameters
    ----------
    figure : Figure
        Figure with one or more plots.
    axes : Axes
        Plot of the figure whose curves the legend explains.
    columns : int
        Number of columns of the legend.
    size : float
        Size of the font, points.
    """
    figure.legend(
        *axes.get_legend_handles_labels(),
        loc="outside upper center",
        ncols=columns,
        fontsize=size,
        frameon=False,
    )

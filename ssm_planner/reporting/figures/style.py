"""Define the style of all figures: units, legends and colours.

The colours suit colour-blind readers and grey print.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import compress, crc32

import numpy as np

from ssm_planner.atomic import replacing
from ssm_planner.units import display_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from ssm_planner.trajectory import Trajectory

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#000000")
"""Colours of joints 1 to 4 (Okabe–Ito). Line styles distinguish them in grey print."""
FIFTH = "#A0457E"
"""Colour of a fifth curve, which has its own dash."""
DASHES = ("-", "--", "-.", ":")
LIMIT: dict[str, Any] = {"color": "0.45", "linewidth": 0.9, "linestyle": (0, (4, 2))}
AXIS: dict[str, Any] = {"color": "0.7", "linewidth": 0.6, "zorder": 0}
"""Style of a line at zero."""
SIZE = 9.0
DPI = 200
LETTER = 0.58
"""Mean width of a letter relative to the font size."""
MARGIN = 0.05
"""Fraction of the data that matplotlib leaves free at each end of an axis."""
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_HEADER = 33
"""Number of bytes in a PNG file up to the end of its first chunk."""


def unit_of(unit: str) -> tuple[str, float]:
    """Return `units.shown` with the degree sign of pages and figures: rad/s → (°/s, 180/π)."""
    return display_unit(unit, "°")


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure (inches) that does not use pyplot's global state.

    The layout makes room for labels when the figure is drawn.
    """
    figure = _bare(width, height)
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
) -> tuple[Figure, NDArray[Any]]:
    """Return a figure and its panels (rows, columns) at fixed positions.

    A fixed layout is faster than an automatic one, which would take longer than drawing.

    Parameters
    ----------
    width, height : float
        Size of the figure, inches.
    rows, columns : int
    edges : (4,)
        Space to the left, to the right, below and above the panels, inches.
    gaps : (2,)
        Space between columns and between rows, inches.
    **options
        Options of `Figure.subplots`.
    """
    figure = _bare(width, height)
    left, right, below, above = edges
    across = (width - left - right - (columns - 1) * gaps[0]) / columns
    down = (height - below - above - (rows - 1) * gaps[1]) / rows
    figure.subplots_adjust(
        left=left / width,
        right=1 - right / width,
        bottom=below / height,
        top=1 - above / height,
        wspace=gaps[0] / across,
        hspace=gaps[1] / down,
    )
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def _bare(width: float, height: float) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=DPI)
    FigureCanvasAgg(figure)
    return figure


def finish(axes: Axes, x: str, y: str, title: str | None = None) -> None:
    """Add labels and a light grid, and remove the frame at the top and on the right."""
    axes.set_xlabel(x, fontsize=SIZE)
    axes.set_ylabel(y, fontsize=SIZE)
    if title is not None:
        axes.set_title(title, fontsize=SIZE)
    axes.tick_params(labelsize=SIZE - 1)
    axes.grid(True, color="0.9", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def drawn(figure: Figure, pdf: bool = True, about: str | None = None) -> dict[str, bytes]:
    """Return the figure as "png" and optionally "pdf", with the same bytes every time.

    PDF files embed TrueType fonts and have `about` as their subject. The layout is computed once,
    and the canvases print directly, because Figure.savefig draws everything twice.
    """
    from matplotlib import rc_context

    with BytesIO() as file, rc_context({"pdf.fonttype": 42}):
        files = {"png": _png(figure)}
        if pdf:
            from matplotlib.backends.backend_pdf import FigureCanvasPdf

            figure.set_layout_engine("none")
            FigureCanvasPdf(figure).print_pdf(
                file, metadata={"CreationDate": None, "Subject": about}
            )  # type: ignore[no-untyped-call]
            files["pdf"] = file.getvalue()
    return files


def save_figure(
    figure: Figure, path: Path, pdf: bool = True, about: str | None = None
) -> dict[str, Path]:
    """Write path.png and optionally path.pdf, and return the paths by name. Raises ExportError."""
    return save_drawn(drawn(figure, pdf, about), path, about)


def save_figures(
    figures: Mapping[str, Figure], folder: Path, about: str | None = None
) -> dict[str, Path]:
    """Write each figure as PNG and PDF under its name. Raises ExportError.

    The paths are returned under `<name>_figure` and `<name>_pdf`.
    """
    paths: dict[str, Path] = {}
    for name, figure in figures.items():
        paths |= save_figure(figure, folder / name, about=about)
    return paths


def save_drawn(files: Mapping[str, bytes], path: Path, about: str | None = None) -> dict[str, Path]:
    """Write the files of `drawn` atomically and return their paths by name. Raises ExportError.

    about: text that identifies the content, such as the hash of a plan. PNG files contain it too.
    """
    paths = {}
    for ending, data in files.items():
        paths[f"{path.name}_{'figure' if ending == 'png' else ending}"] = target = path.with_name(
            f"{path.name}.{ending}"
        )
        with replacing(target) as temporary:
            temporary.write_bytes(
                png_with_text(data, "Source", about) if about and ending == "png" else data
            )
    return paths


def png_with_text(png: bytes, key: str, text: str) -> bytes:
    """Return a PNG image with an additional text chunk after its header."""
    chunk = _chunk(b"tEXt", key.encode("ascii") + b"\0" + text.encode("latin-1"))
    return png[:PNG_HEADER] + chunk + png[PNG_HEADER:]


def _png(figure: Figure) -> bytes:
    """Return the figure as an opaque PNG image with a palette of 256 colours.

    Such a file is a third as large as one with all colours. Python's zlib compresses it, because
    the bytes from Pillow's own compressor depend on the processor.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    coloured = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")  # type: ignore[no-untyped-call]
    image = coloured.quantize(dither=Image.Dither.NONE)
    width, height = image.size
    rows = np.zeros((height, width + 1), np.uint8)  # Each row begins with 0: no filter.
    rows[:, 1:] = np.asarray(image)
    header = struct.pack(">2I", width, height) + bytes((8, 3, 0, 0, 0))  # 8 bits with a palette.
    per_metre = round(figure.dpi / 0.0254)
    chunks = (
        (b"IHDR", header),
        (b"pHYs", struct.pack(">2IB", per_metre, per_metre, 1)),
        (b"PLTE", bytes(image.getpalette() or ())),
        (b"IDAT", compress(rows.data)),
    )
    return PNG_SIGNATURE + b"".join(_chunk(*each) for each in (*chunks, (b"IEND", b"")))


def _chunk(kind: bytes, content: bytes) -> bytes:
    """Return a chunk of a PNG file."""
    return (
        struct.pack(">I", len(content)) + kind + content + struct.pack(">I", crc32(kind + content))
    )


def legend(axes: Axes, **options: Any) -> None:
    """Draw the legend of a panel inside it. options: see `Axes.legend`."""
    axes.legend(**{"fontsize": SIZE - 1, "frameon": False, **options})


def zero_lines(axes: Axes, down: bool = False) -> None:
    """Draw a horizontal line at zero and, with `down`, a vertical one."""
    axes.axhline(0.0, **AXIS)
    if down:
        axes.axvline(0.0, **AXIS)


def shade_phases(axes: Axes, trajectory: Trajectory, named: bool = False) -> None:
    """Shade every second phase and, with `named`, write the names of phases if there is room."""
    size = SIZE - 1
    inches = axes.bbox.width / DPI / (trajectory.duration * (1 + 2 * MARGIN))  # Inches per second.
    for k, phase in enumerate(trajectory.phases):
        if k % 2:
            axes.axvspan(phase.start, phase.end, color="0.95", zorder=0, linewidth=0)
        if named:
            letters = int(72 * inches * (phase.end - phase.start) / (LETTER * size))
            middle = (phase.start + phase.end) / 2
            place: dict[str, Any] = {
                "transform": axes.get_xaxis_transform(),
                "ha": "center",
                "fontsize": size,
            }
            axes.text(middle, 1.02, fitting_name(phase.name, letters), **place)


def fitting_name(name: str, letters: int) -> str:
    """Return the longest form of a phase's name with at most `letters` letters.

    The forms are the whole name, the name without its group, its number, and an empty text.
    """
    own = name.rpartition(", ")[2]
    last = own.rpartition(" ")[2]
    return next(
        text for text in (name, own, last if last.isdigit() else "", "") if len(text) <= letters
    )


def legend_above(figure: Figure, axes: Axes, columns: int, size: float = SIZE) -> None:
    """Draw the legend of one panel above all panels."""
    figure.legend(
        *axes.get_legend_handles_labels(),
        loc="outside upper center",
        ncols=columns,
        fontsize=size,
        frameon=False,
    )

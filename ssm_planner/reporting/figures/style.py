"""One style for all figures: units, legends, colours that survive colour blindness and grey print."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import compress, crc32

import numpy as np

from ssm_planner.atomic import replacing
from ssm_planner.units import shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from ssm_planner.trajectory import Trajectory

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#000000")
"""Joints 1 to 4 (Okabe–Ito); line styles tell them apart in grey."""
FIFTH = "#A0457E"
"""For a fifth curve, with a dash of its own."""
DASHES = ("-", "--", "-.", ":")
LIMIT: dict[str, Any] = {"color": "0.45", "linewidth": 0.9, "linestyle": (0, (4, 2))}
AXIS: dict[str, Any] = {"color": "0.7", "linewidth": 0.6, "zorder": 0}
"""A line at zero."""
SIZE = 9.0
DPI = 300
LETTER = 0.58
"""Mean width of a letter by the size of its type."""
MARGIN = 0.05
"""Share of the data that matplotlib leaves free at either end of an axis."""
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_HEADER = 33
"""Bytes of a PNG file up to the end of its first chunk."""
LEVEL = 2
"""Of compression: a higher one takes twice as long for files smaller by a fifth."""


def unit_of(unit: str) -> tuple[str, float]:
    """`units.shown` with the degree sign of pages and figures: rad/s → (°/s, 180/π)."""
    return shown(unit, "°")


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches, without pyplot's global state; room for labels is found when it is drawn."""
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
    """A figure and its panels (rows, columns) at fixed places; options as in `Figure.subplots`.

    edges: room left, right, below and above the panels, gaps: between columns and rows, inches. For figures drawn with
    every plan: to find the room takes longer than to draw.
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
    """Labels, light grid, no frame above and to the right."""
    axes.set_xlabel(x, fontsize=SIZE)
    axes.set_ylabel(y, fontsize=SIZE)
    if title is not None:
        axes.set_title(title, fontsize=SIZE)
    axes.tick_params(labelsize=SIZE - 1)
    axes.grid(True, color="0.9", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def drawn(figure: Figure, pdf: bool = True, about: str | None = None) -> dict[str, bytes]:
    """The figure as "png" and, if wanted, "pdf" (TrueType fonts embedded, `about` as its subject), the same bytes each time.

    The layout is found once, and the canvases print by themselves: Figure.savefig draws everything twice.
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
    """Write path.png and, if wanted, path.pdf, as `drawn` gives them; paths by name. Raises ExportError."""
    return save_drawn(drawn(figure, pdf, about), path, about)


def save_figures(
    figures: Mapping[str, Figure], folder: Path, about: str | None = None
) -> dict[str, Path]:
    """Write each figure as PNG and PDF under its name; paths by `<name>_figure` and `<name>_pdf`. Raises ExportError."""
    paths: dict[str, Path] = {}
    for name, figure in figures.items():
        paths |= save_figure(figure, folder / name, about=about)
    return paths


def save_drawn(files: Mapping[str, bytes], path: Path, about: str | None = None) -> dict[str, Path]:
    """Write what `drawn` returned, each file whole or not at all; paths by name. Raises ExportError.

    about: what is shown, such as the hash of a plan; PNG files carry it too.
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
    """A PNG image with a text chunk behind its header."""
    chunk = _chunk(b"tEXt", key.encode("ascii") + b"\0" + text.encode("latin-1"))
    return png[:PNG_HEADER] + chunk + png[PNG_HEADER:]


def _png(figure: Figure) -> bytes:
    """The figure as an opaque PNG image, each row as its difference from that above: most of these are zero.

    Matplotlib's own way tries five kinds of differences on four channels and takes four times as long.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")  # type: ignore[no-untyped-call]
    width, height = image.size
    pixels = np.frombuffer(image.tobytes(), np.uint8).reshape(height, -1)
    rows = np.empty((height, pixels.shape[1] + 1), np.uint8)
    rows[:, 0] = 2  # the kind of difference
    rows[0, 1:] = pixels[0]
    np.subtract(pixels[1:], pixels[:-1], out=rows[1:, 1:])
    header = struct.pack(">2I", width, height) + bytes(
        (8, 2, 0, 0, 0)
    )  # 8 bits, red, green and blue
    per_metre = round(figure.dpi / 0.0254)
    chunks = (
        (b"IHDR", header),
        (b"pHYs", struct.pack(">2IB", per_metre, per_metre, 1)),
        (b"IDAT", compress(rows.data, LEVEL)),
    )
    return PNG_SIGNATURE + b"".join(_chunk(*each) for each in (*chunks, (b"IEND", b"")))


def _chunk(kind: bytes, content: bytes) -> bytes:
    """Of a PNG file."""
    return (
        struct.pack(">I", len(content)) + kind + content + struct.pack(">I", crc32(kind + content))
    )


def legend(axes: Axes, **options: Any) -> None:
    """The legend of a panel within it; options as in `Axes.legend`."""
    axes.legend(**{"fontsize": SIZE - 1, "frameon": False, **options})


def zero_lines(axes: Axes, down: bool = False) -> None:
    """A line at zero across the panel, and `down` it too."""
    axes.axhline(0.0, **AXIS)
    if down:
        axes.axvline(0.0, **AXIS)


def shade_phases(axes: Axes, trajectory: Trajectory, named: bool = False) -> None:
    """Shade every other phase and, where asked for, name it above the panel as far as there is room for its name."""
    size = SIZE - 1
    inches = axes.bbox.width / DPI / (trajectory.duration * (1 + 2 * MARGIN))  # per s
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
    """The longest of a phase's names that has so many letters: whole, without its group, its number alone, none."""
    own = name.rpartition(", ")[2]
    last = own.rpartition(" ")[2]
    return next(
        text for text in (name, own, last if last.isdigit() else "", "") if len(text) <= letters
    )


def legend_above(figure: Figure, axes: Axes, columns: int, size: float = SIZE) -> None:
    """The legend of one panel above all of them."""
    figure.legend(
        *axes.get_legend_handles_labels(),
        loc="outside upper center",
        ncols=columns,
        fontsize=size,
        frameon=False,
    )

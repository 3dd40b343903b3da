"""A panel of the page: series that stand together, their limits, and where these are active.

Where along a motion a limit is active.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssm_planner.reporting.figures.style import unit_of
from ssm_planner.typing import Array

Panel = dict[str, Any]


def new_panel(section: str, title: str, unit: str, series: list[tuple[str, str, int]]) -> Panel:
    """series: (channel, label, colour); unit: SI, or "rpm" for rad/s."""
    return {
        "section": section,
        "title": title,
        "unit": unit,
        "series": [{"channel": channel, "label": label, "joint": joint} for channel, label, joint in series],
        "limits": [],
        "missing": [],
        "active": [],
    }


def new_limit(
    name: str, joint: str, index: int, low: float, high: float, channel: str | None, size: float | None = None
) -> dict[str, Any]:
    """of: joint or coordinate; channel: the one whose active stretches are marked; None for a line that only orients.

    size: what margins are relative to, where that is not the limit itself or the width of the range.
    """
    return {"name": name, "of": joint, "joint": index, "low": low, "high": high, "channel": channel, "size": size}


def mark_active(panel: Panel, channels: dict[str, Array]) -> None:
    """Add the stretches in which a limit is active."""
    for limit in panel["limits"]:
        if limit["channel"] is None:
            continue
        own = limit["name"].removesuffix(" range") == limit["of"]
        label = limit["name"] if own or not limit["of"] else f"{limit['name']}, {limit['of']}"
        for start, end, side in active_stretches(
            channels["t"], channels[limit["channel"]], limit["low"], limit["high"], limit["size"]
        ):
            value = limit["high"] if side > 0 else limit["low"]
            stretch = {
                "label": label,
                "joint": limit["joint"],
                "start": start,
                "end": end,
                "side": side,
                "value": value,
            }
            panel["active"].append(stretch)


def in_display_units(panel: Panel) -> None:
    """Limits and stretches in the unit that is shown; channels stay SI and are scaled by the page."""
    panel["unit"], panel["scale"] = unit_of(panel["unit"])
    for limit in panel["limits"]:
        for end in ("low", "high"):
            limit[end] = panel["scale"] * limit[end] if np.isfinite(limit[end]) else None
    for stretch in panel["active"]:
        stretch["value"] *= panel["scale"]


NEAR = 0.005
"""A limit is active where the value is within this share of it, of a range within half this share of its width."""
GAP = 0.01
"""Stretches nearer to each other than this, s, are one."""


def active_stretches(
    t: Array, values: Array, low: float, high: float, size: float | None = None
) -> Iterator[tuple[float, float, int]]:
    """(start, end, side) of each stretch of values (n,) at a limit; t (n,) in s, side +1 at high and −1 at low.

    size: of the limit, where it is not its value.
    """
    for side, end in ((1, high), (-1, low)):
        if np.isfinite(end):
            near = NEAR * (abs(end) if size is None else size)
            if np.isfinite(low) and np.isfinite(high):
                near = NEAR / 2 * (high - low)
            with np.errstate(invalid="ignore"):
                at = side * (end - values) <= near
            for start, stop in _runs(t, at):
                yield start, stop, side


def _runs(t: Array, at: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Start and end time of each run of true values, those close together joined."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], at.astype(int), [0]))))
    runs: list[tuple[float, float]] = []
    for first, after in zip(edges[::2], edges[1::2], strict=True):
        start, end = float(t[first]), float(t[after - 1])
        if runs and start - runs[-1][1] < GAP:
            start = runs.pop()[0]
        runs.append((start, end))
    return runs

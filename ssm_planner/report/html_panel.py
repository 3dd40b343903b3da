"""A panel of the page: series that stand together, their limits, and where these are active."""

from __future__ import annotations

from typing import Any

import numpy as np

from ssm_planner.problem.values import Array
from ssm_planner.report.html_active import active_stretches
from ssm_planner.report.style import unit_of

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

"""The page of the local view."""

from __future__ import annotations

from typing import Any

from ssm_planner.report.html_elements import Markup, tag
from ssm_planner.report.html_page import page
from ssm_planner.report.style import COLOURS

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; "
    "connect-src 'self'; frame-src 'self'"
)


def view_page(start: dict[str, Any], token: str) -> str:
    """The HTML document; start: Study.start(), token: what every POST must carry."""
    title = f"{start['name']} – mechanism" if start["name"] else "Mechanism"
    header = tag("header", tag("h1", title), tag("p", id="verdict", role="status", aria_live="polite"))
    scene = tag("div", tag("p", "The 3D view needs WebGL and JavaScript.", class_="fallback"), id="scene")
    stage = tag("section", scene, class_="stage", aria_label="Mechanism")
    story = tag("div", *_controls(), class_="story controls")
    result = tag("section", id="result", aria_label="Plan")
    data = {"start": start, "token": token, "colours": list(COLOURS)}
    body = Markup(header + tag("main", stage, story, result))
    return page(title, body, data, ("view.js",), POLICY)


def _controls() -> tuple[Markup, ...]:
    mechanism = _group(
        "Mechanism",
        _slider("alpha", "α, joint 1 to joint 2", 5, 175, "°"),
        _slider("beta", "β, joint 2 to tool", 5, 175, "°"),
        tag("button", "Robot's own angles", type="button", id="own"),
    )
    wanted = _group(
        "Tilt range wanted",
        _slider("low", "from", -180, 180, "°"),
        _slider("high", "to", -180, 180, "°"),
        tag("p", id="reach", role="status"),
    )
    pose = _group(
        "Pose",
        _slider("roll", "roll", -180, 180, "°"),
        _slider("tilt", "tilt", -180, 180, "°"),
        _slider("spin", "spin", -180, 180, "°"),
        _slider("depth", "depth", 0, 30, "mm"),
        tag("p", id="reached", role="status"),
    )
    plan = _group(
        "Motion",
        tag("p", id="from"),
        tag("p", id="to"),
        tag("button", "Start here", type="button", id="here"),
        " ",
        tag("button", "Plan this motion", type="button", id="plan", class_="main"),
        " ",
        tag("button", "Plan the problem's own motion", type="button", id="whole"),
        tag("p", id="why", class_="note"),
    )
    return mechanism, wanted, pose, tag("div", id="branches"), plan


def _group(title: str, *children: Markup | str) -> Markup:
    return tag("fieldset", tag("legend", title), *children)


def _slider(name: str, label: str, low: float, high: float, unit: str) -> Markup:
    ends = {"min": str(low), "max": str(high)}
    slider = tag("input", id=name, type="range", step="0.1", **ends)
    number = tag("input", id=f"{name}-number", type="number", step="any", aria_label=f"{label}, {unit}", **ends)
    return tag("div", tag("label", label, for_=name), slider, number, tag("span", unit), class_="slider")

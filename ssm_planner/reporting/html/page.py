"""One self-contained page: styles, scripts and data inside it, nothing fetched."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import Any

from ssm_planner.reporting.html.elements import Markup, tag

LIBRARIES = (("three.js 0.187.0", "three"), ("uPlot 1.6.32", "uplot"))
"""Name with version, and the stem of the files in assets/vendor."""
SHARED = ("base.js", "mechanism.js", "scene.js", "player.js", "now.js", "plots.js", "tables.js")
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"


def page(title: str, body: str, data: Any, scripts: Sequence[str], policy: str = POLICY) -> str:
    """A whole HTML document. data: JSON types, read by the scripts; scripts: names in assets/, after the shared ones."""
    code = [_asset(f"vendor/{stem}.min.js") for _, stem in LIBRARIES] + [_asset(name) for name in (*SHARED, *scripts)]
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        Markup(f'<meta http-equiv="Content-Security-Policy" content="{policy}">'),
        tag("meta", name_="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        Markup('<link rel="icon" href="data:,">'),
        *(Markup(f"<style>\n{_asset(name)}</style>\n") for name in ("vendor/uplot.min.css", "report.css")),
    )
    embedded = Markup(f'<script type="application/json" id="data">{safe_json(data)}</script>\n')
    running = [Markup(f"<script>\n{source}\n</script>\n") for source in code]
    return "<!DOCTYPE html>\n" + tag("html", head, tag("body", body, licences(), embedded, *running), lang="en") + "\n"


def safe_json(data: Any) -> str:
    """JSON that cannot end the script element around it."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def licences() -> Markup:
    """The licences of the libraries inside the page, which must go with every copy."""
    texts = (tag("h3", name) + tag("pre", _asset(f"vendor/{stem}.LICENSE.txt")) for name, stem in LIBRARIES)
    return tag("details", tag("summary", "Libraries in this page"), *map(Markup, texts), class_="licences")


@cache
def _asset(name: str) -> str:
    return resources.files("ssm_planner.reporting").joinpath("assets", *name.split("/")).read_text(encoding="utf-8")

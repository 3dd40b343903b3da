"""Self-contained pages from the templates in reporting/templates: styles, scripts and data inside, nothing fetched."""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ssm_planner.display import environment, filled
from ssm_planner.publishing import replacing_result

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup


PACKAGE = "ssm_planner.reporting"
"""Whose templates and assets pages are made of."""
LIBRARIES = (("three.js 0.187.0", "three"), ("uPlot 1.6.32", "uplot"))
"""Name with version, and the stem of the files in assets/vendor. Their licences must go with every copy of a page."""


def render(template: str, data: Any, **content: Any) -> str:
    """An HTML document. data: JSON types, read by the page's scripts; content: the template's names, escaped in it."""
    from markupsafe import Markup

    return filled(templates(), template, data=Markup(safe_json(data)), **content)


@cache
def templates() -> Environment:
    """Those of the pages, in which every value is escaped."""
    made = environment(PACKAGE, escape=True)
    made.globals.update(asset=_asset, libraries=LIBRARIES)
    return made


def write_page(out: Path, text: str, plan: str) -> Path:
    """Write a page of the plan with a SHA-256, whole or not at all. Raises ExportError."""
    with replacing_result(out, plan) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return out


def safe_json(data: Any) -> str:
    """JSON that cannot end the script element around it."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def _asset(name: str) -> Markup:
    """A file of assets/, which is trusted and not escaped."""
    from markupsafe import Markup

    file = resources.files(PACKAGE).joinpath("assets", *name.split("/"))
    return Markup(file.read_text(encoding="utf-8"))

"""Render self-contained pages from the templates in reporting/templates.

A page contains its styles, scripts and data. It loads nothing from the network. The other modules
of this package call `render_page` with the content of their pages.
"""

import json
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ssm_planner.display import jinja_environment, render_template
from ssm_planner.publishing import replacing_result

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup


PACKAGE = "ssm_planner.reporting"
"""Package that contains the templates and assets."""
PAGE_MARK = "default-src"
"""End of the part with which all pages begin."""
EMBEDDED_LIBRARIES = (("three.js 0.187.0", "three"), ("uPlot 1.6.32", "uplot"))
"""Name with version, and file stem in assets/vendor, of each embedded JavaScript library.

Every page contains copies of these libraries and therefore their licences.
"""


def render_page(template: str, data: Any, **content: Any) -> str:
    """Render a template as an HTML document.

    Parameters
    ----------
    template : str
        File name of the template.
    data : Any
        Data for the scripts of the page, as JSON types.
    **content
        Values of the variables in the template, which escapes them.

    Returns
    -------
    str
        The document.
    """
    from markupsafe import Markup

    return render_template(
        template_environment(), template, data=Markup(safe_json(data)), **content
    )


@cache
def template_environment() -> "Environment":
    """Return the template environment of the pages, which escapes every value."""
    pages = jinja_environment(PACKAGE, escape=True)
    pages.globals.update(asset=_read_asset, libraries=EMBEDDED_LIBRARIES)
    return pages


def write_page(path: Path, text: str, plan: str) -> Path:
    """Write a page atomically, and return its path.

    Parameters
    ----------
    path : Path
        File of the page.
    text : str
        The document.
    plan : str
        SHA-256 of the plan that the page shows.

    Raises
    ------
    ExportError
        If the file cannot be written, or if another program wrote the existing file.
    """
    with replacing_result(path, plan, text.partition(PAGE_MARK)[0]) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def safe_json(data: Any) -> str:
    """Encode data as JSON for an HTML script element.

    Parameters
    ----------
    data : Any
        Data of JSON types.

    Returns
    -------
    str
        JSON text. The characters <, > and & are escaped, so that it cannot close the element.

    Raises
    ------
    ValueError
        If the data contain NaN or an infinite number.
    """
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def _read_asset(name: str) -> "Markup":
    """Return the content of a file in assets/, which is trusted and therefore not escaped."""
    from markupsafe import Markup

    file = resources.files(PACKAGE).joinpath("assets", *name.split("/"))
    return Markup(file.read_text(encoding="utf-8"))

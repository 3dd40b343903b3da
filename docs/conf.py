"""Sphinx: the pages of this folder as a site, without anything from the network; `make docs`."""

import runpy
from pathlib import Path
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert

from ssm_planner import __version__

HERE = Path(__file__).parent
project, author, release = "ssm_planner", "The ssm_planner authors", __version__
extensions = ["myst_parser"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"{project} {release}"
html_show_copyright = html_show_sphinx = False
myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath"]
html_math_renderer = "mathml"  # browsers draw MathML without a script
suppress_warnings = [
    "myst.xref_missing",
    "misc.highlighting_failure",
]  # links out of this folder; tests follow them
runpy.run_path(str(HERE / "make_gallery.py"), run_name="__main__")


CHANGED = {
    'role="heading">': 'role="heading" aria-level="2">',
    "<pre>": '<pre tabindex="0">',
    '<div class="table-wrapper': '<div tabindex="0" class="table-wrapper',
}


def inline_math(writer: Any, node: Any) -> None:
    writer.body.append(convert(node.astext()))
    raise nodes.SkipNode


def block_math(writer: Any, node: Any) -> None:
    writer.body.append(
        f'<div style="overflow: auto hidden; padding: 0.3em 0" tabindex="0">{convert(node.astext(), display="block")}</div>'
    )
    raise nodes.SkipNode


def setup(app: Any) -> None:
    """Captions of the contents get a level, and code and tables that scroll the keyboard, which Sphinx leaves out."""

    def finish(app: Any, _: Exception | None) -> None:
        for page in Path(app.outdir).glob("*.html"):
            text = page.read_text(encoding="utf-8")
            for before, after in CHANGED.items():
                text = text.replace(before, after)
            page.write_text(text, encoding="utf-8")

    app.connect("build-finished", finish)
    app.add_html_math_renderer("mathml", (inline_math, None), (block_math, None))

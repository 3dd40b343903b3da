"""Write docs/gallery.md and its pictures by planning the shipped problems; `make docs` runs it."""

from __future__ import annotations

import re
import shutil
from itertools import takewhile
from pathlib import Path

from ssm_planner import film, load_problem, plan
from ssm_planner.loading.files import shipped_files

HERE = Path(__file__).parent
PICTURES = HERE / "_build" / "gallery"


def first_sentences(text: str) -> str:
    """The first two sentences of the comment with which a file begins."""
    comment = takewhile(lambda line: line.startswith("#"), text.splitlines())
    words = " ".join(line.lstrip("# ") for line in comment)
    return " ".join(re.split(r"(?<=\.) (?=[A-Z])", words)[:2])


def main() -> None:
    """Plan every shipped problem; a section for each, with its first comment, its film, its figure and its file."""
    shutil.rmtree(PICTURES, ignore_errors=True)  # It may contain the plans of another version.
    parts = ["# Gallery\n\nThe shipped problems, planned when this page was made.\n"]
    for name, file in shipped_files("problems").items():
        result = plan(load_problem(file))
        result.save(PICTURES / name)
        text = file.read_text(encoding="utf-8")
        film(PICTURES / name, PICTURES / name / "film.gif", 0.5)
        parts += [
            f"## {name}\n",
            *([comment, ""] if (comment := first_sentences(text)) else []),
            f"{result.duration:.4f} s; lower bound {result.lower_bound:.4f} s. The film shows it at half speed.\n",
            f"![The arm and the tool of {name}](_build/gallery/{name}/film.gif)\n",
            f"![Motion of {name}](_build/gallery/{name}/motion.png)\n",
            f"```yaml\n{text}```\n",
        ]
    (HERE / "gallery.md").write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()

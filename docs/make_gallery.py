"""Write docs/gallery.md and its pictures by planning the shipped problems; `make docs` runs it."""

from __future__ import annotations

from pathlib import Path

from ssm_planner import load_problem, plan
from ssm_planner.loading.files import shipped_files

HERE = Path(__file__).parent
PICTURES = HERE / "_build" / "gallery"


def main() -> None:
    """Plan every shipped problem; a section for each, with its first comment, its figures and its file."""
    parts = ["# Gallery\n\nThe shipped problems, planned when this page was made.\n"]
    for name, file in shipped_files("problems").items():
        result = plan(load_problem(file))
        result.save(PICTURES / name)
        text = file.read_text(encoding="utf-8")
        comment = [line.lstrip("# ") for line in text.splitlines() if line.startswith("#")]
        parts += [
            f"## {name}\n",
            *(["\n".join(comment[:2]), ""] if comment else []),
            f"{result.duration:.4f} s; lower bound {result.lower_bound:.4f} s.\n",
            f"![Motion of {name}](_build/gallery/{name}/motion.png)\n",
            f"```yaml\n{text}```\n",
        ]
    (HERE / "gallery.md").write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()

"""Write the pictures of the documents from the shipped results; `make picture` runs it. Needs Chromium."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
import threading
from pathlib import Path

from PIL import Image

from ssm_planner import film, load_problem
from ssm_planner.pipeline.run import plan_to_folder
from ssm_planner.view.page import Study
from ssm_planner.view.server import ViewServer

HERE = Path(__file__).parent
RESULTS = HERE.parent / "results"
SIZE = "1280,800"
SCENE = (20, 240, 640, 670)
"""Box of the mechanism in the picture of a report, pixels."""
TOO_CLOSE = "[9.07 mm, 0 mm, -18.4 mm]"
"""Target of an infeasible problem: 0.76 mm from the retina."""


def shrink(file: Path) -> None:
    """Give a picture a palette, which halves its file."""
    with Image.open(file) as whole:
        whole.convert("RGB").quantize(128).save(file, optimize=True)


def picture(address: str, out: Path, seconds: float, size: str = SIZE) -> None:
    """Write what Chromium shows at an address after so many seconds of its clock."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome") or "chromium"
    flags = ("--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader")
    time = f"--virtual-time-budget={1000 * seconds:.0f}"
    motion = "--force-prefers-reduced-motion"
    command = [chromium, *flags, motion, time, f"--window-size={size}", f"--screenshot={out}"]
    subprocess.run([*command, address], check=True, capture_output=True, timeout=600)


def main() -> None:
    """Write the pictures of a motion, a report, the view, the mechanism and an infeasible problem."""
    with tempfile.TemporaryDirectory() as folder:
        film(RESULTS / "tilt_insert", Path(folder))
        shutil.copy(Path(folder) / "strip.png", HERE / "motion.png")
    report = RESULTS / "tilt_insert" / "report.html"
    picture(report.as_uri(), HERE / "report.png", 4)
    with Image.open(HERE / "report.png") as whole:
        whole.crop(SCENE).quantize(64).save(HERE / "scene.png")
    with tempfile.TemporaryDirectory() as folder:
        text = (HERE.parent / "problems" / "eye_approach.yaml").read_text(encoding="utf-8")
        file = Path(folder) / "too_close.yaml"
        text = text.replace("robots/vitreoretinal.yaml", "vitreoretinal")
        file.write_text(re.sub(r"\[9.07 mm, 0 mm, -17.66 mm\]", TOO_CLOSE, text), encoding="utf-8")
        _, paths = plan_to_folder(load_problem(file), Path(folder) / "results")
        picture(paths["page"].as_uri(), HERE / "no_plan.png", 2, "1280,480")
    with ViewServer(Study(load_problem("eye_approach"))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        picture(server.url, HERE / "view.png", 60)
        server.shutdown()
    for name in ("report", "view", "no_plan"):
        shrink(HERE / f"{name}.png")


if __name__ == "__main__":
    main()

"""Write the pictures of the documents from the shipped results; `make picture` runs it. Needs Chromium."""

from __future__ import annotations

import re
import shutil
import tempfile
import threading
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

from ssm_planner import film, load_problem
from ssm_planner.pipeline.run import plan_to_folder
from ssm_planner.view.server import ViewServer

HERE = Path(__file__).parent
RESULTS = HERE.parent / "results"
DRAWN = "document.querySelector('canvas') !== null"
"""Condition in JavaScript that the scene of a report is drawn."""
PLANNED = "document.querySelector('.outcome') !== null"
"""Condition in JavaScript that the view has planned its motion."""
SCENE = (20, 250, 640, 680)
"""Box of the mechanism in the picture of a report, pixels."""
TOO_CLOSE = "[9.07 mm, 0 mm, -18.4 mm]"
"""Target of an infeasible problem: 0.76 mm from the retina."""


def shrink(file: Path) -> None:
    """Give a picture a palette, which halves its file."""
    with Image.open(file) as whole:
        whole.convert("RGB").quantize(128).save(file, optimize=True)


def picture(address: str, out: Path, ready: str, height: int = 800, view: str = "") -> None:
    """Write what Chromium shows at an address, two seconds after a condition in JavaScript is true.

    `view` is the name of a button that chooses the view of the scene.

    The scene is drawn in real time, so Chromium's virtual time may leave it blank.
    """
    with sync_playwright() as playwright:
        path = shutil.which("chromium") or shutil.which("google-chrome")
        flags = ["--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=path, args=flags)
        size = {"width": 1280, "height": height}
        page = browser.new_page(viewport=size, reduced_motion="reduce")
        page.goto(address)
        for _ in range(600):  # The policy of the page forbids `wait_for_function`.
            if page.evaluate(ready):
                break
            page.wait_for_timeout(200)
        if view:
            page.get_by_role("button", name=view, exact=True).first.click()
        page.wait_for_timeout(2000)
        page.screenshot(path=out)
        browser.close()


def main() -> None:
    """Write the pictures of a motion, a report, the view, the mechanism and an infeasible problem."""
    with tempfile.TemporaryDirectory() as folder:
        film(RESULTS / "tilt_insert", Path(folder))
        shutil.copy(Path(folder) / "strip.png", HERE / "motion.png")
    report = RESULTS / "tilt_insert" / "report.html"
    picture(report.as_uri(), HERE / "report.png", DRAWN)
    picture(report.as_uri(), HERE / "scene.png", DRAWN, view="whole")
    with Image.open(HERE / "scene.png") as whole:
        scene = whole.crop(SCENE)
    scene.quantize(64).save(HERE / "scene.png")
    with tempfile.TemporaryDirectory() as folder:
        text = (HERE.parent / "problems" / "eye_approach.yaml").read_text(encoding="utf-8")
        file = Path(folder) / "too_close.yaml"
        text = text.replace("robots/vitreoretinal.yaml", "vitreoretinal")
        file.write_text(re.sub(r"\[9.07 mm, 0 mm, -17.66 mm\]", TOO_CLOSE, text), encoding="utf-8")
        _, paths = plan_to_folder(load_problem(file), Path(folder) / "results")
        picture(paths["page"].as_uri(), HERE / "no_plan.png", "true", height=480)
    with ViewServer(load_problem("eye_approach")) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        picture(server.url, HERE / "view.png", PLANNED)
        server.shutdown()
    for name in ("report", "view", "no_plan"):
        shrink(HERE / f"{name}.png")


if __name__ == "__main__":
    main()

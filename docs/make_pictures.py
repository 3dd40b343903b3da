"""Write the pictures of the documents from the shipped results; `make picture` runs it. Needs Chromium."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import threading
from pathlib import Path

from ssm_planner import film, load_problem
from ssm_planner.view.page import Study
from ssm_planner.view.server import ViewServer

HERE = Path(__file__).parent
RESULTS = HERE.parent / "results"
SIZE = "1280,800"


def picture(address: str, out: Path, seconds: float) -> None:
    """Write what Chromium shows at an address after so many seconds of its clock."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome") or "chromium"
    flags = ("--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader")
    time = f"--virtual-time-budget={1000 * seconds:.0f}"
    motion = "--force-prefers-reduced-motion"
    command = [chromium, *flags, motion, time, f"--window-size={SIZE}", f"--screenshot={out}"]
    subprocess.run([*command, address], check=True, capture_output=True, timeout=120)


def main() -> None:
    """Write the pictures of a motion, of the report and of the view."""
    with tempfile.TemporaryDirectory() as folder:
        film(RESULTS / "tilt_insert", Path(folder))
        shutil.copy(Path(folder) / "strip.png", HERE / "motion.png")
    report = RESULTS / "tilt_insert" / "report.html"
    picture(report.as_uri(), HERE / "report.png", 4)
    with ViewServer(Study(load_problem("eye_approach"))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        picture(server.url, HERE / "view.png", 20)
        server.shutdown()


if __name__ == "__main__":
    main()

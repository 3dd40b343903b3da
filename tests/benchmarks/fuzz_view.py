"""Interact at random with the page of `ssm-planner view` in Chromium, and look for stale verdicts.

    python -m tests.benchmarks.fuzz_view [--count 10000] [--seed 1] [--problem tilt_insert]

The script fuzz_view.js performs the interactions: sliders, typed numbers, motors, gears, figures,
motions, pinned motions, cancelled runs, saved files and texts. The answers of the server come after
random delays. Most plans are invented, and every tenth block of interactions uses the real
planner. After each interaction, everything that the page states as current must belong to the
settings that it shows. At the end of each block, the page is reloaded or its text is edited, and
must then show the same settings. A saved file of a real block must plan to the motion of the page.
The exit status is 1 if one of these conditions fails.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from playwright.sync_api import TimeoutError, sync_playwright

from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan
from ssm_planner.pipeline.thermal import with_fast_planner
from ssm_planner.plans import load_plan
from ssm_planner.problem.problem import Problem
from ssm_planner.reporting import comparison_data
from ssm_planner.view.server import ViewServer
from tests.browser.conftest import FLAGS, READY, chromium
from tests.support.paths import ROOT

BLOCK = 40
"""Interactions between two reloads or edited texts."""
REAL_BLOCKS = 10
"""One block of this number uses the real planner."""
SCRIPT = (ROOT / "tests/benchmarks/fuzz_view.js").read_text(encoding="utf-8")
MAX_DIFFERENCE = 1e-6
"""Largest difference between the motion of the page and that of its saved file, rad or m."""
RELEASE = """async ([path, value]) => {
  const node = document.getElementById(path);
  const before = performance.now();
  node.value = value;
  node.dispatchEvent(new Event("input", { bubbles: true }));
  node.dispatchEvent(new Event("change", { bubbles: true }));
  const is_done = () => !campaign.isStale() && document.getElementById("cancel").disabled;
  while (!is_done() && performance.now() < before + 20000) await new Promise((resolve) => setTimeout(resolve, 5));
  await new Promise((resolve) => requestAnimationFrame(resolve));
  return [(performance.now() - before) / 1000, document.querySelector(".outcome").textContent];
}"""
"""Release a slider, and return the time until the new curves are drawn, s."""


@dataclass
class Tally:
    """Faults and counts of a campaign."""

    faults: Counter[str] = field(default_factory=Counter)
    examples: dict[str, str] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    times: list[float] = field(default_factory=list)
    differences: list[float] = field(default_factory=list)
    gaps: list[float] = field(default_factory=list)

    def add(self, text: str) -> None:
        """Count a fault by its description without numbers, and keep one example."""
        title = re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "N", text.split(" | ")[0])
        self.faults[title] += 1
        self.examples.setdefault(title, text)


def shipped_desk() -> dict[str, Any]:
    """Return the curves of the shipped plan for invented answers."""
    desk = comparison_data((load_plan(ROOT / "results/tilt_insert/plan.json"),))
    desk["panels"] = [panel for panel in desk["panels"] if panel["section"] == "Motors"]
    return {**desk, "names": ["B"]}


@contextmanager
def running_server(problem: Problem) -> Iterator[ViewServer]:
    """Yield a server of the view that answers requests in a thread."""
    with ViewServer(problem) as server:
        threading.Thread(
            target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True
        ).start()
        yield server
        server.shutdown()


class Campaign:
    """Random interactions with one page."""

    def __init__(self, browser: Any, server: ViewServer, seed: int, desk: Any) -> None:
        self.context = browser.new_context(
            viewport={"width": 1280, "height": 800}, reduced_motion="reduce"
        )
        self.page = self.context.new_page()
        self.draw = random.Random(seed)
        self.server, self.tally = server, Tally()
        self.page.on("pageerror", lambda error: self.tally.add(f"exception: {error}"))
        self.page.add_init_script(SCRIPT.replace("DESK", json.dumps(desk)))

    def prepare(self, real: bool) -> None:
        """Choose the seed of the next page, and whether the real planner answers."""
        settings = {"seed": self.draw.getrandbits(30), "real": real}
        self.page.evaluate("(settings) => { window.name = settings; }", json.dumps(settings))

    def load(self, address: str | None, real: bool) -> None:
        """Open an address, or reload the page if it is None, with a new seed."""
        self.prepare(real)
        if address is None:
            self.page.reload()
        else:
            self.page.goto(address)
        self.wait()

    def wait(self, condition: str = READY) -> None:
        """Wait until an expression is true, by default until the scripts of the page are ready."""
        for _ in range(3000):
            if self.page.evaluate(condition):
                return
            time.sleep(0.02)
        raise AssertionError(f"never true: {condition}")

    def block(self, count: int, real: bool) -> None:
        """Perform interactions, then reload the page or edit its text."""
        evaluate = self.page.evaluate
        for text in evaluate(f"campaign.run({count})"):
            self.tally.add(text)
        prevented = evaluate("campaign.settle(30)")
        if prevented:
            self.tally.add(prevented)
        if real:
            self.collect()
            self.design()
            self.compare_saved()
            self.release_sliders()
        self.collect()

    def collect(self) -> None:
        """Add the counts of the page to the tally, before the page is left."""
        evaluate = self.page.evaluate
        for item in evaluate("campaign.saved"):
            self.tally.counts["saved"] += 1
            if item["differs"]:
                self.tally.add(f"saved file: {item['differs']}")
        self.tally.counts.update(evaluate("campaign.counts"))
        self.tally.counts["current verdicts"] += evaluate("campaign.current")
        self.tally.counts["current ranges"] += evaluate("campaign.reaches")
        plans = evaluate("campaign.requests.filter((body) => 'design' in body).length")
        kind = "real requests" if evaluate("campaign.real") else "requests"
        self.tally.counts[kind] += plans

    def reload(self, real: bool) -> None:
        """Reload the page. It must show the same settings as before."""
        self.page.evaluate(
            "document.querySelectorAll('details').forEach((node) => { node.open = true; })"
        )
        invalid = self.page.evaluate("campaign.errors().length > 0")
        before = self.page.evaluate("campaign.shown()")
        self.load(None, real)
        self.page.evaluate(
            "document.querySelectorAll('details').forEach((node) => { node.open = true; })"
        )
        after = self.page.evaluate("campaign.shown()")
        self.tally.counts["reloads"] += 1
        if not invalid and before != after:
            names = [name for name in before if before[name] != after.get(name)]
            self.tally.add(f"reload changes {names}: {[before[name] for name in names]}")

    def edit(self, real: bool) -> None:
        """Edit the text of the problem: invalid first, then valid."""
        page = self.page
        page.evaluate("document.getElementById('source').open = false")
        time.sleep(0.1)
        page.evaluate("document.getElementById('source').open = true")
        time.sleep(0.3)
        # The text and the settings are read at the same instant, because an answer may come late.
        text, before, is_outdated = page.evaluate(
            "[document.getElementById('text').value, campaign.shown(), "
            "!document.getElementById('rewrite').hidden]"
        )
        outcome = page.evaluate("document.querySelector('.outcome')?.textContent")
        if not text or outcome == "not planned" or page.evaluate("campaign.errors().length"):
            return
        if is_outdated:
            return
        self.tally.counts["edits"] += 1
        invalid = re.sub(r"velocity: (\S+) deg/s", r"velocity: \1 deg", text, count=1)
        if invalid != text:
            address = page.url
            page.fill("#text", invalid)
            page.click("#apply")
            time.sleep(0.3)
            if not page.inner_text("#text-error") or page.url != address:
                self.tally.add("an invalid text is not refused")
        speed = self.draw.uniform(35.0, 65.0)
        page.fill("#text", re.sub(r"velocity: \S+ deg/s", f"velocity: {speed:.3f} deg/s", text))
        self.prepare(real)
        path = page.url.split("#")[0]
        page.click("#apply")
        try:
            page.wait_for_url(lambda address: address.split("#")[0] != path, timeout=8000)
        except TimeoutError:
            reason = page.inner_text("#text-error")
            # An invented plan may belong to a problem that the server refuses.
            if "check passed" in outcome:
                self.tally.add(f"a valid text is refused: {reason}")
            return
        self.wait()
        after = page.evaluate("campaign.shown()")
        for name in ("alpha", "beta", "payload"):
            if abs(before[name] - after[name]) > 2e-5:
                self.tally.add(f"edit changes {name}: {before[name]} {after[name]}")

    def design(self) -> None:
        """Choose settings at random that probably permit a motion, and wait for its plan."""
        draw, page = self.draw, self.page
        self.prepare(real=True)
        page.goto(self.server.url + "#")
        page.reload()
        self.wait("document.querySelector('.outcome') !== null")
        values = {"payload": draw.uniform(0, 60)}
        for joint in ("roll", "tilt"):
            values[f"joints.{joint}.drive.friction.mu"] = draw.uniform(0.13, 0.2)
        if draw.random() < 0.5:
            values["alpha"] = draw.uniform(28, 32)
        if draw.random() < 0.5:
            values |= {"tilt": draw.uniform(-110, -90), "roll": draw.uniform(-20, 20)}
        for name, value in values.items():
            page.evaluate(RELEASE, [name, value])
        page.evaluate("campaign.settle(30)")

    def compare_saved(self) -> None:
        """Plan the saved file in another folder, and compare it with the motion of the page."""
        page = self.page
        outcome = page.evaluate("document.querySelector('.outcome')?.textContent ?? ''")
        link = page.query_selector("#outcome a[download]")
        if link is None or page.evaluate("campaign.isStale()") or not outcome.startswith("#"):
            self.tally.counts["saved without a plan"] += 1
            return
        document = page.evaluate(
            "async (path) => (await fetch(path)).text()", link.get_attribute("href")
        )
        count = page.evaluate("campaign.saved.length")
        page.evaluate("document.getElementById('save').click()")
        for _ in range(100):
            time.sleep(0.05)
            if page.evaluate("campaign.saved.length") > count:
                break
        text = page.evaluate("campaign.saved.at(-1).text")
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "problem.yaml"
            file.write_text(text, encoding="utf-8")
            shown = Path(folder) / "plan.json"
            shown.write_text(document, encoding="utf-8")
            motion = load_plan(shown).trajectory
            problem = load_problem(file)
            same = plan(with_fast_planner(problem)).trajectory
            optimal = plan(problem)
        self.tally.counts["saved and planned"] += 1
        if motion is None or same is None or optimal.trajectory is None:
            self.tally.add(f"saved file plans differently: {outcome}, {same is None}")
            return
        times = np.linspace(0.0, motion.duration, 200)
        if abs(same.duration - motion.duration) > MAX_DIFFERENCE:
            self.tally.add(f"saved file takes {same.duration} s: {outcome}")
            return
        difference = float(np.abs(same.positions(times) - motion.positions(times)).max())
        self.tally.differences.append(difference)
        self.tally.gaps.append(optimal.trajectory.duration / motion.duration - 1.0)
        if difference > MAX_DIFFERENCE:
            self.tally.add(f"saved file moves differently by {difference}: {outcome}")

    def release_sliders(self) -> None:
        """Measure the time from a released slider to the curves of the new plan."""
        self.page.evaluate("document.getElementById('own').click()")
        self.page.evaluate("campaign.settle(30)")
        for _ in range(3):
            path = f"joints.{self.draw.choice(['roll', 'tilt'])}.drive.friction.mu"
            self.times_of(path, self.draw.uniform(0.13, 0.2))

    def times_of(self, path: str, value: float) -> None:
        """Release one slider and keep the time."""
        if self.page.is_visible(f"[id='{path}']"):
            seconds, outcome = self.page.evaluate(RELEASE, [path, value])
            if "check passed" in outcome:
                self.tally.times.append(seconds)
            self.tally.counts[f"released: {re.sub('[0-9.]+', 'N', outcome)}"] += 1


def is_real(k: int) -> bool:
    """Return True if the block with this number uses the real planner."""
    return k % REAL_BLOCKS == REAL_BLOCKS - 1


def main() -> int:
    """Run the campaign and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--problem", default="tilt_insert")
    options = parser.parse_args()
    problem = load_problem(ROOT / f"problems/{options.problem}.yaml")
    start = time.monotonic()
    with running_server(problem) as server, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(FLAGS))
        campaign = Campaign(browser, server, options.seed, shipped_desk())
        campaign.load(server.url, is_real(0))
        for k in range(options.count // BLOCK):
            campaign.block(BLOCK, is_real(k))
            following = is_real(k + 1)
            if k % 3 == 1:
                campaign.edit(following)
            elif k % 7 == 6:
                campaign.load(server.url, following)
            else:
                campaign.reload(following)
        browser.close()
    tally = campaign.tally
    print(f"{options.count} interactions in {time.monotonic() - start:.0f} s, seed {options.seed}")
    print(", ".join(f"{count} {name}" for name, count in tally.counts.most_common()))
    if tally.times:
        print(
            f"slider released to new curves: median {median(tally.times):.2f} s of {len(tally.times)}"
        )
    if tally.differences:
        print(
            f"saved files: largest difference {max(tally.differences):.1e}; `optimal` changes the "
            f"duration by {min(tally.gaps):.1e} to {max(tally.gaps):.1e}"
        )
    for title, count in tally.faults.most_common():
        print(f"FAULT {count} x {title}\n      {tally.examples[title]}")
    print(f"{sum(tally.faults.values())} faults of {len(tally.faults)} kinds")
    return 1 if tally.faults else 0


if __name__ == "__main__":
    sys.exit(main())

"""The local view in a real browser."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest

from ssm_planner.problem.problem import Problem
from ssm_planner.view.page import Study
from ssm_planner.view.server import ViewServer

from .conftest import Visit
from .page_laws import CONTRAST, OVERFLOW, UNNAMED

Open = Callable[..., Visit]


@pytest.fixture(scope="module")
def server(tilt_insert: Problem) -> Iterator[ViewServer]:
    with ViewServer(Study(tilt_insert)) as running:
        threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()
        yield running
        running.shutdown()


def test_sliders_move_band_and_mechanism(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page, canvas = opened.page, opened.page.locator("#scene canvas")
    assert "−139.778° to −79.778°" in page.inner_text("#reach")
    page.wait_for_timeout(200)
    before = canvas.screenshot()
    page.fill("#alpha", "40")
    opened.wait("document.getElementById('reach').textContent.includes('149.778')")
    page.wait_for_timeout(200)
    wider = canvas.screenshot()
    assert wider != before
    page.fill("#tilt", "-120")
    opened.wait("SSM.scene.tip(0)[0] !== undefined && document.getElementById('to').textContent.includes('−120.0')")
    page.wait_for_timeout(300)
    assert canvas.screenshot() != wider
    assert page.is_disabled("#plan")
    page.click("#own")
    opened.wait("!document.getElementById('plan').disabled")
    assert opened.said == []
    assert all(address.startswith(server.url) or address.startswith("data:") for address in opened.fetched)


def test_branches_are_selectable_and_reach_the_same_tip(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    page.fill("#depth", "15")
    opened.wait("SSM.scene.tip(0).some((x) => Math.abs(x) > 0.01)")
    page.wait_for_timeout(200)
    canvas = page.locator("#scene canvas")
    first, tip = canvas.screenshot(), page.evaluate("SSM.scene.tip(0)")
    page.locator("#branches input").nth(1).check()
    page.wait_for_timeout(200)
    assert canvas.screenshot() != first
    assert page.evaluate("SSM.scene.tip(0)") == pytest.approx(tip, abs=1e-6)


def test_outside_the_workspace_is_said(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    opened.page.fill("#tilt", "-60")
    opened.wait("document.getElementById('reached').textContent.includes('19.78')")


def test_plans_the_motion_and_shows_the_report(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    page.fill("#tilt", "-100")
    page.click("#plan")
    opened.wait("document.querySelector('.outcome')?.textContent.includes('check passed')", seconds=60)
    frame = page.frame_locator("iframe")
    assert "Certified" in frame.locator(".verdict").inner_text(timeout=20_000)
    assert page.locator(".steps li").count() >= 3
    assert opened.said == []


@pytest.mark.parametrize("width", [1280, 390])
def test_fits_reads_and_is_reachable(visit: Open, server: ViewServer, width: int) -> None:
    page = visit(server.url, width=width).page
    page.fill("#tilt", "-60")
    page.wait_for_timeout(300)
    assert page.evaluate(OVERFLOW) == []
    assert page.evaluate(CONTRAST) == []
    assert page.evaluate(UNNAMED) == []

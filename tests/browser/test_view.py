"""The local view in a real browser."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from ssm_planner.problem.problem import Problem
from ssm_planner.view.page import Study
from ssm_planner.view.server import ViewServer
from tests.support.page_laws import CONTRAST, OVERFLOW, UNNAMED, serious

from .conftest import Visit

pytestmark = pytest.mark.slow
Open = Callable[..., Visit]


@pytest.fixture(scope="module")
def server(tilt_insert: Problem) -> Iterator[ViewServer]:
    with ViewServer(Study(tilt_insert)) as running:
        threading.Thread(
            target=running.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True
        ).start()
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
    opened.wait(
        "SSM.scene.tip(0)[0] !== undefined && document.getElementById('to').textContent.includes('−120.0')"
    )
    page.wait_for_timeout(300)
    assert canvas.screenshot() != wider
    assert not page.is_disabled("#plan")
    assert "masses" in page.inner_text("#why")
    page.click("#own")
    opened.wait("document.getElementById('why').textContent === ''")
    assert opened.said == []
    assert all(
        address.startswith(server.url) or address.startswith("data:") for address in opened.fetched
    )


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
    opened.wait(
        "document.querySelector('.outcome')?.textContent.includes('check passed')", seconds=60
    )
    frame = page.frame_locator("iframe")
    assert "limits kept" in frame.locator(".verdict").inner_text(timeout=20_000)
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


FIELDS = ("alpha", "beta", "low", "high", "roll", "tilt", "spin", "depth")


def type_in(page: Any, field: str, text: str) -> None:
    page.fill(f"#{field}-number", text)
    page.press(f"#{field}-number", "Tab")


def test_bad_entries_are_refused_beside_their_fields(visit: Open, server: ViewServer) -> None:
    """40 seeded entries: each a message at its field, in the unit of the field; what was valid stays in use."""
    opened = visit(server.url)
    page, draw = opened.page, random.Random(19)
    for _ in range(40):
        field = draw.choice(FIELDS)
        low, high = (float(page.get_attribute(f"#{field}", end)) for end in ("min", "max"))
        good = page.input_value(f"#{field}")
        type_in(
            page,
            field,
            draw.choice(
                [
                    "",
                    "1e9",
                    "-1e9",
                    "1e308",
                    str(high + draw.uniform(0.01, 500)),
                    str(low - draw.uniform(0.01, 500)),
                ]
            ),
        )
        message = page.inner_text(f"#{field}-error")
        assert message, field
        assert "rad" not in message
        assert page.get_attribute(f"#{field}-number", "aria-invalid") == "true"
        assert page.input_value(f"#{field}") == good
        type_in(page, field, good)
        assert page.inner_text(f"#{field}-error") == ""
    type_in(page, "tilt", "-101.5")
    opened.wait("document.getElementById('to').textContent.includes('−101.5')")
    assert page.inner_text("#verdict") == ""
    assert opened.said == []


def test_sliders_at_their_ends_leave_the_page_alive(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    for field in FIELDS:
        for end in ("max", "min"):
            page.fill(f"#{field}", page.get_attribute(f"#{field}", end))
            page.wait_for_timeout(150)
    assert page.inner_text("#verdict") == ""
    page.fill("#low", "-120")
    page.fill("#high", "-100")
    page.click("#own")
    page.fill("#tilt", "-100")
    opened.wait("document.getElementById('reached').textContent === 'The pose is reachable.'")
    opened.wait("document.getElementById('reach').className === 'good'")


def test_a_late_answer_does_not_replace_a_newer_one(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    reachable = "document.getElementById('reached').textContent === 'The pose is reachable.'"
    page.fill("#tilt", "-170")
    opened.wait(f"!({reachable})")
    held: list[Any] = []
    page.route("**/workspace", lambda route: held.append(route), times=1)
    page.click("#own")
    while not held:
        page.wait_for_timeout(20)
    page.fill("#tilt", "-100")
    opened.wait(reachable)
    with page.expect_response("**/workspace"):
        held.pop().continue_()
    page.wait_for_timeout(200)
    assert page.evaluate(reachable)
    assert page.evaluate("document.getElementById('reach').textContent") != ""


def test_what_is_set_stands_in_the_address(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    type_in(page, "tilt", "-101.25")
    page.click("#waypoint")
    page.click("#dwell")
    type_in(page, "depth", "7.5")
    address = page.url
    for reloaded in (visit(address), visit(address)):
        assert reloaded.page.input_value("#tilt-number") == "-101.25"
        assert reloaded.page.input_value("#depth-number") == "7.5"
        assert reloaded.page.locator("#steps li").count() == 2
    broken = visit(server.url + "#%7B%22tilt%22%3A1e9%2C%22steps%22%3A%5B7%5D%7D")
    assert broken.page.inner_text("#verdict") == ""


def test_a_motion_that_cannot_be_is_refused_at_its_field(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    page.fill("#low", "-110")
    page.fill("#tilt", "-125")
    page.click("#plan")
    opened.wait("document.getElementById('tilt-error').textContent !== ''")
    assert "deg" in page.inner_text("#tilt-error")
    assert page.locator("#outcome").bounding_box()["y"] < page.evaluate("scrollY + innerHeight")


def test_a_verdict_holds_for_its_settings_only(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    assert page.is_disabled("#plan"), "a motion to its own start goes nowhere"
    assert "Move a slider" in page.inner_text("#why")
    type_in(page, "tilt", "-100")
    page.click("#plan")
    opened.wait("document.querySelector('.outcome')?.textContent.includes('check')", seconds=60)
    assert not page.is_visible("#stale")
    assert page.is_visible("#result iframe")
    page.evaluate("document.getElementById('result').scrollIntoView()")
    scene, result = (page.locator(name).bounding_box() for name in (".stage", "#result"))
    assert scene["y"] + scene["height"] <= result["y"], "the scene covers the report"
    draw = random.Random(4)
    for field in ("alpha", "beta", "tilt", "depth", "roll", "low"):
        before = page.input_value(f"#{field}-number")
        low, high = (float(page.get_attribute(f"#{field}", end)) for end in ("min", "max"))
        type_in(page, field, f"{float(before) + draw.choice([0.1, 0.3]):.3f}")
        assert low < high
        assert page.is_visible("#stale"), field
        assert not page.is_visible("#result iframe")
        reloaded = visit(page.url).page
        reloaded.wait_for_timeout(500)
        assert reloaded.is_visible("#stale"), "after a reload too"
        type_in(page, field, before)
        if field in ("alpha", "beta"):
            page.click("#own")
        page.wait_for_timeout(50)
    page.click("#own")


def test_cancel_and_plan_again(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    page.fill("#tilt", "-100")
    page.click("#plan")
    page.wait_for_timeout(500)
    page.click("#cancel")
    opened.wait("document.querySelector('.outcome').textContent === 'cancelled'", seconds=0.6)
    page.wait_for_timeout(200)
    assert not page.is_disabled("#plan")


def test_axe_finds_nothing_serious(visit: Open, server: ViewServer) -> None:
    assert serious(visit(server.url).page) == []

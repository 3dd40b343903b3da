"""The local view is tested in a real browser."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from ssm_planner.problem.problem import Problem
from ssm_planner.view.server import ViewServer
from tests.benchmarks.fuzz_view import BLOCK, Campaign, shipped_desk
from tests.support.cases import selected
from tests.support.page_laws import CONTRAST, OVERFLOW, UNNAMED, serious

from .conftest import Visit

pytestmark = pytest.mark.slow
Open = Callable[..., Visit]


@pytest.fixture(scope="module")
def server(tilt_insert: Problem) -> Iterator[ViewServer]:
    with ViewServer(tilt_insert) as running:
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
    assert "masses" in page.inner_text("#why")
    page.click("#own")
    opened.wait("document.getElementById('why').textContent === ''")
    assert opened.said == [] or all("400" in text for text in opened.said)
    assert all(
        address.startswith(server.url) or address.startswith("data:") for address in opened.fetched
    )


def test_branches_are_selectable_and_reach_the_same_tip(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    opened.wait(f"{PLANNED} && {IDLE}", seconds=60)
    page.fill("#depth", "15")
    opened.wait(f"SSM.scene.tip(0).some((x) => Math.abs(x) > 0.01) && {IDLE}")
    page.wait_for_timeout(200)
    canvas = page.locator("#scene canvas")
    first, tip = canvas.screenshot(), page.evaluate("SSM.scene.tip(0)")
    page.select_option("#branches", index=1)
    page.wait_for_timeout(200)
    assert canvas.screenshot() != first
    assert page.evaluate("SSM.scene.tip(0)") == pytest.approx(tip, abs=1e-6)


def test_a_page_plans_while_another_one_does(visit: Open, server: ViewServer) -> None:
    abandoned = visit(server.url)
    opened = visit(server.url)
    opened.wait(f"{PLANNED} && {IDLE}", seconds=60)
    abandoned.wait(
        f"{PLANNED} || document.querySelector('.outcome')?.textContent.includes('newer')"
    )


def test_outside_the_workspace_is_said(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    opened.page.fill("#tilt", "-60")
    opened.wait("document.getElementById('reached').textContent.includes('19.78')")


PLANNED = "document.querySelector('.outcome')?.textContent.includes('check passed')"
IDLE = "document.getElementById('cancel').disabled && document.getElementById('stale').style.visibility === 'hidden'"


def test_plans_the_motion_and_shows_the_report(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    opened.wait(PLANNED, seconds=60)
    own = page.inner_text("#outcome")
    page.fill("#tilt", "-100")
    opened.wait(f"{PLANNED} && {IDLE}", seconds=60)
    assert page.inner_text("#outcome") != own, "the motion to the pose replaces that of the file"
    assert page.locator("#plots .plot").count() == 9
    with page.expect_popup() as popup:
        page.click("#outcome a")
    assert "limits kept" in popup.value.locator(".verdict").inner_text(timeout=20_000)
    assert opened.said == []


def pinned_time(opened: Visit) -> str:
    """Wait for the motion, pin it, and return its duration as text."""
    opened.wait(PLANNED, seconds=60)
    time = opened.page.inner_text("#outcome tr:first-child td")
    opened.page.click("#pin")
    opened.wait(f"document.querySelectorAll('#outcome tr:first-child td').length === 2 && {IDLE}")
    return time


def test_parts_change_the_plan_and_a_pinned_plan_stays(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    time = pinned_time(opened)
    type_in(page, "joints.roll.drive.friction.mu", "0.3")
    opened.wait(f"{PLANNED} && {IDLE}")
    assert "static friction" in page.inner_text("#why")
    cells = page.locator("#outcome tr").nth(1).locator("td").all_inner_texts()
    assert cells[0] == time
    assert cells[1] != time
    address = page.url
    reloaded = visit(address)
    reloaded.wait(f"{PLANNED} && {IDLE}", seconds=60)
    texts = reloaded.page.locator("#outcome tr").nth(1).locator("td").all_inner_texts()
    assert texts == cells, "the address holds the design and what is pinned"
    page.select_option("[id='joints.roll.motor']", "maxon_ec_13_6w")
    opened.wait("document.querySelector('.outcome').textContent.includes('too weak')", seconds=60)
    page.click("#own")
    opened.wait(f"{PLANNED} && {IDLE}")
    assert page.locator("#outcome tr").nth(1).locator("td").all_inner_texts() == [time, time]
    type_in(page, "joints.roll.drive.friction.mu", "0.05")
    page.fill("[id='joints.roll.drive.geometry.ratio']", "45")
    opened.wait("document.getElementById('joints.roll.drive.friction.mu-error').textContent !== ''")
    assert page.inner_text(".outcome") == "not planned"
    assert opened.said == [] or all("400" in text for text in opened.said)


def test_no_statement_is_stale_in_random_interactions(browser: Any, server: ViewServer) -> None:
    """A statement that is shown as current always belongs to the settings of the page.

    `python -m tests.benchmarks.fuzz_view` performs 10 000 interactions.
    """
    campaign = Campaign(browser, server, seed=int(selected("3", every="5")), desk=shipped_desk())
    campaign.load(server.url, real=False)
    for _ in range(selected(4, every=20)):
        campaign.block(BLOCK, real=False)
        campaign.reload(real=False)
    campaign.edit(real=False)
    assert campaign.tally.examples == {}
    assert campaign.tally.counts["current verdicts"] > 10
    assert campaign.tally.counts["current ranges"] > 10
    campaign.context.close()


def test_curves_follow_a_slider(visit: Open, server: ViewServer) -> None:
    """After a change of a slider, the old verdict is stale at once, and a new plan follows.

    The plans come from the real planner.
    """
    opened = visit(server.url)
    page, draw = opened.page, random.Random(7)
    opened.wait(PLANNED, seconds=60)
    seconds = []
    for _ in range(selected(8, every=20)):
        mu = draw.uniform(0.1, 0.2)
        path = draw.choice(["joints.roll.drive.friction.mu", "joints.tilt.drive.friction.mu"])
        seconds.append(
            page.evaluate(
                f"""async ([path, mu]) => {{
                  const node = document.getElementById(path);
                  const before = performance.now();
                  node.value = mu;
                  node.dispatchEvent(new Event("input", {{ bubbles: true }}));
                  node.dispatchEvent(new Event("change", {{ bubbles: true }}));
                  if (document.getElementById("stale").style.visibility === "hidden") return 1e9;
                  while (!({IDLE} && {PLANNED})) await new Promise((resolve) => setTimeout(resolve, 5));
                  await new Promise((resolve) => requestAnimationFrame(resolve));
                  return (performance.now() - before) / 1000;
                }}""",
                [path, mu],
            )
        )
    median = sorted(seconds)[len(seconds) // 2]
    print(f"slider released to new curves: median {median:.2f} s, largest {max(seconds):.2f} s")
    assert max(seconds) < 1e9, "the old verdict was marked as stale at once"


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
    page.fill(f"[id='{field}-number']", text)
    page.press(f"[id='{field}-number']", "Tab")


def test_bad_entries_are_refused_beside_their_fields(visit: Open, server: ViewServer) -> None:
    """A bad entry causes a message at its field, in the unit of the field.

    The last valid value stays in use. The entries are random with a fixed seed.
    """
    opened = visit(server.url)
    page, draw = opened.page, random.Random(19)
    for _ in range(selected(20, every=40)):
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


def test_the_address_contains_the_settings(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    type_in(page, "tilt", "-101.25")
    page.click("#waypoint")
    page.click("#dwell")
    type_in(page, "depth", "7.5")
    opened.wait(f"{PLANNED} && {IDLE}", seconds=60)
    address = page.url
    for _ in range(2):
        reloaded = visit(address)
        reloaded.wait(f"{PLANNED} && {IDLE}", seconds=60)
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
    opened.wait("document.getElementById('tilt-error').textContent !== ''")
    assert "deg" in page.inner_text("#tilt-error")
    assert page.locator("#outcome").bounding_box()["y"] < page.evaluate("scrollY + innerHeight")


def test_a_verdict_holds_for_its_settings_only(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    opened.wait(f"{PLANNED} && {IDLE}", seconds=60)
    page.click("#here")
    assert page.is_disabled("#save"), "a motion to its own start has length zero"
    assert "Move a slider" in page.inner_text("#why")
    assert page.is_visible("#stale")
    type_in(page, "tilt", "-100")
    opened.wait(f"{PLANNED} && {IDLE}")
    held: list[Any] = []
    page.route("**/plan", lambda route: held.append(route))
    for field in ("alpha", "beta", "tilt", "depth", "roll", "low", "payload"):
        before = page.input_value(f"#{field}-number")
        type_in(page, field, f"{float(before) + 0.2:.3f}")
        assert page.is_visible("#stale"), field
        type_in(page, field, before)


def test_cancel_and_plan_again(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    opened.wait(f"{PLANNED} && {IDLE}", seconds=60)
    page.evaluate(
        """() => {
          document.getElementById("plan").click();
          const cancel = document.getElementById("cancel");
          const wait = () => (cancel.disabled ? setTimeout(wait, 1) : cancel.click());
          wait();
        }"""
    )
    opened.wait("document.querySelector('.outcome').textContent === 'cancelled'", seconds=5)
    page.click("#plan")
    opened.wait(f"{PLANNED} && {IDLE}", seconds=60)


@pytest.mark.parametrize("width", [1280, 390])
def test_axe_finds_nothing_serious(visit: Open, server: ViewServer, width: int) -> None:
    opened = visit(server.url, width=width)
    assert serious(opened.page) == []
    opened.wait(f"{PLANNED} && {IDLE}", seconds=60)
    opened.page.click("#pin")
    opened.wait(f"document.querySelectorAll('#outcome tr:first-child td').length === 2 && {IDLE}")
    assert serious(opened.page) == [], "with curves of two plans, some below the window"


def test_a_text_is_edited_in_place(visit: Open, server: ViewServer) -> None:
    """A faulty text is refused beside its field.

    A valid text is planned and compared with the motion that is pinned.
    """
    opened = visit(server.url)
    page = opened.page
    time = pinned_time(opened)
    page.click("#source summary")
    opened.wait("document.getElementById('text').value !== ''")
    text = page.input_value("#text")
    page.fill("#text", text.replace("velocity: 65 deg/s", "velocity: 65 deg", 1))
    page.click("#apply")
    opened.wait("document.getElementById('text-error').textContent.includes('not a speed')")
    assert page.inner_text("#outcome tr:nth-child(2) td:last-child") == time
    page.fill("#text", text.replace("velocity: 65 deg/s", "velocity: 40 deg/s"))
    page.click("#apply")
    page.wait_for_url(lambda url: not url.startswith(f"{server.url}#"))
    opened.wait(f"{PLANNED} && {IDLE}", seconds=60)
    cells = page.locator("#outcome tr").nth(1).locator("td").all_inner_texts()
    assert cells[0] == time
    assert float(cells[1].split()[0]) > float(cells[0].split()[0])
    assert all("400" in text for text in opened.said)


def test_a_gear_hides_the_ratio_that_it_replaces(visit: Open, server: ViewServer) -> None:
    opened = visit(server.url)
    page = opened.page
    opened.wait(PLANNED, seconds=60)
    ratio = page.locator("[id='joints.roll.drive.geometry.ratio']")
    motors = page.inner_text("#outcome tr:last-child td")
    page.select_option("[id='joints.roll.drive.worm']", "worm m0.3 1:80")
    opened.wait(f"{PLANNED} && {IDLE}", seconds=60)
    assert not ratio.is_visible()
    assert page.inner_text("#outcome tr:last-child td") != motors
    page.select_option("[id='joints.roll.drive.worm']", "")
    opened.wait(f"{PLANNED} && {IDLE}", seconds=60)
    assert ratio.is_visible()
    assert page.inner_text("#outcome tr:last-child td") == motors
    assert opened.said == []


def test_real_figures_replace_stand_ins(visit: Open, server: ViewServer) -> None:
    """The verdict on the motors depends on fewer assumptions, and the address keeps the figures."""
    opened = visit(server.url)
    page = opened.page
    opened.wait(PLANNED, seconds=60)
    outcome = "#outcome tr:last-child td"
    assert "if 4 stand-in figures hold" in page.inner_text(outcome)
    page.click("#figures summary")
    figure = page.locator("[id='joints.roll.motor.max_torque']")
    figure.fill("90 mm")
    figure.blur()
    opened.wait("document.getElementById('joints.roll.motor.max_torque-error').textContent !== ''")
    assert page.inner_text(".outcome") == "not planned"
    figure.fill("90 mN*m")
    figure.blur()
    opened.wait(f"{PLANNED} && {IDLE}", seconds=60)
    assert page.inner_text("[id='joints.roll.motor.max_torque-error']") == ""
    assert "if 3 stand-in figures hold" in page.inner_text(outcome)
    assert "max_torque" in page.url
    page.select_option("[id='joints.roll.motor']", "maxon_ecx_torque_22_m")
    assert not figure.is_visible(), "the chosen motor has its own figures"
    assert all("400" in text for text in opened.said)

"""Unintended presses move nothing: held keys, double clicks, buttons that took a place.

The clock of the page stands still when a test stops it: the time between two presses is then
exactly what the test makes it, on a loaded machine too.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Locator, Page, expect
from support.panel.browser import Watched
from support.panel.page import (
    DRAWN,
    LOOK_MS,
    SETTLE_MS,
    given,
    in_control,
    press,
    running,
    settle,
    stand_still,
    state,
    turn_to,
    wait_until,
)
from support.panel.played_campaign import TRIP
from support.panel.played_rig import PlayedRig
from support.panel.served import ServedPanel

from rigd.remote.protocol.status import Interrupted, PromptView

SAFETY = tuple(
    PromptView(id=number, name=f"safe_{number}", kind="confirm", text=f"Safety question {number}?")
    for number in (1, 2, 3)
)


@pytest.fixture
def panel() -> Iterator[ServedPanel]:
    with ServedPanel(PlayedRig(prompts=SAFETY)) as served:
        yield served


@pytest.fixture
def clocked(watched: Watched) -> Watched:
    """A page with a clock to stop; one installed later would step, and let all buttons settle."""
    watched.page.clock.install()
    return watched


@pytest.fixture
def touched(browser: Browser) -> Iterator[Watched]:
    context = Watched(browser, 820, 1180, has_touch=True)
    context.page.clock.install()
    yield context
    context.context.close()


def middle(locator: Locator) -> tuple[float, float]:
    box = locator.bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def button(page: Page, name: str) -> Locator:
    return page.get_by_role("button", name=name, exact=True)


def tripped(panel: ServedPanel, watched: Watched) -> Page:
    """Return a page with control: an interlock waits, and an interrupted run."""
    run = panel.rig.runs[2].run
    panel.rig.interrupted = (Interrupted(run=run, reason="killed", trials_done=4, trials_total=10),)
    panel.rig.trips.append(TRIP.model_copy(update={"since_ns": 1}))
    page = in_control(panel, watched)
    expect(page.locator("#attention .card")).to_have_count(2)
    return page


def asked(panel: ServedPanel, watched: Watched) -> Page:
    """Return a page with control, before a rig that asks its first safety question."""
    page = in_control(panel, watched)
    turn_to(page, "Procedures")
    page.get_by_role("button", name=re.compile("Identification tests")).click()
    press(page, "Start…")
    press(page, "Start now")
    state(page, "Waiting for you")
    return page


def test_a_double_click_on_acknowledge_resumes_nothing(
    panel: ServedPanel, clocked: Watched
) -> None:
    page = tripped(panel, clocked)
    stand_still(page)
    settle(page)
    place = middle(button(page, "Acknowledge"))
    go_on = middle(button(page, "Continue it…"))
    page.mouse.dblclick(*place)
    expect(page.locator(".trip")).to_have_count(0)
    assert middle(button(page, "Continue it…")) == go_on, "nothing took the place of another"
    page.mouse.click(*place)
    page.clock.run_for(SETTLE_MS - 2 * LOOK_MS)
    page.mouse.click(*place)
    assert len(given(panel, "acknowledge")) == 1
    assert not given(panel, "run") and not given(panel, "resume_run")
    expect(page.get_by_role("dialog")).to_have_count(0)


def test_button_that_has_moved_takes_no_press_yet(panel: ServedPanel, clocked: Watched) -> None:
    page = tripped(panel, clocked)
    go_on = button(page, "Continue it…")
    stand_still(page)
    settle(page)
    before = middle(go_on)
    panel.rig.trip(TRIP.model_copy(update={"interlock": "overrun_near"}))
    expect(page.locator(".trip")).to_have_count(2)
    assert middle(go_on) != before
    page.mouse.click(*middle(go_on))
    expect(page.locator(".toast")).to_contain_text("did not count")
    assert not given(panel, "run")
    settle(page)
    page.mouse.click(*middle(go_on))
    expect(page.get_by_role("dialog")).to_be_visible()


def test_resuming_is_confirmed_with_all_that_will_happen(
    panel: ServedPanel, watched: Watched
) -> None:
    page = tripped(panel, watched)
    press(page, "Continue it…")
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("Continue constant current?")
    facts = dialog.locator(".facts")
    for text in ("LuGre omni-wheel rig", " ago", "killed", "6 of 10", "1.15\u202fm", "stone"):
        expect(facts).to_contain_text(text)
    assert not given(panel, "resume_run")
    press(page, "Cancel")
    expect(dialog).to_have_count(0)
    press(page, "Continue it…")
    expect(page.get_by_label("as the procedure specifies")).to_be_checked()
    page.get_by_label("the run continues without you").check()
    press(page, "Continue now")
    wanted = {"run": panel.rig.runs[2].run, "on_client_loss": "continue"}
    wait_until(lambda: given(panel, "resume_run") == [wanted])


def test_a_start_is_confirmed_with_all_parameters(panel: ServedPanel, watched: Watched) -> None:
    page = in_control(panel, watched)
    turn_to(page, "Procedures")
    page.get_by_role("button", name=re.compile("Identification tests")).click()
    page.get_by_label("brake at").fill("1.1")
    press(page, "Start…")
    facts = page.get_by_role("dialog").locator(".facts")
    for text in ("stone", "all of the sweep", "1.1\u202fm", "4\u202fs", "10", "1 min 33 s"):
        expect(facts).to_contain_text(text)
    closing = page.get_by_role("group", name="If you close this page, or it loses its connection")
    expect(closing.get_by_role("radio")).to_have_count(3)
    closing.get_by_label("the trial is finished, then the run stops").check()
    press(page, "Start now")
    wait_until(
        lambda: [item["on_client_loss"] for item in given(panel, "start")] == ["finish_trial"]
    )


def test_one_enter_held_answers_one_question(panel: ServedPanel, watched: Watched) -> None:
    page = asked(panel, watched)
    page.evaluate(DRAWN)
    assert page.evaluate("document.activeElement.tagName") != "BUTTON", "Yes has no focus"
    yes = button(page, "Yes, done")
    yes.and_(page.locator("[aria-disabled=false]")).focus()
    page.keyboard.down("Enter")
    for question in (2, 3):
        expect(page.get_by_role("heading", name=f"Safety question {question}?")).to_be_visible()
        page.evaluate(DRAWN)
        assert page.evaluate("document.activeElement.tagName") != "BUTTON", "Yes has no focus"
        yes.focus()
        settled = yes.and_(page.locator("[aria-disabled=false]"))
        for _ in range(10):
            page.keyboard.down("Enter")  # the browser repeats it
        settled.wait_for()
        for _ in range(10):
            page.keyboard.down("Enter")
        assert len(given(panel, "answer")) == question - 1
        page.keyboard.up("Enter")
        yes.focus()
        page.keyboard.down("Enter")
    page.keyboard.up("Enter")
    wait_until(lambda: len(given(panel, "answer")) == 3)


def test_enter_pressed_again_too_soon_answers_nothing(panel: ServedPanel, clocked: Watched) -> None:
    page = asked(panel, clocked)
    yes = button(page, "Yes, done")
    stand_still(page)
    settle(page)
    page.mouse.click(*middle(yes))
    expect(page.get_by_role("heading", name="Safety question 2?")).to_be_visible()
    for _ in range(5):  # a remote desktop repeats keys without reporting it
        yes.focus()
        page.keyboard.press("Enter")
        page.keyboard.press("Space")
        page.clock.run_for(SETTLE_MS // 2)
    assert len(given(panel, "answer")) == 1
    settle(page)
    page.keyboard.press("Enter")
    wait_until(lambda: len(given(panel, "answer")) == 2)


@pytest.mark.parametrize("key", ["Enter", "Space"])
def test_a_key_pressed_elsewhere_presses_no_button(
    panel: ServedPanel, watched: Watched, key: str
) -> None:
    page = asked(panel, watched)
    yes = button(page, "Yes, done")
    yes.and_(page.locator("[aria-disabled=false]")).wait_for()
    page.locator(".prompt").focus()
    page.keyboard.down(key)
    yes.focus()
    page.keyboard.down(key)
    page.keyboard.up(key)
    press(page, "Yes, done")
    expect(page.get_by_role("heading", name="Safety question 2?")).to_be_visible()
    assert len(given(panel, "answer")) == 1


def test_a_pointer_pressed_elsewhere_presses_no_button(
    panel: ServedPanel, watched: Watched
) -> None:
    page = asked(panel, watched)
    yes = button(page, "Yes, done")
    yes.and_(page.locator("[aria-disabled=false]")).wait_for()
    page.mouse.move(*middle(page.get_by_role("heading", name="Safety question 1?")))
    page.mouse.down()
    page.mouse.move(*middle(yes))
    page.mouse.up()
    assert not given(panel, "answer")


def test_enter_held_on_start_only_opens_the_dialog(panel: ServedPanel, watched: Watched) -> None:
    page = in_control(panel, watched)
    turn_to(page, "Procedures")
    page.get_by_role("button", name=re.compile("Identification tests")).click()
    button(page, "Start…").and_(page.locator("[aria-disabled=false]")).focus()
    page.keyboard.down("Enter")
    dialog = page.get_by_role("dialog")
    expect(dialog).to_be_visible()
    assert page.evaluate("document.activeElement.tagName") == "DIALOG"
    go = dialog.get_by_role("button", name="Start now")
    go.and_(page.locator("[aria-disabled=false]")).focus()
    for _ in range(10):
        page.keyboard.down("Enter")
    page.keyboard.up("Enter")
    assert not given(panel, "start")
    expect(dialog).to_be_visible()


def test_second_tap_does_not_answer_next_question(panel: ServedPanel, touched: Watched) -> None:
    page = asked(panel, touched)
    stand_still(page)
    settle(page)
    yes = middle(button(page, "Yes, done"))
    page.touchscreen.tap(*yes)
    expect(page.get_by_role("heading", name="Safety question 2?")).to_be_visible()
    assert middle(button(page, "Yes, done")) == yes, "the test taps where the next one stands"
    page.touchscreen.tap(*yes)
    page.clock.run_for(SETTLE_MS // 2)
    page.touchscreen.tap(*yes)
    assert len(given(panel, "answer")) == 1
    settle(page)
    page.touchscreen.tap(*yes)
    wait_until(lambda: len(given(panel, "answer")) == 2)


def test_button_uncovered_by_dialog_takes_no_press_yet(
    panel: ServedPanel, clocked: Watched
) -> None:
    page = running(panel, clocked)
    press(page, "Ada")
    stand_still(page)
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_have_count(0)
    page.mouse.click(*middle(button(page, "Pause")))
    assert not given(panel, "pause")
    settle(page)
    page.mouse.click(*middle(button(page, "Pause")))
    wait_until(lambda: len(given(panel, "pause")) == 1)


def test_every_button_but_the_stops_waits_at_first(panel: ServedPanel, watched: Watched) -> None:
    page = tripped(panel, watched)
    ready = page.locator("button:not([aria-disabled]):visible")
    harmless = (
        ".traces *, .trace-toggle, .picker *, .row-button, .run-search *, .user *, .sound, .stops *"
    )
    for name in ("Live", "Procedures", "Runs", "Events"):
        turn_to(page, name)
        assert page.locator("button[aria-disabled]:visible").count() >= 3
        unguarded = ready.and_(page.locator(f":not({harmless})"))
        expect(unguarded).to_have_count(0)


def test_stop_buttons_need_no_settling_time(panel: ServedPanel, clocked: Watched) -> None:
    page = running(panel, clocked)
    stand_still(page)
    panel.rig.trip()
    panel.rig.state = "running"
    expect(page.locator(".trip")).to_be_visible()
    page.mouse.click(*middle(page.locator(".stop-abort")))
    wait_until(lambda: len(given(panel, "abort")) == 1)

"""What waits for a person calls them."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Page, expect
from support.panel.browser import Watched
from support.panel.page import press, state, turn_to, wait_until
from support.panel.served import ServedPanel

#: Counts the tones that the page plays.
COUNT = """
window.tones = 0;
const start = OscillatorNode.prototype.start;
OscillatorNode.prototype.start = function (at) {
  if (this.context.state === "running") window.tones += 1;
  start.call(this, at);
};"""


@pytest.fixture
def heard(panel: ServedPanel, watched: Watched) -> Page:
    """Return a page with control whose tones are counted."""
    watched.context.add_init_script(COUNT)
    page = watched.enter(panel.links["operator"])
    press(page, "Take control")
    return page


def tones(page: Page) -> int:
    return int(page.evaluate("window.tones"))


def ask(page: Page) -> None:
    """Start a run that asks a question."""
    turn_to(page, "Procedures")
    page.get_by_role("button", name=re.compile("Identification tests")).click()
    press(page, "Start…")
    press(page, "Start now")
    state(page, "Waiting for you")


def test_waiting_question_is_audible_and_in_the_title(heard: Page) -> None:
    expect(heard.get_by_role("button", name="Sound on")).to_be_visible()
    assert tones(heard) == 0
    ask(heard)
    wait_until(lambda: tones(heard) == 2)
    expect(heard).to_have_title(re.compile("❗ Lay the stone floor"))
    expect(heard).to_have_title(re.compile("Waiting for you"))
    heard.get_by_label("stone").check()
    press(heard, "Answer")
    expect(heard.get_by_role("heading", name=re.compile("Weigh"))).to_be_visible()
    wait_until(lambda: tones(heard) == 4)


def test_unanswered_question_sounds_again(heard: Page) -> None:
    ask(heard)
    wait_until(lambda: tones(heard) >= 4)


def test_the_sound_can_be_switched_off_for_good(heard: Page) -> None:
    press(heard, "Sound on")
    ask(heard)
    expect(heard).to_have_title(re.compile("❗"))
    assert tones(heard) == 0
    heard.reload()
    expect(heard.get_by_role("button", name="Sound off")).to_be_visible()


def test_page_not_yet_allowed_to_play_reports_it(heard: Page, watched: Watched) -> None:
    heard.reload()
    silent = heard.get_by_role("button", name="Sound after a press")
    on = heard.get_by_role("button", name="Sound on")
    expect(silent.or_(on)).to_be_visible()
    heard.locator(".state-word").click()
    expect(on).to_be_visible()
    assert watched.complaints == []


def test_trip_makes_a_sound(panel: ServedPanel, heard: Page) -> None:
    panel.rig.trip()
    wait_until(lambda: tones(heard) == 4)

"""What a person does with the panel's page, and what they see."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from playwright.sync_api import Page, expect
from support.browser import PATIENCE_MS, Watched
from support.panel import ServedPanel

expect.set_options(timeout=PATIENCE_MS)

#: Returns when the page has been drawn again, twice; by its observers, as tests replace its clock.
DRAWN = """(async () => {
    const frame = () => new Promise(done => new IntersectionObserver(done).observe(document.body));
    await frame();
    await frame();
})()"""


def state(page: Page, text: str) -> None:
    """Wait until the state of the rig reads ``text``."""
    expect(page.locator(".state-word")).to_have_text(text)


def press(page: Page, name: str) -> None:
    """Press a button, once it takes presses; again if the page says that the press did not count.

    A button that was scrolled to takes none for a while, nor one that has just moved.
    """
    refused = page.get_by_text("That press did not count")
    expect(refused).to_have_count(0)
    _press(page, name)
    while refused.count():
        expect(refused).to_have_count(0)
        _press(page, name)


def _press(page: Page, name: str) -> None:
    button = page.get_by_role("button", name=name, exact=True)
    button.evaluate("one => one.scrollIntoView({block: 'nearest'})")
    page.evaluate(DRAWN)
    expect(button).to_be_enabled()  # or the click would scroll the page while it waits for that
    button.click()


def turn_to(page: Page, name: str) -> None:
    """Open another page of the panel."""
    page.get_by_role("link", name=name, exact=True).click()


def wait_until(condition: Callable[[], bool]) -> None:
    """Wait for ``condition``."""
    deadline = time.monotonic() + PATIENCE_MS / 1000
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def given(panel: ServedPanel, verb: str) -> list[dict[str, Any]]:
    """Return the arguments of each request ``verb`` that the rig has got."""
    return panel.rig.given(verb)


def in_control(panel: ServedPanel, watched: Watched) -> Page:
    """Return a page with control."""
    page = watched.enter(panel.links["operator"])
    press(page, "Take control")
    expect(page.locator("#control")).to_contain_text("You have control")
    return page


def running(panel: ServedPanel, watched: Watched) -> Page:
    """Return a page with control, before a rig that runs."""
    page = in_control(panel, watched)
    panel.rig.become("running")
    state(page, "Running")
    return page

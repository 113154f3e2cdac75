"""What a person does with the panel's page, and what they see."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from playwright.sync_api import Page, expect
from support.panel.browser import PATIENCE_MS, Watched
from support.panel.served import ServedPanel

expect.set_options(timeout=PATIENCE_MS)

#: Returns when the page has been drawn again, twice; by its observers, as tests replace its clock.
DRAWN = """(async () => {
    const frame = () => new Promise(done => new IntersectionObserver(done).observe(document.body));
    await frame();
    await frame();
})()"""

#: Words of a text that are broken within: each word has one box.
BROKEN = r"""(root) => {
  const bad = [];
  const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    for (const { 0: word, index } of walker.currentNode.textContent.matchAll(/\S+/g)) {
      const range = document.createRange();
      range.setStart(walker.currentNode, index);
      range.setEnd(walker.currentNode, index + word.length);
      // A first letter has a box of its own.
      const boxes = [...range.getClientRects()];
      const isBroken = Math.max(...boxes.map(b => b.top)) > Math.min(...boxes.map(b => b.bottom));
      if (isBroken) bad.push(word);
    }
  }
  return bad;
}"""

#: Within this time after a change of the page, a press counts for nothing, in ms.
SETTLE_MS = 600
#: The page checks the positions of its buttons at least this often, in ms.
LOOK_MS = 200
#: The clock is stopped so far ahead, in s: it cannot be stopped in the past.
AHEAD_S = 1.0
#: Returns when the page has got the panel's next message: it takes no silence for a lost link then.
HEARD = """async () => {
    const { watch } = await import("/static/js/store.js");
    let calls = -1;  // the first call is for what the page knows already
    await new Promise(done => watch("panel", () => ++calls && done()));
}"""


def stand_still(page: Page) -> None:
    """Let the page's clock, which a test has installed, stand from now on."""
    page.clock.pause_at(page.evaluate("Date.now()") / 1000 + AHEAD_S)


def settle(page: Page) -> None:
    """Let just so much time pass that buttons take presses, if nothing changes meanwhile."""
    page.evaluate(HEARD)
    page.clock.run_for(SETTLE_MS + 2 * LOOK_MS)


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

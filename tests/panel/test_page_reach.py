"""Everything on the page has a name, can be read, and is large enough to be touched."""

from __future__ import annotations

import re
from itertools import product

import pytest
from playwright.sync_api import expect
from support.panel.browser import Watched
from support.panel.page import DRAWN, running, turn_to
from support.panel.served import ServedPanel

#: Width and height in CSS pixels: a screen, a laptop, a tablet.
SIZES = [(1440, 900), (1024, 768), (768, 1024)]


def test_the_page_fits_and_can_be_touched(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    panel.rig.trip()
    expect(page.locator(".trip")).to_be_visible()
    for name, (width, height) in product(("Procedures", "Runs", "Events", "Live"), SIZES):
        turn_to(page, name)
        page.set_viewport_size({"width": width, "height": height})
        page.evaluate(DRAWN)
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= width, f"{name} is {wide} px wide"
        for button in ("Stop", "Abort", "E-stop"):
            box = page.get_by_role("button", name=button, exact=False).first.bounding_box()
            assert box is not None
            assert box["height"] >= 44 and box["width"] >= 44
            assert 0 <= box["y"] < 40 and box["x"] + box["width"] <= width
        if name == "Live":
            assert page.evaluate(SMALL, 44 if width < 1000 else 24) == []


#: Buttons and links lower than so many pixels.
SMALL = """least => [...document.querySelectorAll("button, a, input, select, summary")]
  .filter(one => one.offsetParent && !one.matches(".skip, [type=radio], [type=checkbox]"))
  .filter(one => one.getBoundingClientRect().height < least - 0.5)
  .map(one => one.outerHTML.slice(0, 120))"""

#: Words for users who cannot see: every control has a name, every field a label.
NAMELESS = """[...document.querySelectorAll("button, a, input, select, iframe, summary")]
  .filter(one => !one.labels?.length && !one.getAttribute("aria-label"))
  .filter(one => !one.textContent.trim() && !one.title)
  .map(one => one.outerHTML.slice(0, 120))"""

#: Text whose contrast to its ground is below 4.5 to 1 (WCAG 2.2, 1.4.3), as [contrast, text].
CONTRAST = """() => {
  const parse = (text) => text.match(/[\\d.]+/g).map(Number);
  const light = ([r, g, b]) => [r, g, b].map(v => v / 255)
    .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const ground = (one) => {
    for (let at = one; at; at = at.parentElement) {
      const found = parse(getComputedStyle(at).backgroundColor);
      if (found.length < 4 || found[3] > 0.5) return found;
    }
    return [255, 255, 255];
  };
  const bad = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const one = walker.currentNode.parentElement;
    if (!walker.currentNode.textContent.trim() || !one.offsetParent) continue;
    if (one.closest(":disabled, [data-stale], .unseen, .skip, script")) continue;
    const [a, b] = [light(parse(getComputedStyle(one).color)), light(ground(one))];
    const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (contrast < 4.5) bad.push([contrast.toFixed(2), one.textContent.slice(0, 40)]);
  }
  return bad;
}"""


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_everything_has_a_name_and_can_be_read(
    panel: ServedPanel, watched: Watched, theme: str
) -> None:
    watched.page.emulate_media(color_scheme="light" if theme == "light" else "dark")
    page = running(panel, watched)
    assert page.locator("html").get_attribute("data-theme") == theme
    panel.rig.trip()
    expect(page.locator(".trip")).to_be_visible()
    for name in ("Live", "Procedures", "Runs", "Events"):
        turn_to(page, name)
        if name == "Procedures":
            page.get_by_role("button", name=re.compile("Identification tests")).click()
            expect(page.get_by_label("floor")).to_be_visible()
        assert page.evaluate(NAMELESS) == []
        assert page.evaluate(CONTRAST) == []

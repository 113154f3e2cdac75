"""Nothing that must be read is cut or covered: from phones to wide screens, and much enlarged."""

from __future__ import annotations

import re
from itertools import pairwise, product

from playwright.sync_api import Browser, FloatRect, Locator, Page, expect
from support.panel.browser import Watched
from support.panel.page import BROKEN, DRAWN, in_control, press, running, state, turn_to
from support.panel.played_rig import PlayedRig
from support.panel.served import ServedPanel

from rigd.remote.protocol.status import PromptView

#: Width and height in CSS pixels: phones, a tablet, laptops, a screen; 1280 x 1024 at 400 %.
SIZES = [
    (320, 640), (390, 844), (768, 1024), (1280, 800), (1440, 900), (1920, 1080), (320, 256),
]  # fmt: skip
NARROW = [(320, 256), (320, 640), (390, 844), (768, 1024), (1280, 800)]

#: Fields whose content is wider than they are, as [id, width of content, width].
CUT = """() => [...document.querySelectorAll("input, select")]
  .filter(one => one.offsetParent && one.scrollWidth > one.clientWidth)
  .map(one => [one.id, one.scrollWidth, one.clientWidth])"""

#: Text of the head that something else covers, by what stands at the ends of each of its lines.
COVERED = """() => {
  const bad = [];
  for (const part of document.querySelectorAll(".state-word, .state-doing, .stops button")) {
    const box = part.getBoundingClientRect();
    for (const x of [box.left + 3, box.left + box.width / 2, box.right - 3]) {
      for (const y of [box.top + 3, box.bottom - 3]) {
        const top = document.elementFromPoint(x, y);
        if (!part.contains(top)) bad.push([part.className, x, y, top?.className]);
      }
    }
  }
  return bad;
}"""

#: Controls of the page that stand under the head once the keyboard comes to them.
UNDER = """() => {
  const head = document.querySelector(".head").getBoundingClientRect().bottom;
  const bad = [];
  for (const one of document.querySelectorAll("#attention :enabled, main :is(:enabled, summary)")) {
    if (!one.offsetParent || one.matches("[type=radio], option, fieldset")) continue;
    window.scrollTo(0, document.body.scrollHeight);
    one.focus();
    const box = one.getBoundingClientRect();
    const room = innerHeight - head;
    if (box.top < head - 0.5 && box.height < room) bad.push([one.outerHTML.slice(0, 80), box.top]);
  }
  return bad;
}"""


def box_of(locator: Locator) -> FloatRect:
    box = locator.bounding_box()
    assert box is not None
    return box


def form(page: Page) -> None:
    """Open a procedure's form, with long numbers in it."""
    turn_to(page, "Procedures")
    page.get_by_role("button", name=re.compile("Identification tests")).click()
    page.get_by_label("brake at").fill("1.15")
    page.get_by_label("current", exact=True).fill("-1.23e-5")
    press(page, "Dry run")
    expect(page.locator(".preview")).to_contain_text("Fit to run")


def resize(page: Page, width: int, height: int) -> None:
    page.set_viewport_size({"width": width, "height": height})
    page.evaluate(DRAWN)


def test_no_number_in_the_form_is_cut(panel: ServedPanel, watched: Watched) -> None:
    page = in_control(panel, watched)
    form(page)
    expect(page.locator(".peak-by").first).to_have_text("rig file")
    for width, height in SIZES:
        resize(page, width, height)
        assert page.evaluate(CUT) == [], f"at {width} x {height}"
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        for value in page.locator(".peak-values .whole").all():
            assert value.evaluate(BROKEN) == []
        field, preview = box_of(page.get_by_label("brake at")), box_of(page.locator(".preview"))
        assert width >= 1400 or preview["y"] > field["y"] + field["height"], "below the form"


def test_the_state_is_whole_and_uncovered_everywhere(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    panel.rig.trip()
    expect(page.locator(".trip")).to_be_visible()
    state(page, "Tripped")
    for name, (width, height) in product(("Live", "Procedures", "Runs", "Events"), NARROW):
        turn_to(page, name)
        resize(page, width, height)
        page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
        assert page.evaluate(COVERED) == [], f"at {width} x {height}"
        assert page.locator("#state").evaluate(BROKEN) == []
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(UNDER) == [], f"at {width} x {height}"
        assert box_of(page.locator(".head"))["height"] < 0.45 * height


def test_a_dialog_leaves_state_and_stops_uncovered(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    press(page, "Ada")
    for width, height in NARROW:
        resize(page, width, height)
        head, dialog = box_of(page.locator(".head")), box_of(page.get_by_role("dialog"))
        assert dialog["y"] >= head["y"] + head["height"]
        assert dialog["y"] + dialog["height"] <= height
        assert page.evaluate(COVERED) == [], f"at {width} x {height}"


def test_list_of_runs_beside_run_is_whole(panel: ServedPanel, watched: Watched) -> None:
    page = watched.enter(panel.links["operator"])
    turn_to(page, "Runs")
    page.locator(".row-button").first.wait_for()
    for width in (1201, 1280, 1440):
        page.set_viewport_size({"width": width, "height": 800})
        listed = page.locator(".run-list .scroll")
        assert listed.evaluate("one => one.scrollWidth - one.clientWidth") == 0
        assert box_of(page.locator("#page-runs .sheet"))["x"] > box_of(listed)["x"] + 400


def test_page_head_keeps_its_height(panel: ServedPanel, browser: Browser) -> None:
    watched = Watched(browser, 390, 844)
    page = running(panel, watched)
    heights = []
    for step in ("settle", "drive", "a step with a name that is longer than most of them are"):
        panel.rig.carriage.step = step
        panel.rig.show()
        expect(page.locator(".run .facts")).to_contain_text(step)
        heights.append(box_of(page.locator(".head"))["height"])
        panel.rig.state = "paused"  # the step stays
    assert all(abs(a - b) < 0.5 for a, b in pairwise(heights)), heights
    watched.context.close()


def test_question_with_long_word_is_not_cut(browser: Browser) -> None:
    text = f"Have you read https://lab.example/{'step-' * 60}?"
    prompt = PromptView(id=1, name="read", kind="confirm", text=text)
    with ServedPanel(PlayedRig(prompts=(prompt,))) as panel:
        watched = Watched(browser, 1280, 800)
        page = in_control(panel, watched)
        turn_to(page, "Procedures")
        page.get_by_role("button", name=re.compile("Identification tests")).click()
        press(page, "Start…")
        press(page, "Start now")
        state(page, "Waiting for you")
        expect(page.locator("#attention .card")).to_contain_text("step-step-")
        for width, height in SIZES:
            resize(page, width, height)
            assert page.evaluate("document.documentElement.scrollWidth") <= width
        watched.context.close()

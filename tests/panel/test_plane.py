"""The plane with the bodies of a rig, in a real browser."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Locator, Page, expect
from support.panel.browser import Watched
from support.panel.page import DRAWN, running, wait_until
from support.panel.played_bodies import RADIUS_M, STANDS, BodiesRig
from support.panel.served import ServedPanel

#: What is drawn in the colour of a trace: the box around it and how many pixels, in CSS pixels.
DRAWN_IN = """(canvas, name) => {
  const probe = document.createElement("i");
  probe.style.color = getComputedStyle(document.documentElement).getPropertyValue(name);
  document.body.append(probe);
  const wanted = getComputedStyle(probe).color.match(/\\d+/g).map(Number);
  probe.remove();
  const { width, height } = canvas;
  const copy = Object.assign(document.createElement("canvas"), { width, height });
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(canvas, 0, 0);
  const { data } = context.getImageData(0, 0, width, height);
  let [left, right, top, bottom, count] = [width, 0, height, 0, 0];
  for (let at = 0; at < data.length; at += 4) {
    // Fainter parts of a trail have the same colour, with less of it.
    if (data[at + 3] < 40 || wanted.some((part, i) => Math.abs(data[at + i] - part) > 12)) continue;
    const x = (at / 4) % width, y = Math.floor(at / 4 / width);
    [left, right] = [Math.min(left, x), Math.max(right, x)];
    [top, bottom] = [Math.min(top, y), Math.max(bottom, y)];
    count += 1;
  }
  const box = { x: (left + right) / 2, y: (top + bottom) / 2 };
  return { ...box, width: right - left, height: bottom - top, count };
}"""


@pytest.fixture
def panel() -> Iterator[ServedPanel]:
    with ServedPanel(BodiesRig()) as served:
        yield served


def chip(page: Page, body: str) -> Locator:
    return page.locator(".plane").get_by_role("button", name=re.compile(f"^{body}"))


def drawing(page: Page, place: int) -> dict[str, float]:
    """Return what the page has drawn of the body in that place."""
    found: dict[str, float] = page.locator(".plane canvas").evaluate(DRAWN_IN, f"--trace-{place}")
    return found


def bodies(panel: ServedPanel) -> BodiesRig:
    assert isinstance(panel.rig, BodiesRig)
    return panel.rig


def test_controller_shows_setpoint_value_and_limit(panel: ServedPanel, watched: Watched) -> None:
    page, rig = running(panel, watched), bodies(panel)
    row = page.locator(".controller-table tbody tr")
    expect(row).to_have_text(re.compile(r"governor\s*–\s*0\.800\s*rad/s\s*off"))
    rig.acts = 1.0
    expect(row).to_have_text(re.compile(r"governor\s*1\.000\s*0\.800\s*rad/s\s*acts"))
    rig.saturated = 1.0
    expect(row.locator(".lock-state")).to_have_text("at its highest output")


def test_bodies_stand_in_plane_until_they_are_lost(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    expect(chip(page, "standing")).to_contain_text("x −3.000, y 0.500, 90°")
    expect(chip(page, "hidden")).to_have_attribute("aria-pressed", "false")

    # After a whole turn.
    wait_until(lambda: _to_one_scale(drawing(page, 0), drawing(page, 1)))
    stands = drawing(page, 0)
    assert stands["height"] > 1.3 * stands["width"], "an arrow that points upwards"

    bodies(panel).covered = {"standing"}
    expect(chip(page, "standing")).to_contain_text(re.compile(r"not seen for \d+\.\d s"))
    expect(chip(page, "going round")).to_contain_text("°")
    page.evaluate(DRAWN)
    assert drawing(page, 0)["width"] > stands["width"], "crossed out"
    expect(page.locator(".plane canvas")).to_have_attribute(
        "aria-label", re.compile(r"standing: not seen for .* s; going round: x .*, y .*, .*°")
    )

    panel.rig.end()
    expect(chip(page, "going round")).to_contain_text("not seen for")
    assert watched.complaints == []


def _to_one_scale(stands: dict[str, float], circle: dict[str, float]) -> bool:
    """Return whether the circle is round, and the body that stands is where the circle puts it.

    The arrow on the circle may stand out of it by a quarter of a metre.
    """
    metre = max(circle["width"], 1.0) / (2 * RADIUS_M)
    away = [(stands["x"] - circle["x"]) / metre, (circle["y"] - stands["y"]) / metre]
    is_round = math.isclose(circle["width"], circle["height"], rel_tol=0.12)
    return is_round and away == pytest.approx(STANDS[:2], abs=0.25)


def test_bodies_shown_are_those_last_chosen(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    expect(chip(page, "going round")).to_contain_text("°")
    chip(page, "hidden").click()
    expect(chip(page, "hidden")).to_contain_text("°")
    chip(page, "going round").click()
    expect(chip(page, "going round")).not_to_contain_text("°")
    page.evaluate(DRAWN)
    assert drawing(page, 1)["count"] == 0

    page.reload()
    expect(chip(page, "hidden")).to_have_attribute("aria-pressed", "true")
    expect(chip(page, "going round")).to_have_attribute("aria-pressed", "false")

    for body in ("hidden", "standing"):
        chip(page, body).click()
    expect(page.locator(".plane canvas")).to_be_hidden()


def test_held_plane_shows_that_time(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    expect(chip(page, "standing")).to_contain_text("90°")
    page.get_by_role("button", name="Hold").click()
    bodies(panel).covered = {"standing", "going_round"}
    page.evaluate("new Promise(done => setTimeout(done, 1800))")
    expect(chip(page, "standing")).to_contain_text("90°")
    page.get_by_role("button", name="Live").click()
    expect(chip(page, "standing")).to_contain_text("not seen for")


@pytest.mark.parametrize(("width", "height"), [(320, 640), (390, 844), (1280, 800)])
def test_plane_has_room(panel: ServedPanel, watched: Watched, width: int, height: int) -> None:
    page = running(panel, watched)
    page.set_viewport_size({"width": width, "height": height})
    expect(chip(page, "standing")).to_contain_text("90°")
    box = page.locator(".plane canvas").bounding_box()
    assert box is not None
    assert box["height"] >= 150
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    row = page.locator(".channel-table tbody th").first
    assert row.evaluate("one => one.clientWidth") >= 60, "room for names of channels"

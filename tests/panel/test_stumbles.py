"""What a person at the page stumbles on, each seen by hand once, looked at here in a browser."""

from __future__ import annotations

import re
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect
from support.panel import played_rig
from support.panel.browser import Watched
from support.panel.page import (
    BROKEN,
    DRAWN,
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
from support.panel.played_campaign import LISTED, TRIP, run_line
from support.panel.played_rig import PlayedRig
from support.panel.served import ServedPanel

from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.status import CertificateView, Interrupted

#: Texts with less contrast than 4.5 to 1 on what is behind them, by WCAG 2.2 (relative luminance).
FAINT = """() => {
  const parse = (text) => {
    const [r, g, b, a = 1] = text.match(/[\\d.]+/g).map(Number);
    return [r, g, b, a];
  };
  const over = ([r, g, b, a], [x, y, z]) =>
    [r * a + x * (1 - a), g * a + y * (1 - a), b * a + z * (1 - a), 1];
  const luminance = (colour) => {
    const [r, g, b] = colour.map((part) => part / 255)
      .map((part) => (part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const bad = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.textContent.trim();
    const owner = walker.currentNode.parentElement;
    const isSeen = owner.checkVisibility({ visibilityProperty: true, opacityProperty: true });
    if (!text || !isSeen) continue;
    if (owner.closest(".unseen, option, .skip, iframe, noscript")) continue;
    const parts = [];
    for (let part = owner; part; part = part.parentElement) parts.push(part);
    let ground = [255, 255, 255, 1];
    let opacity = 1;
    for (const part of parts.reverse()) {
      const style = getComputedStyle(part);
      ground = over(parse(style.backgroundColor), ground);
      opacity *= Number(style.opacity);
    }
    const [r, g, b, a] = parse(getComputedStyle(owner).color);
    const ink = over([r, g, b, a * opacity], ground);
    const [light, dark] = [luminance(ink), luminance(ground)].sort((x, y) => y - x);
    const ratio = (light + 0.05) / (dark + 0.05);
    if (ratio < 4.5) bad.push([text.slice(0, 40), owner.className, Number(ratio.toFixed(2))]);
  }
  return bad;
}"""
#: By how many pixels the page is wider than its window.
SIDEWAYS = """() => Math.max(0, document.documentElement.scrollWidth - innerWidth)"""
#: A recording of which not even the beginning can be read.
UNREADABLE = run_line(
    "broken.mcap", "unreadable", procedure="", started_ns=0, duration_s=0.0, trials_done=0,
    trials_total=0, identifies=False, set="", specimen="", condition="damaged",
    problem="broken.mcap is damaged: bytes 400 to 700 cannot be read",
)  # fmt: skip
#: Keeps the name of the newest event that the page has got.
LISTEN = """async () => {
  const { watchEvents } = await import("/static/js/link.js");
  watchEvents(({ data }) => { globalThis.lastEvent = data.name; });
}"""
#: Whether an element is seen between the head and the lower edge.
SEEN = """one => {
  const { top, bottom } = one.getBoundingClientRect();
  const head = document.querySelector(".head").getBoundingClientRect().bottom;
  return top >= head - 1 && bottom <= innerHeight;
}"""


def button(page: Page, name: str) -> Locator:
    return page.get_by_role("button", name=name, exact=True)


def opened(page: Page) -> None:
    """Open the form of a procedure."""
    turn_to(page, "Procedures")
    page.get_by_role("button", name=re.compile("Identification tests")).click()
    expect(page.get_by_label("brake at")).to_be_visible()


def test_login_names_the_rig_before_entry(panel: ServedPanel, watched: Watched) -> None:
    watched.page.goto(panel.links["operator"])
    expect(watched.page.get_by_role("heading")).to_have_text(panel.rig.name)
    expect(watched.page).to_have_title(re.compile(panel.rig.name))


@pytest.mark.parametrize("width", [1280, 390])
def test_long_names_stay_within_the_page(browser: Browser, width: int) -> None:
    watched, rig = Watched(browser, width, 800), PlayedRig("R" + "x9-" * 20 + "end")
    rig.runs.insert(0, run_line("r" * 190 + ".mcap", procedure="p" * 60, specimen="S" * 60))
    with ServedPanel(rig) as panel:
        watched.page.goto(panel.links["operator"])
        assert watched.page.evaluate(SIDEWAYS) == 0
        page = watched.page
        page.get_by_label("Your name").fill("N" * 40)
        button(page, "Open the panel").click()
        turn_to(page, "Runs")
        page.locator(".run-list tbody tr button").first.click()
        expect(page.locator(".sheet h2").last).to_contain_text("pppp")
        assert page.evaluate(SIDEWAYS) == 0
    watched.context.close()


def test_unreadable_recording_offers_nothing_but_itself(
    panel: ServedPanel, watched: Watched
) -> None:
    panel.rig.runs.insert(0, UNREADABLE)
    page = in_control(panel, watched)
    turn_to(page, "Runs")
    row = page.locator(".run-list tbody tr").first
    expect(row).to_contain_text("broken.mcap")
    expect(row).not_to_contain_text("Jan")  # no date is no date of 1970
    row.get_by_role("button").click()
    sheet = page.locator(".sheet").last
    expect(sheet.get_by_role("heading")).to_have_text("broken.mcap")
    expect(sheet).to_contain_text("bytes 400 to 700 cannot be read")
    assert sheet.get_by_role("button").count() == 0
    expect(sheet).not_to_contain_text("analysis")


def test_events_make_no_rows_until_looked_at(panel: ServedPanel, watched: Watched) -> None:
    page = watched.enter(panel.links["operator"])
    page.evaluate(LISTEN)
    for first in range(1, 1101, 50):  # of more at once a slow page gets the newest alone
        for number in range(first, first + 50):
            panel.rig.emit("step", name=f"step {number}")
        page.wait_for_function(
            "newest => globalThis.lastEvent === newest", arg=f"step {first + 49}"
        )
    assert page.locator(".event-table tbody tr").count() == 0
    turn_to(page, "Events")
    rows = page.locator(".event-table tbody tr")
    expect(rows).to_have_count(1000)
    expect(rows.first).to_contain_text("step 1100")
    panel.rig.emit("step", name="one more")
    expect(rows.first).to_contain_text("one more")
    expect(rows).to_have_count(1000)


def test_lost_control_is_told_on_the_page(panel: ServedPanel, watched: Watched) -> None:
    page = in_control(panel, watched)
    (holder,) = filter(None, [panel.rig.lease.view().holder])
    panel.rig.lease.release(holder)  # as the daemon does after the silence of its client
    expect(page.locator("#toasts")).to_contain_text("You no longer have control")


def test_low_procedure_of_list_shows_its_form(
    panel: ServedPanel, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = LISTED.procedures[0]
    others = [first.model_copy(update={"title": f"Another number {n}"}) for n in range(30)]
    low = first.model_copy(update={"title": "The last of the list"})
    listed = LISTED.model_copy(update={"procedures": (*others, low)})
    monkeypatch.setattr(played_rig, "LISTED", listed)
    page = in_control(panel, watched)
    page.set_viewport_size({"width": 1280, "height": 800})
    turn_to(page, "Procedures")
    page.get_by_role("button", name=re.compile("The last of the list")).click()
    title = page.locator(".sheet article > h2")
    expect(title).to_be_visible()
    page.evaluate(DRAWN)
    assert title.evaluate(SEEN)


@pytest.mark.parametrize("pressed", ["Start…", "Dry run"])
def test_wrong_value_is_named_at_the_button(
    panel: ServedPanel, watched: Watched, pressed: str
) -> None:
    page = in_control(panel, watched)
    opened(page)
    page.get_by_label("brake at").fill("9")
    press(page, pressed)
    field = page.get_by_label("brake at")
    expect(field).to_be_focused()
    assert field.evaluate(SEEN)
    problem = page.locator(".sheet .row + .problem")
    expect(problem).to_contain_text("brake at: brake_at 9 m is above its max 1.25 m")
    assert not given(panel, "start") and not given(panel, "dry_run")
    field.fill("1.1")
    expect(problem).to_be_empty()


def test_wrong_seed_is_shown_in_closed_part(panel: ServedPanel, watched: Watched) -> None:
    page = in_control(panel, watched)
    opened(page)
    more = page.locator(".sheet summary", has_text="More choices")
    more.click()
    page.get_by_label("Seed").fill("first")
    more.click()
    press(page, "Start…")
    expect(page.get_by_label("Seed")).to_be_focused()


def start_below_the_screen(panel: ServedPanel, watched: Watched) -> tuple[Page, Locator]:
    """Return a page that stands still, and its button "Start…", to which one must scroll."""
    page = watched.page
    page.clock.install()
    in_control(panel, watched)
    opened(page)
    page.set_viewport_size({"width": 1280, "height": 420})
    stand_still(page)
    settle(page)
    return page, button(page, "Start…")


def press_where_it_stands(page: Page, target: Locator) -> None:
    """Press a place, without the scrolling and waiting of the test library."""
    page.evaluate(DRAWN)
    box = target.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + 9, box["y"] + 9)


def test_press_counts_at_once_after_own_scroll(panel: ServedPanel, watched: Watched) -> None:
    page, start = start_below_the_screen(panel, watched)
    before = page.evaluate("scrollY")
    page.mouse.move(900, 300)
    page.mouse.wheel(0, 300)
    wait_until(lambda: page.evaluate("scrollY") > before)
    press_where_it_stands(page, start)
    expect(page.get_by_role("dialog")).to_be_visible()


def test_press_after_scroll_of_page_counts_later(panel: ServedPanel, watched: Watched) -> None:
    page, start = start_below_the_screen(panel, watched)
    start.evaluate("one => one.scrollIntoView({block: 'center'})")
    press_where_it_stands(page, start)
    expect(page.locator(".toast")).to_contain_text("did not count")
    expect(page.get_by_role("dialog")).to_have_count(0)


def test_place_of_answer_says_so_and_closes(panel: ServedPanel, watched: Watched) -> None:
    page = watched.page
    page.clock.install()
    in_control(panel, watched)
    opened(page)
    press(page, "Start…")
    press(page, "Start now")
    page.get_by_label("stone").check()
    press(page, "Answer")
    page.locator("#prompt-value").fill("3960")
    stand_still(page)
    settle(page)
    button(page, "Answer").click()
    wait_until(lambda: len(given(panel, "answer")) == 2)
    expect(page.locator(".gone")).to_have_text("Answered: 3960")
    settle(page)
    expect(page.locator(".gone")).to_have_count(0)


def test_legend_after_trip_is_marked_old(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    chips = page.locator(".legend .chip")
    wait_until(lambda: re.search(r"\d", chips.first.inner_text()) is not None)
    expect(page.locator(".legend .chip[data-stale]")).to_have_count(0)
    panel.rig.trip()
    expect(page.locator(".legend .chip[data-stale]")).to_have_count(chips.count())


def test_changing_value_makes_no_new_nodes(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    value = page.locator(".channel-table tr", has_text="angle").locator(".value")
    expect(value).not_to_have_text("0.000")
    before = value.inner_text()
    value.evaluate("one => { window.node = one.firstChild; }")
    expect(value).not_to_have_text(before)
    assert value.evaluate("one => one.firstChild === window.node")


def test_no_command_of_terminal_is_advised(panel: ServedPanel, watched: Watched) -> None:
    page = in_control(panel, watched)
    opened(page)
    panel.rig.fails = "check"
    panel.rig.error = Refusal(
        Code.REFUSED, "it is not free",
        hint="ask for control (at a terminal: `rigd remote lease request`); give --plan FILE",
    )  # fmt: skip
    press(page, "Start…")
    expect(page.locator(".toast").last).to_have_text("it is not free – ask for control")


def test_rig_is_named_wherever_it_moves(panel: ServedPanel, watched: Watched) -> None:
    page = in_control(panel, watched)
    heading = page.get_by_role("heading", level=1)
    expect(heading).to_have_text("lugre-1 – LuGre omni-wheel rig, simulated")
    page.set_viewport_size({"width": 390, "height": 844})
    expect(heading).to_be_visible()
    opened(page)
    press(page, "Start…")
    expect(page.get_by_role("dialog").locator(".facts")).to_contain_text("lugre-1 – LuGre")


def test_ages_are_not_cut(panel: ServedPanel, watched: Watched) -> None:
    page = watched.enter(panel.links["operator"])
    page.locator(".channel-table .age").first.wait_for()
    seconds = [0.4, 31, 200, 3599, 40_000, 172_000, 9e6]
    for width in (390, 1280, 1440):
        page.set_viewport_size({"width": width, "height": 800})
        cut = page.evaluate(
            """async (seconds) => {
              const { age } = await import("/static/js/format.js");
              const cell = document.querySelector(".channel-table .age");
              return seconds.map(age).filter((text) => {
                cell.textContent = text;
                return cell.scrollWidth > cell.clientWidth;
              });
            }""",
            seconds,
        )
        assert cut == [], f"at {width}"


def test_killed_daemon_leaves_no_end_of_earlier_run(panel: ServedPanel, watched: Watched) -> None:
    rig = panel.rig
    page = watched.enter(panel.links["operator"])
    rig.become("running")
    rig.end("complete", "")
    verdict = page.locator(".interlocks .verdict")
    expect(verdict).to_contain_text("not watched since the run ended")
    daemon = rig.status().daemon
    rig.last = None
    rig.interrupted = (Interrupted(run=rig.run, reason="killed", trials_done=4, trials_total=10),)
    began_ns = rig.events[-1].t_ns + 60_000_000_000
    rig.told = {"daemon": daemon.model_copy(update={"pid": 2, "started_ns": began_ns})}
    rig.show()
    expect(verdict).to_contain_text("not watched: no run since the daemon started")
    expect(page.locator(".run")).to_contain_text("Interrupted run")
    expect(page.locator(".run")).to_contain_text("4 of 10 done")


def test_run_that_tripped_is_never_called_done(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    rig = panel.rig
    rig.trips.append(TRIP)
    rig.told = {"ending": "aborted", "coming_to_rest": True, "left_s": 1.0}
    rig.become("done")
    state(page, "Tripped")
    expect(page.locator(".state-doing")).to_contain_text("The rig comes to rest")
    expect(page.locator(".state-left")).to_be_empty()


def test_pause_states_its_time_and_setpoints(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    panel.rig.become("pausing")
    expect(page.locator(".state-left")).to_have_text("pauses within 12 s")
    panel.rig.become("paused")
    expect(page.locator(".run .facts")).to_contain_text(
        "wheel_servo.current 0\u202fA; then trial 2"
    )


@pytest.mark.parametrize(("days", "word"), [(3, "expires"), (-1, "expired")])
def test_certificate_of_daemon_is_shown_with_date(
    panel: ServedPanel, watched: Watched, days: int, word: str
) -> None:
    page = watched.enter(panel.links["operator"])
    until_ns = panel.rig.status().t_ns + days * 86_400 * 10**9
    view = CertificateView(whose="daemon", name="daemon.crt", until_ns=until_ns)
    panel.rig.certificates = (view,)
    panel.rig.show()
    card = page.locator("#attention .card")
    expect(card).to_contain_text(re.compile(rf"daemon.crt {word} on \d+ \w+ 20\d\d"))
    press(page, "Not now")
    expect(card).to_have_count(0)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_every_text_has_contrast(panel: ServedPanel, watched: Watched, theme: str) -> None:
    page = watched.page
    faint: dict[str, Any] = {}

    def look(where: str) -> None:
        page.evaluate(DRAWN)
        faint[where] = page.evaluate(FAINT)

    page.goto(panel.links["operator"])
    page.get_by_label("Your name").wait_for()
    page.evaluate("theme => rigdTheme.choose(theme)", theme)
    look("login")
    page.get_by_label("Your name").fill("Ada")
    button(page, "Open the panel").click()
    page.locator(".channel-table tr[data-stale]").first.wait_for()
    look("idle")
    press(page, "Take control")
    opened(page)
    press(page, "Dry run")
    expect(page.locator(".preview")).to_contain_text("Fit to run")
    look("dry run")
    page.get_by_label("brake at").fill("9")
    press(page, "Start…")
    look("wrong value")
    page.get_by_label("brake at").fill("1.1")
    press(page, "Start…")
    look("dialog")
    press(page, "Start now")
    state(page, "Waiting for you")
    look("question")
    panel.rig.prompt = None
    state(page, "Running")
    look("running")
    panel.rig.trip()
    state(page, "Tripped")
    look("tripped")
    for name in ("Runs", "Events"):
        turn_to(page, name)
        look(name)
    panel.line.is_cut = True
    state(page, "Not connected")
    turn_to(page, "Live")
    look("not connected")
    assert {where: found for where, found in faint.items() if found} == {}


def test_every_page_fits_a_phone(panel: ServedPanel, browser: Browser) -> None:
    watched = Watched(browser, 390, 844)
    page = in_control(panel, watched)
    opened(page)
    press(page, "Dry run")
    expect(page.locator(".preview")).to_contain_text("Fit to run")
    page.locator(".steps tbody").first.wait_for()
    shown = {
        "Procedures": page.locator(".steps tbody").first,
        "Runs": page.locator(".row-button").first,
        "Events": page.locator(".event-table tbody tr").first,
        "Live": page.locator(".legend .chip").first,
    }
    panel.rig.emit(
        "interlock", name="overrun_far", reason="carriage.position 1.68 m is above 1.65 m"
    )
    for name, part in shown.items():
        turn_to(page, name)
        part.wait_for()
        page.evaluate(DRAWN)
        assert page.evaluate("document.documentElement.scrollWidth") <= 390, name
        cut = page.evaluate("""() => [...document.querySelectorAll("main .scroll, main .panel")]
          .filter(one => one.offsetParent && one.scrollWidth > one.clientWidth)
          .map(one => [one.className, one.scrollWidth, one.clientWidth])""")
        assert cut == [], name
    names = page.locator(".channel-table tbody th").all()
    broken = [text for text in (name.evaluate(BROKEN) for name in names) if text]
    assert broken == [], "no word of a name is broken"
    watched.context.close()


def test_rig_can_be_called_by_its_name_alone(watched: Watched) -> None:
    with ServedPanel(PlayedRig(prompts=())) as panel:
        panel.rig.told = {"title": ""}
        page = watched.enter(panel.links["operator"])
        expect(page.get_by_role("heading", level=1)).to_have_text("lugre-1")

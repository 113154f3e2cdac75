"""The page in a real browser, before a played rig."""

from __future__ import annotations

import re
import time

import pytest
from playwright.sync_api import Browser, Page, Route, expect
from support.faults.stalls import witnessed
from support.panel.browser import Watched
from support.panel.page import given, in_control, press, running, state, turn_to, wait_until
from support.panel.played_campaign import TRIP, run_line
from support.panel.played_rig import PlayedRig
from support.panel.served import ServedPanel

from rigd.remote.protocol.results import StatedView
from rigd.remote.protocol.status import Interrupted

#: Keeps the connections of a page for live data.
SOCKETS = """
window.sockets = [];
window.WebSocket = class extends WebSocket {
  constructor(url) {
    super(url);
    if (url.endsWith("/api/live")) sockets.push(this);
  }
};
"""


def drawn(page: Page) -> int:
    return int(page.locator(".traces").get_attribute("data-drawn") or 0)


def test_run_from_choice_of_procedure_to_its_stop(panel: ServedPanel, watched: Watched) -> None:
    page = watched.enter(panel.links["operator"])
    assert "#" not in page.url, "the code does not stay in the address"
    state(page, "Idle")
    press(page, "Take control")
    expect(page.locator("#control")).to_contain_text("You have control")

    turn_to(page, "Procedures")
    page.get_by_role("button", name=re.compile("Identification tests")).click()
    page.get_by_label("floor").select_option("pvc")
    page.get_by_label("brake at").fill("9")
    page.get_by_label("brake at").blur()
    expect(page.locator("#parameter-brake_at-problem")).to_have_text(
        "brake_at 9 m is above its max 1.25 m"
    )
    page.get_by_label("brake at").fill("1,22")
    press(page, "Dry run")
    expect(page.locator(".preview")).to_contain_text("The run would fail")
    expect(page.locator(".preview")).to_contain_text("carriage.position above 1.3 m")
    page.get_by_label("brake at").fill("1.1")
    press(page, "Dry run")
    expect(page.locator(".preview")).to_contain_text("Fit to run")

    press(page, "Start…")
    press(page, "Start now")
    state(page, "Waiting for you")
    (start,) = given(panel, "start")
    assert start["set"] == {"floor": "pvc", "brake_at": "1.1 m"}
    assert "answers" not in start, "the person is asked, unless it says otherwise"

    page.get_by_label("stone").check()
    press(page, "Answer")
    expect(page.get_by_role("heading", name=re.compile("Weigh the carriage"))).to_be_visible()
    page.get_by_label("Answer", exact=True).fill("7000")
    press(page, "Answer")
    expect(page.locator(".prompt .problem")).to_have_text(
        "7000\u202fg is outside 1000\u202fg to 6000\u202fg."
    )
    page.get_by_label("Answer", exact=True).fill("3960,5")
    press(page, "Answer")
    state(page, "Running")
    assert [item["value"] for item in given(panel, "answer")] == ["stone", pytest.approx(3.9605)]

    expect(page.locator(".run .facts")).to_contain_text("0.55\u202fA")

    before = drawn(page)
    wait_until(lambda: drawn(page) > before + 10)
    picture = page.locator(".plot-canvas").first.screenshot()
    wait_until(lambda: page.locator(".plot-canvas").first.screenshot() != picture)
    expect(page.locator(".channel-table tr", has_text="angle").locator(".value")).not_to_have_text(
        "0.000"
    )

    press(page, "Pause")
    state(page, "Pausing")
    press(page, "Resume")
    state(page, "Running")
    panel.rig.can_hold = True
    press(page, "Pause")
    state(page, "Held")
    press(page, "Resume")
    state(page, "Running")
    press(page, "Stop")
    state(page, "Stopping")
    assert panel.rig.users("stop") == ["Ada"]
    assert watched.complaints == []
    assert all(url.startswith(panel.origin) for url in watched.asked), "without internet"


def test_what_the_lab_demands_is_asked(watched: Watched) -> None:
    rig = PlayedRig()
    rig.stated = (
        StatedView(name="meta.batch", required=True, doc="Batch of the supplier"),
        StatedView(name="meta.floor", choices=("wood", "steel")),
    )
    with ServedPanel(rig) as panel:
        page = in_control(panel, watched)
        turn_to(page, "Procedures")
        page.get_by_role("button", name=re.compile("Identification tests")).click()
        press(page, "Start…")
        dialog = page.get_by_role("dialog")
        expect(dialog).to_contain_text("Batch of the supplier")
        press(page, "Start now")
        expect(dialog.get_by_label("batch")).to_be_focused()
        assert given(panel, "start") == [], "what is required is missing"
        dialog.get_by_label("batch").fill("13")
        dialog.get_by_label("specimen").fill("W7")
        press(page, "Start now")
        expect(dialog).to_have_count(0)
        (start,) = given(panel, "start")
        assert (start["specimen"], start["meta"]) == ("W7", {"batch": "13"})
        assert "note" not in start


def test_choosing_the_open_procedure_keeps_typed_values(
    panel: ServedPanel, watched: Watched
) -> None:
    """A value that is lost unseen would be the default of the run that is started next."""
    page = in_control(panel, watched)
    turn_to(page, "Procedures")
    procedure = page.get_by_role("button", name=re.compile("Identification tests"))
    procedure.click()
    field = page.get_by_label("brake at")
    field.fill("1.1")
    asked = len(panel.line.verbs)
    procedure.click()
    wait_until(lambda: len(panel.line.verbs) > asked and procedure.is_enabled())
    expect(field).to_have_value("1.1")


def test_a_trip_is_acknowledged(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    panel.rig.trip()
    since_ns = panel.rig.trips[0].since_ns
    state(page, "Tripped")
    card = page.locator(".trip")
    expect(card).to_contain_text("Interlock overrun far aborted the run")
    expect(card).to_contain_text("1.68 m is above 1.65 m")
    expect(page.locator(".interlocks")).to_contain_text("overrun far tripped")
    press(page, "Acknowledge")
    expect(card).to_have_count(0)
    state(page, "Idle")
    (sent,) = given(panel, "acknowledge")
    assert sent["interlock"] == TRIP.interlock
    assert abs(sent["since_ns"] - since_ns) < 1000


def test_report_is_made_and_read_without_its_scripts(panel: ServedPanel, watched: Watched) -> None:
    page = watched.enter(panel.links["operator"])
    press(page, "Take control")
    turn_to(page, "Runs")
    page.locator(".run-list tbody tr").first.click()
    expect(page.locator(".sheet").last).to_contain_text("No report yet.")
    press(page, "Make the report")
    report = page.frame_locator(".report iframe")
    expect(report.get_by_role("heading")).to_have_text("LuGre model of constant_current")
    frame = next(item for item in page.frames if "/report" in item.url)
    assert frame.title() == "Report"
    assert any("script" in complaint for complaint in watched.complaints), (
        "the browser says that it blocked it"
    )
    with page.expect_download() as download:
        page.get_by_role("link", name=re.compile("Recording")).click()
    assert download.value.suggested_filename == panel.rig.runs[0].run


def test_calibration_is_written_once_confirmed(panel: ServedPanel, watched: Watched) -> None:
    page = in_control(panel, watched)
    turn_to(page, "Runs")
    page.locator(".run-list tbody tr button").nth(1).click()
    expect(page.get_by_role("button", name="Calibrate…")).to_have_count(0)  # measures no values
    page.locator(".run-list tbody tr button").first.click()
    press(page, "Calibrate…")
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("load_scale")
    for text in ("0.99862 ± 0.00070", "0.99901 ± 0.00070", "−0.4 u", "measured before", "(panel)"):
        expect(dialog).to_contain_text(text)
    look = "name => getComputedStyle(name, '::first-letter').textTransform"
    assert dialog.locator("dt").first.evaluate(look) == "none"  # load_scale, not Load_scale
    page.get_by_label("Valid for, in days").fill("0")
    press(page, "Write it")
    expect(dialog).to_be_visible()
    assert given(panel, "calibrate") == [{"run": panel.rig.runs[0].run}]
    page.get_by_label("Valid for, in days").fill("180")
    press(page, "Write it")
    expect(dialog).to_have_count(0)
    expect(page.locator("#toasts")).to_contain_text("bench.yaml is renewed")
    run = panel.rig.runs[0].run
    assert given(panel, "calibrate")[-1] == {"run": run, "days": 180, "write": True}


def test_past_run_is_drawn_without_control(panel: ServedPanel, watched: Watched) -> None:
    page = watched.enter(panel.links["operator"])
    turn_to(page, "Runs")
    page.locator(".run-list tbody tr").nth(2).click()
    expect(page.locator(".sheet").last).to_contain_text(
        "The procedure of this run has no analysis."
    )
    press(page, "Show the recording")
    report = page.frame_locator(".report iframe")
    expect(report.get_by_role("heading")).to_have_text("What was recorded")
    assert given(panel, "draw") == [{"run": panel.rig.runs[2].run}]
    assert given(panel, "lease_take") == []
    expect(page.get_by_role("button", name="Make the report")).to_have_count(0)
    page.locator(".run-list tbody tr").first.click()
    expect(page.locator(".sheet").last).to_contain_text("The person who has control can make it")
    page.locator(".run-list tbody tr").nth(2).click()
    expect(report.get_by_role("heading")).to_have_text("What was recorded")


def test_list_of_runs_shows_specimen_and_values(panel: ServedPanel, watched: Watched) -> None:
    page = watched.enter(panel.links["observer"])
    turn_to(page, "Runs")
    first = page.locator(".run-list tbody tr").first
    expect(first.locator("td .quiet")).to_have_text("W7, floor=pvc, current=0.9 A")


def test_list_and_sheet_state_file_of_run(watched: Watched) -> None:
    rig = PlayedRig()
    said = {"": "written by rigd, not checked since", "damaged": "damaged",
            "valid": "valid, written by another program"}  # fmt: skip
    rig.runs = [
        run_line(f"2026-11-0{day}_a.mcap", condition=condition)
        for day, condition in enumerate(said, 1)
    ]
    with ServedPanel(rig) as panel:
        page = watched.enter(panel.links["observer"])
        turn_to(page, "Runs")
        rows = page.locator(".run-list tbody tr")
        for condition, words in said.items():
            row = rows.nth(list(said).index(condition))
            cell = row.locator("td").nth(2)
            expect(cell).to_have_text(f"complete{f', file {condition}' if condition else ''}")
            row.get_by_role("button").click()
            expect(page.locator(".sheet > .quiet")).to_have_text(re.compile(rf"mcap: {words}$"))


def test_runs_are_searched_by_a_condition(panel: ServedPanel, watched: Watched) -> None:
    page = watched.enter(panel.links["operator"])
    turn_to(page, "Runs")
    lines = page.locator(".run-list tbody tr")
    field, wrong = page.get_by_label("Find"), page.locator(".run-list .problem")
    expect(lines).to_have_count(len(panel.rig.runs))
    field.fill("state == stopped")
    press(page, "Search")
    stopped = [run for run in panel.rig.runs if run.state == "stopped"]
    assert 0 < len(stopped) < len(panel.rig.runs)
    expect(lines).to_have_count(len(stopped))
    expect(wrong).to_be_hidden()
    field.fill("stat == stopped")
    press(page, "Search")
    expect(wrong).to_have_text("there is no field 'stat' – did you mean 'state'?")
    expect(lines).to_have_count(len(stopped))
    panel.rig.become("running")
    state(page, "Running")
    panel.rig.end("stopped", "")  # the list follows, and does not ask what is typed
    expect(lines).to_have_count(len(stopped) + 1)
    field.fill("state == nowhere")
    press(page, "Search")
    expect(lines).to_have_text(["No recordings match."])
    expect(wrong).to_be_hidden()
    field.fill("")
    field.press("Enter")
    expect(lines).to_have_count(len(panel.rig.runs))


def test_search_on_its_way_outlasts_a_run(panel: ServedPanel, watched: Watched) -> None:
    """The list is asked for again when a run begins: not for what was searched before."""
    page = watched.enter(panel.links["observer"])
    turn_to(page, "Runs")
    lines = page.locator(".run-list tbody tr")
    field = page.get_by_label("Find")
    field.fill("state == nowhere")
    press(page, "Search")
    expect(lines).to_have_text(["No recordings match."])
    held: list[Route] = []

    def hold(route: Route) -> None:
        if not held:
            held.append(route)
        else:
            route.continue_()

    watched.context.route("**/api/ask/runs", hold)
    field.fill("")
    with page.expect_request("**/api/ask/runs"):
        press(page, "Search")
    panel.rig.become("running")
    state(page, "Running")
    panel.rig.end("stopped", "")
    expect(lines).to_have_count(len(panel.rig.runs))
    held[0].continue_()
    expect(lines).to_have_count(len(panel.rig.runs))


def test_observer_compares_marked_runs(panel: ServedPanel, watched: Watched) -> None:
    page = watched.enter(panel.links["observer"])
    turn_to(page, "Runs")
    rows = page.locator(".run-list tbody tr")
    expect(page.get_by_role("button", name="Mark runs to compare")).to_be_disabled()
    for row in (0, 1):
        rows.nth(row).get_by_role("checkbox").check()
    press(page, "Compare 2 runs")
    report = page.frame_locator(".report iframe")
    expect(report.get_by_role("heading")).to_have_text("Comparison of campaigns")
    runs = [item.run for item in sorted(panel.rig.runs[:2], key=lambda item: item.started_ns)]
    assert given(panel, "compare")[0]["runs"] == runs
    rows.nth(2).get_by_role("checkbox").check()
    press(page, "Compare 3 runs")
    expect(page.locator(".sheet").last).to_contain_text("one has nothing to compare")


def test_interlocks_are_called_clear_only_while_watched(
    panel: ServedPanel, watched: Watched
) -> None:
    page = watched.enter(panel.links["operator"])
    verdict = page.locator(".interlocks .verdict")
    expect(verdict).to_have_text(re.compile("^not watched: no run since the daemon started, "))
    page.locator(".interlocks summary").click()
    expect(page.locator(".lock-state").first).to_have_text("not watched")
    panel.rig.become("preflight")
    expect(verdict).to_have_text("not watched yet")
    panel.rig.become("running")
    expect(verdict).to_have_text(re.compile(r"^all 4 clear, watched since \d\d:\d\d:\d\d$"))
    expect(page.locator(".lock-state").first).to_have_text("clear")
    panel.rig.end("complete", "")
    expect(verdict).to_have_text(re.compile(r"^not watched since the run ended, \d\d:"))
    panel.line.is_cut = True
    expect(verdict).to_have_text("not known")


def test_preflight_is_no_time_of_the_run(panel: ServedPanel, watched: Watched) -> None:
    page = watched.enter(panel.links["operator"])
    expect(page.locator(".no-data")).to_contain_text("Traces begin with the next run.")
    panel.rig.become("preflight")
    expect(page.locator(".no-data")).to_contain_text("Traces begin with this run.")
    expect(page.locator(".run .facts")).to_contain_text("counts once the rig is armed")
    panel.rig.become("running")
    expect(page.locator(".run .facts")).not_to_contain_text("counts once the rig is armed")


def test_events_stand_once_after_a_reconnection(watched: Watched) -> None:
    ahead_ns = [1_000_000_000, 0, 2_000_000_000]  # two processes report: times are not in order
    rig = PlayedRig(wall=lambda: time.time_ns() + ahead_ns[0])
    watched.page.add_init_script(SOCKETS)
    with ServedPanel(rig) as panel:
        page = watched.enter(panel.links["operator"])
        turn_to(page, "Events")
        rows = page.locator(".event-table tbody tr")
        for count in (1, 2):
            rig.emit("step", name=f"number {count}")
            expect(rows).to_have_count(count)
            del ahead_ns[0]
        page.evaluate("sockets[0].close()")
        wait_until(lambda: page.evaluate("sockets.length === 2 && sockets[1].readyState === 1"))
        rig.emit("step", name="number 3")
        expect(rows.filter(has_text="number 3")).to_have_count(1)
        expect(rows).to_have_count(3)


def test_an_interrupted_run_is_offered_and_can_wait(panel: ServedPanel, watched: Watched) -> None:
    run = panel.rig.runs[2].run
    panel.rig.interrupted = tuple(
        Interrupted(run=name, reason="killed", trials_done=4, trials_total=10)
        for name in (run, panel.rig.runs[5].run)
    )
    page = watched.enter(panel.links["operator"])
    press(page, "Take control")
    card = page.locator("#attention .card")
    expect(card).to_have_count(1)
    expect(card).to_contain_text("after 4 of 10 trials")
    expect(card).to_contain_text("1 more")
    press(page, "Not now")
    expect(card).to_have_count(0)
    turn_to(page, "Runs")
    page.locator(".run-list tbody tr").nth(2).click()
    press(page, "Continue it…")
    press(page, "Continue now")
    wait_until(lambda: given(panel, "resume_run") == [{"run": run}])


def test_control_changes_hands_between_two_browsers(
    panel: ServedPanel, browser: Browser, watched: Watched
) -> None:
    ada = watched.enter(panel.links["operator"], "Ada")
    press(ada, "Take control")
    press(ada, "Ada")
    press(ada, "Link to command")
    link = ada.locator("output.link code").inner_text()
    press(ada, "Close")
    second = Watched(browser)
    bob = second.enter(link, "Bob")
    expect(bob.locator("#control")).to_contain_text("Ada has control")
    press(bob, "Request it")
    expect(ada.locator("#attention")).to_contain_text("Bob requests control")
    press(ada, "Hand over")
    expect(bob.locator("#control")).to_contain_text("You have control")
    expect(ada.locator("#control")).to_contain_text("Bob has control")
    second.context.close()


def test_a_maintainer_takes_over_and_tares(browser: Browser, watched: Watched) -> None:
    rig = PlayedRig()
    rig.hold_lease("bob")
    with ServedPanel(rig, role="maintainer") as panel:
        page = watched.enter(panel.links["operator"])
        expect(page.locator("#control")).to_contain_text("bob has control")
        tare = page.get_by_role("button", name="scale: tare")
        expect(tare).to_be_disabled()
        press(page, "Take it from them")
        expect(page.locator("#control")).to_contain_text("You have control")
        tare.click()
        expect(page.locator(".toast")).to_contain_text("scale is tared")
        assert given(panel, "act") == [{"device": "scale", "action": "tare"}]


def test_watching_user_can_stop_and_nothing_else(panel: ServedPanel, watched: Watched) -> None:
    page = watched.enter(panel.links["observer"], "Olga")
    panel.rig.state = "running"
    panel.rig.trip()
    panel.rig.become("running")
    state(page, "Running")
    expect(page.get_by_role("button", name="Take control")).to_have_count(0)
    expect(page.get_by_role("button", name="Acknowledge")).to_be_disabled()
    expect(page.get_by_role("button", name="Pause")).to_be_disabled()
    press(page, "Stop")
    state(page, "Stopping")


def test_text_of_rig_is_never_markup(panel: ServedPanel, watched: Watched) -> None:
    evil = "<img src=x onerror=\"document.title='owned'\"><b>bold</b>"
    page = watched.enter(panel.links["operator"], evil[:40])
    panel.rig.trips.append(TRIP.model_copy(update={"message": evil}))
    panel.rig.emit(evil, name=evil, reason=evil)
    expect(page.locator(".trip")).to_contain_text("<b>bold</b>")
    turn_to(page, "Events")
    expect(page.locator(".event-table")).to_contain_text("<b>bold</b>")
    assert page.locator("b, img").count() == 0
    assert page.title() != "owned"


def test_text_of_rig_cannot_reverse_line(panel: ServedPanel, watched: Watched) -> None:
    said = "wheel\u202ecleaned"
    page = watched.enter(panel.links["operator"], "A. Miller")
    panel.rig.trips.append(TRIP.model_copy(update={"message": said}))
    panel.rig.emit("note", reason=said)
    expect(page.locator(".trip")).to_contain_text(r"wheel\u202ecleaned")
    turn_to(page, "Events")
    expect(page.locator(".event-table")).to_contain_text(r"wheel\u202ecleaned")
    assert "\u202e" not in page.locator("body").inner_text()


def test_traces_are_held_moved_zoomed_and_live_again(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    wait_until(lambda: drawn(page) > 20)
    press(page, "Hold")
    expect(page.locator(".behind")).to_contain_text("held at")
    before = drawn(page)
    page.wait_for_timeout(500)
    assert drawn(page) <= before + 1
    box = page.locator(".u-over").first.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 300, box["y"] + 20)
    page.mouse.wheel(0, -400)
    page.mouse.down()
    page.mouse.move(box["x"] + 400, box["y"] + 20, steps=4)
    page.mouse.up()
    wait_until(lambda: drawn(page) > before + 2)
    press(page, "Live")
    here = drawn(page)
    wait_until(lambda: drawn(page) > here + 5)
    page.get_by_role("button", name="Trace of carriage.speed").click()
    expect(page.locator(".legend", has_text="carriage.speed")).to_be_visible()
    page.reload()
    expect(page.locator(".legend", has_text="carriage.speed")).to_be_visible()


def test_slow_computer_gets_fewer_frames_close_to_now(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    wait_until(lambda: drawn(page) > 5)
    page.context.new_cdp_session(page).send("Emulation.setCPUThrottlingRate", {"rate": 10})
    page.wait_for_timeout(2000)
    with witnessed() as lost_s:
        begun, before = time.monotonic(), drawn(page)
        page.wait_for_timeout(4000)
        rate_hz = (drawn(page) - before) / (time.monotonic() - begun)
        age = page.locator(".channel-table tr", has_text="angle").locator(".age").inner_text()
        assert 0 < rate_hz < 25
        # Were everything sent as it comes, the page would by now be many seconds behind.
        assert float(age.split()[0]) < 3.0 + lost_s()
    state(page, "Running")

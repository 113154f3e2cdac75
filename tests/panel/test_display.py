"""How the page shows the values of channels, in a real browser."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

import pytest
from playwright.sync_api import expect
from support.panel.browser import Watched
from support.panel.page import press, running, turn_to
from support.panel.played_bodies import STREAMS, BodiesRig
from support.panel.played_campaign import dry_run
from support.panel.played_rig import PlayedRig
from support.panel.served import ServedPanel

from rigd.remote.protocol import Requester
from rigd.remote.protocol.arguments import NoArguments
from rigd.remote.protocol.results import ChannelView, Description, InterlockView, PeakView
from rigd.remote.protocol.verbs import Handlers

#: The channel gives 1.0, which is 9.55 rpm.
RPM = 0.104719755
SPEED = ChannelView(name="speed", unit="rad/s", display="rpm")
FAST = InterlockView(
    name="fast", source="motor.speed", low=-3000 * RPM, high=3000 * RPM, action="stop",
    priority="high", latch=False, message="The motor turns too fast.",
)  # fmt: skip


class TurningRig(BodiesRig):
    """Its motor is read in revolutions per minute."""

    def _describe(self, by: Requester, nothing: NoArguments) -> Description:
        found = super()._describe(by, nothing)
        motor = found.streams[0].model_copy(update={"channels": (SPEED,)})
        streams = (motor, *found.streams[1:])
        return found.model_copy(update={"streams": streams, "interlocks": (FAST,)})


class ClimbingRig(PlayedRig):
    """Its lift has narrow limits."""

    PEAK = PeakView(
        channel="lift.height", unit="m", lowest=-0.001, highest=0.004321, low=-0.0025, high=0.005,
        limit_by="rig file", inside=True,
    )  # fmt: skip

    def _table(self) -> Handlers:
        found = dry_run({}).model_copy(update={"peaks": (self.PEAK,)})
        return replace(super()._table(), dry_run=lambda *_: found)


@pytest.fixture
def panel() -> Iterator[ServedPanel]:
    with ServedPanel(TurningRig()) as served:
        yield served


def test_value_limit_and_trace_are_in_display_unit(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    row = page.locator(".channel-table tr", has_text="speed").first
    expect(row.locator(".value")).to_have_text("10")
    expect(row.locator("td.unit")).to_have_text("rpm")
    expect(row.locator(".limit")).to_have_attribute(
        "title", "Limits −3000 to 3000 rpm (interlock fast)"
    )
    plot = page.locator(".plot", has=page.locator(".plot-unit", has_text="rpm"))
    expect(plot.locator(".chip-value")).to_have_text("9.5")
    page.locator("summary", has_text="Interlocks").click()
    expect(page.locator(".interlock-table")).to_contain_text(
        "within −3000\u202frpm … 3000\u202frpm"
    )


def test_tiny_value_is_not_shown_as_zero(watched: Watched) -> None:
    rig = BodiesRig()
    rig.speed = 3e-7
    with ServedPanel(rig) as panel:
        page = running(panel, watched)
        row = page.locator(".channel-table tr", has_text="speed").first
        expect(row.locator(".value")).to_have_text("3·10⁻⁷")


def test_channel_shows_no_value_of_another(watched: Watched) -> None:
    rig = BodiesRig()
    with ServedPanel(rig) as panel:
        page = running(panel, watched)
        rows = page.locator(".channel-table tr")
        expect(rows.filter(has_text="speed").first.locator(".value")).to_have_text("1.000")
        rig.become("idle")  # no more frames
        torque = ChannelView(name="torque", unit="N m")
        motor = STREAMS[0].model_copy(update={"channels": (torque,)})
        rig.streams = (motor, *STREAMS[1:])
        rig.emit("streams", added=[])
        expect(rows.filter(has_text="torque").locator(".value")).to_have_text("–")


def test_limits_of_preview_have_its_unit(watched: Watched) -> None:
    with ServedPanel(ClimbingRig()) as panel:
        page = watched.enter(panel.links["operator"])
        turn_to(page, "Procedures")
        page.get_by_role("button", name=re.compile("Identification tests")).click()
        press(page, "Dry run")
        row = page.locator(".peak", has_text="lift.height")
        expect(row.locator(".peak-end").first).to_have_text("−2.5")
        expect(row.locator(".peak-end").last).to_have_text("5")
        expect(row.locator(".peak-values")).to_have_text("−1.000 … 4.321\u202fmm")

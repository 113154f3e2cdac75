"""The page shows a channel in the unit in which people read it, in a real browser."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import expect
from support.browser import Watched
from support.page import running
from support.panel import ServedPanel
from support.played_bodies import BodiesRig

from rigd.remote.protocol import Requester
from rigd.remote.protocol.arguments import NoArguments
from rigd.remote.protocol.results import ChannelView, Description, InterlockView

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

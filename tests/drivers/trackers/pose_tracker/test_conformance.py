"""The driver keeps the promises of the SDK, before a tracker that knows the format alone."""

from __future__ import annotations

from support.instruments.pose_sender import sending

from rigd.sdk.check import check_driver
from rigd_drivers.trackers.pose_tracker.driver import TrackedBody


def test_it_keeps_what_a_fast_driver_promises() -> None:
    report = check_driver(TrackedBody, peer=sending)
    # It moves nothing, so that nothing can be stuck, locked or unguarded.
    assert set(report.skipped) == {
        "safe while stuck",
        "ready is true",
        "watchdog that never acts",
        "refused",
        "another at open",
    }

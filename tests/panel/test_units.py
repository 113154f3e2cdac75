"""The page gets units as numbers: it converts quantities, also in degrees Celsius."""

from __future__ import annotations

import pytest
from pydantic import JsonValue

from rigd.panel.messages import PageDescription, PageDryRun, PageEvent, complete
from rigd.remote.protocol import VERSION, RigEvent, Role
from rigd.remote.protocol.results import (
    ChannelView,
    Description,
    DryRun,
    PeakView,
    StreamView,
)


@pytest.mark.parametrize(
    ("unit", "number", "si"),
    [("degC", 25.0, 298.15), ("degF", 212.0, 373.15), ("barg", 0.0, 101_325.0), ("mm", 5.0, 5e-3)],
)
def test_number_in_unit_becomes_si(unit: str, number: float, si: float) -> None:
    data: dict[str, JsonValue] = {"parameters": {"hot": si}, "units": {"hot": unit}}
    began = RigEvent(v=VERSION, seq=1, t_ns=1, kind="trial_start", trial=1, data=data)
    event = PageEvent.of(began)
    scale = event.scales["hot"]
    assert number * scale.factor + scale.offset == pytest.approx(si)


def test_channel_is_shown_in_its_display_unit() -> None:
    channels = (
        ChannelView(name="heat", unit="K", display="degC"),
        ChannelView(name="fan", unit="rad/s"),
    )
    stream = StreamView(number=0, name="oven", channels=channels, rate_hz=1.0)
    shown = complete(
        Description(rig="oven", title="", simulated=True, streams=(stream,), role=Role.OBSERVER)
    )
    assert isinstance(shown, PageDescription)
    heat, fan = shown.streams[0].channels
    assert (heat.display, heat.factor, heat.offset) == ("degC", 1.0, 273.15)
    assert (fan.display, fan.factor, fan.offset) == ("rad/s", 1.0, 0.0)


def test_peak_is_shown_in_its_display_unit() -> None:
    peak = PeakView(channel="oven.fan", unit="rad/s", display="rpm", lowest=0.0, highest=1.0,
                    low=None, high=2.0, limit_by="rig file", inside=True)  # fmt: skip
    shown = complete(DryRun(ok=True, duration_s=1.0, trials=1, steps=(), peaks=(peak,)))
    assert isinstance(shown, PageDryRun)
    assert shown.peaks[0].display == "rpm"
    assert shown.peaks[0].factor == pytest.approx(0.10472, rel=1e-4)

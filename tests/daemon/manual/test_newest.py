"""The newest value of a channel, its age and state; and parts of a rig."""

from __future__ import annotations

import re

import numpy as np
import pytest

from rigd.cli.views.readings import LineView, view_for
from rigd.config.loader import load_rig
from rigd.daemon.manual import Newest, Reading, check_action, chosen_channels, only
from rigd.engine.cycle.wiring import streams_of
from rigd.engine.sink import Rows
from rigd.model.channels import STALE
from rigd.model.errors import ConfigError
from rigd.model.rows import row_dtype

RIG = load_rig("lugre-1")
WIRE = load_rig("wire-1")
STREAM = {stream.name: stream for stream in streams_of(RIG)}["wheel_servo"]


def rows(*times_ns: int, current: float = 0.5, status: int = 7) -> Rows:
    made = np.zeros(len(times_ns), row_dtype(STREAM))
    made["t_ns"], made["current"], made["status"] = times_ns, current, status
    return made


def current(newest: Newest, now_ns: int) -> Reading:
    return next(
        reading for reading in newest.readings(now_ns) if reading.channel == "wheel_servo.current"
    )


def test_channel_has_no_row_then_value_that_ages() -> None:
    newest = Newest(RIG)
    assert current(newest, 0).state == "no row"
    newest.take("wheel_servo", rows(1_000_000, 2_000_000))
    reading = current(newest, 5_000_000)
    assert (reading.value, reading.unit, reading.status) == (0.5, "A", 7)
    assert reading.state == "ok"
    assert reading.age_s == pytest.approx(0.003)
    assert current(newest, 1_000_000_000).state == "stale"


def test_repeated_row_does_not_make_the_value_younger() -> None:
    newest = Newest(RIG)
    newest.take("wheel_servo", rows(1_000_000))
    newest.take("wheel_servo", rows(500_000_000, status=7 | STALE))
    reading = current(newest, 500_000_000)
    assert (reading.state, reading.status) == ("stale", 7)
    assert reading.age_s == pytest.approx(0.499)


def test_value_that_is_not_a_number_reads_none() -> None:
    newest = Newest(RIG)
    newest.take("wheel_servo", rows(1, current=float("nan")))
    assert current(newest, 2).state == "NaN"


def test_reading_is_printed_in_its_display_unit(capsys: pytest.CaptureFixture[str]) -> None:
    reading = Reading("oven.heat", 298.15, "K", 0.0, None, "ok", "degC")
    LineView().show(0, [reading], [])
    view_for(as_json=False, refresh=False).show(0, [reading], [])
    line, _, row = capsys.readouterr().out.splitlines()
    assert "oven.heat 25 degC" in line
    assert re.search(r"oven.heat\s+25\s+degC", row)
    view_for(as_json=True, refresh=False).show(0, [reading], [])
    assert '"value": 298.15, "unit": "K"' in capsys.readouterr().out  # programs read SI


def test_device_name_selects_all_its_channels() -> None:
    assert chosen_channels(RIG, ["wheel_encoder", "carriage.position"]) == [
        "wheel_encoder.angle",
        "wheel_encoder.counts",
        "carriage.position",
    ]
    with pytest.raises(ConfigError, match=r"no channel 'carriage\.positon'") as wrong:
        chosen_channels(RIG, ["carriage.positon"])
    assert "carriage.position" in str(wrong.value)


def test_part_of_rig_keeps_its_links_and_interlocks() -> None:
    part = only(WIRE, {"carriage", "scale"})
    assert list(part.devices) == ["carriage", "scale"]
    assert list(part.links) == ["encoder_bus"]
    names = {interlock.name for interlock in part.interlocks}
    assert names == {"overrun_far", "overrun_near", "carriage_silent"}


def test_unknown_action_is_refused_with_devices_having_it() -> None:
    check_action(WIRE, "scale", "tare")
    with pytest.raises(ConfigError, match="no action 'tare'") as wrong:
        check_action(WIRE, "wheel_servo", "tare")
    assert "scale" in str(wrong.value)
    with pytest.raises(ConfigError, match="no device 'scael'"):
        check_action(WIRE, "scael", "tare")
    with pytest.raises(ConfigError, match="no action 'dance'") as wrong:
        check_action(WIRE, "scale", "dance")
    assert "tare, zero" in str(wrong.value)

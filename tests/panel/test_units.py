"""The page gets units as numbers: it converts quantities, also in degrees Celsius."""

from __future__ import annotations

import pytest
from pydantic import JsonValue

from rigd.panel.messages import PageEvent
from rigd.remote.protocol import VERSION, RigEvent


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

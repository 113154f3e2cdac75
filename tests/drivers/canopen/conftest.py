"""A bus of scripted nodes behind a real CanBus."""

from __future__ import annotations

import time

import pytest
from support.can_bench import Clock, Connect
from support.can_script import ScriptedBus, ScriptedNode

from rigd_drivers.can_bus import CanBus, CanBusConfig


#: ``connect(*nodes)``: the nodes on a bus that is open, with the port that shows what was sent.
@pytest.fixture
def connect(monkeypatch: pytest.MonkeyPatch) -> Connect:
    def opened(*nodes: ScriptedNode, listen: bool = False) -> tuple[CanBus, ScriptedBus]:
        port = ScriptedBus(*nodes)
        monkeypatch.setattr("rigd_drivers.can_bus.open_port", lambda *_: port)
        bus = CanBus(CanBusConfig.model_validate({"interface": "scripted"}))
        if listen:
            bus.open()
        else:
            bus.open_second()
        return bus, port

    return opened


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(time, "monotonic_ns", clock)
    return clock

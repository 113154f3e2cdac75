"""A bus of scripted nodes behind a real CanBus."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from support.can.bench import Clock, Connect
from support.can.script import ScriptedBus, ScriptedNode, use

from rigd_drivers.can.bus import CanBus, CanBusConfig


#: ``connect(*nodes)``: the nodes on a bus that is open, with the port that shows what was sent.
@pytest.fixture
def connect(monkeypatch: pytest.MonkeyPatch) -> Iterator[Connect]:
    with ExitStack() as stack:

        def opened(
            *nodes: ScriptedNode, listen: bool = False, room: int | None = None
        ) -> tuple[CanBus, ScriptedBus]:
            port = use(ScriptedBus(*nodes, room=room), monkeypatch)
            bus = CanBus(CanBusConfig.model_validate({"interface": "scripted"}))
            stack.callback(bus.close)
            if listen:
                bus.open()
            else:
                bus.open_second()
            return bus, port

        yield opened


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(time, "monotonic_ns", clock)
    return clock

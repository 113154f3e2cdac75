"""The real driver in a real helper process against the simulated card: nothing is lost."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from support.cards.served import OnLoop, served
from support.recordings.blocks import device_of, until

from rigd.config.rig import DeviceConfig
from rigd.engine.slow.stand_ins import LatestRowProxy
from rigd.model.errors import LinkError
from rigd_drivers.cards.ni_daq import NiDaq
from rigd_drivers.cards.ni_daq.config import NiDaqConfig
from rigd_sim.wire.cards.ni import SimNi

from .conftest import Place

RATE_HZ = 9600.0
LSB_V = 20 / 2**14


@pytest.fixture
def card() -> Iterator[tuple[SimNi, OnLoop]]:
    volts = {f"ai{index}": (lambda value=float(index): value) for index in range(4)}
    part = SimNi("daq", volts)
    with served(part) as on_loop:
        yield part, on_loop


def daq(port: int, **options: object) -> DeviceConfig:
    inputs = [{"name": f"input_{index}", "channel": f"ai{index}"} for index in range(4)]
    given = {"server": f"127.0.0.1:{port}", "inputs": inputs, **options}
    return device_of("daq", NiDaq, NiDaqConfig.model_validate(given))


def test_four_inputs_at_9600_hz_without_loss(
    card: tuple[SimNi, OnLoop], placed: Callable[..., Place]
) -> None:
    device = daq(card[0].port, rate="9600 Hz")
    place = placed(device)
    latest = LatestRowProxy(device, place.slot)
    place.helper.start()
    assert place.helper.identity.startswith("USB-6009, serial number")
    assert place.helper.rate_hz == RATE_HZ
    until(lambda: latest.read(0) is not None)
    until(lambda: place.ring.head >= 3 * RATE_HZ)
    assert place.helper.poll() is None
    place.helper.stop()
    rows = place.ring.drain()
    assert place.ring.overruns == 0
    numbers = np.rint(rows["device_time"] * RATE_HZ)
    assert np.array_equal(numbers, np.arange(len(rows)))  # every sample, once, in order
    assert np.all(np.diff(rows["t_ns"]) > 0)
    for index in range(4):
        assert rows[f"input_{index}"].mean() == pytest.approx(index, abs=LSB_V)
    assert not rows["status"].any()


def test_an_overrun_of_the_card_ends_the_run(
    card: tuple[SimNi, OnLoop], placed: Callable[..., Place]
) -> None:
    part, on_loop = card
    place = placed(daq(part.port))
    place.helper.start()
    until(lambda: place.ring.head > 0)
    on_loop(lambda: part.inject("overrun"))
    until(lambda: place.helper.poll() is not None)
    assert str(place.helper.poll()).startswith("daq: NI card Dev1 on 127.0.0.1:")
    assert "overran: samples were lost" in str(place.helper.poll())
    until(lambda: on_loop(part.state)["tasks"] == 0)  # the task is cleared all the same


def test_wrong_card_is_refused_before_anything_is_read(
    card: tuple[SimNi, OnLoop], placed: Callable[..., Place]
) -> None:
    place = placed(daq(card[0].port, device="Dev7"))
    with pytest.raises(LinkError, match="daq: there is no NI card Dev7"):
        place.helper.start()
    assert place.ring.head == 0

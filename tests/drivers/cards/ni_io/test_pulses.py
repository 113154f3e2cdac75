"""Pulses that an NI card times, over NI's gRPC protocol."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest
from support.cards.card import serving
from support.cards.ni_card import Block, ServedCard, ni_card

from rigd.sdk import DeviceError
from rigd.sdk.check import Observed, Peer, check_driver
from rigd_drivers.cards.frequency import STANDING, CardFrequency, CardFrequencyConfig
from rigd_drivers.cards.ni_io.config import NiIoConfig
from rigd_drivers.cards.ni_io.link import NiIo
from rigd_sim.wire.cards.mf624_registers import Wires
from rigd_sim.wire.cards.ni_io import SimNiIo
from rigd_sim.wire.cards.ni_terminals import Terminals

FLOW = {"counter": 2, "name": "flow", "unit": "m^3/s", "scale": "0.5 cm^3/count"}


@pytest.fixture
def card() -> Iterator[ServedCard]:
    with ni_card(clock_ns=1) as found:
        yield found


@contextmanager
def opened(card: ServedCard, **options: Any) -> Iterator[CardFrequency]:
    """Yield a device on an open link."""
    link = card.link(watchdog=None)
    link.open()
    device = CardFrequency(CardFrequencyConfig.model_validate(options), link)
    device.open()
    yield device
    card.clear()
    with suppress(DeviceError):
        link.close()


def row_of(device: CardFrequency) -> list[float]:
    device.link.begin(0)
    return device.read(0)


def test_card_gives_the_flow(card: ServedCard) -> None:
    with opened(card, **FLOW) as device:
        assert row_of(device) == [0.0, 0.0, STANDING]
        card.pulse(2, 1, 0.5)
        assert row_of(device) == [0.0, 0.0, STANDING]
        card.pulse(2, 40, 0.5)
        assert row_of(device) == [pytest.approx(40e-6), pytest.approx(80.0), 0]


def test_cycle_without_pulses_does_not_wait(card: ServedCard) -> None:
    with opened(card, counter=0, slowest="1000 Hz") as device:
        card.pulse(0, 5, 0.1)
        row_of(device)
        card.pulse(0, 5, 0.1)
        assert row_of(device)[2] == 0
        rows = [row_of(device) for _ in range(50)]  # a call that waits fails after 0.15 s
        assert rows[-1] == [0.0, 0.0, STANDING]


def test_card_gives_width_and_duty(card: ServedCard) -> None:
    with opened(card, counter=3, width=True, slowest="1000 Hz") as device:
        card.block.duty = 0.3
        card.pulse(3, 1, 0.01)
        row_of(device)
        card.pulse(3, 10, 0.01)
        _, frequency, width, duty, status = row_of(device)
        assert frequency == pytest.approx(1000.0)
        assert width == pytest.approx(0.3e-3)
        assert duty == pytest.approx(0.3)
        assert status == 0


def test_pulses_between_are_not_lost(card: ServedCard) -> None:
    with opened(card, counter=0) as device:
        card.pulse(0, 1, 0.1)
        row_of(device)
        card.pulse(0, 1, 0.2)
        device.link.sample()  # for another device
        card.pulse(0, 1, 0.4)
        assert row_of(device)[1] == pytest.approx(1 / 0.3)


def test_pulses_too_fast_for_the_cycle_are_named(card: ServedCard) -> None:
    with opened(card, counter=0) as device:
        card.pulse(0, 100_001, 1.0)
        with pytest.raises(DeviceError, match="-200279") as caught:
            device.link.begin(0)
        assert "`card-pulses`" in str(caught.value.hint)


def test_card_without_that_counter_is_named(card: ServedCard) -> None:
    with (
        pytest.raises(DeviceError, match="does not exist: ctr5") as caught,
        opened(card, counter=5),
    ):
        pass
    assert "correct the number" in str(caught.value.hint)


@contextmanager
def running_meter() -> Iterator[Peer]:
    """Serve a card on which counter 2 gets 200 pulses per second, a quarter of them high."""
    wires = Wires(
        counts_in={2: lambda: time.monotonic_ns() // 5_000_000}, duty_in={2: lambda: 0.25}
    )
    part = SimNiIo("card", Terminals(wires, (), ()), Block())
    with serving(part) as loop:
        config = NiIoConfig(server=f"127.0.0.1:{part.port}")

        def stall(seconds: float) -> None:
            loop.call_soon_threadsafe(lambda: part.inject("stall", seconds=seconds))

        yield Peer(
            link=lambda: NiIo(config),
            faults={
                "dead": lambda: loop.call_soon_threadsafe(lambda: part.inject("removal")),
                "silent": lambda: stall(3.0),
                "late": lambda: stall(0.3),
            },
            observed=Observed,
        )


@pytest.mark.parametrize("width", [False, True])
def test_it_conforms(width: bool) -> None:
    config = CardFrequencyConfig.model_validate({**FLOW, "width": width})
    report = check_driver(CardFrequency, config, peer=running_meter)
    assert report.skipped.keys() == {
        "frozen", "garbled", "garbled at open", "ready is true", "safe while stuck",
        "watchdog that never acts", "refused", "another at open",
    }  # fmt: skip

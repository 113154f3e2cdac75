"""A sensor on CAN that a DBC describes: values, units, pages, wrong frames, silence."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import cantools
import pytest
from support.can.script import ScriptedBus, use
from support.cards.card import serving

from rigd.config.loader import load_rig
from rigd.model.errors import ConfigError
from rigd.sdk import LinkError, ProtocolError
from rigd.sdk.check import Peer, check_driver
from rigd_drivers.can.bus import CanBus, CanBusConfig
from rigd_drivers.can.message import CanMessage, CanMessageConfig
from rigd_sim.wire.can.dbc import SimDbcSensor
from rigd_sim.wire.can.hub import CanHub

DBC = """VERSION ""
NS_ :
BS_:
BU_: Sensor
BO_ 291 WheelLoad: 4 Sensor
 SG_ LoadForce : 0|16@1- (0.5,10) [-1000|1000] "N" Vector__XXX
 SG_ OilTemp : 16|8@1+ (1,-40) [-40|150] "\xb0C" Vector__XXX
 SG_ Odd : 24|8@1+ (1,0) [0|0] "foo" Vector__XXX
BO_ 2566844926 Paged: 3 Sensor
 SG_ Mux M : 0|8@1+ (1,0) [0|0] "" Vector__XXX
 SG_ SpeedA m0 : 8|16@1+ (0.1,0) [0|6000] "rpm" Vector__XXX
 SG_ SpeedB m1 : 8|16@1+ (0.1,0) [0|6000] "rpm" Vector__XXX
"""
LOAD, PAGED = 291, 2566844926  # bit 31 of the second: 29 bits
TWO_PI_60 = 0.10471975511965977


@pytest.fixture
def dbc(tmp_path: Path) -> Path:
    path = tmp_path / "sensor.dbc"
    path.write_bytes(DBC.encode("latin-1"))
    return path


def test_degrees_in_utf_8_are_read(dbc: Path) -> None:
    dbc.write_bytes(DBC.encode("utf-8"))
    assert config(dbc).read().signals[1].unit.to_si(0.0) == 273.15


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[CanBus, ScriptedBus]]:
    port = use(ScriptedBus(), monkeypatch)
    found = CanBus(CanBusConfig.model_validate({"interface": "scripted"}))
    found.open_second()
    yield found, port
    found.close()


def config(path: Path, **options: Any) -> CanMessageConfig:
    given = {"dbc": str(path), "message": "WheelLoad", "signals": ["LoadForce", "OilTemp"]}
    return CanMessageConfig.model_validate({**given, **options})


def row(driver: CanMessage) -> tuple[float, ...] | None:
    driver.link.begin(0)
    found = driver.read(0)
    driver.link.end(0)
    return None if found is None else tuple(found)


def frame(dbc: Path, message: str, **values: float) -> bytes:
    database: Any = cantools.database.load_file(dbc)
    return bytes(database.encode_message(message, values, strict=False))


def opened(
    bus: tuple[CanBus, ScriptedBus], dbc: Path, identifier: int, first: bytes, **options: Any
) -> CanMessage:
    driver = CanMessage(config(dbc, **options), bus[0])
    bus[1].say(identifier, first)
    driver.open()
    row(driver)
    return driver


def test_signals_become_channels_in_si(bus: tuple[CanBus, ScriptedBus], dbc: Path) -> None:
    data = frame(dbc, "WheelLoad", LoadForce=-123.5, OilTemp=21, Odd=0)
    driver = opened(bus, dbc, LOAD, data)
    force, temperature = driver.declaration.channels
    assert (force.name, force.unit, force.low, force.high) == ("load_force", "N", -1000, 1000)
    assert (temperature.name, temperature.unit) == ("oil_temp", "K")
    assert (temperature.low, temperature.high) == pytest.approx((233.15, 423.15))
    bus[1].say(LOAD, data)
    assert row(driver) == pytest.approx((-123.5, 294.15, 0))
    assert row(driver) is None
    assert driver.identity == "WheelLoad, 0x123, by sensor.dbc"


def test_value_outside_its_range_is_marked(bus: tuple[CanBus, ScriptedBus], dbc: Path) -> None:
    data = frame(dbc, "WheelLoad", LoadForce=-123.5, OilTemp=21, Odd=0)
    driver = opened(bus, dbc, LOAD, data)
    bus[1].say(LOAD, frame(dbc, "WheelLoad", LoadForce=1000.5, OilTemp=21, Odd=0))
    assert row(driver) == pytest.approx((1000.5, 294.15, 1))


def test_page_of_multiplexed_message_is_chosen(bus: tuple[CanBus, ScriptedBus], dbc: Path) -> None:
    first, second = (
        opened(bus, dbc, PAGED, frame(dbc, "Paged", **values), message="Paged", signals=(), page=p)
        for p, values in enumerate(({"Mux": 0, "SpeedA": 600}, {"Mux": 1, "SpeedB": 60}))
    )
    assert [item.name for item in second.declaration.channels] == ["speed_b"]
    bus[1].say(PAGED, frame(dbc, "Paged", Mux=0, SpeedA=1200))
    bus[1].say(PAGED, frame(dbc, "Paged", Mux=1, SpeedB=300))
    bus[1].say(PAGED, bytes([7, 0, 0]))  # a page that the DBC does not have
    first.link.begin(0)
    assert tuple(first.read(0) or ()) == pytest.approx((1200 * TWO_PI_60, 0))
    assert tuple(second.read(0) or ()) == pytest.approx((300 * TWO_PI_60, 0))


def test_wrong_length_is_marked_then_named(bus: tuple[CanBus, ScriptedBus], dbc: Path) -> None:
    data = frame(dbc, "WheelLoad", LoadForce=1, OilTemp=21, Odd=0)
    driver = opened(bus, dbc, LOAD, data)
    bus[1].say(LOAD, data[:3])
    bus[1].say(LOAD, data)
    assert row(driver) == pytest.approx((1.0, 294.15, 2))
    for _ in range(20):
        bus[1].say(LOAD, data[:3])
    with pytest.raises(ProtocolError, match=r"0x123 has 3 bytes, message WheelLoad .* has 4"):
        row(driver)


def test_unknown_identifiers_are_counted(bus: tuple[CanBus, ScriptedBus], dbc: Path) -> None:
    driver = opened(bus, dbc, LOAD, frame(dbc, "WheelLoad", LoadForce=1, OilTemp=21, Odd=0))
    before = bus[0].foreign
    bus[1].say(0x124, b"12345678")
    bus[1].say(0x8000_0123, b"1234")
    assert row(driver) is None
    assert bus[0].foreign == before + 2


def test_silent_sensor_is_named_at_open(bus: tuple[CanBus, ScriptedBus], dbc: Path) -> None:
    driver = CanMessage(config(dbc, timeout="0.05 s"), bus[0])
    with pytest.raises(LinkError, match=r"no 0x123, message WheelLoad, within 0\.05 s"):
        driver.open()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"dbc": "none.dbc"}, "there is no file"),
        ({"message": "Wheel"}, "has no message 'Wheel'; it has WheelLoad, Paged"),
        ({"signals": ["Load"]}, "carries no signal 'Load'; it carries LoadForce, OilTemp, Odd"),
        ({"signals": ["Odd"]}, r"signal Odd .* unit 'foo', which rigd does not know"),
        ({"signals": ["LoadForce"], "units": {"LoadForce": "kg"}}, "is in N; `units` gives it in"),
        ({"signals": ["LoadForce"], "units": {"LoadForce": "zz"}}, "unknown unit 'zz'"),
        ({"page": 1}, "has no multiplexer"),
        ({"message": "Paged", "signals": []}, "`page` is one of 0, 1, not none"),
        ({"message": "Paged", "signals": [], "page": 5}, "`page` is one of 0, 1, not 5"),
        ({"timeout": "0 s"}, "timeout"),
    ],
)
def test_what_the_dbc_has_not_is_refused(dbc: Path, options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        config(dbc, **options)


def test_file_that_is_no_dbc_is_refused(dbc: Path) -> None:
    dbc.write_text("BO_ oh")
    with pytest.raises(ValueError, match="is no DBC that can be read"):
        config(dbc)


def test_unit_given_by_hand_is_taken(dbc: Path) -> None:
    found = config(dbc, signals=["Odd"], units={"Odd": "mm"}).read()
    assert found.signals[0].channel.unit == "m"


RIG = """\
rig: can-1
title: A sensor on CAN
cycle: 100 Hz
simulation:
  model: wire-lugre
  folder: {folder}
  can_sensors:
    force: {{bus: encoder_bus, dbc: sensor.dbc, message: WheelLoad,
             values: {{LoadForce: 5, OilTemp: 20, Odd: 1}}}}
links:
  bus: {{type: can, options: {{interface: hub, channel: {folder}/encoder_bus}}}}
devices:
  force:
    driver: can-message
    link: bus
    options: {{dbc: sensor.dbc, message: WheelLoad, signals: [{signal}]}}
interlocks: []
"""


def test_rig_file_names_place_of_error(dbc: Path, tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text(RIG.format(folder=tmp_path, signal="LoadForce"))
    assert load_rig(rig).devices["force"].channels[0].name == "load_force"
    rig.write_text(RIG.format(folder=tmp_path, signal="Nothing"))
    with pytest.raises(ConfigError, match="carries no signal 'Nothing'") as caught:
        load_rig(rig)
    assert caught.value.place is not None


def sensor(folder: Path, dbc: Path) -> Callable[[], AbstractContextManager[Peer]]:
    """Return what starts a bus with the simulated sensor."""

    @contextmanager
    def start() -> Iterator[Peer]:
        path = folder / "bus"
        hub = CanHub("bus", path)
        part = SimDbcSensor("s", hub, dbc, "WheelLoad", {"LoadForce": 5, "OilTemp": 20, "Odd": 1})
        with serving(hub) as loop:
            asyncio.run_coroutine_threadsafe(part.start(), loop).result(10)

            def show(fault: str) -> Callable[[], object]:
                return lambda: loop.call_soon_threadsafe(part.inject, fault)

            options = {"interface": "hub", "channel": str(path), "sync": False}
            yield Peer(
                link=lambda: CanBus(CanBusConfig.model_validate(options)),
                faults={
                    "dead": lambda: asyncio.run_coroutine_threadsafe(hub.stop(), loop).result(10),
                    "silent": show("silent"),
                    "garbled": show("short"),
                },
            )
            asyncio.run_coroutine_threadsafe(part.stop(), loop).result(10)

    return start


def test_it_conforms(tmp_path: Path, dbc: Path) -> None:
    check_driver(CanMessage, config(dbc), peer=sensor(tmp_path, dbc))

"""The shipped maps: each is complete, and its addresses are those of the manual, less one."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import pytest

from rigd.model.errors import ConfigError
from rigd_drivers import device_file
from rigd_drivers.modbus.registers import Access, Register
from rigd_drivers.modbus.servo_map import ServoMap
from rigd_drivers.modbus.transmitter import TransmitterMap

M = TypeVar("M", ServoMap, TransmitterMap)

HOLDING = 40001  # number that manuals give the register at address 0


def shipped_map(name: str, kind: str, model: type[M]) -> M:
    """Return the shipped map of that name."""
    path = device_file.find(name, kind, Path("nowhere"))
    return device_file.read(path, model, path)


@pytest.mark.parametrize(
    ("name", "force", "status", "kind"),
    [
        # Laumas: 40007 status, 40010-40011 net weight; magnitude, sign in the status register.
        ("laumas-tlb4", 40010, 40007, "uint32"),
        # Seneca MI-005370: 40064-40065 net weight, 40078 status register.
        ("seneca-z-sg2", 40064, 40078, "float32"),
        # Tuna ID551PN, section 3.5: 40001-40002 display weight, 40005 status.
        ("tuna-id551", 40001, 40005, "float32"),
    ],
)
def test_shipped_transmitter_maps_match_their_manuals(
    name: str, force: int, status: int, kind: Any
) -> None:
    described = shipped_map(name, "modbus-transmitter", TransmitterMap)
    assert described.force == Register(address=force - HOLDING, type=kind)
    assert {flag.address for flag in described.status.values()} == {status - HOLDING}
    assert "manual" in described.source


@pytest.mark.parametrize(
    ("name", "setpoint", "watchdog"),
    [
        ("delta-asda-b", 0x0109, 0x0304),  # P1-09, P3-04
        ("schneider-atv320", 8602, 6005),  # LFRD, ttO
    ],
)
def test_shipped_drive_maps_match_their_manuals(name: str, setpoint: int, watchdog: int) -> None:
    described = shipped_map(name, "modbus-servo", ServoMap)
    assert described.setpoint.address == setpoint
    assert described.watchdog.time.address == watchdog
    assert described.scale == pytest.approx(0.10471975512)  # rpm


def test_unsigned_setpoint_register_is_refused(tmp_path: Path) -> None:
    shipped = device_file.find("schneider-atv320", "modbus-servo", Path("nowhere"))
    path = tmp_path / "map.yaml"
    text = shipped.read_text("utf-8").replace("type: int16", "type: uint16", 1)
    path.write_text(text)
    with pytest.raises(
        ConfigError, match=r"map\.yaml:17:3: setpoint: uint16 holds no negative speed"
    ):
        device_file.read(path, ServoMap, path)


def test_one_reading_is_asked_for_in_one_request() -> None:
    described = shipped_map("laumas-tlb4", "modbus-transmitter", TransmitterMap)
    (read,) = described.reads(described.polled())
    assert (read.first, read.request.pdu.hex()) == (6, "0300060005")


def access(**options: object) -> Access:
    return Access.model_validate({"title": "t", "source": "s"} | options)


@pytest.mark.parametrize(
    ("options", "spans", "blocks"),
    [
        ({}, [range(0, 2), range(2, 4)], [(0, 4)]),
        ({}, [range(0, 2), range(3, 5)], [(0, 2), (3, 2)]),
        ({"bridge": 1}, [range(3, 5), range(0, 2)], [(0, 5)]),
        ({"max_registers": 3}, [range(0, 2), range(2, 4)], [(0, 2), (2, 2)]),
        ({}, [range(0, 1), range(0, 1), range(0, 4), range(1, 2)], [(0, 4)]),
    ],
)
def test_reads_cover_all_registers_within_size_without_tearing(
    options: dict[str, object], spans: list[range], blocks: list[tuple[int, int]]
) -> None:
    reads = access(**options).reads(spans)
    assert [(r.first, (r.request.reply_size - 2) // 2) for r in reads] == blocks


@pytest.mark.parametrize(
    ("kind", "value", "words"),
    [
        ("int16", -2, (0xFFFE,)),
        ("uint16", 65535, (0xFFFF,)),
        ("int32", -2, (0xFFFF, 0xFFFE)),
        ("uint32", 0x12345678, (0x1234, 0x5678)),
        ("float32", -12.5, (0xC148, 0x0000)),  # IEEE 754: sign, 1.5625 x 2^3
    ],
)
def test_register_encodes_and_decodes_both_word_orders(
    kind: Any, value: float, words: tuple[int, ...]
) -> None:
    register = Register(address=10, type=kind)
    assert register.encode(value, "high-first") == words
    assert register.encode(value, "low-first") == words[::-1]
    stored = dict(enumerate(words, 10))
    assert register.decode(stored, "high-first") == value


def test_number_beyond_register_range_is_refused() -> None:
    with pytest.raises(ValueError, match="40000 does not fit into int16"):
        Register(address=0, type="int16").encode(40000, "high-first")

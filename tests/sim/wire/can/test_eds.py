"""The shipped EDS files describe the simulated devices; read by canopen, a third party."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from canopen.objectdictionary import datatypes
from canopen.objectdictionary.eds import import_eds

from rigd_sim.wire.can.canopen.dictionary import Entry, Kind, Text
from rigd_sim.wire.can.canopen.node import CanopenNode
from rigd_sim.wire.can.drive import Cia402Drive, Mode, Motor, Ratings, Sensed
from rigd_sim.wire.can.encoder import Cia406Encoder, Scale
from rigd_sim.wire.can.hub import CanHub

EDS = Path(__file__).parents[4] / "configs" / "eds"
NODE = 5
#: Objects that differ between exemplars: a file of them all gives no value.
PLATE = {
    (0x1018, 4), (0x6073, 0), (0x6075, 0), (0x6076, 0), (0x6502, 0), (0x6501, 0), (0x6004, 0),
    (0x6001, 0), (0x6002, 0),
}  # fmt: skip
TYPES = {
    Kind.I8: datatypes.INTEGER8,
    Kind.U8: datatypes.UNSIGNED8,
    Kind.I16: datatypes.INTEGER16,
    Kind.U16: datatypes.UNSIGNED16,
    Kind.I32: datatypes.INTEGER32,
    Kind.U32: datatypes.UNSIGNED32,
}


def servo(hub: CanHub) -> CanopenNode:
    motor = Motor(lambda _: Sensed(0, 0.0, 0.0), lambda _t, _d: None)
    return Cia402Drive("servo", hub, NODE, motor, Ratings(Mode.CST, 2.0, 3.0, 0.04, 1024))


def encoder(hub: CanHub) -> CanopenNode:
    return Cia406Encoder("encoder", hub, NODE, lambda _: 0.0, Scale(1024, 4096))


def rules(entry: Entry) -> dict[str, object]:
    text = isinstance(entry, Text)
    plate = (entry.index, entry.sub) in PLATE or (entry.index == 0x608F and entry.sub)
    return {
        "data_type": datatypes.VISIBLE_STRING if text else TYPES[entry.kind],
        "access_type": "const" if text else "rw" if entry.writable else "ro",
        "pdo_mappable": entry.mappable,
        "min": entry.low,
        "max": entry.high,
        "default": None if plate else entry.text.decode() if isinstance(entry, Text)
        else entry.value,
    }  # fmt: skip


@pytest.mark.parametrize(("name", "make"), [("rigd_servo", servo), ("rigd_encoder", encoder)])
def test_shipped_eds_matches_simulated_device(
    tmp_path: Path, name: str, make: Callable[[CanHub], CanopenNode]
) -> None:
    node = make(CanHub("hub", tmp_path / "hub"))
    entries = {at: each for at, each in node.dictionary._entries.items() if at[0] >= 0x1000}
    od = import_eds(EDS / f"{name}.eds", NODE)
    described = {
        (each.index, each.subindex): each
        for whole in od.values() if whole.index >= 0x1000
        for each in ([whole] if not hasattr(whole, "subindices") else whole.subindices.values())
    }  # fmt: skip
    assert described.keys() == entries.keys()
    for at, entry in entries.items():
        found = {rule: getattr(described[at], rule) for rule in rules(entry)}
        assert found == rules(entry), f"{at[0]:04X}:{at[1]:02X}"
    info, told = od.device_information, node.identity
    assert (info.vendor_number, info.product_number) == (told.vendor, told.product)
    assert info.revision_number == told.revision

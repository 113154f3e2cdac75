"""docs/faults.md lists every fault of every simulated device, in the words of the simulation."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
from support.wire import all_parts

from rigd_sim.approach_angle.wire_relay import SimRelay
from rigd_sim.lugre.card import LugreWiring
from rigd_sim.wire.can.canopen.misbehaviour import FAULTS
from rigd_sim.wire.can.dbc import SimDbcSensor
from rigd_sim.wire.can.drive import Cia402Drive
from rigd_sim.wire.can.encoder import Cia406Encoder
from rigd_sim.wire.can.hub import CanHub
from rigd_sim.wire.can.transmitter import Cia404Transmitter
from rigd_sim.wire.cards.labjack import SimLabjack
from rigd_sim.wire.cards.mf624_registers import Mf624Registers
from rigd_sim.wire.cards.ni import SimNi
from rigd_sim.wire.cards.ni_terminals import Terminals
from rigd_sim.wire.instruments.lines import SimLines
from rigd_sim.wire.instruments.oven import SimOven
from rigd_sim.wire.instruments.scale import SimScale
from rigd_sim.wire.instruments.supply import SimSupply
from rigd_sim.wire.modbus.part import LINE_FAULTS
from rigd_sim.wire.modbus.servo import SimModbusServo
from rigd_sim.wire.modbus.transmitter import SimModbusTransmitter
from rigd_sim.wire.tracker import SimTracker

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "faults.md"


def beyond(faults: Mapping[str, str], common: Mapping[str, str]) -> Mapping[str, str]:
    return {name: what for name, what in faults.items() if name not in common}


LISTS: Mapping[str, Mapping[str, str]] = {
    "CAN bus": CanHub.faults,
    "CANopen node": FAULTS,
    "CiA 402 servo": beyond(Cia402Drive.faults, FAULTS),
    "CiA 406 encoder": beyond(Cia406Encoder.faults, FAULTS),
    "CiA 404 transmitter": beyond(Cia404Transmitter.faults, FAULTS),
    "Sensor of a DBC file": SimDbcSensor.faults,
    "NI card": SimNi.faults,
    "NI card that drives": {**Terminals.faults, "stall": "answers are held back (seconds)"},
    "LabJack": beyond(SimLabjack.faults, LINE_FAULTS),
    "Relay": SimRelay.faults,
    "Scale": SimScale.faults,
    "Device that sends lines": SimLines.faults,
    "Supply": SimSupply.faults,
    "Oven": SimOven.faults,
    "Camera tracker": SimTracker.faults,
    "Modbus line": LINE_FAULTS,
    "Modbus transmitter": beyond(SimModbusTransmitter.faults, LINE_FAULTS),
    "Modbus servo": beyond(SimModbusServo.faults, LINE_FAULTS),
    "Register card": {**Mf624Registers.faults, **LugreWiring.faults},
}


def test_every_simulated_device_has_its_faults_listed() -> None:
    listed = {item for faults in LISTS.values() for item in faults.items()}
    assert {item for part in all_parts() for item in part.faults.items()} <= listed


def table(faults: Mapping[str, str]) -> str:
    rows = [f"| `{name}` | {what.replace('|', chr(92) + '|')} |" for name, what in faults.items()]
    return "\n".join(["| fault | what happens |", "|---|---|", *rows])


@pytest.mark.parametrize("title", LISTS)
def test_fault_list_of_device_is_complete(title: str) -> None:
    expected = f"### {title}\n\n{table(LISTS[title])}\n\n"
    assert expected in DOCUMENT.read_text("utf-8") + "\n"

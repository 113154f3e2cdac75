"""A node of another author: canopen's own, made of the shipped EDS, on python-can's virtual bus."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import canopen
import pytest
from canopen.sdo.base import SdoRecord, SdoVariable
from support.can.eds import SHIPPED, write_eds

from rigd.sdk import ProtocolError
from rigd_drivers.can.bus import CanBus, CanBusConfig
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.canopen.pdo import SYNCHRONOUS, Pdo
from rigd_drivers.can.canopen.sheet import read_sheet
from rigd_drivers.can.node import HEARTBEAT_MS, Node
from rigd_drivers.can.pdo import configure

NODE = 5
SERIAL = 4711


@pytest.fixture
def local(request: pytest.FixtureRequest) -> Iterator[canopen.LocalNode]:
    """The node, on a bus of its own."""
    network = canopen.Network()
    network.connect(interface="virtual", channel=request.node.name)
    node = network.create_node(NODE, str(SHIPPED / "rigd_servo.eds"))
    identity = node.sdo[0x1018]
    assert isinstance(identity, SdoRecord)
    identity[4].raw = SERIAL
    yield node
    node.nmt.stop_heartbeat()
    network.disconnect()


@pytest.fixture
def bus(request: pytest.FixtureRequest, local: canopen.LocalNode) -> Iterator[CanBus]:
    """That bus as rigd opens it."""
    bus = CanBus(CanBusConfig(interface="virtual", channel=request.node.name))
    bus.open_second()
    yield bus
    bus.close()


def kept(local: canopen.LocalNode, name: int | str) -> object:
    """Return what the node has at ``name``, by canopen's own reading."""
    variable = local.sdo[name]
    assert isinstance(variable, SdoVariable)
    return variable.raw


def test_foreign_node_opens_as_device_of_its_eds(bus: CanBus, local: canopen.LocalNode) -> None:
    node = Node(bus, NODE, read_sheet(SHIPPED / "rigd_servo.eds"))
    node.open("servo", 402, SERIAL)
    assert node.identity == (
        "rigd simulated servo, vendor 0x52494744, product 0x402, revision 0x10000, "
        "serial number 4711"
    )
    assert kept(local, 0x1017) == HEARTBEAT_MS
    node.start()
    assert local.nmt.state == "OPERATIONAL"


def test_node_keeps_the_written_value(bus: CanBus, local: canopen.LocalNode) -> None:
    node = Node(bus, NODE, read_sheet(SHIPPED / "rigd_servo.eds"))
    node.attach()
    node.ensure(objects.TARGET_TORQUE, -1000)
    assert kept(local, "Target torque") == -1000
    node.ensure(objects.ABORT_CONNECTION_OPTION, 2)
    assert kept(local, "Abort connection option code") == 2
    pdo = Pdo(1, True, 0x180 + NODE, SYNCHRONOUS, (objects.STATUSWORD, objects.POSITION))
    configure(node, pdo)
    local.tpdo.read()
    names = [variable.name for variable in local.tpdo[1]]
    assert names == ["Statusword", "Position actual value"]
    assert (local.tpdo[1].cob_id, local.tpdo[1].enabled) == (0x180 + NODE, True)


def test_eds_forbids_refused_access(bus: CanBus, local: canopen.LocalNode, tmp_path: Path) -> None:
    forbidden = [
        (Entry(0x2345, 0, "H", "none"), 0),
        (Entry(0x1018, 9, "I", "none"), 0),
        (objects.STATUSWORD, 0),
    ]
    asked, checked = Node(bus, NODE), Node(bus, NODE, read_sheet(SHIPPED / "rigd_servo.eds"))
    asked.attach()
    for entry, value in forbidden:
        with pytest.raises(ProtocolError, match=r"refuses writing .* abort 0x06"):
            asked.write(entry, value)
        with pytest.raises(ProtocolError, match=r"rigd_servo\.eds(:\d+)?: "):
            checked.write(entry, value)
    path = write_eds(tmp_path / "other.eds", {"DeviceInfo/VendorNumber": "0x9A"})
    with pytest.raises(ProtocolError, match=r"vendor is 0x52494744, other\.eds"):
        Node(bus, NODE, read_sheet(path)).open("servo", 402, SERIAL)

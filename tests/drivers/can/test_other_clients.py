"""Other SDO clients, masters and nodes: theirs is not ours; who commands our drives is refused."""

from __future__ import annotations

import threading
from collections.abc import Callable

import canopen
import pytest
from canopen.sdo.base import SdoRecord
from canopen.sdo.exceptions import SdoError
from support.can.bench import Connect, cycle, wheel
from support.can.eds import SHIPPED
from support.can.foreign import FOREIGN
from support.can.script import ScriptedNode, servo

from rigd.sdk import LinkError, ProtocolError
from rigd_drivers.can.bus import CanBus, CanBusConfig
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.canopen.sheet import read_sheet
from rigd_drivers.can.node import Node
from rigd_drivers.can.profile import EncoderProfile

DEVICE_TYPE = bytes.fromhex("43 00 10 00 92 01 02 00")
#: Replies of node 1 to other clients, when ours is for 1000:00.
REPLIES = {
    "abort of another entry": "80 18 10 04 00 00 01 06",
    "another entry": "43 18 10 04 67 12 00 00",
    "another sub-index": "43 00 10 01 67 12 00 00",
    "a write of the same entry": "60 00 10 00 00 00 00 00",
    "a segment": "01 74 65 73 74 00 00 00",
    "a segment that was taken": "30 00 00 00 00 00 00 00",
    "begin of a block upload": "C6 08 10 00 0E 00 00 00",
    "a segment of a block": "83 00 10 74 65 73 74 00",
    "a block that was taken": "A2 7F 7F 00 00 00 00 00",
}


def asked(connect: Connect, answers: Callable[[bytes], list[str]], **options: object) -> Node:
    """Node 1, which answers as told, in front of what it answers by itself."""

    class Answering(ScriptedNode):
        def hear(self, identifier: int, data: bytes) -> None:
            if identifier == 0x601:
                self.outputs.extend((0x581, bytes.fromhex(each)) for each in answers(data))
            super().hear(identifier, data)

    bus, _ = connect(Answering(1, servo().objects, **options))  # type: ignore[arg-type]
    node = Node(bus, 1)
    node.attach()
    node.sdo_timeout_s = 0.02
    return node


@pytest.mark.parametrize("reply", REPLIES.values(), ids=REPLIES)
def test_reply_to_another_client_is_passed_over(connect: Connect, reply: str) -> None:
    node = asked(connect, lambda request: [reply])
    assert node.read(objects.DEVICE_TYPE) == 0x0002_0192


@pytest.mark.parametrize("reply", REPLIES.values(), ids=REPLIES)
def test_time_out_beside_another_client_names_it(connect: Connect, reply: str) -> None:
    node = asked(connect, lambda request: [reply], silent=True)
    with pytest.raises(LinkError, match="another SDO client talks to it") as caught:
        node.read(objects.DEVICE_TYPE)
    assert "wiring" not in (caught.value.hint or "")


def test_own_abort_is_heard_among_others(connect: Connect) -> None:
    node = asked(connect, lambda request: [REPLIES["abort of another entry"]])
    with pytest.raises(ProtocolError, match="the object does not exist"):
        node.read(objects.Entry(0x2345, 6, "H", "missing"))


def test_node_that_drops_our_request_is_asked_again(connect: Connect) -> None:
    dropped: list[bytes] = []

    class Busy(ScriptedNode):
        def hear(self, identifier: int, data: bytes) -> None:
            if identifier == 0x601 and not dropped:
                dropped.append(data)
                port.say(0x601, "40 41 60 00 00 00 00 00")
            else:
                super().hear(identifier, data)

    bus, port = connect(Busy(1, servo().objects), listen=True)
    node = Node(bus, 1)
    node.attach()
    node.sdo_timeout_s = 0.02
    assert node.read(objects.DEVICE_TYPE) == 0x0002_0192


def test_write_that_acts_is_sent_once(connect: Connect) -> None:
    sent: list[bytes] = []

    class Acting(ScriptedNode):
        def hear(self, identifier: int, data: bytes) -> None:
            if identifier == 0x601 and data[0] >> 5 == 1:
                sent.append(data)  # its answer is lost, beside one to another client
                port.say(0x601, "40 41 60 00 00 00 00 00")
            else:
                super().hear(identifier, data)

    bus, port = connect(Acting(1, servo().objects | {(0x2000, 0): b"\0"}), listen=True)
    node = Node(bus, 1)
    node.attach()
    node.sdo_timeout_s = 0.02
    step = {"object": "2000:00", "type": "uint8", "value": 1, "name": "step", "keeps": False}
    profile = EncoderProfile.model_validate({"title": "stepper", "source": "test", "setup": [step]})
    with pytest.raises(LinkError, match="another SDO client"):
        profile.prepare(node)
    assert len(sent) == 1


def test_segments_beside_another_client_are_read_anew(connect: Connect) -> None:
    replies = iter([
        "41 08 10 00 06 00 00 00", "01 66 6f 72 65 69 67 00",  # 7 bytes of another transfer
        "41 08 10 00 04 00 00 00", "07 74 65 73 74 00 00 00",
    ])  # fmt: skip

    class Mixing(ScriptedNode):
        def hear(self, identifier: int, data: bytes) -> None:
            if identifier == 0x601 and data[0] != 0x80:
                if data[0] == 0x60 and len(port.sent) < 3:
                    port.say(0x601, "60 00 00 00 00 00 00 00")
                self.outputs.append((0x581, bytes.fromhex(next(replies))))

    bus, port = connect(Mixing(1, {}), listen=True)
    node = Node(bus, 1)
    node.attach()
    assert node._upload(0x1008, 0).data == b"test"


def test_reply_to_another_client_is_no_twin(connect: Connect) -> None:
    node = asked(
        connect,
        lambda request: ["43 18 10 02 00 00 00 00"] if request[1:4] == b"\x18\x10\x04" else [],
    )
    node.open("wheel", 402, None)


#: What another master may do to a drive of ours, and what is then told.
DANGERS = {
    "PDO": (0x201, "0f 00 e8 03", "sends RPDO1, the setpoints of node 1"),
    "SDO": (0x601, "2b 40 60 00 0f 00 00 00", "writes object 6040:00 of node 1 by SDO"),
    "block": (0x601, "c2 40 60 00 02 00 00 00", "writes object 6040:00 of node 1 by SDO"),
    "NMT": (0x000, "02 01", "sends NMT commands to node 1"),
    "all": (0x000, "02 00", "sends NMT commands"),
}


@pytest.mark.parametrize(("identifier", "data", "does"), DANGERS.values(), ids=DANGERS)
def test_other_master_of_our_drive_ends_run(
    connect: Connect, identifier: int, data: str, does: str
) -> None:
    bus, port = connect(servo(), listen=True)
    driver = wheel(bus)
    driver.open()
    port.say(identifier, data)
    with pytest.raises(LinkError, match=f"another rigd .*drives .*: it {does}"):
        cycle(driver, port, 0.0)


def test_order_heard_before_node_was_claimed_counts(connect: Connect) -> None:
    bus, port = connect(servo(), listen=True)
    port.say(0x000, "80 01")
    port.say(0x000, "80 09")
    bus.begin(0)
    with pytest.raises(LinkError, match="sends NMT commands to node 1"):
        wheel(bus).open()


def test_traffic_of_others_is_no_fault(connect: Connect) -> None:
    bus, port = connect(servo(), listen=True)
    driver = wheel(bus)
    driver.open()
    others = [*FOREIGN, (0x601, "40 41 60 00 00 00 00 00"), (0x000, "01 3c")]
    for frame in others:
        port.say(*frame)
    before = bus.foreign
    cycle(driver, port, 0.0)
    assert bus.foreign - before == len(others) - 1  # of our node is the request of a client
    assert bus.errors == 0


def test_rig_opens_while_another_stack_asks_the_node(request: pytest.FixtureRequest) -> None:
    channel = request.node.name
    network, other = canopen.Network(), canopen.Network()
    network.connect(interface="virtual", channel=channel)
    other.connect(interface="virtual", channel=channel)
    sheet = str(SHIPPED / "rigd_servo.eds")
    identity = network.create_node(5, sheet).sdo[0x1018]
    assert isinstance(identity, SdoRecord)
    identity[4].raw = 4711
    client = other.add_node(5, sheet)
    ended = threading.Event()

    def ask() -> None:
        client.sdo.MAX_RETRIES = 0
        while not ended.wait(0.01):
            try:
                client.sdo.upload(0x1018, 2)
            except SdoError:
                continue

    thread = threading.Thread(target=ask)
    bus = CanBus(CanBusConfig(interface="virtual", channel=channel))
    bus.open()
    thread.start()
    try:
        for _ in range(5):
            node = Node(bus, 5, read_sheet(SHIPPED / "rigd_servo.eds"))
            node.open("servo", 402, None)
            assert node.identity.startswith("rigd simulated servo, vendor 0x52494744")
            node.start()
            node.close()
        assert node.disturbances().foreign
    finally:
        ended.set()
        thread.join()
        bus.close()
        for each in (other, network):
            each.disconnect()

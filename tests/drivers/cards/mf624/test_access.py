"""Ways to the registers: pages of a mapped file, and a socket."""

from __future__ import annotations

import mmap
import socket
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from rigd.sdk import LinkError
from rigd_drivers.cards.mf624.access import MappedRegisters, SocketRegisters, open_registers

PAGE = mmap.PAGESIZE


class FakeUio:
    """A device file and the facts that the kernel reports on it, as uio_mf624 has them."""

    def __init__(self, folder: Path) -> None:
        self.device = folder / "uio3"
        self.device.write_bytes(bytes(3 * PAGE))
        self.sysfs = folder / "class"
        facts = {
            "name": "mf624\n",
            "device/vendor": "0x186c\n",
            "device/device": "0x0624\n",
            "maps/map0/offset": "0x400\n",
            "maps/map1/offset": "0x080\n",
            "maps/map2/offset": "0x000\n",
        }
        for name, text in facts.items():
            self.tell(name, text)

    def tell(self, name: str, text: str) -> None:
        path = self.sysfs / "uio3" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    def open(self, *, alone: bool = True) -> MappedRegisters:
        return MappedRegisters.of_uio(self.device, alone=alone, sysfs=self.sysfs)


@pytest.fixture
def uio(tmp_path: Path) -> FakeUio:
    return FakeUio(tmp_path)


def test_each_bar_is_one_page_with_exact_access(uio: FakeUio) -> None:
    """A plain file stands for the memory: it shows place and width, nothing of the card."""
    uio.device.write_bytes(b"\xee" * 3 * PAGE)
    io = uio.open()
    io.w32((0, 0x54), 0x064006C0)
    io.w16((2, 0x22), 0x2001)
    io.w32((4, 0x7C), 0xFFFFFFFE)
    assert io.r32((0, 0x54)) == 0x064006C0
    assert io.r16((2, 0x22)) == 0x2001
    assert io.r32((4, 0x7C)) == 0xFFFFFFFE
    assert io.r16((2, 0x20)) == 0xEEEE
    io.close()
    io.close()
    expected = bytearray(b"\xee" * 3 * PAGE)
    expected[0x454:0x458] = bytes.fromhex("c0064006")
    expected[PAGE + 0x0A2 : PAGE + 0x0A4] = bytes.fromhex("0120")
    expected[2 * PAGE + 0x7C : 2 * PAGE + 0x80] = bytes.fromhex("feffffff")
    assert uio.device.read_bytes() == expected


def test_second_master_is_kept_out_rescue_is_not(uio: FakeUio) -> None:
    first = uio.open()
    with pytest.raises(LinkError, match=r"another process .*uio3"):
        uio.open()
    uio.open(alone=False).close()
    first.close()
    uio.open().close()


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("name", "uio_pci_generic", r"is 'uio_pci_generic', PCI 186c:0624; expected 'mf624'"),
        ("device/device", "0x0634", r"PCI 186c:0634; expected 'mf624', PCI 186c:0624"),
        ("maps/map2/offset", "", "is no UIO device with three maps on PCI"),
    ],
)
def test_another_card_is_refused(uio: FakeUio, name: str, text: str, message: str) -> None:
    uio.tell(name, text)
    with pytest.raises(LinkError, match=message):
        uio.open()


def test_no_card_no_device_file_no_memory(uio: FakeUio, tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="is no UIO device"):
        open_registers("uio", str(tmp_path / "uio9"), alone=True)
    uio.device.write_bytes(bytes(PAGE))
    with pytest.raises(LinkError, match="cannot be mapped"):
        uio.open()
    uio.device.unlink()
    with pytest.raises(LinkError, match="cannot be opened: No such file"):
        uio.open()
    with pytest.raises(LinkError, match="no way 'spi'"):
        open_registers("spi", "", alone=True)


def open_files() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def test_failures_leave_no_file_open(uio: FakeUio) -> None:
    before = open_files()
    with closing(uio.open()):
        for _ in range(3):
            with pytest.raises(LinkError):
                uio.open()
    assert open_files() == before


@pytest.fixture
def peer(tmp_path: Path) -> Iterator[tuple[SocketRegisters, socket.socket]]:
    """The driver's side, and the other end of its connection."""
    path = tmp_path / "card"
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(str(path))
        listener.listen(1)
        io = SocketRegisters(str(path))
        other, _ = listener.accept()
    other.settimeout(10)
    yield io, other
    other.close()
    io.close()


def test_register_access_is_sent_as_one_packet(peer: tuple[SocketRegisters, socket.socket]) -> None:
    io, other = peer
    io.w16((2, 0x20), 0x2000)
    io.w32((0, 0x54), 0x064006C0)
    assert other.recv(99) == struct.pack("=BBHI", 1, 2, 0x20, 0x2000)
    assert other.recv(99) == struct.pack("=BBHI", 3, 0, 0x54, 0x064006C0)
    for read, what, register in ((io.r16, 0, (2, 0x10)), (io.r32, 2, (4, 0x74))):
        other.send(struct.pack("=I", 0xFFFFFFFE))
        assert read(register) == 0xFFFFFFFE
        assert other.recv(99) == struct.pack("=BBHI", what, *register, 0)


def test_late_answer_stops_reads_but_not_writes(
    peer: tuple[SocketRegisters, socket.socket],
) -> None:
    io, other = peer
    with pytest.raises(LinkError, match="does not answer: timed out"):
        io.r16((2, 0x10))
    other.send(struct.pack("=I", 0xA5))
    with pytest.raises(LinkError, match="does not answer: timed out"):
        io.r16((2, 0x20))
    io.w16((2, 0x10), 0)
    assert other.recv(99)[0] == 0
    assert other.recv(99) == struct.pack("=BBHI", 1, 2, 0x10, 0)


def test_closed_emulator_raises_link_error(peer: tuple[SocketRegisters, socket.socket]) -> None:
    io, other = peer
    other.close()
    with pytest.raises(LinkError, match=r"does not answer: .*Broken pipe"):
        io.r16((2, 0x10))
    with pytest.raises(LinkError, match=r"does not answer: .*Broken pipe"):
        io.w16((2, 0x10), 0)


def test_missing_emulator_raises_link_error(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"MF624 .*No such file"):
        open_registers("emulator", str(tmp_path / "none"), alone=True)

"""Reads and writes the registers of the MF624: mapped by UIO, or through an emulator's socket.

Every access is exactly one bus access of exactly the register's width. On this card a read can
take a value from a FIFO or start a conversion, and a write has another meaning at the same address.
So one access too many is an error. In CPython ``memoryview.cast("H")`` and ``cast("I")`` make
exactly one access. ctypes reads before it writes, and struct with ``<`` goes byte by byte.
"""

from __future__ import annotations

import mmap
import os
import socket
import struct
from importlib.metadata import entry_points
from pathlib import Path
from typing import Final, Protocol

from rigd.sdk import LinkError
from rigd_drivers.cards.mf624.registers import BARS, PCI_DEVICE, PCI_VENDOR, UIO_NAME, Register

#: Entry points of other ways: ``open(resource: str) -> RegIO``.
PLUGINS: Final = "rigd_drivers.mf624"
BUILT_IN: Final = ("uio", "emulator")
_SYSFS: Final = Path("/sys/class/uio")
#: An emulator on a busy machine answers within this, or it is gone.
_ANSWER_TIMEOUT_S: Final = 0.25


class RegIO(Protocol):
    """Registers read and written one by one."""

    def r16(self, register: Register) -> int:
        """Read a 16-bit register."""

    def w16(self, register: Register, value: int) -> None:
        """Write a 16-bit register."""

    def r32(self, register: Register) -> int:
        """Read a 32-bit register."""

    def w32(self, register: Register, value: int) -> None:
        """Write a 32-bit register."""

    def close(self) -> None:
        """Release the registers; closing twice is silent."""


def open_registers(interface: str, resource: str, *, alone: bool) -> RegIO:
    """Open the registers of a card.

    Args:
        interface: ``uio``, ``emulator``, or the name of an entry point in :data:`PLUGINS`.
        resource: device file, socket, or what else the entry point takes.
        alone: whether another process that has the card open prevents opening (if that is known).

    Raises:
        LinkError: the card is missing, is another card, or another program uses it.
    """
    if interface == "uio":
        return MappedRegisters.of_uio(Path(resource), alone=alone)
    if interface == "emulator":
        return SocketRegisters(resource)
    points = list(entry_points(group=PLUGINS, name=interface))
    if len(points) > 1:
        given = " and ".join(sorted(point.value for point in points))
        raise LinkError(f"the way {interface!r} to the registers of an MF624 is {given}: keep one")
    for point in points:
        opened: RegIO = point.load()(resource)
        return opened
    raise LinkError(f"no way {interface!r} to the registers of an MF624 is installed")


class MappedRegisters:
    """Registers that the kernel maps into memory.

    Args:
        file: an open device, or a plain file to measure and test this layer with.
        offsets: where each of :data:`BARS` begins within its page; map i is page i of the file.

    """

    def __init__(self, file: int, offsets: tuple[int, ...] = (0, 0, 0)) -> None:
        page = mmap.PAGESIZE
        self._file = file
        self._views: list[memoryview] = []
        self._maps: list[mmap.mmap] = []
        half = [memoryview(b"")] * (max(BARS) + 1)
        word = half.copy()
        for index, (bar, offset) in enumerate(zip(BARS, offsets, strict=True)):
            mapped = mmap.mmap(file, page, offset=index * page)
            whole = memoryview(mapped)
            part = whole[offset:]
            half[bar], word[bar] = part.cast("H"), part.cast("I")
            self._maps.append(mapped)
            self._views += [view for view in (half[bar], word[bar], part, whole)]
        self._half = half
        self._word = word

    @classmethod
    def of_uio(cls, device: Path, *, alone: bool, sysfs: Path = _SYSFS) -> MappedRegisters:
        """Map the card behind ``/dev/uioN``, once it is seen to be an MF624.

        Raises:
            LinkError: see :func:`open_registers`.

        """
        import fcntl  # Windows has none

        facts = sysfs / device.name
        offsets = _identified(device, facts)
        try:
            file = os.open(device, os.O_RDWR | os.O_SYNC | os.O_CLOEXEC)
        except OSError as error:
            raise LinkError(
                f"{device} cannot be opened: {error.strerror}",
                hint="give this user access to it by a udev rule for SUBSYSTEM uio",
            ) from error
        try:
            if alone:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return cls(file, offsets)
        except BlockingIOError as error:
            os.close(file)
            raise LinkError(
                f"another process drives the card at {device}",
                hint=f"find it with 'fuser {device}' and end it",
            ) from error
        except (OSError, ValueError) as error:
            os.close(file)
            raise LinkError(f"the registers at {device} cannot be mapped: {error}") from error

    def r16(self, register: Register) -> int:
        """Read a 16-bit register."""
        return self._half[register[0]][register[1] >> 1]

    def w16(self, register: Register, value: int) -> None:
        """Write a 16-bit register."""
        self._half[register[0]][register[1] >> 1] = value

    def r32(self, register: Register) -> int:
        """Read a 32-bit register."""
        return self._word[register[0]][register[1] >> 2]

    def w32(self, register: Register, value: int) -> None:
        """Write a 32-bit register."""
        self._word[register[0]][register[1] >> 2] = value

    def close(self) -> None:
        """Unmap and close; closing twice is silent."""
        if self._file < 0:
            return
        for view in self._views:
            view.release()
        for mapped in self._maps:
            mapped.close()
        os.close(self._file)
        self._file = -1


def _identified(device: Path, facts: Path) -> tuple[int, ...]:
    """Return where each BAR begins within its page, after a check that the card is an MF624."""
    try:
        name = (facts / "name").read_text().strip()
        vendor = int((facts / "device/vendor").read_text(), 16)
        product = int((facts / "device/device").read_text(), 16)
        offsets = tuple(
            int((facts / f"maps/map{index}/offset").read_text(), 16) for index in range(len(BARS))
        )
    except (OSError, ValueError) as error:
        raise LinkError(
            f"{device} is no UIO device with three maps on PCI: {error}",
            hint="load uio_mf624 and keep mf6x4 (Comedi) off the card: both claim it",
        ) from error
    if (name, vendor, product) != (UIO_NAME, PCI_VENDOR, PCI_DEVICE):
        raise LinkError(
            f"{device} is {name!r}, PCI {vendor:04x}:{product:04x}; "
            f"expected {UIO_NAME!r}, PCI {PCI_VENDOR:04x}:{PCI_DEVICE:04x}",
            hint="'grep . /sys/class/uio/*/name' shows which device the card is",
        )
    return offsets


#: One access: what (see below), BAR, offset, value. Answer to a read: the value.
_REQUEST: Final = struct.Struct("=BBHI")
_ANSWER: Final = struct.Struct("=I")
_R16, _W16, _R32, _W32 = range(4)


class SocketRegisters:
    """Registers served by an emulator: one packet for each access, an answer to each read.

    Writes are posted, as on PCI: an emulator that is gone is seen at the next read. Once an answer
    came late no read is valid, for the next answer would be that of the last; writes still
    go out, to make safe what can be.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self._lost = ""  # why reads are over
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.settimeout(_ANSWER_TIMEOUT_S)
        try:
            self._socket.connect(path)
        except OSError as error:
            self._socket.close()
            raise LinkError(
                f"no emulated MF624 serves at {path}: {error.strerror or error}",
                hint="start the simulated devices with 'rigd sim', or correct the path",
            ) from error

    def r16(self, register: Register) -> int:
        """Read a 16-bit register."""
        return self._read(_R16, register)

    def w16(self, register: Register, value: int) -> None:
        """Write a 16-bit register."""
        self._send(_W16, register, value)

    def r32(self, register: Register) -> int:
        """Read a 32-bit register."""
        return self._read(_R32, register)

    def w32(self, register: Register, value: int) -> None:
        """Write a 32-bit register."""
        self._send(_W32, register, value)

    def close(self) -> None:
        """Close the socket; closing twice is silent."""
        self._socket.close()

    def _read(self, what: int, register: Register) -> int:
        if self._lost:
            raise self._gone(self._lost)
        self._send(what, register, 0)
        try:
            answer = self._socket.recv(_ANSWER.size)
        except OSError as error:
            self._lost = str(error)
            raise self._gone(error) from error
        if len(answer) != _ANSWER.size:
            self._lost = "it closed the connection"
            raise self._gone(self._lost)
        value: int = _ANSWER.unpack(answer)[0]
        return value

    def _send(self, what: int, register: Register, value: int) -> None:
        try:
            self._socket.send(_REQUEST.pack(what, *register, value))
        except OSError as error:
            raise self._gone(error) from error

    def _gone(self, why: object) -> LinkError:
        return LinkError(f"the emulated MF624 at {self._path} does not answer: {why}")

"""Receives UDP datagrams without waiting, of one sender if that is known."""

from __future__ import annotations

import socket
from typing import Final, NamedTuple

from rigd.model.errors import DeviceError, LinkError
from rigd.model.machine.system import dropped, readable

#: Longest datagram kept, in bytes, unless the driver gives another length.
MAX_DATAGRAM: Final = 8192


class Datagram(NamedTuple):
    """What came, and the host that sent it."""

    data: bytes
    host: str


class DatagramPort:
    """A UDP port of this machine that only receives; nothing but :meth:`wait` waits.

    UDP has no connection: any host that reaches the port may send, datagrams are lost, come twice
    or in another order, and a sender that has ended is only silent. So a protocol on it needs a
    number in each datagram.

    Args:
        host: address of this machine on which it listens; 0.0.0.0: all of them.
        port: its number.
        sender: the host whose datagrams alone are taken, by name or address; None: any.
        longest: longest datagram taken, in bytes.

    """

    def __init__(
        self, host: str, port: int, sender: str | None = None, *, longest: int = MAX_DATAGRAM
    ) -> None:
        #: The port, for messages.
        self.where = f"UDP port {port} of {host}"
        self._address = host, port
        self._sender = sender
        self._longest = longest
        self._only: frozenset[str] | None = None
        self._socket: socket.socket | None = None
        self._clear()

    def _clear(self) -> None:
        self.foreign = 0  #: datagrams of other hosts than the sender, thrown away
        self.stranger = ""  #: the last of these hosts
        self.overlong = 0  #: datagrams thrown away because they were too long
        self.crowded = False  #: whether more may have arrived than the last call looked at

    @property
    def lost(self) -> int:
        """Datagrams that found the queue full since it was opened: they came faster than read."""
        return 0 if self._socket is None else dropped(self._socket)

    @property
    def is_open(self) -> bool:
        """Whether the port was opened, and not closed since."""
        return self._socket is not None

    def open(self) -> None:
        """Open the port, which is this process's alone.

        Raises:
            LinkError: another program has it, this machine has no such address, or the sender's
                name is not known.

        """
        if self._socket is not None:
            raise LinkError(f"{self.where} is open already", hint="close it first")
        self._clear()
        self._only = None if self._sender is None else self._resolved(self._sender)
        family = socket.AF_INET6 if ":" in self._address[0] else socket.AF_INET
        own = socket.socket(family, socket.SOCK_DGRAM)
        try:
            own.setblocking(False)
            own.bind(self._address)
        except OSError as error:
            own.close()
            raise LinkError(
                f"{self.where} cannot be opened ({error.strerror or error})",
                hint="another program may listen there; and the address must be one of this "
                "machine, or 0.0.0.0",
            ) from error
        self._socket = own

    def only(self, host: str) -> None:
        """Take datagrams of ``host`` alone from now on, an address as :meth:`receive` gives it."""
        self._only = frozenset((host,))

    def receive(self, most: int) -> list[Datagram]:
        """Return what has arrived, the oldest first; looks at ``most`` datagrams.

        Datagrams of other hosts, and those that are too long, are counted and left out.

        Raises:
            DeviceError: the network of this machine fails.
            LinkError: it is not open.

        """
        own, found = self._opened(), []
        self.crowded = True
        for _ in range(most):
            try:
                data, (host, *_) = own.recvfrom(self._longest + 1)
            except BlockingIOError:
                self.crowded = False
                break
            except OSError as error:
                raise DeviceError(
                    f"{self.where} fails ({error.strerror or error})",
                    hint="check the network of this machine",
                ) from error
            if self._only is not None and host not in self._only:
                self.foreign += 1
                self.stranger = host
            elif len(data) > self._longest:
                self.overlong += 1
            else:
                found.append(Datagram(data, host))
        return found

    def wait(self, timeout_s: float) -> bool:
        """Wait until something has arrived, at most ``timeout_s``; return whether it has.

        Raises:
            LinkError: it is not open.

        """
        return readable(self._opened(), timeout_s)

    def close(self) -> None:
        """Close the port; closing twice is silent."""
        own, self._socket = self._socket, None
        if own is not None:
            own.close()

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise LinkError(f"{self.where} is not open")
        return self._socket

    def _resolved(self, sender: str) -> frozenset[str]:
        try:
            found = socket.getaddrinfo(sender, None, type=socket.SOCK_DGRAM)
        except (OSError, UnicodeError) as error:  # the latter: no name at all
            raise LinkError(
                f"the sender '{sender}' for {self.where} is not known ({error})",
                hint="give its address in place of its name",
            ) from error
        return frozenset(str(address[0]) for *_, address in found)

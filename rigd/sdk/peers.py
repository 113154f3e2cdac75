"""Remembers the address at which each TCP port was open, so that no name is looked up again.

To find the address of a name may take seconds, and nobody limits that: a device that is made safe
over a new connection is at the address that it had. The processes of a run tell each other what
they know, since one rescues the devices of the other.
"""

from __future__ import annotations

import socket
from collections.abc import Mapping
from typing import Final

#: Host and port as the rig file has them.
Peer = tuple[str, int]

_addresses: Final[dict[Peer, str]] = {}


def known() -> Mapping[Peer, str]:
    """Return the address of each port that was open in this process, or in one it learned from."""
    return dict(_addresses)


def learn(addresses: Mapping[Peer, str]) -> None:
    """Take over what another process knows."""
    _addresses.update(addresses)


def last_address(host: str, port: int) -> str:
    """Return the address at which ``port`` of ``host`` was open last, else ``host``."""
    return _addresses.get((host, port), host)


def note(host: str, port: int, opened: socket.socket) -> None:
    """Note the address of ``opened``, a connection to ``port`` of ``host``."""
    _addresses[host, port] = opened.getpeername()[0]


def connect(host: str, port: int, timeout_s: float, *, again: bool = False) -> socket.socket:
    """Return a connection, made within ``timeout_s``; ``again``: at the last address.

    Raises:
        OSError: nothing accepts it.
    """
    where = last_address(host, port) if again else host
    opened = socket.create_connection((where, port), timeout_s)
    note(host, port, opened)
    return opened

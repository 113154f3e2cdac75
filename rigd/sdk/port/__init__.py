"""Provides serial, TCP and UDP ports for drivers of devices that speak in bytes, lines, datagrams.

A slow driver uses a :class:`LinePort` (lines, on an event loop). A fast driver uses a
:class:`BytePort`, which never waits once it is open, with a :class:`LineBuffer` and
:class:`Questions`. Both take the options of a :class:`PortConfig`. A device that sends UDP
datagrams is heard with a :class:`DatagramPort`.
"""

from rigd.sdk.port.byte_port import BytePort
from rigd.sdk.port.config import TCP, Parity, PortConfig
from rigd.sdk.port.datagram_port import MAX_DATAGRAM, Datagram, DatagramPort
from rigd.sdk.port.line_port import LinePort
from rigd.sdk.port.lines import MAX_LINE, LineBuffer
from rigd.sdk.port.questions import Heard, Questions

__all__ = [
    "MAX_DATAGRAM",
    "MAX_LINE",
    "TCP",
    "BytePort",
    "Datagram",
    "DatagramPort",
    "Heard",
    "LineBuffer",
    "LinePort",
    "Parity",
    "PortConfig",
    "Questions",
]

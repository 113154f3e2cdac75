"""Lists the commands and time limits of each protocol that scales use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

from rigd_drivers.instruments.scale import and_d, ohaus, sbi, sics
from rigd_drivers.instruments.scale.replies import Done, Reading, Refusal

DialectName = Literal["mt-sics", "kern-kcp", "and-d", "and-d-indicator", "sartorius-sbi", "ohaus"]


@dataclass(frozen=True)
class Dialect:
    """One protocol. Commands carry their ends; parsers return None for lines of another kind."""

    title: str
    #: Asks for the weight as it is now.
    read: bytes
    #: Ends a stream, and changes nothing else: no tare that was set.
    quieten: bytes
    #: Ends an action that waits for rest. With MT-SICS some scales lose their tare by it, so it is
    #: sent after an action that was given up, and at no other time.
    cancel: bytes
    parse_reading: Callable[[bytes], Reading | Refusal | None]
    #: What must lie between two commands, in s.
    min_interval_s: float
    #: Command and parser of the actions. An action without parser confirms nothing: it is done
    #: once a stable zero is shown.
    actions: Mapping[str, tuple[bytes, Callable[[bytes], Done | Refusal | None] | None]]


_SICS_ACTIONS: Final = {
    "tare": (b"T\r\n", sics.parse_tare),
    "zero": (b"Z\r\n", sics.parse_zero),
}

DIALECTS: Final[dict[DialectName, Dialect]] = {
    "mt-sics": Dialect(
        "Mettler-Toledo MT-SICS", b"SI\r\n", b"SI\r\n", b"@\r\n", sics.parse_reading, 0.0,
        _SICS_ACTIONS,
    ),
    # "The time between periodic inquiries must be longer than 100 ms": KIB-TM-ZB-e-1913, 1.4.
    "kern-kcp": Dialect(
        "KERN KCP", b"SI\r\n", b"SI\r\n", b"@\r\n", sics.parse_reading, 0.1, _SICS_ACTIONS
    ),
    "and-d": Dialect(
        "A&D", b"Q\r\n", b"C\r\n", b"C\r\n", and_d.parse_reading, 0.0,
        {"tare": (b"T\r\n", None), "zero": (b"Z\r\n", None)},
    ),
    # Its stream is a setting of its menu, which no command ends.
    "and-d-indicator": Dialect(
        "A&D indicator", b"RW\r\n", b"RW\r\n", b"RW\r\n", and_d.parse_reading, 0.0,
        {"tare": (b"MT\r\n", None), "zero": (b"MZ\r\n", None)},
    ),
    # Its automatic output is a setting of its menu too.
    "sartorius-sbi": Dialect(
        "Sartorius SBI", b"\x1bP\r\n", b"\x1bP\r\n", b"\x1bP\r\n", sbi.parse_reading, 0.0,
        {"tare": (b"\x1bT\r\n", None), "zero": (b"\x1bV\r\n", None)},
    ),
    # Its automatic output is a setting of its menu too.
    "ohaus": Dialect(
        "Ohaus", b"IP\r\n", b"IP\r\n", b"IP\r\n", ohaus.parse_reading, 0.0,
        {"tare": (b"T\r\n", None), "zero": (b"Z\r\n", None)},
    ),
}  # fmt: skip

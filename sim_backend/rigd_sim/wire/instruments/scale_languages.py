"""Makes the replies of a simulated scale in the protocols MT-SICS, KERN KCP and A&D.

The module is written from the manuals (Mettler-Toledo 11780711, KERN KCP-ZB-e-19137, A&D
FX-i/FX-iN), independently of rigd's driver.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final

from rigd_sim.wire.instruments.scale_weighing import Weighing

#: A command that waits for stability gives up after so long, in s.
STABILITY_S: Final = 10.0


class Trouble(Enum):
    """Why a scale answers with an error."""

    SYNTAX = "does not know the command"
    TRANSMISSION = "got the bytes damaged"
    LOGIC = "cannot carry it out"
    BUSY = "busy"


@dataclass(frozen=True)
class Nameplate:
    """The type, software and serial number that a scale reports."""

    model: str
    serial: str
    software: str = "1.20"


@dataclass
class _Waiting:
    """A command that the scale answers when the weight is stable."""

    until_s: float
    at_rest: Callable[[], bytes]
    too_late: bytes


class Language(ABC):
    """Takes commands and gives reply lines, without their ends; times in s.

    One command may wait for stability at a time, one stream may run.
    """

    def __init__(self, weighing: Weighing, plate: Nameplate, stream_s: float) -> None:
        self.weighing = weighing
        self.plate = plate
        self.streaming = False
        self._stream_s = stream_s
        self._next_s = 0.0
        self._waiting: _Waiting | None = None

    @abstractmethod
    def answer(self, command: bytes, now_s: float) -> list[bytes]:
        """Return what is answered at once; what waits comes from :meth:`tick`."""

    @abstractmethod
    def weight(self) -> bytes:
        """Return the weight as it is now, stable or not."""

    @abstractmethod
    def trouble(self, why: Trouble) -> bytes:
        """Return the reply for ``why``."""

    def tick(self, now_s: float) -> list[bytes]:
        """Return the lines that are due: a command that waited, the stream."""
        lines = []
        if (waiting := self._waiting) is not None:
            if self.weighing.stable:
                lines.append(waiting.at_rest())
                self._waiting = None
            elif now_s >= waiting.until_s:
                lines.append(waiting.too_late)
                self._waiting = None
        if self.streaming and now_s >= self._next_s:
            lines.append(self.weight())
            self._next_s = now_s + self._stream_s
        return lines

    def cancel(self) -> None:
        """End the stream and what waits."""
        self.streaming = False
        self._waiting = None

    def _wait(self, now_s: float, at_rest: Callable[[], bytes], too_late: bytes) -> list[bytes]:
        self._waiting = _Waiting(now_s + STABILITY_S, at_rest, too_late)
        return self.tick(now_s)


class Sics(Language):
    """MT-SICS level 0 and 1, and KERN KCP, which has the same commands."""

    def answer(self, command: bytes, now_s: float) -> list[bytes]:
        """Answer one command; letters count as written."""
        plate, weighing = self.plate, self.weighing
        if command in (b"S", b"SI", b"SIR", b"@"):
            self.cancel()
        match command:
            case b"@":  # "the condition found after switching on, without a zero setting"
                weighing.tare_kg = 0.0
                return [b'I4 A "%s"' % plate.serial.encode()]
            case b"I4":
                return [b'I4 A "%s"' % plate.serial.encode()]
            case b"I0":
                known = ("@", "I0", "I1", "I2", "I3", "I4", "I5", "S", "SI", "SIR", "T", "Z")
                *first, last = [f'0 "{name}"'.encode() for name in known]
                return [*(b"I0 B " + item for item in first), b"I0 A " + last]
            case b"I1":
                return [b'I1 A "01" "2.30" "2.22" "" ""']
            case b"I2":
                capacity = weighing.text(weighing.capacity_kg)
                return [f'I2 A "{plate.model} {capacity} {weighing.unit}"'.encode()]
            case b"I3":
                return [b'I3 A "%s"' % plate.software.encode()]
            case b"I5":
                return [b'I5 A "12121306C"']
            case b"SI":
                return [self.weight()]
            case b"SIR":
                self.streaming, self._next_s = True, now_s
                return self.tick(now_s)
            case b"S":
                return self._wait(now_s, self.weight, b"S I")
            case b"T":
                return self._wait(now_s, self._tare, b"T I")
            case b"Z":
                return self._wait(now_s, self._zero, b"Z I")
        return [self.trouble(Trouble.SYNTAX)]

    def weight(self) -> bytes:
        """``S S     100.00 g``: the value right-aligned in ten characters."""
        weighing = self.weighing
        if weighing.overload:
            return b"S +"
        if weighing.underload:
            return b"S -"
        state = "S" if weighing.stable else "D"
        return f"S {state} {weighing.shown():>10} {weighing.unit}".encode()

    def trouble(self, why: Trouble) -> bytes:
        """``ES``, ``ET``, ``EL``, ``S I``."""
        return {
            Trouble.SYNTAX: b"ES",
            Trouble.TRANSMISSION: b"ET",
            Trouble.LOGIC: b"EL",
            Trouble.BUSY: b"S I",
        }[why]

    def _tare(self) -> bytes:
        weighing = self.weighing
        if weighing.overload:
            return b"T +"
        if weighing.underload:
            return b"T -"
        weighing.tare()
        return f"T S {weighing.text(weighing.tare_kg):>10} {weighing.unit}".encode()

    def _zero(self) -> bytes:
        if self.weighing.zero():
            return b"Z A"
        return b"Z +" if self.weighing.gross_kg > 0 else b"Z -"


class AndD(Language):
    """A&D standard format; as delivered it confirms nothing and reports no errors."""

    #: Function "ErCd": AK on receipt and completion, EC with a number on errors.
    error_codes = False

    def answer(self, command: bytes, now_s: float) -> list[bytes]:
        """Answer one command."""
        match command:
            case b"Q" | b"SI":
                return [self.weight()]
            case b"S":
                return self._wait(now_s, self.weight, b"EC,E11" if self.error_codes else b"")
            case b"SIR":
                self.streaming, self._next_s = True, now_s
                return self.tick(now_s)
            case b"C":
                self.cancel()
                return []
            case b"T":
                return self._wait(now_s, self._tare, b"")
            case b"Z" | b"R":
                return self._wait(now_s, self._zero, b"")
            case b"?TN":
                return [f"TN,{self.plate.model}".encode()]
            case b"?SN":
                return [f"SN,{self.plate.serial}".encode()]
        return [self.trouble(Trouble.SYNTAX)] if self.error_codes else []

    def weight(self) -> bytes:
        """``ST,+00123.45  g``: sign, eight characters of number, three of unit."""
        weighing = self.weighing
        if weighing.overload:
            return b"OL,+9999999E+19"
        if weighing.underload:
            return b"OL,-9999999E+19"
        header = "ST" if weighing.stable else "US"
        shown = weighing.shown()
        sign, digits = ("-", shown[1:]) if shown.startswith("-") else ("+", shown)
        return f"{header},{sign}{digits.zfill(8)}{weighing.unit:>3}".encode()

    def trouble(self, why: Trouble) -> bytes:
        """``EC,E01`` and its like."""
        return {
            Trouble.SYNTAX: b"EC,E01",
            Trouble.TRANSMISSION: b"EC,E00",
            Trouble.LOGIC: b"EC,E06",
            Trouble.BUSY: b"EC,E02",
        }[why]

    def _tare(self) -> bytes:
        if not (self.weighing.overload or self.weighing.underload):
            self.weighing.tare()
            return b"\x06" if self.error_codes else b""
        return b"EC,E17" if self.error_codes else b""

    def _zero(self) -> bytes:
        if self.weighing.zero():
            return b"\x06" if self.error_codes else b""
        return b"EC,E17" if self.error_codes else b""


class AndDIndicator(AndD):
    """A weighing indicator such as the AD-4401A or AD-4410: commands are echoed and carried out."""

    def answer(self, command: bytes, now_s: float) -> list[bytes]:
        """Answer one command."""
        match command:
            case b"RW":
                return [self.weight()]
            case b"MT":
                return [command, *self._wait(now_s, self._tare, b"")]
            case b"MZ":
                return [command, *self._wait(now_s, self._zero, b"")]
        return []

    def weight(self) -> bytes:
        """``ST,NT,+00123.0kg``: sign, seven characters of number, two of unit."""
        line = super().weight()
        head, number, unit = line[:2], line[3:-3], line[-2:]
        if head == b"OL":
            return b"OL,NT," + line[3:]
        kind = b"NT" if self.weighing.tare_kg else b"GS"
        return b",".join([head, kind, number[:1] + number[2:]]) + unit


class Sbi(AndD):
    """Sartorius SBI, 16 characters: no unit until the weight is stable; confirms nothing."""

    def answer(self, command: bytes, now_s: float) -> list[bytes]:
        """Answer one command: ESC and a letter."""
        match command:
            case b"\x1bP":
                return [self.weight()]
            case b"\x1bT":
                return self._wait(now_s, self._tare, b"")
            case b"\x1bV":
                return self._wait(now_s, self._zero, b"")
        return []

    def weight(self) -> bytes:
        """``+   123.56 g  ``: sign, blank, eight characters of number, blank, three of unit."""
        weighing = self.weighing
        if weighing.overload:
            return b"      High    "
        if weighing.underload:
            return b"      Low     "
        shown = weighing.shown()
        unit = weighing.unit if weighing.stable else ""
        sign = "-" if shown.startswith("-") else "+"
        return f"{sign} {shown.removeprefix('-'):>8} {unit:<3}".encode()


class Ohaus(AndD):
    """Ohaus' own commands: IP prints at once, with "?" until stable; T and Z confirm nothing."""

    def answer(self, command: bytes, now_s: float) -> list[bytes]:
        """Answer one command."""
        match command:
            case b"IP":
                return [self.weight()]
            case b"T":
                return self._wait(now_s, self._tare, b"")
            case b"Z":
                return self._wait(now_s, self._zero, b"")
        return [b"ES"]

    def weight(self) -> bytes:
        """``    123.45 kg    ?``: number in ten characters, unit in five, "?" until stable."""
        weighing = self.weighing
        if weighing.overload or weighing.underload:
            return b"    Err 8.3" if weighing.overload else b"    Err 8.4"
        moves = "" if weighing.stable else "?"
        kind = "NET" if weighing.tare_kg else ""
        return f"{weighing.shown():>10} {weighing.unit:<5} {moves:<1} {kind}".rstrip().encode()

"""Decodes the replies of A&D balances, scales and weighing indicators.

Sources: A&D, FX-i/FX-iN instruction manual, "Data format" (A&D standard format), "Command list"
and "AK code and error codes"; EK-i/EW-i instruction manual, "Data format"; AD-4401A instruction
manual, "Communication diagram"; AD-4410 instruction manual, 9.2.8, "Command format".
"""

from __future__ import annotations

import re
from typing import Final

from rigd_drivers.instruments.scale.replies import Load, Reading, Refusal

#: Sent on receipt and on completion of a command if the balance is set to answer so.
ACKNOWLEDGED: Final = b"\x06"

_LOADS: Final = {b"ST": Load.STABLE, b"QT": Load.STABLE, b"US": Load.DYNAMIC}
#: Header, for checkweighers a second one, sign, 8 or 9 digits with the point among them, and the
#: unit right-aligned in three characters. The widths are fixed, so a lost character shows.
_READING: Final = re.compile(
    rb"(?P<header>ST|US|QT)(?:,(?:LO|OK|HI|NT|GS|TR))?,"
    rb"(?P<value>[-+](?=[\d.]{8,9} *[A-Za-z])\d+\.?\d*)(?P<unit>(?=.{3}$) {0,2}[A-Za-z]{1,3})"
)
#: Of an indicator: gross, net or tare, sign, 7 digits with the point among them, 2 of unit.
_INDICATED: Final = re.compile(
    rb"(?P<header>ST|US),(?:GS|NT|TR),"
    rb"(?P<value>[-+](?=[\d.]{7} ?[A-Za-z])\d+\.?\d*)(?P<unit>(?=.{2}$) ?[A-Za-z]{1,2})"
)
_OVER: Final = re.compile(rb"OL(?:,(?:LO|OK|HI|NT|GS|TR))?,(?P<sign>[-+]).*")
_ERROR: Final = re.compile(rb"EC,(?P<code>E\d\d)")
#: "AK code and error codes".
_ERRORS: Final = {
    "E00": "communications error (parity or framing)",
    "E01": "it does not know the command",
    "E02": "busy: it cannot take the command now",
    "E03": "it missed part of the command (time over)",
    "E04": "too many characters",
    "E06": "the command has the wrong format",
    "E07": "the value is out of range",
    "E11": "the weight does not come to rest",
    "E17": "out of the range in which it can do this",
}


def parse_reading(line: bytes) -> Reading | Refusal | None:
    """Return the weight in ``line``; None if it is not a weight reply, or is damaged.

    ``ST,+00123.45  g`` is 123.45 g, stable, as ``ST,NT,+00123.4 g`` of an indicator is;
    ``OL,+9999999E+19`` is an overload.
    """
    if match := _READING.fullmatch(line) or _INDICATED.fullmatch(line):
        unit = match["unit"].strip().decode()
        return Reading(_LOADS[match["header"]], float(match["value"]), unit)
    if match := _OVER.fullmatch(line):
        return Reading(Load.OVERLOAD if match["sign"] == b"+" else Load.UNDERLOAD)
    return parse_error(line)


def parse_error(line: bytes) -> Refusal | None:
    """Return the refusal in ``line``: ``EC,E02``; None if it is not a refusal."""
    if match := _ERROR.fullmatch(line.rstrip()):
        code = match["code"].decode()
        return Refusal(f"EC,{code}", _ERRORS.get(code, "an error its list of codes explains"))
    return None


def parse_text(line: bytes, name: bytes) -> str | None:
    """Return the answer to a question such as ``?SN``: ``SN,T1234567`` gives ``T1234567``."""
    head, comma, text = line.partition(b",")
    return text.strip().decode("latin-1") if comma and head == name and text.strip() else None

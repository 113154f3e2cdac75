"""Decodes the replies of MT-SICS and KERN KCP.

Sources: Mettler-Toledo, MT-SICS Reference Manual 11780711, "Response formats", commands @, I0-I5,
S, SI, SIR, T, Z, and "Error messages"; KERN, Communications Protocol KCP-ZB-e-19137.
"""

from __future__ import annotations

import re
from typing import Final

from rigd_drivers.instruments.scale.replies import Done, Info, Load, Reading, Refusal

#: The value is right-aligned in so many characters ("Format of responses with weight value").
VALUE_WIDTH: Final = 10

#: "General error messages", and what to do about them.
_ERRORS: Final = {
    b"ES": "syntax error: it does not know the command",
    b"ET": "transmission error: the bytes reached it damaged (parity, break)",
    b"EL": "logical error: it cannot carry out the command",
}
#: "Command-specific error messages": the second field of a reply.
_REASONS: Final = {
    b"I": "busy, or the weight did not come to rest in time",
    b"L": "the parameter is wrong",
    b"+": "above the range in which it can do this",
    b"-": "below the range in which it can do this",
}
# Some instruments answer with the name of the command instead of S.
_READING: Final = re.compile(
    rb"(?:SIR|SI|S) (?P<state>[SD]) (?P<field> *-?(?:\d+\.?\d*|\.\d+)) (?P<unit>[A-Za-z]{1,4}) *"
)
_LIMIT: Final = re.compile(rb"(?:SIR|SI|S) (?P<code>[-+IL])")
_TARED: Final = re.compile(rb"TI? [SD] (?P<text> *-?[\d.]+ [A-Za-z]+) *")
_INFO: Final = re.compile(rb"(?P<name>I\d+) (?P<more>[AB])(?P<rest>(?: .*)?)")
_QUOTED: Final = re.compile(rb'"([^"]*)"')


def parse_reading(line: bytes) -> Reading | Refusal | None:
    """Return the weight in ``line``; None if it is not a weight reply, or is damaged.

    A value that stands right-aligned in fewer or more characters than the manual states has lost
    some on the way: the digits would read as another weight.
    """
    if match := _READING.fullmatch(line):
        field = match["field"]
        if field.startswith(b" ") and len(field) != VALUE_WIDTH:
            return None
        load = Load.STABLE if match["state"] == b"S" else Load.DYNAMIC
        return Reading(load, float(field), match["unit"].decode())
    if match := _LIMIT.fullmatch(line):
        if match["code"] == b"+":
            return Reading(Load.OVERLOAD)
        if match["code"] == b"-":
            return Reading(Load.UNDERLOAD)
    return _refusal(line, (b"S", b"SI", b"SIR"))


def parse_tare(line: bytes) -> Done | Refusal | None:
    """Return the answer to ``T``: ``T S      100.00 g`` names the tare weight."""
    if match := _TARED.fullmatch(line):
        return Done(f"tare {match['text'].decode().strip()}")
    return _refusal(line, (b"T", b"TI"))


def parse_zero(line: bytes) -> Done | Refusal | None:
    """Return the answer to ``Z``: ``Z A``."""
    if line.rstrip() in (b"Z A", b"ZI S", b"ZI D"):
        return Done()
    return _refusal(line, (b"Z", b"ZI"))


def parse_info(line: bytes, name: bytes) -> Info | Refusal | None:
    """Return one line of the answer to ``name`` (``I0`` to ``I5``), such as ``I4 A "B021"``.

    Lines with ``B`` are followed by more, the one with ``A`` is the last.
    """
    match = _INFO.fullmatch(line)
    if match and match["name"] == name:
        texts = _QUOTED.findall(match["rest"]) or match["rest"].split()
        return Info(tuple(text.decode("latin-1") for text in texts), match["more"] == b"A")
    return _refusal(line, (name,))


def _refusal(line: bytes, names: tuple[bytes, ...]) -> Refusal | None:
    """Return the refusal that a line means, of a command in ``names``; None if it is none."""
    word = line.rstrip()
    if word in _ERRORS:
        return Refusal(word.decode(), _ERRORS[word])
    name, _, code = word.partition(b" ")
    if name in names and code in _REASONS:
        return Refusal(word.decode(), _REASONS[code])
    return None

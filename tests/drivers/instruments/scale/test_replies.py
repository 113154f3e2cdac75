"""Golden lines: what the manuals print, and what must not be read as a weight."""

from __future__ import annotations

import asyncio
import math

import pytest

from rigd.sdk.port import MAX_LINE, LineBuffer
from rigd_drivers.instruments.scale import and_d, identity, ohaus, sbi, sics
from rigd_drivers.instruments.scale.replies import Done, Info, Load, Reading, Refusal


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        # Mettler-Toledo 11780711, command S: "S S     100.00 g", and SI: "S D     129.02 g".
        (b"S S     100.00 g", Reading(Load.STABLE, 100.0, "g")),
        (b"S D     129.02 g", Reading(Load.DYNAMIC, 129.02, "g")),
        (b"S S      -1.24 kg", Reading(Load.STABLE, -1.24, "kg")),
        # Padding left out, as some indicators do.
        (b"S S 100.00 g", Reading(Load.STABLE, 100.0, "g")),
        # Named after the command, as some instruments answer.
        (b"SI S      0.500 lb", Reading(Load.STABLE, 0.5, "lb")),
        (b"SIR D      9.81 N", None),  # nine characters: one was lost
        (b"SIR D       9.81 N", Reading(Load.DYNAMIC, 9.81, "N")),
        (b"S I", Refusal("S I", "busy, or the weight did not come to rest in time")),
        (b"ES", Refusal("ES", "syntax error: it does not know the command")),
        (b"ET", Refusal("ET", "transmission error: the bytes reached it damaged (parity, break)")),
        (b"EL", Refusal("EL", "logical error: it cannot carry out the command")),
        (b"SI", None),  # an echo
        (b"S S     100.0", None),  # cut off: no unit
        (b"S S   1.000 kgS S   1.001 kg", None),  # merged
        (b"S S    100.00 g", None),  # padded, and yet nine characters
        (b"S X     100.00 g", None),
        (b"S S     1e5.00 g", None),
        (b"S S        nan g", None),
    ],
)
def test_mt_sics_weight_lines_parse_to_readings(
    line: bytes, expected: Reading | Refusal | None
) -> None:
    assert sics.parse_reading(line) == expected


@pytest.mark.parametrize(("code", "load"), [(b"+", Load.OVERLOAD), (b"-", Load.UNDERLOAD)])
@pytest.mark.parametrize("name", [b"S", b"SI", b"SIR"])
def test_mt_sics_beyond_its_range(name: bytes, code: bytes, load: Load) -> None:
    reading = sics.parse_reading(name + b" " + code)
    assert isinstance(reading, Reading)
    assert reading.load is load
    assert math.isnan(reading.value)


def test_mt_sics_tare_and_zero() -> None:
    """Commands T ("T S     100.00 g") and Z ("Z A")."""
    assert sics.parse_tare(b"T S     100.00 g") == Done("tare 100.00 g")
    assert sics.parse_tare(b"T +") == Refusal("T +", "above the range in which it can do this")
    assert sics.parse_tare(b"Z A") is None
    assert sics.parse_zero(b"Z A") == Done()
    assert sics.parse_zero(b"Z -") == Refusal("Z -", "below the range in which it can do this")
    assert sics.parse_zero(b"S S     100.00 g") is None


def test_mt_sics_identity_is_read() -> None:
    """Commands I4 (I4 A "B021002593") and I0, whose lines go on until one with A."""
    assert sics.parse_info(b'I4 A "B021002593"', b"I4") == Info(("B021002593",), last=True)
    assert sics.parse_info(b'I0 B 0 "I0"', b"I0") == Info(("I0",), last=False)
    assert sics.parse_info(b'I4 A "B021002593"', b"I2") is None
    assert isinstance(sics.parse_info(b"I3 I", b"I3"), Refusal)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        # A&D FX-i, "Data format": ST,+00123.45  g; EK-i: ST,+0001.234 kg.
        (b"ST,+00123.45  g", Reading(Load.STABLE, 123.45, "g")),
        (b"US,-00004.56  g", Reading(Load.DYNAMIC, -4.56, "g")),
        (b"ST,+0001.234 kg", Reading(Load.STABLE, 1.234, "kg")),
        (b"ST,+0002.721 lb", Reading(Load.STABLE, 2.721, "lb")),
        (b"QT,+00000012 PC", Reading(Load.STABLE, 12.0, "PC")),
        (b"ST,OK,+00123.45  g", Reading(Load.STABLE, 123.45, "g")),
        (b"ST,+0123.45  g", None),  # one digit was lost
        (b"ST,+00123.45", None),
        # AD-4410, 9.2.8.1: ST,NT,+00123.0kg.
        (b"ST,NT,+00123.0kg", Reading(Load.STABLE, 123.0, "kg")),
        (b"US,GS,-0012.34 g", Reading(Load.DYNAMIC, -12.34, "g")),
        (b"ST,NT,+0123.0kg", None),
        (b"ST,+00123.0kg", None),
        (b"ST,+001.3.45  g", None),
        (b"Q", None),
        (b"EC,E02", Refusal("EC,E02", "busy: it cannot take the command now")),
    ],
)
def test_a_and_d_weight_lines_parse_to_readings(
    line: bytes, expected: Reading | Refusal | None
) -> None:
    assert and_d.parse_reading(line) == expected


@pytest.mark.parametrize(
    ("line", "load"),
    [(b"OL,+9999999E+19", Load.OVERLOAD), (b"OL,-9999999E+19", Load.UNDERLOAD)],
)
def test_a_and_d_beyond_its_range(line: bytes, load: Load) -> None:
    reading = and_d.parse_reading(line)
    assert isinstance(reading, Reading)
    assert reading.load is load


def test_a_and_d_identity_is_read() -> None:
    assert and_d.parse_text(b"SN,T1234567", b"SN") == "T1234567"
    assert and_d.parse_text(b"SN,", b"SN") is None
    assert and_d.parse_text(b"ST,+00123.45  g", b"SN") is None


def test_an_answer_of_several_lines_is_put_together() -> None:
    """Lines with B are followed by more (I0 to I5); one that is not reported is left out."""
    lines = {
        b"I2\r\n": [b"S S     100.00 g", b'I2 B "WM124-L22"', b'I2 A "120.0090 g"'],
        b"I3\r\n": [b"ES"],
        b"I4\r\n": [],
    }

    async def main() -> str:
        due: list[bytes] = []

        async def send(command: bytes) -> None:
            due[:] = lines[command]

        async def line() -> bytes | None:
            return due.pop(0) if due else None

        return await identity.ask("mt-sics", send, line)

    assert asyncio.run(main()) == "Mettler-Toledo MT-SICS, type WM124-L22 120.0090 g"


@pytest.mark.parametrize("end", [b"\r\n", b"\r", b"\n"])
def test_lines_end_however_the_scale_ends_them(end: bytes) -> None:
    buffer = LineBuffer(drop_nul=True)
    stream = b"S S   1 g" + end + b"ES" + end + b"\0\0S\0 I" + end + b"S "
    found = [line for byte in stream for line in buffer.feed(bytes([byte]))]
    assert found == [b"S S   1 g", b"ES", b"S I"]
    assert buffer.feed(b"+\r\n") == [b"S +"]


def test_endless_line_is_bounded_and_discarded() -> None:
    buffer = LineBuffer()
    for _ in range(100):
        assert buffer.feed(b"x" * 100) == []
    assert buffer.feed(b"x\nS I\n") == [b"S I"]
    assert buffer.feed(b"y" * MAX_LINE + b"\n") == [b"y" * MAX_LINE]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        # GC803S, "Output format with 16 characters" and "with 22 characters".
        (b"+   123.56 g  ", Reading(Load.STABLE, 123.56, "g")),
        (b"-     0.01 kg ", Reading(Load.STABLE, -0.01, "kg")),
        (b"N     +   123.56 g  ", Reading(Load.STABLE, 123.56, "g")),
        (b"+   123.56    ", Reading(Load.DYNAMIC, 123.56, "")),
        # Quintix, "Special outputs".
        (b"      High    ", Reading(Load.OVERLOAD)),
        (b"      Low     ", Reading(Load.UNDERLOAD)),
        (b"+  123.56 g  ", None),
        (b"+   12 .56 g  ", None),
        (b"      --      ", None),
        (b"", None),
    ],
)
def test_sbi_lines_parse_to_readings(line: bytes, expected: Reading | None) -> None:
    found = sbi.parse_reading(line)
    if expected is not None and math.isnan(expected.value):
        assert isinstance(found, Reading)
        assert found.load is expected.load
    else:
        assert found == expected


def test_sbi_error_is_a_refusal() -> None:
    found = sbi.parse_reading(b"   Err 054    ")
    assert isinstance(found, Refusal)
    assert found.code == "Err 054"


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (b"    123.45 g", Reading(Load.STABLE, 123.45, "g")),
        (b"    123.45 g       G", Reading(Load.STABLE, 123.45, "g")),
        (b"    -12.30 kg    ? NET", Reading(Load.DYNAMIC, -12.3, "kg")),
        (b"     123.45 lb    ?", Reading(Load.DYNAMIC, 123.45, "lb")),
        (b"    Err 8.3", Reading(Load.OVERLOAD)),
        (b"   123.45 g", None),  # a character is missing
        (b"    123.4\x005 g", None),
        (b"    123.45", None),
        (b"    12 3.45 g", None),
        (b"IP", None),
    ],
)
def test_ohaus_lines_parse_to_readings(line: bytes, expected: Reading | None) -> None:
    found = ohaus.parse_reading(line)
    if expected is not None and math.isnan(expected.value):
        assert isinstance(found, Reading)
        assert (found.load, math.isnan(found.value)) == (expected.load, True)
    else:
        assert found == expected


def test_ohaus_error_is_a_refusal() -> None:
    found = ohaus.parse_reading(b"ES")
    assert isinstance(found, Refusal)
    assert found.code == "ES"

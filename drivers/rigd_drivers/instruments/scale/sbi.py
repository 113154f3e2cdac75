"""Decodes the replies of Sartorius balances in SBI, their own protocol.

Sources: Sartorius GC803S manual, "Output format with 16 / with 22 characters"; Quintix manual,
"Special outputs"; Cubis MSE manual, "SBI commands".
"""

from __future__ import annotations

import re
from typing import Final

from rigd_drivers.instruments.scale.replies import Load, Reading, Refusal

#: An ID of 6 characters, if set; then 14: sign, value right-aligned in 9, blank, unit in 3.
_READING: Final = re.compile(
    rb"(?:[ -~]{6})?(?=.{14}$)(?P<sign>[-+ ])(?=.{9} )(?P<value> *\d+\.?\d*) (?P<unit>[A-Za-z ]{3})"
)
_ERROR: Final = re.compile(rb" *Err *(?P<code>\d+) *")
_LIMITS: Final = {
    b"High": Load.OVERLOAD, b"H": Load.OVERLOAD, b"Low": Load.UNDERLOAD, b"L": Load.UNDERLOAD,
}  # fmt: skip


def parse_reading(line: bytes) -> Reading | Refusal | None:
    """Return the weight in ``line``; None if it is not a weight reply, or is damaged.

    ``+   123.56 g  `` is 123.56 g, stable. Without its unit the weight is not stable.
    """
    if match := _READING.fullmatch(line):
        value = float(match["value"]) * (-1.0 if match["sign"] == b"-" else 1.0)
        unit = match["unit"].strip().decode()
        return Reading(Load.STABLE if unit else Load.DYNAMIC, value, unit)
    if match := _ERROR.fullmatch(line):
        return Refusal(f"Err {match['code'].decode()}", "see the list of errors in its manual")
    limit = _LIMITS.get(line.strip())
    return None if limit is None else Reading(limit)

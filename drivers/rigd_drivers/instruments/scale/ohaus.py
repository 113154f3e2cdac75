"""Decodes the replies of Ohaus scales and balances to their own commands.

Sources: Ohaus, Scout SPX and Ranger 3000 instruction manuals, "Interface commands" and "Output
format": `IP` prints what is shown at once, stable or not, and `?` behind the unit means that it is
not stable; "Error messages": 8.3 is above the range, 8.4 below. No scale was tried.
"""

from __future__ import annotations

import re
from typing import Final

from rigd_drivers.instruments.scale.replies import Load, Reading, Refusal

#: Weight right-aligned in so many characters: 10 or 11, by model.
_WIDTHS: Final = (10, 11)
#: Weight, blank, unit left-aligned in five characters, blank, `?` if not stable, then what is
#: weighed (G, N, NET, T). Blanks at the end may be missing.
_READING: Final = re.compile(
    rb"(?P<field> *-?(?:\d+\.?\d*|\.\d+)) (?P<unit>[A-Za-z]{1,5}) *(?P<moves>\??) *"
    rb"(?P<kind>G|N|B|NET|GROSS|T|PT)? *"
)


_LIMITS: Final = {b"Err 8.3": Load.OVERLOAD, b"Err 8.4": Load.UNDERLOAD}


def parse_reading(line: bytes) -> Reading | Refusal | None:
    """Return the weight in ``line``; None if it is not a weight, or is damaged.

    ``    123.45 g      ?`` is 123.45 g, not stable. A value in fewer characters has lost some.
    """
    if match := _READING.fullmatch(line):
        if len(match["field"]) not in _WIDTHS:
            return None
        load = Load.DYNAMIC if match["moves"] else Load.STABLE
        return Reading(load, float(match["field"]), match["unit"].decode())
    if line.rstrip() == b"ES":
        return Refusal("ES", "it does not know the command")
    limit = _LIMITS.get(line.strip())
    return None if limit is None else Reading(limit)

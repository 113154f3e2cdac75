"""Formats numbers for a reader, with as many digits as their uncertainty justifies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

#: The uncertainty is shown with two significant digits (GUM, JCGM 100:2008, 7.2.6).
DIGITS: Final = 2
#: Digits of a number that comes without an uncertainty; trailing zeros are not written.
BARE_DIGITS: Final = 4
#: Powers of ten outside of which a number is written as mantissa and exponent.
PLAIN_EXPONENTS: Final = range(-4, 6)
#: Smaller p values depend more on the test's assumptions than on the data.
SMALLEST_P: Final = 1e-6
#: Arms of an interval that differ by less than this share of the wider one read as one ±.
SYMMETRY: Final = 0.25

#: Units that small values are shown a thousand times finer in.
FINER: Final = {"m/s": "mm/s", "m": "mm", "rad/s": "mrad/s", "rad": "mrad"}

_SUPERSCRIPT: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_MINUS: Final = "\N{MINUS SIGN}"


def places_for(uncertainty: float) -> int | None:
    """Return the decimal place that an uncertainty reaches to; None if it has no value.

    Negative places are to the left of the decimal point: 130 gives -1.
    """
    if not math.isfinite(uncertainty) or uncertainty <= 0.0:
        return None
    return DIGITS - 1 - math.floor(math.log10(uncertainty))


def number(value: float, places: int | None = None, *, digits: int = BARE_DIGITS) -> str:
    """Return ``value`` rounded to ``places`` decimals; without them, to at most ``digits`` digits.

    ``places`` come from an uncertainty, so trailing zeros mean something and stay.
    """
    if not math.isfinite(value):
        return "undefined"
    if value == 0.0:
        return f"{0.0:.{max(places or 0, 0)}f}"
    bare = places is None
    if places is None:  # the power of ten once it is rounded: 9.99996 is 10.00
        exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])
        places = digits - 1 - exponent
    else:
        exponent = math.floor(math.log10(abs(value)))
    if exponent in PLAIN_EXPONENTS:
        text = f"{round(value, places):.{max(places, 0)}f}"
        return _signed(_trimmed(text) if bare else text)
    mantissa, _, written = f"{value:.{max(places + exponent, 0)}e}".partition("e")
    power = str(int(written)).translate(_SUPERSCRIPT)
    return _signed(f"{_trimmed(mantissa) if bare else mantissa}×10{power}")


def probability(value: float) -> str:
    """Return ``p = 0.031``; a p value too small to mean anything is only bounded."""
    if value < SMALLEST_P:
        return f"p < {number(SMALLEST_P)}"
    return f"p = {number(value, digits=DIGITS)}"


def count(value: float) -> str:
    """Return a whole number with its thousands set apart by narrow spaces."""
    return f"{value:,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def percent(share: float) -> str:
    """Return a signed percentage of two digits, such as ``+4.1 %``."""
    value = 100.0 * share
    if not math.isfinite(value):
        return "undefined"
    places = 0 if abs(value) >= 9.95 else 1 if abs(value) >= 0.05 else 2
    return _signed(f"{value:+.{places}f} %")


def spread(estimate: float, low: float | None, high: float | None) -> str:
    """Return ``± 0.12``, or ``+0.30 −0.05`` if the interval is lopsided; empty if it is open."""
    if low is None or high is None:
        return ""
    below, above = estimate - low, high - estimate
    places = interval_places(low, high)
    wider = max(below, above)
    if below < 0.0 or above < 0.0 or wider == 0.0:
        return ""
    if abs(above - below) <= SYMMETRY * wider:
        return f"± {number((above + below) / 2, places)}"
    return f"+{number(above, places)} {_MINUS}{number(below, places)}"


def interval(low: float | None, high: float | None) -> str:
    """Return ``1.2 … 1.4``, ``≥ 1.2``, ``≤ 1.4``, or ``open on both sides``."""
    if low is None:
        return "open on both sides" if high is None else f"≤ {number(high, digits=DIGITS)}"
    if high is None:
        return f"≥ {number(low, digits=DIGITS)}"
    places = interval_places(low, high)
    return f"{number(low, places)} … {number(high, places)}"


def finer(values: Sequence[float], unit: str) -> tuple[list[float], str]:
    """Return ``values`` below 1 in a finer unit, if people use one: 0.02 m/s is 20 mm/s."""
    if unit in FINER and all(abs(value) < 1.0 for value in values):
        return [1e3 * value for value in values], FINER[unit]
    return list(values), unit


def span(low: float, high: float, unit: str) -> str:
    """Return ``0.025 to 110 mm/s``: a range, to two digits."""
    ends, unit = finer([low, high], unit)
    shown = "" if unit == "1" else f" {unit}"
    return f"{number(ends[0], digits=2)} to {number(ends[1], digits=2)}{shown}"


def interval_places(low: float | None, high: float | None) -> int | None:
    """Return the decimal place at which half the width of an interval has two digits."""
    if low is None or high is None:
        return None
    return places_for((high - low) / 2)


def _trimmed(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text


def _signed(text: str) -> str:
    return text.replace("-", _MINUS)

"""Converts quantities with units to SI: ``"0.15 A"`` to 0.15, ``"15 deg"`` to 0.2618.

rigd computes in SI; it converts when it reads or shows a quantity. The table below lists the units
that a rig file and a procedure may use; a prefix of SI is allowed if it is usual for the unit.
``rad`` and ``count`` are dimensions of their own, unlike in SI: an angle given as ``0.3`` or an
encoder scale given in ``m`` instead of ``m/count`` is then an error.

Units with a zero of their own (:data:`OFFSETS`: degC, degF, gauge pressures) state where something
is on a scale, never how far two values are apart. They stand alone: no ``degC/s``, no ``1/degC``.
Where a difference is meant, they are refused, and the error names the unit of differences.
"""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

#: The order of the exponents in :attr:`Unit.dimension`.
BASES: Final = ("kg", "m", "s", "A", "K", "rad", "count")
Dimension = tuple[int, ...]
NO_DIMENSION: Final[Dimension] = (0,) * len(BASES)


def _dimension(**exponents: int) -> Dimension:
    return tuple(exponents.get(base, 0) for base in BASES)


#: symbol -> (factor to SI, dimension, may carry an SI prefix)
_UNITS: Final[dict[str, tuple[float, Dimension, bool]]] = {
    "1": (1.0, NO_DIMENSION, False),
    "%": (0.01, NO_DIMENSION, False),
    "g": (1e-3, _dimension(kg=1), True),
    "m": (1.0, _dimension(m=1), True),
    "s": (1.0, _dimension(s=1), True),
    "min": (60.0, _dimension(s=1), False),
    "h": (3600.0, _dimension(s=1), False),
    "d": (86_400.0, _dimension(s=1), False),
    "A": (1.0, _dimension(A=1), True),
    "K": (1.0, _dimension(K=1), True),
    "rad": (1.0, _dimension(rad=1), True),
    "deg": (math.pi / 180, _dimension(rad=1), False),
    "rev": (2 * math.pi, _dimension(rad=1), False),
    "rpm": (2 * math.pi / 60, _dimension(rad=1, s=-1), False),
    "count": (1.0, _dimension(count=1), False),
    "Hz": (1.0, _dimension(s=-1), True),
    "N": (1.0, _dimension(kg=1, m=1, s=-2), True),
    "kgf": (9.80665, _dimension(kg=1, m=1, s=-2), False),  # 3rd CGPM, 1901: standard gravity
    "gf": (9.80665e-3, _dimension(kg=1, m=1, s=-2), False),
    "Pa": (1.0, _dimension(kg=1, m=-1, s=-2), True),
    "J": (1.0, _dimension(kg=1, m=2, s=-2), True),
    "W": (1.0, _dimension(kg=1, m=2, s=-3), True),
    "V": (1.0, _dimension(kg=1, m=2, s=-3, A=-1), True),
    "ohm": (1.0, _dimension(kg=1, m=2, s=-3, A=-2), True),
    "H": (1.0, _dimension(kg=1, m=2, s=-2, A=-2), True),
    "bar": (1e5, _dimension(kg=1, m=-1, s=-2), True),
    "psi": (4.4482216152605 / 0.0254**2, _dimension(kg=1, m=-1, s=-2), False),  # lbf/in^2
    "L": (1e-3, _dimension(m=3), True),
    "strain": (1.0, NO_DIMENSION, True),
    "bit": (1.0, NO_DIMENSION, True),
}
#: 0 degrees Celsius in K (SI brochure, 9th edition, 2.3.1).
ICE_POINT_K: Final = 273.15
#: What a gauge pressure of 0 is, in Pa: the standard atmosphere (10th CGPM, 1954, resolution 4).
#: The weather moves the real one by about 3 kPa, and 1000 m of height by 11 kPa.
ATMOSPHERE_PA: Final = 101_325.0
#: Units with a zero of their own: symbol -> (value of 0 in SI, unit of a difference, which has the
#: same size or is of SI).
OFFSETS: Final[dict[str, tuple[float, str]]] = {
    "degC": (ICE_POINT_K, "K"),
    "degF": (ICE_POINT_K - 32 * 5 / 9, "K"),
    "barg": (ATMOSPHERE_PA, "bar"),
    "mbarg": (ATMOSPHERE_PA, "mbar"),
    "kPag": (ATMOSPHERE_PA, "kPa"),
    "psig": (ATMOSPHERE_PA, "psi"),
}
_FAHRENHEIT_K: Final = 5 / 9
#: SI prefixes, by symbol.
PREFIXES: Final = {
    "n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6,
    "G": 1e9,
}  # fmt: skip
_SYNONYMS: Final = {
    "Ω": "ohm", "°": "deg", "counts": "count", "sec": "s", "l": "L", "°C": "degC", "°F": "degF",
    "U": "rev",
}  # fmt: skip
_SUPERSCRIPTS: Final = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_OFFSET_DECIMALS: Final = 9  # of a number in a unit with an offset
_MAX_POWER: Final = 9  # no quantity of physics needs more, and 1000.0**200 overflows
_FACTOR: Final = re.compile(r"(?P<symbol>[A-Za-zµμΩ°%]+|1)(?:\^?(?P<power>-?\d+))?$")
#: A number in the style of many languages: the part before the comma, and the part after it.
DECIMAL_COMMA: Final = re.compile(r"\s*([-+]?\d+),(\d.*)$", re.DOTALL)
#: What a unit is divided by, in parentheses: the ``N s`` of ``A/(N s)``.
_DIVISOR: Final = re.compile(r"/ +\(([^()/]+)\)")
_NUMBER: Final = re.compile(
    r"\s*(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?P<unit>.*?)\s*$"
)


@dataclass(frozen=True)
class Unit:
    """A unit: its symbol as written, its dimension over :data:`BASES`, and how it becomes SI.

    ``factor`` is what a difference of 1 is in SI, ``offset`` what 0 is: not 0 for :data:`OFFSETS`
    only.
    """

    symbol: str
    factor: float
    dimension: Dimension
    offset: float = 0.0

    def __str__(self) -> str:
        return self.symbol

    def same_kind(self, other: Unit) -> bool:
        """Return whether a quantity in this unit can be given in the other."""
        return self.dimension == other.dimension

    @property
    def is_si(self) -> bool:
        """Whether a number in this unit is the SI value."""
        return self.factor == 1.0 and self.offset == 0.0

    def to_si(self, number: float) -> float:
        """Return a number in this unit in SI."""
        return number * self.factor + self.offset

    def from_si(self, value: float) -> float:
        """Return an SI value as a number in this unit."""
        if self.offset == 0.0:
            return value / self.factor
        # Zero of a scale far from that of SI: 1e-10 in the unit is what rounding leaves.
        return round((value - self.offset) / self.factor, _OFFSET_DECIMALS)

    def difference(self) -> Unit:
        """Return the unit for differences of values in this unit: ``K`` for ``degC``."""
        return self if self.offset == 0.0 else parse_unit(OFFSETS[_canonical(self.symbol)][1])


@dataclass(frozen=True)
class Quantity:
    """A number with its unit; :attr:`value` is in SI base units, :attr:`unit` as written."""

    value: float
    unit: Unit

    def __str__(self) -> str:
        return _text(self.value, self.unit, 6)

    def as_difference(self) -> Quantity:
        """Return itself if it can be a difference, a tolerance or a noise.

        Raises:
            ValueError: its unit has a zero of its own; the message has the unit to be written.
        """
        if self.unit.offset == 0.0:
            return self
        unit = self.unit.difference()
        size = Quantity(self.value - self.unit.offset, unit)
        raise ValueError(
            f"'{self}' is a value on a scale with a zero of its own, and a difference is expected "
            f"here: write '{size}'"
        )


@lru_cache(maxsize=1024)
def parse_unit(text: str) -> Unit:
    """Return the unit written as ``m/s^2``, ``N m``, ``kg·m²``, ``1/m`` or ``A/(N s)``.

    Every ``/`` divides by the single factor after it, or by the product in parentheses.

    Raises:
        ValueError: unknown unit; the message names the unknown factor.
    """
    symbol = text.strip() or "1"
    plain = symbol.translate(_SUPERSCRIPTS).replace("·", " ").replace("*", " ").replace("/", " / ")
    plain = _DIVISOR.sub(lambda match: "/ " + " / ".join(match[1].split()), plain)
    factor, dimension, sign = 1.0, list(NO_DIMENSION), 1
    words = plain.split()
    if not words:
        raise ValueError(f"cannot read {text!r} as a unit")
    if words[-1] == "/":
        raise ValueError(f"unit {text!r} ends in '/'")
    if len(words) == 1 and _canonical(words[0]) in OFFSETS:
        return _with_offset(symbol, _canonical(words[0]))
    for word in words:
        if word == "/":
            sign = -1
            continue
        one_factor, one_dimension, power = _parse_factor(word, text)
        factor *= one_factor ** (sign * power)
        for base, exponent in enumerate(one_dimension):
            dimension[base] += sign * power * exponent
        sign = 1
    return Unit(symbol, factor, tuple(dimension))


def _canonical(symbol: str) -> str:
    return _SYNONYMS.get(symbol, symbol)


def _with_offset(symbol: str, known: str) -> Unit:
    zero, difference = OFFSETS[known]
    size = parse_unit(difference)
    factor = _FAHRENHEIT_K if known == "degF" else size.factor
    return Unit(symbol, factor, size.dimension, zero)


def symbols(unit: str | None = None) -> tuple[list[str], list[str]]:
    """Return the symbols for units of the kind of ``unit`` (None: any kind), in two groups.

    Symbols of the first group may carry an SI prefix (:data:`PREFIXES`), the others may not.
    """
    kind = None if unit is None else parse_unit(unit).dimension
    prefixed: list[str] = []
    bare: list[str] = []
    synonyms = {word: _UNITS[symbol] for word, symbol in _SYNONYMS.items() if symbol in _UNITS}
    for word, (_, dimension, may_carry) in {**_UNITS, **synonyms}.items():
        if kind in (None, dimension) and word != "1":
            (prefixed if may_carry else bare).append(word)
    named = (*OFFSETS, *(word for word, known in _SYNONYMS.items() if known in OFFSETS))
    bare += [word for word in named if kind in (None, parse_unit(word).dimension)]
    return prefixed, bare


def _parse_factor(word: str, text: str) -> tuple[float, Dimension, int]:
    match = _FACTOR.match(word)
    if match is None:
        raise ValueError(f"cannot read {word!r} in unit {text!r}{odd_character(word)}")
    symbol = _SYNONYMS.get(match["symbol"], match["symbol"])
    power = int((match["power"] or "1")[:9])  # nine characters prove that it is too large
    if abs(power) > _MAX_POWER:
        raise ValueError(f"the power in {word!r} is larger than {_MAX_POWER}")
    if symbol in OFFSETS:
        unit = _with_offset(symbol, symbol)
        raise ValueError(
            f"{match['symbol']!r} in {text!r} has a zero of its own and cannot be part of another "
            f"unit: write {unit.difference()}{_size(unit)}"
        )
    if symbol in _UNITS:
        factor, dimension, _ = _UNITS[symbol]
        return factor, dimension, power
    prefix, stem = symbol[:1], _SYNONYMS.get(symbol[1:], symbol[1:])
    if prefix in PREFIXES and stem in _UNITS and _UNITS[stem][2]:
        factor, dimension, _ = _UNITS[stem]
        return PREFIXES[prefix] * factor, dimension, power
    around = "" if symbol == text else f" in {text!r}"
    near = meant_unit(symbol)
    raise ValueError(
        f"unknown unit {symbol!r}{around}" + (f", did you mean {near!r}?" if near else "")
    )


def _size(unit: Unit) -> str:
    """Return `` (1 degF is 0.555556 K)`` if a difference of 1 in ``unit`` has another size."""
    other = unit.difference()
    if unit.factor == other.factor:
        return ""
    return f" (a difference of 1 {unit} is {unit.factor / other.factor:.6g} {other})"


#: What people write for a unit -> what they mean.
_ALMOST: Final = {
    "Newton": "N", "newton": "N", "Newtons": "N", "newtons": "N",
    "Kelvin": "K", "kelvin": "K", "C°": "degC", "micron": "um", "microns": "um",
    "C": "degC", "F": "degF", "Celsius": "degC", "celsius": "degC", "degCelsius": "degC",
    "bara": "bar", "psia": "psi", "lpm": "L/min", "LPM": "L/min", "RPM": "rpm", "Pag": "kPag",
}  # fmt: skip


def meant_unit(symbol: str) -> str | None:
    """Return ``mA`` for ``ma``: what is meant by a wrong case of letters, or a missing space."""
    if symbol in _ALMOST:
        return _ALMOST[symbol]
    known = [*_UNITS, *OFFSETS, *(f"{prefix}{stem}" for stem, (_, _, may) in _UNITS.items() if may
                        for prefix in PREFIXES)]  # fmt: skip
    same = [item for item in known if item.casefold() == symbol.casefold()]
    parts = [f"{symbol[:at]} {symbol[at:]}" for at in range(1, len(symbol))
             if symbol[:at] in known and symbol[at:] in known]  # fmt: skip
    return next(iter((*parts, *same)), None)


def parse_quantity(text: str) -> Quantity:
    """Return the quantity written as ``0.15 A`` or ``1e3 1/m``; a bare number has no dimension.

    Raises:
        ValueError: the text is not a number followed by a known unit.
    """
    if (comma := DECIMAL_COMMA.match(text)) is not None:
        raise ValueError(f"{text!r} has a decimal comma: write '{comma[1]}.{comma[2]}'")
    match = _NUMBER.match(text)
    if match is None:
        raise ValueError(
            f"cannot read {text!r} as a number with a unit, such as '1.5 A'{odd_character(text)}"
        )
    unit = parse_unit(match["unit"])
    value = unit.to_si(float(match["number"]))
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is too large a number")
    return Quantity(value, unit)


def odd_character(text: str) -> str:
    """Return what to say of the first character that only looks like one of a quantity, or "".

    Such as a minus sign U+2212, a space without a width, a mark of the order of bytes.
    """
    for sign in text:
        kind = unicodedata.category(sign)
        if kind == "Cc" or (kind in ("Cf", "Pd", "Sm", "Zs") and not sign.isascii()):
            return f": it has U+{ord(sign):04X} {unicodedata.name(sign, 'a control character')}"
    return ""


def format_quantity(value: float, unit: str, digits: int = 6) -> str:
    """Return SI ``value`` as text in ``unit``, such as ``0.15 A``."""
    return _text(value, parse_unit(unit), digits)


def with_unit(number: str, unit: str) -> str:
    """Return what to write in place of a bare number, such as ``'250 degC' or '250 K'``.

    ``unit`` is the one that people use. Kelvins can be a temperature or a difference.
    """
    units = ("degC", unit) if unit == "K" else (unit,)
    return " or ".join(f"'{number} {item}'" for item in units)


def correct_scale(given: Quantity, wanted: str) -> str:
    """Return what to write in place of a scale that is not in ``wanted``, such as ``N/V``.

    One that is upside down, as ``5 V/N``, is turned over.
    """
    unit = parse_unit(wanted)
    if given.unit.dimension == NO_DIMENSION:
        return f"write '{given.value:.6g} {wanted}'"
    if given.value and given.unit.dimension == tuple(-power for power in unit.dimension):
        return f"it is upside down: write '{unit.from_si(1 / given.value):.6g} {wanted}'"
    return f"give how many {wanted.partition('/')[0]} each {wanted.rpartition('/')[2]} means"


def format_difference(value: float, unit: str, digits: int = 6) -> str:
    """Return an SI difference of values in ``unit`` as text: ``2 K`` for values in ``degC``."""
    return _text(value, parse_unit(unit).difference(), digits)


def _text(value: float, unit: Unit, digits: int) -> str:
    return f"{unit.from_si(value):.{digits}g} {unit}".removesuffix(" 1")


def quotient(above: str, below: str) -> str:
    """Return the text of a unit divided by another: ``A`` and ``m/s`` give ``A s/m``."""
    powers: dict[str, int] = {}
    for text, sign in ((above, 1), (below, -1)):
        turn = sign
        for word in text.replace("/", " / ").split():
            if word == "/":
                turn = -sign
                continue
            symbol, _, power = word.partition("^")
            powers[symbol] = powers.get(symbol, 0) + turn * int(power or 1)
            turn = sign
    top, bottom = (
        " ".join(
            symbol if abs(power) == 1 else f"{symbol}^{abs(power)}"
            for symbol, power in powers.items()
            if sign * power > 0 and symbol != "1"
        )
        for sign in (1, -1)
    )
    if not bottom:
        return top or "1"
    return f"{top or 1}/({bottom})" if " " in bottom else f"{top or 1}/{bottom}"


#: Derived units that people know better than their base units.
_NAMED: Final = {parse_unit(name).dimension: name for name in ("N", "V", "W", "Pa", "ohm", "H")}


def si_symbol(dimension: Dimension) -> str:
    """Return the SI unit of a dimension: ``N``, ``kg m/s``, or ``1``."""
    if dimension in _NAMED:
        return _NAMED[dimension]
    above = [_power(base, n) for base, n in zip(BASES, dimension, strict=True) if n > 0]
    below = [_power(base, -n) for base, n in zip(BASES, dimension, strict=True) if n < 0]
    return (" ".join(above) or "1") + "".join(f"/{item}" for item in below)


def dimension_text(dimension: Dimension) -> str:
    """Return a dimension for a person: ``N``, ``kg m/s``, or ``a plain number``."""
    return "a plain number" if dimension == NO_DIMENSION else si_symbol(dimension)


def _power(base: str, exponent: int) -> str:
    return base if exponent == 1 else f"{base}^{exponent}"

"""Describes an electronic data sheet (EDS) for printing: identity, and a row for each object."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigd.sdk import DeviceSheet
from rigd_drivers.can.canopen.sheet import Sheet, read_sheet

if TYPE_CHECKING:
    from canopen.objectdictionary import ODVariable

_COLUMNS: Final = ("object", "name", "type", "access", "PDO", "limits", "default", "value")
_IDENTITY: Final = ("vendor number", "product number", "revision number")
_OPEN: Final = "left open"


def describe(path: Path) -> DeviceSheet:
    """Return the content of the EDS or DCF at ``path``.

    Raises:
        ConfigError: it cannot be read, or is wrong; every problem with its line.

    """
    sheet = read_sheet(path)
    rows = tuple(_row(sheet, each) for each in sheet.variables())
    return DeviceSheet(_facts(sheet, rows), _COLUMNS, rows, tuple(sheet.remarks))


def _facts(sheet: Sheet, rows: tuple[tuple[str, ...], ...]) -> dict[str, str]:
    facts = {"vendor": sheet.vendor_name, "product": sheet.product_name}
    for name, number in zip(_IDENTITY, sheet.identity, strict=True):
        facts[name] = _OPEN if number is None else f"0x{number:X}"
    facts["profile"] = _OPEN if sheet.profile is None else str(sheet.profile)
    rates = ", ".join(f"{rate / 1e3:g}" for rate in sorted(sheet.bit_rates))
    facts["bit rates"] = f"{rates} kbit/s" if rates else _OPEN
    if sheet.node is not None:
        facts["node"] = str(sheet.node)
    if sheet.bit_rate is not None:
        facts["bit rate"] = f"{sheet.bit_rate / 1e3:g} kbit/s"
    mappable = sum(1 for row in rows if row[4])
    facts["objects"] = f"{len(rows)} values, {mappable} of them for PDOs"
    values = sum(1 for row in rows if row[7])
    if values:
        facts["values"] = f"{values} as configured (DCF); rigd checks and does not write them"
    return facts


def _row(sheet: Sheet, found: ODVariable) -> tuple[str, ...]:
    where, _, name = sheet.called(found.index, found.subindex).partition(" ")
    mappable = "yes" if found.pdo_mappable else ""
    default = getattr(found, "default_raw", "") if found.relative else _text(found.default)
    rest = (mappable, _limits(found), default, _text(found.value))
    return (where, name, sheet.type_name(found), found.access_type, *rest)


def _limits(found: ODVariable) -> str:
    match found.min, found.max:
        case None, None:
            return ""
        case low, None:
            return f"at least {low}"
        case None, high:
            return f"at most {high}"
        case low, high:
            return f"{low} to {high}"


def _text(value: object) -> str:
    if isinstance(value, bytes):
        return value.hex(" ")
    return "" if value is None else str(value)

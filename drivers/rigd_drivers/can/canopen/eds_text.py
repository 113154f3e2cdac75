"""Parses an electronic data sheet (EDS or DCF) with line numbers, and checks its values.

Source: CiA 306-1, electronic data sheets.

:mod:`sheet` makes objects of the text with the library ``canopen``. That library reports no line
numbers, ignores limits and values that are no numbers, and stops at some makers' files that are
readable. So this module checks the text first, and writes it in one uniform way for the library.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from rigd.model.errors import ConfigError, Place

#: The largest file taken, in bytes; those of real drives have 0.05 to 1.5 MB.
LARGEST: Final = 4 << 20
#: So many problems are named at most.
_MOST_PROBLEMS: Final = 20
_OBJECT: Final = re.compile(r"([0-9A-F]{4})(?:sub([0-9A-F]{1,4}))?", re.IGNORECASE)
_NAMES: Final = re.compile(r"([0-9A-F]{4})name", re.IGNORECASE)
#: No text has these; the second begins commands to a terminal (ECMA-48).
_CONTROL: Final = re.compile(rb"[\x00\x1b]")
#: A number with a leading 0, also behind a sign or `$NODEID+`; no part of a hexadecimal one.
_OCTAL: Final = re.compile(r"(?<!\w)0[0-7]+(?!\w)")
_COMMENT: Final = re.compile(r"\s;.*$")
#: Objects that hold nothing: null, and definitions of types.
_TYPES: Final = (0, 5, 6)
_VARIABLES: Final = (2, 7)
_ARRAY: Final = 8
#: Data types of whole numbers (CiA 301, 7.4.7): their values are numbers, those of others text.
_INTEGERS: Final = (*range(0x01, 0x08), 0x10, *range(0x12, 0x17), *range(0x18, 0x1C))
ACCESSES: Final = ("ro", "wo", "rw", "rwr", "rww", "const")
_RATES: Final = (10, 20, 50, 125, 250, 500, 800, 1000)
_SPELLINGS: Final = {
    word.lower(): word
    for word in (
        "DeviceInfo DeviceComissioning ParameterName ObjectType DataType AccessType PDOMapping "
        "LowLimit HighLimit DefaultValue ParameterValue SubNumber CompactSubObj NrOfEntries NodeID "
        "Baudrate VendorName VendorNumber ProductName ProductNumber RevisionNumber NrOfRXPDO "
        "NrOfTXPDO OrderCode Granularity SimpleBootUpMaster SimpleBootUpSlave GroupMessaging "
        "DynamicChannelsSupported LSS_Supported " + " ".join(f"BaudRate_{rate}" for rate in _RATES)
    ).split()
}
_WORDS: Final = ("VendorName", "ProductName", "OrderCode", "ParameterName", "AccessType")
_VALUES: Final = ("LowLimit", "HighLimit", "DefaultValue", "ParameterValue")
_NUMBERS: Final = frozenset(_SPELLINGS.values()) - {*_WORDS, *_VALUES}
#: Sections that describe neither the device nor its objects.
_BESIDE: Final = ("fileinfo", "comments", "dummyusage")
_LISTS: Final = ("mandatoryobjects", "optionalobjects", "manufacturerobjects")


@dataclass
class Section:
    """A section by its name as this module writes it, with the line that begins it."""

    name: str
    line: int
    values: dict[str, str] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)

    def number(self, key: str, default: int = 0) -> int:
        """Return the whole number at ``key``; ``default`` if it is missing or wrong."""
        return parse_number(self.values.get(key, "")) or default

    def uniform(self, key: str) -> str:
        """Return a value as the library reads it: a number without the octal notation."""
        of_number = key in _VALUES and self.number("DataType") in _INTEGERS
        value = self.values[key]
        return _as_decimal(value) if key in _NUMBERS or of_number else value


class EdsText:
    """The sections of the file at ``path``, by name in lower case."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.sections: dict[str, Section] = {}
        #: What is odd, and happens in files of makers: it hinders nothing.
        self.remarks: list[str] = []
        self._problems: list[ConfigError] = []

    def problem(self, line: int, message: str, hint: str | None = None) -> None:
        """Note that ``line`` is wrong."""
        place = Place(str(self.path), line, 1)
        self._problems.append(ConfigError(message, place=place, hint=hint))

    def raise_any(self) -> None:
        """Raise ConfigError with the problems noted, if there are any."""
        problems = sorted(self._problems, key=lambda each: each.place.line if each.place else 0)
        if problems:
            raise ConfigError.several(problems[:_MOST_PROBLEMS])

    def section(self, name: str) -> Section | None:
        """Return the section called ``name``, in any case."""
        return self.sections.get(name.lower())

    def object(self, index: int, sub: int | None = None) -> Section | None:
        """Return the section of an object, or of a part of it."""
        return self.section(object_name(index, sub))

    def objects(self) -> Iterator[tuple[int, int | None, Section]]:
        """Yield index, sub-index (None for that of the whole) and section of every object."""
        for section in self.sections.values():
            found = _OBJECT.fullmatch(section.name)
            if found:
                sub = found[2]
                yield int(found[1], 16), None if sub is None else int(sub, 16), section

    def written(self) -> str:
        """Return what the library shall read, spelt as it expects."""
        return "\n".join(
            line
            for section in self.sections.values()
            if section.name.lower() not in (*_BESIDE, *_LISTS) and not self._is_type(section)
            for line in (
                f"[{section.name}]",
                *(f"{key}={section.uniform(key)}" for key in section.values),
            )
        )

    def _is_type(self, section: Section) -> bool:
        found = _OBJECT.fullmatch(section.name)
        whole = None if found is None else self.section(found[1])
        return whole is not None and whole.number("ObjectType", 7) in _TYPES


def object_name(index: int, sub: int | None = None) -> str:
    """Return the name of an object's section."""
    return f"{index:04X}" if sub is None else f"{index:04X}sub{sub:X}"


def parse_number(text: str) -> int | None:
    """Return a number in the notation of CiA 306, None if it is not a number.

    Numbers are decimal, hexadecimal after `0x`, or octal after a leading `0`.
    """
    try:
        return int(_as_decimal(text), 0)
    except ValueError:
        return None


def _as_decimal(text: str) -> str:
    """Return ``text`` with decimal numbers in place of octal ones, which Python does not read."""
    return _OCTAL.sub(lambda found: str(int(found[0], 8)), text)


def read_text(path: Path) -> EdsText:
    """Return the sections of the file at ``path``.

    Raises:
        ConfigError: it cannot be read, or is no EDS; every problem with its line.

    """
    text = EdsText(path)
    _scan(text, content_of(path))
    text.raise_any()
    if text.section("DeviceInfo") is None:
        text.problem(1, "this is no EDS: it has no section [DeviceInfo]")
    if text.object(0x1000) is None:
        text.problem(1, "the object 0x1000 (device type) is missing, which every device has")
    for section in text.sections.values():
        _check_numbers(text, section)
    _check_lists(text)
    for index, sub, section in text.objects():
        _check_object(text, index, sub, section)
    text.raise_any()
    return text


def content_of(path: Path) -> str:
    """Return the text of the file at ``path``, its lines ended by LF.

    Raises:
        ConfigError: it cannot be read, is too large, or is no text.

    """
    if not path.is_file():
        raise ConfigError(f"{path}: there is no such file")
    try:
        size = path.stat().st_size
        if size > LARGEST:
            raise ConfigError(
                f"{path}: {size / 1e6:.1f} MB are too much for an EDS (at most "
                f"{LARGEST / 1e6:.1f} MB)"
            )
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    if _CONTROL.search(data):
        raise ConfigError(f"{path}: this is no EDS: it is not text", hint="an EDS is an INI file")
    try:
        content = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        content = data.decode("latin-1")  # the standard requires ASCII, makers write °C and µm
    return content.replace("\r\n", "\n").replace("\r", "\n")


def _scan(text: EdsText, content: str) -> None:
    section: Section | None = None
    for number, raw in enumerate(content.split("\n"), start=1):
        line = raw.strip()
        if not line or line[0] in ";#":
            continue
        if line[0] == "[":
            section = _begin(text, number, line)
            continue
        key, equals, value = line.partition("=")
        if not equals or section is None:
            if line.startswith("<"):
                hint = "XDD files (XML) are not read; makers give an EDS too"
            else:
                hint = "an EDS is an INI file: sections, and values below them"
            text.problem(number, f"expected [section] or key=value, found {line[:40]!r}", hint)
            return
        _put(text, section, number, key.strip(), _COMMENT.sub("", value).strip())


def _begin(text: EdsText, number: int, line: str) -> Section:
    name, bracket, _ = line[1:].partition("]")
    name = name.strip()
    if not bracket:
        text.problem(number, f"expected ']' at the end of {line[:40]!r}")
    found, names = _OBJECT.fullmatch(name), _NAMES.fullmatch(name)
    if found:
        sub = found[2]
        name = object_name(int(found[1], 16), None if sub is None else int(sub, 16))
    elif names:
        name = names[1] + "Name"  # the key that the library reads
    section = Section(_SPELLINGS.get(name.lower(), name), number)
    other = text.sections.setdefault(name.lower(), section)
    if other is not section:
        text.problem(number, f"section [{name}] stands here again, first in line {other.line}")
    return section


def _put(text: EdsText, section: Section, number: int, key: str, value: str) -> None:
    key = _SPELLINGS.get(key.lower(), key)
    if key in section.lines:
        text.problem(
            number, f"{key} stands here again in [{section.name}], first in line "
            f"{section.lines[key]}"
        )  # fmt: skip
    section.lines[key] = number
    if value:  # nothing stands for "not given"
        section.values[key] = value


def _check_numbers(text: EdsText, section: Section) -> None:
    for key, value in section.values.items():
        if key in _NUMBERS and parse_number(value) is None:
            text.problem(
                section.lines[key], f"{key} of [{section.name}] is {value!r}, expected a number"
            )
    if section.number("NrOfEntries") > 0xFF or section.number("CompactSubObj") > 0xFF:
        text.problem(section.line, f"[{section.name}] has more than 255 entries")


def _check_lists(text: EdsText) -> None:
    """Check that the file contains every object that its lists name."""
    for name in _LISTS:
        section = text.section(name)
        for key, value in {} if section is None else dict(section.values).items():
            index = parse_number(value)
            if section is None or not key.isdigit() or not key.isascii():
                continue
            if index is None:
                text.problem(section.lines[key], f"{value!r} in [{section.name}] is no index")
            elif text.object(index) is None:
                text.remarks.append(
                    f"line {section.lines[key]}: [{section.name}] lists 0x{index:04X}, and there "
                    f"is no section [{index:04X}]"
                )


def _check_object(text: EdsText, index: int, sub: int | None, section: Section) -> None:
    whole = text.object(index)
    if whole is None:
        text.problem(section.line, f"[{section.name}] stands here without [{index:04X}]")
        return
    if sub is not None and sub > 0xFF:
        text.problem(section.line, f"[{section.name}]: a sub-index is at most FF")
    kind = whole.number("ObjectType", 7)
    if kind in _TYPES or (sub is not None and kind in _VARIABLES):
        return
    compact = kind == _ARRAY and "CompactSubObj" in section.values
    is_value = sub is not None or kind in _VARIABLES or compact
    needed = ("ParameterName", "DataType", "AccessType") if is_value else ("ParameterName",)
    for key in needed:
        if key not in section.values:
            text.problem(section.line, f"{key} is missing in [{section.name}]")
    access = section.values.get("AccessType", "ro")
    if is_value and access.lower() not in ACCESSES:
        text.problem(
            section.lines["AccessType"],
            f"AccessType of [{section.name}] is {access!r}, expected {', '.join(ACCESSES)}",
        )


def device_number(values: Mapping[str, str], key: str) -> int | None:
    """Return a number that differs between devices; None if the file leaves it open (0)."""
    return parse_number(values.get(key, "")) or None

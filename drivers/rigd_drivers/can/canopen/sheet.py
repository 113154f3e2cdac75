"""Reads the objects of a CANopen device from its EDS or DCF, with the library ``canopen``.

Before the driver sends anything, a sheet answers these questions:

* does the object exist;
* may the driver write the object;
* is the value within its limits;
* may the object be mapped to a PDO.

An answer is None if all is well, else a text for a person that begins with the line of the file.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Iterable, Iterator
from configparser import Error as IniError
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigd.model.errors import ConfigError
from rigd_drivers.can.canopen.eds_text import EdsText, device_number, parse_number, read_text
from rigd_drivers.can.canopen.objects import DEVICE_TYPE, HEARTBEAT_CONSUMER, Entry
from rigd_drivers.can.canopen.pdo import Pdo

if TYPE_CHECKING:
    from canopen import ObjectDictionary
    from canopen.objectdictionary import ODVariable

#: What a value may be relative to, such as the identifier of a PDO.
_RELATIVE: Final = "$NODEID"
#: Where the parameters of PDOs stand (CiA 301, 7.5.2.35 to 7.5.2.38).
_PDO_PARAMETERS: Final = range(0x1400, 0x1C00)
#: Accesses that forbid one direction of a PDO, by whether the node sends it (CiA 306-1).
_NOT_SENT: Final = ("wo", "rww")
_NOT_RECEIVED: Final = ("ro", "const", "rwr")


class Sheet:
    """The contents of the file at ``path``; ``od`` holds its objects."""

    def __init__(self, text: EdsText, od: ObjectDictionary) -> None:
        self.path = text.path
        self.od = od
        self._text = text
        info = text.section("DeviceInfo")
        values = {} if info is None else info.values
        self.product_name = values.get("ProductName", "unnamed")
        self.vendor_name = values.get("VendorName", "unknown")
        #: Vendor, product and revision numbers (object 1018); None if the file leaves it open.
        self.identity = tuple(
            device_number(values, key)
            for key in ("VendorNumber", "ProductNumber", "RevisionNumber")
        )
        self.bit_rates = frozenset(od.device_information.allowed_baudrates)
        commissioned = text.section("DeviceComissioning")
        self.node = None if commissioned is None else commissioned.number("NodeID") or None
        self.bit_rate = (
            None if commissioned is None else commissioned.number("Baudrate") * 1000 or None
        )

    @property
    def remarks(self) -> list[str]:
        """What is odd about the file, and hinders nothing."""
        return self._text.remarks

    @property
    def profile(self) -> int | None:
        """Number of the CiA profile that the device follows; None if the file does not state it."""
        found = self.find(DEVICE_TYPE.index)
        kind = None if found is None else found.default
        return kind & 0xFFFF if isinstance(kind, int) and kind else None

    # -- objects -------------------------------------------------------------------------------

    def find(self, index: int, sub: int = 0) -> ODVariable | None:
        """Return the object at ``index``:``sub``.

        For an array or an object without parts, the library returns any requested sub-index.
        """
        whole = self._text.object(index)
        compact = 0 if whole is None else whole.number("CompactSubObj")
        if sub > compact and self._text.object(index, sub) is None:
            return None
        return self.od.get_variable(index, sub)

    def variables(self) -> Iterator[ODVariable]:
        """Yield everything that has a value, in order."""
        from canopen.objectdictionary import ODVariable

        for index in sorted(self.od):
            whole = self.od[index]
            yield from [whole] if isinstance(whole, ODVariable) else whole.subindices.values()

    @staticmethod
    def type_name(found: ODVariable) -> str:
        """Return the type in the words of CiA 301."""
        from canopen.objectdictionary import datatypes

        names = {number: name for name, number in vars(datatypes).items() if name.isupper()
                 and isinstance(number, int)}  # fmt: skip
        return names.get(found.data_type or 0, f"0x{found.data_type or 0:X}")

    def called(self, index: int, sub: int = 0) -> str:
        """Return index and name of an object as messages give them."""
        found = self.find(index, sub)
        whole = self.od.get(index)
        where = f"0x{index:04X}" + (f":{sub:02X}" if sub or whole is not found else "")
        name = getattr(whole, "name", "")
        if found is not None and found is not whole:
            name = f"{name}, {found.name}"
        return f"{where} {name}".rstrip()

    def at(self, index: int, sub: int = 0, key: str = "") -> str:
        """Return file and line of an object, or of its ``key`` if it has the key."""
        section = self._text.object(index, sub) or self._text.object(index)
        line = 1 if section is None else section.lines.get(key, section.line)
        return f"{self.path.name}:{line}"

    # -- what may be done ----------------------------------------------------------------------

    def unreadable(self, entry: Entry) -> str | None:
        """Return why ``entry`` cannot be read."""
        found = self.find(entry.index, entry.sub)
        if found is None:
            return self._missing(entry)
        if not found.readable:
            return f"{self._at(entry, 'AccessType')} is write only ({found.access_type})"
        return self._other_size(entry, found)

    def unwritable(self, entry: Entry, value: int | None = None) -> str | None:
        """Return why ``entry``, or ``value`` to it, cannot be written."""
        found = self.find(entry.index, entry.sub)
        if found is None:
            return self._missing(entry)
        if not found.writable:
            return f"{self._at(entry, 'AccessType')} is read only ({found.access_type})"
        size = self._other_size(entry, found)
        if size or value is None:
            return size
        return self.beyond(entry, value)

    def beyond(self, entry: Entry, value: int) -> str | None:
        """Return which limit ``value`` of ``entry`` is beyond."""
        if _is_composed(entry):
            return None
        found = self.find(entry.index, entry.sub)
        if found is not None and found.min is not None and value < found.min:
            return f"{self._at(entry, 'LowLimit')} is at least {found.min}, not {value}"
        if found is not None and found.max is not None and value > found.max:
            return f"{self._at(entry, 'HighLimit')} is at most {found.max}, not {value}"
        return None

    def unmappable(self, pdo: Pdo) -> Iterator[str]:
        """Yield why ``pdo`` cannot be set up."""
        reported = set()
        kept = {entry for entry, value in pdo.mapping()} if self._has_mapped(pdo) else set()
        for entry, value in pdo.setup():
            if entry in kept:
                continue
            problem = self.unwritable(entry, value)
            if problem and entry not in reported:
                reported.add(entry)
                yield problem
        for entry in pdo.entries:
            found = self.find(entry.index, entry.sub)
            forbidden = _NOT_SENT if pdo.transmit else _NOT_RECEIVED
            if found is None:
                yield self._missing(entry)
            elif not found.pdo_mappable:
                yield f"{self._at(entry, 'PDOMapping')} cannot be mapped to {pdo}"
            elif found.access_type in forbidden:
                access = self._at(entry, "AccessType")
                yield f"{access} cannot be mapped to {pdo}: it is {found.access_type}"
            elif size := self._other_size(entry, found):
                yield size

    def _has_mapped(self, pdo: Pdo) -> bool:
        """Return whether ``pdo`` is mapped as wanted from the start, and need not be writable."""
        found = ((self.find(entry.index, entry.sub), value) for entry, value in pdo.mapping())
        return all(each is not None and each.default == value for each, value in found)

    def another_device(self, found: Iterable[int | None]) -> str | None:
        """Return how vendor, product and revision ``found`` on the bus differ.

        The lower half of a revision may differ: it changes nothing on CANopen (CiA 301, 1018h:3).
        """
        for what, reported, given in zip(
            ("vendor", "product", "major revision"), found, self.identity, strict=True
        ):
            if reported is None or given is None:
                continue
            shift = 16 if what == "major revision" else 0
            if reported >> shift != given >> shift:
                return f"its {what} is 0x{reported >> shift:X}, {self.path.name} is of one with " \
                    f"0x{given >> shift:X} ({self.vendor_name} {self.product_name})"  # fmt: skip
        return None

    # -- within --------------------------------------------------------------------------------

    def _at(self, entry: Entry, key: str) -> str:
        where = self.at(entry.index, entry.sub, key)
        return f"{where}: {self.called(entry.index, entry.sub)}"

    def _missing(self, entry: Entry) -> str:
        whole = self.od.get(entry.index)
        where = f"0x{entry.index:04X}" + (f":{entry.sub:02X}" if entry.sub else "")
        part = "" if whole is None else f" in 0x{entry.index:04X} {whole.name}"
        section = self._text.object(entry.index)
        line = "" if section is None else f":{section.line}"
        return f"{self.path.name}{line}: there is no object {where} ({entry.name}){part}"

    def _other_size(self, entry: Entry, found: ODVariable) -> str | None:
        size = len(found) // 8
        if found.fixed_size and size != entry.size:
            has = self._at(entry, "DataType")
            return f"{has} has {size} byte{'s' * (size > 1)}, this driver expects {entry.size}"
        return None


def _is_composed(entry: Entry) -> bool:
    """Return whether CiA 301 puts the value together of fields, so that it is no number to limit.

    Makers limit it all the same: the EDS of Elmo's Gold drives allows 65535 in 1016h, whose node id
    stands above that.
    """
    of_pdo = entry.index in _PDO_PARAMETERS and entry.code == "I"  # COB-id, or an object mapped
    return of_pdo or entry.index == HEARTBEAT_CONSUMER.index


def read_sheet(path: Path) -> Sheet:
    """Return the sheet in the EDS or DCF at ``path``.

    Raises:
        ConfigError: it cannot be read, or is wrong; every problem with its line.

    """
    try:
        stamp = path.stat().st_mtime_ns
    except OSError:
        stamp = 0  # reported by what reads it
    return _read(path, stamp)


@lru_cache(maxsize=16)
def _read(path: Path, stamp_ns: int) -> Sheet:
    from canopen.objectdictionary.eds import import_eds

    # What the library passes over is a problem here, and not for it to print.
    logging.getLogger("canopen").addHandler(logging.NullHandler())
    text = read_text(path)
    try:
        od = import_eds(io.StringIO(text.written()), None)
    except (IniError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise ConfigError(f"{path}: cannot be understood: {error}") from error
    sheet = Sheet(text, od)
    for variable in sheet.variables():
        _check_values(text, variable)
    text.raise_any()
    return sheet


def _check_values(text: EdsText, variable: ODVariable) -> None:
    """Check the limits, and the value of a DCF, that the library took or passed over."""
    from canopen.objectdictionary import datatypes

    section = text.object(variable.index, variable.subindex) or text.object(variable.index)
    if section is None or variable.data_type not in datatypes.INTEGER_TYPES:
        return
    for key in ("LowLimit", "HighLimit", "ParameterValue"):
        written = section.values.get(key, "0")
        if _RELATIVE not in written.upper() and parse_number(written.replace(" ", "")) is None:
            text.problem(
                section.lines[key], f"{key} of [{section.name}] is {written!r}, expected a number"
            )
            return
    low, high, value = variable.min, variable.max, variable.value
    if low is not None and high is not None and low > high:
        text.problem(
            section.lines["LowLimit"],
            f"LowLimit of [{section.name}] is {low}, above its HighLimit of {high}",
        )
    elif value is not None:
        half = 1 << len(variable) - 1
        signed = variable.data_type in datatypes.SIGNED_TYPES
        least, most = (-half, half - 1) if signed else (0, 2 * half - 1)
        if most < value < 2 * half:
            value -= 2 * half  # written as its bits
        least = least if low is None else max(least, low)
        most = most if high is None else min(most, high)
        if not least <= value <= most:
            text.problem(
                section.lines["ParameterValue"],
                f"ParameterValue of [{section.name}] is {value}, expected {least} to {most}",
            )

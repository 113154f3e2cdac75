"""Compares a CANopen device of the rig file with its electronic data sheet (EDS)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le
from pydantic import ValidationInfo, field_validator

from rigd.model.errors import ConfigError
from rigd.sdk import DriverConfig, LinkConfig, ProtocolError, shipped_configs
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.canopen.eds_text import content_of
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.canopen.pdo import Pdo
from rigd_drivers.can.canopen.sheet import Sheet, read_sheet
from rigd_drivers.device_file import own_files

#: What to do when device and EDS disagree.
WRONG_EDS = "correct `eds`, or leave it out if the maker's file is wrong"


class NodeConfig(DriverConfig):
    """Which node it is; options that every CANopen device has."""

    node: Annotated[int, Ge(1), Le(127)]
    """Node id of the device, as set at it."""
    serial: int | None = None
    """Serial number that the device must have (object 1018:4); none: any."""
    eds: str | None = None
    """EDS or DCF of the device, beside the rig file or shipped: what the driver does is checked
    against it before anything is sent, and messages give its names. None: nothing is checked."""

    @field_validator("eds")
    @classmethod
    def _is_read(cls, name: str | None, info: ValidationInfo) -> str | None:
        """Find and read the file; ``folder`` in the context is the folder of the rig file."""
        if name is None:
            return None
        beside = Path((info.context or {}).get("folder") or Path.cwd()) / name
        found = next((p for p in (beside, shipped_configs() / name) if p.is_file()), None)
        if found is None:
            raise ValueError(f"there is no EDS {name!r}, neither {beside} nor a shipped one")
        try:
            read_sheet(found.resolve())
        except ConfigError as error:
            raise ValueError(str(error)) from error
        return str(found.resolve())

    def files(self) -> Mapping[Path, str]:
        """Return the EDS, and the lab's own profile; see :class:`DriverConfig`."""
        sheet = {} if self.eds is None else {Path(self.eds): content_of(Path(self.eds))}
        return {**sheet, **own_files(self)}

    def sheet(self) -> Sheet | None:
        """Return the content of the EDS; None without an EDS."""
        return None if self.eds is None else read_sheet(Path(self.eds))


@dataclass(frozen=True)
class Plan:
    """SDO transfers of a driver before the first cycle; ``optional`` are writes if it has them."""

    profile: int
    reads: Sequence[Entry]
    writes: Sequence[tuple[Entry, int]]
    pdos: Sequence[Pdo]
    optional: Sequence[tuple[Entry, int]] = ()


def contradictions(config: NodeConfig, link: LinkConfig | None, plan: Plan) -> list[str]:
    """Return what in the EDS contradicts ``plan`` on ``link``, a sentence each."""
    sheet = config.sheet()
    if sheet is None:
        return []
    return [*_connection_problems(sheet, config.node, getattr(link, "bitrate", None)),
            *_profile_problems(sheet, plan.profile), *_object_problems(sheet, plan)]  # fmt: skip


def refuse(device: object, problems: Sequence[str]) -> None:
    """Raise ProtocolError if there are ``problems``; nothing is sent then."""
    if problems:
        raise ProtocolError(f"{device}: {'; '.join(problems)}", hint=WRONG_EDS)


def _connection_problems(sheet: Sheet, node: int, bitrate: float | None) -> Iterator[str]:
    """Yield how node id and bit rate (bit/s; None: not known) differ from the EDS."""
    name = sheet.path.name
    if sheet.node is not None and sheet.node != node:
        yield f"{name} is of node {sheet.node}, `node` is {node}"
    if bitrate is None:
        return
    if sheet.bit_rate is not None and sheet.bit_rate != bitrate:
        yield (
            f"{name} is of a device set to {sheet.bit_rate / 1e3:g} kbit/s, the link has "
            f"{bitrate / 1e3:g} kbit/s"
        )
    elif sheet.bit_rates and bitrate not in sheet.bit_rates:
        known = ", ".join(f"{rate / 1e3:g}" for rate in sorted(sheet.bit_rates))
        yield f"{name} offers {known} kbit/s, the link has {bitrate / 1e3:g} kbit/s"


def _profile_problems(sheet: Sheet, profile: int) -> Iterator[str]:
    if sheet.profile not in (None, profile):
        where = sheet.at(objects.DEVICE_TYPE.index, key="DefaultValue")
        yield f"{where}: this is a device of profile {sheet.profile}, this driver is for {profile}"


def _object_problems(sheet: Sheet, plan: Plan) -> Iterator[str]:
    """Yield why the device cannot do the transfers of ``plan`` by its EDS; each problem once."""
    reported: dict[str, None] = {}
    for entry in (objects.DEVICE_TYPE, *plan.reads):
        if problem := sheet.unreadable(entry):
            reported[problem] = None
    known = [each for each in plan.optional if sheet.find(each[0].index, each[0].sub) is not None]
    for entry, value in (*plan.writes, *known):
        if problem := sheet.unwritable(entry, value):
            reported[problem] = None
    for pdo in plan.pdos:
        reported |= dict.fromkeys(sheet.unmappable(pdo))
    yield from reported

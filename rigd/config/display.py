"""Reads the units in which people read and write the values of a device (``display``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from rigd.config.document import Document, KeyPath
from rigd.config.problems import Problems, suggest
from rigd.model.channels import Channel
from rigd.model.units import parse_unit
from rigd.sdk import Declaration


def displayed(
    document: Document,
    device: KeyPath,
    units: Mapping[str, str],
    declaration: Declaration,
    problems: Problems,
) -> Declaration:
    """Return ``declaration`` with the display units of the file; wrong ones are noted."""
    known: dict[str, Channel] = {
        item.name: item for item in (*declaration.setpoints, *declaration.channels)
    }
    fitting: dict[str, str] = {}
    for name, text in units.items():
        path = (*device, "display", name)
        channel = known.get(name)
        if channel is None:
            problems.add(document.key_place(path), f"{device[-1]} has no channel {name!r}",
                         suggest(name, known))  # fmt: skip
        elif fits(document, path, text, channel, problems):
            fitting[name] = text
    if not fitting:
        return declaration

    def shown(channels: tuple[Channel, ...]) -> tuple[Channel, ...]:
        return tuple(
            replace(item, display=fitting.get(item.name, item.display)) for item in channels
        )

    return replace(
        declaration,
        channels=shown(declaration.channels),
        setpoints=shown(declaration.setpoints),
    )


def fits(
    document: Document, path: KeyPath, text: str, channel: Channel, problems: Problems
) -> bool:
    """Return whether ``text`` is a unit for values of ``channel``; if not, that is noted."""
    try:
        unit = parse_unit(text)
    except ValueError as error:
        problems.add(document.place(path), str(error), f"the channel is in {channel.unit}")
        return False
    if not unit.same_kind(parse_unit(channel.unit)):
        problems.add(document.place(path), f"{channel.name} is in {channel.unit}, not in {text}",
                     f"give a unit of the same kind as {channel.unit}")  # fmt: skip
        return False
    return True

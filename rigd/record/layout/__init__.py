"""Makes layouts for viewers, with the channels of a rig on plots: Foxglove, PlotJuggler.

What a layout shows follows from the streams, so each rig has one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from rigd.model import Stream
from rigd.record.layout import foxglove, plotjuggler
from rigd.record.layout.plots import Tab, tabs_of

__all__ = ["FORMATS", "Format", "Viewer", "layout"]

Viewer = Literal["foxglove", "plotjuggler"]


@dataclass(frozen=True)
class Format:
    """The layout files of one viewer: their suffix, and what makes the text of one."""

    suffix: str
    text: Callable[[Sequence[Tab]], str]


FORMATS: Final[Mapping[Viewer, Format]] = {
    "foxglove": Format(".json", foxglove.text),
    "plotjuggler": Format(".xml", plotjuggler.text),
}


def layout(streams: Sequence[Stream], viewer: Viewer) -> str:
    """Return the layout file of ``viewer`` for recordings of these streams."""
    return FORMATS[viewer].text(tabs_of(streams))

"""Chooses which channels share a plot, and which plots share a tab."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rigd.model import Stream
from rigd.model.channels import ECHO

#: Plots in the first tab: more of them are too low to read.
MOST_PLOTS: Final = 6
MOST_NAMES: Final = 3  #: in the title of a plot
#: The stream of the cycles themselves: a tab, but nothing to look at first.
_CYCLE: Final = "cycle"


@dataclass(frozen=True)
class Plot:
    """Fields of one stream with one unit, in SI as they are recorded."""

    stream: str
    unit: str
    fields: tuple[str, ...]

    @property
    def title(self) -> str:
        """Stream, names and unit, for people; without the names if there are many."""
        names = [name for name in self.fields if not name.endswith(ECHO)] or list(self.fields)
        named = f" {', '.join(names)}" if len(names) <= MOST_NAMES else ""
        return f"{self.stream}{named}" + ("" if self.unit == "1" else f" [{self.unit}]")


@dataclass(frozen=True)
class Tab:
    """Plots that are seen together."""

    title: str
    plots: tuple[Plot, ...]


def tabs_of(streams: Sequence[Stream]) -> tuple[Tab, ...]:
    """Return an overview with a plot per stream, then a tab for each stream with all its plots.

    Raw readings are left out. The plot of a stream in the overview is that of its first setpoint,
    or of its first channel.
    """
    each = [Tab(item.name, _plots(item)) for item in streams]
    firsts = [max(tab.plots, key=_has_setpoint) for tab in each if tab.title != _CYCLE]
    return (Tab("overview", tuple(firsts[:MOST_PLOTS])), *each)


def _has_setpoint(plot: Plot) -> bool:
    return any(name.endswith(ECHO) for name in plot.fields)


def _plots(stream: Stream) -> tuple[Plot, ...]:
    shown = [channel for channel in stream.channels if channel.raw_of is None]
    by_unit: dict[str, list[str]] = {}
    for channel in shown or stream.channels:
        by_unit.setdefault(channel.unit, []).append(channel.name)
    return tuple(Plot(stream.name, unit, tuple(names)) for unit, names in by_unit.items())

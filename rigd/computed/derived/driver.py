"""Reads derived channels in the cycle, as if a device measured them, from the rows of the devices.

The channels of a group (``friction.mu`` and ``friction.power``) are a stream of their own. One
evaluator computes the graph of all groups once per cycle, after all devices were read, and the
cycle takes all rows at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rigd.computed.derived.graph import Graph
from rigd.computed.driver import Computed, ComputedConfig
from rigd.model.channels import Channel
from rigd.sdk import Declaration

if TYPE_CHECKING:  # a rig file is checked without numpy
    from rigd.computed.derived.evaluator import Evaluator

#: Name in recordings and lists, in place of that of a driver.
DERIVED: Final = "derived"


class DerivedConfig(ComputedConfig):
    """The channels of a group; made by rigd from `derived`."""

    graph: Graph
    """The graph of all derived channels of the rig."""
    group: str
    """Name of the group."""
    channels: tuple[Channel, ...]
    """The channels of the group."""

    @property
    def devices(self) -> frozenset[str]:
        """The devices from which the channels of the group are computed."""
        names = self.graph.groups()[self.group]
        uses = frozenset[str]().union(*(self.graph.uses[name] for name in names))
        return frozenset(name.partition(".")[0] for name in uses)


class Derived(Computed[DerivedConfig, "Evaluator"]):
    """A group of derived channels in the cycle."""

    title = "channels computed from others"
    Config = DerivedConfig

    def __init__(self, config: DerivedConfig, link: Evaluator) -> None:
        super().__init__(config, link)
        place = list(config.graph.groups()).index(config.group)
        self.packed = link.packed[place]

    @classmethod
    def declare(cls, config: DerivedConfig) -> Declaration:
        """Return the channels of the group."""
        return Declaration(channels=config.channels, plain_rows=True, has_status=True)

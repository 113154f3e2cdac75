"""Reads derived channels in the cycle, as if a device measured them, from the rows of the devices.

The channels of a group (``friction.mu`` and ``friction.power``) are a stream of their own. One
evaluator computes the graph of all groups once per cycle, after all devices were read, and the
cycle takes all rows at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rigd.derived.graph import Graph
from rigd.model.channels import Channel
from rigd.sdk import Declaration, Driver, DriverConfig

if TYPE_CHECKING:  # a rig file is checked without numpy
    from rigd.derived.evaluator import Evaluator

#: Name in recordings and lists, in place of that of a driver.
DERIVED: Final = "derived"


class DerivedConfig(DriverConfig):
    """The channels of a group; made by rigd from `derived`, never written in a file."""

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


class Derived(Driver[DerivedConfig, "Evaluator"]):
    """A group of derived channels in the cycle. It moves nothing: there is nothing to make safe."""

    title = "channels computed from others"
    Config = DerivedConfig

    def __init__(self, config: DerivedConfig, link: Evaluator) -> None:
        super().__init__(config, link)
        place = list(config.graph.groups()).index(config.group)
        #: The newest row as a ring has it; the memory stays the same.
        self.packed = link.packed[place]

    @classmethod
    def declare(cls, config: DerivedConfig) -> Declaration:
        """Return the channels of the group."""
        return Declaration(channels=config.channels, plain_rows=True, has_status=True)

    def open(self) -> None:
        """Do nothing: there is no device."""

    def arm(self) -> None:
        """Do nothing: it only computes."""

    def read(self, t_ns: int) -> None:
        """Do nothing: the cycle takes the rows of all groups from the evaluator."""

    def make_safe(self) -> None:
        """Do nothing: it only computes."""

"""Defines what stands in the place of a device for what the cycle computes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from rigd.sdk import Driver, DriverConfig


class ComputedConfig(DriverConfig):
    """The checked options of something computed; made by rigd, never written in a file."""


ConfigT = TypeVar("ConfigT", bound=ComputedConfig)
LinkT = TypeVar("LinkT")


class Computed(Driver[ConfigT, LinkT]):
    """Something that the cycle computes, and shows and records like the rows of a device.

    It moves nothing itself: there is nothing to open, to arm or to make safe.
    """

    #: The newest row as a ring has it; the memory stays the same.
    packed: memoryview

    def open(self) -> None:
        """Do nothing: there is no device."""

    def arm(self) -> None:
        """Do nothing: it only computes."""

    def read(self, t_ns: int) -> Sequence[float] | None:
        """Return None: the cycle takes the row when it is computed."""
        return None

    def make_safe(self) -> None:
        """Do nothing: it moves nothing."""

"""Defines the base class of links: an opened connection that several devices share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from rigd.sdk.options.documented_model import Documented


class LinkConfig(Documented):
    """The options of one link in a rig file: frozen, every key known, every field documented."""


@dataclass(frozen=True)
class DeviceSheet:
    """Data of a device from its maker's file, for a person to read."""

    facts: Mapping[str, str]  #: by name, in the order to be read
    columns: tuple[str, ...]
    objects: tuple[tuple[str, ...], ...]  #: a row each, as ``columns`` say
    remarks: tuple[str, ...] = ()  #: unusual entries that have no consequence


class Link(ABC):
    """A connection shared by devices, opened before them and closed after them.

    Constructed as ``Link(config)``; the constructor opens nothing. What it offers to the drivers
    on it (send a frame, take a register) is between the two.
    """

    Config: ClassVar[type[LinkConfig]] = LinkConfig
    #: One line for a person: what it connects.
    title: ClassVar[str] = ""
    #: The name that drivers give as their ``link_kind``; links of one kind are interchangeable.
    kind: ClassVar[str] = ""
    #: Whether the rescue of one device on it makes all devices on it safe; it is then called once.
    rescued_whole: ClassVar[bool] = False
    #: Whether :meth:`begin`, and ``read`` of every device on it, send nothing that a device acts
    #: on: then rows are recorded for a while after the rig was made safe, without :meth:`end`.
    reads_on: ClassVar[bool] = False

    def __init__(self, config: Any) -> None:
        self.config = config

    @property
    def load(self) -> float | None:
        """Largest recent share of the capacity of the connection that was used, 0 to 1.

        None if the link does not know it.
        """
        return None

    @property
    def lost(self) -> int:
        """How much of what came was lost since it was opened, since nobody had taken it in.

        Frames, datagrams or bytes, as far as the link knows: a full queue of the kernel, not a
        disturbed cable.
        """
        return 0

    @classmethod
    def read_sheet(cls, path: Path) -> DeviceSheet:
        """Return the content of the file at ``path`` about a device on such a link.

        Raises:
            ConfigError: it cannot be read, or is wrong; every problem with its line.
        """
        raise NotImplementedError(f"{cls.__name__} reads no files of devices")

    @abstractmethod
    def open(self) -> None:
        """Open the connection and make sure that only this process uses it; move nothing.

        Raises:
            LinkError: it cannot be opened, or another program uses it.
        """

    def begin(self, t_ns: int) -> None:
        """Receive what has arrived, at the start of the cycle at ``t_ns``; never waits.

        Raises:
            LinkError: the connection is lost.
        """

    def end(self, t_ns: int) -> None:
        """Send what the devices wrote, at the end of the cycle at ``t_ns``; never waits.

        Raises:
            LinkError: the connection is lost.

        """

    def idle(self) -> None:
        """Note that no cycle follows for now: the devices have been ordered to be safe.

        Called after the last cycle; :meth:`begin` ends it. A link to devices that send by
        themselves reads on, by an :class:`~rigd.sdk.IdleReader`.
        """

    @abstractmethod
    def close(self) -> None:
        """Close the connection; closing twice is silent."""

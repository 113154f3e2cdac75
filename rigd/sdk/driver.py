"""The driver of a fast device: one exchange per cycle, and a say in what safe means."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict

from rigd.model.channels import Channel


class DriverConfig(BaseModel):
    """The options of one driver in a rig file: frozen, every key known, every field documented.

    Declare quantities as ``Annotated[float, In("A")]``, so that the file must give a unit.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Driver(ABC):
    """One device, exchanged with once per cycle.

    A cycle first calls :meth:`read` on every device, then decides, then calls :meth:`write` on
    every device that takes setpoints. Both must return within a bounded time, allocate nothing
    that grows, and never sleep.

    The class declares ``Config`` (a :class:`DriverConfig`) and is constructed as
    ``Driver(config, link)``. ``link`` is whatever the rig opened for it: a
    :class:`~rigd.sdk.Plant` for devices simulated in process.
    """

    #: Options the rig file may give.
    Config: ClassVar[type[DriverConfig]] = DriverConfig
    #: One line for a person: what the device is.
    title: ClassVar[str] = ""

    def __init__(self, config: Any, link: Any) -> None:
        self.config = config
        self.link = link

    #: What is measured, in the order of a row.
    channels: tuple[Channel, ...] = ()
    #: What is commanded, in the order of :meth:`write`; ``low`` and ``high`` are the device's own.
    setpoints: tuple[Channel, ...] = ()
    #: Whether a row ends in an integer status word.
    has_status: bool = False

    @abstractmethod
    def open(self) -> None:
        """Open the link and prove the device is the one expected; move nothing.

        Raises:
            LinkError: the device cannot be reached.
            ProtocolError: it is not the device the rig file names.

        """

    def preflight(self) -> Sequence[str]:
        """Return what keeps this device from being armed, a sentence each; empty when fit."""
        return ()

    @abstractmethod
    def arm(self) -> None:
        """Enable the actuator, at rest; a sensor has nothing to do."""

    @abstractmethod
    def read(self, t_ns: int) -> Sequence[float] | None:
        """Return the row taken for the cycle at ``t_ns``, or None when there is no new one.

        ``None`` leaves the last values standing and ageing; interlocks see them as stale.

        Raises:
            DeviceError: the device reports a fault.

        """

    def write(self, setpoints: Sequence[float]) -> None:
        """Send the setpoints of this cycle, already limited, in the order of ``setpoints``."""

    @abstractmethod
    def make_safe(self) -> None:
        """Bring the actuator to its safe state; bounded in time, never moves anything on purpose.

        Called on every exit, possibly twice, possibly with the link dead. Every author must say
        what safe means for the device.
        """

    def close(self) -> None:
        """Close the link; closing twice is silent."""

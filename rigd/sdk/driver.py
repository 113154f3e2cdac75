"""Base classes of drivers: fast (every cycle), block (streams of rows), slow (coroutines).

Whatever the kind, the author must say what safe means, and nothing here may wait without a bound.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from rigd.model.channels import Channel
from rigd.sdk.documented import Documented
from rigd.sdk.link import LinkConfig

if TYPE_CHECKING:  # a rig file is checked without numpy
    import numpy as np
    from numpy.typing import NDArray


class DriverConfig(Documented):
    """The options of one driver in a rig file: frozen, every key known, every field documented.

    Declare quantities as ``Annotated[float, In("A")]``, so that the file must give a unit.
    """


class AnyDriver:
    """What drivers of every kind have in common.

    The class declares ``Config`` (a :class:`DriverConfig`) and is constructed as
    ``Driver(config, link)``; the constructor opens nothing. ``link`` is what the rig made for it:
    the :class:`~rigd.sdk.Link` that the rig file names, a :class:`~rigd.sdk.Plant` for devices
    simulated in process, or None where the driver opens a connection of its own (and while a rig
    file is being checked).
    """

    #: Options the rig file may give.
    Config: ClassVar[type[DriverConfig]] = DriverConfig
    #: One line for a person: what the device is.
    title: ClassVar[str] = ""
    #: The kind of link that ``link: NAME`` must lead to, as in ``links: {NAME: {type: KIND}}``;
    #: "" for a driver that opens its own connection or stands on a plant.
    link_kind: ClassVar[str] = ""

    #: What is measured, in the order of a row.
    channels: tuple[Channel, ...] = ()
    #: Whether a row ends in an integer status word. Bit 31 is rigd's own: the row is stale.
    has_status: bool = False
    #: What bits of the status word say, as masks by name: ``{"stable": 1}``. Procedures wait for
    #: them (``scale is stable``); a reading that is not `stable` is not compared with an answer.
    status_bits: Mapping[str, int] = {}
    #: The device has failed once it has given no row for so long, in s.
    silent_s: float = 0.1
    #: What the device said it is, once it is open: type, serial number, firmware.
    identity: str = ""
    #: What a person may ask of it by name, and what that does: ``{"tare": "sets zero"}``.
    actions: Mapping[str, str] = {}

    def __init__(self, config: Any, link: Any) -> None:
        self.config = config
        self.link = link

    def contradictions(self, link: LinkConfig | None) -> Sequence[str]:
        """Return what in the options can never work, a sentence each; asked of every rig file.

        ``link`` holds the options of the link that the rig file names. Nothing is opened.
        """
        return ()

    def preflight(self) -> Sequence[str]:
        """Return what keeps this device from being armed, a sentence each; empty when fit."""
        return ()


class Driver(AnyDriver, ABC):
    """A fast device, exchanged with once per cycle.

    A cycle first lets every link take in what has arrived (:meth:`Link.begin`), calls
    :meth:`read` on every device, then decides, then calls :meth:`write` on every device that
    takes setpoints, then lets every link send (:meth:`Link.end`). All of these return within a
    bounded time, allocate nothing that grows, and never sleep. ``open`` and ``prove_watchdog``
    happen before the first cycle and may take seconds.
    """

    #: What is commanded, in the order of :meth:`write`; ``low`` and ``high`` are the device's own.
    setpoints: tuple[Channel, ...] = ()
    #: Whether there is a row in every cycle: one without is recorded as a stale row. A device with
    #: a pace of its own says False, and only its new rows are recorded.
    every_cycle: bool = True
    #: Whether another process may open the device anew to make it safe (see :meth:`rescue`).
    second_link: ClassVar[bool] = False
    #: The device is safe at most so long after it last heard from us, in s, by a watchdog of its
    #: own; None where it has none. A device that takes setpoints cannot be armed without one,
    #: unless the rig file holds a waiver.
    watchdog_s: float | None = None

    @abstractmethod
    def open(self) -> None:
        """Open the link and prove the device is the one expected; move nothing.

        Raises:
            LinkError: the device cannot be reached.
            ProtocolError: it is not the device the rig file names.

        """

    def prove_watchdog(self) -> float:
        """Fall silent once and return after how many seconds the device made itself safe.

        Called after :meth:`open`, before :meth:`arm`, at zero setpoints; nothing may move.

        Raises:
            DeviceError: it did not within ``watchdog_s``.

        """
        raise NotImplementedError(f"{type(self).__name__} has no watchdog to prove")

    @abstractmethod
    def arm(self) -> None:
        """Begin to enable the actuator, at rest; a sensor has nothing to do.

        Bounded like ``read``; what takes longer goes on in the cycles that follow, until
        :meth:`ready`.
        """

    def ready(self) -> bool:
        """Return whether the actuator is enabled; asked in every cycle after :meth:`arm`."""
        return True

    @abstractmethod
    def read(self, t_ns: int) -> Sequence[float] | None:
        """Return the row taken for the cycle at ``t_ns``, or None when there is no new one.

        ``None`` leaves the last values standing and ageing; interlocks see them as stale.

        Raises:
            DeviceError: the device reports a fault.

        """

    def write(self, setpoints: Sequence[float]) -> None:
        """Send the setpoints of this cycle, already limited, in the order of ``setpoints``."""

    def act(self, action: str) -> None:
        """Begin one of ``actions``; it goes on in the cycles that follow, until :meth:`acted`.

        Raises:
            DeviceError: another one is under way.
            ValueError: there is no such action.

        """
        raise ValueError(f"{type(self).__name__} has no action {action!r}")

    def acted(self) -> str | None:
        """Return what the device said of the action, once; None while it goes on (or is none).

        Raises:
            DeviceError: the device refused, or did not answer; the action is over.

        """
        return None

    @abstractmethod
    def make_safe(self) -> None:
        """Bring the actuator to its safe state; bounded in time, never moves anything on purpose.

        Called on every exit, possibly twice, possibly with the link dead. Every author must say
        what safe means for the device.
        """

    def rescue(self) -> None:
        """Make the device safe over a link of this driver's own, opened anew; then close it.

        Called on a fresh instance (with a fresh, unopened link) in another process, after the one
        that drove the device was killed. Bounded to about 0.5 s. Only where ``second_link``.

        Raises:
            LinkError: the device cannot be reached.

        """
        raise NotImplementedError(f"{type(self).__name__} has no second link")

    def close(self) -> None:
        """Close the link; closing twice is silent."""


@dataclass(frozen=True, eq=False)
class Block:
    """Rows taken together: ``times_ns`` int64 of shape (n,), ``values`` float64 of shape (n, k).

    Times are CLOCK_MONOTONIC in ns (on a plant: its clock), increasing; the k columns are in the
    order of ``channels``, the status word last where the driver has one.
    """

    times_ns: NDArray[np.int64]
    values: NDArray[np.float64]


class BlockDriver(AnyDriver, ABC):
    """A device whose library blocks and hands over many rows at once; it takes no setpoints.

    It runs in a helper process of its own, so it may wait. ``open``, ``start``, then
    ``read_block`` again and again, then ``close``.

    One that is simulated on a plant (``on_plant``) runs in the cycle instead: ``start`` and
    ``read_block(0.0)`` are called with the plant advanced to the cycle's time, ``read_block``
    until it gives None. There it never waits, and the times of its rows are on the clock that
    :meth:`Plant.advance` gets, none of them later than the plant.
    """

    #: Whether it stands on the rig's plant, which ``link`` then is.
    on_plant: ClassVar[bool] = False
    #: Rows per second, once open.
    rate_hz: float = 0.0
    #: How old its newest row becomes before the next block comes, in s, while all is well. A rig
    #: file whose interlock calls rows stale sooner is refused.
    oldest_s: float = 0.0

    @abstractmethod
    def open(self) -> None:
        """Open the device; see :meth:`Driver.open`."""

    @abstractmethod
    def start(self) -> None:
        """Begin to sample."""

    @abstractmethod
    def read_block(self, timeout_s: float) -> Block | None:
        """Wait for the next rows, at most ``timeout_s``; None when there are none yet.

        Raises:
            DeviceError: samples were lost, or the device is gone.

        """

    def newest_row(self, block: Block) -> Sequence[float]:
        """Return the row that the cycle sees of ``block``; by default its last.

        Interlocks and end conditions act on it. A driver of noisy inputs may give a median of the
        last rows, so that no single sample stops a run. All rows are recorded as they are.
        """
        row: list[float] = block.values[-1].tolist()
        return row

    def close(self) -> None:
        """Stop sampling and close; closing twice is silent."""


#: ``emit(row)``: takes one row, the status word (an int) last where the driver has one.
EmitRow = Callable[[Sequence[float]], None]


class SlowDriver(AnyDriver, ABC):
    """A slow device: a coroutine that runs until it is cancelled; it takes no setpoints.

    It runs on the event loop of the daemon, beside other devices: it never blocks.
    """

    silent_s: float = 2.0

    @abstractmethod
    async def open(self) -> None:
        """Open the link and prove the device is the one expected; see :meth:`Driver.open`."""

    @abstractmethod
    async def run(self, emit: EmitRow) -> None:
        """Hand every row to ``emit`` as it comes, until cancelled.

        Raises:
            DeviceError: the device reports a fault, or is gone.

        """

    async def act(self, action: str) -> str:
        """Do one of ``actions`` while :meth:`run` goes on; return what the device said.

        Raises:
            DeviceError: the device refused.
            ValueError: there is no such action.

        """
        raise ValueError(f"{type(self).__name__} has no action {action!r}")

    async def close(self) -> None:
        """Leave the device quiet (no stream left on) and close; closing twice is silent."""

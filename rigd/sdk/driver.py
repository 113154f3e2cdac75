"""Defines the base classes of drivers: fast, block and slow.

The cycle calls a fast driver once per cycle. A block driver returns blocks of rows. A slow driver
is a coroutine. For every kind the author must state which condition is safe, and no method may wait
without a time limit.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic

from typing_extensions import TypeVar

from rigd.sdk.declaration import Declaration
from rigd.sdk.link import LinkConfig
from rigd.sdk.options.documented_model import Documented

if TYPE_CHECKING:  # a rig file is checked without numpy
    import numpy as np
    from numpy.typing import NDArray


class DriverConfig(Documented):
    """The options of one driver in a rig file: frozen, every key known, every field documented.

    Declare quantities as ``Annotated[float, In("A")]``, so that the file must give a unit.
    """

    def files(self) -> Mapping[Path, str]:
        """Return path and text of the files that options name; every recording keeps them."""
        return {}


ConfigT = TypeVar("ConfigT", bound=DriverConfig, default=Any)
LinkT = TypeVar("LinkT", default=Any)


class AnyDriver(ABC, Generic[ConfigT, LinkT]):
    """Base class of drivers of every kind.

    The class names ``Config`` (a :class:`DriverConfig`) and declares with :meth:`declare` what a
    device measures and takes. It is constructed as ``Driver(config, link)`` only to be opened; the
    constructor opens nothing. ``link`` is what the rig made for it: the :class:`~rigd.sdk.Link`
    that the rig file names, or a :class:`~rigd.sdk.Plant` for devices simulated in process. A
    driver that opens a connection of its own is a ``Driver[ItsConfig, None]``.
    """

    #: Options the rig file may give.
    Config: ClassVar[type[DriverConfig]] = DriverConfig
    #: One line for a person: what the device is.
    title: ClassVar[str] = ""
    #: The kind of link that ``link: NAME`` must lead to, as in ``links: {NAME: {type: KIND}}``;
    #: "" for a driver that opens its own connection or stands on a plant.
    link_kind: ClassVar[str] = ""
    #: The model of the plant that the device stands on, as in ``plant: {model: MODEL}``, if its
    #: options name parts of it: a validator finds the plant's options in the context, as ``plant``.
    #: Every validator finds the time of a cycle there, as ``period_ns``.
    plant_model: ClassVar[str] = ""

    #: Options that no two devices of a rig may share: the serial port that this driver opens.
    unshared: ClassVar[tuple[str, ...]] = ()

    #: What the device reports about itself, once it is open: type, serial number, firmware.
    identity: str = ""

    def __init__(self, config: ConfigT, link: LinkT) -> None:
        self.config = config
        self.link = link
        #: What :meth:`declare` returns for ``config``.
        self.declaration = self.declare(config)

    @classmethod
    @abstractmethod
    def declare(cls, config: ConfigT) -> Declaration:
        """Return the channels and setpoints of a device with these options; nothing is opened.

        Raises:
            ValueError: the options cannot be met.
        """

    @classmethod
    def contradictions(cls, config: ConfigT, link: LinkConfig | None) -> Sequence[str]:
        """Return contradictions between options, one sentence each; called for every rig file.

        ``link`` has the options of the link that the rig file names. Nothing is opened.
        """
        return ()

    def reserve(self) -> None:
        """Reserve on the link, which is not open yet, what the device uses of it.

        For a link with inputs and outputs that are given to devices, such as a card. Called for
        every rig file; :meth:`open` calls it again, after the link was opened.

        Raises:
            LinkError, ProtocolError: the link does not have it, or another device has it.
        """

    def preflight(self) -> Sequence[str]:
        """Return the reasons why this device cannot be armed, one sentence each; may be empty."""
        return ()


class Driver(AnyDriver[ConfigT, LinkT]):
    """A driver of a fast device: the cycle exchanges values with it once per cycle.

    A cycle first lets every link receive what has arrived (:meth:`Link.begin`), calls :meth:`read`
    on every device, then decides, then calls :meth:`write` on every device that accepts setpoints,
    then lets every link send (:meth:`Link.end`). All of these return within a bounded time,
    allocate nothing that grows, and never sleep. ``open`` and ``prove_watchdog`` happen before the
    first cycle and may take seconds.
    """

    #: Whether another process may open the device anew to make it safe (see :meth:`rescue`).
    second_link: ClassVar[bool] = False
    #: Whether the device stays safe while it is read after :meth:`make_safe` without :meth:`write`:
    #: what :meth:`read` sends then only asks. Its rows go on for a while after a run that did not
    #: reach its end; if all drivers on its link say so, with the link's ``begin`` and ``end``.
    reads_when_safe: ClassVar[bool] = False
    #: Whether :meth:`read` may wait for an answer: where cycles have no time to keep, so that runs
    #: repeat bit for bit. Set before :meth:`open`.
    lockstep: bool = False
    #: When the last row that :meth:`read` returned was taken, on the clock of its ``t_ns`` and not
    #: after it; None: in the cycle that read it. For a device with a pace of its own whose rows
    #: come late: they are recorded at this time, later with each row, and interlocks count their
    #: age from it.
    taken_ns: int | None = None

    @property
    def watchdog_s(self) -> float | None:
        """:attr:`Declaration.watchdog_s`, or that of the link if the link has the watchdog."""
        return self.declaration.watchdog_s

    @abstractmethod
    def open(self) -> None:
        """Open the link and check that the device is the expected device; move nothing.

        Raises:
            LinkError: the device cannot be reached.
            ProtocolError: it is not the device that the rig file names.
        """

    def prove_watchdog(self) -> float:
        """Be silent once, and return after how many seconds the device made itself safe.

        Called after :meth:`open`, before :meth:`arm`, at zero setpoints; nothing may move.

        Raises:
            DeviceError: it did not within ``watchdog_s``.
        """
        raise NotImplementedError(f"{type(self).__name__} has no watchdog to prove")

    @abstractmethod
    def arm(self) -> None:
        """Begin to enable the actuator, at rest; a sensor has nothing to do.

        Bounded like ``read``; a longer task continues in the following cycles, until :meth:`ready`.
        """

    def ready(self) -> bool:
        """Return whether the actuator is enabled; asked in every cycle after :meth:`arm`."""
        return True

    @abstractmethod
    def read(self, t_ns: int) -> Sequence[float] | None:
        """Return the row taken for the cycle at ``t_ns``, or None if there is no new row.

        Its class is :attr:`Declaration.row`.

        After ``None`` the last values remain and grow older; interlocks treat them as stale.

        Raises:
            DeviceError: the device reports a fault.
        """

    def write(self, setpoints: Sequence[float]) -> None:
        """Send the setpoints of this cycle, already limited, in the order of the declaration."""

    def take_inputs(self, t_ns: int, values: Sequence[float], *, late: bool) -> None:
        """Take :attr:`Declaration.inputs` in SI, in their order, after the setpoints were written.

        Bounded like ``read``. A value is NaN while it is not known. ``late`` is whether one is of
        an earlier cycle although its device has a row in each, or has been silent for too long.

        Raises:
            DeviceError: the device cannot go on with these values.
        """

    def act(self, action: str) -> None:
        """Begin one of ``actions``; it continues in the following cycles, until :meth:`acted`.

        Raises:
            DeviceError: another action is in progress.
            ValueError: unknown action.
        """
        raise ValueError(f"{type(self).__name__} has no action {action!r}")

    def acted(self) -> str | None:
        """Return the device's reply to the action, once; None while it continues (or has none).

        Raises:
            DeviceError: the device refused, or did not answer; the action has ended.
        """
        return None

    @abstractmethod
    def make_safe(self) -> None:
        """Bring the actuator to its safe state; bounded in time, never moves anything on purpose.

        Called on every exit, possibly twice, possibly with a dead link. Every author must state
        what safe means for the device.
        """

    def confirm_safe(self) -> None:
        """Check that the device heeded :meth:`make_safe`; if not, make it safe in another way.

        Called after ``make_safe`` of every device, so that a device that does not answer delays no
        other. Bounded to about 0.5 s. By default it does nothing.

        Raises:
            DeviceError, LinkError, ProtocolError: it is not safe, or does not show whether it is.
        """

    def rescue(self) -> None:
        """Make the device safe over a new link of this driver; then close it.

        Called on a new instance (with a new, unopened link) in another process, after the process
        that drove the device was killed. Bounded to about 0.5 s. Only if ``second_link``.

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
    order of the declared channels, the status word last if there is one.
    """

    times_ns: NDArray[np.int64]
    values: NDArray[np.float64]


class BlockDriver(AnyDriver[ConfigT, LinkT]):
    """A driver of a device whose library waits and returns many rows at once; takes no setpoints.

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


#: ``emit(row)``: takes one row, of the class that :attr:`Declaration.row` names.
EmitRow = Callable[[Sequence[float]], None]


class SlowDriver(AnyDriver[ConfigT, LinkT]):
    """A driver of a slow device: a coroutine that runs until cancelled.

    It runs on the event loop of the daemon, beside other devices: it never blocks.

    With setpoints it also has :meth:`write`, :meth:`make_safe` and mostly :meth:`arm`, which are
    called one at a time while :meth:`run` goes on: if they share a connection, a lock keeps their
    questions apart. The cycle limits the setpoints and gives them in every cycle; the device gets
    the newest, as often as it takes them. Each of these may be cancelled at any await.
    """

    #: Whether a new instance may open the device once more and make it safe after the process that
    #: ran it was killed. Only for setpoints.
    second_link: ClassVar[bool] = False

    @abstractmethod
    async def open(self) -> None:
        """Open the link and check that it is the expected device; see :meth:`Driver.open`."""

    @abstractmethod
    async def run(self, emit: EmitRow) -> None:
        """Hand every row to ``emit`` as it comes, until cancelled.

        Raises:
            DeviceError: the device reports a fault, or is gone.

        """

    async def write(self, setpoints: Sequence[float]) -> None:
        """Send setpoints, already limited, in SI and in the order of the declaration; within 2 s.

        Called first before :meth:`arm`, at rest, then when one has changed.

        Raises:
            DeviceError: the device refuses a setpoint, or reports a fault.
            LinkError, ProtocolError: it does not answer, or not as its manual says.
        """
        raise NotImplementedError(f"{type(self).__name__} takes no setpoints")

    async def arm(self) -> None:
        """Enable the output, at rest, and return when it is enabled; within 2 s."""

    async def make_safe(self) -> None:
        """Bring the device to its safe state and check that it is there; within 3 s.

        Called on every exit, possibly twice, possibly with a dead link. Every author of a driver
        with setpoints must state what safe means for the device.

        Raises:
            DeviceError, LinkError, ProtocolError: it is not safe, or does not show whether it is.
        """
        raise NotImplementedError(f"{type(self).__name__} has no safe state")

    async def rescue(self) -> None:
        """Make the device safe over a new connection of this driver; then close it.

        Called on a new instance in another process, after the process that ran the device was
        killed: an answer to that one may still come. Bounded to about 0.5 s. Only if
        ``second_link``. By default :meth:`open` and :meth:`make_safe`; a device that can be made
        safe without an answer is made safe first.

        Raises:
            DeviceError, LinkError, ProtocolError: see :meth:`make_safe`.
        """
        try:
            await self.open()
            await self.make_safe()
        finally:
            await self.close()

    async def prove_watchdog(self) -> float:
        """Be silent once, and return after how many seconds the device made itself safe.

        Called after :meth:`open`, before :meth:`arm`, at rest, if a watchdog is declared.

        Raises:
            DeviceError: it did not within ``watchdog_s``.
        """
        raise NotImplementedError(f"{type(self).__name__} has no watchdog to prove")

    async def act(self, action: str) -> str:
        """Perform one of ``actions`` while :meth:`run` continues; return the device's reply.

        Raises:
            DeviceError: the device refused.
            ValueError: unknown action.
        """
        raise ValueError(f"{type(self).__name__} has no action {action!r}")

    async def close(self) -> None:
        """Leave the device quiet (no stream left on) and close; closing twice is silent."""

"""What CANopen devices that only measure have in common: set-up by SDO, a TPDO, an action."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar, TypeVar

from rigd.sdk import DeviceError, Driver, LinkConfig, LinkError, about_entry
from rigd_drivers.can.bus import CanBus
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.canopen.inbox import Inbox
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.canopen.pdo import Pdo
from rigd_drivers.can.errand import Errand, Script
from rigd_drivers.can.node import HEARTBEAT_MS, Node
from rigd_drivers.can.pdo import configure, switch_off_rest
from rigd_drivers.can.profile import NodeProfile
from rigd_drivers.can.sheet import NodeConfig, Plan, contradictions, refuse


class SensorConfig(NodeConfig):
    """Which node it is, and of which make."""

    profile: NodeProfile | None = None
    """What is known of this make. None: it is as the standard has it."""


SensorConfigT = TypeVar("SensorConfigT", bound=SensorConfig)


class CanSensor(Driver[SensorConfigT, CanBus]):
    """A node that gives its value at every SYNC; it only measures, so it is always safe."""

    link_kind = "can"
    reads_when_safe = True
    noun: ClassVar[str]  #: what messages call it
    number: ClassVar[int]  #: of its device profile: low word of 1000h
    busy: ClassVar[str]  #: what stands behind the node in a message while its action is under way

    def __init__(self, config: SensorConfigT, link: CanBus, tpdo: Pdo) -> None:
        super().__init__(config, link)
        self._tpdo = tpdo
        self._inbox = Inbox(tpdo, config.node)
        self._watched = False
        self._node: Node | None = None
        self._errand: Errand | None = None

    @classmethod
    @abstractmethod
    def transfers(
        cls, config: SensorConfigT
    ) -> tuple[Sequence[Entry], Sequence[tuple[Entry, int]], Pdo]:
        """Return what is read and written beyond the profile, and the TPDO."""

    @abstractmethod
    def set_up(self, node: Node) -> str | None:
        """Read what the values of ``node`` mean, choose the TPDO; return what to say of it.

        Raises:
            LinkError: it does not answer.
            ProtocolError: it has another resolution or unit.

        """

    @abstractmethod
    def carry_out(self, node: Node) -> Script:
        """Do the one action of the device, and return what it shows then."""

    @classmethod
    def contradictions(cls, config: SensorConfigT, link: LinkConfig | None) -> Sequence[str]:
        """Return what in the EDS contradicts this device on ``link``."""
        reads, writes, tpdo = cls.transfers(config)
        known = config.profile
        plan = Plan(
            cls.number,
            [*reads, *(known.reads() if known else ())],
            [(objects.HEARTBEAT_PRODUCER, HEARTBEAT_MS), *(known.writes() if known else ()),
             *writes],
            [tpdo],
        )  # fmt: skip
        return contradictions(config, link, plan)

    def reserve(self) -> None:
        """See :class:`AnyDriver`: the node id is this device's alone."""
        with about_entry("node"):
            self.link.claim(self.config.node, self.title)

    def open(self) -> None:
        """Set the device up by SDO, reading everything back.

        Raises:
            LinkError: it does not answer.
            ProtocolError: it is another device, refuses the set-up, or measures otherwise.

        """
        config, link = self.config, self.link
        self.close()
        refuse(self.title, self.contradictions(config, link.config))
        node = self._node = Node(link, config.node, config.sheet())
        node.open(self.title, self.number, config.serial)
        known = config.profile
        if known is not None:
            known.confirm(node)
            known.prepare(node)
        told = [node.identity, self.set_up(node), None if known is None else str(known)]
        self.identity = ", ".join(filter(None, told))
        configure(node, self._tpdo)
        switch_off_rest(node, [self._tpdo])
        self._watched = False
        self._inbox = Inbox(self._tpdo, config.node, link.syncs)
        link.subscribe(self._tpdo.identifier, self._inbox.receive)
        link.on_resume(config.node, self._resume)
        node.start()

    def arm(self) -> None:
        """From now on take a silent or stopped node for failed; there is nothing to enable."""
        self._watched = True

    def newest(self) -> Sequence[int] | None:
        """Return what the TPDO holds; None if nothing answered the SYNC of the cycle before.

        Raises:
            DeviceError: the node reports an emergency, has restarted, or fell silent.
            LinkError: it is not open.
            ProtocolError: a frame has not the length mapped, or comes twice per SYNC.

        """
        self.opened().watch(forgive_silence=not self._watched)
        values = self._inbox.take(self.link.syncs)
        return None if self.link.behind else values

    def act(self, action: str) -> None:
        """Begin the action.

        Raises:
            DeviceError: it is in progress.
            LinkError: the device is not open.
            ValueError: unknown action.

        """
        if action not in self.declare(self.config).actions:
            raise ValueError(f"the {self.noun} has no action {action!r}")
        node = self.opened()
        if self._errand is not None:
            raise DeviceError(f"{node}{self.busy}")
        self._errand = Errand(node, self._once(node))

    def acted(self) -> str | None:
        """Return what the device shows once the action is done, None before.

        Raises:
            LinkError, ProtocolError, DeviceError: it does not answer, refuses, or shows otherwise.

        """
        return None if self._errand is None else self._errand.advance()

    def make_safe(self) -> None:
        """Do nothing: it only measures."""

    def close(self) -> None:
        """Leave the device pre-operational; closing twice is silent."""
        self._errand = None
        node, self._node = self._node, None
        if node is not None:
            node.close()

    def opened(self) -> Node:
        """Return the node, or raise LinkError if it is not open."""
        if self._node is None:
            raise LinkError(f"the {self.noun} at node {self.config.node} is not open")
        return self._node

    def _once(self, node: Node) -> Script:
        try:
            return (yield from self.carry_out(node))
        finally:
            self._errand = None

    def _resume(self) -> None:
        if self._node is not None:
            self._node.restart_quietly()

"""Simulates a CANopen node (CiA 301): NMT, SDO, PDO, SYNC, heartbeats, emergencies."""

from __future__ import annotations

import asyncio
import time
from abc import abstractmethod
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar, Self

from rigd_sim.wire.can.canopen import misbehaviour
from rigd_sim.wire.can.canopen.dictionary import Dictionary, Entry, Kind, Text
from rigd_sim.wire.can.canopen.emergency import NO_ERROR, Errors
from rigd_sim.wire.can.canopen.heartbeat import Consumer, Producer, Watch
from rigd_sim.wire.can.canopen.ids import (
    BOOT_S,
    EMERGENCY,
    HEARTBEAT,
    HEARTBEAT_LOST,
    INHIBIT_NS,
    NEXT_PDO,
    NMT_COMMAND,
    NO_CHANGE,
    PDO_LATE,
    PDO_TOO_SHORT,
    PDOS,
    RPDO1,
    SDO_ANSWER,
    SDO_REQUEST,
    SYNC,
    TO_STOPPED,
    TPDO1,
    Identity,
    Manners,
    Nmt,
)
from rigd_sim.wire.can.canopen.misbehaviour import Misbehaviour
from rigd_sim.wire.can.canopen.pdo import Pdo
from rigd_sim.wire.can.canopen.sdo import SdoServer, is_download, is_upload
from rigd_sim.wire.can.hub import CanHub, Port
from rigd_sim.wire.part import Part, State

#: Takes the data of a frame and the CLOCK_MONOTONIC time in ns at which it came.
Handler = Callable[[bytes, int], None]


class CanopenNode(Part):
    """A node on ``hub``; a subclass adds the objects of its profile and its physics."""

    faults: ClassVar = misbehaviour.FAULTS

    def __init__(
        self,
        name: str,
        hub: CanHub,
        node: int,
        identity: Identity,
        *,
        rpdo_timer: bool = False,
        manners: Manners | None = None,
    ) -> None:
        self.name = name
        self.node = node
        self.identity = identity
        self._manners = manners = manners or Manners()
        self._hub = hub
        self._port: Port | None = None
        self._nmt = Nmt.BOOT
        self._boot: asyncio.TimerHandle | None = None
        self._boot_is_over: asyncio.Event | None = None
        self._handlers: dict[int, Handler] = {}
        self._latched: dict[Pdo, bytes] = {}
        self._syncs = 0
        self._sent: dict[Pdo, tuple[int, bytes]] = {}
        self._bad = Misbehaviour(seed=node)
        self._twin: CanopenNode | None = None
        self.dictionary = Dictionary()
        self._describe(identity)
        self._errors = Errors(self.dictionary)
        self._sdo = SdoServer(self.dictionary, segmented=manners.segmented)
        self._producer = Producer(self.dictionary, self._beat)
        self._consumer = Consumer(self.dictionary, self._heartbeat_lost, self._listen)

        def pdo(number: int, cob_id: int, *, receive: bool) -> Pdo:
            return Pdo(
                self.dictionary, number, cob_id + number * NEXT_PDO + node, receive=receive,
                changed=self._listen, refused=lambda: "mapping_refused" in self._bad.shown,
                event_timer=receive and rpdo_timer, inhibit=10,
            )  # fmt: skip

        self._tpdos = tuple(pdo(number, TPDO1, receive=False) for number in range(PDOS))
        self._rpdos = tuple(pdo(number, RPDO1, receive=True) for number in range(PDOS))
        self._active_tpdos: tuple[tuple[int, Pdo], ...] = ()
        self._rpdo_watches = {rpdo: Watch(self._rpdo_late) for rpdo in self._rpdos}

    def _describe(self, identity: Identity) -> None:
        add = self.dictionary.add
        add(Entry(0x1000, 0, Kind.U32, identity.device_type))
        add(Entry(0x1005, 0, Kind.U32, SYNC))
        add(Text(0x1008, 0, Kind.U8, 0, text=identity.name.encode("ascii")))
        add(Entry(0x1014, 0, Kind.U32, EMERGENCY + self.node))
        numbers = (identity.vendor, identity.product, identity.revision, identity.serial)
        self.dictionary.array(
            0x1018, [Entry(0x1018, sub, Kind.U32, n) for sub, n in enumerate(numbers, start=1)]
        )
        (self._error_behaviour,) = self.dictionary.array(
            0x1029, [Entry(0x1029, 1, Kind.U8, 0, writable=True, high=2)]
        )
        # Dummies, so that a node can skip its neighbour's part of a shared RPDO.
        for index, kind in ((5, Kind.U8), (6, Kind.U16), (7, Kind.U32)):
            add(Entry(index, 0, kind, 0, mappable=True))

    # What a profile adds.

    @abstractmethod
    def sample(self, t_ns: int) -> None:
        """Bring what is measured up to date in the dictionary."""

    @abstractmethod
    def apply(self, t_ns: int) -> None:
        """Act on what was received."""

    @abstractmethod
    def connection_lost(self, t_ns: int, error: int) -> None:
        """The node has left the operational state, by ``error`` if that is not 0."""

    @abstractmethod
    def power_off(self, t_ns: int) -> None:
        """Fall back to the state of power-on: no torque."""

    @abstractmethod
    def twin(self) -> Self:
        """Return another node like this one, with the same id, that moves nothing."""

    # The part.

    async def start(self) -> str:
        """Go on the bus and boot; see :meth:`Part.start`."""
        booted = self._boot_is_over = asyncio.Event()
        self.connect()
        await booted.wait()
        return f"{self.name}: {self.identity.name}, node {self.node} on {self._hub.name}"

    async def stop(self) -> None:
        """Leave the bus."""
        self.disconnect()

    def connect(self) -> None:
        """Go on the bus and boot."""
        self._port = self._hub.attach(self._receive)
        self._restart()

    def disconnect(self) -> None:
        """Lose the supply and leave the bus; twice is silent."""
        self.clear("twin")
        self._halt()
        if self._port is not None:
            self._port.detach()
            self._port = None

    def state(self) -> State:
        """Return the node's id, its NMT state, and the faults it shows."""
        return {
            "node": self.node,
            "nmt": self._nmt.name.lower(),
            "faults": " ".join(self._bad.shown),
        }

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault of the node; see :data:`misbehaviour.FAULTS`.

        Raises:
            ValueError: no such fault, or not with these options.

        """
        if fault not in self.faults:
            raise ValueError(f"{self.name} has no fault {fault!r}; it knows {sorted(self.faults)}")
        kept = self.read_options(fault, options)
        self.clear(fault)
        if fault == "reset":
            self._restart()
            return
        if fault == "emergency":
            self.fail(kept["code"], time.monotonic_ns())
            return
        self._bad.shown[fault] = kept
        if fault == "silent":
            self._halt()
        elif fault == "twin":
            self._twin = self.twin()
            self._twin.connect()

    def read_options(self, fault: str, options: Mapping[str, Any]) -> dict[str, Any]:
        """Return the options of ``fault``, complete; a subclass has those of its own faults."""
        return misbehaviour.read_options(fault, options)

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them."""
        for name in list(self._bad.shown) if fault is None else [fault]:
            if self._bad.hide(name) is None:
                continue
            if name == "silent":
                self._restart()
            elif name == "twin" and self._twin is not None:
                self._twin.disconnect()
                self._twin = None

    # Life and death.

    def fail(self, code: int, t_ns: int) -> None:
        """Report an emergency; a drive also goes to its fault state."""
        self._emergency(self._errors.report(code))

    def recovered(self) -> None:
        """Report that no error is left."""
        self._emergency(self._errors.over())

    def _halt(self) -> None:
        """Be without supply."""
        if self._boot is not None:
            self._boot.cancel()
            self._boot = None
        self._nmt = Nmt.BOOT
        self._producer.stop()
        self._consumer.stop()
        for watch in self._rpdo_watches.values():
            watch.stop()
        self._latched.clear()
        self._sent.clear()
        self.power_off(time.monotonic_ns())
        if self._port is not None:
            self._port.listen(())

    def _restart(self, low: int = 0x0000, high: int = 0xFFFF) -> None:
        """Reset: objects with an index from ``low`` to ``high`` take their default; then boot."""
        self._halt()
        self.dictionary.restore(low, high)
        self._sdo.reset()
        self._boot = asyncio.get_running_loop().call_later(BOOT_S, self._booted)

    def _booted(self) -> None:
        self._boot = None
        for pdo in (*self._tpdos, *self._rpdos):
            pdo.refresh()
        self._consumer.refresh()
        for _ in range(1 + self._manners.boots_twice):
            self._send(HEARTBEAT + self.node, bytes([Nmt.BOOT]))
        self._nmt = Nmt.PRE_OPERATIONAL
        self._listen()
        for code in self._manners.boot_emergencies:
            report = self._errors.over() if code == NO_ERROR else self._errors.report(code)
            self._emergency(report)
        self._producer.start()
        if self._boot_is_over is not None:
            self._boot_is_over.set()

    def _listen(self) -> None:
        """Take over which identifiers mean something to this node."""
        handlers: dict[int, Handler] = {
            NMT_COMMAND: self._on_nmt,
            SYNC: self._on_sync,
            SDO_REQUEST + self.node: self._on_sdo,
        }
        for node in self._consumer.nodes:
            handlers[HEARTBEAT + node] = partial(self._on_heartbeat, node)
        for pdo in self._rpdos:
            if pdo.enabled:
                handlers[pdo.cob_id] = partial(self._on_rpdo, pdo)
        self._active_tpdos = tuple(
            (number, pdo) for number, pdo in enumerate(self._tpdos, start=1) if pdo.enabled
        )
        self._handlers = handlers
        if self._port is not None:
            self._port.listen(handlers)

    # Frames in.

    def _receive(self, can_id: int, data: bytes, t_ns: int) -> None:
        self._handlers[can_id](data, t_ns)

    def _on_nmt(self, data: bytes, t_ns: int) -> None:
        if len(data) != 2 or data[1] not in (0, self.node):
            return
        match data[0]:
            case 0x01:
                # As CANopenNode does: no start while the heartbeat error stands.
                if not self._consumer.misses or "watchdog_dead" in self._bad.shown:
                    self._enter(Nmt.OPERATIONAL, t_ns)
            case 0x02:
                self._enter(Nmt.STOPPED, t_ns)
            case 0x80:
                self._enter(Nmt.PRE_OPERATIONAL, t_ns)
            case 0x81:
                self._restart()
            case 0x82:
                self._restart(0x1000, 0x1FFF)

    def _enter(self, state: Nmt, t_ns: int) -> None:
        left = self._nmt is Nmt.OPERATIONAL and state is not Nmt.OPERATIONAL
        self._nmt = state
        self._latched.clear()
        if left:
            for watch in self._rpdo_watches.values():
                watch.stop()
            self.connection_lost(t_ns, NO_ERROR)

    def _on_sync(self, data: bytes, t_ns: int) -> None:
        """Sample, send, then act: what is sent is what was when SYNC came."""
        if self._nmt is not Nmt.OPERATIONAL:
            return
        self._syncs += 1
        self.sample(t_ns)
        for number, pdo in self._active_tpdos:
            if pdo.synchronous and self._syncs % pdo.period == 0:
                self._send_tpdo(number, pdo, t_ns)
        if self._latched:
            for pdo, received in self._latched.items():
                self._store(pdo, received)
            self._latched.clear()
            self.apply(t_ns)
        self._send_changed(t_ns)

    def _on_rpdo(self, pdo: Pdo, data: bytes, t_ns: int) -> None:
        if self._nmt is not Nmt.OPERATIONAL:
            return
        if len(data) < pdo.length:
            self._emergency(self._errors.report(PDO_TOO_SHORT))
            return
        if pdo.event_timer is not None and pdo.event_timer.value:
            self._rpdo_watches[pdo].feed(pdo.event_timer.value * 1e-3)
        if pdo.synchronous:
            self._latched[pdo] = data
        else:
            self._store(pdo, data)
            self.apply(t_ns)
            self._send_changed(t_ns)

    def _store(self, pdo: Pdo, data: bytes) -> None:
        for entry, value in zip(pdo.entries, pdo.unpack(data), strict=True):
            entry.value = value

    def _on_sdo(self, data: bytes, t_ns: int) -> None:
        if self._nmt is Nmt.STOPPED or "sdo_silent" in self._bad.shown:
            return
        if is_upload(data):
            self.sample(t_ns)
        answer = self._sdo.answer(data)
        if answer is not None:
            self._send(SDO_ANSWER + self.node, self._bad.sdo(data, answer))
        if is_download(data):
            self.apply(t_ns)
            self._send_changed(t_ns)

    def _on_heartbeat(self, node: int, data: bytes, t_ns: int) -> None:
        self._consumer.heard(node)

    # Time-outs.

    def _beat(self) -> None:
        if "heartbeat_missing" not in self._bad.shown:
            self._send(HEARTBEAT + self.node, bytes([self._nmt]))

    def _heartbeat_lost(self, node: int) -> None:
        self._lost(HEARTBEAT_LOST)

    def _rpdo_late(self) -> None:
        self._lost(PDO_LATE)

    def _lost(self, code: int) -> None:
        if "watchdog_dead" in self._bad.shown:
            return
        t_ns = time.monotonic_ns()
        self._emergency(self._errors.report(code))
        self.connection_lost(t_ns, code)
        if self._nmt is Nmt.OPERATIONAL and self._error_behaviour.value != NO_CHANGE:
            stopped = self._error_behaviour.value == TO_STOPPED
            self._enter(Nmt.STOPPED if stopped else Nmt.PRE_OPERATIONAL, t_ns)
        self._send_changed(t_ns)

    # Frames out.

    def _emergency(self, message: bytes) -> None:
        if self._nmt in (Nmt.PRE_OPERATIONAL, Nmt.OPERATIONAL):
            self._send(EMERGENCY + self.node, message)

    def _send_changed(self, t_ns: int) -> None:
        """Send the event-driven TPDOs whose values have changed."""
        if self._nmt is not Nmt.OPERATIONAL:
            return
        for number, pdo in self._active_tpdos:
            if not pdo.synchronous and self._sent.get(pdo, (0, b""))[1] != pdo.pack():
                self._send_tpdo(number, pdo, t_ns)

    def _send_tpdo(self, number: int, pdo: Pdo, t_ns: int) -> None:
        data = pdo.pack()
        if pdo.inhibit is not None and pdo.inhibit.value:
            last = self._sent.get(pdo)
            if last is not None and t_ns - last[0] < pdo.inhibit.value * INHIBIT_NS:
                return
        self._sent[pdo] = (t_ns, data)
        if self._bad.shown:
            for can_id, spoilt in self._bad.tpdo(number, pdo.cob_id, data):
                self._send(can_id, spoilt)
        else:
            self._send(pdo.cob_id, data)

    def _send(self, can_id: int, data: bytes) -> None:
        if self._port is None:
            return
        slow = self._bad.shown.get("slow")
        if slow is None:
            self._port.send(can_id, data)
        else:
            asyncio.get_running_loop().call_later(slow["delay_s"], self._port.send, can_id, data)

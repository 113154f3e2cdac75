"""Sets up one CANopen node by SDO and supervises the node in every cycle; rigd is the master."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final, NamedTuple, TypeVar

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.can.bus import OVERFLOW_HINT, CanBus, overflow
from rigd_drivers.can.canopen import emcy, frames, nmt, objects, sdo
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.canopen.sheet import Sheet
from rigd_drivers.can.sheet import WRONG_EDS
from rigd_drivers.wait import looks

#: A node answers an SDO request within this, also when its host or ours stalls, in s.
SDO_TIMEOUT_S: Final = 0.5
#: The same while a drive must be made safe, in s.
RESCUE_TIMEOUT_S: Final = 0.15
#: An SDO transfer is tried at most so often if frames were lost, or if another client was heard.
_TRIES: Final = 3
#: How long a second node with the same id has for its reply, in s.
_TWIN_S: Final = 0.02
#: A scan leaves time between two requests, since few adapters queue more than 10 frames, and for
#: the last reply, in s.
_SCAN_PAUSE_S: Final = 0.001
_SCAN_END_S: Final = 0.05
#: Heartbeat interval that is written to nodes, in ms.
HEARTBEAT_MS: Final = 100
#: Five heartbeats missed in a row are no stall, in ns.
_HEARTBEAT_LOST_NS: Final = 5 * HEARTBEAT_MS * 1_000_000
#: One may have been under way when the node was ordered back to operational.
_HALTED_HEARTBEATS: Final = 2
#: A node is operational within this after the order, by its heartbeat, in s.
_START_S: Final = 1.0
#: The order is repeated after this until it is: a node may refuse it at first, in s.
_START_AGAIN_S: Final = 0.05
#: The same after a pause of ours, also when its host stalls, in ns.
_RESTART_NS: Final = 2_000_000_000


TransferT = TypeVar("TransferT", bound=sdo.Transfer)


class Disturbances(NamedTuple):
    """How often what disturbs an SDO transfer was met, since the node was attached."""

    errors: int  #: errors on the wire that the controller has reported
    lost: int  #: frames that came, and that nobody had taken in
    requests: int  #: of other SDO clients to this node
    replies: int  #: of this node to other clients

    @property
    def foreign(self) -> bool:
        """Whether another client was heard."""
        return self.requests > 0 or self.replies > 0


class Node:
    """Controls node ``node_id`` on ``bus``, and sends nothing that ``sheet`` forbids."""

    def __init__(self, bus: CanBus, node_id: int, sheet: Sheet | None = None) -> None:
        self.bus = bus
        self.node_id = node_id
        self._sheet = sheet
        self._beside_sheet: set[Entry] = set()  #: what the node has though its sheet may not
        self.identity = ""
        self.vendor: int | None = None  #: object 1018:1, once open
        self.product: int | None = None  #: object 1018:2, once open
        self.device_type = 0  #: object 1000, once open
        self.state: nmt.State | None = None  #: the state in its last heartbeat
        self.emergency: emcy.Emergency | None = None  #: the first that was not looked at yet
        self.sdo_timeout_s = SDO_TIMEOUT_S
        self.replies: deque[bytes] = deque(maxlen=16)  #: to SDO requests, not looked at yet
        self._foreign_requests = self._foreign_replies = 0
        self._claimed = False
        self._restarted = False
        self._garbled = ""
        self._heard_ns = 0
        self._halted = 0  #: heartbeats in a row that report another state than operational
        self._start_until_ns = 0  #: until when it is ordered operational; 0: it is
        self._start_next_ns = 0

    def __str__(self) -> str:
        return f"node {self.node_id} on {self.bus.name}"

    # -- set-up --------------------------------------------------------------------------------

    def attach(self) -> None:
        """Take from the bus what the node sends about itself."""
        self.bus.subscribe(frames.SDO_REPLY + self.node_id, self.replies.append)
        self.bus.hear_other_clients(self.node_id, self._on_foreign_request)
        self.bus.subscribe(frames.EMCY + self.node_id, self._on_emergency)
        self.bus.subscribe(frames.HEARTBEAT + self.node_id, self._on_heartbeat)

    def open(self, owner: str, profile: int, serial: int | None) -> None:
        """Bring the node to pre-operational and make sure that it is the expected node.

        ``profile`` is the CiA profile in its device type, ``serial`` its serial number if the rig
        file gives it.

        Raises:
            LinkError: it does not answer.
            ProtocolError: it is another device or kind of device, or two devices share the id.
        """
        self.bus.claim(self.node_id, owner)
        self._claimed = True
        self.attach()
        self.order(nmt.Command.PRE_OPERATIONAL)
        self.device_type = self._read_device_type()
        found = self.device_type & 0xFFFF
        if found != profile:
            raise ProtocolError(
                f"{self} has device profile {found} (object 1000), expected {profile}",
                hint="correct `node` of this device, or its driver",
            )
        number = self.read_optional(objects.SERIAL)
        self._check_alone(objects.SERIAL)
        if serial is not None and number != serial:
            raise ProtocolError(
                f"{self} has serial number {number}, the rig file expects {serial}",
                hint="another device is there: check its calibration, then correct `serial`",
            )
        self.identity = self._identify(number)
        self.ensure(objects.HEARTBEAT_PRODUCER, HEARTBEAT_MS)

    def start(self) -> None:
        """Make the node operational; from now on it receives and sends PDOs.

        Raises:
            ProtocolError: its heartbeat does not show it.

        """
        self.state = None
        for _ in looks(_START_S):
            self.order(nmt.Command.START)
            if self.bus.wait(lambda: self.state is nmt.State.OPERATIONAL, _START_AGAIN_S):
                break
        else:
            raise ProtocolError(
                f"{self} is not operational {_START_S:g} s after the command: {self._shown()}"
                f"{self._errors()}",
                hint="its manual explains its error register and history (1001, 1003)",
            )
        self._restarted = False
        self._halted = 0

    def close(self) -> None:
        """Leave the node pre-operational, quiet but for its heartbeat."""
        if not self._claimed:
            return  # it is another device's
        self._claimed = False
        self.bus.release(self.node_id)
        if self.bus.is_open:
            with suppress(LinkError):  # the bus is lost: the node gets nothing from us anyway
                self.order(nmt.Command.PRE_OPERATIONAL)

    def called(self, entry: Entry) -> str:
        """Return the name of ``entry`` for messages: its name in the EDS, if it has one."""
        if self._sheet is None:
            return str(entry)
        return self._sheet.called(entry.index, entry.sub)

    def permit(self, entry: Entry, value: int | None = None) -> None:
        """Raise ProtocolError if the EDS forbids to read ``entry``, or to write ``value`` to it."""
        if self._sheet is not None and entry not in self._beside_sheet:
            sheet = self._sheet
            self._heed(sheet.unreadable(entry) if value is None else sheet.unwritable(entry, value))

    def read(self, entry: Entry) -> int:
        """Return the value of ``entry``.

        Raises:
            LinkError: the node does not answer.
            ProtocolError: it refuses, or answers with something else.

        """
        self.permit(entry)
        try:
            return entry.unpack(self._upload(entry.index, entry.sub).value(entry.size))
        except sdo.Aborted as error:
            raise self.refused(entry, None, error) from error
        except ValueError as error:
            raise ProtocolError(f"{self}: {error}") from error

    def read_optional(self, entry: Entry) -> int | None:
        """Return the value of ``entry``, of any length; None if the node has no such entry.

        Raises:
            LinkError, ProtocolError: see :meth:`read`.
        """
        try:
            data = self._upload(entry.index, entry.sub).value(entry.size)
        except sdo.Aborted as error:
            if error.code in sdo.MISSING:
                return None
            raise self.refused(entry, None, error) from error
        if self._sheet is not None and self._sheet.find(entry.index, entry.sub) is None:
            self._beside_sheet.add(entry)
        return int.from_bytes(data, "little", signed=entry.code.islower())

    def write(self, entry: Entry, value: int, *, once: bool = False) -> None:
        """Write ``value`` to ``entry``; ``once``, also if the answer may have been lost.

        Raises:
            LinkError, ProtocolError: see :meth:`read`.

        """
        self.permit(entry, value)
        data = entry.pack(value)
        try:
            self._carry_out(
                lambda: sdo.Download(entry.index, entry.sub, data),
                is_done=lambda: self._has(entry, data),
                tries=1 if once else _TRIES,
            )
        except sdo.Aborted as error:
            raise self.refused(entry, value, error) from error

    def ensure(self, entry: Entry, value: int) -> None:
        """Write ``value`` to ``entry`` and read it back.

        Raises:
            LinkError: the node does not answer.
            ProtocolError: it refuses, or reads back something else.

        """
        self.write(entry, value)
        kept = self.read(entry)
        if kept != value:
            raise ProtocolError(
                f"{self}: {self.called(entry)} reads back {kept} (0x{kept:X}), written was "
                f"{value} (0x{value:X})"
            )

    def ensure_optional(self, entry: Entry, value: int) -> bool:
        """Call :meth:`ensure` if the node has ``entry``; return whether it has."""
        if self.read_optional(entry) is None:
            return False
        self.ensure(entry, value)
        return True

    # -- SDO -----------------------------------------------------------------------------------

    def answer(self, transfer: sdo.Transfer) -> bytes | None:
        """Return the next reply that can be the answer to the last request of ``transfer``."""
        while self.replies:
            reply = self.replies.popleft()
            if transfer.is_answer(reply):
                return reply
            self._foreign_replies += 1
        return None

    def disturbances(self, since: Disturbances | None = None) -> Disturbances:
        """Return what has disturbed SDO transfers so far, or after ``since``."""
        bus = self.bus
        now = (bus.errors, bus.lost, self._foreign_requests, self._foreign_replies)
        if since is None:
            return Disturbances(*now)
        return Disturbances(*(each - before for each, before in zip(now, since, strict=True)))

    # -- the cycle -----------------------------------------------------------------------------

    def watch(self, *, forgive_silence: bool) -> None:
        """Raise what the node has reported since the last cycle; once per cycle.

        ``forgive_silence`` ignores what the node reports because heartbeats paused before the
        cycle.

        Raises:
            DeviceError: it reports an emergency, has restarted, or fell silent.
            ProtocolError: it sends what no CANopen node sends.

        """
        if self._start_until_ns:
            self._keep_starting()
        emergency = self.emergency
        if emergency is not None:
            self.emergency = None
            if not (forgive_silence and emergency.code in emcy.MASTER_SILENT):
                raise DeviceError(f"{self}: {emergency}", hint=_advice(emergency))
        if self._restarted:
            self._restarted = False
            raise DeviceError(
                f"{self} has restarted (boot-up message): its set-up is lost",
                hint="check its supply and connector; the next run sets it up again",
            )
        if self._garbled:
            raise ProtocolError(f"{self} {self._garbled}", hint="another device may have its id")
        if forgive_silence:
            if self._halted and not self._start_until_ns:
                self.restart_quietly()
            return
        if self.bus.now_ns - self._heard_ns > _HEARTBEAT_LOST_NS:
            silent_ms = (self.bus.now_ns - self._heard_ns) // 1_000_000
            lost = self.bus.lost
            raise DeviceError(
                f"{self} sent no heartbeat for {silent_ms} ms"
                + (f"; {overflow(lost)}" if lost else ""),
                hint=OVERFLOW_HINT if lost else "check its supply, its cable and the bus connector",
            )
        if self._halted >= _HALTED_HEARTBEATS:
            raise DeviceError(
                f"{self} is no longer operational, its heartbeat shows: {self._shown()}",
                hint="its watchdog acted because this computer stalled, or another master "
                "stopped it",
            )

    def restart_quietly(self) -> None:
        """Order the node operational from the end of this cycle on, after a pause of ours.

        A node that watches our heartbeat leaves the operational state when we fall silent (CiA
        301, object 1029).
        """
        self._halted = 0
        self._heard_ns = now = self.bus.now_ns
        self._start_until_ns, self._start_next_ns = now + _RESTART_NS, now
        self._keep_starting()

    # -- within --------------------------------------------------------------------------------

    def _keep_starting(self) -> None:
        """Order the node operational again and again until its heartbeat shows that it is.

        A node may refuse while it still misses our heartbeat, of which it reports nothing.

        Raises:
            DeviceError: it has a heartbeat and is not operational for too long.

        """
        now = self.bus.now_ns
        if now > self._start_until_ns:
            shown, self._start_until_ns = self.state, 0
            if shown not in (None, nmt.State.OPERATIONAL):
                raise DeviceError(
                    f"{self} does not become operational: it was ordered to for "
                    f"{_RESTART_NS / 1e9:g} s, its heartbeat shows: {self._shown()}",
                    hint="look at its error register and history (objects 1001, 1003)",
                )
        elif now >= self._start_next_ns:
            self.bus.order(nmt.Command.START, self.node_id)
            self._start_next_ns = now + round(_START_AGAIN_S * 1e9)

    def _shown(self) -> str:
        return "no heartbeat" if self.state is None else self.state.name.lower()

    def _errors(self) -> str:
        """Return what the node reports about its errors, in words; "" if it does not answer."""
        found = ""
        with suppress(LinkError, ProtocolError):  # beside the error that is raised
            register = self.read_optional(objects.ERROR_REGISTER)
            last = self.read_optional(objects.LAST_ERROR)
            if register:
                found = f"; error register 0x{register:02X} ({emcy.causes(register)})"
            if last:
                found += f"; last error: {emcy.describe(last & 0xFFFF)}"
        return found

    def order(self, command: nmt.Command) -> None:
        """Send an NMT command now.

        Raises:
            LinkError: the bus is lost, or takes no frames.

        """
        self.bus.send(frames.NMT, nmt.command(command, self.node_id))

    def _on_emergency(self, data: bytes) -> None:
        emergency = emcy.decode(data)
        if emergency is None:
            self._garbled = f"sent an emergency of {len(data)} bytes, expected 8"
        elif not emergency.is_reset and self.emergency is None:
            self.emergency = emergency

    def _on_heartbeat(self, data: bytes) -> None:
        self._heard_ns = time.monotonic_ns()
        self.bus.heard.add(self.node_id)
        state = nmt.read_heartbeat(data)
        if state is None:
            self._garbled = f"sent a heartbeat of {data.hex(' ') or 'no bytes'}"
        elif state is nmt.State.BOOT_UP:
            self._restarted = True
        if state is nmt.State.OPERATIONAL:
            self._halted = self._start_until_ns = 0
        else:
            self._halted += 1
        self.state = state

    def _read_device_type(self) -> int:
        try:
            return self.read(objects.DEVICE_TYPE)
        except LinkError as error:
            if self.bus.errors or self.bus.lost or self.disturbances().foreign:
                raise
            there = ", ".join(map(str, scan(self.bus)))
            found = f"nodes found: {there}" if there else "no node was found"
            raise LinkError(f"{error.message}; {found}", hint=error.hint) from error

    def _upload(self, index: int, sub: int) -> sdo.Upload:
        return self._carry_out(lambda: sdo.Upload(index, sub))

    def _carry_out(
        self,
        make: Callable[[], TransferT],
        *,
        is_done: Callable[[], bool] = lambda: False,
        tries: int = _TRIES,
    ) -> TransferT:
        """Carry out the transfer that ``make`` returns; again if it may have been disturbed.

        The answer may have been lost, or the node may have mixed up the frames of two clients.
        ``is_done``: whether the node has done it though it did not answer.
        """
        for left in reversed(range(tries)):
            transfer, before = make(), self.disturbances()
            try:
                requests = self._run(transfer, before)
            except (LinkError, ProtocolError, sdo.Aborted) as error:
                found = self.disturbances(before)
                if not left or not (found.lost or found.foreign):
                    raise
                if isinstance(error, sdo.Aborted) and not error.is_mixed_up:
                    raise
                if isinstance(error, LinkError) and is_done():
                    return transfer
            else:
                # Segments have no index: they may be those of another client's transfer.
                if requests == 1 or not left or not self.disturbances(before).requests:
                    return transfer
        raise AssertionError("the last try returns or raises")

    def _run(self, transfer: sdo.Transfer, before: Disturbances) -> int:
        """Carry out ``transfer``; return how many requests it took."""
        where = f"{transfer.index:04X}:{transfer.sub:02X}"
        following: bytes | None = transfer.request
        requests, found = 0, b""

        def is_answered() -> bool:
            nonlocal found
            found = self.answer(transfer) or b""
            return bool(found)

        self.replies.clear()
        while following is not None:
            requests += 1
            self.bus.send(frames.SDO_REQUEST + self.node_id, following)
            if not self.bus.wait(is_answered, self.sdo_timeout_s):
                raise self.silent(where, self.disturbances(before))
            try:
                following = transfer.feed(found)
            except sdo.Garbled as error:
                self.bus.send(frames.SDO_REQUEST + self.node_id, transfer.abort(0x05040001))
                raise ProtocolError(
                    f"{self}: SDO transfer of {where}: {error}",
                    hint="two nodes may share the id, or another SDO client asks this one",
                ) from error
        return requests

    def _has(self, entry: Entry, data: bytes) -> bool:
        """Return whether the node has ``data`` in ``entry``; not if it cannot be read."""
        try:
            return self._upload(entry.index, entry.sub).value(entry.size) == data
        except sdo.Aborted:
            return False

    def _on_foreign_request(self) -> None:
        self._foreign_requests += 1

    def _check_alone(self, entry: Entry) -> None:
        """Raise if a second reply follows that about ``entry``, which was just taken.

        Not if another client asks: it may be its answer.
        """
        asked, before = sdo.Upload(entry.index, entry.sub), self.disturbances()
        twice = self.bus.wait(lambda: self.answer(asked) is not None, _TWIN_S)
        if twice and not self.disturbances(before).requests:
            raise ProtocolError(
                f"two nodes answer under node id {self.node_id} on {self.bus.name}",
                hint="switch all but one off, and give each an id of its own",
            )

    def _identify(self, serial: int | None) -> str:
        try:
            name = self._upload(*objects.DEVICE_NAME).data
            text = name.rstrip(b"\0").decode("ascii", "replace")
        except sdo.Aborted as error:
            if error.code not in sdo.MISSING:
                raise ProtocolError(f"{self} does not report its name (1008): {error}") from error
            text = "unnamed"
        found = [
            self.read_optional(entry)
            for entry in (objects.VENDOR, objects.PRODUCT, objects.REVISION)
        ]
        self.vendor, self.product, _ = found
        if self._sheet is not None:
            self._heed(self._sheet.another_device(found))
        numbers = [
            f"{label} 0x{value:X}"
            for label, value in zip(("vendor", "product", "revision"), found, strict=True)
            if value is not None
        ]
        if serial is not None:
            numbers.append(f"serial number {serial}")
        return ", ".join([text, *numbers])

    def _heed(self, problem: str | None) -> None:
        """Raise ProtocolError if the sheet has a ``problem`` with the value to send."""
        if problem is not None:
            raise ProtocolError(f"{self}: {problem}", hint=WRONG_EDS)

    def silent(self, where: str, found: Disturbances) -> LinkError:
        """Return the error of no answer about ``where``, with what was met meanwhile."""
        if found.errors:
            return self.bus.broken(
                f"node {self.node_id} does not answer, the controller reports errors "
                f"({found.errors})"
            )
        silent = f"{self} does not answer within {self.sdo_timeout_s:g} s (SDO {where})"
        if found.lost:
            return LinkError(f"{silent}; {overflow(found.lost)}", hint=OVERFLOW_HINT)
        if found.foreign:
            return LinkError(
                f"{silent}; another SDO client talks to it ({found.requests} requests and "
                f"{found.replies} replies of others were heard)",
                hint="end that program, such as the maker's tool: a node serves one client at once",
            )
        return LinkError(
            silent,
            hint="check `node`, its power and wiring, termination, and that it uses "
            f"{self.bus.config.bitrate / 1000:g} kbit/s",
        )

    def refused(self, entry: Entry, value: int | None, error: sdo.Aborted) -> ProtocolError:
        """Return the error of a refused read, or write of ``value``."""
        doing = "reading" if value is None else f"writing {value} (0x{value:X}) to"
        return ProtocolError(
            f"{self} refuses {doing} {self.called(entry)}: {error}",
            hint=_REFUSALS.get(error.code, _LOOK_UP),
        )


def scan(bus: CanBus) -> Sequence[int]:
    """Ask every node id for its device type; return those that are there. Takes 0.2 s.

    Raises:
        LinkError: the bus is lost, or takes no frames.

    """
    request = sdo.Upload(objects.DEVICE_TYPE.index, objects.DEVICE_TYPE.sub).request
    for node_id in frames.NODES:
        if node_id != bus.config.master_node:
            bus.send(frames.SDO_REQUEST + node_id, request)
            bus.wait(lambda: False, _SCAN_PAUSE_S)
    bus.wait(lambda: False, _SCAN_END_S)
    return sorted(bus.heard)


#: What to do about a refusal.
_LOOK_UP: Final = "its manual states when it refuses so; switch it off and on, then try again"
_REFUSALS: Final = {
    0x06020000: "its firmware lacks what this driver needs: update it, or use another driver",
    0x06040041: "its firmware cannot map this object to a PDO: update it",
    0x06040042: "its PDOs take fewer objects than this driver maps",
    0x06010002: "the mapping of this PDO is fixed: make it variable with the maker's tool",
    0x08000022: "it is not in a state to take this: switch the device off and on, then again",
    0x08000021: "the maker's tool controls it: take it offline there",
}


def _advice(emergency: emcy.Emergency) -> str:
    if emergency.code in emcy.MASTER_SILENT:
        return (
            "for longer than `watchdog` it got nothing from this computer: frames were lost (check "
            "cable and termination), or the cycle stalled (see `rigd doctor`)"
        )
    return "its manual explains the code; the next run resets it once the cause is gone"

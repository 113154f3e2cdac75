"""Carries out SDO transfers of a CANopen node beside the cycle, which never waits for them."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from functools import partial
from typing import Final

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.can.canopen import frames, sdo
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.node import Node
from rigd_drivers.wait import looks

#: A condition that is waited for is looked at again after this, in ns.
_LOOK_NS: Final = 5_000_000


@dataclass(frozen=True)
class Read:
    """Read ``entry``; the script goes on with its value."""

    entry: Entry


@dataclass(frozen=True)
class Write:
    """Write ``value`` to ``entry``."""

    entry: Entry
    value: int


@dataclass(frozen=True)
class Pause:
    """Go on in a later cycle."""


Step = Read | Write | Pause
#: Yields what is to be done next, takes what was read, and returns the reply to a person.
Script = Generator[Step, int, str]
Part = Generator[Step, int, int]


class _Request:
    """A transfer of one entry; its frames go out at the end of a cycle."""

    def __init__(self, node: Node, entry: Entry, value: int | None) -> None:
        node.permit(entry, value)
        self._node, self._entry, self._value = node, entry, value
        self._upload = sdo.Upload(entry.index, entry.sub)
        self._transfer: sdo.Transfer = self._upload
        if value is not None:
            self._transfer = sdo.Download(entry.index, entry.sub, entry.pack(value))
        self._before = node.disturbances()
        self._deadline_ns = time.monotonic_ns() + round(node.sdo_timeout_s * 1e9)
        node.replies.clear()
        self._order(self._transfer.request)

    def poll(self) -> int | None:
        """Return the value read, or that written, once it is; None before.

        Raises:
            LinkError, ProtocolError: the node does not answer, or refuses.

        """
        node, transfer = self._node, self._transfer
        while (reply := node.answer(transfer)) is not None:
            try:
                following = transfer.feed(reply)
            except sdo.Aborted as error:
                raise node.refused(self._entry, self._value, error) from error
            except sdo.Garbled as error:
                self._order(transfer.abort(0x05040001))
                raise ProtocolError(f"{node}: SDO transfer of {self._entry}: {error}") from error
            if following is not None:
                self._order(following)
                return None
            if self._value is not None:
                return self._value
            try:
                return self._entry.unpack(self._upload.value(self._entry.size))
            except ValueError as error:
                raise ProtocolError(f"{node}: {error}") from error
        if node.bus.now_ns > self._deadline_ns:  # what came until then has been taken in
            raise node.silent(str(self._entry), node.disturbances(self._before))
        return None

    def _order(self, data: bytes) -> None:
        self._node.bus.put(frames.SDO_REQUEST + self._node.node_id, data)


class Errand:
    """Plays ``script`` at ``node``, at most a step in each call of :meth:`advance`."""

    def __init__(self, node: Node, script: Script) -> None:
        self._node = node
        self._script = script
        self._request: _Request | None = None
        self._pause_ns = 0

    def advance(self) -> str | None:
        """Take what came, order what is next; return the reply at the end, else None.

        Raises:
            LinkError, ProtocolError, DeviceError: the node does not answer, refuses, or does not
                do what the script expects; the errand has ended.

        """
        if self._request is None:
            if time.monotonic_ns() < self._pause_ns:
                return None
            return self._go_on(partial(next, self._script))
        try:
            value = self._request.poll()
        except (LinkError, ProtocolError, DeviceError) as error:
            self._request = None
            return self._go_on(partial(self._script.throw, error))
        if value is None:
            return None
        self._request = None
        return self._go_on(partial(self._script.send, value))

    def _go_on(self, step: Callable[[], Step]) -> str | None:
        try:
            ordered = step()
        except StopIteration as end:
            return str(end.value)
        if isinstance(ordered, Pause):
            self._pause_ns = time.monotonic_ns() + _LOOK_NS
        else:
            value = ordered.value if isinstance(ordered, Write) else None
            try:
                self._request = _Request(self._node, ordered.entry, value)
            except ProtocolError as error:
                return self._go_on(partial(self._script.throw, error))
        return None


def nearer(count: int, to: int, than: int, span: int) -> bool:
    """Return whether ``count`` is nearer ``to`` a position than ``than``; after ``span`` is 0."""

    def gap(other: int) -> int:
        return abs((count - other + span // 2) % span - span // 2)

    return than == to or gap(to) < gap(than)


def until(entry: Entry, is_right: Callable[[int], bool], timeout_s: float, what: str) -> Part:
    """Read ``entry`` until its value is right; return that value.

    Raises:
        DeviceError: it is not when asked after ``timeout_s``; ``what`` begins the sentence.

    """
    value = None
    for _ in looks(timeout_s):
        value = yield Read(entry)
        if is_right(value):
            return value
        yield Pause()
    raise DeviceError(f"{what}: object {entry} is {value} after {timeout_s:g} s")

"""Sets up the process data objects (PDOs) of a CANopen node by SDO, in the order of CiA 301."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from rigd.sdk import ProtocolError
from rigd_drivers.can.canopen import frames, sdo
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.canopen.pdo import EVENT_DRIVEN, INVALID, NO_REMOTE, Pdo
from rigd_drivers.can.node import Node

#: SDO abort code of an object that is read only (CiA 301, table 22).
_READ_ONLY: Final = 0x06010002


def configure(node: Node, pdo: Pdo) -> None:
    """Set ``pdo`` up while it is invalid, then make it valid.

    What the node has for good is accepted if it is what is wanted.

    Raises:
        LinkError, ProtocolError: see :meth:`Node.ensure`.

    """
    valid, cob_id = pdo.cob_id()
    try:
        _invalidate(node, valid, node.read(valid))
    except ProtocolError as error:
        if _is_fixed(error) and _is_set_up(node, pdo):
            return
        raise
    node.ensure(*pdo.transmission())
    for entry, value in pdo.optional():
        node.ensure_optional(entry, value)
    try:
        for entry, value in pdo.remapping():
            node.ensure(entry, value)
    except ProtocolError as error:
        if not (_is_fixed(error) and _holds(node, pdo.mapping())):
            raise
    node.ensure(valid, cob_id)


def switch_off_rest(node: Node, used: Sequence[Pdo]) -> None:
    """Make invalid what PDOs of CiA 301 the node has beside ``used``, which would load the bus.

    Raises:
        LinkError, ProtocolError: see :meth:`Node.ensure`.

    """
    kept = {(pdo.transmit, pdo.number) for pdo in used}
    for bases, sent in ((frames.RPDO, False), (frames.TPDO, True)):
        for number, base in enumerate(bases, start=1):
            if (sent, number) in kept:
                continue
            valid, _ = Pdo(number, sent, base + node.node_id, EVENT_DRIVEN, ()).cob_id()
            found = node.read_optional(valid)
            if found is not None:
                _invalidate(node, valid, found)


def _is_fixed(error: ProtocolError) -> bool:
    """Return whether an entry was not written since it is read only, by its node or its EDS."""
    cause = error.__cause__
    return cause is None or (isinstance(cause, sdo.Aborted) and cause.code == _READ_ONLY)


def _is_set_up(node: Node, pdo: Pdo) -> bool:
    """Return whether ``pdo`` is valid and in all else as wanted."""
    valid, cob_id = pdo.cob_id()
    return (
        (node.read(valid) ^ cob_id) & ~NO_REMOTE == 0
        and _holds(node, [pdo.transmission()])
        and all(node.read_optional(entry) in (None, value) for entry, value in pdo.optional())
        and _holds(node, pdo.mapping())
    )


def _holds(node: Node, values: Iterable[tuple[Entry, int]]) -> bool:
    """Return whether the node has these values."""
    return all(node.read(entry) == value for entry, value in values)


def _invalidate(node: Node, valid: Entry, found: int) -> None:
    """Set bit 31 of a COB-id that is ``found``, and nothing else."""
    if not found & INVALID:
        node.ensure(valid, found | INVALID)

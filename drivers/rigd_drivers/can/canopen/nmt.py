"""Encodes CANopen network management: commands of the master, states of a node, the heartbeat.

Source: CiA 301 (4.2.0), sections 7.2.8 and 7.3.2.
"""

from __future__ import annotations

from enum import IntEnum


class Command(IntEnum):
    """Commands that the master sends to a node."""

    START = 0x01
    STOP = 0x02
    PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


class State(IntEnum):
    """States that a node reports in its heartbeat."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


def command(order: Command, node: int) -> bytes:
    """Return the data of the NMT frame (identifier 0) that orders ``node``."""
    return bytes([order, node])


def heartbeat(state: State = State.OPERATIONAL) -> bytes:
    """Return the data of a heartbeat frame."""
    return bytes([state])


def read_heartbeat(data: bytes) -> State | None:
    """Return the state in a heartbeat; None if the frame is not one (bit 7 is reserved)."""
    if len(data) != 1:
        return None
    try:
        return State(data[0] & 0x7F)
    except ValueError:
        return None

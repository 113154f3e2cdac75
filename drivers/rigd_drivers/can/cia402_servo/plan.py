"""Plans what a driver of a CiA 402 drive writes by SDO and maps to PDOs; nothing is sent."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from rigd.sdk import LinkConfig
from rigd_drivers.can.canopen import cia402, objects, pdo
from rigd_drivers.can.canopen.cia402 import Mode
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.cia402_servo import by_sdo
from rigd_drivers.can.cia402_servo.config import ServoConfig
from rigd_drivers.can.cia402_servo.profile import Choice
from rigd_drivers.can.node import HEARTBEAT_MS

#: Heartbeats that must fit into the watchdog time, so that a late one does not trip it.
_HEARTBEATS_IN_WATCHDOG: Final = 3
#: What set-up cannot do without reading.
READ: Final = (
    objects.STATUSWORD,
    objects.SUPPORTED_MODES,
    objects.MODE_DISPLAY,
    objects.POSITION,
)


def reads(config: ServoConfig) -> tuple[Entry, ...]:
    """Return what set-up cannot do without reading."""
    return READ if config.profile is None else (*READ, *config.profile.reads())


def writes(config: ServoConfig, link: LinkConfig | None, choice: Choice) -> list[tuple[Entry, int]]:
    """Return what set-up and proof of the watchdog write by SDO, beside the PDOs."""
    master, method = getattr(link, "master_node", 127), config.homing_method
    return [
        (objects.HEARTBEAT_PRODUCER, HEARTBEAT_MS),
        *by_sdo.watch_writes(master, config.watchdog),
        *([] if config.profile is None else config.profile.writes()),
        *((objects.CONTROLWORD, word) for word in cia402.WORDS),
        (choice.target, 0),
        (objects.MODE, choice.mode),
        *([] if method is None else [(objects.HOMING_METHOD, method), (objects.MODE, Mode.HOMING)]),
    ]


def command(config: ServoConfig, choice: Choice) -> pdo.Pdo:
    """Return the RPDO with controlword and target."""
    carrier = config.pdos.command
    # A second watchdog, if the drive has it: targets must keep coming, not only heartbeats.
    timer_ms = round(config.watchdog * 1e3)
    return pdo.Pdo(
        carrier.number, False, carrier.cob_id + config.node, pdo.SYNCHRONOUS,
        (objects.CONTROLWORD, choice.target), timer_ms,
    )  # fmt: skip


def outputs(config: ServoConfig) -> pdo.Pdo:
    """Return the RPDO with the digital outputs."""
    carrier = config.pdos.outputs
    identifier = carrier.cob_id + config.node
    return pdo.Pdo(carrier.number, False, identifier, pdo.EVENT_DRIVEN, (objects.OUTPUTS,))


def feedback(config: ServoConfig, measured: Sequence[tuple[Entry, ...]]) -> tuple[pdo.Pdo, ...]:
    """Return the TPDOs that carry ``measured``, one tuple of entries each."""
    return tuple(
        pdo.Pdo(to.number, True, to.cob_id + config.node, pdo.SYNCHRONOUS, entries)
        for to, entries in zip(config.pdos.feedback, measured, strict=False)
    )


def too_short(config: ServoConfig, link: LinkConfig | None) -> Iterator[str]:
    """Yield why one late heartbeat would trip the watchdog, if it would."""
    least = _HEARTBEATS_IN_WATCHDOG * getattr(link, "heartbeat", 0.0)
    if config.watchdog < least:
        yield (
            f"`watchdog` of {config.watchdog * 1e3:g} ms is shorter than {_HEARTBEATS_IN_WATCHDOG} "
            f"heartbeats ({least * 1e3:g} ms) of the link: raise it, or shorten `heartbeat` there"
        )

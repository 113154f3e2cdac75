"""What must happen for every fault of every device of the shipped rig at the wire.

A missed detection is a failure: all that the simulation can show must stand here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Final


class Must(Enum):
    """What rigd must make of a fault."""

    END = "end"  #: end the run, with every drive safe
    MARK = "mark"  #: go on, with the rows marked: stale, flagged, missing or no number
    BLOCK = "block"  #: refuse before arming; nothing moves
    NAME = "name"  #: end as the operator asks, and name the drive that is not safe then
    GO_ON = "go on"  #: go on: it does no harm, or cannot be distinguished from a sound device


@dataclass(frozen=True)
class Case:
    """One fault of one device, and what must become of the run."""

    part: str
    fault: str
    must: Must
    options: Mapping[str, Any] = field(default_factory=dict)
    words: tuple[str, ...] = ()  #: patterns that the message to the operator must contain
    within_s: float = 0.5  #: END: from the injection until the run knows
    #: END: from then until every drive is safe. The cycle commands them at once, a host may stall,
    #: and behind it stands their watchdog.
    safe_s: float = 0.5
    watch_s: float = 1.0  #: how long the fault is shown if the run goes on
    before: bool = False  #: shown before the run starts
    edit: tuple[str, str] | None = None  #: no fault of a device, but of the rig file: text, wrong
    code: int = 3  #: BLOCK: exit code of the run that does not begin
    rig: str = "wire-1"  #: of ``support.faults.rigs``

    @property
    def name(self) -> str:
        """Names the case in tables and on the command line."""
        options = ",".join(f"{key}={value}" for key, value in self.options.items())
        where = "" if self.rig == "wire-1" else f"{self.rig}: "
        when = " before" if self.before else " at the end" if self.must is Must.NAME else ""
        return f"{where}{self.part} {self.fault}" + (f"({options})" if options else "") + when

    @property
    def injected(self) -> bool:
        """Whether the simulation shows it, not a rig file that names what is not there."""
        return self.edit is None or not self.fault.startswith("wrong_")

    @property
    def spoils(self) -> bool:
        """Whether the simulation must be started again: what it did is not undone by clearing."""
        moved = self.rig in (
            "belt",
            "inverter",
            "inverter-rtu",
        )  # runs that end early would add up to its travel
        if self.fault == "stream" and self.part in MENU_STREAMS:
            return True
        return self.fault == "cut" or (self.must is Must.END and (moved or self.fault == "jump"))


#: Scales whose stream is a setting of their menu, which no command ends.
MENU_STREAMS: Final = ("scale_and_d_indicator", "scale_sartorius_sbi", "scale_ohaus")
SERVOS: Final = ("wheel_servo", "longitudinal_belt", "lateral_belt")
ENCODERS: Final = ("wheel_encoder", "carriage")
#: Each bus with the devices that a message may name as it fails.
BUSES: Final = {"servo_bus": SERVOS, "encoder_bus": ENCODERS}
#: Whichever sees it first: an interlock that watches the channel, or the cycle.
SILENT: Final = "gave no row|is stale"
END, MARK, BLOCK, NAME, GO_ON = Must.END, Must.MARK, Must.BLOCK, Must.NAME, Must.GO_ON


def node(part: str) -> Iterator[Case]:
    """Faults of every CANopen node."""
    yield Case(part, "silent", END, words=(part,))
    yield Case(part, "reset", END, words=(part, "restart"))
    yield Case(part, "emergency", END, {"code": 0x7305}, words=(part, "0x7305"))
    yield Case(part, "tpdo_missing", END, words=(part, SILENT))
    yield Case(part, "tpdo_missing", MARK, {"probability": 0.5})
    # Frames come, their values are possible: it could be a device at rest.
    yield Case(part, "tpdo_stale", GO_ON)
    yield Case(part, "tpdo_short", END, words=(part, "bytes"))
    yield Case(part, "tpdo_duplicate", END, words=(part, "more often than SYNC"))
    yield Case(part, "tpdo_wrong_id", END, words=(part, SILENT))
    for fault in ("sdo_abort", "sdo_silent", "sdo_wrong_toggle", "mapping_refused"):
        yield Case(part, fault, GO_ON)  # a run that has begun asks nothing by SDO
        yield Case(part, fault, BLOCK, words=(part,), before=True)
    yield Case(part, "watchdog_dead", GO_ON)
    yield Case(part, "heartbeat_missing", END, words=(part, "heartbeat"), within_s=1.0)
    # One answer follows each SYNC, whichever it answers: TPDOs do not contain it.
    yield Case(part, "slow", GO_ON, {"delay_s": 0.005})
    yield Case(part, "slow", END, {"delay_s": 0.5}, words=(part,))
    yield Case(part, "twin", END, words=(part,))
    yield Case(part, "twin", BLOCK, words=(part,), before=True)


def _servo(part: str) -> Iterator[Case]:
    yield from node(part)
    yield Case(part, "watchdog_dead", BLOCK, words=(part, "did not switch itself off"), before=True)
    yield Case(part, "fault", END, words=(part, "fault"))
    yield Case(part, "setpoint_ignored", END, words=(part, "ignores its target"))
    yield Case(part, "locked", END, words=(part, "has left operation enabled"))
    yield Case(part, "locked", BLOCK, words=(part, "enable input"), before=True)
    # It obeys nothing: what it does at the end, rigd can only name.
    yield Case(part, "stuck", NAME, words=(part, "does not confirm that it is safe"))
    # A wheel that is stuck takes its current all the same; the belts stand in this procedure.
    yield Case(part, "blocked", GO_ON)


def _encoder(part: str) -> Iterator[Case]:
    yield from node(part)
    # What it counts wrongly shows if an interlock watches it, or another sensor is compared.
    yield Case(part, "missed_counts", GO_ON, {"fraction": 0.5})
    yield Case(part, "sign_flip", GO_ON)
    yield Case(part, "index_reset", GO_ON)
    yield Case(part, "jump", GO_ON, {"counts": 100})


def _bus(part: str) -> Iterator[Case]:
    silent = ("|".join((part, *BUSES[part])),)
    yield Case(part, "drop", MARK, {"probability": 0.1})
    yield Case(part, "drop", END, words=silent)
    yield Case(part, "delay", GO_ON, {"delay_s": 0.005})  # as a node that is slow
    yield Case(part, "delay", END, {"delay_s": 0.5}, silent)
    yield Case(part, "jitter", MARK, {"jitter_s": 0.005})
    yield Case(part, "reorder", GO_ON, {"probability": 0.2})
    yield Case(part, "duplicate", END, words=("more often than SYNC",))
    yield Case(part, "babble", GO_ON)  # 4000 frames per second leave room
    yield Case(part, "babble", END, {"rate_hz": 20e3}, words=("flooded",), within_s=1.0)
    yield Case(part, "bus_off", END, words=("bus-off",))
    yield Case(part, "wrong_bitrate", END, words=("bitrate",))
    yield Case(part, "wrong_bitrate", BLOCK, words=("bitrate",), before=True)
    yield Case(part, "stalled", END, words=silent)


def _card() -> Iterator[Case]:
    def case(fault: str, must: Must, within_s: float = 1.5, **options: Any) -> Case:
        words = ("accelerometer",) if must is END else ()
        return Case("accelerometer", fault, must, options, words, within_s=within_s)

    yield case("overrun", END)
    yield case("short_block", GO_ON)
    yield case("removal", END)
    yield case("saturation", MARK, channel="ai0", side="high")
    yield case("stuck_code", GO_ON, channel="ai0")
    yield case("open_input", GO_ON, channel="ai0")
    yield case("drift", GO_ON, ppm=100.0)
    yield case("stall", GO_ON, seconds=0.005)  # blocks are of 10 ms
    yield case("stall", END, within_s=4.0, seconds=3.0)
    yield Case("accelerometer", "removal", BLOCK, words=("accelerometer",), before=True)


def scale() -> Iterator[Case]:
    """It is asked for its weight seven times a second, and given up after 2 s without one."""

    def case(fault: str, must: Must, **options: Any) -> Case:
        words = ("scale",) if must is END else ()
        return Case("scale", fault, must, options, words, within_s=4.0, watch_s=4.0)

    for fault in ("garbage", "partial", "merged", "lost", "silent", "unplug"):
        yield case(fault, END)
    for fault in ("syntax", "transmission", "logic", "busy"):
        yield case(fault, END)
    yield case("garbage", MARK, probability=0.5)
    yield case("nul", GO_ON)
    # A late answer is taken for that to the question behind it: a weight all the same.
    for fault in ("no_cr", "echo", "stream", "late"):
        yield case(fault, GO_ON)
    for fault in ("overload", "underload", "never_stable"):
        yield case(fault, MARK)
    yield case("unit", END, unit="lb")
    yield Case("scale", "unit", BLOCK, {"unit": "lb"}, ("lb", "kg"), before=True)
    yield Case("scale", "silent", BLOCK, words=("nothing answers",), before=True)


def _transmitter() -> Iterator[Case]:
    def case(fault: str, must: Must, **options: Any) -> Case:
        words = ("traction",) if must is END else ()
        return Case("traction", fault, must, options, words, within_s=2.0, watch_s=2.0)

    for fault in ("silent", "deaf", "wrong_unit", "wrong_transaction", "wrong_function"):
        yield case(fault, END)
    for fault in ("exception", "busy", "truncated", "garbage", "word_order", "broken"):
        yield case(fault, END)
    yield case("late", END)
    yield case("byte_gap", END)
    yield case("silent", MARK, count=1)
    yield case("frozen", GO_ON)
    yield Case("traction", "word_order", BLOCK, words=("word_order",), before=True)
    yield Case("traction", "silent", BLOCK, words=("traction",), before=True)
    yield Case("traction", "broken", BLOCK, words=("traction", "fault"), before=True)
    yield case("cut", END)


#: Name of the case in which a second rigd starts on the buses of a run.
SECOND: Final = "second_rigd"


def _set_up() -> Iterator[Case]:
    """What is wrong around the devices: the rig file, or another master on the bus."""

    def wrong(part: str, fault: str, right: str, written: str, *words: str) -> Case:
        return Case(part, fault, BLOCK, words=words, before=True, edit=(right, written))

    yield wrong("wheel_servo", "wrong_node", "node: 1 #", "node: 7 #", "node 7", "found: .*1, 2, 3")
    yield wrong(
        "scale", "wrong_baud", "dialect: mt-sics", "baud: 4800\n      dialect: mt-sics", "baud"
    )
    yield wrong("traction", "wrong_map", "map: laumas-tlb4", "map: seneca-z-sg2", "traction")
    yield Case("servo_bus", SECOND, BLOCK, words=("another rigd",), before=True)


def in_order(found: Iterable[Case]) -> list[Case]:
    """Return the cases in an order that lets them share a run."""
    return sorted(found, key=lambda item: (item.before, item.spoils, item.must in (END, NAME)))


def cases() -> list[Case]:
    """Return every case of the shipped LuGre rig at the wire."""
    found = [
        *(item for part in BUSES for item in _bus(part)),
        *(item for part in SERVOS for item in _servo(part)),
        *(item for part in ENCODERS for item in _encoder(part)),
        Case("carriage", "jump", END, {"counts": 60_000}, words=("overrun_far",)),
        *_card(),
        *scale(),
        *_transmitter(),
        *_set_up(),
    ]
    return in_order(found)

"""The rigs on which faults are shown, how each moves meanwhile, and the cases of each.

``support.faults.table`` has those of the shipped LuGre rig at the wire. Here stand all others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from support.faults import table as fault_table
from support.faults.killing import DRIVING, PATIENT, QUARTER, SHAKING, Movement
from support.faults.stopping import angle_rig
from support.faults.table import BLOCK, END, GO_ON, MARK, NAME, Case, in_order
from support.wire import (
    LABJACK,
    NI,
    OVEN,
    ROBOT,
    ROOT,
    Shipped,
    WireRig,
    free_ports,
    served_rig,
    wire_rig,
)

_TO_AND_FRO: Final = """\
procedure: to_and_fro
title: The bridge goes to and fro for as long as it is left alone
doc: For tests.
trial:
  steps:
    - step: to_and_fro
      set: {{{axis}.speed: {{sine: {{amplitude: 0.1 m/s, frequency: 0.25 Hz}}}}}}
      for: 7200 s
record: all
"""
BELT: Final = Movement(
    _TO_AND_FRO.format(axis="lateral_belt"),
    drives=("lateral_belt",),
    moves=lambda parts: abs(parts["lateral_belt"]["speed"]) > 0.08,
    stream="lateral_belt",
    watchdog_s=0.1,
)
INVERTER: Final = Movement(
    _TO_AND_FRO.format(axis="lateral_drive"),
    drives=("lateral_drive",),
    moves=lambda parts: abs(parts["lateral_drive"]["speed"]) > 5.0,  # rad/s of the motor
    stream="lateral_drive",
    watchdog_s=0.6,
)
SUPPLYING: Final = Movement(
    """\
procedure: supply
title: The supply follows a sine for as long as it is left alone
doc: For tests.
trial:
  steps:
    - step: supply
      set: {supply.voltage: {sine: {offset: 6 V, amplitude: 4 V, frequency: 0.2 Hz}}}
      for: 7200 s
record: all
""",
    drives=("supply",),
    moves=lambda parts: parts["supply"]["voltage"] > 2.0,
    stream="cycle",  # a supply is asked less often
    watchdog_s=1.0,  # it has none: after a kill another process makes it safe
)
HEATING: Final = Movement(
    """\
procedure: heat
title: The oven follows a sine for as long as it is left alone
doc: For tests.
trial:
  steps:
    - step: heat
      set: {oven.temperature: {sine: {offset: 50 degC, amplitude: 10 K, frequency: 0.02 Hz}}}
      for: 7200 s
record: all
""",
    drives=("oven",),
    moves=lambda parts: parts["oven"]["output"] and parts["oven"]["set_temperature"] > 40.0,
    stream="cycle",
    watchdog_s=1.0,  # it has none: after a kill another process makes it safe
)
ROLLING: Final = Movement(
    """\
procedure: roll
title: Drives for as long as it is left alone
doc: A circle that does not end.
trial:
  steps:
    - step: roll
      set: {right_motor.speed: 200 rad/s, left_motor.speed: 100 rad/s}
      for: 7200 s
record: all
""",
    drives=("right_motor", "left_motor"),
    moves=lambda parts: parts["right_motor"]["enabled"] and parts["right_motor"]["speed"] > 199,
    stream="right_motor",
    watchdog_s=0.1,
)
CARD_SHAKING: Final = replace(
    SHAKING,
    drives=("card",),
    moves=lambda parts: abs(parts["card"]["wheel_demand"]) > 0.01,
    watchdog_s=0.6,
)
NI_SHAKING: Final = replace(
    SHAKING,
    drives=("ni_card",),
    moves=lambda parts: abs(parts["ni_card"]["wheel_demand"]) > 0.01,
    watchdog_s=0.2,
)
LABJACK_SHAKING: Final = replace(
    SHAKING,
    drives=("labjack",),
    moves=lambda parts: abs(parts["labjack"]["wheel_demand"]) > 0.01,
    watchdog_s=2.0,
)

_INVERTER_RIG: Final = """\
rig: wire-inverter
title: The bridge on a Modbus drive
cycle: 100 Hz
simulation:
  model: wire-lugre
  folder: FOLDER
  buses: {}
  plant: {parameters: ROOT/configs/plants/lugre.yaml, floor: stone}
  wheel_servo: null
  longitudinal_belt: null
  lateral_belt: null
  wheel_encoder: null
  carriage: null
  accelerometer: null
  scale: null
  lateral_drive: {port: PORT}
supervision: {cycle_silence: 250 ms, daemon_silence: 1 s}
devices:
  lateral_drive:
    driver: modbus-servo
    options:
      host: 127.0.0.1
      port: PORT
      map: schneider-atv320
      max_speed: 3000 rpm
      travel: 100 mm/rev
      watchdog: 0.5 s
    limits:
      speed: {low: -0.7 m/s, high: 0.7 m/s, rate: 2 m/s^2}
interlocks:
  - name: follows
    source: lateral_drive.speed
    follows: lateral_drive.speed
    band: 50 mm/s
    delay: 0.5 s
    stale_after: 300 ms
    action: abort
    priority: high
    message: The bridge does not run as it is asked to.
"""
DIALECTS: Final = (
    "mt-sics", "kern-kcp", "and-d", "and-d-indicator", "sartorius-sbi", "ohaus",
)  # fmt: skip
_LINES_RIG: Final = r"""rig: wire-bench
title: A supply, instruments and scales on serial lines
cycle: 100 Hz
simulation:
  model: wire-lines
  folder: FOLDER
  devices:
    gauge: {ask: '?', answer: '{force:.3f} N', values: {force: 4.285}, noise: {force: 0.002}}
    climate:
      rate: 5 Hz
      answer: '{temperature:.2f};{humidity:.1f};0'
      values: {temperature: 21.5, humidity: 45.0}
      noise: {temperature: 0.02, humidity: 0.1}
  supplies: {supply: {}}
  scales: {SCALES}
supervision: {cycle_silence: 250 ms, daemon_silence: 1 s}
devices:
  supply:
    driver: line-outputs
    options:
      port: FOLDER/supply
      identify: '*IDN?\n'
      ask: 'MEAS:VOLT?;:MEAS:CURR?\n'
      separator: ';'
      columns: [voltage, current]
      channels:
        voltage: {unit: V, low: -1 V, high: 33 V}
        current: {unit: A, low: -5 A, high: 5 A}
      outputs:
        voltage: {unit: V, low: 0 V, high: 30 V, write: 'VOLT {voltage:.4f}\n'}
      arm: 'OUTP ON\n'
      safe: ['OUTP OFF\n', 'VOLT 0\n']
      state: {ask: 'OUTP?\n', safe: '0', ready: '1'}
      period: 50 ms
    limits:
      voltage: {low: 0 V, high: 12 V, rate: 50 V/s}
    waiver: {by: A. Person, reason: The emergency stop cuts its mains}
  gauge:
    driver: lines
    options:
      port: FOLDER/gauge
      ask: '?\r'
      period: 100 ms
      pattern: '(?P<force>-?\d+\.\d+) N'
      channels: {force: {unit: N, low: -500 N, high: 500 N}}
  climate:
    driver: lines
    options:
      port: FOLDER/climate
      separator: ';'
      columns: [temperature, humidity, '-']
      channels:
        temperature: {unit: degC, low: -20 degC, high: 60 degC}
        humidity: {unit: '%', low: 0 %, high: 100 %}
interlocks:
  - name: supply_follows
    source: supply.voltage
    follows: supply.voltage
    band: 1 V
    delay: 1 s
    stale_after: 5 s
    action: abort
    priority: high
    message: The supply does not give the voltage that is asked of it.
"""
_SCALE: Final = """\
  {name}:
    driver: serial-scale
    options: {{port: FOLDER/{name}, dialect: {dialect}, unit: kg}}
"""


def scale_of(dialect: str) -> str:
    """Return the name of the scale with this dialect."""
    return f"scale_{dialect.replace('-', '_')}"


@contextmanager
def lines_rig(folder: Path, dialects: Sequence[str] = DIALECTS) -> Iterator[WireRig]:
    """A supply, two instruments and a scale of each dialect."""
    scales = ", ".join(f"{scale_of(item)}: {{dialect: {item}}}" for item in dialects)
    text = _LINES_RIG.replace("SCALES", scales)
    for item in dialects:
        entry = _SCALE.format(name=scale_of(item), dialect=item)
        text = text.replace("interlocks:\n", f"{entry}interlocks:\n")
    with served_rig(folder, text) as rig:
        yield rig


@contextmanager
def inverter_rig(folder: Path, *, serial: bool = False) -> Iterator[WireRig]:
    """The bridge of the LuGre rig on a Modbus drive, over TCP or RTU, and nothing else."""
    (port,) = free_ports(1)
    text = _INVERTER_RIG.replace("ROOT", str(ROOT))
    if serial:
        text = text.replace("{port: PORT}", "{}").replace("watchdog: 0.5 s", "watchdog: 0.8 s")
        text = text.replace("host: 127.0.0.1", "serial_port: FOLDER/lateral_drive")
        text = text.replace("port: PORT\n", "parity: none\n")  # a simulated port has no other
    with served_rig(folder, text.replace("PORT", str(port))) as rig:
        yield rig


#: A sensor as its maker describes it, and one of a load cell, both on the bus of the encoders.
_DBC: Final = """\
VERSION ""
NS_ :
BS_:
BU_: Sensor
BO_ 291 WheelLoad: 2 Sensor
 SG_ LoadForce : 0|16@1- (0.1,0) [-1000|1000] "N" Vector__XXX
"""
_SENSORS: Final = {
    "floor: stone}\n": """\
floor: stone}
  cell: {bus: encoder_bus, node: 21}
  can_sensors:
    wheel_load: {bus: encoder_bus, dbc: sensor.dbc, message: WheelLoad, values: {LoadForce: 39}}
""",
    "\ninterlocks:": """
  wheel_load:
    driver: can-message
    link: encoder_bus
    options: {dbc: sensor.dbc, message: WheelLoad}

  cell:
    driver: cia404-transmitter
    link: encoder_bus
    options: {node: 21, unit: 1 N, physical_unit: 0x00210000, low: -300 N, high: 300 N}

interlocks:""",
}


@contextmanager
def sensors_rig(
    folder: Path, changes: Mapping[str, str] = MappingProxyType({})
) -> Iterator[WireRig]:
    """The LuGre rig with a sensor of a DBC file and a CiA 404 transmitter, and ``changes``."""
    (folder / "sensor.dbc").write_text(_DBC)
    with wire_rig(folder, "wire-sensors", {**PATIENT, **_SENSORS, **changes}) as rig:
        yield rig


def _port(rig: str, part: str, must: fault_table.Must, fault: str, **options: Any) -> Case:
    words = (part,) if must is END else ()
    return Case(part, fault, must, options, words, within_s=4.5, watch_s=4.0, rig=rig)


def _of_lines() -> Iterator[Case]:
    """Gauge and logger: a device that is not heard for 3 s has failed."""
    for part in ("gauge", "climate"):
        case = partial(_port, "lines", part)
        for fault in ("garbage", "partial", "merged", "lost", "silent", "unplug", "comma", "word"):
            yield case(END, fault)
        for fault in ("endless", "nul", "short"):
            yield case(END, fault)
        for fault in ("no_cr", "echo"):
            yield case(GO_ON, fault)
        # An answer that does not come costs the rows of 2 s: half of them are too many.
        yield case(END if part == "gauge" else MARK, "garbage", probability=0.5)
        yield case(END if part == "gauge" else GO_ON, "late")
        yield Case(part, "silent", BLOCK, words=(part,), before=True, rig="lines")


def _of_supply() -> Iterator[Case]:
    case = partial(_port, "lines", "supply")
    for fault in ("garbage", "partial", "merged", "lost", "late", "comma"):
        yield case(END, fault)
    for fault in ("silent", "unplug"):  # it hears nothing, and has no watchdog
        yield replace(case(NAME, fault), words=("supply could not be made safe|supply does not",))
    for fault in ("setpoint_ignored", "tripped", "locked"):
        yield case(END, fault)
    yield case(END, "garbage", probability=0.5)
    yield case(END, "nul")
    for fault in ("no_cr", "echo"):
        yield case(GO_ON, fault)
    yield Case("supply", "stuck", NAME, words=("supply", "is not safe after"), rig="lines")
    # That its output is not switched on shows as it is armed.
    yield Case("supply", "locked", BLOCK, words=("supply did not become ready",), before=True,
               code=4, rig="lines")  # fmt: skip
    yield Case("supply", "silent", BLOCK, words=("supply",), before=True, rig="lines")


def _of_scale(dialect: str) -> Iterator[Case]:
    """As the scale of the shipped rig, in another dialect."""
    for case in fault_table.scale():
        if case.edit is None:
            yield replace(case, part=scale_of(dialect), rig="lines",
                          words=tuple(word.replace("scale", scale_of(dialect))
                                      for word in case.words))  # fmt: skip


def _of_inverter() -> Iterator[Case]:
    """A drive that is out of reach is safe by its own watchdog, which acts after 0.5 s."""
    part = "lateral_drive"

    def case(must: fault_table.Must, fault: str, *words: str, **options: Any) -> Case:
        told = (part, *words) if must in (END, NAME) else words
        return Case(part, fault, must, options, told,
                    within_s=2.0, watch_s=2.0, safe_s=0.6, rig="inverter")  # fmt: skip

    for fault in ("silent", "deaf", "wrong_unit", "wrong_transaction", "wrong_function"):
        yield case(END, fault)
    for fault in ("exception", "busy", "truncated", "garbage", "late", "byte_gap", "cut"):
        yield case(END, fault)
    for fault in ("watchdog_tripped", "overcurrent", "locked"):
        yield case(END, fault)
    for fault in ("blocked", "setpoint_ignored"):
        yield case(END, fault, "interlock follows")
    yield case(GO_ON, "silent", count=1)
    yield case(NAME, "stuck")
    for fault in ("watchdog_dead", "watchdog_unset"):
        yield case(GO_ON, fault)  # it is proven before the rig is armed
    for fault in ("silent", "watchdog_dead"):
        yield Case(part, fault, BLOCK, words=(part,), before=True, rig="inverter")
    yield Case(part, "watchdog_unset", BLOCK, words=("reads back as",), before=True, rig="inverter",
               edit=("watchdog: 0.5 s", "watchdog: 0.6 s"))  # fmt: skip
    # Its watchdog is proven while it is disabled; that it is not enabled shows as it is armed.
    yield Case(part, "locked", BLOCK, words=("did not become ready",), before=True, code=4,
               rig="inverter")  # fmt: skip


def _of_serial_inverter() -> Iterator[Case]:
    """As over TCP, but for what only one of the two lines has; its watchdog acts after 0.8 s."""
    for case in _of_inverter():
        fault = "crc" if case.fault == "wrong_transaction" else case.fault
        edit = None if case.edit is None else ("watchdog: 0.8 s", "watchdog: 0.9 s")
        yield replace(case, fault=fault, edit=edit, safe_s=0.9, rig="inverter-rtu")


def _of_sensors() -> Iterator[Case]:
    """A device on CAN that only measures, as an encoder does, and one that sends by itself."""
    for common in fault_table.node("cell"):
        yield replace(common, rig="sensors")
    yield Case("cell", "overload", MARK, rig="sensors")

    def case(must: fault_table.Must, fault: str, **options: Any) -> Case:
        words = ("wheel_load",) if must is END else ()
        return Case("wheel_load", fault, must, options, words, within_s=1.5, rig="sensors")

    yield case(END, "silent")
    yield case(END, "short")
    yield case(GO_ON, "foreign")
    yield case(GO_ON, "value", signal="LoadForce", value=100.0)
    yield case(MARK, "value", signal="LoadForce", value=2000.0)
    yield Case("wheel_load", "silent", BLOCK, words=("wheel_load",), before=True, rig="sensors")


def _of_ni() -> Iterator[Case]:
    def case(must: fault_table.Must, fault: str, *words: str, **options: Any) -> Case:
        return Case("ni_card", fault, must, options, words, within_s=1.5, rig="ni")

    yield case(END, "removal", "is gone")
    yield case(END, "reset", "-200088")
    yield case(END, "watchdog_expired", "watchdog|one-shot")
    yield case(END, "drive_fault", "wheel_servo", drive="wheel")
    yield case(END, "saturation", "more current than was commanded", input=0, rail="high")
    yield case(MARK, "saturation", input=1, rail="high")
    yield case(END, "stall", "NI card", seconds=1.0)
    yield case(GO_ON, "stall", seconds=0.005)
    for fault in ("stuck_code", "open_input"):
        yield case(GO_ON, fault, input=1)
    for fault in ("counter_reset", "sign_flip"):
        yield case(GO_ON, fault, counter=1)
    yield case(GO_ON, "watchdog_dead")
    for fault, told in (
        ("watchdog_dead", "watchdog of the card was still up"),
        ("removal", "card"),
    ):
        yield Case("ni_card", fault, BLOCK, words=(told,), before=True, rig="ni")


def _of_labjack() -> Iterator[Case]:
    def case(must: fault_table.Must, fault: str, *words: str, **options: Any) -> Case:
        # What is not heard is made safe by its own watchdog alone, after 1 s.
        return Case("labjack", fault, must, options, words, within_s=1.5, safe_s=1.5, rig="labjack")

    for fault in ("silent", "deaf", "wrong_transaction", "wrong_function"):
        yield case(END, fault, "LabJack")
    yield case(GO_ON, "wrong_unit")  # its unit is no part of its address
    for fault in ("exception", "busy", "truncated", "garbage", "late", "byte_gap", "cut"):
        yield case(END, fault, "card: .*(LabJack|connection)")
    yield case(END, "watchdog_acts", "watchdog|one-shot")
    yield case(END, "failed_input", "-9999 V")
    yield case(END, "no_tick", "LabJack")
    yield case(END, "drive_fault", "wheel_servo", drive="wheel")
    for fault in ("counter_reset", "watchdog_dead", "other_product"):
        yield case(GO_ON, fault)  # watchdog and product are looked at before the rig is armed
    for fault, told in (("watchdog_dead", "watchdog of the card was still up"),
                        ("other_product", "T8"), ("silent", "LabJack")):  # fmt: skip
        yield Case("labjack", fault, BLOCK, words=(told,), before=True, rig="labjack")


def _of_tracker() -> Iterator[Case]:
    """Interlocks ask for a frame with each marker within 0.5 s."""

    def case(must: fault_table.Must, fault: str, **options: Any) -> Case:
        words = ("marker",) if must is END else ()
        return Case("tracker", fault, must, options, words, within_s=1.5, watch_s=2.0, rig="robot")

    for fault in ("silent", "lost", "dropped", "frozen", "restarted", "garbage", "nan", "field"):
        yield case(END, fault)
    for fault in ("late", "unit", "degrees", "long"):
        yield case(END, fault)
    yield case(END, "lost", body="front")
    for fault in ("duplicate", "reordered", "stranger"):
        yield case(MARK, fault)
    yield case(MARK, "flood", rate_hz=2000.0)  # at ten times that, frames are lost by chance
    yield case(MARK, "lost", probability=0.3)
    yield case(GO_ON, "late", delay_s=0.1)
    for fault in ("exchanged", "scale"):
        yield case(GO_ON, fault)
    yield Case("tracker", "silent", BLOCK, words=("tracker",), before=True, rig="robot")


def _of_oven() -> Iterator[Case]:
    case = partial(_port, "oven", "oven")
    for fault in ("garbage", "partial", "merged", "lost", "late", "nul", "echo"):
        yield case(END, fault)
    yield case(GO_ON, "no_cr")
    yield case(END, "garbage", probability=0.5)
    for fault in ("setpoint_ignored", "tripped", "locked", "broken_wire"):
        yield case(END, fault)
    for fault in ("silent", "unplug"):  # it hears nothing, and has no watchdog
        yield replace(case(NAME, fault), words=("oven could not be made safe|oven does not",))
    yield Case("oven", "stuck", NAME, words=("oven",), rig="oven")
    yield Case("oven", "locked", BLOCK, words=("oven",), before=True, code=4, rig="oven")
    yield Case("oven", "silent", BLOCK, words=("oven",), before=True, rig="oven")


def _of_relay() -> Iterator[Case]:
    def case(must: fault_table.Must, fault: str, *words: str, before: bool = False) -> Case:
        return Case("relay", fault, must, words=words, before=before, rig="angle")

    # The contact itself has no wire back to the card: what moves then is seen by other sensors.
    yield case(GO_ON, "welded")
    yield case(GO_ON, "broken")
    yield case(GO_ON, "one_shot_dead")
    yield case(BLOCK, "one_shot_dead", "relay", before=True)


def _of_card() -> Iterator[Case]:
    def case(must: fault_table.Must, fault: str, *words: str, **options: Any) -> Case:
        return Case("card", fault, must, options, words, within_s=1.5, rig="card")

    yield case(END, "eolc_stuck", "card: .*EOLC")
    yield case(END, "fifo_short", "card: analogue input 7")
    yield case(END, "card_removed", "MF624 is gone")
    yield case(END, "drive_fault", "wheel_servo", drive="wheel")
    yield case(END, "saturation", "card: analogue input 7", input=7)  # the reference
    yield case(MARK, "saturation", input=1)
    for fault in ("stuck_code", "open_input"):
        yield case(GO_ON, fault, input=1)
    for fault in ("index_reset", "sign_flip"):
        yield case(GO_ON, fault, encoder=0)
    yield case(GO_ON, "one_shot_dead")
    yield Case("card", "one_shot_dead", BLOCK, words=("one-shot",), before=True, rig="card")
    yield Case("card", "card_removed", BLOCK, words=("card",), before=True, rig="card")


@contextmanager
def _card_rig(folder: Path) -> Iterator[WireRig]:
    text = (ROOT / "configs" / "card_lugre.yaml").read_text()
    for old, new in _ON_SOCKET.items():
        assert old in text, old
        text = text.replace(old, new)
    with served_rig(folder, text) as rig:
        yield rig


#: What stands in the shipped file of the rig on a card, and what stands here instead.
_ON_SOCKET: Final = {
    "rig: card-lugre": "rig: card-faults",
    "cycle: 4 kHz": "cycle: 100 Hz",
    "interface: lugre": "interface: emulator",
    "resource: stone": "resource: FOLDER/card",
    "time: 240 ms": "time: 600 ms",
    "cycle_silence: 250 ms": "cycle_silence: 5 s",
    "\nlinks:": """
simulation:
  model: wire-lugre
  folder: FOLDER
  buses: {}
  card: {one_shot: 0.5 s}
  wheel_servo: null
  longitudinal_belt: null
  lateral_belt: null
  wheel_encoder: null
  carriage: null
  accelerometer: null
  scale: null

links:""",
}
#: The relay stays closed, and the wheel slides on, for as long as the campaign asks.
_ENDLESS: Final = {
    "    high: 55 rad\n": "    high: 119 rad\n",
    "    high: 0.5\n    delay: 2 s\n": "    high: 1\n    delay: 2 s\n",
}


def _change(rig: WireRig, quantity: str) -> None:
    rig.ask(do="change", quantity=quantity, value="start")


def _off(part: str) -> Callable[[WireRig], None]:
    def by_hand(rig: WireRig) -> None:
        rig.ask(do="fault", part=part, fault="tripped")

    return by_hand


def _shipped(
    name: str, shipped: Shipped, replaced: Mapping[str, str] | None = None
) -> Callable[[Path], AbstractContextManager[WireRig]]:
    return lambda folder: wire_rig(folder, name, replaced, shipped)


def _left(rig: WireRig) -> None:
    """Nothing has to be set up again."""


@dataclass(frozen=True)
class FaultRig:
    """A rig, how it moves, and what is shown on it."""

    served: Callable[[Path], AbstractContextManager[WireRig]]
    movement: Movement
    cases: tuple[Case, ...]
    #: Kind of a part in the table; the part itself, unless given.
    kinds: dict[str, str]
    #: Called before each run.
    set_up: Callable[[WireRig], None] = _left
    #: Switches off by hand what rigd could only name.
    by_hand: Callable[[WireRig], None] = _left


_KINDS: Final = {
    **dict.fromkeys(fault_table.SERVOS, "CAN servo"),
    **dict.fromkeys(fault_table.ENCODERS, "CAN encoder"),
    **dict.fromkeys(fault_table.BUSES, "CAN bus"),
    "accelerometer": "NI card",
    "traction": "Modbus transmitter",
    "scale": "scale, mt-sics",
}
RIGS: Final[dict[str, FaultRig]] = {
    "wire-1": FaultRig(
        lambda folder: wire_rig(folder, "wire-faults", PATIENT),
        SHAKING,
        tuple(fault_table.cases()),
        _KINDS,
    ),
    "belt": FaultRig(
        lambda folder: wire_rig(folder, "wire-belt", PATIENT),
        BELT,
        (
            Case("lateral_belt", "blocked", END, words=("interlock lateral_belt_follows",),
                 within_s=3.5, rig="belt"),
            Case("servo_bus", "drop", END, {"id": 0x203}, ("interlock lateral_belt_follows",),
                 within_s=3.5, rig="belt"),
        ),
        {"lateral_belt": "CAN servo, moving", "servo_bus": "CAN bus, belt moving"},
    ),
    "inverter": FaultRig(
        inverter_rig, INVERTER, tuple(in_order(_of_inverter())), {"lateral_drive": "Modbus servo"}
    ),
    "inverter-rtu": FaultRig(
        partial(inverter_rig, serial=True),
        replace(INVERTER, watchdog_s=0.9),
        tuple(in_order(_of_serial_inverter())),
        {"lateral_drive": "Modbus servo, RTU"},
    ),
    "sensors": FaultRig(
        sensors_rig, SHAKING, tuple(in_order(_of_sensors())),
        {"cell": "CiA 404 transmitter", "wheel_load": "sensor of a DBC file"},
    ),
    "ni": FaultRig(
        _shipped("ni-faults", NI), NI_SHAKING, tuple(in_order(_of_ni())),
        {"ni_card": "NI card that drives"},
    ),
    "labjack": FaultRig(
        _shipped("labjack-faults", LABJACK), LABJACK_SHAKING, tuple(in_order(_of_labjack())),
        {"labjack": "LabJack"},
    ),
    "robot": FaultRig(
        _shipped("robot-faults", ROBOT, {"cycle: 1 kHz": QUARTER["cycle: 1 kHz"]}),
        ROLLING, tuple(in_order(_of_tracker())), {"tracker": "camera tracker"},
        set_up=lambda rig: _change(rig, "robot"),
    ),
    "oven": FaultRig(
        _shipped("oven-faults", OVEN), HEATING, tuple(in_order(_of_oven())), {"oven": "scpi"},
        by_hand=_off("oven"),
    ),
    "lines": FaultRig(
        lines_rig,
        SUPPLYING,
        tuple(
            in_order(
                [
                    *_of_supply(),
                    *_of_lines(),
                    *(case for name in DIALECTS[1:] for case in _of_scale(name)),
                ]
            )
        ),
        {
            "supply": "line-outputs",
            "gauge": "lines, asked",
            "climate": "lines, unasked",
            **{scale_of(name): f"scale, {name}" for name in DIALECTS[1:]},
        },
        by_hand=_off("supply"),
    ),
    "angle": FaultRig(
        lambda folder: angle_rig(folder, "wire-relay", _ENDLESS),
        DRIVING,
        tuple(in_order(_of_relay())),
        {"relay": "NI relay"},
        set_up=lambda rig: _change(rig, "platform"),
    ),
    "card": FaultRig(
        _card_rig, CARD_SHAKING, tuple(in_order(_of_card())), {"card": "register card"}
    ),
}  # fmt: skip


def every_case() -> list[Case]:
    """Return the cases of all rigs, in the order in which each rig plays its own."""
    return [case for rig in RIGS.values() for case in rig.cases]


def kind_of(case: Case) -> str:
    """Return what the table calls the part of ``case``."""
    return RIGS[case.rig].kinds.get(case.part, case.part)

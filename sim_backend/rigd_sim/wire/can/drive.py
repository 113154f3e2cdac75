"""Simulates a CiA 402 servo drive in cyclic torque (CST) or cyclic velocity mode (CSV).

As the standard has it, torque is in thousandths of the rated torque (object 6076, in mN m), current
in thousandths of the rated current (6075, in mA), velocity as object 60A9 has it (here in
thousandths of a turn per minute of the motor), position in counts of the encoder on the motor. A
make of drive (``traits``) has other units, objects and modes, and looks at its commands once per
scan.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, ClassVar, Final, Self

from rigd_sim.wire.can.canopen import misbehaviour
from rigd_sim.wire.can.canopen.dictionary import Abort, AbortCode, Entry, Kind
from rigd_sim.wire.can.canopen.heartbeat import Watch
from rigd_sim.wire.can.canopen.ids import Identity, Manners
from rigd_sim.wire.can.canopen.node import CanopenNode
from rigd_sim.wire.can.homing402 import Homing
from rigd_sim.wire.can.hub import CanHub
from rigd_sim.wire.can.states402 import (
    FOLLOWS,
    LIMITED,
    REMOTE,
    VOLTAGE_ENABLED,
    DriveState,
    StateMachine,
)
from rigd_sim.wire.can.traits import DriveTraits
from rigd_sim.wire.part import State

#: Servo drive of the device profile 402 (CiA 402-1).
DEVICE_TYPE: Final = 0x00020192
#: Object 60A9: velocity in 10^-3 min^-1 (CiA 303-2: prefix FD, unit B4 over 47).
MILLI_RPM: Final = 0xFDB44700
MILLI_RPM_PER_RAD_S: Final = 60e3 / (2 * math.pi)
#: Bit of the digital outputs 60FE:1 (the first of the manufacturer's) that releases the clutch.
RELEASE: Final = 1 << 16
#: A drive that turns slower stands, in rad/s; and its period of checks during a quick stop, in s.
STANDSTILL: Final = 0.5
#: States in which the motor has torque.
ENERGISED: Final = (DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE)
LOOK_S: Final = 0.01


class Mode(IntEnum):
    """Modes of operation, object 6060."""

    NONE = 0
    PV = 3
    PT = 4
    HM = 6
    CSV = 9
    CST = 10


class Reaction(IntEnum):
    """Object 6007: what a lost connection does to an enabled drive."""

    NONE = 0
    FAULT = 1
    DISABLE = 2
    QUICK_STOP = 3


@dataclass(frozen=True)
class Sensed:
    """What a drive measures at the motor shaft: counts, rad/s, N m."""

    counts: int
    speed: float
    torque: float


@dataclass(frozen=True)
class Demand:
    """What a drive does to its motor: A in CST, rad/s in CSV; braked if not ``powered``."""

    value: float = 0.0
    powered: bool = False
    released: bool = False


@dataclass(frozen=True)
class Motor:
    """The physics behind a drive; times are CLOCK_MONOTONIC in ns and never go back."""

    sense: Callable[[int], Sensed]
    command: Callable[[int, Demand], None]


@dataclass(frozen=True)
class Ratings:
    """The plate of a drive and its motor."""

    mode: Mode  #: the only one it supports
    nominal_current: float  #: A
    current_limit: float  #: A
    torque_constant: float  #: N m/A
    counts_per_turn: int
    lever: float = 1.0  #: what moves per rad of the shaft, in m; speeds are shown to observers so


class Cia402Drive(CanopenNode):
    """A servo drive on ``hub`` that turns ``motor``."""

    faults: ClassVar = {
        **misbehaviour.FAULTS,
        "fault": "drops to its fault state without an emergency, once",
        "setpoint_ignored": "does not follow its setpoint (bits 9 and 12 of the statusword are 0)",
        "stuck": "answers, and goes on as it was: it obeys no controlword, setpoint or watchdog",
        "locked": "its enable input is open: it is not enabled, and no longer if it was",
        "blocked": "its motor is held fast: it gives torque as ordered, and does not turn",
    }

    def __init__(
        self,
        name: str,
        hub: CanHub,
        node: int,
        motor: Motor,
        ratings: Ratings,
        *,
        serial: int = 1,
        rpdo_timer: bool = False,
        traits: DriveTraits | None = None,
    ) -> None:
        identity, manners = _identity(traits, serial), Manners()
        if traits is not None:
            manners = Manners(traits.boots_twice, traits.boot_emergencies, traits.segmented)
        super().__init__(name, hub, node, identity, rpdo_timer=rpdo_timer, manners=manners)
        self._motor = motor
        self._ratings = ratings
        self._rpdo_timer = rpdo_timer
        self._traits = traits
        self._scan: asyncio.TimerHandle | None = None  #: its next look at what was commanded
        self._modes: tuple[int, ...] = (ratings.mode,) if traits is None else traits.modes
        self._velocity_units = MILLI_RPM_PER_RAD_S  #: in 1 rad/s
        if traits is not None:
            self._velocity_units = traits.velocity_per_rad_s(ratings.counts_per_turn)
        self._machine = StateMachine()
        self._homing = Homing()
        self._demand = Demand()
        self._held_counts = 0  #: where the shaft is held fast
        self._given_since_ns = self._safe_since_ns = time.monotonic_ns()
        self._fault_follows = False
        self._stopping = Watch(self._look_whether_it_stands)
        self._rated_torque = ratings.nominal_current * ratings.torque_constant
        self._add_objects(ratings)

    def _add_objects(self, ratings: Ratings) -> None:
        def add(index: int, sub: int, kind: Kind, value: int = 0, **rules: Any) -> Entry:
            return self.dictionary.add(Entry(index, sub, kind, value, **rules))

        measured = {"mappable": True}
        commanded = {"mappable": True, "writable": True}
        self._error_code = add(0x603F, 0, Kind.U16, **measured)
        self._connection_option = add(0x6007, 0, Kind.I16, Reaction.QUICK_STOP, writable=True,
                                      low=Reaction.NONE, high=Reaction.QUICK_STOP)  # fmt: skip
        self._control = add(0x6040, 0, Kind.U16, **commanded)
        self._status = add(0x6041, 0, Kind.U16, **measured)
        self._stop_option = add(0x605A, 0, Kind.I16, 6, writable=True, low=0, high=6)
        add(0x605E, 0, Kind.I16, 2, writable=True, low=0, high=2)
        self._mode = add(0x6060, 0, Kind.I8, check=self._check_mode, **commanded)
        self._mode_shown = add(0x6061, 0, Kind.I8, **measured)
        self._position = add(0x6064, 0, Kind.I32, **measured)
        self._velocity = add(0x606C, 0, Kind.I32, **measured)
        self._target_torque = add(0x6071, 0, Kind.I16, **commanded)
        largest = ratings.current_limit / ratings.nominal_current
        add(0x6073, 0, Kind.U16, round(largest * 1e3))
        add(0x6075, 0, Kind.U32, round(ratings.nominal_current * 1e3))
        add(0x6076, 0, Kind.U32, round(self._rated_torque * 1e3))
        self._torque = add(0x6077, 0, Kind.I16, **measured)
        self._current = add(0x6078, 0, Kind.I16, **measured)
        code = MILLI_RPM if self._traits is None else self._traits.velocity_code
        add(0x60A9, 0, Kind.U32, code or 0)
        self._target_velocity = add(0x60FF, 0, Kind.I32, **commanded)
        self._homing_method = Entry(0x6098, 0, Kind.I8, 0, writable=True)
        if Mode.HM in self._modes:
            self.dictionary.add(self._homing_method)
        add(0x6502, 0, Kind.U32, sum(1 << mode - 1 for mode in self._modes))
        outputs = Entry(0x60FE, 1, Kind.U32, 0, writable=True, mappable=True)
        (self._outputs,) = self.dictionary.array(0x60FE, [outputs])
        turn = (ratings.counts_per_turn, 1)
        self.dictionary.array(
            0x608F, [Entry(0x608F, sub, Kind.U32, n) for sub, n in enumerate(turn, start=1)]
        )
        if self._traits is not None:
            motor = {
                "nominal_current": ratings.nominal_current,
                "current_limit": ratings.current_limit,
                "torque_constant": ratings.torque_constant,
                "rated_torque": self._rated_torque,
            }
            self._traits.change(self.dictionary, motor)

    def _check_mode(self, mode: int) -> None:
        if mode not in (Mode.NONE, *self._modes):
            raise Abort(AbortCode.VALUE_RANGE)

    def twin(self) -> Self:
        """Return a drive with the same id and another serial number, with a motor at rest."""
        at_rest = Motor(lambda _: Sensed(0, 0.0, 0.0), lambda _t, _d: None)
        return type(self)(
            f"{self.name} (twin)", self._hub, self.node, at_rest, self._ratings,
            serial=self.identity.serial ^ 1, rpdo_timer=self._rpdo_timer, traits=self._traits,
        )  # fmt: skip

    def state(self) -> State:
        """Return the state, and what the motor really gets: ``current`` in A, or ``speed`` in m/s.

        ``safe_since_ns`` is the CLOCK_MONOTONIC time since which the drive has given no torque of
        its own (CST), or has braked (CSV); 0 while it follows its setpoint. ``given_since_ns`` is
        that since which the motor has got what it gets.
        """
        applied, value = "current", self._demand.value
        if self._ratings.mode is Mode.CSV:
            applied, value = "speed", value * self._ratings.lever
        return {
            **super().state(),
            "state": self._machine.state.name.lower(),
            "enabled": self._machine.state is DriveState.OPERATION_ENABLED,
            applied: value,
            "released": self._demand.released,
            "error_code": self._error_code.value,
            "safe_since_ns": self._safe_since_ns,
            "given_since_ns": self._given_since_ns,
        }

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault; see :meth:`CanopenNode.inject`."""
        super().inject(fault, **options)
        t_ns = time.monotonic_ns()
        if fault == "fault":
            self._bad.hide(fault)
            self._machine.fail()
        elif fault == "locked":
            self._open_enable_input()
        elif fault == "blocked":
            self._held_counts = self._motor.sense(t_ns).counts
            self._turn(t_ns)
        self._actuate(t_ns)

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them; see :meth:`CanopenNode.clear`."""
        shown = set(self._bad.shown)
        super().clear(fault)
        ended, t_ns = shown - set(self._bad.shown), time.monotonic_ns()
        if "stuck" in ended:
            self._follow(t_ns)
        if "blocked" in ended:
            self._turn(t_ns)
        self._actuate(t_ns)

    def sample(self, t_ns: int) -> None:
        """Measure, and bring statusword and actual values up to date."""
        sensed = self._sense(t_ns)
        self._position.value = _wrapped(sensed.counts + self._homing.offset)
        self._velocity.value = _clipped(sensed.speed * self._velocity_units, 31)
        self._torque.value = _clipped(sensed.torque / self._rated_torque * 1e3, 15)
        self._current.value = self._torque.value  # one motor: both are of its rating
        self._show_status()

    def _sense(self, t_ns: int) -> Sensed:
        """Return what the drive measures; a shaft that is held fast shows torque alone."""
        if "blocked" not in self._bad.shown:
            return self._motor.sense(t_ns)
        current = self._demand.value
        if self._ratings.mode is Mode.CSV:
            current = math.copysign(self._ratings.current_limit, current) if current else 0.0
        return Sensed(self._held_counts, 0.0, current * self._ratings.torque_constant)

    def _turn(self, t_ns: int) -> None:
        """Give the motor its demand; if its shaft is held fast, what it drives gets nothing."""
        held = "blocked" in self._bad.shown
        self._motor.command(t_ns, replace(self._demand, value=0.0) if held else self._demand)

    def _open_enable_input(self) -> None:
        """Leave the states with torque if the enable input is open."""
        if "locked" in self._bad.shown and self._machine.state in ENERGISED:
            self._machine.switch_off()

    def apply(self, t_ns: int) -> None:
        """Follow the controlword and the setpoint, at once or with the next scan."""
        scan_s = 0.0 if self._traits is None else self._traits.scan
        if not scan_s:
            self._follow(t_ns)
        elif self._scan is None:
            self._scan = asyncio.get_running_loop().call_later(scan_s, self._look)

    def _look(self) -> None:
        self._scan = None
        t_ns = time.monotonic_ns()
        self._follow(t_ns)
        self._send_changed(t_ns)

    def _follow(self, t_ns: int) -> None:
        if "stuck" in self._bad.shown:
            return
        if self._machine.control(self._control.value) and self._error_code.value:
            self._error_code.value = 0
            self.recovered()
        self._open_enable_input()
        self._mode_shown.value = self._mode.value
        if self._mode.value == Mode.HM:
            enabled = self._machine.state is DriveState.OPERATION_ENABLED
            word, counts = self._control.value, self._sense(t_ns).counts
            self._homing.follow(word, self._homing_method.value, counts, enabled=enabled)
        self._actuate(t_ns)

    def fail(self, code: int, t_ns: int) -> None:
        """Report an emergency and go to the fault state, without torque."""
        if "stuck" not in self._bad.shown:
            self._machine.fail()
        self._actuate(t_ns)
        super().fail(code, t_ns)
        self._error_code.value = code

    def connection_lost(self, t_ns: int, error: int) -> None:
        """Do what object 6007 selects, if the drive is enabled; an error then leads to a fault."""
        self._error_code.value = error or self._error_code.value
        option = self._connection_option.value
        if "stuck" in self._bad.shown:
            return
        if self._machine.state is not DriveState.OPERATION_ENABLED or option == Reaction.NONE:
            return
        if option == Reaction.QUICK_STOP:
            self._machine.quick_stop()
            self._fault_follows = bool(error)
        elif option == Reaction.FAULT or error:
            self._machine.fail()
        else:
            self._machine.switch_off()
        self._actuate(t_ns)

    def power_off(self, t_ns: int) -> None:
        """Start again without torque; the clutch, spring-applied, engages."""
        if self._scan is not None:
            self._scan.cancel()
            self._scan = None
        self._bad.hide("stuck")  # without supply, nothing goes on
        self._machine.power_on()
        self._homing.power_off()
        self._actuate(t_ns)

    def _actuate(self, t_ns: int) -> None:
        """Give the motor what state and setpoint ask for, and note since when it is safe."""
        if "stuck" in self._bad.shown:
            return
        state = self._machine.state
        demand = Demand()
        if state is DriveState.OPERATION_ENABLED:
            demand = Demand(self._setpoint(), True, bool(self._outputs.value & RELEASE))
        elif state is DriveState.QUICK_STOP_ACTIVE:
            # Torque mode has nothing to stop with but the torque itself.
            demand = Demand(powered=self._ratings.mode is Mode.CSV)
            if not self._stopping.running:
                self._stopping.feed(LOOK_S)
        if demand.value != self._demand.value:
            self._given_since_ns = t_ns
        if demand != self._demand:
            self._demand = demand
            self._turn(t_ns)
        if state is DriveState.OPERATION_ENABLED:
            self._safe_since_ns = 0
        elif not self._safe_since_ns:
            self._safe_since_ns = t_ns
        self._show_status()

    def _setpoint(self) -> float:
        """Return the demanded current in A, or speed of the shaft in rad/s."""
        ratings = self._ratings
        moving = (Mode.CSV, Mode.PV) if ratings.mode is Mode.CSV else (Mode.CST, Mode.PT)
        if "setpoint_ignored" in self._bad.shown or self._mode.value not in moving:
            return 0.0
        if ratings.mode is Mode.CSV:
            return self._target_velocity.value / self._velocity_units
        current = self._target_torque.value * 1e-3 * ratings.nominal_current
        return min(max(current, -ratings.current_limit), ratings.current_limit)

    def _show_status(self) -> None:
        word = self._machine.state | VOLTAGE_ENABLED
        if "setpoint_ignored" not in self._bad.shown:
            word |= REMOTE
            if self._mode.value == Mode.HM:
                word |= self._homing.status
            elif self._machine.state is DriveState.OPERATION_ENABLED and self._shows_bit_12():
                word |= FOLLOWS
        if abs(self._demand.value) >= self._ratings.current_limit and (
            self._ratings.mode is Mode.CST
        ):
            word |= LIMITED
        self._status.value = word

    def _shows_bit_12(self) -> bool:
        """Return bit 12: it follows in the cyclic modes, it stands in PV, and 0 in PT."""
        if self._mode.value == Mode.PV:
            return self._velocity.value == 0
        return bool(self._mode.value != Mode.PT)

    def _look_whether_it_stands(self) -> None:
        if self._machine.state is not DriveState.QUICK_STOP_ACTIVE:
            return
        t_ns = time.monotonic_ns()
        stands = self._ratings.mode is Mode.CST or abs(self._motor.sense(t_ns).speed) < STANDSTILL
        if stands and self._fault_follows:
            self._machine.fail()
        elif stands and self._stop_option.value < 5:
            self._machine.switch_off()
        elif stands:
            return  # it stays in quick stop, braked, until the controlword commands otherwise
        self._fault_follows = False if stands else self._fault_follows
        self._actuate(t_ns)


def _identity(traits: DriveTraits | None, serial: int) -> Identity:
    if traits is None:
        return Identity(DEVICE_TYPE, "rigd simulated servo", product=0x402, serial=serial)
    return Identity(
        DEVICE_TYPE, traits.name, traits.product, serial, traits.vendor, traits.revision
    )


def _wrapped(counts: int) -> int:
    """Return ``counts`` as a 32-bit counter shows them."""
    return (counts + 2**31) % 2**32 - 2**31


def _clipped(value: float, bits: int) -> int:
    """Return ``value`` rounded into the range of a signed integer of ``bits`` and a sign."""
    high = (1 << bits) - 1
    return max(-high - 1, min(round(value), high))

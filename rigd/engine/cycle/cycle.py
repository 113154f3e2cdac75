"""Runs the control cycle: read every device, check interlocks, compute, limit and write setpoints.

The cycle never waits for a device. In each cycle the interlocks are checked first and the limiter
acts last, whatever the program commands. When no program is loaded, setpoints go to rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import monotonic_ns
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from rigd.computed.derived.driver import Derived
from rigd.computed.driver import Computed
from rigd.computed.observers.driver import Observer
from rigd.config.rig import RestBound
from rigd.engine.clock import Clock
from rigd.engine.cycle.block_rows import BlockSink
from rigd.engine.cycle.computing import Computing, late_after
from rigd.engine.cycle.inputs import inputs_of
from rigd.engine.cycle.limiter import Limiter
from rigd.engine.cycle.mount import MountedRig
from rigd.engine.cycle.places import DevicePlaces
from rigd.engine.cycle.resting import Resting
from rigd.engine.cycle.rows import CycleRows, RingSink
from rigd.engine.play.conditions import Taken
from rigd.engine.play.control import Control
from rigd.engine.play.holding import HoldPhase
from rigd.engine.play.interlocks import InterlockBank, Trip
from rigd.engine.play.player import Outcome, Player
from rigd.engine.play.windows import Windows
from rigd.model.errors import DeviceError, LinkError, ProtocolError
from rigd.model.severity import Severity
from rigd.procedure.program import CycleProgram, Recorded
from rigd.sdk import Driver, Link, Plant

if TYPE_CHECKING:
    from rigd.computed.controllers.bank import Bank
    from rigd.computed.derived.evaluator import Evaluator

#: Between two programs setpoints are held for this time at most, then they go to rest: the next
#: program may come from another process.
HOLD_NS = 100_000_000

#: Most trips in the result; a value that fluctuates at its limit trips hundreds of times per
#: second. All trips are recorded as events.
MOST_TRIPS = 100

#: No device is asked after this time whether it is safe, in ns; each may take 0.5 s. Together they
#: stay below the 2 s after which the daemon makes the rig safe over a second link.
CONFIRMING_NS: Final = 1_000_000_000

#: The errors by which a device fails.
DEVICE_ERRORS = (DeviceError, LinkError, ProtocolError)

_NONE: Final[Mapping[str, Any]] = MappingProxyType({})

#: ``emit(t_ns, kind, data)``: records an event that is of interest to people.
Emit = Callable[[int, str, Mapping[str, object]], None]


def _nowhere(t_ns: int, kind: str, data: Mapping[str, object]) -> None:
    """Discard events before the cycle is connected."""


def _succeeds(call: Callable[[int], None], t_ns: int) -> bool:
    """Call a part of a link, after every device is safe; return whether it succeeded."""
    try:
        call(t_ns)
    except Exception:  # noqa: BLE001 - boundary: the rig is safe, and this link is left alone
        return False
    return True


def _why_silent(link: object) -> str:
    """Return what may be the cause that a device on ``link`` gives no row."""
    lost = link.lost if isinstance(link, Link) else 0
    if lost:
        return f"its link overflowed: {lost} frames lost, since this computer did not take them in"
    return "check its supply, its cable and the parts between"


@dataclass
class CycleCounters:
    """Counts the cycles, missed slots and stale rows of a run."""

    cycles: int = 0
    missed: int = 0  #: slots without a cycle
    stale: int = 0  #: rows that repeat an earlier row, because the device was late


class Cycle:
    """The control cycle of one rig; call :meth:`connect` before the first :meth:`step`."""

    def __init__(
        self,
        rig: MountedRig,
        limiter: Limiter,
        interlocks: InterlockBank,
        clock: Clock,
        control: Control,
        evaluator: Evaluator | None = None,
        controllers: Bank | None = None,
        at_rest: Sequence[RestBound] = (),
    ) -> None:
        self.rig = rig
        self.resting = Resting(at_rest, rig)
        self.limiter = limiter
        self.interlocks = interlocks
        self.clock = clock
        self.control = control
        self.counters = CycleCounters()
        self.segment = ""
        #: How far the hold of the present step is; it stays until the next program is loaded.
        self.phase = HoldPhase.NONE
        #: Trips in this run: the first :data:`MOST_TRIPS`, and the first of each interlock.
        self.trips: list[Trip] = []
        #: Called before the devices are made safe, which may take longer than a cycle.
        self.on_make_safe: Callable[[], None] = lambda: None
        self._emit: Emit = _nowhere
        self._rows = CycleRows(rig, {}, {}, {}, {})
        self._playing = ""  #: the step that plays in this cycle
        self._watched = {**rig.readings, **rig.status}
        self._values = [float("nan")] * len(rig.stamp_of)
        self._stamps = [0] * (len(rig.mounts) + len(rig.derived))
        self._taken = Taken(self._stamps, rig.stamp_of)
        self._fresh = [False] * len(rig.mounts)  # whether this cycle has read a row
        before = Derived | Observer  # computed before anything is decided
        self._silent = {item.name for item in rig.mounts if not isinstance(item.driver, before)}
        self._rest = [limit.rest for limit in limiter.limits]
        self._wanted = list(self._rest)
        self._holding = [n for n, limit in enumerate(limiter.limits) if limit.holds]
        self._actuators = [
            (mount.name, mount.driver, mount.commands)
            for mount in rig.mounts
            if mount.driver.declaration.setpoints and not isinstance(mount.driver, Computed)
        ]
        self._links = tuple(rig.links.items())
        self._silent_ns = [round(mount.driver.declaration.silent_s * 1e9) for mount in rig.mounts]
        self._reads = [
            (n, DevicePlaces.of(mount))
            for n, mount in enumerate(rig.mounts)
            if not isinstance(mount.driver, Computed)
        ]
        self._steady = [n for n, read in self._reads if read.driver.declaration.every_cycle]
        late_ns = late_after(rig, clock.period_ns)
        self._inputs = inputs_of(rig, late_ns)
        self._computing = Computing(
            rig,
            self._values,
            self._stamps,
            late_ns,
            limiter.applied,
            self._wanted,
            evaluator,
            controllers,
            clock.period_ns,
        )
        self._acting: frozenset[str] = frozenset()  #: setpoints of the controllers that act
        self._hold_until_ns = 0
        self._settle_ns = max(self._silent_ns, default=0)
        self._begun_ns = 0
        self._settled = False
        self._player: Player | None = None
        self._then: Player | None = None  #: follows without a gap when the player reaches its end
        self._leaving: Outcome | None = None
        self._obeyed: Severity | None = None
        self._slot = -1
        self._cut: frozenset[int] = frozenset()
        self._reading_on = False  #: after the end of the run
        self._ending: list[Link] = []  #: links that send what asks their devices then

    @property
    def t_ns(self) -> int:
        """Unix time of the present slot, in ns."""
        return self.clock.start_ns + max(self._slot, 0) * self.clock.period_ns

    @property
    def silent_devices(self) -> int:
        """Number of devices that have not returned a row yet."""
        return len(self._silent)

    def arming_blockers(self) -> Sequence[str]:
        """Return the reasons why the rig, at rest, cannot be armed; one sentence each."""
        reasons = [f"{name} gave no row" for name in sorted(self._silent)]
        found = {item.name: why for item, why in self.interlocks.violated(Severity.END_TRIAL)}
        reasons += [f"interlock {name} is violated at rest: {why}" for name, why in found.items()]
        tripped = [trip for trip in self.trips if trip.interlock.action >= Severity.END_TRIAL]
        return reasons + [
            f"interlock {trip.interlock.name} tripped at rest: {trip.reason}"
            for trip in tripped
            if trip.interlock.name not in found
        ]

    def not_enabled(self) -> Sequence[str]:
        """Return the names of the devices that are armed but not enabled yet."""
        return [mount.name for mount in self.rig.mounts if not mount.driver.ready()]

    def arm(self) -> Outcome | None:
        """Begin to enable every device; return an outcome if a device refused (all are safe)."""
        for mount in self.rig.mounts:
            try:
                mount.driver.arm()
            except DEVICE_ERRORS as error:
                return self._fault(self.t_ns, f"{mount.name}: {error.one_line}")
        return None

    def lockout_reason(self) -> str:
        """Return why motion is locked out (a trip that is latched or still active), or ""."""
        for trip in self.trips:
            if trip.interlock.latch and trip.interlock.action >= Severity.END_TRIAL:
                return f"interlock {trip.interlock.name} is latched: {trip.reason}"
        for interlock in self.interlocks.active(Severity.END_TRIAL):
            return f"interlock {interlock.name} is still tripped"
        return ""

    def connect(
        self,
        rings: Mapping[str, RingSink],
        record: Mapping[str, Recorded],
        emit: Emit,
        *,
        blocks: Mapping[str, BlockSink] = _NONE,
        windows: Mapping[str, Windows] = _NONE,
    ) -> None:
        """Start to push rows to ``rings`` according to ``record``, rows of blocks to ``blocks``.

        ``windows`` are those of streams that another process records.
        """
        self._emit = emit
        self._rows = CycleRows(self.rig, rings, record, blocks, windows, self._taken)

    def load(self, program: CycleProgram | None, then: CycleProgram | None = None) -> None:
        """Play ``program`` from the next cycle on; None takes the setpoints to rest.

        After the end of the program, ``then`` follows in the next cycle. A stop in progress is not
        cancelled: it ends the new program at once.
        """
        self._player, self._then = self._bound(program), self._bound(then)
        self.segment, self.phase = "", HoldPhase.NONE
        self._hold_until_ns = 0

    def begin_trial(self, trial: int) -> None:
        """Let observers and derived channels that begin anew with each trial do so."""
        self._computing.begin_trial(trial)

    @property
    def follows_trials(self) -> bool:
        """Whether a derived channel has a parameter that differs by trial."""
        return self._computing.follows_trials

    def end_trial(self) -> None:
        """Let derived channels know no parameter that differs by trial."""
        self._computing.end_trial()

    def _bound(self, program: CycleProgram | None) -> Player | None:
        if program is None:
            return None
        loops = self._computing.loops
        return Player(program, self._watched, self.rig.setpoints, loops, self._taken)

    def readings(self) -> Mapping[str, float]:
        """Return the newest value of every channel."""
        return {name: self._values[index] for name, index in self.rig.readings.items()}

    def step(self) -> Outcome | None:
        """Run one cycle; return how the program ended, or None while it continues."""
        clock = self.clock
        slot = clock.next_slot()
        began = clock.now()
        self.counters.cycles += 1
        if self._slot >= 0 and slot != self._slot + 1:
            missed = slot - self._slot - 1
            self.counters.missed += missed
            self._emit(self.t_ns, "late", {"missed_slots": missed})
        t_ns = clock.start_ns + slot * clock.period_ns
        if self._slot < 0:
            self._begun_ns = t_ns
            self._stamps[:] = [t_ns] * len(self._stamps)
        self._slot = slot
        self._playing = ""
        self._acting = frozenset()

        try:
            outcome = self._read(t_ns)
            if outcome is None:
                outcome = self._decide(t_ns)
                self._control(t_ns)
                if outcome is None or outcome.severity is not Severity.ESTOP:
                    outcome = self._write(t_ns) or outcome
        except BaseException:
            self.make_safe(t_ns)  # a bug in a driver: first make the rig safe, then raise
            raise
        for captured in self._rows.decide(t_ns, self._playing, self._values):
            self._emit(t_ns, "capture", captured)
        self._push(t_ns, slot, began)
        return outcome

    def reads_on(self, *, asking: bool) -> bool:
        """Return whether a device can be read after :meth:`make_safe`; from then on only those are.

        They are simulated on a plant, or their link says that reading sends nothing. With
        ``asking`` also those whose drivers say that they stay safe while they are asked: what is
        sent feeds their watchdogs, so that all must have become safe before.
        """
        if not self._reading_on:
            self._reading_on = True
            drivers = [places.driver for _, places in self._reads]
            on = {
                id(link): link.reads_on
                for _, link in self._links
                if link.reads_on
                or (asking and all(d.reads_when_safe for d in drivers if d.link is link))
            }
            self._links = tuple(item for item in self._links if id(item[1]) in on)
            self._ending = [link for _, link in self._links if not on[id(link)]]
            self._reads = [
                (index, places)
                for index, places in self._reads
                if isinstance(places.driver.link, Plant)
                or id(places.driver.link) in on
                or (asking and places.driver.link is None and places.driver.reads_when_safe)
            ]
            self._rows.keep({index for index, _ in self._reads})
        return bool(self._reads)

    def read_on(self) -> bool:
        """Read and record in the next slot, after :meth:`reads_on`; nothing is written.

        No interlock acts, and no cycle is counted. The setpoints in the rows are those at rest. A
        device that fails, or whose link does, is read no more. Returned is whether rows go on: a
        device is left, and the rig does not rest yet.
        """
        self._slot = slot = self.clock.next_slot()
        t_ns = self.clock.start_ns + slot * self.clock.period_ns
        lost = [link for _, link in self._links if not _succeeds(link.begin, t_ns)]
        gone = []
        for index, (_, driver, places, _) in self._reads:
            try:
                row = None if driver.link in lost else driver.read(t_ns)
            except Exception:  # noqa: BLE001 - boundary: the rig is safe, and this device is left alone
                row = None
                gone.append(index)
            self._fresh[index] = row is not None
            if row is not None:
                self._values[places] = row[:]
                self._stamps[index] = driver.taken_ns or t_ns
        lost += [
            link for link in self._ending if link not in lost and not _succeeds(link.end, t_ns)
        ]
        if lost or gone:
            self._links = tuple(item for item in self._links if item[1] not in lost)
            self._ending = [link for link in self._ending if link not in lost]
            self._reads = [
                item
                for item in self._reads
                if item[0] not in gone and item[1].driver.link not in lost
            ]
            self._rows.keep({index for index, _ in self._reads})
        self._rows.push(t_ns, slot, self._values, self._rest, self._stamps, self._fresh)
        rests = self.resting.see(t_ns, self._values, self._stamps)
        return bool(self._reads) and not rests

    def _read(self, t_ns: int) -> Outcome | None:
        for name, link in self._links:
            try:
                link.begin(t_ns)
            except DEVICE_ERRORS as error:
                return self._fault(t_ns, f"{name}: {error.one_line}")
        values, stamps, silent, fresh = self._values, self._stamps, self._silent, self._fresh
        for index, (name, driver, places, width) in self._reads:
            try:
                row = driver.read(t_ns)
            except DEVICE_ERRORS as error:
                return self._fault(t_ns, f"{name}: {error.one_line}")
            fresh[index] = row is not None
            if row is not None:
                if len(row) != width:  # it would move the values of all other devices
                    return self._fault(
                        t_ns,
                        f"{name} gave a row of {len(row)} values, expected {width}: "
                        "correct its read()",
                    )
                values[places] = row[:]  # a plain tuple: a list of a Row takes 3 times as long
                taken_ns = driver.taken_ns
                if taken_ns is None:
                    stamps[index] = t_ns
                elif taken_ns <= t_ns:
                    stamps[index] = taken_ns
                else:  # it would look fresh for longer than it is
                    ahead_s = (taken_ns - t_ns) * 1e-9
                    return self._fault(
                        t_ns, f"{name} gave a row that is {ahead_s:.6g} s ahead: correct its read()"
                    )
                if silent:
                    silent.discard(name)
            elif t_ns - stamps[index] > self._silent_ns[index]:
                silent_ms = self._silent_ns[index] // 1_000_000
                return self._fault(
                    t_ns, f"{name} gave no row for {silent_ms} ms ({_why_silent(driver.link)})"
                )
        self._computing.estimate(t_ns)
        return None

    def _write(self, t_ns: int) -> Outcome | None:
        setpoints = self.limiter.apply(self._wanted)
        for name, driver, commands in self._actuators:
            try:
                driver.write(setpoints[commands])
            except DEVICE_ERRORS as error:
                return self._fault(t_ns, f"{name}: {error.one_line}")
        for name, link in self._links:
            try:
                link.end(t_ns)
            except DEVICE_ERRORS as error:
                return self._fault(t_ns, f"{name}: {error.one_line}")
        for inputs in self._inputs:
            try:
                inputs.give(t_ns, self._values, self._stamps, setpoints)
            except DEVICE_ERRORS as error:
                return self._fault(t_ns, f"{inputs.name}: {error.one_line}")
        if self.limiter.cut != self._cut:
            self._report_cut(t_ns)
        return None

    def _decide(self, t_ns: int) -> Outcome | None:
        """Set the wanted setpoints by interlocks, requests and the program, in that order."""
        if not self._settled:
            # Before its first row a device has no value to check; nothing is armed.
            self._settled = not self._silent or t_ns - self._begun_ns >= self._settle_ns
        if self._settled:
            applied = self.limiter.applied
            for trip in self.interlocks.check(t_ns, self._values, self._stamps, applied):
                self._handle_trip(trip)
        asked = self.control.asked
        if asked is not None and asked != self._obeyed:
            self._obeyed = asked
            self._leave(Outcome(asked, self.control.reason))
        if self._leaving is None and self._player is not None:
            ended = self._play(self._player, t_ns)
            if ended is None or ended.severity is Severity.DONE:
                self._playing = self.segment  # the program ``then`` begins in the next cycle
            if ended is None:
                self._acting = self._player.acting
                return None
            if ended.severity is Severity.DONE:
                self._player, self._then = self._then, None
                self._hold_until_ns = t_ns + HOLD_NS
                return ended
            self._leave(ended)
        if self._leaving is None and t_ns < self._hold_until_ns:
            return None
        self._want_rest()
        return self._stop_completed(t_ns)

    def _play(self, player: Player, t_ns: int) -> Outcome | None:
        """Play the program for a cycle; hold its step if a pause is wanted and the step allows."""
        control = self.control
        pause = control.pause_wanted and (control.pauses or self.phase is HoldPhase.HELD)
        ended = player.step(t_ns, self._values, self._wanted, self.limiter.applied, pause=pause)
        for name in player.entered:
            self.segment = name
            self._emit(t_ns, "step", {"name": name})
        if player.phase is not self.phase:
            self.phase = player.phase
            self._emit(t_ns, "hold", {"step": self.segment, "phase": self.phase.value})
        return ended

    def _control(self, t_ns: int) -> None:
        """Let the controllers of the present step set what they command; end the trial for one."""
        reason = self._computing.control(t_ns, self._acting)
        if self._silent:
            self._silent -= self._computing.controllers
        if reason:
            self._want_rest()
            self._leave(Outcome(Severity.END_TRIAL, reason))

    def _want_rest(self) -> None:
        """Let setpoints go to rest; those that hold keep what they have reached."""
        self._wanted[:] = self._rest
        for index in self._holding:
            self._wanted[index] = self.limiter.applied[index]

    def _stop_completed(self, t_ns: int) -> Outcome | None:
        """Return the outcome when the stop is complete."""
        leaving = self._leaving
        if leaving is None:
            return None
        if leaving.severity is Severity.ESTOP:
            self.make_safe(t_ns)
        elif not self.limiter.at_rest():
            return None  # the setpoints reach rest one cycle later, which is noticed here
        self._leaving = self._player = self._then = None
        return leaving

    def _leave(self, outcome: Outcome) -> None:
        """Begin a stop of the program, unless an equally severe stop is in progress."""
        if self._leaving is None or outcome.severity > self._leaving.severity:
            self._leaving = outcome

    def _handle_trip(self, trip: Trip) -> None:
        interlock = trip.interlock
        known = any(item.interlock.name == interlock.name for item in self.trips)
        # A latched interlock trips once.
        if len(self.trips) < MOST_TRIPS or interlock.latch or not known:
            self.trips.append(trip)
        if interlock.action > Severity.WARN:
            reason = f"interlock {interlock.name}: {trip.reason}"
            self._leave(Outcome(interlock.action, reason, trip))
        self._emit(
            trip.t_ns,
            "interlock",
            {
                "name": interlock.name,
                "action": interlock.action.word,
                "priority": interlock.priority.name.lower(),
                "latched": interlock.latch,
                "value": trip.value,
                "reason": trip.reason,
                "message": trip.message,
            },
        )

    def give_up(self, waiting: Sequence[str]) -> Outcome:
        """Make the rig safe as devices ``waiting`` did not become ready; return the outcome."""
        return self._fault(self.t_ns, f"{', '.join(waiting)} did not become ready to run")

    def _fault(self, t_ns: int, reason: str) -> Outcome:
        self.make_safe(t_ns)
        self._emit(t_ns, "fault", {"reason": reason})
        return Outcome(Severity.FAULT, reason)

    def _report_cut(self, t_ns: int) -> None:
        names = [name for name, index in self.rig.setpoints.items() if index in self.limiter.cut]
        self._cut = frozenset(self.limiter.cut)
        self._emit(t_ns, "limit", {"setpoints": names})

    def _push(self, t_ns: int, slot: int, began: int) -> None:
        clock, stamps, stale = self.clock, self._stamps, 0
        if stamps.count(t_ns) != len(stamps):
            for index in self._steady:
                stale += stamps[index] != t_ns
        self.counters.stale += stale
        self._rows.push(t_ns, slot, self._values, self.limiter.applied, stamps, self._fresh)
        if self._computing.t_ns == t_ns:
            self._rows.push_computed(slot)
        spent_ns = clock.now() - began
        own = (slot * clock.period_ns * 1e-9, began * 1e-9, spent_ns * 1e-9, float(stale))
        self._rows.push_own(t_ns, slot, own)

    def make_safe(self, t_ns: int | None = None) -> Sequence[str]:
        """Bring every device to its safe state, and check it; return the errors, a sentence each.

        An error of a device does not prevent that the others are made safe.
        """
        self.on_make_safe()
        problems, ordered = [], []
        for mount in self.rig.mounts:
            try:
                mount.driver.make_safe()
            except Exception as error:  # noqa: BLE001 - boundary: recorded, and the others go on
                problems.append(f"{mount.name} could not be made safe: {error}")
            else:
                ordered.append(mount)
        for name, link in self._links:  # answers are awaited, and devices that send go on
            try:
                link.idle()
            except Exception as error:  # noqa: BLE001 - boundary: as above
                problems.append(f"{name} is not read any more: {error}")
        until_ns = monotonic_ns() + CONFIRMING_NS
        for mount in ordered:
            if type(mount.driver).confirm_safe is Driver.confirm_safe:
                continue  # it has nothing to show
            try:
                if monotonic_ns() < until_ns:
                    mount.driver.confirm_safe()
                else:
                    problems.append(
                        f"{mount.name} was not asked whether it is safe: the devices before it "
                        f"took {CONFIRMING_NS * 1e-9:g} s (look at it before you touch the rig)"
                    )
            except Exception as error:  # noqa: BLE001 - boundary: as above
                problems.append(f"{mount.name} does not confirm that it is safe: {error}")
        now_ns = self.t_ns if t_ns is None else t_ns
        self._rows.finish(now_ns)  # nothing plays any more, and no cycle may follow
        for problem in problems:  # recorded after all are safe
            self._emit(now_ns, "fault", {"reason": problem})
        return problems

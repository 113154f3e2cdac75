"""The control cycle: read every device, check interlocks, play, limit, write; it never waits.

Whatever the program says, each cycle passes the interlocks first and the limiter last. When no
program is loaded, setpoints go to rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from rigd.engine.block_rows import BlockSink
from rigd.engine.clock import Clock
from rigd.engine.control import Control
from rigd.engine.cycle_rows import CycleRows, RowSink
from rigd.engine.interlocks import InterlockBank, Trip
from rigd.engine.limiter import Limiter
from rigd.engine.mount import MountedRig
from rigd.engine.player import Outcome, Player
from rigd.engine.stand_in import StandIn
from rigd.engine.windows import Windows
from rigd.model.errors import DeviceError, LinkError, ProtocolError
from rigd.model.severity import Severity
from rigd.procedure.program import CycleProgram, Recorded

#: Between two programs setpoints are held for so long at most, then they go to rest: the next
#: program may come from another process.
HOLD_NS = 100_000_000

#: Trips that are kept; a value that trembles at its limit makes hundreds per second. All of them
#: are recorded as events.
MOST_TRIPS = 100

#: What a device's failure looks like, whoever must act on it.
DEVICE_ERRORS = (DeviceError, LinkError, ProtocolError)

_NONE: Final[Mapping[str, Any]] = MappingProxyType({})

#: ``emit(t_ns, kind, data)``: something happened that a person will want to read about.
Emit = Callable[[int, str, Mapping[str, object]], None]


def _nowhere(t_ns: int, kind: str, data: Mapping[str, object]) -> None:
    """Where events go before the cycle is connected."""


@dataclass
class CycleCounters:
    """What the cycle counts about itself over a run."""

    cycles: int = 0
    missed: int = 0  #: slots that passed without a cycle
    stale: int = 0  #: rows that repeat an earlier one, as the device was late


class Cycle:
    """The control cycle of one rig; call :meth:`connect` before the first :meth:`step`."""

    def __init__(
        self,
        rig: MountedRig,
        limiter: Limiter,
        interlocks: InterlockBank,
        clock: Clock,
        control: Control,
    ) -> None:
        self.rig = rig
        self.limiter = limiter
        self.interlocks = interlocks
        self.clock = clock
        self.control = control
        self.counters = CycleCounters()
        self.segment = ""
        self.trips: list[Trip] = []  #: what tripped in this run, the first :data:`MOST_TRIPS`
        #: Called before the devices are made safe, which may take longer than a cycle.
        self.on_make_safe: Callable[[], None] = lambda: None
        self._emit: Emit = _nowhere
        self._rows = CycleRows(rig, {}, {}, {}, {})
        self._playing = ""  #: the step that plays in this cycle
        self._watched = {**rig.readings, **rig.status}
        self._values = [float("nan")] * len(rig.device_of)
        self._stamps = [0] * len(rig.mounts)
        self._mute = {mount.name for mount in rig.mounts}
        self._rest = [limit.rest for limit in limiter.limits]
        self._wanted = list(self._rest)
        self._actuators = [mount for mount in rig.mounts if mount.driver.setpoints]
        self._links = tuple(rig.links.items())
        self._silent_ns = [round(mount.driver.silent_s * 1e9) for mount in rig.mounts]
        self._stand_ins = [item.driver if isinstance(item.driver, StandIn) else None
                           for item in rig.mounts]  # fmt: skip
        self._widths = [mount.values.stop - mount.values.start for mount in rig.mounts]
        self._steady = [i for i, mount in enumerate(rig.mounts) if mount.driver.every_cycle]
        self._hold_until_ns = 0
        self._settle_ns = max(self._silent_ns, default=0)
        self._begun_ns = 0
        self._settled = False
        self._player: Player | None = None
        self._then: Player | None = None  #: follows without a gap where the player plays to its end
        self._leaving: Outcome | None = None
        self._heeded: Severity | None = None
        self._slot = -1
        self._cut: frozenset[int] = frozenset()

    @property
    def t_ns(self) -> int:
        """Unix time of the slot under way, in ns."""
        return self.clock.start_ns + max(self._slot, 0) * self.clock.period_ns

    @property
    def mute(self) -> int:
        """How many devices have not given a single row yet."""
        return len(self._mute)

    def unfit(self) -> Sequence[str]:
        """Return why the rig, looked at in rest, is not fit to be armed; a sentence each."""
        reasons = [f"{name} gave no row" for name in sorted(self._mute)]
        violated = self.interlocks.violated(Severity.END_TRIAL)
        return reasons + [f"interlock {item.name} stands violated at rest" for item in violated]

    def unready(self) -> Sequence[str]:
        """Return the names of the devices that are not enabled yet, after they were armed."""
        return [mount.name for mount in self.rig.mounts if not mount.driver.ready()]

    def arm(self) -> Outcome | None:
        """Begin to enable every device; return an outcome where one refused (all are safe then)."""
        for mount in self.rig.mounts:
            try:
                mount.driver.arm()
            except DEVICE_ERRORS as error:
                return self._fault(self.t_ns, f"{mount.name}: {error.told}")
        return None

    def ends_everything(self) -> str:
        """Return why nothing may move any more: a latched trip, or one that still stands; or ""."""
        for trip in self.trips:
            if trip.interlock.latch and trip.interlock.action >= Severity.END_TRIAL:
                return f"interlock {trip.interlock.name} is latched: {trip.reason}"
        for interlock in self.interlocks.active(Severity.END_TRIAL):
            return f"interlock {interlock.name} still stands tripped"
        return ""

    def connect(
        self,
        rings: Mapping[str, RowSink],
        record: Mapping[str, Recorded],
        emit: Emit,
        *,
        blocks: Mapping[str, BlockSink] = _NONE,
        windows: Mapping[str, Windows] = _NONE,
    ) -> None:
        """From now on push rows to ``rings`` as ``record`` says, those of blocks to ``blocks``.

        ``windows`` are those of streams that another process records.
        """
        self._emit = emit
        self._rows = CycleRows(self.rig, rings, record, blocks, windows)

    def load(self, program: CycleProgram | None, then: CycleProgram | None = None) -> None:
        """Play ``program`` from the next cycle on; None lets the setpoints go to rest.

        Where it plays to its end, ``then`` follows in the cycle after. A way out that is being
        taken is not given up: it ends the new program at once.
        """
        self._player, self._then = self._bound(program), self._bound(then)
        self.segment = ""
        self._hold_until_ns = 0

    def _bound(self, program: CycleProgram | None) -> Player | None:
        return None if program is None else Player(program, self._watched, self.rig.setpoints)

    def readings(self) -> Mapping[str, float]:
        """Return the newest value of every channel."""
        return {name: self._values[index] for name, index in self.rig.readings.items()}

    def step(self) -> Outcome | None:
        """Run one cycle; return how the program ended, or None while it plays on."""
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
            self._stamps = [t_ns] * len(self._stamps)
        self._slot = slot
        self._playing = ""

        try:
            outcome = self._read(t_ns)
            if outcome is None:
                outcome = self._decide(t_ns)
                if outcome is None or outcome.severity is not Severity.ESTOP:
                    outcome = self._write(t_ns) or outcome
        except BaseException:
            self.make_safe(t_ns)  # a bug in a driver: safe first, then let it be known
            raise
        self._rows.decide(t_ns, self._playing)
        self._push(t_ns, slot, began)
        return outcome

    def _read(self, t_ns: int) -> Outcome | None:
        for name, link in self._links:
            try:
                link.begin(t_ns)
            except DEVICE_ERRORS as error:
                return self._fault(t_ns, f"{name}: {error.told}")
        values, stamps = self._values, self._stamps
        for index, mount in enumerate(self.rig.mounts):
            try:
                row = mount.driver.read(t_ns)
            except DEVICE_ERRORS as error:
                return self._fault(t_ns, f"{mount.name}: {error.told}")
            if row is not None:
                if len(row) != self._widths[index]:  # it would move the values of all others
                    return self._fault(
                        t_ns,
                        f"{mount.name} gave a row of {len(row)} values, expected "
                        f"{self._widths[index]}: correct its read()",
                    )
                values[mount.values] = row
                stand_in = self._stand_ins[index]
                stamps[index] = t_ns if stand_in is None else stand_in.taken_ns
                self._mute.discard(mount.name)
            elif t_ns - stamps[index] > self._silent_ns[index]:
                silent_ms = self._silent_ns[index] // 1_000_000
                return self._fault(
                    t_ns,
                    f"{mount.name} gave no row for {silent_ms} ms "
                    "(check its supply, its cable and what lies between)",
                )
        return None

    def _write(self, t_ns: int) -> Outcome | None:
        setpoints = self.limiter.apply(self._wanted)
        for mount in self._actuators:
            try:
                mount.driver.write(setpoints[mount.commands])
            except DEVICE_ERRORS as error:
                return self._fault(t_ns, f"{mount.name}: {error.told}")
        for name, link in self._links:
            try:
                link.end(t_ns)
            except DEVICE_ERRORS as error:
                return self._fault(t_ns, f"{name}: {error.told}")
        if self.limiter.cut != self._cut:
            self._report_cut(t_ns)
        return None

    def _decide(self, t_ns: int) -> Outcome | None:
        """Set the wanted setpoints from interlocks, requests and the program, in that order."""
        if not self._settled:
            # Before its first row a device has no value that could be judged; nothing is armed.
            self._settled = not self._mute or t_ns - self._begun_ns >= self._settle_ns
        if self._settled:
            for trip in self.interlocks.check(t_ns, self._values, self._stamps):
                self._heed_trip(trip)
        asked = self.control.asked
        if asked is not None and asked != self._heeded:
            self._heeded = asked
            self._leave(Outcome(asked, self.control.reason))
        if self._leaving is None and self._player is not None:
            ended = self._player.step(t_ns, self._values, self._wanted)
            for name in self._player.entered:
                self.segment = name
                self._emit(t_ns, "step", {"name": name})
            if ended is None or ended.severity is Severity.DONE:
                self._playing = self.segment  # what follows without a gap begins in the next cycle
            if ended is None:
                return None
            if ended.severity is Severity.DONE:
                self._player, self._then = self._then, None
                self._hold_until_ns = t_ns + HOLD_NS
                return ended
            self._leave(ended)
        if self._leaving is None and t_ns < self._hold_until_ns:
            return None
        self._wanted[:] = self._rest
        return self._left(t_ns)

    def _left(self, t_ns: int) -> Outcome | None:
        """Return the outcome once the way out is complete."""
        leaving = self._leaving
        if leaving is None:
            return None
        if leaving.severity is Severity.ESTOP:
            self.make_safe(t_ns)
        elif not self.limiter.at_rest():
            return None  # rest is reached one cycle after it was wanted, and seen here
        self._leaving = self._player = self._then = None
        return leaving

    def _leave(self, outcome: Outcome) -> None:
        """Take the way out of the program, unless one at least as severe is being taken."""
        if self._leaving is None or outcome.severity > self._leaving.severity:
            self._leaving = outcome

    def _heed_trip(self, trip: Trip) -> None:
        interlock = trip.interlock
        if len(self.trips) < MOST_TRIPS or interlock.latch:  # a latched one trips once
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
        """Make the rig safe, as the devices ``waiting`` did not become ready; return that."""
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
        for index in self._steady:
            stale += stamps[index] != t_ns
        self.counters.stale += stale
        self._rows.push(t_ns, slot, self._values, self.limiter.applied, stamps)
        spent_ns = clock.now() - began
        own = (slot * clock.period_ns * 1e-9, began * 1e-9, spent_ns * 1e-9, float(stale))
        self._rows.push_own(t_ns, slot, own)

    def make_safe(self, t_ns: int | None = None) -> Sequence[str]:
        """Bring every device to its safe state; return what went wrong, a sentence each.

        One device that fails never keeps the others from being made safe.
        """
        self.on_make_safe()
        problems = []
        for mount in self.rig.mounts:
            try:
                mount.driver.make_safe()
            except Exception as error:  # noqa: BLE001 - boundary: recorded, and the others go on
                problems.append(f"{mount.name} could not be made safe: {error}")
        now_ns = self.t_ns if t_ns is None else t_ns
        self._rows.decide(now_ns, "")  # nothing plays any more, and there may be no more cycle
        for problem in problems:  # told once all are safe
            self._emit(now_ns, "fault", {"reason": problem})
        return problems

"""Runs the control cycle in the process of the run, and moves its rows from the rings to a sink.

A run uses this host in virtual time, and for simulations at another speed than the wall clock. The
host decides the order in which rows and events reach the sink, so in virtual time a recording
repeats bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from rigd.engine.clock import Clock, idle, monotonic_ns
from rigd.engine.cycle.block_rows import BlockQueue
from rigd.engine.cycle.cycle import DEVICE_ERRORS, Cycle, CycleCounters
from rigd.engine.cycle.mount import Mount
from rigd.engine.cycle.plant_blocks import PlantBlocks
from rigd.engine.play.holding import HoldPhase
from rigd.engine.play.interlocks import Trip
from rigd.engine.play.player import Outcome
from rigd.engine.process.question import PendingQuestion
from rigd.engine.shared import RowRing
from rigd.engine.sink import Rows, Sink
from rigd.model.rows import TIME_FIELD
from rigd.procedure.program import CycleProgram, Recorded
from rigd.record.events.event import NO_TRIAL

#: Longest time until rows are on disk (if the recorder is killed, no more than this is lost).
FLUSH_NS = 100_000_000
#: Interval of draining the rings, in run time.
DRAIN_NS = 50_000_000
#: Longest time for devices to become enabled.
ARM_NS = 3_000_000_000
#: In virtual time frequent draining has no benefit; larger blocks are cheaper.
VIRTUAL_DRAIN_NS = 1_000_000_000
#: ``on_drain`` is called this often, in time of the wall, however long cycles take to compute.
SHOW_NS = 250_000_000


class InProcessHost:
    """Plays cycle programs to their end on a cycle in this process.

    Args:
        cycle: the cycle, wired to its rig.
        clock: the clock of that cycle.
        virtual: whether that clock never waits.
        sink: receives the rows.
        record: the streams to record, and which of their rows.
        on_drain: called after each drain, for progress.
    """

    def __init__(
        self,
        cycle: Cycle,
        clock: Clock,
        *,
        virtual: bool,
        sink: Sink,
        record: Mapping[str, Recorded],
        on_drain: Callable[[], None] = lambda: None,
    ) -> None:
        self.cycle = cycle
        self.virtual = virtual
        self._sink = sink
        self.on_drain = on_drain
        every_ns = VIRTUAL_DRAIN_NS if virtual else DRAIN_NS
        self._drain_every = max(1, every_ns // clock.period_ns)
        # Ten times the rows of one drain: room for a disk that pauses.
        room = 10 * self._drain_every + 1000
        in_blocks = {
            mount.name for mount in cycle.rig.mounts if isinstance(mount.driver, PlantBlocks)
        }
        streams = [stream for stream in cycle.rig.streams if stream.name in record]
        rings = {
            item.name: RowRing.unshared(item, room)
            for item in streams
            if item.name not in in_blocks
        }
        blocks = {item.name: BlockQueue(item) for item in streams if item.name in in_blocks}
        cycle.connect(rings, record, self._emit, blocks=blocks)
        self._rings: dict[str, RowRing | BlockQueue] = {**rings, **blocks}
        self._muted = False
        self._present: dict[str, Rows] = {}  #: those of the present slot, while muted
        self._trial = NO_TRIAL
        self._cycles = 0
        self._flushed_ns = self._shown_ns = monotonic_ns()

    @property
    def trial(self) -> int:
        """Trial number of the events; a new trial begins as it is set."""
        return self._trial

    @trial.setter
    def trial(self, number: int) -> None:
        if number not in (self._trial, NO_TRIAL):
            self.cycle.begin_trial(number)
        elif number == NO_TRIAL:
            self.cycle.end_trial()
        self._trial = number

    @property
    def muted(self) -> bool:
        """Whether rows and events are dropped: what plays is recorded already.

        Set to False, the rows of the present slot are recorded: the next trial begins with them.
        """
        return self._muted

    @muted.setter
    def muted(self, muted: bool) -> None:
        self._muted = muted
        for name, rows in self._present.items():
            if len(rows):
                self._sink.write(name, rows)
        self._present = {}

    @property
    def t_ns(self) -> int:
        """Unix time of the present slot, in ns."""
        return self.cycle.t_ns

    @property
    def run_s(self) -> float:
        """Time of the run so far, in s."""
        return (self.cycle.t_ns - self.cycle.clock.start_ns) * 1e-9

    @property
    def segment(self) -> str:
        """Name of the present step."""
        return self.cycle.segment

    @property
    def held(self) -> bool:
        """Whether a pause holds the present step, or the program ended while it did."""
        return self.cycle.phase is HoldPhase.HELD

    @property
    def counters(self) -> CycleCounters:
        """Counters of the cycle."""
        return self.cycle.counters

    @property
    def trips(self) -> Sequence[Trip]:
        """All trips so far."""
        return self.cycle.trips

    def open(self) -> Sequence[str]:
        """Open every device; return the reasons why the rig cannot be armed.

        Devices simulated in process end with this process: there is no watchdog to test.
        """
        reasons = open_devices(self.cycle)
        if reported := {name: identity for name, identity in self.identities().items() if identity}:
            self.event("devices", reported)
        return reasons

    def identities(self) -> Mapping[str, str]:
        """Return the identity that each device reported, after all are open."""
        return {mount.name: mount.driver.identity for mount in self.cycle.rig.mounts}

    def arming_blockers(self) -> Sequence[str]:
        """Return the reasons why the rig, at rest, cannot be armed; one sentence each."""
        return self.cycle.arming_blockers()

    def arm(self) -> Outcome | None:
        """Enable every device, at rest, and run cycles until all are enabled."""
        outcome = self.cycle.arm()
        begun_ns = self.cycle.t_ns
        self.cycle.load(None)
        while outcome is None and (waiting := self.cycle.not_enabled()):
            outcome = self._step()
            if outcome is None and self.cycle.t_ns - begun_ns > ARM_NS:
                outcome = self.cycle.give_up(waiting)
        return outcome

    def lockout_reason(self) -> str:
        """Return why motion is locked out, or ""."""
        return self.cycle.lockout_reason()

    def play(self, program: CycleProgram, then: CycleProgram | None = None) -> Outcome:
        """Play ``program`` to its end and return how it ended.

        ``then`` is not needed: here the next program always follows in the next cycle.
        """
        self.cycle.load(program)
        while (outcome := self._step()) is None:
            if self.virtual and self.held:  # no longer than the person takes
                self.on_drain()
                idle(self.cycle.clock.period_ns * 1e-9)
        return outcome

    def ask(self, question: Callable[[], None]) -> Outcome | None:
        """Run ``question`` in a thread; the cycle continues at rest until it returns.

        In virtual time the clock stops instead, except for a request to stop. Returns an outcome if
        the cycle had to act meanwhile (an interlock, a stop); the question then remains in its
        thread, which ends with the process.
        """
        # Rest first, so that the state afterwards does not depend on the speed of the answer.
        outcome = self.come_to_rest()
        if outcome is not None:
            return outcome
        asked = PendingQuestion(question)
        while not asked.answered:
            if self.virtual and self.cycle.control.asked is None:
                asked.wait(0.05)
                continue
            outcome = self._step()
            if outcome is not None:
                return outcome
        asked.raise_error()
        return None

    def come_to_rest(self) -> Outcome | None:
        """Take the setpoints to rest, each within its rate, and return when they are there."""
        return self.rest_while(lambda: not self.cycle.limiter.at_rest())

    def rest_while(self, condition: Callable[[], bool]) -> Outcome | None:
        """Keep the rig at rest while ``condition`` holds; return an outcome like :meth:`ask`."""
        self.cycle.load(None)
        while condition():
            outcome = self._step()
            if outcome is not None:
                return outcome
        return None

    def settle(self, count: int) -> Outcome | None:
        """Run ``count`` cycles at rest, and more until every device has returned a row."""
        enough = self.cycle.counters.cycles + count
        return self.rest_while(
            lambda: self.cycle.counters.cycles < enough or self.cycle.silent_devices > 0
        )

    def read_on(self, for_s: float, *, asking: bool) -> Mapping[str, float]:
        """Record for so long what devices show after they were made safe; see :class:`Host`.

        A request to stop that is more severe than the one before ends it.
        """
        asked = self.cycle.control.asked
        if self.cycle.reads_on(asking=asking):
            for _ in range(round(for_s * 1e9) // self.cycle.clock.period_ns):
                if self.cycle.control.asked is not asked or not self.cycle.read_on():
                    break
                self._after_cycle()
        return self.cycle.resting.moving

    def _step(self) -> Outcome | None:
        outcome = self.cycle.step()
        self._after_cycle()
        return outcome

    def _after_cycle(self) -> None:
        self._cycles += 1
        if self._cycles >= self._drain_every:
            self.drain()
        elif monotonic_ns() - self._shown_ns >= SHOW_NS:
            self._show()  # rows stay: where they are drained must not depend on the wall

    def _show(self) -> None:
        self._shown_ns = monotonic_ns()
        self.on_drain()

    def drain(self) -> None:
        """Write all waiting rows to the sink; flush if the last flush is old enough."""
        self._cycles = 0
        self._hand_over()
        now = monotonic_ns()
        # Rather half a drain early than half a drain late.
        if now - self._flushed_ns >= FLUSH_NS - DRAIN_NS // 2:
            self._sink.flush()
            self._flushed_ns = now
        self._show()

    def flush(self) -> None:
        """Write all rows and events so far."""
        self._hand_over()
        self._sink.flush(complete=True)

    def _hand_over(self) -> None:
        for name, ring in self._rings.items():
            rows = ring.drain()
            if not len(rows):
                continue
            if self._muted:
                self._present[name] = rows[rows[TIME_FIELD] >= self.t_ns]
            else:
                self._sink.write(name, rows)

    def event(self, kind: str, data: Mapping[str, object]) -> None:
        """Record an event with the time of the present slot.

        The row of this slot was computed before a trial gave parameters their values: a trial
        begins behind it, if it gives any.
        """
        after_ns = int(kind == "trial_start" and self.cycle.follows_trials)
        self._emit(self.cycle.t_ns + after_ns, kind, data)

    def _emit(self, t_ns: int, kind: str, data: Mapping[str, object]) -> None:
        if not self._muted:
            self._sink.event(t_ns, kind, self._trial, data)

    def make_safe(self) -> Sequence[str]:
        """Bring every device to its safe state; return the errors, one sentence each."""
        return self.cycle.make_safe()

    def close(self) -> None:
        """Close every device, then complete the recording."""
        try:
            for problem in close_devices(self.cycle):
                self.event("fault", {"reason": problem})
            self._hand_over()  # the last rows of a block device
        finally:
            self._sink.close()

    @property
    def overruns(self) -> int:
        """Rows lost because a ring was full."""
        return sum(ring.overruns for ring in self._rings.values())


def open_devices(
    cycle: Cycle, *, judge: bool = True, links_open: Callable[[], None] = lambda: None
) -> Sequence[str]:
    """Open links and devices of ``cycle``; return the reasons why they cannot be armed.

    Devices on a link that could not be opened are left out: one cause gives one sentence. With
    ``judge`` False, open devices are not asked whether they are fit (see :func:`judge_devices`).
    ``links_open`` is called after all links are open, before the first device is.
    """
    reasons: list[str] = []
    dead = set()
    for name, link in cycle.rig.links.items():
        try:
            link.open()
        except DEVICE_ERRORS as error:
            dead.add(id(link))
            reasons.append(f"{name}: {error}")
    if not dead:
        links_open()
    for mount in cycle.rig.mounts:
        driver = mount.driver
        if id(driver.link) in dead:
            continue
        try:
            driver.open()
        except DEVICE_ERRORS as error:
            reasons.append(f"{mount.name}: {error}")
            continue
        if judge:
            reasons += _unfit(mount)
    return reasons


def judge_devices(cycle: Cycle) -> Sequence[str]:
    """Return the reasons why the open devices of ``cycle`` cannot be armed; one sentence each."""
    return [reason for mount in cycle.rig.mounts for reason in _unfit(mount)]


def _unfit(mount: Mount) -> list[str]:
    try:
        return [f"{mount.name}: {reason}" for reason in mount.driver.preflight()]
    except DEVICE_ERRORS as error:
        return [f"{mount.name}: {error}"]


def close_devices(cycle: Cycle) -> Sequence[str]:
    """Close devices and links of ``cycle``; return the errors, one sentence each."""
    problems = []
    closing = [(mount.name, mount.driver.close) for mount in cycle.rig.mounts]
    closing += [(name, link.close) for name, link in cycle.rig.links.items()]
    for name, close in closing:
        try:
            close()
        except Exception as error:  # noqa: BLE001 - boundary: told, and the others go on
            problems.append(f"{name} could not be closed: {error}")
    return problems

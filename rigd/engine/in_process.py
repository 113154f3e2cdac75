"""Host in one process: runs the cycle and drains its rings into a sink.

The form for virtual time and for simulations paced to the wall clock. It owns the order in which
rows and events reach the sink, so that in virtual time a recording repeats bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from rigd.engine.block_rows import BlockQueue
from rigd.engine.clock import Clock, monotonic_ns
from rigd.engine.cycle import DEVICE_ERRORS, Cycle, CycleCounters
from rigd.engine.interlocks import Trip
from rigd.engine.mount import Mount
from rigd.engine.plant_blocks import PlantBlocks
from rigd.engine.player import Outcome
from rigd.engine.question import PendingQuestion
from rigd.engine.shared import RowRing
from rigd.engine.sink import Sink
from rigd.procedure.program import CycleProgram, Recorded
from rigd.record.events import NO_TRIAL

#: Rows wait at most this long before they are on disk (a killed recorder loses less than this).
FLUSH_NS = 100_000_000
#: Rings are drained this often, in time of the run.
DRAIN_NS = 50_000_000
#: How long devices may take to be enabled.
ARM_NS = 3_000_000_000
#: In virtual time nothing is gained by draining often; larger blocks are cheaper.
VIRTUAL_DRAIN_NS = 1_000_000_000


class InProcessHost:
    """Plays cycle programs to their end on a cycle in this process.

    Args:
        cycle: the cycle, wired to its rig.
        clock: the clock of that cycle.
        virtual: whether that clock never waits.
        sink: where rows go.
        record: streams to record, and what of them.
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
        # Ten times what one drain takes out: room for a disk that pauses.
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
        self.trial = NO_TRIAL  #: number of the trial that events belong to
        self._cycles = 0
        self._flushed_ns = monotonic_ns()

    @property
    def t_ns(self) -> int:
        """Unix time of the slot under way, in ns."""
        return self.cycle.t_ns

    @property
    def run_s(self) -> float:
        """Time of the run so far, in s."""
        return (self.cycle.t_ns - self.cycle.clock.start_ns) * 1e-9

    @property
    def segment(self) -> str:
        """Name of the step that plays."""
        return self.cycle.segment

    @property
    def counters(self) -> CycleCounters:
        """What the cycle counts about itself."""
        return self.cycle.counters

    @property
    def trips(self) -> Sequence[Trip]:
        """Everything that tripped so far."""
        return self.cycle.trips

    def open(self) -> Sequence[str]:
        """Open every device; return what keeps the rig from being armed.

        Simulated in process, the devices die with this process: there is no watchdog to prove.
        """
        reasons = open_devices(self.cycle)
        if said := {name: identity for name, identity in self.identities().items() if identity}:
            self.event("devices", said)
        return reasons

    def identities(self) -> Mapping[str, str]:
        """Return what every device said it is, once all are open."""
        return {mount.name: mount.driver.identity for mount in self.cycle.rig.mounts}

    def unfit(self) -> Sequence[str]:
        """Return why the rig, looked at in rest, is not fit to be armed."""
        return self.cycle.unfit()

    def arm(self) -> Outcome | None:
        """Enable every device, at rest, and run cycles until all are."""
        outcome = self.cycle.arm()
        begun_ns = self.cycle.t_ns
        self.cycle.load(None)
        while outcome is None and (waiting := self.cycle.unready()):
            outcome = self._step()
            if outcome is None and self.cycle.t_ns - begun_ns > ARM_NS:
                outcome = self.cycle.give_up(waiting)
        return outcome

    def ends_everything(self) -> str:
        """Return why nothing may move any more, or ""."""
        return self.cycle.ends_everything()

    def play(self, program: CycleProgram, then: CycleProgram | None = None) -> Outcome:
        """Play ``program`` to its end and return how it ended.

        ``then`` need not be known: what is played next follows in the next cycle here.
        """
        self.cycle.load(program)
        while (outcome := self._step()) is None:
            pass
        return outcome

    def ask(self, question: Callable[[], None]) -> Outcome | None:
        """Run ``question`` in a thread; the cycle goes on at rest until it returns.

        In virtual time the world stands still instead, unless a person wants out. Returns an
        outcome where the cycle had to act meanwhile (an interlock, a stop); the question is then
        left behind in its thread, which dies with the process.
        """
        # Rest first, so that what holds afterwards does not depend on how fast the answer came.
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
        """Let the setpoints go to rest, each within its rate, and return once they are there."""
        return self.rest_while(lambda: not self.cycle.limiter.at_rest())

    def rest_while(self, condition: Callable[[], bool]) -> Outcome | None:
        """Keep the rig at rest as long as ``condition`` holds; return an outcome as :meth:`ask`."""
        self.cycle.load(None)
        while condition():
            outcome = self._step()
            if outcome is not None:
                return outcome
        return None

    def settle(self, count: int) -> Outcome | None:
        """Run ``count`` cycles at rest, and more until every device has given a row."""
        enough = self.cycle.counters.cycles + count
        return self.rest_while(lambda: self.cycle.counters.cycles < enough or self.cycle.mute > 0)

    def _step(self) -> Outcome | None:
        outcome = self.cycle.step()
        self._cycles += 1
        if self._cycles >= self._drain_every:
            self.drain()
        return outcome

    def drain(self) -> None:
        """Hand all waiting rows to the sink; flush when the last flush is old enough."""
        self._cycles = 0
        self._hand_over()
        now = monotonic_ns()
        # Half a drain early rather than half a drain late.
        if now - self._flushed_ns >= FLUSH_NS - DRAIN_NS // 2:
            self._sink.flush()
            self._flushed_ns = now
        self.on_drain()

    def _hand_over(self) -> None:
        for name, ring in self._rings.items():
            rows = ring.drain()
            if len(rows):
                self._sink.write(name, rows)

    def event(self, kind: str, data: Mapping[str, object]) -> None:
        """Hand one event to the sink, stamped with the slot under way."""
        self._emit(self.cycle.t_ns, kind, data)

    def _emit(self, t_ns: int, kind: str, data: Mapping[str, object]) -> None:
        self._sink.event(t_ns, kind, self.trial, data)

    def make_safe(self) -> Sequence[str]:
        """Bring every device to its safe state; return what went wrong, a sentence each."""
        return self.cycle.make_safe()

    def close(self) -> None:
        """Close every device, then finish the recording."""
        try:
            for problem in close_devices(self.cycle):
                self.event("fault", {"reason": problem})
            self._hand_over()  # what a block device gave last
        finally:
            self._sink.close()

    @property
    def overruns(self) -> int:
        """Rows lost because a ring was full."""
        return sum(ring.overruns for ring in self._rings.values())


def open_devices(
    cycle: Cycle, *, judge: bool = True, links_open: Callable[[], None] = lambda: None
) -> Sequence[str]:
    """Open links and devices of ``cycle``; return what keeps them from being armed.

    What stands on a link that could not be opened is left out: one cause, one sentence. With
    ``judge`` False what is open is not asked whether it is fit (see :func:`judge_devices`).
    ``links_open`` is called once all links are, before the first device is.
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
    """Return what keeps the devices of ``cycle``, all open, from being armed; a sentence each."""
    return [reason for mount in cycle.rig.mounts for reason in _unfit(mount)]


def _unfit(mount: Mount) -> list[str]:
    try:
        return [f"{mount.name}: {reason}" for reason in mount.driver.preflight()]
    except DEVICE_ERRORS as error:
        return [f"{mount.name}: {error}"]


def close_devices(cycle: Cycle) -> Sequence[str]:
    """Close devices and links of ``cycle``; return what went wrong, a sentence each."""
    problems = []
    closing = [(mount.name, mount.driver.close) for mount in cycle.rig.mounts]
    closing += [(name, link.close) for name, link in cycle.rig.links.items()]
    for name, close in closing:
        try:
            close()
        except Exception as error:  # noqa: BLE001 - boundary: told, and the others go on
            problems.append(f"{name} could not be closed: {error}")
    return problems

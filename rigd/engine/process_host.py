"""Host in processes: runs the cycle in its own process, and supervises it and the recorder.

Whatever dies, the rig ends up safe: a cycle that is gone or silent is ended for good, then the
devices are made safe over a second link; a recorder that is gone is started again and finds its
rows in the rings. All of this happens in :meth:`ProcessHost._look_after`, which every waiting
method calls every few milliseconds.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from functools import partial
from typing import Final, Protocol, TypeVar

from rigd.config.rig import RigConfig
from rigd.engine import messages as m
from rigd.engine.clock import idle, monotonic_ns
from rigd.engine.control import Control
from rigd.engine.cycle import CycleCounters
from rigd.engine.cycle_link import CycleLink
from rigd.engine.interlocks import Trip
from rigd.engine.player import Outcome
from rigd.engine.question import PendingQuestion
from rigd.engine.rescue import Rescue, rescue
from rigd.engine.shared import Phase, RunFolder, Word
from rigd.engine.slow.beside import Beside
from rigd.engine.wiring import in_cycle
from rigd.model.errors import DeviceError, RecordingError
from rigd.model.severity import Severity
from rigd.procedure.program import CycleProgram, Recorded
from rigd.record.events import NO_TRIAL

#: A program too long for a packet, in the run's folder.
PROGRAM: Final = "program.pickle"
#: The daemon looks around this often while something plays.
POLL_MS: Final = 5
#: ``on_drain`` is called this often.
SHOW_NS: Final = 50_000_000
#: A ring this full ends the run: the recorder does not keep up.
FULL: Final = 0.8
#: Opening may take so long: set-up of every device, its watchdog proven.
OPEN_S: Final = 120.0
#: The cycle process answers within this, or is ended.
ANSWER_S: Final = 2.0
#: How long the cycle process may take to close its devices and end.
CLOSE_S: Final = 5.0


T = TypeVar("T")


class Watched(Protocol):
    """A helper that runs beside the cycle: the recorder, the devices that are not in the cycle."""

    def poll(self) -> str | None:
        """Look after it; return why the run must end, or None.

        Raises:
            RecordingError: the recording cannot be kept.
        """
        ...


class ProcessHost:
    """Plays cycle programs on a cycle in a process of its own.

    Args:
        rig: the rig; its cycle process opens the devices.
        record: streams to record, and what of them.
        seed: of the simulation, where the rig has a plant.
        folder: the folder of the run, prepared with its rings and board.
        control: what a person asks for.
        watched: what else must live.
        beside: the devices that run beside the cycle.
        finish: ends the recording once nobody pushes any more; None if nothing is recorded, so that
            a full ring only loses what nobody looked at.
    """

    virtual = False

    def __init__(
        self,
        rig: RigConfig,
        *,
        record: Mapping[str, Recorded],
        seed: int,
        folder: RunFolder,
        control: Control,
        watched: Sequence[Watched] = (),
        beside: Beside | None = None,
        finish: Callable[[], None] | None = None,
    ) -> None:
        self.trial = NO_TRIAL
        self.on_drain: Callable[[], None] = lambda: None
        self.segment = ""
        self.trips: list[Trip] = []
        self._rig, self._folder, self._control = rig, folder.path, control
        self._board = board = folder.board()
        self._watched, self._beside, self._finish = list(watched), beside, finish
        self._rings = folder.row_rings(folder.job)
        self._events = folder.event_ring("daemon")
        self._passed_on: Severity | None = None
        self._lost: Outcome | None = None  #: why nothing is played any more
        self._ahead: CycleProgram | None = None  #: what the cycle plays next by itself
        self._gone = False  #: whether the cycle process was fenced
        self._rescue_problems: Sequence[str] = ()
        self._shown_ns = board[Word.BEAT_DAEMON] = monotonic_ns()
        # Without what the cycle has no use for, and would load the code of.
        job = m.CycleJob(replace(rig, simulation=None, calibration=None), record, seed)
        self._cycle = CycleLink(folder, job, rig.supervision.cycle_silence_s)

    @property
    def t_ns(self) -> int:
        """Unix time now, on the clock of the run, in ns."""
        return self._board[Word.START_NS] + monotonic_ns() - self._board[Word.ORIGIN_NS]

    @property
    def run_s(self) -> float:
        """Time of the run so far, in s."""
        return (monotonic_ns() - self._board[Word.ORIGIN_NS]) * 1e-9

    @property
    def counters(self) -> CycleCounters:
        """What the cycle counts about itself."""
        board = self._board
        return CycleCounters(board[Word.CYCLES], board[Word.MISSED], board[Word.STALE])

    @property
    def overruns(self) -> int:
        """Rows lost because a ring was full."""
        return sum(ring.overruns for ring in self._rings.values())

    def open(self, *, judge: bool = True) -> Sequence[str]:
        """Open the devices beside the cycle, then let the cycle process open its own.

        With ``judge`` False the cycle's own are not asked whether they may be armed.
        """
        reasons: list[str] = []
        if self._beside is not None:
            reasons += self._beside.start()
            if not reasons:
                self._watched.append(self._beside)
            if identities := self._beside.identities:
                self.event("devices", identities)
        opened = self._ask(partial(m.Open, judge=judge), OPEN_S, heed_stop=True)
        return (*reasons, *self._or_lost(opened))

    def identities(self) -> Mapping[str, str]:
        """Return what every device said it is, once all are open."""
        beside = {} if self._beside is None else self._beside.identities
        said: Mapping[str, str] | None = self._ask(m.Identities)
        return {**beside, **(said or {})}

    def unfit(self) -> Sequence[str]:
        """Return why the rig, looked at in rest, is not fit to be armed."""
        return self._or_lost(self._ask(m.Unfit))

    def judge(self) -> Sequence[str]:
        """Return what keeps the open devices from being armed; proves every watchdog."""
        return self._or_lost(self._ask(m.Judge, OPEN_S))

    def standing(self) -> Sequence[str]:
        """Return the names of the interlocks that stand tripped."""
        names: Sequence[str] | None = self._ask(m.Standing)
        return tuple(names or ())

    def loads(self) -> Mapping[str, float | None]:
        """Return which share of its capacity each link carries, 0 to 1; None if it is not known."""
        return self._ask(m.Loads) or {}

    def act(self, device: str, action: str, timeout_s: float) -> str:
        """Do one of a device's actions while the rig stays at rest; return what it said.

        Raises:
            DeviceError: it refused, was not done within ``timeout_s``, or something else ended it.
            LinkError: it cannot be reached.
            ProtocolError: it answered nonsense.
        """
        done: list[str] = []
        if in_cycle(self._rig.devices[device]):
            outcome = self._act_in_cycle(m.Act(self._next(), device, action), timeout_s, done)
        elif (beside := self._beside) is not None:
            outcome = self.ask(lambda: done.append(beside.act(device, action)))
        else:
            raise TypeError(f"{device} does not run beside the cycle")
        if done and outcome is None:
            return done[0]
        why = f" within {timeout_s:g} s" if outcome is None else f": {outcome.reason}"
        raise DeviceError(f"{device} did not {action}{why}")

    def _act_in_cycle(self, question: m.Act, timeout_s: float, done: list[str]) -> Outcome | None:
        self._send(question)
        until_ns = monotonic_ns() + round(timeout_s * 1e9)
        outcome = self.rest_while(
            lambda: not self._cycle.answered(question) and monotonic_ns() < until_ns
        )
        if self._cycle.answered(question):
            acted = self._cycle.answer(question)
            if acted.error is not None:
                raise acted.error
            done.append(acted.said)
            return None
        return outcome

    def ends_everything(self) -> str:
        """Return why nothing may move any more, or ""."""
        if self._lost is not None:
            return self._lost.reason
        barred = self._ask(m.Barred)
        return "; ".join(self._or_lost(None)) if barred is None else barred

    def change(self, quantity: str, value: float | str) -> None:
        """Change the plant of a rig simulated in the cycle process.

        Raises:
            ValueError: the plant has no such ``quantity``, or cannot take ``value``.
        """
        change = partial(m.Change, quantity=quantity, value=value)
        problems = self._or_lost(self._ask(change))
        if problems:
            raise ValueError("; ".join(problems))

    def arm(self) -> Outcome | None:
        """Enable every device, at rest."""
        outcome = self._until(m.Arm(self._next(), self._cycle.heard))
        return None if outcome is None or outcome.severity is Severity.DONE else outcome

    def play(self, program: CycleProgram, then: CycleProgram | None = None) -> Outcome:
        """Play ``program`` to its end and return how it ended; ``then`` follows without a gap."""
        serial, heard = self._next(), self._cycle.heard
        ahead, self._ahead = self._ahead, then
        if program is ahead:
            command = m.Play(serial, heard, self.trial)
        elif len(whole := pickle.dumps((program, then))) < m.MAX_PACKET:
            command = m.Play(serial, heard, self.trial, program, then)
        else:
            (self._folder / PROGRAM).write_bytes(whole)  # the one before has been played
            command = m.Play(serial, heard, self.trial, file=PROGRAM)
        outcome = self._until(command)
        if outcome is None:
            raise RuntimeError("a program ended without an outcome")
        if outcome.severity is not Severity.DONE:
            self._ahead = None  # it was not begun
        return outcome

    def settle(self, count: int) -> Outcome | None:
        """Run ``count`` cycles at rest, and more until every device has given a row."""
        board = self._board
        enough = board[Word.CYCLES] + count
        return self.rest_while(lambda: board[Word.CYCLES] < enough or board[Word.MUTE] > 0)

    def come_to_rest(self) -> Outcome | None:
        """Let the setpoints go to rest, each within its rate, and return once they are there."""
        board = self._board
        cycles = board[Word.CYCLES] + 2  # after which AT_REST speaks of the rest asked for
        return self.rest_while(lambda: board[Word.CYCLES] < cycles or not board[Word.AT_REST])

    def rest_while(self, condition: Callable[[], bool]) -> Outcome | None:
        """Keep the rig at rest as long as ``condition`` holds."""
        self._ahead = None
        rest = m.Rest(self._next(), self._cycle.heard, self.trial)
        return self._until(rest, lambda: not condition())

    def ask(self, question: Callable[[], None]) -> Outcome | None:
        """Run ``question`` in a thread; the cycle goes on at rest until it returns."""
        # Rest first: what the person is asked to touch must stand still.
        outcome = self.come_to_rest()
        if outcome is not None:
            return outcome
        asked = PendingQuestion(question)
        outcome = self.rest_while(lambda: not asked.answered)
        if outcome is None:
            asked.raise_error()
        return outcome

    def meanwhile(self, call: Callable[[], T]) -> T:
        """Return what ``call`` returns, which may take seconds: the cycle hears of us meanwhile."""
        with ThreadPoolExecutor(1, "meanwhile") as pool:
            future = pool.submit(call)
            while not future.done():
                self._board[Word.BEAT_DAEMON] = monotonic_ns()
                wait((future,), timeout=POLL_MS * 1e-3)
        return future.result()

    def drain(self) -> None:
        """Do nothing: the recorder drains the rings by itself."""

    def event(self, kind: str, data: Mapping[str, object]) -> None:
        """Record one event, stamped now."""
        self._events.push(self.t_ns, kind, self.trial, data)

    def make_safe(self) -> Sequence[str]:
        """Bring every device to its safe state; return what went wrong, a sentence each."""
        if self._gone:
            return self._rescue_problems
        return self._or_lost(self._ask(m.MakeSafe, recording=False))

    def close(self) -> None:
        """Close every device, end the cycle process, then finish the recording."""
        try:
            if not self._gone:
                problems = self._or_lost(self._ask(m.Close, CLOSE_S, recording=False))
                for problem in problems:
                    self.event("fault", {"reason": problem})
            if not self._gone and not self._cycle.wait(CLOSE_S):
                self._lose(f"the cycle process did not end within {CLOSE_S:g} s")
        finally:
            self._cycle.close()
            if self._beside is not None:
                self._beside.stop()
            self._board[Word.PHASE] = Phase.ENDED
            if self._finish is not None:
                self._finish()

    def discard(self) -> None:
        """End the cycle process before it has opened anything."""
        self._cycle.fence()
        self._cycle.close()

    def _next(self) -> int:
        return self._cycle.next()

    def _ask(
        self,
        question_of: Callable[[int], m.Question[T]],
        timeout_s: float = ANSWER_S,
        *,
        recording: bool = True,
        heed_stop: bool = False,
    ) -> T | None:
        """Ask the cycle process the question of a new serial; return its answer.

        None if it is lost, as it is if it gives no answer in time. With ``heed_stop`` a request to
        stop ends the process: it cannot heed one while it opens devices, and nothing moves yet.
        """
        question = question_of(self._next())
        self._send(question)
        until_ns = monotonic_ns() + round(timeout_s * 1e9)
        while not self._cycle.answered(question):
            if self._gone:
                return None
            if heed_stop and self._control.asked is not None:
                self._lose(f"{self._control.reason}, while devices were being opened")
            elif monotonic_ns() > until_ns:
                what = type(question).__name__
                self._lose(f"the cycle process gave no answer to {what} within {timeout_s:g} s")
            else:
                self._look_after(recording=recording)
        return self._cycle.answer(question)

    def _or_lost(self, sentences: Sequence[str] | None) -> Sequence[str]:
        """Return the cycle's answer, or why there is none."""
        if sentences is not None:
            return tuple(sentences)
        return () if self._lost is None else (self._lost.reason,)

    def _until(
        self, command: m.Command, enough: Callable[[], bool] = lambda: False
    ) -> Outcome | None:
        """Send ``command``; return how it ended, or None once ``enough``."""
        self._send(command)
        while True:
            outcome = self._cycle.ending(command.serial) or self._lost
            if outcome is not None:
                return outcome
            if enough():
                return None
            self._look_after()

    def _send(self, command: m.Command) -> None:
        try:
            self._cycle.send(command)
        except OSError as error:
            if not self._gone:
                self._look_after(recording=False)  # finds out what became of the process
            self._lose(f"the cycle process takes no commands: {error.strerror}")

    def _look_after(self, *, recording: bool = True) -> None:
        """Wait a little; take messages, pass on requests, see that everybody is alive.

        Raises:
            RecordingError: the recording cannot be kept.
        """
        if self._gone:
            idle(POLL_MS * 1e-3)
        else:
            self._cycle.hear(POLL_MS)
            self._take_news()
        now = monotonic_ns()
        self._board[Word.BEAT_DAEMON] = now
        asked = self._control.asked
        if asked is not None and asked != self._passed_on:
            self._passed_on = asked
            self._send(m.Request(0, asked, self._control.reason))
        while self._control.acknowledged:
            self._send(m.Acknowledge(0, self._control.acknowledged.popleft()))
        if not self._gone and (death := self._cycle.death()) is not None:
            self._lose(death)
        if recording:
            for item in self._watched:
                reason = item.poll()
                if reason is not None and self._lost is None:
                    self._end_by(reason)
            if self._finish is not None:
                self._check_rings()
        if now - self._shown_ns > SHOW_NS:
            self._shown_ns = now
            self.on_drain()

    def _take_news(self) -> None:
        while self._cycle.news:
            match self._cycle.news.popleft():
                case m.Entered(name):
                    self.segment = name
                case m.Tripped(trip):
                    self.trips.append(trip)
                case m.Notice(line):
                    self._control.notices.append(line)

    def _lose(self, reason: str) -> None:
        """Fence, then make the rig safe over a second link; once."""
        if self._gone:
            return
        self._gone = True
        self._cycle.fence()
        # A link that this run has not opened may be another's, whose drives are not ours to stop.
        found = rescue(self._rig) if self._board[Word.OURS] else Rescue()
        self._rescue_problems = tuple(found.problems)
        whole = "; ".join([reason, *found.done, *found.problems])
        self._lost = Outcome(Severity.FAULT, whole)
        self.event("fault", {"reason": whole})

    def _end_by(self, reason: str) -> None:
        """Make the rig safe for a reason that the cycle does not know."""
        self.event("fault", {"reason": reason})
        problems = self._or_lost(self._ask(m.MakeSafe, recording=False))
        self._lost = Outcome(Severity.FAULT, "; ".join([reason, *problems]))

    def _check_rings(self) -> None:
        for name, ring in self._rings.items():
            if ring.fill > FULL:
                raise RecordingError(
                    f"the recorder does not keep up: {FULL:.0%} of the ring of {name} wait to be "
                    "written",
                    hint="nothing was lost; is the disk slow or stuck?",
                )

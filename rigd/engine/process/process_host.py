"""Runs the control cycle in a process of its own, and supervises that process and the recorder.

The rig ends safe if any of its processes dies. If the cycle process is gone or silent, the host
kills it and then makes the devices safe over a second link. If the recorder is gone, the host
starts it again, and the recorder finds its rows in the rings. :meth:`ProcessHost._poll` does all of
this; every method that waits calls it every few milliseconds.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from functools import partial
from typing import Final, Protocol, TypeVar

from rigd.computed.derived.driver import DerivedConfig
from rigd.config.rig import RigConfig
from rigd.engine.clock import idle, monotonic_ns
from rigd.engine.cycle.cycle import CycleCounters
from rigd.engine.cycle.wiring import in_cycle
from rigd.engine.play.control import Control
from rigd.engine.play.interlocks import Trip
from rigd.engine.play.player import Outcome
from rigd.engine.process import messages as m
from rigd.engine.process.cycle_link import CycleLink
from rigd.engine.process.question import PendingQuestion
from rigd.engine.process.rescue import Rescue, rescue
from rigd.engine.shared import Phase, RunFolder, Word
from rigd.engine.slow.off_cycle_devices import OffCycleDevices
from rigd.model.errors import DeviceError, RecordingError
from rigd.model.severity import Severity
from rigd.procedure.program import CycleProgram, Recorded
from rigd.record.events.event import NO_TRIAL
from rigd.sdk import peers

#: A program that is too long for a packet, in the run's folder.
PROGRAM: Final = "program.pickle"
#: Interval at which the daemon polls while a program plays.
POLL_MS: Final = 5
#: Interval of calls of ``on_drain``.
SHOW_NS: Final = 50_000_000
#: A ring with this fill ends the run: the recorder is too slow.
FULL: Final = 0.8
#: Longest time for opening: set-up of every device, and the test of its watchdog.
OPEN_S: Final = 120.0
#: The cycle process answers within this time, or is killed.
ANSWER_S: Final = 2.0
#: Longest time for the cycle process to close its devices and end.
CLOSE_S: Final = 5.0


T = TypeVar("T")


class Watched(Protocol):
    """Defines a helper that runs beside the cycle: the recorder, or the off-cycle devices."""

    def poll(self) -> str | None:
        """Check it; return why the run must end, or None.

        Raises:
            RecordingError: the recording cannot be continued.
        """
        ...


class ProcessHost:
    """Plays cycle programs on a cycle in a process of its own.

    Args:
        rig: the rig; its cycle process opens the devices.
        record: the streams to record, and which of their rows.
        seed: of the simulation, if the rig has a plant.
        folder: the folder of the run, prepared with its rings and board.
        control: the requests of people.
        watched: other processes that must run.
        off_cycle: the devices outside the cycle.
        finish: completes the recording after the last row; None without a recording: then a full
            ring only loses rows.
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
        off_cycle: OffCycleDevices | None = None,
        finish: Callable[[], None] | None = None,
    ) -> None:
        self._trial = NO_TRIAL
        self.muted = False  # what devices did cannot be played again
        self.on_drain: Callable[[], None] = lambda: None
        self.segment = ""
        self.trips: list[Trip] = []
        self._rig, self._folder, self._control = rig, folder.path, control
        configs = (device.config for device in rig.devices.values())
        self._follows_trials = any(
            isinstance(config, DerivedConfig) and config.graph.swept for config in configs
        )
        self._board = board = folder.board()
        self._watched, self._off_cycle, self._finish = list(watched), off_cycle, finish
        self._rings = folder.row_rings(folder.job)
        self._events = folder.event_ring("daemon")
        self._passed_on: Severity | None = None
        self._pause = (False, "")  #: the pause that the cycle process knows of
        self._lost: Outcome | None = None  #: why nothing plays any more
        self._reading_on = False  #: rows go on after a run
        self._ahead: CycleProgram | None = None  #: the program that the cycle plays next by itself
        self._end_reason = False  #: whether the cycle process was killed
        self._rescue_problems: Sequence[str] = ()
        self._shown_ns = board[Word.BEAT_DAEMON] = monotonic_ns()
        # Without the parts that the cycle does not need, whose code it would import.
        job = m.CycleJob(replace(rig, simulation=None, calibration=None), record, seed)
        self._cycle = CycleLink(folder, job, rig.supervision.cycle_silence_s)

    @property
    def trial(self) -> int:
        """Trial number of the events; the next program begins a new one in the cycle."""
        return self._trial

    @trial.setter
    def trial(self, number: int) -> None:
        ends = number == NO_TRIAL != self._trial
        self._trial = number
        if ends and self._follows_trials and not self._end_reason:
            self._send(m.EndTrial(0))

    @property
    def t_ns(self) -> int:
        """The present Unix time, on the clock of the run, in ns."""
        return self._board[Word.START_NS] + monotonic_ns() - self._board[Word.ORIGIN_NS]

    @property
    def run_s(self) -> float:
        """Time of the run so far, in s."""
        return (monotonic_ns() - self._board[Word.ORIGIN_NS]) * 1e-9

    @property
    def held(self) -> bool:
        """Whether a pause holds the present step, or the program ended while it did."""
        return bool(self._board[Word.HELD])

    @property
    def counters(self) -> CycleCounters:
        """Counters of the cycle."""
        board = self._board
        return CycleCounters(board[Word.CYCLES], board[Word.MISSED], board[Word.STALE])

    @property
    def overruns(self) -> int:
        """Rows lost because a ring was full."""
        return sum(ring.overruns for ring in self._rings.values())

    def open(self, *, judge: bool = True) -> Sequence[str]:
        """Open the off-cycle devices, then let the cycle process open its own.

        With ``judge`` False the devices in the cycle are not asked whether they may be armed.
        """
        reasons: list[str] = []
        if self._off_cycle is not None:
            reasons += self._off_cycle.start()
            if not reasons:
                self._watched.append(self._off_cycle)
            if judge and not reasons:
                reasons += self._prove_off_cycle()
            if identities := self._off_cycle.identities:
                self.event("devices", identities)
        open_all = partial(m.Open, judge=judge, peers=peers.known())
        opened = self._ask(open_all, OPEN_S, kill_on_stop=True)
        peers.learn(self._ask(m.Peers) or {})
        reasons += self._or_lost(opened)
        if reasons and (simulation := self._rig.simulation) is not None:
            reasons += simulation.missing(self._rig.name)
        return tuple(reasons)

    def identities(self) -> Mapping[str, str]:
        """Return the identity that each device reported, after all are open."""
        off_cycle = {} if self._off_cycle is None else self._off_cycle.identities
        reply: Mapping[str, str] | None = self._ask(m.Identities)
        return {**off_cycle, **(reply or {})}

    def arming_blockers(self) -> Sequence[str]:
        """Return the reasons why the rig, at rest, cannot be armed; one sentence each."""
        return self._or_lost(self._ask(m.ArmingBlockers))

    def judge(self) -> Sequence[str]:
        """Return the reasons why the open devices cannot be armed; tests every watchdog."""
        return (
            *self._prove_off_cycle(),
            *self._or_lost(self._ask(m.Judge, OPEN_S, kill_on_stop=True)),
        )

    def active_interlocks(self) -> Sequence[str]:
        """Return the names of the interlocks that are tripped."""
        names: Sequence[str] | None = self._ask(m.ActiveInterlocks)
        return tuple(names or ())

    def loads(self) -> Mapping[str, float | None]:
        """Return the share of its capacity that each link uses, 0 to 1; None if it is not known."""
        return self._ask(m.Loads) or {}

    def act(self, device: str, action: str, timeout_s: float) -> str:
        """Perform an action of a device while the rig stays at rest; return the device's reply.

        Raises:
            DeviceError: it refused, took longer than ``timeout_s``, or was interrupted.
            LinkError: it cannot be reached.
            ProtocolError: its reply is invalid.
        """
        done: list[str] = []
        if in_cycle(self._rig.devices[device]):
            outcome = self._act_in_cycle(m.Act(self._next(), device, action), timeout_s, done)
        elif (off_cycle := self._off_cycle) is not None:
            outcome = self.ask(lambda: done.append(off_cycle.act(device, action)))
        else:
            raise TypeError(f"{device} is not an off-cycle device")
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
            done.append(acted.reply)
            return None
        return outcome

    def lockout_reason(self) -> str:
        """Return why motion is locked out, or ""."""
        if self._lost is not None:
            return self._lost.reason
        barred = self._ask(m.LockoutReason)
        return "; ".join(self._or_lost(None)) if barred is None else barred

    def change(self, quantity: str, value: float | str) -> None:
        """Change the plant of a rig simulated in the cycle process.

        Raises:
            ValueError: the plant has no such ``quantity``, or refuses ``value``.
        """
        change = partial(m.Change, quantity=quantity, value=value)
        problems = self._or_lost(self._ask(change))
        if problems:
            raise ValueError("; ".join(problems))

    def draw(self, seed: int) -> None:
        """Let the plant of a rig simulated in the cycle process draw from the seed of a trial."""
        self._send(m.Draw(0, seed))

    def arm(self) -> Outcome | None:
        """Enable every device, at rest."""
        outcome = self._until(m.Arm(self._next(), self._cycle.last_received))
        return None if outcome is None or outcome.severity is Severity.DONE else outcome

    def play(self, program: CycleProgram, then: CycleProgram | None = None) -> Outcome:
        """Play ``program`` to its end and return how it ended; ``then`` follows without a gap."""
        serial, last_received = self._next(), self._cycle.last_received
        ahead, self._ahead = self._ahead, then
        if program is ahead:
            command = m.Play(serial, last_received, self.trial)
        elif len(whole := pickle.dumps((program, then))) < m.MAX_PACKET:
            command = m.Play(serial, last_received, self.trial, program, then)
        else:
            (self._folder / PROGRAM).write_bytes(whole)  # the program before it has been played
            command = m.Play(serial, last_received, self.trial, file=PROGRAM)
        outcome = self._until(command)
        if outcome is None:
            raise RuntimeError("a program ended without an outcome")
        if outcome.severity is not Severity.DONE:
            self._ahead = None  # it did not begin
        return outcome

    def settle(self, count: int) -> Outcome | None:
        """Run ``count`` cycles at rest, and more until every device has returned a row."""
        board = self._board
        enough = board[Word.CYCLES] + count
        return self.rest_while(
            lambda: board[Word.CYCLES] < enough or board[Word.SILENT_DEVICES] > 0
        )

    def come_to_rest(self) -> Outcome | None:
        """Take the setpoints to rest, each within its rate, and return when they are there."""
        board = self._board
        cycles = board[Word.CYCLES] + 2  # from now on AT_REST refers to this request
        return self.rest_while(lambda: board[Word.CYCLES] < cycles or not board[Word.AT_REST])

    def rest_while(self, condition: Callable[[], bool]) -> Outcome | None:
        """Keep the rig at rest while ``condition`` holds."""
        self._ahead = None
        rest = m.Rest(self._next(), self._cycle.last_received, self.trial)
        return self._until(rest, lambda: not condition())

    def ask(self, question: Callable[[], None]) -> Outcome | None:
        """Run ``question`` in a thread; the cycle continues at rest until it returns."""
        # Rest first: a part that the person must touch must not move.
        outcome = self.come_to_rest()
        if outcome is not None:
            return outcome
        asked = PendingQuestion(question)
        outcome = self.rest_while(lambda: not asked.answered)
        if outcome is None:
            asked.raise_error()
        return outcome

    def meanwhile(self, call: Callable[[], T]) -> T:
        """Return the result of ``call``, which may take seconds; keep giving signs of life."""
        with ThreadPoolExecutor(1, "meanwhile") as pool:
            future = pool.submit(call)
            while not future.done():
                self._board[Word.BEAT_DAEMON] = monotonic_ns()
                wait((future,), timeout=POLL_MS * 1e-3)
        return future.result()

    def flush(self) -> None:
        """Do nothing: the recorder writes by itself, every second."""

    def drain(self) -> None:
        """Do nothing: the recorder drains the rings by itself."""

    def event(self, kind: str, data: Mapping[str, object]) -> None:
        """Record an event with the present time."""
        self._events.push(self.t_ns, kind, self.trial, data)

    def make_safe(self) -> Sequence[str]:
        """Bring every device to its safe state; return the errors, one sentence each."""
        in_cycle = self._rescue_problems
        if not self._end_reason:
            in_cycle = self._or_lost(self._ask(m.MakeSafe, recording=False))
        return (*in_cycle, *self._make_off_cycle_safe())

    def read_on(self, for_s: float, *, asking: bool) -> Mapping[str, float]:
        """Record for so long what devices show after they were made safe; see :class:`Host`.

        A request to stop that is more severe than the one before ends it, and so does the loss of
        a process.
        """
        asked = self._control.asked
        until_ns = monotonic_ns() + round(for_s * 1e9)
        asked_on = partial(m.ReadOn, asking=asking)
        self._reading_on = not self._nothing_plays and self._ask(asked_on) is True
        while self._reading_on and monotonic_ns() < until_ns and self._control.asked is asked:
            self._poll()
            if self._nothing_plays:
                break
        moving = None if self._nothing_plays else self._ask(m.Moving)
        if moving is None:
            return {item.name: math.nan for item in self._rig.supervision.at_rest}
        return moving

    @property
    def _nothing_plays(self) -> bool:
        return self._lost is not None

    def _make_off_cycle_safe(self) -> Sequence[str]:
        """Make the slow devices that take setpoints safe: the cycle cannot wait for them."""
        if self._off_cycle is None or not self._off_cycle.acting:
            return ()
        problems = self.meanwhile(self._off_cycle.make_safe)
        for problem in problems:
            self.event("fault", {"reason": problem})
        return problems

    def _prove_off_cycle(self) -> Sequence[str]:
        if self._off_cycle is None:
            return ()
        found, reasons = self._off_cycle.prove_watchdogs()
        for name, took_s in found.items():
            bound_s = self._rig.devices[name].declaration.watchdog_s
            self.event("watchdog", {"device": name, "safe_after_s": took_s, "bound_s": bound_s})
        return reasons

    def close(self) -> None:
        """Close every device, end the cycle process, then complete the recording."""
        try:
            if not self._end_reason:
                problems = self._or_lost(self._ask(m.Close, CLOSE_S, recording=False))
                for problem in problems:
                    self.event("fault", {"reason": problem})
            if not self._end_reason and not self._cycle.wait(CLOSE_S):
                self._declare_cycle_dead(f"the cycle process did not end within {CLOSE_S:g} s")
        finally:
            self._cycle.close()
            if self._off_cycle is not None:
                self._off_cycle.stop()
            self._board[Word.PHASE] = Phase.ENDED
            if self._finish is not None:
                self._finish()

    def discard(self) -> None:
        """End the cycle process before it has opened any device."""
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
        kill_on_stop: bool = False,
    ) -> T | None:
        """Send a question with a new serial to the cycle process; return its answer.

        None if the process is lost, or gives no answer in time. With ``kill_on_stop`` a request to
        stop kills the process: it cannot handle a request while it opens devices, and nothing moves
        yet.
        """
        question = question_of(self._next())
        self._board[Word.BEAT_DAEMON] = monotonic_ns()  # the cycle judges it as soon as it is asked
        self._send(question)
        until_ns = monotonic_ns() + round(timeout_s * 1e9)
        while not self._cycle.answered(question):
            if self._end_reason:
                return None
            if kill_on_stop and self._control.asked is not None:
                self._declare_cycle_dead(f"{self._control.reason}, while devices were opened")
            elif monotonic_ns() > until_ns:
                question_type = type(question).__name__
                self._declare_cycle_dead(
                    f"the cycle process gave no answer to {question_type} within {timeout_s:g} s"
                )
            else:
                self._poll(recording=recording)
        return self._cycle.answer(question)

    def _or_lost(self, sentences: Sequence[str] | None) -> Sequence[str]:
        """Return the cycle's answer, or the reason why there is none."""
        if sentences is not None:
            return tuple(sentences)
        return () if self._lost is None else (self._lost.reason,)

    def _until(
        self, command: m.Command, enough: Callable[[], bool] = lambda: False
    ) -> Outcome | None:
        """Send ``command``; return how it ended, or None when ``enough`` is true."""
        self._send(command)
        while True:
            outcome = self._cycle.ending(command.serial) or self._lost
            if outcome is not None:
                return outcome
            if enough():
                return None
            self._poll()

    def _send(self, command: m.Command) -> None:
        try:
            self._cycle.send(command)
        except OSError as error:
            if not self._end_reason:
                self._poll(recording=False)  # finds out whether the process has ended
            self._declare_cycle_dead(f"the cycle process accepts no commands: {error.strerror}")

    def _poll(self, *, recording: bool = True) -> None:
        """Wait briefly; handle messages, pass on requests, check that every process runs.

        Raises:
            RecordingError: the recording cannot be continued.
        """
        if self._end_reason:
            idle(POLL_MS * 1e-3)
        else:
            self._cycle.receive(POLL_MS)
            self._handle_notifications()
        now = monotonic_ns()
        self._board[Word.BEAT_DAEMON] = now
        asked = self._control.asked
        if asked is not None and asked != self._passed_on:
            self._passed_on = asked
            self._send(m.Request(0, asked, self._control.reason))
        pause = (self._control.pause_wanted, self._control.last_trial)
        if pause != self._pause:
            self._pause = pause
            self._send(m.Pause(0, *pause))
        while self._control.acknowledged:
            self._send(m.Acknowledge(0, self._control.acknowledged.popleft()))
        if not self._end_reason and (death := self._cycle.death()) is not None:
            self._declare_cycle_dead(death)
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

    def _handle_notifications(self) -> None:
        while self._cycle.notifications:
            match self._cycle.notifications.popleft():
                case m.Entered(name):
                    self.segment = name
                case m.Tripped(trip):
                    self.trips.append(trip)
                case m.Notice(line):
                    self._control.notices.append(line)
                case m.ReadOnEnded():
                    self._reading_on = False

    def _declare_cycle_dead(self, reason: str) -> None:
        """Kill the cycle process, then make the rig safe over a second link. Idempotent."""
        if self._end_reason:
            return
        self._end_reason = True
        self._cycle.fence()
        # A link that this run has not opened may belong to another program, whose drives must not
        # stop.
        beside = () if self._off_cycle is None else self._off_cycle.acting
        in_cycle = [name for name in self._rig.devices if name not in beside]
        found = rescue(self._rig, in_cycle) if self._board[Word.OURS] else Rescue()
        found.problems += self._make_off_cycle_safe()
        self._rescue_problems = tuple(found.problems)
        whole = "; ".join([reason, *found.done, *found.problems])
        self._lost = Outcome(Severity.FAULT, whole)
        self.event("fault", {"reason": whole})

    def _end_by(self, reason: str) -> None:
        """Make the rig safe for a reason outside the cycle."""
        self.event("fault", {"reason": reason})
        problems = self._or_lost(self._ask(m.MakeSafe, recording=False))
        self._lost = Outcome(Severity.FAULT, "; ".join([reason, *problems]))

    def _check_rings(self) -> None:
        for name, ring in self._rings.items():
            if ring.fill > FULL:
                raise RecordingError(
                    f"the recorder is too slow: {FULL:.0%} of the ring of {name} wait to be "
                    "written",
                    hint="no rows are lost; check whether the disk is slow or blocked",
                )

"""Runs the control cycle of one rig in real time, in a process of its own.

The daemon starts ``python -m rigd.engine.process.cycle_process FOLDER FD`` and sends commands over
a socket. The cycle process never waits on that socket. It writes signs of life to the board (status
words in shared memory). When the daemon ends or is silent too long, the cycle process takes the
setpoints to rest, makes every device safe, and ends.
"""

from __future__ import annotations

import os
import pickle
import signal
import socket
import sys
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any, Final, TypeVar

from rigd.engine.clock import RealClock
from rigd.engine.cycle.cycle import DEVICE_ERRORS, Cycle
from rigd.engine.cycle.stand_in import StandIn
from rigd.engine.cycle.wiring import in_cycle, wire
from rigd.engine.play.control import Control
from rigd.engine.play.holding import HoldPhase
from rigd.engine.play.player import Outcome
from rigd.engine.process import messages as m
from rigd.engine.process.in_process import ARM_NS, close_devices, judge_devices, open_devices
from rigd.engine.process.rescue import rescue
from rigd.engine.shared import CycleState, RunFolder, Word
from rigd.engine.slow.orders import acting_devices
from rigd.engine.slow.stand_ins import StandIns
from rigd.engine.system.leaving import LEAVE, Leaving, WaitLeft
from rigd.engine.system.realtime import RealTime
from rigd.model.machine.other_process import OtherProcess
from rigd.model.machine.system import readable
from rigd.model.severity import Severity
from rigd.record.events.event import NO_TRIAL
from rigd.sdk import Driver, peers

T = TypeVar("T")

#: Longest time for setpoints to reach rest after the daemon has ended; then all devices are made
#: safe at once.
LEAVE_NS: Final = 1_000_000_000
#: Longest time to make the slow devices safe that the daemon ran, after it has ended.
BESIDE_S: Final = 5.0
#: Without a program, the process wakes at this interval to give its sign of life.
IDLE_S: Final = 0.01
#: The longest wait until the kernel has closed the connections of a daemon that was killed.
CLEARED_S: Final = 2.0
#: How often a cycle looks whether the daemon has been killed.
LOOK_NS: Final = 5_000_000


class CycleProcess:
    """Runs the cycle of one rig by the commands of the daemon at the other end of ``link``."""

    def __init__(self, folder: Path, link: socket.socket) -> None:
        self._folder = folder
        self._link = link
        link.setblocking(False)
        self._job: m.CycleJob = pickle.loads((folder / m.JOB).read_bytes())
        run = RunFolder.at(folder)
        self._board = board = run.board()
        self._events = run.event_ring("cycle")
        self._control = Control()
        rig = self._job.rig
        clock = RealClock(rig.period_ns, board[Word.START_NS], board[Word.ORIGIN_NS])
        stand_ins = StandIns(rig, folder)
        wiring = wire(rig, clock, self._control, self._job.seed, stand_ins.of)
        self._cycle: Cycle = wiring.cycle
        self._cycle.on_make_safe = self._begin_making_safe
        self._plant = wiring.plant
        # A ring has only one writer: off-cycle devices have their own.
        elsewhere = {device.name for device in rig.devices.values() if not in_cycle(device)}
        rings = {
            name: ring for name, ring in run.row_rings(run.job).items() if name not in elsewhere
        }
        windows = stand_ins.windows
        self._cycle.connect(rings, self._job.record, self._emit, blocks=rings, windows=windows)
        self._trial = NO_TRIAL
        self._serial = 0  #: of the command in progress, 0 if there is none
        self._endings: list[tuple[int, Outcome]] = []  #: by serial; the daemon may not know them
        self._final: Outcome | None = None  #: every device is safe; nothing moves any more
        self._in_cycle = [mount for mount in self._cycle.rig.mounts if mount.name not in elsewhere]
        self._acting: tuple[m.Act, Driver] | None = None  #: the action, and its device
        self._arming_since: int | None = None
        self._ticking = False
        self._reading_on = False  #: the run has ended, every device is safe
        self._real_time = RealTime()
        self._daemon = OtherProcess(os.getppid())
        self._looked_ns = 0
        self._leaving = Leaving(self._daemon_gone)
        self._silence_ns = round(rig.supervision.daemon_silence_s * 1e9)
        self._reported_steps = ""
        self._reported_trips = 0
        self._unsent: deque[bytes] = deque()
        self.over = False

    def run(self) -> None:
        """Serve until the daemon closes the run, or ends."""
        try:
            while not self.over:
                if self._ticking:
                    self._tick()
                elif self._reading_on:
                    self._reading_on = self._cycle.read_on()
                    if not self._reading_on:
                        self._send(m.ReadOnEnded())
                else:
                    readable(self._link, IDLE_S)
                self._board[Word.BEAT_CYCLE] = time.monotonic_ns()
                if not self.over:
                    self._receive()
                self._send_unsent()
        except BaseException:
            self._cycle.make_safe()
            raise
        finally:
            self._real_time.leave()

    def _tick(self) -> None:
        cycle, board = self._cycle, self._board
        outcome = cycle.step()
        counters = cycle.counters
        board[Word.CYCLES] = counters.cycles
        board[Word.MISSED] = counters.missed
        board[Word.STALE] = counters.stale
        board[Word.SILENT_DEVICES] = cycle.silent_devices
        board[Word.AT_REST] = cycle.limiter.at_rest()
        board[Word.HELD] = cycle.phase is HoldPhase.HELD
        if self._arming_since is not None and outcome is None:
            outcome = self._arming()
        if self._acting is not None:
            self._look_at_action(*self._acting)
        if cycle.segment != self._reported_steps:
            self._reported_steps = cycle.segment
            self._send(m.Entered(cycle.segment))
        if len(cycle.trips) > self._reported_trips:
            self._send(m.Tripped(cycle.trips[self._reported_trips]))
            self._reported_trips += 1
        if outcome is not None:
            self._end(outcome)
        now_ns = time.monotonic_ns()
        if now_ns - self._looked_ns > LOOK_NS:
            self._looked_ns = now_ns
            if gone := self._daemon_gone():
                self._abandon(gone)

    def _daemon_gone(self) -> str:
        """Return why nobody supervises this process any more, or ""."""
        if self._daemon.ending():
            return "the daemon has ended"
        if time.monotonic_ns() - self._board[Word.BEAT_DAEMON] > self._silence_ns:
            return f"the daemon was silent for {self._silence_ns * 1e-9:g} s"
        return ""

    def _arming(self) -> Outcome | None:
        """Return DONE when every device is enabled, or the failure if some were not in time."""
        waiting = self._cycle.not_enabled()
        if not waiting:
            self._arming_since = None
            return Outcome(Severity.DONE)
        if self._arming_since is not None and self._cycle.t_ns - self._arming_since > ARM_NS:
            return self._cycle.give_up(waiting)
        return None

    def _end(self, outcome: Outcome) -> None:
        """Report the outcome of a command; a missed outcome answers the next command."""
        if outcome.severity >= Severity.ESTOP:
            self._stop_exchanging()
            self._final = outcome
        self._arming_since = None
        self._endings.append((self._serial, outcome))
        if self._serial:
            self._send(m.Ended(self._serial, outcome))
            self._serial = 0

    def _receive(self) -> None:
        """Receive a command, if there is one; the end of the daemon is an empty packet."""
        try:
            packet = self._link.recv(m.MAX_PACKET + 1000)
        except BlockingIOError:
            return
        except OSError:
            packet = b""
        if not packet:
            self._abandon("the daemon has ended")
            return
        self._do(pickle.loads(packet))

    def _do(self, command: m.Command) -> None:
        match command:
            case m.Play(serial, last_received, trial, program, then, file):
                if file:
                    program, then = pickle.loads((self._folder / file).read_bytes())
                self._begin_trial(trial)
                if program is not None:
                    self._cycle.load(program, then)
                self._begin(serial, last_received)
            case m.Rest(serial, last_received, trial):
                self._begin_trial(trial)
                self._cycle.load(None)
                self._begin(serial, last_received)
            case m.EndTrial():
                self._cycle.end_trial()
                self._trial = NO_TRIAL
            case m.Request(_, stop, reason):
                self._control.request(stop, reason)
            case m.Pause(_, wanted, last_trial):
                self._control.pause_wanted, self._control.last_trial = wanted, last_trial
            case m.Draw(_, seed):
                if self._plant is not None:
                    self._plant.begin_trial(seed)
            case m.Acknowledge(_, interlock):
                self._cycle.interlocks.acknowledge(interlock)
            case m.Arm(serial, last_received):
                self._cycle.load(None)
                if self._begin(serial, last_received):
                    self._arm()
            case m.Act():
                self._act(command)
            case m.Question():
                self._reply(command)
            case _:
                raise TypeError(f"unknown command: {command!r}")

    def _begin_trial(self, trial: int) -> None:
        if trial not in (self._trial, NO_TRIAL):
            self._cycle.begin_trial(trial)
        self._trial = trial

    def _reply(self, question: m.Question[Any]) -> None:
        """Answer a question that can be answered at once."""
        match question:
            case m.Open(_, judge, known):
                peers.learn(known)
                self._open(question, judge=judge)
            case m.Peers():
                self._answer(question, peers.known())
            case m.Judge():
                with self._supervised():
                    judged = [*judge_devices(self._cycle), *self._prove_watchdogs()]
                    self._answer(question, judged)
            case m.ArmingBlockers():
                self._answer(question, self._cycle.arming_blockers())
            case m.LockoutReason():
                self._answer(question, self._cycle.lockout_reason())
            case m.ActiveInterlocks():
                tripped = self._cycle.interlocks.active()
                self._answer(question, [interlock.name for interlock in tripped])
            case m.Identities():
                self._answer(question, self._identities())
            case m.Loads():
                links = self._cycle.rig.links
                self._answer(question, {name: link.load for name, link in links.items()})
            case m.Change(_, quantity, value):
                self._answer(question, self._change(quantity, value))
            case m.MakeSafe():
                self._final = Outcome(Severity.FAULT, "the rig was made safe")
                self._answer(question, self._make_safe())
            case m.ReadOn(_, asking):
                final = self._final is not None
                self._reading_on = final and self._cycle.reads_on(asking=asking)
                self._answer(question, self._reading_on)
            case m.Moving():
                self._answer(question, self._cycle.resting.moving)
            case m.Close():
                self._answer(question, [*self._make_safe(), *close_devices(self._cycle)])
                self.over = True
            case _:
                raise TypeError(f"unknown question: {question!r}")

    @contextmanager
    def _supervised(self) -> Iterator[None]:
        """Do what takes longer than a cycle; end if the daemon ends, or a signal comes."""
        try:
            with self._leaving.guarded():
                yield
        except WaitLeft:
            self._abandon(self._daemon_gone() or self._control.reason)

    def _begin(self, serial: int, last_received: int) -> bool:
        """Return whether the command begins; else report that the cycle has acted."""
        self._serial = serial
        outcome = self._unheard(last_received) or self._final
        if outcome is not None:
            self._cycle.load(None)
            self._end(outcome)
            return False
        self._ticking = True
        self._board[Word.CYCLE_STATE] = CycleState.TICKING
        return True

    def _unheard(self, last_received: int) -> Outcome | None:
        """Return the most severe outcome after serial ``last_received``; forget all of them."""
        endings, self._endings = self._endings, []
        for place, (serial, _) in enumerate(endings):
            if serial and serial == last_received:
                endings = endings[place + 1 :]
                break
        return max((ending for _, ending in endings), key=lambda item: item.severity, default=None)

    def _arm(self) -> None:
        self._arming_since = self._cycle.t_ns
        refused = self._cycle.arm()
        if refused is not None:
            self._end(refused)

    def _begin_making_safe(self) -> None:
        self._board[Word.BEAT_CYCLE] = time.monotonic_ns()
        self._board[Word.CYCLE_STATE] = CycleState.MAKING_SAFE

    def _make_safe(self) -> Sequence[str]:
        problems = self._cycle.make_safe()
        self._stop_exchanging()
        return problems

    def _stop_exchanging(self) -> None:
        """Stop exchanging with devices: every device is safe."""
        self._ticking = False
        self._board[Word.CYCLE_STATE] = CycleState.WAITING

    def _open(self, question: m.Open, *, judge: bool) -> None:
        with self._supervised():
            closed = list(open_devices(self._cycle, judge=judge, links_open=self._links_open))
            self._record_event("devices", self._identities())
            reasons = self._prove_watchdogs() if judge and not closed else closed
        if self.over:
            return
        if not closed:
            self._enter_real_time()
        self._answer(question, reasons)

    def _enter_real_time(self) -> None:
        self._real_time.enter()
        real_time = self._real_time
        self._record_event("realtime", {"granted": real_time.granted, "lost": real_time.lost})
        for sentence in self._real_time.lost:
            self._send(m.Notice(f"not in real time: {sentence}"))

    def _identities(self) -> Mapping[str, str]:
        return {mount.name: mount.driver.identity for mount in self._in_cycle}

    def _links_open(self) -> None:
        """Note that this run has opened the links: only then a second link may make them safe."""
        self._board[Word.OURS] = 1

    def _prove_watchdogs(self) -> list[str]:
        """Test the watchdog of each actuator once; for a waived device, record the waiver."""
        reasons = []
        for mount in self._cycle.rig.mounts:
            driver, device = mount.driver, self._job.rig.devices[mount.name]
            if not device.is_actuator or self._plant is not None:
                continue
            if driver.watchdog_s is None:
                if device.waiver is None:
                    reasons.append(
                        f"{mount.name} has no watchdog: nothing makes it safe if this "
                        "computer fails. Use one, or give a `waiver` with a name and a "
                        "reason in the rig file"
                    )
                else:
                    waiver = {"by": device.waiver.by, "reason": device.waiver.reason}
                    self._record_event("waiver", {"device": mount.name, **waiver})
                continue
            if isinstance(driver, StandIn):
                continue  # the process that runs it proves it
            self._leaving.check()  # nothing is enabled for a daemon that has ended
            try:
                took_s = driver.prove_watchdog()
            except DEVICE_ERRORS as error:
                reasons.append(f"{mount.name}: its watchdog is not proven: {error}")
                continue
            found = {"device": mount.name, "safe_after_s": took_s, "bound_s": driver.watchdog_s}
            self._record_event("watchdog", found)
        return reasons

    def _act(self, question: m.Act) -> None:
        (driver,) = (mount.driver for mount in self._in_cycle if mount.name == question.device)
        try:
            driver.act(question.action)
        except DEVICE_ERRORS as error:
            self._answer(question, m.Acted("", error))
            return
        self._acting = (question, driver)

    def _look_at_action(self, question: m.Act, driver: Driver) -> None:
        """Answer with the result of the action in progress, when it has ended."""
        try:
            reply = driver.acted()
        except DEVICE_ERRORS as error:
            self._answer(question, m.Acted("", error))
        else:
            if reply is None:
                return
            self._answer(question, m.Acted(reply))
        self._acting = None

    def _change(self, quantity: str, value: float | str) -> Sequence[str]:
        if self._plant is None:
            return [f"there is no plant whose {quantity} could change"]
        try:
            self._plant.change(quantity, value)
        except ValueError as error:
            return [str(error)]
        return []

    def _abandon(self, reason: str) -> None:
        """End without a daemon: setpoints to rest within their rates, then make safe and close."""
        self._control.request(Severity.ABORT, reason)
        self._record_event("fault", {"reason": f"{reason}; the rig is made safe"})
        if self._ticking:
            self._cycle.load(None)
            until = time.monotonic_ns() + LEAVE_NS
            while self._cycle.step() is None and time.monotonic_ns() < until:
                self._board[Word.BEAT_CYCLE] = time.monotonic_ns()
        problems = [*self._make_safe(), *close_devices(self._cycle), *self._rescue_beside()]
        for problem in problems:
            self._record_event("fault", {"reason": problem})
        self.over = True
        with suppress(OSError):  # its log is on a full disk
            sys.stderr.write(f"{reason}; the rig was made safe\n")  # for a daemon that restarts

    def _rescue_beside(self) -> Sequence[str]:
        """Make the slow devices that the daemon ran safe over new links; return the problems."""
        beside = [device.name for device in acting_devices(self._job.rig)]
        if not beside:
            return ()
        self._begin_making_safe()
        self._daemon.ended(CLEARED_S)  # until then it holds their connections
        return rescue(self._job.rig, beside, BESIDE_S).problems

    def handle_signal(self, number: int, frame: FrameType | None) -> None:
        """Abort on a signal for this process only; see :class:`Leaving`."""
        if number != LEAVE:
            name = signal.Signals(number).name
            self._control.request(Severity.ABORT, f"{name} was sent to the cycle process")
        self._leaving.signalled()

    def _emit(self, t_ns: int, kind: str, data: Mapping[str, object]) -> None:
        self._events.push(t_ns, kind, self._trial, data)

    def _record_event(self, kind: str, data: Mapping[str, object]) -> None:
        """Record an event outside of the slots."""
        clock = self._cycle.clock
        self._emit(clock.start_ns + clock.now(), kind, data)

    def _answer(self, question: m.Question[T], value: T) -> None:
        self._send(m.Answer(question.serial, value))

    def _send(self, message: m.Answer[Any] | m.Ended | m.Notification) -> None:
        self._unsent.append(pickle.dumps(message))
        self._send_unsent()

    def _send_unsent(self) -> None:
        """Send the waiting messages as far as the socket accepts them; never wait."""
        while self._unsent:
            try:
                self._link.send(self._unsent[0])
            except BlockingIOError:
                return
            except OSError:
                self._unsent.clear()  # the daemon has ended, which _receive notices
                return
            self._unsent.popleft()


def main(folder: Path, fd: int) -> None:
    """Run the cycle process of the run in ``folder``, with commands over the socket ``fd``."""
    with socket.socket(fileno=fd) as link:
        process = CycleProcess(folder, link)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, LEAVE):
            signal.signal(number, process.handle_signal)
        signal.signal(signal.SIGTSTP, signal.SIG_IGN)
        process.run()


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))

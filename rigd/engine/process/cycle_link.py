"""Starts the cycle process, sends commands to it, supervises it, and kills it if it hangs."""

from __future__ import annotations

import pickle
import select
import socket
from collections import deque
from typing import Final, TypeVar, cast

from rigd.engine.clock import monotonic_ns
from rigd.engine.play.player import Outcome
from rigd.engine.process import messages as m
from rigd.engine.shared import CycleState, RunFolder, Word
from rigd.engine.system.child import Child, module

T = TypeVar("T")

#: Output of the cycle process, kept in the run's folder, in which a person would look.
LOG: Final = "cycle.log"
#: The daemon does not judge the silence of the cycle if the daemon itself was delayed for this
#: time: the cause (a stalled host) affects both.
AWAY_NS: Final = 25_000_000
#: Devices are made safe in sequence, some over dead links: within this time all of them are safe,
#: or the daemon uses a second link.
SAFE_S: Final = 2.0
#: A killed process ends within this time, unless the kernel still holds it.
FENCE_S: Final = 0.5


class CycleLink:
    """Runs a cycle process for ``job`` in ``folder``; keeps replies by their serial number.

    A process that runs but gives no sign of life for ``silence_s`` counts as dead.
    """

    def __init__(self, folder: RunFolder, job: m.CycleJob, silence_s: float) -> None:
        self.last_received = 0  #: serial of the last outcome that :meth:`ending` returned
        self._ended: dict[int, Outcome] = {}
        self._answers: dict[int, object] = {}
        self.notifications: deque[m.Notification] = deque()  #: unsolicited reports
        self._board = folder.board()
        self._silence_ns = {
            CycleState.TICKING: round(silence_s * 1e9),
            CycleState.MAKING_SAFE: round(SAFE_S * 1e9),
        }
        self._checked_ns = monotonic_ns()
        self._serial = 0
        self._closing = 0  #: serial of the command to end
        (folder.path / m.JOB).write_bytes(pickle.dumps(job))
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setblocking(False)
        with theirs:
            fd = theirs.fileno()
            command = module("rigd.engine.process.cycle_process", str(folder.path), str(fd))
            self._child = Child(
                command, log=folder.path / LOG, fds=(fd, folder.lock_fd), preferred=True
            )
        self._board[Word.PID_CYCLE] = self._child.pid
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def next(self) -> int:
        """Return an unused serial."""
        self._serial += 1
        return self._serial

    def send(self, message: m.Command) -> None:
        """Send ``message``; never waits.

        Raises:
            OSError: the process has ended, or accepts no more messages.
        """
        if isinstance(message, m.Close):
            self._closing = message.serial
        self._socket.send(pickle.dumps(message))

    def ending(self, serial: int) -> Outcome | None:
        """Return the outcome of the command ``serial``, once; None while it is in progress."""
        outcome = self._ended.get(serial)
        if outcome is not None:
            self.last_received = serial
            self._ended.clear()  # with this message the cycle has reported everything before it
        return outcome

    def answered(self, question: m.Question[T]) -> bool:
        """Return whether the answer to ``question`` has arrived."""
        return question.serial in self._answers

    def answer(self, question: m.Question[T]) -> T:
        """Return the answer that has arrived, once."""
        return cast("T", self._answers.pop(question.serial))

    def receive(self, wait_ms: int) -> None:
        """Receive messages; wait at most ``wait_ms`` for the first."""
        self._poll.poll(wait_ms)
        while True:
            try:
                packet = self._socket.recv(m.MAX_PACKET)
            except OSError:
                return  # no more messages, or it has ended: death() checks
            if not packet:
                return
            match pickle.loads(packet):
                case m.Ended(serial, outcome):
                    self._ended[serial] = outcome
                case m.Answer(serial, value):
                    self._answers[serial] = value
                case m.Entered() | m.Tripped() | m.Notice() | m.ReadOnEnded() as notifications:
                    self.notifications.append(notifications)
                case message:
                    raise TypeError(f"the cycle process sent an unknown message {message!r}")

    def death(self) -> str | None:
        """Return why the process counts as dead, or None; called every few ms."""
        now = monotonic_ns()
        away_ns, self._checked_ns = now - self._checked_ns, now
        how = self._child.fate(FENCE_S)
        if how:
            self.receive(0)  # its last messages
            if self._closing in self._answers:
                return None  # it ended on request
            words = self._child.last_words()
            return f"the cycle process {how}" + (f": {words}" if words else "")
        bound_ns = self._silence_ns.get(CycleState(self._board[Word.CYCLE_STATE]))
        silent_ns = now - self._board[Word.BEAT_CYCLE]
        if bound_ns is not None and away_ns < AWAY_NS and silent_ns > bound_ns:
            return (
                f"the cycle process gave no sign of life for {silent_ns / 1e6:.0f} ms, at "
                f"most {bound_ns / 1e6:.0f} ms are allowed: a driver waits, or the machine "
                "stalls (`rigd doctor` measures it; `supervision:` in the rig file)"
            )
        return None

    def wait(self, timeout_s: float) -> bool:
        """Wait until the process has ended; return whether it has."""
        return self._child.wait(timeout_s)

    def fence(self) -> None:
        """Kill the process, whatever it does; see :meth:`Child.fence`."""
        self._child.fence(FENCE_S)

    def close(self) -> None:
        """Close the socket; a process that still runs takes this as the end of the daemon."""
        self._socket.close()
        self._child.leave(FENCE_S)

"""Starts the cycle process, sends it commands, supervises it, and kills it if it hangs."""

from __future__ import annotations

import pickle
import select
import socket
from collections import deque
from typing import Final, TypeVar, cast

from rigd.engine import messages as m
from rigd.engine.child import Child, module
from rigd.engine.clock import monotonic_ns
from rigd.engine.player import Outcome
from rigd.engine.shared import CycleState, RunFolder, Word

T = TypeVar("T")

#: What the cycle process writes where a person would look, kept in the run's folder.
LOG: Final = "cycle.log"
#: The cycle is not judged by its silence where the daemon itself was away for so long: whatever
#: stopped the one (a stalled host) stopped the other.
AWAY_NS: Final = 25_000_000
#: Devices are made safe one after the other, some over links that are dead: within this, all of
#: them, or over a second link.
SAFE_S: Final = 2.0
#: A process that was killed is gone within this, unless the kernel still holds it.
FENCE_S: Final = 0.5


class CycleLink:
    """A cycle process for ``job`` in ``folder``; replies are kept by the serial they carry.

    A process that ticks and gives no sign of life for ``silence_s`` is taken for dead.
    """

    def __init__(self, folder: RunFolder, job: m.CycleJob, silence_s: float) -> None:
        self.heard = 0  #: serial of the last outcome that :meth:`ending` gave
        self._ended: dict[int, Outcome] = {}
        self._answers: dict[int, object] = {}
        self.news: deque[m.News] = deque()  #: what was reported without being asked
        self._board = folder.board()
        self._silence_ns = {
            CycleState.TICKING: round(silence_s * 1e9),
            CycleState.MAKING_SAFE: round(SAFE_S * 1e9),
        }
        self._heard_ns = monotonic_ns()
        self._serial = 0
        self._closing = 0  #: serial of the command to end
        (folder.path / m.JOB).write_bytes(pickle.dumps(job))
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setblocking(False)
        with theirs:
            fd = theirs.fileno()
            command = module("rigd.engine.cycle_process", str(folder.path), str(fd))
            self._child = Child(command, log=folder.path / LOG, fds=(fd, folder.lock_fd))
        self._board[Word.PID_CYCLE] = self._child.pid
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def next(self) -> int:
        """Return a serial that no command has had."""
        self._serial += 1
        return self._serial

    def send(self, message: m.Command) -> None:
        """Send ``message``; never waits.

        Raises:
            OSError: the process is gone, or takes nothing more.
        """
        if isinstance(message, m.Close):
            self._closing = message.serial
        self._socket.send(pickle.dumps(message))

    def ending(self, serial: int) -> Outcome | None:
        """Return how what was asked for by ``serial`` ended, once; None while it goes on."""
        outcome = self._ended.get(serial)
        if outcome is not None:
            self.heard = serial
            self._ended.clear()  # whatever else is there, the cycle has told again by this
        return outcome

    def answered(self, question: m.Question[T]) -> bool:
        """Return whether the answer to ``question`` is there."""
        return question.serial in self._answers

    def answer(self, question: m.Question[T]) -> T:
        """Return the answer that is there, once."""
        return cast("T", self._answers.pop(question.serial))

    def hear(self, wait_ms: int) -> None:
        """Take what was said, waiting at most ``wait_ms`` for something."""
        self._poll.poll(wait_ms)
        while True:
            try:
                packet = self._socket.recv(m.MAX_PACKET)
            except OSError:
                return  # nothing more, or nobody there: judged by the process, not by its socket
            if not packet:
                return
            match pickle.loads(packet):
                case m.Ended(serial, outcome):
                    self._ended[serial] = outcome
                case m.Answer(serial, value):
                    self._answers[serial] = value
                case m.Entered() | m.Tripped() | m.Notice() as news:
                    self.news.append(news)
                case message:
                    raise TypeError(f"the cycle process reports nothing like {message!r}")

    def death(self) -> str | None:
        """Return why the process must be taken for dead, or None; asked every few ms."""
        now = monotonic_ns()
        away_ns, self._heard_ns = now - self._heard_ns, now
        how = self._child.ended
        if how:
            self.hear(0)  # what it said last
            if self._closing in self._answers:
                return None  # it ended as it was told
            words = self._child.last_words()
            return f"the cycle process ended by itself ({how})" + (f": {words}" if words else "")
        bound_ns = self._silence_ns.get(CycleState(self._board[Word.CYCLE_STATE]))
        silent_ns = now - self._board[Word.BEAT_CYCLE]
        if bound_ns is not None and away_ns < AWAY_NS and silent_ns > bound_ns:
            return (
                f"the cycle process gave no sign of life for {silent_ns / 1e6:.0f} ms, "
                f"at most {bound_ns / 1e6:.0f} ms are allowed: a driver that waits, or a machine "
                "that stalls (`rigd doctor` measures it; `supervision:` in the rig file)"
            )
        return None

    def wait(self, timeout_s: float) -> bool:
        """Wait until the process has ended; return whether it has."""
        return self._child.wait(timeout_s)

    def fence(self) -> None:
        """End the process for good, whatever it does; see :meth:`Child.fence`."""
        self._child.fence(FENCE_S)

    def close(self) -> None:
        """Close the socket; a process still there takes that for the daemon's death."""
        self._socket.close()
        self._child.wait(FENCE_S)

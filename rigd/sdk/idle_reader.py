"""Reads a connection on which devices send by themselves, while nobody else reads it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final

#: Room for the calls of a reader, in bytes: the cycle locks all memory, so also unused stack.
_STACK_BYTES: Final = 1 << 19
#: A reader ends within this, in s; one that hangs in a library is left behind.
_ENDS_S: Final = 1.0


class IdleReader:
    """Calls ``read`` every ``every_s`` in a thread of its own, unless the cycle turns.

    The kernel keeps a few hundred frames or datagrams of a connection. While other devices are
    opened, proven or made safe nobody takes them in: the queue is full within a second, and what
    is lost then is the answer to the next question. A :class:`~rigd.sdk.Link` to devices that send
    by themselves starts one in its ``open``, pauses it in ``begin``, resumes it in ``idle`` and
    stops it in ``close``. Paused, the thread sleeps and costs the cycle nothing.

    Whoever else uses the connection, other than in a cycle, holds :attr:`lock` meanwhile.
    """

    def __init__(self, read: Callable[[], None], every_s: float) -> None:
        self.lock: Final = threading.RLock()
        self._changed = threading.Condition(self.lock)
        self._read = read
        self._every_s = every_s
        self._thread: threading.Thread | None = None
        self._paused = False
        self._failure: Exception | None = None

    def start(self) -> None:
        """Begin to read."""
        self._paused, self._failure = False, None
        self._thread = threading.Thread(target=self._run, name="reader of a link", daemon=True)
        before = threading.stack_size(_STACK_BYTES)
        try:
            self._thread.start()
        finally:
            threading.stack_size(before)

    def stop(self) -> None:
        """End the thread; stopping twice is silent."""
        thread, self._thread = self._thread, None
        if thread is not None:
            with self.lock:
                self._changed.notify()
            thread.join(_ENDS_S)

    def pause(self) -> None:
        """Leave the reading to the caller from now on; see :meth:`check` for what it raises."""
        if not self._paused:
            with self.lock:
                self._paused = True
        self.check()

    def resume(self) -> None:
        """Read again."""
        with self.lock:
            self._paused = False
            self._changed.notify()

    def check(self) -> None:
        """Raise the error with which ``read`` has failed, if it has; it is not called again."""
        if self._failure is not None:
            raise self._failure

    def _run(self) -> None:
        own = threading.current_thread()
        with self.lock:
            while self._thread is own:
                if self._paused or self._failure is not None:
                    self._changed.wait()
                    continue
                self._changed.wait(self._every_s)
                if self._thread is own and not self._paused:
                    try:
                        self._read()
                    except Exception as error:  # noqa: BLE001 - raised by `check`, where it is seen
                        self._failure = error

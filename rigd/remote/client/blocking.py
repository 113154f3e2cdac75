"""Provides the client of a daemon for scripts and notebooks; each method waits for its reply.

The methods for the verbs (kinds of request) are the same as those of :class:`AsyncClient`, which
does the work. The :class:`AsyncClient` runs on an event loop in a separate thread, so that it does
not use the event loop of a notebook.
"""

from __future__ import annotations

import asyncio
import logging
import sys
import threading
from collections.abc import AsyncGenerator, Callable, Coroutine, Iterator
from contextlib import contextmanager
from functools import wraps
from queue import Empty, SimpleQueue
from typing import Any, Concatenate, Final, Generic, ParamSpec, Self, TypeVar

from rigd.config.remote import TlsFiles
from rigd.model.errors import LinkError, RigdError
from rigd.remote.client.asynchronous import AsyncClient
from rigd.remote.client.verbs import BlockingVerbs, blocking

_log: Final = logging.getLogger(__name__)

P = ParamSpec("P")
T = TypeVar("T")

_END: Final = object()
#: So often a thread that waits looks whether it is interrupted, in s.
_LOOK_S: Final = 0.2


def _iterating(
    method: Callable[Concatenate[AsyncClient, P], AsyncGenerator[T, None]],
) -> Callable[Concatenate[Client, P], Iterator[T]]:
    """Return the method that waits for each item that ``method`` yields."""

    @wraps(method)
    def iterating(self: Client, /, *args: P.args, **kwargs: P.kwargs) -> Iterator[T]:
        async def begin() -> AsyncGenerator[T, None]:
            return method(self.asynchronous, *args, **kwargs)

        return self.iterate(self.run_async(begin()))  # it receives messages from here on

    return iterating


class Client(BlockingVerbs):
    """Controls a rig through its daemon: ``with Client("lugre-1") as rig: ...``, or without `with`.

    The constructor connects it. ``rig`` is looked up in the client's own list, or is on this
    machine; ``endpoint`` (``tls/rig.lab:7447``), ``tls`` and ``identity`` take precedence.

    Every verb raises :class:`~rigd.model.errors.LinkError` if no daemon answers, and
    :class:`~rigd.remote.protocol.Refusal`, with a ``code``, if the daemon refuses; then nothing has
    changed. Commands need the control lease, see :meth:`control`; a stop does not need it. Any
    thread may call.

    Raises:
        LinkError: no daemon admits this client there, or there is no such rig.
        ConfigError: the list or an argument is wrong, or there are several rigs and none is named.
        Refusal: a name is not allowed in a key.
    """

    asynchronous: AsyncClient
    """The client that does the work, on the event loop of this client's thread."""

    def __init__(
        self,
        rig: str | None = None,
        *,
        endpoint: str | None = None,
        tls: TlsFiles | None = None,
        identity: str | None = None,
    ) -> None:
        self.asynchronous = AsyncClient(rig, endpoint=endpoint, tls=tls, identity=identity)
        self._loop = asyncio.new_event_loop()
        self._ends = False
        # A daemon thread: a notebook can end although the client was not closed.
        self._thread = threading.Thread(target=self._work, name="rigd-client", daemon=True)
        self._thread.start()
        try:
            self.run_async(self.asynchronous.open())
        except BaseException:
            self._end()
            raise

    def close(self) -> None:
        """Disconnect; closing twice is silent. See :meth:`AsyncClient.close` for the lease."""
        if self._works:
            try:
                self.run_async(self.asynchronous.close())
            finally:
                self._end()

    def __repr__(self) -> str:
        """Return a short description, for the cell of a notebook."""
        return f"<{type(self).__name__} of {self.rig}, as {self.identity}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            self._end_by(error)
        finally:
            self.close()

    @property
    def rig(self) -> str:
        """The name of the rig."""
        return self.asynchronous.rig

    @property
    def identity(self) -> str:
        """The name under which the daemon knows this client."""
        return self.asynchronous.identity

    @property
    def holds_lease(self) -> bool:
        """Whether this client keeps the control lease, as far as it knows."""
        return self.asynchronous.holds_lease

    status = blocking(AsyncClient.status)
    watch = _iterating(AsyncClient.watch)
    watch_live = _iterating(AsyncClient.watch_live)
    watch_events = _iterating(AsyncClient.watch_events)
    wait = blocking(AsyncClient.wait)

    @contextmanager
    def control(self, *, brief: bool = False) -> Iterator[None]:
        """Hold the control lease within a block; see :meth:`AsyncClient.control`."""
        control = self.asynchronous.control(brief=brief)
        self.run_async(control.__aenter__())
        try:
            yield
        except BaseException as error:
            try:
                self._end_by(error)
            finally:
                self.run_async(control.__aexit__(type(error), error, error.__traceback__))
            raise
        self.run_async(control.__aexit__(None, None, None))

    def run_async(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Return the result of ``coroutine`` on the loop of this client.

        Raises:
            LinkError: this client is closed.
        """
        if not self._works:
            coroutine.close()
            raise LinkError("this client is closed", hint="make another")
        waiting = _Waiting(self._loop, coroutine)
        try:
            return waiting.result()
        except BaseException:  # Ctrl-C while waiting cancels the coroutine
            waiting.cancel()
            raise

    def iterate(self, items: AsyncGenerator[T, None]) -> Iterator[T]:
        """Yield the items of ``items`` on the loop of this client."""

        async def following() -> T | object:
            return await anext(items, _END)

        async def close() -> None:
            await items.aclose()

        try:
            while (item := self.run_async(following())) is not _END:
                yield item  # type: ignore[misc]  # all but _END are T
        finally:
            if self._works:
                self.run_async(close())

    def _end_by(self, error: BaseException | None) -> None:
        """Stop the run at once if Ctrl-C ends a script that has control.

        Otherwise the run would continue until the lease expires.
        """
        if isinstance(error, KeyboardInterrupt) and self.holds_lease:
            try:
                self.stop("Ctrl-C in a script")
            except RigdError as second:
                _log.warning("the run could not be stopped: %s", second.one_line)

    @property
    def _works(self) -> bool:
        """Whether the thread of the event loop answers; not while Python ends, nor when closed."""
        return not (self._ends or sys.is_finalizing())

    def _work(self) -> None:
        try:
            self._loop.run_forever()
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())
        finally:
            self._loop.close()

    def _end(self) -> None:
        self._ends = True
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()


class _Waiting(Generic[T]):
    """Awaits the result of a coroutine on the event loop of another thread.

    Ctrl-C may interrupt the thread that waits between any two of its instructions. It must not do
    so while that thread holds a lock that the event loop needs; with
    :func:`asyncio.run_coroutine_threadsafe`, the loop then stops for ever. So the two threads
    share no lock of Python's, only a :class:`~queue.SimpleQueue`.

    A Ctrl-C that comes just before that thread waits, or to another thread, does not wake it: it
    wakes by itself now and then.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, coroutine: Coroutine[Any, Any, T]) -> None:
        self._loop = loop
        self._task: asyncio.Task[T] | None = None
        self._done: SimpleQueue[tuple[T | None, BaseException | None]] = SimpleQueue()
        loop.call_soon_threadsafe(self._begin, coroutine)

    def result(self) -> T:
        """Wait for the coroutine to end; return or raise what it does."""
        while True:
            try:
                result, error = self._done.get(timeout=_LOOK_S)
            except Empty:
                continue
            if error is not None:
                raise error
            return result  # type: ignore[return-value]  # without an error it is a T

    def cancel(self) -> None:
        """Cancel the coroutine if it has not ended."""
        self._loop.call_soon_threadsafe(self._cancel)

    def _begin(self, coroutine: Coroutine[Any, Any, T]) -> None:
        self._task = self._loop.create_task(coroutine)
        self._task.add_done_callback(self._end)

    def _end(self, task: asyncio.Task[T]) -> None:
        # The task is let go of here: its end runs callbacks, in which Python ignores a Ctrl-C.
        self._task = None
        if task.cancelled():
            self._done.put((None, asyncio.CancelledError()))
        elif (error := task.exception()) is not None:
            self._done.put((None, error))
        else:
            self._done.put((task.result(), None))

    def _cancel(self) -> None:
        if self._task is not None:
            self._task.cancel()

"""Client of a daemon for scripts and notebooks.

The same verbs as those of :class:`AsyncClient`, which works on an event loop in a thread of its
own: a notebook's own loop is left alone.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import AsyncGenerator, Callable, Coroutine, Iterator
from contextlib import contextmanager
from functools import wraps
from types import TracebackType
from typing import Any, Concatenate, Final, ParamSpec, Self, TypeVar

from rigd.config.remote import TlsFiles
from rigd.model.errors import LinkError, RigdError
from rigd.remote.client.asynchronous import AsyncClient

_log: Final = logging.getLogger(__name__)

P = ParamSpec("P")
T = TypeVar("T")

_END: Final = object()


def _blocking(
    method: Callable[Concatenate[AsyncClient, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate[Client, P], T]:
    """Return the method that waits for what ``method`` returns."""

    @wraps(method)
    def blocking(self: Client, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self.run_async(method(self.asynchronous, *args, **kwargs))

    return blocking


def _iterating(
    method: Callable[Concatenate[AsyncClient, P], AsyncGenerator[T, None]],
) -> Callable[Concatenate[Client, P], Iterator[T]]:
    """Return the method that waits for each of what ``method`` yields."""

    @wraps(method)
    def iterating(self: Client, /, *args: P.args, **kwargs: P.kwargs) -> Iterator[T]:
        async def begin() -> AsyncGenerator[T, None]:
            return method(self.asynchronous, *args, **kwargs)

        return self.iterate(self.run_async(begin()))  # it listens from here on

    return iterating


class Client:
    """Steers one rig from elsewhere: ``with Client("lugre-1") as rig: ...``, or without `with`.

    It is connected once it is made. ``rig`` is looked up in the client's own list, or is on this
    machine; ``endpoint`` (``tls/rig.lab:7447``), ``tls`` and ``identity`` take precedence.

    Every verb raises :class:`~rigd.model.errors.LinkError` where nobody answers, and
    :class:`~rigd.remote.protocol.Refusal`, with a ``code``, where the daemon does not do it; then
    nothing has changed. Commands need the control lease, see :meth:`control`; to stop, nobody
    needs it. Any thread may call.

    Raises:
        LinkError: nobody lets us in there, or there is no such rig.
        ConfigError: the list or an argument is wrong, or several rigs are there, and none is named.
        Refusal: a name cannot stand in a key.
    """

    def __init__(
        self,
        rig: str | None = None,
        *,
        endpoint: str | None = None,
        tls: TlsFiles | None = None,
        identity: str | None = None,
    ) -> None:
        self.asynchronous = AsyncClient(rig, endpoint=endpoint, tls=tls, identity=identity)
        """The client that does the work, on the loop of this one's thread."""
        self._loop = asyncio.new_event_loop()
        # A notebook that ends without a word must end: the thread keeps nothing alive.
        self._thread = threading.Thread(target=self._work, name="rigd-client", daemon=True)
        self._thread.start()
        try:
            self.run_async(self.asynchronous.open())
        except BaseException:
            self._end()
            raise

    def close(self) -> None:
        """Disconnect; closing twice is silent. See :meth:`AsyncClient.close` for the lease."""
        if self._thread.is_alive():
            try:
                self.run_async(self.asynchronous.close())
            finally:
                self._end()

    def __repr__(self) -> str:
        """Return what it is, for the cell of a notebook."""
        return f"<{type(self).__name__} of {self.rig}, as {self.identity}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
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

    status = _blocking(AsyncClient.status)
    describe = _blocking(AsyncClient.describe)
    latest = _blocking(AsyncClient.latest)
    history = _blocking(AsyncClient.history)
    events = _blocking(AsyncClient.events)
    watch = _iterating(AsyncClient.watch)
    watch_live = _iterating(AsyncClient.watch_live)
    watch_events = _iterating(AsyncClient.watch_events)
    wait = _blocking(AsyncClient.wait)

    procedures = _blocking(AsyncClient.procedures)
    procedure = _blocking(AsyncClient.procedure)
    check = _blocking(AsyncClient.check)
    dry_run = _blocking(AsyncClient.dry_run)

    lease = _blocking(AsyncClient.lease)
    lease_take = _blocking(AsyncClient.lease_take)
    lease_seize = _blocking(AsyncClient.lease_seize)
    lease_renew = _blocking(AsyncClient.lease_renew)
    lease_release = _blocking(AsyncClient.lease_release)
    lease_request = _blocking(AsyncClient.lease_request)
    lease_give = _blocking(AsyncClient.lease_give)

    start = _blocking(AsyncClient.start)
    resume_run = _blocking(AsyncClient.resume_run)
    pause = _blocking(AsyncClient.pause)
    resume = _blocking(AsyncClient.resume)
    answer = _blocking(AsyncClient.answer)
    acknowledge = _blocking(AsyncClient.acknowledge)
    act = _blocking(AsyncClient.act)
    stop = _blocking(AsyncClient.stop)
    abort = _blocking(AsyncClient.abort)
    estop = _blocking(AsyncClient.estop)

    runs = _blocking(AsyncClient.runs)
    run = _blocking(AsyncClient.run)
    identify = _blocking(AsyncClient.identify)
    draw = _blocking(AsyncClient.draw)
    fetch = _blocking(AsyncClient.fetch)
    report = _blocking(AsyncClient.report)

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
        """Return what ``coroutine`` returns on the loop of this client.

        Raises:
            LinkError: this client is closed.
        """
        if not self._thread.is_alive():
            coroutine.close()
            raise LinkError("this client is closed", hint="make another")
        future = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        try:
            return future.result()
        except BaseException:  # Ctrl-C while waiting ends what is waited for
            future.cancel()
            raise

    def iterate(self, items: AsyncGenerator[T, None]) -> Iterator[T]:
        """Yield what ``items`` yields on the loop of this client."""

        async def following() -> T | object:
            return await anext(items, _END)

        async def close() -> None:
            await items.aclose()

        try:
            while (item := self.run_async(following())) is not _END:
                yield item  # type: ignore[misc]  # all but _END are T
        finally:
            if self._thread.is_alive():
                self.run_async(close())

    def _end_by(self, error: BaseException | None) -> None:
        """Stop the run at once where Ctrl-C ends a script that has control.

        Else the rig would learn of it when the lease runs out.
        """
        if isinstance(error, KeyboardInterrupt) and self.holds_lease:
            try:
                self.stop("Ctrl-C in a script")
            except RigdError as second:
                _log.warning("the run could not be stopped: %s", second.told)

    def _work(self) -> None:
        try:
            self._loop.run_forever()
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())
        finally:
            self._loop.close()

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

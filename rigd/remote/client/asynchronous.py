"""Client of a daemon for asyncio programs."""

from __future__ import annotations

from collections.abc import AsyncGenerator, AsyncIterator, Mapping
from contextlib import aclosing, asynccontextmanager
from pathlib import Path
from typing import Any, Final, Literal, Self, TypeVar

from rigd.config.remote import TlsFiles
from rigd.config.shipped import is_path
from rigd.model.errors import LinkError
from rigd.model.pages import page_of
from rigd.remote.client.connection import EVENTS, FRAMES, STATUSES, Connection
from rigd.remote.client.lease_keeper import LeaseKeeper
from rigd.remote.client.procedures import naming_the_file, read_procedure
from rigd.remote.client.remotes import find_target
from rigd.remote.client.transfer import Progress, fetch
from rigd.remote.client.watching import RunWatch, each, reader, without_gaps
from rigd.remote.protocol import (
    Frame,
    Kind,
    LeaseView,
    Message,
    RigEvent,
    Status,
    as_json,
    decode_frame,
)
from rigd.remote.protocol.results import (
    ActionReply,
    CheckReport,
    Description,
    DryRun,
    Events,
    History,
    LatestValues,
    Nothing,
    PieceView,
    Procedures,
    ProcedureView,
    Reported,
    RunList,
    RunView,
    Started,
    Stopped,
)
from rigd.remote.protocol.status import LastRun

R = TypeVar("R", bound=Message)

#: How long a daemon may say nothing to who watches it, in s; it speaks twice a second.
PATIENCE_S: Final = 10.0


class AsyncClient:
    """Steers one rig from elsewhere: ``async with AsyncClient("lugre-1") as rig: ...``.

    ``rig`` is looked up in the client's own list (:mod:`rigd.remote.client.remotes`), or is on
    this machine; ``endpoint`` (``tls/rig.lab:7447``), ``tls`` and ``identity`` take precedence.

    Every verb raises :class:`~rigd.model.errors.LinkError` where nobody answers, and
    :class:`~rigd.remote.protocol.Refusal`, with a ``code``, where the daemon does not do it; then
    nothing has changed. Commands need the control lease, see :meth:`control`; to stop, nobody
    needs it.

    Raises:
        ConfigError: the list or an argument is wrong.
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
        self._target = find_target(rig, endpoint, tls, identity)
        self._opened: Connection | None = None
        self._holding = LeaseKeeper(self.lease_renew, self._release)

    async def open(self) -> Self:
        """Connect.

        Raises:
            LinkError: nobody lets us in there, or there is no such rig.
            ConfigError: there are several rigs, and none is named.
        """
        if self._opened is None:
            self._opened = await Connection.open(self._target)
        return self

    async def close(self) -> None:
        """Disconnect; closing twice is silent.

        A lease that is still held then runs out, and the daemon does what the procedure says of a
        client that vanishes. Give it back first where the run is to go on.
        """
        await self._holding.end()
        if self._opened is not None:
            await self._opened.close()
            self._opened = None

    async def __aenter__(self) -> Self:
        return await self.open()

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def connection(self) -> Connection:
        """The connection beneath; LinkError where it is not open."""
        if self._opened is None:
            raise LinkError("this client is not connected", hint="open() it, or use it by `with`")
        return self._opened

    @property
    def rig(self) -> str:
        """The name of the rig."""
        return self.connection.rig

    @property
    def identity(self) -> str:
        """The name under which the daemon knows this client."""
        return self._target.identity

    @property
    def holds_lease(self) -> bool:
        """Whether this client keeps the control lease, as far as it knows."""
        return self._holding.holds

    # Looking

    async def status(self) -> Status:
        """Return the state of everything; at most half a second old."""
        return await self.connection.status()

    async def describe(self) -> Description:
        """Return what does not change: channels, limits, interlocks, one's own role."""
        return await self._ask("describe", Description)

    async def latest(self) -> LatestValues:
        """Return the newest value of every channel, in SI, with its age."""
        return await self._ask("latest", LatestValues)

    async def history(self, stream: str) -> Frame | None:
        """Return the last ten seconds of a stream, reduced; None where nothing came yet."""
        found = await self._ask("history", History, stream=stream)
        return None if found.frame is None else decode_frame(found.frame)

    async def events(self, since: int = 0) -> Events:
        """Return the events numbered from ``since`` that the daemon still knows."""
        return await self._ask("events", Events, seq=since)

    def watch(self, patience_s: float | None = PATIENCE_S) -> AsyncGenerator[Status, None]:
        """Yield the status at every change and twice a second, the newest where it comes too fast.

        Raises:
            LinkError: nothing was heard for ``patience_s``; None waits for ever.
        """
        heard = self.connection.listen(self.connection.keys.status, STATUSES)
        return each(heard, reader(Status), self.rig, patience_s)

    def watch_live(self, stream: str) -> AsyncGenerator[Frame, None]:
        """Yield frames of a stream while it has any, at most 30 a second, the newest ones.

        The streams and their channels are those of :meth:`describe`.
        """
        heard = self.connection.listen(self.connection.keys.live(stream), FRAMES)
        return each(heard, decode_frame, self.rig)

    def watch_events(self, since: int | None = None) -> AsyncGenerator[RigEvent, None]:
        """Yield events, from now on or from number ``since``, none left out.

        Those that were lost on the way are asked for; what the daemon itself no longer has shows
        as a gap in their numbers. A daemon that starts anew counts from 0 again.
        """
        heard = self.connection.listen(self.connection.keys.event, EVENTS)
        return without_gaps(each(heard, reader(RigEvent), self.rig), self.events, since)

    async def wait(self, run: str, *, patience_s: float = PATIENCE_S) -> LastRun:
        """Return how ``run`` ended, once it has.

        Raises:
            LinkError: the daemon fell silent, or it was started anew and the run is interrupted.
            Refusal: it is neither under way nor the run that ended last.
        """
        watched = RunWatch(run)
        async with aclosing(self.watch(patience_s)) as statuses:
            async for status in statuses:
                ended = watched.ended(status)
                if ended is not None:
                    return ended
        raise LinkError("the client was closed")

    # Procedures

    async def procedures(self) -> Procedures:
        """Return the procedures that the daemon has."""
        return await self._ask("procedures", Procedures)

    async def procedure(self, name: str) -> ProcedureView:
        """Return a procedure that the daemon has, and its parameters."""
        return await self._ask("procedure", ProcedureView, name=name)

    async def check(
        self, procedure: str | Path, set: Mapping[str, str] | None = None
    ) -> CheckReport:
        """Return whether a procedure can run on the rig; see :meth:`start` for the arguments."""
        args = await self._checked(procedure, set)
        return await self._ask("check", CheckReport, **args)

    async def dry_run(self, procedure: str | Path, set: Mapping[str, str] | None = None) -> DryRun:
        """Return what a run would do, played on the simulated plant; may take minutes."""
        args = await self._checked(procedure, set)
        with naming_the_file(procedure, args["procedure"]["name"]):
            return await self._command("dry_run", DryRun, **args)

    # The control lease

    async def lease(self) -> LeaseView:
        """Return who may command."""
        return await self._ask("lease", LeaseView)

    async def lease_take(self) -> LeaseView:
        """Take the lease if it is free, and keep it until it is given back or lost."""
        return await self._take("lease_take")

    async def lease_seize(self) -> LeaseView:
        """Take the lease from whoever has it; for maintainers."""
        return await self._take("lease_seize")

    async def lease_renew(self) -> LeaseView:
        """Renew the lease for six seconds; done by itself while this client holds it."""
        return await self._command("lease_renew", LeaseView)

    async def lease_release(self) -> LeaseView:
        """Give the lease back; a run under way goes on."""
        await self._holding.end()
        return await self._release()

    async def lease_request(self) -> LeaseView:
        """Ask whoever has the lease to hand it over; they are shown who asks."""
        return await self._command("lease_request", LeaseView)

    async def lease_give(self, to: str) -> LeaseView:
        """Hand the lease over."""
        view = await self._command("lease_give", LeaseView, to=to)
        await self._holding.end()
        return view

    @asynccontextmanager
    async def control(self, *, brief: bool = False) -> AsyncIterator[None]:
        """Hold the control lease within a block.

        Left by an exception the lease is not given back but runs out, so that the daemon does what
        the procedure says of a client that vanishes. Given back it is after a refusal, and by
        ``brief`` after whatever happens: for single commands to a run that needs nobody. A lease
        that was held before stays as it was.
        """
        held = self._holding.holds
        was_ours = (await self.lease()).holder == self.identity
        await self.lease_take()
        if held:
            yield
            return
        async with self._holding.until_left(brief=brief, give_back=not was_ours):
            yield

    # Running

    async def start(
        self,
        procedure: str | Path,
        set: Mapping[str, str] | None = None,
        *,
        seed: int | None = None,
        answers: Literal["ask", "procedure"] = "ask",
        on_client_loss: Literal["continue", "finish_trial", "stop"] | None = None,
        note: str = "",
        meta: Mapping[str, str] | None = None,
    ) -> Started:
        """Start a run, and return the name of its recording.

        A path means a file of this computer, a name a procedure that the daemon has. ``set`` gives
        parameters, as a person writes them: ``{"current": "0.15 A"}``. With the ``answers`` of the
        procedure its prompts ask nobody. ``on_client_loss`` is what happens to the run when this
        client vanishes with the lease; None: what the procedure says. ``note`` and ``meta``
        (``{"specimen": "W7"}``) are kept in the recording.
        """
        args = await self._checked(procedure, set)
        with naming_the_file(procedure, args["procedure"]["name"]):
            return await self._command(
                "start", Started, **args, seed=seed, answers=answers, on_client_loss=on_client_loss,
                note=note, meta=dict(meta or {}),
            )  # fmt: skip

    async def resume_run(
        self,
        run: str,
        *,
        on_client_loss: Literal["continue", "finish_trial", "stop"] | None = None,
    ) -> Started:
        """Go on with an interrupted run: only the trials that are missing.

        ``on_client_loss`` as in :meth:`start`.
        """
        return await self._command("resume_run", Started, run=run, on_client_loss=on_client_loss)

    async def pause(self) -> None:
        """Pause after the trial under way."""
        await self._command("pause", Nothing)

    async def resume(self) -> None:
        """Go on after a pause."""
        await self._command("resume", Nothing)

    async def answer(self, value: float | str | bool, prompt_id: int) -> None:
        """Answer the prompt of that id (``status().prompt``): in SI, a word, or yes by True."""
        await self._command("answer", Nothing, prompt_id=prompt_id, value=value)

    async def acknowledge(self, interlock: str) -> None:
        """Say that a person has looked at what an interlock stopped."""
        await self._command("acknowledge", Nothing, interlock=interlock)

    async def act(self, device: str, action: str) -> str:
        """Let a device do one of its actions, such as a tare; return what it answered."""
        return (await self._command("act", ActionReply, device=device, action=action)).said

    async def stop(self, reason: str = "") -> bool:
        """Stop the run in order: setpoints to rest, then its ``finish``.

        Needs no lease. A stop is a request; the safety function is the hardware chain of the rig.

        Returns:
            Whether there was anything to stop that had not been stopped as hard before.
        """
        return await self._stop("stop", reason)

    async def abort(self, reason: str = "") -> bool:
        """Ramp to rest now, without ``finish``; see :meth:`stop`."""
        return await self._stop("abort", reason)

    async def estop(self, reason: str = "") -> bool:
        """Ask for power to be dropped; see :meth:`stop`."""
        return await self._stop("estop", reason)

    # Recordings

    async def runs(self, limit: int = 100, before: str | None = None) -> RunList:
        """Return the recordings, the newest first; ``before`` one of them, to see older ones."""
        return await self._ask("runs", RunList, limit=limit, before=before)

    async def run(self, run: str) -> RunView:
        """Return what is known of a recording; ``details`` are those of ``rigd info --json``."""
        return await self._ask("run", RunView, run=run)

    async def identify(self, run: str) -> Reported:
        """Let the daemon identify from a recording, and make the report; may take minutes."""
        return await self._command("identify", Reported, run=run)

    async def draw(self, run: str) -> Reported:
        """Let the daemon draw what a recording holds, unless that page is there; takes seconds."""
        return await self._command("draw", Reported, run=run)

    async def fetch(self, run: str, to: Path | str = ".", progress: Progress | None = None) -> Path:
        """Fetch a recording to the folder ``to``, and return its path; goes on where it broke off.

        ``progress`` is called with the bytes that have come and their number in all.

        Raises:
            RecordingError: it cannot be written, or did not come as it is.
        """
        return await self._fetch("fetch", run, Path(to) / run, progress)

    async def report(
        self,
        run: str,
        to: Path | str = ".",
        progress: Progress | None = None,
        page: Literal["run", "identification"] = "identification",
    ) -> Path:
        """Fetch a page on a recording; as :meth:`fetch`.

        That of its ``identification`` is made by :meth:`identify`, that of the ``run`` by
        :meth:`draw`.
        """
        recording = Path(to) / run
        path = page_of(recording) if page == "run" else recording.with_suffix(".html")
        return await self._fetch("report", run, path, progress, page=page)

    async def _ask(self, what: str, result: type[R], **args: Any) -> R:
        return await self.connection.request(Kind.ASK, what, args, result)

    async def _command(self, verb: str, result: type[R], **args: Any) -> R:
        return await self.connection.request(Kind.COMMAND, verb, args, result)

    async def _stop(self, verb: str, reason: str) -> bool:
        found = await self.connection.request(Kind.STOP, verb, {"reason": reason}, Stopped)
        return found.acted

    async def _release(self) -> LeaseView:
        return await self._command("lease_release", LeaseView)

    async def _take(self, verb: str) -> LeaseView:
        view = await self._command(verb, LeaseView)
        self._holding.begin()
        return view

    async def _checked(
        self, procedure: str | Path, set: Mapping[str, str] | None
    ) -> dict[str, Any]:
        """Return the arguments that say which procedure, with which values."""
        if is_path(procedure):
            file = read_procedure(procedure)
        else:
            file = (await self.procedure(str(procedure))).procedure
        return {"procedure": as_json(file), "set": dict(set or {})}

    async def _fetch(
        self, what: str, run: str, path: Path, progress: Progress | None, **args: str
    ) -> Path:
        async def piece(offset: int) -> PieceView:
            return await self._ask(what, PieceView, run=run, offset=offset, **args)

        return await fetch(piece, path, progress)

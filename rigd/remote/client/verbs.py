"""Defines a method for each verb (kind of request) of the protocol, for both kinds of client."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Coroutine, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, Literal, ParamSpec, TypeVar

from rigd.config.shipped_files import is_path
from rigd.model.pages import page_of
from rigd.procedure.loader import load_own_procedure
from rigd.remote.client.connection import Connection
from rigd.remote.client.lease.lease_keeper import LeaseKeeper
from rigd.remote.client.transfer import Progress, fetch
from rigd.remote.client.watching import all_events
from rigd.remote.protocol import (
    Code,
    Frame,
    Kind,
    LeaseView,
    Message,
    Refusal,
    as_json,
    decode_frame,
)
from rigd.remote.protocol.arguments import ProcedureFile
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
    RenewedCalibration,
    Reported,
    RunList,
    RunView,
    Started,
    Stopped,
)
from rigd.remote.protocol.stop import stop_reason

R = TypeVar("R", bound=Message)
P = ParamSpec("P")
T = TypeVar("T")


class AsyncVerbs(ABC):
    """The methods of :class:`AsyncClient` for the verbs, one for each."""

    _holding: LeaseKeeper

    @property
    @abstractmethod
    def connection(self) -> Connection:
        """The connection that carries the requests."""

    # Looking

    async def describe(self) -> Description:
        """Return the constant data of the rig: channels, limits, interlocks, the client's role."""
        return await self._ask("describe", Description)

    async def latest(self) -> LatestValues:
        """Return the newest value of every channel, in SI, with its age."""
        return await self._ask("latest", LatestValues)

    async def history(self, stream: str) -> Frame | None:
        """Return the last ten seconds of a stream, reduced; None if it had no rows yet."""
        found = await self._ask("history", History, stream=stream)
        return None if found.frame is None else decode_frame(found.frame)

    async def events(self, since: int = 0) -> Events:
        """Return the events numbered from ``since`` that the daemon still knows."""
        return await all_events(lambda seq: self._ask("events", Events, seq=seq), since)

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
        """Play a procedure on the simulated plant and return the result; may take minutes."""
        args = await self._checked(procedure, set)
        with _naming_the_file(procedure, args["procedure"]["name"]):
            return await self._command("dry_run", DryRun, **args)

    # The control lease

    async def lease(self) -> LeaseView:
        """Return the client that may command."""
        return await self._ask("lease", LeaseView)

    async def lease_take(self) -> LeaseView:
        """Take the lease if it is free, and keep it until it is given back or lost."""
        return await self._take("lease_take")

    async def lease_seize(self) -> LeaseView:
        """Take the lease from its holder; for maintainers."""
        return await self._take("lease_seize")

    async def lease_renew(self) -> LeaseView:
        """Renew the lease for six seconds; done by itself while this client holds it."""
        return await self._command("lease_renew", LeaseView)

    async def lease_release(self) -> LeaseView:
        """Give the lease back; a run under way goes on."""
        await self._holding.end()
        return await self._release()

    async def lease_request(self) -> LeaseView:
        """Ask the holder of the lease to hand it over; the holder is shown this client's name.

        Once it is handed over, :meth:`lease_take` keeps it; else it is lost after six seconds.
        """
        return await self._command("lease_request", LeaseView)

    async def lease_give(self, to: str) -> LeaseView:
        """Hand the lease over."""
        view = await self._command("lease_give", LeaseView, to=to)
        await self._holding.end()
        return view

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
        specimen: str = "",
    ) -> Started:
        """Start a run, and return the name of its recording.

        A path means a file of this computer, a name a procedure of the daemon. ``set`` has
        parameters as text: ``{"current": "0.15 A"}``. With the ``answers`` of the procedure its
        prompts do not wait. ``on_client_loss`` is the action of the run when this client vanishes
        with the lease; None: as the procedure specifies. ``note``, ``meta`` (``{"batch": "13"}``)
        and the name of the ``specimen`` are written into the recording.
        """
        args = await self._checked(procedure, set)
        with _naming_the_file(procedure, args["procedure"]["name"]):
            return await self._command(
                "start", Started, **args, seed=seed, answers=answers, on_client_loss=on_client_loss,
                note=note, meta=dict(meta or {}), specimen=specimen,
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
        """Pause: at once if ``status().can_hold``, else in a later step, or after the trial."""
        await self._command("pause", Nothing)

    async def resume(self) -> None:
        """Go on after a pause."""
        await self._command("resume", Nothing)

    async def answer(self, value: float | str | bool, prompt_id: int) -> None:
        """Answer the prompt of that id (``status().prompt``): in SI, a word, or yes by True."""
        await self._command("answer", Nothing, prompt_id=prompt_id, value=value)

    async def acknowledge(self, interlock: str, since_ns: int | None = None) -> None:
        """Confirm that a person has looked at the trip of an interlock.

        ``since_ns`` is the time of that trip (``status().trips``): refused if there is a newer one.
        """
        await self._command("acknowledge", Nothing, interlock=interlock, since_ns=since_ns)

    async def act(self, device: str, action: str) -> str:
        """Perform an action of a device, such as a tare; return its reply."""
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

    async def runs(self, limit: int = 100, before: str | None = None, where: str = "") -> RunList:
        """Return the recordings, the newest first; only those older than ``before`` if given.

        ``where``: only those for which this condition holds, as ``rigd runs --where`` takes it.
        """
        return await self._ask("runs", RunList, limit=limit, before=before, where=where)

    async def run(self, run: str) -> RunView:
        """Return the data of a recording; ``details`` are those of ``rigd info --json``."""
        return await self._ask("run", RunView, run=run)

    async def identify(self, run: str) -> Reported:
        """Let the daemon identify from a recording, and make the report; may take minutes."""
        return await self._command("identify", Reported, run=run)

    async def calibrate(
        self, run: str, *, days: int = 365, write: bool = False
    ) -> RenewedCalibration:
        """Let the daemon evaluate the recording of a calibration; new values beside old.

        ``write``: the calibration file of the rig is renewed, with this client and its user as the
        person responsible; the values may be used for so many ``days``.
        """
        return await self._command("calibrate", RenewedCalibration, run=run, days=days, write=write)

    async def draw(self, run: str) -> Reported:
        """Let the daemon draw the page of a recording, unless it exists; takes seconds."""
        return await self._command("draw", Reported, run=run)

    async def fetch(self, run: str, to: Path | str = ".", progress: Progress | None = None) -> Path:
        """Fetch a recording to the folder ``to``, return its path; continues a broken transfer.

        ``progress`` is called with the received bytes and their total.

        Raises:
            RecordingError: it cannot be written, or arrived with errors.
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

    async def compare(
        self, runs: Sequence[str], to: Path | str, progress: Progress | None = None
    ) -> Path:
        """Let the daemon compare recordings, and fetch the page to the file ``to``.

        Each recording is a campaign; differences are from the first. It may take minutes.

        Raises:
            Refusal: the recordings cannot be compared.
            RecordingError: the page cannot be written, or arrived with errors.
        """

        async def piece(offset: int) -> PieceView:
            return await self._ask("compare", PieceView, runs=list(runs), offset=offset)

        return await fetch(piece, Path(to), progress)

    async def _ask(self, what: str, result: type[R], **args: Any) -> R:
        return await self.connection.request(Kind.ASK, what, args, result)

    async def _command(self, verb: str, result: type[R], **args: Any) -> R:
        return await self.connection.request(Kind.COMMAND, verb, args, result)

    async def _stop(self, verb: str, reason: str) -> bool:
        found = await self.connection.request(
            Kind.STOP, verb, {"reason": stop_reason(reason)}, Stopped
        )
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
        """Return the arguments for a procedure and its values."""
        if is_path(procedure):
            loaded = load_own_procedure(procedure)
            file = ProcedureFile.of(loaded.name, loaded.file.text)
        else:
            file = (await self.procedure(str(procedure))).procedure
        return {"procedure": as_json(file), "set": dict(set or {})}

    async def _fetch(
        self, what: str, run: str, path: Path, progress: Progress | None, **args: str
    ) -> Path:
        async def piece(offset: int) -> PieceView:
            return await self._ask(what, PieceView, run=run, offset=offset, **args)

        return await fetch(piece, path, progress)


def blocking(
    method: Callable[Concatenate[Any, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate[BlockingVerbs, P], T]:
    """Return the method that waits for the result of ``method``."""

    @wraps(method)
    def waiting(self: BlockingVerbs, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self.run_async(method(self.asynchronous, *args, **kwargs))

    return waiting


class BlockingVerbs(ABC):
    """The methods of :class:`Client` for the verbs, one for each; each waits for its reply."""

    asynchronous: AsyncVerbs

    @abstractmethod
    def run_async(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Return the result of ``coroutine`` on the loop of this client."""

    describe = blocking(AsyncVerbs.describe)
    latest = blocking(AsyncVerbs.latest)
    history = blocking(AsyncVerbs.history)
    events = blocking(AsyncVerbs.events)
    procedures = blocking(AsyncVerbs.procedures)
    procedure = blocking(AsyncVerbs.procedure)
    check = blocking(AsyncVerbs.check)
    dry_run = blocking(AsyncVerbs.dry_run)
    lease = blocking(AsyncVerbs.lease)
    lease_take = blocking(AsyncVerbs.lease_take)
    lease_seize = blocking(AsyncVerbs.lease_seize)
    lease_renew = blocking(AsyncVerbs.lease_renew)
    lease_release = blocking(AsyncVerbs.lease_release)
    lease_request = blocking(AsyncVerbs.lease_request)
    lease_give = blocking(AsyncVerbs.lease_give)
    start = blocking(AsyncVerbs.start)
    resume_run = blocking(AsyncVerbs.resume_run)
    pause = blocking(AsyncVerbs.pause)
    resume = blocking(AsyncVerbs.resume)
    answer = blocking(AsyncVerbs.answer)
    acknowledge = blocking(AsyncVerbs.acknowledge)
    act = blocking(AsyncVerbs.act)
    stop = blocking(AsyncVerbs.stop)
    abort = blocking(AsyncVerbs.abort)
    estop = blocking(AsyncVerbs.estop)
    runs = blocking(AsyncVerbs.runs)
    run = blocking(AsyncVerbs.run)
    identify = blocking(AsyncVerbs.identify)
    calibrate = blocking(AsyncVerbs.calibrate)
    draw = blocking(AsyncVerbs.draw)
    fetch = blocking(AsyncVerbs.fetch)
    report = blocking(AsyncVerbs.report)
    compare = blocking(AsyncVerbs.compare)


@contextmanager
def _naming_the_file(given: str | Path, name: str) -> Iterator[None]:
    """Add the path of the local file to errors that a daemon reports in procedure ``name``."""
    try:
        yield
    except Refusal as refusal:
        if refusal.code is not Code.WRONG or not is_path(given):
            raise
        message = refusal.message.replace(f"{name}.yaml:", f"{given}:")
        raise Refusal(refusal.code, message, hint=refusal.hint) from refusal

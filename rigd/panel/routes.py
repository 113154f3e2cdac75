"""The HTTP interface of the panel."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Final

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from rigd.model.errors import RigdError
from rigd.panel.answers import object_of, read_object, refuse, text_of
from rigd.panel.quantities import complete_procedure, complete_run
from rigd.panel.rates import BucketByAddress
from rigd.panel.rig import Object, Rig
from rigd.panel.seat import Seat
from rigd.panel.sessions import Role, Session, Sessions
from rigd.remote.protocol import VERBS, Code, Kind, Lane, Refusal

#: What a page may ask for; files travel by routes of their own.
ASKS: Final = frozenset(
    {"describe", "procedures", "procedure", "check", "runs", "run", "events", "latest"}
)
#: What it may command; the lease is the seat's business.
COMMANDS: Final = {
    name: verb for name, verb in VERBS[Kind.COMMAND].items() if verb.lane is not Lane.LEASE
}

#: Characters of a user's name.
MOST_NAME: Final = 40


@dataclass(frozen=True)
class PanelApi:
    """The panel's HTTP doors; every one but ``login`` wants a session."""

    rig: Rig
    sessions: Sessions
    seat: Seat
    cookie: str  #: name of the session's cookie; holds the port, as cookies do not know ports
    secure: bool  #: whether the page is reached by TLS
    logins: BucketByAddress  #: attempts to log in

    def routes(self) -> list[Route]:
        """Return the routes."""
        posts = {
            "/api/logout": self.logout,
            "/api/invite": self.invite,
            "/api/ask/{what}": self.ask,
            "/api/command/{verb}": self.command,
            "/api/control/{verb}": self.control,
            "/api/stop/{verb}": self.stop,
        }
        return [
            Route("/api/login", self.login, methods=["POST"]),
            Route("/api/session", self.session, methods=["GET"]),
            *(Route(path, self._door(door), methods=["POST"]) for path, door in posts.items()),
        ]

    async def login(self, request: Request) -> Response:
        """Open a session with a one-time code."""
        try:
            if not self.logins.take("" if request.client is None else request.client.host):
                raise Refusal(Code.BUSY, "too many attempts; wait a minute")
            given = await read_object(request)
            name = " ".join(text_of(given, "name", MOST_NAME).split())
            if not name.isprintable() or not name:
                raise Refusal(Code.BAD_REQUEST, "say who you are")
            opened = self.sessions.redeem(text_of(given, "code", 200), name)
            if opened is None:
                raise Refusal(
                    Code.FORBIDDEN,
                    "this link has been used, or is too old",
                    hint="ask for a new one at a panel that is open, or start the panel again",
                )
        except Refusal as refusal:
            return refuse(refusal)
        key, session = opened
        answer = JSONResponse({"session": self._describe(session)})
        answer.set_cookie(
            self.cookie, key, httponly=True, samesite="strict", secure=self.secure, path="/"
        )
        return answer

    async def session(self, request: Request) -> Response:
        """Say who sits before this page; nobody is an answer too."""
        session = self.find(request.cookies)
        return JSONResponse({"session": None if session is None else self._describe(session)})

    async def logout(self, request: Request, session: Session) -> Object:
        """Close the session."""
        self.sessions.end(request.cookies[self.cookie])
        return {}

    async def invite(self, request: Request, session: Session) -> Object:
        """Return a code for another screen, with no more rights than this one has."""
        role = (await read_object(request)).get("role")
        if role != "observer" and role != session.role:
            raise Refusal(Code.FORBIDDEN, f"an {session.role} cannot invite {role!r}")
        given: Role = "observer" if role == "observer" else session.role
        return {"code": self.sessions.invite(given)}

    async def ask(self, request: Request, session: Session) -> Object:
        """Read something from the rig."""
        what = request.path_params["what"]
        if what not in ASKS:
            raise Refusal(Code.UNKNOWN_VERB, f"there is nothing like {what[:40]!r} to ask for")
        answer = await self.rig.ask(what, object_of(await read_object(request), "args"))
        complete = {"procedure": complete_procedure, "run": complete_run}.get(what)
        return answer if complete is None else complete(answer)

    async def command(self, request: Request, session: Session) -> Object:
        """Command the rig."""
        verb = request.path_params["verb"]
        if verb not in COMMANDS:
            raise Refusal(Code.UNKNOWN_VERB, f"there is no command {verb[:40]!r}")
        args = object_of(await read_object(request), "args")
        _require_operator(session)
        if COMMANDS[verb].needs_lease:
            self.seat.require(session)
        return await self.rig.command(verb, args, session.name)

    async def control(self, request: Request, session: Session) -> Object:
        """Take control, give it back, ask for it, or hand it over."""
        args = object_of(await read_object(request), "args")
        _require_operator(session)
        match request.path_params["verb"]:
            case "take":
                return await self.seat.take(session)
            case "seize":
                return await self.seat.seize(session)
            case "release":
                return await self.seat.release(session)
            case "ask":
                return await self.seat.ask(session)
            case "give":
                return await self.seat.give(session, args)
        raise Refusal(Code.UNKNOWN_VERB, "control is taken, seized, released, asked for or given")

    async def stop(self, request: Request, session: Session) -> Object:
        """Stop, abort or estop: whoever may see the page may do so."""
        return await self.stop_for(session, request.path_params["verb"])

    async def stop_for(self, session: Session, verb: str) -> Object:
        """Stop, abort or estop in the name of a session, by whatever way it asks.

        Raises:
            Refusal: it asks too often, or for something else.
        """
        if not session.stops.take():
            raise Refusal(Code.BUSY, "too many requests; wait a second")
        if verb not in VERBS[Kind.STOP]:
            raise Refusal(Code.UNKNOWN_VERB, f"there is no {verb[:40]!r}")
        return await self.rig.stop(verb, session.name)

    def find(self, cookies: dict[str, str]) -> Session | None:
        """Return the session that a page's cookies belong to."""
        return self.sessions.find(cookies.get(self.cookie, ""))

    def _door(
        self, door: Callable[[Request, Session], Awaitable[Object]]
    ) -> Callable[[Request], Awaitable[Response]]:
        """Return ``door`` as an endpoint that lets in only those with a session."""

        async def endpoint(request: Request) -> Response:
            session = self.find(request.cookies)
            if session is None:
                told = {"code": "no_session", "message": "this page is not logged in", "hint": None}
                return JSONResponse({"error": told}, 401)
            try:
                if door != self.stop and not session.requests.take():
                    raise Refusal(Code.BUSY, "too many requests; wait a second")
                return JSONResponse(await door(request, session))
            except RigdError as error:
                return refuse(error)

        return endpoint

    def _describe(self, session: Session) -> Object:
        return {
            "name": session.name,
            "role": session.role,
            "session": session.number,
            "identity": self.rig.identity,
        }


def _require_operator(session: Session) -> None:
    if session.role != "operator":
        raise Refusal(Code.FORBIDDEN, "this page may watch and stop, not command")

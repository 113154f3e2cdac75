"""Carries out the HTTP requests of the page: login, sessions, and requests to the daemon."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from rigd.model.errors import RigdError
from rigd.panel.answers import read_body, refuse, respond
from rigd.panel.login.sessions import Session, Sessions
from rigd.panel.messages import (
    ASKS,
    COMMANDS,
    Invitation,
    InvitationRequest,
    Login,
    RequestError,
    SessionReply,
    SessionView,
    VerbRequest,
    complete,
)
from rigd.panel.rig import Rig
from rigd.remote.protocol import VERBS, Code, Kind, Message, Refusal, as_json
from rigd.remote.protocol.results import Nothing, Stopped
from rigd.remote.request_rates import BucketByClient


async def _while_connected(request: Request, asking: Coroutine[Any, Any, Message]) -> Message:
    """Return what is asked for; cancel that when the page has gone.

    Raises:
        Refusal: the page has gone.
        RigdError: as ``asking`` raises.
    """
    asked = asyncio.create_task(asking)
    gone = asyncio.ensure_future(request.receive())  # of a request that is read: its end
    try:
        await asyncio.wait([asked, gone], return_when=asyncio.FIRST_COMPLETED)
        if not asked.done():
            raise Refusal(Code.REFUSED, "the page that asked has gone")
        return asked.result()
    finally:
        for task in (asked, gone):
            task.cancel()
        await asyncio.wait([asked, gone])


@dataclass(frozen=True)
class PanelApi:
    """The panel's HTTP routes; all but ``login`` and ``session`` need a session."""

    rig: Rig
    sessions: Sessions
    cookie: str  #: name of the session's cookie; contains the port
    secure: bool  #: whether browsers reach the page by TLS
    logins: BucketByClient  #: attempts to log in

    def routes(self) -> list[Route]:
        """Return the routes."""
        posts = {
            "/api/logout": self.logout,
            "/api/invite": self.invite,
            "/api/ask/{what}": self.ask,
            "/api/command/{verb}": self.command,
            "/api/stop/{verb}": self.stop,
        }
        return [
            Route("/api/login", self.login, methods=["POST"]),
            Route("/api/session", self.session, methods=["GET"]),
            *(
                Route(path, self._with_session(handler), methods=["POST"])
                for path, handler in posts.items()
            ),
        ]

    async def login(self, request: Request) -> Response:
        """Open a session with a one-time code."""
        try:
            if not self.logins.take("" if request.client is None else request.client.host):
                raise Refusal(Code.BUSY, "too many attempts; wait a minute")
            given = await read_body(request, Login)
            name = " ".join(given.name.split())
            if not name.isprintable() or not name:
                raise Refusal(Code.BAD_REQUEST, "a name is needed")
            opened = self.sessions.redeem(given.code, name)
            if opened is None:
                raise Refusal(
                    Code.FORBIDDEN,
                    "this link has been used, or is too old",
                    hint="open panels and `rigd panel` give new links",
                )
        except Refusal as refusal:
            return refuse(refusal)
        key, session = opened
        answer = respond(self._reply(session))
        answer.set_cookie(
            self.cookie, key, httponly=True, samesite="strict", secure=self.secure, path="/"
        )
        return answer

    async def session(self, request: Request) -> Response:
        """Return the session of the page, or an empty reply if it has none."""
        session = self.find(request.cookies)
        return respond(self._reply(session))

    async def logout(self, request: Request, session: Session) -> Message:
        """Close the session."""
        self.sessions.end(request.cookies[self.cookie])
        return Nothing()

    async def invite(self, request: Request, session: Session) -> Message:
        """Return a code for another screen, with no more rights than this session has."""
        role = (await read_body(request, InvitationRequest)).role
        if role not in ("observer", session.role):
            raise Refusal(Code.FORBIDDEN, f"an {session.role} cannot invite an {role}")
        return Invitation(code=self.sessions.invite(role))

    async def ask(self, request: Request, session: Session) -> Message:
        """Read something from the rig."""
        question = request.path_params["what"]
        if question not in ASKS:
            raise Refusal(Code.UNKNOWN_VERB, f"unknown question {question[:40]!r}")
        args = (await read_body(request, VerbRequest)).args
        return complete(await self.rig.request(Kind.ASK, question, args, ASKS[question].result))

    async def command(self, request: Request, session: Session) -> Message:
        """Command the rig."""
        verb = request.path_params["verb"]
        if verb not in COMMANDS:
            raise Refusal(Code.UNKNOWN_VERB, f"unknown command {verb[:40]!r}")
        args = (await read_body(request, VerbRequest)).args
        if session.role != "operator":
            raise Refusal(Code.FORBIDDEN, "this page may watch and stop, not command")
        to_us = verb == "lease_give" and args.get("to") == self.rig.identity
        if to_us and not self.sessions.may_hold_lease(str(args.get("user", ""))):
            raise Refusal(Code.NOT_FOUND, "that user is no operator with a page open here")
        kind = COMMANDS[verb].result
        if verb == "dry_run":
            asking = self.rig.request_apart(Kind.COMMAND, verb, args, kind, session.name)
            return complete(await _while_connected(request, asking))
        return complete(await self.rig.request(Kind.COMMAND, verb, args, kind, session.name))

    async def stop(self, request: Request, session: Session) -> Message:
        """Stop, abort or estop; every session may do so."""
        return await self.stop_for(session, request.path_params["verb"])

    async def stop_for(self, session: Session, verb: str) -> Stopped:
        """Stop, abort or estop in the name of a session.

        Raises:
            Refusal: the session sends too many requests, or the verb is no stop.
        """
        if not session.stops.take():
            raise Refusal(Code.BUSY, "too many requests; wait a second")
        if verb not in VERBS[Kind.STOP]:
            raise Refusal(Code.UNKNOWN_VERB, f"unknown stop {verb[:40]!r}")
        return await self.rig.request(Kind.STOP, verb, {}, Stopped, session.name)

    def find(self, cookies: dict[str, str]) -> Session | None:
        """Return the session of a page's cookies."""
        return self.sessions.find(cookies.get(self.cookie, ""))

    def _with_session(
        self, handler: Callable[[Request, Session], Awaitable[Message]]
    ) -> Callable[[Request], Awaitable[Response]]:
        """Return ``handler`` as an endpoint that refuses requests without a session."""

        async def endpoint(request: Request) -> Response:
            session = self.find(request.cookies)
            if session is None:
                error = RequestError(code="no_session", message="this page is not logged in")
                return JSONResponse({"error": as_json(error)}, 401)
            try:
                if handler != self.stop and not session.requests.take():
                    raise Refusal(Code.BUSY, "too many requests; wait a second")
                return respond(await handler(request, session))
            except RigdError as error:
                return refuse(error)

        return endpoint

    def _reply(self, session: Session | None) -> SessionReply:
        view = (
            None
            if session is None
            else SessionView(name=session.name, role=session.role, identity=self.rig.identity)
        )
        return SessionReply(rig=self.rig.rig, session=view)

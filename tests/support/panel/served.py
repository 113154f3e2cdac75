"""A panel that serves a played rig over the network, in a thread of this process."""

from __future__ import annotations

import asyncio
import http.client
import json
import threading
from collections.abc import AsyncIterator, Mapping
from concurrent.futures import Future
from contextlib import ExitStack
from typing import Any, Literal, TypeVar
from urllib.parse import urlsplit

from support.daemon.served_rig import free_port
from support.daemon.served_rig import serve as serve_rig
from support.panel.played_rig import PlayedRig
from websockets import Origin
from websockets.sync.client import ClientConnection, connect

from rigd.config.remote import RemoteSetup
from rigd.model.errors import LinkError
from rigd.panel.login.session_store import SessionStore
from rigd.panel.server import Listen, serve
from rigd.remote.client.connection import Connection
from rigd.remote.client.rigs.target import make_target
from rigd.remote.protocol import Kind, RigEvent, Status

R = TypeVar("R")


class Line:
    """The panel's connection to the rig, which a test can cut, or hold a verb up in."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.is_cut = False
        self.held = ""  #: the verb that gets no further
        self.verbs: list[str] = []  #: of the requests so far
        self._turn = asyncio.Lock()

    @property
    def rig(self) -> str:
        return self.connection.rig

    @property
    def identity(self) -> str:
        return self.connection.identity

    async def request(
        self, kind: Kind, verb: str, args: Mapping[str, Any], result: type[R], user: str = ""
    ) -> R:
        await self._pass(verb)
        return await self.connection.request(kind, verb, args, result, user)

    async def request_apart(
        self, kind: Kind, verb: str, args: Mapping[str, Any], result: type[R], user: str = ""
    ) -> R:
        await self._pass(verb)
        return await self.connection.request_apart(kind, verb, args, result, user)

    async def _pass(self, verb: str) -> None:
        self.verbs.append(verb)
        if verb == self.held:
            async with self._turn:  # they go on in the order in which they came
                while verb == self.held:
                    await asyncio.sleep(0.01)
        if self.is_cut:
            raise LinkError("the daemon does not answer", hint="is it running?")

    async def statuses(self) -> AsyncIterator[Status]:
        async for status in self.connection.statuses():
            if not self.is_cut:
                yield status

    def events(self) -> AsyncIterator[RigEvent]:
        return self.connection.events()

    async def frames(self) -> AsyncIterator[bytes]:
        async for frame in self.connection.frames():
            if not self.is_cut:
                yield frame


class ServedPanel:
    """Serves ``rig`` while the context lasts: the daemon's end, and a panel on a free port.

    ``role`` is that of the panel on the rig.
    """

    line: Line

    def __init__(
        self,
        rig: PlayedRig | None = None,
        store: SessionStore | None = None,
        role: Literal["operator", "maintainer"] = "operator",
    ) -> None:
        self.rig = rig or PlayedRig()
        self._setup = RemoteSetup((f"tcp/127.0.0.1:{free_port()}",), roles={"panel": role})
        self._store = store
        self._opened = ExitStack()
        self.links: dict[str, str] = {}
        self.port = 0
        self._told: Future[Mapping[str, str]] = Future()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="panel")
        self._serving: asyncio.Task[None] | None = None

    def __enter__(self) -> ServedPanel:
        self._opened.enter_context(serve_rig(self._setup, rig=self.rig, live=True))
        self._thread.start()
        self.links = dict(self._told.result(30))
        self.port = urlsplit(self.links["operator"]).port or 0
        return self

    def __exit__(self, *_: object) -> None:
        if self._serving is not None:
            self._loop.call_soon_threadsafe(self._serving.cancel)
        self._thread.join(30)
        self._loop.close()
        self._opened.close()

    @property
    def origin(self) -> str:
        """Of its own pages."""
        return f"http://127.0.0.1:{self.port}"

    def visitor(self, role: str = "operator", name: str = "Ada") -> Visitor:
        """Return a visitor logged in by the link of its role, or by a further one."""
        visitor = Visitor(self)
        code = self.links.pop(role, "").partition("#")[2]
        if not code:
            raise ValueError(f"the link of the {role} has been used")
        visitor.login(code, name)
        return visitor

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)

        async def run() -> None:
            target = make_target(self.rig.name, self._setup.listen[0], identity="panel")
            async with await Connection.open(target) as connection:
                self.line = Line(connection)
                self._serving = asyncio.create_task(
                    serve(self.line, Listen(port=0), self._told.set_result, self._store)
                )
                await asyncio.wait([self._serving])
                if not self._serving.cancelled():
                    await self._serving

        self._loop.run_until_complete(run())


class Visitor:
    """A user with a browser of its own, spoken by hand: plain HTTP, one cookie."""

    def __init__(self, panel: ServedPanel) -> None:
        self.panel = panel
        self.cookie = ""
        self.told: dict[str, Any] = {}

    def login(self, code: str, name: str = "Ada") -> int:
        """Open a session and return the status."""
        status, headers, body = self.send(
            "POST", "/api/login", json.dumps({"code": code, "name": name}).encode()
        )
        if status == 200:
            self.cookie = headers["set-cookie"].partition(";")[0]
            self.told = json.loads(body)["session"]
        return status

    def post(self, path: str, **body: Any) -> tuple[int, dict[str, Any]]:
        """Send what the page would send; return status and answer."""
        status, _, answer = self.send("POST", path, json.dumps(body).encode())
        return status, json.loads(answer)

    def get(self, path: str) -> tuple[int, dict[str, str], bytes]:
        """Read something."""
        return self.send("GET", path)

    def send(
        self, method: str, path: str, body: bytes = b"", **headers: str | None
    ) -> tuple[int, dict[str, str], bytes]:
        """Send a request like the page's, with ``headers`` changed or, by None, left out."""
        usual: dict[str, str | None] = {
            "host": f"127.0.0.1:{self.panel.port}",
            "cookie": self.cookie or None,
        }
        if method not in ("GET", "HEAD"):
            usual |= {
                "origin": self.panel.origin,
                "x-rigd": "1",
                "content-type": "application/json",
                "content-length": str(len(body)),
            }
        usual |= {name.replace("_", "-"): value for name, value in headers.items()}
        connection = http.client.HTTPConnection("127.0.0.1", self.panel.port, timeout=30)
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in usual.items():
                if value is not None:
                    connection.putheader(name, value)
            connection.endheaders(body or None)
            answer = connection.getresponse()
            told = {k.lower(): v for k, v in answer.getheaders()}
            try:
                return answer.status, told, answer.read()
            except ConnectionResetError:
                # Refused by its head, and closed with the body still unread.
                return answer.status, told, b""
        finally:
            connection.close()

    def page(self, origin: str | None = None, path: str = "/api/live") -> ClientConnection:
        """Open the page's WebSocket, or that for its stops."""
        return connect(
            f"ws://127.0.0.1:{self.panel.port}{path}",
            origin=Origin(origin or self.panel.origin),
            additional_headers={"cookie": self.cookie} if self.cookie else {},
            max_size=2**22,
            open_timeout=30,
            close_timeout=1,
        )

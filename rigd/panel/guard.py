"""Checks every HTTP request (host, origin, size, rate) and adds security headers to responses.

The checks against a page of another site (CSRF, DNS rebinding) are:

- The Host must be that of this panel.
- A WebSocket, and every request that is not a plain read, must come from this panel's own Origin.
- A request that may change something must carry a header that an HTML form cannot send.

Against a flood of requests, the panel limits the rate of each address and the size of every body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rigd.remote.protocol.limits import MAX_REQUEST_BYTES
from rigd.remote.request_rates import BucketByClient

#: The header of every request except a plain read.
OWN_HEADER: Final = "x-rigd"
#: Requests per second of one address: a page loads forty files at once.
PER_S: Final = 60.0
BURST: Final = 300.0
#: A WebSocket close code of our own: a page of another site.
FOREIGN: Final = 4403


@dataclass(frozen=True)
class PanelAddress:
    """The address of the panel: ``hosts`` are host names with port, as browsers send them."""

    scheme: str
    hosts: frozenset[str]

    @property
    def origins(self) -> frozenset[str]:
        """The origins of the panel's own pages."""
        return frozenset(f"{self.scheme}://{host}" for host in self.hosts)


class RequestGuard:
    """Wraps the application: refuses forbidden requests, and adds headers to responses."""

    def __init__(self, app: ASGIApp, place: PanelAddress) -> None:
        self._app = app
        self._place = place
        self._requests = BucketByClient(PER_S, BURST)
        socket = "wss" if place.scheme == "https" else "ws"
        # Older browsers do not accept 'self' for a WebSocket; no browser accepts an IPv6 address
        # here.
        named = sorted(f"{socket}://{host}" for host in place.hosts if "[" not in host)
        sources = " ".join(["'self'", *named])
        policy = (
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
            f"connect-src {sources}; frame-src 'self'; manifest-src 'self'; base-uri 'none'; "
            "form-action 'none'; frame-ancestors 'none'"
        )
        self._headers = {
            "content-security-policy": policy,
            "x-content-type-options": "nosniff",
            "referrer-policy": "no-referrer",
            "cross-origin-opener-policy": "same-origin",
            "cross-origin-resource-policy": "same-origin",
            "permissions-policy": "camera=(), microphone=(), geolocation=(), usb=(), serial=()",
            "cache-control": "no-cache",
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal = self._refuse(scope)
        if scope["type"] == "websocket":
            if refusal is None:
                await self._app(scope, receive, send)
            else:
                await receive()
                await send({"type": "websocket.close", "code": FOREIGN, "reason": refusal[2]})
            return

        async def send_complete(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in self._headers.items():
                    headers.setdefault(name, value)
            await send(message)

        if refusal is None:
            await self._app(scope, _bounded(receive), send_complete)
            return
        status, code, message = refusal[0], refusal[1], refusal[2]
        answer = JSONResponse({"error": {"code": code, "message": message, "hint": None}}, status)
        await answer(scope, receive, send_complete)

    def _refuse(self, scope: Scope) -> tuple[int, str, str] | None:
        """Return status, code and message of the refusal of a request; None: it is permitted."""
        headers = Headers(scope=scope)
        # A stop is never refused for its rate here; its session has a limit of its own.
        is_stop = scope["path"].startswith("/api/stop/")
        if not is_stop and not self._requests.take(_address(scope)):
            return 429, "busy", "too many requests; wait a second"
        if headers.get("host") not in self._place.hosts:
            return 421, "bad_request", "this panel does not have that host name"
        reads = scope["type"] == "http" and scope["method"] in ("GET", "HEAD")
        if reads:
            return None
        if headers.get("origin") not in self._place.origins:
            return 403, "forbidden", "the request comes from another page"
        if scope["type"] == "websocket":
            return None
        if headers.get(OWN_HEADER) != "1":
            return 403, "forbidden", "the request does not come from the panel's page"
        if headers.get("content-type") != "application/json":
            return 415, "bad_request", "expected application/json"
        length = headers.get("content-length", "")
        if not length.isdecimal():
            return 411, "bad_request", "expected a content-length"
        if int(length) > MAX_REQUEST_BYTES:
            return 413, "too_large", f"at most {MAX_REQUEST_BYTES} bytes may be sent"
        return None


def _address(scope: Scope) -> str:
    client = scope.get("client")
    return "" if client is None else str(client[0])


def _bounded(receive: Receive) -> Receive:
    """Return ``receive`` that ends a body at the maximum length."""
    taken = 0

    async def receive_bounded() -> Message:
        nonlocal taken
        message = await receive()
        taken += len(message.get("body", b""))
        if taken > MAX_REQUEST_BYTES:
            return {"type": "http.disconnect"}
        return message

    return receive_bounded

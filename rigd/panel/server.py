"""Serves the panel over HTTP."""

from __future__ import annotations

import asyncio
import ipaddress
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import uvicorn

from rigd.model.errors import ConfigError
from rigd.panel.app import build_panel
from rigd.panel.connections import BrowserConnection
from rigd.panel.guard import PanelAddress
from rigd.panel.rig import Rig
from rigd.panel.session_store import SessionStore
from rigd.panel.sessions import Sessions

#: Where the panel is found unless something else is there already.
PORT: Final = 8423
#: How long pages that are open may hold up the end, in s.
GRACE_S: Final = 1
#: How long the link that is printed at the start can be used, in s: whoever starts a panel may
#: come to it in the morning.
FIRST_LINK_S: Final = 24 * 3600.0


@dataclass(frozen=True)
class Listen:
    """Where the panel listens.

    ``port`` None: :data:`PORT`, or where that is taken any that is free. ``names`` are further
    names it is reached by. ``certificate`` and ``key`` are PEM files.

    Raises:
        ConfigError: an address that is not loopback, without TLS.
    """

    host: str = "127.0.0.1"
    port: int | None = None
    names: tuple[str, ...] = ()
    certificate: Path | None = None
    key: Path | None = None

    def __post_init__(self) -> None:
        if (self.certificate is None) != (self.key is None):
            raise ConfigError("a certificate and its key come together", hint="give both or none")
        for path in (self.certificate, self.key):
            if path is not None and not path.is_file():
                raise ConfigError(f"there is no file {path}")
        if self.certificate is None and not _is_loopback(self.host):
            raise ConfigError(
                f"a panel on {self.host} without TLS could be read and misused on the way",
                hint="give a certificate and its key (`rigd remote setup-tls` makes them), or "
                "leave it on 127.0.0.1 and reach it through a tunnel (ssh -L)",
            )

    @property
    def scheme(self) -> str:
        """``http`` or ``https``."""
        return "http" if self.certificate is None else "https"

    def bind(self) -> socket.socket:
        """Return the socket to listen on.

        Raises:
            ConfigError: the address cannot be used.
        """
        try:
            return _bound(self.host, PORT if self.port is None else self.port)
        except OSError as error:
            if self.port is None:
                return _bound(self.host, 0)
            raise ConfigError(
                f"the panel cannot listen on {self.host}:{self.port}: {error.strerror}",
                hint="choose another port, or none",
            ) from error

    def place(self, port: int) -> PanelAddress:
        """Return how browsers name the panel that listens on ``port``."""
        names = {_bracketed(self.host), *map(_bracketed, self.names)}
        if _is_loopback(self.host):
            names |= {"localhost", "127.0.0.1", "[::1]"}
        usual = 80 if self.scheme == "http" else 443
        hosts = {f"{name}:{port}" for name in names}
        return PanelAddress(self.scheme, frozenset(hosts | (names if port == usual else set())))


async def serve(
    rig: Rig,
    listen: Listen,
    announce: Callable[[Mapping[str, str]], None],
    book: SessionStore | None = None,
) -> None:
    """Serve the panel of ``rig`` until cancelled; ``book`` keeps its sessions for the next.

    ``announce`` is told a one-time link for each role once the panel can be reached. The code in
    it stands in the fragment, which browsers keep to themselves: it is in no request and no log.

    Raises:
        ConfigError: the address cannot be used.
        RigdError: what the rig says is not understood.
    """
    with listen.bind() as bound:
        port = bound.getsockname()[1]
        sessions = Sessions(book=book)
        address = f"{listen.scheme}://{_bracketed((*listen.names, listen.host)[0])}:{port}/"
        panel = build_panel(rig, sessions, listen.place(port), port)
        config = uvicorn.Config(
            panel.app,
            http=BrowserConnection,
            ws="websockets-sansio",
            ws_max_size=1024,  # a page says nothing long
            ws_ping_interval=2.0,  # a computer that has gone without a word is noticed in 7 s
            ws_ping_timeout=5.0,
            ws_per_message_deflate=False,
            lifespan="off",
            access_log=False,
            log_config=None,
            server_header=False,
            proxy_headers=False,
            backlog=64,
            timeout_keep_alive=10,
            timeout_graceful_shutdown=GRACE_S,
            ssl_certfile=listen.certificate,
            ssl_keyfile=listen.key,
        )
        announce(
            {
                "operator": f"{address}#{sessions.invite('operator', FIRST_LINK_S)}",
                "observer": f"{address}#{sessions.invite('observer', FIRST_LINK_S)}",
            }
        )
        # Whatever of the three ends or fails ends the others: a panel that no longer follows the
        # rig must not go on serving its page.
        try:
            async with asyncio.TaskGroup() as group:
                beside = [group.create_task(panel.hub.run()), group.create_task(panel.seat.keep())]
                await _serve(_Server(config), bound)
                for task in beside:
                    task.cancel()
        except ExceptionGroup as failed:
            raise _first(failed) from failed


class _Server(uvicorn.Server):
    """Leaves signals to its caller."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Change nothing about signals."""
        yield


async def _serve(server: uvicorn.Server, bound: socket.socket) -> None:
    """Serve until cancelled; open pages are told."""
    serving = asyncio.create_task(server.serve(sockets=[bound]))
    try:
        await asyncio.shield(serving)
    except asyncio.CancelledError:
        server.should_exit = True
        await serving
        raise


def _first(error: Exception) -> Exception:
    """Return what failed first, of groups within groups: that is what a person can act on."""
    return _first(error.exceptions[0]) if isinstance(error, ExceptionGroup) else error


def _bound(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    bound = socket.socket(family, socket.SOCK_STREAM)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((host, port))
        bound.listen(64)
    except OSError:
        bound.close()
        raise
    return bound


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host

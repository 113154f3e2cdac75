"""Serves the panel over HTTP."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
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
from rigd.panel.login.session_store import SessionStore
from rigd.panel.login.sessions import Sessions
from rigd.panel.renewal import renew_lease
from rigd.panel.rig import Rig

#: The port of the panel unless another program listens on it.
PORT: Final = 8423
#: Longest wait for open pages at the end, in s.
GRACE_S: Final = 1
#: How long the link that is printed at the start can be used, in s: a person may start the panel in
#: the evening and use the link the next morning.
FIRST_LINK_S: Final = 24 * 3600.0


@dataclass(frozen=True)
class Listen:
    """The address on which the panel listens.

    ``port`` None: :data:`PORT`, or another if that is in use. ``names`` are further host names of
    the panel. ``certificate`` and ``key`` are PEM files.

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
            raise ConfigError(
                "a certificate and its key come together", hint="give both or neither"
            )
        for path in (self.certificate, self.key):
            if path is not None and not path.is_file():
                raise ConfigError(f"file {path} does not exist")
        if self.certificate is None and not _is_loopback(self.host):
            raise ConfigError(
                f"others could read and misuse a panel on {self.host} without TLS",
                hint="give a certificate and its key (`rigd remote setup-tls` makes them), "
                "or listen on 127.0.0.1 and connect through a tunnel (ssh -L)",
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
        """Return the address by which browsers reach the panel on ``port``."""
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
    store: SessionStore | None = None,
) -> None:
    """Serve the panel of ``rig`` until cancelled; ``store`` keeps its sessions for the next.

    ``announce`` receives a one-time link for each role when the panel can be reached. The code is
    in the fragment, which browsers do not send: it is in no request and no log.

    Raises:
        ConfigError: the address cannot be used.
        RigdError: a message of the rig cannot be read.
    """
    logging.getLogger("asyncio").addFilter(_is_news)
    with listen.bind() as bound:
        port = bound.getsockname()[1]
        sessions = Sessions(store=store)
        address = f"{listen.scheme}://{_bracketed((*listen.names, listen.host)[0])}:{port}/"
        panel = build_panel(rig, sessions, listen.place(port), port)
        config = uvicorn.Config(
            panel.app,
            http=BrowserConnection,
            ws="websockets-sansio",
            ws_max_size=1024,  # messages of a page are short
            ws_ping_interval=2.0,  # a computer that vanishes is noticed within 7 s
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
        # If one of the three ends, the others end too: a panel that no longer follows the rig must
        # not serve its page.
        try:
            async with asyncio.TaskGroup() as group:
                run_with = [
                    group.create_task(panel.hub.run()),
                    group.create_task(renew_lease(rig, panel.hub, sessions)),
                ]
                await _serve(_Server(config), bound)
                for task in run_with:
                    task.cancel()
        except ExceptionGroup as failed:
            raise _first(failed) from failed


def _is_news(record: logging.LogRecord) -> bool:
    """Return whether a line of asyncio tells something: not one for each write to a lost page."""
    return record.msg != "socket.send() raised exception."


class _Server(uvicorn.Server):
    """Leaves signals to its caller."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Change nothing about signals."""
        yield


async def _serve(server: uvicorn.Server, bound: socket.socket) -> None:
    """Serve until cancelled; open pages get a close message."""
    serving = asyncio.create_task(server.serve(sockets=[bound]))
    try:
        await asyncio.shield(serving)
    except asyncio.CancelledError:
        server.should_exit = True
        await serving
        raise


def _first(error: Exception) -> Exception:
    """Return the first failure in nested groups: the failure on which a person can act."""
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

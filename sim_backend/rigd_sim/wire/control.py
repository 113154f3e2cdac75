"""The control socket of a simulation: one JSON object per line, asked and answered in turn."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from rigd.sdk import LinkError

#: Longest request or answer, in bytes.
LONGEST: Final = 1 << 20
#: A simulation that does not answer for so long is stopped or hangs, in s.
TIMEOUT_S: Final = 5.0

#: Answers one request; a ValueError is told to who asked.
Answer = Callable[[Mapping[str, Any]], Mapping[str, Any]]


class ControlServer:
    """Answers requests at the socket ``path``."""

    def __init__(self, path: Path, answer: Answer) -> None:
        self._path = path
        self._answer = answer
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.StreamWriter] = set()

    async def start(self) -> None:
        """Begin to listen."""
        self._server = await asyncio.start_unix_server(self._serve, self._path, limit=LONGEST)

    async def stop(self) -> None:
        """Close every connection and remove the socket."""
        if self._server is not None:
            self._server.close()
            for client in self._clients:
                client.close()
            await self._server.wait_closed()
            self._server = None
            self._path.unlink(missing_ok=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._clients.add(writer)
        try:
            while line := await reader.readline():
                writer.write(json.dumps(self._reply(line)).encode() + b"\n")
                await writer.drain()
        except (ConnectionError, ValueError):
            pass  # gone in the middle of a request, or one without an end: nobody to tell
        finally:
            self._clients.discard(writer)
            writer.close()

    def _reply(self, line: bytes) -> Mapping[str, Any]:
        try:
            request = json.loads(line)
            if not isinstance(request, dict):
                raise ValueError('a request is a JSON object, such as {"do": "state"}')
            return self._answer(request)
        except ValueError as error:
            return {"error": str(error)}


def ask(path: Path, request: Mapping[str, Any]) -> Mapping[str, Any]:
    """Send ``request`` to the simulation at ``path`` and return its answer.

    Raises:
        LinkError: nobody serves there, or no answer comes.
        ValueError: the request cannot be met; says what can.

    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.settimeout(TIMEOUT_S)
        try:
            connection.connect(str(path))
            connection.sendall(json.dumps(dict(request)).encode() + b"\n")
            with connection.makefile("rb") as lines:
                line = lines.readline(LONGEST)
        except OSError as error:
            raise LinkError(
                f"no simulation answers at {path}: {error}", hint="start it with `rigd sim RIG`"
            ) from error
    if not line:
        raise LinkError(f"the simulation at {path} ended before it answered")
    answer: Mapping[str, Any] = json.loads(line)
    if "error" in answer:
        raise ValueError(str(answer["error"]))
    return answer

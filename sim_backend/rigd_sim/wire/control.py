"""Serves the control socket of a simulation, and sends requests to it.

Each request and each reply is one line with one JSON object.
"""

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

#: Answers one request; a ValueError is returned to the client.
Answer = Callable[[Mapping[str, Any]], Mapping[str, Any]]


class ControlServer:
    """Answers requests at the socket ``path``."""

    def __init__(self, path: Path, answer: Answer) -> None:
        self._path = path
        self._answer = answer
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.Task[None]] = set()

    async def start(self) -> None:
        """Begin to listen."""
        self._server = await asyncio.start_unix_server(self._connected, self._path, limit=LONGEST)

    async def stop(self) -> None:
        """Close every connection and remove the socket; stopping twice is silent."""
        if self._server is not None:
            self._server.close()
            for client in self._clients:
                client.cancel()
            await self._server.wait_closed()
            self._server = None
            self._path.unlink(missing_ok=True)

    def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = asyncio.create_task(self._serve(reader, writer))
        self._clients.add(client)
        client.add_done_callback(self._ended)

    def _ended(self, client: asyncio.Task[None]) -> None:
        self._clients.discard(client)
        if not client.cancelled() and (error := client.exception()) is not None:
            context = {"message": "the control socket failed", "exception": error}
            asyncio.get_running_loop().call_exception_handler(context)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while line := await self._line(reader):
                writer.write(json.dumps(self._reply(line)).encode() + b"\n")
                await writer.drain()
        except ConnectionError:
            pass  # the client is gone before the answer
        finally:
            writer.close()

    async def _line(self, reader: asyncio.StreamReader) -> bytes:
        """Return the next line; none once the client has gone, or sends one without an end."""
        try:
            return await reader.readline()
        except ValueError:
            return b""

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
        LinkError: no bench serves there, or no answer comes.
        ValueError: the request cannot be met; names what can.

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

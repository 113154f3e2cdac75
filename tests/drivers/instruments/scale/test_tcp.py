"""A scale on a TCP port, as one with a network or behind a serial device server."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Any

import pytest
from pydantic import ValidationError

from rigd.sdk import DeviceError, LinkError
from rigd_drivers.instruments.scale.driver import ScaleConfig, SerialScale


class Network:
    """Answers as MT-SICS has it, with 1.25 kg on the pan, to one client at a time."""

    def __init__(self) -> None:
        self.port = 0
        self.clients: list[asyncio.StreamWriter] = []
        self.asked: list[bytes] = []

    async def start(self) -> asyncio.Server:
        server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        return server

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.clients.append(writer)
        while command := await reader.readline():
            self.asked.append(command)
            reply = {b"SI\r\n": b"S S      1.250 kg\r\n", b"I2\r\n": b'I2 A "NET60"\r\n'}
            writer.write(reply.get(command, b"ES\r\n"))
        writer.close()


def scale(port: int, **options: Any) -> SerialScale:
    given = {"port": f"tcp://127.0.0.1:{port}", "dialect": "mt-sics", "interval": "0.05 s"}
    return SerialScale(ScaleConfig.model_validate(given | options), None)


def test_scale_on_network_is_weighed() -> None:
    async def main() -> None:
        network = Network()
        server = await network.start()
        driver = scale(network.port)
        await driver.open()
        assert "NET60" in driver.identity
        rows: list[Sequence[float]] = []
        running = asyncio.create_task(driver.run(rows.append))
        async with asyncio.timeout(20):
            while len(rows) < 3:
                await asyncio.sleep(0.01)
        assert [tuple(row) for row in rows[:3]] == [(1.25, 1)] * 3
        for client in network.clients:
            client.transport.abort()
        with pytest.raises(DeviceError, match=r"tcp://127\.0\.0\.1:\d+ is gone"):
            await running
        await driver.close()
        await driver.close()
        assert b"@\r\n" not in network.asked
        server.close()

    asyncio.run(main())


def test_nothing_at_address_is_named() -> None:
    with pytest.raises(LinkError, match="nothing answers at tcp://127"):
        asyncio.run(scale(1).open())


@pytest.mark.parametrize("port", ["tcp://scale", "tcp://:4001", "tcp://scale:0", "tcp://scale:x"])
def test_address_that_is_not_whole_is_refused(port: str) -> None:
    with pytest.raises(ValidationError, match="not of the form tcp://HOST:PORT"):
        ScaleConfig.model_validate({"port": port, "dialect": "mt-sics"})

"""The log of the panel has what a person needs to know."""

from __future__ import annotations

import asyncio
import logging
import socket

import pytest

from rigd.panel.server import _is_news


def test_writes_to_lost_page_fill_no_log(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def write_on() -> None:
        here, there = socket.socketpair()
        with there:
            transport, _ = await asyncio.get_running_loop().create_connection(
                asyncio.Protocol, sock=here
            )
            transport.abort()
            for _ in range(20):
                transport.write(b"x")

    logger = logging.getLogger("asyncio")
    monkeypatch.setattr(logger, "filters", [])  # a panel of another test may have set it
    asyncio.run(write_on())
    assert len(caplog.records) > 5  # what asyncio says of it
    caplog.clear()
    logger.addFilter(_is_news)
    asyncio.run(write_on())
    logger.warning("something else")
    assert caplog.messages == ["something else"]

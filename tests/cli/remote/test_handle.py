"""Ctrl-C reaches the watching of a run on systems whose event loops take no signals."""

from __future__ import annotations

import asyncio
import signal

import pytest

from rigd.cli.remote.watching import _handle


def test_ctrl_c_is_handled_without_loop_signals(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise NotImplementedError

    monkeypatch.setattr(asyncio.SelectorEventLoop, "add_signal_handler", refuse)

    async def pressed() -> None:
        loop, heard = asyncio.get_running_loop(), asyncio.Event()
        before = signal.getsignal(signal.SIGINT)
        release = _handle(loop, signal.SIGINT, heard.set)
        signal.raise_signal(signal.SIGINT)
        await asyncio.wait_for(heard.wait(), 30)
        release()
        assert signal.getsignal(signal.SIGINT) is before

    asyncio.run(pressed())

"""Ctrl-C in a script that steers a rig."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from support.daemon.served_rig import serve

from rigd.remote import Client

SCRIPT = """\
import sys
from pathlib import Path
from rigd.remote import Client
with Client("lugre-1", endpoint=sys.argv[1], identity="alice") as rig:
    {take}
        run = rig.start("quick").run
        print("runs", flush=True)
        rig.wait(run)
"""


@pytest.mark.parametrize("take", ["with rig.control():", "if rig.lease_take():"])
def test_an_interrupt_stops_the_run_at_once(tmp_path: Path, take: str) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(take=take))
    with serve() as found:
        ended = subprocess.Popen(
            [sys.executable, str(script), found.endpoint],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )
        assert ended.stdout is not None
        assert ended.stdout.readline() == "runs\n"
        ended.send_signal(signal.SIGINT)
        _, told = ended.communicate(timeout=60)
        assert told.rstrip().endswith("KeyboardInterrupt")
        assert found.rig.done[-1] == ("alice", "stop")
        assert found.rig.given("stop") == [{"reason": "Ctrl-C in a script"}]


def test_an_interrupt_without_control_stops_nothing() -> None:
    def look() -> None:
        with Client("lugre-1", endpoint=found.endpoint, identity="bob") as rig:
            rig.status()
            raise KeyboardInterrupt

    with serve() as found:
        with pytest.raises(KeyboardInterrupt):
            look()
        assert found.rig.verbs() == []


def test_interrupt_that_wakes_no_wait_is_seen() -> None:
    """As if it came between the last look at signals and the wait: another thread is given it."""
    cancelled: list[bool] = []

    async def wait() -> None:
        try:
            await asyncio.sleep(20)
        except asyncio.CancelledError:
            cancelled.append(True)
            raise

    def interrupt() -> None:
        time.sleep(0.5)
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)

    with serve() as found, Client("lugre-1", endpoint=found.endpoint, identity="bob") as rig:
        other = threading.Thread(target=interrupt)
        other.start()
        with pytest.raises(KeyboardInterrupt):
            rig.run_async(wait())
        other.join()
        rig.run_async(asyncio.sleep(0))
        assert cancelled


def test_an_interrupt_between_any_instructions_blocks_nothing() -> None:
    with serve() as found, Client("lugre-1", endpoint=found.endpoint, identity="bob") as rig:
        instruction = 1
        while _is_interrupted(rig, instruction):
            answers: list[str] = []
            # In a thread of its own: a client that is blocked fails the test, and does not stop it.
            asking = threading.Thread(target=_ask, args=(rig, answers), daemon=True)
            asking.start()
            asking.join(timeout=30)
            assert answers == ["idle"], f"after an interrupt at instruction {instruction}"
            instruction += 1
        assert instruction > 50  # the request was interrupted all along its way


def _ask(rig: Client, answers: list[str]) -> None:
    answers.append(rig.run_async(asyncio.sleep(0, "idle")))


def _is_interrupted(rig: Client, instruction: int) -> bool:
    """Make a request that Ctrl-C ends before that instruction; return whether it was as long."""
    left = instruction

    def trace(frame: FrameType, event: str, _: object) -> Callable[..., Any]:
        nonlocal left
        frame.f_trace_opcodes = True
        left -= event == "opcode"
        if left == 0:
            raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    request = asyncio.sleep(1e-3)
    sys.settrace(trace)
    try:
        rig.run_async(request)
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
        request.close()
    return False

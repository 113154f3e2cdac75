"""Ctrl-C in a script that steers a rig."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support.served_rig import serve

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

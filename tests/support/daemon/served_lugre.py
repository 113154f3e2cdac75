"""The shipped simulated rig behind a daemon, found by the client's own list, as `lugre-1`."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.daemon.process import Daemon, listening
from support.faults.killing import own_state
from support.wire import ROOT, free_ports

RIG = "lugre-1"


@contextmanager
def served_lugre(folder: Path) -> Iterator[Daemon]:
    """Serve the rig; ``folder/rigd/remotes.yaml`` is where clients find it (XDG_CONFIG_HOME)."""
    text = (ROOT / "configs" / "sim_lugre.yaml").read_text()
    for old, new in {
        "$schema=../": f"$schema={ROOT}/",
        "parameters: plants/": f"parameters: {ROOT}/configs/plants/",
        "stale_after: 20 ms": "stale_after: 500 ms",  # in real time, on a crowded machine
        "cycle: 1 kHz": "cycle: 250 Hz",
    }.items():
        assert old in text, old
        text = text.replace(old, new)
    folder.mkdir(parents=True, exist_ok=True)
    rig = folder / "rig.yaml"
    rig.write_text(text)
    endpoint = listening(rig, free_ports(1)[0])
    (folder / "rigd").mkdir()
    (folder / "rigd" / "remotes.yaml").write_text(f"remotes: {{{RIG}: {{endpoint: {endpoint}}}}}\n")
    state = own_state(folder)
    try:
        with Daemon(rig, RIG, endpoint, folder, state) as daemon:
            daemon.notified("READY=1")
            yield daemon
    finally:
        shutil.rmtree(state)

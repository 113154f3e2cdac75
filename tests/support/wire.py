"""A shipped rig at the wire in a folder of its own, with its devices served by `rigd sim`."""

from __future__ import annotations

import fcntl
import importlib
import os
import pkgutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from support import warm

import rigd_sim
from rigd.config.loader import load_rig
from rigd.sdk import LinkError, Simulation
from rigd_sim.wire.part import Part

ROOT = Path(__file__).parent.parent.parent
#: A crowded machine starts a simulation within this time.
START_S = 60.0


@dataclass
class WireRig:
    """A rig file of its own, and the simulation behind it."""

    rig: Path
    folder: Path
    process: subprocess.Popen[bytes] | warm.Started | None = None

    def ask(self, **request: object) -> Mapping[str, Any]:
        """Ask the simulation; see :meth:`rigd.sdk.Simulation.ask`."""
        return self._simulation.ask(request)

    @cached_property
    def _simulation(self) -> Simulation:
        """Read from the rig file once: most of what a test waits for, it asks every few ms."""
        setup = load_rig(self.rig).simulation
        assert setup is not None
        return setup.simulation_class(setup.config)

    def parts(self) -> Mapping[str, Any]:
        """The state of every simulated device."""
        parts: Mapping[str, Any] = self.ask(do="state")["parts"]
        return parts

    def start(self) -> None:
        """Serve the devices; return once they can be reached."""
        with (self.folder / "sim.log").open("wb") as log:
            self.process = warm.start(["sim", str(self.rig)], Path.cwd(), log.fileno())
        deadline = time.monotonic() + START_S
        while True:
            try:
                self.ask(do="state")
                return
            except LinkError:
                ended = self.process.poll() is not None
                if ended or time.monotonic() > deadline:
                    raise AssertionError((self.folder / "sim.log").read_text()) from None
            time.sleep(0.02)

    def without(self, device: str) -> WireRig:
        """Return the rig with a file that leaves out ``device``, on the same simulation."""
        paragraphs = self.rig.read_text().split("\n\n")
        left = [item for item in paragraphs if f"  {device}:\n    driver:" not in item]
        assert len(left) == len(paragraphs) - 1, device
        smaller = self.rig.with_stem(f"{self.rig.stem}-small")
        smaller.write_text("\n\n".join(left))
        return WireRig(smaller, self.folder)

    def stop(self) -> None:
        """End the simulation."""
        if self.process is not None:
            self.process.send_signal(signal.SIGTERM)
            self.process.wait(30)
            self.process = None


@dataclass(frozen=True)
class Shipped:
    """A shipped rig at the wire: what in its file must be each copy's own."""

    file: str
    name: str
    folder: str
    plant: str  #: "" for a rig without
    ports: tuple[str, ...]  #: texts that hold a port, at their end


LUGRE = Shipped(
    "wire_lugre.yaml", "wire-1", "/tmp/rigd-wire-lugre", "lugre.yaml",
    ("127.0.0.1:31763", "port: 15020"),
)  # fmt: skip
ANGLE = Shipped(
    "wire_approach_angle.yaml", "angle-wire-1", "/tmp/rigd-wire-angle", "approach_angle.yaml",
    ("127.0.0.1:31764",),
)  # fmt: skip
LINES = Shipped("wire_lines.yaml", "lines-1", "/tmp/rigd-wire-lines", "", ())
NI = Shipped("ni_lugre.yaml", "ni-lugre", "/tmp/rigd-ni-lugre", "lugre.yaml", ("127.0.0.1:31765",))
LABJACK = Shipped(
    "labjack_lugre.yaml", "labjack-lugre", "/tmp/rigd-labjack-lugre", "lugre.yaml",
    ("port: 31766",),
)  # fmt: skip
TRIBOMETER = Shipped(
    "wire_tribometer.yaml", "tribometer-wire-1", "/tmp/rigd-wire-tribometer", "tribometer.yaml", ()
)  # fmt: skip
OVEN = Shipped("wire_oven.yaml", "oven-1", "/tmp/rigd-wire-oven", "", ())
ROBOT = Shipped(
    "wire_articulated.yaml", "articulated-wire-1", "/tmp/rigd-wire-robot", "articulated.yaml",
    ("port: 31770",),
)  # fmt: skip


def free_ports(count: int) -> list[int]:
    """Return ports of this machine that no program has at present."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for item in sockets:
            item.bind(("127.0.0.1", 0))
        return [item.getsockname()[1] for item in sockets]


def write_rig(
    folder: Path,
    name: str,
    replaced: Mapping[str, str] | None = None,
    shipped: Shipped = LUGRE,
) -> WireRig:
    """Write a shipped rig into ``folder``, with sockets and ports of its own.

    ``name`` is the name of the rig; ``replaced`` maps texts of the file to others.
    """
    text = (ROOT / "configs" / shipped.file).read_text()
    served = Path(tempfile.mkdtemp(prefix="rigd-", dir="/tmp"))  # names of sockets are short
    ports = zip(shipped.ports, free_ports(len(shipped.ports)), strict=True)
    known = {
        shipped.folder: str(served),
        f"rig: {shipped.name}": f"rig: {name}",
        "$schema=../": f"$schema={ROOT}/",
        **{old: f"{old.rstrip('0123456789')}{port}" for old, port in ports},
    }
    if shipped.plant:
        plant = f"{ROOT}/configs/plants/{shipped.plant}"
        known[f"parameters: plants/{shipped.plant}"] = f"parameters: {plant}"
    for old, new in {**known, **(replaced or {})}.items():
        assert old in text, old
        text = text.replace(old, new)
    rig = folder / f"{name}.yaml"
    rig.write_text(text)
    return WireRig(rig, served)


@contextmanager
def wire_rig(
    folder: Path,
    name: str = "wire-test",
    replaced: Mapping[str, str] | None = None,
    shipped: Shipped = LUGRE,
) -> Iterator[WireRig]:
    """The rig of :func:`write_rig`, its devices served as long as this lasts."""
    rig = write_rig(folder, name, replaced, shipped)
    rig.start()
    try:
        yield rig
    finally:
        rig.stop()


@contextmanager
def served_rig(folder: Path, text: str) -> Iterator[WireRig]:
    """The rig of ``text``, which has FOLDER for the folder of its sockets and ports, served."""
    served = Path(tempfile.mkdtemp(prefix="rigd-", dir="/tmp"))
    file = folder / "rig.yaml"
    file.write_text(text.replace("FOLDER", str(served)))
    rig = WireRig(file, served)
    rig.start()
    try:
        yield rig
    finally:
        rig.stop()


def all_parts() -> set[type[Part]]:
    """Return the class of every device that can be simulated at the wire."""
    for module in pkgutil.walk_packages(rigd_sim.__path__, "rigd_sim."):
        importlib.import_module(module.name)
    found, left = set(), [Part]
    while left:
        below = left.pop().__subclasses__()
        found.update(below)
        left += below
    return {part for part in found if part.__module__.startswith("rigd_sim.")}


def is_free(rig: str) -> bool:
    """Return whether no process of a run has the lock of a rig, also none that still ends."""
    with (Path(os.environ["RIGD_STATE"]) / rig / "lock").open() as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True

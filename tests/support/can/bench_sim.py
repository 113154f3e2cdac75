"""Simulated CAN nodes on a hub of their own, each as a peer of the conformance suite."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rigd.sdk.check import Observed, Peer, background_loop
from rigd_drivers.can.bus import CanBus, CanBusConfig
from rigd_sim.wire.can.canopen.node import CanopenNode
from rigd_sim.wire.can.drive import Cia402Drive, Demand, Mode, Motor, Ratings, Sensed
from rigd_sim.wire.can.encoder import Cia406Encoder, Scale
from rigd_sim.wire.can.hub import CanHub
from rigd_sim.wire.can.transmitter import Cia404Transmitter

#: Travel of the belt per turn of the motor, in m.
TRAVEL = 0.1


class Shaft:
    """A motor that turns as commanded and counts 4096 a turn."""

    def __init__(self) -> None:
        self.demand = Demand()

    def sense(self, t_ns: int) -> Sensed:
        return Sensed(counts=1234, speed=self.demand.value, torque=0.0295 * self.demand.value)

    def command(self, t_ns: int, demand: Demand) -> None:
        self.demand = demand


class CountingDrive(Cia402Drive):
    """A drive whose observer counts how often it lost its connection."""

    trips = 0
    is_belt = True

    def connection_lost(self, t_ns: int, error: int) -> None:
        self.trips += bool(error)
        super().connection_lost(t_ns, error)

    def observed(self) -> Observed:
        """Return what the motor gets: A; rad/s; or m/s at 100 mm per turn, and the clutch."""
        state = self.state()
        driven: tuple[float, ...] = (float(state["current"]),) if "current" in state else ()
        if not driven and not self.is_belt:
            driven = (float(state["speed"]),)
        elif not driven:
            engaged = not state["released"]
            driven = (float(state["speed"]) * TRAVEL / (2 * math.pi), float(engaged))
        watched_ms = self.dictionary.find(0x1016, 1).value & 0xFFFF
        return Observed(
            driven, bool(state["enabled"]), watched_ms * 1e-3 if watched_ms else None, self.trips
        )


def _node(kind: str, hub: CanHub) -> CanopenNode:
    shaft = Shaft()
    motor = Motor(shaft.sense, shaft.command)
    if kind == "current":
        return CountingDrive("wheel", hub, 1, motor, Ratings(Mode.CST, 1.5, 2.0, 0.0295, 4096))
    if kind == "speed":
        return CountingDrive("belt", hub, 2, motor, Ratings(Mode.CSV, 5.0, 9.0, 0.2, 4096))
    if kind == "rotary":
        drive = CountingDrive("motor", hub, 3, motor, Ratings(Mode.CSV, 5.0, 9.0, 0.2, 4096))
        drive.is_belt = False
        return drive
    if kind == "transmitter":
        return Cia404Transmitter("cell", hub, 21, lambda t_ns: 3.0)
    return Cia406Encoder("encoder", hub, 11, lambda t_ns: 0.0, Scale(4096, 4096))


@contextmanager
def can_peer(kind: str) -> Iterator[Peer]:
    """A node that runs: `current`, `speed`, `rotary`, `encoder` or `transmitter`."""
    path = Path(tempfile.mkdtemp(prefix="rigd-", dir="/tmp")) / "bus"
    hub = CanHub("bus", path)
    node = _node(kind, hub)

    async def start() -> None:
        await hub.start()
        await node.start()

    async def stop() -> None:
        await node.stop()
        await hub.stop()

    async def inject(fault: str, **options: float) -> None:
        node.inject(fault, **options)

    with background_loop() as run:
        run(start())
        try:
            yield Peer(
                link=lambda: CanBus(CanBusConfig(interface="hub", channel=str(path))),
                faults={
                    "dead": lambda: run(hub.stop()),
                    "silent": lambda: run(inject("silent")),
                    "late": lambda: run(inject("slow", delay_s=1.0)),
                    "garbled": lambda: run(inject("tpdo_short")),
                    "unguarded": lambda: run(inject("watchdog_dead")),
                    "stuck": lambda: run(inject("stuck")),
                    "locked": lambda: run(inject("locked")),
                },
                observed=node.observed if isinstance(node, CountingDrive) else Observed,
            )
        finally:
            run(stop())
            path.parent.rmdir()

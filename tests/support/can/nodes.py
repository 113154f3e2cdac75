"""Simulated CANopen nodes on a bus of their own, and a master that speaks in hexadecimal."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

from support.can.bus import Client

from rigd_sim.wire.can.canopen.node import CanopenNode
from rigd_sim.wire.can.drive import Cia402Drive, Demand, Mode, Motor, Ratings, Sensed
from rigd_sim.wire.can.encoder import Cia406Encoder, Scale
from rigd_sim.wire.can.hub import CanHub
from rigd_sim.wire.can.traits import read_make

SERVO, ENCODER = 1, 11
#: Rated torque 50 mN m: 1000 per mille of object 6077 are 1 A.
CURRENT_DRIVE = Ratings(Mode.CST, 1.0, 1.5, 0.05, counts_per_turn=4096)
SPEED_DRIVE = Ratings(Mode.CSV, 5.0, 10.0, 0.2, counts_per_turn=4096, lever=0.02)


@dataclass
class Physics:
    """The measured values set by the test, and what the node has done to it."""

    sensed: Sensed = field(default_factory=lambda: Sensed(0, 0.0, 0.0))
    counts: float = 0.0
    demands: list[Demand] = field(default_factory=list)

    def motor(self) -> Motor:
        return Motor(lambda _: self.sensed, lambda _, demand: self.demands.append(demand))


@asynccontextmanager
async def drive(
    folder: Path,
    ratings: Ratings = CURRENT_DRIVE,
    *,
    rpdo_timer: bool = False,
    make: str | None = None,
) -> AsyncIterator[tuple[Cia402Drive, Client, Physics]]:
    physics = Physics()
    hub = CanHub("bus", folder / "bus")
    node = Cia402Drive(
        "servo", hub, SERVO, physics.motor(), ratings, serial=0x1234, rpdo_timer=rpdo_timer,
        traits=None if make is None else read_make(make),
    )  # fmt: skip
    async with _on(hub, folder, node) as client:
        yield node, client, physics


@asynccontextmanager
async def encoder(
    folder: Path, scale: Scale
) -> AsyncIterator[tuple[Cia406Encoder, Client, Physics]]:
    physics = Physics()
    hub = CanHub("bus", folder / "bus")
    node = Cia406Encoder("encoder", hub, ENCODER, lambda _: physics.counts, scale)
    async with _on(hub, folder, node) as client:
        yield node, client, physics


@asynccontextmanager
async def _on(hub: CanHub, folder: Path, node: CanopenNode) -> AsyncIterator[Client]:
    await hub.start()
    client = Client(folder / "bus")
    await node.start()
    assert await client.receive() == (0x700 + node.node, "00")  # boot-up, CiA 301 7.2.8.3.3
    try:
        yield client
    finally:
        client.close()
        await node.stop()
        await hub.stop()


async def written(client: Client, node: int, *requests: str) -> None:
    """Send SDO downloads; all must be accepted."""
    for request in requests:
        index = request[3:11]
        answer = await client.sdo(node, request)
        assert answer == f"60 {index} 00 00 00 00", f"{request} was answered by {answer}"


def pdo(
    number: int,
    node: int,
    *mapping: str,
    receive: bool = False,
    kind: str = "01",
    inhibit: str = "00 00",
) -> list[str]:
    """Return the downloads that map PDO ``number`` (1 to 4) of ``node``: disable, set, enable.

    ``mapping`` as the bytes go over the wire: 10004160 is object 6041, sub-index 0, 16 bits.
    """
    base, cob_id = (0x14, 0x200) if receive else (0x18, 0x180)
    cob_id += 0x100 * (number - 1) + node
    cob = cob_id.to_bytes(2, "little").hex(" ")
    comm, mapped = f"{number - 1:02x} {base:02x}", f"{number - 1:02x} {base + 2:02x}"
    places = [
        f"23 {mapped} {place:02x} {bytes.fromhex(item).hex(' ')}"
        for place, item in enumerate(mapping, start=1)
    ]
    held_back = [] if receive else [f"2b {comm} 03 {inhibit} 00 00"]
    return [
        f"23 {comm} 01 {cob} 00 80",
        f"2f {mapped} 00 00 00 00 00",
        *places,
        f"2f {mapped} 00 {len(mapping):02x} 00 00 00",
        f"2f {comm} 02 {kind} 00 00 00",
        *held_back,
        f"23 {comm} 01 {cob} 00 00",
    ]


#: Statusword, torque, position; controlword and target torque; controlword and target velocity.
FEEDBACK = ("10004160", "10007760", "20006460")
TORQUE_COMMAND = ("10004060", "10007160")
SPEED_COMMAND = ("10004060", "2000ff60")
OPERATIONAL = (0x000, "01 00")
SYNC = (0x080, "")


async def operational(client: Client, *setup: str, mode: str = "0a") -> None:
    """Map the PDOs of the servo, set its mode, and start it."""
    command = TORQUE_COMMAND if mode in ("0a", "04") else SPEED_COMMAND
    await written(
        client,
        SERVO,
        *pdo(1, SERVO, *FEEDBACK),
        *pdo(1, SERVO, *command, receive=True),
        f"2f 60 60 00 {mode} 00 00 00",
        *setup,
    )
    client.send(*OPERATIONAL)


async def cycle(client: Client, command: str) -> str:
    """Send RPDO1 and SYNC; return the data of TPDO1."""
    client.send(0x200 + SERVO, command)
    client.send(*SYNC)
    return await client.until(0x180 + SERVO)


async def enabled(client: Client, target: str = "00 00") -> str:
    """Walk up to operation enabled; return the last TPDO1."""
    for control in ("06 00", "07 00", "0f 00"):
        await cycle(client, f"{control} {target}")
    return await cycle(client, f"0f 00 {target}")

"""The devices of ``configs/card_lugre.yaml`` keep the promises of the SDK, faults and all."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest
from support.card import serving

from rigd.config.loader import load_rig
from rigd.sdk.check import Peer, check_driver
from rigd_drivers.mf624.link import Mf624, Mf624Config
from rigd_sim.cards.lugre import LugreWiring
from rigd_sim.cards.mf624 import Mf624Registers
from rigd_sim.plants.lugre.plant import LugreConfig, LugrePlant
from rigd_sim.wire.mf624 import SimMf624

ONE_SHOT_S = 0.5  #: longer than this machine stalls
RIG = load_rig("card-lugre")


def served_card(folder: Path) -> Callable[[], AbstractContextManager[Peer]]:
    """Return what starts the card with the rig behind it; a fault stops or holds up its server."""
    shipped = RIG.links["card"].config
    assert isinstance(shipped, Mf624Config)
    assert shipped.one_shot is not None
    one_shot = shipped.one_shot.model_copy(update={"time": 1.2 * ONE_SHOT_S})
    path = folder / "card"
    config = shipped.model_copy(
        update={"interface": "emulator", "resource": str(path), "one_shot": one_shot}
    )

    @contextmanager
    def start() -> Iterator[Peer]:
        plant = LugrePlant(LugreConfig(), period_ns=1_000_000, seed=1)
        wiring = LugreWiring(plant, one_shot_s=ONE_SHOT_S)
        part = SimMf624("card", path, Mf624Registers(wiring.wires()), wiring)
        with serving(part) as loop:
            yield Peer(
                link=lambda: Mf624(config),
                faults={
                    "dead": lambda: asyncio.run_coroutine_threadsafe(part.stop(), loop).result(10),
                    "silent": lambda: loop.call_soon_threadsafe(time.sleep, 2.0),
                    "late": lambda: loop.call_soon_threadsafe(time.sleep, 0.5),
                    "garbled": lambda: loop.call_soon_threadsafe(part.inject, "card_removed"),
                },
            )

    return start


@pytest.mark.parametrize("name", RIG.devices)
def test_it_conforms(name: str, tmp_path: Path) -> None:
    device = RIG.devices[name]
    report = check_driver(device.driver_class, device.config, peer=served_card(tmp_path))
    assert not report.skipped

"""The devices of ``configs/card_lugre.yaml`` keep the promises of the SDK, faults and all."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest
from support.cards.card import serving

from rigd.config.loader import load_rig
from rigd.sdk.check import Observed, Peer, check_driver
from rigd_drivers.cards.mf624.link import Mf624, Mf624Config
from rigd_sim.lugre import layout
from rigd_sim.lugre.card import LugreWiring
from rigd_sim.lugre.plant import LugreConfig, LugrePlant
from rigd_sim.wire.cards.mf624 import SimMf624
from rigd_sim.wire.cards.mf624_registers import Mf624Registers

ONE_SHOT_S = 0.5  #: longer than this machine stalls
RIG = load_rig("card-lugre")


#: The drive of the wiring and the first command of the plant, by the device of the rig.
DRIVES = {
    "wheel_servo": ("wheel", layout.WHEEL_CURRENT),
    "longitudinal_belt": ("belt", layout.BELT_COMMANDS),
    "lateral_belt": ("bridge", layout.LATERAL_COMMANDS),
}


def observed(wiring: LugreWiring, plant: LugrePlant, name: str) -> Observed:
    """Return what the drive of a device of the rig gives the plant: a value, and its clutch."""
    if name not in DRIVES:
        return Observed()
    drive, first = DRIVES[name]
    state = wiring.state()
    setpoints = len(RIG.devices[name].setpoints)
    driven = (float(state[f"{drive}_demand"]), plant.commands[first + 1])
    return Observed(driven[:setpoints], bool(state[f"{drive}_enabled"]), watchdog_s=ONE_SHOT_S)


def served_card(folder: Path, name: str) -> Callable[[], AbstractContextManager[Peer]]:
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
                    "locked": lambda: wiring.inject("drive_fault", drive=DRIVES[name][0]),
                    "unguarded": lambda: wiring.inject("one_shot_dead"),
                },
                observed=lambda: observed(wiring, plant, name),
            )

    return start


@pytest.mark.parametrize("name", RIG.devices)
def test_it_conforms(name: str, tmp_path: Path) -> None:
    device = RIG.devices[name]
    report = check_driver(device.driver_class, device.config, peer=served_card(tmp_path, name))
    # A card counts no frames, and its drives obey their enable lines.
    assert report.skipped.keys() == {
        "frozen", "safe while stuck", "refused", "another at open",
    }  # fmt: skip

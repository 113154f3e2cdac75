"""The devices of ``configs/ni_lugre.yaml`` keep the promises of the SDK, faults and all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest
from support.cards.card import serving

from rigd.config.loader import load_rig
from rigd.sdk.check import Observed, Peer, check_driver
from rigd_drivers.cards.ni_io.config import NiIoConfig
from rigd_drivers.cards.ni_io.link import NiIo
from rigd_sim.lugre import layout
from rigd_sim.lugre.card import LugreWiring
from rigd_sim.lugre.plant import LugreConfig, LugrePlant
from rigd_sim.wire.cards.ni_io import SimNiIo
from rigd_sim.wire.cards.ni_terminals import Terminals

WATCHDOG_S = 0.6  #: longer than this machine stalls
RIG = load_rig("ni-lugre")
#: The drive of the wiring and the first command of the plant, by the device of the rig.
DRIVES = {
    "wheel_servo": ("wheel", layout.WHEEL_CURRENT),
    "longitudinal_belt": ("belt", layout.BELT_COMMANDS),
}


def observed(wiring: LugreWiring, plant: LugrePlant, name: str) -> Observed:
    """Return what the drive of a device gives the plant: a value, and its clutch."""
    if name not in DRIVES:
        return Observed()
    drive, first = DRIVES[name]
    state = wiring.state()
    driven = (float(state[f"{drive}_demand"]), plant.commands[first + 1])
    setpoints = len(RIG.devices[name].setpoints)
    return Observed(driven[:setpoints], bool(state[f"{drive}_enabled"]), watchdog_s=WATCHDOG_S)


def served_card(name: str) -> Callable[[], AbstractContextManager[Peer]]:
    """Return what starts the card with the rig behind it."""

    @contextmanager
    def start() -> Iterator[Peer]:
        plant = LugrePlant(LugreConfig(), period_ns=1_000_000, seed=1)
        wiring = LugreWiring(plant, one_shot_s=None)
        lines = [f"port0/line{number}" for number in range(16)]
        part = SimNiIo("card", Terminals(wiring.wires(), lines[:8], lines[8:]), wiring)
        with serving(part) as loop:
            shipped = RIG.links["card"].config
            assert isinstance(shipped, NiIoConfig)
            assert shipped.watchdog is not None
            watchdog = shipped.watchdog.model_copy(update={"time": WATCHDOG_S})
            address = f"127.0.0.1:{part.port}"
            config = shipped.model_copy(update={"server": address, "watchdog": watchdog})

            def show(fault: str, **options: object) -> Callable[[], object]:
                return lambda: loop.call_soon_threadsafe(lambda: part.inject(fault, **options))

            yield Peer(
                link=lambda: NiIo(config),
                faults={
                    "dead": show("removal"),
                    "silent": show("stall", seconds=3.0),
                    "late": show("stall", seconds=0.3),
                    "locked": show("drive_fault", drive=DRIVES.get(name, ("wheel", 0))[0]),
                    "unguarded": show("watchdog_dead"),
                },
                observed=lambda: observed(wiring, plant, name),
            )

    return start


@pytest.mark.parametrize(
    "name", ["wheel_servo", "longitudinal_belt", "wheel_encoder", "accelerometer"]
)
def test_it_conforms(name: str) -> None:
    device = RIG.devices[name]
    report = check_driver(device.driver_class, device.config, peer=served_card(name))
    assert report.skipped.keys() == {
        "frozen", "garbled", "garbled at open", "safe while stuck", "refused", "another at open",
    }  # fmt: skip

"""The devices of ``configs/labjack_lugre.yaml`` keep the promises of the SDK, faults and all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest
from support.cards.card import serving

from rigd.config.loader import load_rig
from rigd.sdk.check import Observed, Peer, check_driver
from rigd_drivers.cards.labjack.config import LabjackConfig
from rigd_drivers.cards.labjack.link import Labjack
from rigd_sim.lugre import layout
from rigd_sim.lugre.card import LugreWiring
from rigd_sim.lugre.plant import LugreConfig, LugrePlant
from rigd_sim.lugre.wire_parts import labjack_of
from rigd_sim.wire.cards.labjack import SimLabjack
from rigd_sim.wire.modbus.line import TcpLine

RIG = load_rig("labjack-lugre")
#: The drive of the wiring and the first command of the plant, by the device of the rig.
DRIVES = {
    "wheel_servo": ("wheel", layout.WHEEL_CURRENT),
    "longitudinal_belt": ("belt", layout.BELT_COMMANDS),
}


def observed(wiring: LugreWiring, plant: LugrePlant, name: str, bound_s: float) -> Observed:
    """Return what the drive of a device gives the plant: a value, and its clutch."""
    if name not in DRIVES:
        return Observed()
    drive, first = DRIVES[name]
    state = wiring.state()
    driven = (float(state[f"{drive}_demand"]), plant.commands[first + 1])
    setpoints = len(RIG.devices[name].setpoints)
    return Observed(driven[:setpoints], bool(state[f"{drive}_enabled"]), watchdog_s=bound_s)


def served_card(name: str) -> Callable[[], AbstractContextManager[Peer]]:
    """Return what starts the device with the rig behind it."""

    @contextmanager
    def start() -> Iterator[Peer]:
        plant = LugrePlant(LugreConfig(), period_ns=1_000_000, seed=1)
        wiring = LugreWiring(plant, one_shot_s=None)
        line = TcpLine("127.0.0.1", 0)
        part = SimLabjack("labjack", line, labjack_of(wiring), wiring)
        with serving(part) as loop:
            shipped = RIG.links["card"].config
            assert isinstance(shipped, LabjackConfig)
            assert shipped.guard_s is not None
            bound_s = shipped.guard_s
            config = shipped.model_copy(update={"port": line.port})

            def show(fault: str, **options: object) -> Callable[[], object]:
                return lambda: loop.call_soon_threadsafe(lambda: part.inject(fault, **options))

            yield Peer(
                link=lambda: Labjack(config),
                faults={
                    "dead": show("cut"),
                    "silent": show("deaf"),
                    "late": show("late", delay_s=0.3),
                    "garbled": show("garbage"),
                    "locked": show("drive_fault", drive=DRIVES.get(name, ("wheel", 0))[0]),
                    "unguarded": show("watchdog_dead"),
                },
                observed=lambda: observed(wiring, plant, name, bound_s),
            )

    return start


@pytest.mark.parametrize(
    "name", ["wheel_servo", "longitudinal_belt", "wheel_encoder", "accelerometer"]
)
def test_it_conforms(name: str) -> None:
    device = RIG.devices[name]
    report = check_driver(device.driver_class, device.config, peer=served_card(name))
    assert report.skipped.keys() == {
        "frozen", "safe while stuck", "refused", "another at open",
    }  # fmt: skip

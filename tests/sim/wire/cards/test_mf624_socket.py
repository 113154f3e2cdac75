"""The card of ``rigd sim``: packets in, answers out, and the LuGre rig behind it."""

from __future__ import annotations

import asyncio
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from support.cards.card import serving

from rigd.config.loader import load_rig
from rigd.sdk import DeviceError, Driver, LinkError
from rigd_drivers.cards.mf624.link import Mf624, Mf624Config
from rigd_sim.lugre import layout
from rigd_sim.lugre.card import LugreWiring
from rigd_sim.lugre.plant import LugreConfig, LugrePlant
from rigd_sim.wire.cards.mf624 import SimMf624
from rigd_sim.wire.cards.mf624_registers import Mf624Registers

#: Longer than this machine may stall between two cycles; and one that a test can wait for.
PATIENT_S, BRIEF_S = 60.0, 0.3
MAX_STALL_S = 20.0  #: how long a test waits on a machine that stands still


class Bench:
    """The LuGre rig on a served card, and the rig file's devices on a link to it."""

    loop: asyncio.AbstractEventLoop

    def __init__(self, folder: Path, one_shot_s: float) -> None:
        self.one_shot_s = one_shot_s
        self.plant = LugrePlant(LugreConfig(), period_ns=1_000_000, seed=1)
        self.wiring = LugreWiring(self.plant, one_shot_s=one_shot_s)
        self.path = folder / "card"
        self.card = Mf624Registers(self.wiring.wires())
        self.part = SimMf624("card", self.path, self.card, self.wiring)

    def ask(self, question: Callable[[], Any]) -> Any:
        """Return what ``question`` gives in the thread of the simulation."""

        async def put() -> Any:
            return question()

        return asyncio.run_coroutine_threadsafe(put(), self.loop).result(MAX_STALL_S)

    def state(self) -> dict[str, Any]:
        return dict(self.ask(self.part.state))

    def wait_for(self, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        give_up = time.monotonic() + MAX_STALL_S
        while time.monotonic() < give_up:
            state = self.state()
            if condition(state):
                return state
        raise AssertionError(f"it never came true: {state}")


@contextmanager
def served(folder: Path, one_shot_s: float) -> Iterator[Bench]:
    bench = Bench(folder, one_shot_s)
    with serving(bench.part) as loop:
        bench.loop = loop
        yield bench


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with served(tmp_path, PATIENT_S) as bench:
        yield bench


@pytest.fixture
def brief(tmp_path: Path) -> Iterator[Bench]:
    """The same, with a one-shot that drops soon."""
    with served(tmp_path, BRIEF_S) as bench:
        yield bench


class Master:
    """The devices of ``configs/card_lugre.yaml`` on a link to the served card."""

    def __init__(self, bench: Bench) -> None:
        rig = load_rig("card-lugre")
        config = rig.links["card"].config
        assert isinstance(config, Mf624Config)
        assert config.one_shot is not None
        one_shot = config.one_shot.model_copy(update={"time": 1.2 * bench.one_shot_s})
        config = config.model_copy(
            update={
                "interface": "emulator",
                "resource": str(bench.path),
                "one_shot": one_shot,
            }
        )
        self.link = Mf624(config)
        self.devices: dict[str, Driver] = {}
        for name, device in rig.devices.items():
            driver = device.driver_class(device.config, self.link)
            assert isinstance(driver, Driver)
            self.devices[name] = driver
        self.setpoints = {
            "wheel_servo": (0.0,),
            "longitudinal_belt": (0.0, 1.0),
            "lateral_belt": (0.0, 1.0),
        }

    def cycle(self) -> dict[str, tuple[float, ...]]:
        now = time.monotonic_ns()
        self.link.begin(now)
        rows = {name: tuple(device.read(now) or ()) for name, device in self.devices.items()}
        for name, setpoints in self.setpoints.items():
            self.devices[name].write(setpoints)
        self.link.end(now)
        return rows

    def arm(self) -> None:
        self.cycle()
        for device in self.devices.values():
            device.arm()
        for _ in range(3):
            self.cycle()
        assert all(device.ready() for device in self.devices.values())


@contextmanager
def master(bench: Bench) -> Iterator[Master]:
    found = Master(bench)
    found.link.open()
    try:
        for device in found.devices.values():
            device.open()
        yield found
    finally:
        for device in found.devices.values():
            device.close()
        found.link.close()


def test_packets_are_accesses(bench: Bench) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as peer:
        peer.settimeout(MAX_STALL_S)
        peer.connect(str(bench.path))
        peer.send(struct.pack("=BBHI", 2, 0, 0x54, 0))
        assert peer.recv(99) == struct.pack("=I", 0x024006C0)
        peer.send(struct.pack("=BBHI", 3, 0, 0x54, 0x064006C0))
        peer.send(struct.pack("=BBHI", 1, 2, 0x22, 0x3000))
        peer.send(b"\x09\x00\x00\x00\x00\x00\x00\x00")
        peer.send(b"short")
        peer.send(struct.pack("=BBHI", 0, 2, 0x10, 0))
        assert peer.recv(99) == struct.pack("=I", 0b111), "three drives are ready, no one-shot"
        state = bench.state()
    assert (state["da1"], state["malformed"], state["accesses"]) == (5.0, 2, 4)
    assert bench.wait_for(lambda state: state["masters"] == 0)


def test_the_rig_file_drives_the_rig(bench: Bench) -> None:
    with master(bench) as rig:
        assert [driver.preflight() for driver in rig.devices.values()] == [[], (), (), (), [], []]
        rig.arm()
        rig.setpoints["wheel_servo"] = (1.0,)
        rig.setpoints["longitudinal_belt"] = (0.0, 0.0)
        began = time.monotonic()
        rows = rig.cycle()
        while rows["carriage"][0] < 0.05:
            assert time.monotonic() - began < MAX_STALL_S
            rows = rig.cycle()
        assert rows["wheel_servo"][0] == pytest.approx(1.0, abs=0.1), "sign and scale are right"
        assert rows["wheel_encoder"][0] * 0.05 > rows["carriage"][0], "the wheel slips forward"
        assert rows["longitudinal_belt"][0] == pytest.approx(rows["carriage"][0], abs=2e-3)
        state = bench.state()
        assert state["wheel_demand"] == pytest.approx(1.0, abs=1e-3)
        assert state["safe_since_ns"] == 0
        truth = bench.ask(lambda: list(bench.plant.readings))[layout.TRUTH_READINGS]
        assert truth > 0.05
        for device in rig.devices.values():
            device.make_safe()
        state = bench.state()
        assert not state["enabled"]
        assert state["safe_since_ns"] > 0


def test_every_drive_of_rig_file_proves_its_watchdog(brief: Bench) -> None:
    with master(brief) as rig:
        drives = [device for device in rig.devices.values() if device.watchdog_s is not None]
        assert len(drives) == 3
        for drive in drives:
            assert drive.prove_watchdog() > 0.9 * BRIEF_S
            assert not brief.state()["enabled"]


def test_after_master_dies_one_shot_stops_drives(
    brief: Bench,
) -> None:
    rig = Master(brief)
    rig.link.open()
    for device in rig.devices.values():
        device.open()
    rig.arm()
    rig.setpoints["wheel_servo"] = (1.0,)
    rig.cycle()
    died_ns = time.monotonic_ns()
    state = brief.wait_for(lambda state: not state["enabled"] and state["safe_since_ns"])
    assert state["da0"] == pytest.approx(5.0, abs=2e-3), "the card has no watchdog"
    assert state["lines"] & 1, "nor lets go of the enable line"
    assert state["safe_since_ns"] - died_ns > 0.8e9 * BRIEF_S
    assert not state["one_shot"]
    with pytest.raises(DeviceError, match="one-shot dropped"):
        rig.cycle()
    rescuer = Master(brief)
    rescuer.devices["wheel_servo"].rescue()
    state = brief.state()
    assert (state["da0"], state["lines"] & 0b11111) == (0.0, 0)
    rig.link.close()


def test_one_shot_that_never_drops_prevents_arming(brief: Bench) -> None:
    brief.ask(lambda: brief.part.inject("one_shot_dead"))
    with master(brief) as rig, pytest.raises(DeviceError, match="one-shot was still up"):
        rig.devices["wheel_servo"].prove_watchdog()


@pytest.mark.parametrize(
    ("fault", "options", "message"),
    [
        ("eolc_stuck", {}, "converter has not finished 5 inputs"),
        ("fifo_short", {"words": 1}, "input 7 reads .* wired to 5 V"),
        ("card_removed", {}, "is gone"),
        ("saturation", {"input": 7}, "input 7 reads"),
        ("drive_fault", {"drive": "wheel"}, "the drive is not ready any more"),
    ],
)
def test_faults_at_the_bench_reach_the_operator(
    bench: Bench, fault: str, options: dict[str, Any], message: str
) -> None:
    with master(bench) as rig:
        rig.arm()
        bench.ask(lambda: bench.part.inject(fault, **options))
        with pytest.raises((DeviceError, LinkError), match=message):
            rig.cycle()
        bench.ask(bench.part.clear)
        assert not bench.ask(lambda: bench.wiring.drives["wheel"].faulty)


def test_faults_it_does_not_know(bench: Bench) -> None:
    with pytest.raises(ValueError, match=r"'smoke'.* eolc_stuck, .*one_shot_dead"):
        bench.part.inject("smoke")
    with pytest.raises(ValueError, match=r"'drive_fault' .*'gantry'"):
        bench.part.inject("drive_fault", drive="gantry")
    assert set(bench.part.faults) > {"eolc_stuck", "one_shot_dead"}


def test_name_in_use_is_reported(bench: Bench) -> None:
    second = SimMf624("card", bench.path, bench.card, bench.wiring)
    with pytest.raises(OSError, match="in use"), serving(second):
        pass


def test_a_card_that_stops_serving_is_noticed(bench: Bench) -> None:
    rig = Master(bench)
    rig.link.open()
    rig.devices["wheel_servo"].open()
    rig.link.begin(0)
    asyncio.run_coroutine_threadsafe(bench.part.stop(), bench.loop).result(MAX_STALL_S)
    with pytest.raises(LinkError, match="does not answer"):
        rig.link.begin(0)
    with pytest.raises(LinkError, match="does not answer"):
        rig.devices["wheel_servo"].make_safe()
    with pytest.raises(LinkError, match="does not answer"):
        rig.link.close()
    rig.link.close()
    assert not bench.path.exists()

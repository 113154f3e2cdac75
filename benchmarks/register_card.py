"""CPU of one cycle on the register card: link and devices of ``configs/card_lugre.yaml``.

The same cycle of five analogue inputs, four encoders, three outputs and six devices, three ways:

* on memory: a plain mapped file in place of the card, what rigd itself costs. A real card adds its
  bus: some 25 accesses of 0.1 us (written) to 1 us (read) each;
* on the simulated registers, without physics;
* on the simulated rig, plant and all, in this process: what the 4 kHz run is made of.

Beside them, in every round, the bare accesses of that cycle on the mapped file, with nothing around
them: as little as Python can do. CPU time of this thread, interleaved, medians of rounds.

    python benchmarks/register_card.py
"""

from __future__ import annotations

import mmap
import os
import statistics
import tempfile
import time
from collections.abc import Callable

from figures import at_most, noted

from rigd.config.loader import load_rig
from rigd.sdk import Driver
from rigd_drivers.cards.mf624.access import MappedRegisters, RegIO
from rigd_drivers.cards.mf624.link import Mf624, Mf624Config
from rigd_drivers.cards.mf624.registers import volts_of
from rigd_sim.lugre.card import LugreWiring
from rigd_sim.lugre.plant import LugreConfig, LugrePlant
from rigd_sim.wire.cards.mf624_registers import Mf624Registers, Wires

CYCLES = 4000  # one second of the rig
ROUNDS = 15
PERIOD_US = 250.0
TARGET_US = PERIOD_US / 10  # of rigd itself; the rest is for engine, recording and the card
GPIOC, ADSTART, DIO = (0, 0x54), (2, 0x20), (2, 0x10)
INPUTS = 0b10001111
SETPOINTS = {
    "wheel_servo": (0.3,),
    "longitudinal_belt": (0.0, 1.0),
    "lateral_belt": (0.0, 1.0),
}


class BenchCard(Mf624):
    """The link on given registers."""

    def __init__(self, config: Mf624Config, io: RegIO) -> None:
        super().__init__(config)
        self._given = io

    def connect(self, *, alone: bool) -> RegIO:
        """Return the given registers."""
        return self._given


def card_config() -> Mf624Config:
    """Return the options of the card in the rig file."""
    config = load_rig("card-lugre").links["card"].config
    assert isinstance(config, Mf624Config)
    return config


def config_on_memory() -> Mf624Config:
    """Return the same for memory, which answers a read by what was written there last.

    An input reads the mask of inputs; a digital input reads the output, such as the enable line.
    """
    config = card_config()
    assert config.reference is not None
    assert config.one_shot is not None
    reference = config.reference.model_copy(update={"voltage": volts_of(INPUTS)})
    one_shot = config.one_shot.model_copy(update={"input": 0})
    return config.model_copy(update={"reference": reference, "one_shot": one_shot})


def cycle_on(io: RegIO, config: Mf624Config) -> Callable[[], None]:
    """Return one cycle of the rig file's link and devices on ``io``."""
    rig = load_rig("card-lugre")
    link = BenchCard(config, io)
    devices: list[Driver] = []
    writers: list[tuple[Driver, tuple[float, ...]]] = []
    link.open()
    for name, setup in rig.devices.items():
        device = setup.driver_class(setup.config, link)
        assert isinstance(device, Driver)
        device.open()
        devices.append(device)
        if name in SETPOINTS:
            writers.append((device, SETPOINTS[name]))

    def cycle() -> None:
        now = time.monotonic_ns()
        link.begin(now)
        for device in devices:
            device.read(now)
        for device, setpoints in writers:
            device.write(setpoints)
        link.end(now)

    cycle()
    for device in devices:
        device.arm()
    return cycle


def bare_accesses(io: RegIO) -> Callable[[], None]:
    """Return the accesses of that cycle alone."""

    def accesses() -> None:
        io.w16((2, 0x00), INPUTS)
        io.r16(ADSTART)
        for encoder in (0x70, 0x74, 0x78, 0x7C, 0x6C):
            io.r32((4, encoder))
        io.r16(DIO)
        io.r32(GPIOC)
        for _ in range(5):
            io.r16((2, 0x00))
        io.w32(GPIOC, 0x06C006C0)
        for output in (0x20, 0x22, 0x24):
            io.w16((2, output), 0x2000)
        io.w32(GPIOC, 0x064006C0)
        io.w16(DIO, 0)

    return accesses


def per_cycle_us(cycle: Callable[[], None]) -> float:
    """Return the CPU time of a cycle in us."""
    began = time.thread_time_ns()
    for _ in range(CYCLES):
        cycle()
    return (time.thread_time_ns() - began) / CYCLES / 1e3


def memory() -> MappedRegisters:
    """Return registers that are a plain file, its outputs driven and nothing converting."""
    with tempfile.TemporaryFile() as file:
        os.ftruncate(file.fileno(), 3 * mmap.PAGESIZE)
        return MappedRegisters(os.dup(file.fileno()))


def simulated_rig() -> Mf624Registers:
    """Return the registers of the rig, its one-shot up while the others have their turn."""
    plant = LugrePlant(LugreConfig(), period_ns=250_000, seed=1)
    return Mf624Registers(LugreWiring(plant, one_shot_s=60.0).wires())


def main() -> None:
    """Measure all in turn and print their figures."""
    wires = Wires(lines_in=lambda: 0xFF, volts_in={7: lambda: 5.0})
    cycles = {
        "bare accesses on memory": bare_accesses(memory()),
        "rigd on memory": cycle_on(memory(), config_on_memory()),
        "rigd on registers": cycle_on(Mf624Registers(wires), card_config()),
        "rigd on the simulated rig": cycle_on(simulated_rig(), card_config()),
    }
    for cycle in cycles.values():
        per_cycle_us(cycle)
    times: dict[str, list[float]] = {name: [] for name in cycles}
    for _ in range(ROUNDS):
        for name, cycle in cycles.items():
            times[name].append(per_cycle_us(cycle))
    medians = {name: statistics.median(values) for name, values in times.items()}
    for name, value in medians.items():
        print(f"{name:<27}{value:7.1f} us a cycle  min {min(times[name]):6.1f}")
    at_most("register card, link and devices", medians["rigd on memory"], TARGET_US, "us a cycle")
    noted("register card, bare accesses", medians["bare accesses on memory"], "us a cycle")
    noted("register card, simulated rig", medians["rigd on the simulated rig"], "us a cycle")


if __name__ == "__main__":
    main()

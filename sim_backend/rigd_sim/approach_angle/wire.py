"""Serves the simulated approach-angle rig over real protocols: NI card, relay and scale."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Final, Literal, Self

import numpy as np
from annotated_types import Gt, Le
from numpy.typing import NDArray
from pydantic import model_validator

from rigd.sdk import In, SimulationConfig, wrong_entry
from rigd_sim.approach_angle import layout
from rigd_sim.approach_angle.acquisition import Acquisition
from rigd_sim.approach_angle.plant import AngleConfig, AnglePlant
from rigd_sim.approach_angle.wire_relay import SimRelay
from rigd_sim.approach_angle.world import AngleWorld
from rigd_sim.wire.cards.ni import SimNi
from rigd_sim.wire.cards.ni_card import Span
from rigd_sim.wire.cards.ni_lines import Lines
from rigd_sim.wire.folder import Folder
from rigd_sim.wire.instruments.scale import SimScale
from rigd_sim.wire.part import Part
from rigd_sim.wire.service import PLANT_PERIOD_NS, WirePlantConfig, WirePlantSimulation, World

#: Samples that the card converts at a time: as many as are due within a step of its part.
CONVERTED: Final = 8
#: The plant's scale filters by itself; the device that shows it does so at once.
AT_ONCE_S: Final = 1e-3

FloatArray = NDArray[np.float64]


class OneShotOptions(SimulationConfig):
    """The one-shot between computer and relay."""

    line: str = "port0/line1"
    """Line that triggers it."""
    feedback: str = "port0/line2"
    """Line that it drives: high while it is up."""
    time: Annotated[float, In("s"), Gt(0), Le(1)] = 0.18
    """How long it stays up after an edge."""


class CardOptions(SimulationConfig):
    """The NI card behind NI's device server (gRPC), and what is wired to it."""

    address: str = "127.0.0.1:31764"
    """host:port where the device server is reached."""
    device: str = "Dev1"
    """Name of the card."""
    gauge_a: str = "ai0"
    """Input of the gauge at +45 degrees."""
    gauge_b: str = "ai1"
    """Input of the gauge at -45 degrees."""
    wheel_angle: str = "ai2"
    """Input of the wheel's potentiometer."""
    platform_position: str = "ai3"
    """Input of the platform's potentiometer."""
    normal_force: str = "ai4"
    """Input of the load cell; a task without it has no such fifth input."""

    @property
    def inputs(self) -> Mapping[str, int]:
        """Inputs -> number of what is wired to them, as ``layout.SIGNALS`` counts."""
        return {getattr(self, name): number for number, name in enumerate(layout.SIGNALS)}

    @model_validator(mode="after")
    def _inputs_are_distinct(self) -> Self:
        if len(self.inputs) < len(layout.SIGNALS):
            raise wrong_entry(
                "two sensors are wired to the same input; give each its own", "inputs"
            )
        return self


class RelayOptions(SimulationConfig):
    """The relay on the card's lines."""

    line: str = "port0/line0"
    """Line of its coil."""
    active: Literal["high", "low"] = "low"
    """Level at which the coil has current."""
    one_shot: OneShotOptions | None = OneShotOptions()
    """The one-shot in series with it; null: there is none."""


class ScaleOptions(SimulationConfig):
    """The scale under the rig's base, on a serial port."""

    port: str = "scale"
    """Name of the port in the folder."""
    dialect: Literal[
        "mt-sics", "kern-kcp", "and-d", "and-d-indicator", "sartorius-sbi", "ohaus"
    ] = "mt-sics"
    """Its protocol."""
    baud: int = 9600
    """Its baud rate."""


class WireAngleConfig(WirePlantConfig):
    """The addresses of the simulated devices, their plant, and the options of each device."""

    plant: AngleConfig = AngleConfig()
    """The physics."""
    daq: CardOptions = CardOptions()
    """The NI card."""
    relay: RelayOptions = RelayOptions()
    """The relay between supply and motor."""
    scale: ScaleOptions = ScaleOptions()
    """The scale."""


class WireAngle(WirePlantSimulation):
    """Serves the devices of the approach-angle rig, and a control socket beside them."""

    Config: ClassVar[type[SimulationConfig]] = WireAngleConfig
    title: ClassVar[str] = "the approach-angle rig at the wire: NI card, relay and scale"
    config: WireAngleConfig

    def build(self, folder: Folder) -> tuple[World, Sequence[Part]]:
        """Return the plant in real time and every device; see :class:`WireSimulation`."""
        config = self.config
        relay, one_shot = config.relay, config.relay.one_shot
        plant = AnglePlant(config.plant, period_ns=PLANT_PERIOD_NS, seed=config.seed)
        world = AngleWorld(plant, None if one_shot is None else one_shot.time)
        outputs = {relay.line: lambda high: world.ask(closed=high == (relay.active == "high"))}
        inputs = {}
        if one_shot is not None:
            outputs[one_shot.line] = lambda high: world.trigger(level=high)
            inputs[one_shot.feedback] = world.one_shot_up
        wired = config.daq.inputs

        def sample(spans: Mapping[str, Span], rate_hz: float, start_ns: int) -> Sampled:
            return Sampled(world, [wired.get(name) for name in spans], rate_hz, start_ns)

        card = SimNi(
            "daq", {name: _volts(world, number) for name, number in wired.items()},
            address=config.daq.address, device=config.daq.device, drift_ppm=0.0,
            lines=Lines(inputs, outputs), sample=sample, serial=config.plant.individual,
        )  # fmt: skip
        where = f"{relay.line} of {config.daq.device}"
        return world, [card, SimRelay("relay", world, where), self._scale(folder, world)]

    def _scale(self, folder: Folder, world: AngleWorld) -> Part:
        options, physical = self.config.scale, world.plant.parameters.scale

        def mass() -> float:
            world.now()
            shown, _ = world.plant.scale()
            return 0.0 if math.isnan(shown) else shown  # it has just been switched on

        return SimScale(
            "scale", folder.socket(options.port), mass, dialect=options.dialect,
            baud=options.baud, capacity_kg=physical.capacity, division_kg=physical.division,
            noise_kg=0.0, settling_s=AT_ONCE_S, seed=self.config.seed,
            rests=lambda: bool(world.plant.scale()[1] & layout.STABLE),
        )  # fmt: skip


class Sampled:
    """The plant's own samples of a task: with noise, skew and conversion.

    Args:
        world: its plant is sampled.
        signals: number of the signal at each input (``layout.SIGNALS``); None: it is open.
        rate_hz: samples of each input per second.
        start_ns: when the clock is started.
    """

    def __init__(
        self, world: AngleWorld, signals: Sequence[int | None], rate_hz: float, start_ns: int
    ) -> None:
        world.now()
        load_cell = layout.SIGNALS.index("normal_force") in signals
        self._world = world
        self._columns = [0 if signal is None else signal for signal in signals]
        self._card = Acquisition(
            world.plant, start_ns=start_ns, rate_hz=rate_hz, block=CONVERTED,
            load_cell=load_cell, latency_s=0.0, jitter_s=0.0,
        )  # fmt: skip

    def due(self, now_ns: int, drift: float) -> FloatArray:
        """Return what fell due; the plant's clock is the card's, so that nothing drifts."""
        self._world.now()
        blocks = []
        while (block := self._card.read()) is not None:
            blocks.append(block.volts[:, self._columns].T)
        return np.hstack(blocks) if blocks else np.zeros((len(self._columns), 0))


def _volts(world: AngleWorld, signal: int) -> Any:
    def volts() -> float:
        world.now()
        return float(world.plant.history[world.plant.steps % layout.HISTORY_ROWS, signal])

    return volts

"""Serves the simulated articulated robot over real protocols: drives on CAN, a tracker on UDP."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal, Self

from annotated_types import Ge, Gt, Le
from pydantic import Field, model_validator

from rigd.model.errors import ConfigError
from rigd.sdk import In, SimulationConfig, wrong_entry
from rigd_sim.articulated import layout
from rigd_sim.articulated.camera import Camera
from rigd_sim.articulated.plant import ArticulatedConfig, ArticulatedPlant
from rigd_sim.wire.can.drive import Cia402Drive, Demand, Mode, Motor, Ratings, Sensed
from rigd_sim.wire.can.hub import CanHub
from rigd_sim.wire.can.options import BusOptions, ServoOptions
from rigd_sim.wire.folder import Folder
from rigd_sim.wire.part import Part, State
from rigd_sim.wire.plant_world import PlantWorld
from rigd_sim.wire.service import PLANT_PERIOD_NS, WirePlantConfig, WirePlantSimulation, World
from rigd_sim.wire.tracker import Poses, SimTracker


class MotorOptions(ServoOptions):
    """The drive of a motor of the robot, and the plate of the motor."""

    module: str = "front"
    """Name of the module in the parameter file."""
    wheel: Literal["front_right", "front_left", "rear_right", "rear_left"]
    """The wheel that the motor turns; of a geared pair either one."""
    counts_per_turn: Annotated[int, Ge(4), Le(2**20)] = 4096
    """Counts of the motor's encoder per turn."""
    nominal_current: Annotated[float, In("A"), Gt(0), Le(100)] = 0.8
    """Nominal current of the motor."""
    torque_constant: Annotated[float, In("N m/A"), Gt(0), Le(10)] = 0.025
    """Torque of the motor per ampere."""


class TrackerOptions(SimulationConfig):
    """The camera over the floor; how it errs is of the plant's parameters."""

    host: str = "127.0.0.1"
    """Where it sends to."""
    port: Annotated[int, Ge(1), Le(65535)] = 31770
    """UDP port where it sends to."""
    jitter: Annotated[float, In("s"), Ge(0), Le(1)] = 0.002
    """A datagram comes up to so much later than the camera's latency, by chance."""
    drift: Annotated[float, Ge(-1000), Le(1000)] = 30.0
    """By how many parts in a million its clock runs fast."""


class WireArticulatedConfig(WirePlantConfig):
    """The addresses of the simulated devices, their plant, and the options of each device."""

    plant: ArticulatedConfig = ArticulatedConfig()
    """The physics."""
    buses: dict[str, BusOptions] = Field(default_factory=lambda: {"drive_bus": BusOptions()})
    """CAN buses by name; each is a socket of that name in the folder."""
    motors: dict[str, MotorOptions] = Field(
        default_factory=lambda: {
            "right_motor": MotorOptions(bus="drive_bus", node=1, wheel="front_right"),
            "left_motor": MotorOptions(bus="drive_bus", node=2, wheel="front_left"),
        }
    )
    """Drives by the name of their part."""
    tracker: TrackerOptions = TrackerOptions()
    """The camera."""

    @model_validator(mode="after")
    def _buses_exist(self) -> Self:
        for name, motor in self.motors.items():
            if motor.bus not in self.buses:
                raise wrong_entry(
                    f"{name} is on bus {motor.bus!r}; `buses` has {', '.join(self.buses)}",
                    "motors",
                    name,
                    "bus",
                )
        return self


class RobotWorld(PlantWorld[ArticulatedPlant]):
    """The simulated robot that all devices share."""

    def state(self) -> State:
        """Return the hidden state of every module."""
        self.now()
        return {
            f"{module}_{name}": value
            for place, module in enumerate(self.plant.modules)
            for (name, *_), value in zip(layout.TRUTH, self.plant.truth(place), strict=True)
        }


class WireArticulated(WirePlantSimulation):
    """Serves the devices of the articulated robot, and a control socket beside them."""

    Config: ClassVar[type[SimulationConfig]] = WireArticulatedConfig
    title: ClassVar[str] = "the articulated robot at the wire: CAN drives and a camera tracker"
    config: WireArticulatedConfig

    def build(self, folder: Folder) -> tuple[World, Sequence[Part]]:
        """Return the plant in real time and every device; see :class:`WireSimulation`."""
        config = self.config
        plant = ArticulatedPlant(config.plant, period_ns=PLANT_PERIOD_NS, seed=config.seed)
        world = RobotWorld(plant)
        hubs = {
            name: CanHub(name, folder.socket(name), bitrate=bus.bitrate, seed=config.seed + number)
            for number, (name, bus) in enumerate(config.buses.items())
        }
        drives = [_drive(name, options, world, hubs) for name, options in config.motors.items()]
        return world, [*hubs.values(), *drives, self._tracker(world)]

    def _tracker(self, world: RobotWorld) -> Part:
        options, camera = self.config.tracker, Camera(world.plant)
        physical = world.plant.parameters.camera

        def look(frame: int, ago_s: float) -> Poses:
            world.now()
            at_s = (world.plant.now_ns - world.plant.origin_ns) * 1e-9 - ago_s
            return {
                name: pose and camera.measured(place, frame, pose)
                for place, name in enumerate(world.plant.modules)
                for pose in [camera.true_pose(place, frame, max(0.0, at_s))]
            }

        return SimTracker(
            "tracker", options.host, options.port, look, rate_hz=physical.rate,
            latency_s=physical.latency, jitter_s=options.jitter, drift_ppm=options.drift,
            seed=self.config.seed,
        )  # fmt: skip


def _drive(
    name: str, options: MotorOptions, world: RobotWorld, hubs: Mapping[str, CanHub]
) -> Cia402Drive:
    """Return the drive of a motor; in its safe state the motor has no torque and is not braked.

    Raises:
        ConfigError: the robot has no such motor.

    """
    plant, per_turn = world.plant, options.counts_per_turn / (2 * math.pi)
    try:
        spin = plant.spin_of(options.module, options.wheel)
    except ValueError as error:
        raise ConfigError(f"motors.{name}: {error}") from error

    def sense(t_ns: int) -> Sensed:
        world.at(t_ns)
        speed, torque = plant.motors_at(plant.now_ns)[spin].tolist()
        return Sensed(round(plant.angle_of(spin) * per_turn), speed, torque)

    def command(t_ns: int, demand: Demand) -> None:
        world.at(t_ns)
        plant.commands[spin] = demand.value, float(demand.powered)

    ratings = Ratings(
        Mode.CSV, options.nominal_current,
        plant.torque_limit(spin) / options.torque_constant, options.torque_constant,
        options.counts_per_turn,
    )  # fmt: skip
    return Cia402Drive(
        name, hubs[options.bus], options.node, Motor(sense, command), ratings,
        serial=options.serial, rpdo_timer=options.rpdo_timer, traits=options.profile,
    )  # fmt: skip

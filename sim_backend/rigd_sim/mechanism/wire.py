"""Serves a mechanism that a file describes over real protocols.

Drives on CAN and Modbus, NI cards, and devices that send lines.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, ClassVar, Final, Self

from annotated_types import Ge, Gt, Le
from pydantic import Field, model_validator

from rigd.model.errors import ConfigError
from rigd.model.units import Unit, parse_quantity, parse_unit
from rigd.sdk import In, SimulationConfig, WrongEntries
from rigd_sim.mechanism.network import Element, Kind
from rigd_sim.mechanism.plant import MechanismConfig, MechanismPlant, truth_of
from rigd_sim.wire.can.drive import Cia402Drive, Demand, Mode, Motor, Ratings, Sensed
from rigd_sim.wire.can.hub import CanHub
from rigd_sim.wire.can.options import BusOptions, ServoOptions
from rigd_sim.wire.cards.ni import SimNi
from rigd_sim.wire.cards.ni_card import INPUTS
from rigd_sim.wire.folder import Folder
from rigd_sim.wire.instruments.lines import AnswerOptions
from rigd_sim.wire.modbus.drive_options import ModbusDriveOptions
from rigd_sim.wire.modbus.servo import SimModbusServo
from rigd_sim.wire.part import Part, State
from rigd_sim.wire.plant_world import PlantWorld
from rigd_sim.wire.service import PLANT_PERIOD_NS, WirePlantConfig, WirePlantSimulation, World

#: How much more current than its nominal one a drive gives.
OVERLOAD: Final = 3.0


class ShaftOptions(ServoOptions):
    """A drive of CiA 402 in velocity mode that turns a shaft of the mechanism."""

    drive: str
    """Name of the drive in the file of the mechanism; of mode speed, on a shaft."""
    gear_ratio: Annotated[float, In("1"), Gt(0), Le(1e4)] = 1.0
    """Turns of the motor per turn of the shaft."""
    counts_per_turn: Annotated[float, In("count/rad"), Gt(0), Le(1e8)] = 4096 / (2 * math.pi)
    """Counts of the motor's encoder per turn, such as `4096 count/rev`."""
    rated_torque: Annotated[float, In("N m"), Gt(0), Le(1e4)] | None = None
    """Rated torque on the plate of the motor; by default a third of the largest."""
    torque_constant: Annotated[float, In("N m/A"), Gt(0), Le(10)] = 0.05
    """Torque of the motor per ampere."""


class InputOptions(SimulationConfig):
    """What is at an analogue input."""

    sensor: str
    """Name of the sensor in the file of the mechanism."""
    scale: str
    """The quantity for each volt, such as `5 N/V`."""
    zero: Annotated[float, In("V"), Ge(-100), Le(100)] = 0.0
    """Volts that mean 0 in `unit`."""
    unit: str | None = None
    """A unit with a zero of its own, such as `degC`; by default the sensor's SI unit."""


class CardOptions(SimulationConfig):
    """An NI card of eight analogue inputs, on a device server of its own."""

    address: str = "127.0.0.1:31763"
    """Where it is served, as host:port."""
    device: str = "Dev1"
    """Its name in NI MAX."""
    inputs: dict[str, InputOptions]
    """What is at its inputs, ai0 to ai7."""


class ModbusShaftOptions(ModbusDriveOptions):
    """A speed drive on Modbus whose motor turns a shaft of the mechanism."""

    drive: str
    """Name of the drive in the file of the mechanism; of mode speed, on a shaft."""


class LineValue(SimulationConfig):
    """One number in a line."""

    sensor: str
    """Name of the sensor in the file of the mechanism."""
    unit: str
    """Unit of the number, such as kN or degC, or what 1 means, such as `0.01 N`."""

    @property
    def per_one(self) -> tuple[float, Unit]:
        """What 1 in the line means, in SI, and its unit."""
        found = re.match(r"[-+.\d]\S* ", self.unit)
        given = parse_quantity(self.unit if found else f"1 {self.unit}")
        return given.value - given.unit.offset, given.unit

    def number(self, value: float) -> float:
        """Return the number that stands in the line for ``value``, in SI."""
        scale, unit = self.per_one
        return (value - unit.offset) / scale


class SensorLineOptions(AnswerOptions):
    """A device that sends lines with what sensors of the mechanism measure, on a serial port."""

    values: dict[str, LineValue]
    """The numbers of its line, by name."""

    @model_validator(mode="after")
    def _answer_has_values(self) -> Self:
        self.check_answer(self.values)
        return self


class WireMechanismConfig(WirePlantConfig):
    """The addresses of the simulated devices, their plant, and the options of each device."""

    plant: MechanismConfig = Field(default_factory=MechanismConfig)
    """The physics."""
    buses: dict[str, BusOptions] = Field(default_factory=dict)
    """CAN buses by name; each is a socket of that name in the folder."""
    drives: dict[str, ShaftOptions] = Field(default_factory=dict)
    """Drives on these buses, by the name of their part."""
    cards: dict[str, CardOptions] = Field(default_factory=dict)
    """NI cards, by the name of their part."""
    modbus: dict[str, ModbusShaftOptions] = Field(default_factory=dict)
    """Speed drives on Modbus, by the name of their part."""
    lines: dict[str, SensorLineOptions] = Field(default_factory=dict)
    """Devices that send lines, by the name of their part, which is that of their serial port."""

    @model_validator(mode="after")
    def _the_mechanism_has_them(self) -> Self:
        problems: list[tuple[tuple[str | int, ...], str]] = []
        mechanism = self.plant.mechanism()
        drives = {item.name: item for item in mechanism.drives}
        sensors = {item.name: item for item in mechanism.instruments}
        for name, item in self.drives.items():
            if item.bus not in self.buses:
                words = f"no bus {item.bus!r}; there are {', '.join(self.buses) or 'none'}"
                problems.append((("drives", name, "bus"), words))
        turned = [("drives", name, item.drive) for name, item in self.drives.items()]
        turned += [("modbus", name, item.drive) for name, item in self.modbus.items()]
        for group, name, turns in turned:
            drive = drives.get(turns)
            if drive is None or drive.kind != Kind.SPEED or drive.strain_unit != "rad":
                words = f"the mechanism has no drive {turns!r} of mode speed on a shaft"
                problems.append(((group, name, "drive"), words))
        for name, device in self.lines.items():
            for key, value in device.values.items():
                where = ("lines", name, "values", key)
                sensor = sensors.get(value.sensor)
                if sensor is None:
                    words = f"the mechanism has no sensor {value.sensor!r}"
                    problems.append(((*where, "sensor"), words))
                elif not _counts(value, sensor.unit):
                    words = f"{value.sensor} is in {sensor.unit}, not in {value.unit}"
                    problems.append(((*where, "unit"), words))
        for name, card in self.cards.items():
            for key, entry in card.inputs.items():
                where = ("cards", name, "inputs", key)
                sensor = sensors.get(entry.sensor)
                if key not in INPUTS:
                    problems.append((where, f"no input {key!r}; there are {', '.join(INPUTS)}"))
                elif sensor is None:
                    words = f"the mechanism has no sensor {entry.sensor!r}"
                    problems.append(((*where, "sensor"), words))
                elif not _fits(entry.scale, sensor.unit):
                    words = f"expected a quantity in {sensor.unit}/V, such as '1 {sensor.unit}/V'"
                    problems.append(((*where, "scale"), words))
                elif not _is_of(entry.unit, sensor.unit):
                    words = f"{entry.sensor} is in {sensor.unit}, not in {entry.unit}"
                    problems.append(((*where, "unit"), words))
        if problems:
            raise WrongEntries(problems)
        return self


def _fits(scale: str, unit: str) -> bool:
    try:
        given = parse_quantity(scale)
    except ValueError:
        return False
    return given.value != 0.0 and given.unit.same_kind(parse_unit(f"{unit}/V"))


def _is_of(unit: str | None, kind: str) -> bool:
    try:
        return parse_unit(unit or kind).same_kind(parse_unit(kind))
    except ValueError:
        return False


def _counts(value: LineValue, kind: str) -> bool:
    try:
        scale, unit = value.per_one
    except ValueError:
        return False
    return scale != 0.0 and unit.same_kind(parse_unit(kind))


class MechanismWorld(PlantWorld[MechanismPlant]):
    """The mechanism that all devices share."""

    def state(self) -> State:
        """Return the hidden state."""
        self.now()
        names = (name for name, _, _ in truth_of(self.plant.mechanism))
        return dict(zip(names, self.plant.truth(), strict=True))


class WireMechanism(WirePlantSimulation):
    """Serves the devices of a mechanism, and a control socket beside them."""

    Config: ClassVar[type[SimulationConfig]] = WireMechanismConfig
    title: ClassVar[str] = "a mechanism at the wire: drives on CAN and Modbus, NI cards, lines"
    config: WireMechanismConfig

    def build(self, folder: Folder) -> tuple[World, Sequence[Part]]:
        """Return the plant in real time and every device; see :class:`WireSimulation`."""
        config = self.config
        plant = MechanismPlant(config.plant, period_ns=PLANT_PERIOD_NS, seed=config.seed)
        world = MechanismWorld(plant)
        hubs = {
            name: CanHub(name, folder.socket(name), bitrate=bus.bitrate, seed=config.seed + number)
            for number, (name, bus) in enumerate(config.buses.items())
        }
        drives = [_drive(name, item, world, hubs) for name, item in config.drives.items()]
        cards = [
            SimNi(
                name,
                {key: _volts(entry, world) for key, entry in card.inputs.items()},
                address=card.address,
                device=card.device,
                seed=config.seed,
            )
            for name, card in config.cards.items()
        ]
        speed_drives = [_modbus(name, item, world, folder) for name, item in config.modbus.items()]
        senders = [
            item.part(name, folder.socket(name), _numbers(item, world), config.seed)
            for name, item in config.lines.items()
        ]
        return world, [*hubs.values(), *drives, *cards, *speed_drives, *senders]


def _numbers(item: SensorLineOptions, world: MechanismWorld) -> Callable[[], Mapping[str, float]]:
    places = {
        name: (value, world.plant.mechanism.instrument(value.sensor))
        for name, value in item.values.items()
    }

    def numbers() -> Mapping[str, float]:
        world.now()
        readings = world.plant.readings
        return {name: value.number(readings[place]) for name, (value, place) in places.items()}

    return numbers


def _volts(entry: InputOptions, world: MechanismWorld) -> Callable[[], float]:
    place = world.plant.mechanism.instrument(entry.sensor)
    scale = parse_quantity(entry.scale).value
    zero = entry.zero - parse_unit(entry.unit or "1").offset / scale

    def volts() -> float:
        world.now()
        return world.plant.readings[place] / scale + zero

    return volts


def _drive(
    name: str, options: ShaftOptions, world: MechanismWorld, hubs: Mapping[str, CanHub]
) -> Cia402Drive:
    """Return a drive on a shaft; in its safe state the shaft has no torque and is not braked.

    Raises:
        ConfigError: its motor would need more current than a drive can state.
    """
    plant, ratio = world.plant, options.gear_ratio
    element, place, shaft = _shaft(options.drive, world)

    def sense(t_ns: int) -> Sensed:
        world.at(t_ns)
        angle, speed, torque = shaft()
        return Sensed(round(angle * ratio * options.counts_per_turn), speed * ratio, torque / ratio)

    def command(t_ns: int, demand: Demand) -> None:
        world.at(t_ns)
        plant.command(place, demand.value / ratio, enabled=demand.powered)

    most = element.numbers["limit"] / ratio / options.torque_constant
    rated = options.rated_torque
    nominal = most / OVERLOAD if rated is None else rated / options.torque_constant
    counts = round(options.counts_per_turn * 2 * math.pi)
    if not 1e-3 <= nominal <= 4e6:
        raise ConfigError(f"drives.{name}: {nominal:g} A of its motor: check 'torque_constant'")
    ratings = Ratings(Mode.CSV, nominal, most, options.torque_constant, counts)
    return Cia402Drive(
        name, hubs[options.bus], options.node, Motor(sense, command), ratings,
        serial=options.serial, rpdo_timer=options.rpdo_timer, traits=options.profile,
    )  # fmt: skip


def _shaft(
    drive: str, world: MechanismWorld
) -> tuple[Element, int, Callable[[], tuple[float, float, float]]]:
    """Return a drive on a shaft: its element, its place, and its angle, speed and torque (SI)."""
    plant = world.plant
    element: Element = plant.mechanism.element(drive)
    place = [item.name for item in plant.mechanism.drives].index(drive)
    index = plant.mechanism.index[drive]
    (end,) = element.ends
    speeds = len(plant.mechanism.masses) + 1

    def shaft() -> tuple[float, float, float]:
        state = plant.memory.state
        angle = element.offset + end.lever * float(state[end.dof])
        return (
            angle,
            end.lever * float(state[speeds + end.dof]),
            -float(plant.memory.terms["f"][index]),
        )

    return element, place, shaft


def _modbus(
    name: str, options: ModbusShaftOptions, world: MechanismWorld, folder: Folder
) -> SimModbusServo:
    """Return a speed drive on a shaft; disabled, it freewheels: the shaft has no torque of it."""
    _, place, shaft = _shaft(options.drive, world)

    def command(speed: float, enabled: bool) -> None:
        world.now()
        world.plant.command(place, speed, enabled=enabled)

    def speed() -> float:
        world.now()
        return shaft()[1]

    return SimModbusServo(
        name, options.line(name, folder), command=command, speed=speed, unit=options.unit,
        drive=options.make,
    )  # fmt: skip

"""Builds the simulated devices of the LuGre rig from options, and connects them to the plant."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal, Self

from annotated_types import Ge, Gt, Le
from pydantic import Field, ValidationInfo, field_validator, model_validator

from rigd.sdk import In, SimulationConfig, wrong_entry
from rigd_sim.lugre import layout
from rigd_sim.lugre.card import ONE_SHOT_S, LugreWiring
from rigd_sim.lugre.world import World
from rigd_sim.wire.can.dbc import SimDbcSensor
from rigd_sim.wire.can.drive import Cia402Drive, Demand, Mode, Motor, Ratings, Sensed
from rigd_sim.wire.can.encoder import Cia406Encoder, Scale
from rigd_sim.wire.can.hub import CanHub
from rigd_sim.wire.can.options import NodeOptions, ServoOptions
from rigd_sim.wire.can.traits import read_make
from rigd_sim.wire.can.transmitter import Cia404Transmitter
from rigd_sim.wire.cards.labjack import CONNECTIONS, SimLabjack
from rigd_sim.wire.cards.labjack_registers import LabjackRegisters
from rigd_sim.wire.cards.mf624 import SimMf624
from rigd_sim.wire.cards.mf624_registers import Mf624Registers
from rigd_sim.wire.cards.ni import SimNi
from rigd_sim.wire.cards.ni_io import SimNiIo
from rigd_sim.wire.cards.ni_terminals import Terminals
from rigd_sim.wire.folder import Folder
from rigd_sim.wire.instruments.scale import SimScale
from rigd_sim.wire.modbus.drive_options import ModbusDriveOptions
from rigd_sim.wire.modbus.line import TcpLine
from rigd_sim.wire.modbus.servo import SimModbusServo
from rigd_sim.wire.modbus.transmitter import LoadCell, SimModbusTransmitter
from rigd_sim.wire.part import Part


class BeltOptions(ServoOptions):
    """A servo drive on a belt, and the plate of its motor."""

    travel_per_turn: Annotated[float, In("m/rad"), Gt(0)] = 0.1 / (2 * math.pi)
    """Travel of the belt per turn of the motor shaft."""
    counts_per_turn: Annotated[int, Ge(4), Le(2**20)] = 4096
    """Counts of the motor's encoder per turn."""
    nominal_current: Annotated[float, In("A"), Gt(0), Le(100)] = 5.0
    """Nominal current of the motor."""
    torque_constant: Annotated[float, In("N m/A"), Gt(0), Le(10)] = 0.2
    """Torque of the motor per ampere."""


class ModbusBeltOptions(ModbusDriveOptions):
    """A speed drive on Modbus on a belt, without a clutch."""

    travel_per_turn: Annotated[float, In("m/rad"), Gt(0)] = 0.1 / (2 * math.pi)
    """Travel of the belt per turn of the motor shaft."""


class EncoderOptions(NodeOptions):
    """An absolute encoder; the plant's sensors set its counts per turn."""

    turns: Annotated[int, Ge(1), Le(0xFFFF)] = 4096
    """Turns that it counts; its position then starts again."""
    start: Annotated[int, Ge(0)] = 1000
    """Counts that it shows when the rig is switched on."""


class CardOptions(SimulationConfig):
    """An NI card behind NI's device server (gRPC), with the accelerometer on one input."""

    address: str = "127.0.0.1:31763"
    """host:port where the device server is reached."""
    device: str = "Dev1"
    """Name of the card."""
    channel: str = "ai0"
    """Input of the accelerometer."""
    drift: float = 40.0
    """By how many parts in a million its clock runs fast."""


class TransmitterOptions(SimulationConfig):
    """A load-cell transmitter on Modbus TCP, between the floor and the bench."""

    host: str = "127.0.0.1"
    """Address where it is reached."""
    port: Annotated[int, Ge(1), Le(65535)]
    """TCP port where it is reached."""
    instrument: str = "laumas-tlb4"
    """Which transmitter: laumas-tlb4, seneca-z-sg2, tuna-id551."""
    unit: Annotated[int, Ge(0), Le(255)] = 1
    """Its unit address."""
    capacity: Annotated[float, In("N"), Gt(0)] = 200.0
    """Largest force of the cell."""
    resolution: Annotated[float, In("N/count"), Gt(0)] = 0.01
    """Force per count."""
    noise: Annotated[float, In("N"), Ge(0)] = 0.02
    """Standard deviation of a conversion."""
    filter: Annotated[float, In("s"), Ge(0)] = 0.01
    """Time constant of its filter."""


class ScaleOptions(SimulationConfig):
    """A scale on a serial port."""

    port: str = "scale"
    """Name of the port in the folder."""
    dialect: Literal[
        "mt-sics", "kern-kcp", "and-d", "and-d-indicator", "sartorius-sbi", "ohaus"
    ] = "mt-sics"
    """Its protocol."""
    baud: int = 9600
    """Its baud rate."""
    unit: str = "kg"
    """The unit it shows."""


class RegisterCardOptions(SimulationConfig):
    """An MF624 with the whole rig wired to it, as ``configs/card_lugre.yaml`` has it."""

    socket: str = "card"
    """Name in the folder of the socket where its registers are reached."""
    one_shot: Annotated[float, In("s"), Gt(0), Le(1)] = ONE_SHOT_S
    """How long the one-shot on the enable lines stays up."""


class NiCardOptions(SimulationConfig):
    """A multifunction NI card with the whole rig wired to it, as ``configs/ni_lugre.yaml`` has it.

    Its digital outputs are port0/line0 to 7, its digital inputs port0/line8 to 15.
    """

    address: str = "127.0.0.1:31765"
    """host:port where its device server is reached."""
    device: str = "Dev1"
    """Name of the card."""
    one_shot: Annotated[float, In("s"), Gt(0), Le(1)] | None = None
    """How long a one-shot on the enable lines stays up; without it they come from the card, whose
    watchdog timer guards them."""
    guards_volts: bool = True
    """Whether that timer can act on analogue outputs, too."""


class LabjackOptions(SimulationConfig):
    """A LabJack T7 with the rig wired to it, as ``configs/labjack_lugre.yaml`` has it.

    An LJTick-DAC on FIO4 and FIO5 gives the set values of wheel and longitudinal belt (TDAC4,
    TDAC5). Encoders are on FIO0, FIO2 and FIO6 (wheel, guide, longitudinal belt). EIO0 to 7 are the
    digital outputs, CIO0 to 3 the digital inputs; EIO7 is wired to CIO3.
    """

    host: str = "127.0.0.1"
    """Address where it is reached."""
    port: Annotated[int, Ge(0), Le(65535)] = 31766
    """TCP port where it is reached."""
    serial: Annotated[int, Ge(1), Le(0xFFFFFFFF)] = 470012345
    """Its serial number."""


class CanSensorOptions(SimulationConfig):
    """A sensor that sends a message of a DBC file by itself, with values that stand still."""

    bus: str
    """The bus of `buses` that it is on."""
    dbc: str
    """The DBC file, beside the rig file."""
    message: str
    """Name of the message in it."""
    values: dict[str, float]
    """Value of every signal of the message, in the unit of the DBC."""
    rate: Annotated[float, In("Hz"), Gt(0), Le(1000)] = 100.0
    """Frames per second."""

    @field_validator("dbc")
    @classmethod
    def _is_there(cls, name: str, info: ValidationInfo) -> str:
        path = Path((info.context or {}).get("folder") or Path.cwd()) / name
        if not path.is_file():
            raise ValueError(f"there is no file {path}")
        return str(path.resolve())


@dataclass(frozen=True)
class Bench:
    """The shared objects from which the parts are built."""

    world: World
    buses: Mapping[str, CanHub]
    folder: Folder
    seed: int


def _wheel_servo(name: str, options: ServoOptions, bench: Bench) -> Part:
    world, drive = bench.world, bench.world.plant.parameters.drive
    sensors = world.plant.parameters.sensors
    torque_per_volt = drive.torque_constant / sensors.current_monitor.sensitivity

    def sense(t_ns: int) -> Sensed:
        readings = world.at(t_ns)
        return Sensed(
            round(readings[layout.MOTOR_COUNTS]),
            readings[WHEEL_SPEED] * drive.gear_ratio,
            readings[layout.CURRENT_VOLTS] * torque_per_volt,
        )

    def command(t_ns: int, demand: Demand) -> None:
        world.command(t_ns, layout.WHEEL_CURRENT, demand.value, float(demand.powered))

    ratings = Ratings(
        Mode.CST, drive.rated_current, drive.current_limit, drive.torque_constant,
        counts_per_turn=round(sensors.motor_counts * 2 * math.pi),
    )  # fmt: skip
    return Cia402Drive(
        name, bench.buses[options.bus], options.node, Motor(sense, command), ratings,
        serial=options.serial, rpdo_timer=options.rpdo_timer, traits=options.profile,
    )  # fmt: skip


def _belt(commands: int, readings: int, force_limit: Callable[[World], float]) -> Builder:
    def build(name: str, options: BeltOptions, bench: Bench) -> Part:
        world, lever = bench.world, options.travel_per_turn
        counts_per_metre = options.counts_per_turn / (2 * math.pi * lever)

        def sense(t_ns: int) -> Sensed:
            position, speed, force = world.at(t_ns)[readings : readings + 3]
            return Sensed(round(position * counts_per_metre), speed / lever, force * lever)

        def command(t_ns: int, demand: Demand) -> None:
            # Without power the clutch, spring-applied, holds the belt at the braked motor.
            engaged = float(not demand.released)
            world.command(t_ns, commands, demand.value * lever, engaged)

        ratings = Ratings(
            Mode.CSV, options.nominal_current,
            force_limit(world) * lever / options.torque_constant,
            options.torque_constant, options.counts_per_turn, lever,
        )  # fmt: skip
        return Cia402Drive(
            name, bench.buses[options.bus], options.node, Motor(sense, command), ratings,
            serial=options.serial, rpdo_timer=options.rpdo_timer, traits=options.profile,
        )  # fmt: skip

    return build


def _modbus_belt(name: str, options: ModbusBeltOptions, bench: Bench) -> Part:
    world, lever = bench.world, options.travel_per_turn

    def command(speed: float, enabled: bool) -> None:
        world.command(time.monotonic_ns(), layout.LATERAL_COMMANDS, speed * lever, 1.0)

    return SimModbusServo(
        name, options.line(name, bench.folder), command=command,
        speed=lambda: world.now()[layout.BRIDGE_READINGS + 1] / lever, unit=options.unit,
        drive=options.make,
    )  # fmt: skip


def _encoder(name: str, options: EncoderOptions, bench: Bench, reading: int, scale: Scale) -> Part:
    world = bench.world
    return Cia406Encoder(
        name, bench.buses[options.bus], options.node, lambda t_ns: world.at(t_ns)[reading], scale,
        serial=options.serial,
    )  # fmt: skip


def _wheel_encoder(name: str, options: EncoderOptions, bench: Bench) -> Part:
    per_turn = round(bench.world.plant.parameters.sensors.motor_counts * 2 * math.pi)
    gear = bench.world.plant.parameters.drive.gear_ratio
    scale = Scale(per_turn, options.turns, options.start, "angle", 2 * math.pi / per_turn / gear)
    return _encoder(name, options, bench, layout.MOTOR_COUNTS, scale)


def _carriage(name: str, options: EncoderOptions, bench: Bench) -> Part:
    per_count = bench.world.plant.parameters.sensors.guide_resolution
    scale = Scale(GUIDE_COUNTS_PER_TURN, options.turns, options.start, "position", per_count)
    return _encoder(name, options, bench, layout.GUIDE_COUNTS, scale)


def _cell(name: str, options: NodeOptions, bench: Bench) -> Part:
    return Cia404Transmitter(
        name, bench.buses[options.bus], options.node,
        lambda t_ns: bench.world.at(t_ns)[TRACTION], unit=NEWTON, serial=options.serial,
    )  # fmt: skip


def _scale(name: str, options: ScaleOptions, bench: Bench) -> Part:
    return SimScale(
        name, bench.folder.socket(options.port), lambda: bench.world.plant.mass,
        dialect=options.dialect, baud=options.baud, unit=options.unit, seed=bench.seed,
    )  # fmt: skip


def _accelerometer(name: str, options: CardOptions, bench: Bench) -> Part:
    volts = {options.channel: bench.world.reading(layout.ACCELERATION_VOLTS)}
    return SimNi(
        name, volts, address=options.address, device=options.device, drift_ppm=options.drift,
        seed=bench.seed,
    )  # fmt: skip


def _card(name: str, options: RegisterCardOptions, bench: Bench) -> Part:
    world = bench.world
    wiring = LugreWiring(world.plant, one_shot_s=options.one_shot, advance=world.at)
    registers = Mf624Registers(wiring.wires())
    return SimMf624(name, bench.folder.socket(options.socket), registers, wiring)


def _ni_card(name: str, options: NiCardOptions, bench: Bench) -> Part:
    world = bench.world
    wiring = LugreWiring(world.plant, one_shot_s=options.one_shot, advance=world.at)
    lines = [f"port0/line{number}" for number in range(16)]
    terminals = Terminals(wiring.wires(), lines[:8], lines[8:], guards_volts=options.guards_volts)
    return SimNiIo(name, terminals, wiring, address=options.address, device=options.device)


def _labjack(name: str, options: LabjackOptions, bench: Bench) -> Part:
    world = bench.world
    wiring = LugreWiring(world.plant, one_shot_s=None, advance=world.at)
    registers = labjack_of(wiring, serial=options.serial)
    return SimLabjack(name, TcpLine(options.host, options.port, CONNECTIONS), registers, wiring)


def labjack_of(wiring: LugreWiring, *, serial: int = 470012345) -> LabjackRegisters:
    """Return a T7 with the rig wired to it as :class:`LabjackOptions` states."""
    return LabjackRegisters(
        wiring.wires(),
        lines_out={line: line - 8 for line in range(8, 16)},
        lines_in={16: 0, 17: 1, 18: 2, 19: 7},
        volts_out={"TDAC4": 0, "TDAC5": 1},
        counters={0: 0, 2: 1, 6: 2},
        serial=serial,
    )


def _traction(name: str, options: TransmitterOptions, bench: Bench) -> Part:
    cell = LoadCell(
        bench.world.reading(TRACTION),
        capacity=options.capacity, resolution=options.resolution, noise=options.noise,
        filter_s=options.filter, seed=bench.seed,
    )  # fmt: skip
    line = TcpLine(options.host, options.port)
    return SimModbusTransmitter(name, line, cell, unit=options.unit, instrument=options.instrument)


#: ``build(name, options, bench)`` makes the part of that name.
Builder = Callable[..., Part]
#: Of the measuring wheel on the guide.
GUIDE_COUNTS_PER_TURN: Final = 4096
WHEEL_SPEED: Final = layout.READINGS.index("wheel_speed")
TRACTION: Final = layout.READINGS.index("traction_force")
#: Code of N in object 6131 (CiA 303-2).
NEWTON: Final = 0x0021_0000

#: Every device that the bench can show: the key of its options, and what builds it.
BUILDERS: Final[Mapping[str, Builder]] = {
    "wheel_servo": _wheel_servo,
    "longitudinal_belt": _belt(
        layout.BELT_COMMANDS,
        layout.BELT_READINGS,
        lambda world: world.plant.parameters.belts.longitudinal.force_limit,
    ),
    "lateral_belt": _belt(
        layout.LATERAL_COMMANDS,
        layout.BRIDGE_READINGS,
        lambda world: world.plant.parameters.belts.lateral.force_limit,
    ),
    "lateral_drive": _modbus_belt,
    "wheel_encoder": _wheel_encoder,
    "carriage": _carriage,
    "accelerometer": _accelerometer,
    "traction": _traction,
    "cell": _cell,
    "scale": _scale,
    "card": _card,
    "ni_card": _ni_card,
    "labjack": _labjack,
}


class DeviceOptions(SimulationConfig):
    """The devices of the bench; `null` leaves one out."""

    wheel_servo: ServoOptions | None = ServoOptions(bus="servo_bus", node=1)
    """Servo drive of the wheel, current mode."""
    longitudinal_belt: BeltOptions | None = BeltOptions(bus="servo_bus", node=2)
    """Servo drive along the guide, speed mode, with a clutch."""
    lateral_belt: BeltOptions | None = BeltOptions(bus="servo_bus", node=3)
    """Servo drive across the guide, speed mode, with a clutch."""
    lateral_drive: ModbusBeltOptions | None = None
    """Speed drive on Modbus that moves the bridge in place of `lateral_belt`."""
    wheel_encoder: EncoderOptions | None = EncoderOptions(bus="encoder_bus", node=11, turns=16384)
    """Encoder on the shaft of the wheel's motor."""
    carriage: EncoderOptions | None = EncoderOptions(bus="encoder_bus", node=12)
    """Encoder of the measuring wheel on the guide."""
    accelerometer: CardOptions | None = CardOptions()
    """NI card with the accelerometer of the carriage."""
    traction: TransmitterOptions | None = None
    """Load cell that measures the force of the floor on the wheel, on a Modbus transmitter."""
    cell: NodeOptions | None = None
    """The same on a CiA 404 transmitter, which counts 0.01 N."""
    scale: ScaleOptions | None = ScaleOptions()
    """Scale on which the quarter model rests, with its weights."""
    card: RegisterCardOptions | None = None
    """Register card that drives the rig in place of the three servo drives."""
    can_sensors: dict[str, CanSensorOptions] = Field(default_factory=dict)
    """Sensors that send messages of DBC files on a bus, by name."""
    ni_card: NiCardOptions | None = None
    """NI card that drives the rig in place of the three servo drives."""
    labjack: LabjackOptions | None = None
    """LabJack that drives wheel and longitudinal belt in place of the three servo drives."""

    @model_validator(mode="after")
    def _one_drive_per_axis(self) -> Self:
        cards = {"card": self.card, "ni_card": self.ni_card, "labjack": self.labjack}
        given = [name for name, options in cards.items() if options is not None]
        card = cards[given[0]] if given else None
        if len(given) > 1:
            raise wrong_entry(
                f"one card drives the rig: remove `{given[0]}` or `{given[1]}`", given[1]
            )
        for name in ("wheel_servo", "longitudinal_belt", "lateral_belt"):
            if card is not None and getattr(self, name) is not None:
                raise wrong_entry(f"the card drives the rig already; write '{name}: null'", name)
        if self.lateral_drive is not None and (self.lateral_belt or card) is not None:
            raise wrong_entry(
                "`lateral_drive` drives the bridge; write 'lateral_belt: null'", "lateral_belt"
            )
        return self


def build_parts(options: DeviceOptions, bench: Bench) -> list[Part]:
    """Return every device that ``options`` name, not yet started."""
    devices = [
        build(name, found, bench)
        for name, build in BUILDERS.items()
        if (found := getattr(options, name)) is not None
    ]
    sensors = [
        SimDbcSensor(
            name, bench.buses[item.bus], Path(item.dbc), item.message, item.values,
            period_s=1 / item.rate,
        )
        for name, item in options.can_sensors.items()
    ]  # fmt: skip
    return [*devices, *sensors]


def with_makes(config: DeviceOptions, makes: Mapping[str, str]) -> dict[str, ServoOptions]:
    """Return the options of the drives of ``config`` that become of the makes named.

    ``makes`` has the make of each device by its name; the key "" stands for every drive.

    Raises:
        ValueError: no such make, or no such drive.

    """
    drives = {
        name: options
        for name in DeviceOptions.model_fields
        if isinstance(options := getattr(config, name), ServoOptions)
    }
    unknown = sorted(set(makes) - {"", *drives})
    if unknown:
        raise ValueError(f"no drive is called {unknown[0]!r}; there are {', '.join(drives)}")
    chosen = {name: makes.get(name, makes.get("")) for name in drives}
    return {
        name: drives[name].model_copy(update={"profile": read_make(make)})
        for name, make in chosen.items()
        if make is not None
    }

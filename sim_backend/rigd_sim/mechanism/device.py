"""Simulates devices of a mechanism: channels are its sensors, setpoints are those of its drives."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from typing import Annotated, Any, ClassVar, Self

from annotated_types import Len
from pydantic import (
    BeforeValidator,
    Field,
    PrivateAttr,
    StringConstraints,
    ValidationInfo,
    model_validator,
)

from rigd.model.errors import ConfigError
from rigd.model.units import correct_scale, parse_quantity, parse_unit
from rigd.sdk import (
    Channel,
    Declaration,
    Documented,
    Driver,
    DriverConfig,
    In,
    PlantSensor,
    WrongEntries,
    accepted,
)
from rigd_sim.mechanism.network import Instrument, Mechanism
from rigd_sim.mechanism.plant import MechanismConfig, MechanismPlant, truth_of

Name = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*$", max_length=60)]


class SensorChannel(Documented):
    """A channel: a sensor of the mechanism, with its raw value beside it if the real device has."""

    sensor: Name
    """Name of the sensor in the file of the mechanism."""
    scale: str | None = None
    """The quantity per raw unit, such as `10 N/V`: the raw value is then recorded beside it."""
    zero: str = "0"
    """Raw value that means 0 in `unit`, such as `0.1 V`."""
    unit: str | None = None
    """Unit in which people read the channel, such as `degC`; by default that of the sensor in
    SI."""
    raw: Name | None = None
    """Name of the raw channel; by default that of the channel with _raw."""


def _short(value: Any) -> Any:
    """Return ``{sensor: NAME}`` for a bare NAME."""
    return {"sensor": value} if isinstance(value, str) else value


class MechanismDeviceConfig(DriverConfig):
    """Which sensors and drives of the mechanism the device has."""

    channels: Annotated[
        dict[Name, Annotated[SensorChannel, BeforeValidator(_short)]], Len(0, 64)
    ] = Field(default_factory=dict)
    """Channels, by name: `{force: load_cell}` or `{force: {sensor: load_cell, scale: 10 N/V}}`."""
    setpoints: Annotated[dict[Name, Name], Len(0, 16)] = Field(default_factory=dict)
    """Setpoints, by name: `{speed: spindle}`, with the name of the drive."""

    _channels: tuple[Channel, ...] = PrivateAttr(default=())
    _setpoints: tuple[Channel, ...] = PrivateAttr(default=())

    @model_validator(mode="after")
    def _the_mechanism_has_them(self, info: ValidationInfo) -> Self:
        """Compare with the mechanism of the rig, which is ``plant`` in the context."""
        problems: list[tuple[tuple[str | int, ...], str]] = []
        if not self.channels and not self.setpoints:
            problems.append(((), "name at least one sensor under 'channels'"))
        mechanism = _mechanism((info.context or {}).get("plant"))
        if mechanism is not None:
            self._channels = self._resolved_channels(mechanism, problems)
            self._setpoints = self._resolved_setpoints(mechanism, problems)
        if problems:
            raise WrongEntries(problems)
        return self

    def _resolved_channels(
        self, mechanism: Mechanism, problems: list[tuple[tuple[str | int, ...], str]]
    ) -> tuple[Channel, ...]:
        sensors = {item.name: item for item in mechanism.instruments}
        found: list[Channel] = []
        for name, entry in self.channels.items():
            sensor = sensors.get(entry.sensor)
            if sensor is None:
                words = f"the mechanism has no sensor {entry.sensor!r}; "
                problems.append(
                    (("channels", name, "sensor"), words + _near(entry.sensor, sensors))
                )
                continue
            display = entry.unit or ""
            try:
                found.append(
                    Channel(
                        name, sensor.unit, _doc(sensor), sensor.low, sensor.high, display=display
                    )
                )
            except ValueError as error:
                problems.append((("channels", name, "unit"), str(error)))
                continue
            try:
                found += _raw(name, entry, sensor)
            except ValueError as error:
                where = ("scale",) if entry.scale is not None else ()
                problems.append((("channels", name, *where), str(error)))
        return tuple(found)

    def _resolved_setpoints(
        self, mechanism: Mechanism, problems: list[tuple[tuple[str | int, ...], str]]
    ) -> tuple[Channel, ...]:
        drives = {item.name: item for item in mechanism.drives}
        found: list[Channel] = []
        for name, drive in self.setpoints.items():
            item = drives.get(drive)
            if item is None:
                words = f"the mechanism has no drive {drive!r}; {_near(drive, drives)}"
                problems.append((("setpoints", name), words))
                continue
            found.append(
                Channel(name, item.setpoint_unit, f"setpoint of {drive}", item.low, item.high)
            )
        return tuple(found)

    @property
    def declared(self) -> Declaration:
        """The channels and setpoints, known once the mechanism is."""
        return Declaration(
            channels=self._channels, plain_rows=bool(self._channels), setpoints=self._setpoints
        )


def _mechanism(plant: Any) -> Mechanism | None:
    """Return the mechanism of the rig's plant; None if it is not known or its file is wrong."""
    if not isinstance(plant, MechanismConfig):
        return None
    try:
        return plant.mechanism()
    except ConfigError:
        return None  # noted with the plant


def _near(name: str, names: Any) -> str:
    near = get_close_matches(name, names, n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}?" if near else f"it has {', '.join(names) or 'none'}"


def _doc(sensor: Instrument) -> str:
    return f"{sensor.name} of the mechanism"


def _scale(entry: SensorChannel, unit: str) -> tuple[float, float, str]:
    """Return scale and zero in SI and the unit of the raw value; zero is that of 0 in SI.

    Raises:
        ValueError: they are not of the kind of the sensor.
    """
    text = entry.scale or "1"
    scale = parse_quantity(text)
    head, _, raw = text.rpartition("/")
    if not head or not scale.unit.same_kind(parse_unit(f"{unit}/{raw}")):
        wanted = f"{unit}/V"
        raise ValueError(f"scale '{text}' is not in {wanted}: {correct_scale(scale, wanted)}")
    if scale.value == 0.0:
        raise ValueError("scale is 0: every raw value would mean the same")
    zero = 0.0 if entry.zero == "0" else In(raw).read(entry.zero)
    zero -= parse_unit(entry.unit or unit).offset / scale.value
    return scale.value, zero, raw.strip()


def _raw(name: str, entry: SensorChannel, sensor: Instrument) -> tuple[Channel, ...]:
    if entry.scale is None:
        if entry.raw is not None or entry.zero != "0":
            raise ValueError("a raw channel needs its 'scale', such as '10 N/V'")
        return ()
    scale, zero, unit = _scale(entry, sensor.unit)
    low, high = sorted((sensor.low / scale + zero, sensor.high / scale + zero))
    raw = entry.raw or f"{name}_raw"
    return (Channel(raw, unit, f"{sensor.name} as it comes", low, high, raw_of=name),)


class MechanismDevice(Driver[MechanismDeviceConfig, MechanismPlant]):
    """A device whose channels are sensors of the mechanism and whose setpoints its drives.

    Safe: its drives are off and give no force.
    """

    Config: ClassVar[type[DriverConfig]] = MechanismDeviceConfig
    title: ClassVar[str] = "device of a mechanism: sensors and drives by name"
    plant_model: ClassVar[str] = "mechanism"

    def __init__(self, config: MechanismDeviceConfig, link: MechanismPlant) -> None:
        super().__init__(config, link)
        mechanism = link.mechanism
        drives = [item.name for item in mechanism.drives]
        self._drives = [drives.index(name) for name in config.setpoints.values()]
        #: Place among the readings, then scale and zero of what is shown of it.
        self._shown: list[tuple[int, float, float]] = []
        for entry in config.channels.values():
            place = mechanism.instrument(entry.sensor)
            self._shown.append((place, 1.0, 0.0))
            if entry.scale is not None:
                scale, zero, _ = _scale(entry, mechanism.instruments[place].unit)
                self._shown.append((place, 1.0 / scale, zero))

    @classmethod
    def declare(cls, config: MechanismDeviceConfig) -> Declaration:
        """Return the sensors as channels, the drives as setpoints."""
        return config.declared

    def open(self) -> None:
        """Do nothing: the plant stands as soon as the rig does."""

    def arm(self) -> None:
        """Enable the drives where they stand: a position is held, anything else is 0."""
        self._give(self._resting(), enabled=True)

    def read(self, t_ns: int) -> Sequence[float]:
        """Return what the sensors show."""
        readings = self.link.readings_at(t_ns)
        return [readings[place] * factor + zero for place, factor, zero in self._shown]

    def write(self, setpoints: Sequence[float]) -> None:
        """Give the setpoints, in SI.

        Raises:
            DeviceError: one is NaN; those before it hold.
        """
        channels = self.declaration.setpoints
        values = [accepted(*pair) for pair in zip(channels, setpoints, strict=True)]
        self._give(values, enabled=True)

    def make_safe(self) -> None:
        """Switch the drives off."""
        self._give(self._resting(), enabled=False)

    def close(self) -> None:
        """Leave it safe: there is nothing to close, and opened again it is not armed."""
        self.make_safe()

    def _resting(self) -> list[float]:
        return [self.link.resting(drive) for drive in self._drives]

    def _give(self, values: Sequence[float], *, enabled: bool) -> None:
        for drive, value in zip(self._drives, values, strict=True):
            self.link.command(drive, value, enabled=enabled)


class MechanismTruthConfig(DriverConfig):
    """No options: it shows all of the mechanism."""

    _channels: tuple[Channel, ...] = PrivateAttr(default=())

    @model_validator(mode="after")
    def _of_the_mechanism(self, info: ValidationInfo) -> Self:
        mechanism = _mechanism((info.context or {}).get("plant"))
        if mechanism is not None:
            self._channels = tuple(Channel(*item) for item in truth_of(mechanism))
        return self

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The hidden state."""
        return self._channels


class MechanismTruth(PlantSensor[MechanismTruthConfig, MechanismPlant]):
    """The hidden state of a mechanism, for verification; no real rig has it."""

    Config: ClassVar[type[DriverConfig]] = MechanismTruthConfig
    title: ClassVar[str] = "hidden state of a mechanism"
    plant_model: ClassVar[str] = "mechanism"

    @classmethod
    def declare(cls, config: MechanismTruthConfig) -> Declaration:
        """Return positions, speeds, forces and temperatures."""
        return Declaration(channels=config.channels, plain_rows=bool(config.channels))

    def read(self, t_ns: int) -> Sequence[float]:
        """Return the hidden state in the order of the channels."""
        self.link.readings_at(t_ns)
        return self.link.truth()

"""Defines a rig as typed data: all values in SI, all names resolved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.computed.controllers.driver import Controller, ControllerConfig
from rigd.computed.derived.driver import DerivedConfig
from rigd.config.remote import RemoteSetup
from rigd.model.channels import ECHO, Channel, Stream
from rigd.model.constants import Constant
from rigd.model.errors import Place
from rigd.model.limits import Interlock, SetpointLimit
from rigd.sdk import (
    AnyDriver,
    Declaration,
    DriverConfig,
    Link,
    LinkConfig,
    LinkError,
    Plant,
    PlantConfig,
    Setting,
    Simulation,
    SimulationConfig,
    SlowDriver,
)

if TYPE_CHECKING:  # the processes of a run read no file
    from rigd.config.calibration.calibration import CalibrationSetup


@dataclass(frozen=True)
class SourceFile:
    """A file as its author wrote it; recordings attach it unchanged.

    ``location`` is the place where it was found, from :func:`rigd.config.shipped_files.location`.
    """

    path: Path
    text: str
    location: str = ""


@dataclass(frozen=True)
class Waiver:
    """The person who accepts that a device has no watchdog, and the reason."""

    by: str
    reason: str


@dataclass(frozen=True)
class LinkSetup:
    """A shared connection: ``link_class(config)`` constructs the link and opens nothing."""

    name: str
    model: str
    link_class: type[Link]
    config: LinkConfig


@dataclass(frozen=True)
class RestBound:
    """A rig rests only if its channel ``name`` has at most the magnitude ``bound``, in SI.

    If it ``is_rate``, that is how fast the channel may change. People read it in ``unit``.
    """

    name: str
    bound: float
    unit: str
    is_rate: bool = False


@dataclass(frozen=True)
class Supervision:
    """The seconds of silence after which a process counts as dead.

    ``rest_s`` is how long rows go on after a run that did not reach its end, at most if channels
    ``at_rest`` show whether the rig rests.
    """

    cycle_silence_s: float = 0.05
    daemon_silence_s: float = 1.0
    rest_s: float = 2.0
    at_rest: tuple[RestBound, ...] = ()


@dataclass(frozen=True)
class DeviceConfig:
    """A driver with its options: ``driver_class(config, link)`` constructs it and opens nothing.

    ``declaration`` is what the driver declares for ``config``. ``limits`` has exactly one entry for
    each of its setpoints. ``link`` names the shared link of the device.
    """

    name: str
    driver: str
    driver_class: type[AnyDriver]
    config: DriverConfig
    declaration: Declaration
    limits: Mapping[str, SetpointLimit]
    link: str | None = None
    waiver: Waiver | None = None

    @property
    def is_actuator(self) -> bool:
        """Whether it can move something: it takes setpoints, and is more than a controller."""
        return bool(self.setpoints) and self.driver_class is not Controller

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels that the device measures, in the order of a row."""
        return self.declaration.channels

    @property
    def setpoints(self) -> tuple[Channel, ...]:
        """The setpoints that the device accepts; empty for a sensor."""
        return self.declaration.setpoints

    @property
    def stream(self) -> Stream:
        """The stream in which the device's rows are recorded; empty for a pure actuator."""
        return Stream(
            name=self.name,
            channels=self.channels,
            doc=self.driver_class.title,
            has_status=self.declaration.has_status,
            source=self.driver,
        )


@dataclass(frozen=True)
class PlantSetup:
    """The physics behind a simulated rig: ``plant_class(config, period_ns=..., seed=...)``."""

    model: str
    plant_class: type[Plant]
    config: PlantConfig
    settings: Mapping[str, Setting] = field(default_factory=dict)


@dataclass(frozen=True)
class SimulationSetup:
    """The simulated devices behind the links: ``simulation_class(config)`` serves them."""

    model: str
    simulation_class: type[Simulation]
    config: SimulationConfig
    settings: Mapping[str, Setting] | None = None

    def missing(self, rig: str) -> tuple[str, ...]:
        """Return what to do if no process serves the devices of ``rig``; nothing if one does."""
        try:
            self.simulation_class(self.config).ask({"do": "state"})
        except LinkError:
            start = f"start them in another terminal first: rigd sim {rig}"
            return (f"nothing serves the simulated devices of {rig}\n  {start}",)
        return ()


@dataclass(frozen=True)
class SiblingFile:
    """The simulated sibling that a rig file names; :mod:`rigd.config.sibling.sibling` reads it.

    ``place`` is where it is named.
    """

    path: Path
    place: Place


@dataclass(frozen=True)
class RigConfig:
    """A checked rig: the content of a rig file, with its drivers and valid options."""

    name: str
    title: str
    period_ns: int
    plant: PlantSetup | None
    devices: Mapping[str, DeviceConfig]
    interlocks: tuple[Interlock, ...]
    constants: Mapping[str, Constant]
    source: SourceFile
    links: Mapping[str, LinkSetup] = field(default_factory=dict)
    simulation: SimulationSetup | None = None
    supervision: Supervision = Supervision()
    calibration: CalibrationSetup | None = None
    remote: RemoteSetup = field(default_factory=RemoteSetup)
    sibling: SiblingFile | None = None
    lab: Path | None = None  #: its file, which is read when a run starts

    @property
    def settings(self) -> Mapping[str, Setting] | None:
        """The settings of the plant that prompts can change; None if the rig is real."""
        simulated = self.plant or self.simulation
        return None if simulated is None else simulated.settings

    def channel(self, name: str) -> Channel | None:
        """Return the measured channel called ``device.channel``, or None."""
        return _find(self.devices, name, "channels")

    def readings_in(self, name: str) -> frozenset[str]:
        """Return the channels of devices from which the channel ``name`` is computed, or itself."""
        device = self.devices.get(name.partition(".")[0])
        if device is not None and isinstance(device.config, DerivedConfig):
            return device.config.graph.uses.get(name, frozenset())
        return frozenset({name})

    def oldest_s(self, name: str) -> float:
        """Return how old the newest value of a channel becomes in normal operation, in s; or 0."""
        sources = [self.devices.get(item.partition(".")[0]) for item in self.readings_in(name)]
        return max((item.declaration.oldest_s for item in sources if item is not None), default=0.0)

    def slow_device_in(self, name: str) -> str | None:
        """Return a device from which the channel is and which gives rows at a pace of its own."""
        devices = sorted({item.partition(".")[0] for item in self.readings_in(name)})
        kinds = {item: self.devices[item].driver_class for item in devices if item in self.devices}
        return next((item for item, kind in kinds.items() if issubclass(kind, SlowDriver)), None)

    def recorded(self, name: str) -> Channel | None:
        """Return the recorded quantity ``device.channel``: a reading, or a setpoint; or None."""
        echoed = name.removesuffix(ECHO)
        return self.channel(name) or (self.setpoint(echoed) if echoed != name else None)

    def setpoint(self, name: str) -> Channel | None:
        """Return the setpoint called ``device.setpoint``, or None."""
        return _find(self.devices, name, "setpoints")

    def setpoint_name(self, name: str) -> str:
        """Return ``name``, or the setpoint of the controller with this name."""
        config = None if name not in self.devices else self.devices[name].config
        return config.setpoint if isinstance(config, ControllerConfig) else name

    @property
    def settable(self) -> list[str]:
        """What a procedure can set: setpoints of devices, and controllers by name."""
        return [
            name
            for device in self.devices.values()
            for name in (
                [f"{device.name}.{setpoint.name}" for setpoint in device.setpoints]
                if device.driver_class is not Controller
                else [device.name]
            )
        ]

    @property
    def loops(self) -> Mapping[str, str]:
        """What each controller commands, by its setpoint."""
        configs = (device.config for device in self.devices.values())
        return {c.setpoint: c.output for c in configs if isinstance(c, ControllerConfig)}


def _find(devices: Mapping[str, DeviceConfig], name: str, kind: str) -> Channel | None:
    device_name, _, channel_name = name.partition(".")
    device = devices.get(device_name)
    if device is None:
        return None
    known = device.channels if kind == "channels" else device.setpoints
    return next((channel for channel in known if channel.name == channel_name), None)

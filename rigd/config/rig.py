"""A rig as typed data: all values in SI, all names resolved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.config.remote import RemoteSetup
from rigd.model.channels import Channel, Stream
from rigd.model.limits import Interlock, SetpointLimit
from rigd.model.units import Quantity
from rigd.sdk import (
    AnyDriver,
    DriverConfig,
    Link,
    LinkConfig,
    Plant,
    PlantConfig,
    Setting,
    Simulation,
    SimulationConfig,
)

if TYPE_CHECKING:  # the processes of a run read no file
    from rigd.config.calibration import CalibrationSetup


@dataclass(frozen=True)
class SourceFile:
    """A file as its author wrote it; recordings attach it unchanged.

    ``whence`` is where it was taken from, as :func:`rigd.config.shipped.whence` says it.
    """

    path: Path
    text: str
    whence: str = ""


@dataclass(frozen=True)
class Waiver:
    """Who takes it upon themselves that a device has no watchdog, and why."""

    by: str
    reason: str


@dataclass(frozen=True)
class LinkSetup:
    """One shared connection: ``link_class(config)`` makes it, nothing is opened yet."""

    name: str
    model: str
    link_class: type[Link]
    config: LinkConfig


@dataclass(frozen=True)
class Supervision:
    """After how many seconds of silence a process is taken for dead."""

    cycle_silence_s: float = 0.05
    daemon_silence_s: float = 1.0


@dataclass(frozen=True)
class DeviceConfig:
    """One driver instance: ``driver_class(config, link)`` makes it, nothing is opened yet.

    ``limits`` has exactly one entry for each of ``setpoints``. ``link`` names the shared link
    that the device stands on.
    """

    name: str
    driver: str
    driver_class: type[AnyDriver]
    config: DriverConfig
    channels: tuple[Channel, ...]
    setpoints: tuple[Channel, ...]
    has_status: bool
    limits: Mapping[str, SetpointLimit]
    link: str | None = None
    waiver: Waiver | None = None
    status_bits: Mapping[str, int] = field(default_factory=dict)
    oldest_s: float = 0.0  #: how old its newest row becomes while all is well, in s

    @property
    def stream(self) -> Stream:
        """The stream that the device's rows are recorded as; empty for a pure actuator."""
        return Stream(
            name=self.name,
            channels=self.channels,
            doc=self.driver_class.title,
            has_status=self.has_status,
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
    """The simulated devices behind the links: ``simulation_class(config)`` reaches them."""

    model: str
    simulation_class: type[Simulation]
    config: SimulationConfig
    settings: Mapping[str, Setting] | None = None


@dataclass(frozen=True)
class RigConfig:
    """One bench, checked: what a rig file says, with its drivers found and their options valid."""

    name: str
    title: str
    period_ns: int
    plant: PlantSetup | None
    devices: Mapping[str, DeviceConfig]
    interlocks: tuple[Interlock, ...]
    constants: Mapping[str, Quantity]
    source: SourceFile
    links: Mapping[str, LinkSetup] = field(default_factory=dict)
    simulation: SimulationSetup | None = None
    supervision: Supervision = Supervision()
    calibration: CalibrationSetup | None = None
    remote: RemoteSetup = field(default_factory=RemoteSetup)

    @property
    def settings(self) -> Mapping[str, Setting] | None:
        """What prompts can change at the plant; None if the rig is a real one."""
        simulated = self.plant or self.simulation
        return None if simulated is None else simulated.settings

    def channel(self, name: str) -> Channel | None:
        """Return the measured channel called ``device.channel``, or None."""
        return _find(self.devices, name, "channels")

    def setpoint(self, name: str) -> Channel | None:
        """Return the setpoint called ``device.setpoint``, or None."""
        return _find(self.devices, name, "setpoints")


def _find(devices: Mapping[str, DeviceConfig], name: str, kind: str) -> Channel | None:
    device_name, _, channel_name = name.partition(".")
    device = devices.get(device_name)
    if device is None:
        return None
    known = device.channels if kind == "channels" else device.setpoints
    return next((channel for channel in known if channel.name == channel_name), None)

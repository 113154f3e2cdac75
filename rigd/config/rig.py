"""A rig as the rest of rigd sees it: plain frozen data, every value in SI, every name resolved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from rigd.model.channels import Channel, Stream
from rigd.model.units import Quantity
from rigd.sdk import Driver, DriverConfig, Plant, PlantConfig


@dataclass(frozen=True)
class SourceFile:
    """A file as its author wrote it; recordings attach it unchanged."""

    path: Path
    text: str


@dataclass(frozen=True)
class SetpointLimit:
    """What the rig allows a setpoint, in the SI value of its unit (``rate`` per second).

    Lies within the device's own range. ``rest`` is the value a controlled stop ramps the
    setpoint to within ``rate``.
    """

    low: float
    high: float
    rate: float
    rest: float = 0.0


@dataclass(frozen=True)
class DeviceConfig:
    """One driver instance: ``driver_class(config, link)`` makes it, nothing is opened yet.

    ``limits`` has exactly one entry for each of ``setpoints``.
    """

    name: str
    driver: str
    driver_class: type[Driver]
    config: DriverConfig
    channels: tuple[Channel, ...]
    setpoints: tuple[Channel, ...]
    has_status: bool
    limits: Mapping[str, SetpointLimit]

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


class InterlockAction(Enum):
    """What a tripped interlock does, each escalating the last."""

    WARN = "warn"  #: an event in the recording, nothing else
    END_TRIAL = "end_trial"  #: the trial ends, marked incomplete; the sweep goes on
    STOP = "stop"  #: controlled stop: setpoints ramp to rest within their rates
    ABORT = "abort"  #: setpoints to zero now
    ESTOP = "estop"  #: ask for power to drop


@dataclass(frozen=True)
class InterlockConfig:
    """A condition checked every cycle, beneath procedures and manual commands alike.

    Trips when ``source`` (``device.channel``) leaves ``low``..``high`` (SI constant, or the name
    of a channel in the same unit) without a break for ``delay_s``, and rearms ``deadband`` inside
    the bound. NaN trips; so does a value older than ``stale_after_s``. With ``latch`` it stays
    tripped until acknowledged. Of two that trip together, the higher ``priority`` is reported.
    """

    name: str
    source: str
    low: float | str | None
    high: float | str | None
    delay_s: float
    deadband: float
    stale_after_s: float
    latch: bool
    priority: int
    action: InterlockAction
    message: str


@dataclass(frozen=True)
class RigConfig:
    """One bench, checked: what a rig file says, with its drivers found and their options valid."""

    name: str
    title: str
    period_ns: int
    plant: PlantSetup | None
    devices: Mapping[str, DeviceConfig]
    interlocks: tuple[InterlockConfig, ...]
    constants: Mapping[str, Quantity]
    source: SourceFile

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

"""Schema of a rig file: the keys and values that are allowed."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, StringConstraints

from rigd.model.patterns import quantity_schema
from rigd.sdk import Documented, In

#: Names of rigs, devices, interlocks and constants.
Name = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*$", max_length=60)]
#: Rigs and procedures may carry a dash: names on the command line, not in expressions.
FileName = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_-]*$", max_length=60)]
#: ``device.channel``.
ChannelName = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*\.[a-z][a-z0-9_]*$")]
#: A quantity whose unit another part of the file decides.
QuantityText = Annotated[str, Field(json_schema_extra=quantity_schema())]
#: Path of a file, relative to the one that names it.
FilePath = Annotated[str, StringConstraints(min_length=1, max_length=300)]
#: Name of a person or program in its certificate; part of zenoh keys.
Identity = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9._-]{1,64}$")]


def _nothing_is_empty(value: object) -> object:
    return {} if value is None else value


class Source(Documented, BaseModel):  # both: ruff does not look into other modules
    """A part of a file: every key known, every field documented."""

    model_config = ConfigDict(allow_inf_nan=False)


class LimitSource(Source):
    """What the rig allows one setpoint."""

    low: QuantityText
    """Smallest value, in the unit of the setpoint."""
    high: QuantityText
    """Largest value, in the unit of the setpoint."""
    rate: QuantityText
    """Fastest change per second; faster commands are slowed down to it."""
    rest: QuantityText = "0"
    """Value that a controlled stop ramps to; by default zero."""


class WaiverSource(Source):
    """Lets a device be armed that nothing makes safe when this computer dies."""

    by: Annotated[str, StringConstraints(min_length=1, max_length=100)]
    """The person who decided it."""
    reason: Annotated[str, StringConstraints(min_length=10, max_length=300)]
    """Why nothing can happen: what else makes the device safe."""


class LinkSource(Source):
    """One connection that devices share."""

    type: FileName
    """Kind of link; `rigd drivers` lists them."""
    options: Annotated[dict[str, Any], BeforeValidator(_nothing_is_empty)] = {}
    """Options of the link."""


class SupervisionSource(Source):
    """When a process that says nothing is taken for dead."""

    cycle_silence: Annotated[float, In("s"), Ge(0.005), Le(5)] = 0.05
    """The cycle: its process is ended and the rig made safe over a second link."""
    daemon_silence: Annotated[float, In("s"), Ge(0.1), Le(60)] = 1.0
    """The daemon: the cycle makes the rig safe and ends."""


class TlsSource(Source):
    """What the daemon proves itself with, and whom it trusts; paths count from the rig file."""

    ca: FilePath
    """Certificate that signs everybody who is trusted."""
    certificate: FilePath
    """The daemon's own certificate."""
    key: FilePath
    """Its private key."""


class RemoteSource(Source):
    """Control from elsewhere: by default from this machine only, by anybody on it."""

    listen: Annotated[list[str], Field(min_length=1, max_length=8)] = ["tcp/127.0.0.1:7447"]
    """Where the daemon listens; beyond loopback only by `tls/...`."""
    tls: TlsSource | None = None
    """Certificates; `rigd remote setup-tls` makes them."""
    roles: Annotated[
        dict[Identity, Literal["observer", "operator", "maintainer"]], Field(max_length=64)
    ] = {}
    """Who may do what, by the names in their certificates; without certificates, by the names
    that clients give themselves, where those not named are operators."""


class DeviceSource(Source):
    """One device of the rig."""

    driver: FileName
    """Name of an installed driver; `rigd drivers` lists them."""
    link: Name | None = None
    """The link of this file that the device stands on, for drivers that share one."""
    options: Annotated[dict[str, Any], BeforeValidator(_nothing_is_empty)] = {}
    """Options of the driver."""
    limits: Annotated[dict[Name, LimitSource], BeforeValidator(_nothing_is_empty)] = {}
    """One entry for each setpoint of the device."""
    waiver: WaiverSource | None = None
    """Who takes it upon themselves that the device has no watchdog; recorded with every run."""


class InterlockSource(Source):
    """A condition checked every cycle; NaN trips it too."""

    name: Name
    """Name that the recording and the operator see."""
    source: ChannelName
    """The channel watched, as `device.channel`."""
    low: QuantityText | None = None
    """Trips below this value, or below another channel (`device.channel`)."""
    high: QuantityText | None = None
    """Trips above this value, or above another channel (`device.channel`)."""
    delay: Annotated[float, In("s"), Ge(0), Le(60)] = 0.0
    """How long the value must stay outside without a break; by default it trips at once."""
    deadband: QuantityText | None = None
    """How far inside the bound the value must return before the interlock clears."""
    stale_after: Annotated[float, In("s"), Gt(0), Le(60)] = 0.05
    """Age of the last value at which it counts as lost."""
    latch: bool = False
    """Whether it stays tripped until a person acknowledges it."""
    priority: Literal["low", "medium", "high", "critical"] = "medium"
    """How urgently a person must look."""
    action: Literal["warn", "end_trial", "stop", "abort", "estop"]
    """What happens: each escalates the one before."""
    message: Annotated[str, StringConstraints(min_length=1, max_length=300)]
    """What the operator reads when it trips."""


class PlantSource(Documented):
    """The physics behind a simulated rig, with the options of its model."""

    model_config = ConfigDict(extra="allow")

    model: FileName
    """Name of the plant; its options stand beside it."""


class SimulationSource(Documented):
    """The simulated devices that stand behind the links of this rig, with their options."""

    model_config = ConfigDict(extra="allow")

    model: FileName
    """Name of the simulation; its options stand beside it."""


class RigSource(Source):
    """A rig: its devices, limits, interlocks and constants."""

    rig: FileName
    """Name of the rig, as in `--rig NAME`."""
    title: Annotated[str, StringConstraints(min_length=1, max_length=200)]
    """One line for a person."""
    cycle: Annotated[float, In("Hz"), Ge(100), Le(5000)]
    """How often devices are exchanged with and interlocks checked: 100 Hz to 5 kHz."""
    plant: PlantSource | None = None
    """Only for a rig simulated in process."""
    simulation: SimulationSource | None = None
    """Only for a rig whose devices `rigd sim` simulates at the wire."""
    supervision: SupervisionSource = SupervisionSource()
    """How the processes of rigd watch one another."""
    links: Annotated[dict[Name, LinkSource], BeforeValidator(_nothing_is_empty)] = {}
    """Connections that devices share, by name."""
    devices: Annotated[dict[Name, DeviceSource], Field(min_length=1, max_length=64)]
    """The devices by name."""
    interlocks: Annotated[list[InterlockSource], Field(max_length=256)]
    """Conditions that end what the rig does; `[]` says that there are none."""
    remote: RemoteSource | None = None
    """Control from elsewhere, where it is to be other than from this machine only."""
    calibration: FilePath | None = None
    """File of what was measured of this rig, with its uncertainty; the path counts from here."""
    constants: dict[Name, QuantityText] = {}
    """Quantities of the rig that procedures use as `${rig.NAME}`."""

"""Defines the schema of a rig file: the keys and values that are allowed."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from annotated_types import Ge, Gt, Le
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    StringConstraints,
    Tag,
)

from rigd.model.patterns import quantity_schema
from rigd.sdk import Documented, In

#: Names of rigs, devices, interlocks and constants.
Name = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*$", max_length=60)]
#: Rigs and procedures may contain a dash: their names are used on the command line, not in
#: expressions.
FileName = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_-]*$", max_length=60)]
#: ``device.channel``.
ChannelName = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*\.[a-z][a-z0-9_]*$")]
#: ``device.setpoint``, or the name of a controller.
SetpointName = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)?$")]
#: What the patterns above ask for, in words.
NAME_RULES: Final = {
    r"^[a-z][a-z0-9_]*$": "small letters, digits and _, a letter first",
    r"^[a-z][a-z0-9_-]*$": "small letters, digits, _ and -, a letter first",
    r"^[a-z][a-z0-9_]*\.[a-z][a-z0-9_]*$": "'device.channel'",
    r"^[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)?$": "'device.setpoint'",
}
#: A quantity whose unit follows from another part of the file.
QuantityText = Annotated[str, Field(json_schema_extra=quantity_schema())]
#: Path of a file, relative to the file that names it.
FilePath = Annotated[str, StringConstraints(min_length=1, max_length=300)]
#: Name of a person or program in its certificate; part of zenoh keys.
Identity = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9._-]{1,64}$")]


#: The source of a value, for people.
Origin = Annotated[str, StringConstraints(min_length=1, max_length=200)]


def _nothing_is_empty(value: object) -> object:
    return {} if value is None else value


class Source(Documented, BaseModel):  # both: ruff does not look into other modules
    """A part of a file: unknown keys are refused, every field is documented."""

    model_config = ConfigDict(allow_inf_nan=False)


class ConstantSource(Source):
    """A known quantity, and its uncertainty."""

    value: QuantityText
    """The quantity."""
    u: QuantityText | None = None
    """Standard uncertainty (k = 1), at least 0: of the same kind, or in % of the value."""
    source: Origin | None = None
    """Its source: `caliper, 2026-10`, `data sheet`, `assumed: ...`."""


def _constant_kind(value: object) -> str:
    return "full" if isinstance(value, dict) else "value"


#: A quantity alone, or with its uncertainty and source.
GivenConstant = Annotated[
    Annotated[QuantityText, Tag("value")] | Annotated[ConstantSource, Tag("full")],
    Discriminator(_constant_kind),
]


class LimitSource(Source):
    """The bounds of one setpoint on this rig."""

    low: QuantityText
    """Smallest value, in the unit of the setpoint."""
    high: QuantityText
    """Largest value, in the unit of the setpoint."""
    rate: QuantityText
    """Fastest change per second; faster commands are slowed down to it."""
    rest: QuantityText = "0"
    """Value that a controlled stop ramps to; by default zero."""
    at_stop: Literal["rest", "hold"] = "rest"
    """With `hold` a stop, a pause and a prompt keep the value that is reached, and `rest` is only
    where a run begins; for slow devices, such as an oven. At the end the device is made safe.
    """


class WaiverSource(Source):
    """Permits arming of a device that no watchdog makes safe if this computer fails."""

    by: Annotated[str, StringConstraints(min_length=1, max_length=100)]
    """The person who decided it."""
    reason: Annotated[str, StringConstraints(min_length=10, max_length=300)]
    """The reason why this is safe: what else makes the device safe."""


class LinkSource(Source):
    """A connection that devices share."""

    type: FileName
    """Kind of link; `rigd drivers` lists them."""
    options: Annotated[dict[str, Any], BeforeValidator(_nothing_is_empty)] = {}
    """Options of the link."""


class SupervisionSource(Source):
    """The silence after which a process counts as dead, and how long the rig needs to rest."""

    cycle_silence: Annotated[float, In("s"), Ge(0.005), Le(5)] = 0.05
    """The cycle: the daemon kills its process and makes the rig safe over a second link."""
    daemon_silence: Annotated[float, In("s"), Ge(0.1), Le(60)] = 1.0
    """The daemon: the cycle makes the rig safe and ends."""
    rest: Annotated[float, In("s"), Ge(2), Le(60)] = 2.0
    """How long rows go on after a run that did not reach its end, for the rig to come to rest."""
    at_rest: Annotated[dict[ChannelName, QuantityText], Field(max_length=16)] = {}
    """The channels by which the rig rests, with their largest magnitudes, or the fastest at which
    they may change: `{carriage.position: 1 mm/s}`. Rows then end as soon as all have stayed within
    them for 0.5 s, after 2 s at the earliest; if some have not within `rest`, that is an error.
    """


class TlsSource(Source):
    """The daemon's certificate, and the authority that it trusts; paths start at the rig file."""

    ca: FilePath
    """Certificate of the authority that the daemon and its clients trust."""
    certificate: FilePath
    """The daemon's own certificate."""
    key: FilePath
    """The daemon's private key."""


class RemoteSource(Source):
    """Remote control: by default from this machine only, by every user of it."""

    listen: Annotated[list[str], Field(min_length=1, max_length=8)] = ["tcp/127.0.0.1:7447"]
    """The addresses on which the daemon listens; beyond loopback only `tls/...`."""
    tls: TlsSource | None = None
    """Certificates; `rigd remote setup-tls` makes them."""
    roles: Annotated[
        dict[Identity, Literal["observer", "operator", "maintainer"]], Field(max_length=64)
    ] = {}
    """The roles of clients by name: with certificates, the names in them; without certificates, the
    names that clients give themselves, and clients not listed are operators.
    """


class DeviceSource(Source):
    """One device of the rig."""

    driver: FileName
    """Name of an installed driver; `rigd drivers` lists them."""
    link: Name | None = None
    """The link of this file that the device uses, for drivers that share a link."""
    options: Annotated[dict[str, Any], BeforeValidator(_nothing_is_empty)] = {}
    """Options of the driver."""
    limits: Annotated[dict[Name, LimitSource], BeforeValidator(_nothing_is_empty)] = {}
    """One entry for each setpoint of the device."""
    display: dict[Name, QuantityText] = {}
    """Units in which people read its channels and setpoints: `{temperature: degC, speed: rpm}`."""
    waiver: WaiverSource | None = None
    """The person who accepts that the device has no watchdog; recorded with every run."""


class InterlockSource(Source):
    """A condition checked every cycle; NaN trips it too."""

    name: Name
    """Name in the recording and for the operator."""
    source: ChannelName
    """The channel watched, as `device.channel`."""
    low: QuantityText | None = None
    """Trips below this value, or below another channel (`device.channel`)."""
    high: QuantityText | None = None
    """Trips above this value, or above another channel (`device.channel`)."""
    follows: ChannelName | None = None
    """Instead of bounds: the setpoint that the value must follow, as `device.setpoint`."""
    band: QuantityText | None = None
    """With `follows`: how far the value may be from its setpoint, for `delay`."""
    only_while: Annotated[ChannelName | None, Field(alias="while")] = None
    """With `follows`: the setpoint, 0 or 1, that lets the value follow, such as a clutch."""
    delay: Annotated[float, In("s"), Ge(0), Le(60)] = 0.0
    """How long the value must stay outside without interruption; by default it trips at once."""
    deadband: QuantityText | None = None
    """How far inside the bound the value must return before the interlock clears."""
    stale_after: Annotated[float, In("s"), Gt(0), Le(60)] = 0.05
    """Age of the last value at which the channel counts as lost."""
    latch: bool = False
    """Whether it stays tripped until a person acknowledges it."""
    priority: Literal["low", "medium", "high", "critical"] = "medium"
    """How urgently a person must look at the rig."""
    action: Literal["warn", "end_trial", "stop", "abort", "estop"]
    """The action, in order of severity."""
    message: Annotated[str, StringConstraints(min_length=1, max_length=300)]
    """Message for the operator when it trips."""


class DerivedSource(Source):
    """A channel that the cycle computes from other channels."""

    formula: Annotated[str, Field(alias="is"), StringConstraints(min_length=1, max_length=300)]
    """The formula, such as `traction.force / load.force`; docs/derived.md lists its functions."""
    unit: QuantityText | None = None
    """Unit of the result; by default what follows from the formula."""
    where: Annotated[str, StringConstraints(min_length=1, max_length=300)] | None = None
    """The condition for a value, such as `load.force > 5 N`; the value is NaN without it."""
    lowpass: QuantityText | None = None
    """Cut-off frequency of a filter of second order behind the formula."""
    reset: Literal["run", "trial"] = "run"
    """When integrals, filters and counts begin anew: only with the run, or with every trial."""
    doc: Annotated[str, StringConstraints(max_length=200)] = ""
    """What it is, in one line."""


class TargetLimitSource(Source):
    """Bounds of the setpoint of a controller."""

    low: QuantityText
    """Lowest setpoint."""
    high: QuantityText
    """Highest setpoint."""
    rate: QuantityText | None = None
    """Largest change per second; by default any."""
    rest: QuantityText | None = None
    """Setpoint that `rest` means in a held step; by default the one next to 0 within the bounds."""


class ControllerSource(Source):
    """A controller (PID or relay): holds a measured channel at its setpoint by another setpoint."""

    measured: ChannelName
    """The channel that is held."""
    output: SetpointName
    """What it commands: a setpoint, as `device.setpoint`, or another controller by its name."""
    kp: QuantityText | None = None
    """Proportional gain, such as `0.02 A/N`; negative if more output lowers the measured value."""
    ki: QuantityText | None = None
    """Integral gain, such as `0.1 A/(N s)`."""
    kd: QuantityText | None = None
    """Derivative gain, such as `0.001 A s/N`."""
    filter: QuantityText | None = None
    """Cut-off frequency of the filter of the derivative; needed with `kd`."""
    setpoint_weight: Annotated[float, In("1"), Ge(0), Le(1)] = 1.0
    """Part of a change of the setpoint that acts at once, by `kp`."""
    relay: QuantityText | None = None
    """In place of gains, to find them: by how much the output jumps above and below what the
    setpoint needs, such as `0.4 A`; negative if more output lowers the measured value.
    """
    hysteresis: QuantityText | None = None
    """Error at which the relay passes over, above the noise of the measured channel."""
    output_limits: Annotated[list[QuantityText], Field(min_length=2, max_length=2)] | None = None
    """Lowest and highest output; by default the limits of what it commands."""
    limits: TargetLimitSource | None = None
    """Limits of its setpoint; by default the range of the measured channel, at any rate."""
    feed_forward: ChannelName | None = None
    """A channel that is added to the output, in its unit; often a derived channel."""
    schedule: ChannelName | None = None
    """A channel without unit by which all gains are multiplied; often a derived channel."""
    stale_after: Annotated[float, In("s"), Gt(0), Le(60)] = 0.05
    """Age at which a channel that it uses counts as lost, which ends the trial."""
    frozen_after: Annotated[float, In("s"), Gt(0), Le(3600)] = 1.0
    """The trial ends if the measured value does not change at all for so long, while the output
    moves by more than 1 % of its range.
    """
    frozen: Literal["moving", "always"] = "moving"
    """With `always` a measured value without change is frozen while the output does not move too:
    for a sensor whose noise changes each reading.
    """
    stuck_after: Annotated[float, In("s"), Gt(0), Le(3600)] = 2.0
    """The trial ends if the output is at a limit for so long and the error does not shrink, or if a
    relay does not pass over for so long.
    """


class ObserverSource(Documented):
    """A filter that estimates what is not measured, with the options of its model."""

    model_config = ConfigDict(extra="allow")

    model: FileName
    """Kind of filter: `linear`, given as matrices, or an installed one (docs/observers.md)."""


class ObserverConstants(Source):
    """The constants of an installed model."""

    constants: dict[Name, GivenConstant] = {}
    """Constants by name: a quantity, `${rig.NAME}`, or one of them as `value` with its `u`."""


class LinearSource(Source):
    """A linear Kalman filter: dx/dt = a x + b u + noise of q, measured = c x + d u + noise of r."""

    states: Annotated[dict[Name, str], Field(min_length=1, max_length=12)]
    """The states by name, each with its SI unit."""
    inputs: Annotated[list[ChannelName], Field(max_length=8)] = []
    """Channels, or setpoints as `device.setpoint_setpoint`, that drive the model."""
    measured: Annotated[list[ChannelName], Field(min_length=1, max_length=8)]
    """Channels that correct the states."""
    time: Literal["continuous", "discrete"] = "continuous"
    """Whether `a`, `b` and `q` are of a differential equation, or of one cycle."""
    a: list[list[str]]
    """Change of the states with the states: a row and a column for each state."""
    b: list[list[str]] | None = None
    """Change of the states with the inputs; required with `inputs`."""
    c: list[list[str]]
    """Measured channels from the states."""
    d: list[list[str]] | None = None
    """Measured channels from the inputs directly; by default nothing."""
    q: list[list[str] | str]
    """Noise of the model: its spectral density, or with `time: discrete` its covariance."""
    r: list[list[str] | str]
    """Covariance of the readings."""
    x0: list[str]
    """States at the beginning."""
    p0: list[list[str] | str]
    """Covariance of `x0`."""
    lost_after: Annotated[float, In("s"), Gt(0), Le(3600)] = 1.0
    """How long nothing may be measured, or an input not be known, before the states are NaN."""
    reset: Literal["run", "trial"] = "run"
    """When the filter begins anew: only with the run, or with every trial."""


class PlantSource(Documented):
    """The physics behind a simulated rig, with the options of its model."""

    model_config = ConfigDict(extra="allow")

    model: FileName
    """Name of the plant; its options follow beside it."""


class SimulationSource(Documented):
    """The simulated devices behind the links of this rig, with their options."""

    model_config = ConfigDict(extra="allow")

    model: FileName
    """Name of the simulation; its options follow beside it."""


class RigSource(Source):
    """A rig: its devices, limits, interlocks and constants."""

    rig: FileName
    """Name of the rig, as in `--rig NAME`."""
    title: Annotated[str, StringConstraints(min_length=1, max_length=200)]
    """A title in one line."""
    cycle: Annotated[float, In("Hz"), Ge(100), Le(5000)]
    """How often devices are read and written and interlocks are checked: 100 Hz to 5 kHz."""
    plant: PlantSource | None = None
    """Only for a rig simulated in process."""
    simulation: SimulationSource | None = None
    """Only for a rig whose devices `rigd sim` simulates at the wire."""
    sibling: FilePath | None = None
    """Only without `plant`: rig file of the same rig simulated in process, on whose plant a dry run
    plays; relative to this file.
    """
    supervision: SupervisionSource = SupervisionSource()
    """How the processes of rigd supervise one another."""
    links: Annotated[dict[Name, LinkSource], BeforeValidator(_nothing_is_empty)] = {}
    """Connections that devices share, by name."""
    devices: Annotated[dict[Name, DeviceSource], Field(min_length=1, max_length=64)]
    """The devices by name."""
    derived: Annotated[
        dict[ChannelName, DerivedSource], BeforeValidator(_nothing_is_empty), Field(max_length=64)
    ] = {}
    """Channels computed in every cycle from others, by name, as `group.channel`."""
    controllers: Annotated[
        dict[Name, ControllerSource], BeforeValidator(_nothing_is_empty), Field(max_length=16)
    ] = {}
    """Controllers by name, which is that of their setpoint in procedures: `set: {NAME: 20 N}`."""
    observers: Annotated[
        dict[Name, ObserverSource], BeforeValidator(_nothing_is_empty), Field(max_length=16)
    ] = {}
    """Filters that estimate what is not measured, by name."""
    interlocks: Annotated[list[InterlockSource], Field(max_length=256)]
    """Conditions that end a run; `[]` if there are none."""
    remote: RemoteSource | None = None
    """Remote control, if it is not only from this machine."""
    calibration: FilePath | None = None
    """File with measured values of this rig and their uncertainty; relative to this file."""
    lab: FilePath | None = None
    """File with what the lab demands of every run, and of its specimens; relative to this file."""
    constants: dict[Name, GivenConstant] = {}
    """Quantities of the rig that procedures use as `${rig.NAME}`: `50 mm`, or
    `{value: 50 mm, u: 0.1 mm, source: caliper}`."""

"""Simulates a device by variables of an FMU: setpoints are inputs of it, channels its outputs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import (
    BeforeValidator,
    Field,
    PrivateAttr,
    StringConstraints,
    ValidationInfo,
    model_validator,
)

from rigd.model.units import parse_unit
from rigd.sdk import (
    Channel,
    Declaration,
    Documented,
    Driver,
    DriverConfig,
    In,
    WrongEntries,
    accepted,
)
from rigd_sim.fmu.description import NUMBERS, FmuFile, Variable
from rigd_sim.fmu.options import find
from rigd_sim.fmu.plant import FmuConfig, FmuPlant
from rigd_sim.fmu.units import FmuUnit, as_stated

Name = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*$", max_length=60)]


class FmuOutput(Documented):
    """A channel: a variable of the FMU that is read in every cycle."""

    variable: str
    """Name of the variable in the FMU: an output, or a local variable."""
    unit: str | None = None
    """SI unit of the channel; by default that of the FMU, if it names an SI unit."""

    _channel: Channel = PrivateAttr(default=Channel("unnamed"))

    @property
    def channel(self) -> Channel:
        """What the rig has of the variable, in SI."""
        return self._channel

    def resolve(self, name: str, fmu: FmuFile | None) -> None:
        """Make the channel ``name`` of the variable; without ``fmu`` by this entry alone.

        Raises:
            ValueError: the FMU has no such variable, or one that does not fit.
        """
        self._channel = _channel(name, self, fmu)


class FmuInput(FmuOutput):
    """A setpoint: an input of the FMU."""

    safe: str = "0"
    """Value in its safe state, before the first setpoint too: `0 N m`; 0 if it is left out."""
    low: str | None = None
    """Smallest value that it takes, with unit; by default the FMU's minimum, if it states one."""
    high: str | None = None
    """Largest value that it takes, with unit; by default the FMU's maximum, if it states one."""


def _short(value: Any) -> Any:
    """Return ``{variable: NAME}`` for a bare NAME."""
    return {"variable": value} if isinstance(value, str) else value


Output = Annotated[FmuOutput, BeforeValidator(_short)]
Input = Annotated[FmuInput, BeforeValidator(_short)]
Part = TypeVar("Part", bound=FmuOutput)


class FmuDeviceConfig(DriverConfig):
    """Which variables of the FMU the device has."""

    outputs: dict[Name, Output] = Field(default_factory=dict)
    """Channels, by name: `{speed: omega}` or `{speed: {variable: omega, unit: rad/s}}`."""
    inputs: dict[Name, Input] = Field(default_factory=dict)
    """Setpoints, by name: `{torque: {variable: T, unit: N m}}`."""

    @model_validator(mode="after")
    def _the_fmu_has_them(self, info: ValidationInfo) -> FmuDeviceConfig:
        """Compare with the FMU of the rig, which is ``plant`` in the context, if it is there."""
        plant = (info.context or {}).get("plant")
        fmu = plant.fmu if isinstance(plant, FmuConfig) else None
        problems: list[tuple[tuple[str | int, ...], str]] = []
        if not self.outputs:
            problems.append(((), "name at least one of the FMU's variables under 'outputs'"))
        parts: list[tuple[str, str, FmuOutput]] = [
            *(("outputs", name, part) for name, part in self.outputs.items()),
            *(("inputs", name, part) for name, part in self.inputs.items()),
        ]
        for group, name, part in parts:
            try:
                part.resolve(name, fmu)
            except ValueError as error:
                problems.append(((group, name, wrong_key(error)), str(error)))
        if problems:
            raise WrongEntries(problems)
        return self


class _Wrong(ValueError):
    """A problem of the entry ``key``."""

    def __init__(self, key: str, text: str) -> None:
        super().__init__(text)
        self.key = key


def wrong_key(error: ValueError) -> str:
    """Return the key of the entry that :meth:`FmuOutput.resolve` has refused."""
    return error.key if isinstance(error, _Wrong) else "variable"


def _channel(name: str, part: FmuOutput, fmu: FmuFile | None) -> Channel:
    is_input = isinstance(part, FmuInput)
    variable = None if fmu is None else numeric_variable(fmu, part.variable, is_input=is_input)
    unit, low, high, doc = part.unit, -math.inf, math.inf, f"variable {part.variable} of the FMU"
    if variable is not None:
        unit = _unit(part, variable)
        conversion = conversion_of(variable, unit)
        low = low if variable.low is None else conversion.to_si(variable.low)
        high = high if variable.high is None else conversion.to_si(variable.high)
        if variable.kind == "Boolean":
            low, high = 0.0, 1.0
        doc = variable.doc or doc
    if unit is None:
        raise _Wrong("unit", "give the unit: the FMU is not known here")
    if isinstance(part, FmuInput):
        low, high = _quantity("low", part.low, unit, low), _quantity("high", part.high, unit, high)
        safe = _quantity("safe", part.safe, unit, 0.0)
        if not low <= safe <= high:
            raise _Wrong(
                "safe", f"its safe value {part.safe} is not within {low:g} to {high:g} {unit}"
            )
    try:
        return Channel(name, unit, doc, low, high)
    except ValueError as error:
        raise _Wrong("unit", str(error)) from error


def _quantity(key: str, text: str | None, unit: str, default: float) -> float:
    """Return the entry ``key`` of an input in SI; 0 needs no unit."""
    if text is None:
        return default
    try:
        return 0.0 if text.strip() == "0" else In(unit).read(text)
    except ValueError as error:
        raise _Wrong(key, str(error)) from error


def numeric_variable(fmu: FmuFile, name: str, *, is_input: bool) -> Variable:
    """Return the variable ``name``: an input of the FMU, or an output or local variable of it.

    Raises:
        ValueError: there is no such variable, it is not numeric, or it has another causality.
    """
    variable = find(fmu, name)
    if variable.kind not in NUMBERS:
        raise ValueError(f"{name!r} is a {variable.kind}; a channel is a number")
    if is_input and variable.causality != "input":
        known = ", ".join(fmu.names("input")) or "none"
        raise ValueError(
            f"{name!r} is no input of the FMU but of causality {variable.causality!r}; "
            f"inputs: {known}"
        )
    if not is_input and variable.causality not in ("output", "local"):
        known = ", ".join(fmu.names("output")) or "none"
        raise ValueError(
            f"{name!r} is no output of the FMU but of causality {variable.causality!r}; "
            f"outputs: {known}"
        )
    return variable


def _unit(part: FmuOutput, variable: Variable) -> str:
    """Return the SI unit of the channel of ``variable``."""
    if part.unit is not None:
        parse_unit(part.unit)
        if variable.unit is not None:
            try:
                variable.unit.check(part.unit)
            except ValueError as error:
                raise _Wrong("unit", str(error)) from error
        return part.unit
    if variable.kind not in ("Real", "Float64", "Float32"):
        return "1"
    if variable.unit is None:
        gives = f"the unit {variable.unit_name!r}, which rigd cannot read" if (
            variable.unit_name
        ) else "no unit"  # fmt: skip
        raise _Wrong(
            "unit",
            f"the FMU gives {variable.name!r} {gives}: write "
            f"{{variable: {variable.name}, unit: ...}} with the SI unit of its numbers",
        )
    symbol = variable.unit.symbol()
    if symbol is None:
        raise _Wrong(
            "unit",
            f"the FMU gives {variable.name!r} in {variable.unit_name!r}, which is no SI unit: "
            f"write {{variable: {variable.name}, unit: ...}} with the SI unit of the channel",
        )
    return symbol


def conversion_of(variable: Variable, unit: str) -> FmuUnit:
    """Return how numbers of ``variable`` become values of a channel of the unit ``unit``."""
    return as_stated(unit) if variable.unit is None else variable.unit


class FmuDevice(Driver[FmuDeviceConfig, FmuPlant]):
    """A device whose setpoints are inputs of the FMU and whose channels are its outputs.

    Safe: every input has its ``safe`` value.
    """

    Config: ClassVar[type[DriverConfig]] = FmuDeviceConfig
    title: ClassVar[str] = "device in an FMU"
    plant_model: ClassVar[str] = "fmu"

    def __init__(self, config: FmuDeviceConfig, link: FmuPlant) -> None:
        super().__init__(config, link)
        self._safe = [
            _quantity("safe", part.safe, part.channel.unit, 0.0) for part in config.inputs.values()
        ]
        self._inputs = [
            (self._conversion(part), link.add_input(part.variable, self._number(part, safe)))
            for part, safe in zip(config.inputs.values(), self._safe, strict=True)
        ]
        self._outputs: list[tuple[Callable[[float], float], int]] = [
            (self._conversion(part).to_si, link.add_output(part.variable))
            for part in config.outputs.values()
        ]

    @classmethod
    def declare(cls, config: FmuDeviceConfig) -> Declaration:
        """Return the variables of the FMU as channels and setpoints."""
        return Declaration(
            channels=tuple(part.channel for part in config.outputs.values()),
            plain_rows=True,
            setpoints=tuple(part.channel for part in config.inputs.values()),
        )

    def open(self) -> None:
        """Report which FMU it is; the plant has set it up."""
        fmu = self.link.fmu
        self.identity = f"{fmu.model}, FMI {fmu.version}, by {fmu.tool}, GUID {fmu.token}"

    def arm(self) -> None:
        """Do nothing: it takes setpoints at once."""

    def read(self, t_ns: int) -> Sequence[float]:
        """Return the outputs after the last step.

        Raises:
            DeviceError: the FMU failed; see :meth:`FmuPlant.evolve`.
        """
        outputs = self.link.outputs_at(t_ns)
        return [to_si(outputs[place]) for to_si, place in self._outputs]

    def write(self, setpoints: Sequence[float]) -> None:
        """Give the inputs for the next step.

        Raises:
            DeviceError: a setpoint is NaN; those before it hold.
        """
        channels = self.declaration.setpoints
        values = [accepted(*pair) for pair in zip(channels, setpoints, strict=True)]
        self._give(values)

    def make_safe(self) -> None:
        """Give every input its safe value."""
        self._give(self._safe)

    def close(self) -> None:
        """End the process of the FMU."""
        self.link.close()

    def _give(self, values: Sequence[float]) -> None:
        for (conversion, place), value in zip(self._inputs, values, strict=True):
            self.link.inputs[place] = conversion.from_si(value)

    def _conversion(self, part: FmuOutput) -> FmuUnit:
        return conversion_of(self.link.fmu.variables[part.variable], part.channel.unit)

    def _number(self, part: FmuOutput, value: float) -> float:
        return self._conversion(part).from_si(value)

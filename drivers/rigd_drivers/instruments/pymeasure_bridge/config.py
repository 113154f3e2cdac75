"""Defines how a rig file describes an instrument of PyMeasure: class, address, attributes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Self

from annotated_types import Ge, Le, MinLen
from pydantic import BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from rigd.model.machine.extras import is_installed
from rigd.sdk import DriverConfig, In, WrongEntries, wrong_entry
from rigd_drivers.instruments.lines.config import ChannelName, LineChannel
from rigd_drivers.instruments.lines.outputs import ReadBack, check_read_back, check_safe_options
from rigd_drivers.instruments.polling import PolledConfig
from rigd_drivers.instruments.pymeasure_bridge.checking import Use, problems

#: The extra that brings PyMeasure.
EXTRA: Final = "pymeasure"
#: What must lie between a simulated instrument's file and its library in `visa_library`.
_SIMULATED: Final = "@sim"
#: Digits of a setpoint for PyMeasure: more would put 100 mA, computed from 0.1 A, above its limit.
_DIGITS: Final = 12
#: Longest time to an answer, in s, of an instrument that must be safe within 3 s: a process that
#: hangs is replaced after twice this and 1 s more, and the new one must open the instrument.
_MOST_IF_SET_S: Final = 0.5


def _listed(value: Any) -> Any:
    return [value] if isinstance(value, (str, Mapping)) else value


def _named(value: object) -> object:
    return {} if value is None else value


#: A truth value, a number or a text, as it is written; :func:`value_of` gives it.
Value = str
#: An attribute or method, with dots for channels: `ch_1.voltage`. No name begins with "_".
Attribute = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*(\.[A-Za-z][A-Za-z0-9_]*)*$")]
#: Methods that are called and attributes that are written, in order.
Actions = Annotated[
    tuple[Attribute | Annotated[Mapping[Attribute, Value], MinLen(1)], ...],
    BeforeValidator(_listed),
]


class AttributeChannel(LineChannel):
    """One attribute, whose value is one number."""

    read: Attribute
    """Attribute, such as voltage or ch_1.voltage."""


class AttributeSetpoint(ReadBack):
    """One setpoint, and the attribute that takes it."""

    write: Attribute
    """Attribute that sets it, such as source_voltage."""
    read: Attribute | None = None
    """Attribute with the setpoint that the instrument has taken; it is compared with the one sent.
    """


class AttributeState(DriverConfig):
    """An attribute that shows whether the instrument is safe."""

    read: Attribute
    """Attribute, such as output_enabled."""
    safe: Value
    """Its value if the instrument is safe, such as false."""
    ready: Value
    """Its value if the output is on, such as true."""

    @model_validator(mode="after")
    def _values_differ(self) -> Self:
        if value_of(self.safe) == value_of(self.ready):
            raise wrong_entry(f"'safe' and 'ready' are the same value {self.safe}", "ready")
        return self


class PymeasureConfig(PolledConfig):
    """A class of PyMeasure, its address, what is read, what is set and how it is made safe."""

    instrument: Annotated[str, Field(pattern=r"^[A-Za-z]\w*(\.[A-Za-z]\w*)+$")]
    """Class of the instrument, such as pymeasure.instruments.keithley.Keithley2000; or one of an
    installed package of yours, a subclass of pymeasure.instruments.Instrument.
    """
    address: Annotated[str, MinLen(1)]
    """VISA resource, such as ASRL/dev/ttyUSB0::INSTR, GPIB0::16::INSTR or
    TCPIP::192.168.1.31::5025::SOCKET.
    """
    visa_library: str = ""
    """VISA library: `@py` (PyVISA-py), `@ivi` (that of a maker), or `FILE@sim` with a file of
    PyVISA-sim beside the rig file. Empty: that of a maker if there is one, else `@py`.
    """
    connection: Mapping[ChannelName, Value] = {}
    """Settings of the connection that the class takes as keywords: `{baud_rate: 19200}`."""
    channels: Annotated[Mapping[ChannelName, AttributeChannel], MinLen(1)]
    """What is read, by name: `{voltage: {read: voltage, unit: V}}`."""
    setpoints: Annotated[Mapping[ChannelName, AttributeSetpoint], BeforeValidator(_named)] = {}
    """What is set, by name; then `safe` and `state` are needed too."""
    start: Actions = ()
    """What is done when it is opened, in order: `[reset, {mode: voltage}]` calls a method and then
    writes an attribute.
    """
    arm: Actions = ()
    """What switches its output on, behind the setpoints that are set to rest."""
    safe: Actions = ()
    """What makes it safe, from any state, such as shutdown or `{output_enabled: false}`."""
    state: AttributeState | None = None
    """How it shows that it is safe, and that its output is on."""
    identify: Attribute | None = None
    """Attribute with its identity, mostly id, which stands in the recording."""
    model: str = ""
    """Text that must be part of the identity, such as its model or serial number."""
    errors: Attribute | None = None
    """Method that returns the errors of its queue, such as check_errors, called after each row and
    each setpoint; an error ends the run.
    """
    period: Annotated[float, In("s"), Ge(0.05), Le(60)] = 0.5
    """Time from one row to the next."""
    timeout: Annotated[float, In("s"), Ge(0.02), Le(10)] = 0.5
    """Longest time to an answer; with setpoints at most 0.5 s."""
    silence: Annotated[float, In("s"), Ge(0.5), Le(600)] | None = None
    """Without a row for so long the instrument has failed; by default 3 s, or the time of 3 rows if
    that is more.
    """

    @field_validator("visa_library")
    @classmethod
    def _simulation_is_there(cls, library: str, info: ValidationInfo) -> str:
        """Find the file; ``folder`` in the context is the folder of the rig file."""
        name = library.removesuffix(_SIMULATED)
        if name == library or not name:
            return library
        path = Path((info.context or {}).get("folder") or Path.cwd()) / name
        if not path.is_file():
            raise ValueError(f"there is no file {path}")
        return f"{path.resolve()}{_SIMULATED}"

    @field_validator("setpoints")
    @classmethod
    def _within_is_above_0(
        cls, setpoints: Mapping[str, AttributeSetpoint]
    ) -> Mapping[str, AttributeSetpoint]:
        check_read_back(setpoints)
        return setpoints

    @model_validator(mode="after")
    def _safe_is_known(self) -> Self:
        options = {"arm": self.arm, "safe": self.safe, "state": self.state}
        check_safe_options(self.setpoints, options)
        if self.setpoints and self.timeout > _MOST_IF_SET_S:
            raise wrong_entry(
                f"timeout {self.timeout:g} s: an instrument with setpoints must be safe within "
                f"3 s, so at most {_MOST_IF_SET_S:g} s",
                "timeout",
            )
        if self.model and self.identify is None:
            raise wrong_entry(
                "'model' is compared with 'identify': give that too, such as id", "model"
            )
        return self

    @model_validator(mode="after")
    def _class_has_the_attributes(self) -> Self:
        """Ask PyMeasure, if it is installed, without opening the instrument."""
        if not is_installed(EXTRA):
            return self
        uses = list(self._uses())
        instrument, *found = problems(self.instrument, tuple(use for _, use in uses))
        wrong: list[tuple[tuple[str | int, ...], str]] = [
            (path, text) for (path, _), text in zip(uses, found, strict=True) if text
        ]
        if instrument:
            wrong = [(("instrument",), instrument)]
        if wrong:
            raise WrongEntries(wrong)
        return self

    def _uses(self) -> Iterator[tuple[tuple[str | int, ...], Use]]:
        """Yield each attribute with its place in the options."""
        for name, channel in self.channels.items():
            yield ("channels", name, "read"), Use(channel.read, "read")
        for name, item in self.setpoints.items():
            ends = tuple(number_of(item, item.bound(text)) for text in (item.low, item.high))
            yield ("setpoints", name, "write"), Use(item.write, "write", ends)
            if item.read is not None:
                yield ("setpoints", name, "read"), Use(item.read, "read")
        for key in ("start", "arm", "safe"):
            for path, value in steps(getattr(self, key)):
                use = Use(path, "call") if value is None else Use(path, "write", (value,))
                yield (key,), use
        if self.state is not None:
            yield ("state", "read"), Use(self.state.read, "read")
        if self.identify is not None:
            yield ("identify",), Use(self.identify, "read")
        if self.errors is not None:
            yield ("errors",), Use(self.errors, "call")


def value_of(text: Value) -> bool | int | float | str:
    """Return the truth value or number that ``text`` means; else the text."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def steps(actions: Actions) -> list[tuple[str, bool | int | float | str | None]]:
    """Return each attribute with the value that is written to it; a method with None."""
    found: list[tuple[str, bool | int | float | str | None]] = []
    for item in actions:
        if isinstance(item, str):
            found.append((item, None))
        else:
            found += [(path, value_of(text)) for path, text in item.items()]
    return found


def number_of(item: LineChannel, value: float) -> float:
    """Return the number that PyMeasure gets for ``value`` in SI."""
    return float(f"{item.number(value):.{_DIGITS}g}")


def class_name(instrument: str) -> str:
    """Return the name of the class without its module."""
    return re.sub(r".*\.", "", instrument)

"""Defines how a rig file describes an instrument with SCPI: questions, setpoints, safe state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Self

from annotated_types import Ge, Le, MinLen
from pydantic import BeforeValidator, field_validator, model_validator

from rigd.sdk import In
from rigd.sdk.port import PortConfig
from rigd_drivers.instruments.lines.config import ChannelName, Command, Commands, LineChannel
from rigd_drivers.instruments.lines.outputs import (
    LineOutput,
    LineState,
    ReadBack,
    check_read_back,
    check_safe_options,
    check_writes,
)
from rigd_drivers.instruments.lines.text import encoded
from rigd_drivers.instruments.polling import PolledConfig


class ScpiChannel(LineChannel):
    """One question, whose answer is one number."""

    ask: Command
    """Question, such as MEAS:TEMP?."""


class ScpiSetpoint(ReadBack, LineOutput):
    """One setpoint; `write` has its name in braces: SOUR:TEMP {temperature:.2f}."""

    read: Command | None = None
    """Question for the setpoint that the instrument has taken; it is compared with the one sent."""


def _named(value: object) -> object:
    return {} if value is None else value


class ScpiConfig(PolledConfig, PortConfig):
    """The port of an instrument, its questions, its setpoints and how it is made safe."""

    channels: Annotated[Mapping[ChannelName, ScpiChannel], MinLen(1)]
    """What is asked, by name: `{measured: {ask: 'MEAS:TEMP?', unit: degC}}`."""
    setpoints: Annotated[Mapping[ChannelName, ScpiSetpoint], BeforeValidator(_named)] = {}
    """What is set, by name; then `safe` and `state` are needed too."""
    arm: Commands = ()
    """Commands that switch its output on, behind those that set all setpoints to rest."""
    safe: Commands = ()
    """Commands that make it safe, at once and from any state, such as OUTP OFF."""
    state: LineState | None = None
    """How it shows that it is safe, and that its output is on."""
    identify: Command | None = "*IDN?"
    """Question for its identity, which stands in the recording."""
    model: str = ""
    """Text that must be part of the identity, such as its model or serial number."""
    errors: Command | None = "SYST:ERR?"
    """Question for the next entry of its error queue, asked after each row and each setpoint; an
    error ends the run. None for an instrument without a queue."""
    start: Commands = ("*CLS",)
    """Commands sent when it is opened, in order."""
    end: Command = "\\n"
    """End of each command."""
    period: Annotated[float, In("s"), Ge(0.05), Le(60)] = 0.5
    """Time from one row to the next."""
    timeout: Annotated[float, In("s"), Ge(0.02), Le(1)] = 0.5
    """Longest time to an answer."""
    silence: Annotated[float, In("s"), Ge(0.5), Le(600)] | None = None
    """Without a row for so long the instrument has failed; by default 3 s, or the time of 3 rows if
    that is more.
    """

    @field_validator("setpoints")
    @classmethod
    def _writes_have_their_setpoint(
        cls, setpoints: Mapping[str, ScpiSetpoint]
    ) -> Mapping[str, ScpiSetpoint]:
        check_writes(setpoints)
        check_read_back(setpoints)
        return setpoints

    @model_validator(mode="after")
    def _safe_is_known(self) -> Self:
        options = {"arm": self.arm, "safe": self.safe, "state": self.state}
        check_safe_options(self.setpoints, options)
        return self

    def line(self, command: str) -> bytes:
        """Return the bytes of a command with its end."""
        return encoded(command) + encoded(self.end)

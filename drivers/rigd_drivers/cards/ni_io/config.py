"""Defines the options of an NI card that drives a rig."""

from __future__ import annotations

import re
from typing import Annotated, Final, Literal, Self

from annotated_types import Ge, Le
from pydantic import AfterValidator, Field, model_validator

from rigd.sdk import Documented, In, LinkConfig, wrong_entry
from rigd_drivers.cards.ni_card import NiCardConfig
from rigd_drivers.cards.ni_daq.config import Terminal
from rigd_drivers.cards.watchdog import OneShotOptions

#: Lines of one port, as NI-DAQmx names them.
_LINES: Final = re.compile(r"^port(\d+)/line(\d+)(?::(\d+))?$")
#: More lines than one port has.
_MOST_LINES: Final = 32


def lines_of(text: str) -> list[str]:
    """Return the single lines that ``text`` names, such as ``port0/line0:7``.

    Raises:
        ValueError: it names none.
    """
    match = _LINES.match(text)
    if match is None:
        raise ValueError(f"{text!r} is not lines of a port, such as 'port0/line0:7'")
    port, first, last = match.group(1), int(match.group(2)), match.group(3)
    count = int(last or first) - first + 1
    if not 1 <= count <= _MOST_LINES:
        raise ValueError(f"{text!r} are {count} lines; a port has 1 to {_MOST_LINES}")
    return [f"port{port}/line{first + index}" for index in range(count)]


def _checked(text: str) -> str:
    lines_of(text)
    return text


Lines = Annotated[str, AfterValidator(_checked)]
Counter = Annotated[int, Ge(0), Le(7)]


class WatchdogOptions(Documented):
    """The watchdog timer of the card itself (NI-DAQmx: watchdog timer task)."""

    output: Annotated[int, Ge(0)]
    """Digital output that stands high while rigd feeds the watchdog. The card brings it low when
    the timer expires."""
    input: Annotated[int, Ge(0)]
    """Digital input that this output is wired to, by which the watchdog is proven and watched."""
    time: Annotated[float, In("s"), Ge(0.01), Le(1)]
    """After so long without a cycle the timer expires."""
    analog: bool = True
    """Whether the timer brings the analogue outputs to 0 V, too. Some cards guard digital lines
    alone (`analog: false`): then the drive must obey its enable line."""


class NiIoConfig(NiCardConfig, LinkConfig):
    """Which card, what of it is used, and what stops the drives when this computer fails."""

    analog_outputs: Annotated[int, Ge(0), Le(32)] = 2
    """How many analogue outputs rigd drives, from ao0 on; at rest all give 0 V."""
    output_lines: Lines = "port0/line0:7"
    """Lines that are digital outputs 0, 1, ...; rigd drives them all."""
    input_lines: Lines | None = None
    """Lines that are digital inputs 0, 1, ...; none: no digital inputs."""
    high_at_rest: tuple[Annotated[int, Ge(0)], ...] = ()
    """Digital outputs that stand high while nothing is driven, such as enable lines that are
    active low; all others stand low."""
    terminal: Terminal = Terminal.DEFAULT
    """How the analogue inputs are wired: default, rse, nrse, differential or
    pseudo-differential."""
    decoding: Literal["x1", "x2", "x4"] = "x4"
    """How the counters count the edges of encoders."""
    edge_counters: tuple[Counter, ...] = ()
    """Counters that count the rising edges of their input, in place of an encoder."""
    index_counters: dict[Counter, Counter] = Field(default_factory=dict)
    """Which edge counter counts the index pulses of which encoder, as `{0: 2}`."""
    one_shot: OneShotOptions | None = None
    """Watchdog beside the card: a one-shot on the enable lines."""
    watchdog: WatchdogOptions | None = None
    """Watchdog in the card: its own timer."""

    @property
    def outputs(self) -> list[str]:
        """The digital outputs, by number, without the name of the card."""
        return lines_of(self.output_lines)

    @property
    def inputs(self) -> list[str]:
        """The digital inputs, by number, without the name of the card."""
        return [] if self.input_lines is None else lines_of(self.input_lines)

    @property
    def guard(self) -> OneShotOptions | WatchdogOptions | None:
        """The one-shot or the watchdog, whichever there is."""
        return self.one_shot or self.watchdog

    @model_validator(mode="after")
    def _lines_are_apart(self) -> Self:
        both = sorted(set(self.outputs) & set(self.inputs))
        if both:
            raise wrong_entry(
                f"{both[0]} is a digital output and an input: correct one",
                "inputs",
                self.inputs.index(both[0]),
            )
        for place, line in enumerate(self.high_at_rest):
            _check_line("output", line, self.outputs, "high_at_rest", place)
        return self

    @model_validator(mode="after")
    def _one_guard(self) -> Self:
        if self.one_shot is not None and self.watchdog is not None:
            raise wrong_entry(
                "give `one_shot` or `watchdog`, not both: one of them feeds the rig", "watchdog"
            )
        if self.guard is not None:
            name = "watchdog" if self.one_shot is None else "one_shot"
            _check_line("output", self.guard.output, self.outputs, name, "output")
            _check_line("input", self.guard.input, self.inputs, name, "input")
        if self.watchdog is not None and self.watchdog.output in self.high_at_rest:
            raise wrong_entry(
                f"digital output {self.watchdog.output} of `watchdog` stands low at rest; remove "
                "it from `high_at_rest`",
                "high_at_rest",
                self.high_at_rest.index(self.watchdog.output),
            )
        return self

    @model_validator(mode="after")
    def _indexes_are_edges(self) -> Self:
        for encoder, counter in self.index_counters.items():
            if counter not in self.edge_counters:
                raise wrong_entry(
                    f"counter {counter} counts the index of encoder {encoder}; name it in "
                    "`edge_counters`",
                    "index_counters",
                    encoder,
                )
        return self


def _check_line(kind: str, line: int, known: list[str], key: str, below: str | int) -> None:
    if line >= len(known):
        have = f"there are 0 to {len(known) - 1}" if known else f"`{kind}_lines` names none"
        raise wrong_entry(f"`{key}` uses digital {kind} {line}; {have}", key, below)

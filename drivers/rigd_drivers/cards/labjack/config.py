"""Defines the options of a LabJack T7 or T4 that drives a rig."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Final, Literal, Self

from annotated_types import Ge, Le
from pydantic import AfterValidator, Field, field_validator, model_validator

from rigd.sdk import Documented, In, LinkConfig, wrong_entry
from rigd_drivers.cards.watchdog import OneShotOptions

Line = Annotated[int, Ge(0), Le(22)]


@dataclass(frozen=True)
class Product:
    """What a device of the T series has (T-Series Datasheet, "Hardware Overview" and "DIO-EF")."""

    number: int  #: what PRODUCT_ID reads
    lines: range  #: digital lines
    inputs: range  #: analogue inputs of +-10 V
    phases: tuple[int, ...]  #: lines for phase A of an encoder, B is on the next
    edges: tuple[int, ...]  #: lines that can count edges
    best_resolution: int


PRODUCTS: Final = {
    "T7": Product(7, range(23), range(14), (0, 2, 6), (0, 1, 2, 3, 6, 7), 8),
    "T4": Product(4, range(4, 20), range(4), (4, 6, 8), (4, 5, 6, 7, 8, 9), 5),
}
_OUTPUT: Final = re.compile(r"^(?:DAC([01])|TDAC(\d{1,2}))$")
_MOST_TDAC: Final = 21
#: The volts between the ends of DAC0 and DAC1, and those of an LJTick-DAC.
DAC_SPAN_V: Final = (0.0, 5.0)
TDAC_SPAN_V: Final = (-10.0, 10.0)


def _checked(name: str) -> str:
    match = _OUTPUT.match(name)
    if match is None or int(match[2] or 0) > _MOST_TDAC:
        raise ValueError(f"{name!r} is no output; expected DAC0, DAC1 or TDAC0 to TDAC{_MOST_TDAC}")
    return name


AnalogOutput = Annotated[str, AfterValidator(_checked)]


def tick_of(output: str) -> int | None:
    """Return the number of an output of an LJTick-DAC; None for one of the device itself."""
    return int(output[4:]) if output.startswith("TDAC") else None


class LabjackWatchdogOptions(Documented):
    """The watchdog of the device, in strict mode: nothing but rigd's key feeds it."""

    output: Line
    """Digital output that stands high while rigd feeds the watchdog, which brings it low when its
    time is over."""
    input: Line
    """Digital input that this output is wired to, by which the watchdog is proven and watched."""
    timeout: Annotated[float, In("s"), Ge(1), Le(60)] = 1.0
    """Time of the watchdog as the device keeps it, in whole seconds (1 s at least)."""
    time: Annotated[float, In("s"), Ge(1), Le(120)] | None = None
    """After so long without a cycle the outputs are at rest; more than that is refused when it is
    proven. By default 1 s more than `timeout`, since the device counts in seconds."""

    @field_validator("timeout")
    @classmethod
    def _whole(cls, timeout: float) -> float:
        if timeout != round(timeout):
            raise ValueError(f"{timeout:g} s is not a whole number of seconds")
        return timeout

    @model_validator(mode="after")
    def _time_fits(self) -> Self:
        if not self.timeout <= self.bound_s <= 3 * self.timeout:
            raise wrong_entry(
                f"`time` of {self.bound_s:g} s must be between {self.timeout:g} s, the `timeout` "
                f"of the device, and {3 * self.timeout:g} s",
                "time",
            )
        return self

    @property
    def bound_s(self) -> float:
        """:attr:`time`, or its default."""
        return self.timeout + 1.0 if self.time is None else self.time


class LabjackConfig(LinkConfig):
    """Which device, what of it is used, and what stops the drives when this computer fails.

    Digital lines have the numbers of LabJack's DIO: FIO0 to 7 are 0 to 7, EIO0 to 7 are 8 to 15,
    CIO0 to 3 are 16 to 19, MIO0 to 2 are 20 to 22.
    """

    host: Annotated[str, Field(pattern=r"^\S+$")]
    """Address of the device on Ethernet. The connection is neither encrypted nor authenticated:
    use it on a network of your own."""
    port: Annotated[int, Ge(1), Le(65535)] = 502
    """TCP port of the device."""
    product: Literal["T7", "T4"] = "T7"
    """Which device it must be; checked when it is opened. A T7-Pro is a T7."""
    serial: Annotated[int, Ge(1)] | None = None
    """Serial number that the device must have, as printed on it."""
    analog_outputs: tuple[AnalogOutput, ...] = ()
    """Analogue outputs 0, 1, ...: TDAC0 to TDAC21 of an LJTick-DAC (-10 to 10 V; TDAC4 and TDAC5
    are DACA and DACB of one on FIO4 and FIO5), or DAC0 and DAC1 (0 to 5 V). At rest all give
    0 V."""
    outputs: tuple[Line, ...] = ()
    """Lines that are digital outputs."""
    inputs: tuple[Line, ...] = ()
    """Lines that are digital inputs."""
    high_at_rest: tuple[Line, ...] = ()
    """Digital outputs that stand high while nothing is driven, such as enable lines that are
    active low; all others stand low."""
    edge_counters: tuple[Line, ...] = ()
    """Lines that count rising edges. An encoder is not declared: encoder 0 has its phases on
    lines 0 and 1."""
    index_counters: dict[Line, Line] = Field(default_factory=dict)
    """Which edge counter counts the index pulses of which encoder, as `{0: 6}`."""
    differential: tuple[Annotated[int, Ge(0), Le(12)], ...] = ()
    """Analogue inputs that are measured against the next one (even numbers, T7); all others against
    ground."""
    resolution: Annotated[int, Ge(1), Le(8)] = 1
    """Resolution index of the analogue inputs: a higher one has less noise and takes longer."""
    one_shot: OneShotOptions | None = None
    """Watchdog beside the device: a one-shot on the enable lines."""
    watchdog: LabjackWatchdogOptions | None = None
    """Watchdog in the device."""

    @property
    def facts(self) -> Product:
        """What the product has."""
        return PRODUCTS[self.product]

    @property
    def guard(self) -> OneShotOptions | LabjackWatchdogOptions | None:
        """The one-shot or the watchdog, whichever there is."""
        return self.one_shot or self.watchdog

    @property
    def guard_s(self) -> float | None:
        """How long the guard stays up at most without a cycle, in s."""
        if self.watchdog is not None:
            return self.watchdog.bound_s
        return None if self.one_shot is None else self.one_shot.time

    @property
    def tick_lines(self) -> dict[int, int]:
        """The lines that LJTick-DACs are plugged into, each with its place in `analog_outputs`."""
        ticks = {tick_of(item): place for place, item in enumerate(self.analog_outputs)}
        return {
            line: place
            for number, place in ticks.items()
            if number is not None
            for line in (number & ~1, number | 1)
        }

    @model_validator(mode="after")
    def _lines_exist_once(self) -> Self:
        facts = self.facts
        uses = {
            "outputs": [*enumerate(self.outputs)], "inputs": [*enumerate(self.inputs)],
            "edge_counters": [*enumerate(self.edge_counters)],
            "analog_outputs": [(place, line) for line, place in self.tick_lines.items()],
        }  # fmt: skip
        used: dict[int, str] = {}
        for key, lines in uses.items():
            known = facts.edges if key == "edge_counters" else facts.lines
            for place, line in lines:
                if line not in known:
                    raise wrong_entry(
                        f"`{key}`: line {line} of a {self.product} cannot be that; "
                        f"{_listed(known)} can",
                        key,
                        place,
                    )
                if line in used:
                    raise wrong_entry(
                        f"line {line} is in `{used[line]}` and in `{key}`: correct one", key, place
                    )
                used[line] = key
        for place, line in enumerate(self.high_at_rest):
            if line not in self.outputs:
                raise wrong_entry(
                    f"`high_at_rest` has line {line}, which is not in `outputs`",
                    "high_at_rest",
                    place,
                )
        for place, item in enumerate(self.analog_outputs):
            if item in self.analog_outputs[:place]:
                raise wrong_entry("`analog_outputs` names an output twice", "analog_outputs", place)
        return self

    @model_validator(mode="after")
    def _one_guard(self) -> Self:
        if self.one_shot is not None and self.watchdog is not None:
            raise wrong_entry(
                "give `one_shot` or `watchdog`, not both: one of them feeds the rig", "watchdog"
            )
        if self.guard is None:
            return self
        name = "watchdog" if self.one_shot is None else "one_shot"
        for key, lines in (("output", self.outputs), ("input", self.inputs)):
            line = getattr(self.guard, key)
            if line not in lines:
                raise wrong_entry(f"`{name}` uses line {line}, which is not in `{key}s`", name, key)
        if self.watchdog is not None and self.watchdog.output in self.high_at_rest:
            raise wrong_entry(
                f"line {self.watchdog.output} of `watchdog` stands low at rest; remove it from "
                "`high_at_rest`",
                "high_at_rest",
                self.high_at_rest.index(self.watchdog.output),
            )
        return self

    @model_validator(mode="after")
    def _inputs_are_possible(self) -> Self:
        facts = self.facts
        if self.resolution > facts.best_resolution:
            raise wrong_entry(
                f"`resolution` of a {self.product} is at most {facts.best_resolution}", "resolution"
            )
        for place, number in enumerate(self.differential):
            if self.product != "T7" or number % 2:
                raise wrong_entry(
                    f"input {number} of a {self.product} cannot be differential; those of even "
                    "number of a T7 can",
                    "differential",
                    place,
                )
        for encoder, counter in self.index_counters.items():
            if counter not in self.edge_counters:
                raise wrong_entry(
                    f"line {counter} counts the index of encoder {encoder}; name it in "
                    "`edge_counters`",
                    "index_counters",
                    encoder,
                )
        return self


def _listed(lines: Iterable[int]) -> str:
    if isinstance(lines, range):
        return f"lines {lines[0]} to {lines[-1]}"
    return f"lines {', '.join(map(str, lines))}"

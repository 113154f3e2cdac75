"""What a Config offers, described for a person."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le, Lt

from rigd.sdk import DriverConfig, In
from rigd.sdk.options.options import Option, options_of


class Level(Enum):
    HIGH = "high"
    LOW = "low"


class Input(DriverConfig):
    """One input."""

    zero: Annotated[float, In("V")] = 0.5
    """Volts at zero."""
    gain: float | None = None
    """Of an unknown thing."""


class Config(DriverConfig):
    """Options of every kind."""

    port: str
    """Where it is.

    Best by its serial number.
    """
    axis: Literal["wheel", "carriage"] = "wheel"
    """Which one."""
    level: Level = Level.LOW
    """Which level."""
    inverted: bool = False
    """Whether it is."""
    count: Annotated[int, Ge(1), Lt(9)] = 4
    """How many."""
    range: Annotated[float, In("A"), Gt(0), Le(10)] | None = None
    """How far."""
    ratio: Annotated[float, In("1")] = 20.25
    """How much."""
    inputs: tuple[Input, ...] = ()
    """The inputs."""
    reference: Input = Input()
    """One more."""
    words: Mapping[str, int] = {}
    """Numbers by name."""
    file: Path | str = ""
    """A file."""


def test_every_option_is_listed() -> None:
    told = {item.name: item for item in options_of(Config)}
    assert told["port"] == Option(
        "port", "text", None, True, "", "Where it is.\n\nBest by its serial number."
    )
    assert told["axis"].kind == "wheel or carriage"
    assert (told["level"].kind, told["level"].default) == ("high or low", "low")
    assert (told["inverted"].kind, told["inverted"].default) == ("true or false", "false")
    assert told["count"].kind == "a whole number, at least 1, less than 9"
    assert told["range"].kind == "a quantity in A, more than 0 A, at most 10 A"
    assert (told["range"].unit, told["range"].default) == ("A", "none")
    assert (told["ratio"].kind, told["ratio"].default) == ("a pure number", "20.25")
    assert (told["inputs"].kind, told["inputs"].default) == ("a list of keys as below", "empty")
    assert (told["inputs.zero"].default, told["inputs.zero"].doc) == ("0.5 V", "Volts at zero.")
    assert told["reference"].default == "as below"
    assert told["words"].kind == "names with a whole number each"
    assert told["file"].kind == "a path or text"
    assert list(told).index("inputs.zero") == list(told).index("inputs") + 1


def test_option_with_unitless_number_is_marked() -> None:
    assert [item.name for item in options_of(Config) if item.bare] == [
        "inputs.gain",
        "reference.gain",
    ]

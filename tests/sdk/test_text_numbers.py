"""Numbers that are text, as in a rig file, are read by every option."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import Enum, IntEnum
from importlib.metadata import entry_points
from typing import Annotated, Any, Literal, get_args, get_origin

import pytest
from annotated_types import Le
from pydantic import BaseModel, ValidationError, create_model

from rigd.sdk import Documented

#: Where drivers, links, plants, simulations and observers declare their options.
GROUPS = ("rigd.drivers", "rigd.links", "rigd.plants", "rigd.simulations", "rigd.observers")


class Bits(Enum):
    SEVEN = 7
    EIGHT = 8


class Lines(IntEnum):
    ONE = 1
    TWO = 2


class Part(Documented):
    stop_bits: Literal[1, 2] = 1


class Options(Documented):
    bits: Bits = Bits.EIGHT
    lines: Lines = Lines.ONE
    rate: Literal[100, "auto"] = "auto"
    function: Literal[3, 16] | None = None
    address: Annotated[int, Le(0xFFFF)] = 0
    by_name: Mapping[str, Literal[1, 2]] = {}
    many: tuple[Literal[1, 2], ...] = ()
    part: Part = Part()
    parts: tuple[Part, ...] = ()
    word: Literal["1", "2"] = "1"


def test_choices_of_numbers_are_read_from_text() -> None:
    options = Options.model_validate(
        {"bits": "7", "lines": "2", "rate": "100", "function": "0x10", "address": "0x0304",
         "by_name": {"a": "2"}, "many": ["1", "2"], "part": {"stop_bits": "2"},
         "parts": [{"stop_bits": "2"}], "word": "2"}
    )  # fmt: skip
    assert options == Options(
        bits=Bits.SEVEN, lines=Lines.TWO, rate=100, function=16, address=0x304,
        by_name={"a": 2}, many=(1, 2), part=Part(stop_bits=2), parts=(Part(stop_bits=2),), word="2",
    )  # fmt: skip
    assert Options.model_validate({"rate": "auto"}).rate == "auto"


@pytest.mark.parametrize(
    "given",
    [{"bits": "6"}, {"function": "4"}, {"rate": "1_0_0x"}, {"address": "0x10000"},
     {"address": "four"}, {"lines": "3"}, {"part": {"stop_bits": "1.5"}}, {"word": "3"}],
)  # fmt: skip
def test_numbers_not_allowed_are_refused_as_before(given: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Options.model_validate(given)


def test_strict_model_takes_no_text_for_number() -> None:
    strict = create_model("Strict", __base__=Documented, __cls_kwargs__={"strict": True},
                          number=(Literal[1], ...))  # fmt: skip
    with pytest.raises(ValidationError):
        strict.model_validate({"number": "1"})


def declared() -> Iterator[Any]:
    for group in GROUPS:
        for point in entry_points(group=group):
            if point.dist is None or point.dist.name != "rigd":
                continue
            for where, annotation in _fields(point.load().Config, point.name):
                yield pytest.param(annotation, id=where)


def _fields(model: type[BaseModel], where: str) -> Iterator[tuple[str, Any]]:
    for name, field in model.model_fields.items():
        for item in _within(field.annotation):
            if isinstance(item, type) and issubclass(item, BaseModel):
                yield from _fields(item, f"{where}.{name}")
            elif get_origin(item) is Literal or (isinstance(item, type) and issubclass(item, Enum)):
                yield f"{where}.{name}", item


def _within(annotation: Any) -> Iterator[Any]:
    yield annotation
    if get_origin(annotation) is not Literal:
        for item in get_args(annotation):
            yield from _within(item)


@pytest.mark.parametrize("annotation", list(declared()))
def test_each_choice_of_shipped_options_can_be_written(annotation: Any) -> None:
    choices = get_args(annotation) or [item.value for item in annotation]
    model = create_model("Model", __base__=Documented, option=(annotation, ...))
    for choice in choices:
        read = model.model_validate({"option": str(choice)})
        assert read == model.model_validate({"option": choice})

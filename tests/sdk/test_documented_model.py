"""Fields are described by the strings beneath them, as the author of a driver writes them."""

from pydantic import Field, create_model

from rigd.sdk import Documented
from rigd.sdk.options.documented_model import description


class Port(Documented):
    speed: int
    """How fast
    it is.
    """
    first: int = Field(alias="from")
    """Where it begins."""
    told: int = Field(0, description="In the field itself.")
    """Beneath it."""
    silent: int = 0


class FastPort(Port):
    speed: int = 9
    more: int = 0
    """What only this one has."""


def test_field_is_described_by_the_string_beneath() -> None:
    assert description(Port, "speed") == "How fast\nit is."
    assert description(Port, "told") == "In the field itself."
    assert description(Port, "silent") is None


def test_inherited_field_keeps_its_description_unless_redeclared() -> None:
    assert description(FastPort, "first") == "Where it begins."
    assert description(FastPort, "more") == "What only this one has."
    assert description(FastPort, "speed") is None


def test_model_without_source_has_no_descriptions() -> None:
    made = create_model("Made", __base__=Documented, size=(int, 0))
    assert description(made, "size") is None


def test_class_within_a_function_is_described() -> None:
    class Within(Documented):
        size: int
        """How large it is."""

    assert description(Within, "size") == "How large it is."


def test_schema_carries_each_description_by_alias() -> None:
    properties = FastPort.model_json_schema()["properties"]
    told = {name: field.get("description") for name, field in properties.items()}
    assert told == {
        "speed": None,
        "from": "Where it begins.",
        "told": "In the field itself.",
        "silent": None,
        "more": "What only this one has.",
    }

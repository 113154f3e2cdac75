"""Reads the description of a rig, and makes the real rig and its simulated sibling of it.

Both are documents whose entries have the places of the description: whatever the checks of rig
files find is shown where its author wrote it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

from annotated_types import Len
from pydantic import BeforeValidator, Field

from rigd.config.binding import bind
from rigd.config.document import Document, KeyPath
from rigd.config.loader import build_rig
from rigd.config.problems import Problems, suggest
from rigd.config.registry import find_driver, find_plant
from rigd.config.rig import DeviceConfig, RigConfig
from rigd.config.source import DeviceSource, Name, Source
from rigd.model.errors import ConfigError
from rigd.model.units import parse_unit
from rigd.sdk import Declaration, ParametersConfig

#: The plant that the description is of, and its files in the folder.
PLANT: Final = "mechanism"
PLANT_FILE: Final = "plant.yaml"
REAL_FILE: Final = "real.yaml"
SIM_FILE: Final = "sim.yaml"
#: Supervision of the rigs without hardware, for a machine that others use as well.
PATIENT: Final = {"cycle_silence": "250 ms", "daemon_silence": "1 s"}
#: Keys of the description that both rig files have as they stand.
SHARED: Final = ("derived", "observers", "controllers", "interlocks", "constants")
#: Keys of a device that only the simulated one has, as its options.
SIMULATED: Final = ("channels", "setpoints")


class DescribedDevice(DeviceSource):
    """A device: as in a rig file, and which parts of the mechanism stand for it."""

    channels: dict[Name, Any] = Field(default_factory=dict)
    """The sensor behind each channel, as the options of `sim-mechanism` have it."""
    setpoints: dict[Name, Name] = Field(default_factory=dict)
    """The drive behind each setpoint."""


class FirstSource(Source):
    """What the first procedure does."""

    values: Annotated[
        list[str],
        Len(1, 20),
        BeforeValidator(lambda item: item if isinstance(item, list) else [item]),
    ]
    """Setpoints of its trials."""
    setpoint: str
    """The setpoint that it sets, as `device.setpoint`."""
    seconds: Annotated[str, Field(alias="for")] = "5 s"
    """How long each is held, in the step `hold`."""
    measure: dict[str, Any] = Field(default_factory=dict)
    """What is read off each trial, as `measure` of a procedure."""
    accept: dict[str, Any] = Field(default_factory=dict)
    """What that must be, as `accept` of a procedure."""


class RigDescription(Source):
    """A rig, with the mechanism that simulates it."""

    title: Annotated[str, Len(1, 100)]
    """One line for a person."""
    cycle: str = "1 kHz"
    """Rate of the cycle."""
    mechanism: dict[str, Any]
    """Bodies, springs, friction, drives and sensors (docs/mechanism.md)."""
    devices: Annotated[dict[Name, DescribedDevice], Len(1, 64)]
    """The devices of the real rig."""
    links: dict[Name, Any] = Field(default_factory=dict)
    """Connections that devices share."""
    derived: dict[str, Any] = Field(default_factory=dict)
    """Derived channels."""
    observers: dict[str, Any] = Field(default_factory=dict)
    """Observers."""
    controllers: dict[str, Any] = Field(default_factory=dict)
    """Controllers."""
    interlocks: list[Any]
    """Conditions that end a run; `[]` if there are none."""
    constants: dict[str, Any] = Field(default_factory=dict)
    """Known quantities."""
    first: FirstSource | None = None
    """What the first procedure does; by default a quarter and a half of the first setpoint."""


@dataclass(frozen=True)
class Twins:
    """Real rig and sibling, as data and checked."""

    real: Mapping[str, Any]
    sim: Mapping[str, Any]
    real_rig: RigConfig
    sim_rig: RigConfig
    first: FirstSource | None


def read_twins(document: Document, name: str, folder: Path) -> Twins:
    """Return both rigs of a description; ``folder`` has ``plant.yaml`` and will have them.

    Raises:
        ConfigError: the description is wrong; every problem with its place in it.
    """
    problems = Problems()
    given = bind(document, RigDescription, problems)
    _check_mechanism(document, problems)
    problems.raise_any()
    if given is None:
        raise ConfigError("the description cannot be used", place=document.place(()))
    real, sim = _real(document, name), _sim(document, name)
    real_rig = build_rig(_document(document, real, folder / REAL_FILE, is_real=True))
    for device in given.devices:
        declared = _simulated(document, device, folder, problems)
        if declared is not None:
            _compare(document, real_rig.devices[device], declared, problems)
    problems.raise_any()
    sim_rig = build_rig(_document(document, sim, folder / SIM_FILE, is_real=False))
    return Twins(real, sim, real_rig, sim_rig, given.first)


def _check_mechanism(document: Document, problems: Problems) -> None:
    if document.get(("mechanism",)) is None:
        return  # noted as missing
    config = find_plant(PLANT).Config
    if not issubclass(config, ParametersConfig):
        raise TypeError(f"the plant {PLANT} takes no file")
    bind(document, config.parameter_model(), problems, ("mechanism",))


def _real(document: Document, name: str) -> dict[str, Any]:
    data: Any = document.data
    devices = {
        device: {key: value for key, value in entry.items() if key not in SIMULATED}
        for device, entry in data["devices"].items()
    }
    links = {"links": data["links"]} if data.get("links") else {}
    return {
        "rig": name,
        "title": data["title"],
        "cycle": data.get("cycle", "1 kHz"),
        "sibling": SIM_FILE,
        **links,
        "devices": devices,
        **{key: data[key] for key in SHARED if key in data},
    }


def _sim(document: Document, name: str) -> dict[str, Any]:
    data: Any = document.data
    devices = {
        device: {
            "driver": f"sim-{PLANT}",
            "options": {key: entry[key] for key in SIMULATED if key in entry},
            **({"limits": entry["limits"]} if "limits" in entry else {}),
            **_display(entry),
        }
        for device, entry in data["devices"].items()
    }
    return {
        "rig": f"{name}-sim",
        "title": f"{data['title']}, simulated",
        "cycle": data.get("cycle", "1 kHz"),
        "supervision": PATIENT,
        "plant": {"model": PLANT, "parameters": PLANT_FILE},
        "devices": devices,
        **{key: data[key] for key in SHARED if key in data},
    }


def _display(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return the units for people of the channels that the simulated device has, if any."""
    names = {name for key in SIMULATED for name in entry.get(key) or {}}
    shown = {name: unit for name, unit in entry.get("display", {}).items() if name in names}
    return {"display": shown} if shown else {}


def _document(document: Document, data: dict[str, Any], path: Path, *, is_real: bool) -> Document:
    """Return ``data`` as a document with the places of the description."""

    def moved(places: Mapping[KeyPath, Any]) -> dict[KeyPath, Any]:
        found = {}
        for where, place in places.items():
            target = where
            if not is_real and where[:1] == ("devices",) and where[2:3] and where[2] in SIMULATED:
                target = (*where[:2], "options", *where[2:])
            elif not is_real and where[:1] == ("devices",) and where[2:3] == ("options",):
                continue
            found[target] = place
        return found

    return Document(path, document.text, data, moved(document.values), moved(document.keys))


def _simulated(
    document: Document, device: str, folder: Path, problems: Problems
) -> Declaration | None:
    """Return what the simulated device declares; None with the problems noted."""
    driver = find_driver(f"sim-{PLANT}")
    plant = find_plant(PLANT).Config.model_validate(
        {"parameters": str(folder.resolve() / PLANT_FILE)}
    )
    entry: Any = document.get(("devices", device))
    options = {key: entry[key] for key in SIMULATED if key in entry}
    config = bind(document, driver.Config, problems, ("devices", device), data=options, plant=plant)
    return None if config is None else driver.declare(config)


def _compare(document: Document, real: DeviceConfig, sim: Declaration, problems: Problems) -> None:
    """Note what the real device has not, and setpoints that no drive takes."""
    base = ("devices", real.name)
    measured = {item.name: item for item in real.declaration.channels}
    for channel in sim.channels:
        near = channel.raw_of or channel.name
        where = (*base, "channels", channel.name if channel.raw_of is None else near)
        other = measured.get(channel.name)
        if other is None:
            problems.add(
                document.key_place(where),
                f"{real.driver} has no channel {channel.name!r}", suggest(channel.name, measured),
            )  # fmt: skip
        elif not parse_unit(other.unit).same_kind(parse_unit(channel.unit)):
            problems.add(
                document.place(where),
                f"{channel.name!r} of {real.driver} is in {other.unit}, that of the mechanism in "
                f"{channel.unit}",
            )
    taken = {item.name: item for item in real.declaration.setpoints}
    given = {item.name: item for item in sim.setpoints}
    for name in given.keys() - taken.keys():
        problems.add(
            document.key_place((*base, "setpoints", name)),
            f"{real.driver} has no setpoint {name!r}", suggest(name, taken),
        )  # fmt: skip
    for name, setpoint in taken.items():
        if name not in given:
            problems.add(
                document.place((*base, "setpoints")),
                f"{real.driver} also takes the setpoint {name!r} in {setpoint.unit}: name the "
                "drive behind it under 'setpoints'",
            )
        elif not parse_unit(given[name].unit).same_kind(parse_unit(setpoint.unit)):
            problems.add(
                document.place((*base, "setpoints", name)),
                f"{name!r} of {real.driver} is in {setpoint.unit}, that of the drive in "
                f"{given[name].unit}",
            )

"""Makes the rig at the wire: the real rig file, with its devices served by `rigd sim`.

For the drivers of :data:`_SERVED`, behind which simulated devices stand.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, Final

from rigd.cli.plugins.new_rig.description import PATIENT, PLANT_FILE
from rigd.model.units import parse_quantity, parse_unit

WIRE_FILE: Final = "wire.yaml"
DRIVE: Final = "cia402-rotary"
CARD: Final = "ni-daq"
#: Address of the first simulated card; each further one has the next port.
_PORT: Final = 31790
#: Silence of a device or of the cycle that ends a run: long, as :data:`PATIENT` is.
_SILENCE: Final = PATIENT["cycle_silence"]
#: Makes of speed drives on Modbus that are simulated; they have the names of their maps.
_MAKES: Final = ("delta-asda-b", "schneider-atv320")
#: A group of the pattern of a line, and the forms of a number that are tried in its place.
_GROUP: Final = re.compile(r"\(\?P<(\w+)>(?:[^()\\]|\\.)*\)")
_FORMS: Final = (".3f", "+.3f", ".2f", "+.2f", ".1f", "+.1f", ".0f")


class NotServed(Exception):
    """Nothing simulates a device of the rig at the wire; the message has the reason."""


def at_wire(name: str, real: Mapping[str, Any], described: Mapping[str, Any]) -> dict[str, Any]:
    """Return the rig file.

    ``real`` is the real rig, ``described`` the devices of the description.

    Raises:
        NotServed: nothing simulates one of its devices at the wire.
    """
    links = real.get("links", {})
    for key, item in links.items():
        if item["type"] != "can":
            raise NotServed(f"no link of type {item['type']} is simulated: {key}")
    folder = f"/tmp/rigd-{name}"  # a place for sockets, whose names must be short
    devices = {key: dict(item) for key, item in real["devices"].items()}
    served: dict[str, dict[str, Any]] = {"drives": {}, "cards": {}, "modbus": {}, "lines": {}}
    for device, item in described.items():
        if item["driver"] not in _SERVED:
            known = ", ".join(sorted(_SERVED))
            raise NotServed(f"nothing simulates {device}, of {item['driver']}; only {known}")
        group, make = _SERVED[item["driver"]]
        place = f"127.0.0.1:{_PORT + len(served[group])}" if group == "cards" else folder
        served[group][device], changed = make(device, item, place)
        devices[device]["options"] = changed
    buses = {
        key: {**item, "options": {**item["options"], "interface": "hub",
                                  "channel": f"{folder}/{key}"}}
        for key, item in links.items()
    }  # fmt: skip
    simulation = {
        "model": "wire-mechanism",
        "folder": folder,
        "plant": {"parameters": PLANT_FILE},
        **({"buses": {key: {} for key in buses}} if buses else {}),
        **{group: parts for group, parts in served.items() if parts},
    }
    rest = ("rig", "title", "links", "devices", "controllers", "interlocks")
    controllers = {key: _patient(item) for key, item in real.get("controllers", {}).items()}
    return {
        "rig": f"{name}-wire",
        "title": f"{real['title']}, devices at the wire",
        **{key: real[key] for key in ("cycle", "sibling")},
        "supervision": PATIENT,
        "simulation": simulation,
        **({"links": buses} if buses else {}),
        "devices": devices,
        **{key: value for key, value in real.items() if key not in (*rest, "cycle", "sibling")},
        **({"controllers": controllers} if controllers else {}),
        "interlocks": [_patient(item) for item in real["interlocks"]],
    }


def _patient(item: Mapping[str, Any]) -> dict[str, Any]:
    """Return an interlock or a controller that bears stalls of :data:`_SILENCE` at least."""
    given = item.get("stale_after", _SILENCE)
    longer = parse_quantity(given).value > parse_quantity(_SILENCE).value
    return {**item, "stale_after": given if longer else _SILENCE}


Options = Mapping[str, Any]


def _drive(device: str, item: Options, folder: str) -> tuple[Options, Options]:
    options = item.get("options") or {}
    same = {key: options[key] for key in ("gear_ratio", "rated_torque") if key in options}
    simulated = {
        "bus": item["link"],
        "node": options["node"],
        "drive": _turned(item),
        "counts_per_turn": options["counts_per_revolution"],
        **same,
    }
    return simulated, {**options, "watchdog": _SILENCE}


def _turned(item: Options) -> str:
    """Return the drive of the mechanism behind the one setpoint of a device."""
    (drive,) = item["setpoints"].values()
    return str(drive)


def _card(device: str, item: Options, address: str) -> tuple[Options, Options]:
    options, channels = item.get("options") or {}, item.get("channels", {})
    inputs = {}
    for entry in options["inputs"]:
        sensor = _sensor(channels.get(entry["name"]))
        if sensor is not None:
            same = {"zero": entry["zero"]} if "zero" in entry else {}
            if parse_unit(entry.get("unit", "V")).offset:
                same["unit"] = entry["unit"]
            scale = entry.get("scale", "1 V/V")
            inputs[entry["channel"]] = {"sensor": sensor, "scale": scale, **same}
    simulated = {"address": address, "device": options.get("device", "Dev1"), "inputs": inputs}
    return simulated, {**options, "server": address}


def _sensor(channel: Any) -> Any:
    """Return the sensor of the mechanism behind a channel of the description, None without."""
    return channel.get("sensor") if isinstance(channel, Mapping) else channel


def _modbus(device: str, item: Options, folder: str) -> tuple[Options, Options]:
    options = item.get("options") or {}
    if options.get("map") not in _MAKES:
        raise NotServed(f"{device} is simulated with the maps {', '.join(_MAKES)} only")
    if "travel" in options:
        raise NotServed(f"{device} moves an axis; a simulated drive on Modbus turns a shaft")
    simulated = {"make": options["map"], "drive": _turned(item)}
    if "unit" in options:
        simulated["unit"] = options["unit"]
    line = ("host", "port", "baud", "stop_bits")
    changed = {key: value for key, value in options.items() if key not in line}
    return simulated, {**changed, "serial_port": f"{folder}/{device}", "parity": "none"}


def _lines(device: str, item: Options, folder: str) -> tuple[Options, Options]:
    options, channels = item.get("options") or {}, item.get("channels", {})
    values = {}
    for name, channel in options["channels"].items():
        sensor = _sensor(channels.get(name))
        if sensor is None:
            raise NotServed(f"no sensor of the mechanism stands for {device}.{name}")
        unit = channel if isinstance(channel, str) else channel["unit"]
        values[name] = {"sensor": sensor, "unit": unit}
    simulated = {"answer": _line(device, options), "values": values}
    for key in ("baud", "decimal"):
        if key in options:
            simulated[key] = options[key]
    if "ask" in options:
        simulated["ask"] = re.sub(r"(\\r|\\n)+$", "", options["ask"])
    kept = {key: value for key, value in options.items() if key not in _PORT_OPTIONS}
    return simulated, {**kept, "port": f"{folder}/{device}"}


#: What a simulated port has not, and commands to which a simulated device has no answer.
_PORT_OPTIONS: Final = ("parity", "data_bits", "stop_bits", "identify", "start", "stop")


def _line(device: str, options: Options) -> str:
    """Return a line as the options of the driver `lines` read it, with the values in braces.

    Raises:
        NotServed: no line can be made from its pattern.
    """
    if "columns" in options:
        columns = ["0" if name == "-" else f"{{{name}:.3f}}" for name in options["columns"]]
        return (options.get("separator") or " ").join(columns)
    pattern = str(options["pattern"])
    sign = "," if options.get("decimal") == "comma" else "."
    for form in _FORMS:
        line = _GROUP.sub(rf"{{\1:{form}}}", pattern)
        line = re.sub(r"\\(.)", r"\1", line)
        try:
            shown = line.format_map(dict.fromkeys(options["channels"], 1.0))
        except (LookupError, ValueError):
            continue  # braces of the pattern itself
        if re.fullmatch(pattern, re.sub(r"(\d)\.(\d)", rf"\1{sign}\2", shown), re.ASCII):
            return line
    raise NotServed(f"no line can be made from the pattern of {device}: {pattern}")


#: Drivers behind which devices are simulated: where `wire-mechanism` has them, and what makes the
#: options of the simulated one and those of the driver.
_SERVED: Final[Mapping[str, tuple[str, Callable[..., tuple[Options, Options]]]]] = {
    DRIVE: ("drives", _drive),
    CARD: ("cards", _card),
    "modbus-servo": ("modbus", _modbus),
    "lines": ("lines", _lines),
}

"""Makes the rig at the wire: the real rig file, with its devices served by `rigd sim`.

For drivers behind which simulated devices stand: `cia402-rotary` on CAN and `ni-daq`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from rigd.cli.new_rig.description import PATIENT, PLANT_FILE
from rigd.model.units import parse_unit

WIRE_FILE: Final = "wire.yaml"
DRIVE: Final = "cia402-rotary"
CARD: Final = "ni-daq"
#: Address of the first simulated card; each further one has the next port.
_PORT: Final = 31790
#: Silence of a device or of the cycle that ends a run: long, as :data:`PATIENT` is.
_SILENCE: Final = PATIENT["cycle_silence"]


def at_wire(name: str, real: Mapping[str, Any], described: Mapping[str, Any]) -> dict[str, Any]:
    """Return the rig file; an empty one if a driver has no simulated device.

    ``real`` is the real rig, ``described`` the devices of the description.
    """
    drivers = {item["driver"] for item in described.values()}
    links = real.get("links", {})
    if not drivers <= {DRIVE, CARD} or any(item["type"] != "can" for item in links.values()):
        return {}
    folder = f"/tmp/rigd-{name}"  # a place for sockets, whose names must be short
    devices = {key: dict(item) for key, item in real["devices"].items()}
    drives: dict[str, Any] = {}
    cards: dict[str, Any] = {}
    for device, item in described.items():
        options = item.get("options") or {}
        if item["driver"] == DRIVE:
            drives[device] = _drive(item, options)
            devices[device]["options"] = {**options, "watchdog": _SILENCE}
            continue
        address = f"127.0.0.1:{_PORT + len(cards)}"
        cards[device] = _card(item, options, address)
        devices[device]["options"] = {**options, "server": address}
    buses = {
        key: {**item, "options": {**item["options"], "interface": "hub",
                                  "channel": f"{folder}/{key}"}}
        for key, item in links.items()
    }  # fmt: skip
    simulation = {
        "model": "wire-mechanism",
        "folder": folder,
        "plant": {"parameters": PLANT_FILE},
        "buses": {key: {} for key in buses},
        "drives": drives,
        "cards": cards,
    }
    rest = ("rig", "title", "links", "devices", "controllers", "interlocks")
    controllers = {
        key: {**item, "stale_after": _SILENCE} for key, item in real.get("controllers", {}).items()
    }
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
        "interlocks": [{**item, "stale_after": _SILENCE} for item in real["interlocks"]],
    }


def _drive(item: Mapping[str, Any], options: Mapping[str, Any]) -> dict[str, Any]:
    (drive,) = item["setpoints"].values()
    same = {key: options[key] for key in ("gear_ratio", "rated_torque") if key in options}
    return {
        "bus": item["link"],
        "node": options["node"],
        "drive": drive,
        "counts_per_turn": options["counts_per_revolution"],
        **same,
    }


def _card(item: Mapping[str, Any], options: Mapping[str, Any], address: str) -> dict[str, Any]:
    channels = item.get("channels", {})
    inputs = {}
    for entry in options["inputs"]:
        channel = channels.get(entry["name"])
        sensor = channel.get("sensor") if isinstance(channel, Mapping) else channel
        if sensor is not None:
            same = {"zero": entry["zero"]} if "zero" in entry else {}
            if parse_unit(entry.get("unit", "V")).offset:
                same["unit"] = entry["unit"]
            scale = entry.get("scale", "1 V/V")
            inputs[entry["channel"]] = {"sensor": sensor, "scale": scale, **same}
    return {"address": address, "device": options.get("device", "Dev1"), "inputs": inputs}

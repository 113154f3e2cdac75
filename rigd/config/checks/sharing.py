"""Checks that no two devices of a rig use what only one can have."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from rigd.config.document import Document
from rigd.config.problems import Problems
from rigd.config.rig import DeviceConfig, LinkSetup
from rigd.model.errors import LinkError, ProtocolError
from rigd.sdk import AnyDriver, Link


def check_shared(
    document: Document,
    devices: Iterable[DeviceConfig],
    links: Mapping[str, LinkSetup | None],
    problems: Problems,
) -> None:
    """Note each option and each part of a link that a device before has, or that is not there.

    Links and drivers are constructed for it, and not opened.
    """
    users: dict[object, str] = {}
    made: dict[str, Link] = {}
    for device in devices:
        path = ("devices", device.name, "options")
        for option in device.driver_class.unshared:
            value = getattr(device.config, option)
            user = None if value is None else users.setdefault(value, device.name)
            if user not in (None, device.name):
                problems.add(
                    document.place((*path, option)), f"{user} uses {value} already",
                    "each device needs a port of its own, also on one RS-485 line: an adapter each",
                )  # fmt: skip
        setup = links.get(device.link or "")
        if setup is None or device.driver_class.reserve is AnyDriver.reserve:
            continue
        link = made.setdefault(setup.name, setup.link_class(setup.config))
        try:
            device.driver_class(device.config, link).reserve()
        except (LinkError, ProtocolError) as error:
            message = f"{device.driver}: {error.message}"
            problems.add(document.place((*path, *error.entry)), message, error.hint)

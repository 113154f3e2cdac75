"""Makes a rig safe over new links after the process that drove it was killed.

The caller must first make sure that this process is gone: the cycle process for the devices in the
cycle, the daemon for slow devices that take setpoints. A device that no second process can open is
made safe by its watchdog.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

from rigd.config.rig import DeviceConfig, RigConfig
from rigd.engine.shared.scarce import insist
from rigd.sdk import Driver, SlowDriver

#: A rescue that has not returned after this time is given up; the device's watchdog remains.
RESCUE_S = 1.0


@dataclass
class Rescue:
    """The result of a rescue, one sentence per actuator or shared link."""

    done: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def rescue(rig: RigConfig, names: Collection[str], within_s: float = RESCUE_S) -> Rescue:
    """Make the actuators of ``rig`` among ``names`` safe, all at the same time, in ``within_s``."""
    found = Rescue()
    if rig.plant is not None:
        return found  # devices simulated in process have ended with it
    together: dict[tuple[str, str], list[DeviceConfig]] = {}
    for device in rig.devices.values():
        if device.is_actuator and device.name in names:
            together.setdefault(_rescued_with(rig, device), []).append(device)
    threads = [
        threading.Thread(
            target=_rescue,
            args=(rig, devices, found),
            daemon=True,
            name=", ".join(device.name for device in devices),
        )
        for devices in together.values()
    ]
    for thread in threads:
        thread.start()
    until = time.monotonic() + within_s
    for thread in threads:
        thread.join(max(0.0, until - time.monotonic()))
        if thread.is_alive():
            found.problems.append(
                f"{thread.name} did not answer over a second link within {within_s:g} s"
            )
    return found


def _rescued_with(rig: RigConfig, device: DeviceConfig) -> tuple[str, str]:
    """Return what is the same for devices that one rescue makes safe: their link, or the device."""
    link, driver_class = device.link, device.driver_class
    if link is None or not (issubclass(driver_class, Driver) and driver_class.second_link):
        return "device", device.name
    whole = rig.links[link].link_class.rescued_whole
    return ("link", link) if whole else ("device", device.name)


def _rescue(rig: RigConfig, devices: Sequence[DeviceConfig], found: Rescue) -> None:
    """Make ``devices`` safe by the rescue of the first."""
    begun, device = time.monotonic(), devices[0]
    names = ", ".join(each.name for each in devices)
    was = "was" if len(devices) == 1 else "were"
    try:
        setup = None if device.link is None else rig.links[device.link]
        link = None if setup is None else setup.link_class(setup.config)
        driver = device.driver_class(device.config, link)
        if isinstance(driver, SlowDriver) and driver.second_link:
            import asyncio  # the cycle, which may do this once it is over, does without

            asyncio.run(driver.rescue())
        elif isinstance(driver, Driver) and driver.second_link:
            insist(driver.rescue)
        else:
            found.done.append(f"{names} is left to its watchdog")
            return
        took_ms = (time.monotonic() - begun) * 1e3
        found.done.append(f"{names} {was} made safe over a second link in {took_ms:.0f} ms")
    except Exception as error:  # noqa: BLE001 - boundary: told, and the others go on
        found.problems.append(f"{names} could not be reached over a second link: {error}")

"""Makes a rig safe over new links after the process that drove it was killed.

The caller must first make sure that this process is gone: the cycle process for the devices in the
cycle, the daemon for slow devices that take setpoints. A device that no second process can open is
made safe by its watchdog.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Collection
from dataclasses import dataclass, field

from rigd.config.rig import DeviceConfig, RigConfig
from rigd.engine.shared.scarce import insist
from rigd.sdk import Driver, SlowDriver

#: A rescue that has not returned after this time is given up; the device's watchdog remains.
RESCUE_S = 1.0


@dataclass
class Rescue:
    """The result of a rescue, one sentence per actuator."""

    done: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def rescue(rig: RigConfig, names: Collection[str], within_s: float = RESCUE_S) -> Rescue:
    """Make the actuators of ``rig`` among ``names`` safe, all at the same time, in ``within_s``."""
    found = Rescue()
    if rig.plant is not None:
        return found  # devices simulated in process have ended with it
    threads = [
        threading.Thread(target=_rescue, args=(rig, device, found), daemon=True, name=device.name)
        for device in rig.devices.values()
        if device.is_actuator and device.name in names
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


def _rescue(rig: RigConfig, device: DeviceConfig, found: Rescue) -> None:
    begun = time.monotonic()
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
            found.done.append(f"{device.name} is left to its watchdog")
            return
        took_ms = (time.monotonic() - begun) * 1e3
        found.done.append(f"{device.name} was made safe over a second link in {took_ms:.0f} ms")
    except Exception as error:  # noqa: BLE001 - boundary: told, and the others go on
        found.problems.append(f"{device.name} could not be reached over a second link: {error}")

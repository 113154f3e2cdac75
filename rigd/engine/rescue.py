"""Makes a rig safe over new links after the cycle process was killed.

The caller must first make sure that the cycle process is gone. A device that no second process can
open is made safe by its watchdog.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field

from rigd.config.rig import DeviceConfig, RigConfig
from rigd.engine.shared.scarce import insist
from rigd.sdk import Driver

#: A rescue that has not returned after this time is given up; the device's watchdog remains.
RESCUE_S = 1.0


@dataclass
class Rescue:
    """The result of a rescue, one sentence per actuator."""

    done: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def rescue(rig: RigConfig) -> Rescue:
    """Make every actuator of ``rig`` safe, all at the same time; return within about 1 s."""
    found = Rescue()
    if rig.plant is not None:
        return found  # devices simulated in process have ended with it
    threads = [
        threading.Thread(target=_rescue, args=(rig, device, found), daemon=True, name=device.name)
        for device in rig.devices.values()
        if device.is_actuator
    ]
    for thread in threads:
        thread.start()
    until = time.monotonic() + RESCUE_S
    for thread in threads:
        thread.join(max(0.0, until - time.monotonic()))
        if thread.is_alive():
            found.problems.append(
                f"{thread.name} did not answer over a second link within {RESCUE_S:g} s"
            )
    return found


def _rescue(rig: RigConfig, device: DeviceConfig, found: Rescue) -> None:
    begun = time.monotonic()
    try:
        setup = None if device.link is None else rig.links[device.link]
        link = None if setup is None else setup.link_class(setup.config)
        driver = device.driver_class(device.config, link)
        if not isinstance(driver, Driver) or not driver.second_link:
            found.done.append(f"{device.name} is left to its watchdog")
            return
        insist(driver.rescue)
        took_ms = (time.monotonic() - begun) * 1e3
        found.done.append(f"{device.name} was made safe over a second link in {took_ms:.0f} ms")
    except Exception as error:  # noqa: BLE001 - boundary: told, and the others go on
        found.problems.append(f"{device.name} could not be reached over a second link: {error}")

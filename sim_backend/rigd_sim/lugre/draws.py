"""Draws the random differences between LuGre rigs, and between starts of one rig."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from rigd_sim.lugre.parameters import LugreParameters, Sensors

#: The carriage is put down by hand, within this of its mark at the start, in m.
PUT_DOWN_M: Final = 2e-3
#: Zeros of accelerometer and current monitor lie anywhere within so many bits of the card around
#: theirs.
BITS: Final = 0.5


@dataclass(frozen=True)
class Start:
    """Where a rig stands when it is switched on: between counts, and between rollers.

    The default is as drawn: all stand at zero.
    """

    wheel_rad: float = 0.0
    carriage_m: float = 0.0


def individual(parameters: LugreParameters, number: int) -> tuple[LugreParameters, Start]:
    """Return the rig with this number, and where it stands; 0 is the rig as drawn."""
    if number == 0:
        return parameters, Start()
    random = np.random.default_rng(number)
    start = Start(
        wheel_rad=float(random.uniform(0.0, 2 * math.pi)),
        carriage_m=float(random.uniform(-PUT_DOWN_M, PUT_DOWN_M)),
    )
    zeros_v = parameters.sensors.card_resolution * random.uniform(-BITS, BITS, size=2)
    sensors = _moved(parameters.sensors, *zeros_v.tolist())
    return parameters.model_copy(update={"sensors": sensors}), start


def _moved(sensors: Sensors, accelerometer_v: float, monitor_v: float) -> Sensors:
    """Return ``sensors`` with their zeros moved; a monitor that shows nothing has none."""
    accelerometer, monitor = sensors.accelerometer, sensors.current_monitor
    bias = accelerometer.bias + accelerometer_v / accelerometer.sensitivity
    moved = {"accelerometer": accelerometer.model_copy(update={"bias": bias})}
    if monitor.sensitivity == 0.0:
        return sensors.model_copy(update=moved)
    zero = monitor.zero + monitor_v / monitor.sensitivity
    shown = {"current_monitor": monitor.model_copy(update={"zero": zero})}
    return sensors.model_copy(update=moved | shown)

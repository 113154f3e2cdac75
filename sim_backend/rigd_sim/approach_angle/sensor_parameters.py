"""Defines the parameters of the approach-angle rig's sensors with unit and bounds."""

from __future__ import annotations

import math
from typing import Annotated

from annotated_types import Ge, Gt, Le

from rigd.sdk import In, ParameterGroup

Share = Annotated[float, In("1"), Ge(0), Le(0.2)]
Correlation = Annotated[float, In("1"), Ge(0), Le(1)]
Length = Annotated[float, In("m"), Gt(0), Le(2)]
Strain = Annotated[float, In("strain"), Ge(0), Le(1e-3)]
Volts = Annotated[float, In("V"), Ge(0), Le(1)]


class Gauges(ParameterGroup):
    """The two strain gauges at +45 and -45 degrees, each with its own amplifier."""

    sensitivity: Annotated[float, In("V"), Gt(0), Le(1e6)]
    """Volts per strain."""
    gain_spread: Share
    """Spread of an amplifier's gain."""
    noise: Strain
    """Noise, rms per sample."""
    hum: Strain
    """Amplitude of the mains' hum at 50 Hz."""
    hum_correlation: Correlation
    """Correlation of the hum of both gauges."""
    drift: Strain
    """Spread of a zero, from one run to the next."""
    drift_correlation: Correlation
    """Correlation of the zeros of both gauges."""
    spike: Strain
    """Disturbance when the relay switches."""
    spike_time: Annotated[float, In("s"), Gt(0), Le(0.1)]
    """Time in which it decays."""
    misalignment_a: Annotated[float, In("rad"), Ge(-0.2), Le(0.2)]
    """Angle of gauge a beyond +45 degrees."""
    misalignment_b: Annotated[float, In("rad"), Ge(-0.2), Le(0.2)]
    """Angle of gauge b beyond -45 degrees."""


class Potentiometers(ParameterGroup):
    """The two ten-turn potentiometers, on the wheel and on the platform's thread."""

    excitation: Annotated[float, In("V"), Gt(0), Le(30)]
    """Voltage over the whole potentiometer."""
    turns: Annotated[int, Ge(1), Le(50)]
    """Turns from end to end; it does not go on beyond."""
    pulley: Length
    """Radius of the pulley that the platform's thread turns."""
    noise: Volts
    """Noise, rms per sample."""
    slope_spread: Share
    """Spread of the slope that a calibration leaves."""
    cyclic: Annotated[float, In("rad"), Ge(0), Le(0.2)]
    """Amplitude of the error once per turn."""
    wheel_start: Annotated[float, In("rad"), Gt(0), Le(100)]
    """Angle from its end at which a run begins."""
    wheel_start_spread: Annotated[float, In("rad"), Ge(0), Le(3)]
    """Spread of that angle from run to run."""
    platform_start: Length
    """Thread from its end at which a run begins."""
    platform_start_spread: Annotated[float, In("m"), Ge(0), Le(0.05)]
    """Spread of that length from run to run."""

    @property
    def volts_per_rad(self) -> float:
        """Nominal slope, in V/rad."""
        return self.excitation / (2 * math.pi * self.turns)


class Scale(ParameterGroup):
    """The scale under the rig's base."""

    capacity: Annotated[float, In("kg"), Gt(0), Le(1000)]
    """Largest mass."""
    division: Annotated[float, In("kg"), Gt(0), Le(1)]
    """Smallest step of the display."""
    noise: Annotated[float, In("kg"), Ge(0), Le(1)]
    """Noise of a reading, rms."""
    interval: Annotated[float, In("s"), Ge(0.01), Le(10)]
    """Time from one reading to the next."""
    time_constant: Annotated[float, In("s"), Gt(0), Le(10)]
    """Of the display's filter."""
    gain_spread: Share
    """Spread of the gain."""


class LoadCell(ParameterGroup):
    """The load cell under the contact, the optional fifth input."""

    sensitivity: Annotated[float, In("V/N"), Gt(0), Le(10)]
    """Volts per force."""
    noise: Annotated[float, In("N"), Ge(0), Le(100)]
    """Noise, rms per sample."""
    gain_spread: Share
    """Spread of the gain."""
    zero_spread: Volts
    """Spread of the voltage at no force."""


class Card(ParameterGroup):
    """The data acquisition card: one converter for all inputs."""

    range: Annotated[float, In("V"), Gt(0), Le(100)]
    """Largest voltage of either sign."""
    bits: Annotated[int, Ge(8), Le(24)]
    """Resolution with up to four inputs; with five it has a bit less."""
    scan: Annotated[float, In("s"), Ge(0), Le(1e-3)]
    """Time from one input's conversion to the next one's."""

    def resolution(self, inputs: int) -> float:
        """Return the smallest step in V with so many inputs."""
        return float(2 * self.range / 2 ** (self.bits - (inputs > 4)))


class Arm(ParameterGroup):
    """The arm that is put on the clamped shaft for calibration."""

    length: Length
    """Nominal length."""
    length_spread: Annotated[float, In("m"), Ge(0), Le(0.1)]
    """Spread of the true length."""

"""Lists the values that a calibration of the approach-angle rig may hold, and its input signals."""

from __future__ import annotations

from typing import Final

from rigd.analysis import Calibratable

CALIBRATABLE: Final = {
    "torque_scale": Calibratable(
        "N m/V", "torque per volt of (gauge a - gauge b)", "calibrate_torque", "positive"
    ),
    "gauge_share": Calibratable(
        "1",
        "share of the torque that gauge a shows, one half if both gains are equal",
        sign="positive",
    ),
    "wheel_scale": Calibratable(
        "rad/V", "angle per volt of the wheel's potentiometer", sign="positive"
    ),
    "platform_scale": Calibratable(
        "m/V", "travel per volt of the platform's potentiometer", sign="positive"
    ),
    "load_scale": Calibratable(
        "1", "true load per load that the scale shows", "calibrate_scale", "positive"
    ),
    "normal_force_scale": Calibratable(
        "N/V", "normal force per volt of the load cell", "calibrate_load_cell", "positive"
    ),
    "normal_force_zero": Calibratable(
        "V", "voltage of the load cell at 0 N", "calibrate_load_cell", "any"
    ),
    "effective_radius": Calibratable(
        "1", "effective over nominal radius of the wheel", sign="positive"
    ),
    "bearing_constant": Calibratable(
        "N m", "torque of the wheel's bearings at rest, without load", "calibrate_friction"
    ),
    "bearing_viscous": Calibratable(
        "N m s/rad", "torque of the wheel's bearings per angular speed", "calibrate_friction"
    ),
    "bearing_load": Calibratable("N m/N", "torque of the wheel's bearings per normal force"),
    "rolling_resistance": Calibratable("1", "moment of rolling resistance over N R"),
    "roller_drag": Calibratable("1", "axial drag of the free rollers over N"),
    "load_rise": Calibratable(
        "1/m", "relative rise of N per travel of the platform", "calibrate_rise", "any"
    ),
    "rail_constant": Calibratable(
        "N", "friction of the rails, at any load and speed", "calibrate_friction"
    ),
    "rail_load": Calibratable("1", "friction of the rails per load on them"),
    "rail_viscous": Calibratable("N s/m", "friction of the rails per speed", "calibrate_friction"),
}

#: Signals of the card and the scale: a calibration turns volts into quantities.
SIGNALS: Final = {
    "gauge_a": "V",
    "gauge_b": "V",
    "wheel_angle": "V",
    "platform_position": "V",
    "load": "kg",
    "normal_force": "V",
}

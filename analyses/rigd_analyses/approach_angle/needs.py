"""What the approach-angle analysis needs: signals, constants, units and calibrated values."""

from __future__ import annotations

from typing import Final

from rigd.analysis import Needs

NEEDS: Final = Needs(
    signals={
        "gauge_a": "V",
        "gauge_b": "V",
        "wheel_angle": "V",
        "platform_position": "V",
        "relay": "1",
        "load": "kg",
    },
    optional_signals={"normal_force": "V", "final_travel": "m", "final_turning": "rad"},
    constants=("angle", "wheel_radius", "wheel_inertia", "platform_mass", "gravity"),
    optional_constants=("stop_travel", "most_turning", "pre_trigger"),
    constant_units={
        **{"angle": "rad", "wheel_radius": "m", "wheel_inertia": "kg m^2"},
        **{"platform_mass": "kg", "gravity": "m/s^2"},
        **{"stop_travel": "m", "most_turning": "rad", "pre_trigger": "s"},
    },
    references=("maximum",),
    trial_parameters=("set", "load", "voltage"),
    calibrated=(
        "torque_scale",
        "wheel_scale",
        "platform_scale",
        "load_scale",
        "effective_radius",
        "bearing_constant",
        "bearing_viscous",
        "bearing_load",
        "rolling_resistance",
        "roller_drag",
        "rail_constant",
        "rail_load",
        "rail_viscous",
    ),
    calibrated_with={"normal_force": ("normal_force_scale", "normal_force_zero")},
    calibrated_if_known=("load_rise", "gauge_share"),
)

"""What the analysis of lateral sweeps needs: signals, constants and their units."""

from __future__ import annotations

from typing import Final

from rigd.analysis import Needs
from rigd_analyses.lugre import needs as lugre

#: Lengths of the guide, of the carriage and of the wheel's rows of rollers.
GEOMETRY: Final = (
    *("guide_lever", "guide_height", "guide_half_span", "row_distance", "mass_offset"),
    *("bearing_spacing", "bearing_overhang"),
)
#: Friction of the rollers' bearings, if it is stated.
ROLLERS: Final = ("mu_R_dry", "mu_R_vis")

NEEDS: Final = Needs(
    signals={**lugre.NEEDS.signals, "lateral_speed": "m/s"},
    optional_signals=lugre.NEEDS.optional_signals,
    constants=(*lugre.NEEDS.constants, *lugre.DRIVE, *GEOMETRY),
    optional_constants=("guide_friction_mass", "guide_lift", *ROLLERS),
    constant_units={
        **lugre.NEEDS.constant_units,
        **dict.fromkeys(GEOMETRY, "m"),
        **{"mu_R_dry": "1", "mu_R_vis": "s/m"},
    },
    trial_parameters=("current", "lateral_speed"),
)

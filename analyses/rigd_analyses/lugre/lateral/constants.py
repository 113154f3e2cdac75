"""Holds the constants of the lateral coupling that are known before a trial, and one trial."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigd.analysis import DataError
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.trials.known_constants import Known
from rigd_analyses.lugre.trials.trial import LugreTrial


@dataclass(frozen=True)
class LateralConstants:
    """Geometry of guide, rollers and bearings in SI (lugre.md section 2, items 6 to 11).

    ``lever`` is d - e, ``height`` c, ``half_span`` h, ``row_distance`` j, ``mass_offset`` k,
    ``bearing_spacing`` a and ``bearing_overhang`` b. ``dry`` and ``viscous`` are the friction of
    the rollers if it is known, else None.

    Raises:
        DataError: a value is not possible.
    """

    lever: Known
    height: Known
    half_span: Known
    row_distance: Known
    mass_offset: Known
    bearing_spacing: float
    bearing_overhang: float
    dry: Known | None = None
    viscous: Known | None = None

    def __post_init__(self) -> None:
        positive = {
            "guide_height": self.height.value,
            "guide_half_span": self.half_span.value,
            "row_distance": self.row_distance.value,
            "bearing_spacing": self.bearing_spacing,
            **({} if self.dry is None else {"mu_R_dry": self.dry.value}),
            **({} if self.viscous is None else {"mu_R_vis": self.viscous.value}),
        }
        for name, value in positive.items():
            if not (np.isfinite(value) and value > 0.0):
                raise DataError(f"{name} is {value:g}, must be a positive number")
        if not (np.isfinite(self.lever.value) and self.lever.value != 0.0):
            raise DataError(
                f"guide_lever is {self.lever.value:g} m: with no lever the guide's friction is 0 N",
                hint="it is d - e of Eq. 21: the arm of the wheel's contact less that of the mass",
            )
        j, k = self.row_distance.value, self.mass_offset.value
        if not -j < k < 0.0:
            raise DataError(
                f"mass_offset is {k:g} m, must lie between {-j:g} m (-row_distance) and 0 m: else "
                "one row of rollers is lifted at rest (Eq. 25)"
            )


@dataclass(frozen=True, eq=False)
class LateralTrial:
    """A trial of the sweep: ``speed_m_s`` (n,) is the measured lateral speed, v_z.

    ``asked_m_s`` is the lateral speed that the procedure asked for, without its sign.
    """

    trial: LugreTrial
    speed_m_s: FloatArray
    asked_m_s: float

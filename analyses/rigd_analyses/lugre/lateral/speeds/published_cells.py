"""Lists the speed errors that the paper reports: Tables III and IV, RMS in m/s, on natural stone.

"Investigation of longitudinal friction characteristics of an omnidirectional wheel via LuGre
model". A report prints them beside its own results; no computation uses them.
"""

from __future__ import annotations

from dataclasses import dataclass

CURRENTS_A = (0.6, 0.9, 1.2, 1.5)
#: By lateral speed in m/s: Table III and Table IV, each with a value for each current.
TABLES = {
    0.2: ((0.045, 0.029, 0.033, 0.024), (0.021, 0.005, 0.008, 0.009)),
    0.35: ((0.068, 0.054, 0.040, 0.027), (0.029, 0.013, 0.011, 0.024)),
    0.5: ((0.075, 0.038, 0.033, 0.029), (0.029, 0.014, 0.022, 0.032)),
    0.65: ((0.072, 0.040, 0.028, 0.033), (0.024, 0.019, 0.029, 0.028)),
    -0.2: ((0.023, 0.055, 0.051, 0.078), (0.018, 0.018, 0.015, 0.041)),
    -0.35: ((0.047, 0.066, 0.079, 0.102), (0.016, 0.008, 0.020, 0.044)),
    -0.5: ((0.034, 0.064, 0.067, 0.093), (0.059, 0.023, 0.019, 0.018)),
    -0.65: ((0.057, 0.082, 0.088, 0.103), (0.047, 0.018, 0.014, 0.024)),
}
CLOSE_M_S, CLOSE_A = 0.01, 0.01  #: a trial this near to a cell is that cell


@dataclass(frozen=True)
class Published:
    """RMS of measured minus modelled speed, m/s: lateral force ignored (III) and included (IV)."""

    ignored_m_s: float
    included_m_s: float

    @property
    def ratio(self) -> float:
        """Return ignored over included."""
        return self.ignored_m_s / self.included_m_s

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "rms_ignored_m_s": self.ignored_m_s,
            "rms_included_m_s": self.included_m_s,
            "ratio": self.ratio,
        }


def published(lateral_speed_m_s: float, current_a: float) -> Published | None:
    """Return the cell of the tables at a lateral speed and a current; None if there is none."""
    for speed, (ignored, included) in TABLES.items():
        for column, current in enumerate(CURRENTS_A):
            if abs(speed - lateral_speed_m_s) < CLOSE_M_S and abs(current - current_a) < CLOSE_A:
                return Published(ignored[column], included[column])
    return None

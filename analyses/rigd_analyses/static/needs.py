"""The signals that the static law works from, in the units that they may have."""

from __future__ import annotations

from typing import Final

from rigd.analysis import Needs

NEEDS: Final = Needs(
    signals={"force": "N or N m or 1", "speed": "m/s or rad/s"},
    references=("F_c", "F_s", "v_s", "k_v"),
)

"""Defines the settings of the paper's method; if the paper gives no value, ours is the default."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from rigd_analyses.approach_angle.raw.good_run_limits import Limits


class Ends(Enum):
    """What the forward and backward filter does at the ends of a signal."""

    ZERO = "zero"  #: starts from rest: what the paper's line through both ends is for
    FILTFILT = "filtfilt"  #: odd padding, as SciPy and MATLAB do; costs 8 % of V at the end


@dataclass(frozen=True)
class PaperSettings:
    """Settings of the paper's pipeline; those that it does not state are marked (assumed).

    ``rcond`` sets the effective bandwidth of the Fourier step: below 1 s the basis is nearly
    dependent (condition 1e10 to 1e16), so it must be fixed (assumed). Of ``cutoffs_hz`` only the
    last is published, of ``averages`` only that they increase; all are odd, because an even one
    would shift the time axis by half a sample. ``peak_free_s`` and ``steady_share``: a maximum of
    the torque nearer than the first to an end of the record, or a steady segment shorter than the
    second (of the record), does not give a steady torque (both assumed).

    Raises ValueError for settings that cannot work.
    """

    highest_hz: int = 19  #: N of Eq. 7
    rcond: float = 1e-12
    fit_window: float = 0.1  #: of t_M - t_0, on either side of the peak
    steady_sigmas: float = 2.0
    cutoffs_hz: tuple[float, ...] = (200.0, 150.0, 110.0, 80.0, 55.0, 35.0, 20.0)
    averages: tuple[int, ...] = (5, 11, 17, 23, 29, 35, 41)  #: samples
    ends: Ends = Ends.ZERO
    peak_free_s: float = 0.005
    steady_share: float = 0.1
    limits: Limits = field(default_factory=Limits)  #: of the raw run

    def __post_init__(self) -> None:
        if len(self.cutoffs_hz) != len(self.averages):
            raise ValueError(
                f"{len(self.cutoffs_hz)} cut-off frequencies and {len(self.averages)} averages; "
                "each iteration needs one of both"
            )
        if any(n < 1 or n % 2 == 0 for n in self.averages):
            raise ValueError(f"averages must be odd numbers of samples, got {self.averages}")

    @property
    def lost(self) -> int:
        """Samples by which one combined smoothing shortens a signal, half of it at each end."""
        return sum(n - 1 for n in self.averages)

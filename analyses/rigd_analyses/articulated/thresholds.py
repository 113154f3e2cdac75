"""The thresholds of the robot; a field is named by its kind, with its unit at the end."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RobotThresholds:
    """Where the search for contacts goes on, and from where on a robot counts as another one."""

    # -- The search (:mod:`.search`) --
    #: Relative decrease of the cost below which a first fit ends.
    min_decrease_first: float = 1e-2
    #: And below which the fit of all trials does: 0.1 of 3e4.
    min_decrease: float = 3e-6
    #: From which other mu_s and mu_d are sought.
    max_mean_square: float = 1.2
    #: mu_s over mu_d, its bound: other values of both are sought from there.
    min_ratio: float = 1.001
    #: Half the 95 % point of chi-squared: mu_s that cost more are ruled out.
    max_cost: float = 1.92
    #: The same, between the values that are tried.
    max_cost_rough: float = 3.0
    #: No other parameter makes up for it.
    max_cost_hopeless: float = 40.0

    # -- What a robot is found by (:mod:`.family`, :mod:`.result`, :mod:`.validation`) --
    #: Way by the camera over that by the wheels, less 1. Slip is some per cent.
    max_way_share: float = 0.15
    #: By which all lengths may be off: no two careful measures of a length differ by so much.
    max_length_share: float = 0.03
    #: From which another scale of the camera is worth a word.
    min_camera_scale_sd: float = 3.0


ROBOT = RobotThresholds()

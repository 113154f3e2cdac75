"""Concludes the identification of a group: from its first fit to intervals and further tests."""

from __future__ import annotations

from collections.abc import Sequence

from rigd.analysis.result import IdentificationResult
from rigd_analyses.lugre.design.further import with_further_tests
from rigd_analyses.lugre.rig.family import RigFit, fit_group, with_intervals
from rigd_analyses.lugre.rig.result import result
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.known_constants import RigConstants
from rigd_analyses.lugre.trials.trial import LugreConstants, LugreTrial


def identify_output_error(
    trials: Sequence[LugreTrial],
    constants: LugreConstants,
    rig: RigConstants,
    settings: Settings | None = None,
) -> IdentificationResult:
    """Return the LuGre parameters that ``trials`` support, by simulating the rig.

    The starts come from method A (slip in, traction out) and from the model's own start.

    Raises:
        DataError: the recordings cannot answer (wrong sign, no motion, no rest, too few trials).
    """
    return conclude_group(fit_group(trials, constants, rig, settings))


def conclude_group(begun: RigFit) -> IdentificationResult:
    """Return the result of ``begun``: profiles, other filters of the current, intervals."""
    found = with_intervals(begun)
    return with_further_tests(result(found), found)

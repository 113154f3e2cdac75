"""Concludes the identification of a group: from its first fit to intervals and further tests."""

from __future__ import annotations

from collections.abc import Sequence

from rigd.analysis.result import IdentificationResult
from rigd_analyses.lugre.design.further import with_further_tests
from rigd_analyses.lugre.identify import Settings
from rigd_analyses.lugre.rig.constants import RigConstants
from rigd_analyses.lugre.rig.found import WINDOW_S
from rigd_analyses.lugre.rig.identify import FirstFit, fit_group, rig_system, with_intervals
from rigd_analyses.lugre.rig.result import result
from rigd_analyses.lugre.rig.system import RigSystem
from rigd_analyses.lugre.trial import LugreConstants, LugreTrial


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


def conclude_group(begun: FirstFit) -> IdentificationResult:
    """Return the result of ``begun``: profiles, other filters of the current, intervals."""
    first = begun.system

    def system(window_s: float) -> RigSystem:
        if window_s == WINDOW_S:
            return first
        return rig_system(begun.parts, first.constants, begun.starts[0], window_s)

    found = with_intervals(begun.whole, system, begun.gate, begun.block, begun.alike, begun.shifts)
    concluded = result(first, found, begun.rejected, begun.starts, begun.block)
    return with_further_tests(concluded, found, first)

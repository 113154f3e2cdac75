"""Brings a chain of modules to the pipeline of output error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.homogeneity import TrialParts, homogeneity
from rigd.analysis.output_error.pipeline import Family
from rigd.analysis.output_error.structure import Suspect
from rigd.analysis.result import FloatArray, Gate, ResidualTest, TrialRejection
from rigd_analyses.articulated.chain.suspects import candidates, motor_name
from rigd_analyses.articulated.chain.system import ChainSystem, unit_of
from rigd_analyses.articulated.family import by_lengths, with_lengths, with_torques
from rigd_analyses.articulated.search import SCORES

STIFFNESS: Final = 0  #: place of the first module's k_lon, which all motion shows


@dataclass(frozen=True, eq=False, kw_only=True)
class ChainFamily(Family[ChainSystem]):
    """A chain: the trials in which no contact slides."""

    def suspects(self, theta: FloatArray) -> Iterator[Suspect]:
        """Return what may be wrong with robot, contacts and camera."""
        return candidates(self.system, theta)

    def agreement(self, whole: OutputErrorFit, gate: Gate) -> tuple[ResidualTest, ...]:
        """Return the tests whether trials and recordings have one k_lon, which all motion shows."""
        parts = TrialParts(
            "recordings", [item.recording for item in self.system.trials],
            "Something changed between them; identify each by a command of its own.",
        )  # fmt: skip
        return homogeneity(whole, STIFFNESS, "longitudinal stiffness", [parts], self.block)

    def findings(self, whole: OutputErrorFit, gate: Gate, tests: tuple[ResidualTest, ...]) -> Gate:
        """Return ``gate`` with a torque that is off, and a scale that all lengths share."""
        motors = [motor_name(self.system, k) for k in range(self.system.motors)]
        gate = with_torques(gate, whole, self.system, self.labels, motors)
        return with_lengths(gate, whole)

    def shifts(self, whole: OutputErrorFit) -> tuple[FloatArray, ...]:
        """Return the step of the parameters if all lengths are off instead of the camera."""
        lengths = [name for name in self.system.sizes if unit_of(name) == "m"]
        return by_lengths(whole, lengths)


def chain_family(
    system: ChainSystem, point: FloatArray, rejected: tuple[TrialRejection, ...] = ()
) -> ChainFamily:
    """Return the trials of a chain for the pipeline, whose fit begins at ``point`` (p,)."""
    return ChainFamily(
        system=system,
        labels=tuple(item.label for item in system.trials),
        period_s=system.trials[0].period_s,
        block=SCORES,
        starts=(point,),
        rejected=rejected,
    )

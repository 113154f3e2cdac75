"""The steps of an identification by output error, in one order for all families of rigs.

1. fit from the starts of the family, and again from points beside its end, or from elsewhere if
   that may be in a wrong place;
2. diagnose what explains a misfit (:mod:`.diagnosis`), and judge the fit (:mod:`.gate`);
3. test whether trials and recordings agree (:mod:`.homogeneity`), and take what the family finds
   itself into the judgement;
4. profiles, each begun anew from a better fit that one of them finds;
5. fit variants: the same trials with other choices of the method, such as another filter;
6. without each trial in turn (:mod:`.jackknife`), if something was added to the model.

If the judgement is that no number may be given, steps 4 to 6 are left out. A :class:`Family` brings
data and pure functions; what it does not define does nothing. It makes intervals and a result of
its :class:`Identification`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import numpy as np

from rigd.analysis.estimates import Share
from rigd.analysis.fitting.fit import fit
from rigd.analysis.fitting.profile import ProfileScan
from rigd.analysis.output_error.augmented_system import same_with
from rigd.analysis.output_error.diagnosis import Assumption, diagnose
from rigd.analysis.output_error.estimator import (
    NEAR,
    OutputErrorFit,
    drawn,
    estimate,
    improve,
    retried,
)
from rigd.analysis.output_error.gate import judge_fit, settled_gate
from rigd.analysis.output_error.jackknife import jackknife_sd, without_each_trial
from rigd.analysis.output_error.structure import Suspect
from rigd.analysis.output_error.system import Diverged, System
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.result import FitOutcome, FloatArray, Gate, ResidualTest, TrialRejection

MOST_BETTER = 3  #: times that profiles may find a better fit
VARIANT_ITERATIONS = 3  #: of the fit of a variant; its optimum is near
#: The tests of a diagnosis, each with a chance of a false alarm of its own.
DIAGNOSED = ("causes of a misfit", "a loud band of frequencies or a jump")

S = TypeVar("S", bound=System)


@dataclass(frozen=True, eq=False, kw_only=True)
class Family(Generic[S]):
    """What a family of rigs brings for the trials of one group.

    ``system`` are the trials, ``labels`` (trials,) their names, samples are ``period_s`` apart, and
    ``block`` is the longest correlation of the scores that is accounted for, in samples. ``starts``
    are shared parameters (p,), natural, that the fit begins from; a family without any has a
    :meth:`fitted` of its own. ``rejected`` are the trials that are left out.
    """

    system: S
    labels: tuple[str, ...]
    period_s: float
    block: int
    starts: tuple[FloatArray, ...] = ()
    rejected: tuple[TrialRejection, ...] = ()

    @property
    def advice(self) -> str:
        """What to do if a fit has not converged; a sentence, or empty."""
        return ""

    def described(self, trial: int) -> str:
        """Return which trial it is (its number from 0), for an error."""
        return self.labels[trial]

    def fitted(self) -> OutputErrorFit:
        """Return the fit of the system.

        Raises:
            DataError: the data cannot answer.
        """
        return estimate(self.system, self.starts, self.block)

    def retries(self, whole: OutputErrorFit) -> Sequence[FloatArray]:
        """Return other points (p,), natural, that the fit ``whole`` is continued from."""
        return ()

    def elsewhere(self) -> Sequence[FloatArray]:
        """Return shared parameters (p,), natural, that a fit with a wrong end begins anew from."""
        return drawn(self.system)

    def refitted(self, system: System, starts: Sequence[FloatArray], block: int) -> OutputErrorFit:
        """Return the fit of a system with something added, from shared parameters (p + c,)."""
        return estimate(system, starts, block)

    def refusal(self, whole: OutputErrorFit) -> Gate | None:
        """Return why no diagnosis of ``whole`` is of use; None if one is."""
        return None

    def suspects(self, theta: FloatArray) -> Iterable[Suspect]:
        """Return what may be wrong with the model, at the parameters ``theta`` (p,)."""
        return ()

    def agreement(self, whole: OutputErrorFit, gate: Gate) -> tuple[ResidualTest, ...]:
        """Return the tests whether trials and recordings agree."""
        return ()

    def alarms(self, tests: Sequence[ResidualTest]) -> dict[str, float]:
        """Return the chance that a test names or refuses something of a right rig, by its name.

        They are the levels of all tests that are made; ``tests`` are those of :meth:`agreement`.
        """
        levels = dict.fromkeys(DIAGNOSED, THRESHOLDS.max_p_value_cause)
        return levels | {test.name: THRESHOLDS.max_p_value_agreement for test in tests}

    def findings(self, whole: OutputErrorFit, gate: Gate, tests: tuple[ResidualTest, ...]) -> Gate:
        """Return ``gate`` with what the family finds itself; ``tests`` are of :meth:`agreement`."""
        return gate

    def shifts(self, whole: OutputErrorFit) -> tuple[FloatArray, ...]:
        """Return further steps (p,), scaled, by which the parameters may be off."""
        return ()

    def profiles(self, whole: OutputErrorFit, gate: Gate) -> dict[str, ProfileScan]:
        """Return the profiles of the likelihood that intervals are made of, by name."""
        return {}

    def variants(self) -> Iterable[S]:
        """Yield the system with other choices of the method."""
        return ()

    def fit_of_variant(self, whole: OutputErrorFit, system: S) -> FloatArray:
        """Return the natural parameters (p,) that a variant of the system leads to."""
        model = replace(whole.model, system=same_with(whole, system))
        return fit(
            model, whole.fit.theta, max_iterations=VARIANT_ITERATIONS,
            relative_decrease=THRESHOLDS.min_decrease, damping=NEAR, thorough=True,
        ).theta  # fmt: skip


F = TypeVar("F", bound=Family[Any])


@dataclass(frozen=True, eq=False)
class DiagnosedFit(Generic[F]):
    """The fit of one group with what explains its misfit, and whether numbers may be given.

    ``tests`` are those of agreement. ``shifts`` (p,) each, or the first of them, scaled, are the
    steps of the parameters from what is left unexplained, and from what explains as much as that
    which was added: they widen the intervals, and so does what the data leave open of the
    ``assumptions``.
    """

    family: F
    whole: OutputErrorFit
    gate: Gate
    tests: tuple[ResidualTest, ...] = ()
    shifts: tuple[FloatArray, ...] = ()
    assumptions: tuple[Assumption, ...] = ()

    @property
    def theta(self) -> FloatArray:
        """All fitted parameters in natural units, (p,)."""
        return self.whole.fit.theta

    @property
    def fits(self) -> bool:
        """Whether the model fits these trials, as far as the gate can say, and has converged."""
        return self.gate.outcome is not FitOutcome.MISFIT and self.whole.converged

    @property
    def alarms(self) -> dict[str, float]:
        """Return the chance of a false alarm of each test that was made, by its name."""
        return self.family.alarms(self.tests)

    def by_unexplained(self, gradient: FloatArray) -> float:
        """Return by how much what is not explained may move a quantity.

        ``gradient`` is d(quantity)/d(scaled), of all parameters or of the first of them.
        """
        counts = (min(len(gradient), len(shift)) for shift in self.shifts)
        moved = (
            abs(float(gradient[:count] @ shift[:count]))
            for count, shift in zip(counts, self.shifts, strict=True)
        )
        return max(moved, default=0.0)

    def assumed(self, gradient: FloatArray) -> tuple[Share, ...]:
        """Return what each assumption adds to a quantity if it is 1 u larger.

        ``gradient`` is d(quantity)/d(scaled), of all parameters or of the first of them.
        """
        return tuple(
            Share(item.name, 0.0, item.u, float(gradient @ item.step[: len(gradient)]), item.left)
            for item in self.assumptions
        )

    def by_assumptions(self, gradient: FloatArray) -> float:
        """Return the standard deviation that the assumptions leave; ``gradient`` as above."""
        return math.hypot(*(share.held for share in self.assumed(gradient)))


@dataclass(frozen=True, eq=False)
class Identification(DiagnosedFit[F]):
    """A diagnosed fit with all that its intervals are made of.

    ``scans`` are the profiles, ``variants`` the natural parameters of each variant of the method,
    ``without`` (trials, p) the steps, scaled, without each trial, if something was added.
    """

    scans: Mapping[str, ProfileScan] = field(default_factory=dict)
    variants: tuple[FloatArray, ...] = ()
    without: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def by_trials(self, gradient: FloatArray) -> float:
        """Return the standard deviation of a quantity that single trials make of it.

        ``gradient`` is d(quantity)/d(scaled), of all parameters or of the first of them.
        """
        if not len(self.without):
            return 0.0
        return jackknife_sd(self.without[:, : len(gradient)] @ gradient)

    def by_method(self, change: Callable[[FloatArray], float]) -> float:
        """Return the root mean square ``change`` of a quantity with the variants of the method."""
        moved = [change(theta) for theta in self.variants]
        return float(np.sqrt(np.mean(np.square(moved)))) if moved else 0.0


def identify(family: F) -> Identification[F]:
    """Return what the trials of ``family`` show, by all steps.

    Raises:
        Diverged: the simulation of a trial leaves the numbers from every start.
        DataError: the data cannot answer.
    """
    return concluded(diagnosed(family, fitted(family)))


def fitted(family: Family[S]) -> OutputErrorFit:
    """Return the fit of ``family``, or a better one from points beside its end (step 1).

    Raises:
        Diverged: the simulation of a trial leaves the numbers from every start.
        DataError: the data cannot answer.
    """
    try:
        whole = family.fitted()
        return retried(whole, family.retries, family.block, family.elsewhere)
    except Diverged as error:
        raise Diverged(error.trial, family.described(error.trial)) from error


def diagnosed(family: F, whole: OutputErrorFit) -> DiagnosedFit[F]:
    """Return ``whole``, a fit of ``family``, diagnosed and judged (steps 2 and 3)."""
    refusal, shifts = family.refusal(whole), list[FloatArray]()
    assumptions: tuple[Assumption, ...] = ()
    if refusal is None:
        starts = family.starts or (whole.fit.theta[: len(family.system.shared)],)
        with np.errstate(over="ignore", invalid="ignore"):  # far from any motion
            diagnosis = diagnose(
                whole, family.suspects, starts, family.block, family.period_s, family.refitted
            )
        whole = diagnosis.fit
        gate = judge_fit(diagnosis, family.labels, family.period_s)
        shifts += (*(item.score.shift for item in diagnosis.left), *diagnosis.doubts)
        assumptions = diagnosis.assumptions
    else:
        gate = refusal
    tests = family.agreement(whole, gate)
    gate = family.findings(whole, gate, tests)
    shifts += family.shifts(whole)
    return DiagnosedFit(family, whole, gate, tests, tuple(shifts), assumptions)


def concluded(begun: DiagnosedFit[F]) -> Identification[F]:
    """Return ``begun`` with profiles, variants and steps without each trial (steps 4 to 6)."""
    family, whole, gate = begun.family, begun.whole, begun.gate
    scans: dict[str, ProfileScan] = {}
    if gate.outcome is not FitOutcome.MISFIT:
        whole, scans, why = _profiled(family, whole, gate)
        gate = settled_gate(gate, why, family.advice)
    variants: list[FloatArray] = []
    if gate.outcome is not FitOutcome.MISFIT:
        variants += (family.fit_of_variant(whole, system) for system in family.variants())
    corrected = gate.outcome is FitOutcome.CORRECTED
    return Identification(
        family, whole, gate, begun.tests, begun.shifts, begun.assumptions, scans, tuple(variants),
        without_each_trial(whole) if corrected else np.zeros((0, len(whole.fit.theta))),
    )  # fmt: skip


def _profiled(
    family: Family[S], whole: OutputErrorFit, gate: Gate
) -> tuple[OutputErrorFit, dict[str, ProfileScan], str]:
    """Return the fit with its profiles, and why it is not to be trusted (empty: it is).

    Profiles that find a better fit are made again from there.
    """
    for _ in range(MOST_BETTER):
        if not whole.converged:
            break
        scans = family.profiles(whole, gate)
        better = [line.better for line in scans.values() if line.better is not None]
        if not better:
            return whole, scans, ""
        whole = improve(whole, better[0], family.block)
    return whole, {}, whole.unsettled or "its profiles find better fits again and again"

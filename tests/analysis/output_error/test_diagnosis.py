"""Checks the search for explanations on a small system; the rig's own: analyses/lugre."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rigd.analysis.output_error.augmented_system import moved_constants
from rigd.analysis.output_error.diagnosis import Diagnosis, diagnose
from rigd.analysis.output_error.gate import judge_fit, sentence
from rigd.analysis.output_error.innovations import Deviations
from rigd.analysis.output_error.score import Columns
from rigd.analysis.output_error.structure import POSITIVE, Suspect
from rigd.analysis.output_error.system import Unknown
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.result import Explanation, FitOutcome, FloatArray, Meaning

from .lines import BLOCK, ROWS, Lines, fitted

WAVE = np.sin(9.0 * np.linspace(0.0, 1.0, ROWS))


def diagnosed(shapes: tuple[int, int]) -> Diagnosis:
    """Diagnose lines with a wave on them that is suspected.

    The suspect has as many shapes as the first of ``shapes``, once the motion is refitted as many
    as the second.
    """
    lines = Lines(((0, 6.0), (0, 5.0), (0, 4.0)), (0.7,))
    lines = replace(lines, measured=tuple(y + 0.4 * WAVE[:, None] for y in lines.measured))
    whole = fitted(lines)
    first = whole.fit.theta.copy()

    def columns(count: int) -> Columns:
        return [WAVE[:, None, None] ** np.arange(1, count + 1) for _ in lines.trials]

    def suspects(theta: FloatArray) -> Iterator[Suspect]:
        count = shapes[0] if np.array_equal(theta, first) else shapes[1]
        yield Suspect("a wave", "1", lambda: columns(count), special=True)

    return diagnose(whole, suspects, [np.zeros(len(lines.shared))], BLOCK, 1e-3)


def test_explanation_is_fitted_with_its_size() -> None:
    (wave,) = diagnosed((1, 1)).explanations
    assert wave.name == "a wave"
    assert wave.size == pytest.approx(0.4, abs=0.02)


def test_explanation_with_other_shapes_when_refitted_is_left() -> None:
    diagnosis = diagnosed((1, 2))
    assert diagnosis.explanations == ()
    assert diagnosis.left[0].name == "a wave"


@pytest.mark.parametrize("off", [-11.0, 11.0])
def test_constant_11_uncertainties_off_is_contradicted(off: float) -> None:
    """Trials as short show the sum of gain and offset only: half of the error goes to each."""
    lines = Lines(((0, 0.3), (0, 0.25), (0, 0.2)), (0.7,), gain=off)
    whole = fitted(lines)
    assert abs(whole.pulls[1]) < 6.0
    diagnosis = diagnose(whole, lambda _: (), [np.zeros(3)], BLOCK, 1e-3)
    (found,) = diagnosis.explanations
    assert found.stated == 0.0
    assert found.pull == pytest.approx(found.size)  # u is 1
    assert found.size == pytest.approx(off, abs=0.5)
    gate = judge_fit(diagnosis, ["a", "b", "c"], 1e-3)
    assert gate.outcome is FitOutcome.MISFIT
    assert gate.sentence.startswith("The model does not fit these data as the rig is stated")


def test_constant_left_to_data_states_its_move() -> None:
    lines = Lines(((0, 0.3), (0, 0.25), (0, 0.2)), (0.7,), gain=11.0)
    diagnosis = diagnose(fitted(lines), lambda _: (), [np.zeros(3)], BLOCK, 1e-3)
    (found,) = diagnosis.explanations
    gain, offset = moved_constants(lines.shared, diagnosis.fit)
    assert gain == (
        f"gain (the gain): stated 0 1 with u = {lines.shared[1].u:.3g} 1, fitted {found.size:.5g}, "
        f"moved by {found.pull:+.2f} of its uncertainty; left to the data"
    )
    assert offset.endswith("of its uncertainty")


@pytest.mark.parametrize(
    "decisive",
    [
        Explanation("mass", "kg", 2.0, 0.1, 90.0, stated=1.0, pull=10.0),
        Explanation("a law", "1", 2.0, 0.1, 90.0, meaning=Meaning.LAW),
        Explanation("a play", "1", 2.0, 0.1, 90.0, meaning=Meaning.CONFUSED),
    ],
)
def test_findings_begin_with_what_decides_the_outcome(decisive: Explanation) -> None:
    wave = Explanation("a wave", "1", 0.4, 0.01, 100.0)
    diagnosis = replace(diagnosed((1, 1)), explanations=(wave, decisive))
    gate = judge_fit(diagnosis, ["a", "b", "c"], 1e-3)
    assert gate.outcome is FitOutcome.MISFIT
    assert gate.sentence.startswith(f"Most of the misfit is {sentence(wave)} Beside that: ")
    assert gate.sentence.endswith(sentence(decisive))
    assert gate.findings[:2] == (sentence(decisive), sentence(wave))


@pytest.mark.parametrize(
    ("name", "asked"), [("wheel radius", True), ("lever d - e of the guide", False)]
)
def test_typing_error_is_guessed_of_radii_only(name: str, asked: bool) -> None:
    item = Explanation(name, "m", 0.025, 1e-5, 90.0, stated=0.05, pull=10.0)
    assert ("a diameter typed for a radius?" in sentence(item)) is asked


class HalfRead(Lines):
    """Of every other sample there is no reading; the others have 1.5 times the stated noise."""

    def deviations(self, trial: int, shared: FloatArray, local: FloatArray) -> Deviations:
        found = super().deviations(trial, shared, local)
        variance = found.variance / 1.5**2
        variance[::2] = np.inf
        return replace(found, variance=variance)


def test_samples_without_reading_hide_no_misfit() -> None:
    lines = HalfRead(tuple((0, 0.05 * k) for k in range(80, 120)), (0.7,))
    diagnosis = diagnose(fitted(lines), lambda _: (), [np.zeros(3)], BLOCK, 1e-3)
    assert diagnosis.levels[0] == pytest.approx(1.5**2, rel=0.1)
    gate = judge_fit(diagnosis, [f"trial {k}" for k in range(40)], 1e-3)
    assert "its y is off by 1.5 times what the noise" in gate.sentence


class Bounded(Lines):
    """Lines fitted with a gain within 6 of its uncertainties; their offset is not suspected."""

    @property
    def shared(self) -> tuple[Unknown, ...]:
        own, gain, offset = super().shared
        bounded = replace(gain.parameter, low=-6.0, high=6.0)
        return (own, replace(gain, parameter=bounded), replace(offset, wording=""))


def test_constant_beyond_its_bound_is_contradicted() -> None:
    lines = Bounded(((0, 0.3), (0, 0.25), (0, 0.2)), (0.7,), gain=11.0)
    wave = Suspect("a wave", "1", lambda: [WAVE[:, None, None] for _ in lines.trials])
    diagnosis = diagnose(fitted(lines), lambda _: (wave,), [np.zeros(3)], BLOCK, 1e-3)
    (found,) = diagnosis.explanations
    assert found.size == pytest.approx(11.0, abs=0.5)  # the bound goes with what is stated
    assert found.pull > THRESHOLDS.max_pull
    assert judge_fit(diagnosis, ["a", "b", "c"], 1e-3).outcome is FitOutcome.MISFIT


def test_explanation_that_cannot_be_fitted_yields_to_another() -> None:
    """By the score tests a twin explains most; with the motion refitted it has two shapes."""
    lines = Lines(((0, 6.0), (0, 5.0), (0, 4.0)), (0.7,))
    lines = replace(lines, measured=tuple(y + 0.4 * WAVE[:, None] for y in lines.measured))
    whole = fitted(lines)
    first = whole.fit.theta.copy()

    def alike(*waves: FloatArray) -> Columns:
        return [np.stack(waves, axis=1)[:, None, :] for _ in lines.trials]

    def suspects(theta: FloatArray) -> Iterator[Suspect]:
        twin = (WAVE,) if np.array_equal(theta, first) else (WAVE, WAVE**2)
        yield Suspect("a twin", "1", lambda: alike(*twin), special=True)
        yield Suspect("a wave", "1", lambda: alike(WAVE + 0.05 * np.roll(WAVE, 7)), special=True)

    diagnosis = diagnose(whole, suspects, [np.zeros(len(lines.shared))], BLOCK, 1e-3)
    (wave,) = diagnosis.explanations
    assert wave.name == "a wave"
    assert wave.others == ("a twin",)


def with_wave(suspects: list[Suspect], size: float = 0.4) -> Diagnosis:
    lines = Lines(((0, 6.0), (0, 5.0), (0, 4.0)), (0.7,))
    lines = replace(lines, measured=tuple(y + size * WAVE[:, None] for y in lines.measured))
    return diagnose(fitted(lines), lambda _: suspects, [np.zeros(3)], BLOCK, 1e-3)


def shaped(name: str, shape: FloatArray, **more: Any) -> Suspect:
    return Suspect(name, "1", lambda: [shape.reshape(ROWS, 1, -1)] * 3, special=True, **more)


def test_cause_with_an_impossible_size_is_not_named() -> None:
    height = shaped("a height", -WAVE, possible=POSITIVE)
    wave = shaped("a wave", WAVE + 0.3 * np.roll(WAVE, 9))
    diagnosis = with_wave([height, wave])
    assert [item.name for item in diagnosis.explanations] == ["a wave"]
    assert "a height" not in judge_fit(diagnosis, ["a", "b", "c"], 1e-3).sentence


def test_cause_that_explains_little_is_not_named() -> None:
    part = np.where(np.arange(ROWS) < ROWS // 4, WAVE, 0.0)
    speed = replace(shaped("an error that depends on the speed", part), context="the speed")
    diagnosis = with_wave([speed])
    assert diagnosis.explanations == ()
    gate = judge_fit(diagnosis, ["a", "b", "c"], 1e-3)
    assert gate.outcome is FitOutcome.MISFIT
    assert "Nothing that rigd knows explains most of it." in gate.sentence
    assert "goes with the speed" in gate.sentence
    assert "an error that" not in gate.sentence


@pytest.mark.parametrize(("size", "named"), [(0.05, False), (0.2, True)])
def test_cause_just_significant_widens_without_name(size: float, named: bool) -> None:
    diagnosis = with_wave([shaped("a wave", WAVE)], size)
    assert bool(diagnosis.explanations) is named
    assert [item.name for item in diagnosis.left] == ([] if named else ["a wave"])
    gate = judge_fit(diagnosis, ["a", "b", "c"], 1e-3)
    assert gate.outcome is FitOutcome.CORRECTED
    assert ("nearly" in gate.sentence) is not named


def test_misfit_without_cause_is_placed_in_time() -> None:
    late = np.where(np.arange(ROWS) >= ROWS // 2, np.sin(2.5 * np.arange(ROWS)), 0.0)
    lines = Lines(((0, 6.0), (0, 5.0), (0, 4.0)), (0.7,))
    measured = list(lines.measured)
    measured[1] = measured[1] + 0.6 * late[:, None]
    diagnosis = diagnose(
        fitted(replace(lines, measured=tuple(measured))), lambda _: (), [np.zeros(3)], BLOCK, 1e-3
    )
    shape = diagnosis.shape
    assert shape.trial == 1
    assert ROWS // 2 <= shape.begin < shape.end
    assert shape.frequency == pytest.approx(2.5 / (2.0 * np.pi), abs=0.05)
    sentence = judge_fit(diagnosis, ["a", "b", "c"], 1e-3).sentence
    assert "in trial b between" in sentence


def test_amplitude_is_that_of_the_largest_harmonic() -> None:
    turned = 9.0 * np.linspace(0.0, 1.0, ROWS)[:, None] * np.arange(1, 3)
    waves = np.concatenate([np.cos(turned), np.sin(turned)], axis=1)
    (wave,) = with_wave([shaped("a runout", waves, harmonics=2)]).explanations
    assert wave.size == pytest.approx(0.4, abs=0.05)


def test_size_that_differs_between_trials_is_uncertain() -> None:
    lines = Lines(((0, 6.0), (0, 5.0), (0, 4.0)), (0.7,))
    waves = zip(lines.measured, (0.3, 0.4, 0.5), strict=True)
    lines = replace(lines, measured=tuple(y + size * WAVE[:, None] for y, size in waves))
    suspect = shaped("a wave", WAVE)
    (wave,) = diagnose(fitted(lines), lambda _: [suspect], [np.zeros(3)], BLOCK, 1e-3).explanations
    assert wave.size == pytest.approx(0.4, abs=0.05)
    assert wave.sd > 0.05  # of the mean of three that differ by 0.1


def test_size_holds_what_other_explanations_make_of_it() -> None:
    companion = np.roll(WAVE, 5)
    lines = Lines(((0, 6.0), (0, 5.0), (0, 4.0)), (0.7,))
    both = 0.4 * WAVE + 0.3 * companion
    lines = replace(lines, measured=tuple(y + both[:, None] for y in lines.measured))
    suspects = [shaped("a wave", WAVE), shaped("a companion", companion)]
    found = diagnose(fitted(lines), lambda _: suspects, [np.zeros(3)], BLOCK, 1e-3).explanations
    alone = diagnose(fitted(lines), lambda _: suspects[:1], [np.zeros(3)], BLOCK, 1e-3)
    wave = next(item for item in found if item.name == "a wave")
    assert len(found) == 2
    assert abs(alone.explanations[0].size - wave.size) < 2.0 * wave.sd

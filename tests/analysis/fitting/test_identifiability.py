from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rigd.analysis.fitting.identifiability import (
    Advice,
    Candidate,
    Evidence,
    advise,
    fisher,
    judge,
    log_sd,
)
from rigd.analysis.fitting.model import Model
from rigd.analysis.result import Verdict


@pytest.mark.parametrize(
    ("low", "high", "bound", "verdict"),
    [
        (0.98, 1.02, None, Verdict.IDENTIFIABLE),
        (0.7, 1.4, None, Verdict.WEAK),
        (0.4, 2.5, None, Verdict.UNIDENTIFIABLE),
        (None, 1.1, None, Verdict.UNIDENTIFIABLE),
        (0.9, None, None, Verdict.UNIDENTIFIABLE),
        (0.98, 1.02, 1.0, Verdict.UNIDENTIFIABLE),
        (-0.1, 1.1, None, Verdict.UNIDENTIFIABLE),
    ],
)
def test_verdict_follows_from_ends_and_bound(
    low: float | None, high: float | None, bound: float | None, verdict: Verdict
) -> None:
    assert judge(Evidence(1.0, low, high, "m/s", bound))[0] is verdict


def test_a_biased_method_never_reads_as_known() -> None:
    verdict, sentence = judge(Evidence(1.0, 0.99, 1.01, "s/m", bias="Smeared."))
    assert verdict is Verdict.BIASED
    assert sentence == "Smeared."


def test_sentence_names_the_open_side() -> None:
    assert "at least 0.9 m/s" in judge(Evidence(1.0, 0.9, None, "m/s"))[1]
    assert "at most 1.1 m/s" in judge(Evidence(1.0, None, 1.1, "m/s"))[1]


def test_log_sd_inverts_the_interval() -> None:
    assert log_sd(np.exp(-0.2 * 1.959964), np.exp(0.2 * 1.959964)) == pytest.approx(0.2)


def test_advice_names_the_candidate_that_excites_the_parameter(
    decay: Callable[..., Model],
) -> None:
    late, early = np.linspace(4.0, 5.0, 100), np.linspace(0.0, 1.0, 100)
    theta = np.array([1.0, 1.0])
    current = fisher(decay(np.zeros(100), late), theta, 0.01)
    tests = (
        Candidate("Measure late again", decay(np.zeros(100), late)),
        Candidate("Measure the beginning", decay(np.zeros(100), early)),
    )
    amplitude = np.array([1.0, 0.0])
    found = advise(amplitude, theta, current, tests, 0.01)
    assert found is not None
    assert found.sentence == "Measure the beginning"
    assert found.shrink > 1.5
    assert advise(amplitude, theta, current, tests[:1], 0.01) is None  # sqrt 2 is not worth a test


def test_more_data_shrink_chance_but_not_the_method() -> None:
    repeats = Advice("The same again", 2.0)
    assert repeats.remaining(0.4, 0.0) == pytest.approx(0.2)
    assert repeats.remaining(0.5, 0.4) == pytest.approx(np.hypot(0.15, 0.4))
    assert repeats.remaining(np.inf, 0.0) == np.inf


def test_interval_end_beyond_allowed_range_is_not_printed() -> None:
    evidence = Evidence(0.0189, 1.1e-5, 34.9, "m/s", allowed=(1e-4, 10.0), wider="(Why.)")
    verdict, sentence = judge(evidence)
    assert verdict is Verdict.UNIDENTIFIABLE
    assert evidence.ends == (None, None)
    assert evidence.log_sd == np.inf
    assert sentence == "The data do not limit it: neither upwards nor downwards. (Why.)"
    half = Evidence(0.0189, 0.001, 34.9, "m/s", allowed=(1e-4, 10.0))
    assert judge(half)[1] == "The data do not limit it: not upwards (at least 0.001 m/s)."


def test_parameter_moved_by_the_method_is_reported() -> None:
    """The data alone close it; only the choice of the filter window leaves it open or wide."""
    for low, high in ((0.4, 2.5), (None, 1.1)):
        by_method, sentence = judge(Evidence(1.0, low, high, "m/s", data_log_sd=0.05))
        assert by_method is Verdict.UNRESOLVED
        assert "data" not in sentence
        by_data, _ = judge(Evidence(1.0, low, high, "m/s", data_log_sd=0.5))
        assert by_data is Verdict.UNIDENTIFIABLE
    on_bound, _ = judge(Evidence(1.0, 0.4, 2.5, "m/s", bound=2.5, data_log_sd=0.05))
    assert on_bound is Verdict.UNIDENTIFIABLE


@pytest.mark.parametrize("bound", [None, 2.0])
def test_parameter_at_bound_in_all_refits_is_unidentifiable(bound: float | None) -> None:
    """As for a parameter that is on its bound with any trial left out."""
    stuck = Evidence(2.0, 2.0, 2.0, "1/m", bound)
    assert judge(stuck)[0] is Verdict.UNIDENTIFIABLE
    assert stuck.log_sd == np.inf
    assert Advice("More", 2.0).remaining(stuck.log_sd, 0.0) == np.inf

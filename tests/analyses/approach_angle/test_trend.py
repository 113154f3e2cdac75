"""The trend over the angle, against the figures that the reference gives for Table 1."""

from __future__ import annotations

import math

import pytest

from rigd_analyses.approach_angle.campaign.trend import trend

NAMES = ("clean_0", "clean_15", "clean_30", "clean_45")
ALPHA = tuple(math.radians(a) for a in (0.0, 15.0, 30.0, 45.0))
TABLE_1 = (0.1868, 0.2475, 0.4504, 0.5861)


def test_the_line_through_table_1() -> None:
    found = trend("published", NAMES, ALPHA, TABLE_1)
    assert found is not None
    line = found.line
    assert line.slope_per_deg == pytest.approx(0.009339, abs=5e-7)
    assert line.slope_u == pytest.approx(0.00126, abs=5e-6)
    assert line.slope_high - line.slope_per_deg == pytest.approx(0.0054, abs=5e-5)
    assert line.slope_per_deg - line.slope_low == pytest.approx(0.0054, abs=5e-5)
    assert line.intercept == pytest.approx(0.1576, abs=5e-5)
    assert line.r_squared == pytest.approx(0.965, abs=5e-4)
    assert line.rms == pytest.approx(0.030, abs=5e-4)
    assert line.dof == 2


def test_chance_alignment_of_maxima_keeps_slope_uncertain() -> None:
    on_a_line = [0.2 + 0.5 * a for a in ALPHA[:3]]
    sure = trend("made", NAMES[:3], ALPHA[:3], on_a_line)
    found = trend("made", NAMES[:3], ALPHA[:3], on_a_line, [0.01, 0.03, 0.01])
    assert sure is not None and sure.line.slope_u < 1e-12
    assert found is not None
    # The slope is (mu_3 - mu_1) / 30 degrees: the one in the middle has no part in it.
    expected = math.hypot(0.01, 0.01) / 30.0
    assert found.line.slope_u == pytest.approx(expected)
    assert found.line.slope_high - found.line.slope_per_deg == pytest.approx(1.96 * expected)
    assert found.line.intercept_u > 0.01


def test_rolling_demand_fitting_table_1_equally_is_reported() -> None:
    found = trend("published", NAMES, ALPHA, TABLE_1)
    assert found is not None
    assert found.demand.a == pytest.approx(0.180, abs=5e-4)
    assert found.demand.b == pytest.approx(0.347, abs=5e-4)
    assert found.demand.rms == pytest.approx(0.028, abs=5e-4)
    assert "cannot separate" in found.sentence


def test_sentence_names_the_form_that_fits_far_better() -> None:
    straight = trend("made", NAMES, ALPHA, [0.2 + 0.5 * a for a in ALPHA])
    rolling = trend("made", NAMES, ALPHA, [(0.2 + 0.3 * math.sin(a)) / math.cos(a) for a in ALPHA])
    assert straight is not None and "The line describes" in straight.sentence
    assert rolling is not None and "The demand form describes" in rolling.sentence


def test_three_collinear_maxima_cannot_separate_limit_from_demand() -> None:
    found = trend("made", NAMES[:3], ALPHA[:3], [0.2 + 0.5 * a for a in ALPHA[:3]])
    assert found is not None and "3 maxima alone cannot separate" in found.sentence


def test_two_angles_are_no_trend() -> None:
    assert trend("made", NAMES[:2], ALPHA[:2], TABLE_1[:2]) is None
    assert trend("made", ("a", "b", "c"), (0.0, 0.0, 0.5), (0.1, 0.2, 0.3)) is None

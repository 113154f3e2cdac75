import numpy as np
import pytest

from rigd.analysis.report.trace import spans, thin


def test_short_signal_is_left_alone() -> None:
    x = np.arange(20.0)
    assert thin(x, x, 10)[1] is x


def test_thinning_keeps_every_peak_and_the_order() -> None:
    rng = np.random.default_rng(3)
    x = np.arange(10_000.0)
    y = rng.normal(size=x.size)
    y[4_321], y[77] = 50.0, -60.0
    thin_x, thin_y = thin(x, y, 100)
    assert thin_x.size <= 200
    assert thin_y.max() == 50.0
    assert thin_y.min() == -60.0
    assert np.all(np.diff(thin_x) > 0)
    assert np.array_equal(y[thin_x.astype(int)], thin_y)


def test_gap_stays_a_gap() -> None:
    x = np.arange(1_000.0)
    y = np.ones_like(x)
    y[300:600] = np.nan
    thin_x, thin_y = thin(x, y, 100)
    inside = (thin_x > 305) & (thin_x < 595)
    assert inside.any()
    assert np.isnan(thin_y[inside]).all()
    assert np.isfinite(thin_y[~inside & ((thin_x < 295) | (thin_x > 605))]).all()


def test_spans_join_across_less_than_a_column() -> None:
    t = np.arange(1_000, dtype=np.float64) * 1e-3
    flag = np.zeros(t.size, dtype=bool)
    flag[100:200] = flag[202:300] = flag[700] = True
    found = spans(t, flag, columns=100)
    assert found == [pytest.approx((0.0995, 0.2)), pytest.approx((0.6995, 0.001))]


def test_spans_of_empty_or_false_are_empty() -> None:
    assert spans(np.empty(0), np.empty(0, dtype=bool)) == []
    assert spans(np.arange(5.0), np.zeros(5, dtype=bool)) == []

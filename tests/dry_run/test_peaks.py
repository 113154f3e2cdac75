"""Extremes of channels in a dry run."""

from __future__ import annotations

import numpy as np

from rigd.dry_run.peaks import PeakSink
from rigd.model.channels import Channel, Stream
from rigd.model.rows import row_dtype

OVEN = Stream("oven", (Channel("heat", "K"),))


def test_channel_without_first_value_has_peak_later() -> None:
    sink = PeakSink()
    for heat in (np.nan, 300.0, np.nan, 290.0):
        rows = np.zeros(1, row_dtype(OVEN))
        rows["heat"] = heat
        sink.write("oven", rows)
    assert sink.peaks["oven.heat"] == (290.0, 300.0)

"""Trials of a run are grouped, and coloured, by what distinguishes them."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.analysis.run_page.groups import RANGES, groups_of
from rigd.model.channels import Channel, Stream
from rigd.record import Recording, RecordingWriter

AXIS = Stream("axis", (Channel("position", "m"),))


@pytest.mark.parametrize("repeats", [1, 2, 3, 5])
def test_trials_of_one_value_have_one_group(tmp_path: Path, repeats: int) -> None:
    values = [float(number) for number in range(1, 14) for _ in range(repeats)]
    path = tmp_path / "run.mcap"
    with RecordingWriter.create(
        path, streams=[AXIS], metadata={}, attachments=(), start_ns=0
    ) as writer:
        for number, value in enumerate(values, 1):
            data = {"number": number, "parameters": {"speed": value}, "units": {"speed": "m/s"}}
            writer.event(2 * number, "trial_start", number, data)
            writer.event(2 * number + 1, "trial_end", number, {"complete": True})
    groups = groups_of(Recording.open(path).info)
    of_value = {value: groups.of[index] for index, value in enumerate(values)}
    assert [groups.of[index] for index in range(len(values))] == [of_value[v] for v in values]
    assert sorted(groups.of.values()) == [groups.of[index] for index in range(len(values))]
    assert 3 <= len(groups.labels) == len(groups.colours) <= RANGES
    assert (groups.labels[0][:5], groups.labels[-1][-6:]) == ("1 m/s", "13 m/s")

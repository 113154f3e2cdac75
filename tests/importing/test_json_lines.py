"""JSON lines of pandas and of json give the numbers that another reader gives, or are refused."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rigd.importing import import_files, parse_map, propose
from rigd.model import ConfigError
from rigd.record import Recording

COUNT = 300
TIMES_S = np.arange(COUNT) / 1000.0
FORCE = np.random.default_rng(5).normal(size=COUNT)
MAP = """\
map: bench
rig: old_bench
started: 2016-03-04T10:00:00Z
sources:
  samples:
    time: {column: t, unit: s}
    channels:
      force: {column: load.force, unit: kN}
"""


def bring_in(path: Path, text: str = MAP) -> Recording:
    (made,) = import_files(parse_map(text, Path("map.yaml")), [path], path.parent / "runs")
    return Recording.open(made.path)


def written(folder: Path, rows: Sequence[object], name: str = "a.jsonl") -> Path:
    path = folder / name
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


def nested() -> list[dict[str, object]]:
    pairs = zip(TIMES_S.tolist(), FORCE.tolist(), strict=True)
    return [
        {"t": t, "load": {"force": f, "on": i % 2 == 0}, "n": i, "list": [1, [2]]}
        for i, (t, f) in enumerate(pairs)
    ]


@pytest.mark.parametrize("block", [1000, 8 << 20])
def test_nested_keys_are_columns(
    tmp_path: Path, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigd.importing.tables.json_table.BLOCK_BYTES", block)
    path = written(tmp_path, nested())
    more = "      on: {column: load.on, unit: '1'}\n      n: {column: n, unit: '1'}\n"
    rows = bring_in(path, MAP + more).read("samples")
    flat = pd.json_normalize([json.loads(line) for line in path.read_text().splitlines()])
    assert rows["force"].tolist() == (flat["load.force"] * 1000.0).tolist()
    assert rows["on"].tolist() == flat["load.on"].astype(float).tolist()
    assert rows["n"].tolist() == flat["n"].tolist()
    since = np.rint(flat["t"].to_numpy() * 1e9).astype(int)
    assert (rows["t_ns"] - rows["t_ns"][0]).tolist() == since.tolist()


def test_lines_of_pandas_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.ndjson"
    table = pd.DataFrame({"t": TIMES_S, "load.force": np.where(FORCE > 1, np.nan, FORCE)})
    table.to_json(path, orient="records", lines=True, double_precision=15)
    again = pd.read_json(path, lines=True, precise_float=True)
    rows = bring_in(path).read("samples")
    np.testing.assert_array_equal(rows["force"], again["load.force"] * 1000.0)


def test_keys_that_lines_lack_are_nan(tmp_path: Path) -> None:
    rows = nested()
    rows[3] = {"t": 0.003}
    rows[4]["load"] = None
    rows[5]["load"] = {"force": None}
    rows[6]["load"] = {"force": math.nan}  # which json of Python writes as NaN
    force = bring_in(written(tmp_path, rows)).read("samples")["force"]
    assert np.flatnonzero(np.isnan(force)).tolist() == [3, 4, 5, 6]


def test_whole_times_keep_their_digits(tmp_path: Path) -> None:
    stamps = [1_457_085_600_123_456_789 + i * 1_000_001 for i in range(40)]
    path = written(tmp_path, [{"t": t, "load": {"force": 1.5}} for t in stamps])
    text = MAP.replace("unit: s}", "unit: ns, since: 1970-01-01}")
    assert bring_in(path, text).read("samples")["t_ns"].tolist() == stamps


def test_last_line_may_lack_its_end(tmp_path: Path) -> None:
    path = written(tmp_path, nested())
    path.write_bytes(path.read_bytes()[:-1])
    assert len(bring_in(path).read("samples")) == COUNT


#: What a line becomes -> the refusal.
WRONG = {
    '{"t": 0.006, "load": {"force": "OVER"}}': r"a\.jsonl:7:2: .*'load.force' is \"OVER\"",
    '{"t": 0.006, "load": {"force": 1': r"a\.jsonl:7:\d+: the line is no JSON, or is cut off",
    '{"t": 0.006, "load": {"force": Infinity}}': r"a\.jsonl:7:\d: .*Infinity",
    "[0.006, 1.0]": r"a\.jsonl:7:1: the line has no object",
    "": r"a\.jsonl:7:\d: the line is no JSON",
    '{"t": 0.006} {"t": 0.007}': r"a\.jsonl:7:\d+: the line is no JSON",
    '{"t": null}': r"a\.jsonl:7:1: a time is missing",
    '{"a":' * 100_000 + "1" + "}" * 100_000: r"a\.jsonl:7:1: (.*too deep|a time is missing)",
}


@pytest.mark.parametrize("late", [False, True], ids=["in the first lines", "later"])
@pytest.mark.parametrize("number", range(len(WRONG)))
def test_line_that_is_wrong_is_named(
    tmp_path: Path, number: int, late: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    line, refusal = list(WRONG.items())[number]
    if late:
        monkeypatch.setattr("rigd.importing.tables.json_table.NAMED_LINES", 5)
    lines = [json.dumps(row) for row in nested()]
    lines[6] = line
    (tmp_path / "a.jsonl").write_text("\n".join(lines) + "\n")
    with pytest.raises(ConfigError, match=refusal):
        bring_in(tmp_path / "a.jsonl")


def test_proposed_map_asks_for_units_alone(tmp_path: Path) -> None:
    path = written(tmp_path, [{**row, "floor": "pvc", "n": None} for row in nested()])
    proposal = propose([path])
    assert len(proposal.blanks) == 3, proposal.text
    text = proposal.text.replace('unit: "?"  ', "unit: s  ").replace('unit: "?"}', "unit: kN}")
    assert "column: load.on" in text or 'column: "load.on"' in text
    rows = bring_in(path, text).read("samples")
    assert rows["load_force"].tolist() == (FORCE * 1000.0).tolist()

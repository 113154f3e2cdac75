"""What the tables of docs/import.md say to write is written into a map, and gives the truth."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from support.recordings.imported import MAP, Import

from rigd.importing.tables.formats import _ENDINGS
from rigd.model import ConfigError

PAGE = (Path(__file__).parents[2] / "docs" / "import.md").read_text()
COUNT = 40
FORCE = [i * 0.5 for i in range(COUNT)]
START = datetime(2016, 3, 4, 10, tzinfo=UTC)
#: A key with its value, or a block in braces.
_SAYS = re.compile(r"`(\{[^`]+\}|[a-z_]+: [^`]+)`")


def rows_below(heading: str) -> list[list[str]]:
    """Return the cells of the rows of the table with that line of names."""
    lines = PAGE[PAGE.index(heading) :].splitlines()[2:]
    end = next(at for at, line in enumerate(lines) if not line.startswith("|"))
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines[:end]]


def said(heading: str) -> list[str]:
    return [text for row in rows_below(heading) for cell in row for text in _SAYS.findall(cell)]


WRONG = "| what is wrong | what to do if it is meant so |"
TIMES = "| the times are | write |"
TRIALS = "| | |\n|---|---|\n| `columns"


def table(times: Sequence[object], head: str = "t,F,v") -> str:
    return f"{head}\n" + "".join(f"{t},{i * 0.5},{i}\n" for i, t in enumerate(times))


def milli(step: float = 1e-3) -> list[str]:
    return [f"{i * step:.3f}" for i in range(COUNT)]


GOOD = table(milli())
AUTUMN = [
    (datetime(2024, 10, 27, tzinfo=UTC) + i * timedelta(minutes=3)).astimezone(
        ZoneInfo("Europe/Berlin")
    )
    for i in range(COUNT)
]
DATES = '{column: t, format: "%Y-%m-%d %H:%M:%S"}'
AT_TOP, TIME, TEXT, CHANNEL = "started:", "time: {column: t, unit: s", "text: {", "column: F"
#: What the page says -> where it is put (before AT_TOP, else behind), the map before, the file.
REMEDIES: dict[str, tuple[str, str, str]] = {
    "restarts: true": (TIME, f"{MAP}trials: {{gaps: 1 s}}\n", table(milli()[:20] * 2)),
    "gaps: 1 s": ("trials", MAP.replace("unit: s", "unit: s, restarts: true"),
                  table(milli()[:20] * 2)),
    "wraps: 32 bit": (TIME, MAP.replace("unit: s", "unit: us"),
                      table([(2**32 - 5000 + 1000 * i) % 2**32 for i in range(COUNT)])),
    "zone: Europe/Berlin": (TIME, MAP.replace("{column: t, unit: s}", DATES),
                            table([f"{moment:%Y-%m-%d %H:%M:%S}" for moment in AUTUMN])),
    "coarse: spread": (TIME, MAP, table([f"{i // 4 * 0.004:.3f}" for i in range(COUNT)])),
    "longest_gap: 0.5 s": (TIME, MAP, table([f"{i * 1e-3 + (i > 9) * 0.4:.3f}"
                                              for i in range(COUNT)])),
    'missing: [NaN, ""]': (TEXT, MAP, GOOD.replace(",5.0,", ",NaN,").replace(",6.0,", ",,")),
    'decimal: ","': (TEXT, MAP, GOOD.replace(",", ";").replace(".", ",")),
    "unit: N": (CHANNEL, MAP.replace(", unit: N", ""), GOOD.replace("F", "F [Newton]")),
    "last: 204": (TEXT, MAP, table([f"{i / 1e3:.3f}" for i in range(203)]) + f"\n{GOOD}"),
    "header: 206": (TEXT, MAP, table([f"{i / 1e3:.3f}" for i in range(203)]) + f"\n{GOOD}"),
    "open_end: true": (TEXT, MAP, GOOD[:-1]),
}  # fmt: skip
#: `warnings: accept` has a test of its own: test_warning_of_a_library_is_an_error.
OTHER = {"warnings: accept"}


def placed(where: str, says: str, map: str) -> str:
    if where == "trials":
        return f"{map}trials: {{{says}}}\n"
    if where == TEXT:
        return map.replace(TEXT, TEXT + says)
    if where == TIME:
        return re.sub(r"(time: \{column: t)", rf"\1, {says}", map)
    return map.replace(where, f"{where}, {says}")


@pytest.mark.parametrize("says", REMEDIES)
def test_remedy_of_the_table_imports_truth(bring_in: Import, says: str) -> None:
    where, map, text = REMEDIES[says]
    with pytest.raises(ConfigError):
        bring_in(text, map=map, name="before.csv")
    force = bring_in(text, map=placed(where, says, map)).read("samples")["force"]
    assert len(force) == (203 if says == "last: 204" else COUNT)
    expected = [i * 0.5 for i in range(len(force))]
    if "NaN" in says:
        expected[10] = expected[12] = np.nan
    np.testing.assert_array_equal(force, expected)


SECONDS = [START + timedelta(seconds=i) for i in range(COUNT)]
EXCEL, MAC = datetime(1899, 12, 30, tzinfo=UTC), datetime(1904, 1, 1, tzinfo=UTC)


def days(zero: datetime, more: float = 0.0) -> list[str]:
    return [repr((moment - zero) / timedelta(days=1) + more) for moment in SECONDS]


def unix_s(moment: datetime) -> int:
    return round((moment - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds())


COUNTER = [str((2**32 - 5_000_000 + 1_000_000 * i) % 2**32) for i in range(COUNT)]
#: What the page says -> the cells of the times, and when the samples were taken.
CLOCKS: dict[str, tuple[Sequence[object], Sequence[datetime]]] = {
    "{column: t, unit: s}": (range(COUNT), SECONDS),
    "{rate: 2 kHz}": (["-"] * COUNT, [START + i * timedelta(seconds=5e-4) for i in range(COUNT)]),
    "{column: t, unit: s, since: 1970-01-01}": ([unix_s(item) for item in SECONDS], SECONDS),
    "{column: t, unit: s, since: 1904-01-01}":
        ([round((item - MAC).total_seconds()) for item in SECONDS], SECONDS),
    "{column: t, unit: d, since: 1899-12-30}": (days(EXCEL), SECONDS),
    "since: 1904-01-01": (days(MAC), SECONDS),
    "since: 0000-01-00": (days(datetime(1, 1, 1, tzinfo=UTC), 367.0), SECONDS),
    "{column: t, format: iso}": ([f"{item:%Y-%m-%dT%H:%M:%S}" for item in SECONDS], SECONDS),
    'format: "%d.%m.%Y %H:%M:%S.%f"': ([f"{item:%d.%m.%Y %H:%M:%S.%f}" for item in SECONDS],
                                         SECONDS),
    '{column: t, format: "%H:%M:%S.%f", since: 2025-03-03}':
        ([f"{item:%H:%M:%S.%f}" for item in SECONDS],
         [item.replace(year=2025, day=3) for item in SECONDS]),
    "unit: s, since: 2025-03-03, wraps: 24 h":
        ([(86_390 + i) % 86_400 for i in range(COUNT)],
         [datetime(2025, 3, 3, 23, 59, 50, tzinfo=UTC) + timedelta(seconds=i)
          for i in range(COUNT)]),
    '{column: t, format: "%Y-%m-%d %H:%M:%S", zone: Europe/Berlin}':
        ([f"{item:%Y-%m-%d %H:%M:%S}" for item in AUTUMN], AUTUMN),
    "{column: t, unit: us, wraps: 32 bit}":
        (COUNTER, [item + timedelta(seconds=2**32 / 1e6 - 5) for item in SECONDS]),
    "wraps: 2^32 us": (COUNTER, [item + timedelta(seconds=2**32 / 1e6 - 5) for item in SECONDS]),
    "{column: t, unit: s, restarts: true}":
        ([i % 20 / 1000 for i in range(COUNT)],
         [START + timedelta(seconds=i / 1000 + (i >= 20) * 0.999) for i in range(COUNT)]),
    "{column: t, unit: s, coarse: spread}":
        ([i // 4 for i in range(COUNT)],
         [START + timedelta(seconds=i / 4) for i in range(COUNT)]),
    "shift: -5 ms": (range(COUNT), [item - timedelta(milliseconds=5) for item in SECONDS]),
}  # fmt: skip
#: What the keys that stand alone belong to.
ROUND = {"since": "unit: d, ", "shift": "unit: s, ", "wraps": "unit: us, "}


@pytest.mark.parametrize("says", CLOCKS)
def test_clock_of_the_table_gives_times(bring_in: Import, says: str) -> None:
    cells, moments = CLOCKS[says]
    alone = "" if says.startswith("unit:") else ROUND.get(says.partition(":")[0], "")
    time = says if says.startswith("{") else f"{{column: t, {alone}{says}}}"
    more = "trials: {gaps: 1 s}\n" if "restarts" in says else ""
    map = MAP.replace("{column: t, unit: s}", time) + more
    rows = bring_in(table(cells), map=map).read("samples")
    microseconds = [(item - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1)
                    for item in moments]  # fmt: skip
    resolution_us = 6.0 if "0000" in says else 1.0
    assert np.max(np.abs(rows["t_ns"] / 1000 - np.array(microseconds))) <= resolution_us
    assert rows["force"].tolist() == FORCE


PARTS = {
    "columns: [load, repeat]": 4,
    'outside: "-1"': 3,
    "gaps: 1 s": 2,
    "signal: {channel: drive.speed, above: 1 mm/s}": 3,
}


@pytest.mark.parametrize("says", PARTS)
def test_trials_of_the_table_are_found(bring_in: Import, says: str) -> None:
    text = "t,F,v,load,repeat\n" + "".join(
        f"{i / 1000 + (i >= 20) * 2:.3f},{i},{0 if i % 14 < 4 else 9},{-1 if i < 10 else 5},"
        f"{i // 10}\n"
        for i in range(COUNT)
    )
    keys = f"columns: [load, repeat], {says}" if says.startswith("outside") else says
    map = MAP.replace("  samples:", "  drive:")
    if "gaps" not in says:
        map = map.replace("unit: s}", "unit: s, longest_gap: 9 s}")
    assert len(bring_in(text, map=map, more=f"trials: {{{keys}}}\n").trials) == PARTS[says]


def test_every_row_of_the_tables_is_tested() -> None:
    assert set(said(WRONG)) == set(REMEDIES) | OTHER
    assert set(said(TIMES)) == set(CLOCKS)
    lines = PAGE[PAGE.index(TRIALS) :].splitlines()[2:5]
    assert {text for line in lines for text in _SAYS.findall(line)} == set(PARTS)


def test_endings_of_the_table_are_known() -> None:
    rows = rows_below("| format | endings | units | times |")
    documented = {row[0].partition(",")[0]: set(re.findall(r"`(\.\w+)`", row[1])) for row in rows}
    names = {"csv": "text with columns", "parquet": "Parquet", "hdf5": "HDF5", "mat": "MATLAB",
             "tdms": "TDMS", "mdf": "MDF4", "numpy": "numpy",
             "jsonl": "JSON lines: an object in each line"}  # fmt: skip
    known = {
        names[format]: {end for end, other in _ENDINGS.items() if other == format}
        for format in set(_ENDINGS.values())
    }
    assert documented == known

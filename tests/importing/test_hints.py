"""Each hint of the import leads to the right recording or another refusal, never to a wrong one.

A case breaks a map or a file, asserts the hint, and follows it. What comes out is compared with
the truth that made the file. A hint in the code without a case fails `test_every_hint_has_a_case`.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import h5py
import numpy as np
import pytest
import scipy.io
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter

import rigd.importing
from rigd.importing import import_files, parse_map
from rigd.model import ConfigError, RecordingError
from rigd.model.errors import RigdError
from rigd.record import Recording

START = datetime(2016, 3, 4, 10, tzinfo=UTC)
COUNT = 40
FORCE = tuple(i * 0.5 for i in range(COUNT))
MILLI = tuple(i * 1e-3 for i in range(COUNT))
MAP = """\
map: m
rig: r
started: 2016-03-04T10:00:00Z
sources:
  s:
    text: {}
    time: {column: t, unit: s}
    channels:
      force: {column: F, unit: N}
      speed: {column: v, unit: mm/s}
"""
Edits = Sequence[tuple[str, str]]
Files = Mapping[str, str | bytes | Callable[[Path], None]]


def table(times: Sequence[object], head: str = "t,F,v") -> str:
    return f"{head}\n" + "".join(f"{t},{i * 0.5},{i}\n" for i, t in enumerate(times))


def seconds(values: Sequence[float], digits: int = 3) -> list[str]:
    return [f"{value:.{digits}f}" for value in values]


GOOD = table(seconds(MILLI))


@dataclass(frozen=True)
class Walk:
    """The hint followed: ``says`` is what it says, ``edits`` change the map, ``files`` replace."""

    says: str
    edits: Edits = ()
    files: Files | None = None
    outcome: str = "right"  #: or words of the refusal
    out: str = "runs"
    overwrite: bool = False
    trials: int = 1
    env: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Case:
    """A map or file that is wrong, its hint, and the ways that this names."""

    hint: str
    walks: Sequence[Walk]
    edits: Edits = ()
    files: Files = field(default_factory=lambda: {"a.csv": GOOD})
    times: Sequence[float] = MILLI  #: since the first sample
    force: Sequence[float] = FORCE
    first: datetime | None = START
    atol_s: float = 1e-9
    env: Mapping[str, str] = field(default_factory=dict)


def edited(text: str, edits: Edits) -> str:
    for old, new in edits:
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in {text}"
        text = text.replace(old, new)
    return text


def put(what: str, block: str = "time") -> tuple[str, str]:
    """Return the edit that adds keys to a block in braces."""
    return (f"{block}: {{", f"{block}: {{{what}, " if block != "text" else f"{block}: {{{what}")


TIME = "time: {column: t, unit: s}"
COARSE = table([f"{i // 4 * 0.004:.3f}" for i in range(COUNT)])
MICROS = [2**32 - 2_000_000 + i * 100_000 for i in range(COUNT)]
TENTHS = [i * 0.1 for i in range(COUNT)]
BERLIN = ZoneInfo("Europe/Berlin")
AUTUMN = [datetime(2024, 10, 27, 0, tzinfo=UTC) + i * timedelta(minutes=3) for i in range(COUNT)]
THREE_MINUTES = [i * 180.0 for i in range(COUNT)]
DATED = 'time: {column: t, format: "%Y-%m-%d %H:%M:%S"}'
SHORT_HOUR = [f"2024-10-27 02:{i:02d}:00" for i in range(10, 10 + COUNT)]
UNIX = 1_457_085_600


def local_table(moments: Sequence[datetime]) -> str:
    return table([f"{item.astimezone(BERLIN):%Y-%m-%d %H:%M:%S}" for item in moments])


TIMES = {
    "equal times": Case(
        "if its clock is coarser than the rate of the logger, add `coarse: spread` below `time:`; "
        "if a row is there twice, delete it",
        [Walk("coarse: spread", [put("coarse: spread")])],
        files={"a.csv": COARSE},
    ),
    "row twice": Case(
        "if its clock is coarser than the rate of the logger, add `coarse: spread` below `time:`; "
        "if a row is there twice, delete it",
        [Walk("delete it", files={"a.csv": GOOD})],
        files={"a.csv": GOOD.replace("0.005,2.5,5\n", "0.005,2.5,5\n" * 2)},
    ),
    "all times equal": Case(
        "give `rate:` in place of `column:` below `time:`: how many samples there are in a second, "
        "such as `rate: 1 kHz`",
        [Walk("rate: 1 kHz", [("column: t, unit: s, coarse: spread", "rate: 1 kHz")])],
        [("unit: s}", "unit: s, coarse: spread}")],
        {"a.csv": table(["5"] * COUNT)},
    ),
    "new test": Case(
        "if a new test begins there, add `restarts: true` below `time:`, and show below `trials:` "
        "where trials end, such as by `gaps: 1 s`",
        [
            Walk("restarts: true", [put("restarts: true")], outcome="begins again within a trial"),
            Walk("gaps: 1 s", [put("restarts: true"),
                               ("started:", "trials: {gaps: 1 s}\nstarted:")], trials=2),
        ],
        files={"a.csv": table(seconds([i % 20 * 1e-3 for i in range(COUNT)]))},
        times=[i * 1e-3 + (i >= 20) * 0.999 for i in range(COUNT)],
    ),
    "row out of order": Case(
        "if a new test begins there, add `restarts: true` below `time:`, and show below `trials:` "
        "where trials end, such as by `gaps: 1 s`",
        [Walk("gaps: 1 s", [put("restarts: true"), ("started:", "trials: {gaps: 1 s}\nstarted:")],
              outcome="later goes on from where it was")],
        files={"a.csv": GOOD.replace("0.030,15.0,30\n", "0.030,15.0,30\n0.001,0.5,1\n")},
    ),
    "row out of order with restarts": Case(
        "this is no new test: delete the rows that are out of order",
        [Walk("delete the rows", files={"a.csv": GOOD})],
        [put("restarts: true"), ("started:", "trials: {gaps: 1 s}\nstarted:")],
        {"a.csv": GOOD.replace("0.030,15.0,30\n", "0.030,15.0,30\n0.001,0.5,1\n")},
    ),
    "counter": Case(
        "if a counter of 32 bits begins again at 0 there, add `wraps: 32 bit` below `time:`",
        [Walk("wraps: 32 bit", [put("wraps: 32 bit")])],
        [("unit: s}", "unit: us}")],
        {"a.csv": table([count % 2**32 for count in MICROS])},
        TENTHS, first=None,
    ),
    "range of a counter": Case(
        "correct `wraps:` below `time:`, or remove it",
        [
            Walk("correct", [("16 bit", "32 bit")]),
            Walk("remove", [(", wraps: 16 bit", "")], outcome="runs backward"),
        ],
        [("unit: s}", "unit: us, wraps: 16 bit}")],
        {"a.csv": table([count % 2**32 for count in MICROS])},
        TENTHS, first=None,
    ),
    "seconds of a day": Case(
        "if these are times of a day, add `wraps: 24 h` below `time:`",
        [Walk("wraps: 24 h", [put("wraps: 24 h")])],
        files={"a.csv": table(seconds([(86_398 + i * 0.1) % 86_400 for i in range(COUNT)]))},
        times=TENTHS, first=None,
    ),
    "summer time ends": Case(
        "if these are local times and summer time ends there, name their zone below `time:`, such "
        "as `zone: Europe/Berlin`",
        [Walk("zone: Europe/Berlin", [put("zone: Europe/Berlin")])],
        [(TIME, DATED)],
        {"a.csv": local_table(AUTUMN)},
        THREE_MINUTES, first=AUTUMN[0],
    ),
    "hour that does not exist": Case(
        "if the clock of the logger stays at one time all the year, give its offset, such as "
        "`zone: '+01:00'`",
        [Walk("zone: '+01:00'", [("Europe/Berlin", "'+01:00'")])],
        [(TIME, DATED.replace("}", ", zone: Europe/Berlin}"))],
        {"a.csv": table([f"2025-03-30 02:{i:02d}:00" for i in range(COUNT)])},
        [i * 60.0 for i in range(COUNT)], first=datetime(2025, 3, 30, 1, tzinfo=UTC),
    ),
    "hour that occurs twice, first": Case(
        "`zone: '+02:00'` below `time:` if the clock had not been put back yet, `zone: '+01:00'` "
        "if it had",
        [Walk("zone: '+02:00'", [("Europe/Berlin", "'+02:00'")])],
        [(TIME, DATED.replace("}", ", zone: Europe/Berlin}"))],
        {"a.csv": table(SHORT_HOUR)},
        [i * 60.0 for i in range(COUNT)], first=datetime(2024, 10, 27, 0, 10, tzinfo=UTC),
    ),
    "hour that occurs twice, second": Case(
        "`zone: '+02:00'` below `time:` if the clock had not been put back yet, `zone: '+01:00'` "
        "if it had",
        [Walk("zone: '+01:00'", [("Europe/Berlin", "'+01:00'")])],
        [(TIME, DATED.replace("}", ", zone: Europe/Berlin}"))],
        {"a.csv": table(SHORT_HOUR)},
        [i * 60.0 for i in range(COUNT)], first=datetime(2024, 10, 27, 1, 10, tzinfo=UTC),
    ),
    "gap out of the hour": Case(
        "delete the rows of this hour",
        [Walk("delete",
              files={"a.csv": table([f"2024-10-27 05:{i:02d}:00" for i in range(COUNT)])})],
        [(TIME, DATED.replace("}", ", zone: Europe/Berlin}"))],
        {"a.csv": table([*SHORT_HOUR[:5], "2024-10-27 05:00:00", "2024-10-27 05:01:00"])},
        [i * 60.0 for i in range(COUNT)], first=datetime(2024, 10, 27, 4, tzinfo=UTC),
    ),
    "zone twice": Case(
        "remove `zone:` below `time:`",
        [Walk("remove `zone:`", [(", zone: UTC", "")])],
        [(TIME, "time: {column: t, format: iso, zone: UTC}")],
        {"a.csv": table([f"2016-03-04T12:00:{i:02d}+02:00" for i in range(COUNT)])},
        [float(i) for i in range(COUNT)],
    ),
    "time of a day in iso": Case(
        'times of day are `format: "%H:%M:%S.%f"`, with the day in `since:`',
        [Walk('format: "%H:%M:%S.%f"',
              [("format: iso", 'format: "%H:%M:%S.%f", since: 2016-03-04')])],
        [(TIME, "time: {column: t, format: iso}")],
        {"a.csv": table([f"10:00:{i * 0.1:09.6f}" for i in range(COUNT)])},
        TENTHS,
    ),
    "day of times of a day": Case(
        "add `since: 2025-03-03` below `time:`, with that day",
        [Walk("since: 2025-03-03", [put("since: 2025-03-03")])],
        [(TIME, 'time: {column: t, format: "%H:%M:%S.%f"}')],
        {"a.csv": table([f"10:00:{i * 0.1:09.6f}" for i in range(COUNT)])},
        TENTHS, first=datetime(2025, 3, 3, 10, tzinfo=UTC),
    ),
    "since is no day": Case(
        "write `since: 2016-03-04`",
        [Walk("since: 2016-03-04", [('"2016-03-04T10:00:00"', "2016-03-04")])],
        [(TIME, 'time: {column: t, format: "%H:%M:%S.%f", since: "2016-03-04T10:00:00"}')],
        {"a.csv": table([f"10:00:{i * 0.1:09.6f}" for i in range(COUNT)])},
        TENTHS,
    ),
    "morning or evening": Case(
        "write `%H` for hours up to 23, or `%I` and `%p` for AM, PM",
        [Walk("%H", [("%I", "%H")])],
        [(TIME, 'time: {column: t, format: "%I:%M:%S.%f", since: 2016-03-04}')],
        {"a.csv": table([f"10:00:{i * 0.1:09.6f}" for i in range(COUNT)])},
        TENTHS,
    ),
    "date with since": Case(
        "remove `since:`",
        [Walk("remove `since:`", [(", since: 1970-01-01", "")])],
        [(TIME, "time: {column: t, format: iso, since: 1970-01-01}")],
        {"a.csv": table([f"2016-03-04T10:00:{i:02d}" for i in range(COUNT)])},
        [float(i) for i in range(COUNT)],
    ),
    "wraps and restarts": Case(
        "remove `wraps:` or `restarts:`",
        [
            Walk("restarts:", [(", restarts: true", "")]),
            Walk("wraps:", [(", wraps: 32 bit", "")], outcome="begins again within a trial"),
        ],
        [("unit: s}", "unit: us, wraps: 32 bit, restarts: true}")],
        {"a.csv": table([count % 2**32 for count in MICROS])},
        TENTHS, first=None,
    ),
    "zone without a date": Case(
        "add `since:` or `format:`, or remove `zone:`",
        [Walk("remove `zone:`", [(", zone: UTC", "")])],
        [("unit: s}", "unit: s, zone: UTC}")],
    ),
    "zone in since": Case(
        "remove `zone:`, or the zone in `since:`",
        [Walk("remove `zone:`", [(", zone: UTC", "")])],
        [("unit: s}", 'unit: s, since: "2016-03-04T12:00:00+02:00", zone: UTC}')],
    ),
    "unknown zone": Case(
        "such as `zone: Europe/Berlin` or `zone: '+01:00'`; `pip install tzdata` brings the "
        "database",
        [Walk("zone: Europe/Berlin", [("Europa", "Europe")])],
        [(TIME, DATED.replace("}", ", zone: Europa/Berlin}"))],
        {"a.csv": local_table(AUTUMN)},
        THREE_MINUTES, first=AUTUMN[0],
    ),
    "beyond 2260": Case(
        "correct `unit:` below `time:`; days of MATLAB are `unit: d, since: 0000-01-00`",
        [Walk("unit: d, since: 0000-01-00", [("unit: d", "unit: d, since: 0000-01-00")]),
        ],
        [("unit: s}", "unit: d}")],
        {"a.csv": table([f"{719_529 + 16_864 + i / 1000:.3f}" for i in range(COUNT)])},
        [i * 86.4 for i in range(COUNT)], first=datetime(2016, 3, 4, tzinfo=UTC), atol_s=2e-5,
    ),
    "unit of Unix times": Case(
        "correct `unit:` below `time:`; days of MATLAB are `unit: d, since: 0000-01-00`",
        [
            Walk("correct `unit:`", [("unit: s,", "unit: ms,")]),
            Walk("since: 0000-01-00", [("unit: s, since: 1970-01-01",
                                        "unit: d, since: 0000-01-00")], outcome="after the year"),
        ],
        [("unit: s}", "unit: s, since: 1970-01-01}")],
        {"a.csv": table([1000 * UNIX + i for i in range(COUNT)])},
    ),
    "before 1970": Case(
        "give `since:` below `time:`: the moment that a time of 0 means",
        [Walk("since:", [("1904-01-01", "1970-01-01")])],
        [("unit: s}", "unit: s, since: 1904-01-01}")],
        {"a.csv": table(seconds([UNIX + t for t in MILLI]))}, atol_s=3e-7,
    ),
    "date before 1970": Case(
        "if the clock was wrong, `shift:` below `time:` corrects it, such as `shift: 1 d`",
        [Walk("shift: 1 d", [put("shift: 1 d")], outcome="before 1970"),
         Walk("shift:", [put("shift: 24170 d")])],
        [(TIME, "time: {column: t, format: iso}")],
        {"a.csv": table([f"1950-01-01T10:00:{i:02d}" for i in range(COUNT)])},
        [float(i) for i in range(COUNT)], first=datetime(2016, 3, 5, 10, tzinfo=UTC),
    ),
    "in the future": Case(
        "state below `time:` which moment a time of 0 means: `since: 1970-01-01` for Unix times",
        [Walk("since: 1970-01-01", [put("since: 1970-01-01")])],
        files={"a.csv": table(seconds([UNIX + t for t in MILLI]))}, atol_s=3e-7,
    ),
    "jump": Case(
        "if a trial ends there, add `gaps: 0.01 s` below `trials:`; if samples are missing, state "
        "how long a gap may be: `longest_gap: 0.55 s` below `time:`",
        [
            Walk("gaps: 0.01 s", [("started:", "trials: {gaps: 0.01 s}\nstarted:")], trials=2),
            Walk("longest_gap: 0.55 s", [put("longest_gap: 0.55 s")]),
        ],
        files={"a.csv": table(seconds([i * 1e-3 + (i >= 20) * 0.5 for i in range(COUNT)]))},
        times=[i * 1e-3 + (i >= 20) * 0.5 for i in range(COUNT)],
    ),
    "jump between columns": Case(
        "if a trial ends there, add a column that changes there to `columns:` below `trials:`; if "
        "samples are missing, state how long a gap may be: `longest_gap: 0.55 s` below `time:`",
        [Walk("longest_gap: 0.55 s", [put("longest_gap: 0.55 s")])],
        [("started:", "trials: {columns: v2}\nstarted:")],
        {"a.csv": "t,F,v,v2\n" + "".join(
            f"{i * 1e-3 + (i >= 20) * 0.5:.3f},{i * 0.5},{i},1\n" for i in range(COUNT))},
        [i * 1e-3 + (i >= 20) * 0.5 for i in range(COUNT)],
    ),
    "restart within a trial": Case(
        "if a trial ends there, add `gaps: 1 s` below `trials:`",
        [Walk("gaps: 1 s", [("started:", "trials: {gaps: 1 s}\nstarted:")], trials=2)],
        [put("restarts: true")],
        {"a.csv": table(seconds([i % 20 * 1e-3 for i in range(COUNT)]))},
        [i * 1e-3 + (i >= 20) * 0.999 for i in range(COUNT)],
    ),
    "restart between columns": Case(
        "if a trial ends there, add a column that changes there to `columns:` below `trials:`",
        [Walk("`columns:`", [("columns: b", "columns: [b, load]")], trials=2)],
        [put("restarts: true"), ("started:", "trials: {columns: b}\nstarted:")],
        {"a.csv": "t,F,v,b,load\n" + "".join(
            f"{i % 20 * 1e-3:.3f},{i * 0.5},{i},1,{5 if i < 20 else 10}\n" for i in range(COUNT))},
        [i * 1e-3 + (i >= 20) * 0.999 for i in range(COUNT)],
    ),
    "no time in common": Case(
        "`since:` or `shift:` below `time:` puts the times of one to those of another",
        [Walk("shift:", [("unit: s, shift: 9 s", "unit: s, shift: 0 s")])],
        [("    text: {}\n", "    file: '{test}_a.csv'\n"), ("unit: s}", "unit: s, shift: 9 s}"),
         ("speed: {column: v, unit: mm/s}\n", "speed: {column: v, unit: mm/s}\n  o:\n    file: "
          "'{test}_b.csv'\n    time: {rate: 1 kHz}\n    channels: {x: {column: v, unit: m}}\n")],
        {"1_a.csv": GOOD, "1_b.csv": GOOD},
    ),
    "time or rate": Case(
        "column: Time, or rate: 1 kHz",
        [Walk("rate: 1 kHz", [("shift: 0 s", "rate: 1 kHz")])],
        [(TIME, "time: {shift: 0 s}")],
    ),
    "no time unit": Case(
        "such as s, ms or ns", [Walk("s", [("unit: kg", "unit: s")])], [("unit: s}", "unit: kg}")],
    ),
    "no rate": Case(
        "such as 1 kHz", [Walk("1 kHz", [("1e12 Hz", "1 kHz")])], [(TIME, "time: {rate: 1e12 Hz}")],
    ),
    "no duration": Case(
        "such as '1 s'",
        [Walk("1 s", [("1 m", "1 s")])],
        [("unit: s}", "unit: s, longest_gap: 1 m}")],
    ),
    "no moment": Case(
        "write 2016-03-04T10:00:00Z",
        [Walk("2016-03-04T10:00:00Z", [("4 March 2016", "2016-03-04T10:00:00Z")])],
        [("2016-03-04T10:00:00Z", "4 March 2016")],
    ),
}  # fmt: skip

MISSING = GOOD.replace(",5.0,10\n", ",NaN,10\n")
HOLE: Sequence[float] = [*FORCE[:10], float("nan"), *FORCE[11:]]
TWO_RATES = "t,F,v\n" + "".join(
    f"{i / 1000:.3f},{i * 0.5},{'' if i % 4 else i}\n" for i in range(COUNT)
)
SPLIT = [
    ("    text: {}\n    time", "    file: '{test}.csv'\n    sparse: true\n    time"),
    ("      speed: {column: v, unit: mm/s}\n", "  o:\n    file: '{test}.csv'\n    sparse: true\n"
     "    time: {column: t, unit: s}\n    channels:\n      speed: {column: v, unit: mm/s}\n"),
]  # fmt: skip
COLUMNS = "t,F,v,load\n" + "".join(
    f"{i / 1000:.3f},{i * 0.5},{i},{5 if i < 20 else 10}\n" for i in range(COUNT)
)
BY_LOAD = "trials: {columns: load, table: {file: trials.csv, key: load}}\nignore: trials.csv\n"
LOAD = "parameters: {load: {column: load, unit: kg}}\n"

TEXTS = {
    "blank of a proposal": Case(
        "the comment behind it says what is not known; write the value in its place",
        [Walk("write the value", [('unit: "?"', "unit: N")])],
        [("unit: N", 'unit: "?"')],
    ),
    "empty cell": Case(
        "if empty cells mean that there is no value, add `missing: ['']` below `text:`; if columns "
        "have different rates, make a source of each with `sparse: true`",
        [Walk("missing: ['']", [put("missing: ['']", "text")]), Walk("sparse: true", SPLIT)],
        files={"a.csv": TWO_RATES},
    ),
    "no number": Case(
        "if it means that there is no value, add `missing: ['NaN']` below `text:`",
        [Walk("missing: ['NaN']", [put("missing: ['NaN']", "text")])],
        files={"a.csv": MISSING}, force=HOLE,
    ),
    "lookalike": Case(
        "correct that character in the file",
        [Walk("correct", files={"a.csv": GOOD.replace(",0.5,", ",-0.5,")})],
        files={"a.csv": GOOD.replace(",0.5,", ",\u22120.5,")}, force=[0.0, -0.5, *FORCE[2:]],
    ),
    "other decimal sign": Case(
        "correct the file if it mixes both signs, or the map: `decimal: ','`",
        [Walk("decimal: ','", [put("decimal: ','", "text")])],
        files={"a.csv": GOOD.replace(",", ";").replace(".", ",")},
    ),
    "other encoding": Case(
        "name the file's encoding below `text:`, such as `encoding: latin-1` or `utf-16`",
        [Walk("utf-16", [put("encoding: utf-16", "text")]),
         Walk("encoding: latin-1", [put("encoding: latin-1", "text")], outcome="no column")],
        files={"a.csv": GOOD.encode("utf-16")},
    ),
    "wrong encoding": Case(
        "name its encoding below `text:`, such as `encoding: latin-1` or `utf-16`",
        [Walk("encoding: latin-1", [("utf-16", "latin-1")])],
        [put("encoding: utf-16", "text")],
    ),
    "unknown encoding": Case(
        "such as utf-8, latin-1 or utf-16",
        [Walk("utf-8", [("utf-88", "utf-8")])],
        [put("encoding: utf-88", "text")],
    ),
    "last line without end": Case(
        "delete this line, or add `open_end: true` below `text:` if the program that wrote the "
        "file never ends the last line",
        [Walk("open_end: true", [put("open_end: true", "text")])],
        files={"a.csv": GOOD[:-1]},
    ),
    "another table": Case(
        "if another table begins there, `last: 41` below `text:` ends this one; `header:` and "
        "`first:` of another source, or of another map, begin the next one",
        [Walk("last: 41", [put("last: 41", "text")]),
         Walk("`header:`", [put("header: 43", "text")])],
        files={"a.csv": f"{GOOD}\n{GOOD}"},
    ),
    "cells of a cut line": Case(
        "the file may be cut off there, or a text have the separator in it",
        [Walk("cut off", files={"a.csv": GOOD})],
        files={"a.csv": GOOD + "0.04,3\n"},
    ),
    "no format": Case(
        "give `format:` in the source of the map",
        [Walk("format:", [("    text: {}\n", "    text: {}\n    format: csv\n")])],
        files={"a.log": GOOD},
    ),
    "group of a text": Case(
        "remove `group:`",
        [Walk("remove `group:`", [("    group: g\n", "")])],
        [("    text: {}\n", "    text: {}\n    group: g\n")],
    ),
    "no such column": Case(
        "did you mean 'force'?",
        [Walk("force", [("forse", "force")])],
        [("column: F", "column: forse")],
        {"a.csv": GOOD.replace("F", "force")},
    ),
    "column twice": Case(
        "give the number of one: 2, 3",
        [Walk("2", [("column: F", "column: '2'")])],
        [("speed: {column: v, unit: mm/s}", "")],
        {"a.csv": GOOD.replace("t,F,v", "t,F,F")},
    ),
    "no unit": Case(
        "add `unit:` to it in the map; `unit: 1` if it has none",
        [Walk("unit:", [("column: F", "column: F, unit: N")])],
        [(", unit: N", "")],
    ),
    "unknown unit": Case(
        "add `unit:` to it in the map; `unit: 1` if it has none",
        [Walk("unit:", [("column: F", "column: F, unit: N")])],
        [(", unit: N", "")],
        {"a.csv": GOOD.replace("F", "F [Newton]")},
    ),
    "unit differs": Case(
        "leave `unit:` out of the map to take that of the file; if the file is wrong, correct it "
        "there",
        [Walk("leave `unit:` out", [("column: F, unit: kN", "column: F")])],
        [("unit: N", "unit: kN")],
        {"a.csv": GOOD.replace("F", "F [N]")},
    ),
    "zero without scale": Case(
        "add `scale: 1`",
        [Walk("scale: 1", [("zero: 1 N", "zero: 1 N, scale: 1")])],
        [("unit: N", "unit: N, zero: 1 N")],
        force=[value - 1.0 for value in FORCE],
    ),
    "parameter and channel": Case(
        "a parameter or a key of trials cannot be a channel too",
        [Walk("cannot be a channel", [("speed: {column: v, unit: mm/s}", "")])],
        [("started:", "parameters: {p: {column: v, unit: mm/s}}\nstarted:")],
        {"a.csv": "t,F,v\n" + "".join(f"{i / 1000},{i * 0.5},3\n" for i in range(COUNT))},
    ),
    "parameter changes": Case(
        "add its column to `columns:` below `trials:` if a new trial begins there",
        [Walk("`columns:`", [("started:", "trials: {columns: load}\nstarted:")], trials=2)],
        [("started:", f"{LOAD}started:")],
        {"a.csv": COLUMNS},
    ),
    "trials change too often": Case(
        "what shows the trials changes too often",
        [Walk("changes", [("columns: v2", "columns: load")], files={"a.csv": COLUMNS}, trials=2)],
        [("started:", "trials: {columns: v2}\nstarted:")],
        {"a.csv": "t,F,v,v2,load\n" + "".join(
            f"{i / 1e6:.6f},0,0,{i},1\n" for i in range(100_010))},
    ),
    "parameter is a word": Case(
        "without `unit:` it is a word",
        [Walk("without `unit:`", [(", unit: kg", "")])],
        [("started:", f"{LOAD}started:")],
        {"a.csv": "t,F,v,load\n" + "".join(
            f"{i / 1000:.3f},{i * 0.5},{i},heavy\n" for i in range(COUNT))},
    ),
    "trial without a row": Case(
        "known: 5",
        [Walk("5", files={"a.csv": COLUMNS, "trials.csv": "load\n5\n10\n"}, trials=2)],
        [("started:", f"{BY_LOAD}{LOAD}started:")],
        {"a.csv": COLUMNS, "trials.csv": "load\n5\n"},
    ),
    "second row of a trial": Case(
        "the first is FOLDER/trials.csv:2:1; correct its key, or remove one of the two",
        [Walk("remove", files={"a.csv": COLUMNS, "trials.csv": "load,p\n5,1\n10,2\n"}, trials=2)],
        [("started:", f"{BY_LOAD}{LOAD.replace('column: load', 'column: p')}started:")],
        {"a.csv": COLUMNS, "trials.csv": "load,p\n5,1\n5,3\n10,2\n"},
    ),
    "table of which name": Case(
        "the names of the sources have test",
        [Walk("test", [("{name}_trials", "{test}_trials")], trials=2)],
        [("    text: {}\n", "    file: '{test}.csv'\n"),
         ("started:", BY_LOAD.replace("file: trials", "file: '{name}_trials")
          .replace("csv, key", "csv', key").replace("ignore: trials", "ignore: a_trials")
          + LOAD + "started:")],
        {"a.csv": COLUMNS, "a_trials.csv": "load\n5\n10\n"},
    ),
    "unit of a signal": Case(
        "a `scale` such as '250 N/V' makes another quantity of a reading",
        [Walk("scale", [("unit: V}", "unit: V, scale: '1 N/V'}")])],
        [("unit: N", "unit: V"),
         ("started:", "identify: {model: static-friction, signals: {force: s.force, speed: "
          "s.speed}}\nstarted:")],
    ),
}  # fmt: skip


def tdms(path: Path, *, groups: Sequence[str] = ("g",), late_s: float = 0.0) -> None:
    with TdmsWriter(path) as writer:
        for group in groups:
            writer.write_segment([
                ChannelObject(group, name, np.array(values), properties={
                    "unit_string": unit, "wf_increment": 0.001,
                    "wf_start_offset": late_s if name == "v" else 0.0})
                for name, values, unit in (("F", FORCE, "N"), ("v", np.arange(40.0), "mm/s"))
            ])  # fmt: skip


def tdms_cut(path: Path) -> None:
    tdms(path)
    path.write_bytes(path.read_bytes()[:-9])


def tdms_warned(path: Path) -> None:
    about = {"unit_string": "N", "wf_increment": 0.001, "NI_Number_Of_Scales": 1,
             "NI_Scale[0]_Scale_Type": "Spiral", "NI_Scaling_Status": "unscaled"}  # fmt: skip
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("g", "F", np.array(FORCE), properties=about),
                              ChannelObject("g", "v", np.arange(40.0))])  # fmt: skip


def mdf(path: Path) -> None:
    with MDF() as file:
        for _ in range(2):
            file.append(
                [
                    Signal(np.array(FORCE), np.array(MILLI), unit="N", name="F"),
                    Signal(np.arange(40.0), np.array(MILLI), unit="mm/s", name="v"),
                ]
            )
        file.save(path)


def hdf5(path: Path, rows: int = COUNT) -> None:
    with h5py.File(path, "w") as file:
        for name, values in (("t", MILLI), ("F", FORCE), ("v", range(COUNT))):
            file[f"run/{name}"] = np.array(values)[: rows if name == "v" else COUNT]


def hdf5_chunked(path: Path) -> None:
    """Its chunks of 2 MiB have room for more rows than there are."""
    with h5py.File(path, "w") as file:
        for name, values in (("t", MILLI), ("F", FORCE), ("v", range(COUNT))):
            file.create_dataset(
                f"run/{name}", data=np.array(values, float), maxshape=(None,), chunks=(1 << 18,),
                compression="gzip",
            )  # fmt: skip


def hdf5_beside(path: Path, *, turned: bool = False) -> None:
    hdf5(path)
    with h5py.File(path, "a") as file:
        file.create_dataset("run/all", (60_000, 2) if turned else (2, 60_000), "f4")


def hdf5_deep(path: Path) -> None:
    hdf5(path)
    with h5py.File(path, "a") as file:
        group = file
        for _ in range(1_020):
            group = group.create_group("g")


def mat(path: Path) -> None:
    scipy.io.savemat(path, {"run": {"t": MILLI, "F": FORCE, "v": np.arange(40.0)}})


def object_of_matlab(path: Path) -> None:
    """As version 7.3 has it: numbers that say where the content lies."""
    with h5py.File(path, "w", userblock_size=512) as file:
        item = file.create_dataset("logs", data=np.zeros((1, 6), np.uint32))
        item.attrs["MATLAB_object_decode"] = np.int32(3)
    with path.open("r+b") as head:
        head.write(b"MATLAB 7.3 MAT-file")


def saved_anew(path: Path) -> None:
    scipy.io.savemat(path, {"t": MILLI, "x": FORCE})


WITHOUT_V: tuple[str, str] = ("      speed: {column: v, unit: mm/s}\n", "")
OF_TDMS = [(TIME, "time: {column: (time)}"), ("    text: {}\n", "    group: g\n")]
NO_GROUP = [(TIME, "time: {column: (time)}")]

FORMATS = {
    "arrays of different lengths": Case(
        "columns of different rates are sources of their own",
        [Walk("sources of their own", [WITHOUT_V])],
        [("    text: {}\n", "    group: run\n")],
        {"a.h5": lambda path: hdf5(path, 20)},
    ),
    "no such group": Case(
        "did you mean 'run'?",
        [Walk("run", [("group: rum", "group: run")])],
        [("    text: {}\n", "    group: rum\n")],
        {"a.h5": hdf5},
    ),
    "chunks too large": Case(
        "if you trust the file and there is memory for it, set RIGD_CHUNK_MIB=2 in the "
        "environment, the most MiB that rigd unpacks at once",
        [Walk("RIGD_CHUNK_MIB=2", env={"RIGD_CHUNK_MIB": "2"})],
        [("    text: {}\n", "    group: run\n")],
        {"a.h5": hdf5_chunked},
        env={"RIGD_CHUNK_MIB": "1"},
    ),
    "rows and columns exchanged": Case(
        "if its rows and columns are exchanged, save it transposed",
        [Walk("transposed", files={"a.h5": lambda path: hdf5_beside(path, turned=True)})],
        [("    text: {}\n", "    group: run\n")],
        {"a.h5": hdf5_beside},
    ),
    "groups too deep": Case(
        "name the group that has the channels by `group:` in the source",
        [Walk("group:", [("    text: {}\n", "    group: run\n")])],
        files={"a.h5": hdf5_deep},
    ),
    "no such structure": Case(
        "did you mean 'run'?",
        [Walk("run", [("group: rum", "group: run")])],
        [("    text: {}\n", "    group: rum\n")],
        {"a.mat": mat},
    ),
    "structures alone": Case(
        "give `group:`, one of run",
        [Walk("run", [("    text: {}\n", "    group: run\n")])],
        files={"a.mat": mat},
    ),
    "object of MATLAB": Case(
        "save its numbers in MATLAB: s.t = logs.Time; s.x = logs.Data; save('new.mat', "
        "'-struct', 's')",
        [Walk("s.t = logs.Time; s.x = logs.Data", [("column: F", "column: x"), WITHOUT_V],
              files={"a.mat": saved_anew})],
        files={"a.mat": object_of_matlab},
    ),
    "derived group of a source": Case(
        "choose another name before the dot, such as 's_derived'",
        [Walk("s_derived", [("s.way", "s_derived.way")])],
        [("started:", "derived: {s.way: {is: s.force * 2, unit: N}}\nstarted:")],
    ),
    "pickled objects": Case(
        "save arrays of numbers: np.savez('new.npz', t=t, force=force)",
        [Walk("np.savez('new.npz', t=t, force=force)", [("column: F", "column: force"), WITHOUT_V],
              files={"a.npz": lambda path: np.savez(path, t=MILLI, force=FORCE)})],
        files={"a.npz": lambda path: np.savez(path, rows=np.array([{"t": 0.0}], object))},
    ),
    "groups of TDMS": Case(
        "give `group:`, one of g, h",
        [Walk("g", [("    text: {}\n", "    group: g\n")])],
        NO_GROUP, {"a.tdms": lambda path: tdms(path, groups=("g", "h"))},
    ),
    "groups of MDF": Case(
        "give `group:`, the number or name of: 0, 1",
        [Walk("0", [("    text: {}\n", "    group: '0'\n")])],
        NO_GROUP, {"a.mf4": mdf},
    ),
    "no such group of TDMS": Case(
        "did you mean 'g1'?",
        [Walk("g1", [("group: g2", "group: g1")])],
        [(TIME, "time: {column: (time)}"), ("    text: {}\n", "    group: g2\n")],
        {"a.tdms": lambda path: tdms(path, groups=("g1",))},
    ),
    "cut TDMS": Case(
        "take the whole file from where it was written; what this one still has can be saved anew "
        "with LabVIEW or npTDMS",
        [Walk("whole file", files={"a.tdms": tdms})],
        OF_TDMS, {"a.tdms": tdms_cut},
    ),
    "waveforms of different times": Case(
        "channels with different times are sources of their own",
        [Walk("sources of their own", [WITHOUT_V])],
        OF_TDMS, {"a.tdms": lambda path: tdms(path, late_s=1.0)},
    ),
    "library warns": Case(
        "the file may be damaged, or hold what the library cannot read; if that does not matter "
        "for your channels, add `warnings: accept` to the map",
        [Walk("warnings: accept", [("started:", "warnings: accept\nstarted:")])],
        OF_TDMS, {"a.tdms": tdms_warned},
    ),
}  # fmt: skip

TWO = [
    ("    text: {}\n", "    file: '{test}_a.csv'\n"),
    (
        "speed: {column: v, unit: mm/s}\n",
        "speed: {column: v, unit: mm/s}\n  o:\n    file: "
        "'{test}_b.csv'\n    time: {rate: 1 kHz}\n    channels: {x: {column: v, unit: m}}\n",
    ),
]
SETS = {
    "two sources, one file": Case(
        "give `file:`, such as '{test}_force.csv', for each of several sources",
        [Walk("{test}_force.csv", [("    text: {}\n", "    file: '{test}_force.csv'\n")],
              files={"1_force.csv": GOOD, "1_b.csv": GOOD})],
        [("    text: {}\n", "    text: {}\n"), TWO[1]],
    ),
    "file of no source": Case(
        "leave it out, or name it under `ignore:` in the map",
        [Walk("leave it out", files={"1_a.csv": GOOD, "1_b.csv": GOOD}),
         Walk("`ignore:`", [("started:", "ignore: notes.csv\nstarted:")])],
        TWO, {"1_a.csv": GOOD, "1_b.csv": GOOD, "notes.csv": GOOD},
    ),
    "file lacks": Case(
        "add it to the files of the command",
        [Walk("add it", files={"1_a.csv": GOOD, "1_b.csv": GOOD})],
        TWO, {"1_a.csv": GOOD},
    ),
    "two files of a source": Case(
        "give each a source of its own with `file:`, such as '{test}_force.csv', or a {name} that "
        "tells tests apart",
        [Walk("a {name}", [("'{test}_*.csv'", "'{test}_{name}.csv'")],
              outcome="2 recordings"),
         Walk("{test}_force.csv", [("'{test}_*.csv'", "'{test}_force.csv'")],
              outcome="belongs to no source")],
        [("    text: {}\n", "    file: '{test}_*.csv'\n")],
        {"1_a.csv": GOOD, "1_b.csv": GOOD},
    ),
    "two tests of one name": Case(
        "import them one after the other, each with another --out",
        [Walk("each with another --out", files={"x/a.csv": GOOD})],
        files={"x/a.csv": GOOD, "y/a.csv": GOOD},
    ),
    "recording is there": Case(
        "choose another --out, or give --overwrite",
        [Walk("another --out", out="other"), Walk("--overwrite", overwrite=True)],
        files={"a.csv": GOOD, "runs/a.mcap": b"old"},
    ),
    "no such name": Case(
        "did you mean 'test'?",
        [Walk("test", [("name: tset", "name: test")])],
        [("    text: {}\n", "    file: '{test}.csv'\n"),
         ("started:", "parameters: {p: {name: tset}}\nstarted:")],
    ),
    "no such source": Case(
        "did you mean 's'?",
        [Walk("s", [("source: ss", "source: s")])],
        [("started:", "trials: {source: ss}\nstarted:")],
    ),
    "no such channel": Case(
        "did you mean 's.force'?",
        [Walk("s.force", [("channel: s.forse", "channel: s.force")])],
        [("started:", "trials: {signal: {channel: s.forse, above: -1 N}}\nstarted:")],
    ),
}  # fmt: skip
CASES = {**TIMES, **TEXTS, **FORMATS, **SETS}
#: Hints that are passed on, and one that needs a file which changes while it is read: see
#: `test_file_that_changes_is_imported_again`.
ELSEWHERE = {"import it again"}


def bring(
    folder: Path, map: str, files: Files, out: str = "runs", *, overwrite: bool = False
) -> list[Path]:
    given = []
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, str):
            path.write_text(content)
        elif isinstance(content, bytes):
            path.write_bytes(content)
        else:
            content(path)
        if path.suffix != ".mcap" and path.name not in ("trials.csv", "a_trials.csv"):
            given.append(path)
    what = parse_map(map, Path("map.yaml"))
    return [m.path for m in import_files(what, given, folder / out, overwrite=overwrite)]


def check_truth(paths: Sequence[Path], case: Case, trials: int) -> None:
    (path,) = paths
    recording = Recording.open(path)
    rows = recording.read("s")
    first = rows["t_ns"][0]
    np.testing.assert_allclose((rows["t_ns"] - first) * 1e-9, case.times, atol=case.atol_s)
    if case.first is not None:
        since = (case.first - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds()
        assert abs(int(first) - round(since) * 10**9) <= case.atol_s * 1e9
    np.testing.assert_array_equal(rows["force"], case.force)
    assert len(recording.trials) == trials


@pytest.mark.parametrize("name", CASES)
def test_hint_leads_to_truth_or_refusal(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = CASES[name]
    for variable, value in case.env.items():
        monkeypatch.setenv(variable, value)
    wrong = edited(MAP, case.edits)
    with pytest.raises((ConfigError, RecordingError)) as raised:
        bring(tmp_path / "wrong", wrong, case.files)
    given = str(raised.value.hint).replace(str(tmp_path / "wrong"), "FOLDER")
    assert given == case.hint
    for number, walk in enumerate(case.walks):
        assert walk.says in case.hint
        for variable, value in [*case.env.items(), *walk.env.items()]:
            monkeypatch.setenv(variable, value)
        folder, map = tmp_path / str(number), edited(wrong, walk.edits)
        files = case.files if walk.files is None else walk.files
        try:
            made = bring(folder, map, files, walk.out, overwrite=walk.overwrite)
        except RigdError as error:
            assert walk.outcome in str(error), walk
            continue
        if walk.outcome.endswith("recordings"):
            assert len(made) == int(walk.outcome.split()[0])
            continue
        assert walk.outcome == "right"
        check_truth(made, case, walk.trials)


def test_file_that_changes_is_imported_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stamps = iter([(1, 1), (2, 2)])
    with monkeypatch.context() as changing:
        changing.setattr("rigd.importing.importer._stamp", lambda _: next(stamps))
        with pytest.raises(ConfigError, match="was changed while it was read") as raised:
            bring(tmp_path, MAP, {"a.csv": GOOD})
    assert raised.value.hint == "import it again"
    check_truth(bring(tmp_path, MAP, {"a.csv": GOOD}), CASES["no unit"], 1)


def pattern(node: ast.expr) -> str | None:
    """Return what a text in the code may become, as an expression; None if it is no text."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return re.escape(node.value)
    if isinstance(node, ast.JoinedStr):
        parts = [pattern(item) for item in node.values]
        return "".join(".*" if part is None else part for part in parts)
    return None


def texts(node: ast.expr) -> Iterator[tuple[int, str]]:
    """Yield line and expression of each text that ``node`` may be."""
    found = pattern(node)
    if found is not None:
        yield node.lineno, found
    elif isinstance(node, ast.IfExp):
        yield from (*texts(node.body), *texts(node.orelse))
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        assert node.func.id == "suggest", f"line {node.lineno}: what is this hint?"
        yield node.lineno, "(did you mean|known: ).*"


def hints_of(path: Path) -> Iterator[tuple[int, str]]:
    tree = ast.parse(path.read_text())
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef) and function.name.endswith("remedy"):
            for node in ast.walk(function):
                if isinstance(node, ast.Return) and node.value is not None:
                    yield from texts(node.value)
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            for keyword in node.keywords:
                if keyword.arg == "hint":
                    yield from texts(keyword.value)
            if isinstance(node.func, ast.Attribute) and node.func.attr in ("_note", "_note_key"):
                yield from (found for item in node.args[2:] for found in texts(item))
        elif isinstance(node, ast.Return) and isinstance(node.value, ast.Tuple):
            if path.name == "csv_table.py" and len(node.value.elts) == 2:
                yield from texts(node.value.elts[1])
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "hint":
            yield from texts(node.value)


def test_every_hint_has_a_case() -> None:
    found = [
        (f"{path.name}:{line}", text)
        for path in sorted(Path(rigd.importing.__file__).parent.rglob("*.py"))
        for line, text in hints_of(path)
    ]
    known = {case.hint for case in CASES.values()} | ELSEWHERE
    without = [
        (place, text)
        for place, text in found
        if not any(re.fullmatch(text, hint) for hint in known)
    ]
    assert without == []
    assert len(found) > 70  # the search still finds them

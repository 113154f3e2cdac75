"""Clocks of loggers: coarse ones, counters that wrap, midnight, days of Excel, local times."""

from __future__ import annotations

import sys
import zoneinfo
from datetime import UTC, datetime, timedelta
from importlib.util import find_spec
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from numpy.typing import NDArray
from support.recordings.imported import MAP, Import

from rigd.model import ConfigError
from rigd.record import Recording

START_NS = 1_457_085_600_000_000_000
MS = 1_000_000


def table(times: list[str]) -> str:
    return "t,F,v\n" + "".join(f"{t},{i * 0.5},{i}\n" for i, t in enumerate(times))


def timed(time: str) -> str:
    return MAP.replace("{column: t, unit: s}", time)


def since_start(recording: Recording) -> NDArray[np.float64]:
    times: NDArray[np.int64] = recording.read("samples")["t_ns"]
    since: NDArray[np.float64] = (times - times[0]) * 1e-9
    return since


def unix_ns(moment: datetime) -> int:
    since = moment - datetime(1970, 1, 1, tzinfo=UTC)
    return ((since.days * 86_400 + since.seconds) * 1_000_000 + since.microseconds) * 1000


COARSE = [f"{i // 4 * 0.004:.3f}" for i in range(200)]


def test_equal_stamps_are_refused_naming_coarse(bring_in: Import) -> None:
    with pytest.raises(ConfigError, match="same as in the row before") as raised:
        bring_in(table(COARSE))
    assert "`coarse: spread` below `time:`" in str(raised.value.hint)
    assert "restarts" not in str(raised.value.hint)


def test_restarts_does_not_move_equal_stamps(bring_in: Import) -> None:
    with pytest.raises(ConfigError, match="same as in the row before"):
        bring_in(table(COARSE), map=timed("{column: t, unit: s, restarts: true}"))


@pytest.mark.parametrize("block_bytes", [64, 1 << 20])
@pytest.mark.parametrize("first", [0, 1, 3])
def test_rows_of_a_stamp_are_spread_evenly(
    bring_in: Import, monkeypatch: pytest.MonkeyPatch, block_bytes: int, first: int
) -> None:
    """The first stamp of a file may lack rows: those that are there lie just before the next."""
    monkeypatch.setattr("rigd.importing.tables.csv_table.BLOCK_BYTES", block_bytes)
    recording = bring_in(table(COARSE[first:-2]), map=timed("{column: t, unit: s, coarse: spread}"))
    times = recording.read("samples")["t_ns"]
    assert times.tolist() == [START_NS + i * MS for i in range(first, 198)]
    stated = f"samples: {198 - first} rows at 50 different times, spread evenly between them"
    assert recording.metadata["import"]["times"] == stated
    assert recording.info.metadata["import"]["times"] == stated


def test_gap_between_coarse_stamps_stays_a_gap(bring_in: Import) -> None:
    stamps = [f"{i // 4 * 0.004 + (i >= 100) * 0.5:.3f}" for i in range(200)]
    map = timed("{column: t, unit: s, coarse: spread}")
    recording = bring_in(table(stamps), map=map, more="trials: {gaps: 0.1 s}\n")
    expected = np.arange(200) * 1e-3 + (np.arange(200) >= 100) * 0.5
    np.testing.assert_allclose(since_start(recording), expected, atol=1e-9)
    assert len(recording.trials) == 2
    with pytest.raises(ConfigError, match=r"jumps by 0\.501 s within a trial; usual are 0\.001 s"):
        bring_in(table(stamps), map=map, name="one_trial.csv")


def test_stamps_that_never_change_are_refused(bring_in: Import) -> None:
    with pytest.raises(ConfigError, match="all rows have the same time"):
        bring_in(table(["5"] * 9), map=timed("{column: t, unit: s, coarse: spread}"))


@pytest.mark.parametrize("period_s", [0.1, 2.0])
def test_moved_time_is_a_jump_within_trial(bring_in: Import, period_s: float) -> None:
    """At 10 Hz or less a pause of 1 s was no jump."""
    text = table([f"{i % 20 * period_s:.3f}" for i in range(40)])
    map = timed("{column: t, unit: s, restarts: true}")
    with pytest.raises(ConfigError, match="the time begins again within a trial"):
        bring_in(text, map=map)
    pause = max(1.0, 10 * period_s)
    more = f"trials: {{gaps: {pause} s}}\n"
    recording = bring_in(text, map=map, more=more)
    trials = [(t.end_ns - t.start_ns - 1) * 1e-9 for t in recording.trials]
    assert trials == pytest.approx([19 * period_s] * 2)
    assert "began again 1 times" in recording.metadata["import"]["times"]


WRAPS = {
    # range in counts, unit, period in counts, first count, `wraps:`
    "32 bit of us": (2**32, "us", 100_000, 2**32 - 10_000_000, ["32 bit", "2^32 us"]),
    "16 bit of ms, several": (2**16, "ms", 1000, 5, ["16 bit", "65.536 s"]),
    "signed": (2**32, "us", 100_000, 2**31 - 1_000_000, ["32 bit"]),
    "seconds of a day": (86_400, "s", 60, 80_000, ["24 h"]),
}


@pytest.mark.parametrize("case", WRAPS)
@pytest.mark.parametrize("block_bytes", [200, 1 << 20])
def test_time_goes_on_where_counter_wraps(
    bring_in: Import, monkeypatch: pytest.MonkeyPatch, case: str, block_bytes: int
) -> None:
    monkeypatch.setattr("rigd.importing.tables.csv_table.BLOCK_BYTES", block_bytes)
    span, unit, period, first, spellings = WRAPS[case]
    truth = first + period * np.arange(300)
    counts = truth % span
    if case == "signed":
        counts = (counts + span // 2) % span - span // 2
    text = table([str(count) for count in counts])
    with pytest.raises(ConfigError, match="runs backward") as raised:
        bring_in(text, map=timed(f"{{column: t, unit: {unit}}}"))
    assert f"`wraps: {spellings[0]}`" in str(raised.value.hint)
    seconds = {"us": 1e-6, "ms": 1e-3, "s": 1.0}[unit]
    for number, wraps in enumerate(spellings):
        recording = bring_in(
            text, map=timed(f"{{column: t, unit: {unit}, wraps: {wraps}}}"), name=f"{number}.csv"
        )
        np.testing.assert_allclose(
            since_start(recording), (truth - first) * seconds, rtol=0, atol=1e-9
        )


def test_counter_that_wraps_in_gap_goes_on(bring_in: Import) -> None:
    truth = np.concatenate([np.arange(50), np.arange(50) + 45_000 // 10]) * 10 + 30_000
    recording = bring_in(
        table([str(count) for count in truth % 2**16]),
        map=timed("{column: t, unit: ms, wraps: 16 bit}"), more="trials: {gaps: 1 s}\n",
    )  # fmt: skip
    np.testing.assert_allclose(since_start(recording), (truth - truth[0]) * 1e-3, atol=1e-9)
    assert len(recording.trials) == 2


@pytest.mark.parametrize(
    ("wraps", "words"),
    [("16 bit", "farther than"), ("24 bit", "farther than"), ("40 bit", "jumps by")],
)
def test_wrong_range_of_a_counter_is_refused(bring_in: Import, wraps: str, words: str) -> None:
    counts = (2**32 - 10_000_000 + 100_000 * np.arange(200)) % 2**32
    with pytest.raises(ConfigError, match=words):
        bring_in(
            table([str(count) for count in counts]),
            map=timed(f"{{column: t, unit: us, wraps: {wraps}}}"),
        )


def test_row_out_of_order_is_no_wrap(bring_in: Import) -> None:
    counts = [*range(0, 1000, 10), 500, *range(1000, 2000, 10)]
    with pytest.raises(ConfigError, match="jumps by"):
        bring_in(
            table([str(count) for count in counts]),
            map=timed("{column: t, unit: ms, wraps: 16 bit}"),
        )


TIME_OF_DAY = '{column: t, format: "%H:%M:%S.%f", since: 2025-03-03}'


def test_times_of_day_need_their_day(bring_in: Import) -> None:
    with pytest.raises(ConfigError, match="need the day of the first row") as raised:
        bring_in(table(["10:00:00.0"]), map=timed('{column: t, format: "%H:%M:%S.%f"}'))
    assert "`since: 2025-03-03`" in str(raised.value.hint)


@pytest.mark.parametrize("block_bytes", [100, 1 << 20])
def test_times_of_day_go_on_over_midnight(
    bring_in: Import, monkeypatch: pytest.MonkeyPatch, block_bytes: int
) -> None:
    monkeypatch.setattr("rigd.importing.tables.csv_table.BLOCK_BYTES", block_bytes)
    first = datetime(2025, 3, 3, 22, 0, tzinfo=UTC)
    moments = [first + i * timedelta(minutes=7, microseconds=1) for i in range(600)]
    texts = [f"{moment:%H:%M:%S.%f}" for moment in moments]
    recording = bring_in(table(texts), map=timed(TIME_OF_DAY))
    assert recording.read("samples")["t_ns"].tolist() == [unix_ns(item) for item in moments]
    assert recording.metadata["import"]["times"] == "samples: midnights: 3"


@pytest.mark.parametrize(
    ("since", "unit", "zero", "resolution_s"),
    [
        ("1899-12-30", "d", datetime(1899, 12, 30), 5e-7),  # Excel
        ("1904-01-01", "d", datetime(1904, 1, 1), 5e-7),  # Excel of a Mac, until 2011
        ("0000-01-00", "d", datetime(1, 1, 1) - timedelta(0), 1e-5),  # MATLAB
    ],
    ids=["excel", "mac", "matlab"],
)
def test_days_of_a_spreadsheet_are_read(
    bring_in: Import, since: str, unit: str, zero: datetime, resolution_s: float
) -> None:
    moments = [datetime(2023, 3, 15, 12) + i * timedelta(seconds=0.1) for i in range(100)]
    days = [(moment - zero) / timedelta(days=1) for moment in moments]
    if since.startswith("0000"):
        days = [day + 367.0 for day in days]  # 0001-01-01 is 367: 0000 was a leap year
    recording = bring_in(
        table([repr(day) for day in days]),
        map=timed(f"{{column: t, unit: {unit}, since: {since}}}"),
    )
    expected = [unix_ns(moment.replace(tzinfo=UTC)) for moment in moments]
    late = recording.read("samples")["t_ns"] - np.array(expected)
    assert np.max(np.abs(late)) * 1e-9 <= resolution_s


BERLIN = ZoneInfo("Europe/Berlin")


def local(first: datetime, count: int, step: timedelta) -> tuple[list[str], list[int]]:
    moments = [first + i * step for i in range(count)]
    return (
        [f"{moment.astimezone(BERLIN):%Y-%m-%d %H:%M:%S}" for moment in moments],
        [unix_ns(moment) for moment in moments],
    )


LOCAL = '{column: t, format: "%Y-%m-%d %H:%M:%S", zone: Europe/Berlin}'
CHANGES = {
    "to winter time": (datetime(2024, 10, 26, 22, tzinfo=UTC), timedelta(seconds=97)),
    "to summer time": (datetime(2025, 3, 30, 0, tzinfo=UTC), timedelta(seconds=97)),
    "rows each two hours": (datetime(2024, 10, 24, 22, 30, tzinfo=UTC), timedelta(hours=2)),
    "rows each 50 minutes": (datetime(2024, 10, 24, 22, 30, tzinfo=UTC), timedelta(minutes=50)),
    "begins in the first hour": (datetime(2024, 10, 27, 0, 10, tzinfo=UTC), timedelta(seconds=9)),
    "begins in the second hour": (datetime(2024, 10, 27, 1, 10, tzinfo=UTC), timedelta(seconds=9)),
}


@pytest.mark.parametrize("case", CHANGES)
@pytest.mark.parametrize("block_bytes", [300, 1 << 20])
def test_local_times_go_on_over_changes(
    bring_in: Import, monkeypatch: pytest.MonkeyPatch, case: str, block_bytes: int
) -> None:
    if not case.startswith("begins"):
        monkeypatch.setattr("rigd.importing.tables.csv_table.BLOCK_BYTES", block_bytes)
    texts, expected = local(CHANGES[case][0], 900, CHANGES[case][1])
    recording = bring_in(table(texts), map=timed(LOCAL))
    assert recording.read("samples")["t_ns"].tolist() == expected
    assert "local times of Europe/Berlin" in recording.metadata["import"]["times"]


def test_end_of_summer_time_names_zone(bring_in: Import) -> None:
    texts, _ = local(*CHANGES["to winter time"][:1], 900, CHANGES["to winter time"][1])
    with pytest.raises(ConfigError, match=r"runs backward by 3503 s") as raised:
        bring_in(table(texts), map=timed(LOCAL.replace(", zone: Europe/Berlin", "")))
    assert "`zone: Europe/Berlin`" in str(raised.value.hint)


def test_hour_that_does_not_exist_is_refused(bring_in: Import) -> None:
    texts = [f"2025-03-30 02:{minute:02d}:00" for minute in range(60)]
    with pytest.raises(ConfigError, match="02:00:00 does not exist in Europe/Berlin") as raised:
        bring_in(table(texts), map=timed(LOCAL))
    assert "`zone: '+01:00'`" in str(raised.value.hint)
    fixed = bring_in(table(texts), map=timed(LOCAL.replace("Europe/Berlin", "'+01:00'")))
    assert fixed.start_ns == unix_ns(datetime(2025, 3, 30, 1, tzinfo=UTC))


def test_hour_that_occurs_twice_is_refused(bring_in: Import) -> None:
    texts = [f"2024-10-27 02:{minute:02d}:00" for minute in range(10, 50)]
    with pytest.raises(ConfigError, match="02:10:00 occurs twice in Europe/Berlin") as raised:
        bring_in(table(texts), map=timed(LOCAL))
    for hour, offset in ((0, "+02:00"), (1, "+01:00")):
        assert f"`zone: '{offset}'`" in str(raised.value.hint)
        map = timed(LOCAL.replace("Europe/Berlin", f"'{offset}'"))
        fixed = bring_in(table(texts), map=map, name=f"{hour}.csv")
        assert fixed.start_ns == unix_ns(datetime(2024, 10, 27, hour, 10, tzinfo=UTC))


def test_local_times_of_day_pass_both(bring_in: Import) -> None:
    """Midnight, and the end of summer time in the same night."""
    first = datetime(2024, 10, 26, 20, tzinfo=UTC)
    moments = [first + i * timedelta(minutes=7) for i in range(300)]
    texts = [f"{moment.astimezone(BERLIN):%H:%M:%S}" for moment in moments]
    time = '{column: t, format: "%H:%M:%S", since: 2024-10-26, zone: Europe/Berlin}'
    recording = bring_in(table(texts), map=timed(time))
    assert recording.read("samples")["t_ns"].tolist() == [unix_ns(item) for item in moments]


def test_local_days_of_excel_follow_zone(bring_in: Import) -> None:
    moments = [datetime(2024, 7, 1, 12) + i * timedelta(seconds=1) for i in range(20)]
    days = [(moment - datetime(1899, 12, 30)) / timedelta(days=1) for moment in moments]
    time = "{column: t, unit: d, since: 1899-12-30, zone: Europe/Berlin}"
    recording = bring_in(table([repr(day) for day in days]), map=timed(time))
    expected = unix_ns(datetime(2024, 7, 1, 10, tzinfo=UTC))
    assert abs(recording.start_ns - expected) < 1000


WRONG = {
    "zone without a day": ("{column: t, unit: s, zone: Europe/Berlin}", "belongs to times with"),
    "unknown zone": ("{column: t, format: iso, zone: Europa/Berlin}", "there is no zone"),
    "zone twice": ('{column: t, unit: d, since: "2024-01-01T00:00:00Z", zone: UTC}', "its zone"),
    "both": ("{column: t, unit: ms, wraps: 16 bit, restarts: true}", "does not begin again"),
    "no range": ("{column: t, unit: ms, wraps: 5 N}", "is no quantity in s"),
    "no year": ('{column: t, format: "%d.%m. %H:%M:%S"}', "has no year"),
    "since of a date": ("{column: t, format: iso, since: 1970-01-01}", "have no `since:`"),
    "morning": ('{column: t, format: "%I:%M:%S", since: 2024-01-01}', "morning from evening"),
    "no day": ('{column: t, format: "%H:%M", since: "2024-01-01T10:00:00"}', "is no day"),
    "rate": ("{rate: 1 kHz, coarse: spread}", "belong to a column"),
}


@pytest.mark.parametrize("case", WRONG)
def test_clock_that_contradicts_itself_is_refused(bring_in: Import, case: str) -> None:
    with pytest.raises(ConfigError, match=WRONG[case][1]):
        bring_in(table(["0", "1"]), map=timed(WRONG[case][0]))


def test_machine_without_tz_database_names_tzdata(
    bring_in: Import, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts, _ = local(datetime(2024, 7, 1, tzinfo=UTC), 9, timedelta(seconds=1))
    before = zoneinfo.TZPATH
    zoneinfo.reset_tzpath(to=[])
    ZoneInfo.clear_cache()
    try:
        with monkeypatch.context() as bare:
            for module in ("tzdata", "tzdata.zoneinfo", "tzdata.zoneinfo.Europe"):
                bare.setitem(sys.modules, module, None)
            with pytest.raises(ConfigError, match="no zone 'Europe/Berlin'") as raised:
                bring_in(table(texts), map=timed(LOCAL))
        assert "`pip install tzdata`" in str(raised.value.hint)
        if find_spec("tzdata") is not None:  # what the hint says is enough
            bring_in(table(texts), map=timed(LOCAL))
    finally:
        zoneinfo.reset_tzpath(to=before)

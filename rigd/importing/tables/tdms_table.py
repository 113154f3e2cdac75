"""Reads TDMS files, as LabVIEW writes them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from nptdms import TdmsFile
from numpy.typing import NDArray

from rigd.config.problems import suggest
from rigd.importing.tables.array_table import ArrayColumn, ArrayTable
from rigd.importing.tables.parquet_table import unreadable
from rigd.importing.tables.table import Batch, Kind
from rigd.model.errors import ConfigError, Place

#: The column of the times that a waveform states by its start and increment.
TIME: Final = "(time)"


def open_tdms(path: Path, group: str | None) -> ArrayTable:
    """Return the channels of a group as a table; without ``group`` the file has a single one.

    Raises:
        ConfigError: the file is cut off, damaged or no TDMS, or has no such group.
    """
    with _file(path) as file:
        starts = [_start_ns(channel) for channel in _group(path, file, group).channels()]
    return _TdmsTable(path, group, next((item for item in starts if item is not None), None))


def tdms_groups(path: Path) -> list[str]:
    """Return the groups of a file that have samples.

    Raises:
        ConfigError: the file is cut off, damaged or no TDMS.
    """
    with _file(path) as file:
        return [item.name for item in file.groups() if any(map(len, item.channels()))]


class _TdmsTable(ArrayTable):
    """A group; :data:`TIME` has the times of the waveforms that are read with it."""

    def __init__(self, path: Path, group: str | None, start_ns: int | None) -> None:
        super().__init__(path, partial(_opened, path, group, start_ns, ()), start_ns)
        self._group = group

    def batches(self, wanted: Mapping[int, Kind]) -> Iterator[Batch]:
        opener = partial(_opened, self.path, self._group, self.start_ns, wanted)
        return ArrayTable(self.path, opener, self.start_ns).batches(wanted)


def _start_ns(channel: Any) -> int | None:
    """Return when a waveform begins, in ns since 1970, if it states it."""
    start = channel.properties.get("wf_start_time")
    if not isinstance(start, np.datetime64):
        return None
    return int(start.astype("datetime64[ns]").astype(np.int64))


@contextmanager
def _file(path: Path) -> Iterator[TdmsFile]:
    with path.open("rb") as stream:  # npTDMS leaves a file open that it cannot read
        try:
            file = TdmsFile.open(stream)
        except (OSError, ValueError, EOFError, KeyError) as error:
            raise unreadable(path, "TDMS", error) from error
        with file:
            rest = path.stat().st_size - _read_end(file)
            if file.file_status.incomplete_final_segment or rest:
                raise ConfigError(
                    "the file is cut off: its last segment is not complete",
                    place=Place(str(path), 1, 1),
                    hint="take the whole file from where it was written; what this one still has "
                    "can be saved anew with LabVIEW or npTDMS",
                )
            yield file


def _read_end(file: Any) -> int:
    """Return where the last segment that was read ends, in bytes.

    npTDMS passes over a segment whose head is cut off, and says so in its log alone.
    """
    segments = file._reader._segments  # noqa: SLF001  (it has no public name)
    return int(segments[-1].next_segment_pos) if segments else 0


def _group(path: Path, file: TdmsFile, group: str | None) -> Any:
    groups = {item.name: item for item in file.groups()}
    if group is None and len(groups) == 1:
        return next(iter(groups.values()))
    if group is None:
        raise ConfigError(
            f"{path} has {len(groups)} groups", hint=f"give `group:`, one of {', '.join(groups)}"
        )
    if group not in groups:
        raise ConfigError(f"{path} has no group {group!r}", hint=suggest(group, groups))
    return groups[group]


@contextmanager
def _opened(
    path: Path, group: str | None, start_ns: int | None, wanted: Collection[int]
) -> Iterator[Sequence[ArrayColumn]]:
    with _file(path) as file:
        channels = _group(path, file, group).channels()
        columns = []
        for channel in channels:
            kind = np.dtype(channel.dtype).kind
            unit = "ns" if kind == "M" else str(channel.properties.get("unit_string", ""))
            columns.append(
                ArrayColumn(
                    channel.name, unit, len(channel), kind in "iuM", partial(_read, channel)
                )
            )
        waveforms = {at: c for at, c in enumerate(channels) if "wf_increment" in c.properties}
        if waveforms:
            used = [at for at in wanted if at in waveforms] or [min(waveforms)]
            first, *others = (_clock(waveforms[at], start_ns) for at in used)
            for at, other in zip(used[1:], others, strict=True):
                if other != first and len(columns) in wanted:
                    a, b = columns[used[0]].name, columns[at].name
                    raise ConfigError(
                        f"the times of {a!r} begin at {first[0]:.9g} s in steps of {first[1]:.9g} "
                        f"s, those of {b!r} at {other[0]:.9g} s in steps of {other[1]:.9g} s",
                        place=Place(str(path), 1, at + 1),
                        hint="channels with different times are sources of their own",
                    )
            rows = columns[used[0]].rows
            columns.append(ArrayColumn(TIME, "s", rows, False, partial(_times, *first)))
        yield columns


def _read(channel: Any, start: int, end: int) -> NDArray[Any]:
    values: NDArray[Any] = channel.read_data(start, end - start)
    return values


def _clock(waveform: Any, start_ns: int | None) -> tuple[float, float]:
    """Return the first time of a waveform since ``start_ns``, and its increment, in s."""
    properties, own_ns = waveform.properties, _start_ns(waveform)
    late_s = 0.0 if start_ns is None or own_ns is None else (own_ns - start_ns) * 1e-9
    return late_s + float(properties.get("wf_start_offset", 0.0)), float(properties["wf_increment"])


def _times(first_s: float, increment_s: float, start: int, end: int) -> NDArray[np.float64]:
    return np.arange(start, end, dtype=np.float64) * increment_s + first_s

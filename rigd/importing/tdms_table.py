"""Reads TDMS files, as LabVIEW writes them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from nptdms import TdmsFile
from numpy.typing import NDArray

from rigd.config.problems import suggest
from rigd.importing.array_table import ArrayColumn, ArrayTable
from rigd.importing.parquet_table import unreadable
from rigd.model.errors import ConfigError, Place

#: The column of the times that a waveform states by its start and increment.
TIME: Final = "(time)"


def open_tdms(path: Path, group: str | None) -> ArrayTable:
    """Return the channels of a group as a table; without ``group`` the file has a single one.

    Raises:
        ConfigError: the file is cut off, damaged or no TDMS, or has no such group.
    """
    with _file(path) as file:
        channels = _group(path, file, group).channels()
        starts = [channel.properties.get("wf_start_time") for channel in channels]
        start = next((item for item in starts if isinstance(item, np.datetime64)), None)
    start_ns = None if start is None else int(start.astype("datetime64[ns]").astype(np.int64))
    return ArrayTable(path, partial(_opened, path, group), start_ns)


@contextmanager
def _file(path: Path) -> Iterator[TdmsFile]:
    with path.open("rb") as stream:  # npTDMS leaves a file open that it cannot read
        try:
            file = TdmsFile.open(stream)
        except (OSError, ValueError, EOFError, KeyError) as error:
            raise unreadable(path, "TDMS", error) from error
        with file:
            if file.file_status.incomplete_final_segment:
                raise ConfigError(
                    "the file is cut off: its last segment is not complete",
                    place=Place(str(path), 1, 1),
                )
            yield file


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
def _opened(path: Path, group: str | None) -> Iterator[Sequence[ArrayColumn]]:
    with _file(path) as file:
        columns = []
        for channel in _group(path, file, group).channels():
            kind = np.dtype(channel.dtype).kind
            unit = "ns" if kind == "M" else str(channel.properties.get("unit_string", ""))
            columns.append(
                ArrayColumn(
                    channel.name, unit, len(channel), kind in "iuM", partial(_read, channel)
                )
            )
        waveform = next(
            (c for c in _group(path, file, group).channels() if "wf_increment" in c.properties),
            None,
        )
        if waveform is not None:
            columns.append(
                ArrayColumn(TIME, "s", len(waveform), False, partial(_times, waveform.properties))
            )
        yield columns


def _read(channel: Any, start: int, end: int) -> NDArray[Any]:
    values: NDArray[Any] = channel.read_data(start, end - start)
    return values


def _times(properties: Any, start: int, end: int) -> NDArray[np.float64]:
    offset = float(properties.get("wf_start_offset", 0.0))
    rows = np.arange(start, end, dtype=np.float64)
    return rows * float(properties["wf_increment"]) + offset

"""Computes the observers of a rig from a recording, cycle by cycle as in a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigd.computed.observers.driver import Observer, ObserverConfig
from rigd.computed.observers.runner import Runner
from rigd.config.rig import RigConfig
from rigd.model.channels import ECHO, STALE, STATUS_FIELD, Stream
from rigd.model.errors import RecordingError
from rigd.model.rows import TIME_FIELD, row_dtype
from rigd.model.tables import Tables
from rigd.procedure.steps.recorded_streams import CYCLE_STREAM
from rigd.record import Recording

Rows = NDArray[np.void]


@dataclass(frozen=True, eq=False)
class Filtered:
    """The rows of one observer, as a run records them, and how many values it corrects with."""

    name: str
    config: ObserverConfig
    stream: Stream
    rows: Rows


@dataclass(frozen=True, eq=False)
class _Source:
    """The rows of one stream that are new: the cycle in which each counts, and its values."""

    at_ns: NDArray[np.int64]
    columns: NDArray[np.float64]


def observers_of(rig: RigConfig) -> dict[str, ObserverConfig]:
    """Return the observers of ``rig`` by name."""
    return {
        name: device.config
        for name, device in rig.devices.items()
        if isinstance(device.config, ObserverConfig)
    }


def filtered(recording: Recording, rig: RigConfig, name: str) -> Filtered:
    """Return what the observer ``name`` of ``rig`` makes of ``recording``.

    Every recorded cycle is computed, with the newest rows of its time or before. Rows that were
    recorded at a lower rate, or not at all, are missing: the filter then predicts. Rows of a device
    that is read beside the cycle count in the cycle at whose time they were taken; in the run, in
    the one in which they came.

    Raises:
        RecordingError: a channel that it uses is not in the recording.
    """
    config = observers_of(rig)[name]
    declared = Observer.declare(config)
    stream = Stream(name, declared.channels, Observer.title, has_status=True, source="observer")
    values: dict[str, list[str]] = {}
    echoes: dict[str, list[str]] = {}
    for channel in (*config.inputs, *config.measured):
        device, _, item = channel.partition(".")
        is_echo = rig.channel(channel) is None
        (echoes if is_echo else values).setdefault(device, []).append(item)
    sources = {device: _read(recording, device, items) for device, items in values.items()}
    sent = {device: _read(recording, device, items) for device, items in echoes.items()}
    times = _read(recording, CYCLE_STREAM, ()).at_ns
    begins = sorted(trial.info.start_ns for trial in recording.trials) if config.each_trial else []
    rows = _computed(config, rig, times, begins, (values, sources), (echoes, sent))
    return Filtered(name, config, stream, rows.astype(row_dtype(stream)))


def _read(recording: Recording, device: str, items: Sequence[str]) -> _Source:
    if device not in recording.streams:
        raise RecordingError(
            f"{recording.path} has no stream {device!r}, which the observer uses",
            hint="record it: `record: all` in the procedure",
        )
    rows = recording.read(device)
    missing = [item for item in items if item not in (rows.dtype.names or ())]
    if missing:
        raise RecordingError(f"{recording.path} has no channel {device}.{missing[0]}")
    echo = bool(items) and items[0].endswith(ECHO)
    if STATUS_FIELD in (rows.dtype.names or ()) and not echo:
        rows = rows[rows[STATUS_FIELD] & STALE == 0]
    columns = np.array([rows[item] for item in items]).reshape(len(items), len(rows))
    return _Source(rows[TIME_FIELD].astype(np.int64), columns)


def _computed(
    config: ObserverConfig,
    rig: RigConfig,
    times: NDArray[np.int64],
    begins: Sequence[int],
    measured: tuple[dict[str, list[str]], dict[str, _Source]],
    written: tuple[dict[str, list[str]], dict[str, _Source]],
) -> NDArray[np.void]:
    """Play the rows into tables as those of the cycle, and return what the filter writes."""
    runner = Runner(config)
    values: list[float] = []
    stamps = [0] * len(measured[0])
    applied: list[float] = []
    readings, setpoints, stamp_of, late_ns = {}, {}, [], []
    feeds: list[tuple[int, int, NDArray[np.int64], list[list[float]]]] = []
    for number, (device, items) in enumerate(measured[0].items()):
        declared = rig.devices[device].declaration
        late_ns.append(0 if declared.every_cycle else round(declared.silent_s * 1e9))
        source = measured[1][device]
        feeds.append((number, len(values), source.at_ns, source.columns.T.tolist()))
        for item in items:
            readings[f"{device}.{item}"] = len(values)
            stamp_of.append(number)
            values.append(float("nan"))
    sends: list[tuple[int, NDArray[np.int64], list[list[float]]]] = []
    for device, items in written[0].items():
        source = written[1][device]
        sends.append((len(applied), source.at_ns, source.columns.T.tolist()))
        for place, item in enumerate(items):
            setpoints[f"{device}.{item.removesuffix(ECHO)}"] = len(applied)
            applied.append(float(source.columns[place, 0]) if len(source.at_ns) else float("nan"))
    tables = Tables(values, stamps, applied, [], readings, stamp_of, late_ns, setpoints)
    runner.bind(tables)
    out = np.zeros(len(times), dtype=[(TIME_FIELD, "<i8"), *_fields(config)])
    table: list[tuple[float, ...]] = []
    feed_at, send_at, trials = [0] * len(feeds), [0] * len(sends), list(begins)
    for t_ns in times.tolist():
        while trials and trials[0] <= t_ns:
            trials.pop(0)
            runner.begin()
        for k, (number, place, at_ns, rows) in enumerate(feeds):
            while feed_at[k] < len(rows) and at_ns[feed_at[k]] <= t_ns:
                row = rows[feed_at[k]]
                values[place : place + len(row)] = row
                stamps[number] = int(at_ns[feed_at[k]])
                feed_at[k] += 1
        for k, (place, at_ns, rows) in enumerate(sends):
            while send_at[k] < len(rows) and at_ns[send_at[k]] < t_ns:  # written before it is read
                row = rows[send_at[k]]
                applied[place : place + len(row)] = row
                send_at[k] += 1
        tables.take(t_ns)
        runner.step(t_ns)
        table.append((t_ns, *runner.row))
    for place, field in enumerate(out.dtype.names or ()):
        out[field] = [row[place] for row in table]
    return out


def _fields(config: ObserverConfig) -> list[tuple[str, str]]:
    return [*((channel.name, "<f8") for channel in config.channels), (STATUS_FIELD, "<u4")]

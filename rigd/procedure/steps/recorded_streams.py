"""Reads which part of each stream a procedure records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from rigd.config.problems import suggest
from rigd.config.rig import RigConfig
from rigd.procedure.conditions.conditions import read_until
from rigd.procedure.expression import Scope
from rigd.procedure.program import Capture, Recorded
from rigd.procedure.reader import Reader
from rigd.procedure.source import CaptureSource, ProcedureSource
from rigd.sdk import BlockDriver, Driver

#: The stream of the cycle itself; always recorded, because delays are data.
CYCLE_STREAM: Final = "cycle"
#: Most memory for the past of a stream, in bytes.
MOST_BYTES: Final = 64 << 20


def read_record(
    reader: Reader, source: ProcedureSource, rig: RigConfig, scope: Scope, steps: Sequence[str]
) -> dict[str, Recorded]:
    """Return the recorded part of each stream; problems are noted.

    ``steps`` are the names of those of the procedure.
    """
    streams = [name for name, device in rig.devices.items() if device.channels]
    streams.append(CYCLE_STREAM)
    if source.record == "all":
        return dict.fromkeys(streams, Recorded())
    record = {CYCLE_STREAM: Recorded()}
    for name, given in source.record.items():
        if name not in streams:
            place = reader.document.key_place(("record", name))
            reader.problems.add_lacking(place, rig.name, "stream", name, streams)
        if isinstance(given, int):
            record[name] = Recorded(given)
            continue
        if isinstance(given, CaptureSource):
            capture = _capture(reader, name, given, rig, scope)
            record[name] = Recorded(given.every, capture=capture)
            continue
        for index, step in enumerate(given.during):
            if step not in steps:
                path = ("record", name, "during", index)
                reader.note(path, f"the procedure has no step {step!r}", suggest(step, steps))
        record[name] = Recorded(given.every, frozenset(given.during))
    _check_identify(reader, source, record)
    return record


def _capture(
    reader: Reader, name: str, given: CaptureSource, rig: RigConfig, scope: Scope
) -> Capture:
    path = ("record", name)
    when = read_until(reader, (*path, "when"), given.when, scope, rig, ())
    before_s = reader.time((*path, "before"), given.before, scope) or 0.0
    after_s = reader.time((*path, "after"), given.after, scope) or 0.0
    device = rig.devices.get(name)
    if name == CYCLE_STREAM:
        reader.note_key(path, "the stream of the cycle is always recorded whole",
                        "leave it out here")  # fmt: skip
    elif device is not None:
        kind = device.driver_class
        if issubclass(kind, BlockDriver):
            rate_hz = device.declaration.rate_hz
        elif issubclass(kind, Driver):
            rate_hz = 1e9 / rig.period_ns
        else:
            reader.note_key(
                path, f"{name} is read beside the cycle, and its past is not held",
                f"its rows are few: record all of them, '{name}: 1'",
            )  # fmt: skip
            return Capture(when, before_s, after_s)
        from rigd.model.rows import row_struct  # a procedure is checked without numpy

        size = row_struct(device.stream).size + 8 * len(device.setpoints)
        if before_s * size * rate_hz > MOST_BYTES * given.every:
            most_s = MOST_BYTES * given.every / (size * rate_hz)
            reader.note(
                (*path, "before"),
                f"{given.before} of {name} take more than {MOST_BYTES >> 20} MB of memory",
                f"at most {most_s:.3g} s, or a larger 'every'",
            )
    return Capture(when, before_s, after_s)


def _check_identify(reader: Reader, source: ProcedureSource, record: dict[str, Recorded]) -> None:
    """Note a signal of the analysis that is not recorded whole."""
    plan = source.identify
    signals = {} if plan is None else {
        ("identify", key, name): channel
        for key, named in (("signals", plan.signals), ("optional_signals", plan.optional_signals))
        for name, channel in named.items()
    }  # fmt: skip
    for path, channel in signals.items():
        recorded = record.get(channel.partition(".")[0])
        if recorded is not None and recorded.capture is not None:
            reader.note(
                path,
                f"{channel} is recorded only around what its stream waits for: trials would lack "
                "rows",
                "record it always, or during the steps that are evaluated",
            )

"""Writes all tables into one file of ASAM MDF 4.1: a channel group for each table."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import redirect_stdout
from datetime import UTC, datetime
from io import StringIO
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
from asammdf import MDF, Signal, Source
from asammdf.blocks.v4_constants import BUS_TYPE_NONE, SOURCE_TOOL

from rigd.record.export.part import Origin, Part, step_column, step_numbers
from rigd.record.read.joined_table import JOINED_TABLE
from rigd.record.read.tables import Column, Table

_VERSION: Final = "4.10"


def write_mdf4(path: Path, parts: Sequence[Part], origin: Origin) -> None:
    """Write the tables; each channel is named ``TABLE.COLUMN`` and has its unit and description.

    The steps are numbers with a conversion to their names, the attached files are embedded. The
    samples wait in a temporary file, not in memory.
    """
    with MDF(version=_VERSION) as mdf:
        # The file's time has nanoseconds, that of datetime has not.
        mdf.start_time = datetime.fromtimestamp(origin.start_ns // 1_000_000_000, UTC)
        mdf.header.abs_time = origin.start_ns
        mdf.header.description = json.dumps(origin.metadata, ensure_ascii=False)
        for attachment in origin.attachments:
            mdf.attach(attachment.data, attachment.name, mime=attachment.media_type)
        for part in parts:
            _add(mdf, part, origin)
        # asammdf prints how fast it was if that took long.
        with path.open("wb+") as file, redirect_stdout(StringIO()):
            mdf.save(file, compression=2)


def _add(mdf: Any, part: Part, origin: Origin) -> None:
    """Add a group; the first batch makes it, the others extend it."""
    step = step_column(part.head)
    source = Source(part.name, part.source, part.doc, SOURCE_TOOL, BUS_TYPE_NONE)
    index = None
    for table in chain(_first(part), part.batches()):
        columns = {name: _raw(name, table, step, origin) for name in table.columns}
        times = columns[part.time]
        if index is None:
            signals = [
                Signal(
                    samples, times, name=_name(part, name),
                    unit=table.units.get(name, ""), comment=table.docs.get(name, ""),
                    conversion=_conversion(origin) if name == step else None,
                    encoding="utf-8" if samples.dtype.kind == "S" else None,
                )
                for name, samples in columns.items()
            ]  # fmt: skip
            index = mdf.append(
                signals, acq_name=part.name, acq_source=source, comment=part.doc,
                common_timebase=True,
            )  # fmt: skip
        else:
            mdf.extend(index, [(samples, None) for samples in (times, *columns.values())])


def _first(part: Part) -> Sequence[Table]:
    """Return the empty table if no batch follows: then the group has no rows."""
    return () if next(part.batches(), None) is not None else (part.head,)


def _name(part: Part, column: str) -> str:
    joined = part.head.name == JOINED_TABLE
    return column if joined else f"{part.name}.{column}"


def _raw(name: str, table: Table, step: str, origin: Origin) -> Column:
    column = table.columns[name]
    if name == step:
        return step_numbers(column, origin).astype(np.uint16)
    if column.dtype == object:
        return np.array([str(item).encode() for item in column], np.bytes_)
    return column.astype(np.uint8) if column.dtype == np.bool_ else column


def _conversion(origin: Origin) -> dict[str, object]:
    names = ["", *origin.step_names]
    return {
        **{f"val_{place}": place for place in range(len(names))},
        **{f"text_{place}": name for place, name in enumerate(names)},
        "default": "",
    }

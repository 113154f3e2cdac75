"""Writes tables as Parquet and CSV files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from rigd.record.export.part import Origin, Part
from rigd.record.read.tables import Table


def write_parquet(path: Path, parts: Sequence[Part], origin: Origin) -> None:
    """Write a table; units and descriptions are in the metadata of its fields."""
    (part,) = parts
    schema = _schema(part, origin, with_units=False)
    with pa_parquet.ParquetWriter(path, schema) as writer:
        for table in _arrow(part, schema):
            writer.write_table(table)


def write_csv(path: Path, parts: Sequence[Part], origin: Origin) -> None:
    """Write a table with the units in the names of its columns."""
    (part,) = parts
    schema = _schema(part, origin, with_units=True)
    with pa_csv.CSVWriter(path, schema) as writer:
        for table in _arrow(part, schema):
            writer.write_table(table)


def describe_csv(path: Path, _parts: Sequence[Part], origin: Origin) -> None:
    """Write what CSV files have no place for: metadata, and what is known of each channel."""
    streams = {
        stream.name: {
            "description": stream.doc,
            "source": stream.source,
            "channels": {
                channel.name: {"unit": channel.unit, "description": channel.doc}
                for channel in stream.channels
            },
        }
        for stream in origin.streams
    }
    content = {"metadata": origin.metadata, "time_base": origin.time_base, "streams": streams}
    text = json.dumps(content, indent=2, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def _schema(part: Part, origin: Origin, *, with_units: bool) -> Any:
    fields = []
    for name, column in part.head.columns.items():
        unit, doc = part.head.units.get(name, ""), part.head.docs.get(name, "")
        shown = f"{name} [{unit}]" if with_units and unit else name
        kind = pa.string() if column.dtype == object else pa.from_numpy_dtype(column.dtype)
        fields.append(pa.field(shown, kind, metadata={"unit": unit, "doc": doc}))
    about = {f"rigd.{name}": text for name, text in origin.as_json().items()}
    about["rigd.table"] = json.dumps({"description": part.doc, "source": part.source})
    return pa.schema(fields, metadata=about)


def _arrow(part: Part, schema: Any) -> Iterator[Any]:
    for table in part.batches():
        yield _arrays(table, schema)


def _arrays(table: Table, schema: Any) -> Any:
    columns = zip(table.columns.values(), schema.types, strict=True)
    return pa.Table.from_arrays([pa.array(column, kind) for column, kind in columns], schema=schema)

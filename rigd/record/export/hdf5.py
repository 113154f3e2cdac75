"""Writes all tables into one HDF5 file: a group for each table, a dataset for each column."""

from __future__ import annotations

from collections.abc import Sequence
from io import FileIO
from pathlib import Path, PurePosixPath
from typing import Any, Final

import h5py
import numpy as np

from rigd.model import RecordingError
from rigd.record.export.part import Origin, Part, step_column, step_numbers, unused
from rigd.record.read.attachments import file_names

#: Rows of a compressed block of a dataset: 128 kB of float64.
_CHUNK_ROWS: Final = 16_384
#: Has the place of an empty name.
_UNNAMED: Final = "unnamed"
_TEXT: Final = h5py.string_dtype("utf-8")


def write_hdf5(path: Path, parts: Sequence[Part], origin: Origin) -> None:
    """Write the tables; units and descriptions are attributes of the datasets.

    ``step`` is a number into the dataset ``step_names`` beside it, 0 outside of steps. A name of
    rigd's own, such as ``metadata``, is ``rigd_metadata`` beside a stream or channel of that name.

    Raises:
        RecordingError: a stream would have the name of a channel of another.
    """
    _check_names(parts)
    with _Spared(path, "wb+") as target:
        with h5py.File(target, "w", track_order=True) as file:
            _write_all(file, parts, origin, target)
        target.check()


class _Spared(FileIO):
    """A file that keeps the first error of the system: libhdf5 cannot close a file it can't write.

    After an error it takes what is written and drops it.
    """

    failed: OSError | None = None

    def write(self, data: Any) -> int:
        """Write ``data`` whole, or keep the error."""
        view = memoryview(data).cast("B")
        done = 0
        while self.failed is None and done < len(view):
            try:
                done += super().write(view[done:]) or 0
            except OSError as error:
                self.failed = error
        return len(view)

    def readinto(self, buffer: Any) -> int:
        """Read into the whole ``buffer``, zeros behind the end."""
        view = memoryview(buffer).cast("B")
        done = super().readinto(view) or 0
        view[done:] = bytes(len(view) - done)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the size, or keep the error."""
        try:
            return super().truncate(size)
        except OSError as error:
            self.failed = self.failed or error
            return size or 0

    def check(self) -> None:
        """Raise the error that was kept."""
        if self.failed is not None:
            raise self.failed


def _write_all(file: Any, parts: Sequence[Part], origin: Origin, target: _Spared) -> None:
    """Write all, up to the first error: one that is raised before the file is closed damages it."""
    file.attrs["recording"] = origin.recording
    file.attrs["start_ns"] = np.int64(origin.start_ns)
    taken = {part.name.partition("/")[0] for part in parts}
    metadata, attachments = unused("metadata", taken), unused("attachments", taken)
    records = file.create_group(metadata)
    for name, values in origin.metadata.items():
        group = records.create_group(unused(_path(name), records))
        group.attrs.update({_text(key) or _UNNAMED: _text(value) for key, value in values.items()})
    names = file_names(attachment.name for attachment in origin.attachments)
    for attachment in origin.attachments:
        group = file.require_group(attachments)
        name = unused(str(names[attachment.name]).replace("/", "."), group)
        group.create_dataset(name, data=np.frombuffer(attachment.data, np.uint8))
    for part in parts:
        group = file.create_group(part.name)
        step = step_column(part.head)
        _define(group, part, step, origin)
        for table in part.batches():
            for name, column in table.columns.items():
                if target.failed is not None:
                    return
                dataset = group[name]
                end = len(dataset)
                dataset.resize(end + len(table), 0)
                if name == step:
                    dataset[end:] = step_numbers(column, origin)
                else:
                    dataset[end:] = (
                        [_text(item) for item in column] if column.dtype == object else column
                    )


def _check_names(parts: Sequence[Part]) -> None:
    """Refuse a stream ``imu/data`` beside a channel ``data`` of ``imu``: both are ``imu/data``."""
    columns = {f"{part.name}/{column}" for part in parts for column in part.head.columns}
    for part in parts:
        for path in (part.name, *map(str, PurePosixPath(part.name).parents)):
            if path in columns:
                raise RecordingError(
                    f"the stream {part.name!r} and a channel would both be {path!r} in HDF5",
                    hint="Export to parquet, csv or mdf4 instead, or one stream alone by --stream.",
                )


def _define(group: Any, part: Part, step: str, origin: Origin) -> None:
    group.attrs["description"], group.attrs["source"] = _text(part.doc), _text(part.source)
    if step:
        names = ["", *origin.step_names]
        group.create_dataset(unused("step_names", part.head.columns), data=names, dtype=_TEXT)
    for name, column in part.head.columns.items():
        kind: Any = _TEXT if column.dtype == np.object_ else column.dtype
        dataset = group.create_dataset(
            name, (0,), np.int32 if name == step else kind, maxshape=(None,),
            chunks=(_CHUNK_ROWS,), compression="gzip", compression_opts=1, shuffle=True,
        )  # fmt: skip
        dataset.attrs["unit"] = _text(part.head.units.get(name, ""))
        dataset.attrs["description"] = _text(part.head.docs.get(name, ""))


def _path(name: str) -> str:
    """Return a name of another program as HDF5 can hold it: no part of its path is empty."""
    parts = _text(name).split("/")
    return "/".join(part for part in parts if part not in ("", ".")) or _UNNAMED


def _text(item: object) -> str:
    """Return a text as HDF5 can hold it."""
    return str(item).replace("\0", "")

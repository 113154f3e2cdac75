"""A small file that claims, or unpacks to, very much is refused before it takes memory or time."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import lz4.frame
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
import zstandard
from asammdf import MDF, Signal

from rigd.importing import import_files, parse_map
from rigd.model import ConfigError

MIB = 1 << 20
MAP = """\
map: m
rig: r
started: 2016-03-04T10:00:00Z
sources:
  s:
    time: {rate: 1 kHz}
    channels:
      force: {column: F, unit: N}
"""
TEXTS = f"{MAP}trials: {{columns: kind}}\n"
DZ = struct.Struct("<8sQQ2sBBIQQ")


def packed(mib: int) -> bytes:
    return zlib.compress(bytes(mib * MIB), 9)


def hdf5_rows(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("F", (10**12,), "f8", chunks=(1 << 15,))


def matlab_rows(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("F", (1, 10**12), "f8", chunks=(1, 1 << 15))
    with path.open("r+b") as head:
        head.write(b"MATLAB 7.3 MAT-file")


def hdf5_chunk(path: Path) -> None:
    with h5py.File(path, "w") as file:
        data = file.create_dataset("F", (MIB,), "f8", chunks=(MIB,), compression="gzip")
        data.id.write_direct_chunk((0,), packed(8))


def matlab_compressed(path: Path) -> None:
    """Compressed in one piece, as MATLAB does; scipy writes no such zeros of its own."""
    scipy.io.savemat(path, {"F": np.zeros(20 * MIB // 8)}, do_compression=True)


def npz(path: Path) -> None:
    np.savez_compressed(path, F=np.zeros(20 * MIB // 8))


def npz_head(path: Path) -> None:
    """The head of the array claims 10^6 numbers, behind it is none."""
    with zipfile.ZipFile(path, "w") as file, file.open("F.npy", "w") as member:
        head = {"descr": "<f8", "fortran_order": False, "shape": (10**6,)}
        np.lib.format.write_array_header_1_0(member, head)


def mf4(path: Path, stated: int, data: bytes, kind: int = 0) -> None:
    times = np.arange(2000) * 1e-3
    with MDF() as file:
        file.append([Signal(np.zeros(2000), times, unit="N", name="F")])
        file.save(path, compression=2, overwrite=True)
    content = bytearray(path.read_bytes())
    at = content.index(b"##DZ")
    content += bytes(-len(content) % 8)
    begin, end = content.index(struct.pack("<Q", at)), len(content)
    content[begin : begin + 8] = struct.pack("<Q", end)
    head = b"##DZ\0\0\0\0", DZ.size + len(data), 0, b"DT", kind, 0, 0, stated, len(data)
    path.write_bytes(content + DZ.pack(*head) + data)


def parquet_rows(path: Path) -> None:
    pq.write_table(pa.table({"F": np.zeros(4 * MIB)}), path, compression="zstd")


def parquet_texts(path: Path) -> None:
    texts = pa.array(["x" * 10_000] * 500)
    pq.write_table(pa.table({"F": np.zeros(500), "kind": texts}), path)


def parquet_page(path: Path) -> None:
    """The footer states 8,000 rows; the page of them has 2 million."""
    parts = []
    for values in (np.zeros(2 * MIB), np.random.default_rng(1).random(8000)):
        sizes = {"data_page_size": 1 << 30, "row_group_size": 1 << 30, "max_rows_per_page": 1 << 30}
        pq.write_table(
            pa.table({"F": values}), path, compression="zstd", use_dictionary=False,
            write_statistics=False, write_batch_size=1 << 30, **sizes,
        )  # fmt: skip
        content = path.read_bytes()
        length = struct.unpack("<I", content[-8:-4])[0] + 8
        parts.append((content[:-length], content[-length:]))
    (pages, _), (honest, footer) = parts
    path.write_bytes(pages.ljust(len(honest), b"\0") + footer)


def csv_line(path: Path) -> None:
    path.write_bytes(b"F\n" + b"1" * 9 * MIB + b"\n")


def csv_head(path: Path) -> None:
    path.write_bytes(b"F," * 60_000 + b"x\n")


def csv_cell(path: Path) -> None:
    path.write_bytes(b"F\n1\n" + b"x" * 200_000 + b"\n")


Make = Callable[[Path], None]
#: Each with what the refusal says; the bounds are those of 1 MiB in place of 64.
LYING = "does not unpack to the 32000 bytes that"
BOMBS: dict[str, tuple[Make, str]] = {
    "rows.h5": (hdf5_rows, "1000000000000 rows of 1 columns, with more than 1000 times the bytes"),
    "rows.mat": (matlab_rows, "1000000000000 rows of 1 columns"),
    "chunk.h5": (hdf5_chunk, "chunks of the dataset 'F' of 8388608 bytes, more than the 1 MiB"),
    "zlib.mat": (matlab_compressed, "arrays of more than 16777216 bytes"),
    "zip.npz": (npz, "arrays of more than 16777216 bytes"),
    "head.npz": (npz_head, "F.npy ends before its array"),
    "honest.mf4": (
        lambda path: mf4(path, 8 * MIB, packed(8)),
        "of 8388608 bytes, more than the 1 MiB",
    ),
    "lying.mf4": (lambda path: mf4(path, 32_000, packed(8)), LYING),
    "zstd.mf4": (lambda path: mf4(path, 32_000, zstandard.compress(bytes(8 * MIB)), 2), LYING),
    "lz4.mf4": (lambda path: mf4(path, 32_000, lz4.frame.compress(bytes(8 * MIB)), 4), LYING),
    "lz4_unstated.mf4": (
        lambda path: mf4(path, 32_000, lz4.frame.compress(bytes(8 * MIB), store_size=False), 5),
        LYING,
    ),
    "rows.parquet": (parquet_rows, "4194304 rows of 1 columns"),
    "page.parquet": (parquet_page, "a page at byte 4 of 16777225 bytes, more than the 1 MiB"),
    "texts.parquet": (parquet_texts, "texts of 500 rows of 5000000 bytes, more than the 1 MiB"),
    "line.csv": (csv_line, "line.csv:2:1: the line has more than"),
    "head.csv": (csv_head, "the array 'line 1' has 60001 columns, more than the 50000"),
    "cell.csv": (csv_cell, "is no number|no row of a table"),
}


@pytest.mark.parametrize("name", BOMBS)
def test_small_file_that_claims_much_is_refused(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIGD_CHUNK_MIB", "1")
    make, says = BOMBS[name]
    make(tmp_path / name)
    what = parse_map(TEXTS if name == "texts.parquet" else MAP, Path("map.yaml"))
    with pytest.raises(ConfigError, match=says) as refused:
        import_files(what, [tmp_path / name], tmp_path / "runs")
    assert name in str(refused.value)
    assert not [*(tmp_path / "runs").iterdir()]

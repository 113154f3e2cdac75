"""Attached files: read one at a time, and never written outside of a folder."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import h5py
import pytest

from rigd.cli.main import main
from rigd.model import RecordingError
from rigd.record import Recording
from rigd.record.export import export
from rigd.record.mcap.wire import FRAME, MAGIC
from rigd.record.read.attachments import file_names

#: Names that a recording of anybody may have, and where they go.
NAMES = {
    "rig.yaml": "rig.yaml",
    "models/a.onnx": "models/a.onnx",
    "..": "unnamed",
    ".": "2-unnamed",
    "": "3-unnamed",
    "/": "4-unnamed",
    "../../outside.txt": "outside.txt",
    "/outside.txt": "2-outside.txt",
    "a/../../outside.txt": "3-outside.txt",
    "sub/..": "sub",
    "Rig.yaml": "2-Rig.yaml",
    "rig.yaml/x": "2-x",
    "models": "2-models",
    "x\0y": "x_y",
    "a\nb": "a_b",
    "\u202ecba.txt": "_cba.txt",
    "C:\\outside.txt": "C__outside.txt",
    "CON": "_CON",
    "dots... ": "dots",
    "-rf": "-rf",
    "n" * 300: "n" * 200,
}


def text(value: str) -> bytes:
    return struct.pack("<I", len(value.encode())) + value.encode()


def record(opcode: int, content: bytes) -> bytes:
    return FRAME.pack(opcode, len(content)) + content


def attachment(name: str, data: bytes) -> bytes:
    head = struct.pack("<QQ", 1, 1) + text(name) + text("text/plain")
    content = head + struct.pack("<Q", len(data)) + data
    return record(9, content + struct.pack("<I", zlib.crc32(content)))


@pytest.fixture
def theirs(tmp_path: Path) -> Path:
    path = tmp_path / "theirs.mcap"
    ending = record(15, bytes(4)) + record(2, bytes(20)) + MAGIC
    attached = b"".join(attachment(name, name.encode()) for name in NAMES)
    path.write_bytes(MAGIC + record(1, text("") + text("another")) + attached + ending)
    return path


def test_every_name_gets_place_in_folder() -> None:
    assert {name: str(path) for name, path in file_names(NAMES).items()} == NAMES


def test_info_writes_no_file_outside_of_folder(
    theirs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "a" / "b" / "files"
    assert main(["info", str(theirs), "--attachments", str(folder)]) == 0
    written = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert written == set(NAMES.values())
    assert [*tmp_path.rglob("*outside*")] == [*folder.glob("*outside*")]
    for name, place in NAMES.items():
        assert (folder / place).read_bytes() == name.encode()
    said = capsys.readouterr().out
    assert f"wrote {folder}/outside.txt, which is named '../../outside.txt'" in said
    assert not [letter for letter in said if not letter.isprintable() and letter != "\n"]


def test_attachment_is_not_written_through_link(theirs: Path, tmp_path: Path) -> None:
    folder, outside = tmp_path / "files", tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "unnamed").symlink_to(outside)
    assert main(["info", str(theirs), "--attachments", str(folder)]) == 7
    assert not outside.exists()
    assert [path.name for path in folder.iterdir()] == ["unnamed"]


def test_hdf5_holds_attachments_of_any_name(theirs: Path, tmp_path: Path) -> None:
    (path,) = export(Recording.open(theirs), tmp_path / "out", "hdf5")
    with h5py.File(path) as file:
        assert len(file["attachments"]) == len(NAMES)


def test_damaged_attachment_costs_no_other(theirs: Path) -> None:
    data = bytearray(theirs.read_bytes())
    at = data.index(b"rig.yaml", data.index(b"rig.yaml") + 1)  # the content, not the name
    theirs_open = Recording.open(theirs)
    data[at] ^= 1
    theirs.write_bytes(data)
    assert theirs_open.attachments["-rf"].data == b"-rf"
    assert len(theirs_open.attachments) == len(NAMES)
    with pytest.raises(RecordingError, match=r"the CRC of attachment 'rig.yaml' differs"):
        theirs_open.attachments["rig.yaml"]

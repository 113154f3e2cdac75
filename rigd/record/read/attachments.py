"""Reads the files that are attached to a recording; one may be larger than the memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Final

from mcap.opcode import Opcode
from mcap.records import AttachmentIndex

from rigd.model import RecordingError
from rigd.model.machine.system import read_at
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.prefix import Attachment
from rigd.record.mcap.wire import FRAME, Malformed, decode_attachment_head
from rigd.record.read.index import bytes_at, opened

_CRC_BYTES: Final = 4
#: What no name of a file has on some system, beside letters that cannot be printed.
_NOT_IN_NAMES: Final = frozenset('\\:*?"<>|')
#: File systems have names of up to 255 bytes.
_NAME_BYTES: Final = 200


class Attachments(Mapping[str, Attachment]):
    """The attached files by name, each read when it is asked for; the last of a name counts.

    What reads one raises a RecordingError if it is damaged.
    """

    def __init__(
        self,
        path: Path,
        indexes: Sequence[AttachmentIndex],
        damaged: Callable[[object], RecordingError],
    ) -> None:
        """Name those of a file; ``damaged`` makes the error of one that cannot be read."""
        self._path = path
        self._indexes = {index.name: index for index in indexes}
        self._damaged = damaged

    def __getitem__(self, name: str) -> Attachment:
        """Return a file."""
        index = self._indexes[name]
        with opened(self._path) as fd:
            try:
                return _read(fd, index)
            except Malformed as error:
                raise self._damaged(error) from error

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(self._indexes)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._indexes)


def _read(fd: int, index: AttachmentIndex) -> Attachment:
    """Return a file whose bytes are held once."""
    size = index.length - index.data_size - _CRC_BYTES
    head = bytes_at(fd, index.offset, max(size, FRAME.size))
    opcode, length = FRAME.unpack_from(head)
    found, begin = decode_attachment_head(head[FRAME.size :])
    stated = opcode, FRAME.size + length, FRAME.size + begin, found.data_size
    if stated != (Opcode.ATTACHMENT, index.length, size, index.data_size):
        raise Malformed(f"the record at byte {index.offset} does not agree with its index")
    end = bytes_at(fd, index.offset + index.length - _CRC_BYTES, _CRC_BYTES)
    data, crc = read_at(fd, index.data_size, index.offset + size), int.from_bytes(end, "little")
    if crc and crc32(data, crc32(head[FRAME.size :])) != crc:
        raise Malformed(f"the CRC of attachment {index.name!r} differs")
    return Attachment(found.name, found.media_type, data)


def file_names(names: Iterable[str]) -> dict[str, PurePosixPath]:
    """Return where each attached file goes below a folder, by its name in the recording.

    The name comes from the recording, which may be of anybody: no path leads out of the folder,
    every system can have it, and no two are the same. A plain relative path stays as it is.
    """
    found: dict[str, PurePosixPath] = {}
    files: set[str] = set()
    folders: set[str] = set()
    for name in dict.fromkeys(names):
        parts = name.split("/")
        kept = [part for part in parts if part not in ("", ".", "..")]
        if len(kept) < len(parts):
            kept = kept[-1:]
        path = PurePosixPath(*map(_portable, kept or [""]))
        number, own = 1, path.name
        while _keys(path)[0] in files | folders or not files.isdisjoint(_keys(path)):
            number += 1
            path = PurePosixPath(f"{number}-{own}")
        key, *parents = _keys(path)
        files.add(key)
        folders.update(parents)
        found[name] = path
    return found


def _keys(path: PurePosixPath) -> list[str]:
    """Return the path and the folders that it is in, as systems that know no case compare them."""
    return [str(part).casefold() for part in (path, *path.parents[:-1])]


def _portable(part: str) -> str:
    """Return a part of a path as every system can have it."""
    text = "".join(
        letter if letter.isprintable() and letter not in _NOT_IN_NAMES else "_" for letter in part
    )
    text = text.encode()[:_NAME_BYTES].decode(errors="ignore").rstrip(". ") or "unnamed"
    return f"_{text}" if PureWindowsPath(text).is_reserved() else text

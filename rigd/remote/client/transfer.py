"""Fetches files from a daemon in pieces, resumes interrupted transfers, and verifies the digest."""

from __future__ import annotations

import asyncio
import hashlib
import os
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import IO

from rigd.model.errors import RecordingError
from rigd.remote.protocol.results import PieceView

#: ``ask(offset)`` returns the piece of the file that begins there, as long as it may be.
AskPiece = Callable[[int], Awaitable[PieceView]]
#: ``progress(done, size)`` in bytes.
Progress = Callable[[int, int], None]


async def fetch(ask: AskPiece, path: Path, progress: Progress | None = None) -> Path:
    """Fetch a file to ``path``, and return that.

    Received data are stored beside it under a name with the file's digest; an interrupted transfer
    continues with them. Only the complete file gets the name ``path``; an existing file with the
    same content stays.

    Raises:
        RecordingError: another file has that name, the file changes during the transfer, its
            digest is wrong, or it cannot be written.
        RigdError: as ``ask`` raises.
    """
    first = await ask(0)
    if path.exists():
        if await asyncio.to_thread(digest_of, path) == first.sha256:
            return path
        raise RecordingError(
            f"{path} exists, and is another file", hint="move it away, or fetch to another folder"
        )
    part = path.with_name(f".{path.name}.{first.sha256[:16]}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("ab") as file:
            await _append(ask, first, file, progress)
            file.flush()
            os.fsync(file.fileno())
        digest = await asyncio.to_thread(digest_of, part)
        if digest != first.sha256:
            part.unlink()
            raise RecordingError(
                f"{path.name} arrived with the SHA-256 {digest[:16]}..., expected "
                f"{first.sha256[:16]}...",
                hint="fetch it again",
            )
        part.replace(path)
    except OSError as error:
        raise RecordingError(f"{path} cannot be written: {error.strerror}") from error
    return path


async def _append(
    ask: AskPiece, first: PieceView, file: IO[bytes], progress: Progress | None
) -> None:
    """Bring ``file`` to its full size."""
    done = file.tell()
    while done < first.size:
        piece = first if done == 0 else await ask(done)
        if piece.sha256 != first.sha256:
            raise RecordingError(
                "the file changes while it is fetched", hint="wait until it is complete"
            )
        if piece.offset != done or not 0 < len(piece.data) <= first.size - done:
            raise RecordingError(
                f"the daemon sent {len(piece.data)} bytes from {piece.offset}, expected some of "
                f"{first.size - done} from {done}"
            )
        file.write(piece.data)
        done += len(piece.data)
        if progress is not None:
            progress(done, first.size)


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file, as hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

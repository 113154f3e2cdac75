"""Files fetched in pieces."""

from __future__ import annotations

import asyncio
import hashlib
from base64 import b64encode
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from rigd.model.errors import LinkError, RecordingError
from rigd.remote.client.transfer import fetch
from rigd.remote.protocol.results import PieceView

WHOLE = bytes(range(250)) * 40
PIECE = 1024


@dataclass
class Source:
    """Gives pieces of a file; some go wrong."""

    whole: bytes = WHOLE
    said: str = hashlib.sha256(WHOLE).hexdigest()
    breaks_at: int | None = None
    asked: list[int] = field(default_factory=list)

    async def piece(self, offset: int) -> PieceView:
        self.asked.append(offset)
        if self.breaks_at is not None and offset >= self.breaks_at:
            raise LinkError("the cable fell out")
        data = b64encode(self.whole[offset : offset + PIECE])
        return PieceView(size=len(self.whole), sha256=self.said, offset=offset, data=data)

    def fetch(self, path: Path) -> Path:
        return asyncio.run(fetch(self.piece, path))


def test_file_comes_whole_and_leaves_nothing_beside_it(tmp_path: Path) -> None:
    path = Source().fetch(tmp_path / "deep" / "a.mcap")
    assert path.read_bytes() == WHOLE
    assert [item.name for item in path.parent.iterdir()] == ["a.mcap"]


def test_an_empty_file_comes_too(tmp_path: Path) -> None:
    nothing = Source(b"", hashlib.sha256(b"").hexdigest())
    assert nothing.fetch(tmp_path / "a.mcap").read_bytes() == b""


def test_broken_transfer_continues_at_its_byte(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    broken = Source(breaks_at=3 * PIECE)
    with pytest.raises(LinkError):
        broken.fetch(path)
    assert not path.exists()
    again = Source()
    again.fetch(path)
    assert path.read_bytes() == WHOLE
    assert again.asked[:2] == [0, 3 * PIECE]  # the first shows whether it is still that file


def test_other_file_of_same_name_restarts_the_transfer(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with pytest.raises(LinkError):
        Source(breaks_at=3 * PIECE).fetch(path)
    other = WHOLE[::-1]
    Source(other, hashlib.sha256(other).hexdigest()).fetch(path)
    assert path.read_bytes() == other


def test_existing_file_is_not_fetched_again(tmp_path: Path) -> None:
    path = Source().fetch(tmp_path / "a.mcap")
    again = Source()
    assert again.fetch(path) == path
    assert again.asked == [0]


def test_other_local_file_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("mine")
    with pytest.raises(RecordingError, match="exists, and is another file"):
        Source().fetch(path)
    assert path.read_text() == "mine"


def test_transfer_with_errors_gets_no_name(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    flipped = WHOLE[:5000] + b"X" + WHOLE[5001:]
    with pytest.raises(RecordingError, match="arrived with the SHA-256"):
        Source(flipped).fetch(path)
    assert list(tmp_path.iterdir()) == []


def test_file_that_changes_meanwhile_is_reported(tmp_path: Path) -> None:
    source = Source()

    async def changing(offset: int) -> PieceView:
        if offset:
            source.said = "0" * 64
        return await source.piece(offset)

    with pytest.raises(RecordingError, match="changes while it is fetched"):
        asyncio.run(fetch(changing, tmp_path / "a.mcap"))


def test_daemon_sending_other_bytes_is_reported(tmp_path: Path) -> None:
    async def stuck(offset: int) -> PieceView:
        return await Source().piece(0)

    with pytest.raises(RecordingError, match="sent 1024 bytes from 0, expected some"):
        asyncio.run(fetch(stuck, tmp_path / "a.mcap"))

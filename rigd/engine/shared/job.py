"""Reads and writes the job file, from which the recorder starts or restarts at any time."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rigd.model.channels import Stream
from rigd.model.errors import RecordingError
from rigd.record import Attachment
from rigd.record.mcap.compression import Compression
from rigd.record.mcap.schema import stream_from_json, stream_to_json


@dataclass(frozen=True)
class Job:
    """Describes the recording that the recorder makes.

    ``resume``: the file exists, and is continued. ``start_ns`` is Unix time.
    """

    rig: str
    recording: Path
    streams: tuple[Stream, ...]
    start_ns: int
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: tuple[Attachment, ...] = ()
    compression: Compression = "zstd"
    resume: bool = False

    def to_json(self) -> str:
        """Return the job as text."""
        return json.dumps(
            {
                "rig": self.rig,
                "recording": str(self.recording.absolute()),
                "streams": [json.loads(stream_to_json(stream)) for stream in self.streams],
                "start_ns": self.start_ns,
                "metadata": {name: dict(values) for name, values in self.metadata.items()},
                "attachments": [
                    {
                        "name": attachment.name,
                        "media_type": attachment.media_type,
                        "data": base64.b64encode(attachment.data).decode(),
                    }
                    for attachment in self.attachments
                ],
                "compression": self.compression,
                "resume": self.resume,
            },
            indent=1,
        )

    @classmethod
    def read(cls, path: Path) -> Job:
        """Return the job in a file that contains :meth:`to_json`.

        Raises:
            RecordingError: it cannot be read, or is not a job.
        """
        try:
            content: Mapping[str, Any] = json.loads(path.read_bytes())
            return cls(
                rig=content["rig"],
                recording=Path(content["recording"]),
                streams=tuple(stream_from_json(json.dumps(item)) for item in content["streams"]),
                start_ns=int(content["start_ns"]),
                metadata=content["metadata"],
                attachments=tuple(
                    Attachment(item["name"], item["media_type"], base64.b64decode(item["data"]))
                    for item in content["attachments"]
                ),
                compression=content["compression"],
                resume=bool(content["resume"]),
            )
        except OSError as error:
            raise RecordingError(f"cannot read {path}: {error.strerror}") from error
        except (KeyError, TypeError, ValueError) as error:
            raise RecordingError(
                f"{path} is not the job of a recorder: {error!r}",
                hint="Another version of rigd made it, which can recover it; to discard "
                f"those samples, remove {path.parent}.",
            ) from error

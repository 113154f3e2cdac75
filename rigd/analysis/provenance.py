"""Collects the provenance of a report: the recordings, their metadata, the software versions."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from shlex import quote

from rigd import __version__
from rigd.analysis.heading import heading
from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.report import Facts, Provenance, ReportAttachment
from rigd.record import Recording, RunInfo


def provenance(
    sweeps: Sequence[RecordedSweep],
    trials_used: Sequence[int],
    identification: Mapping[str, str],
    further: Sequence[Mapping[str, str]] = (),
) -> Provenance:
    """Return the provenance of what was identified from ``sweeps``.

    ``trials_used`` counts those of each recording, ``further`` has more on each;
    ``identification`` is how it was done.
    """
    more = further or [{} for _ in sweeps]
    facts = [
        facts_of(
            sweep.info,
            {
                "trials used": str(used),
                **{f"corrected {item.what}": str(item) for item in sweep.corrections},
                **extra,
                "what was recorded": f"rigd report {quote(sweep.path.name)} draws it",
            },
        )
        for sweep, used, extra in zip(sweeps, trials_used, more, strict=True)
    ]
    facts.append(Facts("Identification", {"rigd": __version__, **identification}))
    recordings = [sweep.recording for sweep in sweeps]
    top = heading([sweep.info for sweep in sweeps])
    return Provenance(tuple(facts), attachments_of(recordings), top)


def facts_of(info: RunInfo, further: Mapping[str, str]) -> Facts:
    """Return the origin that a recording states, with the digest of its file."""
    return Facts(
        info.path.name,
        {
            "sha256": file_sha256(info.path),
            **{name: value for name, value in info.metadata.get("run", {}).items() if value},
            **{f"parameter {name}": value for name, value in info.parameters.items()},
            "state": info.state,
            **further,
        },
    )


def attachments_of(recordings: Sequence[Recording]) -> tuple[ReportAttachment, ...]:
    """Return each attached file once, however many recordings have it."""
    texts: dict[bytes, str] = {}
    for recording in recordings:
        for name, attachment in recording.attachments.items():
            texts.setdefault(attachment.data, name)
    return tuple(
        ReportAttachment(name, data.decode(errors="replace")) for data, name in texts.items()
    )


def file_sha256(path: Path) -> str:
    """Return the digest of the file at ``path``, which copies of it share."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()

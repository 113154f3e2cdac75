"""Says what a recording's file is in one of three words, and what a file of others lacks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from rigd.record.mcap.schema import EVENTS_TOPIC, STREAM_KEY
from rigd.record.scan.findings import Scan

#: Before this, in ns, every row is: an int64 holds no later time.
LAST_NS: Final = 2**63 - 1


class FileCondition(StrEnum):
    """What a file is; the same words stand in every list, report and JSON."""

    WHOLE = "whole"  #: rigd wrote it, and every byte is as it was written
    VALID = "valid"  #: another program wrote it, and it is valid MCAP
    DAMAGED = "damaged"  #: bytes are not what their writer wrote, or are missing
    UNCHECKED = "not checked"  #: rigd wrote it, and only its index was read


@dataclass(frozen=True)
class Foreign:
    """What is known of a file that another program wrote."""

    library: str  #: that wrote it, by its header
    lacks: tuple[str, ...]  #: what rigd would have written, in words
    unread: tuple[str, ...]  #: what rigd cannot read and keeps, in words
    doubled: Mapping[str, int]  #: messages that stand there again, by topic
    spans: Mapping[int, tuple[int, int]]  #: first and last time of each channel, ns
    late: Mapping[int, int]  #: messages of a channel whose time no int64 of ns can hold

    @classmethod
    def of(cls, found: Scan, metadata: Mapping[str, Mapping[str, str]]) -> Foreign:
        """Return what a scan has found."""
        contents = found.contents
        lacks = []
        if "run" not in metadata:
            lacks.append("its run (procedure, rig, parameters)")
        if EVENTS_TOPIC not in {channel.topic for channel in contents.channels.values()}:
            lacks.append("events, so trials and steps")
        if not any(STREAM_KEY in channel.metadata for channel in contents.channels.values()):
            lacks.append("units")
        unread = [
            *found.unread,
            *(
                f"{count} record{'' if count == 1 else 's'} of the unknown kind {opcode:#04x}"
                for opcode, count in sorted(found.unknown.items())
            ),
        ]
        spans, late = {}, {}
        for number, parts in found.times.items():
            held = [part[part < LAST_NS] for part in parts]
            if beyond := sum(map(len, parts)) - sum(map(len, held)):
                late[number] = beyond
                topic = contents.channels[number].topic
                unread.append(f"{beyond} of {topic} with times after the year 2262")
            if held := [part for part in held if len(part)]:
                spans[number] = (
                    min(int(part.min()) for part in held),
                    max(int(part.max()) for part in held),
                )
        lacking = (*lacks, *found.lacks)
        return cls(found.library, lacking, tuple(unread), found.doubled, spans, late)


def writer_of(foreign: Foreign | None) -> str:
    """Return what wrote a file, in words."""
    if foreign is None:
        return "rigd"
    return repr(foreign.library) if foreign.library else "a program that does not state its name"


def foreign_lines(foreign: Foreign | None) -> list[str]:
    """Return what is known of a file of another program, line by line."""
    if foreign is None:
        return []
    lines = [f"rigd would have added: {', '.join(foreign.lacks)}"] if foreign.lacks else []
    lines += [f"not read, and kept: {text}" for text in foreign.unread]
    twice = [f"{count} of {topic}" for topic, count in sorted(foreign.doubled.items())]
    return [*lines, f"stand there twice, and count once: {', '.join(twice)}"] if twice else lines


def foreign_json(foreign: Foreign | None) -> dict[str, object]:
    """Return the same as an object for ``json.dumps``."""
    if foreign is None:
        return {"writer": "rigd"}
    return {
        "writer": foreign.library,
        "lacks": list(foreign.lacks),
        "unread": list(foreign.unread),
        "doubled": dict(foreign.doubled),
    }

"""Scans files that other programs wrote: any valid MCAP, whatever its layout.

How rigd itself writes (:mod:`~rigd.record.write.writer`) is no law of the format: others mix
channels in a chunk or write no chunks, number messages as they like, leave out CRCs and indexes,
and add records of their own. All of that is valid. Damage is what contradicts itself, such as a
chunk whose CRC is not that of its data. Format: https://mcap.dev/spec.
"""

from __future__ import annotations

from rigd.record.scan.findings import Scan
from rigd.record.scan.others.foreign_walk import Walk

__all__ = ["scan_others"]


def scan_others(buffer: memoryview) -> Scan:
    """Scan a file of another program, up to a second recording behind it if there is one.

    Raises:
        Malformed: it is not an MCAP file: it contains no intact record.
    """
    walk = Walk(buffer)
    walk.run()
    return walk.found

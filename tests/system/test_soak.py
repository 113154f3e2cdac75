"""After any events a daemon holds what it held before; benchmarks/soak.py plays longer."""

from __future__ import annotations

from pathlib import Path

from support.faults.soaking import settled, soak, soaked


def test_rounds_leave_no_descriptor_and_no_thread(tmp_path: Path) -> None:
    with soaked(tmp_path) as daemon:
        for _ in range(2):  # what is made once, at first use
            soak(daemon, unauthenticated=20, clients=1, flood_s=0.3)
        before = settled(daemon)
        for _ in range(3):
            soak(daemon, unauthenticated=20, clients=1, flood_s=0.3)
        after = settled(daemon, before)
    assert (after.descriptors, after.threads) == (before.descriptors, before.threads)

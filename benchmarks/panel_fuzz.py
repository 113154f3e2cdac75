"""Random and spoilt requests on every door of the panel: what they change, and its memory.

A panel before a rig that is played, and its clients, are in one process: what either of them
kept of a request would show. The user who has control sends them, so that a request is refused for
its content alone; the rates that keep a flood out are taken away.

    python benchmarks/panel_fuzz.py --requests 1000 --rounds 4
"""

from __future__ import annotations

import argparse
import random
import statistics
import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import pytest
from figures import at_most, noted
from remote_fuzz import resident_mb
from support.panel.served import ServedPanel
from support.panel.wild import DOORS, in_control, let_a_flood_through, send_wild


def main() -> None:
    """Send everything, and report what became of it."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--requests", type=int, default=1000, help="to each door in a round")
    parser.add_argument("--rounds", type=int, default=4)
    args = parser.parse_args()
    rng = random.Random()
    codes: Counter[int] = Counter()
    sizes_mb: list[float] = []
    changed, begun_s = 0, time.monotonic()
    with pytest.MonkeyPatch.context() as patch, ServedPanel() as panel:
        let_a_flood_through(patch)
        host = panel.visitor()
        for method, known in args.rounds * DOORS:
            with in_control(panel, host) as visitor:
                before = panel.rig.changes
                for _ in range(args.requests):
                    codes[send_wild(rng, visitor, method, known)[0]] += 1
                changed += panel.rig.changes - before
            sizes_mb.append(resident_mb())
        took_s = time.monotonic() - begun_s
        unheard = int(host.get("/api/session")[0] != 200)
    print(f"answers: {dict(sorted(codes.items()))}")
    noted("panel: spoilt requests sent", codes.total(), "")
    noted("panel: sent per second", codes.total() / took_s, "/s")
    at_most("panel: answered by a fault", sum(n for code, n in codes.items() if code >= 500), 0, "")
    at_most("panel: changes of the rig by them", changed, 0, "")
    at_most("panel: good requests refused after them", unheard, 0, "")
    settled_mb = statistics.median(sizes_mb[: len(sizes_mb) // 4])
    noted("panel: memory of panel and asker", sizes_mb[-1], "MB")
    growth_mb = sizes_mb[-1] - settled_mb
    at_most("panel: its growth over the last three quarters", growth_mb, 5, "MB")


if __name__ == "__main__":
    main()

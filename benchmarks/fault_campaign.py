"""Every fault of every simulated device, shown to a run that moves the rig: what did rigd do?

Prints by what and how fast each was detected, when the drives were safe, and what the operator was
told; fails where that is not what must happen (``tests/support/faults/table.py``). Most rigs are
the shipped ones at the wire (``tests/support/faults/rigs.py``).

    python benchmarks/fault_campaign.py --table faults.jsonl
                        continues the table: stop it and start it as you like
    python benchmarks/fault_campaign.py --only scale
                        cases whose name holds the word
    python benchmarks/fault_campaign.py --foreign 1000
                        other devices send so many frames per second on each CAN bus meanwhile; the
                        rigs without a CAN bus are left out
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from figures import at_most, noted

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.can.foreign import foreign_traffic
from support.faults.campaign import Campaign, Outcome, verdict
from support.faults.killing import heed_ctrl_c
from support.faults.rigs import RIGS, every_case, kind_of
from support.faults.table import Case

Row = dict[str, Any]


def play(missing: list[Case], table: Path | None, foreign_hz: float) -> list[Row]:
    """Play what is missing from the table, and return and append what became of it.

    ``foreign_hz`` frames per second of other devices are on each CAN bus meanwhile.
    """
    rows: list[Row] = []

    def report(case: Case, outcome: Outcome) -> None:
        wrong = verdict(case, outcome)
        row = {"name": case.name, **asdict(outcome)}
        rows.append(row)
        if table is not None:
            with table.open("a") as file:
                file.write(json.dumps(row) + "\n")
        print(f"{len(rows)}/{len(missing)} {case.name}: {'; '.join(wrong) or 'ok'}", flush=True)

    for name, rig in RIGS.items():
        left = [case for case in missing if case.rig == name]
        while left:
            with (
                tempfile.TemporaryDirectory() as folder,
                rig.served(Path(folder)) as served,
                foreign_traffic(buses := sorted(served.folder.glob("*_bus")), foreign_hz),
            ):
                if foreign_hz and not buses:
                    break
                campaign = Campaign(
                    served, Path(folder), report, rig.movement, rig.set_up, rig.by_hand
                )
                while left:
                    case = left.pop(0)
                    campaign.play(case)
                    if case.spoils:
                        break
                campaign.finish()
    return rows


def show(rows: list[Row]) -> bool:
    """Print the table; return whether all is as it must be."""
    print(f"{'fault':<48} {'must':<6} {'detected by':<13} {'ms':>6} {'safe ms':>8}  told")
    known = {item.name: item for item in every_case()}
    failed = 0
    rows = [row for row in rows if row["name"] in known]
    for row in sorted(rows, key=lambda item: str(item["name"])):
        outcome = _outcome(row)
        case = known[row["name"]]
        print(
            f"{case.name:<48} {case.must.value:<6} {outcome.detected_by:<13}"
            f" {_ms(outcome.detected_s):>6} {_ms(outcome.safe_s):>8}  {outcome.told}"
        )
        wrong = verdict(case, outcome)
        failed += bool(wrong)
        for item in wrong:
            print(f"{'':<48} WRONG: {item}")
    noted("fault campaign, faults", len(rows), "")
    at_most("fault campaign, not as they must be", failed, 0, "faults")
    return not failed


def markdown(rows: list[Row]) -> Iterator[str]:
    """Yield the table as it stands in docs/faults.md: the worst of devices of the same kind."""
    known = {case.name: case for case in every_case()}
    alike: dict[tuple[str, str, str], list[Outcome]] = defaultdict(list)
    for row in rows:
        if row["name"] in known:
            alike[_described(known[row["name"]])].append(_outcome(row))
    yield "| device | fault | the run must | seen by | after, ms | safe after, ms |"
    yield "|---|---|---|---|---|---|"
    for described, found in sorted(alike.items()):
        by = ", ".join(sorted({item.detected_by for item in found}))
        seen = max((item.detected_s for item in found if item.detected_s is not None), default=None)
        safe = max((item.safe_s for item in found if item.safe_s is not None), default=None)
        refused = any(item.detected_by == "refused" for item in found)
        after = "" if refused else _ms(seen)
        yield f"| {' | '.join(described)} | {by} | {after} | {_ms(safe)} |"


def _described(case: Case) -> tuple[str, str, str]:
    options = ", ".join(f"{key}={value}" for key, value in case.options.items())
    what = f"`{case.fault}`" + (f" {options}" if options else "")
    return kind_of(case), what, case.must.value


def _outcome(row: Row) -> Outcome:
    return Outcome(**{name: value for name, value in row.items() if name != "name"})


def _ms(seconds: float | None) -> str:
    return "" if seconds is None else f"{1e3 * seconds:.0f}"


def main() -> int:
    """Play the cases that the table has not, then print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--table", type=Path, default=None, help="file of what is done already")
    parser.add_argument("--only", default="", metavar="WORD", help="cases whose name holds it")
    parser.add_argument("--foreign", type=float, default=0.0, metavar="HZ", help="on each CAN bus")
    parser.add_argument("--markdown", action="store_true", help="print the table so, play nothing")
    args = parser.parse_args()
    heed_ctrl_c()
    rows: list[Row] = []
    if args.table is not None and args.table.exists():
        rows = [json.loads(line) for line in args.table.read_text().splitlines()]
    if args.markdown:
        print(*markdown(rows), sep="\n")
        return 0
    done = {row["name"] for row in rows}
    missing = [case for case in every_case() if args.only in case.name and case.name not in done]
    rows += play(missing, args.table, args.foreign)
    return 0 if show(rows) else 1


if __name__ == "__main__":
    sys.exit(main())

"""Puts mistakes into packages as `rigd new` and authors write them, and counts those found.

Each mutant is a driver, plant or analysis as written, with one replacement of text
(`tests/sdk/mutants/known`). It is caught if check_driver, check_plant or check_analysis finds it by
the rule that it names, or by the sequences, which come before and end the examination. The package
as written must pass them all.

    python benchmarks/conformance.py                 all mutants of all kinds
    python benchmarks/conformance.py fast "trip swallowed"
    python benchmarks/conformance.py --fresh third [KIND]  those of the third author

Four authors (first, second, third, fourth) wrote fresh mutants without a look at the suites
(`tests/sdk/mutants/fresh`), the fourth of drivers only. These name no rule: one is caught if
the suite finds anything. The seconds are those of the processor. Some do what rigd allows: these
are not counted.
"""

from __future__ import annotations

import argparse
import re
import resource
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from figures import at_least, at_most

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from sdk.mutants.fresh import Fresh
from sdk.mutants.fresh.kinds import AUTHORS
from sdk.mutants.known import Mistake, made
from sdk.mutants.known.kinds import KINDS

#: The rule that plays sequences of calls.
SEQUENCES = "any order of calls"


def rules_of(kind: str, mutant: Mistake | None, only: tuple[str, ...] = ()) -> list[str]:
    """Return the rules that a mutant breaks, each once, in the order of the suite."""
    with tempfile.TemporaryDirectory() as folder, made(kind, mutant, Path(folder)) as package:
        report = package.examine(only)
    # A rule for analyses is applied to each of its cases: "recovers the truth (case 2)".
    return list(dict.fromkeys(re.sub(r" \(case \d+\)$", "", item.rule) for item in report.findings))


def main() -> int:
    """Examine the mutants and print which rules find each."""
    parser = argparse.ArgumentParser(description=__doc__)
    kinds = tuple(dict.fromkeys((*KINDS, *AUTHORS["first"])))
    parser.add_argument("kind", nargs="?", choices=kinds, help="of one kind only")
    parser.add_argument("name", nargs="*", help="mutants of this name only")
    parser.add_argument("--own-rule", action="store_true", help="apply only the rule it names")
    parser.add_argument("--fresh", choices=AUTHORS, help="those of an author, which name no rule")
    args = parser.parse_args()
    if args.fresh:
        fresh = AUTHORS[args.fresh]
        if args.kind and args.kind not in fresh:
            parser.error(f"the {args.fresh} author wrote none of kind {args.kind}")
        return examine_fresh(fresh, [args.kind] if args.kind else list(fresh), args.name)
    sums = []
    missed, unfit = 0, 0
    for kind in [args.kind] if args.kind else KINDS:
        began = time.monotonic()
        if broken := rules_of(kind, None):
            unfit += 1
            print(f"{kind}, as written: breaks {', '.join(broken)}", flush=True)
        caught = 0
        mutants = [each for each in KINDS[kind] if not args.name or each.name in args.name]
        for mutant in mutants:
            broken = rules_of(kind, mutant, (mutant.rule,) if args.own_rule else ())
            found = not {mutant.rule, SEQUENCES}.isdisjoint(broken)
            caught += found
            others = ", ".join(rule for rule in broken if rule != mutant.rule)
            verdict = mutant.rule if found else f"NOT by {mutant.rule}"
            print(f"{kind:<8} {mutant.name:<34} {verdict:<28} {others}", flush=True)
        missed += len(mutants) - caught
        sums.append((kind, caught, len(mutants), time.monotonic() - began))
    print(f"\n{'kind':<8} {'caught':>7} {'of':>4} {'s':>6}")
    for kind, caught, count, took_s in sums:
        print(f"{kind:<8} {caught:>7} {count:>4} {took_s:>6.0f}")
    total = sum(count for _, _, count, _ in sums)
    if total:
        share = 100 * (total - missed) / total
        at_least("conformance, mutants caught by the rule they break", share, 95, "%")
    at_most("conformance, packages as written that break a rule", unfit, 0, "packages")
    return int(bool(unfit) or missed > 0.05 * total)


def examine_fresh(fresh: Mapping[str, Sequence[Fresh]], kinds: list[str], names: list[str]) -> int:
    """Print which rules find each fresh mutant, and how many of a kind are found."""
    sums = []
    unfit = 0
    for kind in kinds:
        if as_written := rules_of(kind, None):
            unfit += 1
            print(f"{kind}, as written: breaks {', '.join(as_written)}", flush=True)
        mutants = [each for each in fresh[kind] if not names or each.name in names]
        began, caught = cpu_s(), 0
        count = sum(not each.allowed for each in mutants)
        for mutant in mutants:
            began_s = cpu_s()
            broken = [rule for rule in rules_of(kind, mutant) if rule not in as_written]
            caught += bool(broken) and not mutant.allowed
            missed = f"allowed: {mutant.allowed}" if mutant.allowed else f"MISSED: {mutant.harm}"
            verdict = ", ".join(broken) or missed
            print(f"{kind:<8} {cpu_s() - began_s:>5.1f} {mutant.name:<58} {verdict}", flush=True)
        sums.append((kind, caught, count, cpu_s() - began))
    print(f"\n{'kind':<8} {'caught':>7} {'of':>4} {'CPU s each':>10}")
    for kind, caught, count, took_s in sums:
        print(f"{kind:<8} {caught:>7} {count:>4} {took_s / max(count, 1):>10.1f}")
    caught, count = sum(each[1] for each in sums), sum(each[2] for each in sums)
    if len(kinds) == len(fresh) and not names:  # 57 of 60
        at_least("conformance, fresh mutants caught", 100 * caught / count, 95, "%")
    most_s = max((took_s / count for _, _, count, took_s in sums if count), default=0.0)
    at_most("conformance, processor time of an examination", most_s, 30, "s")
    return int(bool(unfit) or caught < 0.95 * count)


def cpu_s() -> float:
    """Return the seconds that the processor has worked for this process and its children."""
    ours, theirs = (resource.getrusage(who) for who in _WHOSE)
    return ours.ru_utime + ours.ru_stime + theirs.ru_utime + theirs.ru_stime


_WHOSE = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)


if __name__ == "__main__":
    sys.exit(main())

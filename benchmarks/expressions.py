"""Compares how expressions are read with Python's arithmetic, and with an older rigd.

Random expressions (`tests/support/expression_draws.py`), half of them with `${names}` as procedures
have them, half with channels as derived channels have them: value, dimension and whether it is
refused. `--old COMMIT` also reads them, and as many searches, with that commit of this repository
(one before `rigd.language`, such as 2cdfcef5), and shows what it reads in another way.

    python benchmarks/expressions.py --count 100000 --old 2cdfcef5
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from random import Random

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from support.expression_draws import NAMES, Drawn, Refused, draw, value_of

ROOT = Path(__file__).resolve().parents[1]
#: Reads a line of JSON (text, is it a formula) each, with the rigd that it is started with.
READER = """
import json, sqlite3, sys
from rigd.catalogue import parse_where
from rigd.catalogue.statement import statement_of
from rigd.model import ConfigError
from rigd.model.units import parse_unit
from rigd.procedure.expression import parse_expression
names = json.loads(sys.argv[1])
try:
    from rigd.language.number import Number
    from rigd.computed.derived.graph import Builder
    from rigd.computed.derived.formula import read_formula
    def formula(text):
        found = lambda name, offset: scope[name.removeprefix("a.")]
        number = read_formula(text, Builder(1e-3), found)
        return number.value, number.dimension
except ImportError:
    from rigd.procedure.expression import Number
    from rigd.computed.derived.graph import Builder
    from rigd.computed.derived.formula import read_formula
    OPS = {2: lambda x, y: x + y, 3: lambda x, y: x - y, 4: lambda x, y: x * y}
    def formula(text):
        builder = Builder()
        def found(name, offset):
            number = scope[name.removeprefix("a.")]
            return builder.constant(number.value, number.dimension)
        term = read_formula(text, builder, found, 1e-3)
        return at(builder, term.row), term.dimension
    def at(builder, row):
        import math
        item = builder.rows[row]
        if item.op == 0:
            return builder.parameters[item.parameter]
        x, y = (at(builder, place) if place < row else 0.0 for place in (item.a, item.b))
        if math.isnan(x) or math.isnan(y):
            return math.nan
        made = {2: lambda: x + y, 3: lambda: x - y, 4: lambda: x * y,
                5: lambda: x / y if y else math.nan, 6: lambda: -x, 7: lambda: abs(x),
                8: lambda: math.sqrt(x) if x >= 0 else math.nan, 9: lambda: math.sin(x),
                12: lambda: math.atan2(x, y), 13: lambda: min(x, y), 14: lambda: max(x, y)}
        value = made[int(item.op)]()
        return value if math.isfinite(value) else math.nan
index = sqlite3.connect(":memory:")
index.execute("CREATE TABLE names (id INTEGER, name TEXT)")
index.execute("CREATE TABLE facts (name INTEGER, text TEXT, number REAL, unit TEXT)")
for number, (name, unit) in enumerate(json.loads(sys.argv[2]).items(), 1):
    index.execute("INSERT INTO names VALUES (?, ?)", (number, name))
    index.execute("INSERT INTO facts VALUES (?, 'x', 1.0, ?)", (number, unit))
def search(text):
    try:
        found = statement_of(parse_where(text), index)
        return found.sql, [str(item) for item in found.values]
    except ConfigError as error:
        refused = ValueError(str(error))
        refused.offset = int(str(error).split(":")[2]) - 1
        raise refused
scope = {name: Number(value, parse_unit(unit).dimension) for name, (value, unit) in names.items()}
for line in sys.stdin:
    text, kind = json.loads(line)
    try:
        if kind == "search":
            value, dimension = search(text)
        elif kind == "formula":
            value, dimension = formula(text)
        else:
            number = parse_expression(text).value(scope)
            value, dimension = number.value, number.dimension
        print(json.dumps([value, list(dimension), "", -1]))
    except ValueError as error:
        print(json.dumps([None, None, str(error), error.offset]))
"""


#: Fields of recordings, and their units.
FIELDS = {"duration": "s", "parameter.current": "A", "meta.lot-7": "", "started": "date",
          "specimen.hardness": "Pa", "state": "", "count": "1"}  # fmt: skip
VALUES = ("5 s", "150 mA", "-2.5 GPa", "PTFE", "W-7", '"8"', "'A. Miller'", "2026-09", "7", "3 N",
          "2026-09-01 23:59", "2026-13", "1e3", "5 1/s", "mü")  # fmt: skip


def search(random: Random, depth: int) -> str:
    """Return a condition of `rigd runs --where`."""
    kind = random.random()
    if depth and kind < 0.5:
        sign = random.choice(("and", "or"))
        return f"{search(random, depth - 1)} {sign} {search(random, depth - 1)}"
    if depth and kind < 0.6:
        return f"({search(random, depth - 1)})"
    if depth and kind < 0.7:
        return f"not {search(random, depth - 1)}"
    field, value = random.choice([*FIELDS, "lot-7", "current"]), random.choice(VALUES)
    if kind < 0.8:
        return f"{field} is {random.choice(('known', 'missing'))}"
    if kind < 0.85:
        return f"{field} in ({value}, {random.choice(VALUES)})"
    return f"{field} {random.choice(('==', '!=', '<', '<=', '>', '>=', 'contains'))} {value}"


def read(texts: list[tuple[str, str]], folder: Path) -> tuple[list[list[object]], float]:
    """Return value, dimension, error and its place of each text, and the seconds it took."""
    lines = "\n".join(map(json.dumps, texts))
    begun = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", READER, json.dumps(NAMES), json.dumps(FIELDS)],
        input=lines, text=True, capture_output=True, check=True, cwd=folder,
        env={"PYTHONPATH": str(folder)},
    )  # fmt: skip
    took_s = time.perf_counter() - begun
    return [json.loads(line) for line in done.stdout.splitlines()], took_s


def same(new: list[object], old: list[object]) -> bool:
    """Return whether both are refused, or have one dimension and the value within rounding."""
    if new[0] is None or old[0] is None:
        return new[0] is old[0]
    if isinstance(new[0], str):
        return new == old
    a, b = float(str(new[0])), float(str(old[0]))
    near = math.isclose(a, b, rel_tol=1e-12, abs_tol=1e-300) or (math.isnan(a) and math.isnan(b))
    return near and new[1] == old[1]


def main() -> None:
    """Draw, read and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--old", help="compare with this commit too")
    args = parser.parse_args()
    random = Random(args.seed)
    drawn: list[tuple[Drawn, bool]] = []
    while len(drawn) < args.count:
        bare = len(drawn) % 2 == 1
        item = draw(random, random.choice((2, 3, 4)), bare=bare)
        if len(item.text) <= 300:
            drawn.append((item, bare))
    texts = [(item.text, "formula" if bare else "procedure") for item, bare in drawn]
    found, took_s = read(texts, ROOT)
    values = {name: value for name, (value, _) in NAMES.items()}
    bases = ("kg", "m", "s", "A", "K", "rad", "count")
    wrong = []
    refused = 0
    for (item, _), new in zip(drawn, found, strict=True):
        try:
            value: float | None = value_of(item, values)
            powers = [(item.powers or {}).get(base, 0) for base in bases]
        except Refused:
            value, powers = None, []
            refused += 1
        if not same(new, [value, powers]):
            wrong.append((item.text, new, value))
    print(f"{args.count} expressions, {refused} of them refused, read in {took_s:.1f} s: "
          f"{len(wrong)} differ from Python")  # fmt: skip
    for text, new, expected in wrong[:20]:
        print(f"  {text}: {new}, expected {expected}")
    if args.old:
        searches = [(search(random, 2), "search") for _ in range(args.count)]
        compare(args.old, texts + searches, found + read(searches, ROOT)[0])


def compare(commit: str, texts: list[tuple[str, str]], found: list[list[object]]) -> None:
    """Print what the rigd of ``commit`` reads in another way."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        packed = subprocess.run(
            ["git", "-C", str(ROOT), "archive", commit, "rigd"], capture_output=True, check=True
        ).stdout
        subprocess.run(["tar", "-x", "-C", name], input=packed, check=True)
        earlier, took_s = read(texts, folder)
    kinds: Counter[str] = Counter()
    shown: dict[str, str] = {}
    for (text, kind), new, old in zip(texts, found, earlier, strict=True):
        if not same(new, old):
            change = f"{kind}: was {old[2] or 'a value'!r}, is {new[2] or 'a value'!r}"
        elif new[2] and new[3] != old[3]:
            change = f"{kind}: the place of {' '.join(str(new[2]).split()[:2])!r}"
        elif new[2] != old[2]:
            words = [" ".join(str(item[2]).rpartition(": ")[2].split()[:4]) for item in (old, new)]
            change = f"{kind}: was {words[0]!r}, is {words[1]!r}"
        else:
            continue
        kinds[change] += 1
        shown.setdefault(change, f"{text}   ({old[3]} -> {new[3]})")
    count = sum(not item[2] for item in found)
    print(f"{count} of {len(texts)} are read, by {commit} in {took_s:.1f} s; "
          f"{sum(kinds.values())} differ:")  # fmt: skip
    for change, count in kinds.most_common(25):
        print(f"  {count:6}  {change}\n          {shown[change]}")


if __name__ == "__main__":
    main()

"""Texts of what rigd does today: a change of structure changes none of them.

`pytest tests/contract --force-regen` writes them anew; what a commit changes in them is in its
difference. On a machine whose arithmetic is that of the machine that wrote them they are equal to
the byte. On another the numbers in them agree to 3e-3, as fits end where their decrease is small:
two processors gave 1e-4, and 1.6e-3 for a p value. Digests and widths of tables are not compared,
and a line in a thousand may have other words: a law that does not fit reaches another bound.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Final

import numpy as np

Check = Callable[[str, str], None]

#: A number, or what a digest of bytes looks like.
_NUMBER: Final = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w])")
_DIGEST: Final = re.compile(r"(?<![\w.])[0-9a-f]{16}(?:[0-9a-f]{48})?(?![\w.])")
#: Numbers of another arithmetic agree to this share of the larger one, or are as close to zero.
RELATIVE: Final = 3e-3
ABSOLUTE: Final = 1e-9
#: In so many lines one may have other words.
LINES: Final = 1000
#: The digest of what this arithmetic gives, beside the texts that it gave.
ARITHMETIC: Final = Path(__file__).parent / "arithmetic.txt"


@cache
def arithmetic() -> str:
    """Return a digest of what this machine's libraries make of functions and of linear algebra."""
    draws = np.random.default_rng(1).normal(size=(60, 60))
    values = [f(x) for f in (math.sin, math.exp, math.atan2(1.0, 3.0).__pow__) for x in draws[0]]
    arrays = (np.sin(draws), np.exp(draws), draws @ draws, np.linalg.solve(draws, draws[0]))
    data = struct.pack(f"{len(values)}d", *values) + b"".join(a.tobytes() for a in arrays)
    return sha256(data).hexdigest()[:16]


def same(obtained: Path, kept: Path, *, exact: bool) -> None:
    """Compare two files line by line, and name the first that differs."""
    new, old = (path.read_text("utf-8").splitlines() for path in (obtained, kept))
    other_words = 0
    for number, (a, b) in enumerate(zip(new, old, strict=False), 1):
        if a != b and (exact or not _near(a, b)):
            other_words += 1
            if not exact and other_words <= len(old) // LINES:
                continue
            raise AssertionError(f"{kept}:{number}:\nit was  {b}\nit is   {a}")
    if len(new) != len(old):
        longer = max(new, old, key=len)[min(len(new), len(old))]
        raise AssertionError(f"{kept}: {len(old)} lines, now {len(new)}; the first more: {longer}")


def _near(a: str, b: str) -> bool:
    a, b = (" ".join(_DIGEST.sub("DIGEST", text).split()) for text in (a, b))
    if _NUMBER.sub("#", a) != _NUMBER.sub("#", b):
        return False
    pairs = zip(_NUMBER.findall(a), _NUMBER.findall(b), strict=True)
    return all(
        math.isclose(float(x), float(y), rel_tol=RELATIVE, abs_tol=ABSOLUTE) for x, y in pairs
    )

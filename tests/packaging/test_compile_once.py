"""Workers of a suite that need a kernel at the same time: one compiles it, the others load it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from support import warm

KERNEL = (
    "from rigd.model.machine.kernel import kernel\n\n\n@kernel\ndef twice(x):\n    return 2.0 * x\n"
)
CODE = """\
import sys

sys.path.insert(0, ".")
from shared import twice

assert twice(21.0) == 42.0
print(sum(twice.stats.cache_misses.values()))
"""


def test_kernel_needed_by_two_is_compiled_once(tmp_path: Path) -> None:
    (tmp_path / "shared.py").write_text(KERNEL)
    with ThreadPoolExecutor(4) as pool:
        ran = list(pool.map(lambda _: warm.run_python(CODE, tmp_path, 120.0), range(4)))
    assert [code for code, _, _ in ran] == [0] * 4, ran
    assert sorted(int(out) for _, out, _ in ran) == [0, 0, 0, 1]

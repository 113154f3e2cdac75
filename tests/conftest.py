"""What holds for every test: one thread of linear algebra, told before numpy is imported.

The systems to solve are small. Threads that wait for one another cost many times what one alone
does, and the cores that other tests need. Commands that tests start inherit it.
"""

from __future__ import annotations

import os

for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

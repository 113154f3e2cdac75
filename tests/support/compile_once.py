"""Has each kernel compiled by one process of a suite: the others wait for it and load it.

numba stores what it compiles, and finds what is stored, but two processes that need a kernel at the
same time both compile it, for 5 to 15 CPU seconds.
"""

from __future__ import annotations

import fcntl
from pathlib import Path
from typing import Any
from zlib import crc32

from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher

_DISPATCHER: Any = Dispatcher
_compile = _DISPATCHER.compile


def install(folder: Path) -> None:
    """Have this process, and those that it forks, wait at files in ``folder``."""

    def compile_once(self: Any, signature: object) -> object:
        if isinstance(self._cache, NullCache):  # stored with the kernels that call it
            return _compile(self, signature)
        function = self.py_func
        name = f"{function.__module__}.{function.__qualname__}"
        with (folder / f"{crc32(name.encode()):08x}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # given back at its end, also if it is killed
            return _compile(self, signature)

    _DISPATCHER.compile = compile_once

"""Counts what a driver leaves behind: descriptors, threads, processes; and sees what it opens.

It looks at the process itself, so that it depends on no setting of the author's tests.
"""

from __future__ import annotations

import contextlib
import gc
import inspect
import socket
import sys
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Container, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from types import (
    CellType,
    CoroutineType,
    FunctionType,
    GeneratorType,
    MappingProxyType,
    MethodType,
)
from typing import Any, Final, NamedTuple

import numpy as np

from rigd.sdk.check.peer import Peer
from rigd.sdk.check.sequences import StepFailed
from rigd.sdk.plant import Plant


class OpenedItem(NamedTuple):
    """What was opened, in words, and the socket that it connects."""

    words: str
    connected: socket.socket | None


#: What is left gets this time to end, in s: threads end in their next turn, processes on a busy
#: machine later.
ENDS_S: Final = 10.0
#: Bytes that more turns may keep, in all: counters become larger.
KEPT_BYTES: Final = 2880
#: What refers to the objects that it is made of, and to no others.
_HOLDERS: Final = (dict, list, tuple, set, frozenset, deque, memoryview, MappingProxyType, CellType,
                   MethodType, GeneratorType, CoroutineType, partial, type(cache(len)))  # fmt: skip
_LOOK_S: Final = 0.01
_FOLDER: Final = Path("/proc/self/fd")
#: Files that are opened by reading them in once, such as maps of a device, are no connections.
_OPENS: Final = ("socket.connect", "socket.bind", "socket.sendto", "subprocess.Popen", "os.system",
                 "_thread.start_new_thread")  # fmt: skip

#: By thread: what it opens, while it is watched.
_opened: dict[int, list[OpenedItem]] = {}
_hooked = threading.Event()


@contextlib.contextmanager
def nothing_left(when: str = "after close()") -> Iterator[None]:
    """Compare what the process has open after the block with what it had before.

    Raises:
        StepFailed: something is left, or a driver drops what it has not closed.
    """
    before = _held()
    dropped: list[str] = []

    def show(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        if threading.current_thread().name == "driver under check":
            dropped.append(str(message).partition("\n")[0])

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        warnings.filterwarnings("always", category=ResourceWarning)
        warnings.showwarning = show
        yield
    if dropped:
        raise StepFailed(f"{when} it drops what it has not closed: {dropped[0]}")
    end = time.monotonic() + ENDS_S
    while left := _held().items() - before.items():
        if time.monotonic() > end:
            words = ", ".join(sorted(words for _, words in left))
            raise StepFailed(f"{when} {words} left open")
        let_go()
        time.sleep(_LOOK_S)


def kept_for_good(
    driver: object, peer: Peer, turns: int, turn: Callable[[], object]
) -> Iterator[str]:
    """Yield that a driver keeps memory for good while ``turn`` is made again and again.

    What counts is what the driver refers to, and what its file and files beside it refer to. No
    hook counts allocations: tracemalloc, in Python before 3.12.9, can crash the process if threads
    of the peer or of a library allocate while it stops (CPython issue 128679).
    """
    used = vars(sys.modules[type(driver).__module__]).values()
    own = inspect.getmodule(type(driver))
    folder = Path(inspect.getfile(type(driver))).parent
    found = {inspect.getmodule(item) for item in used}
    found -= {inspect.getmodule(c) for c in used if isinstance(c, type) and issubclass(c, Plant)}
    beside = {
        module.__name__: module
        for module in found | {own}
        if module and Path(getattr(module, "__file__", None) or "").parent == folder
    }
    sizes: list[int] = []
    for _ in range(2):
        for _ in range(turns):
            turn()
        if isinstance(peer.readings, list):
            del peer.readings[:-1]  # they lie in memory that the driver has given back
        gc.collect()
        sizes.append(_bytes_of([driver, *(vars(module) for module in beside.values())], beside))
    if (kept := sizes[1] - sizes[0]) > KEPT_BYTES:
        yield f"each turn keeps {kept / turns:.0f} bytes for good"


def _bytes_of(roots: Sequence[object], modules: Container[str]) -> int:
    """Return how many bytes ``roots`` and what they refer to take.

    An object of a class of other modules counts by itself alone, as it may have its own life (a
    link, a loop, a log of a test); but a frozen dataclass is a value, and counts whole.
    """
    seen: set[int] = set()
    size = 0
    left = [*roots]
    while left:
        item = left.pop()
        if id(item) in seen:
            continue
        seen.add(id(item))
        size += sys.getsizeof(item, 0)
        if isinstance(item, np.ndarray):
            left.append(item.base)
        elif isinstance(item, FunctionType):  # not its globals
            if item.__module__ in modules:
                left += [item.__closure__, item.__defaults__, vars(item)]
        elif _counts_whole(item, modules):
            left += gc.get_referents(item)
    return size


def _counts_whole(item: object, modules: Container[str]) -> bool:
    if isinstance(item, _HOLDERS):
        return True
    cls = item if isinstance(item, type) else type(item)
    value = cls is not item and getattr(cls, "__dataclass_params__", None)
    return not issubclass(cls, Plant) and (
        cls.__module__ in modules or bool(value and value.frozen)
    )


def let_go() -> None:
    """Collect what a faulty driver left open, without a word: a later test would be blamed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()


def _held() -> dict[str, str]:
    """Return descriptors, threads and processes, each with its words."""
    held = {
        f"thread {thread.ident}": f"the thread {thread.name!r} is"
        for thread in threading.enumerate()
        if thread.name not in {"driver under check", "watcher of the device"}
    }
    with contextlib.suppress(OSError):  # a system without /proc
        for number in _FOLDER.iterdir():
            with contextlib.suppress(OSError):  # the one that lists the folder
                target = str(number.readlink())
                held[f"descriptor {number.name} {target}"] = f"{target.partition(':')[0]} is"
        for task in Path("/proc/self/task").iterdir():
            for pid in (task / "children").read_text().split():
                held[f"process {pid}"] = f"the process {pid} is"
    return held


@contextlib.contextmanager
def opens() -> Iterator[list[OpenedItem]]:
    """Yield the list of the connections, processes and threads that this thread opens meanwhile.

    A connection with the address to which it leads.
    """
    if not _hooked.is_set():
        _hooked.set()
        sys.addaudithook(_hear)
    seen = _opened[threading.get_ident()] = []
    try:
        yield seen
    finally:
        del _opened[threading.get_ident()]


def _hear(event: str, args: tuple[Any, ...]) -> None:
    seen = _opened.get(threading.get_ident()) if _opened else None
    if seen is None:
        return
    if event in _OPENS:
        connects = event.startswith("socket.")
        words = f"{event} {args[1] if connects else ''}".rstrip()
        seen.append(OpenedItem(words, args[0] if event == "socket.connect" else None))
    elif event == "open" and str(args[0]).startswith("/dev/"):
        seen.append(OpenedItem(f"open {args[0]}", None))

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
import tracemalloc
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

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
    """Yield that code of a driver keeps memory for good while ``turn`` is made again and again.

    The code is its file, and files beside it that it uses; not that of a plant, as tracemalloc
    counts as kept what compiled functions give back.
    """
    used = list(vars(sys.modules[type(driver).__module__]).values())
    own = Path(inspect.getfile(type(driver)))
    names = {getattr(inspect.getmodule(item), "__file__", None) or "" for item in used}
    names -= {inspect.getfile(c) for c in used if isinstance(c, type) and issubclass(c, Plant)}
    beside = (name for name in names if Path(name).parent == own.parent)
    files = [tracemalloc.Filter(True, name) for name in {str(own), *beside}]
    sizes: list[int] = []
    tracemalloc.start()
    try:
        for _ in range(2):
            for _ in range(turns):
                turn()
            if isinstance(peer.readings, list):
                del peer.readings[:-1]  # they lie in memory that the driver has given back
            gc.collect()
            taken = tracemalloc.take_snapshot().filter_traces(files)
            sizes.append(sum(trace.size for trace in taken.traces))
    finally:
        tracemalloc.stop()
    if (kept := sizes[1] - sizes[0]) > KEPT_BYTES:
        yield f"each turn keeps {kept / turns:.0f} bytes for good"


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

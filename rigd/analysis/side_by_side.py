"""Calls functions side by side, each in a process of its own that is a copy of this one.

Each copy computes what this process would, to the last bit. A process is copied with what it has
loaded, so that only the results are sent. Copies of a process with threads can wait for a lock
for ever: only a program with one thread may ask for more than one process. A copy ends with the
process that asked, if that one is killed too.
"""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Callable, Sequence
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Any, TypeVar

from rigd.model.machine.parent import end_with

if TYPE_CHECKING:  # Windows has none
    from multiprocessing.context import ForkProcess

T = TypeVar("T")


def cores() -> int:
    """Return how many processes of :func:`side_by_side` this machine has use for.

    One if it has no Linux: there a process cannot be copied, or not safely.
    """
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


def side_by_side(work: Sequence[Callable[[], T]], processes: int) -> list[T]:
    """Return what the functions ``work`` return, in their order; at most ``processes`` at once.

    With one process, or one function, they are called here. Raises the exception of the first
    function that raises one; RuntimeError: a process ended without a result.
    """
    if min(processes, len(work)) < 2:
        return [function() for function in work]
    waiting = deque(enumerate(work))
    running: dict[Connection, tuple[int, ForkProcess]] = {}
    found: dict[int, T] = {}
    try:
        while waiting or running:
            while waiting and len(running) < processes:
                index, function = waiting.popleft()
                answer, process = _begun(function)
                running[answer] = index, process
            ready = wait(list(running))
            for answer in [item for item in running if item in ready]:
                index, process = running.pop(answer)
                found[index] = _answer(answer, process)
    finally:
        for answer, (_, process) in running.items():
            process.terminate()
            process.join()
            answer.close()
    return [found[index] for index in range(len(work))]


def _begun(function: Callable[[], T]) -> tuple[Connection, ForkProcess]:
    context = get_context("fork")
    answer, sender = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(function, sender, os.getpid()), daemon=True)
    process.start()
    sender.close()
    return answer, process


def _send(function: Callable[[], T], sender: Connection, asking: int) -> None:
    if not end_with(asking, signal.SIGKILL):
        return
    try:
        result: tuple[bool, object] = True, function()
    except Exception as error:  # noqa: BLE001 - raised again in the process that asked
        result = False, error
    sender.send(result)


def _answer(answer: Connection, process: ForkProcess) -> Any:
    # Any: the type of what was sent is not known to the checker.
    with answer:
        try:
            returned, result = answer.recv()
        except EOFError:
            process.join()
            raise RuntimeError(
                f"a process ended without a result (exit code {process.exitcode})"
            ) from None
    process.join()
    if not returned:
        raise result
    return result

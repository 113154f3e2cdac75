"""Functions that are called side by side, in processes that are copies of this one."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import pytest
from support.recordings.blocks import alive, until

from rigd.analysis.output_error.system import Diverged
from rigd.analysis.side_by_side import side_by_side


def _fail(trial: int) -> int:
    raise Diverged(trial, f"trial {trial}")


def _end() -> int:
    os._exit(3)


def test_results_keep_order_of_functions() -> None:
    squares = side_by_side([partial(pow, k, 2) for k in range(5)], processes=2)
    assert squares == [0, 1, 4, 9, 16]


def test_functions_run_in_processes_of_their_own() -> None:
    assert os.getpid() not in side_by_side([os.getpid, os.getpid], processes=2)
    assert side_by_side([os.getpid, os.getpid], processes=1) == [os.getpid()] * 2


def test_error_of_a_copy_is_raised_whole() -> None:
    work: list[Callable[[], int]] = [os.getpid, partial(_fail, 4)]
    with pytest.raises(Diverged, match="trial 4") as found:
        side_by_side(work, processes=2)
    assert found.value.trial == 4
    assert found.value.hint


def test_process_that_ends_early_is_reported() -> None:
    with pytest.raises(RuntimeError, match="exit code 3"):
        side_by_side([os.getpid, _end], processes=2)


def test_copies_end_with_the_killed_process(tmp_path: Path) -> None:
    def copy() -> None:
        (tmp_path / str(os.getpid())).touch()
        time.sleep(600)

    asking = get_context("fork").Process(target=side_by_side, args=([copy, copy], 2))
    asking.start()
    until(lambda: len(list(tmp_path.iterdir())) == 2)
    asking.kill()
    asking.join()
    copies = [int(file.name) for file in tmp_path.iterdir()]
    try:
        until(lambda: not any(alive(process) for process in copies), timeout_s=30)
    finally:
        for process in filter(alive, copies):
            os.kill(process, signal.SIGKILL)

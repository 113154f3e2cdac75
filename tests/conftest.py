"""What holds for every test: one thread of linear algebra, signals that act, what runs when.

The systems to solve are small. Threads that wait for one another cost many times what one alone
does, and the cores that other tests need. Commands that tests start inherit it.

A folder named in none of the lists below has its rigs in real time, of which `make test` runs two
at once, and is not in `make quick`. What is left to `make test-long` stands in `support/long.py`.
"""

from __future__ import annotations

import gc
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Generator
from contextlib import suppress
from functools import cache
from pathlib import Path
from zlib import crc32

import pytest
from hypothesis import HealthCheck, settings
from support import compile_once, long, warm

for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):  # before numpy is imported
    os.environ.setdefault(name, "1")

# What is imported and collected stays: each search for garbage in it takes 0.1 to 0.3 s.
gc.set_threshold(50_000, 20, 20)

# A loaded machine is no fault of what is tested.
settings.register_profile("loaded", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("loaded")

# Tests and the commands that they start keep what they compile: it costs more than many of them.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# A suite started with nohup, or in the background of a script, must ignore these. What it
# starts would inherit that, and rigd respects it: no test of a Ctrl-C or a lost terminal could
# pass.
for number, action in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGQUIT, signal.SIG_DFL),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, action)

pytest_plugins = ["support.cpu"]

# Rigs of one name that several workers run at once would find one another in use.
MEMORY = "/dev/shm" if os.access("/dev/shm", os.W_OK) else tempfile.gettempdir()
WHERE = Path(os.environ.get("RIGD_STATE", MEMORY))
WHERE.mkdir(mode=0o700, parents=True, exist_ok=True)
STATE = Path(tempfile.mkdtemp(prefix="rigd-tests-", dir=WHERE))
os.environ["RIGD_STATE"] = str(STATE)
os.environ["XDG_CACHE_HOME"] = str(STATE / "cache")  # the indexes of folders of recordings

warm.offer()
compile_once.install(warm.shared_folder())
HERE = Path(__file__).parent


def places(*names: str) -> frozenset[str]:
    """Return folders and files of tests."""
    return frozenset(str(HERE / name) for name in names)


#: Tests that compute, or wait for answers and not by the clock. All others run rigs or watchdogs
#: in real time: two of them share the machine, with nothing that computes beside them.
SIDE_BY_SIDE = places(
    "analyses", "analysis", "catalogue", "cli", "config", "daemon/doctor/test_statistics.py",
    "daemon/doctor/test_storage.py", "daemon/doctor/test_survey.py", "daemon/live", "daemon/serve",
    "daemon/test_forms.py",
    "daemon/manual", "daemon/test_resume_point.py", "daemon/test_virtual_time.py",
    "computed", "contract", "importing",
    "docs", "dry_run",
    "drivers", "engine/recorder/test_exactly_once.py", "engine/shared",
    "engine/slow/test_latest.py", "engine/test_any_loops.py", "engine/test_asking.py",
    "engine/test_compiled_ahead.py", "engine/test_cycle.py",
    "engine/test_derived.py", "engine/test_faults.py", "engine/test_interlocks.py",
    "engine/test_limiter.py",
    "engine/test_plant_blocks.py", "engine/test_player.py", "engine/test_run.py",
    "engine/test_run_pause.py",
    "engine/test_windows.py", "model", "packaging", "panel", "procedure", "record", "remote",
    "sdk", "sim",
    "system/test_approach_angle.py", "system/test_articulated.py", "system/test_bad_input.py",
    "system/test_calibrate.py",
    "system/test_friction_laws.py",
    "system/test_identify_campaign.py", "system/test_identify_command.py",
    "system/test_identify_lateral.py",
    "system/test_replay.py", "system/test_run_command.py", "system/test_seeds.py",
    "system/test_third_family.py", "system/test_validate_command.py",
)  # fmt: skip
#: Of these, tests whose driver or simulated device lives by the clock in the process of the test.
#: rigd and `rigd sim` give both real-time priority; so does the suite, on a machine that allows it.
WITH_PRIORITY = places(
    "drivers/can/test_conformance.py", "drivers/cards/labjack", "drivers/modbus",
    "drivers/cards/ni_io", "drivers/cards/ni_relay", "drivers/instruments/scale",
    "drivers/cards/test_ni_clock.py", "drivers/cards/test_ni_daq.py",
    "engine/slow/test_ni_in_helper.py", "sim/wire", "sim/approach_angle/test_wire.py",
    "sim/lugre/test_wire.py", "sim/mechanism/test_wire.py", "sim/mechanism/test_tribometer.py",
)  # fmt: skip
#: `make quick`: computes only, in less than a minute. No browser, no node, nothing in real time.
QUICK = places(
    "analysis/fitting/test_fit.py", "analysis/fitting/test_residuals.py",
    "record/test_resample.py", "config", "daemon/live/test_points.py",
    "daemon/serve/test_library.py", "daemon/serve/test_recordings.py", "computed/controllers",
    "computed/derived", "drivers/can/test_bus.py", "drivers/can/test_eds_on_bus.py",
    "drivers/can/test_servo_cycle.py", "drivers/can/test_servo_safe.py",
    "drivers/can/test_servo_setup.py", "drivers/can/test_sheet.py",
    "drivers/modbus/test_exchange.py", "drivers/modbus/test_frames.py",
    "drivers/modbus/test_maps.py", "drivers/cards/mf624", "drivers/cards/test_analog_servo.py",
    "drivers/cards/test_analog_speed_servo.py", "drivers/cards/test_card_analog.py",
    "drivers/cards/test_card_encoder.py", "drivers/cards/test_card_frequency.py",
    "engine/test_cycle.py", "engine/test_interlocks.py", "engine/test_limiter.py",
    "engine/test_player.py", "engine/test_run.py", "engine/test_run_pause.py",
    "engine/test_windows.py", "model", "procedure", "record/test_events.py",
    "record/test_values.py", "record/test_writer.py", "remote/protocol", "remote/test_access.py",
    "remote/test_certificates.py", "sdk/test_options.py", "sim/lugre/test_parameters.py",
    "sim/wire/can/test_eds.py",
)  # fmt: skip
#: `make test-days`: tests that ask which day it is. Shown to be all by whole runs on other days.
DATES = places(
    "config/test_calibration.py", "daemon/serve/test_audit.py",
    "daemon/serve/test_logs.py", "daemon/test_forms.py", "remote/test_certificates.py",
    "remote/test_strangers.py", "remote/test_tls.py",
)  # fmt: skip
#: Documents of which some do, by the ends of their names, and files that mark those that do.
DATED_DOCUMENTS = ("[calibration.md]",)
DATED_IN_PART = places("docs", "system/test_calibrate.py")
#: Files that take most time as a whole: begun last, one would keep all other processors waiting.
FIRST = places("system", "cli/test_examples.py", "panel/test_page.py", "panel/test_presses.py")
#: Files whose tests wait for devices more than they compute: together they leave processors idle.
WAITING = places("drivers", "sdk", "sim/wire")
DOCUMENTS = places("docs")
LONG, LONG_AS_A_WHOLE = places(*long.FILES), places(*long.WHOLE)
MARKED = {"side_by_side": SIDE_BY_SIDE, "quick": QUICK, "dates": DATES}


@cache
def above(path: Path) -> frozenset[str]:
    """Return a file and the folders that it stands in."""
    return frozenset(map(str, (path, *path.parents)))


def is_in(path: Path, listed: frozenset[str]) -> bool:
    """Return whether a file stands in one of these folders, or is one of these files."""
    return not listed.isdisjoint(above(path))


def pytest_sessionstart() -> None:
    """Refuse lists that name what is not there.

    No search for garbage while tests are collected: what is made then stays.
    """
    gc.disable()
    listed = {
        place
        for those in (*MARKED.values(), WITH_PRIORITY, DATED_IN_PART, FIRST, LONG)
        for place in those
    }
    if missing := sorted(place for place in listed if not Path(place).exists()):
        raise pytest.UsageError(f"tests/conftest.py lists what is not there: {missing}")


def pytest_collection_finish() -> None:
    """Leave what is there out of later searches for garbage."""
    gc.freeze()
    gc.enable()


def pytest_sessionfinish() -> None:
    """Remove the state of the runs of this process."""
    shutil.rmtree(STATE, ignore_errors=True)


def is_needless(path: Path, term: str) -> bool:
    """Return whether no test of a file can have a marker, or be without it: `not NAME`."""
    match term:
        case "not side_by_side":
            return is_in(path, SIDE_BY_SIDE)
        case "long":
            return not is_in(path, LONG)
        case "not long":
            return is_in(path, LONG_AS_A_WHOLE)
        case "dates":
            return not is_in(path, DATES | DATED_IN_PART)
    return term in MARKED and not is_in(path, MARKED[term])


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Import no more than the markers that are asked for need."""
    asked = str(config.getoption("markexpr"))
    if collection_path.suffix != ".py" or " or " in asked:
        return None
    return any(is_needless(collection_path, term) for term in asked.split(" and ")) or None


def spread(items: list[pytest.Item]) -> None:
    """Put the largest files first, and those that wait evenly among the others."""
    files = dict.fromkeys(item.path for item in items)
    waiting = [file for file in files if is_in(file, WAITING)]
    others = [file for file in files if not is_in(file, WAITING | FIRST)]
    turn = {
        file: (number + 0.5) / len(kind)
        for kind in (waiting, others)
        for number, file in enumerate(kind)
    }
    items.sort(key=lambda item: turn.get(item.path, 0.0))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the tests by what may run when, and put them in the order in which they are to run.

    RIGD_TESTS_SLICE=0/4 takes a quarter of the long tests only, 1/4 to 3/4 the others.
    """
    spread(items)
    ids = [(str(item.path.relative_to(HERE)), item.nodeid.split("::", 1)[1]) for item in items]
    whole_files = not any("::" in argument for argument in config.args)
    if whole_files and (unknown := long.unknown(ids)):
        raise pytest.UsageError(f"tests/support/long.py lists what is not there: {unknown}")
    for item, (file, test) in zip(items, ids, strict=True):
        for marker, listed in MARKED.items():
            if is_in(item.path, listed):
                item.add_marker(marker)
        if why := long.reason(file, test):
            item.add_marker(pytest.mark.long(why))
        if is_in(item.path, DOCUMENTS) and item.name.endswith(DATED_DOCUMENTS):
            item.add_marker("dates")
    if of := os.environ.get("RIGD_TESTS_SLICE"):
        number, slices = (int(part) for part in of.split("/"))
        beside = [
            item
            for item in items
            if item.get_closest_marker("long") and crc32(item.nodeid.encode()) % slices != number
        ]
        items[:] = [item for item in items if item not in beside]
        config.hook.pytest_deselected(items=beside)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(
    item: pytest.Item, nextitem: pytest.Item | None
) -> Generator[None, object, object]:
    """Collect what a file of tests left open at its end: no test of another file is blamed."""
    result = yield
    if nextitem is None or nextitem.path != item.path:
        gc.collect()
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Give a test that lives by the clock in its own process real-time priority."""
    if not is_in(item.path, WITH_PRIORITY):
        return (yield)
    policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    result = yield
    with suppress(PermissionError):  # what the test itself has set may be there to stay
        os.sched_setscheduler(0, policy, parameter)
    return result

"""Runs commands as on Windows: what Linux alone has is hidden, and files behave as there.

``python -m support.commands.elsewhere COMMANDS LIBRARIES`` runs each command, a list of a list in
JSON, in a copy of a process that has imported the libraries and has rigd still to import. What each
prints goes to ``toldN``, and the exit codes to standard output. This does not replace a computer
with Windows: paths, consoles and processes are still those of Linux.
"""

from __future__ import annotations

import asyncio
import errno
import importlib
import importlib.abc
import json
import mmap
import multiprocessing.context
import os
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Final, NoReturn

MODULES: Final = {
    "fcntl", "grp", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty", "uvloop",
}  # fmt: skip
#: Of each module, what Python on Windows does not have; macOS has most of it.
NAMES: Final[dict[ModuleType, tuple[str, ...]]] = {
    os: (
        "O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "O_SYNC", "chown", "eventfd",
        "eventfd_write", "fchmod", "fchown", "fdatasync", "fork", "forkpty", "getegid", "geteuid",
        "getgid", "getpgid", "getuid", "getloadavg", "killpg", "memfd_create", "mkfifo", "nice",
        "pipe2", "posix_fallocate", "posix_spawn", "pread", "preadv", "pwrite", "pwritev",
        "sched_getaffinity", "sched_getscheduler", "sched_getparam", "sched_param",
        "sched_setaffinity", "sched_setscheduler", "setpriority", "setsid", "sysconf",
        "uname",
    ),
    signal: (
        "SIGALRM", "SIGCHLD", "SIGCONT", "SIGHUP", "SIGKILL", "SIGPIPE", "SIGQUIT", "SIGSTOP",
        "SIGTSTP", "SIGUSR1", "SIGUSR2", "pthread_kill", "pthread_sigmask", "setitimer", "sigwait",
        "sigtimedwait", "sigwaitinfo",
    ),
    socket: ("AF_CAN", "AF_UNIX", "CMSG_LEN", "CMSG_SPACE", "SCM_RIGHTS", "SO_REUSEPORT"),
    mmap: ("MAP_POPULATE", "MAP_PRIVATE", "MAP_SHARED", "PROT_READ", "PROT_WRITE"),
    select: ("epoll", "poll"),
    time: ("CLOCK_MONOTONIC", "CLOCK_REALTIME", "clock_gettime", "clock_gettime_ns"),
}  # fmt: skip
#: Libraries that know their system, imported while all of it is there.
LIBRARIES: Final = (
    "concurrent.futures", "getpass", "multiprocessing.connection",
    "multiprocessing.popen_spawn_posix", "numba", "platform", "pyarrow.csv", "pydantic",
    "rich.progress", "ruamel.yaml", "sqlite3", "tempfile", "uuid", "zenoh",
)  # fmt: skip
#: Those of analyses and of drivers, which take some seconds.
HEAVY: Final = (
    "canopen", "h5py", "jinja2", "matplotlib.pyplot", "pymodbus.client", "scipy.io",
    "scipy.optimize", "scipy.stats",
)  # fmt: skip
_UNIX: Final = socket.AF_UNIX
LINUX: Final = ("/dev/shm", "/proc", "/sys")
#: No file of Windows has such a name.
NO_NAME: Final = re.compile(
    r"""[<>:"|?*\x00-\x1f]|[ .]$|^(con|prn|aux|nul|com\d|lpt\d)(\.|$)""", re.IGNORECASE
)


@dataclass(frozen=True)
class Ended:
    """A command that has ended, and what it printed."""

    code: int
    told: str


def run_elsewhere(
    commands: Sequence[Sequence[str]], cwd: Path, libraries: Sequence[str] = LIBRARIES
) -> list[Ended]:
    """Run commands of rigd, or programs after ``-c``, one after the other in the folder ``cwd``.

    ``libraries`` are imported before anything is hidden.
    """
    tests = Path(__file__).resolve().parents[2]
    done = subprocess.run(
        [sys.executable, "-X", "warn_default_encoding", "-m", "support.commands.elsewhere",
         json.dumps([list(command) for command in commands]), *libraries],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        env={
            **os.environ,
            "OPENBLAS_NUM_THREADS": "1",
            "PYTHONIOENCODING": "cp1252",
            "PYTHONPATH": str(tests),
            "USERNAME": "someone",
        },
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = [cwd / f"told{number}" for number in range(len(commands))]
    codes = json.loads(done.stdout)
    return [Ended(code, path.read_text("cp1252")) for code, path in zip(codes, told, strict=True)]


class _Hide(importlib.abc.MetaPathFinder):
    def find_spec(self, name: str, path: object, target: object = None) -> None:
        if name.partition(".")[0] in MODULES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def hide(libraries: Sequence[str]) -> None:
    """Import ``libraries``; then hide from this process what Windows does not have, for good."""
    warnings.filterwarnings("ignore", category=EncodingWarning)  # of others
    for name in libraries:
        importlib.import_module(name)
    for name in MODULES & set(sys.modules):
        del sys.modules[name]
    sys.meta_path.insert(0, _Hide())
    for module, names in NAMES.items():
        for name in names:
            if hasattr(module, name):
                delattr(module, name)
    os.O_BINARY = 0x8000  # type: ignore[attr-defined]  # O_LARGEFILE, without effect here
    sys.platform = "win32"
    _replace_functions()
    warnings.filterwarnings("error", category=EncodingWarning, module="rigd")
    sys.addaudithook(_Files().judge)


def _replace_functions() -> None:
    """Let functions behave as on Windows: processes, signals, sockets, memory, the console."""
    contexts: dict[str, Any] = multiprocessing.context._concrete_contexts  # type: ignore[attr-defined]
    for name in ("fork", "forkserver"):
        del contexts[name]
    multiprocessing.set_start_method("spawn", force=True)

    def no_handler(*_: object) -> NoReturn:
        raise NotImplementedError

    asyncio.SelectorEventLoop.add_signal_handler = no_handler  # type: ignore[assignment,method-assign]
    real, known = signal.signal, {signal.SIGINT, signal.SIGTERM, signal.SIGABRT}

    def handle(number: int, handler: Any) -> Any:
        if number not in known:
            raise ValueError("signal number out of range")
        return real(number, handler)

    signal.signal = handle  # type: ignore[assignment]
    shutil._use_fd_functions = False  # type: ignore[attr-defined]
    pair = socket.socketpair
    socket.socketpair = lambda *_: pair(_UNIX)  # of event loops
    mapped = mmap.mmap
    # Without a choice of flags and protection.
    mmap.mmap = lambda fd, length, *, access=mmap.ACCESS_WRITE: mapped(fd, length, access=access)  # type: ignore[assignment,misc]
    console = ModuleType("msvcrt")
    console.kbhit = lambda: bool(select.select([sys.stdin], [], [], 0)[0])  # type: ignore[attr-defined]
    console.getwch = lambda: sys.stdin.read(1)  # type: ignore[attr-defined]
    sys.modules["msvcrt"] = console


class _Files:
    """Refuses what Windows refuses to do with files."""

    def __init__(self) -> None:
        self._inside = threading.local()

    def judge(self, event: str, given: tuple[Any, ...]) -> None:
        """Judge an event of Python (PEP 578)."""
        judges: dict[str, Callable[..., None]] = {
            "open": self._open,
            "os.mkdir": lambda path, *_: self._name(path),
            "os.rename": self._rename,
            "os.remove": lambda path, *_: self._free(path),
            "os.truncate": lambda path, *_: self._unmapped(path),
        }
        if event not in judges or getattr(self._inside, "on", False):
            return
        self._inside.on = True
        try:
            judges[event](*given)
        finally:
            self._inside.on = False

    def _open(self, path: Any, mode: str | None, flags: int) -> None:
        if isinstance(path, int):
            return
        text = os.fsdecode(path)
        if text.startswith(LINUX):
            raise FileNotFoundError(errno.ENOENT, "hidden, as Linux alone has it", text)
        if flags & os.O_CREAT:
            self._name(path)
        if mode is None and self._by_rigd():
            if Path(text).is_dir():
                raise PermissionError(errno.EACCES, "a folder cannot be opened", text)
            if not flags & os.O_BINARY:  # type: ignore[attr-defined]
                raise ValueError(f"{text} is opened as text: line ends would be translated")

    @staticmethod
    def _by_rigd() -> bool:
        frame = sys._getframe(3)
        return str(frame.f_globals.get("__name__", "")).startswith("rigd")

    @staticmethod
    def _name(path: Any) -> None:
        name = Path(os.fsdecode(path)).name
        if NO_NAME.search(name):
            raise OSError(errno.EINVAL, "no file has such a name", name)

    def _rename(self, source: Any, target: Any, *_: object) -> None:
        self._name(target)
        self._free(source)
        self._free(target)

    def _free(self, path: Any) -> None:
        target = Path(os.fsdecode(path))
        if not target.exists():
            return
        found = target.resolve()
        opened = set()
        for number in Path("/proc/self/fd").iterdir():
            with suppress(OSError):  # that of the list itself
                opened.add(number.readlink())
        if found in opened:
            raise PermissionError(errno.EACCES, "the file is open", str(found))
        self._unmapped(path)

    @staticmethod
    def _unmapped(path: Any) -> None:
        where = f"/proc/self/fd/{path}" if isinstance(path, int) else os.fsdecode(path)
        found = str(Path(where).resolve())
        with Path("/proc/self/maps").open(encoding="utf-8") as maps:
            if any(line.rstrip("\n").endswith(found) for line in maps):
                raise PermissionError(errno.EACCES, "the file is mapped", found)


def _play(number: int, arguments: list[str]) -> NoReturn:
    # A copy of this process ends here, whatever its command raises.
    told = os.open(f"told{number}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    os.dup2(told, 1)
    os.dup2(told, 2)
    code = 1
    try:
        if arguments[0] == "-c":
            exec(arguments[1], {"__name__": "__main__"})
            code = 0
        else:
            from rigd.cli.main import main

            code = main(arguments)
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else 1
    except BaseException:  # noqa: BLE001 - shown, as Python would show it
        import traceback

        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)


def _main(commands: list[list[str]], libraries: list[str]) -> None:
    fork = os.fork
    hide(libraries)
    codes = []
    for number, arguments in enumerate(commands):
        process = fork()
        if not process:
            _play(number, arguments)
        codes.append(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]))
    json.dump(codes, sys.stdout)


if __name__ == "__main__":
    _main(json.loads(sys.argv[1]), sys.argv[2:])

"""Commands from a process that has imported rigd already: it forks where others start from nothing.

Most of what a short command costs is its imports. What they are, and that each command finds its
own, is tested by processes of their own: by tests/cli/test_main.py, by some of the documents, and
by what is started and not run to its end: `rigd serve`, runs to be watched or killed, `rigd sim` in
tests/sim/lugre/test_wire.py. Simulations behind other tests, and commands on a terminal of
their own (:mod:`support.commands.terminal`), begin here.
The processes that a run itself starts are never shared. All workers of a suite ask one process,
which imports rigd when the first of them asks. A command ends without destroying these modules,
which would cost more than most commands do.
"""

from __future__ import annotations

import atexit
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

#: CPU seconds of the commands that have ended, which are no children of this process.
spent_s = 0.0

#: What the process is: a loop that forks a command for each connection, until the suite ends.
_SERVER = """
import atexit, gc, importlib, json, os, pkgutil, runpy, select, signal, socket, sys, threading
import pathlib, time, warnings


def import_all():
    import rigd, rigd_analyses, rigd_drivers, rigd_sim

    with warnings.catch_warnings(action="ignore"):
        for package in (rigd, rigd_analyses, rigd_drivers, rigd_sim):
            for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
                if not module.name.endswith("__main__"):
                    importlib.import_module(module.name)
    runpy.run_path(sys.argv[1])["install"](pathlib.Path(sys.argv[2]))
    gc.collect()
    gc.freeze()


def fork(request, streams, asking, spent_s):
    "Fork who waits for the command, and from there the command: only this one returns."
    if os.fork():
        return False
    command = os.fork()
    if command:
        asking.send(str(command).encode())
        _, status, usage = os.wait4(command, 0)
        code = os.waitstatus_to_exitcode(status)
        asking.send(json.dumps([code, spent_s + usage.ru_utime + usage.ru_stime]).encode())
        os._exit(0)
    if request.get("session"):
        os.setsid()
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    os.chdir(request["cwd"])
    os.environ.clear()
    os.environ.update(request["environment"])
    sys.path[0] = request["cwd"]
    sys.argv = ["rigd", *request["arguments"]]
    for number in request.get("ignored", ()):
        signal.signal(number, signal.SIG_IGN)
    sys.stdin = open(0, encoding="utf-8", closefd=False)
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False)
    sys.stderr = open(2, "w", 1, encoding="utf-8", errors="backslashreplace", closefd=False)
    sys.__stdin__, sys.__stdout__, sys.__stderr__ = sys.stdin, sys.stdout, sys.stderr
    return True


def serve(waiting, suite):
    "Fork a command for each connection; return the request in it, or end with the suite."
    spent_s = 0.0
    while True:
        ready, _, _ = select.select([waiting, suite], [], [])
        if waiting not in ready:
            os._exit(0)
        asking, _ = waiting.accept()
        if "rigd" not in sys.modules:
            import_all()
            spent_s = time.process_time()
        data, streams, _, _ = socket.recv_fds(asking, 1 << 20, 3)
        request = json.loads(data)
        if fork(request, streams, asking, spent_s):
            for ours in (asking, waiting, suite):
                ours.close()
            return request
        for stream in streams:
            os.close(stream)
        asking.close()
        os.waitpid(-1, os.WNOHANG)
        spent_s = 0.0


def end(main):
    "End with what main returns, as an interpreter does, but destroy nothing that was imported."
    try:
        code = main()
    except SystemExit as error:
        code = error.code
    if isinstance(code, str):
        print(code, file=sys.stderr)
        code = 1
    threading._shutdown()
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code or 0)


request = serve(*(socket.socket(fileno=int(number)) for number in sys.argv[3:]))

if "python" in request:
    warnings.simplefilter("error")
    code = compile(request["python"], "<string>", "exec")
    end(lambda: exec(code, {"__name__": "__main__"}))

from rigd.cli.main import main

end(main)
"""

#: `rigd` for a shell: it asks for the command with its own streams, and ends as the command does.
_SHIM = """\
#!{python} -IS
import json, os, signal, socket, sys

asking = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
asking.connect("{place}")
signals = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
request = {{
    "arguments": sys.argv[1:],
    "cwd": os.getcwd(),
    "environment": dict(os.environ),
    "ignored": [number for number in signals if signal.getsignal(number) is signal.SIG_IGN],
}}
socket.send_fds(asking, [json.dumps(request).encode()], [0, 1, 2])
process = int(asking.recv(1 << 16))
for number in signals:
    if number not in request["ignored"]:
        signal.signal(number, lambda number, _: os.kill(process, number))
code, cpu_s = json.loads(asking.recv(1 << 16))
with open("{spent}", "a") as spent:
    spent.write(str(cpu_s) + "\\n")
if code < 0:
    signal.signal(-code, signal.SIG_DFL)
    os.kill(os.getpid(), -code)
sys.exit(code)
"""
#: In the environment of a suite and of its workers: the socket to ask on.
_PLACE = "RIGD_TESTS_ASK_AT"


#: What that process installs once it has imported rigd, and with it numba.
_COMPILE_ONCE = str(Path(__file__).with_name("compile_once.py"))


def offer() -> None:
    """Start the process of this suite, which a worker has from the suite that started it."""
    if _PLACE in os.environ:
        return
    folder = tempfile.mkdtemp(prefix="rigd-warm-")
    place = f"{folder}/socket"
    ours, theirs = socket.socketpair()
    with theirs, socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as waiting:
        waiting.bind(place)
        waiting.listen(64)
        passed = [waiting.fileno(), theirs.fileno()]
        server = subprocess.Popen(
            [sys.executable, "-c", _SERVER, _COMPILE_ONCE, folder, *map(str, passed)],
            pass_fds=passed,
            cwd="/",
            start_new_session=True,
        )
    os.environ[_PLACE] = place
    atexit.register(_end, server, ours, folder)


def _end(server: subprocess.Popen[bytes], suite: socket.socket, folder: str) -> None:
    suite.close()
    server.wait()
    shutil.rmtree(folder)


def shared_folder() -> Path:
    """Return the folder of the suite."""
    return Path(os.environ[_PLACE]).parent


def offered() -> bool:
    """Return whether it is a suite that asks, and no bench."""
    return _PLACE in os.environ


def _text(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode().replace("\r\n", "\n")


def run(
    arguments: list[str], cwd: Path, timeout_s: float, environment: Mapping[str, str]
) -> tuple[int, str, str]:
    """Run ``rigd ARGUMENTS`` to its end; return exit code, output and errors.

    Raises:
        TimeoutError: it has not ended in time.

    """
    asked = {"arguments": arguments, "environment": dict(environment)}
    return _run(asked, cwd, timeout_s)


class Started:
    """A command that goes on: what :class:`subprocess.Popen` offers of it, in its own session."""

    def __init__(
        self, arguments: list[str], cwd: Path, streams: Sequence[int], environment: dict[str, str]
    ) -> None:
        asked = {
            "arguments": arguments,
            "cwd": str(cwd.absolute()),
            "environment": environment,
            "session": True,
        }
        self.returncode: int | None = None
        self._answer = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._answer.connect(os.environ[_PLACE])
        socket.send_fds(self._answer, [json.dumps(asked).encode()], streams)
        self.pid = int(self._answer.recv(1 << 16))

    def wait(self, timeout_s: float | None = None) -> int:
        """Wait for its end; return its exit code.

        Raises:
            TimeoutError: it has not ended in time.

        """
        global spent_s
        if self.returncode is None:
            self._answer.settimeout(timeout_s)
            self.returncode, cpu_s = json.loads(self._answer.recv(1 << 16))
            self._answer.close()
            spent_s += cpu_s
        assert self.returncode is not None
        return self.returncode

    def poll(self) -> int | None:
        """Return its exit code; None if it has not ended."""
        with suppress(BlockingIOError):
            return self.wait(0.0)
        return None

    def send_signal(self, number: int) -> None:
        """Send a signal, if it has not ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill it, if it has not ended."""
        self.send_signal(signal.SIGKILL)


def start(
    arguments: Sequence[str],
    cwd: Path,
    out: int,
    *,
    stdin: int | None = None,
    environment: Mapping[str, str] | None = None,
) -> Started | subprocess.Popen[bytes]:
    """Start ``rigd ARGUMENTS``, in tests from the process that has imported rigd.

    Its output and errors go to the descriptor ``out``; ``environment`` is added to that of this
    process. Its input is empty if ``stdin`` is None.
    """
    environ = {**os.environ, **(environment or {})}
    with Path(os.devnull).open("rb") as nothing:
        given = nothing.fileno() if stdin is None else stdin
        if offered():
            return Started(list(arguments), cwd, [given, out, out], environ)
        return subprocess.Popen(
            [sys.executable, "-m", "rigd", *arguments],
            cwd=cwd, env=environ, stdin=given, stdout=out, stderr=out, start_new_session=True,
        )  # fmt: skip


def run_python(code: str, cwd: Path, timeout_s: float) -> tuple[int, str, str]:
    """Do the same with ``python -W error -c CODE``."""
    asked = {"arguments": [], "python": code, "environment": dict(os.environ)}
    return _run(asked, cwd, timeout_s)


def _run(asked: dict[str, Any], cwd: Path, timeout_s: float) -> tuple[int, str, str]:
    global spent_s
    request = {**asked, "cwd": str(cwd.absolute())}
    with (
        Path(os.devnull).open("rb") as nothing,
        tempfile.TemporaryFile() as out,
        tempfile.TemporaryFile() as err,
    ):
        streams = [nothing.fileno(), out.fileno(), err.fileno()]
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as answer:
            answer.connect(os.environ[_PLACE])
            socket.send_fds(answer, [json.dumps(request).encode()], streams)
            # Its time begins when it has begun: given up before, it would begin unwatched.
            process = int(answer.recv(1 << 16))
            answer.settimeout(timeout_s)
            try:
                code, cpu_s = json.loads(answer.recv(1 << 16))
            except TimeoutError:
                os.kill(process, signal.SIGKILL)
                raise
        spent_s += cpu_s
        return code, _text(out), _text(err)


@contextmanager
def in_shell() -> Iterator[Path]:
    """Offer ``rigd`` to a shell that a test runs: yield the folder to put first in PATH."""
    global spent_s
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spent = folder / "spent"
        spent.touch()
        command = folder / "rigd"
        place = os.environ[_PLACE]
        command.write_text(_SHIM.format(python=sys.executable, place=place, spent=spent))
        command.chmod(0o700)
        try:
            yield folder
        finally:
            spent_s += sum(map(float, spent.read_text().split()))

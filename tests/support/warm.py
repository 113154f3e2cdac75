"""Commands from a process that has imported rigd already: it forks where others start from nothing.

Most of what a short command costs is its imports. What they are, and that each command finds its
own, is tested by processes of their own: by tests/cli/test_main.py, by some of the documents, and
by what is started and not run to its end: `rigd sim`, `rigd serve`, runs to be watched or killed.
The processes that a run itself starts are never shared.
"""

from __future__ import annotations

import array
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import IO, Any

#: Whether it is a test that asks, and no bench: tests/conftest.py sets it.
wanted = False
#: CPU seconds of the commands that have ended, which are no children of this process.
spent_s = 0.0

#: What the process is: a loop that forks a command for each request.
_SERVER = """
import gc, importlib, json, os, pkgutil, signal, socket, sys, time, warnings

os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # whatever the test has that asks first

import rigd, rigd_analyses, rigd_drivers, rigd_sim

with warnings.catch_warnings(action="ignore"):
    for package in (rigd, rigd_analyses, rigd_drivers, rigd_sim):
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
gc.collect()
gc.freeze()


def fork(request, streams, answers, spent_s):
    "Fork who waits for the command, and from there the command: only this one returns."
    if os.fork():
        return False
    command = os.fork()
    if command:
        answers.send(str(command).encode())
        _, status, usage = os.wait4(command, 0)
        code = os.waitstatus_to_exitcode(status)
        answers.send(json.dumps([code, spent_s + usage.ru_utime + usage.ru_stime]).encode())
        os._exit(0)
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


def serve(requests):
    "Fork a command for each request; return the request in it, or end with the tests."
    spent_s = time.process_time()
    while True:
        data, given, _, _ = socket.recv_fds(requests, 1 << 20, 4)
        if not data:
            os._exit(0)
        answers = socket.socket(fileno=given[3])
        request = json.loads(data)
        if fork(request, given[:3], answers, spent_s):
            answers.close()
            requests.close()
            return request
        for stream in given[:3]:
            os.close(stream)
        answers.close()
        os.waitpid(-1, os.WNOHANG)
        spent_s = 0.0


request = serve(socket.socket(fileno=int(sys.argv[1])))

if "python" in request:
    warnings.simplefilter("error")
    exec(compile(request["python"], "<string>", "exec"), {"__name__": "__main__"})
    sys.exit(0)

from rigd.cli.main import main

sys.exit(main())
"""

#: `rigd` for a shell: it asks for the command with its own streams, and ends as the command does.
_SHIM = """\
#!{python} -IS
import array, json, os, signal, socket, sys

requests = socket.socket(fileno=int(os.environ["{socket}"]))
ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
signals = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
request = {{
    "arguments": sys.argv[1:],
    "cwd": os.getcwd(),
    "environment": dict(os.environ),
    "ignored": [number for number in signals if signal.getsignal(number) is signal.SIG_IGN],
}}
streams = array.array("i", [0, 1, 2, theirs.fileno()])
socket.send_fds(requests, [json.dumps(request).encode()], list(streams))
theirs.close()
process = int(ours.recv(1 << 16))
for number in signals:
    if number not in request["ignored"]:
        signal.signal(number, lambda number, _: os.kill(process, number))
code, cpu_s = json.loads(ours.recv(1 << 16))
with open("{spent}", "a") as spent:
    spent.write(str(cpu_s) + "\\n")
if code < 0:
    signal.signal(-code, signal.SIG_DFL)
    os.kill(os.getpid(), -code)
sys.exit(code)
"""
#: In the environment of what may use :data:`_SHIM`: the number of the socket to ask on.
_SOCKET = "RIGD_TESTS_ASK_ON"


class _Starter:
    """The process that forks, and the way to ask it."""

    def __init__(self) -> None:
        self._requests, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _SERVER, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                cwd="/",
                start_new_session=True,
            )
        self._one_at_a_time = threading.Lock()

    @property
    def requests(self) -> int:
        """The socket to ask on."""
        return self._requests.fileno()

    def start(self, request: dict[str, Any], streams: list[int]) -> socket.socket:
        """Start a command; return the socket on which its end is told."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs, self._one_at_a_time:
            descriptors = array.array("i", [*streams, theirs.fileno()])
            socket.send_fds(self._requests, [json.dumps(request).encode()], list(descriptors))
        return ours


@cache
def _starter() -> _Starter:
    return _Starter()


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
        with _starter().start(request, streams) as answer:
            answer.settimeout(timeout_s)
            process = int(answer.recv(1 << 16))
            try:
                code, cpu_s = json.loads(answer.recv(1 << 16))
            except TimeoutError:
                os.kill(process, signal.SIGKILL)
                raise
        spent_s += cpu_s
        return code, _text(out), _text(err)


@contextmanager
def in_shell() -> Iterator[tuple[Path, dict[str, str], list[int]]]:
    """Offer ``rigd`` to a shell that a test runs.

    Yields:
        The folder to put first in PATH, what to add to the environment, the descriptors to pass.

    """
    global spent_s
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spent = folder / "spent"
        spent.touch()
        command = folder / "rigd"
        command.write_text(_SHIM.format(python=sys.executable, socket=_SOCKET, spent=spent))
        command.chmod(0o700)
        asked_on = _starter().requests
        try:
            yield folder, {_SOCKET: str(asked_on)}, [asked_on]
        finally:
            spent_s += sum(map(float, spent.read_text().split()))

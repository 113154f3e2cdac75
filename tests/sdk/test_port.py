"""Ports of drivers: what arrives, what is lost, and which line answers which question."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import termios
import time
import tty
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
from pydantic import ValidationError

from rigd.sdk import DeviceError, LinkError
from rigd.sdk.port import BytePort, DatagramPort, Heard, LineBuffer, LinePort, PortConfig, Questions


class Far:
    """The other end of a serial port, on a pty."""

    def __init__(self) -> None:
        self.ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.name = os.ttyname(self._theirs)

    def send(self, data: bytes) -> None:
        os.write(self.ours, data)

    def receive(self) -> bytes:
        return os.read(self.ours, 4096)

    def unplug(self) -> None:
        for fd in (self.ours, self._theirs):
            with contextlib.suppress(OSError):
                os.close(fd)


@pytest.fixture
def far() -> Iterator[Far]:
    end = Far()
    yield end
    end.unplug()


@contextlib.asynccontextmanager
async def opened(far: Far, late_s: float = 0.3) -> AsyncIterator[LinePort]:
    port = LinePort(PortConfig(port=far.name), late_s=late_s)
    await port.open()
    try:
        yield port
    finally:
        port.close()


async def answers(far: Far, *delays_s: float) -> None:
    """Answer each question with its number, so many seconds after it came."""
    loop = asyncio.get_running_loop()
    questions: asyncio.Queue[None] = asyncio.Queue()

    def heard() -> None:
        far.receive()
        questions.put_nowait(None)

    loop.add_reader(far.ours, heard)
    try:
        for number, delay_s in enumerate(delays_s):
            await questions.get()
            loop.call_later(delay_s, far.send, b"%d\r\n" % number)
    finally:
        loop.remove_reader(far.ours)


def test_lines_come_whole_however_bytes_arrive() -> None:
    buffer = LineBuffer()
    assert buffer.feed(b"1.2") == []
    assert buffer.begun
    assert buffer.feed(b"5\r\n2.5\r\n\r\n3") == [b"1.25", b"2.5"]
    assert buffer.feed(b"\n") == [b"3"]
    assert not buffer.begun


def test_line_without_its_begin_is_thrown_away() -> None:
    buffer = LineBuffer()
    buffer.skip()
    assert buffer.feed(b"5.25\n7\n") == [b"7"]


def test_overlong_line_is_counted_and_thrown_away() -> None:
    buffer = LineBuffer(8)
    assert buffer.feed(b"123456789\n12345678\n") == [b"12345678"]
    assert buffer.overlong == 1


def test_nul_stays_unless_dropped() -> None:
    assert LineBuffer().feed(b"1\x005\n") == [b"1\x005"]
    assert LineBuffer(drop_nul=True).feed(b"1\x005\n") == [b"15"]


def test_late_answer_answers_no_later_question() -> None:
    questions = Questions(late_s=1.0)
    questions.asked(0.0, timeout_s=0.5)
    assert not questions.expired(0.4)
    assert questions.expired(0.5)
    questions.give_up(0.5, owed=True)
    assert questions.left(0.7) == pytest.approx(0.8)
    assert questions.passed(0.7) is Heard.LATE
    assert questions.left(0.7) == 0.0
    questions.asked(0.8, timeout_s=0.5)
    assert questions.answered(0.9) is Heard.ANSWER
    assert questions.answered(0.9) is Heard.UNASKED


def test_first_answer_after_a_loss_is_unused() -> None:
    questions = Questions(late_s=1.0)
    questions.asked(0.0, timeout_s=0.5)
    questions.give_up(0.5, owed=True)
    questions.asked(1.5, timeout_s=0.5)
    assert questions.answered(1.6) is Heard.DOUBTFUL
    assert questions.left(1.6) == pytest.approx(1.6)  # it may be 1.6 s old: so may the next be
    questions.asked(3.2, timeout_s=0.5)
    assert questions.answered(3.3) is Heard.ANSWER


def test_byte_port_sends_receives_and_never_waits(far: Far) -> None:
    port = BytePort(PortConfig(port=far.name))
    port.open()
    assert port.receive() == b""
    port.send(b"?\r")
    assert far.receive() == b"?\r"
    far.send(b"1 N\r\n")
    end = time.monotonic() + 10
    got = b""
    while got != b"1 N\r\n":
        assert time.monotonic() < end
        got += port.receive()
    with pytest.raises(LinkError, match="open already"):
        port.open()
    port.close()
    port.close()
    with pytest.raises(LinkError, match="is not open"):
        port.receive()


def test_unplugged_serial_port_is_named(far: Far) -> None:
    port = BytePort(PortConfig(port=far.name))
    port.open()
    far.unplug()
    for _ in range(2):
        with pytest.raises(DeviceError, match=f"the port {far.name} is gone"):
            port.receive()
    with pytest.raises(DeviceError, match="is gone"):
        port.send(b"?")
    port.close()


def test_serial_port_is_of_one_process_alone(far: Far) -> None:
    config = PortConfig(port=far.name)
    first, second = BytePort(config), BytePort(config)
    first.open()
    with pytest.raises(LinkError, match="another program holds"):
        second.open()
    first.close()
    second.open()
    second.close()


def test_missing_serial_port_is_named(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="there is no serial port"):
        BytePort(PortConfig(port=str(tmp_path / "absent"))).open()


def test_settings_reach_the_serial_port(far: Far) -> None:
    config = PortConfig.model_validate(
        {"port": far.name, "baud": "19200", "data_bits": "7", "stop_bits": "2"}
    )
    port = BytePort(config)
    port.open()
    _, _, control, _, _, speed, _ = termios.tcgetattr(port.fileno())
    assert speed == termios.B19200
    assert control & termios.CSTOPB
    port.close()


def test_tcp_port_is_a_port_of_bytes() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = BytePort(PortConfig(port=f"tcp://127.0.0.1:{server.getsockname()[1]}"))
        port.open()
        client, _ = server.accept()
        assert port.receive() == b""
        port.send(b"?\n")
        assert client.recv(8) == b"?\n"
        client.close()
        end = time.monotonic() + 10
        with pytest.raises(DeviceError, match=r"tcp://127.* is gone"):
            while time.monotonic() < end:
                port.receive()
        port.close()
    with pytest.raises(LinkError, match="nothing answers at tcp://"):
        port.open()


def test_line_port_tries_each_address_of_name(monkeypatch: pytest.MonkeyPatch) -> None:
    def found(host: str, port: str, *_: object, **__: object) -> list[tuple[object, ...]]:
        refused, there = ("127.0.0.2", int(port)), ("127.0.0.1", int(port))
        return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", at) for at in (refused, there)]

    monkeypatch.setattr(socket, "getaddrinfo", found)

    async def ask() -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = LinePort(PortConfig(port=f"tcp://scale:{server.getsockname()[1]}"))
            await port.open()
            server.accept()[0].close()
            port.close()
        with pytest.raises(LinkError, match="nothing answers at tcp://scale"):
            await port.open()

    asyncio.run(ask())


@pytest.mark.parametrize("port", ["tcp://scale", "tcp://:4001", "tcp://scale:0", "tcp://scale:x"])
def test_incomplete_tcp_address_is_refused(port: str) -> None:
    with pytest.raises(ValidationError, match="not of the form tcp://HOST:PORT"):
        PortConfig(port=port)


@pytest.mark.parametrize("late_s", [0.12, 0.22, 0.35, 0.6])
def test_constantly_late_answers_are_never_used(far: Far, late_s: float) -> None:
    """Nor is one of another question; a stall of this machine may hide that it is late."""

    async def main() -> None:
        async with opened(far, late_s=0.15) as port:
            device = asyncio.create_task(answers(far, *[late_s] * 30))
            for asked in range(5):
                answer = await port.ask(b"?\n", lambda line: line, timeout_s=0.1)
                assert answer in (None, b"%d" % asked), f"question {asked} got {answer!r}"
            assert port.late
            device.cancel()

    asyncio.run(main())


def stall_until_answer(far: Far, answer: bytes, stall_s: float) -> None:
    """Hold the loop up, as a busy computer does: the answer and the timeout come together."""
    far.send(answer)
    time.sleep(stall_s)


def test_answer_that_came_during_stall_is_taken(far: Far) -> None:
    async def main() -> None:
        async with opened(far) as port:
            asyncio.get_running_loop().call_later(0.01, stall_until_answer, far, b"7\r\n", 0.2)
            assert await port.ask(b"?\n", lambda line: line, timeout_s=0.1) == b"7"

    asyncio.run(main())


def test_late_answer_before_next_question_is_counted(far: Far) -> None:
    """It comes with the end of the wait for it."""

    async def main() -> None:
        async with opened(far, late_s=0.1) as port:
            assert await port.ask(b"?\n", lambda line: line, timeout_s=0.02) is None
            far.receive()
            asyncio.get_running_loop().call_later(0.01, stall_until_answer, far, b"7\r\n", 0.2)
            device = asyncio.create_task(answers(far, 0.0, 0.0))
            assert await port.ask(b"?\n", lambda line: line, timeout_s=20.0) == b"0"
            assert port.late == 1
            device.cancel()

    asyncio.run(main())


def test_question_after_late_answer_gets_its_own(far: Far) -> None:
    async def main() -> None:
        async with opened(far) as port:
            device = asyncio.create_task(answers(far, 0.0, 0.3, 0.0, 0.0, 0.0))
            got = [await port.ask(b"?\n", lambda line: line, 0.2) for _ in range(4)]
            assert got == [b"0", None, b"2", b"3"]  # 1 was late
            device.cancel()

    asyncio.run(main())


def test_action_with_doubtful_answer_is_sent_once(far: Far) -> None:
    async def main() -> None:
        async with opened(far, late_s=0.1) as port:
            assert await port.ask(b"?\n", lambda line: line, timeout_s=0.02) is None
            asyncio.get_running_loop().call_later(0.5, far.send, b"done\r\n")
            assert await port.ask(b"step\n", lambda line: line, timeout_s=20.0, once=True) is None
            assert far.receive() == b"?\nstep\n"
            assert not port.is_doubtful

    asyncio.run(main())


def test_rest_of_a_line_is_no_answer(far: Far) -> None:
    async def main() -> None:
        async with opened(far) as port:
            loop = asyncio.get_running_loop()
            loop.call_later(0.1, far.send, b"12")
            loop.call_later(0.3, far.send, b"3.45\r\n")
            assert await port.ask(b"?\n", lambda line: line, 0.2) is None
            loop.call_later(0.15, far.send, b"6.25\r\n")
            await port.question(b"?\n")
            assert await port.line(1.0) == b"6.25"

    asyncio.run(main())


def test_cancelled_question_leaves_no_answer_behind(far: Far) -> None:
    async def main() -> None:
        async with opened(far) as port:
            device = asyncio.create_task(answers(far, 0.15, 0.0, 0.0))
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(port.ask(b"?\n", lambda line: line, 5.0), 0.05)
            assert await port.ask(b"?\n", lambda line: line, 0.2) == b"1"
            device.cancel()

    asyncio.run(main())


def test_unplugging_ends_the_wait_for_a_line(far: Far) -> None:
    async def main() -> None:
        async with opened(far) as port:
            asyncio.get_running_loop().call_later(0.05, far.unplug)
            with pytest.raises(DeviceError, match="is gone"):
                await port.line(20.0)
            with pytest.raises(DeviceError, match="is gone"):
                port.send(b"?")

    asyncio.run(main())


@pytest.fixture
def senders() -> Iterator[tuple[socket.socket, socket.socket]]:
    """Two hosts that send datagrams: addresses of this machine."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        ours.bind(("127.0.0.1", 0))
        other.bind(("127.0.0.2", 0))
        yield ours, other


def test_datagrams_of_one_host_alone_are_taken(
    senders: tuple[socket.socket, socket.socket],
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        number = free.getsockname()[1]
    port = DatagramPort("127.0.0.1", number, "localhost", longest=4)
    port.open()
    with pytest.raises(LinkError, match="is open already"):
        port.open()
    with pytest.raises(LinkError, match="cannot be opened"):
        DatagramPort("127.0.0.1", number).open()
    assert not port.wait(0.0)
    for sender, data in ((0, b"1234"), (1, b"2"), (0, b"12345"), (0, b"3")):
        senders[sender].sendto(data, ("127.0.0.1", number))
    assert port.wait(1.0)
    assert [item.data for item in port.receive(2)] == [b"1234"]
    assert port.crowded
    assert [item.data for item in port.receive(9)] == [b"3"]
    assert not port.crowded
    assert (port.foreign, port.stranger, port.overlong) == (1, "127.0.0.2", 1)
    port.close()
    port.close()
    with pytest.raises(LinkError, match="is not open"):
        port.receive(1)


def test_sender_of_unknown_name_is_refused() -> None:
    with pytest.raises(LinkError, match=r"the sender '\.\.' .* is not known"):
        DatagramPort("127.0.0.1", 1024, "..").open()

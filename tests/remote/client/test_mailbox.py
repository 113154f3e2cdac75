"""What comes from a network thread, taken on an event loop."""

from __future__ import annotations

import asyncio
import threading

from rigd.remote.client.payload_queue import PayloadQueue


def put_all(mailbox: PayloadQueue, payloads: list[bytes]) -> None:
    for payload in payloads:
        mailbox.put(payload)


def test_payloads_are_taken_in_order() -> None:
    async def take() -> list[bytes]:
        mailbox = PayloadQueue(10_000)
        sent = [str(number).encode() for number in range(5000)]
        threading.Thread(target=lambda: put_all(mailbox, sent)).start()
        taken = []
        async for payload in mailbox:
            taken.append(payload)
            if len(taken) == len(sent):
                break
        assert taken == sent
        return taken

    asyncio.run(asyncio.wait_for(take(), 30))


def test_full_queue_keeps_the_newest() -> None:
    async def take() -> None:
        mailbox = PayloadQueue(3)
        for number in range(10):
            mailbox.put(bytes([number]))
        mailbox.close()
        assert [payload[0] async for payload in mailbox] == [7, 8, 9]

    asyncio.run(take())


def test_closing_ends_a_waiting_reader() -> None:
    async def take() -> None:
        mailbox = PayloadQueue(3)

        async def read() -> list[bytes]:
            return [payload async for payload in mailbox]

        reading = asyncio.create_task(read())
        await asyncio.sleep(0)
        mailbox.close()
        assert await asyncio.wait_for(reading, 30) == []

    asyncio.run(take())


def test_put_after_loop_ended_raises_nothing() -> None:
    async def make() -> PayloadQueue:
        return PayloadQueue(3)

    mailbox = asyncio.run(make())
    mailbox.put(b"late")

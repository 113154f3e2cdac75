"""Sends Modbus requests: the cycle polls without waiting, other callers wait with a time limit."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from rigd.sdk import DeviceError, LinkError, readable
from rigd_drivers.modbus.exchange import Answer, Exchange, Failure
from rigd_drivers.modbus.framing import Trouble
from rigd_drivers.modbus.pdu import EXCEPTIONS, PASSING, Request
from rigd_drivers.modbus.transport import Transport

#: How long opening a connection may take, in s.
OPEN_S: Final = 2.0
#: How often, and for how many s, :meth:`Client.ask` asks before it gives up, and at most.
TRIES: Final = 5
TRYING_S: Final = 1.0
ASK_S: Final = 3.0

_WORDS: Final = {
    Trouble.TIMEOUT: "no answer",
    Trouble.WRONG_UNIT: "an answer from another unit",
    Trouble.WRONG_TRANSACTION: "an answer with a transaction number never asked with",
    Trouble.WRONG_REPLY: "an answer to something else",
    Trouble.CRC: "an answer with a wrong check sum",
    Trouble.GARBLED: "an answer cut short or with bytes that belong to no frame",
    Trouble.REFUSED: "a refusal",
}


class Client:
    """One connection to one unit."""

    def __init__(
        self,
        transport: Transport,
        exchange: Exchange,
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.where = transport.where
        self._transport = transport
        self._exchange = exchange
        self._now_ns = now_ns

    def open(self, timeout_s: float = OPEN_S, *, again: bool = False) -> None:
        """Open the connection, within ``timeout_s``; ``again``: at the address that it had.

        Raises:
            LinkError: it cannot be opened.

        """
        self._transport.open(timeout_s, again=again)

    def close(self) -> None:
        """Close the connection; closing twice is silent."""
        self._transport.close()

    @property
    def counts(self) -> list[int]:
        """How often each :class:`Trouble` was met, in their order."""
        return self._exchange.counts

    def status(self) -> int:
        """Return the troubles since the last call as status bits; see :class:`Exchange`."""
        return self._exchange.status()

    def poll(self) -> Answer | Failure | None:
        """Take in what has arrived; return how the request ended, once it has; never waits.

        Raises:
            LinkError: the connection is lost.
            ProtocolError: what comes is not Modbus.

        """
        return self._exchange.receive(self._transport.receive(), self._now_ns())

    def free(self) -> bool:
        """Return whether :meth:`start` may be called; to be asked right after :meth:`poll`."""
        return self._exchange.free(self._now_ns())

    def start(self, request: Request) -> None:
        """Send ``request``; never waits.

        Raises:
            LinkError: the connection is lost.

        """
        self._transport.send(self._exchange.send(request, self._now_ns()))

    def ask(self, request: Request, within_s: float = ASK_S) -> tuple[int, ...]:
        """Wait for the answer to ``request``: the registers read, none after a write.

        A request under way is waited out first. A failed one is made again, five times and for a
        second: this computer may stall, and the device may be busy.

        Raises:
            LinkError: no answer within ``within_s``.
            ProtocolError: what comes is not Modbus.
            DeviceError: the device refused.

        """
        now_ns = self._now_ns()
        limit_ns, trying_ns = now_ns + round(within_s * 1e9), now_ns + round(TRYING_S * 1e9)
        failure, tries = None, 0
        while tries < TRIES or self._now_ns() < trying_ns:
            tries += 1
            if not self._wait_free(limit_ns):
                break
            self.start(request)
            outcome = self._wait_outcome(limit_ns)
            if isinstance(outcome, Answer):
                return outcome.words
            failure = outcome
            if outcome is None or _is_final(outcome):
                break
        raise self._gave_up(request, failure, within_s)

    def longest_s(self, request: Request) -> float:
        """Return how long ``request`` takes at most, until its answer is here, in s."""
        return self._exchange.longest_ns(request) * 1e-9

    def insist(self, request: Request, within_s: float) -> None:
        """Send a write again and again until it is acknowledged, at most ``within_s`` long.

        Does not wait for a request under way for longer than a third of that, nor for the line
        to settle after a failure.

        Raises:
            LinkError: not acknowledged, or the connection is lost.
            ProtocolError: what comes is not Modbus.
            DeviceError: the device refused.

        """
        now_ns = self._now_ns()
        limit_ns = now_ns + round(within_s * 1e9)
        self._wait_outcome(now_ns + round(within_s / 3 * 1e9))
        failure = None
        while self._now_ns() < limit_ns:
            self._exchange.abandon(self._now_ns())
            if not self._wait_free(limit_ns):
                break
            self.start(request)
            outcome = self._wait_outcome(limit_ns)
            if isinstance(outcome, Answer):
                return
            failure = outcome or failure
            if outcome is not None and _is_final(outcome):
                break
        raise self._gave_up(request, failure, within_s)

    def _wait_free(self, limit_ns: int) -> bool:
        while True:
            self.poll()
            if self.free():
                return True
            if not self._wait(limit_ns):
                return False

    def _wait_outcome(self, limit_ns: int) -> Answer | Failure | None:
        """Wait for the end of the request under way, if there is one."""
        while self._exchange.waiting:
            outcome = self.poll()
            if outcome is not None:
                return outcome
            if not self._wait(limit_ns):
                break
        return None

    def _wait(self, limit_ns: int) -> bool:
        """Wait for bytes or for the next change; False once ``limit_ns`` is over."""
        now_ns = self._now_ns()
        if now_ns >= limit_ns:
            return False
        until_ns = min(limit_ns, max(self._exchange.next_ns, now_ns))
        readable(self._transport.fileno(), (until_ns - now_ns) * 1e-9)
        return True

    def _gave_up(self, request: Request, failure: Failure | None, within_s: float) -> Exception:
        if failure is None:
            return LinkError(f"{self.where}: no answer to the {request.text} in {within_s:g} s")
        if failure.trouble is Trouble.REFUSED:
            return refusal(self.where, failure)
        return LinkError(
            f"{self.where}: {_WORDS[failure.trouble]} to the {request.text}",
            hint="check the wiring (A and B), that the device is on, baud rate, parity and unit",
        )


def _is_final(failure: Failure) -> bool:
    return failure.trouble is Trouble.REFUSED and failure.code not in PASSING


def refusal(where: str, failure: Failure) -> DeviceError:
    """Return the error that names what the device declined, and why."""
    meaning = EXCEPTIONS.get(failure.code, "of the device's own")
    return DeviceError(
        f"{where} refused the {failure.request.text}: exception {failure.code}, {meaning}",
        hint="compare the register map with the manual of this device and its firmware"
        if failure.code in (1, 2, 3)
        else None,
    )

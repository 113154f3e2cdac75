"""Asks a scale for its type, software and serial number, as far as the scale reports them."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Final

from rigd_drivers.instruments.scale import and_d, sics
from rigd_drivers.instruments.scale.dialects import DIALECTS, DialectName
from rigd_drivers.instruments.scale.replies import Info

#: Lines read before an answer is given up: I2 has at most a handful.
_MAX_LINES: Final = 16

Send = Callable[[bytes], Awaitable[None]]
Line = Callable[[], Awaitable[bytes | None]]


async def ask(dialect: DialectName, send: Send, line: Line) -> str:
    """Return a line for a person, without values that the scale does not report.

    ``line`` returns the next line, or None after a while without a line.
    """
    if dialect in ("and-d-indicator", "sartorius-sbi", "ohaus"):
        return DIALECTS[dialect].title  # no question that all of them answer
    if dialect == "and-d":
        questions = {b"?TN": "type", b"?SN": "serial number"}
        answers = {what: await _ask_and_d(name, send, line) for name, what in questions.items()}
    else:
        questions = {b"I2": "type", b"I3": "software", b"I4": "serial number"}
        answers = {what: await _ask_sics(name, send, line) for name, what in questions.items()}
    parts = [f"{what} {text}" for what, text in answers.items() if text]
    return ", ".join([DIALECTS[dialect].title, *parts])


async def _ask_sics(name: bytes, send: Send, line: Line) -> str:
    await send(name + b"\r\n")
    texts: list[str] = []
    for _ in range(_MAX_LINES):
        answer = await line()
        if answer is None:
            break
        info = sics.parse_info(answer, name)
        if isinstance(info, Info):
            texts += info.texts
        if info is not None and (not isinstance(info, Info) or info.last):
            break
    return " ".join(texts)


async def _ask_and_d(name: bytes, send: Send, line: Line) -> str:
    await send(name + b"\r\n")
    for _ in range(_MAX_LINES):
        answer = await line()
        if answer is None or and_d.parse_error(answer) is not None:
            break
        text = and_d.parse_text(answer, name.removeprefix(b"?"))
        if text is not None:
            return text
    return ""

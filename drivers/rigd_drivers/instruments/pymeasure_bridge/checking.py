"""Checks what a rig file asks of a class of PyMeasure, without an instrument.

``python -m rigd_drivers.instruments.pymeasure_bridge.checking`` reads questions as JSON and writes
an answer for each: importing PyMeasure takes a second, which no other process is to spend.
"""

from __future__ import annotations

import dis
import inspect
import json
import subprocess
import sys
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final, Literal, NamedTuple

from rigd_drivers.instruments.pymeasure_bridge.attributes import (
    Unusable,
    check_name,
    find_class,
    static,
)

#: Longest time for the import of PyMeasure and of the class, in s.
_CHECK_S: Final = 60.0
#: What makes an attribute whose name only the running code knows.
_MAKING: Final = frozenset({"add_child", "setattr"})
#: Options of Python for a process of PyMeasure: modules come from where they are installed, not
#: from the working folder, and what PyMeasure calls outdated is no matter of the user of a rig.
PYTHON: Final = (sys.executable, "-P", "-W", "ignore", "-m")


class Use(NamedTuple):
    """How a rig file uses an attribute, and the values that it writes."""

    path: str
    how: Literal["read", "write", "call"]
    values: tuple[bool | int | float | str, ...] = ()


@lru_cache(maxsize=64)
def problems(instrument: str, uses: tuple[Use, ...]) -> tuple[str, ...]:
    """Return what is wrong with the class, then with each of ``uses``; "" where nothing is.

    Raises:
        ValueError: the check itself has failed.
    """
    try:
        done = subprocess.run(
            [*PYTHON, __name__],
            input=json.dumps([instrument, uses]),
            capture_output=True, text=True, timeout=_CHECK_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise ValueError(
            f"the import of {instrument} took more than {_CHECK_S:g} s: it could not be checked"
        ) from error
    try:
        return tuple(json.loads(done.stdout.splitlines()[-1]))
    except (IndexError, ValueError) as error:
        words = (done.stderr.strip().splitlines() or ["it ended without a message"])[-1]
        raise ValueError(f"{instrument} could not be checked: {words}") from error


def found(instrument: str, uses: Sequence[Use]) -> list[str]:
    """Return what :func:`problems` does; it imports PyMeasure."""
    try:
        kind = find_class(instrument)
    except Unusable as error:
        return [str(error), *("" for _ in uses)]
    root, possible = _skeleton(kind)
    return ["", *(_problem(root, possible, use) for use in uses)]


def _skeleton(kind: Any) -> tuple[Any, frozenset[str]]:
    """Return an instrument whose constructor was not run, so that nothing is opened.

    It has its channels. Also returns names that its methods may give it besides; with one of
    :data:`_MAKING` that may be any name.
    """
    from pymeasure.instruments.common_base import CommonBase

    names: set[str] = set()
    functions = (
        item
        for each in kind.__mro__
        if each is not CommonBase
        for item in vars(each).values()
        if inspect.isfunction(item)
    )
    for code in (item.__code__ for item in functions):  # a constructor may call any of them
        names.update(_MAKING.intersection(code.co_names))
        names.update(
            step.argval for step in dis.get_instructions(code) if step.opname == "STORE_ATTR"
        )
    root = kind.__new__(kind)
    try:
        CommonBase.__init__(root)
    except Exception:  # noqa: BLE001 - code of others: a channel that asks its instrument at once
        names.update(_MAKING)
    return root, frozenset(names)


def _problem(root: Any, possible: frozenset[str], use: Use) -> str:
    try:
        return _checked(root, possible, use)
    except Unusable as error:
        return str(error)


def _checked(root: Any, possible: frozenset[str], use: Use) -> str:
    *parents, name = use.path.split(".")
    owner, first = root, use.path.partition(".")[0]
    if first in possible and not isinstance(static(root, first), property):
        return ""  # it may be another once the instrument is open
    try:
        for part in parents:
            check_name(owner, part, use.path)
            if isinstance(static(owner, part), property):
                return ""  # only the instrument knows
            owner = getattr(owner, part)
        check_name(owner, name, use.path)
    except Unusable:
        if owner is root and possible & _MAKING:
            return ""  # it may be made when the instrument is opened
        raise
    item = static(owner, name)
    is_method = inspect.isroutine(item)
    if use.how == "call":
        return _wrong_call(item, use.path) if is_method else f"{use.path} is no method"
    if is_method:
        return f"{use.path} is a method: an attribute is expected"
    if not isinstance(item, property):
        return ""
    return _unreadable(item, use) if use.how == "read" else _unwritable(item, use)


def _wrong_call(method: Any, path: str) -> str:
    from pymeasure.instruments import Instrument

    if method is static(Instrument, "shutdown"):
        return f"{path} of this class does nothing at the instrument: write an attribute"
    signature = inspect.signature(method)
    try:
        signature.bind(None)
    except TypeError:
        return f"{path} needs arguments: {signature}"
    return ""


def _defaults(function: Any) -> dict[str, Any]:
    """Return what PyMeasure has made a property with, such as its commands and validator."""
    return {name: item.default for name, item in inspect.signature(function).parameters.items()}


def _unreadable(item: property, use: Use) -> str:
    if item.fget is None or _defaults(item.fget).get("get_command", "") is None:
        return f"{use.path} cannot be read: PyMeasure has no question for it"
    return ""


def _unwritable(item: property, use: Use) -> str:
    if item.fset is None or _defaults(item.fset).get("set_command", "") is None:
        return f"{use.path} cannot be written: PyMeasure has no command for it"
    made = _defaults(item.fset)
    if type(item) is not property or not callable(made.get("validator")):
        return ""  # the range of a dynamic property may be another once it is open
    for value in use.values:
        try:
            taken = made["validator"](value, made.get("values"))
        except Exception as error:  # noqa: BLE001 - code of others: whatever it raises, it refuses
            return f"PyMeasure refuses {value!r} for {use.path}: {error}"
        if isinstance(taken, (int, float)) and taken != value:
            return f"PyMeasure makes {taken!r} of {value!r} for {use.path}"
    return ""


def main() -> None:
    """Answer the questions of :func:`problems`."""
    instrument, uses = json.load(sys.stdin)
    answers = found(instrument, [Use(path, how, tuple(values)) for path, how, values in uses])
    sys.stdout.write(f"\n{json.dumps(answers)}\n")


if __name__ == "__main__":
    main()

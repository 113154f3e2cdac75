"""Finds, reads, writes and calls attributes of an instrument of PyMeasure, named with dots.

It runs in the process of the instrument, and needs PyMeasure only for :func:`find_class`.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from difflib import get_close_matches
from enum import Enum
from importlib import import_module
from typing import Any, Final

#: Most names that a message lists.
_LISTED: Final = 6
_ABSENT: Final = object()
#: Longest text of a value in a message.
_LONGEST: Final = 80


class Unusable(ValueError):
    """A class or an attribute is not there, or cannot be used so; the text says which."""


def find_class(dotted: str) -> Any:
    """Return the class that ``dotted`` names; only its module is imported.

    Raises:
        Unusable: there is no such module or class, or it is no instrument of PyMeasure.
    """
    from pymeasure.instruments import Instrument

    module, _, name = dotted.rpartition(".")
    try:
        found = import_module(module)
    except ModuleNotFoundError as error:
        raise Unusable(_missing_module(module, error.name or module)) from error
    kind = getattr(found, name, None)
    if isinstance(kind, type) and issubclass(kind, Instrument):
        return kind
    if kind is not None:
        raise Unusable(f"{dotted} is no subclass of pymeasure.instruments.Instrument")
    known = [
        each
        for each, item in vars(found).items()
        if isinstance(item, type) and issubclass(item, Instrument) and item is not Instrument
    ]
    raise Unusable(f"{module} has no class {name!r}{near(name, known)}")


def _missing_module(module: str, missing: str) -> str:
    if module != missing and not module.startswith(f"{missing}."):
        return f"{module} needs the package {missing.partition('.')[0]!r}, which is not installed"
    return f"there is no module {missing}"


def near(name: str, known: Iterable[str]) -> str:
    """Return "; it has ...", with those names of ``known`` that are nearest to ``name``."""
    names = sorted(each for each in known if not each.startswith("_"))
    lower = {each.lower(): each for each in names}
    found = [lower[each] for each in get_close_matches(name.lower(), lower, _LISTED)]
    listed = found or names[:_LISTED]
    return f"; it has {', '.join(listed)}" if listed else ""


def place(root: object, path: str) -> tuple[Any, str]:
    """Return the object that has the attribute ``path`` of ``root``, and the name in it.

    Raises:
        Unusable: one of the names is not there.
    """
    *parents, name = path.split(".")
    owner: Any = root
    for part in parents:
        check_name(owner, part, path)
        owner = getattr(owner, part)
    check_name(owner, name, path)
    return owner, name


def static(owner: object, name: str) -> Any:
    """Return what ``owner`` has as ``name``, without running its code; None if nothing."""
    return inspect.getattr_static(owner, name, None)


def check_name(owner: object, name: str, path: str) -> None:
    """Check that ``owner`` has ``name``, a part of ``path``.

    Raises:
        Unusable: it does not.
    """
    if inspect.getattr_static(owner, name, _ABSENT) is _ABSENT:
        inside = "" if name == path else f" (in {path})"
        raise Unusable(
            f"{type(owner).__name__} has no attribute {name!r}{inside}{near(name, dir(owner))}"
        )


def read(root: object, path: str) -> Any:
    """Return the value of an attribute as :func:`plain` has it."""
    owner, name = place(root, path)
    found = getattr(owner, name)
    if inspect.isroutine(found):
        raise Unusable(f"{path} is a method, and no attribute that can be read")
    return plain(found)


def write(root: object, path: str, value: object) -> None:
    """Give an attribute that is there a value; PyMeasure sends it."""
    owner, name = place(root, path)
    if inspect.isroutine(static(owner, name)):
        raise Unusable(f"{path} is a method, and no attribute that can be written")
    setattr(owner, name, value)


def call(root: object, path: str) -> Any:
    """Call a method without arguments, and return what it returns as :func:`plain` has it."""
    owner, name = place(root, path)
    method = getattr(owner, name)
    if not inspect.isroutine(method):
        raise Unusable(f"{path} is no method that can be called")
    return plain(method())


def plain(value: Any) -> Any:
    """Return a truth value, number or text as it is, also one of numpy or an enumeration.

    All else becomes a list with its type and its text: it is no number and no text.
    """
    if isinstance(value, Enum) and not isinstance(value, (int, str)):
        value = value.name
    if getattr(value, "shape", None) == () and hasattr(value, "item"):
        value = value.item()
    for kind in (bool, int, float, str):
        if isinstance(value, kind):
            return value if type(value) is kind else kind(value)
    if value is None or (isinstance(value, (list, tuple)) and not value):
        return None
    return [type(value).__name__, repr(value)[:_LONGEST]]

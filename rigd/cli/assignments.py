"""Options of the shape ``NAME=VALUE``, such as ``--set`` and ``--meta``."""

from __future__ import annotations

from collections.abc import Iterable


def read_assignments(texts: Iterable[str], shape: str = "NAME=VALUE") -> dict[str, str]:
    """Return the values by name; of a name that is given twice, the last.

    Raises:
        ConfigError: one has no ``=``, or no name before it.
    """
    from rigd.model.errors import ConfigError

    values = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise ConfigError(f"{text!r} is not {shape}", hint="write 'floor=pvc', without spaces")
        values[name.strip()] = value.strip()
    return values

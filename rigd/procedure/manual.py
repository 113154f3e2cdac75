"""Writes a manual movement (jog) as a procedure, so that the same limits and recording apply."""

from __future__ import annotations

from collections.abc import Mapping

#: Names that a user can give are channel names; other text could be YAML syntax.
_QUOTED = str.maketrans({"\\": "\\\\", '"': '\\"', "\n": " "})


def jog_text(setpoints: Mapping[str, str], duration: str) -> str:
    """Return the procedure that holds ``setpoints`` for ``duration``, then goes to rest.

    Both are texts of the user: ``{"wheel_servo.current": "0.1 A"}``, ``"2 s"``. The usual check of
    a procedure finds their errors.
    """
    moves = ", ".join(f'"{name.translate(_QUOTED)}": {_text(to)}' for name, to in setpoints.items())
    return (
        "procedure: jog\ntitle: Moved by hand\ndoc: Holds setpoints for a while, then ramps "
        f"them to rest.\ntrial:\n  steps:\n    - step: jog\n      set: {{{moves}}}\n      "
        f"for: {_text(duration)}\nrecord: all\n"
    )


def _text(value: str) -> str:
    return f'"{value.translate(_QUOTED)}"'

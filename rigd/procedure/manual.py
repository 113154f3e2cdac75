"""Writes a movement by hand as a procedure, with the same limits and recording."""

from __future__ import annotations

from collections.abc import Mapping

#: Names that a person can give are channel names; anything else would be YAML of its own.
_QUOTED = str.maketrans({"\\": "\\\\", '"': '\\"', "\n": " "})


def jog_text(setpoints: Mapping[str, str], duration: str) -> str:
    """Return the procedure that holds ``setpoints`` for ``duration``, then goes to rest.

    Both are as a person writes them: ``{"wheel_servo.current": "0.1 A"}``, ``"2 s"``. What is
    wrong with them is found where every procedure is checked.
    """
    moves = ", ".join(f'"{name.translate(_QUOTED)}": {_text(to)}' for name, to in setpoints.items())
    return (
        "procedure: jog\n"
        "title: Moved by hand\n"
        "doc: Holds setpoints for a while, then lets them go to rest.\n"
        "trial:\n"
        "  steps:\n"
        "    - step: jog\n"
        f"      set: {{{moves}}}\n"
        f"      for: {_text(duration)}\n"
        "record: all\n"
    )


def _text(value: str) -> str:
    return f'"{value.translate(_QUOTED)}"'

"""Prints the results of ``rigd doctor``: one line for each check, with its remedy."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap
from typing import Final

from rich.console import Console
from rich.text import Text

from rigd.config.loader import channel_names
from rigd.config.rig import RigConfig
from rigd.config.shipped_files import titled
from rigd.daemon.doctor import Check, CheckVerdict, is_fit

_COLOUR: Final = {
    CheckVerdict.OK: "green",
    CheckVerdict.WARN: "yellow",
    CheckVerdict.FAIL: "bold red",
}
#: Widths of the columns before the finding: verdict, name.
_VERDICT_WIDTH: Final = 4
_NAME_WIDTH: Final = 18
#: Names of channels are longer; the longest name of a rig sets the width, up to this.
_CHANNEL_WIDTH: Final = 34
#: The least width for the finding, however narrow the terminal.
_LEAST_ROOM: Final = 20


class CheckupView:
    """Prints checks as they are made, under the heading of their group."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._group = ""
        self._channel_width = _NAME_WIDTH

    def begin(self, rig: RigConfig | None, seconds: float) -> None:
        """Print what the examination does, before it begins."""
        if rig is not None:
            longest = max(map(len, channel_names(rig)), default=0)
            self._channel_width = max(min(longest, _CHANNEL_WIDTH), _NAME_WIDTH)
            self._console.print(f"rig {titled(rig.name, rig.source.location)}", markup=False)
        if rig is None:
            text = f"This takes about {seconds + 2:.0f} s. --rig examines a rig too."
        else:
            text = f"This takes about {2 * seconds + 10:.0f} s. It opens every device of the rig"
            if rig.plant is None and any(device.is_actuator for device in rig.devices.values()):
                text += (
                    ", and stops the heartbeat to each drive once, to prove that the drive "
                    "makes itself safe"
                )
            text += ". Nothing is armed; keep the rig at rest."
        self._console.print(text, style="dim")

    def show(self, check: Check) -> None:
        """Print one check."""
        if check.group != self._group:
            self._group = check.group
            self._console.print()
            self._console.print(Text(check.group, style="bold"))
        width = self._channel_width if "." in check.name else _NAME_WIDTH
        indent = " " * (2 + _VERDICT_WIDTH + 1 + width + 1)
        room = max(self._console.width - len(indent), _LEAST_ROOM)
        name = check.name.ljust(width)
        line = Text("  ")
        line.append(check.verdict.value.ljust(_VERDICT_WIDTH), style=_COLOUR[check.verdict])
        line.append(f" {name}" + (" " if len(name) == width else f"\n{indent}"))
        line.append(f"\n{indent}".join(_wrapped(check.found, room)))
        if check.advice:
            line.append(
                "".join(f"\n{indent}{item}" for item in _wrapped(check.advice, room)), "italic"
            )
        self._console.print(line, soft_wrap=True)

    def conclude(self, checks: Sequence[Check]) -> None:
        """Print the number of checks per verdict."""
        count = {
            verdict: sum(check.verdict is verdict for check in checks) for verdict in CheckVerdict
        }
        fit = is_fit(checks)
        word = Text(
            "fit" if fit else "not fit",
            style=_COLOUR[CheckVerdict.OK if fit else CheckVerdict.FAIL],
        )
        rest = f": {count[CheckVerdict.OK]} ok, {count[CheckVerdict.WARN]} to look at"
        if not fit:
            rest += f", {count[CheckVerdict.FAIL]} failed"
        self._console.print()
        self._console.print(word.append(rest, style="default"))


def _wrapped(text: str, room: int) -> list[str]:
    return wrap(text, room, break_on_hyphens=False)  # paths stay whole if they fit


def as_json(checks: Sequence[Check], *, whole: bool) -> dict[str, object]:
    """Return the checks for a script; ``whole`` is true if the user interrupted none of them."""
    return {
        "fit": whole and is_fit(checks),
        "whole": whole,
        "checks": [
            {
                "group": check.group,
                "name": check.name,
                "verdict": check.verdict.value,
                "found": check.found,
                "advice": check.advice,
                **({"figures": dict(check.figures)} if check.figures else {}),
            }
            for check in checks
        ],
    }

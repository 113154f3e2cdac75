"""Shows what the doctor finds: a line per check, and what to do below it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from rigd.config.rig import RigConfig
from rigd.daemon.doctor import Check, Verdict, is_fit

_COLOUR: Final = {Verdict.OK: "green", Verdict.WARN: "yellow", Verdict.FAIL: "bold red"}
#: Columns before what was found: the verdict, the name.
_VERDICT_WIDTH: Final = 4
_NAME_WIDTH: Final = 22


class CheckupView:
    """Prints checks as they come, under the heading of their group."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._group = ""

    def begin(self, rig: RigConfig | None, seconds: float) -> None:
        """Say what is going to happen, before it does."""
        if rig is None:
            text = f"This takes about {seconds + 2:.0f} s. With --rig, a rig is examined too."
        else:
            text = (
                f"This takes about {2 * seconds + 10:.0f} s. Every device of rig {rig.name} is "
                "opened"
            )
            if rig.plant is None and any(one.setpoints for one in rig.devices.values()):
                text += (
                    ", and each drive is left without our heartbeat once, to prove that it makes "
                    "itself safe"
                )
            text += ". Nothing is armed; let the rig stand still."
        self._console.print(text, style="dim")

    def show(self, check: Check) -> None:
        """Print one check."""
        if check.group != self._group:
            self._group = check.group
            self._console.print()
            self._console.print(Text(check.group, style="bold"))
        line = Table.grid(padding=(0, 1))
        line.add_column(width=_VERDICT_WIDTH)
        line.add_column(width=_NAME_WIDTH, overflow="fold")
        line.add_column(overflow="fold")
        found = Text(check.found)
        if check.advice:
            found.append(f"\n{check.advice}", style="italic")
        verdict = Text(check.verdict.value, style=_COLOUR[check.verdict])
        line.add_row(verdict, check.name, found)
        self._console.print(Padding(line, (0, 0, 0, 2)))

    def conclude(self, checks: Sequence[Check]) -> None:
        """Say what it comes to."""
        count = {verdict: sum(one.verdict is verdict for one in checks) for verdict in Verdict}
        fit = is_fit(checks)
        word = Text("fit" if fit else "not fit", style=_COLOUR[Verdict.OK if fit else Verdict.FAIL])
        rest = f": {count[Verdict.OK]} ok, {count[Verdict.WARN]} to look at"
        if not fit:
            rest += f", {count[Verdict.FAIL]} failed"
        self._console.print()
        self._console.print(word.append(rest, style="default"))


def as_json(checks: Sequence[Check], *, whole: bool) -> dict[str, object]:
    """Return the checks for a script; ``whole``: nobody interrupted them."""
    return {
        "fit": whole and is_fit(checks),
        "whole": whole,
        "checks": [
            {
                "group": one.group,
                "name": one.name,
                "verdict": one.verdict.value,
                "found": one.found,
                "advice": one.advice,
                **({"figures": dict(one.figures)} if one.figures else {}),
            }
            for one in checks
        ],
    }

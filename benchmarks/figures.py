"""The one line by which a benchmark reports a figure; ``all.py`` gathers these lines in a table."""

from __future__ import annotations

PREFIX = "figure:"


def at_least(name: str, value: float, target: float, unit: str = "x") -> None:
    """Report a figure that should be ``target`` or more."""
    _line(name, value, f">= {target:g}", unit, value >= target)


def at_most(name: str, value: float, target: float, unit: str = "x") -> None:
    """Report a figure that should be ``target`` or less."""
    _line(name, value, f"<= {target:g}", unit, value <= target)


def noted(name: str, value: float, unit: str) -> None:
    """Report a figure without a target."""
    _line(name, value, "", unit, None)


def _line(name: str, value: float, target: str, unit: str, met: bool | None) -> None:
    verdict = "" if met is None else "ok" if met else "MISSED"
    print(f"{PREFIX} {name} | {value:.4g} {unit} | {target} | {verdict}", flush=True)

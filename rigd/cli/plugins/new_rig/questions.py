"""Asks for the few numbers that make a pin-on-disk, and writes its description."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from rigd.cli.asking import ask
from rigd.model.errors import ConfigError
from rigd.model.units import format_quantity, parse_quantity
from rigd.sdk import In

_TEMPLATE: Final = Path(__file__).parents[2] / "templates" / "rig" / "pin_on_disk.yaml.jinja"


@dataclass(frozen=True)
class BenchQuestion:
    """One number: what it is, its SI unit, its default, and what it may be in SI."""

    key: str
    text: str
    unit: str
    default: str
    low: float
    high: float
    note: str = ""  #: what becomes of the answer; stands in the question only

    @property
    def usual(self) -> str:
        """The unit in which people give it."""
        return parse_quantity(self.default).unit.symbol

    def accepted(self, answer: str) -> str:
        """Return the answer as it is written down; the default if it is empty.

        Raises:
            ValueError: it is no such quantity, or not in the range.
        """
        text = answer.strip() or self.default
        if self.unit != "1" and parse_quantity(text).unit.symbol == "1":
            raise ValueError(f"{text} has no unit: write '{text} {self.usual}'")
        value = In(self.unit).read(text)
        if not self.low <= value <= self.high:
            low, high = (format_quantity(bound, self.unit) for bound in (self.low, self.high))
            raise ValueError(f"'{text}' is not within {low} to {high}")
        return str(parse_quantity(text))


QUESTIONS: Final = (
    BenchQuestion("radius", "Radius of the track on the disk", "m", "30 mm", 1e-3, 1.0),
    BenchQuestion(
        "inertia", "Inertia of the disk with its drive", "kg m^2", "6e-3 kg m^2", 1e-5, 10.0
    ),
    BenchQuestion(
        "speed",
        "Largest speed of the disk",
        "rad/s",
        "60 rad/s",
        1.0,
        1e4,
        "; the limit becomes 80 % of it, its rate that much per second",
    ),
    BenchQuestion("torque", "Largest torque of the drive at the disk", "N m", "4 N m", 1e-2, 1e4),
    BenchQuestion("load", "Mass of the dead weight on the pin", "kg", "1 kg", 1e-3, 1e3),
    BenchQuestion("force", "Range of the load cell", "N", "50 N", 1e-2, 1e5),
    BenchQuestion(
        "stiffness", "Stiffness of the load cell with its arm", "N/m", "200 kN/m", 1e3, 1e7
    ),
    BenchQuestion("force_scale", "Force for each volt of its amplifier", "N/V", "5 N/V", 1e-3, 1e5),
    BenchQuestion("friction", "Coefficient of friction to be expected", "1", "0.12", 1e-3, 5.0),
)


def described(name: str, ask: Callable[[BenchQuestion], str]) -> str:
    """Return the description of a pin-on-disk, with the answers of ``ask``."""
    answers = {question.key: ask(question) for question in QUESTIONS}
    return _rendered({"name": name, **answers, **_derived(answers)})


def defaults(question: BenchQuestion) -> str:
    """Return the default answer."""
    return question.accepted("")


@dataclass
class Asker:
    """Gets answers from standard input; ``missing`` are the questions without a line there."""

    missing: list[BenchQuestion] = field(default_factory=list)

    def ask(self, question: BenchQuestion) -> str:
        """Return the answer of the next line; at a terminal asks until it is right.

        Without further lines the default holds.

        Raises:
            ConfigError: a line that was piped in is wrong.
        """
        at_terminal = sys.stdin is not None and sys.stdin.isatty()
        while True:
            if at_terminal:
                shown = f"{question.text}{question.note} [{question.default}]: "
                line = ask(shown, sys.stdin, sys.stderr)
            else:
                line = _piped_line()
            if not line:
                self.missing.append(question)
            try:
                return question.accepted(line)
            except ValueError as error:
                if not at_terminal:
                    raise ConfigError(
                        f"{question.text.lower()}: {error}",
                        hint="the lines of standard input answer the questions in their order; an "
                        "empty line is the default",
                    ) from error
                print(f"  {error}", file=sys.stderr)

    @property
    def defaults(self) -> str:
        """What was taken without an answer, as text; "" if nothing was."""
        if not self.missing:
            return ""
        taken = ", ".join(f"{item.text.lower()} {item.default}" for item in self.missing)
        none = "no answers" if len(self.missing) == len(QUESTIONS) else "no further answers"
        return f"standard input had {none}: taken were {taken}"


def _piped_line() -> str:
    """Return the next line of standard input, "" if there is none, or no standard input."""
    try:
        return "" if sys.stdin is None else sys.stdin.readline()
    except OSError:  # what it was is closed
        return ""


def _derived(answers: Mapping[str, str]) -> dict[str, str]:
    """Return what follows from the answers: limits with a margin, and the weight as a force."""
    speed, force, load, friction, radius = (In(unit).read(answers[key]) for key, unit in (
        ("speed", "rad/s"), ("force", "N"), ("load", "kg"), ("friction", "1"), ("radius", "m")
    ))  # fmt: skip
    slow, fast = 0.2 * speed, 0.4 * speed
    return {
        "fastest": f"{0.8 * speed:.6g} rad/s",
        "slow": f"{slow:.6g} rad/s",
        "fast": f"{fast:.6g} rad/s",
        "rate": f"{0.8 * speed:.6g} rad/s^2",
        "band": f"{0.1 * slow:.6g} rad/s",
        "still": f"{0.1 * slow:.6g} rad/s",
        "overload": f"{0.9 * force:.6g} N",
        "weight": f"{9.81 * load:.6g} N",
        # Friction that grows by 5 % up to the fast setpoint, and has fallen at the slow one.
        "static": f"{4 / 3 * friction:.4g}",
        "stribeck": f"{0.05 * slow * radius * 1e3:.4g} mm/s",
        "viscous": f"{0.05 * friction / (fast * radius):.4g} s/m",
        "least": f"{0.85 * friction:.4g}",
        "most": f"{1.15 * friction:.4g}",
    }


def _rendered(words: Mapping[str, str]) -> str:
    return re.sub(r"\{\{ (\w+) \}\}", lambda found: words[found[1]], _TEMPLATE.read_text("utf-8"))

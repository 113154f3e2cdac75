"""Every shipped procedure on every shipped rig that is simulated in process and that it fits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from rigd.config.loader import load_rig
from rigd.config.rig import RigConfig
from rigd.daemon.execute import RunRequest, perform
from rigd.engine.play.control import Control
from rigd.engine.run.result import RunResult
from rigd.model.errors import ConfigError
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.sdk.shipped_files import shipped_folder


@dataclass(frozen=True)
class Pair:
    """A procedure on a rig, both shipped."""

    procedure: Path
    rig: RigConfig

    @property
    def name(self) -> str:
        """What a table calls it."""
        return f"{self.procedure.stem} on {self.rig.name}"


def pairs() -> Iterator[Pair]:
    """Yield every procedure on every rig simulated in process that it fits."""
    rigs = [load_rig(path) for path in sorted(shipped_folder("configs").glob("*.yaml"))]
    procedures = sorted(shipped_folder("procedures").glob("*.yaml"))
    for rig in rigs:
        for path in procedures:
            if rig.plant is not None and _fits(path, rig):
                yield Pair(path, rig)


def play(pair: Pair, seed: int, output: Path, trials: int | None = None) -> RunResult:
    """Run and record ``pair`` in virtual time, a procedure with a floor on one of its floors.

    ``trials`` is how many of them to play, from the first one; None for all.
    """
    source = load_procedure(pair.procedure)
    floor = source.source.parameters.get("floor")
    choices = (floor and floor.choices) or []
    chosen = {"floor": choices[seed % len(choices)]} if choices else {}
    whole = compile_procedure(source, pair.rig, chosen)
    procedure = replace(whole, trials=whole.trials[:trials])
    request = RunRequest(procedure, source.file.text, pair.rig, seed, output=output)
    return perform(request, Control()).result


def wrong(result: RunResult) -> str:
    """Return why the run is not whole, or "" if it is."""
    if not result.exit_code and not result.trips:
        return ""
    words = (f"{result.ending}: {result.reason}", *result.trips, *map(str, result.incomplete))
    return f"exit {result.exit_code:d}, " + "; ".join(dict.fromkeys(words))


def _fits(path: Path, rig: RigConfig) -> bool:
    try:
        compile_procedure(load_procedure(path), rig, {})
    except ConfigError:
        return False
    return True

"""What `rigd identify` says of one world, a row of the study's table, and whether it is right."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Final

import numpy as np
from blind.kind import Kind
from blind.rig import Rig, draw, draw_lateral, write
from blind.robot import Robot
from blind.robot import draw as draw_robot
from blind.robot import write as write_robot
from blind.robot_worlds import robot_kinds, robot_world
from blind.worlds import kinds, lateral_kinds, lateral_world, world

import rigd
from rigd.model.errors import RigdError

Row = dict[str, Any]
#: A number is wrong if its interval misses the truth by more half widths than this: of ten
#: intervals of 95 % chance puts one beyond 1 in two cases of five, beyond 1.5 in one of thirty.
WRONG: Final = 1.5
LONGEST: Final = 400  # s of CPU that one identification may take
#: Their parameters have no true value: another law holds. All but the first two have a true g.
OTHER_LAW: Final = (
    *("rolling relaxation", "load shifts with force", "ageing in rest", "gaussian law"),
    *("exponential law", "steep law", "lorentz law", "plateau law"),
)
GOOD: Final = ("right", "rightly named", "refused, rightly named", "refused without a name")


@dataclass(frozen=True)
class Study:
    """A family of rigs: its right and wrong worlds, their recordings, and what is missed."""

    kinds: Callable[[], dict[str, Kind[Any]]]
    draw: Callable[[int], Any]
    world: Callable[[str, int, int], Any]
    write: Callable[[Any, Path], None]
    misses: Callable[[Any, str, dict[str, Any]], dict[str, float]]


def run(name: str, size: int, seed: int, folder: Path, study: Study) -> Row:
    """Simulate one world, identify it, and return all that was said; ``right`` is a right rig."""
    rig = study.draw(seed) if name == "right" else study.world(name, size, seed)
    path = folder / "world.mcap"
    path.unlink(missing_ok=True)
    row: Row = {"kind": name, "size": size, "seed": seed, "trials": len(rig.trials)}
    if isinstance(rig, Rig):
        row |= {"floor": rig.floor, "rate": rig.rate}
    begin = time.process_time()
    study.write(rig, path)
    row["cpu_simulated"] = round(time.process_time() - begin, 2)
    begin = time.process_time()
    signal.signal(signal.SIGPROF, _too_long)
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        result: dict[str, Any] = rigd.identify(str(path)).to_json()
        gate = result.get("gate") or {}
        row |= {
            "outcome": gate.get("outcome"),
            "sentence": gate.get("sentence", ""),
            "findings": gate.get("findings", []),
            "explanations": gate.get("explanations", []),
            "warnings": [
                text
                for text in result["warnings"]
                if text not in (gate.get("sentence"), *gate.get("findings", []))
            ],
            "misses": study.misses(rig, name, result),
        }
    except RigdError as error:
        row |= {
            "outcome": "refused",
            "sentence": str(error),
            "findings": [],
            "explanations": [],
            "warnings": [],
            "misses": {},
        }
    except TimeoutError:
        row |= {
            "outcome": "too long",
            "sentence": "",
            "findings": [],
            "explanations": [],
            "warnings": [],
            "misses": {},
        }
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    row["cpu"] = round(time.process_time() - begin, 2)
    return row


def named(row: Row) -> str:
    """Return the words of the cause that stands first, empty if none is named."""
    if row["explanations"]:
        first = row["explanations"][0]
        return " ".join([first["name"], str(first.get("look") or ""), *_others(first)])
    sentence = str(row["sentence"])
    found = re.search(r"(?:explains most of it|explained most of it)[^.]*? is (.*)", sentence, re.S)
    if found and "Nothing that rigd knows explains most" not in sentence:
        return found[1]
    told = (sentence, *row["warnings"])
    trend = [text for text in told if re.search(r"friction (rises|falls|differs)", text)]
    return trend[0] if trend else ""


def verdict(row: Row, known: dict[str, Kind[Any]]) -> str:
    """Return the verdict in words; capitals are what must not be."""
    cause, refused = named(row), row["outcome"] in ("does not fit", "refused", "too long")
    wrong = worst(row) > WRONG
    if row["kind"] == "right":
        if refused:
            return "REFUSED" if not cause else "REFUSED WITH A CAUSE"
        if cause:
            return "A CAUSE NAMED"
        if row["outcome"] != "fits":
            return "A MISFIT TOLD"
        return "A NUMBER WRONG" if wrong else "right"
    kind = known[row["kind"]]
    right = bool(cause) and kind.accepts(cause)
    if not cause and any(kind.accepts(text) for text in row["warnings"]):
        cause, right = (
            "a warning",
            True,
        )  # a trial that was left out for the right reason, rows that are missing
    if refused:
        return (
            "refused without a name"
            if not cause
            else "refused, rightly named"
            if right
            else "REFUSED, WRONG NAME"
        )
    if cause:
        if not right:
            return "WRONG NAME"
        return "RIGHTLY NAMED, NUMBER WRONG" if wrong else "rightly named"
    if wrong:
        told = row["outcome"] != "fits"
        return (
            "KNOWN, IN SILENCE"
            if kind.documented
            else "WRONG, A MISFIT TOLD"
            if told
            else "WRONG IN SILENCE"
        )
    return "right"


def worst(row: Row) -> float:
    """Return the largest miss in half widths, 0 if no number is given."""
    return max(row["misses"].values(), default=0.0)


def _others(explanation: dict[str, Any]) -> list[str]:
    return [
        item if isinstance(item, str) else str(item.get("name", ""))
        for item in explanation.get("others") or []
    ]


def _too_long(_signal: int, _frame: FrameType | None) -> None:
    raise TimeoutError


def _spread(rig: Rig) -> tuple[float, float]:
    """Return between which shares of its nominal value the friction of this world lies."""
    k = rig.true
    low, high = min(trial.level for trial in rig.trials), max(trial.level for trial in rig.trials)
    wide = abs(k["wave_size"]) + abs(k["turn_size"])
    changes = [k["step_size"], k["patch_size"], k["run_in"], k["backward"], -k["heat_size"] * 0.05]
    return low * (1 - wide) * (1 + sum(min(c, 0) for c in changes)), high * (1 + wide) * (
        1 + sum(max(c, 0) for c in changes)
    )


def _misses(rig: Rig, kind: str, result: dict[str, Any]) -> dict[str, float]:
    low, high = _spread(rig)
    truth: dict[str, tuple[float, float]] = {}
    if rig.model == "lugre-lateral":
        return _lateral_misses(rig, kind, result)
    for name, value in rig.friction().items():
        scaled = name in ("mu_c", "mu_s", "sigma_2")
        truth[name] = (value * low, value * high) if scaled else (value, value)
        if kind == "other floor half way" and name != "V_s":
            others = [trial.constants.get(name.lower(), value) for trial in rig.trials]
            truth[name] = (min(others), max(others))
    found = {}
    if kind not in OTHER_LAW:
        for name, ends in truth.items():
            item = result["parameters"].get(name)
            if (
                item
                and item["identifiable"]
                and item["low"] is not None
                and item["high"] is not None
            ):
                found[name] = _miss(item["low"], item["high"], *ends)
    fits = result["gate"]["outcome"] != "does not fit"
    if fits and kind not in (*OTHER_LAW[:2], "other floor half way"):
        points = result["friction_curve"]
        slips = np.array([point["V_r"] for point in points])
        curve = rig.curve(slips)
        if rig.true["age_size"]:
            age = rig.true["age_length"] / slips
            curve = curve * (1 + rig.true["age_size"] * np.log(1 + age / 0.1))
        missed = [
            _miss(p["low"], p["high"], g * low, g * high)
            for p, g in zip(points, curve, strict=True)
            if p["low"] is not None
        ]
        if missed:
            found["g"] = max(missed)
    return {name: round(miss, 3) for name, miss in found.items()} if fits else {}


def _lateral_misses(rig: Rig, kind: str, result: dict[str, Any]) -> dict[str, float]:
    """Of the friction of the rollers; a world in which it has another law has no truth."""
    k = rig.true
    if kind == "rollers' law bends" or result["gate"]["outcome"] == "does not fit":
        return {}
    dry = [trial.constants.get("roller_dry", k["roller_dry"]) for trial in rig.trials]
    truth = {"mu_R_dry": (min(dry), max(dry)), "mu_R_vis": (k["roller_viscous"],) * 2}
    side = abs(k["roller_side"])
    found = {}
    for name, (least, most) in truth.items():
        item = result["parameters"].get(name)
        if item and item["identifiable"] and item["low"] is not None and item["high"] is not None:
            missed = _miss(item["low"], item["high"], least * (1 - side), most * (1 + side))
            found[name] = round(missed, 3)
    return found


def _miss(low: float, high: float, least: float, most: float) -> float:
    centre, half = 0.5 * (low + high), max(0.5 * (high - low), 1e-12)
    return (
        float(max(least - centre, centre - most, 0.0) / half)
        if least < most
        else float(abs(least - centre) / half)
    )


def all_worlds(known: dict[str, Kind[Any]], seeds: int = 2) -> list[tuple[str, int, int]]:
    """Return every kind in every size with ``seeds`` seeds."""
    return [
        (kind.name, size, seed)
        for kind in known.values()
        for size in range(len(kind.sizes))
        for seed in range(seeds)
    ]


def _robot_misses(robot: Robot, _kind: str, result: dict[str, Any]) -> dict[str, float]:
    gate = result.get("gate") or {}
    if gate.get("outcome") == "does not fit":
        return {}
    found = {}
    for name, (least, most) in robot.truth().items():
        item = result["parameters"].get(name)
        if item and item["identifiable"] and item["low"] is not None and item["high"] is not None:
            found[name] = round(_miss(item["low"], item["high"], least, most), 3)
    return found


LUGRE: Final = Study(kinds, draw, world, write, _misses)
LATERAL: Final = Study(lateral_kinds, draw_lateral, lateral_world, write, _misses)
ROBOT: Final = Study(robot_kinds, draw_robot, robot_world, write_robot, _robot_misses)

"""Checks the declarations of a plant, its time, its noise, and the values that it must refuse."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from rigd.model.errors import ConfigError, RigdError
from rigd.model.units import format_quantity, parse_quantity, parse_unit
from rigd.sdk.check.declaration_rules import NAME, bare, lenient, title_problems, undocumented
from rigd.sdk.check.plant.bench import (
    CYCLES,
    Commands,
    PlantBench,
    PlantSubject,
    Played,
    gentle,
    mirrored,
    strong,
    wild,
)
from rigd.sdk.check.subject import NamedRule, UnfitSubject, described
from rigd.sdk.driver import Driver
from rigd.sdk.parameters import ParametersConfig
from rigd.sdk.plant import Plant, PlantConfig
from rigd.sdk.setting import Setting
from rigd.sdk.yaml.document import parse_document

#: Two channels show the same quantity if they go together so well; one may fall short of the other,
#: as a drive at the end of its supply does, by so much.
ALIKE: Final = 0.95
FACTOR: Final = 5.0
SETPOINT: Final = "its setpoint"
#: The error of a sensor jumps at zero by no more than this part of its steps, so many standard
#: deviations.
ROUNDED_PART: Final = 0.3
SURE: Final = 8.0
ROUNDING: Final = 1e-9
#: What parameters are altered by, as a part of them.
ALTERED: Final = 0.3
#: The error of a sensor leaps if it changes from row to row by this part of what the truth passes
#: through, in at most so many of all rows, and the truth by less than a part of that.
LEAP_PART: Final = 0.1
LEAPS: Final = 0.01


@dataclass(frozen=True)
class PlantRule(NamedRule):
    """One rule for plants; ``check`` yields a sentence for every breach.

    ``missing`` returns why the rule cannot be applied to a plant, "" if it can.
    """

    check: Callable[[PlantSubject], Iterator[str]]
    missing: Callable[[PlantSubject], str] = lambda _: ""


def needs_devices(subject: PlantSubject) -> str:
    """Return why a rule that drives the plant cannot be applied."""
    return "" if subject.devices else "no devices were given"


def needs_truth(subject: PlantSubject) -> str:
    """Return why a rule on the hidden state cannot be applied."""
    return "" if subject.truth in subject.devices else "no truth was named"


def _options(subject: PlantSubject) -> Iterator[str]:
    config_class = subject.plant_class.Config
    yield from undocumented(config_class)
    yield from bare(config_class)
    yield from lenient(config_class, PlantConfig, subject.options)


def _made(subject: PlantSubject) -> Iterator[str]:
    try:
        subject.make()
    except Exception as error:  # noqa: BLE001  # whatever its author's code raises is the finding
        name = subject.plant_class.__name__
        yield f"{name}(config, period_ns=..., seed=...) raises {described(error)}"


def _parameters(subject: PlantSubject) -> Iterator[str]:
    config = subject.config()
    if not isinstance(config, ParametersConfig):
        return
    model = config.parameter_model()
    yield from bare(model, "")
    yield from undocumented(model, "")
    tree = _plain(config)
    for path, _, unit in _leaves(tree, ()):
        taken = [sign for sign in ("", "-") if _takes(model, tree, path, sign, unit)]
        if len(taken) == 2:
            yield f"{'.'.join(path)} takes any number: 1e30 and -1e30 {unit} are accepted"


def _plain(config: ParametersConfig) -> Any:
    ((path, text),) = config.files().items()
    return parse_document(text, path).data


def _leaves(node: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], float, str]]:
    """Yield the place of each quantity in a parameter file, its number and its unit as written."""
    if isinstance(node, dict):
        for key, value in node.items():
            yield from _leaves(value, (*path, str(key)))
        return
    if isinstance(node, bool) or not isinstance(node, int | float | str):
        return
    try:
        quantity = parse_quantity(str(node))
    except ValueError:
        return
    yield path, quantity.value, quantity.unit.symbol


def _takes(model: Any, tree: Any, path: tuple[str, ...], sign: str, unit: str) -> bool:
    try:
        model.model_validate(_with(tree, path, f"{sign}1e30 {unit}".removesuffix(" 1")))
    except ValidationError:
        return False
    except Exception as error:
        raise UnfitSubject(
            f"{'.'.join(path)} of {sign}1e30 {unit} raises {described(error)}, not a ValueError"
        ) from error
    return True


@contextmanager
def other_parameters(subject: PlantSubject) -> Iterator[PlantSubject | None]:
    """Yield the plant with each parameter of its file altered by up to a part; None: it has none.

    One that does not fit the others stays as it is.
    """
    config = subject.config()
    if not isinstance(config, ParametersConfig):
        yield None
        return
    tree, rng = _plain(config), random.Random(subject.seed)
    for path, value, unit in list(_leaves(tree, ())):
        other = value * rng.choice((1 - ALTERED, 1 + ALTERED))
        altered = _with(tree, path, format_quantity(other, unit, 12))
        with suppress(ValidationError):
            config.parameter_model().model_validate(altered)
            tree = altered
    with TemporaryDirectory() as folder:
        file = Path(folder) / "parameters.yaml"
        file.write_text(json.dumps(tree), "utf-8")
        yield replace(subject, options={**subject.options, "parameters": str(file)})


def _with(node: Any, path: tuple[str, ...], value: str) -> Any:
    if not path:
        return value
    return {**node, path[0]: _with(node[path[0]], path[1:], value)}


def _settings(subject: PlantSubject) -> Iterator[str]:
    plant, settings = subject.make(), subject.config().settings()
    for name, setting in settings.items():
        if not NAME.fullmatch(name):
            yield f"setting {name!r}: lower case letters, digits and _ make a name"
        yield from _well_described(name, setting)
        for value in ("no such value", math.inf, math.nan if setting.unit else 1.0):
            yield from _refuses(plant, name, value)
    yield from _refuses(plant, "no_such_setting_", 1.0)


def _well_described(name: str, setting: Setting) -> Iterator[str]:
    if not setting.doc.strip():
        yield f"setting {name!r} has no doc"
    try:
        parse_unit(setting.unit)
    except ValueError as error:
        yield f"setting {name!r}: {error}"
    finite = math.isfinite(setting.low) and math.isfinite(setting.high)
    if not setting.choices and not (finite and setting.low < setting.high and setting.unit):
        yield f"setting {name!r} takes {setting}: neither choices nor a range with a unit"


def _refuses(plant: Plant, name: str, value: float | str) -> Iterator[str]:
    try:
        plant.change(name, value)
    except ValueError as error:
        if not str(error).strip():
            yield f"change({name!r}, {value!r}) raises a ValueError without a sentence"
    except Exception as error:  # noqa: BLE001  # whatever its author's code raises is the finding
        yield f"change({name!r}, {value!r}) raises {described(error)}"
    else:
        yield f"change({name!r}, {value!r}) is accepted"


def _finite(subject: PlantSubject) -> Iterator[str]:
    problems: dict[str, None] = {}
    for change in (None, *changes_of(subject.config().settings())):
        bench = PlantBench(subject, subject.make())
        where = "" if change is None else f" with {change[0]} at {change[1]}"
        try:
            if change is not None:
                bench.plant.change(*change)
        except ValueError:
            continue  # not allowed with the present settings
        except RigdError as error:
            problems[f"change{change} raises {described(error)}"] = None
            continue
        try:
            found = list(_not_finite(bench, bench.play(CYCLES // 2, wild)))
        except UnfitSubject as unfit:
            found = [str(unfit)]
        problems |= dict.fromkeys(f"{problem}{where}" for problem in found)
    yield from list(problems)[:5]


def changes_of(settings: Mapping[str, Setting]) -> Iterator[tuple[str, float | str]]:
    """Yield every setting with every choice, or with both ends of its range, in SI."""
    for name, setting in settings.items():
        to_si = parse_unit(setting.unit).to_si
        values: tuple[float | str, ...] = setting.choices or (setting.low, setting.high)
        for value in values:
            yield name, value if isinstance(value, str) else to_si(value)


def _not_finite(bench: PlantBench, seen: Played) -> Iterator[str]:
    for name, driver in bench.devices.items():
        rows = seen.table(name)
        if not rows.size:
            continue
        # A device may show NaN if its status word reports a problem.
        healthy = rows[rows[:, -1] == 0] if driver.declaration.has_status else rows
        for number, channel in enumerate(driver.declaration.channels):
            if not np.isfinite(healthy[:, number]).all():
                yield f"{name}.{channel.name} is not finite"
    energy = seen.energy[-1:]
    if energy and not all(map(math.isfinite, vars(energy[0]).values())):
        yield f"its energy is {energy[0]}"


def _files(subject: PlantSubject) -> Iterator[str]:
    try:
        files = subject.config().files()
    except ConfigError as error:
        yield f"files() raises {described(error)}"
        return
    for path, text in files.items():
        if not path.is_file() or path.read_text("utf-8") != text:
            yield f"files() gives {path}, which is no such file"


def _units(subject: PlantSubject) -> Iterator[str]:
    """Compare what devices show with the truth, and with setpoints, of the same name and unit."""
    for words, of, shown, wanted in _pairs(subject, strong):
        if of != SETPOINT and (leap := _leap(shown, wanted)):
            yield f"{words} leaps by {leap:.3g} against {of}"
    pairs = [list(_pairs(subject, commands)) for commands in (gentle, mirrored)]
    for (words, of, shown, wanted), (_, _, shown_2, wanted_2) in zip(*pairs, strict=True):
        factor = _factor(shown, wanted)
        if factor is not None and not 1 / FACTOR <= factor <= FACTOR:
            yield f"{words} is {factor:.3g} times {of}"
        elif factor is not None and of != SETPOINT:
            a, b = (np.concatenate(each) for each in ((shown, shown_2), (wanted, wanted_2)))
            if (jump := _jump(a, b)) > ROUNDED_PART:
                yield f"{words} jumps by {jump:.2g} of its steps as {of} passes zero"


def _pairs(
    subject: PlantSubject, commands: Commands
) -> Iterator[tuple[str, str, NDArray[np.float64], NDArray[np.float64]]]:
    """Yield each channel in words, what it is to show, and both as arrays."""
    bench = PlantBench(subject, subject.make())
    commanded: dict[str, list[Sequence[float]]] = {}

    def noted(driver: Driver, cycle: int) -> Sequence[float]:
        values = commands(driver, cycle)
        (name,) = (name for name, item in bench.devices.items() if item is driver)
        commanded.setdefault(name, []).append(values)
        return values

    seen = bench.play(CYCLES, noted)
    known: dict[tuple[str, str, str], Any] = {}
    for name, driver in bench.devices.items():
        for number, item in enumerate(driver.declaration.setpoints):
            # A row is read before the setpoint of its cycle is written.
            known[name, item.name, item.unit] = np.array(commanded[name])[:-1, number]
    truth = bench.devices.get(subject.truth)
    for name, driver in bench.devices.items():
        rows = seen.table(name)
        for number, channel in enumerate(driver.declaration.channels):
            wanted = known.get((name, channel.name, channel.unit))
            shown = rows[1:, number] if rows.size else rows
            of = SETPOINT
            if wanted is None and truth is not None and driver is not truth:
                names = [(item.name, item.unit) for item in truth.declaration.channels]
                if (channel.name, channel.unit) in names:
                    column = names.index((channel.name, channel.unit))
                    wanted, of = seen.table(subject.truth)[1:, column], f"that of {subject.truth}"
            if wanted is not None and len(wanted) == len(shown):
                yield f"{name}.{channel.name} in {channel.unit}", of, shown, wanted


def _jump(shown: NDArray[np.float64], wanted: NDArray[np.float64]) -> float:
    """Return by how much an error differs below and above zero, as part of the steps of a sensor.

    Counts that are rounded towards zero do; a scale that is off a little does not.
    """
    steps = np.diff(np.unique(shown))
    steps = steps[steps > ROUNDING * np.ptp(shown)]
    signs = np.sign(wanted)
    if not len(steps) or min((signs > 0).sum(), (signs < 0).sum()) < CYCLES // 8:
        return 0.0
    error = shown - wanted
    matrix = np.stack([np.ones_like(wanted), wanted, signs], axis=1)
    found, _, _, _ = np.linalg.lstsq(matrix, error, rcond=None)
    left = float(np.std(error - matrix @ found))
    jump = 2.0 * abs(float(found[2]))
    sure = jump > SURE * left / math.sqrt(min((signs > 0).sum(), (signs < 0).sum()))
    return jump / float(np.min(steps)) if sure else 0.0


def _leap(shown: NDArray[np.float64], wanted: NDArray[np.float64]) -> float:
    """Return the largest step of an error that leaps now and then; 0 if it does not."""
    least = LEAP_PART * np.ptp(wanted)
    steps = abs(np.diff(shown - wanted))
    share = float(np.mean(steps > least))
    if not 0.0 < share <= LEAPS or abs(np.diff(wanted)).max() > least / 2:
        return 0.0
    return float(steps.max())


def _factor(shown: NDArray[np.float64], wanted: NDArray[np.float64]) -> float | None:
    """Return what ``shown`` changes by per change of ``wanted``; None if they are not alike."""
    both = np.isfinite(shown) & np.isfinite(wanted)
    a, b = shown[both], wanted[both]
    if len(a) < CYCLES // 2 or not a.std() or not b.std():
        return None
    alike = float(np.corrcoef(a, b)[0, 1])
    return float(alike * a.std() / b.std()) if abs(alike) > ALIKE else None


CLASS_RULES: Final = (
    PlantRule(
        "title",
        "give the class a `title` of one line: which rig this is",
        lambda subject: title_problems(subject.plant_class.title),
    ),
    PlantRule(
        "options",
        "derive Config from PlantConfig; document every field, declare quantities as "
        'Annotated[float, In("kg")]',
        _options,
    ),
)
#: The rule that comes before all that need a plant.
CONSTRUCTOR: Final = (
    PlantRule("constructor", "construct the plant from its options, a period and a seed", _made),
)
PLANT_RULES: Final = (
    PlantRule("files", "files() gives path and text of the files the plant is made from", _files),
    PlantRule(
        "parameters",
        "give every parameter a unit, a docstring and bounds beyond which no rig is",
        _parameters,
    ),
    PlantRule(
        "settings",
        "give every setting a name, a doc and what it takes; change() refuses all else with a "
        "ValueError",
        _settings,
    ),
    PlantRule(
        "units agree",
        "a channel with name and unit of a channel of the truth, or of a setpoint of its device, "
        "shows the same quantity: check its factor and its sign",
        _units,
        needs_devices,
    ),
    PlantRule(
        "finite",
        "whatever is commanded and set up, every reading is a finite number",
        _finite,
        needs_devices,
    ),
)

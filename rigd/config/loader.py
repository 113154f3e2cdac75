"""Loads a rig file: finds drivers, validates options, checks limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from rigd.config.binding import bind, named_key
from rigd.config.calibration.calibration import read_setup
from rigd.config.checks.following import read_following
from rigd.config.checks.links import check_link, read_links
from rigd.config.checks.sharing import check_shared
from rigd.config.computed.controllers import add_controllers
from rigd.config.computed.derived import add_derived
from rigd.config.computed.inputs import check_inputs
from rigd.config.computed.observers import add_observers
from rigd.config.display import displayed
from rigd.config.document import Document, KeyPath, parse_document, read_document
from rigd.config.problems import Problems, suggest
from rigd.config.quantities import (
    check_inside,
    has_unit_like,
    rate_unit,
    read_difference,
    read_quantity,
    read_uncertainty,
)
from rigd.config.registry import find_driver, find_plant, find_simulation
from rigd.config.remote import read_remote
from rigd.config.rig import (
    DeviceConfig,
    LinkSetup,
    PlantSetup,
    RestBound,
    RigConfig,
    SiblingFile,
    SimulationSetup,
    SourceFile,
    Supervision,
    Waiver,
)
from rigd.config.shipped_files import find_beside, find_file, location
from rigd.config.source import ConstantSource, DeviceSource, InterlockSource, LimitSource, RigSource
from rigd.model.channels import Channel
from rigd.model.constants import Constant
from rigd.model.errors import ConfigError, RigdError
from rigd.model.limits import Interlock, Priority, SetpointLimit
from rigd.model.severity import Severity
from rigd.model.units import parse_quantity, parse_unit
from rigd.sdk import BlockDriver, SlowDriver, WrongEntries

#: Number of silent cycles that is still normal.
_CYCLES_OF_SILENCE: Final = 3


def load_rig(given: str | Path, recorded: bytes | None = None) -> RigConfig:
    """Return the rig of a file, or of a rig's name (see :func:`find_file`).

    Raises:
        ConfigError: the file is missing or wrong; the error names every problem with its place.
    """
    found = find_file(given, "configs", recorded)
    rig = build_rig(read_document(found))
    return replace(rig, source=replace(rig.source, location=location(given, found, "configs")))


def parse_rig(text: str, path: Path, *, period_ns: int | None = None) -> RigConfig:
    """Return the rig in ``text``, such as the text attached to a recording.

    ``path`` is the name in error messages; its folder is the start of relative paths. With
    ``period_ns`` its cycle takes this time in ns, and not what the text states.

    Raises:
        ConfigError: the text is wrong; the error names every problem with its place.
    """
    return build_rig(parse_document(text, path), period_ns)


def parse_constants(text: str, path: Path) -> dict[str, Constant]:
    """Return the constants of the rig in ``text``; its drivers need not be installed.

    Raises:
        ConfigError: the text is wrong; the error names every problem with its place.
    """
    document, problems = parse_document(text, path), Problems()
    source = bind(document, RigSource, problems)
    constants = {} if source is None else _constants(document, source, problems)
    problems.raise_any()
    return constants


def build_rig(document: Document, period_ns: int | None = None) -> RigConfig:
    """Return the rig of a document that is read already; see :func:`parse_rig`.

    Raises:
        ConfigError: it is wrong; the error names every problem with its place.
    """
    document.check_kind("rig")
    problems = Problems()
    source = bind(document, RigSource, problems)
    if source is None:
        problems.raise_any()
        raise ConfigError("the rig file cannot be used", place=document.place(()))
    if period_ns is not None:
        source = source.model_copy(update={"cycle": 1e9 / period_ns})
    _check_supervision(document, source, problems)
    links = read_links(document, source, problems)
    plant = _plant(document, source, problems)
    devices: dict[str, DeviceConfig] = {}
    for name, item in source.devices.items():
        device = _device(document, name, item, links, source, plant, problems)
        if device is not None:
            _check_ground(document, device, source, problems)
            devices[name] = device
    check_shared(document, devices.values(), links, problems)
    rig = RigConfig(
        name=source.rig,
        title=source.title,
        period_ns=round(1e9 / source.cycle),
        plant=plant,
        devices=devices,
        interlocks=(),
        constants=_constants(document, source, problems),
        source=SourceFile(document.path, document.text),
        links={name: link for name, link in links.items() if link is not None},
        simulation=_simulation(document, source, problems),
        supervision=Supervision(
            source.supervision.cycle_silence,
            source.supervision.daemon_silence,
            source.supervision.rest,
            _at_rest(document, source, devices, problems),
        ),
        calibration=read_setup(source.calibration, document.path.parent, problems),
        remote=read_remote(document, source.remote, problems),
        sibling=_sibling(document, source, problems),
        lab=None if source.lab is None else document.path.parent / source.lab,
    )
    if len(devices) < len(source.devices):
        problems.raise_any()  # the channels of a wrong device would all seem unknown
    before = len(problems.found)
    rig = add_observers(document, source.observers, source.derived, rig, problems)
    if len(problems.found) > before:
        problems.raise_any()  # the same of a wrong observer
    rig = add_derived(document, source.derived, rig, problems)
    if len(problems.found) == before:  # wrong derived channels would all seem unknown
        rig = add_controllers(document, source.controllers, rig, problems)
        check_inputs(document, rig, channel_names(rig), problems)
    above = {name.partition(".")[0] for name in (*source.derived, *source.controllers)}
    unread = above - rig.devices.keys()
    interlocks = _interlocks(document, source.interlocks, rig, unread, problems)
    problems.raise_any()
    return RigConfig(**{**vars(rig), "interlocks": interlocks})


def _at_rest(
    document: Document, source: RigSource, devices: Mapping[str, DeviceConfig], problems: Problems
) -> tuple[RestBound, ...]:
    """Return by which channels the rig rests; only the cycle reads after a run."""
    read = {
        f"{device.name}.{channel.name}": channel.unit
        for device in devices.values()
        if not issubclass(device.driver_class, SlowDriver)
        for channel in device.channels
    }
    bounds = []
    for name, text in source.supervision.at_rest.items():
        path: KeyPath = ("supervision", "at_rest", name)
        if name not in read:
            problems.add(
                document.place(path),
                f"unknown channel {name!r}: expected one of a device that the cycle reads",
                suggest(name, list(read)),
            )
            continue
        rate = rate_unit(read[name])
        is_rate = has_unit_like(text, rate)
        unit = rate if is_rate else read[name]
        bound = read_quantity(document, path, text, unit, problems)
        if bound <= 0.0:
            problems.add(document.place(path), f"{text} must be more than 0")
        bounds.append(RestBound(name, bound, unit, is_rate))
    return tuple(bounds)


def _sibling(document: Document, source: RigSource, problems: Problems) -> SiblingFile | None:
    """Return where the sibling of the rig is; whether it is there is found when it is needed."""
    if source.sibling is None:
        return None
    place = document.place(("sibling",))
    if source.plant is not None:
        problems.add(
            place,
            "this rig has a `plant`: its dry run plays on that, and needs no `sibling`",
            "remove one of the two",
        )
    return SiblingFile(find_beside(source.sibling, document.path.parent), place)


def _check_supervision(document: Document, source: RigSource, problems: Problems) -> None:
    """Check that the cycle has time for its sign of life, which it gives once per cycle."""
    least_s = _CYCLES_OF_SILENCE / source.cycle
    if source.supervision.cycle_silence < least_s:
        problems.add(
            document.place(("supervision", "cycle_silence")),
            f"cycle_silence {source.supervision.cycle_silence:g} s is less than "
            f"{_CYCLES_OF_SILENCE} cycles: a healthy cycle would count as dead",
            f"give at least {least_s:g} s",
        )


def _device(
    document: Document,
    name: str,
    source: DeviceSource,
    links: dict[str, LinkSetup | None],
    rig: RigSource,
    plant: PlantSetup | None,
    problems: Problems,
) -> DeviceConfig | None:
    path: KeyPath = ("devices", name)
    try:
        driver_class = find_driver(source.driver)
    except ConfigError as error:
        problems.add(document.place((*path, "driver")), error.message, error.hint)
        return None
    check_link(document, path, source, driver_class.link_kind, links, problems)
    if driver_class.plant_model and not _stands(document, path, source, rig, plant, problems):
        return None
    config = bind(
        document,
        driver_class.Config,
        problems,
        (*path, "options"),
        data=source.options,
        plant=None if plant is None else plant.config,
        period_ns=round(1e9 / rig.cycle),
    )
    if config is None:
        return None
    try:
        declaration = driver_class.declare(config)
    except WrongEntries as error:
        for below, text in error.problems:
            problems.add(document.place((*path, "options", *below)), f"{source.driver}: {text}")
        return None
    except (ValueError, RigdError) as error:
        where = (*path, "options", named_key(str(error)))
        problems.add(document.place(where), f"{source.driver}: {error}")
        return None
    declaration = displayed(document, path, source.display, declaration, problems)
    link = links.get(source.link or "")
    for text in driver_class.contradictions(config, None if link is None else link.config):
        where = (*path, "options", named_key(text))
        problems.add(document.place(where), f"{source.driver}: {text}")
    waiver = source.waiver
    return DeviceConfig(
        name=name,
        driver=source.driver,
        driver_class=driver_class,
        config=config,
        declaration=declaration,
        limits=_limits(
            document,
            path,
            source.limits,
            declaration.setpoints,
            problems,
            slow=issubclass(driver_class, SlowDriver),
        ),
        link=source.link,
        waiver=None if waiver is None else Waiver(waiver.by, waiver.reason),
    )


def _stands(
    document: Document,
    path: KeyPath,
    source: DeviceSource,
    rig: RigSource,
    plant: PlantSetup | None,
    problems: Problems,
) -> bool:
    """Return whether the plant of the device is there, with the problem noted if it is another."""
    wanted = find_driver(source.driver).plant_model
    given = None if rig.plant is None else rig.plant.model
    if given == wanted:
        return plant is not None  # if it is wrong, that is noted
    has = "no plant" if given is None else f"the plant {given!r}"
    problems.add(
        document.place((*path, "driver")),
        f"{source.driver} stands on a plant with 'model: {wanted}', and this rig has {has}",
        f"add 'plant: {{model: {wanted}, ...}}', or use another driver",
    )
    return False


def _check_ground(
    document: Document, device: DeviceConfig, source: RigSource, problems: Problems
) -> None:
    """Check that a block device which is simulated on a plant has a plant."""
    kind = device.driver_class
    if issubclass(kind, BlockDriver) and kind.on_plant and source.plant is None:
        problems.add(
            document.place(("devices", device.name, "driver")),
            f"{device.driver} is simulated on a plant, and this rig has no plant",
            "add 'plant: {model: ...}', or use the driver of a real device",
        )


def _limits(
    document: Document,
    device: KeyPath,
    sources: dict[str, LimitSource],
    setpoints: tuple[Channel, ...],
    problems: Problems,
    *,
    slow: bool,
) -> dict[str, SetpointLimit]:
    known = {setpoint.name for setpoint in setpoints}
    for name in sources:
        if name not in known:
            problems.add(
                document.key_place((*device, "limits", name)),
                f"{device[-1]} has no setpoint {name!r}", suggest(name, known),
            )  # fmt: skip
    limits = {}
    for setpoint in setpoints:
        if setpoint.name in sources:
            path = (*device, "limits", setpoint.name)
            if sources[setpoint.name].at_stop == "hold" and not slow:
                problems.add(
                    document.place((*path, "at_stop")),
                    f"{device[-1]} is no slow device: a stop must take {setpoint.name} to rest",
                    "remove the key",
                )
            limits[setpoint.name] = _limit(
                document, path, sources[setpoint.name], setpoint, problems
            )
        else:
            problems.add(
                document.key_place((*device, "limits")),
                f"{device[-1]} takes the setpoint {setpoint.name!r}, but has no limit for it",
                f"add 'limits: {{{setpoint.name}: {{low: ..., high: ..., rate: ...}}}}' "
                f"in {setpoint.shown_in}",
            )
    return limits


def _limit(
    document: Document, path: KeyPath, source: LimitSource, setpoint: Channel, problems: Problems
) -> SetpointLimit:
    unit = setpoint.shown_in
    owner = f"the device's own {setpoint.name}"
    values = {}
    for key in ("low", "high"):
        value = read_quantity(document, (*path, key), getattr(source, key), unit, problems)
        values[key] = check_inside(
            document, (*path, key), value, (setpoint.low, setpoint.high), unit, owner, problems
        )
    low, high = values["low"], values["high"]
    if low > high:
        message = f"low {source.low} is above high {source.high}"
        problems.add(document.place((*path, "low")), message, "swap the two")
    rate = read_quantity(document, (*path, "rate"), source.rate, rate_unit(setpoint.unit), problems)
    if rate <= 0:
        problems.add(document.place((*path, "rate")), f"rate {source.rate} must be above 0")
    rest = 0.0
    if "rest" in source.model_fields_set:
        rest = read_quantity(document, (*path, "rest"), source.rest, unit, problems)
    if low <= high:
        bounds, owner = (low, high), f"{setpoint.name} in this file"
        rest = check_inside(document, (*path, "rest"), rest, bounds, unit, owner, problems)
    return SetpointLimit(low, high, rate, rest, source.at_stop == "hold")


def _plant(document: Document, source: RigSource, problems: Problems) -> PlantSetup | None:
    if source.plant is None:
        return None
    model = source.plant.model
    try:
        plant_class = find_plant(model)
    except ConfigError as error:
        problems.add(document.place(("plant", "model")), error.message, error.hint)
        return None
    options: dict[str, Any] = dict(source.plant.model_extra or {})
    config = bind(document, plant_class.Config, problems, ("plant",), data=options)
    if config is None:
        return None
    try:
        settings = config.settings()
    except ConfigError as error:  # places in the plant's own file
        problems.take([error, *error.others])
        return None
    for name, value in config.at_start().items():
        try:
            settings[name].accepted(name, value)
        except ValueError as error:
            problems.add(document.place(("plant", name)), f"{model}: {error}")
    return PlantSetup(model, plant_class, config, settings)


def _simulation(
    document: Document, source: RigSource, problems: Problems
) -> SimulationSetup | None:
    if source.simulation is None:
        return None
    model = source.simulation.model
    try:
        simulation_class = find_simulation(model)
    except ConfigError as error:
        problems.add(document.place(("simulation", "model")), error.message, error.hint)
        return None
    if source.plant is not None:
        problems.add(
            document.place(("simulation", "model")),
            "a rig has either a `plant` (simulated in process) or a `simulation` (at the wire)",
            "remove one of the two",
        )
    options: dict[str, Any] = dict(source.simulation.model_extra or {})
    config = bind(document, simulation_class.Config, problems, ("simulation",), data=options)
    if config is None:
        return None
    return SimulationSetup(model, simulation_class, config, simulation_class.settings(config))


def _constants(document: Document, source: RigSource, problems: Problems) -> dict[str, Constant]:
    constants = {}
    for name, item in source.constants.items():
        given = ConstantSource(value=item) if isinstance(item, str) else item
        path: KeyPath = ("constants", name)
        try:
            found = parse_quantity(given.value)
        except ValueError as error:
            problems.add(document.place((*path, "value")), str(error))
            continue
        u = read_uncertainty(document, (*path, "u"), given.u, found.unit, problems)
        constants[name] = Constant(found.value, found.unit, u, given.source or "")
    return constants


def _interlocks(
    document: Document,
    sources: list[InterlockSource],
    rig: RigConfig,
    unread: Set[str],
    problems: Problems,
) -> tuple[Interlock, ...]:
    """Return the interlocks without those on groups or controllers that are ``unread``."""
    seen: set[str] = set()
    built = []
    for index, source in enumerate(sources):
        if not unread.isdisjoint(_named_in(source)):
            continue  # the channels of what is wrong above would all seem unknown
        path = ("interlocks", index)
        if source.name in seen:
            problems.add(document.place((*path, "name")), f"interlock name {source.name!r} is used "
                                                          "twice",
                         "give each interlock a different name")  # fmt: skip
        seen.add(source.name)
        channel = rig.channel(source.source)
        if channel is None:
            problems.add(
                document.place((*path, "source")), f"unknown channel {source.source!r}",
                suggest(source.source, channel_names(rig)),
            )  # fmt: skip
            continue
        built.append(_interlock(document, path, source, channel, rig, problems))
    return tuple(built)


def _named_in(source: InterlockSource) -> list[str]:
    """Return the devices, groups and controllers of which an interlock names something."""
    names = (source.source, source.low, source.high, source.follows, source.only_while)
    return [name.partition(".")[0] for name in names if name is not None]


def _interlock(
    document: Document,
    path: KeyPath,
    source: InterlockSource,
    channel: Channel,
    rig: RigConfig,
    problems: Problems,
) -> Interlock:
    low = _bound(document, (*path, "low"), source.low, channel, rig, problems)
    high = _bound(document, (*path, "high"), source.high, channel, rig, problems)
    if isinstance(low, float) and isinstance(high, float) and low >= high:
        message = f"low {source.low} is not below high {source.high}"
        problems.add(document.place((*path, "low")), message, "swap the two")
    deadband = 0.0
    if source.deadband is not None:
        deadband = read_difference(
            document, (*path, "deadband"), source.deadband, channel.shown_in, problems
        )
        if deadband < 0:
            problems.add(document.place((*path, "deadband")), "the deadband must be at least 0")
        if isinstance(low, float) and isinstance(high, float) and low < high < low + 2 * deadband:
            problems.add(
                document.place((*path, "deadband")),
                f"the deadband {source.deadband} is more than half of the range from {source.low} "
                f"to {source.high}: a trip could never clear",
                "give a smaller one",
            )
    _check_staleness(document, path, source, rig, problems)
    band = read_following(document, path, source, channel, rig, problems)
    return Interlock(
        name=source.name,
        source=source.source,
        low=low,
        high=high,
        follows=source.follows,
        band=band,
        only_while=source.only_while,
        delay_s=source.delay,
        deadband=deadband,
        stale_after_s=source.stale_after,
        latch=source.latch,
        priority=Priority[source.priority.upper()],
        action=Severity[source.action.upper()],
        message=source.message,
    )


def _check_staleness(
    document: Document, path: KeyPath, source: InterlockSource, rig: RigConfig, problems: Problems
) -> None:
    """Check that rows which arrive on time are never stale."""
    place = document.place((*path, "stale_after"))
    if source.stale_after * 1e9 < 2 * rig.period_ns:
        problems.add(
            place, f"stale_after {source.stale_after:g} s is less than two cycles",
            f"give at least {2e-9 * rig.period_ns:g} s",
        )  # fmt: skip
    channels = [item for item in (source.source, source.low, source.high) if item]
    for name in dict.fromkeys(channels):
        oldest_s = rig.oldest_s(name)
        if not oldest_s:
            continue
        least_s = oldest_s + 1e-9 * rig.period_ns  # the cycle looks once per period
        if source.stale_after < least_s:
            problems.add(
                place,
                f"stale_after {source.stale_after:g} s is too short for {name}: in normal "
                f"operation its newest row becomes {1e3 * oldest_s:.1f} ms old before the "
                "next row",
                f"give at least {math.ceil(1e3 * least_s)} ms, or make its blocks smaller",
            )


def _bound(
    document: Document,
    path: KeyPath,
    text: str | None,
    channel: Channel,
    rig: RigConfig,
    problems: Problems,
) -> float | str | None:
    """Return a constant in SI, or the name of the channel that gives the bound."""
    if text is None:
        return None
    if text[:1].isalpha():
        other = rig.channel(text)
        if other is None:
            problems.add(document.place(path), f"unknown channel {text!r}",
                         suggest(text, channel_names(rig)))  # fmt: skip
        elif not parse_unit(other.unit).same_kind(parse_unit(channel.unit)):
            problems.add(
                document.place(path), f"{text} is in {other.unit}, expected {channel.unit}"
            )
        return text
    unit = channel.shown_in
    value = read_quantity(document, path, text, unit, problems)
    return check_inside(document, path, value, (channel.low, channel.high), unit,
                        "what the channel can measure", problems)  # fmt: skip


def channel_names(rig: RigConfig) -> list[str]:
    """Return the names of all measured channels of ``rig`` as ``device.channel``."""
    return [
        f"{device.name}.{channel.name}"
        for device in rig.devices.values()
        for channel in device.channels
    ]

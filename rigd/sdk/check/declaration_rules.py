"""Checks the declaration of a driver, and its behaviour before it is opened."""

from __future__ import annotations

import ast
import inspect
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from functools import cache, partial
from types import ModuleType
from typing import Any, Final

from pydantic import BaseModel, ValidationError

from rigd.model.channels import STALE, STATUS_FIELD, Channel
from rigd.sdk.check.caller import Caller, Hung
from rigd.sdk.check.leaks import nothing_left, opens
from rigd.sdk.check.opening import AnyBench, any_bench
from rigd.sdk.check.subject import Rule, Subject, described
from rigd.sdk.declaration import Declaration
from rigd.sdk.driver import AnyDriver, BlockDriver, Driver, DriverConfig, SlowDriver
from rigd.sdk.options.options import options_of

NAME: Final = re.compile(r"[a-z][a-z0-9_]*")
#: Every call on a driver that is not open must return at once; machines stall, so in s:
AT_ONCE_S: Final = 2.0
#: Two addresses of this computer; simulated devices are at the first.
HERE: Final = "127.0.0.1"
THERE: Final = "127.0.0.2"


def title_problems(title: str) -> Iterator[str]:
    """Yield what is wrong with the title of a driver or a plant."""
    if not title.strip() or "\n" in title:
        yield f"title is {title!r}"


def _safe_is_said(subject: Subject) -> Iterator[str]:
    cls = subject.driver_class
    if not issubclass(cls, Driver | SlowDriver):
        return
    moves = cls.write not in (Driver.write, SlowDriver.write)
    own = (cls.make_safe.__doc__ or "").strip()
    if not own and (moves or issubclass(cls, Driver)):
        yield f"{cls.__name__}.make_safe has no docstring"
    texts = [own, *(own_class_.__doc__ or "" for own_class_ in _own_classes(cls))]
    if moves and not any("safe" in text.lower() for text in texts):
        yield f"{cls.__name__} takes setpoints, and no docstring states what safe means"


def undocumented(model: type[BaseModel], what: str = "option ") -> Iterator[str]:
    """Yield the options of ``model`` without a documentation."""
    for option in options_of(model):
        if not option.doc:
            yield f"{what}{option.name} has no documentation"


def bare(model: type[BaseModel], what: str = "option ") -> Iterator[str]:
    """Yield the options of ``model`` that are numbers without a unit."""
    for option in options_of(model):
        if option.bare:
            yield f"{what}{option.name} is a bare float"


def lenient(
    config_class: type[BaseModel], base: type[BaseModel], options: Mapping[str, Any]
) -> Iterator[str]:
    """Yield that a Config is none, or accepts options that it does not have."""
    if not issubclass(config_class, base):
        yield f"Config is {config_class!r}"
        return
    try:
        config_class.model_validate({**options, "no_such_option_": 1})
    except ValidationError as error:
        if any(item["type"] == "extra_forbidden" for item in error.errors()):
            return
    yield "an unknown option is accepted"


def _options_read(subject: Subject) -> Iterator[str]:
    for name in unread(subject.driver_class.Config, _own_classes(subject.driver_class)):
        yield f"nothing reads option {name}"


def unread(model: type[BaseModel], users: Sequence[type]) -> Iterator[str]:
    """Yield each field of ``model`` that no code reads.

    The code is that of the folders of ``users`` (the class that has the model, those that it is
    made of, its devices), and of the class that declares the field: an option of a port is read
    beside it.
    """
    if "model_dump" in _used([_folder(users[0].__module__)]):
        return
    used = _used(_folder(item.__module__) for item in users)
    for name in model.model_fields:
        homes = [
            _folder(item.__module__)
            for item in model.__mro__
            if name in inspect.get_annotations(item)
        ]
        read = used | _used(homes)
        if read and name not in read:
            yield name


def _folder(module: str) -> str:
    return module.rpartition(".")[0] or module


def _used(folders: Iterable[str]) -> set[str]:
    """Return the names of attributes and the texts in modules that lie in ``folders``."""
    wanted = set(folders)
    used: set[str] = set()
    for name, module in list(sys.modules.items()):
        if _folder(name) in wanted or name in wanted:
            used |= _names_read(module)
    return used


def _elsewhere(subject: Subject) -> Iterator[str]:
    with subject.fresh_peer() as peer:
        given = {**dict(subject.config(peer.options))}
        for name, value in given.items():
            if not isinstance(value, str) or HERE not in value:
                continue
            try:
                config = subject.config({**peer.options, name: value.replace(HERE, THERE)})
            except ValueError:
                continue
            with Caller() as caller:
                found = AnyBench(subject, peer, caller, config)
                opened = found.opened()
                found.end()
            if any(HERE in item for item in opened) and not any(THERE in item for item in opened):
                yield f"{name} is {value.replace(HERE, THERE)}, and open() connects to {HERE}"


@cache
def _names_read(module: ModuleType) -> frozenset[str]:
    """Return the names of attributes in the source of a module, and the texts in it."""
    try:
        tree = ast.parse(inspect.getsource(module))
    except (OSError, TypeError, SyntaxError):
        return frozenset()  # it has no source
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            found.add(node.attr)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)  # as of getattr
    return frozenset(found)


def _declares(subject: Subject) -> Iterator[str]:
    name = subject.driver_class.__name__
    with Caller() as caller:
        for _ in range(2):
            try:
                ended = caller.call(subject.declare, AT_ONCE_S)
            except Hung as hung:
                yield f"{name}.declare(config) {hung}"
                return
            if ended.error is not None:
                yield f"{name}.declare(config) raises {described(ended.error)}"
                return
            if not isinstance(ended.value, Declaration):
                yield f"{name}.declare(config) returns {ended.value!r}, expected a Declaration"
                return


def _same_again(subject: Subject) -> Iterator[str]:
    first, second = subject.declare(), subject.declare()
    for item in fields(Declaration):
        if getattr(first, item.name) != getattr(second, item.name):
            yield f"two declarations for the same options differ in {item.name}"


def _channels(subject: Subject) -> Iterator[str]:
    declared = subject.declare()
    if not declared.channels and not declared.setpoints:
        yield "it has neither channels nor setpoints"
    yield from _named_well("channel", declared.channels)
    names = {channel.name for channel in declared.channels}
    for channel in declared.channels:
        if channel.name == STATUS_FIELD:
            yield f"channel {STATUS_FIELD!r}: the name is taken by the status word"
        if channel.raw_of is not None and channel.raw_of not in names:
            yield f"channel {channel.name!r} is raw_of {channel.raw_of!r}, which is no channel"
        if not channel.low < channel.high:
            yield f"channel {channel.name!r} has the range {channel.low:g} to {channel.high:g}"


def _row_is_named(subject: Subject) -> Iterator[str]:
    declared = subject.declare()
    named = declared.row is not None
    if issubclass(subject.driver_class, BlockDriver):
        if named or declared.plain_rows:
            yield "a block driver gives blocks, and declares rows of its own"
    elif named and declared.plain_rows:
        yield "it declares a row and plain_rows"
    elif declared.channels and not named and not declared.plain_rows:
        yield "it has channels, and names no row"


def _setpoints(subject: Subject) -> Iterator[str]:
    setpoints = subject.declare().setpoints
    yield from _named_well("setpoint", setpoints)
    for setpoint in setpoints:
        finite = math.isfinite(setpoint.low) and math.isfinite(setpoint.high)
        if not finite or not setpoint.low < setpoint.high:
            bounds = f"{setpoint.low:g} to {setpoint.high:g} {setpoint.unit}"
            yield f"setpoint {setpoint.name!r} has the range {bounds}"
    cls = subject.driver_class
    if setpoints and issubclass(cls, BlockDriver):
        yield "it has setpoints, and a block driver cannot take them"
    kind = SlowDriver if issubclass(cls, SlowDriver) else Driver
    for name in ("write", "make_safe") if setpoints and issubclass(cls, kind) else ():
        if getattr(cls, name) is getattr(kind, name):
            yield f"it has setpoints, and {name}() is not its own"


def _status_bits(subject: Subject) -> Iterator[str]:
    declared = subject.declare()
    if declared.status_bits and not declared.has_status:
        yield "it has status_bits, and no status word"
    for word, mask in declared.status_bits.items():
        if not NAME.fullmatch(word) or word == "not":
            yield f"status bit {word!r}: conditions could not be written with it"
        if not 0 < mask < STALE:
            yield f"status bit {word!r} is {mask:#x}, not within bits 0 to 30"


def _hooks(subject: Subject) -> Iterator[str]:
    cls, declared = subject.driver_class, subject.declare()
    acts = issubclass(cls, SlowDriver) and cls.act is not SlowDriver.act
    if issubclass(cls, Driver):
        watchdog_s = declared.watchdog_s
        if watchdog_s is not None and cls.prove_watchdog is Driver.prove_watchdog:
            yield f"watchdog_s is {watchdog_s:g} s, and prove_watchdog() is not its own"
        if watchdog_s is not None and not 0 < watchdog_s < math.inf:
            yield f"watchdog_s is {watchdog_s}"
        if cls.second_link and cls.rescue is Driver.rescue:
            yield "second_link is True, and rescue() is not its own"
        acts = cls.act is not Driver.act
    if declared.actions and not acts:
        yield f"it has the actions {', '.join(declared.actions)}, and act() is not its own"
    for name, doc in declared.actions.items():
        if not NAME.fullmatch(name) or not doc.strip():
            yield f"action {name!r} is described as {doc!r}"


def _silence(subject: Subject) -> Iterator[str]:
    declared = subject.declare()
    silent_s, oldest_s = declared.silent_s, declared.oldest_s
    if not (math.isfinite(silent_s) and silent_s > 0):
        yield f"silent_s is {silent_s}"
    if not 0 <= oldest_s < silent_s:
        yield f"oldest_s is {oldest_s}, and silent_s {silent_s}"


def _constructor_opens_nothing(subject: Subject) -> Iterator[str]:
    name = subject.driver_class.__name__
    with subject.fresh_peer() as peer, Caller() as caller:
        made: list[tuple[object, list[str]]] = []
        for _ in range(2):
            make = partial(subject.make, peer, peer.link())  # a link may take longer to make
            before = peer.look()
            try:
                with nothing_left(f"after {name}(config, link)"):
                    ended = caller.call(partial(_listened, make), AT_ONCE_S)
                    made.append(ended.value)
            except Hung as hung:
                yield f"the constructor {hung}"
                return
            if ended.error is not None:
                yield f"{name}(config, link) raises {described(ended.error)}"
                return
            opened = ended.value[1]
            after = peer.look()
            if opened:
                yield f"{name}(config, link) calls {', '.join(dict.fromkeys(opened))}"
            elif (before.driven, before.energised, before.acted) != (
                after.driven, after.energised, after.acted,
            ):  # fmt: skip
                yield f"{name}(config, link) changes what the device does"
        if made[0][0] is made[1][0]:
            yield "the class gives the same object twice"


def _listened(make: Callable[[], object]) -> tuple[object, list[str]]:
    with opens() as opened:
        return make(), [each.words for each in opened]


def _unopened(subject: Subject) -> Iterator[str]:
    with any_bench(subject) as (found, _, _):
        names = ("make_safe", "close") if isinstance(found.driver, Driver) else ("close",)
        for name in (each for each in names for _ in range(2)):
            try:
                ended = found.call(getattr(found.driver, name), AT_ONCE_S)
            except Hung as hung:
                yield f"{name} before open {hung}"
                return
            if ended.error is not None:
                yield f"{name} before open raises {described(ended.error)}"


def _named_well(what: str, channels: tuple[Channel, ...]) -> Iterator[str]:
    names = [channel.name for channel in channels]
    for channel in channels:
        if not NAME.fullmatch(channel.name):
            yield f"{what} {channel.name!r}: lower case letters, digits and _ make a name"
        if names.count(channel.name) > 1:
            yield f"{what} {channel.name!r} is there more than once"
        if not channel.doc.strip():
            yield f"{what} {channel.name!r} has no doc"


def _own_classes(cls: type[AnyDriver]) -> list[type]:
    return [item for item in inspect.getmro(cls) if item.__module__ != Driver.__module__]


#: Rules for the class alone.
CLASS_RULES: Final = (
    Rule(
        "title",
        "give the class a `title` of one line: what the device is",
        lambda subject: title_problems(subject.driver_class.title),
    ),
    Rule(
        "safe is described",
        "state in the docstring of make_safe what it does, and of the class what safe means",
        _safe_is_said,
    ),
    Rule(
        "options strict",
        "derive Config from DriverConfig, and leave its model_config as it is",
        lambda subject: lenient(subject.driver_class.Config, DriverConfig, dict(subject.options)),
    ),
    Rule(
        "options documented",
        "put a docstring beneath every field of Config: `rigd drivers` and `rigd check` show it",
        lambda subject: undocumented(subject.driver_class.Config),
    ),
    Rule(
        "options have units",
        'declare quantities as Annotated[float, In("A")], pure numbers with In("1")',
        lambda subject: bare(subject.driver_class.Config),
    ),
    Rule(
        "options are read",
        "use every option of Config, or remove it: who gives it in a rig file relies on it",
        _options_read,
    ),
)

#: The rule that comes before all that look at the declaration.
DECLARES: Final = (
    Rule(
        "declares",
        "return a Declaration from declare(config), of the options alone; open nothing",
        _declares,
    ),
)

#: Rules for the declaration.
DECLARED_RULES: Final = (
    Rule("same again", "make the declaration from the options alone", _same_again),
    Rule(
        "channels",
        "give every channel a name of its own, a doc, an SI unit, and a range that it can measure",
        _channels,
    ),
    Rule(
        "row is named",
        "derive a class from Row with a field for each channel, and declare it as `row`; only if "
        "the options list the channels, declare plain_rows",
        _row_is_named,
    ),
    Rule(
        "setpoints",
        "give every setpoint a name, a doc and the finite range that the device takes",
        _setpoints,
    ),
    Rule(
        "status bits",
        "give the bits of the status word names of small letters, each a mask below bit 31",
        _status_bits,
    ),
    Rule(
        "hooks",
        "what a driver declares (watchdog_s, second_link, actions) it implements and describes",
        _hooks,
    ),
    Rule("silence", "silent_s is a time in s, above 0; oldest_s one below it", _silence),
)

#: Rules for drivers that are constructed and not open.
UNOPENED_RULES: Final = (
    Rule(
        "constructor opens nothing",
        "keep config and link in the constructor, and connect in open()",
        _constructor_opens_nothing,
        "",
    ),
    Rule(
        "safe and closed before open",
        "make_safe() and close() do nothing, silently, while nothing is open",
        _unopened,
        "",
    ),
    Rule(
        "address is used",
        "connect to the address that the rig file gives, and to no other",
        _elsewhere,
        "",
    ),
)

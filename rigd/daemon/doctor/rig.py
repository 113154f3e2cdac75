"""Checks the parts of a rig: links, devices, watchdogs, and channels at rest."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from rigd.config.rig import RigConfig
from rigd.daemon.doctor.check import Check, CheckVerdict, OnCheck
from rigd.daemon.doctor.machine import rigs_check
from rigd.daemon.doctor.survey import Survey
from rigd.daemon.manual import UnarmedSession, open_unarmed
from rigd.engine.play.control import Control
from rigd.engine.system.processors import residents
from rigd.model.errors import Blocked, DeviceError
from rigd.model.severity import Severity

#: A load is an upper bound. Beyond this share a message that comes late, or is repeated, delays
#: those of the next cycle.
_FULL: Final = 0.8


@dataclass(frozen=True)
class Reason:
    """Why a device or link failed; ``name`` is "" if the device is unknown."""

    name: str
    message: str
    advice: str


def examine_rig(rig: RigConfig, seconds: float, control: Control, on_check: OnCheck) -> None:
    """Open ``rig``, test its watchdogs, watch it at rest for ``seconds``; nothing is armed."""
    group = f"rig {rig.name}"
    try:
        with open_unarmed(rig, control, command="rigd doctor") as look:
            _examine(look, seconds, on_check)
    except Blocked as error:
        for reason in error.reasons:
            on_check(
                Check(group, "free", CheckVerdict.FAIL, reason, "wait until it ends, or end it")
            )


def _examine(look: UnarmedSession, seconds: float, on_check: OnCheck) -> None:
    rig = look.rig
    group = f"rig {rig.name}"
    reasons = split_reasons(look.open(), [*rig.links, *rig.devices])
    for check in _links_and_devices(group, look, reasons):
        on_check(check)
    if reasons:
        found = "not measured"
        on_check(
            Check(group, "at rest", CheckVerdict.FAIL, found, "every device must be found first")
        )
        return
    if look.stopped:
        return
    for check in _watchdogs(look):
        on_check(check)
    survey = Survey(rig)
    try:
        look.first_rows()
        look.on_rows = survey.take
        look.rest(seconds)
    except DeviceError as error:
        on_check(Check(group, "at rest", CheckVerdict.FAIL, error.message, error.hint or ""))
        return
    if look.stopped:
        return
    group = f"{group}, {seconds:g} s at rest"
    watchdogs = {
        event.data["device"]: event.data["safe_after_s"]
        for event in look.events
        if event.kind == "watchdog"
    }
    for check in survey.cycle(group, watchdogs):
        on_check(check)
    if survey.share is not None:
        on_check(rigs_check(group, os.sched_getaffinity(0), residents(), survey.share))
    for check in (*judge_loads(group, look.loads()), *_interlocks(group, look)):
        on_check(check)
    for check in survey.devices(group):
        on_check(check)
    for check in survey.channels("channels, at rest"):
        on_check(check)


def split_reasons(messages: Sequence[str], names: Sequence[str]) -> list[Reason]:
    """Return the reasons in a message: ``name: message`` each, or several joined by semicolons."""
    known = "|".join(map(re.escape, sorted(names, key=len, reverse=True)))
    reasons = []
    for text in messages:
        message, _, advice = text.partition("\n")
        for piece in re.split(rf"; (?=(?:{known}): )", message):
            match = re.match(rf"({known}): (.*)", piece, re.DOTALL)
            name, found = (match[1], match[2]) if match else ("", piece)
            reasons.append(Reason(name, found, " ".join(advice.split())))
    return reasons


def _links_and_devices(
    group: str, look: UnarmedSession, reasons: Sequence[Reason]
) -> Iterator[Check]:
    rig = look.rig
    identities = {
        name: str(identity)
        for event in look.events
        if event.kind == "devices"
        for name, identity in event.data.items()
    }
    wrong = {item.name for item in reasons}
    for reason in reasons:
        if reason.name not in rig.devices:
            name = reason.name or "opening"
            yield Check(group, name, CheckVerdict.FAIL, reason.message, reason.advice)
    for name, link in rig.links.items():
        if name not in wrong:
            yield Check(group, name, CheckVerdict.OK, f"open ({link.link_class.title})")
    for name, device in rig.devices.items():
        mine = [reason for reason in reasons if reason.name == name]
        for reason in mine:
            yield Check(group, name, CheckVerdict.FAIL, reason.message, reason.advice)
        if device.link is not None and device.link in wrong:
            found = f"not tested: {device.link} is not open"
            yield Check(group, name, CheckVerdict.FAIL, found)
        elif not mine and "" not in wrong:
            identity = identities.get(name) or device.driver_class.title
            yield Check(group, name, CheckVerdict.OK, identity, figures={"identity": identity})


def _watchdogs(look: UnarmedSession) -> Iterator[Check]:
    """Yield a check of every watchdog; each has acted once for it."""
    rig, group = look.rig, "watchdogs"
    actuators = [device for device in rig.devices.values() if device.is_actuator]
    if rig.plant is not None:
        found = "none needed: the devices are simulated in this process and end with it"
        yield Check(group, "all", CheckVerdict.OK, found)
        return
    before = len(look.events)
    reasons = split_reasons(look.judge(), list(rig.devices))
    proven = {event.data.get("device"): event for event in look.events[before:]}
    for reason in reasons:
        yield Check(
            group, reason.name or "arming", CheckVerdict.FAIL, reason.message, reason.advice
        )
    for device in actuators:
        event = proven.get(device.name)
        if event is None:
            continue  # reported above, with its reason
        name, data = device.name, event.data
        if event.kind == "waiver":
            found = f"none; waived by {data['by']}: {data['reason']}"
            yield Check(
                group, name, CheckVerdict.WARN, found, "nothing stops it if this machine fails"
            )
        elif event.kind == "watchdog":
            took_s, bound_s = data["safe_after_s"], data["bound_s"]
            found = (
                f"safe {took_s * 1e3:.0f} ms after the driver fell silent, "
                f"bound {bound_s * 1e3:.0f} ms"
            )
            figures = {"safe_after_s": took_s, "bound_s": bound_s}
            yield Check(group, name, CheckVerdict.OK, found, figures=figures)


def judge_loads(group: str, loads: Mapping[str, float]) -> Iterator[Check]:
    """Yield whether each link, by name, has room; ``loads`` are shares of its capacity, 0 to 1."""
    for name, load in loads.items():
        found, figures = f"uses at most {load:.0%} of its capacity", {"load": load}
        if load > _FULL:
            advice = "move devices to another bus, or lower `cycle`: messages that wait arrive late"
            yield Check(group, name, CheckVerdict.WARN, found, advice, figures)
        else:
            yield Check(group, name, CheckVerdict.OK, found, figures=figures)


def _interlocks(group: str, look: UnarmedSession) -> Iterator[Check]:
    standing = {trip.interlock.name for trip in look.active_interlocks()}
    last = {trip.interlock.name: trip for trip in look.trips}
    for name, trip in last.items():
        action = trip.interlock.action
        verdict = (
            CheckVerdict.FAIL if name in standing and action > Severity.WARN else CheckVerdict.WARN
        )
        advice = trip.interlock.message or "no run is armed while it is tripped"
        if name not in standing:
            advice = f"it is over; in a run its action would be: {action.word.replace('_', ' ')}"
        yield Check(group, f"interlock {name}", verdict, trip.reason, advice)
    if not last:
        count = len(look.rig.interlocks)
        yield Check(group, "interlocks", CheckVerdict.OK, f"none of {count} tripped")

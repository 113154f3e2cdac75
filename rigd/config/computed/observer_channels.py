"""Finds the channels that observers of every kind use, and makes those that they publish."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rigd.config.document import Document, KeyPath
from rigd.config.problems import Problems, suggest
from rigd.config.rig import RigConfig
from rigd.config.source import DerivedSource
from rigd.model.channels import Channel


@dataclass(frozen=True)
class Finder:
    """Finds channels for the observer at ``path``; ``lost_s`` is its `lost_after`.

    ``by_default``: the file does not give it.
    """

    document: Document
    path: KeyPath
    derived: Mapping[str, DerivedSource]
    rig: RigConfig
    problems: Problems
    lost_s: float
    by_default: bool

    def find(self, keys: KeyPath, name: str, *, measured: bool) -> Channel:
        """Return the channel ``name`` that stands at ``keys``, or a stand-in with a problem noted.

        A channel that is not ``measured`` may be a setpoint as it was written.
        """
        rig = self.rig
        channel = rig.channel(name) if measured else rig.recorded(name)
        if channel is None:
            if name in self.derived:
                self._note(
                    keys, f"{name} is a derived channel, computed after the observers",
                    "give what it is computed from; derived channels may use states",
                )  # fmt: skip
                return Channel(name)
            known = [
                f"{device.name}.{item.name}"
                for device in rig.devices.values()
                for item in device.channels
            ]
            self._note(keys, f"unknown channel {name!r}", suggest(name, known))
            return Channel(name)
        declared = rig.devices[name.partition(".")[0]].declaration
        apart_s = declared.oldest_s
        if not declared.every_cycle and rig.channel(name) is not None:
            apart_s = max(apart_s, declared.silent_s)
        if apart_s >= self.lost_s:
            self._note(
                keys,
                f"readings of {name} may come {apart_s:g} s apart, and the states are lost after "
                f"{self.lost_s:g} s",
                f"give a `lost_after` above {apart_s:g} s",
            )
        slow = rig.slow_device_in(name)
        if slow is not None and self.by_default and rig.channel(name) is not None:
            self._note(
                keys,
                f"the readings of {name} come at a pace of their own: when are the states lost?",
                "give a `lost_after` that is longer than the time between two readings",
            )
        return channel

    def _note(self, keys: KeyPath, message: str, hint: str | None = None) -> None:
        self.problems.add(self.document.place((*self.path, *keys)), message, hint)


def published(
    states: Sequence[Channel], measured: Sequence[tuple[str, Channel]]
) -> tuple[Channel, ...]:
    """Return the channels of an observer, in the order of its row.

    ``measured`` are names, as ``device.channel``, with their channels.
    """
    found: list[Channel] = []
    for state in states:
        found.append(state)
        doc = f"standard deviation of {state.name}"
        found.append(Channel(f"{state.name}_sd", state.unit, doc))
    for name, channel in measured:
        doc = f"{name} as measured minus as expected from the readings before"
        found.append(Channel(f"{name.replace('.', '_')}_innovation", channel.unit, doc))
    doc = "normalised innovation squared; its mean is the number of channels that are measured"
    found.append(Channel("nis", "1", doc))
    return tuple(found)

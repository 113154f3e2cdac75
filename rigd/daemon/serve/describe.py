"""Describes a rig to clients: what changes only with the streams of a run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import cast

from rigd.config.lab.lab import load_lab
from rigd.config.rig import RigConfig
from rigd.daemon.live.stream import LiveStream
from rigd.daemon.manual import actions_of
from rigd.engine.cycle.wiring import streams_of
from rigd.engine.row_rates import most_rows_hz
from rigd.model.channels import Channel, Stream
from rigd.model.errors import ConfigError
from rigd.model.limits import Interlock
from rigd.remote.protocol import Role
from rigd.remote.protocol.results import (
    ActionView,
    ChannelView,
    ControllerView,
    Description,
    InterlockView,
    PriorityName,
    SetpointView,
    StatedView,
    StreamView,
)
from rigd.remote.protocol.status import ActionName


def describe(rig: RigConfig, role: Role, of_run: Sequence[LiveStream] = ()) -> Description:
    """Return the description of ``rig`` for a client with ``role``.

    ``of_run`` are the streams that the rig has in the present run only.
    """
    return Description(
        rig=rig.name,
        title=rig.title,
        simulated=rig.plant is not None or rig.simulation is not None,
        # Numbered as in the frames (rigd.daemon.live).
        streams=(
            *(_stream(rig, n, item) for n, item in enumerate(streams_of(rig))),
            *(_stream(rig, live.number, live.stream) for live in of_run),
        ),
        setpoints=tuple(_setpoints(rig)),
        interlocks=tuple(_interlock(interlock) for interlock in rig.interlocks),
        controllers=tuple(
            ControllerView(setpoint=name, output=output) for name, output in rig.loops.items()
        ),
        actions=tuple(_actions(rig)),
        role=role,
        roles={name: Role(given) for name, given in rig.remote.roles.items()},
        stated=tuple(_stated(rig.lab)),
    )


def _stated(lab: Path | None) -> Iterator[StatedView]:
    """Yield the fields that a person states; none if the file of the lab is wrong.

    The start of a run is then refused, with the mistake.
    """
    try:
        fields = {} if lab is None else load_lab(lab).fields
    except ConfigError:
        return
    for name, item in fields.items():
        if name in ("specimen", "note") or name.startswith("meta."):
            yield StatedView(
                name=name,
                doc=item.doc,
                required=item.required,
                unit=item.unit or "",
                choices=item.choices,
            )


def _stream(rig: RigConfig, number: int, stream: Stream) -> StreamView:
    return StreamView(
        number=number,
        name=stream.name,
        channels=tuple(_channel(channel) for channel in stream.channels),
        rate_hz=most_rows_hz(rig, stream),
    )


def _channel(channel: Channel) -> ChannelView:
    return ChannelView(
        name=channel.name,
        unit=channel.unit,
        display=channel.display,
        doc=channel.doc,
        low=_finite(channel.low),
        high=_finite(channel.high),
        raw_of=channel.raw_of,
    )


def _setpoints(rig: RigConfig) -> Iterator[SetpointView]:
    for device in rig.devices.values():
        for setpoint in device.setpoints:
            limit = device.limits[setpoint.name]
            yield SetpointView(
                name=f"{device.name}.{setpoint.name}",
                unit=setpoint.unit,
                low=limit.low,
                high=limit.high,
                rate=_finite(limit.rate),
                rest=limit.rest,
            )


def _interlock(interlock: Interlock) -> InterlockView:
    return InterlockView(
        name=interlock.name,
        source=interlock.source,
        low=interlock.low,
        high=interlock.high,
        action=cast(ActionName, interlock.action.word),
        priority=cast(PriorityName, interlock.priority.name.lower()),
        latch=interlock.latch,
        message=interlock.message,
    )


def _actions(rig: RigConfig) -> Iterator[ActionView]:
    for device in rig.devices:
        for action, doc in actions_of(rig, device).items():
            yield ActionView(device=device, action=action, doc=doc)


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None

"""A rig that is played with two bodies in a plane: one stands, one goes round in a circle."""

from __future__ import annotations

import math
import threading
import time

import numpy as np
from support.panel.played_rig import TICK_S, TITLE, PlayedRig

from rigd.remote.protocol import Requester
from rigd.remote.protocol.arguments import NoArguments, StreamName
from rigd.remote.protocol.frame import Frame, encode_frame
from rigd.remote.protocol.results import (
    ChannelView,
    ControllerView,
    Description,
    History,
    InterlockView,
    StreamView,
)

#: Where the body stands: x and y in m, heading in rad.
STANDS = (-3.0, 0.5, math.pi / 2)
#: The circle: its radius in m about the origin, and the time of a turn in s.
RADIUS_M = 1.0
TURN_S = 1.0


def _channels(**units: str) -> tuple[ChannelView, ...]:
    return tuple(ChannelView(name=name, unit=unit) for name, unit in units.items())


POSE = {"x": "m", "y": "m", "heading": "rad"}
STREAMS = (
    StreamView(number=0, name="motor", rate_hz=30.0, channels=_channels(speed="rad/s")),
    StreamView(number=1, name="standing", rate_hz=30.0, channels=_channels(frame="count", **POSE)),
    StreamView(number=2, name="going_round", rate_hz=30.0, channels=_channels(**POSE)),
    StreamView(number=3, name="hidden", rate_hz=30.0, channels=_channels(**POSE)),
    StreamView(
        number=4,
        name="governor",
        rate_hz=30.0,
        channels=_channels(
            speed="rad/s",
            error="rad/s",
            saturated="1",
            active="1",
            speed_setpoint="rad/s",
        ),
    ),
)
CONTROLLER = ControllerView(setpoint="governor.speed", output="motor.current")
INTERLOCKS = tuple(
    InterlockView(name=f"{name}_lost", source=f"{name}.x", action="stop", priority="high",
                  latch=False, message="The camera has lost the body.")
    for name in ("standing", "going_round")
)  # fmt: skip


class BodiesRig(PlayedRig):
    """Publishes the poses of its bodies while it runs; ``covered`` bodies give no rows."""

    def __init__(self) -> None:
        super().__init__()
        self.covered: set[str] = set()
        self.acts = self.saturated = 0.0  #: what its controller does
        self.speed = 1.0  #: of its motor
        self.streams = STREAMS

    def play(self, until: threading.Event) -> None:
        """Publish frames while a run is under way."""
        sequence = 0
        while not until.wait(TICK_S):
            if self.state == "idle" or self.publisher is None:
                continue
            now_ns, sequence = time.time_ns(), sequence + 1
            angle = 2 * math.pi * (now_ns * 1e-9 / TURN_S % 1.0)
            there = (RADIUS_M * math.cos(angle), RADIUS_M * math.sin(angle), angle)
            rows: dict[str, tuple[float, ...]] = {
                "motor": (self.speed,), "standing": (sequence, *STANDS), "going_round": there,
                "hidden": there, "governor": (0.8, 0.2, self.saturated, self.acts, 1.0),
            }  # fmt: skip
            for stream in STREAMS:
                if stream.name not in self.covered:
                    values = np.array(rows[stream.name], "f4")[:, None]
                    frame = Frame(stream.number, sequence, now_ns, np.zeros(1), values, values)
                    self.publisher.frame(stream.name, encode_frame(frame))

    def _describe(self, by: Requester, _: NoArguments) -> Description:
        return Description(
            rig=self.name, title=TITLE, simulated=True, streams=self.streams, interlocks=INTERLOCKS,
            controllers=(CONTROLLER,), role=by.role,
        )  # fmt: skip

    def _history(self, _: Requester, __: StreamName) -> History:
        return History(frame=None)

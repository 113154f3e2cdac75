"""An axis that is a file: what it was last told outlives the process that told it."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from rigd.config.rig import DeviceConfig, LinkSetup, RigConfig, SourceFile, Supervision, Waiver
from rigd.model.limits import Interlock, SetpointLimit
from rigd.sdk import Channel, DeviceError, Driver, DriverConfig, Link, LinkConfig


class FileAxisConfig(DriverConfig):
    """Where the axis stands, and how it misbehaves."""

    path: Path
    watchdog: bool = True
    """Whether it has one."""
    proven: bool = True
    """Whether it acts when it is tried."""
    hang_after_s: float | None = None
    """When `read` no longer returns."""
    drops_after_s: float | None = None
    """When the position drops by a metre."""
    fails_after_s: float | None = None
    """When it reports a fault."""
    safe_takes_s: float = 0.0
    ready_after_s: float = 0.0
    opens_in_s: float = 0.0


class FileAxis(Driver):
    """Integrates its speed; safe means speed zero and disabled."""

    Config: ClassVar[type[DriverConfig]] = FileAxisConfig
    second_link: ClassVar[bool] = True
    channels = (Channel("position", "m"), Channel("speed", "m/s"))
    setpoints = (Channel("speed", "m/s", low=-2, high=2),)
    has_status = True
    config: FileAxisConfig

    def __init__(self, config: FileAxisConfig, link: object) -> None:
        super().__init__(config, link)
        self.watchdog_s = 0.5 if config.watchdog else None
        self._enabled = False
        self._position = self._speed = 0.0
        self._begun = self._armed_at = 0.0

    def open(self) -> None:
        self._begun = time.monotonic()
        self._keep("opened")
        time.sleep(self.config.opens_in_s)

    def prove_watchdog(self) -> float:
        if not self.config.proven:
            raise DeviceError("it went on for 1 s after the last command")
        return 0.1

    def arm(self) -> None:
        self._armed_at = time.monotonic()
        self._enabled = True

    def ready(self) -> bool:
        return time.monotonic() - self._armed_at >= self.config.ready_after_s

    def read(self, t_ns: int) -> Sequence[float]:
        self._position += self._speed * 1e-3
        hang = self.config.hang_after_s
        if hang is not None and time.monotonic() - self._begun > hang:
            time.sleep(60)
        fail = self.config.fails_after_s
        if fail is not None and time.monotonic() - self._begun > fail:
            raise DeviceError("the belt is torn")
        drop = self.config.drops_after_s
        if drop is not None and time.monotonic() - self._begun > drop:
            return self._position - 1.0, self._speed, int(self._enabled)
        return self._position, self._speed, int(self._enabled)

    def write(self, setpoints: Sequence[float]) -> None:
        if self._enabled:
            (self._speed,) = setpoints
            self._keep("moving" if self._speed else "still")

    def make_safe(self) -> None:
        self._enabled = False
        self._speed = 0.0
        time.sleep(self.config.safe_takes_s)
        self._keep("safe")

    def rescue(self) -> None:
        self._keep("rescued")

    def _keep(self, word: str) -> None:
        draft = self.config.path.with_suffix(f".{os.getpid()}")
        draft.write_text(json.dumps({"word": word, "pid": os.getpid()}))
        draft.replace(self.config.path)


class HeldLinkConfig(LinkConfig):
    """No options."""


class HeldLink(Link):
    """A link that somebody else holds: opening it waits for them."""

    def open(self) -> None:
        time.sleep(60)

    def close(self) -> None:
        pass


def word(path: Path) -> str:
    """Return what the axis was last told."""
    told = json.loads(path.read_text())["word"]
    assert isinstance(told, str)
    return told


def rig(
    path: Path,
    *,
    interlocks: tuple[Interlock, ...] = (),
    waiver: Waiver | None = None,
    cycle_silence_s: float = 0.25,
    daemon_silence_s: float = 1.0,
    link_held: bool = False,
    **options: object,
) -> RigConfig:
    """Return a rig of this one axis."""
    config = FileAxisConfig.model_validate({"path": path, **options})
    axis = FileAxis(config, None)
    return RigConfig(
        name=f"file-{path.parent.name}",
        title="",
        period_ns=2_000_000,
        plant=None,
        devices={
            "axis": DeviceConfig(
                name="axis",
                driver="file-axis",
                driver_class=FileAxis,
                config=config,
                channels=axis.channels,
                setpoints=axis.setpoints,
                has_status=True,
                limits={"speed": SetpointLimit(-1.5, 1.5, 100.0)},
                waiver=waiver,
            )
        },
        interlocks=interlocks,
        constants={},
        source=SourceFile(path, "rig: file\n"),
        links={"held": LinkSetup("held", "held", HeldLink, HeldLinkConfig())} if link_held else {},
        supervision=Supervision(cycle_silence_s, daemon_silence_s),
    )

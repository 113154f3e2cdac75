"""An axis that is a file: its last command outlives the process that sent it."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from rigd.config.rig import DeviceConfig, LinkSetup, RigConfig, SourceFile, Supervision, Waiver
from rigd.model.limits import Interlock, SetpointLimit
from rigd.sdk import Channel, Declaration, DeviceError, Driver, DriverConfig, Link, LinkConfig, Row
from rigd.sdk.peers import connect


class FileAxisConfig(DriverConfig):
    """Where the axis stands, and how it misbehaves."""

    path: Path
    watchdog: bool = True
    """Whether it has one."""
    proven: bool = True
    """Whether it acts when it is tried."""
    proof_takes_s: float = 0.0
    hang_after_s: float | None = None
    """When `read` no longer returns."""
    drops_after_s: float | None = None
    """When the position drops by a metre."""
    fails_after_s: float | None = None
    """When it reports a fault."""
    safe_takes_s: float = 0.0
    ready_after_s: float = 0.0
    opens_in_s: float = 0.0
    tcp_port: int | None = None
    """The port of `localhost` at which it is opened and rescued."""


class AxisRow(Row):
    position: float
    speed: float
    status: int


class FileAxis(Driver[FileAxisConfig, None]):
    """Integrates its speed; safe means speed zero and disabled."""

    Config: ClassVar[type[DriverConfig]] = FileAxisConfig
    second_link: ClassVar[bool] = True

    def __init__(self, config: FileAxisConfig, link: None) -> None:
        super().__init__(config, link)
        self._enabled = False
        self._position = self._speed = 0.0
        self._begun = self._armed_at = 0.0
        self._kept: tuple[str, int, int] | None = None

    @classmethod
    def declare(cls, config: FileAxisConfig) -> Declaration:
        return Declaration(
            channels=(Channel("position", "m"), Channel("speed", "m/s")),
            row=AxisRow,
            setpoints=(Channel("speed", "m/s", low=-2, high=2),),
            watchdog_s=0.5 if config.watchdog else None,
        )

    def open(self) -> None:
        self._begun = time.monotonic()
        if self.config.tcp_port is not None:
            connect("localhost", self.config.tcp_port, 1.0).close()
        self._keep("opened")
        time.sleep(self.config.opens_in_s)

    def prove_watchdog(self) -> float:
        if not self.config.proven:
            raise DeviceError("it went on for 1 s after the last command")
        if self.config.proof_takes_s:
            self._keep("enabled for a proof")
            time.sleep(self.config.proof_takes_s)
            self._keep("proven")
        return 0.1

    def arm(self) -> None:
        self._armed_at = time.monotonic()
        self._enabled = True

    def ready(self) -> bool:
        return time.monotonic() - self._armed_at >= self.config.ready_after_s

    def read(self, t_ns: int) -> AxisRow:
        self._position += self._speed * 1e-3
        hang = self.config.hang_after_s
        if hang is not None and time.monotonic() - self._begun > hang:
            time.sleep(60)
        fail = self.config.fails_after_s
        if fail is not None and time.monotonic() - self._begun > fail:
            raise DeviceError("the belt is torn")
        drop = self.config.drops_after_s
        if drop is not None and time.monotonic() - self._begun > drop:
            return self._row(self._position - 1.0)
        return self._row(self._position)

    def _row(self, position: float) -> AxisRow:
        return AxisRow.of(position=position, speed=self._speed, status=int(self._enabled))

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
        if self.config.tcp_port is not None:
            connect("localhost", self.config.tcp_port, 1.0, again=True).close()
        self._keep("rescued")

    def _keep(self, word: str) -> None:
        """Write a word that is new or that another process has replaced.

        A write in each cycle would hold the cycle up on a disk that others load.
        """
        path = self.config.path
        if self._kept is not None and self._kept == (word, *_version(path)):
            return
        draft = path.with_suffix(f".{os.getpid()}")
        draft.write_text(json.dumps({"word": word, "pid": os.getpid()}))
        self._kept = (word, *_version(draft))
        draft.replace(path)


def _version(path: Path) -> tuple[int, int]:
    """Return what differs between two files of one name: the inode and the time of writing, ns."""
    status = path.stat()
    return status.st_ino, status.st_mtime_ns


class HeldLinkConfig(LinkConfig):
    """No options."""


class HeldLink(Link):
    """A link that another process holds: opening it waits for them."""

    def open(self) -> None:
        time.sleep(60)

    def close(self) -> None:
        pass


def word(path: Path) -> str:
    """Return the last command of the axis."""
    told = json.loads(path.read_text())["word"]
    assert isinstance(told, str)
    return told


def two_axes(path: Path, **options: object) -> RigConfig:
    """Return a rig of the axis at ``path``, and another at ``second`` beside it."""
    single = rig(path, **options)  # type: ignore[arg-type]  # options of an axis
    (axis,) = single.devices.values()
    config = axis.config.model_copy(update={"path": path.with_name("second")})
    second = replace(axis, name="second", config=config)
    return replace(single, devices={"axis": axis, "second": second})


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
                declaration=FileAxis.declare(config),
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

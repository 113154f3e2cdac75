"""Devices are made safe over new links, all at the same time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pytest
from support.daemon import file_axis

from rigd.config.rig import LinkSetup, RigConfig
from rigd.engine.process.rescue import rescue
from rigd.sdk import Declaration, Driver, DriverConfig, Link, LinkConfig, Row


class Card(Link):
    """A card that brings all of its outputs to rest together, and counts how often."""

    rescued_whole: ClassVar[bool] = True
    reached = 0

    def open(self) -> None:
        """It is not opened by a rescue."""

    def rescue(self) -> None:
        """Bring all outputs to rest."""
        Card.reached += 1

    def close(self) -> None:
        """Nothing is open."""


class Drive(Driver[DriverConfig, Card]):
    """A drive on the card."""

    second_link: ClassVar[bool] = True

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        return Declaration(channels=(), row=Row)

    def open(self) -> None:
        """It is not opened by a rescue."""

    def arm(self) -> None:
        """It is not armed by a rescue."""

    def read(self, t_ns: int) -> None:
        """It measures nothing."""

    def make_safe(self) -> None:
        """It is rescued by its card."""

    def rescue(self) -> None:
        self.link.rescue()


@pytest.fixture
def rig(tmp_path: Path) -> RigConfig:
    axis = file_axis.rig(tmp_path / "axis")
    drives = {
        name: replace(
            axis.devices["axis"], name=name, driver_class=Drive, config=DriverConfig(), link="card"
        )
        for name in ("wheel", "brake", "belt")
    }
    links = {"card": LinkSetup("card", "card", Card, LinkConfig())}
    return replace(axis, devices={**axis.devices, **drives}, links=links)


def test_card_of_three_drives_is_reached_once(rig: RigConfig) -> None:
    Card.reached = 0
    found = rescue(rig, rig.devices)
    assert found.problems == []
    assert Card.reached == 1
    assert any("wheel, brake, belt were made safe" in each for each in found.done)
    assert len(found.done) == 2

"""A browser, a panel with a played rig, and a page that is watched."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser
from support.panel.browser import Watched, chromium
from support.panel.played_campaign import PROMPT, WEIGH
from support.panel.played_rig import PlayedRig
from support.panel.served import ServedPanel


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.fixture
def panel() -> Iterator[ServedPanel]:
    with ServedPanel(PlayedRig(prompts=(PROMPT, WEIGH))) as served:
        yield served


@pytest.fixture
def watched(browser: Browser) -> Iterator[Watched]:
    found = Watched(browser)
    yield found
    found.context.close()

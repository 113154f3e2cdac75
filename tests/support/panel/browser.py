"""A real browser before a panel: headless Chromium, which `make test` installs if need be.

If there is the package `chromium-headless-shell`, it is that, which has no windows: a page opens
in two thirds of the time.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, ConsoleMessage, Page, sync_playwright

#: The machine is shared and stalls: what takes a tenth of a second may take seconds.
PATIENCE_MS = 30_000
#: The first that is installed is taken.
PROGRAMS = ("chromium-headless-shell", "chromium", "chromium-browser")


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start Chromium; it draws by software, as the machine may have no graphics."""
    path = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if path is None:
        raise FileNotFoundError("chromium is not installed: run scripts/need chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


class Watched:
    """A page whose complaints are kept, and every address it asks for."""

    def __init__(
        self, browser: Browser, width: int = 1440, height: int = 900, *, has_touch: bool = False
    ) -> None:
        self.browser = browser
        self.context = browser.new_context(
            viewport={"width": width, "height": height}, has_touch=has_touch
        )
        self.context.set_default_timeout(PATIENCE_MS)
        self.page: Page = self.context.new_page()
        self.complaints: list[str] = []
        self.asked: list[str] = []
        self.page.on("console", self._heard)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))

    def _heard(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            self.complaints.append(message.text)

    def enter(self, link: str, name: str = "Ada") -> Page:
        """Open the panel by its link."""
        self.page.goto(link)
        self.page.get_by_label("Your name").fill(name)
        self.page.get_by_role("button", name="Open the panel").click()
        self.page.locator(".state-word").wait_for()
        return self.page
